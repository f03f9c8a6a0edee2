//! Path tracing in a ply: intersection with the next wall, by a march along the screw or by a BVH of
//! triangles; scattering at rough dielectric and opaque walls; the walk of a path in 3D and in 2D.

pub(crate) mod dielectric;
pub(crate) mod mesh_tracer;
pub(crate) mod path;
pub(crate) mod screw;
pub(crate) mod surface;
pub(crate) mod tracer;
pub(crate) mod walk2d;

pub use dielectric::{RoughDielectric, Scattered, fresnel};
pub use mesh_tracer::{MeshResolution, MeshTracer};
pub use path::{MAX_INTERACTIONS, PathEnd, trace_path, trace_path_among};
pub use screw::ScrewTracer;
pub use surface::{FiberSurface, RoughConductor, Scattering, Surfaces, Wall};
pub use tracer::{Hit, Medium, Trace, Tracer, WALL_OFFSET_UM};
pub use walk2d::{Azimuthal, Walk2d, walk_2d};
