//! Runs long work on a thread of its own, while the calling thread checks for Ctrl-C and reports progress to
//! Python.

use crate::errors::{Failure, Outcome};
use plywave_pipeline::{Progress, Run};
use plywave_runs::{self as runs, Found, Job, PartsFolder, Plan};
use pyo3::exceptions::{PyKeyboardInterrupt, PyUserWarning};
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time between two checks.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Panic payload that unwinds a stage without checks of the stop flag.
struct Stopped;

/// Progress of a stage: its name, its unit, units done, total.
type State = (&'static str, &'static str, u64, u64);

/// State shared by the work and its watcher.
pub(crate) struct Watch {
    pub(crate) stop: AtomicBool,
    state: Mutex<Option<State>>,
}

impl Watch {
    fn state(&self) -> MutexGuard<'_, Option<State>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records the progress of a stage of the pipeline. A stage that does not check the stop flag is unwound
    /// here.
    pub(crate) fn tell(&self, progress: Progress) {
        *self.state() = Some((progress.stage.name(), progress.stage.unit(), progress.done, progress.total));
        if self.stop.load(Ordering::Relaxed) && !progress.stage.is_stoppable() {
            resume_unwind(Box::new(Stopped));
        }
    }

    /// Runs a job with progress and stop flag.
    pub(crate) fn run_job<J: Job>(
        &self,
        job: &J,
        (what, unit): (&'static str, &'static str),
        parts: Option<&PartsFolder>,
        file: &str,
    ) -> Outcome<J::Output> {
        let (total, done) = (Plan::from_job(job).units, AtomicU64::new(0));
        *self.state() = Some((what, unit, 0, total));
        let advance = |units: u64| {
            let done = done.fetch_add(units, Ordering::Relaxed) + units;
            *self.state() = Some((what, unit, done, total));
        };
        let run = runs::Run { parts, stop: Some(&self.stop), progress: Some(&advance) };
        runs::run(job, run).map_err(|e| Failure::of_run(e, file))
    }

    /// Runs a function of the pipeline with progress and stop flag.
    pub(crate) fn run<T>(
        &self,
        parts: [Option<&PartsFolder>; 2],
        work: impl FnOnce(&Run<'_>) -> Outcome<T>,
    ) -> Outcome<T> {
        let tell = |progress| self.tell(progress);
        work(&Run { parts: parts[0], speckle_parts: parts[1], stop: Some(&self.stop), progress: Some(&tell) })
    }
}

/// Runs `work` on a pool of `threads` threads. `progress` is called with the name of a stage, its unit, the
/// units done and the total. An exception in it, and Ctrl-C, stop the work.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    threads: usize,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&Watch) -> Outcome<T> + Send,
) -> Outcome<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| Failure::Input(format!("threads = {threads}: {e}; use fewer")))?;
    let watch = Watch { stop: AtomicBool::new(false), state: Mutex::new(None) };
    let (sender, ended) = channel::<()>();
    let ended = Mutex::new(ended);
    let mut raised: Option<PyErr> = None;
    let done = std::thread::scope(|scope| {
        let watch = &watch;
        let worker = scope.spawn(move || {
            let done = catch_unwind(AssertUnwindSafe(|| pool.install(|| work(watch))));
            // The receiver exists unless the process is ending.
            let _ = sender.send(());
            done
        });
        let mut reported: Option<State> = None;
        loop {
            let ended = py.detach(|| {
                let ended = ended.lock().unwrap_or_else(PoisonError::into_inner);
                ended.recv_timeout(LOOK_EVERY) != Err(RecvTimeoutError::Timeout)
            });
            if raised.is_none() {
                let state = *watch.state();
                raised = py.check_signals().err().or_else(|| match (&progress, state) {
                    (Some(call), Some(now)) if reported != state => {
                        reported = state;
                        call.call1(py, now).err()
                    }
                    _ => None,
                });
                watch.stop.store(raised.is_some(), Ordering::Relaxed);
            }
            if ended {
                break;
            }
        }
        match py.detach(|| worker.join()) {
            Ok(done) => done,
            Err(payload) => Err(payload),
        }
    });
    match (done, raised) {
        (Err(payload), _) if !payload.is::<Stopped>() => resume_unwind(payload),
        (Ok(Ok(value)), None) => Ok(value),
        (Ok(Err(Failure::Interrupted(line))), Some(error)) if error.is_instance_of::<PyKeyboardInterrupt>(py) => {
            Err(Failure::Interrupted(line))
        }
        (_, Some(error)) => Err(Failure::Python(error)),
        (Ok(Err(failure)), None) => Err(failure),
        (Err(payload), None) => resume_unwind(payload),
    }
}

/// Folders for the finished shards of the stages `names`, inside `folder`.
pub(crate) struct Shards {
    folder: Option<PathBuf>,
    parts: Vec<Option<PartsFolder>>,
}

impl Shards {
    /// Opens and locks the folders: shards of an earlier run are used, or deleted unless `resume` is set.
    pub(crate) fn open(folder: Option<PathBuf>, resume: bool, names: &[&str]) -> Outcome<Shards> {
        let found = if resume { Found::Resume } else { Found::Replace };
        let mut parts = Vec::new();
        for name in names {
            parts.push(match &folder {
                None => None,
                Some(folder) => {
                    let io = |source| plywave::Error::Io { file: folder.display().to_string(), source };
                    std::fs::create_dir_all(folder).map_err(io)?;
                    Some(PartsFolder::open(folder.join(name), found).map_err(|e| Failure::of_run(e, ""))?)
                }
            });
        }
        Ok(Shards { folder, parts })
    }

    /// The folder of a stage.
    pub(crate) fn of(&self, stage: usize) -> Option<&PartsFolder> {
        self.parts.get(stage)?.as_ref()
    }

    /// Warns about dropped shards.
    pub(crate) fn warn(&self, py: Python<'_>) -> Outcome {
        for note in self.parts.iter().flatten().flat_map(PartsFolder::take_notes) {
            let note = std::ffi::CString::new(note.replace('\0', " ")).unwrap_or_default();
            PyErr::warn(py, &py.get_type::<PyUserWarning>(), &note, 2)?;
        }
        Ok(())
    }

    /// Deletes the shards, and the folders unless they contain other files.
    pub(crate) fn remove(self) {
        self.parts.into_iter().flatten().for_each(PartsFolder::remove);
        // A folder with other files stays.
        if let Some(folder) = self.folder {
            let _ = std::fs::remove_dir(folder);
        }
    }
}
