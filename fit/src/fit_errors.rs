//! Relative L2 errors of a model against a table, with the table's noise removed.

use crate::check::check_table;
use crate::error::FitError;
use crate::lobes::block::corner_weights;
use crate::lobes::model::{GridCell, evaluate, high_lobes_in_block, refl_lobes};
use crate::lobes::sphere::{Scratch, SphereGrid};
use plywave::ply::PlyData;
use plywave_tables::table::Table;
use rayon::prelude::*;

/// Excess errors `sqrt(max(0, |model - table|^2 - noise) / |table|^2)`, with the table's own noise removed
/// from |table|^2 too. A slice whose noise is more than half of its norm has no meaningful error and contains
/// NaN.
///
/// The subtracted noise is an expectation. The actual noise of a slice varies about it, so the uncertainty of
/// one slice's error is about `sqrt(noise / |table|^2) (2 / bins)^(1/4)`: 0.03 for a standard table. Means
/// add the squares with their signs, including negative ones, and are far more accurate.
#[derive(Clone, Debug, PartialEq)]
pub struct FitErrors {
    /// `[M][H]`: error of f_refl.
    pub refl: Vec<f64>,
    /// `[M][H][K]`: error of f_high, rms over the blocks that contain the node.
    pub high: Vec<f64>,
    /// `[(M-1)/2][(H-1)/2][K]`: rms over the nine slices of each block.
    pub block: Vec<f64>,
    /// rms of f_refl over all nodes.
    pub rms_refl: f64,
    /// `[K]`: rms of f_high over the nine slices of all blocks.
    pub rms_high: Vec<f64>,
    /// `[M][H]`: difference of the model's lobe energies from the table's own ([`Table::fine_energies`]),
    /// f_refl; absolute.
    pub energy_refl: Vec<f64>,
    /// `[M][H][K]`: the same for f_high.
    pub energy_high: Vec<f64>,
}

/// Squared excess error of one slice, negative if the slice has less noise than expected; `None` if noise
/// hides it.
pub(crate) fn excess2(distance2: f64, norm2: f64, noise: f64) -> Option<f64> {
    let signal = norm2 - noise;
    (signal > 0.5 * norm2 && norm2 > 0.0).then(|| (distance2 - noise) / signal)
}

/// Root of the mean of squared errors.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for v in values {
        sum += v;
        count += 1;
    }
    if count == 0 { f64::NAN } else { root(sum / count as f64) }
}

/// Square root of a squared error that may be negative.
fn root(squared: f64) -> f64 {
    squared.max(0.0).sqrt()
}

/// The cell of node `(m, n)` in a model of `rows` x `columns` nodes.
pub(crate) fn node_place(m: usize, n: usize, rows: usize, columns: usize) -> GridCell {
    let (m0, n0) = (m.min(rows - 2), n.min(columns - 2));
    GridCell { m: m0, s: (m - m0) as f64, n: n0, t: (n - n0) as f64 }
}

/// Errors of `model` against `table`, which must have the same incidences and absorption coefficients. Errors
/// against the table of the fit are optimistic, because the fit follows its noise; a table with another seed
/// gives unbiased ones.
pub fn errors(model: &PlyData, table: &Table) -> Result<FitErrors, FitError> {
    check_table(table)?;
    let same = |a: &[f64], b: &[f64]| {
        a.len() == b.len() && a.iter().zip(b).all(|(x, y)| (x - y).abs() <= 1e-9 * (1.0 + x.abs()))
    };
    for (name, a, b) in [
        ("theta_i", &model.theta_i, &table.theta_i),
        ("h_um", &model.h_um, &table.h_um),
        ("sigma_per_um", &model.sigma_per_um, &table.sigma_per_um),
    ] {
        if !same(a, b) {
            return Err(FitError::Axes { axis: name, model: a.len(), table: b.len() });
        }
    }
    let sphere = SphereGrid::new(table.grid);
    let (rows, columns, sigmas) = (table.theta_i.len(), table.h_um.len(), table.sigma_per_um.len());
    let fine = table.fine_energies();
    let held = |node: usize| fine.at_node(table.theta_i[node / columns], table.h_um[node % columns]);
    let refl: Vec<(Option<f64>, f64)> = (0..rows * columns)
        .into_par_iter()
        .map(|node| {
            let mut scratch = Scratch::default();
            let lobes = refl_lobes(model, node_place(node / columns, node % columns, rows, columns));
            let slice = sphere.pad(table.refl_slice(node / columns, node % columns), 1.0);
            let distance2 = sphere.distance2(&evaluate(&sphere, &lobes, &mut scratch), &slice);
            let error = excess2(distance2, sphere.inner(&slice, &slice), table.noise_refl[node]);
            (error, lobes.energy - held(node).refl)
        })
        .collect();
    let (block_rows, block_columns) = ((rows - 1) / 2, (columns - 1) / 2);
    // For each block: nine slices by K, each with the node to which it belongs.
    type SliceError = (usize, Option<f64>, f64);
    let blocks: Vec<Vec<SliceError>> = (0..block_rows * block_columns)
        .into_par_iter()
        .map(|block| {
            let mut scratch = Scratch::default();
            let (bm, bn) = (block / block_columns, block % block_columns);
            let mut out = Vec::with_capacity(9 * sigmas);
            for a in 0..3 {
                for b in 0..3 {
                    let (m, n) = (2 * bm + a, 2 * bn + b);
                    let place = node_place(m, n, rows, columns);
                    debug_assert!((corner_weights(a, b).iter().sum::<f64>() - 1.0).abs() < 1e-12);
                    for k in 0..sigmas {
                        let lobes = high_lobes_in_block(
                            model,
                            (bm, bn),
                            0.5 * a as f64,
                            0.5 * b as f64,
                            place,
                            table.sigma_per_um[k],
                        );
                        let slice = sphere.pad(table.high_slice(m, n, k), 1.0);
                        let distance2 = sphere.distance2(&evaluate(&sphere, &lobes, &mut scratch), &slice);
                        let at = (m * columns + n) * sigmas + k;
                        let error = excess2(distance2, sphere.inner(&slice, &slice), table.noise_high[at]);
                        out.push((at, error, lobes.energy - held(m * columns + n).high[k]));
                    }
                }
            }
            out
        })
        .collect();
    let mut sums = vec![(0.0, 0usize); rows * columns * sigmas];
    let mut energy_high = vec![0.0; rows * columns * sigmas];
    let mut block = Vec::with_capacity(blocks.len() * sigmas);
    for slices in &blocks {
        for k in 0..sigmas {
            block.push(rms(slices.iter().skip(k).step_by(sigmas).filter_map(|s| s.1)));
        }
        for &(at, error, energy) in slices {
            energy_high[at] = energy;
            if let Some(e) = error {
                sums[at].0 += e;
                sums[at].1 += 1;
            }
        }
    }
    Ok(FitErrors {
        refl: refl.iter().map(|r| r.0.map_or(f64::NAN, root)).collect(),
        high: sums.iter().map(|&(s, c)| if c == 0 { f64::NAN } else { root(s / c as f64) }).collect(),
        rms_refl: rms(refl.iter().filter_map(|r| r.0)),
        rms_high: (0..sigmas)
            .map(|k| rms(blocks.iter().flat_map(|slices| slices.iter().skip(k).step_by(sigmas).filter_map(|s| s.1))))
            .collect(),
        block,
        energy_refl: refl.iter().map(|r| r.1).collect(),
        energy_high,
    })
}
