//! Batches of queries of cloths.

use crate::batch::{Floats, Out, PreparedQueries, Rows, Same, What, by_channels, rows_mut};
use crate::errors::{Failure, Outcome};
use plywave::cloth::{Channels, ClothBsdf};
use plywave::{ClothModel, ClothQuery};
use pyo3::prelude::*;

/// The queries of a call as flat arrays.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ClothArrays<'py> {
    n: usize,
    channels: usize,
    position: Floats<'py>,
    wo: Floats<'py>,
    /// Wavelengths; `None` selects linear sRGB.
    lambda: Option<Floats<'py>>,
    warp: Option<Floats<'py>>,
    weft: Option<Floats<'py>>,
    turn: Floats<'py>,
    footprint: Floats<'py>,
    w: Option<Floats<'py>>,
    threads: usize,
}

/// Computes the quantity `what` for the queries.
pub(crate) fn ask(
    cloth: &ClothModel,
    py: Python<'_>,
    what: &str,
    arrays: &ClothArrays<'_>,
    out: &mut Out<'_>,
) -> Outcome {
    by_channels!(arrays.channels, N => answer::<N>(cloth, py, what, arrays, out))
}

/// A query as numbers: position, wo, wavelengths, absorptions of warp and weft, rotation and footprint.
type Numbers<const N: usize> = ([f32; 2], [f32; 3], [f32; N], [Option<[f32; N]>; 2], [f32; 2]);

fn answer<const N: usize>(
    cloth: &ClothModel,
    py: Python<'_>,
    what: &str,
    arrays: &ClothArrays<'_>,
    out: &mut Out<'_>,
) -> Outcome {
    let ClothArrays { n, threads, .. } = *arrays;
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
    let prepared = PreparedQueries {
        n,
        threads,
        get: |i: usize| -> Numbers<N> {
            let sigma = [has[0].then(|| warp.get(i)), has[1].then(|| weft.get(i))];
            (position.get(i), wo.get(i), lambda.get(i), sigma, [turn.get(i)[0], footprint.get(i)[0]])
        },
        at: Same(|&(position_um, wo, lambda_um, sigma_per_um, [turn_rad, footprint_um]): &Numbers<N>| {
            let query = ClothQuery {
                channels,
                sigma_per_um,
                turn_rad,
                footprint_um,
                ..ClothQuery::new(position_um, wo, lambda_um)
            };
            cloth.at(&query)
        }),
    };
    match What::from_name(what) {
        Some(what) => prepared.answer(py, what, w, out, |(_, wo, ..)| wo.map(|v| -v)),
        None if what == "is_gap" => {
            let of = |at: &ClothBsdf<'_, N>| [f32::from(u8::from(at.is_gap()))];
            let [gap] = out.floats()?;
            let gap = rows_mut(gap, n)?;
            py.detach(|| prepared.map(gap, |at, _| of(at)))?;
            Ok(())
        }
        None => Err(Failure::input("cloth", "question", what, "there is no such")),
    }
}
