//! Groups of consecutive segments of a strand, one cache line each, for a conservative first test of a ray.
//!
//! A group stores the chord of each segment and one reach for all of them: the largest radius plus, for a
//! spline, an eighth of its largest second derivative, which bounds the distance of the curve from its chord.
//! A ray that passes a chord at a greater distance, or ends before or begins behind it, misses the segment.
//! Arithmetic is in 32 bits; the reach includes a margin for rounding.

use super::Basis;
use super::segment::{Cubic, cubic, point};
use glam::{DVec3, Vec3, Vec4};

/// Segments per group.
pub const SEGMENTS: usize = 4;
/// Margin for rounding, relative to the largest coordinate: it covers the chord's ends, the ray's origin,
/// their difference, and its products with the ray's axes.
const PAD: f32 = 2e-6;

/// Chords of up to [`SEGMENTS`] segments; shorter groups repeat the last end.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Group {
    x: [f32; SEGMENTS + 1],
    y: [f32; SEGMENTS + 1],
    z: [f32; SEGMENTS + 1],
    reach: f32,
}

/// A ray in 32 bits, and two axes perpendicular to it.
#[derive(Clone, Copy, Debug)]
pub struct GroupRay {
    origin: Vec3,
    axes: [Vec3; 3],
}

impl GroupRay {
    /// Prepares a ray. The origin must lie within the largest coordinate of the groups.
    pub fn new(origin: Vec3, w: DVec3) -> GroupRay {
        let (x, y) = w.any_orthonormal_pair();
        GroupRay { origin, axes: [x, y, w].map(|v| v.as_vec3()) }
    }
}

impl Group {
    /// Group of the control points of consecutive segments, whose coordinates have a magnitude of at most
    /// `max`.
    pub fn new(points: &[[f32; 4]], basis: Basis, max: f32) -> Group {
        let order = basis.order();
        let count = (points.len() + 1 - order).min(SEGMENTS);
        let (mut ends, mut reach) = ([[0.0f32; 3]; SEGMENTS + 1], 0.0f64);
        for k in 0..count {
            let p: &[[f32; 4]] = &points[k..k + order];
            let radius = p.iter().map(|p| f64::from(p[3])).fold(0.0, f64::max);
            let (a, b, bend) = match basis {
                Basis::Linear => (p[0].map(f64::from), p[1].map(f64::from), 0.0),
                Basis::BSpline => {
                    let wide: [[f64; 4]; 4] = std::array::from_fn(|i| p[i].map(f64::from));
                    let c: Cubic = cubic(wide);
                    (point(&c, 0.0), point(&c, 1.0), bend(&wide))
                }
            };
            ends[k] = [a[0] as f32, a[1] as f32, a[2] as f32];
            ends[k + 1] = [b[0] as f32, b[1] as f32, b[2] as f32];
            reach = reach.max(radius + 0.125 * bend);
        }
        for k in count + 1..=SEGMENTS {
            ends[k] = ends[count];
        }
        let row = |c: usize| std::array::from_fn(|k| ends[k][c]);
        let reach = (reach as f32 + PAD * max) * (1.0 + 1e-5);
        Group { x: row(0), y: row(1), z: row(2), reach }
    }

    /// Bit mask of the segments that a ray may hit between the distances `after` and `before`.
    #[inline(always)]
    pub fn candidates(&self, ray: &GroupRay, after: f32, before: f32) -> u32 {
        let o = ray.origin;
        let ends = |v: &[f32; SEGMENTS + 1], o: f32| {
            let o = Vec4::splat(o);
            (Vec4::new(v[0], v[1], v[2], v[3]) - o, Vec4::new(v[1], v[2], v[3], v[4]) - o)
        };
        let ((ax, bx), (ay, by), (az, bz)) = (ends(&self.x, o.x), ends(&self.y, o.y), ends(&self.z, o.z));
        let along = |k: usize| {
            let d = ray.axes[k];
            (ax * d.x + ay * d.y + az * d.z, bx * d.x + by * d.y + bz * d.z)
        };
        let ((au, bu), (av, bv), (aw, bw)) = (along(0), along(1), along(2));
        // Squared distance between the ray and the chord, in the plane perpendicular to the ray.
        let (du, dv) = (bu - au, bv - av);
        let length = (du * du + dv * dv).max(Vec4::splat(1e-30));
        let s = (-(au * du + av * dv) / length).max(Vec4::ZERO).min(Vec4::ONE);
        let (u, v) = (au + s * du, av + s * dv);
        let off = u * u + v * v;
        let reach = Vec4::splat(self.reach);
        let hits = off.cmple(reach * reach)
            & (aw.min(bw) - reach).cmple(Vec4::splat(before))
            & (aw.max(bw) + reach).cmpge(Vec4::splat(after));
        hits.bitmask()
    }
}

/// Largest second derivative of a segment of a spline.
fn bend(p: &[[f64; 4]; 4]) -> f64 {
    let second = |k: usize| (0..3).map(|c| (p[k][c] - 2.0 * p[k + 1][c] + p[k + 2][c]).powi(2)).sum::<f64>();
    second(0).max(second(1)).sqrt()
}
