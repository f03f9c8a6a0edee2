//! Shards of long runs for external schedulers: plans of the jobs that `build`, `wave.tabulate`,
//! `wave.speckle`, twins and comparisons run, single blocks of shards as bytes, and checks of such bytes.

use crate::compare::{CompareArgs, compare_job};
use crate::errors::{Failure, Outcome};
use crate::watch::{Shards, watched};
use crate::work::{RecipeArgs, RunArgs, SpecArgs, TabulateArgs, recipe, speckle_job, tabulate_job};
use plywave::Document;
use plywave_pipeline::{AnyJob, Output};
use plywave_pipeline::{ClothRecipe, Run, model_library, simulate_job, speckle_options};
use plywave_runs::{Job, Plan, Run as JobRun, RunError, Shards as _, block_name as name_of};
use plywave_sim::twin::{TwinCurves, TwinJob, TwinOptions};
use plywave_wave::SpeckleJob;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Plan of a job: folder of the shards, text of the description, extent, digest, number of shards, shards per
/// group, units of progress.
pub(crate) type PlanRow = (String, String, u64, String, usize, usize, u64);

pub(crate) fn row<J: Job>(folder: &str, job: &J) -> PlanRow {
    let plan = Plan::from_job(job);
    (folder.into(), plan.description.text(), plan.extent, plan.digest, plan.shards, plan.group, plan.units)
}

/// The jobs that `build` runs for a recipe, and the spec's text.
#[pyfunction]
pub(crate) fn plan_build(py: Python<'_>, spec: SpecArgs, args: RecipeArgs) -> Outcome<(Vec<PlanRow>, String)> {
    py.detach(|| {
        let recipe = recipe(&spec, args)?;
        let refuse = |e: RunError| Failure::of_run(e, &recipe.file);
        let job = simulate_job(&recipe)?;
        job.check_savable().map_err(|e| refuse(e.into()))?;
        let mut rows = vec![row("simulate", &job)];
        if let Some(instances) = recipe.solved_speckle() {
            let options = speckle_options(&recipe, instances);
            rows.push(row("speckle", &SpeckleJob::new(&recipe.spec, &recipe.spec_text, &options).map_err(refuse)?));
        }
        Ok((rows, recipe.spec_text))
    })
}

/// The job of a fiber table, and the text of its spec.
#[pyfunction]
pub(crate) fn plan_tabulate(py: Python<'_>, spec: SpecArgs, args: TabulateArgs) -> Outcome<(Vec<PlanRow>, String)> {
    py.detach(|| {
        let job = tabulate_job(&spec, args)?;
        Ok((vec![row("tabulate", &job)], job.description().spec))
    })
}

/// The job of speckle patterns, and the text of their spec.
#[pyfunction]
pub(crate) fn plan_speckle(
    py: Python<'_>,
    spec: SpecArgs,
    instances: u32,
    seed: u64,
) -> Outcome<(Vec<PlanRow>, String)> {
    py.detach(|| {
        let job = speckle_job(&spec, instances, seed)?;
        Ok((vec![row("speckle", &job)], job.description().spec))
    })
}

/// The job of a cloth's twin from the cloth's spec: standard views and absorptions, `paths` per view.
#[pyfunction]
pub(crate) fn plan_twin(
    py: Python<'_>,
    cloth: PathBuf,
    paths: Option<u64>,
    seed: u64,
) -> Outcome<(Vec<PlanRow>, String)> {
    py.detach(|| {
        let recipe = ClothRecipe::load(&cloth)?;
        let refuse = |e: RunError| Failure::of_run(e, &recipe.file);
        let plies = recipe.plies(&model_library())?.spec_texts();
        let curves = recipe.curves(&Run::plain())?.curves;
        let cloth = TwinCurves::new(&recipe.spec.name, curves, plies)
            .map_err(|e| refuse(e.into()))?
            .with_hairs(recipe.spec.hairs());
        let standard = TwinOptions::default();
        let options = TwinOptions { paths: paths.unwrap_or(standard.paths), seed, ..standard };
        let job = TwinJob::new(cloth, &options).map_err(|e| refuse(e.into()))?;
        Ok((vec![row("twin", &job)], job.description().spec))
    })
}

/// The job of a comparison of waves with rays, and the text of its spec.
#[pyfunction]
pub(crate) fn plan_compare(py: Python<'_>, spec: SpecArgs, args: CompareArgs) -> Outcome<(Vec<PlanRow>, String)> {
    py.detach(|| {
        let job = compare_job(&spec, args)?;
        Ok((vec![row("compare", &job)], job.description().spec))
    })
}

/// The jobs whose shards ran last: preparing a job takes longer than many a shard.
static LAST: Mutex<VecDeque<(String, Arc<AnyJob>)>> = Mutex::new(VecDeque::new());
/// Number of jobs in that cache.
const KEPT: usize = 2;

fn job_of(description: &str, extent: u64) -> Outcome<Arc<AnyJob>> {
    let key = format!("{extent} {description}");
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(at) = last.iter().position(|(known, _)| *known == key)
        && let Some(found) = last.remove(at)
    {
        last.push_front(found);
    } else {
        let job = AnyJob::of_text(description, extent).map_err(|e| Failure::of_run(e, "job"))?;
        last.push_front((key, Arc::new(job)));
        last.truncate(KEPT);
    }
    Ok(last[0].1.clone())
}

/// Runs one shard or one group of shards; returns the bytes of its file.
#[pyfunction]
pub(crate) fn run_block<'py>(
    py: Python<'py>,
    description: &str,
    extent: u64,
    first: usize,
    count: usize,
    run: RunArgs,
) -> Outcome<Bound<'py, PyBytes>> {
    let job = py.detach(|| job_of(description, extent))?;
    let shards = first..first.saturating_add(count);
    let bytes = watched(py, run.threads, run.progress, |watch| {
        let run = JobRun { parts: None, stop: Some(&watch.stop), progress: None };
        job.run_block(shards.clone(), run).map_err(|e| Failure::of_run(e, "shard"))
    })?;
    Ok(PyBytes::new(py, &bytes))
}

/// Refuses bytes that are not the complete file of these shards.
#[pyfunction]
pub(crate) fn check_block(
    py: Python<'_>,
    description: &str,
    extent: u64,
    first: usize,
    count: usize,
    bytes: Vec<u8>,
    name: &str,
) -> Outcome {
    py.detach(|| {
        let shards = first..first.saturating_add(count);
        job_of(description, extent)?.check_block(shards, bytes, name).map_err(|e| Failure::of_run(e, name))
    })
}

/// Name of the file of shards, in a folder from which `build` and similar commands resume.
#[pyfunction]
pub(crate) fn block_name(first: usize, count: usize) -> String {
    name_of(first, count)
}

/// Merges a folder's finished shards into the job's result, running missing ones; returns its bytes.
#[pyfunction]
pub(crate) fn run_job<'py>(
    py: Python<'py>,
    description: &str,
    extent: u64,
    stage: &str,
    run: RunArgs,
) -> Outcome<Bound<'py, PyBytes>> {
    let job = py.detach(|| job_of(description, extent))?;
    let shards = Shards::open(run.folder, run.resume, &[stage])?;
    let done = watched(py, run.threads, run.progress, |watch| {
        let run = JobRun { parts: shards.of(0), stop: Some(&watch.stop), progress: None };
        Ok(match job.run(run).map_err(|e| Failure::of_run(e, "job"))? {
            Output::Table(table) => table.to_bytes()?,
            Output::Fiber(table) => table.to_bytes()?,
            Output::Speckle(patterns) => patterns.to_bytes()?,
            Output::Twin(twin) => twin.to_bytes()?,
            Output::Compare(report) => {
                let mut text = serde_json::to_vec(&*report).map_err(|e| Failure::Input(format!("report: {e}")))?;
                text.push(b'\n');
                text
            }
            Output::Scatter(_) => {
                return Err(Failure::Input("job: of a kind that makes no file; give that of a plan".into()));
            }
        })
    });
    shards.warn(py)?;
    let bytes = done?;
    shards.remove();
    Ok(PyBytes::new(py, &bytes))
}
