//! Fits a ply model to a table of simulated scattering: lobes, absorption, energies, exits and errors.

use crate::check::check_table;
use crate::energies::energy_splines;
use crate::error::FitError;
use crate::exits::fit_exits;
use crate::fit_errors::errors;
use crate::layers::layer_factors;
use crate::lobes::absorption::{SliceProducts, attenuation, energy_spectrum, fit_lobe_spectra};
use crate::lobes::block::{BlockEffort, CORNERS, Target, blend, coarse_grid, corner_weights, fit_joint};
use crate::lobes::canonical::canonicalize;
use crate::lobes::cone::SliceLobes;
use crate::lobes::dark::{DarkSlices, refine};
use crate::lobes::reflection::fit_reflection;
use crate::lobes::sphere::{Scratch, SphereGrid};
use crate::options::FitOptions;
use plywave::ply::asg::PARAMS;
use plywave::ply::{EdgeLobes, LobeKind, PlyData};
use plywave_tables::table::Table;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Stage of the fit that a [`Progress`] counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Blocks of high-order slices, lobes and absorption.
    High,
    /// Reflection slices, all rounds.
    Reflection,
    /// Errors of the finished model.
    Errors,
}

/// Progress of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Stage that is counted.
    pub stage: Stage,
    /// Units done.
    pub done: usize,
    /// Total number of units.
    pub total: usize,
}

/// Largest sum of the energies at a node: 1 plus a margin for the noise of few paths.
const MAX_ENERGY: f64 = 1.05;

/// A model without lobes: the axes, absorption and energies of a table, and the given edge lobes. It takes
/// milliseconds and fails if the model could not be saved.
///
/// # Errors
/// [`FitError::Table`], [`FitError::Option`], [`FitError::Unsavable`].
pub fn frame(table: &Table, options: &FitOptions, edge: Option<EdgeLobes>) -> Result<PlyData, FitError> {
    frame_on(table, options, edge, None)
}

/// As [`frame`], with spectra on the path lengths `path_um` [um], or on those that fit the table best.
pub(crate) fn frame_on(
    table: &Table,
    options: &FitOptions,
    edge: Option<EdgeLobes>,
    path_um: Option<&[f64]>,
) -> Result<PlyData, FitError> {
    check_table(table)?;
    options.check()?;
    let (energies, path_um) = energy_splines(table, path_um);
    let data = PlyData {
        spec_text: table.spec_text.clone(),
        program_version: env!("CARGO_PKG_VERSION").to_string(),
        preset: table.preset.clone(),
        seed: table.seed,
        theta_i: table.theta_i.clone(),
        h_um: table.h_um.clone(),
        sigma_per_um: table.sigma_per_um.clone(),
        path_um,
        family: LobeKind::Round,
        lobes_refl: options.lobes_refl,
        lobes_high: options.lobes_high,
        energies,
        refl: Vec::new(),
        high: Vec::new(),
        high_path: Vec::new(),
        error_refl: Vec::new(),
        error_high: Vec::new(),
        layers: None,
        exits: None,
        edge,
        noise: None,
    };
    // Coefficients of the splines are clamped to their bounds, so the table's own values are checked first.
    for node in 0..table.r_d.len() {
        let all = table.r_d[node] + table.energy_refl[node] + table.energy_high[node * table.sigma_per_um.len()];
        if all > MAX_ENERGY {
            let key = format!("r_d + energy_refl + energy_high at node {node}");
            return Err(FitError::Unsavable {
                key,
                value: all.to_string(),
                hint: format!("expected at most {MAX_ENERGY}"),
            });
        }
    }
    match data.check_frame("table") {
        Ok(()) => Ok(data),
        Err(plywave::Error::Invalid { key, value, mut hint, .. }) => {
            if key.starts_with("theta_i") || key.starts_with("h_um") {
                hint += "; give simulation.theta_i_nodes and h_nodes other values and simulate again";
            }
            Err(FitError::Unsavable { key, value, hint })
        }
        Err(other) => {
            Err(FitError::Unsavable { key: "model".into(), value: "invalid".into(), hint: other.to_string() })
        }
    }
}

/// Fits a ply model to a table. The lobes of f_refl have fractions of `energy_refl` that add up to 1 at each
/// node; the lobes of a block of f_high have energies up to a common factor. The evaluator scales both to the
/// energies of the table. The result depends on the table and options alone, not on the number of threads.
/// Worker threads call `progress` after each unit of work.
pub fn fit(table: &Table, options: &FitOptions, progress: &(dyn Fn(Progress) + Sync)) -> Result<PlyData, FitError> {
    let mut data = frame(table, options, None)?;
    let sphere = SphereGrid::new(table.grid);
    let coarse = coarse_grid(&sphere);
    let (rows, columns, sigmas) = (table.theta_i.len(), table.h_um.len(), table.sigma_per_um.len());
    let path_um = data.path_um.clone();
    let energies: Vec<Vec<f64>> = table.energy_high.chunks_exact(sigmas).map(|e| e.to_vec()).collect();
    let spectra: Vec<Vec<f64>> = energies.iter().map(|e| energy_spectrum(e, &table.sigma_per_um, &path_um).0).collect();

    let family = options.family.unwrap_or_else(|| needed_family(&sphere, coarse.as_ref(), table, options));
    data.family = family;
    let (block_rows, block_columns) = ((rows - 1) / 2, (columns - 1) / 2);
    let blocks = block_rows * block_columns;
    let done = AtomicUsize::new(0);
    let fitted: Vec<(Vec<f64>, Vec<f64>)> = (0..blocks)
        .into_par_iter()
        .map(|block| {
            let (bm, bn) = (block / block_columns, block % block_columns);
            let targets = block_targets(&sphere, table, bm, bn, family);
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
                .with(SliceLobes::new(family, table.theta_i[node / columns]))
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

    data.refl = refl;
    data.high = fitted.iter().flat_map(|f| f.0.iter().copied()).collect();
    data.high_path = fitted.iter().flat_map(|f| f.1.iter().copied()).collect();
    canonicalize(&mut data);
    let own = errors(&data, table)?;
    let finite = |values: Vec<f64>| values.into_iter().map(|v| if v.is_finite() { v } else { 0.0 }).collect();
    data.error_refl = finite(own.refl);
    data.error_high = finite(own.high);
    data.exits = fit_exits(table);
    data.layers = Some(layer_factors(&data));
    progress(Progress { stage: Stage::Errors, done: 1, total: 1 });
    Ok(data)
}

/// Relative error of high-order slices above which cones are tried instead of round lobes.
const ROUND_SERVES: f64 = 0.06;

/// Chooses the kind of lobes for a table from a few blocks, at a third and two thirds of the theta_i axis, at
/// the center and halfway to the rim, with half the starts.
///
/// The choice is round lobes, which every host evaluates, unless their rms error exceeds [`ROUND_SERVES`] and
/// cones have less than half of their squared error. Cones have as many parameters, so they fit as much
/// noise.
fn needed_family(sphere: &SphereGrid, coarse: Option<&SphereGrid>, table: &Table, options: &FitOptions) -> LobeKind {
    let (rows, columns) = ((table.theta_i.len() - 1) / 2, (table.h_um.len() - 1) / 2);
    let effort = BlockEffort { starts: options.block.starts.div_ceil(2), moves: 0, ..options.block };
    let probes: Vec<(usize, usize)> = [rows / 3, (2 * rows / 3).min(rows - 1)]
        .into_iter()
        .flat_map(|m| [columns / 2, columns / 3].map(|n| (m, n)))
        .collect();
    // The cost is the sum of squared relative errors over all slices of all probes.
    let cost = |family: LobeKind| -> f64 {
        let costs: Vec<f64> = probes
            .par_iter()
            .map(|&(m, n)| {
                let targets = block_targets(sphere, table, m, n, family);
                fit_joint(sphere, coarse, &targets, CORNERS, options.lobes_high, &effort, 1, &[]).cost
            })
            .collect();
        costs.iter().sum()
    };
    let round = cost(LobeKind::Round);
    if round <= ROUND_SERVES.powi(2) * (9 * probes.len()) as f64 || cost(LobeKind::Cone) > 0.5 * round {
        LobeKind::Round
    } else {
        LobeKind::Cone
    }
}

/// The nine slices of block `(bm, bn)` at sigma = 0.
pub(crate) fn block_targets(sphere: &SphereGrid, table: &Table, bm: usize, bn: usize, family: LobeKind) -> Vec<Target> {
    let (columns, sigmas) = (table.h_um.len(), table.sigma_per_um.len());
    (0..9)
        .map(|i| {
            let (m, n) = (2 * bm + i / 3, 2 * bn + i % 3);
            let at = (m * columns + n) * sigmas;
            let corners = corner_weights(i / 3, i % 3).into_iter().enumerate().filter(|c| c.1 > 0.0).collect();
            Target::new(sphere, table.high_slice(m, n, 0), table.energy_high[at], table.noise_high[at], corners)
                .with(SliceLobes::new(family, table.theta_i[m]))
        })
        .collect()
}

/// The nine incidences of a block at all sigma.
pub(crate) fn dark_slices(
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
                Target::new(sphere, table.high_slice(m, n, k), energy, noise, Vec::new()).with(target.lobes)
            };
            DarkSlices { targets: (0..sigmas).map(slice).collect(), corners: target.corners.clone() }
        })
        .collect()
}

/// Inner products of a block's nine slices, for the absorption of its lobes.
pub(crate) fn block_products(
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
                    sphere.mixture_of(target.lobes, &unit, 1.0, &mut scratch)
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
