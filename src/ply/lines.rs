//! A ply lit along single lines instead of a beam.
//!
//! A model's `1 - r_d(h)` is the probability m(x) that a line at lateral position x hits a fiber, blurred by
//! the beam: `1 - r_d = m * g`, with g a normal distribution of standard deviation s = w0 / 2. A host that
//! follows lines through several plies must not multiply such means: where two plies overlap in projection by
//! less than s, no line passes both, but the product of the two blurred r_d is up to a quarter at the rim.
//! The iteration of Richardson (1972, "Bayesian-based iterative method of image restoration") and Lucy (1974)
//! recovers m. It keeps m in [0, 1] and the integral over h to 0.2 %.

use super::data::energies::{PlyEnergies, spline_coefficients};
use crate::math::simd::{max, min};
use std::f64::consts::FRAC_PI_2;

/// Steps of the finer grid per standard deviation of the beam.
const STEPS: f64 = 4.0;
/// Number of iterations.
const ITERATIONS: usize = 60;

impl PlyEnergies {
    /// The energies with r_d of lines instead of a beam of standard deviation `sd_um` [um], on a grid of h
    /// with steps of at most a quarter of it. The shares of the light that hits fibers are unchanged.
    pub(super) fn of_lines(&self, sd_um: f64) -> PlyEnergies {
        let last = self.miss_h_um[self.miss_h_um.len() - 1];
        // An integer number of steps between two nodes, so that the nodes stay nodes.
        let per_step = (2.0 * last / (self.miss_h_um.len() - 1) as f64 / (sd_um / STEPS)).ceil().max(1.0) as usize;
        let columns = (self.miss_h_um.len() - 1) * per_step + 1;
        let step = 2.0 * last / (columns - 1) as f64;
        let h_um: Vec<f64> = (0..columns).map(|i| -last + step * i as f64).collect();
        let reach = (4.0 * sd_um / step).ceil() as usize;
        let kernel: Vec<f64> = {
            let g = |i: usize| (-0.5 * (step * (i as f64 - reach as f64) / sd_um).powi(2)).exp();
            let sum: f64 = (0..=2 * reach).map(g).sum();
            (0..=2 * reach).map(|i| g(i) / sum).collect()
        };
        let blurred = |v: &[f64]| -> Vec<f64> {
            let at = |i: usize| {
                let (low, high) = (i.saturating_sub(reach), (i + reach).min(columns - 1));
                (low..=high).map(|k| kernel[k + reach - i] * v[k]).sum()
            };
            (0..columns).map(at).collect()
        };
        let mut values = Vec::with_capacity(self.miss_theta_i.len() * columns);
        for theta_i in &self.miss_theta_i {
            let hits: Vec<f64> = h_um.iter().map(|h| 1.0 - self.at(*theta_i, *h).r_d).collect();
            let mut lines = hits.clone();
            for _ in 0..ITERATIONS {
                let got = blurred(&lines);
                let ratio: Vec<f64> = hits.iter().zip(&got).map(|(m, g)| if *g > 1e-9 { m / g } else { 0.0 }).collect();
                lines.iter_mut().zip(blurred(&ratio)).for_each(|(l, r)| *l = (*l * r).min(1.0));
            }
            values.extend(lines.iter().map(|l| 1.0 - l));
        }
        let miss = spline_coefficients(&values, self.miss_theta_i.len(), columns);
        PlyEnergies { miss_h_um: h_um, miss: miss.into_iter().map(|c| c.clamp(0.0, 1.0)).collect(), ..self.clone() }
    }
}

/// Number of latitudes in [`PassedLines`], and number of offsets.
pub(crate) const PASSED_ROWS: usize = 16;
pub(crate) const PASSED_COLUMNS: usize = 65;
/// Points at which r_d is sampled between two offsets.
const LOOKS: usize = 4;

/// Means of r_d of lines over intervals of offsets: the transmission of light spread evenly over an interval.
#[derive(Clone, Debug)]
pub(crate) struct PassedLines {
    /// `[PASSED_ROWS][PASSED_COLUMNS]`: the integral of r_d from the first offset, divided by the last
    /// offset. The rows are latitudes from 0 to pi/2.
    sums: Vec<f32>,
    last_h_um: f32,
}

impl PassedLines {
    /// Tabulates r_d of lines.
    pub(super) fn new(lines: &PlyEnergies) -> PassedLines {
        let last = lines.miss_h_um[lines.miss_h_um.len() - 1];
        let step = 2.0 * last / (PASSED_COLUMNS - 1) as f64;
        let mut sums = Vec::with_capacity(PASSED_ROWS * PASSED_COLUMNS);
        for row in 0..PASSED_ROWS {
            let theta_i = FRAC_PI_2 * row as f64 / (PASSED_ROWS - 1) as f64;
            let mut sum = 0.0;
            sums.push(0.0);
            for column in 1..PASSED_COLUMNS {
                for look in 0..LOOKS {
                    let h = -last + step * (column as f64 - (look as f64 + 0.5) / LOOKS as f64);
                    sum += step / LOOKS as f64 * lines.at(theta_i, h).r_d;
                }
                sums.push((sum / last) as f32);
            }
        }
        PassedLines { sums, last_h_um: last as f32 }
    }

    /// The table, and the maximum offset [um].
    pub(crate) fn numbers(&self) -> (&[f32], f32) {
        (&self.sums, self.last_h_um)
    }

    /// The mean of r_d over offsets from `low` to `high` [um] at a latitude [rad]; 1 beyond the ply.
    #[inline(always)]
    pub(crate) fn mean(&self, theta_i: f32, low: f32, high: f32) -> f32 {
        // A negative latitude is the mirror image: the ply is rotated about y.
        let (theta, [low, high]) = if theta_i < 0.0 { (-theta_i, [-high, -low]) } else { (theta_i, [low, high]) };
        let per = 1.0 / self.last_h_um;
        let (low, high) = (per * low, per * high);
        if low >= 1.0 || high <= -1.0 {
            return 1.0;
        }
        const PER_ROW: f32 = ((PASSED_ROWS - 1) as f64 / FRAC_PI_2) as f32;
        let row = node(min(theta * PER_ROW, (PASSED_ROWS - 1) as f32), PASSED_ROWS);
        min(max((self.until(row, high) - self.until(row, low)) / max(high - low, 1e-6), 0.0), 1.0)
    }

    /// The integral of r_d up to an offset, both relative to the last offset.
    #[inline(always)]
    fn until(&self, (row, s): (usize, f32), h: f32) -> f32 {
        let inside = min(max(h, -1.0), 1.0);
        let (column, t) = node((inside + 1.0) * (0.5 * (PASSED_COLUMNS - 1) as f32), PASSED_COLUMNS);
        let at = row * PASSED_COLUMNS + column;
        let Some([a, b, .., c, d]) = self.sums[at..].first_chunk::<{ PASSED_COLUMNS + 2 }>() else { return 0.0 };
        let (low, high) = (a + t * (b - a), c + t * (d - c));
        low + s * (high - low) + (h - inside)
    }
}

/// The node of a table of `count` before `x`, and the way to the next.
#[inline(always)]
fn node(x: f32, count: usize) -> (usize, f32) {
    let node = (x as usize).min(count - 2);
    (node, x - node as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means over intervals agree with sums of r_d, inside, on both sides of and beyond the ply. For a ply
    /// rotated about y they are mirrored.
    #[test]
    fn means_over_stretches_are_those_of_r_d() {
        let lines = blurred().of_lines(SD);
        let passed = PassedLines::new(&lines);
        for theta_i in [0.0, 0.42, -0.83, 1.3] {
            for (low, high) in [(-20.0, 20.0), (30.0, 50.0), (-49.0, -41.0), (44.0, 100.0), (80.0, 90.0)] {
                let r_d = |h: f64| if h.abs() > 70.0 { 1.0 } else { lines.at(theta_i, h).r_d };
                let want =
                    (0..400).map(|i| r_d(low + (high - low) * (f64::from(i) + 0.5) / 400.0)).sum::<f64>() / 400.0;
                let got = passed.mean(theta_i as f32, low as f32, high as f32);
                assert!((f64::from(got) - want).abs() < 0.015, "{theta_i}, {low} to {high}: {got}, {want}");
            }
        }
    }

    const SD: f64 = 5.0;

    /// A ply of radius 45 that hits every line within 42 and none beyond 48. The rim moves outwards with
    /// theta_i.
    fn hits(theta_i: f64, x: f64) -> f64 {
        ((48.0 + 4.0 * theta_i - x.abs()) / 6.0).clamp(0.0, 1.0)
    }

    fn blurred() -> PlyEnergies {
        let axis = |low: f64, high: f64, n: usize| -> Vec<f64> {
            (0..n).map(|i| low + (high - low) * i as f64 / (n - 1) as f64).collect()
        };
        let (theta_i, h_um) = (axis(0.0, 1.4, 15), axis(-70.0, 70.0, 57));
        let mean = |t: f64, h: f64| {
            let g = |i: i32| (-0.5 * (0.05 * f64::from(i) / SD).powi(2)).exp();
            let (mut sum, mut weight) = (0.0, 0.0);
            for i in -400..=400 {
                sum += g(i) * hits(t, h + 0.05 * f64::from(i));
                weight += g(i);
            }
            1.0 - sum / weight
        };
        let values: Vec<f64> =
            theta_i.iter().flat_map(|t| h_um.iter().map(|h| mean(*t, *h)).collect::<Vec<_>>()).collect();
        PlyEnergies {
            miss: spline_coefficients(&values, 15, 57),
            share_refl: vec![0.25; values.len()],
            share_high: vec![0.75; values.len()],
            share_theta_i: theta_i.clone(),
            share_h_um: h_um.clone(),
            miss_theta_i: theta_i,
            miss_h_um: h_um,
        }
    }

    #[test]
    fn lines_are_found_and_their_number_kept() {
        let (beam, lines) = (blurred(), blurred().of_lines(SD));
        for t in [0.0, 0.7, 1.4] {
            let r_d = |e: &PlyEnergies, h: f64| e.at(t, h).r_d;
            let (mut off, mut sums) = (0.0f64, [0.0; 2]);
            for i in -700..=700 {
                let h = 0.1 * f64::from(i);
                let want = 1.0 - hits(t, h);
                off += 0.1 * (r_d(&lines, h) - want).abs();
                sums[0] += 0.1 * (1.0 - r_d(&beam, h));
                sums[1] += 0.1 * (1.0 - r_d(&lines, h));
            }
            let before: f64 =
                (-700..=700).map(|i| 0.1 * f64::from(i)).map(|h| 0.1 * (r_d(&beam, h) - 1.0 + hits(t, h)).abs()).sum();
            assert!((sums[0] - sums[1]).abs() < 0.2, "{t}: {sums:?} um of lines");
            assert!(off < 1.7 && off < 0.3 * before, "{t}: off by {off} um, before by {before}");
        }
    }

    /// Two plies side by side whose projections overlap by 8 um let no line through. Two plies that touch let
    /// through only lines that pass both rims.
    #[test]
    fn plies_that_overlap_let_no_line_through() {
        let through = |e: &PlyEnergies, apart: f64| -> f64 {
            let r_d = |h: f64| if h.abs() > 70.0 { 1.0 } else { e.at(0.0, h).r_d };
            (-300..=300).map(|i| 0.1 * f64::from(i)).map(|x| 0.1 * r_d(0.5 * apart + x) * r_d(x - 0.5 * apart)).sum()
        };
        let (beam, lines) = (blurred(), blurred().of_lines(SD));
        for (apart, want) in [(82.0, 0.0), (90.0, 1.0)] {
            let got = [through(&beam, apart), through(&lines, apart)];
            println!("{apart} um apart: {got:.2?} um of lines, beam and lines; exactly {want}");
            assert!((got[1] - want).abs() < 0.35 && got[0] > want + 0.5, "{apart}: {got:?}");
        }
    }
}
