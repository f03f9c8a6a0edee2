//! `plywave sample`: samples outgoing directions of a model at one incidence, as CSV or JSON. Light that
//! misses the fibers has no line; its count is printed at the end.

use crate::args::{Cli, SampleArgs};
use crate::commands::{Yarn, by_count, incidence};
use crate::failure::Outcome;
use crate::output;
use plywave::frame::theta_phi;
use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use rand::{RngExt, SeedableRng};
use std::io::Write;

/// Runs the command.
pub fn run(cli: &Cli, args: &SampleArgs) -> Outcome {
    let model = cli.library()?.load(&args.model)?;
    let yarn = Yarn::from_spec(&args.model, &model.data().spec_text, &model.data().h_um)?;
    let (theta_i, h_um) = incidence(&args.incidence, model.data(), yarn.radius_um)?;
    by_count!(args.incidence.sigma, draw(cli, args, &model, theta_i, h_um))
}

fn draw<const N: usize>(
    cli: &Cli,
    args: &SampleArgs,
    model: &PlyModel,
    theta_i: f32,
    h_um: f32,
    sigma: [f32; N],
) -> Outcome {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(args.seed);
    let mut missed = 0u64;
    output::print(|out| {
        if cli.json {
            let settings = serde_json::json!({
                "theta_i_deg": args.incidence.theta_i,
                "h_rel": args.incidence.h_rel,
                "h_um": h_um,
                "sigma_per_um": args.incidence.sigma,
                "seed": args.seed,
                "count": args.count,
            });
            // The samples precede the closing brace of the settings.
            let settings = settings.to_string();
            write!(out, "{},\"samples\":[", settings.strip_suffix('}').unwrap_or(&settings))?;
        } else {
            let weights: String = (0..N).map(|k| format!(",weight_{k}")).collect();
            writeln!(out, "theta_o_deg,phi_o_deg,pdf_per_sr{weights}")?;
        }
        let bsdf = model.at(&PlyQuery::lobes(theta_i, h_um, sigma));
        let mut first = true;
        for _ in 0..args.count {
            let u = [rng.random(), rng.random(), rng.random()];
            let BsdfSample::Scattered(sample) = bsdf.sample(u) else {
                missed += 1;
                continue;
            };
            let (theta, phi) = theta_phi(sample.w);
            let (theta, phi) = (theta.to_degrees(), phi.to_degrees());
            if cli.json {
                let comma = if first { "" } else { "," };
                let weights = serde_json::json!(sample.weight.to_vec());
                write!(
                    out,
                    "{comma}\n{{\"theta_o_deg\":{theta},\"phi_o_deg\":{phi},\"pdf_per_sr\":{},\"weight\":{weights}}}",
                    sample.pdf
                )?;
            } else {
                write!(out, "{theta:.4},{phi:.4},{:e}", sample.pdf)?;
                sample.weight.iter().try_for_each(|w| write!(out, ",{w:.6}"))?;
                writeln!(out)?;
            }
            first = false;
        }
        if cli.json {
            writeln!(out, "\n],\"missed\":{missed}}}")?;
        }
        Ok(())
    })?;
    if !cli.json && !cli.quiet {
        // A closed stderr is ignored, because the samples are complete.
        let _ = writeln!(std::io::stderr(), "{missed} of {} missed the fibers", args.count);
    }
    Ok(())
}
