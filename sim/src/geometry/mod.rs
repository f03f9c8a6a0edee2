//! The geometry of a ply: outlines of fibers, their packing, the cross section, the sweep along the twist as
//! triangles.

pub(crate) mod fiber_section;
pub(crate) mod mesh;
pub(crate) mod outline;
pub(crate) mod packing;
mod radial;
pub(crate) mod section;
pub(crate) mod shape;

pub use fiber_section::FiberSection;
pub use mesh::TriMesh;
pub use outline::{Outline, OutlinePoint};
pub use section::PlySection;
