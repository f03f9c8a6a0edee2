//! The twin of a cloth: path tracing of one periodic repeat with all explicit fibers, without a model
//! (`plywave::twin`).
//!
//! It shares only the curves of the plies and the specs of their fibers with the cloth model: packed fibers
//! wind in the plies, and rays scatter at the fibers' walls by the same walk as in the simulation of a single
//! ply.
//!
//! [`TwinCurves`] describes the cloth and sweeps its fibers, [`Domain`] has the traced repeats and the
//! pitches that close over them, `sweep.rs` has the rings about outlines, `hair_walls.rs` the walls of
//! hairs, [`ClothTracer`] traces rays through
//! the infinite repetition, and [`TwinJob`] runs the paths.

mod curves;
mod domain;
mod hair_walls;
mod job;
mod options;
mod rings;
mod shard;
mod sweep;
#[cfg(test)]
mod tests;
mod tracer;

pub use curves::TwinCurves;
pub use domain::{Domain, PitchUsed};
pub use job::{TwinJob, TwinSize, twin};
pub use options::{TwinMesh, TwinOptions, direction, standard_views};
pub use sweep::ThreadOfFiber;
pub use tracer::{ClothTracer, LeftFibers, LightsOfFibers};
