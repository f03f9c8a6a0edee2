//! The checks of `plywave check` for a ply model.

use crate::errors::Outcome;
use crate::model::Model;
use plywave_check::{
    CheckOptions, FURNACE_TOLERANCE, PartReport, REFERENCE_TOLERANCE, SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE,
    check_layers, check_model, check_whole,
};
use plywave_pipeline::FitQuality;
use pyo3::prelude::*;
use rand::{RngExt, SeedableRng};

/// Tolerances of `plywave check`: for the energy of a ply over a second layer, and for the total energy at
/// sigma = 0.
const LAYER_TOLERANCE: f64 = 0.02;
const KEPT_TOLERANCE: f64 = 5e-3;

/// One check: its name, the measured value, the allowed value, whether it passed.
type Line = (&'static str, f64, f64, bool);

fn at_most(check: &'static str, value: f64, allowed: f64) -> Line {
    (check, value, allowed, value <= allowed)
}

fn at_least(check: &'static str, value: f64, allowed: f64) -> Line {
    (check, value, allowed, value >= allowed)
}

fn part(names: [&'static str; 5], part: &PartReport, furnace: f64) -> Vec<Line> {
    let s = &part.scatter;
    let mut lines = vec![
        at_most(names[0], s.furnace_error, furnace),
        at_most(names[1], s.weight_error, WEIGHT_TOLERANCE),
        at_most(names[2], s.sampled_furnace_se, SAMPLED_TOLERANCE_SE),
        at_least(names[3], s.chi2_p, part.chi2_threshold),
        at_most(names[4], part.kept_error, KEPT_TOLERANCE),
    ];
    lines.retain(|line| !line.0.is_empty());
    lines
}

/// Checks a model and returns the lines of the report.
#[pyfunction]
pub(crate) fn check(py: Python<'_>, model: &Model, seed: u64, incidences: usize) -> Outcome<Vec<Line>> {
    let model = model.model.clone();
    Ok(py.detach(|| {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let options = CheckOptions { incidences, ..CheckOptions::default() };
        let report = check_model(&model, &options, &mut || rng.random());
        let mut lines = vec![
            at_most("furnace", report.furnace_error(), FURNACE_TOLERANCE),
            at_most("pdf_integral", report.pdf_error(), FURNACE_TOLERANCE),
            at_most("weight_times_pdf", report.weight_error(), WEIGHT_TOLERANCE),
            at_most("sampled_furnace", report.sampled_furnace_se(), SAMPLED_TOLERANCE_SE),
            at_least("chi_square", report.chi2_p(), report.chi2_threshold),
            at_most("stored_values", report.reference_error.into(), REFERENCE_TOLERANCE.into()),
        ];
        if let Some(whole) = check_whole(&model, &options, &mut || rng.random()) {
            let names = ["whole_furnace", "whole_weight", "whole_sampled", "whole_chi_square", "whole_kept"];
            lines.extend(part(names, &whole, FURNACE_TOLERANCE));
        }
        if let Some(layers) = check_layers(&model, &options, &mut || rng.random()) {
            let names = ["layers_furnace", "layers_weight", "", "layers_chi_square", "layers_kept"];
            lines.extend(part(names, &layers, LAYER_TOLERANCE));
        }
        let (quality, good) = (FitQuality::from_data(model.data()), FitQuality::good());
        lines.push(at_most("fit_error_refl", quality.refl, good.refl));
        lines.push(at_most("fit_error_high", quality.high, good.high));
        lines
    }))
}
