//! Diagnostic fits of a single slice or a single block.

use crate::check::check_table;
use crate::error::FitError;
use crate::fit::block_targets;
use crate::fit_errors::excess2;
use crate::lobes::block::{BlockEffort, CORNERS, Target, coarse_grid, fit_joint};
use crate::lobes::sphere::{Scratch, SphereGrid};
use plywave::ply::LobeKind;
use plywave::ply::asg::PARAMS;
use plywave_tables::table::Table;
use rayon::prelude::*;

/// A fitted part: lobe parameters `[sets][lobes][6]` and their cost.
#[derive(Clone, Debug, PartialEq)]
pub struct PartFit {
    /// Lobes of the free parameter sets: one for a slice, four for the corners of a block.
    pub params: Vec<f64>,
    /// Sum over slices of the squared relative distance to the table, noise included.
    pub cost: f64,
    /// Number of evaluations of cost and gradient.
    pub evaluations: usize,
}

/// Fits block `(m, n)` of the high-order slices at sigma = 0 as [`crate::fit()`] does.
pub fn fit_block(
    table: &Table,
    (m, n): (usize, usize),
    lobes: usize,
    effort: &BlockEffort,
) -> Result<PartFit, FitError> {
    check_table(table)?;
    let (rows, columns) = ((table.theta_i.len() - 1) / 2, (table.h_um.len() - 1) / 2);
    if m >= rows || n >= columns {
        return Err(FitError::Option { name: "block", value: m.max(n), allowed: "a block of the table" });
    }
    let sphere = SphereGrid::new(table.grid);
    let targets = block_targets(&sphere, table, m, n, LobeKind::Round);
    let seed = (m * columns + n) as u64 + 1;
    let fit = fit_joint(&sphere, coarse_grid(&sphere).as_ref(), &targets, CORNERS, lobes, effort, seed, &[]);
    Ok(PartFit { params: fit.params, cost: fit.cost, evaluations: fit.evaluations })
}

/// Kind of a slice of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// f_refl.
    Refl,
    /// f_high at sigma = 0.
    High,
}

/// Fits `lobes` lobes to each slice of `table` at `nodes` separately. Returns the excess error of each
/// against `other`, a table of the same yarn and grids with another seed; it is the smallest error of a model
/// with that many lobes. The error is squared. It is negative if the slice has less noise than expected, so
/// that means are unbiased, and NaN if noise hides it.
pub fn fit_single_slices(
    table: &Table,
    other: &Table,
    part: Part,
    nodes: &[(usize, usize)],
    lobes: usize,
    effort: &BlockEffort,
) -> Result<Vec<f64>, FitError> {
    check_table(table)?;
    check_table(other)?;
    let (rows, columns, sigmas) = (table.theta_i.len(), table.h_um.len(), table.sigma_per_um.len());
    for (axis, a, b) in [
        ("theta_i", rows, other.theta_i.len()),
        ("h_um", columns, other.h_um.len()),
        ("sigma_per_um", sigmas, other.sigma_per_um.len()),
        ("grid", table.grid.len(), other.grid.len()),
    ] {
        if a != b {
            return Err(FitError::Axes { axis, model: a, table: b });
        }
    }
    if let Some(&(m, n)) = nodes.iter().find(|k| k.0 >= rows || k.1 >= columns) {
        return Err(FitError::Option { name: "node", value: m.max(n), allowed: "a node of the table" });
    }
    let sphere = SphereGrid::new(table.grid);
    let coarse = coarse_grid(&sphere);
    let slice = |t: &Table, m: usize, n: usize| {
        let node = m * columns + n;
        let corners = vec![(0, 1.0)];
        match part {
            Part::Refl => {
                let noise = t.noise_refl[node];
                (Target::new(&sphere, t.refl_slice(m, n), t.energy_refl[node], noise, corners), noise)
            }
            Part::High => {
                let (energy, noise) = (t.energy_high[node * sigmas], t.noise_high[node * sigmas]);
                (Target::new(&sphere, t.high_slice(m, n, 0), energy, noise, corners), noise)
            }
        }
    };
    Ok(nodes
        .par_iter()
        .map(|&(m, n)| {
            let (target, _) = slice(table, m, n);
            let energy = target.energy;
            let fit = fit_joint(&sphere, coarse.as_ref(), &[target], 1, lobes, effort, (m * columns + n) as u64, &[]);
            let sum: f64 = fit.params.chunks_exact(PARAMS).map(|p| p[5]).sum();
            let gain = if sum > 0.0 { energy / sum } else { 0.0 };
            let model = sphere.mixture(&fit.params, gain, &mut Scratch::default());
            let (truth, noise) = slice(other, m, n);
            let norm2 = sphere.inner(&truth.slice, &truth.slice);
            excess2(sphere.distance2(&model, &truth.slice), norm2, noise).unwrap_or(f64::NAN)
        })
        .collect())
}
