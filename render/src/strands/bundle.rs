//! Bundles of the capsules about eight segments of strands, in one cache line.
//!
//! A box along the axes about a thin segment that runs across them is mostly empty; a capsule about its chord
//! is not. A ray is tested against the eight capsules at once. The capsule of a segment reaches beyond its
//! chord by its largest radius and, for a spline, by an eighth of its largest second derivative, which bounds
//! the distance of the curve from the chord. Arithmetic is in 32 bits; the reach includes a margin for
//! rounding.

use super::segment::{Cubic, cubic, point};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use plywave::math::simd::{fma, max, min};

/// Largest number of capsules of a bundle.
pub const CAPSULES: usize = 8;
/// Largest 8-bit coordinate.
pub const STEPS: f32 = 255.0;
/// The bit of each of eight lanes. It is a table, since shifts by other amounts are not one instruction for
/// all lanes.
pub const BITS: [u32; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
/// Margin for rounding, relative to the largest coordinate: it covers the chord's ends, the ray's origin,
/// their difference, and its products with the ray's axes.
const PAD: f32 = 4e-6;

/// A ray in 32 bits, and two axes perpendicular to it.
#[derive(Clone, Copy, Debug)]
pub struct ThinRay {
    origin: [f32; 3],
    /// Two axes across the ray, and its direction.
    axes: [[f32; 3]; 3],
}

impl ThinRay {
    /// Prepares a ray. The origin must lie within the largest coordinate of the capsules.
    pub fn new(origin: Vec3, w: DVec3) -> ThinRay {
        let (x, y) = w.any_orthonormal_pair();
        ThinRay { origin: origin.to_array(), axes: [x, y, w].map(|v| v.as_vec3().to_array()) }
    }
}

/// The capsule about a segment of a strand.
#[derive(Clone, Copy, Debug)]
pub struct Capsule {
    ends: [Vec3A; 2],
    reach: f32,
    /// First control point of the segment.
    pub first: u32,
}

impl Capsule {
    /// Capsule about the segment of these control points, which begin with number `first`; coordinates have a
    /// magnitude of at most `max`.
    pub fn new(points: &[[f32; 4]], first: u32, max: f32) -> Capsule {
        let radius = points.iter().map(|p| f64::from(p[3])).fold(0.0, f64::max);
        let (ends, bend) = match points.first_chunk() {
            None => ([points[0].map(f64::from), points[1].map(f64::from)], 0.0),
            Some(points) => {
                let wide = points.map(|p| p.map(f64::from));
                let c: Cubic = cubic(wide);
                ([point(&c, 0.0), point(&c, 1.0)], bend(&wide))
            }
        };
        let ends = ends.map(|p| Vec3A::new(p[0] as f32, p[1] as f32, p[2] as f32));
        let reach = ((radius + 0.125 * bend) as f32 + PAD * max) * (1.0 + 1e-5);
        Capsule { ends, reach, first }
    }

    /// The box about the capsule.
    pub fn aabb(&self) -> Aabb {
        let [a, b] = self.ends;
        Aabb::new(a.min(b) - self.reach, a.max(b) + self.reach)
    }
}

/// Largest second derivative of a segment of a spline.
fn bend(p: &[[f64; 4]; 4]) -> f64 {
    let second = |k: usize| (0..3).map(|c| (p[k][c] - 2.0 * p[k + 1][c] + p[k + 2][c]).powi(2)).sum::<f64>();
    second(0).max(second(1)).sqrt()
}

/// Eight capsules of one radius. Coordinates of the ends are `corner + step * n` for the 8-bit number n, and
/// the radius `step * n`.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Bundle {
    corner: [f32; 3],
    /// The upper half of the bits of the step.
    step: u16,
    reach: u8,
    /// Bit mask of the capsules that exist.
    exist: u8,
    ends: [[[u8; CAPSULES]; 3]; 2],
}

const _: () = assert!(size_of::<Bundle>() == 64);

impl Bundle {
    /// Bundle of up to eight capsules.
    pub fn new(capsules: impl Iterator<Item = Capsule> + Clone) -> Bundle {
        let (mut low, mut high, mut widest) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY, 0.0f32);
        for Capsule { ends: [a, b], reach, .. } in capsules.clone() {
            (low, high) = (low.min(a.min(b)), high.max(a.max(b)));
            widest = widest.max(reach);
        }
        // Room for the reach, which grows by the rounding of the ends (the diagonal of half a step) and is
        // rounded up.
        let step = ((high - low).max_element().max(widest) / (STEPS - 2.0)).max(f32::MIN_POSITIVE);
        // The upper bits alone, rounded up.
        let bits = (step.to_bits() >> 16) as u16 + 1;
        let mut of = Bundle { corner: low.to_array(), step: bits, reach: 0, exist: 0, ends: [[[0; CAPSULES]; 3]; 2] };
        of.reach = (widest / of.step() + 0.867).ceil() as u8;
        for (i, Capsule { ends, .. }) in capsules.take(CAPSULES).enumerate() {
            for (e, end) in ends.into_iter().enumerate() {
                let at = ((end - low) / of.step()).round().to_array();
                (0..3).for_each(|k| of.ends[e][k][i] = at[k] as u8);
            }
            of.exist |= 1 << i;
        }
        of
    }

    #[inline(always)]
    fn step(&self) -> f32 {
        f32::from_bits(u32::from(self.step) << 16)
    }

    /// Bit mask of the capsules that a ray may hit between the distances `after` and `before`.
    #[inline(always)]
    pub fn candidates<const FMA: bool>(&self, ray: &ThinRay, after: f32, before: f32) -> u32 {
        let (mut a, mut b) = ([[0.0f32; CAPSULES]; 3], [[0.0f32; CAPSULES]; 3]);
        let (corner, o, step) = (self.corner, ray.origin, self.step());
        let reach = step * f32::from(self.reach);
        for k in 0..3 {
            let d = ray.axes[k];
            let shift = d[0] * (corner[0] - o[0]) + d[1] * (corner[1] - o[1]) + d[2] * (corner[2] - o[2]);
            let d = [d[0] * step, d[1] * step, d[2] * step];
            for (to, [x, y, z]) in [(&mut a, &self.ends[0]), (&mut b, &self.ends[1])] {
                for i in 0..CAPSULES {
                    let along = fma::<FMA>(d[0], f32::from(x[i]), shift);
                    to[k][i] = fma::<FMA>(d[2], f32::from(z[i]), fma::<FMA>(d[1], f32::from(y[i]), along));
                }
            }
        }
        let mut hits = [0u32; CAPSULES];
        for i in 0..CAPSULES {
            // Squared distance between the ray and the chord, in the plane perpendicular to the ray.
            let (du, dv) = (b[0][i] - a[0][i], b[1][i] - a[1][i]);
            let length = max(fma::<FMA>(du, du, dv * dv), 1e-30);
            let s = min(max(-fma::<FMA>(a[0][i], du, a[1][i] * dv) / length, 0.0), 1.0);
            let (u, v) = (fma::<FMA>(s, du, a[0][i]), fma::<FMA>(s, dv, a[1][i]));
            let is_near = fma::<FMA>(u, u, v * v) <= reach * reach;
            let begins = min(a[2][i], b[2][i]) - reach <= before;
            let ends = max(a[2][i], b[2][i]) + reach >= after;
            hits[i] = if is_near & begins & ends { BITS[i] } else { 0 };
        }
        let mut all = 0;
        for hit in hits {
            all |= hit;
        }
        all & u32::from(self.exist)
    }
}
