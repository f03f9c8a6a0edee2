//! Long computations in shards: the scheduler of all simulations of plywave, and their file of parts.
//!
//! [`Shards`] have a [`Description`], whose digest identifies them, and each shard runs independently by its
//! number. A [`Job`] merges the parts of all shards in fixed order. [`run`] does both in one process, and can
//! resume from a [`PartsFolder`]. [`run_part`] runs a share of the shards and writes them to a file;
//! [`Parts`] collects such files, and [`Parts::merge`] computes the output from them. Its bits equal those of
//! [`run`] for any machines, threads and interruptions that produced the parts.

mod arrays;
mod disk;
mod error;
mod folder;
mod job;
pub mod memory;
mod merge;
mod part;
mod runner;

pub use arrays::{ArrayLayout, Part, Values};
pub use error::RunError;
pub use folder::{Found, PartsFolder, block_name};
pub use job::{Description, Done, Job, PART_VERSION, Plan, Shards};
pub use merge::Parts;
pub use part::{Entry, PartFile};
pub use runner::{Run, check_parts, run, run_block, run_part};

#[cfg(test)]
mod tests;
