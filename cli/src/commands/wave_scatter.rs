//! `plywave wave scatter`: scene in, far fields and widths out.

use super::on_threads;
use crate::args::{Cli, WaveScatterArgs};
use crate::failure::{Failure, Outcome};
use crate::progress::{self, Bar};
use crate::{output, report};
use plywave_sim::wave::{Report, Scene, WaveError, scatter};
use std::path::Path;
use std::time::Duration;

/// Runs the command.
pub fn run(cli: &Cli, args: &WaveScatterArgs) -> Outcome {
    let refuse = |error: WaveError| Failure::Input(format!("{}: {error}", args.scene.display()));
    let scene = Scene::load(&args.scene).map_err(refuse)?;
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.scene, "json"));
    output::check_writable(&path, &[&args.scene])?;
    // There is nothing to save on the way, so that Ctrl-C may end the program at once.
    progress::install_stop();
    let bar = Bar::new("scatter", "cases", cli.quiet);
    bar.begin("scatter", scene.cases() as u64);
    let done = on_threads(cli, || scatter(&scene, &|cases| bar.advance(cases)));
    bar.finish();
    let report = done?.map_err(refuse)?;
    // But a file that is half written is finished first.
    progress::stoppable(|| {
        output::write_whole_by(&path, |out| {
            serde_json::to_writer(&mut *out, &report).map_err(std::io::Error::from)?;
            writeln!(out)
        })
    })?;
    tell(cli, &path, &report)
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
