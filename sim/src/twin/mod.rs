//! The twin of a cloth: path tracing of one periodic repeat with all explicit fibers, without a model
//! (`plywave::twin`).
//!
//! It shares only the spec and the center lines of the yarns with the cloth model: plies wind about the
//! yarns, packed fibers wind in the plies, and rays scatter at the fibers' walls by the same walk as in the
//! simulation of a single ply.
//!
//! [`TwinCloth`] describes the cloth of a fabric spec, [`TwinCurves`] one of curves, [`Domain`] has the
//! traced repeats and the pitches that close over them, `sweep.rs` builds triangles, [`ClothTracer`] traces
//! rays through their infinite repetition, and [`TwinJob`] runs the paths.

mod cloth;
mod curves;
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
pub use curves::TwinCurves;
pub use domain::{Domain, PitchUsed};
pub use job::{TwinJob, TwinSize, TwinSource, twin};
pub use options::{TwinMesh, TwinOptions, direction, standard_views};
pub use sweep::ThreadOfFiber;
pub use tracer::ClothTracer;
