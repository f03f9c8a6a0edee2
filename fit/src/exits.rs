//! Mean offsets at which light leaves a ply, from the exits that a table recorded.
//!
//! At an incidence, an absorption and an azimuth the table has the distribution of the lateral position t at which light leaves. The polynomials of the azimuth
//! (`plywave::ply::ExitOffsets`) are those nearest to its mean, in least squares weighted by the light of the azimuth, each absorption alike.

use plywave::ply::{EXIT_KINDS, EXIT_LENGTH_UM, EXIT_TERMS, ExitOffsets, exit_terms};
use plywave::table::Table;

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
        // Where hardly any light tells, the offset is small.
        let ridge = 1e-3 * self.normal.trace() / N as f64 + 1e-12;
        for i in 0..N {
            self.normal[(i, i)] += ridge;
        }
        self.normal.cholesky().map_or([0.0; N], |c| c.solve(&self.right).into())
    }
}

/// The offsets of a table; `None` for one without exits.
pub fn fit_exits(table: &Table) -> Option<ExitOffsets> {
    let exit = table.exit.as_ref()?;
    let (m, h, k) = (table.theta_i.len(), table.h_um.len(), table.sigma_per_um.len());
    let mut mean = Vec::with_capacity(m * h * EXIT_KINDS * EXIT_TERMS);
    for row in 0..m {
        for column in 0..h {
            let mut refl = Fit::<EXIT_TERMS>::new();
            let mut high = Fit::<{ 2 * EXIT_TERMS }>::new();
            for channel in 0..=k {
                let slice = match channel {
                    0 => table.refl_slice(row, column),
                    _ => table.high_slice(row, column, channel - 1),
                };
                let lights: Vec<f64> = (0..exit.azimuths).map(|a| light(table, slice, a, exit.azimuths)).collect();
                let all: f64 = lights.iter().sum();
                if all <= 0.0 {
                    continue;
                }
                for (azimuth, light) in lights.iter().enumerate() {
                    let first = (((row * h + column) * (1 + k) + channel) * exit.azimuths + azimuth) * exit.positions;
                    let Some(value) = mean_of(&exit.shares[first..first + exit.positions]) else { continue };
                    let phi = std::f64::consts::TAU * (azimuth as f64 + 0.5) / exit.azimuths as f64;
                    let terms = exit_terms(phi.cos() as f32, phi.sin() as f32).map(f64::from);
                    let weight = light / all;
                    if channel == 0 {
                        refl.add(terms, value, weight);
                        continue;
                    }
                    let clear = 1.0 / (1.0 + EXIT_LENGTH_UM * table.sigma_per_um[channel - 1]);
                    let terms = std::array::from_fn(|i| {
                        terms[i % EXIT_TERMS] * if i < EXIT_TERMS { clear } else { 1.0 - clear }
                    });
                    high.add(terms, value, weight);
                }
            }
            mean.extend(refl.solve());
            mean.extend(high.solve());
        }
    }
    Some(ExitOffsets { mean })
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

    /// Means of light from a place of the section are found as they are.
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
