//! Checks of analytic fibers: the checks of any scattering function at a few incidences, in the far and the
//! near field, and the distance of the albedo without absorption from 1.

use crate::{BsdfReport, FURNACE_TOLERANCE, SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE, check_bsdf};
use plywave::Bsdf;
use plywave::frame::direction;
use plywave_fiber::MIN_FAR_WIDTH;
use plywave_fiber::{FiberModel, FiberQuery};

/// Width of the panels that integrate caustics to [`CAUSTIC_TOLERANCE`] [rad].
const CAUSTIC: f64 = 0.0025;
/// Maximum furnace error with caustics.
const CAUSTIC_TOLERANCE: f64 = 5e-3;
/// Maximum furnace error of parametric models, whose albedos are integrals by the midpoint rule.
const PARAMETRIC_TOLERANCE: f64 = 2e-3;
/// Minimum p-value of a chi-square test: the probability of a false alarm is about 1 % at 12 incidences.
const MIN_P: f64 = 8e-4;
/// Latitudes of the incidences [degrees], and their offsets.
const DEGREES: [f32; 3] = [0.0, 35.0, -70.0];
const OFFSETS: [Option<f32>; 4] = [None, Some(0.0), Some(0.6), Some(-0.95)];
/// Number of latitudes of [`clear_albedo`] on each side of the equator, and the last latitude [degrees].
const LATITUDES: u32 = 60;
const LAST_DEGREES: f64 = 89.9;

/// Result of the checks of a fiber at one incidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiberReport {
    /// Latitude of the light [degrees].
    pub theta_i_deg: f32,
    /// Offset; `None` for the far field.
    pub h_rel: Option<f32>,
    /// Albedo at the query's wavelengths.
    pub albedo: [f32; 3],
    /// Results of the checks.
    pub scatter: BsdfReport,
    /// Limit of the errors of the furnace and of the density.
    pub furnace_allowed: f64,
}

impl FiberReport {
    /// Whether every check passes.
    pub fn passed(&self) -> bool {
        let r = &self.scatter;
        r.furnace_error <= self.furnace_allowed
            && r.pdf_error <= self.furnace_allowed
            && r.weight_error <= WEIGHT_TOLERANCE
            && r.sampled_furnace_se <= SAMPLED_TOLERANCE_SE
            && r.chi2_p >= MIN_P
    }
}

/// Minimum standard deviations over latitude and azimuth [rad], and the limit of the furnace error.
fn finest(model: &FiberModel, near: bool) -> ([f64; 2], f64) {
    let min_width = |widths: &[f32]| f64::from(widths.iter().copied().fold(0.3, f32::min));
    match model {
        FiberModel::Dielectric(fiber) => {
            let p = fiber.parameters();
            let caustics = !near && p.beta_n < MIN_FAR_WIDTH;
            let across = if caustics { CAUSTIC } else { min_width(&[p.beta_n]) };
            ([min_width(&p.beta_m), across], if caustics { CAUSTIC_TOLERANCE } else { FURNACE_TOLERANCE })
        }
        FiberModel::RoughDielectric(fiber) => {
            let p = fiber.parameters();
            let caustics = p.width_phi.contains(&0.0);
            let across = if caustics { CAUSTIC } else { min_width(&p.width_phi) };
            ([min_width(&p.width_theta), across], if caustics { CAUSTIC_TOLERANCE } else { PARAMETRIC_TOLERANCE })
        }
        FiberModel::Opaque(fiber) => {
            let p = fiber.parameters();
            ([min_width(&[p.beta_m]), if near { min_width(&[p.beta_n]) } else { 0.1 }], FURNACE_TOLERANCE)
        }
        FiberModel::KajiyaKay(fiber) => {
            ([min_width(&[0.7 / fiber.parameters().exponent.sqrt()]), 0.3], PARAMETRIC_TOLERANCE)
        }
        FiberModel::Khungurn(fiber) => {
            let p = fiber.parameters();
            ([min_width(&[p.beta_r, p.beta_tt]), min_width(&[p.gamma_tt])], FURNACE_TOLERANCE)
        }
        FiberModel::Tabulated(fiber) => {
            let table = fiber.table();
            let cell = std::f64::consts::TAU / table.phi_r_count() as f64;
            ([min_width(&[table.beta_m as f32]), cell.clamp(CAUSTIC, 0.3)], FURNACE_TOLERANCE)
        }
    }
}

/// Checks a fiber at three latitudes, in the far field and at three offsets, with `samples` samples each.
pub fn check_fiber(
    model: &FiberModel,
    lambda_um: [f32; 3],
    sigma_per_um: [f32; 3],
    samples: usize,
    uniform: &mut dyn FnMut() -> f32,
) -> Vec<FiberReport> {
    let mut reports = Vec::with_capacity(DEGREES.len() * OFFSETS.len());
    for theta_i_deg in DEGREES {
        for h_rel in OFFSETS {
            let omega_i = direction(theta_i_deg.to_radians(), 6.0 * uniform());
            let at = model.at(&FiberQuery { omega_i, h_rel, lambda_um, sigma_per_um });
            let (sd_rad, furnace_allowed) = finest(model, h_rel.is_some());
            let scatter = check_bsdf(&at, sd_rad, samples, uniform);
            reports.push(FiberReport { theta_i_deg, h_rel, albedo: at.albedo(), scatter, furnace_allowed });
        }
    }
    reports
}

/// An albedo and its latitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClearAlbedo {
    /// Latitude of the light [degrees].
    pub theta_i_deg: f64,
    /// The albedo.
    pub albedo: f64,
}

/// The albedo of the far field without absorption that is farthest from 1, over latitudes up to 89.9 degrees
/// and three wavelengths.
pub fn clear_albedo(model: &FiberModel, lambda_um: [f32; 3]) -> ClearAlbedo {
    let mut farthest = ClearAlbedo { theta_i_deg: 0.0, albedo: 1.0 };
    for k in 0..=2 * LATITUDES {
        // Spaced by the root of the distance from the pole, up to the neighborhood of the poles.
        let from_pole = 1.0 - (f64::from(k) / f64::from(LATITUDES) - 1.0).abs();
        let theta_i_deg = (LAST_DEGREES * (1.0 - from_pole * from_pole)).copysign(f64::from(k) - f64::from(LATITUDES));
        let at = model.at(&FiberQuery::new(direction(theta_i_deg.to_radians() as f32, 0.0), lambda_um));
        for albedo in at.albedo().map(f64::from) {
            if (albedo - 1.0).abs() > (farthest.albedo - 1.0).abs() {
                farthest = ClearAlbedo { theta_i_deg, albedo };
            }
        }
    }
    farthest
}
