//! Errors of the pipeline. Each prints as one line.

use plywave_sim::SimError;

/// What can go wrong between a spec and a model.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A run of shards was stopped; what is finished is in the parts folder, where there is one.
    #[error("stopped with {left} of {total} shards left")]
    Interrupted {
        /// Shards that are left.
        left: usize,
        /// Shards of the stage.
        total: usize,
    },
    /// Something of the simulator.
    #[error("{file}: {source}")]
    Simulation {
        /// The spec's name.
        file: String,
        /// What it is.
        source: SimError,
    },
    /// A run's folder of parts, its files, or parts that do not make a whole: the message names the file.
    #[error(transparent)]
    Parts(SimError),
    /// Something of the fit.
    #[error("{file}: {source}")]
    Fit {
        /// The table's or spec's name.
        file: String,
        /// What it is.
        source: plywave_fit::FitError,
    },
    /// A spec, a table, a model or a file that is not as it must be: the message names it.
    #[error(transparent)]
    Runtime(#[from] plywave::Error),
    /// A change of a spec's key that the spec does not have.
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
            SimError::Runtime(error) => Error::Runtime(error),
            error @ (SimError::PartsInUse { .. }
            | SimError::PartsFound { .. }
            | SimError::PartsOfAnotherRun { .. }
            | SimError::Merge { .. }) => Error::Parts(error),
            source => Error::Simulation { file: file.into(), source },
        }
    }
}
