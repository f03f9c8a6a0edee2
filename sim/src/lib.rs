//! Simulator of plywave: fiber and ply geometry, path tracing, scattering tables.
//!
//! Yarn spec -> cross section ([`PlySection`]) -> tracer ([`ScrewTracer`] or [`MeshTracer`]) -> [`simulate`] -> `plywave::Table`.

mod dielectric;
mod error;
mod mesh;
mod mesh_tracer;
mod options;
mod outline;
mod packing;
mod path;
pub mod runs;
mod screw;
mod section;
mod shape;
mod shard;
mod simulate;
mod target;
mod tracer;
mod walk2d;
pub mod wave;

pub use dielectric::{RoughDielectric, Scattered, fresnel};
pub use error::SimError;
pub use mesh::TriMesh;
pub use mesh_tracer::{MeshResolution, MeshTracer};
pub use options::{SimOptions, TracerKind};
pub use outline::{Outline, OutlinePoint};
pub use path::{MAX_INTERACTIONS, PathEnd, trace_path};
pub use runs::{Found, PartsFolder, Run};
pub use screw::ScrewTracer;
pub use section::{FiberSection, PlySection};
pub use simulate::{SimulateJob, simulate, total_paths};
pub use tracer::{Hit, Medium, Trace, Tracer, WALL_OFFSET_UM};
pub use walk2d::{Azimuthal, Walk2d, walk_2d};
