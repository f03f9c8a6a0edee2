//! Fits the exit positions of a ply to the exits recorded in a table.
//!
//! At each incidence, absorption and azimuth, the table contains the distribution of the lateral position t
//! at which light leaves. Polynomials of the azimuth (`plywave::ply::ExitOffsets`) are fitted to its mean by
//! least squares, weighted by the light of the azimuth, with equal weight for each absorption. The densities
//! about these means have one length per kind of light for all incidences, fitted to the recorded cumulative
//! distributions by least squares weighted by the light. Displacements along the axis are the quantiles of
//! the recorded distributions.

use plywave::ply::{
    DRIFT_QUANTILES, EXIT_KINDS, EXIT_LENGTH_UM, EXIT_LENGTHS, EXIT_TERMS, ExitDrift, ExitOffsets, ExitShape,
    USUAL_EXIT_LENGTHS, exit_terms,
};
use plywave_tables::table::{DISPLACEMENTS, Table, displacement};
use rayon::prelude::*;

/// Number of trial lengths, evenly spaced in their logarithm, and number of rounds of the search for the
/// lengths of clear and of dark fibers, which depend on each other.
const TRIED: usize = 28;
const ROUNDS: usize = 3;
/// Fraction of the light of a kind below which its length is undetermined.
const MIN_LIGHT: f64 = 1e-3;

/// Normal equations of `N` coefficients.
struct Fit<const N: usize> {
    normal: nalgebra::SMatrix<f64, N, N>,
    right: nalgebra::SVector<f64, N>,
}

impl<const N: usize> Fit<N> {
    fn new() -> Fit<N> {
        Fit { normal: nalgebra::SMatrix::zeros(), right: nalgebra::SVector::zeros() }
    }

    fn add(&mut self, terms: [f64; N], value: f64, weight: f64) {
        let terms = nalgebra::SVector::from(terms);
        self.normal += weight * terms * terms.transpose();
        self.right += weight * value * terms;
    }

    fn solve(mut self) -> [f64; N] {
        // The ridge makes the offset small where there is hardly any light.
        let ridge = 1e-3 * self.normal.trace() / N as f64 + 1e-12;
        for i in 0..N {
            self.normal[(i, i)] += ridge;
        }
        self.normal.cholesky().map_or([0.0; N], |c| c.solve(&self.right).into())
    }
}

/// Exits of one incidence, absorption and azimuth, as in the table.
struct Recorded<'a> {
    incidence: usize,
    /// Channel: 0 for single reflection, then the absorptions.
    channel: usize,
    terms: [f32; EXIT_TERMS],
    light: f64,
    /// Fraction of the light of all azimuths.
    part: f64,
    /// Fractions over equal parts of [-1, 1].
    shares: &'a [f32],
}

/// Exits of a table, except at azimuths without light; empty for a table without exits.
fn recorded(table: &Table) -> Vec<Recorded<'_>> {
    let Some(exit) = table.exit.as_ref() else { return Vec::new() };
    let (h, channels) = (table.h_um.len(), 1 + table.sigma_per_um.len());
    let mut found = Vec::new();
    for at in 0..table.theta_i.len() * h * channels {
        let (incidence, channel) = (at / channels, at % channels);
        let (row, column) = (incidence / h, incidence % h);
        let slice = match channel {
            0 => table.refl_slice(row, column),
            _ => table.high_slice(row, column, channel - 1),
        };
        let lights: Vec<f64> = (0..exit.azimuths).map(|a| light(table, slice, a, exit.azimuths)).collect();
        let all: f64 = lights.iter().sum();
        for (azimuth, light) in lights.iter().enumerate().filter(|_| all > 0.0) {
            let first = (at * exit.azimuths + azimuth) * exit.positions;
            let shares = &exit.shares[first..first + exit.positions];
            if shares.iter().any(|share| *share > 0.0) {
                let phi = std::f64::consts::TAU * (azimuth as f64 + 0.5) / exit.azimuths as f64;
                let terms = exit_terms(phi.cos() as f32, phi.sin() as f32);
                found.push(Recorded { incidence, channel, terms, light: *light, part: light / all, shares });
            }
        }
    }
    found
}

/// Fraction v of the clear fibers' kind, by channel; 0 for single reflection, which is a separate kind.
fn clear_shares(table: &Table) -> Vec<f64> {
    let of = |sigma: &f64| 1.0 / (1.0 + EXIT_LENGTH_UM * sigma);
    std::iter::once(0.0).chain(table.sigma_per_um.iter().map(of)).collect()
}

/// Fits the offsets of a table; `None` for a table without exits.
pub fn fit_exits(table: &Table) -> Option<ExitOffsets> {
    table.exit.as_ref()?;
    let (all, clear) = (recorded(table), clear_shares(table));
    let mut mean = Vec::with_capacity(table.theta_i.len() * table.h_um.len() * EXIT_KINDS * EXIT_TERMS);
    let mut remaining = all.iter().peekable();
    for incidence in 0..table.theta_i.len() * table.h_um.len() {
        let mut refl = Fit::<EXIT_TERMS>::new();
        let mut high = Fit::<{ 2 * EXIT_TERMS }>::new();
        while let Some(of) = remaining.next_if(|of| of.incidence == incidence) {
            let Some(value) = mean_of(of.shares) else { continue };
            let terms = of.terms.map(f64::from);
            if of.channel == 0 {
                refl.add(terms, value, of.part);
                continue;
            }
            let v = clear[of.channel];
            let terms = std::array::from_fn(|i| terms[i % EXIT_TERMS] * if i < EXIT_TERMS { v } else { 1.0 - v });
            high.add(terms, value, of.part);
        }
        mean.extend(refl.solve());
        mean.extend(high.solve());
    }
    let length = lengths(&all, &clear, &mean);
    let light = table.exit.as_ref().map_or(&[][..], |exit| &exit.drift);
    let drift = drift_of(light, table.theta_i.len(), table.sigma_per_um.len());
    Some(ExitOffsets { mean, length, drift })
}

/// Displacements along the axis: the mean of each eighth of clear fibers' light, and the share of the light
/// in it at every absorption. `light` is that of a table ([`plywave_tables::table::ExitPositions::drift`]).
fn drift_of(light: &[f32], rows: usize, k: usize) -> ExitDrift {
    let mut found = ExitDrift::none(rows, k);
    for ((light, at), share) in light
        .chunks_exact(DISPLACEMENTS * k)
        .zip(found.at.chunks_exact_mut(DRIFT_QUANTILES))
        .zip(found.share.chunks_exact_mut(DRIFT_QUANTILES * k))
    {
        let clear: f64 = light.chunks_exact(k).map(|of| f64::from(of[0])).sum();
        if clear <= 0.0 {
            continue;
        }
        let per_part = DRIFT_QUANTILES as f64 / clear;
        share.fill(0.0);
        let mut below = 0.0;
        for (part, of) in light.chunks_exact(k).enumerate().filter(|(_, of)| of[0] > 0.0) {
            let (from, to) = (below, below + f64::from(of[0]) * per_part);
            below = to;
            for (q, at) in at.iter_mut().enumerate() {
                let overlap = (to.min((q + 1) as f64) - from.max(q as f64)).max(0.0);
                *at += overlap * displacement(part);
                for (share, light) in share[q * k..(q + 1) * k].iter_mut().zip(of) {
                    *share += overlap / (to - from) * f64::from(*light);
                }
            }
        }
        let all: Vec<f64> = (0..k).map(|i| share.chunks_exact(k).map(|of| of[i]).sum()).collect();
        for of in share.chunks_exact_mut(k) {
            of.iter_mut().zip(&all).for_each(|(share, all)| *share /= all.max(1e-300));
        }
    }
    found
}

/// Lengths of the densities, relative to R, about the means `[M][H][EXIT_KINDS][EXIT_TERMS]` of a table's
/// exits; the default length for a kind without light.
///
/// # Panics
/// If the nodes of the means differ from the table's.
pub fn fit_exit_lengths(table: &Table, mean: &[f64]) -> [f64; EXIT_KINDS] {
    lengths(&recorded(table), &clear_shares(table), mean)
}

fn lengths(all: &[Recorded<'_>], clear: &[f64], mean: &[f64]) -> [f64; EXIT_KINDS] {
    let [min, max] = EXIT_LENGTHS;
    let tried: Vec<f64> = (0..TRIED).map(|i| min * (max / min).powf(i as f64 / (TRIED - 1) as f64)).collect();
    let shapes: Vec<ExitShape> = tried.iter().map(|length| ExitShape::new(*length)).collect();
    // The error is the sum of squared differences of cumulative distributions for these lengths of the kinds.
    let error = |[refl, high, dark]: [usize; EXIT_KINDS], is_refl: bool| -> f64 {
        let of = |of: &Recorded<'_>| {
            let positions = of.shares.len();
            let about = |kind: usize| -> f32 {
                let first = (of.incidence * EXIT_KINDS + kind) * EXIT_TERMS;
                let c = &mean[first..first + EXIT_TERMS];
                c.iter().zip(of.terms).map(|(c, t)| *c as f32 * t).sum::<f32>().clamp(-1.0, 1.0)
            };
            let (v, [a, b, c]) = (clear[of.channel] as f32, [0, 1, 2].map(about));
            let (mut below, mut sum) = (0.0, 0.0);
            for (i, share) in of.shares[..positions - 1].iter().enumerate() {
                below += share;
                let t = 2.0 * (i + 1) as f32 / positions as f32 - 1.0;
                let model = if is_refl {
                    shapes[refl].share_below(a, t)
                } else {
                    v * shapes[high].share_below(b, t) + (1.0 - v) * shapes[dark].share_below(c, t)
                };
                sum += f64::from(below - model).powi(2);
            }
            of.light * sum
        };
        let here: Vec<f64> = all.par_iter().filter(|of| (of.channel == 0) == is_refl).map(of).collect();
        here.iter().sum()
    };
    let light_of = |is_refl: bool| all.iter().filter(|of| (of.channel == 0) == is_refl).map(|of| of.light).sum::<f64>();
    let (refl, high) = (light_of(true), light_of(false));
    let usual = USUAL_EXIT_LENGTHS.map(|length| {
        (0..TRIED).min_by(|i, j| (tried[*i] - length).abs().total_cmp(&(tried[*j] - length).abs())).unwrap_or(0)
    });
    let (mut best, mut found) = (usual, USUAL_EXIT_LENGTHS);
    for _ in 0..ROUNDS {
        for kind in 0..EXIT_KINDS {
            if if kind == 0 { refl } else { high } < MIN_LIGHT * (refl + high) {
                continue;
            }
            let errors: Vec<f64> = (0..TRIED)
                .map(|i| {
                    let mut with = best;
                    with[kind] = i;
                    error(with, kind == 0)
                })
                .collect();
            let min = (0..TRIED).min_by(|i, j| errors[*i].total_cmp(&errors[*j])).unwrap_or(best[kind]);
            best[kind] = min;
            // The best length is at the minimum of a parabola through the best trial and its neighbors.
            let step = match errors.get(min.wrapping_sub(1)..min + 2) {
                Some([a, b, c]) if a + c > 2.0 * b => 0.5 * (a - c) / (a - 2.0 * b + c),
                _ => 0.0,
            };
            found[kind] = tried[min] * (max / tried[0]).powf(step / (TRIED - 1) as f64);
        }
    }
    found.map(|length| length.clamp(min, max))
}

/// Mean of a distribution over equal parts of [-1, 1].
fn mean_of(shares: &[f32]) -> Option<f64> {
    let n = shares.len() as f64;
    let (mut sum, mut first) = (0.0, 0.0);
    for (i, share) in shares.iter().enumerate() {
        sum += f64::from(*share);
        first += f64::from(*share) * (2.0 * (i as f64 + 0.5) / n - 1.0);
    }
    (sum > 0.0).then(|| first / sum)
}

/// Light of a slice in an azimuth.
fn light(table: &Table, slice: &[f32], azimuth: usize, azimuths: usize) -> f64 {
    let columns = table.grid.phi_o;
    let (from, to) =
        (azimuth * columns / azimuths, ((azimuth + 1) * columns / azimuths).max(azimuth * columns / azimuths + 1));
    let of = |row: usize| {
        slice[row * columns + from..row * columns + to.min(columns)].iter().map(|f| f64::from(*f)).sum::<f64>()
    };
    (0..table.grid.theta_o).map(|row| table.grid.solid_angle(row) * of(row)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plywave::ply::DRIFT_BINS;
    use plywave_tables::table::displacement_part;

    /// The displacements of light spread evenly over [0, 4] R, whose dark part fell as exp(-D), are the
    /// middles of its eighths, and their dark shares are the integrals of exp(-D).
    #[test]
    fn displacements_are_quantiles() {
        let parts = |of: &dyn Fn(f64) -> f64| {
            let mut light = vec![0.0f32; DISPLACEMENTS * 2];
            for i in 0..40_000 {
                let d = 4.0 * (f64::from(i) + 0.5) / 40_000.0;
                let part = displacement_part(d);
                light[2 * part] += 1.0;
                light[2 * part + 1] += of(d) as f32;
            }
            light
        };
        let drift = drift_of(&parts(&|d| (-d).exp()).repeat(DRIFT_BINS), 1, 2);
        for q in 0..DRIFT_QUANTILES {
            let (from, to) = (0.5 * q as f64, 0.5 * (q + 1) as f64);
            assert!((drift.at[q] - 0.5 * (from + to)).abs() < 0.03, "{q}: {}", drift.at[q]);
            let dark = ((-from).exp() - (-to).exp()) / (1.0 - (-4f64).exp());
            assert!((drift.share[2 * q] - 0.125).abs() < 1e-6, "{q}: {}", drift.share[2 * q]);
            assert!((drift.share[2 * q + 1] - dark).abs() < 0.02 * dark + 1e-3, "{q}: {}", drift.share[2 * q + 1]);
        }
    }

    /// The fit finds the known means of light from a point of the section.
    #[test]
    fn places_are_found() {
        let [px, py] = [0.4, 0.7f64];
        let mut fit = Fit::<EXIT_TERMS>::new();
        for azimuth in 0..36 {
            let phi = std::f64::consts::TAU * (f64::from(azimuth) + 0.5) / 36.0;
            let terms = exit_terms(phi.cos() as f32, phi.sin() as f32).map(f64::from);
            fit.add(terms, phi.cos() * py - phi.sin() * px, 1.0);
        }
        let got = fit.solve();
        assert!((got[1] - py).abs() < 2e-3 && (got[2] + px).abs() < 2e-3, "{got:?}");
        assert!(got[0].abs() + got[3].abs() + got[4].abs() < 1e-6, "{got:?}");
        assert_eq!(mean_of(&[0.0; 8]), None);
        assert!((mean_of(&[0.0, 0.0, 1.0, 1.0]).unwrap() - 0.5).abs() < 1e-12);
    }
}
