//! Jobs of any kind, rebuilt from their descriptions to run shards elsewhere and to merge parts.

use super::job::{Description, Plan};
use super::merge::Parts;
use super::part::PartFile;
use super::runner::{Run, run, run_block};
use crate::error::SimError;
use crate::simulate::SimulateJob;
use crate::twin::TwinJob;
use crate::wave::{CompareJob, CompareReport, Report, ScatterJob, SpeckleJob, TabulateJob};
use plywave::fiber::FiberTable;
use plywave::speckle::SpecklePatterns;
use plywave::table::Table;
use plywave::twin::ClothTwin;
use std::ops::Range;

/// Output of a job.
pub enum Output {
    /// Of "simulate".
    Table(Box<Table>),
    /// Of "tabulate".
    Fiber(Box<FiberTable>),
    /// Of "speckle".
    Speckle(Box<SpecklePatterns>),
    /// Of "compare".
    Compare(Box<CompareReport>),
    /// Of "scatter".
    Scatter(Box<Report>),
    /// Of "twin".
    Twin(Box<ClothTwin>),
}

/// A job of any kind.
pub struct AnyJob(Kind);

enum Kind {
    Simulate(Box<SimulateJob>),
    Tabulate(Box<TabulateJob<'static>>),
    Speckle(Box<SpeckleJob>),
    Compare(Box<CompareJob<'static>>),
    Scatter(Box<ScatterJob<'static>>),
    Twin(Box<TwinJob>),
}

/// Evaluates the same expression for a job of any kind.
macro_rules! each {
    ($self:ident, $job:ident => $does:expr) => {
        match &$self.0 {
            Kind::Simulate($job) => $does,
            Kind::Tabulate($job) => $does,
            Kind::Speckle($job) => $does,
            Kind::Compare($job) => $does,
            Kind::Scatter($job) => $does,
            Kind::Twin($job) => $does,
        }
    };
}

impl AnyJob {
    /// The job of a description; `extent` is [`super::Job::extent`].
    ///
    /// # Errors
    /// [`SimError::Merge`] for a kind or options that this program does not know, and those of the spec.
    pub fn from_description(description: &Description, extent: u64) -> Result<AnyJob, SimError> {
        Ok(AnyJob(match description.kind.as_str() {
            "simulate" => Kind::Simulate(Box::new(SimulateJob::from_description(description)?)),
            "tabulate" => Kind::Tabulate(Box::new(TabulateJob::from_description(description)?)),
            "speckle" => Kind::Speckle(Box::new(SpeckleJob::from_description(description, extent)?)),
            "compare" => Kind::Compare(Box::new(CompareJob::from_description(description, extent)?)),
            "scatter" => Kind::Scatter(Box::new(ScatterJob::from_description(description)?)),
            "twin" => Kind::Twin(Box::new(TwinJob::from_description(description)?)),
            other => {
                return Err(SimError::Merge {
                    what: format!("parts of kind {other:?}"),
                    hint: "this program knows simulate, tabulate, speckle, compare, scatter and twin".into(),
                });
            }
        }))
    }

    /// The job of a [`Description::text`], for shards that this program runs.
    ///
    /// # Errors
    /// As [`AnyJob::from_description`], and [`SimError::Merge`] for the description of another version of the
    /// program.
    pub fn of_text(text: &str, extent: u64) -> Result<AnyJob, SimError> {
        let refuse = |what: String, hint: &str| SimError::Merge { what, hint: hint.into() };
        let description: Description = serde_json::from_str(text)
            .map_err(|e| refuse(format!("the description of a job cannot be read: {e}"), "give that of a plan"))?;
        let (asked, ours) = (description.program_version.as_str(), env!("CARGO_PKG_VERSION"));
        if asked != ours {
            let what = format!("shards of plywave {asked} cannot be run by plywave {ours}");
            return Err(refuse(what, "install one version everywhere"));
        }
        let job = AnyJob::from_description(&description, extent)?;
        if job.plan().description != description {
            return Err(refuse("the description of a job is not this program's".into(), "give that of a plan"));
        }
        Ok(job)
    }

    /// The job's plan, which is cheap to hold.
    pub fn plan(&self) -> Plan {
        each!(self, job => Plan::from_job(&**job))
    }

    /// Runs one shard, or one group of shards, and returns the bytes of its file in a parts folder
    /// ([`super::block_name`]).
    ///
    /// # Errors
    /// As [`run_block`].
    pub fn run_block(&self, shards: Range<usize>, run: Run<'_>) -> Result<Vec<u8>, SimError> {
        each!(self, job => run_block(&**job, shards, run))
    }

    /// Checks that the bytes are an undamaged file of these shards of this job, with possible values.
    ///
    /// # Errors
    /// [`SimError::Merge`] for the parts of another job or other shards, those of [`PartFile::from_bytes`]
    /// and [`PartFile::entry`].
    pub fn check_block(&self, shards: Range<usize>, bytes: Vec<u8>, name: &str) -> Result<(), SimError> {
        let file = PartFile::from_bytes(bytes, name)?;
        if file.digest() != self.plan().digest || !file.entries().eq([(shards.start, shards.len())]) {
            return Err(SimError::Merge {
                what: format!("{name}: not shards {} to {} of this job", shards.start, shards.end.saturating_sub(1)),
                hint: "run them again".into(),
            });
        }
        each!(self, job => file.entry(&**job, 0).map(|_| ()))
    }

    /// Runs all shards that are not in the folder of `how`, and merges all.
    ///
    /// # Errors
    /// As [`super::run`].
    pub fn run(&self, how: Run<'_>) -> Result<Output, SimError> {
        Ok(match &self.0 {
            Kind::Simulate(job) => Output::Table(Box::new(run(&**job, how)?)),
            Kind::Tabulate(job) => Output::Fiber(Box::new(run(&**job, how)?)),
            Kind::Speckle(job) => Output::Speckle(Box::new(run(&**job, how)?)),
            Kind::Compare(job) => Output::Compare(Box::new(run(&**job, how)?)),
            Kind::Scatter(job) => Output::Scatter(Box::new(run(&**job, how)?)),
            Kind::Twin(job) => Output::Twin(Box::new(run(&**job, how)?)),
        })
    }

    fn merge(&self, parts: &Parts) -> Result<Output, SimError> {
        Ok(match &self.0 {
            Kind::Simulate(job) => Output::Table(Box::new(parts.merge(&**job)?)),
            Kind::Tabulate(job) => Output::Fiber(Box::new(parts.merge(&**job)?)),
            Kind::Speckle(job) => Output::Speckle(Box::new(parts.merge(&**job)?)),
            Kind::Compare(job) => Output::Compare(Box::new(parts.merge(&**job)?)),
            Kind::Scatter(job) => Output::Scatter(Box::new(parts.merge(&**job)?)),
            Kind::Twin(job) => Output::Twin(Box::new(parts.merge(&**job)?)),
        })
    }
}

impl Parts {
    /// The merged output of the parts; their job is rebuilt from the description.
    ///
    /// # Errors
    /// As [`Parts::merge`], and those of the spec in the parts.
    pub fn output(&self) -> Result<Output, SimError> {
        AnyJob::from_description(self.description(), self.extent())?.merge(self)
    }
}
