//! Positions of the plies of a yarn: the smallest circle on which they do not intersect (Yu 2025, 5.3).
//!
//! The axes of P plies are the helices `(D cos(k z + 2 pi p / P), D sin(k z + 2 pi p / P), z)` with k = 2 pi
//! / pitch. The squared distance of a point on one axis at height 0 from a point on another at height z is
//! `2 D^2 (1 - cos(k z + 2 pi p / P)) + z^2`. It grows with D at every z, and so does its minimum over z.
//! Tubes of radius R do not intersect if that distance is at least 2 R, so bisection finds the smallest D.
//!
//! At z = pitch / P the next ply is at the position of this one, for any D, so no D works for a pitch below 2
//! P R. For longer pitches a ply never intersects itself: the radius of curvature of the helix, D + 1 / (D
//! k^2), is at least 2 / k > 2 P R / pi > R, and the helix returns only after a pitch.

use std::f64::consts::{PI, TAU};

/// Maximum circle that is tried, in ply radii. It only keeps the bisection finite: yarns are not springs of
/// that size.
const MAX_RADII: f64 = 50.0;
/// Number of points in z at which the minimum distance is searched before refinement.
const POINTS: usize = 512;

/// Distance D [um] of the axes of `plies` plies of radius `radius_um` from the yarn's axis: `R / sin(pi / P)`
/// for parallel plies, more for helices of pitch `ply_pitch_um`, and 0 for a single ply. `None` if plies of
/// that pitch intersect for every D up to 50 R.
pub fn ply_circle_um(plies: u32, radius_um: f64, ply_pitch_um: Option<f64>) -> Option<f64> {
    if plies < 2 {
        return Some(0.0);
    }
    let parallel = radius_um / (PI / f64::from(plies)).sin();
    let Some(pitch) = ply_pitch_um else { return Some(parallel) };
    let apart = |d: f64| min_distance(plies, d, pitch) >= 2.0 * radius_um;
    let (mut low, mut high) = (parallel, MAX_RADII * radius_um);
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

/// Minimum pitch [um] for which [`ply_circle_um`] finds a circle, slightly above `2 P R`; 0 for a single ply.
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

/// Minimum distance between two different axes on a circle of radius `d`. The previous ply is equivalent to
/// the next one seen from the other end.
fn min_distance(plies: u32, d: f64, pitch: f64) -> f64 {
    let squared = |phase: f64, z: f64| 2.0 * d * d * (1.0 - (TAU * z / pitch + phase).cos()) + z * z;
    let mut minimum = f64::INFINITY;
    for p in 1..plies {
        let phase = TAU * f64::from(p) / f64::from(plies);
        let at = |i: usize| pitch * (2.0 * i as f64 / POINTS as f64 - 1.0);
        let best = (0..=POINTS).min_by(|&a, &b| squared(phase, at(a)).total_cmp(&squared(phase, at(b)))).unwrap_or(0);
        // Golden-section search between the neighboring points.
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
        minimum = minimum.min(squared(phase, 0.5 * (a + b)));
    }
    minimum.sqrt()
}

/// Number of cells of a turn in which the ends of valid ranges are searched.
const CELLS: usize = 2048;

/// The plies of a yarn in the plane across it, relative to ply 0: its axis is the origin, and light comes
/// from +y (Yu 2025, Fig. 9).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyRing {
    /// Number of plies.
    pub plies: u32,
    /// Radius of each ply [um].
    pub radius_um: f64,
    /// Distance of the plies' axes from the yarn's axis [um].
    pub circle_um: f64,
}

impl PlyRing {
    /// Center of ply `p` [um] when ply 0 lies at azimuth `psi` [rad] about the yarn's axis.
    pub fn center(&self, p: u32, psi: f64) -> [f64; 2] {
        let turned = psi + TAU * f64::from(p) / f64::from(self.plies);
        [self.circle_um * (turned.cos() - psi.cos()), self.circle_um * (turned.sin() - psi.sin())]
    }

    /// Whether the line x = `h_um` from +y hits ply 0 first or, if it misses ply 0, no other ply (Yu 2025,
    /// Fig. 9b).
    pub fn is_valid(&self, psi: f64, h_um: f64) -> bool {
        let r2 = self.radius_um * self.radius_um;
        let top = r2 - h_um * h_um;
        (1..self.plies).all(|p| {
            let [x, y] = self.center(p, psi);
            let there = r2 - (h_um - x) * (h_um - x);
            // A line hits discs that do not overlap in the order of the heights of their centers.
            there <= 0.0 || (top > 0.0 && y + there.sqrt() <= top.sqrt())
        })
    }

    /// The valid psi at offset `h_um`, as disjoint ranges of [0, 2 pi) in ascending order. Bisection finds
    /// their ends to 1e-12.
    pub fn valid_ranges(&self, h_um: f64) -> Vec<(f64, f64)> {
        let at = |i: usize| TAU * i as f64 / CELLS as f64;
        let middle = |i: usize| TAU * (i as f64 + 0.5) / CELLS as f64;
        let mut ends = Vec::new();
        let mut inside = self.is_valid(middle(0), h_um);
        if inside {
            ends.push(0.0);
        }
        for i in 1..CELLS {
            if self.is_valid(middle(i), h_um) != inside {
                let (mut a, mut b) = (middle(i - 1), middle(i));
                while b - a > 1e-12 {
                    let c = 0.5 * (a + b);
                    if self.is_valid(c, h_um) == inside { a = c } else { b = c }
                }
                ends.push(0.5 * (a + b));
                inside = !inside;
            }
        }
        if inside {
            ends.push(at(CELLS));
        }
        ends.chunks_exact(2).map(|e| (e[0], e[1])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ranges agree with a walk along the line in small steps.
    #[test]
    fn valid_ranges_are_those_of_a_walk_along_the_line() {
        for plies in 2..=7 {
            let circle_um = ply_circle_um(plies, 50.0, None).unwrap();
            let ring = PlyRing { plies, radius_um: 50.0, circle_um };
            for h in [-65.0, -45.3, -10.0, 0.0, 30.0, 49.0, 52.0, 69.0] {
                let ranges = ring.valid_ranges(h);
                let total: f64 = ranges.iter().map(|r| r.1 - r.0).sum();
                assert!(total > 0.1 && total < TAU, "{plies} plies, h {h}: {total}");
                for i in 0..120 {
                    let psi = (f64::from(i) + 0.37) * TAU / 120.0;
                    let mut hit = None;
                    let mut y = 300.0;
                    while hit.is_none() && y > -300.0 {
                        hit = (0..plies).find(|&p| {
                            let [cx, cy] = ring.center(p, psi);
                            (h - cx).hypot(y - cy) < 50.0
                        });
                        y -= 0.25;
                    }
                    let valid = if f64::abs(h) < 50.0 { hit == Some(0) } else { hit.is_none() };
                    let near_an_end = ranges.iter().any(|r| (psi - r.0).abs() < 0.01 || (psi - r.1).abs() < 0.01);
                    let got = ranges.iter().any(|r| r.0 <= psi && psi < r.1);
                    assert!(got == valid || near_an_end, "{plies} plies, h {h}, psi {psi}: {got}, hit {hit:?}");
                }
            }
        }
    }

    #[test]
    fn parallel_plies_touch() {
        for plies in 2..=7 {
            let d = ply_circle_um(plies, 50.0, None).unwrap();
            let chord = 2.0 * d * (PI / f64::from(plies)).sin();
            assert!((chord - 100.0).abs() < 1e-9, "{plies}: neighbors {chord} um apart");
            // A pitch of a meter is practically parallel.
            let long = ply_circle_um(plies, 50.0, Some(1e6)).unwrap();
            assert!((long / d - 1.0).abs() < 1e-4, "{plies}: {long} against {d}");
        }
        assert_eq!(ply_circle_um(1, 50.0, Some(10.0)), Some(0.0));
    }

    /// Reference implementation: the points on all helices against the points on the first.
    #[test]
    fn helical_plies_touch_and_do_not_intersect() {
        for (plies, pitch) in [(2, 500.0), (2, 260.0), (3, 800.0), (4, 900.0), (7, 1500.0)] {
            let d = ply_circle_um(plies, 50.0, Some(pitch)).unwrap();
            let point = |p: u32, z: f64| {
                let a = TAU * (z / pitch + f64::from(p) / f64::from(plies));
                [d * a.cos(), d * a.sin(), z]
            };
            let mut minimum = f64::INFINITY;
            for p in 0..plies {
                for i in 0..200_000 {
                    let z = 2.0 * pitch * (f64::from(i) / 100_000.0 - 1.0);
                    let (a, b) = (point(0, 0.0), point(p, z));
                    let apart = (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
                    // On the ply itself, only points beyond a quarter turn are compared.
                    if p > 0 || z.abs() > 0.25 * pitch {
                        minimum = minimum.min(apart);
                    }
                }
            }
            assert!((minimum - 100.0).abs() < 0.02, "{plies} plies at pitch {pitch}: axes {minimum} um apart");
            let k = TAU / pitch;
            assert!(d + 1.0 / (d * k * k) > 50.0, "the helix bends more than its ply");
        }
    }

    #[test]
    fn short_pitches_have_no_circle() {
        for plies in 2..=7 {
            let minimum = least_ply_pitch_um(plies, 50.0);
            let bound = 100.0 * f64::from(plies);
            assert!(minimum > bound && minimum < 1.03 * bound, "{plies}: {minimum}");
            assert!(ply_circle_um(plies, 50.0, Some(1.001 * minimum)).is_some_and(f64::is_finite));
            assert_eq!(ply_circle_um(plies, 50.0, Some(0.999 * minimum)), None);
        }
    }
}
