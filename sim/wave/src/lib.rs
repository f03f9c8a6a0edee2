//! Wave optics of parallel fibers: scattering by straight cylinders of any outline, at any incidence (Yu
//! 2025, 4.3; Xia 2020, 3-4).
//!
//! All fields are those of one axial wavenumber, `E(x, y, z) = E(x, y) exp(i k_z z)`, so a 3D problem reduces
//! to the plane ("2.5D"). Its unknowns are `e = E_z` and `h = Z_0 H_z`, of the same unit, which obey
//! Helmholtz's equation with the transverse wavenumber `kappa_j^2 = k_0^2 eps_j - k_z^2` of each medium j.
//! The other components follow from them:
//!
//! ```text
//! E_T = (i / kappa_j^2) (k_z grad e - k_0 z x grad h)        h_T = (i / kappa_j^2) (k_z grad h + k_0 eps_j z x grad e)
//! ```
//!
//! On a wall with outward normal n and tangent t = z x n, `e`, `h` and these two are continuous:
//!
//! ```text
//! (k_0 eps_j d_n e + k_z d_t h) / kappa_j^2                  (k_0 d_n h - k_z d_t e) / kappa_j^2
//! ```
//!
//! Conventions: exp(-i omega t), index eta + i kappa with kappa >= 0 absorbing, outgoing waves H^(1), phase
//! zero at the origin.

mod boundary;
mod cylinders;
mod error;
mod jobs;
mod light;
mod many;
pub mod noise;
mod scene;
mod solver;
pub mod special;
mod types;

pub use boundary::nystrom::NystromSolver;
pub use cylinders::mie::MieSolver;
pub use cylinders::multipole::MultipoleSolver;
pub use error::WaveError;
pub use jobs::compare::{
    AcrossWavelengths, CompareCase, CompareCurves, CompareJob, CompareOptions, CompareReport, Energies, Resolved,
    compare,
};
pub use jobs::scatter::{Case, Report, RunStats, ScatterJob, check_ledger, scatter};
pub use jobs::similarity::{Similarity, Spread, correlation};
pub use jobs::speckle::{SpeckleJob, SpeckleOptions, speckle};
pub use jobs::tabulate::{
    MakeSolver, Solver, TabulateJob, TabulateOptions, tabulate, tabulate_rays, tabulate_slices, tabulate_with,
};
pub use jobs::total_field::{TotalField, azimuths, beam_power, incident_far_field, total_field};
pub use light::source::{BeamSource, PlaneWave, Source};
pub use many::compressed::CompressedSolver;
pub use scene::description::{Beams, Method, Scene};
pub use scene::scene_check::check_walls;
pub use scene::section_bodies::{fiber_body, section_bodies};
pub use scene::single_fiber::{Absorption, SingleFiber};

pub use solver::{Scattered, SolverStats, WaveSolver, extinction_width, scattering_width};
pub use types::{Body, C64, Polarization, Shape, Wave};
