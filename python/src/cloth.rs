//! Cloths, from their files or specs.

use crate::batch::{Floats, Out, Rows};
use crate::cloth_queries::{ClothArrays, ask};
use crate::errors::{Failure, Outcome};
use crate::export::{ExportArgs, Written, written};
use crate::watch::watched;
use crate::work::{RunArgs, SpecArgs};
use numpy::IntoPyArray;
use plywave::ClothModel;
use plywave::Document;
use plywave::cloth::{ClothData, ClothOptions, ColorOf, GapLight, Slits, YarnColor};
use plywave::io::{self, FileKind};
use plywave_pipeline::{PrecomputedCloth, model_library};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// Shading options of a cloth.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ClothArgs {
    gaps: String,
    sigma_per_um: Option<f32>,
    noise: bool,
    layers: bool,
    shadowing: bool,
    edges: bool,
    slits: Option<(f32, f32)>,
    uneven: bool,
    relief: bool,
    far: bool,
}

impl ClothArgs {
    fn options(&self) -> Outcome<ClothOptions> {
        let gaps = match self.gaps.as_str() {
            "diffracted" => GapLight::Diffracted,
            "straight" => GapLight::Straight,
            other => {
                return Err(Failure::input(
                    "options",
                    "gaps",
                    format!("{other:?}"),
                    "use \"diffracted\" or \"straight\"",
                ));
            }
        };
        Ok(ClothOptions {
            gaps,
            sigma_per_um: sigma_of_options(self.sigma_per_um)?,
            noise: self.noise,
            layers: self.layers,
            shadowing: self.shadowing,
            edges: self.edges,
            slits: self.slits.map(|(width_um, share)| Slits { width_um, share }),
            uneven: self.uneven,
            relief: self.relief,
            far: self.far,
        })
    }
}

/// Checks an absorption [1/um] of the options for all yarns.
fn sigma_of_options(sigma: Option<f32>) -> Outcome<Option<f32>> {
    match sigma {
        Some(sigma) if !(0.0..=1e6).contains(&sigma) => {
            Err(Failure::input("options", "sigma_per_um", sigma, "must be 0 to 1e6, in 1/um"))
        }
        sigma => Ok(sigma),
    }
}

/// Color of yarns: sRGB, an absorption, or none.
#[derive(FromPyObject)]
pub(crate) enum Color {
    Srgb([f32; 3]),
    Sigma(f32),
}

fn yarn_color(color: Option<Color>, name: &str) -> Outcome<YarnColor> {
    Ok(match color {
        None => YarnColor::Undyed,
        Some(Color::Srgb(srgb)) if srgb.iter().all(|c| (0.0..=1.0).contains(c)) => YarnColor::Srgb(srgb),
        Some(Color::Srgb(srgb)) => {
            return Err(Failure::input("colors", name, format!("{srgb:?}"), "use sRGB from 0 to 1"));
        }
        Some(Color::Sigma(sigma)) if (0.0..=1e6).contains(&sigma) => YarnColor::Sigma(sigma),
        Some(Color::Sigma(sigma)) => return Err(Failure::input("colors", name, sigma, "must be 0 to 1e6, in 1/um")),
    })
}

fn color_of(name: &str) -> Outcome<ColorOf> {
    [ColorOf::EvenSky, ColorOf::Reflected, ColorOf::Folded].into_iter().find(|of| of.name() == name).ok_or_else(|| {
        Failure::input("colors", "color_of", format!("{name:?}"), "use \"even_sky\", \"reflected\" or \"folded\"")
    })
}

/// A cloth loaded for shading, and the bytes of its file.
#[pyclass(frozen, module = "plywave._plywave", name = "Cloth")]
pub(crate) struct Cloth {
    cloth: Arc<ClothModel>,
    bytes: Arc<Vec<u8>>,
    notes: Vec<String>,
}

#[pymethods]
impl Cloth {
    /// Loads a cloth file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, options: ClothArgs) -> Outcome<Cloth> {
        let options = options.options()?;
        py.detach(|| {
            let bytes = io::read_file(&path, FileKind::Cloth.most_bytes())?;
            Cloth::of_bytes(bytes, &path.display().to_string(), &options)
        })
    }

    /// Loads the bytes of a cloth file; `name` identifies it in messages.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str, options: ClothArgs) -> Outcome<Cloth> {
        let options = options.options()?;
        py.detach(|| Cloth::of_bytes(bytes.to_vec(), name, &options))
    }

    /// Loads the cloth of a spec from the user's cache, or precomputes and caches it.
    #[staticmethod]
    fn of_spec(py: Python<'_>, spec: SpecArgs, options: ClothArgs, run: RunArgs) -> Outcome<Cloth> {
        let (recipe, options) = (spec.cloth()?, options.options()?);
        watched(py, run.threads, run.progress, |watch| {
            watch.run([None, None], |run| {
                let PrecomputedCloth { data, notes, .. } = recipe.precomputed(&model_library(), run)?;
                Cloth::of_data(data, notes, &options)
            })
        })
    }

    /// Precomputes the cloth of a spec.
    #[staticmethod]
    fn weave(py: Python<'_>, spec: SpecArgs, options: ClothArgs, run: RunArgs) -> Outcome<Cloth> {
        let (recipe, options) = (spec.cloth()?, options.options()?);
        watched(py, run.threads, run.progress, |watch| {
            watch.run([None, None], |run| {
                let plies = recipe.plies(&model_library())?;
                let curves = recipe.curves(run)?;
                let plies = plies.build(run)?;
                let data = recipe.make(&curves, &plies.models, true, run)?;
                Cloth::of_data(data, [plies.notes, curves.notes].concat(), &options)
            })
        })
    }

    /// The bytes of the cloth file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.bytes)
    }

    /// The same cloth with other colors; a cloth with one kind of yarn uses the first.
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

    /// Notes on the cloth, one per line.
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

    /// Absorptions [1/um] at which the cloth has these reflectances.
    fn sigma_of_reflectance<'py>(&self, py: Python<'py>, reflectance: Floats<'py>) -> Outcome<Bound<'py, PyAny>> {
        let n = match &reflectance {
            Floats::Single(array) => array.len()?,
            Floats::Double(array) => array.len()?,
        };
        let rows: Rows<'_, 1> = Rows::new(&reflectance, n, "reflectance")?;
        let curve = self.cloth.color_curve();
        let sigma = |i: usize| curve.sigma(f64::from(rows.get(i)[0])).0 as f32;
        let sigma: Vec<f32> = py.detach(|| (0..n).map(sigma).collect());
        Ok(sigma.into_pyarray(py).into_any())
    }

    /// The ply model of a kind of yarn.
    fn model_of(&self, kind: usize) -> Outcome<crate::model::Model> {
        let model = self.cloth.model_of(kind).ok_or_else(|| Failure::Input(format!("there is no kind {kind}")))?;
        Ok(crate::model::Model::from_model(model.clone()))
    }

    /// Exports the cloth for other programs; `name` identifies it in messages.
    fn export(
        &self,
        py: Python<'_>,
        name: &str,
        paths: Vec<PathBuf>,
        format: &str,
        args: ExportArgs,
        run: RunArgs,
    ) -> Outcome<Written> {
        written(py, &self.bytes, name, paths, format, args, run)
    }

    /// Computes the quantity `what` for the queries.
    fn ask<'py>(&self, py: Python<'py>, what: &str, arrays: ClothArrays<'py>, mut out: Out<'py>) -> Outcome {
        ask(&self.cloth, py, what, &arrays, &mut out)
    }
}

impl Cloth {
    fn of_bytes(bytes: Vec<u8>, name: &str, options: &ClothOptions) -> Outcome<Cloth> {
        let data = ClothData::from_bytes(&bytes, name)?;
        let notes = data.notes(options);
        Ok(Cloth { cloth: Arc::new(ClothModel::from_data(data, options)?), bytes: Arc::new(bytes), notes })
    }

    fn of_data(data: ClothData, mut notes: Vec<String>, options: &ClothOptions) -> Outcome<Cloth> {
        let bytes = Arc::new(data.to_bytes()?);
        notes.extend(data.notes(options));
        Ok(Cloth { cloth: Arc::new(ClothModel::from_data(data, options)?), bytes, notes })
    }
}
