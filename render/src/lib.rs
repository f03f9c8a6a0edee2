//! Reference host of plywave: a small spectral path tracer for a sheet of cloth, which exercises every part
//! of the shading model in a real renderer.
//!
//! Four wavelengths go along a path. The camera ray plays the beam of the ply model: at a point of the cloth
//! it determines latitude and offset on the ply that it hits, and `f(wo)`, which includes the cosine of the
//! light's direction, weights the light from `wo`. Light sources are sampled and hit, weighted by the power
//! heuristic. Cloth is thin: paths continue at either side.
//!
//! Not implemented: subsurface and volumes, textures other than the weave, depth of field, denoising.

mod bvh;
mod camera;
mod cloth;
mod course;
mod drape;
mod film;
mod import;
mod light;
mod matter;
mod mesh;
mod numbers;
mod obj;
mod path;
mod picture;
mod primaries;
mod props;
mod room;
mod scene;
mod setup;
mod sky;
mod sky_exr;
mod sky_file;
mod smooth;
mod spectrum;
mod strands;
mod uv_places;

pub use camera::{Camera, View};
pub use course::MAX_SCATTERINGS;
pub use film::{Film, FilmView, Ingredients};
pub use import::{FaceCount, MeshNotes};
pub use light::{Light, LightSampling};
pub use matter::{Lamps, Leaves, Matter, render_matter};
pub use mesh::Mesh;
pub use numbers::PathNumbers;
pub use path::{RenderOptions, render};
pub use picture::{Facts, png};
pub use props::{Prop, Shape};
pub use scene::{Frame, Scene, SurfacePoint};
pub use setup::Setup;
pub use sky::Environment;
pub use spectrum::LAMBDA_RANGE_UM;
pub use strands::{
    Basis, GeneratedStrands, MAX_MM, MAX_POINTS, MIN_RADIUS_MM, Skip, StrandDual, StrandDualOptions, StrandFiber,
    StrandFile, StrandHit, StrandNotes, StrandScene, StrandShape, StrandTree, Strands, TraceCost, make, mitsuba_text,
    render_strands, render_strands_dual,
};

pub use uv_places::UvPlaces;

/// Wavelengths along a path.
pub const WAVELENGTHS: usize = 4;

/// Errors of a render and its input.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A file cannot be read or written.
    #[error("{file}: {source}")]
    Io {
        /// The file.
        file: String,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A mesh cannot be used.
    #[error("{file}: {}{what}", if *line > 0 { format!("line {line}: ") } else { String::new() })]
    Mesh {
        /// The file.
        file: String,
        /// Line from 1; 0 for the whole file.
        line: usize,
        /// Description of the error.
        what: String,
    },
    /// Strands cannot be read or used.
    #[error("{file}: {what}")]
    Strands {
        /// The file.
        file: String,
        /// Description of the error.
        what: String,
    },
    /// A picture cannot be read, written or resumed.
    #[error("{file}: {what}")]
    Picture {
        /// The file.
        file: String,
        /// Description of the error.
        what: String,
    },
    /// Something does not fit in memory.
    #[error("{what} needs {gib:.1} GiB of memory, more than there is; ask for a smaller one")]
    TooLarge {
        /// Name of the object that is too large.
        what: String,
        /// Required memory [GiB].
        gib: f64,
    },
    /// Stopped by the host.
    #[error("stopped after {done} of {total} samples a pixel; --resume goes on")]
    Stopped {
        /// Samples done.
        done: u32,
        /// Total number of samples.
        total: u32,
    },
}

/// Material of a scene's surface: a scattering function at each point.
///
/// `wo` is the direction back along the path, unit, in the surface's frame: x and y along the cloth's u and
/// v, z its normal. The scattering function takes the other direction, in the same frame, and includes its
/// cosine.
pub trait Surface: Sync {
    /// The scattering function at a point.
    type At<'a>: plywave::Bsdf<WAVELENGTHS>
    where
        Self: 'a;

    /// The scattering function at a position on the cloth [um] with a footprint of this diameter [um], seen
    /// from `wo`, at wavelengths [um].
    fn at(&self, uv_um: [f32; 2], footprint_um: f32, wo: [f32; 3], lambda_um: [f32; WAVELENGTHS]) -> Self::At<'_>;
}
