//! plywave: evaluate and sample the far-field scattering of a textile ply (Yu et al. 2025).
//!
//! This crate is the runtime. It reads ply model files and answers `eval`, `sample`, `pdf` and `albedo`; it also holds
//! what the simulator and the fitter share with it: the yarn spec, the ply frame, the Gaussian beam, the anisotropic
//! spherical Gaussian lobe and the table of simulated scattering. It has no simulator, optimizer or thread pool.
//!
//! Conventions: lengths in micrometers, absorption in 1/um, angles in radians, distributions in 1/sr.

pub mod asg;
mod beam;
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
mod gap;
pub mod io;
mod layers;
#[doc(hidden)]
pub mod math;
mod noise;
mod ply;
mod ply_circle;
mod scatter;
mod slit;
pub mod spec;
mod speckle;
mod table;
mod whole;

use io as file;
use math::simd;

pub use beam::GaussianBeam;
pub use edge::{EDGE_MU_MAX, EdgeLobes, beam_mu};
pub use error::{Error, Result};
pub use frame::{direction, incident_direction, mirror_incidence, theta_phi};
pub use gap::{Aperture, Gap, GapIncidence};
pub use io::{FileKind, file_kind};
pub use layers::{DoubleLayer, Layer, LayerFactors, TwoLayers};
#[doc(hidden)]
pub use math::faddeeva;
pub use noise::{Instance, NoiseTiles, SEAM_RAD};
#[doc(hidden)]
pub use ply::reference;
pub use ply::{Golden, PlyData, PlyModel, PlySample, Queries};
pub use ply_circle::{PlyRing, least_ply_pitch_um, ply_circle_um};
pub use scatter::{PlyIncidence, Scatter, ScatterSample};
pub use slit::{SLIT_MAX_UM, SLIT_SHARE, Slit};
pub use spec::{
    AbsorptionSpec, BeamSpec, FiberSpec, Handedness, POLYESTER, PlySpec, Shape, SimulationSpec, YarnGeometry, YarnSpec,
};
pub use speckle::{FORWARD_RAD, SpecklePatterns, SpecklePolarization, SpeckleSide, SpeckleStatistics};
pub use table::{ExitPositions, OutgoingGrid, Table};
pub use whole::{PlyTerms, PreparedPly, WholePly};
