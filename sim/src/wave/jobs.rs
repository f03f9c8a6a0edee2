//! Runs over many instances: jobs that depend on their number alone, side by side as far as memory allows, finished ones on disk.
//!
//! The outcome does not depend on threads or interruptions. Jobs start in their order, so that what a stopped run leaves is the first of them.

use super::memory;
use crate::error::SimError;
use crate::parts::{JobOutput, Parts};
use crate::simulate::Run;
use rayon::prelude::*;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// What does a job: its output and the most memory that it held [bytes], or none where it was stopped.
pub(crate) type Work<'a> = dyn Fn(usize, &AtomicBool) -> Result<Option<(JobOutput, usize)>, SimError> + Sync + 'a;

/// Outputs of jobs `0..count`, in their order. `marker` names the run: finished jobs of a run of the same marker and spec text are taken up when `run` says
/// so. Progress counts jobs.
///
/// # Errors
/// The failure of the first job by number that fails, [`SimError::Interrupted`] when stopped, file errors of the parts folder.
pub(crate) fn run_jobs(
    count: usize,
    empty: &JobOutput,
    marker: &dyn std::fmt::Debug,
    spec_text: &str,
    run: Run<'_>,
    work: &Work<'_>,
) -> Result<Vec<JobOutput>, SimError> {
    let never = AtomicBool::new(false);
    let stop = run.stop.unwrap_or(&never);
    let silent = |_: u64| {};
    let progress: &(dyn Fn(u64) + Sync) = run.progress.unwrap_or(&silent);
    let parts = match run.parts {
        Some(folder) => Some(Parts::open(folder, run.resume, spec_text, marker)?),
        None => None,
    };
    let mut done: Vec<Option<JobOutput>> = vec![None; count];
    let mut left = Vec::new();
    for (job, slot) in done.iter_mut().enumerate() {
        let mut output = empty.clone();
        match &parts {
            Some(parts) if parts.read_job(job, &mut output)? => {
                *slot = Some(output);
                progress(1);
            }
            _ => left.push(job),
        }
    }
    let found: Mutex<Vec<(usize, JobOutput)>> = Mutex::new(Vec::with_capacity(left.len()));
    let one = |job: usize| -> Result<Option<usize>, SimError> {
        let Some((output, bytes)) = work(job, stop)? else { return Ok(None) };
        if let Some(parts) = &parts {
            parts.write_job(job, &output)?;
        }
        lock(&found).push((job, output));
        progress(1);
        Ok(Some(bytes))
    };
    // The first job alone tells how many may be held side by side.
    let mut lanes = 0;
    if let Some((first, rest)) = left.split_first()
        && let Some(bytes) = one(*first)?
    {
        let fit = memory::available_bytes().map_or(1, |free| free / 2 / bytes.max(1));
        lanes = fit.clamp(1, rayon::current_num_threads()).min(rest.len());
    }
    let next = AtomicUsize::new(1);
    let failed: Mutex<Option<(usize, SimError)>> = Mutex::new(None);
    (0..lanes).into_par_iter().with_max_len(1).for_each(|_| {
        loop {
            let turn = next.fetch_add(1, Ordering::Relaxed);
            let hopeless = || lock(&failed).as_ref().is_some_and(|(at, _)| *at < turn);
            if turn >= left.len() || stop.load(Ordering::Relaxed) || hopeless() {
                return;
            }
            if let Err(error) = one(left[turn]) {
                let mut failed = lock(&failed);
                if failed.as_ref().is_none_or(|(at, _)| turn < *at) {
                    *failed = Some((turn, error));
                }
            }
        }
    });
    if let Some((_, error)) = failed.into_inner().unwrap_or_else(|e| e.into_inner()) {
        return Err(error);
    }
    for (job, output) in found.into_inner().unwrap_or_else(|e| e.into_inner()) {
        done[job] = Some(output);
    }
    let whole: Vec<JobOutput> = done.into_iter().flatten().collect();
    if whole.len() < count {
        return Err(SimError::Interrupted { left: count - whole.len(), total: count });
    }
    Ok(whole)
}

/// The lock of a mutex, whoever panicked while holding it: the values within are whole at any time.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|e| e.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn empty() -> JobOutput {
        JobOutput { floats: vec![0.0; 2], numbers: vec![0.0] }
    }

    fn output(job: usize) -> JobOutput {
        JobOutput { floats: vec![job as f32, 0.5], numbers: vec![1.0 / (1.0 + job as f64)] }
    }

    /// Stopped in the middle, taken up again: each job is done once, and the outcome is that of an undisturbed run. Another marker is refused.
    #[test]
    fn stopped_runs_are_taken_up() {
        let folder = tempfile::tempdir().unwrap();
        let parts = folder.path().join("x.parts");
        let (stop, calls) = (AtomicBool::new(false), AtomicUsize::new(0));
        let work = |job: usize, stop: &AtomicBool| {
            if calls.fetch_add(1, Ordering::Relaxed) == 4 {
                stop.store(true, Ordering::Relaxed);
                return Ok(None);
            }
            Ok(Some((output(job), 1)))
        };
        let run = Run { parts: Some(&parts), resume: false, stop: Some(&stop), progress: None };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let stopped = pool.install(|| run_jobs(9, &empty(), &"a", "spec", run, &work));
        assert!(matches!(stopped, Err(SimError::Interrupted { left: 5, total: 9 })), "{stopped:?}");
        stop.store(false, Ordering::Relaxed);
        let resumed = Run { resume: true, ..run };
        assert!(run_jobs(9, &empty(), &"b", "spec", resumed, &work).is_err(), "another run");
        let whole = run_jobs(9, &empty(), &"a", "spec", resumed, &work).unwrap();
        assert_eq!(whole, (0..9).map(output).collect::<Vec<_>>());
        assert_eq!(calls.into_inner(), 4 + 1 + 5);
        // More of the same run: what is there is read, not done again.
        let more = run_jobs(10, &empty(), &"a", "spec", resumed, &|job, _| {
            assert_eq!(job, 9);
            Ok(Some((output(job), 1)))
        });
        assert_eq!(more.unwrap().len(), 10);
    }

    /// Of several failures the first by number is told, whatever the threads.
    #[test]
    fn first_failure_is_told() {
        for threads in [1, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let work = |job: usize, _: &AtomicBool| match job {
                5 | 7 => Err(SimError::TooLarge { cells: job as f64, allowed: 0.0 }),
                _ => Ok(Some((output(job), 1))),
            };
            let failed = pool.install(|| run_jobs(12, &empty(), &"a", "", Run::plain(), &work));
            assert!(matches!(failed, Err(SimError::TooLarge { cells, .. }) if cells == 5.0), "{failed:?}");
        }
    }
}
