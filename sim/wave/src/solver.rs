//! The trait of all solvers, its results (far fields, widths, statistics), and widths from far fields by the
//! optical theorem.

use crate::error::WaveError;
use crate::light::source::{PlaneWave, Source};
use crate::types::{C64, Polarization, Wave};
use std::f64::consts::{PI, TAU};

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
    /// Maximum relative residual of a solve (0 for closed forms).
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
