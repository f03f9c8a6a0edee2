//! Energies of a table as the splines of a model ([`PlyEnergies`]).

use crate::lobes::absorption::{choose_paths, energy_spectrum};
use plywave::ply::{PlyData, PlyEnergies, spline_coefficients};
use plywave_tables::table::{Table, TableEnergies};
use rayon::prelude::*;

/// Largest sum of the coefficients of all energies, as at a table's nodes; splines overshoot beside a sudden
/// fall.
const MAX: f64 = 1.049;

/// The splines of a table's energies, and the path lengths [um] of their spectra: `path_um`, or those that
/// fit the table best.
///
/// The coefficients invert the smoothing by the splines, which amplifies noise too. Negative values are set
/// to 0, and the sum of the fractions at sigma = 0 is preserved.
pub(crate) fn energy_splines(table: &Table, path_um: Option<&[f64]>) -> (PlyEnergies, Vec<f64>) {
    let energies = &*table.fine_energies();
    let TableEnergies { miss_theta_i, miss_h_um, share_theta_i, share_h_um, .. } = energies.clone();
    let (rows, columns, sigmas) = (share_theta_i.len(), share_h_um.len(), table.sigma_per_um.len());
    let spline = |values: &[f64]| spline_coefficients(values, rows, columns);
    let refl = spline(&energies.share_refl);
    let high: Vec<Vec<f64>> = (0..sigmas)
        .map(|k| spline(&energies.share_high.iter().skip(k).step_by(sigmas).copied().collect::<Vec<_>>()))
        .collect();
    // Values at each node: f_refl, then f_high at each sigma.
    let shares: Vec<(f64, Vec<f64>)> = (0..rows * columns)
        .map(|i| {
            let all = (refl[i] + high[0][i]).clamp(0.0, MAX);
            let refl = refl[i].clamp(0.0, all);
            let clear = all - refl;
            (refl, (0..sigmas).map(|k| if k == 0 { clear } else { high[k][i].clamp(0.0, clear) }).collect())
        })
        .collect();
    let curves: Vec<Vec<f64>> = shares.iter().map(|s| s.1.clone()).collect();
    let path_um = path_um.map_or_else(|| choose_paths(&curves, &table.sigma_per_um), <[f64]>::to_vec);
    let spectra: Vec<Vec<f64>> =
        curves.par_iter().map(|c| energy_spectrum(c, &table.sigma_per_um, &path_um).0).collect();
    let splines = PlyEnergies {
        miss: missed(energies),
        miss_theta_i,
        miss_h_um,
        share_theta_i,
        share_h_um,
        share_refl: shares.iter().map(|s| s.0).collect(),
        share_high: spectra.concat(),
    };
    (splines, path_um)
}

/// Spline coefficients of r_d.
fn missed(energies: &TableEnergies) -> Vec<f64> {
    let (rows, columns) = (energies.miss_theta_i.len(), energies.miss_h_um.len());
    spline_coefficients(&energies.miss, rows, columns).into_iter().map(|c| c.clamp(0.0, 1.0)).collect()
}

/// Whether a model was fitted to this table, according to its missed light: tables of other seeds or numbers
/// of paths have other noise.
pub fn has_energies_of(model: &PlyData, table: &Table) -> bool {
    let (own, held) = (missed(&table.fine_energies()), &model.energies.miss);
    own.len() == held.len() && own.iter().zip(held).all(|(a, b)| *a as f32 == *b as f32)
}
