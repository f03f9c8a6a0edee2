//! What the commands that run shards share: the parts folder, `--resume`, `--fresh`, `--shards`, `--plan`,
//! progress and failures.

use super::on_threads;
use crate::args::{Cli, ResumeArgs, ShardArgs};
use crate::failure::{Failure, Outcome};
use crate::progress::{self, Bar};
use crate::{output, report};
use plywave_sim::runs::{self, Found, Job, PartsFolder, Plan, Run};
use plywave_sim::{SimError, wave::WaveError};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The folder of shards beside an output.
pub fn parts_of(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_os_string();
    name.push(".parts");
    output.with_file_name(name)
}

/// What to do with shards of an earlier run.
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

/// A failure of a run as the command says it; `file` is the spec or scene.
pub fn failure(error: SimError, file: &Path) -> Failure {
    match error {
        SimError::Interrupted { left, total } => interrupted(left, total),
        SimError::Runtime(error) => error.into(),
        SimError::TooManyParts { .. } => Failure::Input(format!("command line: {error}")),
        SimError::PartsInUse { .. }
        | SimError::PartsFound { .. }
        | SimError::PartsOfAnotherRun { .. }
        | SimError::Merge { .. } => Failure::Input(error.to_string()),
        other => Failure::Input(format!("{}: {other}", file.display())),
    }
}

/// A failure of the wave code.
pub fn wave_failure(error: WaveError, file: &Path) -> Failure {
    failure(error.into(), file)
}

/// A failure of the pipeline.
pub fn pipeline_failure(error: plywave_pipeline::Error) -> Failure {
    match error {
        plywave_pipeline::Error::Interrupted { left, total } => interrupted(left, total),
        plywave_pipeline::Error::Runtime(error) => error.into(),
        other => Failure::Input(other.to_string()),
    }
}

/// What a run that was stopped says.
fn interrupted(left: usize, total: usize) -> Failure {
    let told = if total > 0 { format!(" with {left} of {total} shards left") } else { String::new() };
    progress::stopped(&told)
}

/// Says what parts were dropped.
pub fn tell_notes(cli: &Cli, parts: &PartsFolder) {
    for note in parts.take_notes() {
        if !cli.quiet {
            eprintln!("{}", crate::failure::one_line(&note));
        }
    }
}

/// Names for the bar of a job.
#[derive(Clone, Copy)]
pub struct ProgressNames {
    /// The work.
    pub what: &'static str,
    /// What is counted.
    pub unit: &'static str,
}

/// Runs a job with progress; gives the output and the time it took. `file` is the spec or scene.
pub fn run_job<J: Job>(
    cli: &Cli,
    job: &J,
    told: ProgressNames,
    parts: Option<&PartsFolder>,
    file: &Path,
) -> Outcome<(J::Output, Duration)>
where
    J::Output: Send,
{
    with_bar(cli, job, told, parts, file, |run| runs::run(job, run))
}

/// Runs the shards that `--shards` asks for and writes their part, or prints the plan that `--plan` asks for.
/// True when there is nothing more to do.
pub fn run_share<J: Job>(
    cli: &Cli,
    job: &J,
    told: ProgressNames,
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
    let (shards, time) = with_bar(cli, job, told, Some(&parts), file, work)?;
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
    told: ProgressNames,
    parts: Option<&PartsFolder>,
    file: &Path,
    work: impl FnOnce(Run<'_>) -> Result<T, SimError> + Send,
) -> Outcome<(T, Duration)> {
    progress::install_stop();
    let bar = Bar::new(told.what, told.unit, cli.quiet);
    bar.begin(told.what, Plan::from_job(job).units);
    let advance = |units: u64| bar.advance(units);
    let run = Run { parts, stop: Some(&progress::STOP), progress: Some(&advance) };
    // Without a folder there is nothing to save on the way, so that Ctrl-C may end the program at once.
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

/// Reads `K/N` of `--shards`.
pub fn share(text: &str) -> Result<(usize, usize), String> {
    let read = |part: &str| part.parse::<usize>().ok();
    match text.split_once('/').map(|(k, n)| (read(k), read(n))) {
        Some((Some(k), Some(n))) if (1..=n).contains(&k) => Ok((k, n)),
        _ => Err("give K/N, part K of N, with 1 <= K <= N".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_read() {
        assert_eq!(share("3/16"), Ok((3, 16)));
        for bad in ["0/3", "4/3", "3", "a/b", "1/", "-1/2", "1/2/3"] {
            assert!(share(bad).is_err(), "{bad}");
        }
    }
}
