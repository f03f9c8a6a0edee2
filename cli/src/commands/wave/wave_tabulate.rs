//! `plywave wave tabulate`: a fiber's spec or scene in, the table of its scattering out (Xia 2020).

use crate::args::{Cli, WaveTabulateArgs};
use crate::commands::runs::{self, ProgressNames};
use crate::failure::{Failure, Outcome};
use crate::report::{self, number};
use crate::{output, progress};
use plywave::Document;
use plywave_fiber::{FiberSource, FiberTable};
use plywave_runs::Plan;
use plywave_wave::{SingleFiber, TabulateJob, TabulateOptions};
use std::path::Path;
use std::time::Duration;

/// Runs the command.
pub fn run(cli: &Cli, args: &WaveTabulateArgs) -> Outcome {
    let options = options(args)?;
    let refuse = |error| runs::failure(error, &args.spec);
    let (fiber, text) = SingleFiber::load(&args.spec, args.sigma).map_err(refuse)?;
    let path = args.output.clone().unwrap_or_else(|| args.shards.default_output(&args.spec, "pwf"));
    output::check_writable(&path, &[&args.spec])?;
    let source = if args.rays { FiberSource::Ray } else { FiberSource::Wave };
    let job = TabulateJob::new(&fiber, &text, &options, source).map_err(refuse)?;
    let names = ProgressNames { what: "tabulate", unit: "slices" };
    if runs::run_share(cli, &job, names, &args.shards, (&path, &args.resume), &args.spec)? {
        return Ok(());
    }
    let resumed = args.resume.resume && runs::parts_of(&path).exists();
    let parts = runs::open_parts(&path, &args.resume)?;
    let (table, time) = runs::run_job(cli, &job, names, Some(&parts), &args.spec)?;
    progress::stoppable(|| table.save(&path))?;
    parts.remove();
    tell(cli, &path, &table, Plan::from_job(&job).units, time, resumed)
}

/// Sizes: the preset's, then the command line's.
fn options(args: &WaveTabulateArgs) -> Outcome<TabulateOptions> {
    let refuse = |key: &str, value: f64, hint: &str| Err(Failure::input("command line", key, value, hint));
    if !(args.sigma >= 0.0 && args.sigma <= 1e3) {
        return refuse("--sigma", args.sigma, "must be 0 to 1000, in 1/um");
    }
    // The range of the file, 0.001 to 2 radians.
    if !(args.beta_m >= 0.058 && args.beta_m <= 114.0) {
        return refuse("--beta-m", args.beta_m, "must be from 0.058 to 114 degrees");
    }
    let mut options = args.preset.quality().tabulate();
    let set = |to: &mut usize, from: Option<u32>| *to = from.map_or(*to, |n| n as usize);
    set(&mut options.lambdas, args.lambdas);
    set(&mut options.thetas, args.thetas);
    set(&mut options.azimuths, args.azimuths);
    options.relative = options.relative.max(options.azimuths);
    options.rays = args.ray_count.unwrap_or(options.rays);
    options.seed = args.seed;
    options.beta_m = args.beta_m.to_radians();
    Ok(options)
}

/// Says how the run went.
fn tell(cli: &Cli, path: &Path, table: &FiberTable, slices: u64, time: Duration, resumed: bool) -> Outcome {
    let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    let ledger = table.ledger_error();
    let sizes = [table.lambda_um.len(), table.theta_i.len(), table.phi_i.len(), table.phi_r_count()];
    if cli.json {
        return output::print_json(&serde_json::json!({
            "fiber": path.display().to_string(),
            "bytes": bytes,
            "source": table.source,
            "preset": table.preset,
            "lambdas": sizes[0], "thetas": sizes[1], "azimuths": sizes[2], "relative_azimuths": sizes[3],
            "slices": slices,
            "seconds": time.as_secs_f64(),
            "resumed": resumed,
            "ledger_error_max": ledger,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        let rate = match resumed {
            true => "resumed from an earlier run".into(),
            false => format!("{} slices/s", report::count(slices as f64 / time.as_secs_f64().max(1e-9))),
        };
        writeln!(out, "  work         {}: {slices} slices, {rate}", report::duration(time))?;
        let [l, t, p, d] = sizes;
        writeln!(out, "  table        {l} lambda, {t} theta_i, {p} phi_i, {d} phi_r - phi_i")?;
        writeln!(out, "  ledger       scattered + absorbed = extinguished within {}", number(ledger))
    })
}
