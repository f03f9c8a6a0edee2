//! How a recipe is made: where parts are kept, how progress is told, how it is stopped.

use crate::error::Error;
use plywave_sim::runs::PartsFolder;
use std::sync::atomic::{AtomicBool, Ordering};

/// Part of the work that progress counts.
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
    /// Slices of the model against those of the table.
    FitErrors,
    /// Fibers whose speckle is solved.
    Speckle,
}

impl Stage {
    /// A word for it.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Simulate => "simulate",
            Stage::Yarn => "yarn",
            Stage::FitHigh => "fit high",
            Stage::FitReflection => "fit refl",
            Stage::FitErrors => "errors",
            Stage::Speckle => "speckle",
        }
    }

    /// What is counted.
    pub fn unit(self) -> &'static str {
        match self {
            Stage::Simulate => "paths",
            Stage::Yarn => "incidences",
            Stage::FitHigh | Stage::FitReflection | Stage::FitErrors => "slices",
            Stage::Speckle => "fibers",
        }
    }

    /// Whether the stage looks at the stop flag within, and keeps its finished shards.
    pub fn is_stoppable(self) -> bool {
        matches!(self, Stage::Simulate | Stage::Speckle)
    }
}

/// How far a stage is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is counted.
    pub stage: Stage,
    /// Units done.
    pub done: u64,
    /// Units in all.
    pub total: u64,
}

/// How a recipe is made: nothing here changes the result.
#[derive(Clone, Copy, Default)]
pub struct Run<'a> {
    /// Folder for finished shards of the simulation; `None` keeps them in memory only.
    pub parts: Option<&'a PartsFolder>,
    /// The same for solved fibers.
    pub speckle_parts: Option<&'a PartsFolder>,
    /// Set to stop with [`Error::Interrupted`]: at once in stages that are [stoppable](Stage::is_stoppable),
    /// else after the stage.
    pub stop: Option<&'a AtomicBool>,
    /// Called from any thread.
    pub progress: Option<&'a (dyn Fn(Progress) + Sync)>,
}

impl Run<'_> {
    /// In memory, without progress, to the end.
    pub fn plain() -> Run<'static> {
        Run::default()
    }

    pub(crate) fn tell(&self, progress: Progress) {
        if let Some(tell) = self.progress {
            tell(progress);
        }
    }

    pub(crate) fn check_stop(&self) -> Result<(), Error> {
        match self.stop {
            Some(stop) if stop.load(Ordering::Relaxed) => Err(Error::Interrupted { left: 0, total: 0 }),
            _ => Ok(()),
        }
    }
}
