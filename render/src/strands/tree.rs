//! BVH over groups of segments of strands, and the intersections of rays with them.

use super::group::{Group, GroupRay, SEGMENTS};
use super::segment::{Cubic, Extent, RayFrame, band, cubic, point, slope, spline, tube};
use super::wide::{Wide, prefetch};
use super::{Basis, StrandShape, Strands};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;

/// Margin by which boxes grow for the rounding of traversal, relative to the largest coordinate. The error of
/// the slab test is some ten roundings of 6e-8: those of the ray's origin, of the difference, whose magnitude
/// is up to 3.5 coordinates, and of the product.
const PAD: f32 = 1.5e-6;

/// Control points that a group of segments comes from.
#[derive(Clone, Copy, Debug)]
struct Source {
    /// First control point of the group.
    first: u32,
    strand: u32,
    /// Number of segments.
    count: u32,
}

/// Cost of finding a ray's first hit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceCost {
    /// Number of BVH nodes tested, each with up to four boxes.
    pub nodes: u64,
    /// Number of groups whose chords are tested.
    pub groups: u64,
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
    strand: u32,
}

/// Strands with a BVH over their segments.
pub struct StrandTree {
    strands: Strands,
    shape: StrandShape,
    /// Segments in the order of the tree.
    groups: Vec<Group>,
    /// Sources of the groups, in the same order.
    sources: Vec<Source>,
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

    fn by(strands: Strands, shape: StrandShape, build: impl FnOnce(&[Aabb]) -> Wide) -> StrandTree {
        let basis = strands.basis();
        let order = basis.order();
        let mut sources = Vec::with_capacity(strands.segments().div_ceil(SEGMENTS) + strands.len());
        let mut boxes = Vec::with_capacity(sources.capacity());
        let mut bounds = Aabb::empty();
        for run in strands.runs() {
            let segments = run.count as usize + 1 - order;
            let groups = segments.div_ceil(SEGMENTS);
            for group in 0..groups {
                // Groups have sizes that differ by at most one segment.
                let (from, to) = (group * segments / groups, (group + 1) * segments / groups);
                let first = run.first + from as u32;
                let mut all = Aabb::empty();
                for k in from..to {
                    all = all.union(&aabb(&strands.points()[run.first as usize + k..][..order]));
                }
                bounds = bounds.union(&all);
                sources.push(Source { first, strand: run.strand, count: (to - from) as u32 });
                boxes.push(all);
            }
        }
        if sources.is_empty() {
            bounds = Aabb::new(Vec3A::ZERO, Vec3A::ZERO);
        }
        let pad = Vec3A::splat(PAD * bounds.min.abs().max(bounds.max.abs()).max_element());
        boxes.iter_mut().for_each(|b| *b = Aabb::new(b.min - pad, b.max + pad));
        let bounds = Aabb::new(bounds.min - pad, bounds.max + pad);
        let boxes = build(&boxes);
        let sources: Vec<Source> = boxes.order.iter().map(|&i| sources[i as usize]).collect();
        let max = bounds.min.abs().max(bounds.max.abs()).max_element();
        let of = |s: &Source| {
            let points = &strands.points()[s.first as usize..][..s.count as usize + order - 1];
            Group::new(points, basis, max)
        };
        let groups = sources.iter().map(of).collect();
        StrandTree { strands, shape, groups, sources, boxes, bounds }
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
        let hit = self.nearest::<false>(origin, direction, after, before, skips, &mut TraceCost::default())?;
        Some(self.hit(origin, direction, hit))
    }

    /// Cost of finding the first hit of a ray.
    pub fn cost(&self, origin: DVec3, direction: DVec3) -> TraceCost {
        let mut cost = TraceCost::default();
        self.nearest::<true>(origin, direction, 0.0, f64::INFINITY, &[], &mut cost);
        cost
    }

    fn nearest<const COUNT: bool>(
        &self,
        origin: DVec3,
        direction: DVec3,
        after: f64,
        before: f64,
        skips: &[Skip],
        cost: &mut TraceCost,
    ) -> Option<SegmentHit> {
        let [from, to] = self.reach(origin, direction)?;
        if to <= after || from >= before {
            return None;
        }
        let (start, moved, limit) = start_of(origin, direction, from.max(after), before.min(to));
        let (frame, chords) = (RayFrame::new(origin, direction), GroupRay::new(moved, direction));
        let low = (after - start) as f32;
        let mut best: Option<SegmentHit> = None;
        let ahead = |i| prefetch(&self.groups, i);
        let nodes = self.boxes.traverse(moved, direction.as_vec3(), limit, ahead, |i, mut limit| {
            let mut candidates = self.groups[i].candidates(&chords, low, limit);
            cost.groups += u64::from(COUNT);
            if candidates == 0 {
                return limit;
            }
            let source = self.sources[i];
            let after = after_skips(after, skips, source.strand);
            candidates &= (1 << source.count) - 1;
            while candidates != 0 {
                let first = source.first + candidates.trailing_zeros();
                candidates &= candidates - 1;
                cost.segments += u64::from(COUNT);
                // At equal distances the first segment in input order wins, whatever the order of traversal.
                let max = best.map_or(before, |best| best.t + best.t.abs() * f64::EPSILON);
                let Some((t, u)) = self.meet(&frame, first, after, max) else { continue };
                if best.map_or(t < before, |best| t < best.t || t == best.t && first < best.first) {
                    best = Some(SegmentHit { t, u, first, strand: source.strand });
                    limit = limit.min(above((t - start) as f32));
                }
            }
            limit
        });
        if COUNT {
            cost.nodes += nodes;
        }
        best
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
        let (start, moved, limit) = start_of(origin, direction, from.max(after), before.min(to));
        let (frame, chords) = (RayFrame::new(origin, direction), GroupRay::new(moved, direction));
        let low = (after - start) as f32;
        let ahead = |i| prefetch(&self.groups, i);
        self.boxes.traverse(moved, direction.as_vec3(), limit, ahead, |i, limit| {
            let mut candidates = self.groups[i].candidates(&chords, low, limit);
            if candidates == 0 {
                return limit;
            }
            let source = self.sources[i];
            candidates &= (1 << source.count) - 1;
            while candidates != 0 {
                let first = source.first + candidates.trailing_zeros();
                candidates &= candidates - 1;
                let mut after = after_skips(after, skips, source.strand);
                // A bent segment may be entered more than once. All entries are recorded, because only the
                // neighbors' entries determine which of them count.
                while let Some((t, u)) = self.meet(&frame, first, after, before).filter(|(t, _)| *t < before) {
                    found.push(self.hit(origin, direction, SegmentHit { t, u, first, strand: source.strand }));
                    after = t;
                }
            }
            limit
        });
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
        (from <= to + slack && !self.sources.is_empty()).then_some([from - slack, to + slack])
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

    fn hit(&self, origin: DVec3, direction: DVec3, SegmentHit { t, u, first, strand }: SegmentHit) -> StrandHit {
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
        StrandHit { t, position, center, tangent, radius_mm, h_rel, strand, first_point: first, u }
    }
}

/// The part of a ray between two distances for the traversal: its start and its length. It starts at the box
/// of all strands, so that rounding errors scale with the strands' coordinates and not with the distance of
/// the ray's origin.
fn start_of(origin: DVec3, direction: DVec3, from: f64, to: f64) -> (f64, Vec3, f32) {
    let start = from.max(0.0);
    (start, (origin + direction * start).as_vec3(), above((to - start) as f32))
}

/// Distance beyond which a ray can hit the strand.
fn after_skips(after: f64, skips: &[Skip], strand: u32) -> f64 {
    skips.iter().filter(|skip| skip.strand == strand).fold(after, |after, skip| after.max(skip.until))
}

/// The second-next larger floating-point number.
fn above(x: f32) -> f32 {
    x.next_up().next_up()
}

/// Box of a segment from its radius and its Bezier points, which lie closer to the curve than those of the
/// spline.
fn aabb(p: &[[f32; 4]]) -> Aabb {
    let radius = p.iter().map(|p| p[3]).fold(0.0, f32::max);
    let v = |k: usize| DVec3::new(f64::from(p[k][0]), f64::from(p[k][1]), f64::from(p[k][2]));
    let corners: [DVec3; 4] = if p.len() == 4 {
        let (a, b, c, d) = (v(0), v(1), v(2), v(3));
        [(a + 4.0 * b + c) / 6.0, (2.0 * b + c) / 3.0, (b + 2.0 * c) / 3.0, (b + 4.0 * c + d) / 6.0]
    } else {
        [v(0), v(0), v(1), v(1)]
    };
    let (mut low, mut high) = (corners[0], corners[0]);
    for c in &corners[1..] {
        low = low.min(*c);
        high = high.max(*c);
    }
    let r = DVec3::splat(f64::from(radius));
    let (low, high) = ((low - r).as_vec3(), (high + r).as_vec3());
    let step = |v: Vec3, up: bool| Vec3A::from(v.to_array().map(|x| if up { x.next_up() } else { x.next_down() }));
    Aabb::new(step(low, false), step(high, true))
}
