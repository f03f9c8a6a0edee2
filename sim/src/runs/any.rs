//! Parts of any kind of job, merged into the output of that kind.

use super::merge::Parts;
use crate::error::SimError;
use crate::simulate::SimulateJob;
use crate::twin::TwinJob;
use crate::wave::{CompareJob, CompareReport, Report, ScatterJob, SpeckleJob, TabulateJob};
use plywave::fiber::FiberTable;
use plywave::speckle::SpecklePatterns;
use plywave::table::Table;
use plywave::twin::ClothTwin;

/// What a job makes.
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

impl Parts {
    /// The output of the job that the parts are of, made anew from their description.
    ///
    /// # Errors
    /// As [`Parts::merge`], and those of the spec in the parts.
    pub fn output(&self) -> Result<Output, SimError> {
        let (job, extent) = (self.description(), self.extent());
        Ok(match job.kind.as_str() {
            "simulate" => Output::Table(Box::new(self.merge(&SimulateJob::of(job)?)?)),
            "tabulate" => Output::Fiber(Box::new(self.merge(&TabulateJob::of(job)?)?)),
            "speckle" => Output::Speckle(Box::new(self.merge(&SpeckleJob::of(job, extent)?)?)),
            "compare" => Output::Compare(Box::new(self.merge(&CompareJob::of(job, extent)?)?)),
            "scatter" => Output::Scatter(Box::new(self.merge(&ScatterJob::of(job)?)?)),
            "twin" => Output::Twin(Box::new(self.merge(&TwinJob::of(job)?)?)),
            other => {
                return Err(SimError::Merge {
                    what: format!("parts of kind {other:?}"),
                    hint: "this program knows simulate, tabulate, speckle, compare, scatter and twin".into(),
                });
            }
        })
    }
}
