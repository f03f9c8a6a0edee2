//! `plywave eval`: a model at one incidence and one outgoing direction.

use crate::args::{Cli, EvalArgs};
use crate::commands::{Yarn, by_count, incidence, latitude};
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::report::number;
use plywave::frame::direction;
use plywave::{Bsdf, PlyModel, PlyQuery};

#[derive(serde::Serialize)]
struct Report {
    theta_i_deg: f64,
    h_rel: f64,
    h_um: f64,
    theta_o_deg: f64,
    phi_o_deg: f64,
    sigma_per_um: Vec<f64>,
    f_per_sr: Vec<f32>,
    refl_per_sr: f32,
    high_per_sr: Vec<f32>,
    pdf_per_sr: f32,
    albedo: Vec<f32>,
    r_d: f32,
}

/// Runs the command.
pub fn run(cli: &Cli, args: &EvalArgs) -> Outcome {
    let model = cli.library()?.load(&args.model)?;
    let yarn = Yarn::from_spec(&args.model, &model.data().spec_text, &model.data().h_um)?;
    let (theta_i, h_um) = incidence(&args.incidence, model.data(), yarn.radius_um)?;
    latitude("--theta-o", args.theta_o)?;
    if !args.phi_o.is_finite() {
        return Err(Failure::input("command line", "--phi-o", args.phi_o, "must be a number of degrees"));
    }
    let report = by_count!(args.incidence.sigma, evaluate(&model, args, theta_i, h_um))?;
    if cli.json {
        return output::print_json(&report);
    }
    output::print(|out| {
        writeln!(
            out,
            "albedo and densities [1/sr] at r_d = {}, pdf = {}",
            number(report.r_d as f64),
            number(report.pdf_per_sr as f64)
        )?;
        writeln!(out, "{:>14} {:>12} {:>12} {:>12} {:>12}", "sigma [1/um]", "f", "f_refl", "f_high", "albedo")?;
        for (k, sigma) in report.sigma_per_um.iter().enumerate() {
            let (f, refl, high) = (report.f_per_sr[k], report.refl_per_sr, report.high_per_sr[k]);
            writeln!(out, "{:>14} {f:>12.6} {refl:>12.6} {high:>12.6} {:>12.6}", number(*sigma), report.albedo[k])?;
        }
        Ok(())
    })
}

fn evaluate<const N: usize>(
    model: &PlyModel,
    args: &EvalArgs,
    theta_i: f32,
    h_um: f32,
    sigma: [f32; N],
) -> Outcome<Report> {
    let wo = direction(args.theta_o.to_radians() as f32, args.phi_o.rem_euclid(360.0).to_radians() as f32);
    let bsdf = model.at(&PlyQuery::lobes(theta_i, h_um, sigma));
    let terms = bsdf.terms(wo);
    Ok(Report {
        theta_i_deg: args.incidence.theta_i,
        h_rel: args.incidence.h_rel,
        h_um: h_um as f64,
        theta_o_deg: args.theta_o,
        phi_o_deg: args.phi_o,
        sigma_per_um: args.incidence.sigma.clone(),
        f_per_sr: terms.sum().to_vec(),
        refl_per_sr: terms.refl,
        high_per_sr: terms.high.to_vec(),
        pdf_per_sr: terms.pdf,
        albedo: bsdf.albedo().to_vec(),
        r_d: bsdf.r_d(),
    })
}
