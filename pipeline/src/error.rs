//! Errors of the pipeline. Each prints as one line.

use plywave_sim::SimError;

/// Errors between a spec and a model.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A run of shards was stopped; finished shards are in the parts folder, if there is one.
    #[error("stopped with {left} of {total} shards left")]
    Interrupted {
        /// Remaining shards.
        left: usize,
        /// Shards of the stage.
        total: usize,
    },
    /// Error of the simulator.
    #[error("{file}: {source}")]
    Simulation {
        /// The spec's name.
        file: String,
        /// The error.
        source: SimError,
    },
    /// Error of a run's folder of parts, its files, or their merge. The message names the file.
    #[error(transparent)]
    Parts(SimError),
    /// Error of the fit.
    #[error("{file}: {source}")]
    Fit {
        /// The table's or spec's name.
        file: String,
        /// The error.
        source: plywave_fit::FitError,
    },
    /// Invalid spec, table, model or file. The message names it.
    #[error(transparent)]
    Runtime(#[from] plywave::Error),
    /// An export that cannot be made.
    #[error("{file}: {what}")]
    Export {
        /// The file.
        file: String,
        /// Why.
        what: String,
    },
    /// An override of a key that the spec does not have.
    #[error("{file}: {key} = (absent): a recipe changes keys that are there; add the key to the spec")]
    NoSuchKey {
        /// The spec's name.
        file: String,
        /// The key.
        key: String,
    },
}

impl Error {
    /// An error of the simulator about the spec `file`.
    pub fn of_simulation(error: SimError, file: &str) -> Error {
        match error {
            SimError::Interrupted { left, total } => Error::Interrupted { left, total },
            SimError::Stopped => Error::Interrupted { left: 0, total: 0 },
            SimError::Runtime(error) => Error::Runtime(error),
            error @ (SimError::PartsInUse { .. }
            | SimError::PartsFound { .. }
            | SimError::PartsOfAnotherRun { .. }
            | SimError::Merge { .. }) => Error::Parts(error),
            source => Error::Simulation { file: file.into(), source },
        }
    }
}
