//! Simulator of plywave: fiber and ply geometry, path tracing, scattering tables.
//!
//! Yarn spec -> cross section ([`PlySection`]) -> tracer ([`ScrewTracer`] or [`MeshTracer`]) -> [`simulate`]
//! -> `plywave::table::Table`;
//! a yarn of several plies: [`yarn::yarn_table`]. Single fibers by waves: [`wave`].
//! Curves of a cloth: [`cloth`]. A cloth of explicit fibers: [`twin`].

pub mod cloth;
mod energies;
mod energy_grids;
mod error;
mod geometry;
mod incidence;
mod options;
mod rays;
pub mod runs;
mod shard;
mod simulate;
mod target;
pub mod twin;
pub mod wave;
pub mod yarn;

pub use error::SimError;
pub use geometry::{FiberSection, Outline, OutlinePoint, PlySection, TriMesh};
pub use options::{SimOptions, TracerKind};
pub use rays::{
    Azimuthal, FiberSurface, Hit, MAX_INTERACTIONS, Medium, MeshResolution, MeshTracer, PathEnd, RoughConductor,
    RoughDielectric, Scattered, ScrewTracer, Surfaces, Trace, Tracer, WALL_OFFSET_UM, Walk2d, Wall, fresnel,
    trace_path, trace_path_among, walk_2d,
};
pub use runs::{Found, PartsFolder, Run};
pub use simulate::{SimulateJob, simulate, total_paths};
