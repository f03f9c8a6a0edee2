//! `plywave simulate`: simulates a yarn spec and writes its table.

use crate::args::{Cli, Plies, Preset, RunArgs, SimulateArgs};
use crate::commands::runs::{self, ProgressNames, pipeline_failure};
use crate::failure::{Failure, Outcome};
use crate::{output, report};
use plywave::Document;
use plywave::spec::YarnSpec;
use plywave_pipeline::{Recipe, Speckle};
use plywave_sim::SimulateJob;
use plywave_tables::table::Table;
use std::path::Path;
use std::time::Duration;

/// The recipe of a spec and the flags. The default spec is polyester, and the default quality without spec
/// and flag is preview.
pub fn recipe(spec: Option<&Path>, run: &RunArgs) -> Outcome<Recipe> {
    let mut recipe = match spec {
        Some(path) => Recipe::load(path, run.preset.unwrap_or(Preset::Standard).quality()).map_err(pipeline_failure)?,
        None => {
            let quality = run.preset.unwrap_or(Preset::Preview).quality();
            Recipe::new("polyester.toml", YarnSpec::polyester()?, plywave::spec::POLYESTER, quality)
        }
    };
    recipe.seed = run.seed;
    recipe.paths = run.paths;
    recipe.instances = run.instances;
    recipe.speckle = Speckle::None;
    Ok(recipe)
}

/// Summary of a finished simulation.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Summary {
    /// Number of paths traced, over all latitudes.
    pub paths: u64,
    /// Time [s].
    pub simulation_s: f64,
    /// Whether shards of an earlier run were used; the time then excludes them.
    pub resumed: bool,
    /// Largest deviation of refl + high + r_d from 1 at sigma = 0, in its standard errors.
    pub energy_balance_max_standard_errors: f64,
    /// Largest energy of paths stopped at the interaction limit, at sigma = 0.
    pub energy_killed_max: f64,
}

impl Summary {
    /// Summary of a table that was just simulated.
    pub fn new(table: &Table, time: Duration, resumed: bool) -> Self {
        Summary {
            paths: table.paths.iter().sum(),
            simulation_s: time.as_secs_f64(),
            resumed,
            energy_balance_max_standard_errors: energy_balance(table),
            energy_killed_max: table.energy_killed.iter().copied().fold(0.0, f64::max),
        }
    }
}

/// Largest |refl + high + r_d - 1| at sigma = 0 over the incidences, in standard errors; incidences without
/// variance are skipped.
pub fn energy_balance(table: &Table) -> f64 {
    let sigmas = table.sigma_per_um.len();
    (0..table.r_d.len())
        .filter(|&i| table.energy_se[i] > 1e-12)
        .map(|i| {
            let sum = table.r_d[i] + table.energy_refl[i] + table.energy_high[i * sigmas];
            (sum - 1.0).abs() / table.energy_se[i]
        })
        .fold(0.0, f64::max)
}

/// Runs the command.
pub fn run(cli: &Cli, args: &SimulateArgs) -> Outcome {
    let mut recipe = recipe(Some(&args.spec), &args.run)?;
    if args.plies == Plies::Traced {
        if recipe.spec.yarn.plies < 2 {
            let hint = "--plies traced needs 2 or more";
            return Err(Failure::input(args.spec.display(), "yarn.plies", recipe.spec.yarn.plies, hint));
        }
        recipe.traced_plies = true;
    }
    let path = args.output.clone().unwrap_or_else(|| args.shards.default_output(&args.spec, "pwt"));
    let refuse = |e| runs::failure(e, &args.spec);
    let job = SimulateJob::new(&recipe.spec, &recipe.spec_text, &recipe.simulation()).map_err(refuse)?;
    job.check_savable().map_err(refuse)?;
    output::check_writable(&path, &[&args.spec])?;
    let names = ProgressNames { what: "simulate", unit: "paths" };
    if runs::run_share(cli, &job, names, &args.shards, (&path, &args.run.resume), &args.spec)? {
        return Ok(());
    }
    let resumed = args.run.resume.resume && runs::parts_of(&path).exists();
    let parts = runs::open_parts(&path, &args.run.resume)?;
    let (table, time) = runs::run_job(cli, &job, names, Some(&parts), &args.spec)?;
    table.save(&path)?;
    parts.remove();
    tell(cli, &path, &recipe.spec.name, &table, &Summary::new(&table, time, resumed))
}

/// Reports the result.
fn tell(cli: &Cli, path: &Path, name: &str, table: &Table, summary: &Summary) -> Outcome {
    let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    if cli.json {
        let mut object = serde_json::json!({
            "table": path.display().to_string(),
            "bytes": bytes,
            "name": name,
            "preset": table.preset,
            "seed": table.seed,
            "plies": table.plies,
        });
        merge(&mut object, summary);
        return output::print_json(&object);
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        write_summary(out, summary)
    })
}

/// The lines of a simulation in a report.
pub fn write_summary(out: &mut dyn std::io::Write, summary: &Summary) -> std::io::Result<()> {
    let rate = match summary.resumed {
        true => "resumed from an earlier run".into(),
        false => format!("{} paths/s", report::count(summary.paths as f64 / summary.simulation_s.max(1e-9))),
    };
    let time = report::duration(Duration::from_secs_f64(summary.simulation_s));
    writeln!(out, "  simulation   {time}: {} paths, {rate}", report::count(summary.paths as f64))?;
    let balance = summary.energy_balance_max_standard_errors;
    if balance <= 5.0 {
        writeln!(out, "  energy       refl + high + r_d = 1 within {balance:.1} standard errors at every incidence")
    } else {
        writeln!(
            out,
            "  energy       refl + high + r_d is off 1 by up to {balance:.1} standard errors; paths stopped at the interaction limit hold up to {:.1e}",
            summary.energy_killed_max
        )
    }
}

/// Adds the fields of `more` to a JSON object.
pub fn merge(object: &mut serde_json::Value, more: &impl serde::Serialize) {
    if let (Some(to), Ok(serde_json::Value::Object(from))) = (object.as_object_mut(), serde_json::to_value(more)) {
        to.extend(from);
    }
}
