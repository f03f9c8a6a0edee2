//! Multiple scattering between parallel fibers by dual scattering (Zinke et al. 2008), in the form of
//! Khungurn's note of 2015, from any fiber model.
//!
//! Light on its way to a fiber passes n other fibers. Their forward scattering transmits the share `T_f` of
//! it, spread over the half turn of azimuths about its origin and, by a Gaussian, over the latitudes. The
//! fiber scatters that light (`F^G`). Its neighbors return a share A_b of the light that passes them, as a
//! wide lobe (`F^L`).
//!
//! Measures. The note gives radiance, `L_o = integral (F^G + d_b F^L) L_d domega_d`, for a BCSDF f_s. A
//! [`Bsdf`] gives energy, `f = f_s cos theta_o`. Relative to the flux on a fiber's axis, `L_d cos theta_d`,
//! the energy density is `(F^G + d_b F^L) cos theta_o / cos theta_d` ([`DualBsdf::eval`]). For a fiber that
//! is not occluded it is f itself plus its neighbors' light. The factor for the note's integrator is
//! [`DualBsdf::radiance`].
//!
//! Balance. Light that passes n fibers has the flux `T_f L_d cos theta_d`. The note's S_f is a density of
//! *radiance* over directions: its flux is `T_f L_d` times the mean of cos theta_i, which for wide spreads is
//! not cos theta_d. [`Spread::Flux`] conserves the flux, `S_f = s g cos theta_d / cos^2 theta_i`; the light
//! of F^G is then T_f times the mean albedo. [`Spread::Radiance`] is the note's. With `d_f = d_b = 1` and the
//! full sum, infinite layers reflect the share `a_b + A_b`, which solves the adding equation of layers;
//! without absorption it is 1.
//!
//! Latitudes. A fiber scatters light of mean latitude m forward at `m - s(m)`, with its own variance
//! `beta^2(m)`. To first order the mean and variance of light that passes fibers therefore become
//! `m' = m - s(m)` and `V' = (1 - ds/dm)^2 V + beta^2(m)`. Narrow lobes have s near 0, and V = n beta^2 as in
//! the note. Wide lobes have `s > 0` above the equator, where cos^2 cuts them off, and V converges.
//! [`DualOptions::drift`] switches between the two.
//!
//! The attenuations a_f, a_b and the moments of latitude are integrals of f over the azimuths of light and
//! fiber. They are estimated from the model's own samples at low-discrepancy points, so narrow lobes and
//! caustics have their correct weight. The longitudinal shape of F^G is a Gaussian with the mean and variance
//! of f there, convolved with that of the spread; [`DualScattering::global`] integrates f itself.
//! docs/explain/dual_scattering.md lists the errors against traced layers and bundles.

mod attenuation;
mod bsdf;
mod lobe;
mod sums;

pub use attenuation::{Attenuation, DualScattering};
pub use bsdf::{DualBsdf, DualTerms, Occlusion};
pub use sums::{Backscattering, Stack, stack};

#[cfg(doc)]
use plywave::Bsdf;

/// The quantity that is conserved when light spreads through fibers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// The flux on the fiber, which balances energy.
    Flux,
    /// The radiance, as in the note, whose flux is off by the ratio of the mean of cos theta_i to cos
    /// theta_d.
    Radiance,
}

/// Options of dual scattering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DualOptions {
    /// d_f, 0 to 1: fraction of the passing light that hits the occluding fibers.
    pub forward_density: f32,
    /// d_b, 0 to 1: density of the neighbors that reflect light.
    pub backward_density: f32,
    /// Orders of backscattering included in A_b.
    pub backscattering: Backscattering,
    /// Definition of the spread S_f.
    pub spread: Spread,
    /// Whether the mean latitude of light drifts as it passes fibers, and its variance converges: lobes near
    /// a pole have more light on the equator's side. If false, the latitude is that of straight light and the
    /// variance is `n beta^2` with beta the width of TT ([`Attenuation::forward_beta`]), as in the note.
    pub drift: bool,
    /// Number of samples of f at each latitude, 64 to 1000000. Powers of two fill the directions most evenly.
    pub samples: u32,
    /// Number of rotations of the fiber about its axis to average, 1 to 1000; a round fiber needs one.
    pub turns: u32,
}

impl Default for DualOptions {
    /// Zinke's densities 0.7, all orders, conserved flux, drift, and one rotation.
    fn default() -> Self {
        DualOptions {
            forward_density: 0.7,
            backward_density: 0.7,
            backscattering: Backscattering::Full,
            spread: Spread::Flux,
            drift: true,
            samples: 16_384,
            turns: 1,
        }
    }
}
