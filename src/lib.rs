//! plywave: evaluate and sample the far-field scattering of a textile ply (Yu et al. 2025).
//!
//! This crate is the runtime. It reads ply model files and evaluates `eval`, `sample`, `pdf` and `albedo`; it
//! also contains the parts that the simulator and the fitter share with it: the yarn spec, the ply frame, the
//! Gaussian beam, the anisotropic spherical Gaussian lobe and the table of simulated scattering. It has no
//! simulator, optimizer or thread pool.
//!
//! Conventions: lengths in micrometers, absorption in 1/um, angles in radians, distributions in 1/sr.

pub mod bsdf;
pub mod check;
pub mod cloth;
pub mod color;
mod error;
pub mod fiber;
pub mod frame;
pub mod gap;
pub mod io;
#[doc(hidden)]
pub mod math;
pub mod ply;
pub mod spec;
pub mod speckle;
pub mod table;
pub mod twin;

pub use bsdf::{Bsdf, BsdfSample};
pub use cloth::{ClothModel, ClothOptions, ClothQuery};
pub use error::{Error, Result, one_line};
pub use fiber::{FiberBsdf, FiberModel, FiberQuery};
pub use ply::{FamilyParams, PlyBsdf, PlyFamily, PlyModel, PlyQuery};

/// Checks that the examples in README and in the host guide compile.
#[cfg(doctest)]
mod pages {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/howto/host_rust.md")]
    struct Hosts;
    #[doc = include_str!("../docs/explain/dual_scattering.md")]
    struct DualScattering;
}
