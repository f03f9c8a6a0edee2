//! What fabrics and cloths share: queries, colors, answers.

use crate::batch::{Floats, Out, PreparedQueries, Rows, Same, What, by_channels, rows_mut};
use crate::errors::{Failure, Outcome};
use numpy::IntoPyArray;
use plywave::FabricQuery;
use plywave::cloth::ClothSurface;
use plywave::color::AlbedoCurve;
use plywave::fabric::{Channels, ColorOf, FabricBsdf, FabricOptions, GapLight, Slits, YarnColor};
use pyo3::prelude::*;

/// The queries of a call, as flat arrays.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SurfaceArrays<'py> {
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

pub(crate) fn yarn_color(color: Option<Color>, name: &str) -> Outcome<YarnColor> {
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

pub(crate) fn color_of(name: &str) -> Outcome<ColorOf> {
    [ColorOf::EvenSky, ColorOf::Reflected, ColorOf::Folded].into_iter().find(|of| of.name() == name).ok_or_else(|| {
        Failure::input("colors", "color_of", format!("{name:?}"), "use \"even_sky\", \"reflected\" or \"folded\"")
    })
}

/// How a cloth is shaded.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SurfaceOptions {
    gaps: String,
    sigma_per_um: Option<f32>,
    noise: bool,
    layers: bool,
    shadowing: bool,
    edges: bool,
    slits: Option<(f32, f32)>,
    far: bool,
}

impl SurfaceOptions {
    pub(crate) fn options(&self) -> Outcome<FabricOptions> {
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
        Ok(FabricOptions {
            gaps,
            sigma_per_um: sigma_of_options(self.sigma_per_um)?,
            noise: self.noise,
            layers: self.layers,
            shadowing: self.shadowing,
            edges: self.edges,
            slits: self.slits.map(|(width_um, share)| Slits { width_um, share }),
            far: self.far,
        })
    }
}

/// An absorption [1/um] of the options for all yarns.
fn sigma_of_options(sigma: Option<f32>) -> Outcome<Option<f32>> {
    match sigma {
        Some(sigma) if !(0.0..=1e6).contains(&sigma) => {
            Err(Failure::input("options", "sigma_per_um", sigma, "must be 0 to 1e6, in 1/um"))
        }
        sigma => Ok(sigma),
    }
}

/// Absorptions [1/um] with which a cloth of this brightness has these reflectances.
pub(crate) fn sigma_of_reflectance<'py>(
    py: Python<'py>,
    curve: &AlbedoCurve,
    reflectance: &Floats<'py>,
) -> Outcome<Bound<'py, PyAny>> {
    let n = match reflectance {
        Floats::Single(array) => array.len()?,
        Floats::Double(array) => array.len()?,
    };
    let rows: Rows<'_, 1> = Rows::new(reflectance, n, "reflectance")?;
    let sigma = |i: usize| curve.sigma(f64::from(rows.get(i)[0])).0 as f32;
    let sigma: Vec<f32> = py.detach(|| (0..n).map(sigma).collect());
    Ok(sigma.into_pyarray(py).into_any())
}

/// Answers `what` of the queries.
pub(crate) fn ask<S: ClothSurface>(
    surface: &S,
    py: Python<'_>,
    what: &str,
    arrays: &SurfaceArrays<'_>,
    out: &mut Out<'_>,
) -> Outcome {
    by_channels!(arrays.channels, N => answer::<S, N>(surface, py, what, arrays, out))
}

/// A query as numbers: position, wo, wavelengths, absorptions of warp and weft, turn.
type Numbers<const N: usize> = ([f32; 2], [f32; 3], [f32; N], [Option<[f32; N]>; 2], [f32; 2]);

fn answer<S: ClothSurface, const N: usize>(
    surface: &S,
    py: Python<'_>,
    what: &str,
    arrays: &SurfaceArrays<'_>,
    out: &mut Out<'_>,
) -> Outcome {
    let SurfaceArrays { n, threads, .. } = *arrays;
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
            surface.surface_at(&query)
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
        None => Err(Failure::input("surface", "question", what, "there is no such")),
    }
}
