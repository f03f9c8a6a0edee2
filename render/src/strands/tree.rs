//! The BVH over the segments of strands, and what a ray meets first.

use super::group::{Group, GroupRay, SEGMENTS};
use super::segment::{Cubic, Extent, RayFrame, band, cubic, point, slope, spline, tube};
use super::wide::{Wide, prefetch};
use super::{Basis, StrandShape, Strands};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;

/// Rounding of the tree's traversal, over the largest coordinate: boxes grow by it. Slabs are off by some ten
/// roundings of 6e-8: those of the ray's origin, of the difference, whose size is up to
/// 3.5 coordinates, and of the product.
const PAD: f32 = 1.5e-6;

/// Where a group of segments comes from.
#[derive(Clone, Copy, Debug)]
struct Source {
    /// Its first control point.
    first: u32,
    strand: u32,
    /// Number of segments.
    count: u32,
}

/// What finding a ray's first hit takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceCost {
    /// Nodes of the BVH, each with up to four boxes.
    pub nodes: u64,
    /// Groups of segments whose chords are looked at.
    pub groups: u64,
    /// Segments that are intersected.
    pub segments: u64,
}

/// A segment that is met.
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
    /// The same.
    sources: Vec<Source>,
    boxes: Wide,
    bounds: Aabb,
}

/// A strand that a ray starts in: it is not met up to this distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skip {
    /// Number of the strand.
    pub strand: u32,
    /// Distance [mm].
    pub until: f64,
}

/// What a ray meets of a strand.
#[derive(Clone, Copy, Debug)]
pub struct StrandHit {
    /// Distance along the ray [mm].
    pub t: f64,
    /// Point where the ray is met [mm]: on the tube, or on the band.
    pub position: DVec3,
    /// Center of the strand there [mm].
    pub center: DVec3,
    /// Unit tangent, along growing numbers of points.
    pub tangent: DVec3,
    /// Radius there [mm].
    pub radius_mm: f64,
    /// Offset of the ray from the line along the tangent through the center, over the radius, -1 to 1; above
    /// 0 on the side of growing azimuth about the tangent, as
    /// [`plywave::FiberQuery::h_rel`] has it.
    pub h_rel: f64,
    /// Number of the strand.
    pub strand: u32,
    /// First control point of the segment.
    pub first_point: u32,
    /// Position on the segment, 0 to 1.
    pub u: f64,
}

impl StrandHit {
    /// Axes of the fiber: two across it, and the tangent. The first lies in the plane of the tangent and
    /// `reference`, or anywhere where the two are parallel.
    pub fn frame(&self, reference: Vec3) -> [DVec3; 3] {
        let x = reference.as_dvec3();
        let x = (x - self.tangent * self.tangent.dot(x)).normalize_or(self.tangent.any_orthonormal_vector());
        [x, self.tangent.cross(x), self.tangent]
    }

    /// Azimuth, about the tangent from the first axis of the frame, of the direction towards where the ray
    /// comes from [rad].
    pub fn phi(&self, frame: &[DVec3; 3], direction: DVec3) -> f64 {
        (-direction.dot(frame[1])).atan2(-direction.dot(frame[0]))
    }

    /// How far a ray from this place in the unit direction `w` goes before it is out of the strand: until
    /// then the strand is not met again. The strand counts as straight, and as left after 1000 radii.
    pub fn leave(&self, w: DVec3) -> Skip {
        let across = |v: DVec3| v - self.tangent * self.tangent.dot(v);
        let (p, d) = (across(self.position - self.center), across(w));
        let (a, b) = (d.length_squared(), p.dot(d));
        let c = (p.length_squared() - self.radius_mm * self.radius_mm).min(0.0);
        let most = 1000.0 * self.radius_mm;
        let out = if a > 0.0 { (-b + (b * b - a * c).max(0.0).sqrt()) / a } else { most };
        Skip { strand: self.strand, until: out.min(most) + 1e-3 * self.radius_mm }
    }
}

impl StrandTree {
    /// Builds the tree.
    pub fn new(strands: Strands, shape: StrandShape) -> StrandTree {
        StrandTree::by(strands, shape, Wide::new)
    }

    /// Builds a tree of another form over the same strands, split at medians: what a ray meets is the same.
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
                // As equal as they come.
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
        let most = bounds.min.abs().max(bounds.max.abs()).max_element();
        let of = |s: &Source| {
            let points = &strands.points()[s.first as usize..][..s.count as usize + order - 1];
            Group::new(points, basis, most)
        };
        let groups = sources.iter().map(of).collect();
        StrandTree { strands, shape, groups, sources, boxes, bounds }
    }

    /// The strands.
    pub fn strands(&self) -> &Strands {
        &self.strands
    }

    /// What a ray meets of them.
    pub fn shape(&self) -> StrandShape {
        self.shape
    }

    /// Corners of the box about all strands [mm].
    pub fn bounds(&self) -> [Vec3; 2] {
        [self.bounds.min.into(), self.bounds.max.into()]
    }

    /// What a ray from `origin` in the unit `direction` meets first, farther than `after` and nearer than
    /// `before` [mm]; the strands of `skips` only where it is out of them.
    pub fn first(&self, origin: DVec3, direction: DVec3, after: f64, before: f64, skips: &[Skip]) -> Option<StrandHit> {
        let met = self.nearest::<false>(origin, direction, after, before, skips, &mut TraceCost::default())?;
        Some(self.hit(origin, direction, met))
    }

    /// What finding the first hit of a ray takes.
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
            let mut near = self.groups[i].near(&chords, low, limit);
            cost.groups += u64::from(COUNT);
            if near == 0 {
                return limit;
            }
            let source = self.sources[i];
            let after = after_skips(after, skips, source.strand);
            near &= (1 << source.count) - 1;
            while near != 0 {
                let first = source.first + near.trailing_zeros();
                near &= near - 1;
                cost.segments += u64::from(COUNT);
                // Equal distances go to the segment that was given first, in whatever order the tree comes
                // by.
                let most = best.map_or(before, |best| best.t + best.t.abs() * f64::EPSILON);
                let Some((t, u)) = self.meet(&frame, first, after, most) else { continue };
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

    /// All that a ray meets farther than `after` and nearer than `before` [mm], the nearest first: a strand
    /// is met again only where the ray has been out of it ([`StrandHit::leave`]); the strands of `skips` only
    /// where it is out of them. What was in `found` is dropped. One traversal, where [`StrandTree::first`]
    /// takes one a strand.
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
            let mut near = self.groups[i].near(&chords, low, limit);
            if near == 0 {
                return limit;
            }
            let source = self.sources[i];
            near &= (1 << source.count) - 1;
            while near != 0 {
                let first = source.first + near.trailing_zeros();
                near &= near - 1;
                let mut after = after_skips(after, skips, source.strand);
                // A bent segment is entered more than once: all of it, since which of them count is known
                // only when those of its neighbors are.
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

    /// Distances between which a ray is in the box of all.
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
        // A part in 1e12 for the roundings of the divisions.
        let slack = 1e-12 * (from.abs() + to.abs());
        (from <= to + slack && !self.sources.is_empty()).then_some([from - slack, to + slack])
    }

    /// Where a ray meets the segment of a first control point, farther than `after` and up to `before`.
    #[inline(always)]
    fn meet(&self, frame: &RayFrame, first: u32, after: f64, before: f64) -> Option<(f64, f64)> {
        let points = &self.strands.points()[first as usize..];
        match self.strands.basis() {
            Basis::Linear => {
                let (a, b) = (frame.see(points[0]), frame.see(points[1]));
                let met = match self.shape {
                    StrandShape::Tube => tube(a, b, after),
                    StrandShape::Band => band(a, b, after),
                };
                met.filter(|(t, _)| *t <= before)
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
                // Where the curve stands still, as at three equal points, it goes on as it came.
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
        // Unit vector across the ray and the strand: the side of growing azimuth of the direction to where
        // the ray comes from.
        let side = direction.cross(tangent).normalize_or(tangent.any_orthonormal_vector());
        let h_rel = ((position - center).dot(side) / radius_mm).clamp(-1.0, 1.0);
        StrandHit { t, position, center, tangent, radius_mm, h_rel, strand, first_point: first, u }
    }
}

/// The tree's ray between two distances: where it starts, and the distance from there up to which it counts.
/// It starts where the box of all begins, so that its roundings are those of the strands' coordinates,
/// however far off the ray comes from.
fn start_of(origin: DVec3, direction: DVec3, from: f64, to: f64) -> (f64, Vec3, f32) {
    let start = from.max(0.0);
    (start, (origin + direction * start).as_vec3(), above((to - start) as f32))
}

/// Distance beyond which a strand is met.
fn after_skips(after: f64, skips: &[Skip], strand: u32) -> f64 {
    skips.iter().filter(|skip| skip.strand == strand).fold(after, |after, skip| after.max(skip.until))
}

/// The next larger number, twice over.
fn above(x: f32) -> f32 {
    x.next_up().next_up()
}

/// Box of a segment: that of its Bezier points, which lie closer than those of the spline, and the radius.
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
