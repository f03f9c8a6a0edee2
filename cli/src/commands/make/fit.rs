//! `plywave fit`: fits a model to a table.

use crate::args::{Cli, FitArgs};
use crate::commands::make::simulate::merge;
use crate::commands::runs::pipeline_failure;
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::progress::{self, PipelineBar};
use crate::report::{self, Spread};
use crate::threads::on_threads;
use plywave::Document;
use plywave::ply::PlyData;
use plywave::spec::YarnSpec;
use plywave_pipeline::{Quality, Run, check_fit, fit_model, held_errors, yarn_table};
use plywave_tables::table::Table;
use std::path::Path;
use std::time::Duration;

/// The spec in a table.
fn spec_of(file: &Path, table: &Table) -> Outcome<YarnSpec> {
    Ok(YarnSpec::parse(&table.spec_text, &format!("{} (its spec)", file.display()))?)
}

/// Runs a stage of the pipeline with a progress bar; returns its result and the elapsed time.
fn stage<T: Send>(
    cli: &Cli,
    work: impl FnOnce(&Run<'_>) -> Result<T, plywave_pipeline::Error> + Send,
) -> Outcome<(T, Duration)> {
    progress::install_stop();
    let bar = PipelineBar::new(cli.quiet);
    let tell = |progress| bar.update(progress);
    let run = Run { progress: Some(&tell), ..Run::plain() };
    let done = on_threads(cli, || work(&run));
    let time = bar.finish();
    Ok((done?.map_err(pipeline_failure)?, time))
}

/// Summary of a finished fit.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Summary {
    /// Incident latitudes.
    pub theta_i_nodes: usize,
    /// Beam offsets.
    pub h_nodes: usize,
    /// Family of the lobes: round or cone.
    pub family: &'static str,
    /// Lobes of f_refl.
    pub lobes_refl: usize,
    /// Lobes of f_high.
    pub lobes_high: usize,
    /// Relative L2 error of f_refl over the incidences, noise removed, against the table of the fit, as
    /// `plywave check` counts it.
    pub fit_error_refl: Spread,
    /// The same for f_high over incidences and absorptions, as a share of the slice's light at sigma = 0.
    pub fit_error_high: Spread,
    /// Time [s].
    pub fit_s: f64,
}

impl Summary {
    /// Summary of a model that was just fitted.
    pub fn new(data: &PlyData, time: Duration) -> Self {
        let [refl, high] = held_errors(data, &data.error_refl, &data.error_high);
        Summary {
            theta_i_nodes: data.theta_i.len(),
            h_nodes: data.h_um.len(),
            family: data.family.name(),
            lobes_refl: data.lobes_refl,
            lobes_high: data.lobes_high,
            fit_error_refl: Spread::of_errors(refl),
            fit_error_high: Spread::of_errors(high),
            fit_s: time.as_secs_f64(),
        }
    }
}

/// The lines of a fit in a report.
pub fn write_summary(out: &mut dyn std::io::Write, summary: &Summary, time: Duration) -> std::io::Result<()> {
    writeln!(
        out,
        "  fit          {}: {} x {} incidences, {} + {} {} lobes",
        report::duration(time),
        summary.theta_i_nodes,
        summary.h_nodes,
        summary.lobes_refl,
        summary.lobes_high,
        summary.family
    )?;
    writeln!(
        out,
        "  fit error    f_refl rms {:.4}, largest {:.4}",
        summary.fit_error_refl.rms, summary.fit_error_refl.max
    )?;
    writeln!(
        out,
        "               f_high rms {:.4}, largest {:.4} (relative L2, noise removed; f_high: of the light at sigma = 0)",
        summary.fit_error_high.rms, summary.fit_error_high.max
    )
}

/// Replaces the spec of a table of one ply by that of another yarn of such plies.
fn respecify(table: &mut Table, file: &Path, path: &Path) -> Outcome {
    let was = YarnSpec::parse(&table.spec_text, &format!("{} (its spec)", file.display()))?;
    let (spec, text) = plywave_textile::load_yarn_file(path)?;
    if table.plies > 1 {
        let hint = "is of a yarn of several plies already; --spec takes the table of one ply";
        return Err(Failure::input(file.display(), "plies", table.plies, hint));
    }
    // All values except the name and the yarn must match; the numbers of lobes do not belong to the table.
    let simulation =
        |s: &YarnSpec| plywave::spec::SimulationSpec { lobes_refl: None, lobes_high: None, ..s.simulation.clone() };
    let differs = [
        ("fiber", spec.fiber != was.fiber),
        ("ply", spec.ply != was.ply),
        ("beam", spec.beam != was.beam),
        ("absorption", spec.absorption != was.absorption),
        ("simulation", simulation(&spec) != simulation(&was)),
    ];
    if let Some((section, _)) = differs.iter().find(|(_, differs)| *differs) {
        let hint = format!("is not that of {}; simulate this spec, or make the sections the same", file.display());
        return Err(Failure::Input(format!("{}: [{section}] {hint}", path.display())));
    }
    table.spec_text = text;
    Ok(())
}

/// Runs the command.
pub fn run(cli: &Cli, args: &FitArgs) -> Outcome {
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.table, "pwm"));
    output::check_writable(&path, &[&args.table])?;
    if let Some(yarn_path) = &args.yarn_table {
        if *yarn_path == path {
            let hint = "is where the model goes; name the yarn's table NAME.pwt";
            return Err(Failure::input("command line", "--yarn-table", path.display(), hint));
        }
        output::check_writable(yarn_path, &[&args.table])?;
    }
    let mut table = Table::load(&args.table)?;
    if let Some(spec) = &args.spec {
        respecify(&mut table, &args.table, spec)?;
    }
    let (spec, file) = (spec_of(&args.table, &table)?, args.table.display().to_string());
    let quality = args.preset.map_or_else(|| Quality::of_preset(&table.preset), |preset| preset.quality());
    check_fit(&table, &spec, &quality.fit(), &file).map_err(pipeline_failure)?;
    let (made, yarn_time) = stage(cli, |run| yarn_table(&table, &spec, &file, run))?;
    let mut files = Vec::new();
    if let Some(yarn_path) = &args.yarn_table {
        let Some(yarn) = &made else {
            let hint = "there is no yarn to make: it takes a table of one ply whose spec has yarn.plies of 2 or more";
            return Err(Failure::input(args.table.display(), "plies", table.plies, hint));
        };
        files.push((yarn_path, yarn.to_bytes()?));
    }
    let yarn_s = made.as_ref().map(|_| yarn_time.as_secs_f64());
    let table = made.unwrap_or(table);
    let plies = table.plies;
    let (data, time) = stage(cli, |run| fit_model(&table, &spec, &quality.fit(), &file, run))?;
    files.push((&path, data.to_bytes()?));
    output::write_set(&files)?;
    let summary = Summary::new(&data, time);
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    if cli.json {
        let mut object = serde_json::json!({
            "model": path.display().to_string(),
            "bytes": bytes,
            "preset": data.preset,
            "seed": data.seed,
            "plies": plies,
            "yarn_s": yarn_s,
        });
        merge(&mut object, &summary);
        return output::print_json(&object);
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        if let Some(seconds) = yarn_s {
            let time = report::duration(Duration::from_secs_f64(seconds));
            writeln!(out, "  yarn         {time}: from one ply to {plies}")?;
        }
        write_summary(out, &summary, time)
    })
}
