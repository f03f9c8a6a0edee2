//! Checks of a model beyond f_refl and f_high: the whole ply with its edge light, and a ply over a second
//! layer.

use crate::nodes::Feature;
use crate::{BsdfReport, CheckOptions, check_lobes, lobe_features};
use plywave::ply::Layer;
use plywave::{Bsdf, PlyModel, PlyQuery};

/// Result of the checks of one use of a model: the worst of its incidences.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartReport {
    /// Results of the checks of any scattering function.
    pub scatter: BsdfReport,
    /// Maximum of |energy - 1| at sigma = 0, over all terms together: the Monte Carlo error of the table.
    pub kept_error: f64,
    /// Minimum p-value that passes, from [`CheckOptions::chi2_threshold`].
    pub chi2_threshold: f64,
}

/// Limit of the furnace error of a ply over a second layer, whose forward light is bilinear between nodes
/// while its lobes are not.
pub const LAYER_TOLERANCE: f64 = 0.02;
/// Limit of |total energy - 1| at sigma = 0: the Monte Carlo error of a preview table.
pub const KEPT_TOLERANCE: f64 = 5e-3;

/// Wavelengths of the checks [um].
const LAMBDA_UM: [f32; 4] = [0.4, 0.5, 0.6, 0.7];

/// The worse of each of two results.
fn worst(a: BsdfReport, b: BsdfReport) -> BsdfReport {
    // NaN is worse than any number.
    let worse = |a: f64, b: f64| if b.is_nan() { f64::INFINITY } else { a.max(b) };
    BsdfReport {
        furnace_error: worse(a.furnace_error, b.furnace_error),
        pdf_error: worse(a.pdf_error, b.pdf_error),
        weight_error: worse(a.weight_error, b.weight_error),
        sampled_furnace_se: worse(a.sampled_furnace_se, b.sampled_furnace_se),
        chi2_p: if b.chi2_p.is_nan() { 0.0 } else { a.chi2_p.min(b.chi2_p) },
    }
}

/// Number of incidences of each of these checks.
pub const PART_INCIDENCES: usize = 8;

/// Incidences of the checks: the center, the rim and beyond it, with both signs, in proportion to the last
/// nodes.
fn incidences(model: &PlyModel, uniform: &mut dyn FnMut() -> f32) -> Vec<(f32, f32)> {
    let d = model.data();
    let last = d.h_um[d.h_um.len() - 1] as f32;
    let mut all = vec![(0.0, 0.0), (0.3, 0.7 * last), (-0.5, -0.8 * last), (0.9, 0.95 * last)];
    all.extend((all.len()..PART_INCIDENCES).map(|_| (1.8 * (uniform() - 0.5), 2.0 * last * (uniform() - 0.5))));
    all
}

/// Runs the checks of a scattering function at each incidence; `None` if `below` returns `None`.
fn run(
    model: &PlyModel,
    options: &CheckOptions,
    uniform: &mut dyn FnMut() -> f32,
    below: &dyn Fn([f32; 4]) -> Option<Option<Layer<4>>>,
) -> Option<PartReport> {
    let places = incidences(model, uniform);
    let chi2_threshold = options.chi2_threshold(model);
    let mut report: Option<PartReport> = None;
    for (theta_i, h_um) in places {
        let last = model.data().sigma_per_um.last().map_or(0.0, |s| *s as f32);
        let sigma_per_um = [0.0, 0.02 * last, 0.2 * last, last];
        let query = PlyQuery::new(theta_i, h_um, sigma_per_um, LAMBDA_UM);
        let scatter = model.at(&PlyQuery { below: below(sigma_per_um)?, ..query });
        let edges = model.data().edge.iter().flat_map(|edge| {
            LAMBDA_UM.map(|lambda| Feature::round(&edge.lobe(theta_i.into(), h_um.into(), lambda.into())))
        });
        let lobes: Vec<Feature> = lobe_features(model, theta_i, h_um).into_iter().chain(edges).collect();
        let scatter_report = check_lobes(&scatter, &lobes, options.samples, uniform);
        let energy_error = (f64::from(scatter.albedo()[0]) - 1.0).abs();
        report = Some(match report {
            None => PartReport { scatter: scatter_report, kept_error: energy_error, chi2_threshold },
            Some(r) => PartReport {
                scatter: worst(r.scatter, scatter_report),
                kept_error: r.kept_error.max(energy_error),
                ..r
            },
        });
    }
    report
}

/// Checks f_refl + f_high + f_edge at a few incidences; `None` for a model without edge lobes.
pub fn check_whole(model: &PlyModel, options: &CheckOptions, uniform: &mut dyn FnMut() -> f32) -> Option<PartReport> {
    model.data().edge.as_ref()?;
    run(model, options, uniform, &|_| Some(None))
}

/// Checks a ply over a second layer of its own kind; `None` for a model without layer factors.
pub fn check_layers(model: &PlyModel, options: &CheckOptions, uniform: &mut dyn FnMut() -> f32) -> Option<PartReport> {
    run(model, options, uniform, &|sigma_per_um| Some(Some(model.layer(0.5, sigma_per_um)?)))
}
