//! Where the plies of a yarn lie: the least circle on which they do not intersect (Yu 2025, 5.3).
//!
//! The axes of P plies are the helices `(D cos(k z + 2 pi p / P), D sin(k z + 2 pi p / P), z)`, k = 2 pi / pitch. The squared distance of a point of one
//! at height 0 to a point of another at height z is `2 D^2 (1 - cos(k z + 2 pi p / P)) + z^2`: it grows with D at every z, and so does its
//! least value over z. Tubes of radius R are apart where that is at least 2 R, so the least D is found by bisection.
//!
//! At z = pitch / P the next ply stands where this one stood, whatever D is: no D serves a pitch below 2 P R. From there on a ply
//! never meets itself: the helix' radius of curvature, D + 1 / (D k^2), is at least 2 / k > 2 P R / pi > R, and it comes back only after a pitch.

use std::f64::consts::{PI, TAU};

/// Largest circle that is tried, in ply radii. It only keeps the bisection finite: springs of that size are no yarns.
const MOST_RADII: f64 = 50.0;
/// Points of z on which the least distance is looked for before it is refined.
const POINTS: usize = 512;

/// Distance D [um] of the axes of `plies` plies of radius `radius_um` from the yarn's axis: `R / sin(pi / P)` for parallel plies, more for
/// helices of pitch `ply_pitch_um`; 0 for a single ply. None when the plies of that pitch intersect for every D up to 50 R.
pub fn ply_circle_um(plies: u32, radius_um: f64, ply_pitch_um: Option<f64>) -> Option<f64> {
    if plies < 2 {
        return Some(0.0);
    }
    let parallel = radius_um / (PI / f64::from(plies)).sin();
    let Some(pitch) = ply_pitch_um else { return Some(parallel) };
    let apart = |d: f64| least_distance(plies, d, pitch) >= 2.0 * radius_um;
    let (mut low, mut high) = (parallel, MOST_RADII * radius_um);
    if !apart(high) {
        return None;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if apart(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    Some(high)
}

/// Least pitch [um] that [`ply_circle_um`] finds a circle for; a little above `2 P R`. 0 for a single ply.
pub fn least_ply_pitch_um(plies: u32, radius_um: f64) -> f64 {
    if plies < 2 {
        return 0.0;
    }
    let (mut low, mut high) = (2.0 * f64::from(plies) * radius_um, 4.0 * f64::from(plies) * radius_um);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if ply_circle_um(plies, radius_um, Some(middle)).is_some() {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// Least distance of two different axes on a circle of radius `d`. The ply before this one is the next one seen from the other end.
fn least_distance(plies: u32, d: f64, pitch: f64) -> f64 {
    let squared = |phase: f64, z: f64| 2.0 * d * d * (1.0 - (TAU * z / pitch + phase).cos()) + z * z;
    let mut least = f64::INFINITY;
    for p in 1..plies {
        let phase = TAU * f64::from(p) / f64::from(plies);
        let at = |i: usize| pitch * (2.0 * i as f64 / POINTS as f64 - 1.0);
        let best = (0..=POINTS).min_by(|&a, &b| squared(phase, at(a)).total_cmp(&squared(phase, at(b)))).unwrap_or(0);
        // Golden section within the neighboring points.
        let (mut a, mut b) = (at(best.saturating_sub(1)), at(best + 1));
        let ratio = 0.5 * (5.0f64.sqrt() - 1.0);
        for _ in 0..60 {
            let (c, e) = (b - ratio * (b - a), a + ratio * (b - a));
            if squared(phase, c) < squared(phase, e) {
                b = e;
            } else {
                a = c;
            }
        }
        least = least.min(squared(phase, 0.5 * (a + b)));
    }
    least.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_plies_touch() {
        for plies in 2..=7 {
            let d = ply_circle_um(plies, 50.0, None).unwrap();
            let chord = 2.0 * d * (PI / f64::from(plies)).sin();
            assert!((chord - 100.0).abs() < 1e-9, "{plies}: neighbors {chord} um apart");
            // A pitch of a metre is as good as none.
            let long = ply_circle_um(plies, 50.0, Some(1e6)).unwrap();
            assert!((long / d - 1.0).abs() < 1e-4, "{plies}: {long} against {d}");
        }
        assert_eq!(ply_circle_um(1, 50.0, Some(10.0)), Some(0.0));
    }

    /// The slow twin: points on all helices against points on the first.
    #[test]
    fn helical_plies_touch_and_do_not_intersect() {
        for (plies, pitch) in [(2, 500.0), (2, 260.0), (3, 800.0), (4, 900.0), (7, 1500.0)] {
            let d = ply_circle_um(plies, 50.0, Some(pitch)).unwrap();
            let point = |p: u32, z: f64| {
                let a = TAU * (z / pitch + f64::from(p) / f64::from(plies));
                [d * a.cos(), d * a.sin(), z]
            };
            let mut least = f64::INFINITY;
            for p in 0..plies {
                for i in 0..200_000 {
                    let z = 2.0 * pitch * (f64::from(i) / 100_000.0 - 1.0);
                    let (a, b) = (point(0, 0.0), point(p, z));
                    let apart = (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
                    // Of the ply itself only what lies beyond a quarter turn is another place.
                    if p > 0 || z.abs() > 0.25 * pitch {
                        least = least.min(apart);
                    }
                }
            }
            assert!((least - 100.0).abs() < 0.02, "{plies} plies at pitch {pitch}: axes {least} um apart");
            let k = TAU / pitch;
            assert!(d + 1.0 / (d * k * k) > 50.0, "the helix bends more than its ply");
        }
    }

    #[test]
    fn short_pitches_have_no_circle() {
        for plies in 2..=7 {
            let least = least_ply_pitch_um(plies, 50.0);
            let bound = 100.0 * f64::from(plies);
            assert!(least > bound && least < 1.03 * bound, "{plies}: {least}");
            assert!(ply_circle_um(plies, 50.0, Some(1.001 * least)).is_some_and(f64::is_finite));
            assert_eq!(ply_circle_um(plies, 50.0, Some(0.999 * least)), None);
        }
    }
}
