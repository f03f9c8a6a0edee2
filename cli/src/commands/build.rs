//! `plywave build`: simulate and fit in one go.

use super::compare::refuse;
use super::simulate::{Job, merge, parts_of, remove_parts};
use super::{fit, on_threads, simulate};
use crate::args::{BuildArgs, Cli};
use crate::failure::{Failure, Outcome};
use crate::progress::{self, Bar};
use crate::{output, report};
use plywave::SpecklePatterns;
use plywave_fit::speckle::NoiseOptions;
use plywave_sim::Run;
use plywave_sim::wave::{SpeckleOptions, speckle};
use std::path::Path;

/// Patterns of 200 fibers of the spec by waves, for the tiles.
fn solve_speckle(cli: &Cli, job: &Job, parts: &Path, resume: bool) -> Outcome<SpecklePatterns> {
    let options = SpeckleOptions { seed: job.options.seed, ..SpeckleOptions::default() };
    progress::install_stop();
    let bar = Bar::new("speckle", "fibers", cli.quiet);
    bar.begin("speckle", u64::from(options.instances));
    let advance = |fibers: u64| bar.advance(fibers);
    let run = Run { parts: Some(parts), resume, stop: Some(&progress::STOP), progress: Some(&advance) };
    let work = progress::stoppable(|| on_threads(cli, || speckle(&job.spec, &job.text, &options, run)));
    bar.finish();
    work?.map_err(|error| refuse(error, &job.file))
}

/// Runs the command. The shards stay until the model is written, so that a run stopped while fitting can go on too.
pub fn run(cli: &Cli, args: &BuildArgs) -> Outcome {
    let job = Job::new(args.spec.as_deref(), &args.run)?;
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&job.file, "pwm"));
    output::check_writable(&path, &[&job.file])?;
    let table_path = args.keep_table.then(|| path.with_extension("pwt"));
    if let Some(table_path) = &table_path {
        if *table_path == path {
            let mend = "is where --keep-table puts the table; name the model NAME.pwm";
            return Err(Failure::input("command line", "-o", path.display(), mend));
        }
        output::check_writable(table_path, &[&job.file])?;
    }
    let parts = parts_of(&path);
    let (table, simulated) = job.simulate(cli, &parts, args.run.resume)?;
    if let Some(table_path) = &table_path {
        table.save(table_path)?;
    }
    let (mut data, fit_time) = fit::fit_table(cli, &job.file, &table, args.run.preset)?;
    let speckle_parts = parts_of(&path.with_extension("pws"));
    let patterns = match &args.speckle {
        Some(file) => Some(SpecklePatterns::load(file)?),
        None if args.smooth || data.preset == "preview" => None,
        None => Some(solve_speckle(cli, &job, &speckle_parts, args.run.resume)?),
    };
    if let Some(patterns) = patterns {
        let beam = job.spec.beam.beam();
        let options = NoiseOptions { seed: data.seed, w0_um: beam.w0_um, ..NoiseOptions::default() };
        let name = args.speckle.as_ref().map_or_else(|| job.file.display().to_string(), |f| f.display().to_string());
        data.noise = Some(plywave_fit::speckle::noise_tiles(&patterns, &options, &name)?.0);
    }
    data.save(&path)?;
    remove_parts(&parts);
    remove_parts(&speckle_parts);
    let fitted = fit::Summary::of(&data, fit_time);
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    if cli.json {
        let mut object = serde_json::json!({
            "model": path.display().to_string(),
            "table": table_path.as_ref().map(|p| p.display().to_string()),
            "bytes": bytes,
            "name": job.spec.name,
            "preset": data.preset,
            "seed": data.seed,
        });
        merge(&mut object, &simulated);
        merge(&mut object, &fitted);
        return output::print_json(&object);
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}, {} at {} quality", path.display(), report::bytes(bytes), job.spec.name, data.preset)?;
        simulate::write_summary(out, &simulated)?;
        fit::write_summary(out, &fitted, fit_time)?;
        writeln!(out, "look at it with: plywave plot {}", path.display())
    })
}
