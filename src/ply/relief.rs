//! Relief: the individual fibers on a ply's surface, as factors of mean 1 on f_refl and f_high.
//!
//! The lobes are means over many packings of the fibers, so a ply shaded by them alone is a smooth tube. A
//! real ply shows a few fibers, each with a highlight along it. Consider the plane normal to the fibers. A
//! fiber of radius r reflects light that arrives at the azimuth alpha from the viewer's where its normal
//! bisects the two directions, `r sin(alpha / 2)` from its center; roughness widens the line. If the fibers'
//! centers are at x_c, then
//!
//! ```text
//! M_refl(h) = p sum_c v_c K((h - r sin(alpha/2) - x_c) / w),   x_c = -R' sin(phi_c - phi)
//! ```
//!
//! Here K is a bump of width w and integral 1; v_c, of mean 1, is the part of fiber c that other fibers do
//! not hide; phi_c is the azimuth of fiber c about the ply's axis and phi that of the viewer. The n fibers
//! stand around the ply at distances that vary about `2 pi / n`, and turn with the twist. The light of f_high
//! leaves from all of a fiber, so its bump is as wide as the fiber.
//!
//! With `p = (2 pi / n) R' cos(phi_c - phi)` the mean over a turn of the ply is 1 for each offset, light and
//! view. The bumps widen with the footprint of the query. Where they are wider than the distance between
//! fibers, M fades to 1.

use super::place::{FibersAround, PlyPlace, mean_radius_um};
use crate::math::hash::mix32;
use crate::math::simd::{halves, max, min, sin_cos_half_turns};
use crate::spec::{Shape, YarnSpec};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, TAU};

/// Maximum shift of a fiber from its even position, in distances between fibers.
const JITTER: f32 = 0.35;
/// Maximum relative difference of a fiber's f_high from the mean.
const HIGH: f32 = 0.3;
/// Width of the bump of f_high, in fiber radii.
const HIGH_WIDTH: f32 = 1.1;
/// Half-width of a bump in its standard deviations, which is `sqrt(7)` for `(1 - u^2)^2`.
const ENDS: f32 = 2.645_751_3;
/// Width of a bump, in distances between fibers, from which on M fades to 1.
const MAX_WIDTH: f32 = 1.5;
/// Fibers that are evaluated side by side.
const LANES: usize = 8;
/// Step of the hashes from fiber to fiber.
const GOLDEN: u32 = 0x9e37_79b9;
/// Contrast below which M is 1.
const MIN_CONTRAST: f32 = 0.02;

/// The fibers on the surface of a model's ply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relief {
    /// Number of fibers around the ply.
    count: f32,
    /// Distance of the fibers' centers from the ply's axis [um].
    ring_um: f32,
    /// Share of the fibers around the ply that other fibers do not hide.
    free: f32,
    /// Radius of a fiber [um].
    fiber_um: f32,
    /// Widths of the bumps of f_refl and f_high [um].
    width_um: [f32; 2],
}

impl Relief {
    /// The relief of a spec's ply; `None` for a yarn of several plies, an elliptical ply, or fewer than three
    /// fibers.
    pub fn of_spec(spec: &YarnSpec) -> Option<Relief> {
        let [a, b] = spec.ply_radii_um();
        if spec.yarn.plies > 1 || (a - b).abs() > 1e-6 * a || spec.ply.fibers < 3 {
            return None;
        }
        let fiber_um = mean_radius_um(spec);
        let FibersAround { count, ring_um } = FibersAround::of_spec(spec, a);
        // Fitted to packed cross sections: fibers with highlights as a share of a full ring.
        let free = (1.0 - 0.095 * (f64::from(spec.ply.fibers) / 5.0).ln()).clamp(0.3, 1.0) as f32;
        if !(ring_um > 0.5 * fiber_um as f32 && count >= 2.0) {
            return None;
        }
        // The slopes of a rough wall have the standard deviation alpha / sqrt(2) along an axis. Facets of
        // fibers that are not round move the line by a different amount on each fiber, which widens it
        // further.
        let faces =
            if matches!(spec.fiber.shape, Shape::Circle { .. } | Shape::HollowCircle { .. }) { 0.0 } else { 0.3 };
        let slope = (0.5 * spec.fiber.alpha_fiber.powi(2) + faces * faces).sqrt();
        let width = |deviation: f64| (f64::from(ENDS) * deviation) as f32;
        Some(Relief {
            count,
            ring_um,
            free,
            fiber_um: fiber_um as f32,
            width_um: [width(fiber_um * slope.max(0.02)), HIGH_WIDTH * fiber_um as f32],
        })
    }

    /// Mean number of highlights that a viewer sees if the light comes from the viewer's direction.
    pub fn highlights(&self) -> f32 {
        0.5 * self.count * self.free
    }

    /// Count, ring radius, free share, fiber radius and the two widths, for hosts with kernels of their own.
    pub(crate) fn numbers(&self) -> [f32; 6] {
        let [refl, high] = self.width_um;
        [self.count, self.ring_um, self.free, self.fiber_um, refl, high]
    }

    /// The factors of f_refl and f_high at a position, for light scattered towards `w` in the ply's frame and
    /// the offset h [um]. If an input is not finite, both factors are 1.
    #[inline(always)]
    pub fn factors(&self, place: &PlyPlace, h_um: f32, w: [f32; 3]) -> [f32; 2] {
        let s = (w[0] * w[0] + w[1] * w[1]).sqrt();
        let cos = if s > 0.0 { (w[1] / s).clamp(-1.0, 1.0) } else { 1.0 };
        let sine = (0.5 - 0.5 * cos).max(0.0).sqrt().copysign(w[0]);
        let ok = h_um.is_finite() && sine.is_finite() && place.azimuth.is_finite();
        if !ok {
            return [1.0; 2];
        }
        let spacing = TAU / self.count;
        // The bumps convolved with the footprint: the variances add.
        let (blur, max_width) = (ENDS * place.deviation_um(), MAX_WIDTH * spacing * self.ring_um);
        let ring = self.ring_um;
        let (mut width, mut contrast, mut x) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        for kind in 0..2 {
            let wide = (self.width_um[kind] * self.width_um[kind] + blur * blur).sqrt();
            contrast[kind] = if wide > max_width { max_width / wide } else { 1.0 };
            width[kind] = min(wide, max_width);
            x[kind] = min(max(h_um - [1.0, 0.5][kind] * self.fiber_um * sine, -ring), ring);
        }
        // The fibers whose bumps can overlap an offset: those within the width, widened by the jitter.
        let per_ring = 1.0 / ring;
        let first = about_asin(per_ring * max(x[0] + width[0], x[1] + width[1]));
        let last = about_asin(per_ring * min(x[0] - width[0], x[1] - width[1]));
        let per_spacing = 1.0 / spacing;
        let first = ((place.azimuth - first) * per_spacing - (0.5 + JITTER)).ceil();
        let last = ((place.azimuth - last) * per_spacing - (0.5 - JITTER)).floor();
        let count = ((last - first) as i32 + 1).clamp(0, self.count as i32) as usize;
        let sums = self.bumps(place, (first, count), x, width);
        let mut factors = [1.0; 2];
        for kind in 0..2 {
            if contrast[kind] > MIN_CONTRAST {
                // The integral over the part of the bump that lies on the ring.
                let (x, width) = (x[kind], width[kind]);
                let integral = upto((ring - x) / width) + upto((ring + x) / width);
                let m = spacing * ring * sums[kind] / (width * max(integral, 0.1));
                factors[kind] = 1.0 + contrast[kind] * (m - 1.0);
            }
        }
        factors
    }

    /// Sums of the weighted bumps of `count` fibers, of f_refl and f_high, at the offsets `x_um`.
    #[inline(always)]
    fn bumps(&self, place: &PlyPlace, (first, count): (f32, usize), x_um: [f32; 2], width_um: [f32; 2]) -> [f32; 2] {
        let key = mix32(place.ply);
        let per_count = 2.0 / self.count;
        let (low, per_free, per_width) =
            (FRAC_1_PI * place.azimuth, 1.0 / self.free, width_um.map(|width| 1.0 / width));
        let mut sums = [[0.0f32; LANES]; 2];
        let mut start = 0;
        while start < count {
            for l in 0..LANES {
                let cell = first + (start + l) as f32;
                let number = (cell - self.count * (cell / self.count).floor()) as i32 as u32;
                let bits = mix32(key.wrapping_add(number.wrapping_mul(GOLDEN)));
                let unit = |shift: u32, bits_of: u32| (bits >> shift & ((1 << bits_of) - 1)) as f32 + 0.5;
                let jitter = JITTER * (unit(22, 10) * (2.0 / 1024.0) - 1.0);
                let half_turns = per_count * (cell + 0.5 + jitter) - low;
                // Within a quarter of a turn both have their own sign.
                let (sin, cos, _) = sin_cos_half_turns::<false>(half_turns);
                let cos = if start + l < count && half_turns.abs() < 0.5 { cos } else { 0.0 };
                let of_refl = if unit(11, 11) * (1.0 / 2048.0) < self.free { per_free } else { 0.0 };
                let of_high = 1.0 + HIGH * (unit(0, 11) * (2.0 / 2048.0) - 1.0);
                for (kind, weight) in [of_refl, of_high].into_iter().enumerate() {
                    let t = (x_um[kind] + self.ring_um * sin) * per_width[kind];
                    let bump = max(1.0 - t * t, 0.0);
                    sums[kind][l] += weight * cos * bump * bump;
                }
            }
            start += LANES;
        }
        [halves(sums[0]), halves(sums[1])]
    }
}

/// Integral of a bump from its middle to `t` half-widths.
#[inline(always)]
fn upto(t: f32) -> f32 {
    let t = min(max(t, -1.0), 1.0);
    t * (1.0 - t * t * (2.0 / 3.0 - 0.2 * t * t))
}

/// Arc sine within 7e-5 [rad] (Abramowitz and Stegun 1964, 4.4.45), of a number clamped to [-1, 1].
#[inline(always)]
fn about_asin(sine: f32) -> f32 {
    let x = min(sine.abs(), 1.0);
    let p = 1.570_728_8 + x * (-0.212_114_4 + x * (0.074_261 - 0.018_729_3 * x));
    (FRAC_PI_2 - (1.0 - x).sqrt() * p).copysign(sine)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RELIEF: Relief = Relief { count: 9.0, ring_um: 20.0, free: 0.7, fiber_um: 7.0, width_um: [1.5, 9.0] };

    /// The mean over the azimuth and over plies is 1, for each offset, light and footprint.
    #[test]
    fn mean_is_one() {
        for (h, w, footprint_um) in [
            (0.0, [0.0, 1.0, 0.0], 0.0),
            (13.0, [0.6, 0.8, 0.0], 0.0),
            (-24.0, [0.6, -0.3, 0.7], 2.0),
            (26.9, [-0.9, -0.3, 0.2], 10.0),
            (5.0, [0.1, 0.2, 0.9], 100.0),
        ] {
            let (mut sums, n) = ([0.0f64; 2], 200_000);
            for i in 0..n {
                let place = PlyPlace { footprint_um, ..PlyPlace::new(i, 0.618_034 * i as f32 % TAU, 0.0) };
                let factors = RELIEF.factors(&place, h, w);
                (0..2).for_each(|k| sums[k] += f64::from(factors[k]));
            }
            let means = sums.map(|sum| sum / f64::from(n));
            println!("{h} {w:?} {footprint_um}: {means:.4?}");
            assert!(means.iter().all(|mean| (mean - 1.0).abs() < 0.01), "{h} {w:?} {footprint_um}: {means:?}");
        }
    }
}
