//! Woven fabrics.

use crate::batch::{Floats, Out};
use crate::errors::{Failure, Outcome};
use crate::surface::{Color, SurfaceArrays, SurfaceOptions, ask, color_of, sigma_of_reflectance, yarn_color};
use plywave::FabricModel;
use plywave::fabric::{FabricOptions, FabricSpec, LoadedFabric, YarnSet};
use plywave::io::Folder;
use plywave_pipeline::model_library;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A fabric, loaded for shading.
#[pyclass(frozen, module = "plywave._plywave", name = "Fabric")]
pub(crate) struct Fabric {
    pub(crate) fabric: Arc<FabricModel>,
    notes: Vec<String>,
}

#[pymethods]
impl Fabric {
    /// Of a spec's file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, options: SurfaceOptions) -> Outcome<Fabric> {
        let options = options.options()?;
        py.detach(|| Fabric::from_loaded(FabricSpec::load_file(path, &model_library())?, &options))
    }

    /// Of a spec's text; the files it names lie in `folder`, and anywhere.
    #[staticmethod]
    fn from_text(py: Python<'_>, text: &str, name: &str, folder: PathBuf, options: SurfaceOptions) -> Outcome<Fabric> {
        let options = options.options()?;
        let folder = Folder::new(folder).anywhere();
        py.detach(|| Fabric::from_loaded(FabricSpec::load_with(text, name, &folder, &model_library())?, &options))
    }

    /// The same fabric with other colors of warp and weft.
    #[pyo3(signature = (warp, weft, of))]
    fn with_colors(
        &self,
        py: Python<'_>,
        warp: Option<Color>,
        weft: Option<Color>,
        of: Option<&str>,
    ) -> Outcome<Fabric> {
        let colors = [yarn_color(warp, "warp")?, yarn_color(weft, "weft")?];
        let of = of.map_or(Ok(self.fabric.color_of()), color_of)?;
        let fabric = py.detach(|| self.fabric.with_colors(colors, of));
        Ok(Fabric { fabric: Arc::new(fabric), notes: self.notes.clone() })
    }

    /// Notes on the spec, a line each.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    #[getter]
    fn color_of(&self) -> &'static str {
        self.fabric.color_of().name()
    }

    #[getter]
    fn repeat_um(&self) -> (f32, f32) {
        let [x, y] = self.fabric.fabric().repeat_um();
        (x as f32, y as f32)
    }

    #[getter]
    fn memory_bytes(&self) -> usize {
        self.fabric.memory_bytes()
    }

    /// Absorptions [1/um] with which the cloth has these reflectances.
    fn sigma_of_reflectance<'py>(&self, py: Python<'py>, reflectance: Floats<'py>) -> Outcome<Bound<'py, PyAny>> {
        sigma_of_reflectance(py, self.fabric.color_curve(), &reflectance)
    }

    /// The ply model of a yarn.
    fn model_of(&self, family: &str, yarn: i32) -> Outcome<crate::model::Model> {
        let family = YarnSet::EACH.into_iter().find(|f| f.name() == family);
        let family = family.ok_or_else(|| Failure::Input("family must be \"warp\" or \"weft\"".into()))?;
        Ok(crate::model::Model::from_model(self.fabric.model_of(family, yarn).clone()))
    }

    /// Answers `what` of the queries.
    fn ask<'py>(&self, py: Python<'py>, what: &str, arrays: SurfaceArrays<'py>, mut out: Out<'py>) -> Outcome {
        ask(&*self.fabric, py, what, &arrays, &mut out)
    }
}

impl Fabric {
    fn from_loaded(loaded: LoadedFabric, options: &FabricOptions) -> Outcome<Fabric> {
        let notes = loaded.notes();
        Ok(Fabric { fabric: Arc::new(FabricModel::new(loaded, options)?), notes })
    }
}
