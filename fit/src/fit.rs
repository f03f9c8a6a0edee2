//! From a table of simulated scattering to a ply model.

use crate::absorption::{SliceProducts, attenuation, choose_paths, energy_spectrum, fit_lobe_spectra};
use crate::block::{BlockEffort, CORNERS, Target, blend, coarse_grid, corner_weights, fit_joint};
use crate::canonical::canonicalize;
use crate::dark::{DarkSlices, refine};
use crate::fit_errors::errors;
use crate::layers::layer_factors;
use crate::reflection::{ReflectionEffort, fit_reflection};
use crate::sphere::{Scratch, SphereGrid};
use plywave::asg::PARAMS;
use plywave::{PlyData, Table};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How hard and with how many lobes to fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Reflection lobes per incidence; 1 is the paper's choice, which cannot wrap a distribution wider than a half turn.
    pub lobes_refl: usize,
    /// High-order lobes.
    pub lobes_high: usize,
    /// Effort of a block of high-order slices.
    pub block: BlockEffort,
    /// Effort of the reflection slices.
    pub reflection: ReflectionEffort,
    /// Iterations of the absorption spectra of a block.
    pub absorption_iterations: usize,
    /// Iterations of the joint refinement of a block's lobes and spectra at all sigma.
    pub dark_iterations: usize,
    /// Weight in it of a slice at sigma > 0 against one at sigma = 0.
    pub dark_share: f64,
}

impl FitOptions {
    /// Seconds: for a first look.
    pub fn preview() -> Self {
        FitOptions {
            block: BlockEffort {
                starts: 2,
                start_iterations: 60,
                moves: 2,
                move_iterations: 40,
                iterations: 80,
                tolerance: 3e-3,
            },
            reflection: ReflectionEffort { rounds: 1, iterations: 40, ..Self::standard().reflection },
            absorption_iterations: 60,
            dark_iterations: 40,
            ..Self::standard()
        }
    }

    /// The errors of the README.
    pub fn standard() -> Self {
        FitOptions {
            lobes_refl: 3,
            lobes_high: 8,
            block: BlockEffort {
                starts: 8,
                start_iterations: 150,
                moves: 6,
                move_iterations: 60,
                iterations: 300,
                tolerance: 1e-3,
            },
            reflection: ReflectionEffort { starts: 4, iterations: 80, rounds: 3, smoothness: 5e-3, tolerance: 1e-3 },
            absorption_iterations: 150,
            dark_iterations: 80,
            dark_share: 0.03,
        }
    }

    /// Everything the minimizer can find.
    pub fn reference() -> Self {
        FitOptions {
            block: BlockEffort {
                starts: 8,
                start_iterations: 400,
                moves: 30,
                move_iterations: 150,
                iterations: 1000,
                tolerance: 1e-4,
            },
            reflection: ReflectionEffort {
                starts: 8,
                iterations: 300,
                rounds: 4,
                tolerance: 1e-4,
                ..Self::standard().reflection
            },
            absorption_iterations: 400,
            dark_iterations: 300,
            ..Self::standard()
        }
    }
}

/// Part of the work that a [`Progress`] counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Blocks of high-order slices, lobes and absorption.
    High,
    /// Reflection slices, all rounds.
    Reflection,
    /// Errors of the finished model.
    Errors,
}

/// How far the fit is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is counted.
    pub stage: Stage,
    /// Units done.
    pub done: usize,
    /// Units in all.
    pub total: usize,
}

/// What a fit can refuse.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// A table's field has a length or value that cannot be fitted.
    #[error("table: {field} = {value}: {mend}")]
    Table {
        /// Name of the field.
        field: &'static str,
        /// Offending length or value.
        value: String,
        /// What would be accepted.
        mend: &'static str,
    },
    /// An option is out of range.
    #[error("fit options: {name} = {value}: must be {allowed}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// Offending value.
        value: usize,
        /// Allowed values.
        allowed: &'static str,
    },
    /// Model and table, or two models, differ in an axis.
    #[error(
        "axis {axis} differs: {model} nodes in the model, {table} in the other, or other values; use files of one yarn and preset"
    )]
    Axes {
        /// Name of the axis.
        axis: &'static str,
        /// Length in the model.
        model: usize,
        /// Length in the table or other model.
        table: usize,
    },
}

/// Refuses tables whose arrays do not fit together or whose incidences make no blocks.
pub(crate) fn check_table(table: &Table) -> Result<(), FitError> {
    let bad = |field, value: String, mend| Err(FitError::Table { field, value, mend });
    let (m, n, k, bins) = (table.theta_i.len(), table.h_um.len(), table.sigma_per_um.len(), table.grid.len());
    for (field, len) in [("theta_i", m), ("h_um", n)] {
        if len < 3 || len.is_multiple_of(2) {
            return bad(field, format!("{len} nodes"), "must have an odd number of nodes, 3 or more");
        }
    }
    if table.grid.theta_o < 4 || table.grid.phi_o < 4 {
        return bad("grid", format!("{} x {}", table.grid.theta_o, table.grid.phi_o), "must have at least 4 x 4 bins");
    }
    if k == 0
        || table.sigma_per_um[0] != 0.0
        || table.sigma_per_um.windows(2).any(|w| w[1] <= w[0] || !w[1].is_finite())
    {
        return bad("sigma_per_um", format!("{:?}", table.sigma_per_um), "must ascend from 0");
    }
    for (field, len, want) in [
        ("r_d", table.r_d.len(), m * n),
        ("energy_refl", table.energy_refl.len(), m * n),
        ("energy_high", table.energy_high.len(), m * n * k),
        ("refl", table.refl.len(), m * n * bins),
        ("high", table.high.len(), m * n * k * bins),
        ("noise_refl", table.noise_refl.len(), m * n),
        ("noise_high", table.noise_high.len(), m * n * k),
    ] {
        if len != want {
            return bad(field, format!("{len} values"), "must have one value for each index of its axes");
        }
    }
    for (field, values) in [
        ("theta_i", &table.theta_i),
        ("h_um", &table.h_um),
        ("r_d", &table.r_d),
        ("energy_refl", &table.energy_refl),
        ("energy_high", &table.energy_high),
        ("noise_refl", &table.noise_refl),
        ("noise_high", &table.noise_high),
    ] {
        if let Some(v) = values.iter().find(|v| !v.is_finite()) {
            return bad(field, v.to_string(), "must be finite");
        }
    }
    for (field, values) in [("refl", &table.refl), ("high", &table.high)] {
        if let Some(v) = values.iter().find(|v| !v.is_finite() || **v < 0.0) {
            return bad(field, v.to_string(), "must be finite and not negative");
        }
    }
    Ok(())
}

fn check_options(options: &FitOptions) -> Result<(), FitError> {
    for (name, value) in [("lobes_refl", options.lobes_refl), ("lobes_high", options.lobes_high)] {
        if !(1..=64).contains(&value) {
            return Err(FitError::Option { name, value, allowed: "1 to 64" });
        }
    }
    if options.block.starts == 0 || options.reflection.starts == 0 {
        return Err(FitError::Option { name: "starts", value: 0, allowed: "1 or more" });
    }
    Ok(())
}

/// Fits a ply model to a table. The lobes of f_refl carry shares of `energy_refl` that add up to 1 at each node, those of a block of
/// f_high energies up to a common factor; the evaluator scales both to the energies of the table. The result depends on the table and options alone, not on the number of threads.
/// `progress` is called from worker threads, after each unit of work.
pub fn fit(table: &Table, options: &FitOptions, progress: &(dyn Fn(Progress) + Sync)) -> Result<PlyData, FitError> {
    check_table(table)?;
    check_options(options)?;
    let sphere = SphereGrid::new(table.grid);
    let coarse = coarse_grid(&sphere);
    let (rows, columns, sigmas) = (table.theta_i.len(), table.h_um.len(), table.sigma_per_um.len());

    let energies: Vec<Vec<f64>> = table.energy_high.chunks_exact(sigmas).map(|e| e.to_vec()).collect();
    let path_um = choose_paths(&energies, &table.sigma_per_um);
    let spectra: Vec<Vec<f64>> = energies.iter().map(|e| energy_spectrum(e, &table.sigma_per_um, &path_um).0).collect();

    let (block_rows, block_columns) = ((rows - 1) / 2, (columns - 1) / 2);
    let blocks = block_rows * block_columns;
    let done = AtomicUsize::new(0);
    let fitted: Vec<(Vec<f64>, Vec<f64>)> = (0..blocks)
        .into_par_iter()
        .map(|block| {
            let (bm, bn) = (block / block_columns, block % block_columns);
            let targets = block_targets(&sphere, table, bm, bn);
            let fit = fit_joint(
                &sphere,
                coarse.as_ref(),
                &targets,
                CORNERS,
                options.lobes_high,
                &options.block,
                block as u64 + 1,
                &[],
            );
            let products =
                block_products(&sphere, table, bm, bn, &targets, &fit.params, options.lobes_high, &path_um, &spectra);
            let mean: Vec<f64> = (0..path_um.len())
                .map(|j| (0..9).map(|i| spectra[(2 * bm + i / 3) * columns + 2 * bn + i % 3][j]).sum())
                .collect();
            let mut paths = fit_lobe_spectra(
                &products,
                CORNERS,
                options.lobes_high,
                &attenuation(&table.sigma_per_um, &path_um),
                &mean,
                options.absorption_iterations,
            );
            let mut params = fit.params;
            if sigmas > 1 {
                let slices = dark_slices(&sphere, table, bm, bn, &targets, &path_um, &spectra);
                refine(
                    &sphere,
                    &slices,
                    &mut params,
                    &mut paths,
                    options.lobes_high,
                    &attenuation(&table.sigma_per_um, &path_um),
                    options.dark_share,
                    options.dark_iterations,
                );
            }
            progress(Progress { stage: Stage::High, done: done.fetch_add(1, Ordering::Relaxed) + 1, total: blocks });
            (params, paths)
        })
        .collect();

    let targets: Vec<Target> = (0..rows * columns)
        .map(|node| {
            let values = table.refl_slice(node / columns, node % columns);
            Target::new(&sphere, values, table.energy_refl[node], table.noise_refl[node], vec![(0, 1.0)])
        })
        .collect();
    let total = rows * columns * (1 + options.reflection.rounds);
    let done = AtomicUsize::new(0);
    let refl = fit_reflection(
        &sphere,
        coarse.as_ref(),
        &targets,
        (rows, columns),
        options.lobes_refl,
        &options.reflection,
        &|units| {
            let done = done.fetch_add(units, Ordering::Relaxed) + units;
            progress(Progress { stage: Stage::Reflection, done, total });
        },
    );

    let mut data = PlyData {
        spec_text: table.spec_text.clone(),
        program_version: env!("CARGO_PKG_VERSION").to_string(),
        preset: table.preset.clone(),
        seed: table.seed,
        theta_i: table.theta_i.clone(),
        h_um: table.h_um.clone(),
        sigma_per_um: table.sigma_per_um.clone(),
        path_um,
        lobes_refl: options.lobes_refl,
        lobes_high: options.lobes_high,
        r_d: table.r_d.clone(),
        energy_refl: table.energy_refl.clone(),
        energy_high: spectra.concat(),
        refl,
        high: fitted.iter().flat_map(|f| f.0.iter().copied()).collect(),
        high_path: fitted.iter().flat_map(|f| f.1.iter().copied()).collect(),
        error_refl: Vec::new(),
        error_high: Vec::new(),
        layers: None,
        edge: None,
        noise: None,
    };
    canonicalize(&mut data);
    let own = errors(&data, table)?;
    let finite = |values: Vec<f64>| values.into_iter().map(|v| if v.is_finite() { v } else { 0.0 }).collect();
    data.error_refl = finite(own.refl);
    data.error_high = finite(own.high);
    data.layers = Some(layer_factors(&data));
    progress(Progress { stage: Stage::Errors, done: 1, total: 1 });
    Ok(data)
}

/// The nine slices of block `(bm, bn)` at sigma = 0.
pub(crate) fn block_targets(sphere: &SphereGrid, table: &Table, bm: usize, bn: usize) -> Vec<Target> {
    let (columns, sigmas) = (table.h_um.len(), table.sigma_per_um.len());
    (0..9)
        .map(|i| {
            let (m, n) = (2 * bm + i / 3, 2 * bn + i % 3);
            let at = (m * columns + n) * sigmas;
            let corners = corner_weights(i / 3, i % 3).into_iter().enumerate().filter(|c| c.1 > 0.0).collect();
            Target::new(sphere, table.high_slice(m, n, 0), table.energy_high[at], table.noise_high[at], corners)
        })
        .collect()
}

/// The nine incidences of a block at all sigma.
fn dark_slices(
    sphere: &SphereGrid,
    table: &Table,
    bm: usize,
    bn: usize,
    targets: &[Target],
    path_um: &[f64],
    spectra: &[Vec<f64>],
) -> Vec<DarkSlices> {
    let (columns, sigmas) = (table.h_um.len(), table.sigma_per_um.len());
    let t = attenuation(&table.sigma_per_um, path_um);
    targets
        .iter()
        .enumerate()
        .map(|(i, target)| {
            let (m, n) = (2 * bm + i / 3, 2 * bn + i % 3);
            let slice = |k: usize| {
                let row = &t[k * path_um.len()..(k + 1) * path_um.len()];
                let energy = row.iter().zip(&spectra[m * columns + n]).map(|(t, p)| t * p).sum();
                let noise = table.noise_high[(m * columns + n) * sigmas + k];
                Target::new(sphere, table.high_slice(m, n, k), energy, noise, Vec::new())
            };
            DarkSlices { targets: (0..sigmas).map(slice).collect(), corners: target.corners.clone() }
        })
        .collect()
}

fn block_products(
    sphere: &SphereGrid,
    table: &Table,
    bm: usize,
    bn: usize,
    targets: &[Target],
    params: &[f64],
    lobes: usize,
    path_um: &[f64],
    spectra: &[Vec<f64>],
) -> Vec<SliceProducts> {
    let (columns, sigmas) = (table.h_um.len(), table.sigma_per_um.len());
    let t = attenuation(&table.sigma_per_um, path_um);
    let mut scratch = Scratch::default();
    let mut local = vec![0.0; lobes * PARAMS];
    targets
        .iter()
        .enumerate()
        .map(|(i, target)| {
            let (m, n) = (2 * bm + i / 3, 2 * bn + i % 3);
            blend(params, &target.corners, &mut local);
            let basis: Vec<_> = local
                .chunks_exact(PARAMS)
                .map(|p| {
                    let mut unit = p.to_vec();
                    unit[5] = 1.0;
                    sphere.mixture(&unit, 1.0, &mut scratch)
                })
                .collect();
            let slices: Vec<Target> = (0..sigmas)
                .map(|k| {
                    let at = (m * columns + n) * sigmas + k;
                    let values = table.high_slice(m, n, k);
                    Target::new(sphere, values, table.energy_high[at], table.noise_high[at], Vec::new())
                })
                .collect();
            let energy_at = |k: usize| {
                let row = &t[k * path_um.len()..(k + 1) * path_um.len()];
                row.iter().zip(&spectra[m * columns + n]).map(|(t, p)| t * p).sum()
            };
            SliceProducts {
                energy: local.chunks_exact(PARAMS).map(|p| p[5]).collect(),
                gram: basis.iter().flat_map(|a| basis.iter().map(|b| sphere.inner(a, b))).collect(),
                cross: slices.iter().flat_map(|s| basis.iter().map(|b| sphere.inner(b, &s.slice))).collect(),
                norm2: slices.iter().map(|s| sphere.inner(&s.slice, &s.slice)).collect(),
                target_energy: (0..sigmas).map(energy_at).collect(),
                weight: slices.iter().map(|s| s.weight).collect(),
                corners: target.corners.clone(),
            }
        })
        .collect()
}
