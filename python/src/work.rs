//! From specs to tables and models, and access to the wave simulator.

use crate::errors::{Failure, Outcome};
use crate::watch::{Shards, watched};
use plywave::Document;
use plywave::io::Folder;
use plywave::spec::YarnSpec;
use plywave_fiber::FiberSource;
use plywave_pipeline::{
    ClothRecipe, FitQuality, Quality, Recipe, Speckle, build as build_recipe, check_fit, fit_model, yarn_table,
};
use plywave_sim::SimulateJob;
use plywave_tables::speckle::SpecklePatterns;
use plywave_tables::table::Table;
use plywave_textile::{load_yarn, load_yarn_file};
use plywave_wave::{ScatterJob, Scene, SingleFiber, SpeckleJob, SpeckleOptions, TabulateJob};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// A spec from Python: the path of a file, or a text with the folder of the files that it names.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SpecArgs {
    path: Option<PathBuf>,
    text: String,
    name: String,
    folder: PathBuf,
}

impl SpecArgs {
    pub(crate) fn name(&self) -> String {
        self.path.as_ref().map_or_else(|| self.name.clone(), |path| path.display().to_string())
    }

    pub(crate) fn yarn(&self) -> Outcome<(YarnSpec, String)> {
        Ok(match &self.path {
            Some(path) => load_yarn_file(path)?,
            None => load_yarn(&self.text, &self.name, &Folder::new(&self.folder).anywhere())?,
        })
    }

    pub(crate) fn cloth(&self) -> Outcome<ClothRecipe> {
        Ok(match &self.path {
            Some(path) => ClothRecipe::load(path)?,
            None => ClothRecipe::parse(&self.name, self.text.clone(), &self.folder)?,
        })
    }

    /// The text of a scene.
    fn scene(&self) -> Outcome<(Scene, String)> {
        let refuse = |e| Failure::of_run(e, &self.name());
        match &self.path {
            Some(path) => Scene::load(path).map_err(refuse),
            None => Ok((Scene::parse(&self.text).map_err(refuse)?, self.text.clone())),
        }
    }
}

/// Conditions of a run: threads, parts, progress.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct RunArgs {
    pub(crate) folder: Option<PathBuf>,
    pub(crate) resume: bool,
    pub(crate) threads: usize,
    pub(crate) progress: Option<Py<PyAny>>,
}

/// Options of a recipe for a spec.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct RecipeArgs {
    quality: String,
    seed: u64,
    paths: Option<u64>,
    instances: Option<u32>,
    traced_plies: bool,
    speckle: SpeckleArgs,
}

/// Source of speckle.
#[derive(FromPyObject)]
pub(crate) enum SpeckleArgs {
    /// Whether the default number of fibers is solved.
    Usual(bool),
    /// Number of fibers to solve.
    Solve(u32),
    /// Bytes of a file of patterns, and its name.
    Patterns(Vec<u8>, String),
}

pub(crate) fn quality(name: &str) -> Outcome<Quality> {
    let known = [Quality::Preview, Quality::Standard, Quality::Reference];
    known.into_iter().find(|quality| quality.name() == name).ok_or_else(|| {
        Failure::input("options", "quality", format!("{name:?}"), "use \"preview\", \"standard\" or \"reference\"")
    })
}

pub(crate) fn recipe(spec: &SpecArgs, args: RecipeArgs) -> Outcome<Recipe> {
    let (yarn, text) = spec.yarn()?;
    let mut recipe = Recipe::new(spec.name(), yarn, text, quality(&args.quality)?);
    (recipe.seed, recipe.paths, recipe.instances) = (args.seed, args.paths, args.instances);
    recipe.traced_plies = args.traced_plies;
    if args.traced_plies && recipe.spec.yarn.plies < 2 {
        let hint = "tracing plies together needs 2 or more";
        return Err(Failure::input(&recipe.file, "yarn.plies", recipe.spec.yarn.plies, hint));
    }
    if let Some(paths) = args.paths.filter(|n| !(1..=1_000_000_000_000).contains(n)) {
        return Err(Failure::input("options", "paths", paths, "must be 1 to 1000000000000"));
    }
    if let Some(instances) = args.instances.filter(|n| !(1..=1000).contains(n)) {
        return Err(Failure::input("options", "instances", instances, "must be 1 to 1000"));
    }
    recipe.speckle = match args.speckle {
        SpeckleArgs::Usual(true) => Speckle::Usual,
        SpeckleArgs::Usual(false) => Speckle::None,
        SpeckleArgs::Solve(instances) => Speckle::Solve(instances),
        SpeckleArgs::Patterns(bytes, name) => {
            Speckle::Patterns(Box::new(SpecklePatterns::from_bytes(&bytes, &name)?), name)
        }
    };
    Ok(recipe)
}

/// Bytes of a file for Python.
fn bytes_of<'py>(py: Python<'py>, bytes: &[u8]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, bytes)
}

/// Builds a model; returns the bytes of the model and of the table of its ply.
#[pyfunction]
pub(crate) fn build<'py>(
    py: Python<'py>,
    spec: SpecArgs,
    args: RecipeArgs,
    run: RunArgs,
) -> Outcome<(Bound<'py, PyBytes>, Bound<'py, PyBytes>, [f64; 3])> {
    let recipe = py.detach(|| recipe(&spec, args))?;
    let shards = Shards::open(run.folder, run.resume, &["simulate", "speckle"])?;
    let done = watched(py, run.threads, run.progress, |watch| {
        let built = watch.run([shards.of(0), shards.of(1)], |run| Ok(build_recipe(&recipe, run)?))?;
        let times = [built.times.simulate, built.times.fit, built.times.speckle].map(|t| t.as_secs_f64());
        Ok((built.model.to_bytes()?, built.table.to_bytes()?, times))
    });
    shards.warn(py)?;
    let (model, table, times) = done?;
    shards.remove();
    Ok((bytes_of(py, &model), bytes_of(py, &table), times))
}

/// Simulates the ply of a spec; returns the bytes of its table.
#[pyfunction]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    spec: SpecArgs,
    args: RecipeArgs,
    run: RunArgs,
) -> Outcome<Bound<'py, PyBytes>> {
    let recipe = py.detach(|| recipe(&spec, args))?;
    let refuse = |e| Failure::of_run(e, &recipe.file);
    let job = SimulateJob::new(&recipe.spec, &recipe.spec_text, &recipe.simulation()).map_err(refuse)?;
    job.check_savable().map_err(refuse)?;
    let shards = Shards::open(run.folder, run.resume, &["simulate"])?;
    let done = watched(py, run.threads, run.progress, |watch| {
        Ok(watch.run_job(&job, ("simulate", "paths"), shards.of(0), &recipe.file)?.to_bytes()?)
    });
    shards.warn(py)?;
    let table = done?;
    shards.remove();
    Ok(bytes_of(py, &table))
}

/// Fits a model to a table; returns the bytes of the model.
#[pyfunction]
#[pyo3(signature = (table, name, quality_name, run))]
pub(crate) fn fit<'py>(
    py: Python<'py>,
    table: &[u8],
    name: &str,
    quality_name: Option<&str>,
    run: RunArgs,
) -> Outcome<Bound<'py, PyBytes>> {
    let chosen = quality_name.map(quality).transpose()?;
    let model = watched(py, run.threads, run.progress, |watch| {
        let table = Table::from_bytes(table, name)?;
        let spec = YarnSpec::parse(&table.spec_text, &format!("{name} (its spec)"))?;
        let options = chosen.unwrap_or_else(|| Quality::of_preset(&table.preset)).fit();
        watch.run([None, None], |run| {
            check_fit(&table, &spec, &options, name)?;
            let yarn = yarn_table(&table, &spec, name, run)?;
            Ok(fit_model(yarn.as_ref().unwrap_or(&table), &spec, &options, name, run)?.to_bytes()?)
        })
    })?;
    Ok(bytes_of(py, &model))
}

/// Largest errors of a model's fit, of f_refl and f_high, and their limits.
#[pyfunction]
pub(crate) fn fit_quality(model: &crate::model::Model) -> [[f64; 2]; 2] {
    let of = |quality: FitQuality| [quality.refl, quality.high];
    [of(FitQuality::from_data(model.model.data())), of(FitQuality::good())]
}

/// Solves a scene; returns the report as JSON.
#[pyfunction]
pub(crate) fn wave_scatter(py: Python<'_>, scene: SpecArgs, run: RunArgs) -> Outcome<String> {
    let name = scene.name();
    let (scene, text) = py.detach(|| scene.scene())?;
    watched(py, run.threads, run.progress, |watch| {
        let report = watch.run_job(&ScatterJob::new(&scene, &text), ("scatter", "cases"), None, &name)?;
        serde_json::to_string(&report).map_err(|e| Failure::Input(format!("{name}: {e}")))
    })
}

/// Sizes of a fiber table that override the preset's.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct TabulateArgs {
    quality: String,
    sigma_per_um: f64,
    rays: bool,
    lambdas: Option<usize>,
    thetas: Option<usize>,
    azimuths: Option<usize>,
    ray_count: Option<u64>,
    seed: u64,
    beta_m_rad: f64,
}

/// The job of a fiber's table.
pub(crate) fn tabulate_job(spec: &SpecArgs, args: TabulateArgs) -> Outcome<TabulateJob<'static>> {
    let refuse = |key: &str, value: f64, hint: &str| Err(Failure::input("options", key, value, hint));
    if !(args.sigma_per_um >= 0.0 && args.sigma_per_um <= 1e3) {
        return refuse("sigma_per_um", args.sigma_per_um, "must be 0 to 1000, in 1/um");
    }
    if !(args.beta_m_rad >= 0.001 && args.beta_m_rad <= 2.0) {
        return refuse("beta_m_rad", args.beta_m_rad, "must be from 0.001 to 2, in radians");
    }
    let mut options = quality(&args.quality)?.tabulate();
    for (key, to, from, max) in [
        ("lambdas", &mut options.lambdas, args.lambdas, 400),
        ("thetas", &mut options.thetas, args.thetas, 900),
        ("azimuths", &mut options.azimuths, args.azimuths, 3600),
    ] {
        match from {
            Some(n) if !(1..=max).contains(&n) => {
                return Err(Failure::input("options", key, n, &format!("must be 1 to {max}")));
            }
            Some(n) => *to = n,
            None => {}
        }
    }
    if let Some(n) = args.ray_count.filter(|n| !(1..=1_000_000_000).contains(n)) {
        return Err(Failure::input("options", "ray_count", n, "must be 1 to 1000000000"));
    }
    options.relative = options.relative.max(options.azimuths);
    options.rays = args.ray_count.unwrap_or(options.rays);
    options.seed = args.seed;
    options.beta_m = args.beta_m_rad;
    let name = spec.name();
    let refuse = |e| Failure::of_run(e, &name);
    let (fiber, text) = match &spec.path {
        Some(path) => SingleFiber::load(path, args.sigma_per_um),
        None => SingleFiber::parse(&spec.text, &name, args.sigma_per_um).map(|fiber| (fiber, spec.text.clone())),
    }
    .map_err(refuse)?;
    let source = if args.rays { FiberSource::Ray } else { FiberSource::Wave };
    TabulateJob::new(&fiber, &text, &options, source).map_err(refuse)
}

/// Tabulates a fiber; returns the bytes of its table.
#[pyfunction]
pub(crate) fn wave_tabulate<'py>(
    py: Python<'py>,
    spec: SpecArgs,
    args: TabulateArgs,
    run: RunArgs,
) -> Outcome<Bound<'py, PyBytes>> {
    let name = spec.name();
    let job = tabulate_job(&spec, args)?;
    let shards = Shards::open(run.folder, run.resume, &["tabulate"])?;
    let done = watched(py, run.threads, run.progress, |watch| {
        Ok(watch.run_job(&job, ("tabulate", "slices"), shards.of(0), &name)?.to_bytes()?)
    });
    shards.warn(py)?;
    let table = done?;
    shards.remove();
    Ok(bytes_of(py, &table))
}

/// The job of speckle patterns of a spec's fiber.
pub(crate) fn speckle_job(spec: &SpecArgs, instances: u32, seed: u64) -> Outcome<SpeckleJob> {
    if !(2..=100_000).contains(&instances) {
        return Err(Failure::input("options", "instances", instances, "must be 2 to 100000"));
    }
    let name = spec.name();
    let (yarn, text) = spec.yarn()?;
    let options = SpeckleOptions { instances, seed, ..SpeckleOptions::default() };
    SpeckleJob::new(&yarn, &text, &options).map_err(|e| Failure::of_run(e, &name))
}

/// Solves speckle patterns of a spec's fiber; returns their bytes.
#[pyfunction]
pub(crate) fn wave_speckle<'py>(
    py: Python<'py>,
    spec: SpecArgs,
    instances: u32,
    seed: u64,
    run: RunArgs,
) -> Outcome<Bound<'py, PyBytes>> {
    let name = spec.name();
    let job = py.detach(|| speckle_job(&spec, instances, seed))?;
    let shards = Shards::open(run.folder, run.resume, &["speckle"])?;
    let done = watched(py, run.threads, run.progress, |watch| {
        Ok(watch.run_job(&job, ("speckle", "fibers"), shards.of(0), &name)?.to_bytes()?)
    });
    shards.warn(py)?;
    let patterns = done?;
    shards.remove();
    Ok(bytes_of(py, &patterns))
}
