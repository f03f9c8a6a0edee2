//! The twin of a cloth: path tracing of one periodic repeat with all of its fibers explicit, as the reference
//! of the cloth model. Results are tables of `plywave_tables::twin`.
//!
//! It shares only the curves of the plies and the specs of their fibers with the cloth model. Packed fibers
//! wind in the plies, and rays scatter at their walls by the same walk as in the simulation of a single ply.
//!
//! [`TwinCurves`] describes the cloth and sweeps its fibers along the curves (`rings.rs`, `sweep.rs`); hairs
//! are tubes (`hair_walls.rs`). [`Domain`] has the traced repeats and the pitches that close over them.
//! [`ClothTracer`] traces rays through the infinite repetition, and [`TwinJob`] runs the paths.

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
