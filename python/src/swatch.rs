//! Fits of cloths to photographs of swatches.

use crate::errors::Outcome;
use crate::watch::watched;
use crate::work::RunArgs;
use plywave_pipeline::swatch::{Photo, SwatchGeometry, SwatchInputs, SwatchWords, fit_swatch};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// What the user says of a swatch.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SwatchArgs {
    geometry: Option<PathBuf>,
    fiber: Option<String>,
    weave: Option<String>,
    g_per_m2: Option<f64>,
    ends_per_cm: Option<f64>,
    picks_per_cm: Option<f64>,
    count: Option<String>,
}

/// Fits a cloth to two photographs: the report as JSON, the cloth spec, and the bytes of a PNG of the fit.
#[pyfunction]
pub(crate) fn swatch<'py>(
    py: Python<'py>,
    front: PathBuf,
    back: PathBuf,
    args: SwatchArgs,
    run: RunArgs,
) -> Outcome<(String, String, Bound<'py, PyBytes>)> {
    let words = SwatchWords {
        fiber: args.fiber.as_deref(),
        weave: args.weave.as_deref(),
        g_per_m2: args.g_per_m2,
        ends_per_cm: args.ends_per_cm,
        picks_per_cm: args.picks_per_cm,
        count: args.count.as_deref(),
    };
    let known = words.known("swatch", &|key| key.into())?;
    let geometry = match &args.geometry {
        None => SwatchGeometry::default(),
        Some(path) => SwatchGeometry::load(path)?,
    };
    let fit = watched(py, run.threads, run.progress, |watch| {
        watch.run([None, None], |run| {
            let inputs = SwatchInputs { photos: [Photo::load(&front)?, Photo::load(&back)?], geometry, known };
            Ok(fit_swatch(&inputs, run)?)
        })
    })?;
    let report = serde_json::to_string(&fit).unwrap_or_default();
    Ok((report, fit.spec, PyBytes::new(py, &fit.picture)))
}
