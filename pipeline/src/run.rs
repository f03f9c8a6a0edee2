//! Conditions under which a recipe runs: folders of parts, progress, stop flag.

use crate::error::Error;
use plywave_runs::PartsFolder;
use std::sync::atomic::{AtomicBool, Ordering};

/// Stage of the work that progress counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Paths of the simulation.
    Simulate,
    /// Incidences of the yarn's table.
    Yarn,
    /// Blocks of f_high slices.
    FitHigh,
    /// Slices of f_refl.
    FitReflection,
    /// Slices of the model compared with the table's.
    FitErrors,
    /// Fibers whose speckle is solved.
    Speckle,
    /// Steps in which the yarns of a cloth relax.
    Curves,
    /// A further step of a cloth's precomputation, by its name; it is not subdivided.
    Cloth(&'static str),
    /// Directions of an export.
    Export,
}

impl Stage {
    /// Name of the stage.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Simulate => "simulate",
            Stage::Yarn => "yarn",
            Stage::FitHigh => "fit high",
            Stage::FitReflection => "fit refl",
            Stage::FitErrors => "errors",
            Stage::Speckle => "speckle",
            Stage::Curves => "curves",
            Stage::Cloth(step) => step,
            Stage::Export => "export",
        }
    }

    /// Unit that is counted.
    pub fn unit(self) -> &'static str {
        match self {
            Stage::Simulate => "paths",
            Stage::Yarn => "incidences",
            Stage::FitHigh | Stage::FitReflection | Stage::FitErrors => "slices",
            Stage::Speckle => "fibers",
            Stage::Curves => "parts",
            Stage::Cloth(_) => "parts",
            Stage::Export => "directions",
        }
    }

    /// Whether the stage checks the stop flag while it runs and saves its finished shards.
    pub fn is_stoppable(self) -> bool {
        matches!(self, Stage::Simulate | Stage::Speckle)
    }
}

/// Progress of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Stage that is counted.
    pub stage: Stage,
    /// Units done.
    pub done: u64,
    /// Total number of units.
    pub total: u64,
}

/// Conditions under which a recipe runs. None of them changes the result.
#[derive(Clone, Copy, Default)]
pub struct Run<'a> {
    /// Folder for finished shards of the simulation; `None` stores them in memory only.
    pub parts: Option<&'a PartsFolder>,
    /// Folder for finished shards of the speckle solver.
    pub speckle_parts: Option<&'a PartsFolder>,
    /// A flag that stops the run with [`Error::Interrupted`]: at once in [stoppable](Stage::is_stoppable)
    /// stages, else after the stage.
    pub stop: Option<&'a AtomicBool>,
    /// Receives the progress; called from any thread.
    pub progress: Option<&'a (dyn Fn(Progress) + Sync)>,
}

impl Run<'_> {
    /// A run in memory, without progress reports or a stop flag.
    pub fn plain() -> Run<'static> {
        Run::default()
    }

    pub(crate) fn report(&self, progress: Progress) {
        if let Some(tell) = self.progress {
            tell(progress);
        }
    }

    /// Returns [`Error::Interrupted`] if the stop flag is set.
    pub(crate) fn check_stop(&self) -> Result<(), Error> {
        match self.stop {
            Some(stop) if stop.load(Ordering::Relaxed) => Err(Error::Interrupted { left: 0, total: 0 }),
            _ => Ok(()),
        }
    }
}
