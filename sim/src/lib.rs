//! Simulator of plywave: fiber and ply geometry, path tracing, scattering tables.
//!
//! A yarn spec gives a cross section ([`PlySection`]), which a tracer ([`ScrewTracer`] or [`MeshTracer`])
//! uses to [`simulate`] a `plywave_tables::table::Table`. [`yarn::yarn_table`] assembles a yarn of several
//! plies. [`cloth`] makes the curves and the shading tables of a cloth. [`twin`] traces a cloth of explicit
//! fibers. The WebAssembly build has [`cloth`] and the tracers only.

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
pub mod seeds;
#[cfg(not(target_family = "wasm"))]
mod shard;
#[cfg(not(target_family = "wasm"))]
mod simulate;
#[cfg(not(target_family = "wasm"))]
mod target;
#[cfg(not(target_family = "wasm"))]
pub mod twin;
#[cfg(not(target_family = "wasm"))]
pub mod yarn;

pub use error::SimError;
pub use geometry::{FiberSection, Outline, OutlinePoint, PlySection, TriMesh, shape};
#[cfg(not(target_family = "wasm"))]
pub use options::{SimOptions, TracerKind};
pub use rays::{
    Azimuthal, FiberSurface, Hit, MAX_INTERACTIONS, Medium, MeshResolution, MeshTracer, PathEnd, RoughConductor,
    RoughDielectric, Scattered, Scattering, ScrewTracer, Surfaces, Trace, Tracer, WALL_OFFSET_UM, Walk2d, Wall,
    fresnel, trace_path, trace_path_among, walk_2d,
};
#[cfg(not(target_family = "wasm"))]
pub use simulate::{SimulateJob, simulate, total_paths};
