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

#[cfg(test)]
mod absorbing_tests;
mod assemble;
mod basis;
mod choice;
mod circle;
mod close;
mod compare;
#[cfg(test)]
mod compare_tests;
mod compressed;
#[cfg(test)]
mod compressed_tests;
mod coupling;
mod curve;
mod entries;
mod error;
mod extinction;
mod hierarchy;
#[cfg(test)]
mod hierarchy_tests;
mod incident;
mod interpolate;
mod kernel;
mod likeness;
mod lu;
pub(crate) mod memory;
mod merge;
mod mie;
mod multipole;
#[cfg(test)]
mod multipole_tests;
mod nystrom;
#[cfg(test)]
mod nystrom_tests;
mod packed;
mod placement;
mod rays;
mod scatter;
mod scene;
mod scene_check;
mod scene_toml;
mod section_bodies;
mod series;
mod single_fiber;
mod skeleton;
mod source;
pub mod special;
mod speckle;
mod symmetry;
mod system;
mod tabulate;
#[cfg(test)]
mod tabulate_tests;
mod total_field;
mod vicinity;
mod visible;
mod walls;

pub use compare::{
    AcrossWavelengths, CompareCase, CompareCurves, CompareJob, CompareOptions, CompareReport, Energies, Resolved,
    compare,
};
pub use compressed::CompressedSolver;
pub use error::WaveError;
pub use likeness::{Likeness, Spread};
pub use mie::MieSolver;
pub use multipole::MultipoleSolver;
pub use nystrom::NystromSolver;
pub use scatter::{Case, Report, RunStats, ScatterJob, check_ledger, scatter};
pub use scene::{Beams, Method, Scene};
pub use scene_check::check_walls;
pub use section_bodies::{fiber_body, section_bodies};
pub use single_fiber::{Absorption, SingleFiber};
pub use source::{BeamSource, PlaneWave, Source};
pub use speckle::{SpeckleJob, SpeckleOptions, speckle};
pub use tabulate::{
    MakeSolver, Solver, TabulateJob, TabulateOptions, tabulate, tabulate_rays, tabulate_slices, tabulate_with,
};
pub use total_field::{TotalField, azimuths, beam_power, incident_far_field, total_field};

use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

/// Complex number of the wave code.
pub type C64 = Complex64;

/// Wavelength and latitude of incidence, common to all sources of one solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Vacuum wavelength [um].
    pub lambda_um: f64,
    /// Latitude theta_i of the incidence [rad], in (-pi/2, pi/2).
    pub theta_i: f64,
}

impl Wave {
    /// Vacuum wavenumber k_0 [1/um].
    pub fn k0(&self) -> f64 {
        TAU / self.lambda_um
    }

    /// Axial wavenumber k_z = -k_0 sin theta_i [1/um], the same in every medium.
    pub fn kz(&self) -> f64 {
        -self.k0() * self.theta_i.sin()
    }

    /// Transverse wavenumber of the air outside [1/um], k_0 cos theta_i.
    pub fn k_rho(&self) -> f64 {
        self.k0() * self.theta_i.cos()
    }

    /// Transverse wavenumber [1/um] in a medium of complex `index`, with a non-negative imaginary part.
    pub fn k_rho_in(&self, index: C64) -> C64 {
        // eps - sin^2, without cancellation for air at grazing latitudes.
        let k = self.k0() * ((index - 1.0) * (index + 1.0) + self.theta_i.cos().powi(2)).sqrt();
        if k.im < 0.0 { -k } else { k }
    }
}

/// Polarization of the incident light, by the field that has an axial component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarization {
    /// Electric field along `(-sin theta cos phi, -sin theta sin phi, cos theta)`: e != 0, h = 0.
    Tm,
    /// Electric field along `(-sin phi, cos phi, 0)`: h != 0, e = 0.
    Te,
}

/// Outline of a wall in its own frame. Counterclockwise; the solvers reverse clockwise ones.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Circle about the origin.
    Circle {
        /// Radius [um].
        radius_um: f64,
    },
    /// Ellipse about the origin, first axis along x.
    Ellipse {
        /// Semi-axis along x [um].
        a_um: f64,
        /// Semi-axis along y [um].
        b_um: f64,
    },
    /// `z(t) = x + i y = sum c_k exp(i k t)`, t in [0, 2 pi).
    Fourier {
        /// `(k, c_k)`, c_k in um.
        coeffs: Vec<(i32, C64)>,
    },
    /// Polygon whose corners are replaced by circular arcs tangent to both edges.
    Polygon {
        /// Corners in order [um].
        points_um: Vec<[f64; 2]>,
        /// Radius of the arcs [um].
        rounding_um: f64,
    },
}

/// A homogeneous body bounded by a closed wall: a fiber, or the lumen inside of one. At most one lumen per
/// body, nested to any depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Outline of the wall.
    pub shape: Shape,
    /// Origin of the outline's frame in the scene [um].
    pub center_um: [f64; 2],
    /// Turn of the outline's frame [rad]: a point p of it lies at `center + Rot(rotation) p`.
    pub rotation_rad: f64,
    /// Real index.
    pub eta: f64,
    /// Imaginary index, >= 0.
    pub kappa: f64,
    /// The hollow (or filled) core.
    pub lumen: Option<Box<Body>>,
}

impl Body {
    /// Complex index eta + i kappa.
    pub fn index(&self) -> C64 {
        C64::new(self.eta, self.kappa)
    }
}

/// Far field and power of one source.
///
/// As rho -> inf, `E_s = sqrt(2/(pi k_rho rho)) exp(i (k_rho rho - pi/4 + k_z z)) [F_u u + F_phi phi]` with
/// `u = cos theta_i z + sin theta_i rho`. In terms of the axial fields, which vary as
/// `sqrt(2/(pi k_rho rho)) exp(i (k_rho rho - pi/4)) a(phi)`: `F_u = a_e / cos theta_i`,
/// `F_phi = a_h / cos theta_i`. Widths [um] are power per length over |S| of the incident wave; for a beam,
/// over |S| at its center.
#[derive(Clone, Debug, PartialEq)]
pub struct Scattered {
    /// F_u at azimuths 2 pi j / n, `[j]`.
    pub f_u: Vec<C64>,
    /// F_phi likewise.
    pub f_phi: Vec<C64>,
    /// Width of the scattered power [um], from the integral of the far field over a grid that resolves it.
    pub c_sca_um: f64,
    /// Width of the absorbed power [um], from the flux of the total field through the walls (or from the
    /// series, for Mie and multipoles).
    pub c_abs_um: f64,
    /// Width of the extinction [um], from the optical theorem. `c_sca + c_abs` equals it as far as the
    /// solution is exact; nothing is scaled to make it so.
    pub c_ext_um: f64,
}

/// Statistics of a solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolverStats {
    /// Size of the largest linear system solved.
    pub unknowns: usize,
    /// Largest relative residual of a solve (0 for closed forms).
    pub residual: f64,
    /// Estimate of the largest memory held at once [bytes].
    pub peak_bytes: usize,
}

/// A scene prepared for one [`Wave`]: one factorization serves every azimuth, beam and polarization.
pub trait WaveSolver: Sync {
    /// Far fields at `n_phi_out` azimuths and the ledger: one [`Scattered`] per source, in their order.
    ///
    /// # Errors
    /// [`WaveError::NotConverged`] where the residual stays above the tolerance.
    fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError>;

    /// Sizes and residual, after the solves so far.
    fn stats(&self) -> SolverStats;
}

/// C_sca [um] from far-field amplitudes on an equispaced azimuth grid that resolves them:
/// `2/(pi k_0) integral (|F_u|^2 + |F_phi|^2) d phi`.
pub fn scattering_width(wave: &Wave, f_u: &[C64], f_phi: &[C64]) -> f64 {
    let sum: f64 = f_u.iter().zip(f_phi).map(|(u, p)| u.norm_sqr() + p.norm_sqr()).sum();
    2.0 / (PI * wave.k0()) * sum * TAU / f_u.len() as f64
}

/// C_ext [um] by the optical theorem, from the amplitudes `(F_u, F_phi)` in the forward direction of each
/// plane wave of the source.
///
/// For one plane wave `C_ext = -(4/k_0) Re F_co(phi_i + pi)`, with the opposite sign for TE, since
/// `phi(phi_i + pi) = -e_TE`. For plane waves with amplitudes A_m, the terms are `conj(A_m)` times the
/// forward amplitude in each wave's direction.
pub fn extinction_width(wave: &Wave, pol: Polarization, waves: &[PlaneWave], forward: &[(C64, C64)]) -> f64 {
    let sum: f64 = waves
        .iter()
        .zip(forward)
        .map(|(w, (f_u, f_phi))| match pol {
            Polarization::Tm => -(w.amplitude.conj() * f_u).re,
            Polarization::Te => (w.amplitude.conj() * f_phi).re,
        })
        .sum();
    4.0 / wave.k0() * sum
}
