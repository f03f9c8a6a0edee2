//! Builds a ply model from a recipe in one call: simulation, table of the yarn, fit, speckle.

use crate::error::Error;
use crate::recipe::{Recipe, Speckle};
use crate::run::Run;
use crate::stages::{
    add_speckle, fit_model, noise_options, simulate, simulate_job, solve_speckle, speckle_options, yarn_table,
};
use plywave::ply::PlyData;
use plywave_runs::{self as runs, RunError};
use plywave_tables::table::Table;
use plywave_wave::SpeckleJob;
use plywave_wave::noise::check_savable;
use std::time::{Duration, Instant};

/// Times of the stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Times {
    /// Simulation.
    pub simulate: Duration,
    /// Table of the yarn, for a yarn of several plies, and fit.
    pub fit: Duration,
    /// Speckle: solving and fitting its patterns.
    pub speckle: Duration,
}

/// A model with its table and times.
pub struct Built {
    /// The model.
    pub model: PlyData,
    /// Table of the ply that was simulated.
    pub table: Table,
    /// Times of the stages.
    pub times: Times,
}

/// Builds a recipe's model on the current thread pool. The result depends on the recipe alone.
///
/// # Errors
/// [`Error::Interrupted`] if the run was stopped, and those of the stages. Unusable folders, and recipes
/// whose results could not be saved, are refused before any work.
pub fn build(recipe: &Recipe, run: &Run<'_>) -> Result<Built, Error> {
    let (spec, text, file) = (&recipe.spec, &recipe.spec_text, recipe.file.as_str());
    let speckle = recipe.solved_speckle().map(|instances| speckle_options(recipe, instances));
    let refuse = |error: RunError| Error::of_simulation(error, file);
    // Unusable folders are refused here, before the earlier stages run.
    let check = runs::Run { parts: run.parts, ..runs::Run::plain() };
    runs::check_parts(&simulate_job(recipe)?, check).map_err(refuse)?;
    if let Some(options) = &speckle {
        let job = SpeckleJob::new(spec, text, options).map_err(refuse)?;
        let check = runs::Run { parts: run.speckle_parts, ..runs::Run::plain() };
        runs::check_parts(&job, check).map_err(refuse)?;
    }

    if let Speckle::Patterns(patterns, name) = &recipe.speckle {
        check_savable(patterns, &noise_options(recipe.seed, spec), name)?;
    }

    let mut times = Times::default();
    let begun = Instant::now();
    let table = simulate(recipe, run)?;
    times.simulate = begun.elapsed();

    let begun = Instant::now();
    let yarn = yarn_table(&table, spec, file, run)?;
    run.check_stop()?;
    let options = recipe.quality.fit();
    let mut model = fit_model(yarn.as_ref().unwrap_or(&table), spec, &options, file, run)?;
    run.check_stop()?;
    times.fit = begun.elapsed();

    let begun = Instant::now();
    match (&recipe.speckle, &speckle) {
        (Speckle::Patterns(patterns, name), _) => add_speckle(&mut model, patterns, spec, name)?,
        (_, Some(options)) => {
            let patterns = solve_speckle(spec, text, options, file, run)?;
            add_speckle(&mut model, &patterns, spec, file)?;
        }
        _ => {}
    }
    times.speckle = begun.elapsed();
    Ok(Built { model, table, times })
}
