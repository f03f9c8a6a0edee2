//! The BVH over the segments of strands, and what a ray meets first.

use super::segment::{Cubic, Extent, RayFrame, band, cubic, point, slope, spline, tube};
use super::{Basis, StrandShape, Strands};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit};

/// Rounding of the tree's traversal, over the largest coordinate: boxes grow by it. Slabs are off by 4 roundings of 6e-8, and components of directions below
/// 1.2e-7 count as that.
const PAD: f32 = 1e-6;

/// Control points of a segment, in one line of the cache; a straight one has two.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Points([[f32; 4]; 4]);

/// Where a segment comes from.
#[derive(Clone, Copy, Debug)]
struct Segment {
    /// Its first control point.
    first: u32,
    strand: u32,
}

/// Strands with a BVH over their segments.
pub struct StrandTree {
    strands: Strands,
    shape: StrandShape,
    /// In the order of the tree.
    segments: Vec<Segment>,
    /// The same.
    points: Vec<Points>,
    bvh: CwBvh,
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
    /// Place where the ray is met [mm]: on the tube, or on the band.
    pub position: DVec3,
    /// Center of the strand there [mm].
    pub center: DVec3,
    /// Unit tangent, along growing numbers of points.
    pub tangent: DVec3,
    /// Radius there [mm].
    pub radius_mm: f64,
    /// Offset of the ray from the line along the tangent through the center, over the radius, -1 to 1; above 0 on the side of growing azimuth about the tangent, as
    /// [`plywave::FiberQuery::h_rel`] has it.
    pub h_rel: f64,
    /// Number of the strand.
    pub strand: u32,
    /// First control point of the segment.
    pub first_point: u32,
    /// Place on the segment, 0 to 1.
    pub u: f64,
}

impl StrandHit {
    /// Axes of the fiber: two across it, and the tangent. The first lies in the plane of the tangent and `reference`, or anywhere where the two are parallel.
    pub fn frame(&self, reference: Vec3) -> [DVec3; 3] {
        let x = reference.as_dvec3();
        let x = (x - self.tangent * self.tangent.dot(x)).normalize_or(self.tangent.any_orthonormal_vector());
        [x, self.tangent.cross(x), self.tangent]
    }

    /// Azimuth, about the tangent from the first axis of the frame, of the direction towards where the ray comes from [rad].
    pub fn phi(&self, frame: &[DVec3; 3], direction: DVec3) -> f64 {
        (-direction.dot(frame[1])).atan2(-direction.dot(frame[0]))
    }

    /// How far a ray from this place in the unit direction `w` goes before it is out of the strand: until then the strand is not met again. The strand counts as
    /// straight, and as left after 1000 radii.
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
        StrandTree::by(strands, shape, crate::bvh::build)
    }

    /// Builds a tree of another form over the same strands, split at medians: what a ray meets is the same.
    pub fn by_medians(strands: Strands, shape: StrandShape) -> StrandTree {
        StrandTree::by(strands, shape, crate::bvh::by_medians)
    }

    fn by(strands: Strands, shape: StrandShape, build: impl FnOnce(&[Aabb]) -> CwBvh) -> StrandTree {
        let order = strands.basis().order();
        let mut segments = Vec::with_capacity(strands.segments());
        let mut boxes = Vec::with_capacity(strands.segments());
        let mut bounds = Aabb::empty();
        for run in strands.runs() {
            for first in run.first..=run.first + run.count - order as u32 {
                let p = &strands.points()[first as usize..][..order];
                let aabb = aabb(p);
                bounds = bounds.union(&aabb);
                segments.push(Segment { first, strand: run.strand });
                boxes.push(aabb);
            }
        }
        if segments.is_empty() {
            bounds = Aabb::new(Vec3A::ZERO, Vec3A::ZERO);
        }
        let pad = Vec3A::splat(PAD * bounds.min.abs().max(bounds.max.abs()).max_element());
        boxes.iter_mut().for_each(|b| *b = Aabb::new(b.min - pad, b.max + pad));
        let bounds = Aabb::new(bounds.min - pad, bounds.max + pad);
        let bvh = build(&boxes);
        let segments: Vec<Segment> = bvh.primitive_indices.iter().map(|&i| segments[i as usize]).collect();
        let of = |s: &Segment| {
            let p = &strands.points()[s.first as usize..][..order];
            Points(std::array::from_fn(|k| p[k.min(order - 1)]))
        };
        let points = segments.iter().map(of).collect();
        StrandTree { strands, shape, segments, points, bvh, bounds }
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

    /// What a ray from `origin` in the unit `direction` meets first, farther than `after` and nearer than `before` [mm]; the strands of `skips` only where it is out of them.
    pub fn first(&self, origin: DVec3, direction: DVec3, after: f64, before: f64, skips: &[Skip]) -> Option<StrandHit> {
        let (t, i, u) = self.nearest(origin, direction, after, before, skips)?;
        Some(self.hit(origin, direction, (t, i, u)))
    }

    fn nearest(
        &self,
        origin: DVec3,
        direction: DVec3,
        after: f64,
        before: f64,
        skips: &[Skip],
    ) -> Option<(f64, usize, f64)> {
        let [from, to] = self.reach(origin, direction)?;
        if to <= after || from >= before {
            return None;
        }
        let (start, ray) = self.ray(origin, direction, from.max(after), before.min(to));
        let frame = RayFrame::new(origin, direction);
        let mut best = (before, usize::MAX, 0.0);
        self.bvh.ray_traverse(ray, &mut RayHit::none(), |_, i| {
            let segment = &self.segments[i];
            let left =
                |after: f64, skip: &Skip| if skip.strand == segment.strand { after.max(skip.until) } else { after };
            let after = skips.iter().fold(after, left);
            // Equal distances go to the segment that was given first, in whatever order the tree comes by.
            let limit = best.0 + if best.1 == usize::MAX { 0.0 } else { best.0.abs() * f64::EPSILON };
            match self.meet(&frame, &self.points[i].0, after, limit) {
                Some((t, u))
                    if t < best.0
                        || t == best.0
                            && best.1 != usize::MAX
                            && self.segments[i].first < self.segments[best.1].first =>
                {
                    best = (t, i, u);
                    above((t - start) as f32)
                }
                _ => f32::INFINITY,
            }
        });
        (best.1 != usize::MAX).then_some(best)
    }

    /// All that a ray meets farther than `after` and nearer than `before` [mm], the nearest first: a strand is met again only where the ray has been out of it
    /// ([`StrandHit::leave`]); the strands of `skips` only where it is out of them. What was in `found` is dropped. One traversal, where [`StrandTree::first`] takes one a strand.
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
        let (_, ray) = self.ray(origin, direction, from.max(after), before.min(to));
        let frame = RayFrame::new(origin, direction);
        self.bvh.ray_traverse_anyhit(ray, |_, i| {
            let strand = self.segments[i].strand;
            let mut after =
                skips.iter().filter(|skip| skip.strand == strand).fold(after, |after, skip| after.max(skip.until));
            // A bent segment may be met more than once.
            while let Some((t, u)) = self.meet(&frame, &self.points[i].0, after, before).filter(|(t, _)| *t < before) {
                let hit = self.hit(origin, direction, (t, i, u));
                after = t + hit.leave(direction).until;
                found.push(hit);
            }
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

    /// The tree's ray between two distances, and where it starts: where the box of all begins, so that its roundings are those of the strands' coordinates, however far off the
    /// ray comes from.
    fn ray(&self, origin: DVec3, direction: DVec3, from: f64, to: f64) -> (f64, Ray) {
        let start = from.max(0.0);
        let moved = origin + direction * start;
        // Adding 0 turns -0 into 0: the tree takes a ray's octant from the sign of its inverse in one place and of itself in another.
        let ray = Ray::new(
            Vec3A::from(moved.as_vec3()),
            Vec3A::from(direction.as_vec3()) + Vec3A::ZERO,
            0.0,
            above((to - start) as f32),
        );
        (start, ray)
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
        (from <= to + slack && !self.segments.is_empty()).then_some([from - slack, to + slack])
    }

    #[inline(always)]
    fn meet(&self, frame: &RayFrame, p: &[[f32; 4]; 4], after: f64, before: f64) -> Option<(f64, f64)> {
        match self.strands.basis() {
            Basis::Linear => {
                let (a, b) = (frame.see(p[0]), frame.see(p[1]));
                let met = match self.shape {
                    StrandShape::Tube => tube(a, b, after),
                    StrandShape::Band => band(a, b, after),
                };
                met.filter(|(t, _)| *t <= before)
            }
            Basis::BSpline => spline(&cubic(p.map(|p| frame.see(p))), Extent::of(p), self.shape, after, before),
        }
    }

    fn hit(&self, origin: DVec3, direction: DVec3, (t, i, u): (f64, usize, f64)) -> StrandHit {
        let segment = &self.segments[i];
        let points = &self.strands.points()[segment.first as usize..];
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
        // Unit vector across the ray and the strand: the side of growing azimuth of the direction to where the ray comes from.
        let side = direction.cross(tangent).normalize_or(tangent.any_orthonormal_vector());
        let h_rel = ((position - center).dot(side) / radius_mm).clamp(-1.0, 1.0);
        StrandHit {
            t,
            position,
            center,
            tangent,
            radius_mm,
            h_rel,
            strand: segment.strand,
            first_point: segment.first,
            u,
        }
    }
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
