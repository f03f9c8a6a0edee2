//! `plywave build`: simulate and fit in one go.

use super::simulate::{Job, merge, parts_of, remove_parts};
use super::{fit, simulate};
use crate::args::{BuildArgs, Cli};
use crate::failure::{Failure, Outcome};
use crate::{output, report};

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
    let (data, fit_time) = fit::fit_table(cli, &job.file, &table, args.run.preset)?;
    data.save(&path)?;
    remove_parts(&parts);
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
