//! `plywave wave scatter`: scene in, far fields and widths out.

use crate::args::{Cli, ResumeArgs, WaveScatterArgs};
use crate::commands::runs::{self, ProgressNames};
use crate::failure::Outcome;
use crate::{output, progress, report};
use plywave_wave::{Report, ScatterJob, Scene};
use std::path::Path;
use std::time::Duration;

/// Runs the command.
pub fn run(cli: &Cli, args: &WaveScatterArgs) -> Outcome {
    // Parts carry the text.
    let (scene, text) = Scene::load(&args.scene).map_err(|error| runs::failure(error, &args.scene))?;
    let path = args.output.clone().unwrap_or_else(|| args.shards.default_output(&args.scene, "json"));
    output::check_writable(&path, &[&args.scene])?;
    let job = ScatterJob::new(&scene, &text);
    let names = ProgressNames { what: "scatter", unit: "cases" };
    let never = ResumeArgs::default();
    if runs::run_share(cli, &job, names, &args.shards, (&path, &never), &args.scene)? {
        return Ok(());
    }
    // Scenes are short runs: nothing is saved on the way.
    let (mut report, time) = runs::run_job(cli, &job, names, None, &args.scene)?;
    report.stats.seconds = time.as_secs_f64();
    save(&path, &report)?;
    tell(cli, &path, &report)
}

/// Writes the report.
pub fn save(path: &Path, report: &Report) -> Outcome {
    progress::stoppable(|| {
        output::write_whole_by(path, |out| {
            serde_json::to_writer(&mut *out, report).map_err(std::io::Error::from)?;
            writeln!(out)
        })
    })
}

/// Says how the run went.
fn tell(cli: &Cli, path: &Path, report: &Report) -> Outcome {
    let stats = &report.stats;
    let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    // The share of the extinction that the ledger is off by.
    let ledger = report
        .cases
        .iter()
        .map(|c| (c.c_ext_um - c.c_sca_um - c.c_abs_um).abs() / c.c_ext_um.abs().max(f64::MIN_POSITIVE))
        .fold(0.0, f64::max);
    if cli.json {
        return output::print_json(&serde_json::json!({
            "output": path.display().to_string(),
            "bytes": bytes,
            "cases": report.cases.len(),
            "ledger_max": ledger,
            "stats": stats,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}, {} cases", path.display(), report::bytes(bytes), report.cases.len())?;
        let time = report::duration(Duration::from_secs_f64(stats.seconds));
        writeln!(out, "  method       {}, {} unknowns, {time}", stats.method, stats.unknowns)?;
        writeln!(out, "  memory       {} at most", report::bytes(stats.peak_bytes as u64))?;
        writeln!(out, "  residual     {:.1e}", stats.residual)?;
        writeln!(out, "  ledger       C_ext - C_sca - C_abs is at most {ledger:.1e} of C_ext")
    })
}
