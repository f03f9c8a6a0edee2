//! BVH over segments of strands, and the intersections of rays with them.

use super::bundle::{CAPSULES, Capsule, ThinRay};
use super::segment::{Cubic, Extent, RayFrame, band, cubic, point, slope, spline, tube};
use super::wide::{Wide, prefetch};
use super::{Basis, StrandShape, Strands};
use arrayvec::ArrayVec;
use glam::{DVec3, Vec3, Vec3A};
use multiversion::{multiversion, target::target_cfg_f};
use obvhs::aabb::Aabb;

/// Cost of finding a ray's first hit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceCost {
    /// Number of BVH nodes tested, each with up to eight boxes.
    pub nodes: u64,
    /// Number of bundles tested, each with up to eight capsules.
    pub bundles: u64,
    /// Number of segments intersected.
    pub segments: u64,
}

/// A hit on a segment.
#[derive(Clone, Copy, Debug)]
struct SegmentHit {
    t: f64,
    u: f64,
    /// First control point.
    first: u32,
}

/// Strands with a BVH over their segments.
pub struct StrandTree {
    strands: Strands,
    shape: StrandShape,
    boxes: Wide,
    bounds: Aabb,
}

/// A strand that contains a ray's start: hits on it up to this distance are skipped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skip {
    /// Number of the strand.
    pub strand: u32,
    /// Distance [mm].
    pub until: f64,
}

/// Hit of a ray on a strand.
#[derive(Clone, Copy, Debug)]
pub struct StrandHit {
    /// Distance along the ray [mm].
    pub t: f64,
    /// Hit point [mm]: on the tube, or on the band.
    pub position: DVec3,
    /// Point of the strand's center line there [mm].
    pub center: DVec3,
    /// Unit tangent, in the order of the control points.
    pub tangent: DVec3,
    /// Radius there [mm].
    pub radius_mm: f64,
    /// Offset of the ray from the line through the center along the tangent, relative to the radius, -1 to 1;
    /// positive on the side of increasing azimuth about the tangent, as in
    /// [`plywave_fiber::FiberQuery::h_rel`].
    pub h_rel: f64,
    /// Number of the strand.
    pub strand: u32,
    /// First control point of the segment.
    pub first_point: u32,
    /// Parameter along the segment, 0 to 1.
    pub u: f64,
}

impl StrandHit {
    /// Axes of the fiber: two across it, and the tangent. The first lies in the plane of the tangent and
    /// `reference`; it is arbitrary if the two are parallel.
    pub fn frame(&self, reference: Vec3) -> [DVec3; 3] {
        let x = reference.as_dvec3();
        let x = (x - self.tangent * self.tangent.dot(x)).normalize_or(self.tangent.any_orthonormal_vector());
        [x, self.tangent.cross(x), self.tangent]
    }

    /// Azimuth [rad] of the direction back along the ray, about the tangent, measured from the first axis of
    /// the frame.
    pub fn phi(&self, frame: &[DVec3; 3], direction: DVec3) -> f64 {
        (-direction.dot(frame[1])).atan2(-direction.dot(frame[0]))
    }

    /// Distance that a ray from this hit in unit direction `w` travels within the strand, where hits on it
    /// are skipped. The strand counts as straight with a length of 1000 radii.
    pub fn leave(&self, w: DVec3) -> Skip {
        let across = |v: DVec3| v - self.tangent * self.tangent.dot(v);
        let (p, d) = (across(self.position - self.center), across(w));
        let (a, b) = (d.length_squared(), p.dot(d));
        let c = (p.length_squared() - self.radius_mm * self.radius_mm).min(0.0);
        let max = 1000.0 * self.radius_mm;
        let out = if a > 0.0 { (-b + (b * b - a * c).max(0.0).sqrt()) / a } else { max };
        Skip { strand: self.strand, until: out.min(max) + 1e-3 * self.radius_mm }
    }
}

impl StrandTree {
    /// Builds the tree.
    pub fn new(strands: Strands, shape: StrandShape) -> StrandTree {
        StrandTree::by(strands, shape, Wide::new)
    }

    /// Builds a tree of another form over the same strands, split at medians, with the same hits.
    pub fn by_medians(strands: Strands, shape: StrandShape) -> StrandTree {
        StrandTree::by(strands, shape, Wide::by_medians)
    }

    fn by(strands: Strands, shape: StrandShape, build: impl FnOnce(&[Capsule], f32) -> Wide) -> StrandTree {
        let order = strands.basis().order();
        // A segment lies between its control points.
        let largest = |p: &[f32; 4]| p[..3].iter().fold(0.0f32, |max, x| max.max(x.abs())) + p[3];
        let max = strands.points().iter().map(largest).fold(0.0, f32::max);
        let mut capsules = Vec::with_capacity(strands.segments());
        for run in strands.runs() {
            for first in run.first..run.first + run.count + 1 - order as u32 {
                capsules.push(Capsule::new(&strands.points()[first as usize..][..order], first, max));
            }
        }
        let bounds = capsules.iter().fold(Aabb::empty(), |all, capsule| all.union(&capsule.aabb()));
        let bounds = if capsules.is_empty() { Aabb::new(Vec3A::ZERO, Vec3A::ZERO) } else { bounds };
        StrandTree { boxes: build(&capsules, max), strands, shape, bounds }
    }

    /// The strands.
    pub fn strands(&self) -> &Strands {
        &self.strands
    }

    /// Shape of the strands for intersection.
    pub fn shape(&self) -> StrandShape {
        self.shape
    }

    /// Corners of the box about all strands [mm].
    pub fn bounds(&self) -> [Vec3; 2] {
        [self.bounds.min.into(), self.bounds.max.into()]
    }

    /// First hit of a ray from `origin` in unit `direction`, beyond `after` and before `before` [mm], except
    /// within `skips`.
    pub fn first(&self, origin: DVec3, direction: DVec3, after: f64, before: f64, skips: &[Skip]) -> Option<StrandHit> {
        let hit = nearest::<false>(self, origin, direction, after, before, skips, &mut TraceCost::default())?;
        Some(self.hit(origin, direction, hit))
    }

    /// Cost of finding the first hit of a ray.
    pub fn cost(&self, origin: DVec3, direction: DVec3) -> TraceCost {
        let mut cost = TraceCost::default();
        nearest::<true>(self, origin, direction, 0.0, f64::INFINITY, &[], &mut cost);
        cost
    }

    /// Finds all hits of a ray beyond `after` and before `before` [mm], the nearest first, except within
    /// `skips`. A strand is hit again only after the ray has left it ([`StrandHit::leave`]). Replaces the
    /// contents of `found`. One traversal finds all hits, whereas [`StrandTree::first`] needs one per strand.
    pub fn each(
        &self,
        origin: DVec3,
        direction: DVec3,
        after: f64,
        before: f64,
        skips: &[Skip],
        found: &mut Vec<StrandHit>,
    ) {
        found.clear();
        let Some([from, to]) = self.reach(origin, direction) else { return };
        if to <= after || from >= before {
            return;
        }
        entries(self, (origin, direction), [from, to], [after, before], skips, found);
        found.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.first_point.cmp(&b.first_point)));
        let mut inside: Vec<Skip> = Vec::new();
        found.retain(|hit| {
            inside.retain(|skip| skip.until > hit.t);
            let is_new = inside.iter().all(|skip| skip.strand != hit.strand);
            if is_new {
                let Skip { strand, until } = hit.leave(direction);
                inside.push(Skip { strand, until: hit.t + until });
            }
            is_new
        });
    }

    /// Range of distances [mm] in which a ray is in the box of all strands.
    fn reach(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for k in 0..3 {
            let (low, high) = (f64::from(self.bounds.min[k]), f64::from(self.bounds.max[k]));
            if direction[k].abs() < 1e-300 {
                if !(low..=high).contains(&origin[k]) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - origin[k]) / direction[k], (high - origin[k]) / direction[k]);
            from = from.max(a.min(b));
            to = to.min(a.max(b));
        }
        // A slack of 1e-12 covers the rounding of the divisions.
        let slack = 1e-12 * (from.abs() + to.abs());
        (from <= to + slack && !self.boxes.is_empty()).then_some([from - slack, to + slack])
    }

    /// Bytes of memory of the tree, without the control points.
    pub fn memory_bytes(&self) -> usize {
        self.boxes.memory_bytes()
    }

    /// Distance beyond which a ray can hit the strand of a control point.
    #[inline(always)]
    fn after_skips(&self, after: f64, skips: &[Skip], point: u32) -> f64 {
        if skips.is_empty() {
            return after;
        }
        let strand = self.strand_of(point);
        skips.iter().filter(|skip| skip.strand == strand).fold(after, |after, skip| after.max(skip.until))
    }

    /// Number of the strand that a control point belongs to.
    fn strand_of(&self, point: u32) -> u32 {
        let runs = self.strands.runs();
        let behind = runs.partition_point(|run| run.first <= point);
        runs[behind.saturating_sub(1)].strand
    }

    /// Hit of a ray on the segment with this first control point, beyond `after` and up to `before`.
    #[inline(always)]
    fn meet(&self, frame: &RayFrame, first: u32, after: f64, before: f64) -> Option<(f64, f64)> {
        let points = &self.strands.points()[first as usize..];
        match self.strands.basis() {
            Basis::Linear => {
                let (a, b) = (frame.see(points[0]), frame.see(points[1]));
                let hit = match self.shape {
                    StrandShape::Tube => tube(a, b, after),
                    StrandShape::Band => band(a, b, after),
                };
                hit.filter(|(t, _)| *t <= before)
            }
            Basis::BSpline => {
                let p: &[[f32; 4]; 4] = points.first_chunk()?;
                spline(&cubic(p.map(|p| frame.see(p))), Extent::from_points(p), self.shape, after, before)
            }
        }
    }

    fn hit(&self, origin: DVec3, direction: DVec3, SegmentHit { t, u, first }: SegmentHit) -> StrandHit {
        let points = &self.strands.points()[first as usize..];
        let wide = |p: [f32; 4]| p.map(f64::from);
        let (at, along) = match self.strands.basis() {
            Basis::Linear => {
                let (a, b) = (wide(points[0]), wide(points[1]));
                let d: [f64; 4] = std::array::from_fn(|k| b[k] - a[k]);
                (std::array::from_fn(|k| a[k] + u * d[k]), d)
            }
            Basis::BSpline => {
                let c: Cubic = cubic(std::array::from_fn(|k| wide(points[k])));
                // Where the derivative vanishes, as at three equal points, the tangent continues the previous
                // direction.
                let mut along = slope(&c, u);
                if DVec3::new(along[0], along[1], along[2]).length_squared() < 1e-24 {
                    let (a, b) = (point(&c, 0.0), point(&c, 1.0));
                    along = std::array::from_fn(|k| b[k] - a[k]);
                }
                (point(&c, u), along)
            }
        };
        let center = DVec3::new(at[0], at[1], at[2]);
        let radius_mm = at[3];
        let tangent = DVec3::new(along[0], along[1], along[2]).normalize_or(direction.any_orthonormal_vector());
        let position = origin + direction * t;
        // Unit vector across the ray and the strand, on the side of increasing azimuth of the direction back
        // along the ray.
        let side = direction.cross(tangent).normalize_or(tangent.any_orthonormal_vector());
        let h_rel = ((position - center).dot(side) / radius_mm).clamp(-1.0, 1.0);
        StrandHit {
            t,
            position,
            center,
            tangent,
            radius_mm,
            h_rel,
            strand: self.strand_of(first),
            first_point: first,
            u,
        }
    }
}

/// The first hit of a ray, and the cost of finding it if `COUNT`.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn nearest<const COUNT: bool>(
    of: &StrandTree,
    origin: DVec3,
    direction: DVec3,
    after: f64,
    before: f64,
    skips: &[Skip],
    cost: &mut TraceCost,
) -> Option<SegmentHit> {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let [from, to] = of.reach(origin, direction)?;
    if to <= after || from >= before {
        return None;
    }
    let (start, moved, limit) = start_of(origin, direction, from.max(after), before.min(to));
    let (frame, thin) = (RayFrame::new(origin, direction), ThinRay::new(moved, direction));
    let low = (after - start) as f32;
    let mut best: Option<SegmentHit> = None;
    // Segments whose control points are on their way from memory.
    let mut due = ArrayVec::<u32, CAPSULES>::new();
    let nodes = of.boxes.traverse::<FMA>(moved, direction.as_vec3(), limit, |bundle, mut limit| {
        for first in due.drain(..) {
            cost.segments += u64::from(COUNT);
            let after = of.after_skips(after, skips, first);
            // At equal distances the first segment in input order wins, whatever the order of traversal.
            let max = best.map_or(before, |best| best.t + best.t.abs() * f64::EPSILON);
            let Some((t, u)) = of.meet(&frame, first, after, max) else { continue };
            if best.map_or(t < before, |best| t < best.t || t == best.t && first < best.first) {
                best = Some(SegmentHit { t, u, first });
                limit = limit.min(above((t - start) as f32));
            }
        }
        let Some((bundle, firsts)) = bundle else { return limit };
        cost.bundles += u64::from(COUNT);
        let mut candidates = bundle.candidates::<FMA>(&thin, low, limit);
        while candidates != 0 {
            let first = firsts[candidates.trailing_zeros() as usize % CAPSULES];
            candidates &= candidates - 1;
            prefetch(of.strands.points(), first as usize);
            due.push(first);
        }
        limit
    });
    if COUNT {
        cost.nodes += nodes;
    }
    best
}

/// Adds all entries of a ray into segments between two distances, in no order; `reach` is where the ray is in
/// the box of all strands.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn entries(
    of: &StrandTree,
    (origin, direction): (DVec3, DVec3),
    [from, to]: [f64; 2],
    [after, before]: [f64; 2],
    skips: &[Skip],
    found: &mut Vec<StrandHit>,
) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let (start, moved, limit) = start_of(origin, direction, from.max(after), before.min(to));
    let (frame, thin) = (RayFrame::new(origin, direction), ThinRay::new(moved, direction));
    let low = (after - start) as f32;
    of.boxes.traverse::<FMA>(moved, direction.as_vec3(), limit, |bundle, limit| {
        let Some((bundle, firsts)) = bundle else { return limit };
        let mut candidates = bundle.candidates::<FMA>(&thin, low, limit);
        while candidates != 0 {
            let first = firsts[candidates.trailing_zeros() as usize % CAPSULES];
            candidates &= candidates - 1;
            let mut after = of.after_skips(after, skips, first);
            // A bent segment may be entered more than once. All entries are recorded, because only the
            // neighbors' entries determine which of them count.
            while let Some((t, u)) = of.meet(&frame, first, after, before).filter(|(t, _)| *t < before) {
                found.push(of.hit(origin, direction, SegmentHit { t, u, first }));
                after = t;
            }
        }
        limit
    });
}

/// The part of a ray between two distances for the traversal: its start and its length. It starts at the box
/// of all strands, so that rounding errors scale with the strands' coordinates and not with the distance of
/// the ray's origin.
fn start_of(origin: DVec3, direction: DVec3, from: f64, to: f64) -> (f64, Vec3, f32) {
    let start = from.max(0.0);
    (start, (origin + direction * start).as_vec3(), above((to - start) as f32))
}

/// The second-next larger floating-point number.
fn above(x: f32) -> f32 {
    x.next_up().next_up()
}
