//! Common parts of the commands that run shards: the parts folder, `--resume`, `--fresh`, `--shards`,
//! `--plan`, progress and failures.

use crate::args::{Cli, ResumeArgs, ShardArgs};
use crate::failure::{Failure, Outcome};
use crate::progress::{self, Bar};
use crate::threads::on_threads;
use crate::{output, report};
use plywave_runs::RunError;
use plywave_runs::{self as runs, Found, Job, PartsFolder, Plan, Run};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Path of the folder of shards beside an output.
pub fn parts_of(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_os_string();
    name.push(".parts");
    output.with_file_name(name)
}

/// Treatment of shards of an earlier run.
pub fn found(args: &ResumeArgs) -> Found {
    match (args.resume, args.fresh) {
        (_, true) => Found::Replace,
        (true, false) => Found::Resume,
        (false, false) => Found::Refuse,
    }
}

/// Opens and locks the folder of shards beside an output.
pub fn open_parts(output: &Path, args: &ResumeArgs) -> Outcome<PartsFolder> {
    PartsFolder::open(parts_of(output), found(args)).map_err(|e| failure(e, output))
}

/// Converts a run's error to the command's failure; `file` is the spec or scene.
pub fn failure(error: impl Into<RunError>, file: &Path) -> Failure {
    match error.into() {
        RunError::Interrupted { left, total } => interrupted(left, total),
        RunError::Runtime(error) => error.into(),
        error @ RunError::TooManyParts { .. } => Failure::Input(format!("command line: {error}")),
        error if error.is_of_parts() => Failure::Input(error.to_string()),
        other => Failure::Input(format!("{}: {other}", file.display())),
    }
}

/// Converts the pipeline's error to the command's failure.
pub fn pipeline_failure(error: plywave_pipeline::Error) -> Failure {
    match error {
        plywave_pipeline::Error::Interrupted { left, total } => interrupted(left, total),
        plywave_pipeline::Error::Runtime(error) => error.into(),
        other => Failure::Input(other.to_string()),
    }
}

/// Failure of a run that was stopped, with the number of remaining shards.
fn interrupted(left: usize, total: usize) -> Failure {
    let remaining = if total > 0 { format!(" with {left} of {total} shards left") } else { String::new() };
    progress::stopped(&remaining)
}

/// Prints notes on dropped parts.
pub fn tell_notes(cli: &Cli, parts: &PartsFolder) {
    for note in parts.take_notes() {
        if !cli.quiet {
            eprintln!("{}", crate::failure::one_line(&note));
        }
    }
}

/// Names of a job for its progress bar.
#[derive(Clone, Copy)]
pub struct ProgressNames {
    /// Name of the work.
    pub what: &'static str,
    /// Name of the counted units.
    pub unit: &'static str,
}

/// Runs a job with progress; returns the output and the elapsed time. `file` is the spec or scene.
pub fn run_job<J: Job>(
    cli: &Cli,
    job: &J,
    names: ProgressNames,
    parts: Option<&PartsFolder>,
    file: &Path,
) -> Outcome<(J::Output, Duration)>
where
    J::Output: Send,
{
    with_bar(cli, job, names, parts, file, |run| runs::run(job, run))
}

/// Runs the shards that `--shards` selects and writes their part, or prints the plan for `--plan`. Returns
/// whether the command is finished.
pub fn run_share<J: Job>(
    cli: &Cli,
    job: &J,
    names: ProgressNames,
    args: &ShardArgs,
    (path, resume): (&Path, &ResumeArgs),
    file: &Path,
) -> Outcome<bool> {
    let plan = Plan::from_job(job);
    if args.plan {
        tell_plan(cli, &plan)?;
        return Ok(true);
    }
    let Some((index, count)) = args.shards else { return Ok(false) };
    let parts = open_parts(path, resume)?;
    let work = |run: Run<'_>| runs::run_part(job, (index, count), path, run);
    let (shards, time) = with_bar(cli, job, names, Some(&parts), file, work)?;
    parts.remove();
    let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    let (first, last) = (shards.start, shards.end.saturating_sub(1));
    if cli.json {
        output::print_json(&serde_json::json!({
            "part": path.display().to_string(), "bytes": bytes, "kind": plan.description.kind, "job": plan.digest,
            "first": first, "last": last, "shards": plan.shards, "seconds": time.as_secs_f64(),
        }))?;
    } else if !cli.quiet {
        output::print(|out| {
            writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
            let time = report::duration(time);
            writeln!(
                out,
                "  work         {time}: part {index} of {count}, shards {first} to {last} of {}",
                plan.shards
            )?;
            writeln!(out, "join all parts with: plywave merge PARTS -o OUTPUT")
        })?;
    }
    Ok(true)
}

fn tell_plan(cli: &Cli, plan: &Plan) -> Outcome {
    if cli.json {
        return output::print_json(&serde_json::json!({
            "kind": plan.description.kind, "job": plan.digest, "shards": plan.shards, "group": plan.group,
            "units": plan.units, "values": plan.values, "options": plan.description.options,
        }));
    }
    output::print(|out| writeln!(out, "{plan}"))
}

fn with_bar<J: Job, T: Send>(
    cli: &Cli,
    job: &J,
    names: ProgressNames,
    parts: Option<&PartsFolder>,
    file: &Path,
    work: impl FnOnce(Run<'_>) -> Result<T, RunError> + Send,
) -> Outcome<(T, Duration)> {
    progress::install_stop();
    let bar = Bar::new(names.what, names.unit, cli.quiet);
    bar.begin(names.what, Plan::from_job(job).units);
    let advance = |units: u64| bar.advance(units);
    let run = Run { parts, stop: Some(&progress::STOP), progress: Some(&advance) };
    // Without a folder there is no state to save, so Ctrl-C may end the program at once.
    let done = match parts {
        Some(_) => progress::stoppable(|| on_threads(cli, || work(run))),
        None => on_threads(cli, || work(run)),
    };
    let time = bar.finish();
    if let Some(parts) = parts {
        tell_notes(cli, parts);
    }
    Ok((done?.map_err(|e| failure(e, file))?, time))
}
