//! Relief: which fibers lie on a ply's surface, as factors of mean 1 on f_refl and f_high.
//!
//! The lobes are means over many packings, so a ply of them is a smooth tube. A ply in fact shows a few
//! fibers, each with a highlight along it. Seen across, in the plane at right angles to the fibers, a fiber
//! of radius r reflects light from the azimuth alpha, counted from the viewer's, where its normal halves the
//! angle, at `r sin(alpha / 2)` from its middle; roughness widens the line. Where the fibers' middles are at
//! x_c, then
//!
//! ```text
//! M_refl(h) = p sum_c v_c K((h - r sin(alpha/2) - x_c) / w),   x_c = -R' sin(phi_c - phi)
//! ```
//!
//! with K a bump of width w and integral 1, v_c of mean 1 the part of fiber c that others leave free, phi_c
//! its azimuth about the ply's axis, phi the viewer's. n fibers stand around the ply, at distances `2 pi / n`
//! that vary, and turn with the twist. Of f_high, which leaves all over a fiber, the bump is as wide as the
//! fiber.
//!
//! Over the turn of the ply, `p = (2 pi / n) R' cos(phi_c - phi)` makes the mean 1 for each h, light and
//! view. Bumps widen with the footprint of a query; where they are wider than fibers are apart, M fades to 1.

use super::place::{FibersAround, PlyPlace, mean_radius_um};
use crate::math::hash::{GAMMA, mix64};
use crate::spec::{Shape, YarnSpec};
use std::f32::consts::{FRAC_PI_2, TAU};

/// Largest shift of a fiber from its even place, over the distance of fibers.
const JITTER: f32 = 0.35;
/// Largest difference of a fiber's f_high from the mean.
const HIGH: f32 = 0.3;
/// Width of the bump of f_high, over a fiber's radius.
const HIGH_WIDTH: f32 = 1.1;
/// Bumps end at this many standard deviations, `sqrt(7)` for `(1 - u^2)^2`.
const ENDS: f32 = 2.645_751_3;
/// Width over the fibers' distance from which on M fades.
const WIDEST: f32 = 1.5;
/// Below this contrast there is none.
const LEAST: f32 = 0.02;

/// Fibers on the surface of the plies of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relief {
    /// Number of fibers around.
    count: f32,
    /// Distance of their middles from the axis [um].
    ring_um: f32,
    /// Share of the fibers around that others do not hide.
    free: f32,
    /// Radius of a fiber [um].
    fiber_um: f32,
    /// Widths of the bumps of f_refl and f_high [um].
    width_um: [f32; 2],
}

impl Relief {
    /// Of a spec's plies; none of yarns of several plies, of elliptical plies and of a single fiber.
    pub fn of_spec(spec: &YarnSpec) -> Option<Relief> {
        let [a, b] = spec.ply_radii_um();
        if spec.yarn.plies > 1 || (a - b).abs() > 1e-6 * a || spec.ply.fibers < 3 {
            return None;
        }
        let fiber_um = mean_radius_um(spec);
        let FibersAround { count, ring_um } = FibersAround::of_spec(spec, a);
        // Of packed sections: which share of a full ring fibers with highlights are.
        let free = (1.0 - 0.095 * (f64::from(spec.ply.fibers) / 5.0).ln()).clamp(0.3, 1.0) as f32;
        if !(ring_um > 0.5 * fiber_um as f32 && count >= 2.0) {
            return None;
        }
        // Slopes of a rough wall have the deviation alpha / sqrt(2) along an axis; faces that are not round
        // send the line elsewhere on each fiber.
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

    /// Mean number of highlights that a viewer at the lamp sees.
    pub fn highlights(&self) -> f32 {
        0.5 * self.count * self.free
    }

    /// Count, ring, free share, radius of a fiber and widths, for hosts with kernels of their own.
    pub(crate) fn numbers(&self) -> [f32; 6] {
        let [refl, high] = self.width_um;
        [self.count, self.ring_um, self.free, self.fiber_um, refl, high]
    }

    /// The factors of f_refl and f_high at a place, for light towards `w` in the ply's frame and the offset
    /// h [um]. Numbers that are not finite give 1.
    pub fn factors(&self, place: &PlyPlace, h_um: f32, w: [f32; 3]) -> [f32; 2] {
        let s = (w[0] * w[0] + w[1] * w[1]).sqrt();
        let cos = if s > 0.0 { (w[1] / s).clamp(-1.0, 1.0) } else { 1.0 };
        let sine = (0.5 - 0.5 * cos).max(0.0).sqrt().copysign(w[0]);
        let ok = h_um.is_finite() && sine.is_finite() && place.azimuth.is_finite();
        if !ok {
            return [1.0; 2];
        }
        [self.factor(place, h_um - self.fiber_um * sine, 0), self.factor(place, h_um - 0.5 * self.fiber_um * sine, 1)]
    }

    /// M of a kind where the middle of a fiber would have to be at `x`.
    fn factor(&self, place: &PlyPlace, x_um: f32, kind: usize) -> f32 {
        let apart = TAU / self.count;
        // A pixel's deviation along an axis, in the bump's.
        let own = self.width_um[kind];
        let wide = ENDS * place.deviation_um();
        let wide = (own * own + wide * wide).sqrt();
        let most = WIDEST * apart * self.ring_um;
        let contrast = if wide > most { most / wide } else { 1.0 };
        if contrast.is_nan() || contrast <= LEAST {
            return 1.0;
        }
        let (ring, width) = (self.ring_um, wide.min(most));
        let x = x_um.clamp(-ring, ring);
        // From azimuths to the sum, [x - width, x + width] and what jitter brings in.
        let asin = |x: f32| (x / ring).clamp(-1.0, 1.0).asin();
        let [low, high] = [place.azimuth - asin(x + width), place.azimuth - asin(x - width)];
        let first = (low / apart - 0.5 - JITTER).ceil();
        let last = (high / apart - 0.5 + JITTER).floor();
        let cells = ((last - first) as i32 + 1).clamp(0, self.count as i32);
        let mut sum = 0.0;
        for i in 0..cells {
            let cell = first + i as f32;
            let number = cell.rem_euclid(self.count) as u32;
            let bits = mix64((u64::from(place.ply) << 32 | u64::from(number)).wrapping_mul(GAMMA) ^ kind as u64);
            const UNIT: f32 = 1.0 / (1u32 << 24) as f32;
            let jitter = JITTER * (2.0 * UNIT * (bits & 0xff_ffff) as f32 - 1.0);
            let u = UNIT * (bits >> 40) as f32;
            let weight = match kind {
                0 => {
                    if u < self.free {
                        1.0 / self.free
                    } else {
                        0.0
                    }
                }
                _ => 1.0 + HIGH * (2.0 * u - 1.0),
            };
            let phi = (cell + 0.5 + jitter) * apart - place.azimuth;
            let cos = phi.cos();
            if phi.abs() < FRAC_PI_2 && cos > 0.0 {
                let t = (x + ring * phi.sin()) / width;
                let bump = (1.0 - t * t).max(0.0);
                sum += weight * cos * bump * bump;
            }
        }
        // The integral over the part of the bump that lies on the ring.
        let upto = |t: f32| {
            let t = t.clamp(-1.0, 1.0);
            t * (1.0 - t * t * (2.0 / 3.0 - 0.2 * t * t))
        };
        let integral = upto((ring - x) / width) + upto((ring + x) / width);
        let m = apart * ring * sum / (width * integral.max(0.1));
        1.0 + contrast * (m - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RELIEF: Relief = Relief { count: 9.0, ring_um: 20.0, free: 0.7, fiber_um: 7.0, width_um: [1.5, 9.0] };

    /// Over the azimuth and over plies the mean is 1, for each offset, light and footprint.
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
