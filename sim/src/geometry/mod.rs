//! Geometry of a ply: outlines of fibers, their packing into a cross section, and triangles of the section
//! swept along the twist.

pub(crate) mod fiber_section;
pub(crate) mod mesh;
pub(crate) mod outline;
pub(crate) mod packing;
mod radial;
pub(crate) mod section;
pub mod shape;

pub use fiber_section::FiberSection;
pub use mesh::TriMesh;
pub use outline::{Outline, OutlinePoint};
pub use section::PlySection;
