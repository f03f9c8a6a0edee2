//! Definition of a job: a description that identifies it, shards that can run alone, and a merge in fixed
//! order.

use super::arrays::{ArrayLayout, Part};
use crate::error::RunError;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::sync::atomic::AtomicBool;

/// Version of the part format that this program writes and reads.
pub const PART_VERSION: u64 = 1;

/// All that the shards of a job depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// Version of the part format.
    pub part_version: u64,
    /// Version of the program, whose arithmetic the shards depend on.
    pub program_version: String,
    /// Kind of the job: "simulate", "tabulate", "speckle", "compare", "scatter" or "twin".
    pub kind: String,
    /// Options and seed, without options that only set the number of shards.
    pub options: serde_json::Value,
    /// Text of the spec or scene.
    pub spec: String,
}

impl Description {
    /// A description by this program; `options` is a struct of numbers, strings and lists.
    pub fn new(kind: &str, options: &impl Serialize, spec: &str) -> Description {
        Description {
            part_version: PART_VERSION,
            program_version: env!("CARGO_PKG_VERSION").into(),
            kind: kind.into(),
            options: serde_json::to_value(options).unwrap_or_default(),
            spec: spec.into(),
        }
    }

    /// The options, parsed as those of a job of this kind.
    ///
    /// # Errors
    /// [`RunError::Merge`].
    pub fn parse_options<T: serde::de::DeserializeOwned>(&self) -> Result<T, RunError> {
        serde_json::from_value(self.options.clone()).map_err(|e| RunError::Merge {
            what: format!("the part's options are not those of {}: {e}", self.kind),
            hint: "merge it with the program that wrote it".into(),
        })
    }

    /// Canonical text of the description: JSON without spaces, the keys of `options` sorted, numbers in the
    /// fewest digits that restore them.
    pub fn text(&self) -> String {
        // Serialization cannot fail for strings, numbers and objects with string keys.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// SHA-256 in hexadecimal digits.
pub(super) fn hex_digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A finished shard.
pub struct Done {
    /// Result of the shard.
    pub part: Part,
    /// Peak memory of the shard [bytes]; 0 if it is negligible.
    pub peak_bytes: usize,
}

/// Work that is divided into shards.
///
/// Shard `i` depends on the description and `i` alone. Consecutive shards may form groups, whose parts are
/// added up in their order; the sums of the groups, again in their order, make the output. The bits of the
/// output therefore do not depend on threads, machines or interruptions.
pub trait Shards: Sync {
    /// All that the shards depend on.
    fn description(&self) -> Description;

    /// Number of shards.
    fn shards(&self) -> usize;

    /// Size of the job that determines the number of shards but is not part of the description; for jobs that
    /// can be extended.
    fn extent(&self) -> u64 {
        0
    }

    /// Number of shards of a group.
    fn group(&self) -> usize {
        1
    }

    /// Number of units of progress in a shard.
    fn units(&self, _shard: usize) -> u64 {
        1
    }

    /// Arrays in the part of shard `shard`, or of the group that begins with it.
    fn layout(&self, shard: usize) -> Vec<ArrayLayout>;

    /// Checks, beyond the layout, that the values in the part of shards `first..first + count` are plausible.
    ///
    /// # Errors
    /// A sentence about the impossible value.
    fn check(&self, _first: usize, _count: usize, _part: &Part) -> Result<(), String> {
        Ok(())
    }

    /// Memory of a shard [bytes], if it is known before the first shard runs.
    fn shard_bytes(&self) -> Option<usize> {
        None
    }

    /// Prepares the data that all shards need, once before the first one runs.
    ///
    /// # Errors
    /// Errors of the spec.
    fn prepare(&self) -> Result<(), RunError> {
        Ok(())
    }

    /// Runs one shard; `None` when stopped. `progress` is called with the number of units just finished.
    ///
    /// # Errors
    /// Errors of the solvers.
    fn run_shard(
        &self,
        shard: usize,
        stop: &AtomicBool,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Option<Done>, RunError>;
}

/// Sharded work whose parts are merged into an output.
pub trait Job: Shards {
    /// Result of merging all parts.
    type Output;
    /// Incomplete output.
    type Merge: Send;

    /// The empty output before the first part.
    fn begin(&self) -> Self::Merge;

    /// Adds the part of the group that begins at shard `first`. Called once per group, in order.
    fn absorb(&self, merge: &mut Self::Merge, first: usize, part: Part);

    /// The complete output after the last part.
    ///
    /// # Errors
    /// Errors of parts that do not make a valid output.
    fn finish(&self, merge: Self::Merge) -> Result<Self::Output, RunError>;
}

/// Identity and sizes of a job, without its data.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Description of the job.
    pub description: Description,
    /// SHA-256 of the description's text, in hexadecimal digits: the job's identity.
    pub digest: String,
    /// Number of shards.
    pub shards: usize,
    /// Number of shards of a group.
    pub group: usize,
    /// Extent of the job, see [`Shards::extent`].
    pub extent: u64,
    /// Number of units of progress of all shards.
    pub units: u64,
    /// Number of values of a part.
    pub values: usize,
}

impl Plan {
    /// The plan of a job.
    pub fn from_job(job: &dyn Shards) -> Plan {
        let description = job.description();
        let shards = job.shards();
        Plan {
            digest: hex_digest(description.text().as_bytes()),
            description,
            shards,
            group: job.group().max(1),
            extent: job.extent(),
            units: (0..shards).map(|shard| job.units(shard)).sum(),
            values: job.layout(0).iter().map(ArrayLayout::len).sum(),
        }
    }

    /// The shards of part `index` (from 1) of `count` parts of nearly equal size.
    pub fn slice(&self, index: usize, count: usize) -> std::ops::Range<usize> {
        let at = |k: usize| (self.shards as u128 * k as u128 / count.max(1) as u128) as usize;
        at(index.saturating_sub(1))..at(index)
    }
}

impl std::fmt::Display for Plan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} {}: {} shards in groups of {}, {} values each",
            self.description.kind,
            &self.digest[..16.min(self.digest.len())],
            self.shards,
            self.group,
            self.values
        )
    }
}
