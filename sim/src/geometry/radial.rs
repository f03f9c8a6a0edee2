//! Radial density of the fibers in a ply.
//!
//! Hard particles at equilibrium line the wall of their container; a ply has no wall. Cross sections of spun
//! yarns are densest in the inner part, fall towards the surface and end there with a ragged rim (Hickie and
//! Chaikin 1974; Neckar and Ibrahim 2003; docs/explain/papers/yu_2025.md, departure 20). With the ply scaled
//! to the unit disc, the target filled fraction is
//!
//! ```text
//! d(r) = d0 (1 - r^m),   d0 = (1 + 2/m) phi,   share of the fibers within r:  A(r) = ((m + 2) r^2 - 2 r^(m + 2)) / m
//! ```
//!
//! where phi is the filled fraction of the whole ply. m is 2, a parabola, if the middle is then no denser
//! than random packings of the outlines; else m gives the middle that density. The density of loose plies
//! falls all the way; tight plies have a dense core and a thin rim.
//!
//! The packing's trial moves are accepted by the Metropolis rule for the energy
//! `sum_k (A_k - A(r_k))^2 / (2 tau^2)` over rings r_k, where A_k is the share within. Fibers count as discs
//! of their area.

use nalgebra::Vector2;
use std::f64::consts::PI;

/// Number of rings at which the share is controlled.
const RINGS: usize = 12;
/// Standard deviation tau of the share within a ring, at the end and at the start.
const TAU_END: f64 = 0.015;
const TAU_START: f64 = 0.2;
/// Densest middle of random packings: discs end at 0.82 (Berryman 1983, Phys. Rev. A 27, 1053); the value for
/// other outlines is a choice.
const CORE_DISCS: f64 = 0.82;
const CORE_OTHERS: f64 = 0.72;
/// Range of the profile's exponent.
const MIN_EXPONENT: f64 = 2.0;
const MAX_EXPONENT: f64 = 40.0;
/// Minimum number of fibers for a radial density.
pub(super) const MIN_FIBERS: usize = 4;

/// Exponent m of the profile of a ply whose fibers fill the fraction `phi`; `discs` is false for outlines
/// other than circles.
pub(super) fn exponent(phi: f64, discs: bool) -> f64 {
    let core = if discs { CORE_DISCS } else { CORE_OTHERS };
    // The density of the middle is (1 + 2/m) phi = core.
    let m = if core > phi { 2.0 / (core / phi - 1.0) } else { MAX_EXPONENT };
    m.clamp(MIN_EXPONENT, MAX_EXPONENT)
}

/// Target share of the fibers within r, 0 to 1.
pub(super) fn target_share(r: f64, m: f64) -> f64 {
    let r = r.clamp(0.0, 1.0);
    ((m + 2.0) * r * r - 2.0 * r.powf(m + 2.0)) / m
}

/// Shares of the fibers within rings, updated with the arrangement.
pub(super) struct Radial {
    radii: [f64; 2],
    /// Radius of each fiber's disc in the scaled ply, and its share of the total area.
    discs: Vec<(f64, f64)>,
    wanted: [f64; RINGS],
    held: [f64; RINGS],
    /// `[fiber][ring]`: the fiber's part of `held`.
    parts: Vec<[f64; RINGS]>,
    weight: f64,
}

impl Radial {
    /// State for fibers of these areas [um^2] in a ply of these semi-axes.
    pub fn new(areas: &[f64], radii: [f64; 2], discs: bool) -> Radial {
        let (all, ply) = (areas.iter().sum::<f64>(), PI * radii[0] * radii[1]);
        let m = exponent(all / ply, discs);
        Radial {
            radii,
            discs: areas.iter().map(|a| ((a / ply).sqrt(), a / all)).collect(),
            wanted: std::array::from_fn(|k| target_share(ring(k), m)),
            held: [0.0; RINGS],
            parts: vec![[0.0; RINGS]; areas.len()],
            weight: 0.0,
        }
    }

    /// Recounts an arrangement; `progress` from 0 to 1 sets the strictness of the target shares.
    pub fn count(&mut self, centers: impl Iterator<Item = Vector2<f64>>, progress: f64) {
        let tau = TAU_START * (TAU_END / TAU_START).powf(progress.clamp(0.0, 1.0));
        self.weight = 0.5 / (tau * tau);
        self.held = [0.0; RINGS];
        for (i, center) in centers.enumerate() {
            self.parts[i] = self.part(i, center);
            self.held.iter_mut().zip(&self.parts[i]).for_each(|(held, part)| *held += part);
        }
    }

    /// Contribution of fiber `i` at `center` to the shares.
    fn part(&self, i: usize, center: Vector2<f64>) -> [f64; RINGS] {
        let from_axis = (center.x / self.radii[0]).hypot(center.y / self.radii[1]);
        let (radius, share) = self.discs[i];
        std::array::from_fn(|k| share * disc_within(from_axis, radius, ring(k)))
    }

    /// Energy gained if fiber `i` moves to `center`, and its new contribution.
    pub fn gain(&self, i: usize, center: Vector2<f64>) -> (f64, [f64; RINGS]) {
        let part = self.part(i, center);
        let gain = (0..RINGS).map(|k| {
            let off = self.held[k] - self.wanted[k];
            let moved = off + part[k] - self.parts[i][k];
            moved * moved - off * off
        });
        (self.weight * gain.sum::<f64>(), part)
    }

    /// Sets the contribution of fiber `i`.
    pub fn set(&mut self, i: usize, part: [f64; RINGS]) {
        for k in 0..RINGS {
            self.held[k] += part[k] - self.parts[i][k];
        }
        self.parts[i] = part;
    }
}

/// Radius of ring `k`; the last ring lies within the surface, which contains all fibers.
fn ring(k: usize) -> f64 {
    (k as f64 + 1.0) / (RINGS as f64 + 1.0)
}

/// Fraction of the disc of radius `b` at the distance `d` from the axis that lies within `r` of it.
fn disc_within(d: f64, b: f64, r: f64) -> f64 {
    if d + b <= r {
        return 1.0;
    }
    if d >= r + b {
        return 0.0;
    }
    if d + r <= b {
        return (r / b).powi(2);
    }
    // The intersection is a lens of two circles.
    let angle = |own: f64, other: f64| ((d * d + own * own - other * other) / (2.0 * d * own)).clamp(-1.0, 1.0).acos();
    let (x, y) = (angle(b, r), angle(r, b));
    let lens = b * b * (x - x.sin() * x.cos()) + r * r * (y - y.sin() * y.cos());
    lens / (PI * b * b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_are_cut_by_rings_as_points_in_them_are() {
        for (d, b, r) in [(0.5, 0.2, 0.55), (0.1, 0.3, 0.15), (0.8, 0.15, 0.7), (0.0, 0.3, 0.2), (0.3, 0.1, 0.9)] {
            let n = 400;
            let inside = (0..n * n).filter(|i| {
                let at = |k: usize| b * (2.0 * (k as f64 + 0.5) / f64::from(n as u32) - 1.0);
                let (x, y) = (at(i / n), at(i % n));
                x * x + y * y < b * b && (d + x).hypot(y) < r
            });
            let want = inside.count() as f64 * 4.0 / (PI * (n * n) as f64);
            assert!((disc_within(d, b, r) - want).abs() < 2e-3, "{d} {b} {r}: {}, want {want}", disc_within(d, b, r));
        }
    }

    #[test]
    fn profiles_hold_all_fibers_and_no_middle_is_too_dense() {
        for phi in [0.1, 0.3, 0.5, 0.675, 0.75, 0.85] {
            for discs in [false, true] {
                let m = exponent(phi, discs);
                assert!((target_share(1.0, m) - 1.0).abs() < 1e-12 && target_share(0.0, m) == 0.0);
                let middle = phi * target_share(1e-3, m) / 1e-6;
                assert!(middle <= 0.821 || m == MAX_EXPONENT, "{phi}: {middle}");
                assert!(
                    (1..50).all(|k| target_share(f64::from(k) / 50.0, m) > target_share(f64::from(k - 1) / 50.0, m))
                );
            }
        }
    }
}
