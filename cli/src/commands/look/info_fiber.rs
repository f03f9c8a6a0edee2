//! `plywave info` of a fiber table.

use crate::args::Cli;
use crate::failure::{Outcome, one_line};
use crate::output;
use crate::report::{self, number};
use plywave_fiber::{FiberSource, FiberTable, WIDTH_LIMIT};

/// Smallest, mean and largest of some numbers.
#[derive(serde::Serialize)]
struct Range {
    min: f64,
    mean: f64,
    max: f64,
}

impl Range {
    fn from_values(values: impl Iterator<Item = f64> + Clone) -> Self {
        let count = values.clone().count().max(1) as f64;
        Range {
            min: values.clone().fold(f64::INFINITY, f64::min),
            mean: values.clone().sum::<f64>() / count,
            max: values.fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

impl std::fmt::Display for Range {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} to {}, mean {}", number(self.min), number(self.max), number(self.mean))
    }
}

/// Prints the contents of a fiber table.
pub fn run(cli: &Cli, file: &str, bytes: u64, t: &FiberTable) -> Outcome {
    let p = t.phi_i.len();
    let slices = 0..t.c_x_um.len();
    let c_x = Range::from_values(t.c_x_um.iter().copied());
    let relative = Range::from_values(slices.clone().map(|s| t.c_x_um[s] / t.width_um[s % p]));
    let albedo = Range::from_values(slices.clone().map(|s| t.slice_albedo(s)));
    let ledger = t.ledger_error();
    let clamped = slices.clone().filter(|s| t.c_x_um[*s] > WIDTH_LIMIT * t.width_um[s % p]).count();
    let last = |v: &[f64]| v.last().copied().unwrap_or(0.0);
    let degrees = |v: &[f64]| v.iter().map(|v| v.to_degrees()).collect::<Vec<f64>>();
    if cli.json {
        return output::print_json(&serde_json::json!({
            "file": file, "kind": "fiber", "bytes": bytes,
            "program_version": t.program_version, "preset": t.preset, "seed": t.seed,
            "source": t.source, "symmetry": t.symmetry, "beta_m_deg": t.beta_m.to_degrees(),
            "lambda_um": t.lambda_um, "theta_i_deg": degrees(&t.theta_i), "phi_i_deg": degrees(&t.phi_i),
            "relative_azimuths": t.phi_r_count(),
            "width_um": t.width_um, "c_x_um": c_x, "c_x_over_width": relative, "clamped_slices": clamped,
            "albedo": albedo, "ledger_error_max": ledger, "spec": t.spec_text,
        }));
    }
    output::print(|out| {
        let optics = match t.source {
            FiberSource::Wave => "wave optics",
            FiberSource::Ray => "rays",
        };
        writeln!(out, "{file}: fiber by {optics}, {}", report::bytes(bytes))?;
        writeln!(
            out,
            "  written by   plywave {}, preset {}, seed {}",
            one_line(&t.program_version),
            one_line(&t.preset),
            t.seed
        )?;
        let symmetry = match (t.symmetry.folds, t.symmetry.mirror_rad) {
            (0, _) => "circle".to_string(),
            (1, None) => "none".to_string(),
            (n, None) => format!("{n}-fold"),
            (1, Some(_)) => "mirror".to_string(),
            (n, Some(_)) => format!("{n}-fold with mirrors"),
        };
        writeln!(out, "  symmetry     {symmetry}")?;
        writeln!(
            out,
            "  axes         {} lambda from {} to {} um, {} theta_i to {} degrees, {} phi_i from {} to {} degrees, {} phi_r - phi_i",
            t.lambda_um.len(),
            number(t.lambda_um.first().copied().unwrap_or(0.0)),
            number(last(&t.lambda_um)),
            t.theta_i.len(),
            number(last(&t.theta_i).to_degrees()),
            p,
            number(t.phi_i.first().copied().unwrap_or(0.0).to_degrees()),
            number(last(&t.phi_i).to_degrees()),
            t.phi_r_count()
        )?;
        writeln!(out, "  beta_m       {} degrees", number(t.beta_m.to_degrees()))?;
        writeln!(out, "  width        {} um", Range::from_values(t.width_um.iter().copied()))?;
        writeln!(out, "  C_x          {c_x} um; over the width {relative}")?;
        let share = 100.0 * clamped as f64 / t.c_x_um.len().max(1) as f64;
        writeln!(out, "  beyond {} widths: {} % of the slices", number(WIDTH_LIMIT), number(share))?;
        writeln!(out, "  albedo       {albedo}")?;
        writeln!(out, "  ledger       scattered + absorbed = extinguished within {ledger:.1e}")
    })
}
