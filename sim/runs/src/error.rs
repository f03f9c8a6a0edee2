//! Errors of runs. Variants hold values; each prints as one line. An error of the job itself is wrapped and
//! can be recovered with its type.

use std::error::Error as StdError;

/// Errors between a job and its output.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// Stopped before the end.
    #[error("stopped with {left} of {total} shards left")]
    Interrupted {
        /// Number of shards that have not been summed.
        left: usize,
        /// Number of all shards.
        total: usize,
    },
    /// Another process runs in the parts folder.
    #[error("{folder}: another run is writing to this output; wait for it, or choose another output")]
    PartsInUse {
        /// The folder.
        folder: String,
    },
    /// The parts folder holds finished shards of the same job, and the caller has not chosen between resuming
    /// and replacing them.
    #[error(
        "{folder}: holds {found} of {total} finished shards of this run; go on with --resume, or delete them with --fresh"
    )]
    PartsFound {
        /// The folder.
        folder: String,
        /// Number of finished shards.
        found: usize,
        /// Number of shards of the job.
        total: usize,
    },
    /// The parts folder holds finished shards of another job.
    #[error(
        "{folder}: holds shards of another run (its spec, options, seed or version differ); choose another output, or delete them with --fresh"
    )]
    PartsOfAnotherRun {
        /// The folder.
        folder: String,
    },
    /// A shard computed impossible values.
    #[error("shard {shard}: {what}; the run cannot be saved: change the spec or its sizes")]
    BadShard {
        /// Number of the shard.
        shard: usize,
        /// Description of the error.
        what: String,
    },
    /// The job has fewer shards than parts.
    #[error("--shards = {index}/{count}: the run has {shards} shards; give K/N with 1 <= K <= N <= {shards}")]
    TooManyParts {
        /// Number of the part.
        index: usize,
        /// Number of parts.
        count: usize,
        /// Shards of the job.
        shards: usize,
    },
    /// Parts that cannot be merged into a whole.
    #[error("{}; {hint}", plywave::one_line(what, 1000))]
    Merge {
        /// Description of the error.
        what: String,
        /// What the user can do about it.
        hint: String,
    },
    /// Error of the job itself, such as one of its simulator; [`RunError::job`] recovers its type.
    #[error(transparent)]
    Job(Box<dyn StdError + Send + Sync>),
    /// Error of the runtime: spec, table or file.
    #[error(transparent)]
    Runtime(#[from] plywave::Error),
}

impl RunError {
    /// An error of the job itself.
    pub fn of_job(error: impl StdError + Send + Sync + 'static) -> RunError {
        RunError::Job(Box::new(error))
    }

    /// The error of the job itself, if it is an `E`.
    pub fn job<E: StdError + 'static>(&self) -> Option<&E> {
        match self {
            RunError::Job(error) => error.downcast_ref(),
            _ => None,
        }
    }

    /// Whether the error concerns parts of runs; its message then names their file or folder.
    pub fn is_of_parts(&self) -> bool {
        use RunError::{Merge, PartsFound, PartsInUse, PartsOfAnotherRun};
        matches!(self, PartsInUse { .. } | PartsFound { .. } | PartsOfAnotherRun { .. } | Merge { .. })
    }
}
