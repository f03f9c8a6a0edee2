//! Long computations cut into shards: one scheduler and one format of parts for simulations, fiber tables,
//! speckle, comparisons and scenes.
//!
//! A [`Job`] has a [`Description`], whose digest identifies it, runs one shard by its number alone, and
//! merges the parts of all shards in fixed order. [`run`] does all of it in one process; [`run_part`] runs a
//! share of the shards and writes them to a file; [`Parts`] collects such files and [`Parts::merge`] computes
//! the output from them. Its bits equal those of [`run`], whatever machines, threads and interruptions made
//! the parts.

mod any;
mod arrays;
mod disk;
mod folder;
mod job;
mod memory;
mod merge;
mod part;
mod runner;

pub use any::{AnyJob, Output};
pub use arrays::{ArrayLayout, Part, Values};
pub use folder::{Found, PartsFolder, block_name};
pub use job::{Description, Done, Job, PART_VERSION, Plan};
pub use merge::Parts;
pub use part::{Entry, PartFile};
pub use runner::{Run, check_parts, run, run_block, run_part};

#[cfg(test)]
mod tests;
