//! `plywave wave speckle`: a spec in, patterns of many instances of its fiber out (Yu 2025, 6.2).

use super::compare::{refuse, within};
use super::simulate::{parts_of, remove_parts};
use super::speckle_view;
use super::{latitude, on_threads};
use crate::args::{Cli, WaveSpeckleArgs};
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::progress::{self, Bar};
use crate::report;
use plywave::YarnSpec;
use plywave_sim::Run;
use plywave_sim::wave::{SpeckleOptions, speckle};
use std::sync::atomic::{AtomicU64, Ordering};

/// Runs the command.
pub fn run(cli: &Cli, args: &WaveSpeckleArgs) -> Outcome {
    let (spec, text) = YarnSpec::load(&args.spec)?;
    let options = options(args)?;
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.spec, "pws"));
    output::check_writable(&path, &[&args.spec])?;
    let parts = parts_of(&path);
    let fresh = !parts.exists();
    progress::install_stop();
    let bar = Bar::new("speckle", "fibers", cli.quiet);
    bar.begin("speckle", u64::from(options.instances));
    let done = AtomicU64::new(0);
    let advance = |fibers: u64| {
        done.fetch_add(fibers, Ordering::Relaxed);
        bar.advance(fibers);
    };
    let run = Run { parts: Some(&parts), resume: args.resume, stop: Some(&progress::STOP), progress: Some(&advance) };
    let work = progress::stoppable(|| on_threads(cli, || speckle(&spec, &text, &options, run)));
    let time = bar.finish();
    let patterns = work?.map_err(|error| {
        // What cannot be solved leaves nothing behind; jobs that were done are kept.
        if fresh && done.load(Ordering::Relaxed) == 0 {
            remove_parts(&parts);
        }
        refuse(error, &args.spec)
    })?;
    progress::stoppable(|| patterns.save(&path))?;
    remove_parts(&parts);
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
