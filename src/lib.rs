//! plywave: evaluate and sample the far-field scattering of a textile ply (Yu et al. 2025).
//!
//! This crate is the runtime. It reads ply model files and answers `eval`, `sample`, `pdf` and `albedo`; it also holds
//! what the simulator and the fitter share with it: the yarn spec, the ply frame, the Gaussian beam, the anisotropic
//! spherical Gaussian lobe and the table of simulated scattering. It has no simulator, optimizer or thread pool.
//!
//! Conventions: lengths in micrometers, absorption in 1/um, angles in radians, distributions in 1/sr.

pub mod asg;
mod beam;
mod bsdf;
pub mod check;
mod check_whole;
#[doc(hidden)]
pub mod chi2;
pub mod color;
mod edge;
mod error;
pub mod fabric;
pub mod fiber;
mod frame;
pub mod gap;
pub mod io;
mod layers;
#[doc(hidden)]
pub mod math;
mod noise;
pub mod ply;
mod ply_circle;
pub mod spec;
mod speckle;
mod table;

use io as file;
use math::simd;

pub use beam::GaussianBeam;
pub use bsdf::{Bsdf, BsdfSample, DirectionSample, Outcomes};
pub use edge::{EDGE_MU_MAX, EdgeLobes, beam_mu};
pub use error::{Error, Result};
pub use fabric::{FabricBsdf, FabricQuery};
pub use fiber::{FiberBsdf, FiberModel, FiberQuery};
pub use frame::{direction, incident_direction, mirror_incidence, theta_phi};
pub use gap::{Aperture, Gap, GapBsdf, SLIT_MAX_UM, SLIT_SHARE, Slit};
pub use io::{FileKind, file_kind};
pub use layers::{Layer, LayerFactors, TwoLayers};
#[doc(hidden)]
pub use math::faddeeva;
pub use noise::{Instance, NoiseTiles, SEAM_RAD};
#[doc(hidden)]
pub use ply::reference;
pub use ply::{PlyBsdf, PlyData, PlyModel, PlyQuery, PlyTerms, Queries, ReferenceValue};
pub use ply_circle::{PlyRing, least_ply_pitch_um, ply_circle_um};
pub use spec::{
    AbsorptionSpec, BeamSpec, FiberSpec, Handedness, POLYESTER, PlySpec, Shape, SimulationSpec, YarnGeometry, YarnSpec,
};
pub use speckle::{FORWARD_RAD, SpecklePatterns, SpecklePolarization, SpeckleSide, SpeckleStatistics};
pub use table::{ExitPositions, OutgoingGrid, Table};
