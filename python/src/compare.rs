//! Jobs that compare waves with rays, for external schedulers of their shards.

use crate::errors::{Failure, Outcome};
use crate::work::SpecArgs;
use plywave_wave::{CompareJob, CompareOptions};
use pyo3::prelude::*;

/// Sizes of a comparison; angles in radians.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct CompareArgs {
    instances: u32,
    seed: u64,
    lambda_um: Vec<f64>,
    h_rel: Vec<f64>,
    theta_i: f64,
    sigma_per_um: f64,
    tolerance: f64,
    paths: u64,
}

/// The job of a comparison; the ranges of its options are those of `plywave compare`.
pub(crate) fn compare_job(spec: &SpecArgs, args: CompareArgs) -> Outcome<CompareJob<'static>> {
    let (yarn, text) = spec.yarn()?;
    let within = |key: &str, values: &[f64], max: usize, (low, high): (f64, f64)| -> Outcome {
        if values.is_empty() || values.len() > max {
            return Err(Failure::input("options", key, values.len(), &format!("give 1 to {max} numbers")));
        }
        match values.iter().find(|v| !(low..=high).contains(*v)) {
            None => Ok(()),
            Some(value) => Err(Failure::input("options", key, value, &format!("must be from {low} to {high}"))),
        }
    };
    let count = |key: &str, value: u64, (low, high): (u64, u64)| -> Outcome {
        let hint = format!("must be {low} to {high}");
        if (low..=high).contains(&value) { Ok(()) } else { Err(Failure::input("options", key, value, &hint)) }
    };
    let reach = 1.0 + yarn.beam.beam().d_cut_um / yarn.ply_radii_um()[0];
    within("lambda_um", &args.lambda_um, 8, (0.1, 20.0))?;
    within("h_rel", &args.h_rel, 16, (-reach, reach))?;
    within("theta_i", &[args.theta_i], 1, (-80f64.to_radians(), 80f64.to_radians()))?;
    within("sigma_per_um", &[args.sigma_per_um], 1, (0.0, 100.0))?;
    within("tolerance", &[args.tolerance], 1, (1e-12, 0.01))?;
    count("instances", args.instances.into(), (1, 10_000))?;
    count("paths", args.paths, (100, 10_000_000_000))?;
    let options = CompareOptions {
        instances: args.instances,
        seed: args.seed,
        lambda_um: args.lambda_um,
        h_rel: args.h_rel,
        theta_i: args.theta_i,
        sigma_per_um: args.sigma_per_um,
        tolerance: args.tolerance,
        paths: args.paths,
    };
    CompareJob::new(&yarn, &text, &options).map_err(|e| Failure::of_run(e, &spec.name()))
}
