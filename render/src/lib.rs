//! Reference host of plywave: a small spectral path tracer for a sheet of cloth, which exercises every part
//! of the shading model in a real renderer.
//!
//! A path carries four wavelengths. The camera ray takes the role of the beam of the ply model: at its hit
//! point on the cloth it fixes the latitude and the offset on the ply, and `f(w)`, which includes the cosine
//! of the light's direction, weights the light that arrives from `w`. Direct light combines sampling of the
//! sources with sampling of the scattering function by the power heuristic (Veach 1997, 9.2). Cloth is thin:
//! a path continues on either side of it.
//!
//! Not implemented: subsurface and volumes, textures other than the weave, depth of field, denoising.

mod camera;
mod cloth;
mod explicit_fibers;
mod exposure;
mod film;
mod light;
mod memory_limit;
mod numbers;
mod path;
mod picture;
mod roulette;
mod scene;
mod setup;
mod sky;
mod spectrum;
mod strands;
mod surface;
mod uv_places;

pub use camera::{Camera, View};
pub use explicit_fibers::{Exit, ExplicitFibers, Lamps, render_matter};
pub use film::{Film, FilmView, Ingredients};
pub use light::{Light, LightSampling};
pub use numbers::PathNumbers;
pub use path::{RenderOptions, render};
pub use picture::{Facts, png};
pub use roulette::MAX_SCATTERINGS;
pub use scene::{Frame, Scene, SurfacePoint};
pub use setup::Setup;
pub use sky::environment::Environment;
pub use spectrum::LAMBDA_RANGE_UM;
pub use strands::{
    Basis, GeneratedStrands, MAX_MM, MAX_POINTS, MIN_RADIUS_MM, Skip, StrandDual, StrandDualOptions, StrandFiber,
    StrandFile, StrandHit, StrandNotes, StrandScene, StrandShape, StrandTree, Strands, TraceCost, make, mitsuba_text,
    render_strands, render_strands_dual,
};
pub use surface::import::{FaceCount, MeshNotes};
pub use surface::mesh::Mesh;
pub use surface::props::{Prop, Shape};

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
    /// The host stopped the render.
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
/// `wo` is the unit direction towards the camera, back along the path, in the surface's frame: x and y along
/// the cloth's u and v, z its normal. The scattering function takes the direction towards the light in the
/// same frame and includes its cosine.
pub trait Surface: Sync {
    /// The scattering function at one query.
    type At<'a>: plywave::Bsdf<WAVELENGTHS>
    where
        Self: 'a;

    /// The scattering function at the position `uv_um` on the cloth [um], averaged over a footprint of
    /// diameter `footprint_um` [um], for the unit direction `wo` towards the camera and the wavelengths
    /// `lambda_um` [um].
    fn at(&self, uv_um: [f32; 2], footprint_um: f32, wo: [f32; 3], lambda_um: [f32; WAVELENGTHS]) -> Self::At<'_>;
}
