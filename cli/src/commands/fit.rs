//! `plywave fit`: table in, model out.

use super::on_threads;
use super::simulate::merge;
use crate::args::{Cli, FitArgs, Preset};
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::progress::{self, Bar};
use crate::report::{self, Spread};
use plywave::{PlyData, Table, YarnSpec};
use plywave_fit::{FitOptions, Stage};
use std::path::Path;
use std::time::Duration;

/// Fits a model; gives it and the time it took. Without a preset the table's own counts; the spec's lobe numbers go before both.
pub fn fit_table(cli: &Cli, file: &Path, table: &Table, preset: Option<Preset>) -> Outcome<(PlyData, Duration)> {
    let spec = YarnSpec::parse(&table.spec_text, &format!("{} (its spec)", file.display()))?;
    let mut options = match preset.map_or(table.preset.as_str(), |p| p.name()) {
        "preview" => FitOptions::preview(),
        "reference" => FitOptions::reference(),
        _ => FitOptions::standard(),
    };
    options.lobes_refl = spec.simulation.lobes_refl.map_or(options.lobes_refl, |n| n as usize);
    options.lobes_high = spec.simulation.lobes_high.map_or(options.lobes_high, |n| n as usize);
    progress::install_stop();
    let bar = Bar::new("fit", "slices", cli.quiet);
    let work = on_threads(cli, || {
        plywave_fit::fit(table, &options, &|p| {
            let name = match p.stage {
                Stage::High => "fit high",
                Stage::Reflection => "fit refl",
                Stage::Errors => "errors",
            };
            bar.update(name, p.done as u64, p.total as u64);
        })
    })?;
    let time = bar.finish();
    match work {
        Ok(mut data) => {
            data.edge = Some(plywave_fit::fit_edge(&spec, &plywave_fit::EdgeOptions::default()).lobes);
            Ok((data, time))
        }
        Err(error) => Err(Failure::Input(format!("{}: {error}", file.display()))),
    }
}

/// What a finished fit has to say.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Summary {
    /// Incident latitudes.
    pub theta_i_nodes: usize,
    /// Beam offsets.
    pub h_nodes: usize,
    /// Lobes of f_refl.
    pub lobes_refl: usize,
    /// Lobes of f_high.
    pub lobes_high: usize,
    /// Relative L2 error of f_refl over the incidences, noise removed, against the table of the fit.
    pub fit_error_refl: Spread,
    /// The same for f_high at sigma = 0.
    pub fit_error_high: Spread,
    /// Time [s].
    pub fit_s: f64,
}

impl Summary {
    /// Of a model just fitted.
    pub fn of(data: &PlyData, time: Duration) -> Self {
        Summary {
            theta_i_nodes: data.theta_i.len(),
            h_nodes: data.h_um.len(),
            lobes_refl: data.lobes_refl,
            lobes_high: data.lobes_high,
            fit_error_refl: Spread::of_errors(data.error_refl.iter().copied()),
            fit_error_high: Spread::of_errors(data.error_high.iter().copied().step_by(data.sigma_per_um.len().max(1))),
            fit_s: time.as_secs_f64(),
        }
    }
}

/// The lines of a fit in a report.
pub fn write_summary(out: &mut dyn std::io::Write, summary: &Summary, time: Duration) -> std::io::Result<()> {
    writeln!(
        out,
        "  fit          {}: {} x {} incidences, {} + {} lobes",
        report::duration(time),
        summary.theta_i_nodes,
        summary.h_nodes,
        summary.lobes_refl,
        summary.lobes_high
    )?;
    writeln!(
        out,
        "  fit error    f_refl rms {:.4}, largest {:.4}",
        summary.fit_error_refl.rms, summary.fit_error_refl.max
    )?;
    writeln!(
        out,
        "               f_high rms {:.4}, largest {:.4} (relative L2 at sigma = 0, noise removed)",
        summary.fit_error_high.rms, summary.fit_error_high.max
    )
}

/// Runs the command.
pub fn run(cli: &Cli, args: &FitArgs) -> Outcome {
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.table, "pwm"));
    output::check_writable(&path, &[&args.table])?;
    let table = Table::load(&args.table)?;
    let (data, time) = fit_table(cli, &args.table, &table, args.preset)?;
    data.save(&path)?;
    let summary = Summary::of(&data, time);
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    if cli.json {
        let mut object = serde_json::json!({
            "model": path.display().to_string(),
            "bytes": bytes,
            "preset": data.preset,
            "seed": data.seed,
        });
        merge(&mut object, &summary);
        return output::print_json(&object);
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        write_summary(out, &summary, time)
    })
}
