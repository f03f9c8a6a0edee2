//! The stages of the pipeline, as functions from input and options to output.

use crate::error::Error;
use crate::recipe::Recipe;
use crate::run::{Progress, Run, Stage};
use plywave::ply::{EdgeLobes, PlyData};
use plywave::spec::YarnSpec;
use plywave_fit::{EdgeOptions, FitOptions, fit, fit_edge, frame};
use plywave_runs::{self as runs, PartsFolder};
use plywave_sim::{SimError, SimulateJob};
use plywave_tables::speckle::SpecklePatterns;
use plywave_tables::table::Table;
use plywave_wave::noise::{NoiseOptions, noise_spectrum};
use plywave_wave::{SpeckleJob, SpeckleOptions};
use std::sync::atomic::{AtomicU64, Ordering};

/// Limits of a good fit: the largest error of an f_refl slice, and that of an f_high slice relative to its
/// light at sigma = 0.
const GOOD_REFL: f64 = 0.2;
/// Limit for f_high; see [`GOOD_REFL`].
const GOOD_HIGH: f64 = 0.15;

/// Runs one stage's job and reports its progress.
fn run_job<J: runs::Job>(
    job: &J,
    stage: Stage,
    parts: Option<&PartsFolder>,
    run: &Run<'_>,
    file: &str,
) -> Result<J::Output, Error> {
    let total = runs::Plan::from_job(job).units;
    let done = AtomicU64::new(0);
    let advance = |units: u64| {
        let done = done.fetch_add(units, Ordering::Relaxed) + units;
        run.report(Progress { stage, done, total });
    };
    run.report(Progress { stage, done: 0, total });
    let inner = runs::Run { parts, stop: run.stop, progress: Some(&advance) };
    runs::run(job, inner).map_err(|e| Error::of_simulation(e, file))
}

/// The job of a recipe's simulation. A number of paths whose noise would make the table invalid is refused.
///
/// # Errors
/// [`Error::Simulation`].
pub fn simulate_job(recipe: &Recipe) -> Result<SimulateJob, Error> {
    let refuse = |e: SimError| Error::of_simulation(e, &recipe.file);
    let job = SimulateJob::new(&recipe.spec, &recipe.spec_text, &recipe.simulation()).map_err(refuse)?;
    job.check_savable().map_err(refuse)?;
    Ok(job)
}

/// The table of the recipe's ply, or of its traced yarn.
///
/// # Errors
/// Those of [`plywave_sim::simulate`], and [`SimError::TooFewPaths`] before any work.
pub fn simulate(recipe: &Recipe, run: &Run<'_>) -> Result<Table, Error> {
    run_job(&simulate_job(recipe)?, Stage::Simulate, run.parts, run, &recipe.file)
}

/// Computes the table of the yarn of `spec` from the table of one of its plies; `None` if the table describes
/// the yarn already, or the yarn has one ply. `file` identifies the table in messages.
///
/// # Errors
/// [`Error::Simulation`] for tables with inconsistent arrays.
pub fn yarn_table(table: &Table, spec: &YarnSpec, file: &str, run: &Run<'_>) -> Result<Option<Table>, Error> {
    if table.plies > 1 || spec.yarn.plies == 1 {
        return Ok(None);
    }
    let tell = |done: usize, total: usize| {
        run.report(Progress { stage: Stage::Yarn, done: done as u64, total: total as u64 });
    };
    match plywave_sim::yarn::yarn_table(table, spec, &plywave_sim::yarn::YarnOptions::default(), &tell) {
        Ok((yarn, _)) => Ok(Some(yarn)),
        Err(error) => Err(Error::of_simulation(error, file)),
    }
}

/// Fits the model of a table, with its layer factors and the edge lobes of `spec`, the table's spec. Numbers
/// of lobes in the spec override those of the options. `file` identifies the table in messages.
///
/// # Errors
/// [`Error::Fit`].
pub fn fit_model(
    table: &Table,
    spec: &YarnSpec,
    options: &FitOptions,
    file: &str,
    run: &Run<'_>,
) -> Result<PlyData, Error> {
    let edge = check_fit(table, spec, options, file)?;
    let options = with_lobes_of(options, spec);
    let tell = |p| tell_fit(run, p);
    let mut data = fit(table, &options, &tell).map_err(|source| Error::Fit { file: file.into(), source })?;
    data.edge = Some(edge);
    Ok(data)
}

/// Reports the progress of a fit to a run.
pub(crate) fn tell_fit(run: &Run<'_>, p: plywave_fit::Progress) {
    let stage = match p.stage {
        plywave_fit::Stage::High => Stage::FitHigh,
        plywave_fit::Stage::Reflection => Stage::FitReflection,
        plywave_fit::Stage::Errors => Stage::FitErrors,
    };
    run.report(Progress { stage, done: p.done as u64, total: p.total as u64 });
}

/// Refuses, within milliseconds, a table whose model could not be saved; returns the edge lobes of `spec`.
/// `file` identifies the table in messages.
///
/// # Errors
/// [`Error::Fit`].
pub fn check_fit(table: &Table, spec: &YarnSpec, options: &FitOptions, file: &str) -> Result<EdgeLobes, Error> {
    let edge = fit_edge(spec, &EdgeOptions::default()).lobes;
    match frame(table, &with_lobes_of(options, spec), Some(edge.clone())) {
        Ok(_) => Ok(edge),
        Err(source) => Err(Error::Fit { file: file.into(), source }),
    }
}

/// The options with the spec's numbers of lobes.
pub(crate) fn with_lobes_of(options: &FitOptions, spec: &YarnSpec) -> FitOptions {
    let mut options = *options;
    options.lobes_refl = spec.simulation.lobes_refl.map_or(options.lobes_refl, |n| n as usize);
    options.lobes_high = spec.simulation.lobes_high.map_or(options.lobes_high, |n| n as usize);
    options
}

/// Options of the speckle patterns of a recipe.
pub fn speckle_options(recipe: &Recipe, instances: Option<u32>) -> SpeckleOptions {
    let usual = SpeckleOptions::default();
    SpeckleOptions { seed: recipe.seed, instances: instances.unwrap_or(usual.instances), ..usual }
}

/// Solves speckle patterns of single fibers of `spec`, whose text is `spec_text`. `file` identifies the spec
/// in messages.
///
/// # Errors
/// Those of [`plywave_wave::speckle`].
pub fn solve_speckle(
    spec: &YarnSpec,
    spec_text: &str,
    options: &SpeckleOptions,
    file: &str,
    run: &Run<'_>,
) -> Result<SpecklePatterns, Error> {
    let job = SpeckleJob::new(spec, spec_text, options).map_err(|e| Error::of_simulation(e, file))?;
    run_job(&job, Stage::Speckle, run.speckle_parts, run, file)
}

/// Adds speckle noise to a model: the spectrum of the patterns of its fiber in the beam of `spec`. `file`
/// identifies the patterns in messages.
///
/// # Errors
/// Those of [`noise_spectrum`].
pub fn add_speckle(model: &mut PlyData, patterns: &SpecklePatterns, spec: &YarnSpec, file: &str) -> Result<(), Error> {
    model.noise = Some(noise_spectrum(patterns, &noise_options(model.seed, spec), file)?.0);
    Ok(())
}

/// Options of the noise of a model of `spec`.
pub(crate) fn noise_options(seed: u64, spec: &YarnSpec) -> NoiseOptions {
    NoiseOptions { seed, w0_um: spec.beam.beam().w0_um, ..NoiseOptions::default() }
}

/// Fraction of a beam that hits fibers above which a slice's errors count in full ([`held_errors`]).
pub const MIN_MET: f64 = 0.02;

/// Errors of f_refl, `[theta_i][h]`, and of f_high, `[theta_i][h][sigma]`, for comparison with limits:
/// relative L2 errors of the slices, for f_high as a share of the slice's light at sigma = 0.
///
/// Beyond the ply's rim almost none of a beam hits fibers, and the error of energies is 0.002 of the beam. If
/// less than [`MIN_MET`] of the beam hits fibers, a slice's errors are scaled by that fraction over
/// [`MIN_MET`].
pub fn held_errors(data: &PlyData, error_refl: &[f64], error_high: &[f64]) -> [Vec<f64>; 2] {
    let (nodes, sigmas) = (data.node_energies(), data.sigma_per_um.len().max(1));
    let energy = |k: usize| nodes[k / sigmas].high_at(data.sigma_per_um[k % sigmas], &data.path_um);
    let share = |k: usize| energy(k) / energy(k - k % sigmas).max(f64::MIN_POSITIVE);
    let hit_share = |node: usize| ((1.0 - nodes[node].r_d) / MIN_MET).clamp(0.0, 1.0);
    [
        error_refl.iter().enumerate().map(|(node, e)| e * hit_share(node)).collect(),
        error_high.iter().enumerate().map(|(k, e)| e * share(k) * hit_share(k / sigmas)).collect(),
    ]
}

/// Distance of a model from the table of its fit: the largest errors of its slices, as in `plywave check`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitQuality {
    /// Largest relative L2 error of an f_refl slice, without noise; 0 for a model without f_refl, as for
    /// opaque fibers; NaN if noise hides all of them.
    pub refl: f64,
    /// Largest error of an f_high slice, relative to its light at sigma = 0.
    pub high: f64,
}

impl FitQuality {
    /// Quality of a model from the errors that its fit stored in it.
    pub fn from_data(data: &PlyData) -> FitQuality {
        FitQuality::of_errors(data, &data.error_refl, &data.error_high)
    }

    /// Quality of a model with these errors of its slices, `[theta_i][h]` and `[theta_i][h][sigma]`, weighted
    /// as in [`held_errors`].
    pub fn of_errors(data: &PlyData, error_refl: &[f64], error_high: &[f64]) -> FitQuality {
        let [refl, high] = held_errors(data, error_refl, error_high);
        // Noise hides errors that are not positive.
        let largest = |errors: Vec<f64>| errors.into_iter().filter(|e| *e > 0.0).fold(f64::NAN, f64::max);
        // Without light, no fit is needed: the energies of the lobes are those of the table.
        let none = data.node_energies().iter().all(|energies| energies.refl == 0.0);
        FitQuality { refl: if none { 0.0 } else { largest(refl) }, high: largest(high) }
    }

    /// Limits of a good model: 0.2 and 0.15.
    pub fn good() -> FitQuality {
        FitQuality { refl: GOOD_REFL, high: GOOD_HIGH }
    }

    /// Whether both errors are at most those of `allowed`. Errors that noise hides pass.
    pub fn is_within(&self, allowed: &FitQuality) -> bool {
        let exceeds = |value: f64, limit: f64| value > limit;
        !exceeds(self.refl, allowed.refl) && !exceeds(self.high, allowed.high)
    }
}
