//! The twin of a cloth: path tracing of one periodic repeat with every fiber there, no model in between
//! (`plywave::twin`).
//!
//! What it shares with the cloth model is the spec and the center lines of the yarns, and nothing else: plies
//! wind about the yarns, packed fibers wind in the plies, and rays scatter at the fibers' walls by the same
//! walk as in the simulation of a single ply.
//!
//! [`TwinCloth`] says what is there, [`Domain`] how many repeats are traced and which pitches close over
//! them, `sweep.rs` makes triangles of it,
//! [`ClothTracer`] follows rays through them without end, [`TwinJob`] runs the paths.

mod cloth;
mod domain;
mod job;
mod options;
mod shard;
mod strand;
mod sweep;
#[cfg(test)]
mod tests;
mod tracer;

pub use cloth::{OVERLAP_TOLERANCE_UM, TwinCloth};
pub use domain::{Domain, PitchUsed};
pub use job::{TwinJob, TwinSize, twin};
pub use options::{TwinMesh, TwinOptions, direction, standard_views};
pub use sweep::ThreadOfFiber;
pub use tracer::ClothTracer;
