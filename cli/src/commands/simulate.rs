//! `plywave simulate`: spec in, table out.

use super::on_threads;
use crate::args::{Cli, Plies, Preset, RunArgs, SimulateArgs};
use crate::failure::{Failure, Outcome};
use crate::progress::{self, Bar};
use crate::{output, report};
use plywave::{Table, YarnSpec};
use plywave_sim::{Run, SimError, SimOptions};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A spec, ready to run.
pub struct Job {
    /// Where it came from, for messages.
    pub file: PathBuf,
    /// The parsed spec.
    pub spec: YarnSpec,
    /// Its text, for the table.
    pub text: String,
    /// Sizes of the run.
    pub options: SimOptions,
}

impl Job {
    /// Reads a spec (polyester when there is none) and settles the sizes: preset, then the spec's, then the command line's.
    pub fn new(spec: Option<&Path>, run: &RunArgs) -> Outcome<Self> {
        let (file, (spec, text), usual) = match spec {
            Some(path) => (path.to_path_buf(), YarnSpec::load(path)?, Preset::Standard),
            None => {
                ("polyester.toml".into(), (YarnSpec::polyester()?, plywave::POLYESTER.to_string()), Preset::Preview)
            }
        };
        Ok(Job::of(file, spec, text, &RunArgs { preset: Some(run.preset.unwrap_or(usual)), ..run.clone() }))
    }

    /// Of a spec that has been read; standard quality where no preset is given.
    pub fn of(file: PathBuf, spec: YarnSpec, text: String, run: &RunArgs) -> Self {
        let mut options = match run.preset.unwrap_or(Preset::Standard) {
            Preset::Preview => SimOptions::preview(),
            Preset::Standard => SimOptions::standard(),
            Preset::Reference => SimOptions::reference(),
        }
        .overridden_by(&spec.simulation);
        options.seed = run.seed;
        options.paths_per_theta = run.paths.unwrap_or(options.paths_per_theta);
        options.instances = run.instances.unwrap_or(options.instances);
        Job { file, spec, text, options }
    }

    /// Runs the simulation with finished shards kept in `parts`; gives the table and what there is to say.
    pub fn simulate(&self, cli: &Cli, parts: &Path, resume: bool) -> Outcome<(Table, Summary)> {
        let fresh = !parts.exists();
        progress::install_stop();
        let bar = Bar::new("simulate", "paths", cli.quiet);
        bar.begin("simulate", plywave_sim::total_paths(&self.options));
        let advance = |paths: u64| bar.advance(paths);
        let run = Run { parts: Some(parts), resume, stop: Some(&progress::STOP), progress: Some(&advance) };
        let work = progress::stoppable(|| {
            on_threads(cli, || plywave_sim::simulate(&self.spec, &self.text, &self.options, run))
        });
        let time = bar.finish();
        match work? {
            Ok(table) => {
                let summary = Summary::of(&table, time, resume && !fresh);
                Ok((table, summary))
            }
            Err(error) => {
                // A spec that cannot be built leaves nothing behind.
                if fresh && !matches!(error, SimError::Interrupted { .. } | SimError::Runtime(_)) {
                    remove_parts(parts);
                }
                Err(self.failure(error))
            }
        }
    }

    fn failure(&self, error: SimError) -> Failure {
        match error {
            SimError::Interrupted { left, total } => Failure::Interrupted(format!(
                "stopped with {left} of {total} shards left; go on with: {}",
                progress::resume_command()
            )),
            SimError::Runtime(error) => error.into(),
            other => Failure::Input(format!("{}: {other}", self.file.display())),
        }
    }
}

/// The folder of shards beside an output.
pub fn parts_of(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_os_string();
    name.push(".parts");
    output.with_file_name(name)
}

/// Takes away the shards of a run whose result is written. What cannot be taken away does no harm.
pub fn remove_parts(parts: &Path) {
    let _ = std::fs::remove_dir_all(parts);
}

/// What a finished simulation has to say.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Summary {
    /// Paths traced, all latitudes together.
    pub paths: u64,
    /// Time [s].
    pub simulation_s: f64,
    /// Whether shards of an earlier run were taken up; the time is then that of the rest.
    pub resumed: bool,
    /// Largest departure of refl + high + r_d from 1 at sigma = 0, in its standard errors.
    pub energy_balance_max_standard_errors: f64,
    /// Largest energy of paths stopped at the interaction limit, at sigma = 0.
    pub energy_killed_max: f64,
}

impl Summary {
    /// Of a table just simulated.
    fn of(table: &Table, time: Duration, resumed: bool) -> Self {
        Summary {
            paths: table.paths.iter().sum(),
            simulation_s: time.as_secs_f64(),
            resumed,
            energy_balance_max_standard_errors: energy_balance(table),
            energy_killed_max: table.energy_killed.iter().copied().fold(0.0, f64::max),
        }
    }
}

/// Largest |refl + high + r_d - 1| at sigma = 0 over the incidences, in standard errors; incidences without spread are left out.
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
    let mut job = Job::new(Some(&args.spec), &args.run)?;
    if args.plies == Plies::Traced {
        if job.spec.yarn.plies < 2 {
            let mend = "--plies traced needs 2 or more";
            return Err(Failure::input(args.spec.display(), "yarn.plies", job.spec.yarn.plies, mend));
        }
        job.options.traced_plies = true;
    }
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.spec, "pwt"));
    output::check_writable(&path, &[&args.spec])?;
    let parts = parts_of(&path);
    let (table, summary) = job.simulate(cli, &parts, args.run.resume)?;
    table.save(&path)?;
    remove_parts(&parts);
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    if cli.json {
        let mut object = serde_json::json!({
            "table": path.display().to_string(),
            "bytes": bytes,
            "name": job.spec.name,
            "preset": table.preset,
            "seed": table.seed,
            "plies": table.plies,
        });
        merge(&mut object, &summary);
        return output::print_json(&object);
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        write_summary(out, &summary)
    })
}

/// The lines of a simulation in a report.
pub fn write_summary(out: &mut dyn std::io::Write, summary: &Summary) -> std::io::Result<()> {
    let rate = match summary.resumed {
        true => "taken up from an earlier run".into(),
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
