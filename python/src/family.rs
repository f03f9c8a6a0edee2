//! Families of plies: loading, evaluation and building.

use crate::errors::{Failure, Outcome};
use crate::model::Model;
use crate::shards::{PlanRow, row};
use crate::watch::watched;
use crate::work::{RecipeArgs, RunArgs, SpecArgs, recipe};
use plywave::Document;
use plywave::ply::{FamilyParams, PlyFamily};
use plywave_pipeline::{FamilyFolder, FamilyOptions, Recipe, Speckle, build_family as build, family_jobs};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// A loaded family.
#[pyclass(frozen, module = "plywave._plywave", name = "Family")]
pub(crate) struct Family {
    family: PlyFamily,
}

#[pymethods]
impl Family {
    /// Loads the bytes of a file; `name` identifies it in messages.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str) -> Outcome<Family> {
        Ok(Family { family: py.detach(|| PlyFamily::from_bytes(bytes, name))? })
    }

    /// Names and nodes of the axes.
    #[getter]
    fn axes(&self) -> Vec<(&'static str, Vec<f64>)> {
        self.family.data().axes.iter().map(|axis| (axis.param.name(), axis.values.clone())).collect()
    }

    /// Pitch, roughness and index of the yarn in the family's spec.
    #[getter]
    fn params(&self) -> [f64; 3] {
        let p = self.family.params();
        [p.fiber_pitch_um, p.alpha_fiber, p.eta]
    }

    /// The model of a yarn with these parameters.
    fn at(&self, py: Python<'_>, params: [f64; 3]) -> Outcome<Model> {
        let [fiber_pitch_um, alpha_fiber, eta] = params;
        Ok(Model::from_model(py.detach(|| self.family.at(&FamilyParams { fiber_pitch_um, alpha_fiber, eta }))?))
    }
}

/// Recipe and options of a family with `nodes` nodes along each axis, and up to `most_nodes` where
/// interpolation has the largest error.
fn of(spec: &SpecArgs, args: RecipeArgs, nodes: usize, most_nodes: usize) -> Outcome<(Recipe, FamilyOptions)> {
    if !(2..=64).contains(&nodes) || !(nodes..=64).contains(&most_nodes) {
        let hint = "use 2 to 64 nodes along an axis, the most no fewer than the first";
        return Err(Failure::input("options", "nodes, most_nodes", format!("{nodes}, {most_nodes}"), hint));
    }
    let mut recipe = recipe(spec, args)?;
    recipe.speckle = Speckle::None;
    Ok((recipe, FamilyOptions { first_nodes: nodes, most_nodes, ..FamilyOptions::default() }))
}

/// Builds the family of a spec with ranges; returns the bytes of its file.
#[pyfunction]
pub(crate) fn build_family<'py>(
    py: Python<'py>,
    spec: SpecArgs,
    args: RecipeArgs,
    nodes: usize,
    most_nodes: usize,
    run: RunArgs,
) -> Outcome<Bound<'py, PyBytes>> {
    let (recipe, options) = py.detach(|| of(&spec, args, nodes, most_nodes))?;
    let folder = run.folder;
    if let Some(path) = &folder {
        let io = |source| plywave::Error::Io { file: path.display().to_string(), source };
        std::fs::create_dir_all(path).map_err(io)?;
    }
    let bytes = watched(py, run.threads, run.progress, |watch| {
        let folder = folder.as_deref().map(|path| FamilyFolder { path });
        watch.run([None, None], |run| Ok(build(&recipe, &options, folder, run)?.to_bytes()?))
    })?;
    Ok(PyBytes::new(py, &bytes))
}

/// The jobs of a family with a fixed number of nodes along each axis, and the text of its spec.
#[pyfunction]
pub(crate) fn plan_family(
    py: Python<'_>,
    spec: SpecArgs,
    args: RecipeArgs,
    nodes: usize,
) -> Outcome<(Vec<PlanRow>, String)> {
    py.detach(|| {
        let (recipe, options) = of(&spec, args, nodes, nodes)?;
        let jobs = family_jobs(&recipe, &options)?;
        Ok((jobs.iter().map(|one| row(&one.folder, &one.job)).collect(), recipe.spec_text))
    })
}
