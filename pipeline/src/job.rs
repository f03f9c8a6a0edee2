//! Jobs of any kind, rebuilt from their descriptions: a worker runs their shards, and any program with the
//! parts merges them.

use plywave_fiber::FiberTable;
use plywave_runs::{Description, PartFile, Parts, Plan, Run, RunError, run, run_block};
use plywave_sim::SimulateJob;
use plywave_sim::twin::TwinJob;
use plywave_tables::speckle::SpecklePatterns;
use plywave_tables::table::Table;
use plywave_tables::twin::ClothTwin;
use plywave_wave::{CompareJob, CompareReport, Report, ScatterJob, SpeckleJob, TabulateJob};
use std::ops::Range;

/// Result of a job, by kind.
pub enum Output {
    /// Result of "simulate".
    Table(Box<Table>),
    /// Result of "tabulate".
    Fiber(Box<FiberTable>),
    /// Result of "speckle".
    Speckle(Box<SpecklePatterns>),
    /// Result of "compare".
    Compare(Box<CompareReport>),
    /// Result of "scatter".
    Scatter(Box<Report>),
    /// Result of "twin".
    Twin(Box<ClothTwin>),
}

/// A job of any kind.
pub struct AnyJob(JobKind);

enum JobKind {
    Simulate(Box<SimulateJob>),
    Tabulate(Box<TabulateJob<'static>>),
    Speckle(Box<SpeckleJob>),
    Compare(Box<CompareJob<'static>>),
    Scatter(Box<ScatterJob<'static>>),
    Twin(Box<TwinJob>),
}

/// Evaluates an expression for a job of any kind.
macro_rules! each {
    ($self:ident, $job:ident => $does:expr) => {
        match &$self.0 {
            JobKind::Simulate($job) => $does,
            JobKind::Tabulate($job) => $does,
            JobKind::Speckle($job) => $does,
            JobKind::Compare($job) => $does,
            JobKind::Scatter($job) => $does,
            JobKind::Twin($job) => $does,
        }
    };
}

impl AnyJob {
    /// Rebuilds a job from its description; `extent` is [`plywave_runs::Shards::extent`].
    ///
    /// # Errors
    /// [`RunError::Merge`] for an unknown kind or unknown options, and those of the spec.
    pub fn from_description(description: &Description, extent: u64) -> Result<AnyJob, RunError> {
        Ok(AnyJob(match description.kind.as_str() {
            "simulate" => JobKind::Simulate(Box::new(SimulateJob::from_description(description)?)),
            "tabulate" => JobKind::Tabulate(Box::new(TabulateJob::from_description(description)?)),
            "speckle" => JobKind::Speckle(Box::new(SpeckleJob::from_description(description, extent)?)),
            "compare" => JobKind::Compare(Box::new(CompareJob::from_description(description, extent)?)),
            "scatter" => JobKind::Scatter(Box::new(ScatterJob::from_description(description)?)),
            "twin" => JobKind::Twin(Box::new(TwinJob::from_description(description)?)),
            other => {
                return Err(RunError::Merge {
                    what: format!("parts of kind {other:?}"),
                    hint: "this program knows simulate, tabulate, speckle, compare, scatter and twin".into(),
                });
            }
        }))
    }

    /// Rebuilds a job from a [`Description::text`], to run its shards in this program.
    ///
    /// # Errors
    /// Those of [`AnyJob::from_description`], and [`RunError::Merge`] for a description by another version of
    /// the program.
    pub fn of_text(text: &str, extent: u64) -> Result<AnyJob, RunError> {
        let refuse = |what: String, hint: &str| RunError::Merge { what, hint: hint.into() };
        let description: Description = serde_json::from_str(text)
            .map_err(|e| refuse(format!("the description of a job cannot be read: {e}"), "give that of a plan"))?;
        let (requested, ours) = (description.program_version.as_str(), env!("CARGO_PKG_VERSION"));
        if requested != ours {
            let what = format!("shards of plywave {requested} cannot be run by plywave {ours}");
            return Err(refuse(what, "install one version everywhere"));
        }
        let job = AnyJob::from_description(&description, extent)?;
        if job.plan().description != description {
            return Err(refuse("the description of a job is not this program's".into(), "give that of a plan"));
        }
        Ok(job)
    }

    /// The job's plan, which takes little memory.
    pub fn plan(&self) -> Plan {
        each!(self, job => Plan::from_job(&**job))
    }

    /// Runs one shard, or one group of shards, and returns the bytes of its file in a parts folder
    /// ([`plywave_runs::block_name`]).
    ///
    /// # Errors
    /// Those of [`run_block`].
    pub fn run_block(&self, shards: Range<usize>, run: Run<'_>) -> Result<Vec<u8>, RunError> {
        each!(self, job => run_block(&**job, shards, run))
    }

    /// Checks that the bytes are an undamaged file of these shards of this job, with plausible values.
    ///
    /// # Errors
    /// [`RunError::Merge`] for the parts of another job or other shards; those of [`PartFile::from_bytes`]
    /// and [`PartFile::entry`].
    pub fn check_block(&self, shards: Range<usize>, bytes: Vec<u8>, name: &str) -> Result<(), RunError> {
        let file = PartFile::from_bytes(bytes, name)?;
        if file.digest() != self.plan().digest || !file.entries().eq([(shards.start, shards.len())]) {
            return Err(RunError::Merge {
                what: format!("{name}: not shards {} to {} of this job", shards.start, shards.end.saturating_sub(1)),
                hint: "run them again".into(),
            });
        }
        each!(self, job => file.entry(&**job, 0).map(|_| ()))
    }

    /// Runs all shards that the folder of `options` does not contain, and merges all shards.
    ///
    /// # Errors
    /// Those of [`plywave_runs::run`].
    pub fn run(&self, options: Run<'_>) -> Result<Output, RunError> {
        Ok(match &self.0 {
            JobKind::Simulate(job) => Output::Table(Box::new(run(&**job, options)?)),
            JobKind::Tabulate(job) => Output::Fiber(Box::new(run(&**job, options)?)),
            JobKind::Speckle(job) => Output::Speckle(Box::new(run(&**job, options)?)),
            JobKind::Compare(job) => Output::Compare(Box::new(run(&**job, options)?)),
            JobKind::Scatter(job) => Output::Scatter(Box::new(run(&**job, options)?)),
            JobKind::Twin(job) => Output::Twin(Box::new(run(&**job, options)?)),
        })
    }

    fn merge(&self, parts: &Parts) -> Result<Output, RunError> {
        Ok(match &self.0 {
            JobKind::Simulate(job) => Output::Table(Box::new(parts.merge(&**job)?)),
            JobKind::Tabulate(job) => Output::Fiber(Box::new(parts.merge(&**job)?)),
            JobKind::Speckle(job) => Output::Speckle(Box::new(parts.merge(&**job)?)),
            JobKind::Compare(job) => Output::Compare(Box::new(parts.merge(&**job)?)),
            JobKind::Scatter(job) => Output::Scatter(Box::new(parts.merge(&**job)?)),
            JobKind::Twin(job) => Output::Twin(Box::new(parts.merge(&**job)?)),
        })
    }
}

/// Merges parts; their job is rebuilt from the description.
///
/// # Errors
/// Those of [`Parts::merge`], and those of the spec in the parts.
pub fn merge_parts(parts: &Parts) -> Result<Output, RunError> {
    AnyJob::from_description(parts.description(), parts.extent())?.merge(parts)
}
