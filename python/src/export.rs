//! Export of cloths to other programs.

use crate::errors::{Failure, Outcome};
use crate::watch::watched;
use crate::work::RunArgs;
use plywave::Document;
use plywave::cloth::ClothData;
use plywave_pipeline::exports::{BeyondVisible, ExportOptions, Format, View, export};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Options of an export.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ExportArgs {
    sigma_per_um: Option<f64>,
    sigma_uv_per_um: Option<f64>,
    sigma_ir_per_um: Option<f64>,
    samples: usize,
    seed: u32,
    views: Vec<(f64, f64, bool)>,
    squares: usize,
    spectral: bool,
    pixels: usize,
    mm_per_uv: f64,
    force: bool,
}

/// Written files, notes, and named numbers.
pub(crate) type Written = (Vec<PathBuf>, Vec<String>, Vec<(String, f64)>);

/// Exports the cloth in these bytes of a file; `name` identifies it in messages.
pub(crate) fn written(
    py: Python<'_>,
    bytes: &[u8],
    name: &str,
    paths: Vec<PathBuf>,
    format: &str,
    args: ExportArgs,
    run: RunArgs,
) -> Outcome<Written> {
    let Some(chosen) = Format::named(format) else {
        let names: Vec<String> = Format::ALL.iter().map(|f| format!("\"{}\"", f.name())).collect();
        return Err(Failure::input("export", "to", format!("{format:?}"), &format!("use {}", names.join(", "))));
    };
    let view = |&(tilt_rad, azimuth_rad, is_face): &(f64, f64, bool)| View { tilt_rad, azimuth_rad, is_face };
    let options = ExportOptions {
        sigma_per_um: args.sigma_per_um,
        beyond: BeyondVisible { uv_per_um: args.sigma_uv_per_um, ir_per_um: args.sigma_ir_per_um },
        samples: args.samples,
        seed: args.seed,
        views: args.views.iter().map(view).collect(),
        squares: args.squares,
        is_spectral: args.spectral,
        pixels: args.pixels,
        mm_per_uv: args.mm_per_uv,
    };
    if !args.force {
        chosen.check_outputs(&paths)?;
    }
    watched(py, run.threads, run.progress, |watch| {
        watch.run([None, None], |run| {
            let data = ClothData::from_bytes(bytes, name)?;
            let exported = export(&data, chosen, &paths, &options, run)?;
            let files = exported.save()?;
            let facts = exported.facts.into_iter().map(|(name, value)| (name.to_string(), value)).collect();
            Ok((files, exported.notes, facts))
        })
    })
}
