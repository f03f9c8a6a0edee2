//! `plywave wave tabulate`: a fiber's spec or scene in, the table of its scattering out (Xia 2020).

use super::on_threads;
use super::simulate::{parts_of, remove_parts};
use crate::args::{Cli, Preset, WaveTabulateArgs};
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::progress::{self, Bar};
use crate::report::{self, number};
use plywave::fiber::{FiberSource, FiberTable};
use plywave_sim::wave::{SingleFiber, TabulateOptions, tabulate, tabulate_rays, tabulate_slices};
use plywave_sim::{Run, SimError};
use std::path::Path;
use std::time::Duration;

/// Runs the command.
pub fn run(cli: &Cli, args: &WaveTabulateArgs) -> Outcome {
    let options = options(args)?;
    let refuse = |error: SimError| match error {
        SimError::Interrupted { left, total } => Failure::Interrupted(format!(
            "stopped with {left} of {total} shards left; go on with: {}",
            progress::resume_command()
        )),
        SimError::Runtime(error) => error.into(),
        other => Failure::Input(format!("{}: {other}", args.spec.display())),
    };
    let (fiber, text) = SingleFiber::load(&args.spec, args.sigma).map_err(refuse)?;
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.spec, "pwf"));
    output::check_writable(&path, &[&args.spec])?;
    let source = if args.rays { FiberSource::Ray } else { FiberSource::Wave };
    let total = tabulate_slices(&fiber, &options, source).map_err(refuse)?;

    let parts = parts_of(&path);
    let fresh = !parts.exists();
    progress::install_stop();
    let bar = Bar::new("tabulate", "slices", cli.quiet);
    bar.begin("tabulate", total);
    let advance = |slices: u64| bar.advance(slices);
    let run = Run { parts: Some(&parts), resume: args.resume, stop: Some(&progress::STOP), progress: Some(&advance) };
    let work = progress::stoppable(|| {
        on_threads(cli, || match source {
            FiberSource::Wave => tabulate(&fiber, &text, &options, run),
            FiberSource::Ray => tabulate_rays(&fiber, &text, &options, run),
        })
    });
    let time = bar.finish();
    let table = work?.map_err(|error| {
        // A fiber that cannot be solved leaves nothing behind.
        if fresh && !matches!(error, SimError::Interrupted { .. } | SimError::Runtime(_)) {
            remove_parts(&parts);
        }
        refuse(error)
    })?;
    progress::stoppable(|| table.save(&path))?;
    remove_parts(&parts);
    tell(cli, &path, &table, total, time, args.resume && !fresh)
}

/// Sizes: the preset's, then the command line's.
fn options(args: &WaveTabulateArgs) -> Outcome<TabulateOptions> {
    let refuse = |key: &str, value: f64, mend: &str| Err(Failure::input("command line", key, value, mend));
    if !(args.sigma >= 0.0 && args.sigma <= 1e3) {
        return refuse("--sigma", args.sigma, "must be 0 to 1000, in 1/um");
    }
    // The range of the file, 0.001 to 2 radians.
    if !(args.beta_m >= 0.058 && args.beta_m <= 114.0) {
        return refuse("--beta-m", args.beta_m, "must be from 0.058 to 114 degrees");
    }
    let mut options = match args.preset {
        Preset::Preview => TabulateOptions::preview(),
        Preset::Standard => TabulateOptions::standard(),
        Preset::Reference => TabulateOptions::reference(),
    };
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
            true => "taken up from an earlier run".into(),
            false => format!("{} slices/s", report::count(slices as f64 / time.as_secs_f64().max(1e-9))),
        };
        writeln!(out, "  work         {}: {slices} slices, {rate}", report::duration(time))?;
        let [l, t, p, d] = sizes;
        writeln!(out, "  table        {l} lambda, {t} theta_i, {p} phi_i, {d} phi_r - phi_i")?;
        writeln!(out, "  ledger       scattered + absorbed = extinguished within {}", number(ledger))
    })
}
