//! Errors of the pipeline. Each prints as one line.

use plywave_runs::RunError;
use plywave_sim::SimError;

/// Errors between a spec and a model.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The run of shards was stopped; the finished shards are in the parts folder, if there is one.
    #[error("stopped with {left} of {total} shards left")]
    Interrupted {
        /// Remaining shards.
        left: usize,
        /// Shards of the stage.
        total: usize,
    },
    /// The simulator failed.
    #[error("{file}: {source}")]
    Simulation {
        /// The spec's name.
        file: String,
        /// The error.
        source: RunError,
    },
    /// A run's folder of parts, one of its files, or their merge is invalid. The message names the file.
    #[error(transparent)]
    Parts(RunError),
    /// The fit failed.
    #[error("{file}: {source}")]
    Fit {
        /// The table's or spec's name.
        file: String,
        /// The error.
        source: plywave_fit::FitError,
    },
    /// A spec, table, model or file is invalid. The message names it.
    #[error(transparent)]
    Runtime(#[from] plywave::Error),
    /// An export is impossible.
    #[error("{file}: {what}")]
    Export {
        /// The file.
        file: String,
        /// Reason.
        what: String,
    },
    /// An override refers to a key that the spec does not contain.
    #[error("{file}: {key} = (absent): a recipe changes keys that are there; add the key to the spec")]
    NoSuchKey {
        /// The spec's name.
        file: String,
        /// The key.
        key: String,
    },
}

impl Error {
    /// Error of a simulation or its run for the spec `file`.
    pub fn of_simulation(error: impl Into<RunError>, file: &str) -> Error {
        match error.into() {
            RunError::Interrupted { left, total } => Error::Interrupted { left, total },
            RunError::Runtime(error) => Error::Runtime(error),
            error if matches!(error.job(), Some(SimError::Stopped)) => Error::Interrupted { left: 0, total: 0 },
            error if error.is_of_parts() => Error::Parts(error),
            source => Error::Simulation { file: file.into(), source },
        }
    }
}
