//! Simulator of plywave.

mod error;
mod outline;
mod packing;
mod section;
mod shape;

pub use error::SimError;
pub use outline::{Outline, OutlinePoint};
pub use section::{FiberSection, PlySection};
