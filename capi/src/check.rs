//! Checks of models, as in `plywave check`: furnace, density and weights of the sampler, chi-square of its
//! samples, stored values.

use crate::bsdf::{PlywaveBsdf, Prepared, as_prepared, not_prepared, tag_of, with_prepared};
use crate::ply::PlywavePly;
use crate::pointer::{put, reference};
use crate::status::{Checked, PlywaveError, PlywaveStatus, guard, invalid};
use plywave::PlyBsdf;
use plywave::cloth::ClothBsdf;
use plywave_check::{
    BsdfReport, CheckOptions, FURNACE_TOLERANCE, KEPT_TOLERANCE, LAYER_TOLERANCE, PartReport, SAMPLED_TOLERANCE_SE,
    WEIGHT_TOLERANCE, check_bsdf, check_layers, check_model, check_whole,
};
use plywave_fiber::FiberBsdf;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Result of a check: the worst value over all incidences.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlywaveReport {
    /// Largest |integral of eval - albedo|.
    pub furnace_error: f64,
    /// Largest |integral of pdf - probability of scattering|, or |sum of the probabilities of all outcomes -
    /// 1|.
    pub pdf_error: f64,
    /// Largest |weight times pdf - eval| over the samples, relative to the largest eval.
    pub weight_error: f64,
    /// Largest |mean weight - albedo| in standard errors.
    pub sampled_furnace_se: f64,
    /// Smallest p-value of the samples against the pdf.
    pub chi2_p: f64,
    /// Smallest p-value that passes.
    pub chi2_threshold: f64,
    /// Largest |total energy - 1| at sigma = 0; 0 if it is not checked.
    pub kept_error: f64,
    /// Whether every number with a limit is within it; 0 or 1.
    pub passed: i32,
}

/// Result of the check of a ply model.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlywavePlyReport {
    /// Report on f_refl + f_high.
    pub lobes: PlywaveReport,
    /// Report on all terms, edge light included, where `has_whole`.
    pub whole: PlywaveReport,
    /// Report on a ply over a second layer, where `has_layers`.
    pub layers: PlywaveReport,
    /// Whether the model has edge lobes, so that `whole` is set; 0 or 1.
    pub has_whole: i32,
    /// Whether the model has layer factors, so that `layers` is set; 0 or 1.
    pub has_layers: i32,
    /// Largest difference between eval and the values stored in the file, relative to the largest of those
    /// values.
    pub reference_error: f64,
    /// Whether everything passed; 0 or 1.
    pub passed: i32,
}

/// Largest number of incidences and samples of a check.
const MAX: usize = 10_000_000;

fn within(name: &str, value: usize) -> Checked {
    if (1..=MAX).contains(&value) { Ok(()) } else { Err(invalid(name, value, "1 to 10000000")) }
}

fn report(r: &BsdfReport, chi2_threshold: f64, kept_error: f64) -> PlywaveReport {
    PlywaveReport {
        furnace_error: r.furnace_error,
        pdf_error: r.pdf_error,
        weight_error: r.weight_error,
        sampled_furnace_se: r.sampled_furnace_se,
        chi2_p: r.chi2_p,
        chi2_threshold,
        kept_error,
        passed: 0,
    }
}

/// Report on a part of a model with the limits of `plywave check`: the sampled energy has a limit only if the
/// furnace is exact.
fn part(found: Option<PartReport>, furnace: f64, is_sampled: bool) -> (PlywaveReport, bool) {
    let Some(p) = found else { return (PlywaveReport::default(), false) };
    let s = &p.scatter;
    let passed = s.furnace_error <= furnace
        && s.weight_error <= WEIGHT_TOLERANCE
        && (!is_sampled || s.sampled_furnace_se <= SAMPLED_TOLERANCE_SE)
        && s.chi2_p >= p.chi2_threshold
        && p.kept_error <= KEPT_TOLERANCE;
    (PlywaveReport { passed: passed.into(), ..report(s, p.chi2_threshold, p.kept_error) }, true)
}

/// Checks a model at `incidences` incidences (100 in `plywave check`), with `samples` samples each (20000
/// there) and random numbers of `seed` (1 there). The checks and numbers are those of `plywave check` that
/// need no table. It takes about 0.1 s per incidence.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_check(
    ply: *const PlywavePly,
    incidences: usize,
    samples: usize,
    seed: u64,
    found: *mut PlywavePlyReport,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let model = unsafe { &reference(ply, "ply")?.0 };
        within("incidences", incidences)?;
        within("samples", samples)?;
        let options = CheckOptions { incidences, samples, ..CheckOptions::default() };
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let r = check_model(model, &options, &mut || rng.random());
        let lobes = PlywaveReport {
            furnace_error: r.furnace_error(),
            pdf_error: r.pdf_error(),
            weight_error: r.weight_error(),
            sampled_furnace_se: r.sampled_furnace_se(),
            chi2_p: r.chi2_p(),
            chi2_threshold: r.chi2_threshold,
            kept_error: 0.0,
            passed: r.passed().into(),
        };
        let (whole, has_whole) = part(check_whole(model, &options, &mut || rng.random()), FURNACE_TOLERANCE, true);
        let (layers, has_layers) = part(check_layers(model, &options, &mut || rng.random()), LAYER_TOLERANCE, false);
        let passed = r.passed() && (!has_whole || whole.passed != 0) && (!has_layers || layers.passed != 0);
        let value = PlywavePlyReport {
            lobes,
            whole,
            layers,
            has_whole: has_whole.into(),
            has_layers: has_layers.into(),
            reference_error: r.reference_error.into(),
            passed: passed.into(),
        };
        // SAFETY: as above.
        unsafe { put(found, value, "found") }
    })
}

/// Checks a prepared query with `samples` samples and random numbers of `seed`. The steps of the integrals
/// resolve features of width `sd_rad` (0.001 to 1) along latitude and azimuth; 0.01 suits most models. The
/// check passes if weight times pdf equals eval within 1e-3 and the p-value is 1e-4 or more; for plies and
/// fibers, furnace and integral of the pdf must also be within 1e-3. For a single point of a cloth the
/// furnace is reported without a limit, because the point's shadows differ from their mean.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_check(
    bsdf: *const PlywaveBsdf,
    sd_rad: f64,
    samples: usize,
    seed: u64,
    found: *mut PlywaveReport,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        if !(1e-3..=1.0).contains(&sd_rad) {
            return Err(invalid("sd_rad", sd_rad, "0.001 to 1"));
        }
        within("samples", samples)?;
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let mut uniform = || rng.random();
        let (r, is_cloth) =
            with_prepared!(bsdf, at => Ok((check_bsdf(at, [sd_rad; 2], samples, &mut uniform), is_cloth(at))))?;
        let furnace = r.furnace_error <= FURNACE_TOLERANCE && r.pdf_error <= FURNACE_TOLERANCE;
        let passed =
            r.weight_error <= POINT_WEIGHT_TOLERANCE && r.chi2_p >= POINT_CHI2_THRESHOLD && (is_cloth || furnace);
        let value = PlywaveReport { passed: passed.into(), ..report(&r, POINT_CHI2_THRESHOLD, 0.0) };
        // SAFETY: the caller's pointer, as documented.
        unsafe { put(found, value, "found") }
    })
}

/// Limits for the check of a single query.
const POINT_WEIGHT_TOLERANCE: f64 = 1e-3;
const POINT_CHI2_THRESHOLD: f64 = 1e-4;

fn is_cloth<T: Prepared>(_: &T) -> bool {
    (T::TAG >> 8) as u8 == crate::bsdf::PlywaveKind::Cloth as u8
}
