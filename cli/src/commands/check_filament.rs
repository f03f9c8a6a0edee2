//! `plywave check` of an analytic fiber's spec: the checks of every model at a few incidences, far and near field.

use crate::args::{CheckArgs, Cli};
use crate::failure::{Failure, Outcome};
use crate::output;
use plywave::check::{FURNACE_TOLERANCE, SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE, check_bsdf};
use plywave::fiber::{FilamentSpec, LEAST_FAR_WIDTH};
use plywave::frame::direction;
use plywave::{Bsdf, FiberModel, FiberQuery};
use rand::{RngExt, SeedableRng};

/// Samples at an incidence.
const SAMPLES: usize = 20_000;
/// Caustics are integrated by panels of this width [rad], which knows them to [`CAUSTIC_TOLERANCE`].
const CAUSTIC: f64 = 0.0025;
/// Most that a furnace with caustics may miss.
const CAUSTIC_TOLERANCE: f64 = 5e-3;
/// Parametric models do not conserve energy: their albedo is an integral by midpoints.
const PARAMETRIC_TOLERANCE: f64 = 2e-3;
/// Least p-value of a chi-square test: some 1 % chance of a false alarm at 12 incidences.
const LEAST_P: f64 = 8e-4;

#[derive(serde::Serialize)]
struct Line {
    theta_i_deg: f32,
    h_rel: Option<f32>,
    albedo: [f32; 3],
    furnace_error: f64,
    furnace_allowed: f64,
    weight_error: f64,
    sampled_furnace_se: f64,
    chi2_p: f64,
    passed: bool,
}

/// Finest standard deviations over latitude and azimuth [rad], and what a furnace may miss.
fn finest(model: &FiberModel, near: bool) -> ([f64; 2], f64) {
    let least = |widths: &[f32]| f64::from(widths.iter().copied().fold(0.3, f32::min));
    match model {
        FiberModel::Dielectric(fiber) => {
            let p = fiber.parameters();
            let caustics = !near && p.beta_n < LEAST_FAR_WIDTH;
            let across = if caustics { CAUSTIC } else { least(&[p.beta_n]) };
            ([least(&p.beta_m), across], if caustics { CAUSTIC_TOLERANCE } else { FURNACE_TOLERANCE })
        }
        FiberModel::RoughDielectric(fiber) => {
            let p = fiber.parameters();
            let caustics = p.width_phi.contains(&0.0);
            let across = if caustics { CAUSTIC } else { least(&p.width_phi) };
            ([least(&p.width_theta), across], if caustics { CAUSTIC_TOLERANCE } else { PARAMETRIC_TOLERANCE })
        }
        FiberModel::Opaque(fiber) => {
            let p = fiber.parameters();
            ([least(&[p.beta_m]), if near { least(&[p.beta_n]) } else { 0.1 }], FURNACE_TOLERANCE)
        }
        FiberModel::KajiyaKay(fiber) => {
            ([least(&[0.7 / fiber.parameters().exponent.sqrt()]), 0.3], PARAMETRIC_TOLERANCE)
        }
        _ => ([0.05; 2], FURNACE_TOLERANCE),
    }
}

/// Runs the command.
pub fn run(cli: &Cli, args: &CheckArgs) -> Outcome {
    for (flag, path) in [("--table", &args.table), ("--twin", &args.twin)] {
        if let Some(path) = path {
            let hint = "an analytic fiber has none: leave it out";
            return Err(Failure::input("command line", flag, path.display(), hint));
        }
    }
    let spec = FilamentSpec::load(&args.model)?;
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(args.seed);
    let mut lines = Vec::new();
    for theta_i_deg in [0.0, 35.0, -70.0f32] {
        for h_rel in [None, Some(0.0), Some(0.6), Some(-0.95)] {
            let omega_i = direction(theta_i_deg.to_radians(), 6.0 * rng.random::<f32>());
            let query = FiberQuery { omega_i, h_rel, lambda_um: spec.lambda_um, sigma_per_um: spec.sigma_per_um };
            let at = spec.model.at(&query);
            let (sd_rad, furnace_allowed) = finest(&spec.model, h_rel.is_some());
            let r = check_bsdf(&at, sd_rad, SAMPLES, &mut || rng.random());
            let passed = r.furnace_error <= furnace_allowed
                && r.pdf_error <= furnace_allowed
                && r.weight_error <= WEIGHT_TOLERANCE
                && r.sampled_furnace_se <= SAMPLED_TOLERANCE_SE
                && r.chi2_p >= LEAST_P;
            lines.push(Line {
                theta_i_deg,
                h_rel,
                albedo: at.albedo(),
                furnace_error: r.furnace_error,
                furnace_allowed,
                weight_error: r.weight_error,
                sampled_furnace_se: r.sampled_furnace_se,
                chi2_p: r.chi2_p,
                passed,
            });
        }
    }
    let passed = lines.iter().all(|line| line.passed);
    if cli.json {
        output::print_json(&lines)?;
    } else {
        output::print(|out| {
            writeln!(out, "{}: {}, an analytic fiber", args.model.display(), spec.name)?;
            writeln!(
                out,
                "{:>8} {:>6} {:>24} {:>10} {:>10} {:>9} {:>9}",
                "theta_i", "h", "albedo", "furnace", "weight", "sampled", "chi2 p"
            )?;
            for line in &lines {
                let h = line.h_rel.map_or("all".to_string(), |h| format!("{h:.2}"));
                let [a, b, c] = line.albedo;
                writeln!(
                    out,
                    "{:>8.1} {h:>6} {a:>8.4}{b:>8.4}{c:>8.4} {:>10.1e} {:>10.1e} {:>6.2} se {:>9.4}{}",
                    line.theta_i_deg,
                    line.furnace_error,
                    line.weight_error,
                    line.sampled_furnace_se,
                    line.chi2_p,
                    if line.passed { "" } else { "  FAILED" }
                )?;
            }
            writeln!(out, "{}", if passed { "passed" } else { "FAILED" })
        })?;
    }
    if passed { Ok(()) } else { Err(Failure::NotHeld) }
}
