//! Woven fabrics.

use crate::batch::{Floats, Out, PreparedQueries, Rows, Same, What, by_channels, rows_mut};
use crate::errors::{Failure, Outcome};
use numpy::IntoPyArray;
use plywave::fabric::{
    Channels, ColorOf, FabricBsdf, FabricOptions, FabricSpec, GapLight, LoadedFabric, Slits, YarnColor, YarnSet,
};
use plywave::io::Folder;
use plywave::{FabricModel, FabricQuery};
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

/// How a fabric is shaded.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Options {
    gaps: String,
    sigma_per_um: Option<f32>,
    noise: bool,
    layers: bool,
    shadowing: bool,
    edges: bool,
    slits: Option<(f32, f32)>,
    far: bool,
}

impl Options {
    fn options(&self) -> Outcome<FabricOptions> {
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
        if let Some(sigma) = self.sigma_per_um.filter(|sigma| !(*sigma >= 0.0 && *sigma <= 1e6)) {
            return Err(Failure::input("options", "sigma_per_um", sigma, "must be 0 to 1e6, in 1/um"));
        }
        Ok(FabricOptions {
            gaps,
            sigma_per_um: self.sigma_per_um,
            noise: self.noise,
            layers: self.layers,
            shadowing: self.shadowing,
            edges: self.edges,
            slits: self.slits.map(|(width_um, share)| Slits { width_um, share }),
            far: self.far,
        })
    }
}

/// The queries of a call, as flat arrays.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct FabricArrays<'py> {
    n: usize,
    channels: usize,
    position: Floats<'py>,
    wo: Floats<'py>,
    /// Absent for linear sRGB.
    lambda: Option<Floats<'py>>,
    warp: Option<Floats<'py>>,
    weft: Option<Floats<'py>>,
    turn: Floats<'py>,
    footprint: Floats<'py>,
    w: Option<Floats<'py>>,
    threads: usize,
}

/// A color of yarns: sRGB, an absorption, or none.
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

#[pymethods]
impl Fabric {
    /// Of a spec's file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, options: Options) -> Outcome<Fabric> {
        let options = options.options()?;
        py.detach(|| Fabric::from_loaded(FabricSpec::load_file(path, &model_library())?, &options))
    }

    /// Of a spec's text; the files it names lie in `folder`, and anywhere.
    #[staticmethod]
    fn from_text(py: Python<'_>, text: &str, name: &str, folder: PathBuf, options: Options) -> Outcome<Fabric> {
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
        let n = match &reflectance {
            Floats::Single(array) => array.len()?,
            Floats::Double(array) => array.len()?,
        };
        let rows: Rows<'_, 1> = Rows::new(&reflectance, n, "reflectance")?;
        let sigma: Vec<f32> = py.detach(|| (0..n).map(|i| self.fabric.sigma_of_reflectance(rows.get(i))[0]).collect());
        Ok(sigma.into_pyarray(py).into_any())
    }

    /// The ply model of a yarn.
    fn model_of(&self, family: &str, yarn: i32) -> Outcome<crate::model::Model> {
        let family = YarnSet::EACH.into_iter().find(|f| f.name() == family);
        let family = family.ok_or_else(|| Failure::Input("family must be \"warp\" or \"weft\"".into()))?;
        Ok(crate::model::Model::from_model(self.fabric.model_of(family, yarn).clone()))
    }

    /// Answers `what` of the queries.
    fn ask<'py>(&self, py: Python<'py>, what: &str, arrays: FabricArrays<'py>, mut out: Out<'py>) -> Outcome {
        by_channels!(arrays.channels, N => self.answer::<N>(py, what, &arrays, &mut out))
    }
}

/// A query as numbers: position, wo, wavelengths, absorptions of warp and weft, turn.
type Numbers<const N: usize> = ([f32; 2], [f32; 3], [f32; N], [Option<[f32; N]>; 2], [f32; 2]);

impl Fabric {
    fn from_loaded(loaded: LoadedFabric, options: &FabricOptions) -> Outcome<Fabric> {
        let notes = loaded.notes();
        Ok(Fabric { fabric: Arc::new(FabricModel::new(loaded, options)?), notes })
    }

    fn answer<const N: usize>(
        &self,
        py: Python<'_>,
        what: &str,
        arrays: &FabricArrays<'_>,
        out: &mut Out<'_>,
    ) -> Outcome {
        let FabricArrays { n, threads, .. } = *arrays;
        let position: Rows<'_, 2> = Rows::new(&arrays.position, n, "position_um")?;
        let wo: Rows<'_, 3> = Rows::new(&arrays.wo, n, "wo")?;
        let mut rgb = [0.0; N];
        plywave::color::RGB_LAMBDA_UM.iter().zip(&mut rgb).for_each(|(from, to)| *to = *from);
        let lambda: Rows<'_, N> = Rows::of_optional(arrays.lambda.as_ref(), n, "lambda_um", rgb)?;
        let channels = if arrays.lambda.is_some() { Channels::Wavelengths } else { Channels::LinearSrgb };
        let has = [arrays.warp.is_some(), arrays.weft.is_some()];
        let warp: Rows<'_, N> = Rows::of_optional(arrays.warp.as_ref(), n, "sigma_per_um", [0.0; N])?;
        let weft: Rows<'_, N> = Rows::of_optional(arrays.weft.as_ref(), n, "sigma_per_um", [0.0; N])?;
        let turn: Rows<'_, 1> = Rows::new(&arrays.turn, n, "turn_rad")?;
        let footprint: Rows<'_, 1> = Rows::new(&arrays.footprint, n, "footprint_um")?;
        let w: Option<Rows<'_, 3>> = arrays.w.as_ref().map(|w| Rows::new(w, n, "wi")).transpose()?;
        let fabric = &*self.fabric;
        let asked = PreparedQueries {
            n,
            threads,
            get: |i: usize| -> Numbers<N> {
                let sigma = [has[0].then(|| warp.get(i)), has[1].then(|| weft.get(i))];
                (position.get(i), wo.get(i), lambda.get(i), sigma, [turn.get(i)[0], footprint.get(i)[0]])
            },
            at: Same(|&(position_um, wo, lambda_um, sigma_per_um, [turn_rad, footprint_um]): &Numbers<N>| {
                let query = FabricQuery {
                    channels,
                    sigma_per_um,
                    turn_rad,
                    footprint_um,
                    ..FabricQuery::new(position_um, wo, lambda_um)
                };
                fabric.at(&query)
            }),
        };
        match What::from_name(what) {
            Some(what) => asked.answer(py, what, w, out, |(_, wo, ..)| wo.map(|v| -v)),
            None if what == "is_gap" => {
                let of = |at: &FabricBsdf<'_, N>| [f32::from(u8::from(at.is_gap()))];
                let [gap] = out.floats()?;
                let gap = rows_mut(gap, n)?;
                py.detach(|| asked.map(gap, |at, _| of(at)))?;
                Ok(())
            }
            None => Err(Failure::input("fabric", "question", what, "there is no such")),
        }
    }
}
