//! Solvers for many bodies: each body is compressed to a skeleton, and their coupling is solved whole or by
//! merging groups.

pub(crate) mod basis;
pub(crate) mod compressed;
#[cfg(test)]
mod compressed_tests;
pub(crate) mod coupling;
pub(crate) mod hierarchy;
#[cfg(test)]
mod hierarchy_tests;
pub(crate) mod interpolate;
pub(crate) mod merge;
pub(crate) mod packed;
pub(crate) mod placement;
pub(crate) mod skeleton;
