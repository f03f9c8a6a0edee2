//! plywave: evaluate and sample the far-field scattering of a textile ply (Yu et al. 2025).
//!
//! This crate is the runtime. It reads ply model files and evaluates `eval`, `sample`, `pdf` and `albedo`. It
//! also contains what the simulator and the fitter share with it: the yarn spec, the ply frame, the Gaussian
//! beam, the anisotropic spherical Gaussian lobe and the file container. It has no simulator, optimizer or
//! thread pool.
//!
//! Conventions: lengths are in micrometers, absorption is in 1/um, angles are in radians, distributions are
//! in 1/sr.

pub mod bsdf;
pub mod cloth;
pub mod color;
mod error;
pub mod frame;
pub mod gap;
mod host_constants;
pub mod io;
#[doc(hidden)]
pub mod math;
pub mod optics;
pub mod ply;
pub mod spec;

pub use bsdf::{Bsdf, BsdfSample};
pub use cloth::{ClothModel, ClothOptions, ClothQuery};
pub use error::{Error, Result, one_line};
pub use host_constants::host_constants;
pub use io::Document;
pub use ply::speckle;
pub use ply::{FamilyParams, PlyBsdf, PlyFamily, PlyModel, PlyQuery};

/// Compiles the examples of the README and of the host guide.
#[cfg(doctest)]
mod pages {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/howto/host_rust.md")]
    struct Hosts;
}
