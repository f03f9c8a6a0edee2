//! Simulator of plywave: fiber and ply geometry, path tracing, scattering tables.
//!
//! Yarn spec -> cross section ([`PlySection`]) -> tracer ([`ScrewTracer`] or [`MeshTracer`]) -> [`simulate`]
//! -> `plywave::table::Table`;
//! a yarn of several plies: [`yarn::yarn_table`]. Single fibers by waves: [`wave`].
//! Curves of a cloth: [`cloth`]. A cloth of explicit fibers: [`twin`].
//! For WebAssembly the crate has [`cloth`] and the tracers, and the rest of these is not used.

#![cfg_attr(target_family = "wasm", allow(dead_code))]

pub mod cloth;
#[cfg(not(target_family = "wasm"))]
mod energies;
#[cfg(not(target_family = "wasm"))]
mod energy_grids;
mod error;
mod geometry;
#[cfg(not(target_family = "wasm"))]
mod incidence;
#[cfg(not(target_family = "wasm"))]
mod options;
mod rays;
#[cfg(not(target_family = "wasm"))]
pub mod runs;
#[cfg(not(target_family = "wasm"))]
mod shard;
#[cfg(not(target_family = "wasm"))]
mod simulate;
#[cfg(not(target_family = "wasm"))]
mod target;
#[cfg(not(target_family = "wasm"))]
pub mod twin;
#[cfg(not(target_family = "wasm"))]
pub mod wave;
#[cfg(not(target_family = "wasm"))]
pub mod yarn;

pub use error::SimError;
pub use geometry::{FiberSection, Outline, OutlinePoint, PlySection, TriMesh};
#[cfg(not(target_family = "wasm"))]
pub use options::{SimOptions, TracerKind};
pub use rays::{
    Azimuthal, FiberSurface, Hit, MAX_INTERACTIONS, Medium, MeshResolution, MeshTracer, PathEnd, RoughConductor,
    RoughDielectric, Scattered, ScrewTracer, Surfaces, Trace, Tracer, WALL_OFFSET_UM, Walk2d, Wall, fresnel,
    trace_path, trace_path_among, walk_2d,
};
#[cfg(not(target_family = "wasm"))]
pub use runs::{Found, PartsFolder, Run};
#[cfg(not(target_family = "wasm"))]
pub use simulate::{SimulateJob, simulate, total_paths};
