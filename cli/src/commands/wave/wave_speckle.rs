//! `plywave wave speckle`: a spec in, patterns of many instances of its fiber out (Yu 2025, 6.2).

use crate::args::{Cli, WaveSpeckleArgs};
use crate::commands::latitude;
use crate::commands::runs::{self, ProgressNames};
use crate::commands::wave::compare::within;
use crate::commands::wave::speckle_view;
use crate::failure::{Failure, Outcome};
use crate::{output, progress, report};
use plywave::Document;
use plywave_wave::{SpeckleJob, SpeckleOptions};

/// Runs the command.
pub fn run(cli: &Cli, args: &WaveSpeckleArgs) -> Outcome {
    let (spec, text) = plywave_textile::load_yarn_file(&args.spec)?;
    let options = options(args)?;
    let path = args.output.clone().unwrap_or_else(|| args.shards.default_output(&args.spec, "pws"));
    output::check_writable(&path, &[&args.spec])?;
    let job = SpeckleJob::new(&spec, &text, &options).map_err(|e| runs::failure(e, &args.spec))?;
    let names = ProgressNames { what: "speckle", unit: "fibers" };
    if runs::run_share(cli, &job, names, &args.shards, (&path, &args.resume), &args.spec)? {
        return Ok(());
    }
    let parts = runs::open_parts(&path, &args.resume)?;
    let (patterns, time) = runs::run_job(cli, &job, names, Some(&parts), &args.spec)?;
    progress::stoppable(|| patterns.save(&path))?;
    parts.remove();
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    let kinds = speckle_view::kinds(&patterns);
    if cli.json {
        return output::print_json(&serde_json::json!({
            "patterns": path.display().to_string(), "bytes": bytes, "instances": patterns.instances,
            "azimuths": patterns.azimuths, "seconds": time.as_secs_f64(), "statistics": kinds,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        writeln!(
            out,
            "  work         {}: {}",
            report::duration(time),
            report::counted(patterns.instances as u64, "fiber", "fibers")
        )?;
        speckle_view::write_kinds(out, &kinds)
    })
}

/// The sizes of the run, within their ranges.
fn options(args: &WaveSpeckleArgs) -> Outcome<SpeckleOptions> {
    within("--lambda", &args.lambda, (0.1, 20.0), " um")?;
    if let Some(pair) = args.lambda.windows(2).find(|w| w[1] <= w[0]) {
        return Err(Failure::input("command line", "--lambda", pair[1], "must be larger than the one before it"));
    }
    within("--kappa", &args.kappa, (0.0, 10.0), "")?;
    latitude("--theta-i", args.theta_i)?;
    within("--theta-i", &[args.theta_i], (-80.0, 80.0), " degrees")?;
    within("--w0", &[args.w0], (0.1, 1e4), " um")?;
    within("--tolerance", &[args.tolerance], (1e-12, 0.01), "")?;
    Ok(SpeckleOptions {
        instances: args.instances,
        seed: args.seed,
        lambda_um: args.lambda.clone(),
        kappa: args.kappa.clone(),
        theta_i: args.theta_i.to_radians(),
        w0_um: args.w0,
        tolerance: args.tolerance,
    })
}
