//! Cloths of curves, from their files or their specs.

use crate::batch::{Floats, Out};
use crate::errors::{Failure, Outcome};
use crate::surface::{Color, SurfaceArrays, SurfaceOptions, ask, color_of, sigma_of_reflectance, yarn_color};
use crate::watch::watched;
use crate::work::{RunArgs, SpecArgs};
use plywave::cloth::{ClothData, ClothModel};
use plywave::fabric::FabricOptions;
use plywave::io::{self, FileKind};
use plywave_pipeline::{ReadyCloth, model_library};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// A cloth, loaded for shading, and the bytes of its file.
#[pyclass(frozen, module = "plywave._plywave", name = "Cloth")]
pub(crate) struct Cloth {
    cloth: Arc<ClothModel>,
    bytes: Arc<Vec<u8>>,
    notes: Vec<String>,
}

#[pymethods]
impl Cloth {
    /// Of a cloth file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, options: SurfaceOptions) -> Outcome<Cloth> {
        let options = options.options()?;
        py.detach(|| {
            let bytes = io::read_file(&path, FileKind::Cloth.most_bytes())?;
            Cloth::of_bytes(bytes, &path.display().to_string(), &options)
        })
    }

    /// Of the bytes of a cloth file; `name` stands for it in messages.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str, options: SurfaceOptions) -> Outcome<Cloth> {
        let options = options.options()?;
        py.detach(|| Cloth::of_bytes(bytes.to_vec(), name, &options))
    }

    /// Of a cloth spec: looked up in the user's cache, or made and kept there.
    #[staticmethod]
    fn of_spec(py: Python<'_>, spec: SpecArgs, options: SurfaceOptions, run: RunArgs) -> Outcome<Cloth> {
        let (recipe, options) = (spec.cloth()?, options.options()?);
        watched(py, run.threads, run.progress, |watch| {
            watch.run([None, None], |run| {
                let ReadyCloth { data, notes, .. } = recipe.ready(&model_library(), run)?;
                Cloth::of_data(data, notes, &options)
            })
        })
    }

    /// Of a cloth spec: made.
    #[staticmethod]
    fn weave(py: Python<'_>, spec: SpecArgs, options: SurfaceOptions, run: RunArgs) -> Outcome<Cloth> {
        let (recipe, options) = (spec.cloth()?, options.options()?);
        watched(py, run.threads, run.progress, |watch| {
            watch.run([None, None], |run| {
                let models = recipe.models(&model_library())?;
                let curves = recipe.curves(run)?;
                let data = recipe.make(&curves, &models, true, run)?;
                Cloth::of_data(data, curves.notes.clone(), &options)
            })
        })
    }

    /// The bytes of its file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.bytes)
    }

    /// The same cloth with other colors; of one kind of yarn, the first.
    #[pyo3(signature = (warp, weft, of))]
    fn with_colors(
        &self,
        py: Python<'_>,
        warp: Option<Color>,
        weft: Option<Color>,
        of: Option<&str>,
    ) -> Outcome<Cloth> {
        let colors = [yarn_color(warp, "warp")?, yarn_color(weft, "weft")?];
        let of = of.map_or(Ok(self.cloth.color_of()), color_of)?;
        let cloth = py.detach(|| self.cloth.with_colors(colors, of));
        Ok(Cloth { cloth: Arc::new(cloth), bytes: self.bytes.clone(), notes: self.notes.clone() })
    }

    /// Notes, a line each.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    #[getter]
    fn color_of(&self) -> &'static str {
        self.cloth.color_of().name()
    }

    #[getter]
    fn cell_um(&self) -> ((f64, f64), (f64, f64)) {
        let [a, b] = self.cloth.cell_um();
        (a.into(), b.into())
    }

    #[getter]
    fn half_thickness_um(&self) -> f32 {
        self.cloth.lines().half_thickness_um()
    }

    #[getter]
    fn kinds(&self) -> usize {
        self.cloth.kinds()
    }

    #[getter]
    fn has_far(&self) -> bool {
        self.cloth.has_far()
    }

    #[getter]
    fn memory_bytes(&self) -> usize {
        self.cloth.memory_bytes()
    }

    /// Absorptions [1/um] with which the cloth has these reflectances.
    fn sigma_of_reflectance<'py>(&self, py: Python<'py>, reflectance: Floats<'py>) -> Outcome<Bound<'py, PyAny>> {
        sigma_of_reflectance(py, self.cloth.color_curve(), &reflectance)
    }

    /// The ply model of a kind of yarn.
    fn model_of(&self, kind: usize) -> Outcome<crate::model::Model> {
        let model = self.cloth.model_of(kind).ok_or_else(|| Failure::Input(format!("there is no kind {kind}")))?;
        Ok(crate::model::Model::from_model(model.clone()))
    }

    /// Answers `what` of the queries.
    fn ask<'py>(&self, py: Python<'py>, what: &str, arrays: SurfaceArrays<'py>, mut out: Out<'py>) -> Outcome {
        ask(&*self.cloth, py, what, &arrays, &mut out)
    }
}

impl Cloth {
    fn of_bytes(bytes: Vec<u8>, name: &str, options: &FabricOptions) -> Outcome<Cloth> {
        let data = ClothData::from_bytes(&bytes, name)?;
        let notes = data.notes(options);
        Ok(Cloth { cloth: Arc::new(ClothModel::from_data(data, options)?), bytes: Arc::new(bytes), notes })
    }

    fn of_data(data: ClothData, mut notes: Vec<String>, options: &FabricOptions) -> Outcome<Cloth> {
        let bytes = Arc::new(data.to_bytes()?);
        notes.extend(data.notes(options));
        Ok(Cloth { cloth: Arc::new(ClothModel::from_data(data, options)?), bytes, notes })
    }
}
