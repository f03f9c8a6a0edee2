//! Multiple scattering between parallel fibers by dual scattering (Zinke et al. 2008), in the form of
//! Khungurn's note of 2015, from any fiber model.
//!
//! Light on its way to a fiber passes n others. Their forward scattering transmits the share `T_f` of it,
//! spread over the half turn of azimuths about its origin and, by a Gaussian, over the latitudes; the fiber
//! scatters that (`F^G`). Its neighbors return a share A_b of the light that passes them, as a wide lobe
//! (`F^L`).
//!
//! Measures. The note gives radiance, `L_o = integral (F^G + d_b F^L) L_d domega_d`, for a BCSDF f_s. A
//! [`Bsdf`] gives energy, `f = f_s cos theta_o`. If the flux on a fiber's axis, `L_d cos theta_d`, counts as
//! the incident light, the energy density is `(F^G + d_b F^L) cos theta_o / cos theta_d`
//! ([`DualBsdf::eval`]), which for a fiber with nothing before it is f itself, plus its neighbors' light. The
//! factor for the note's integrator is [`DualBsdf::radiance`].
//!
//! Balance. Light that passes n fibers has the flux `T_f L_d cos theta_d`. The note's S_f is a density over
//! directions of *radiance*: its flux is `T_f L_d` times the mean of cos theta_i, which for wide spreads is
//! not that of theta_d. [`Spread::Flux`] conserves the flux, `S_f = s g cos theta_d / cos^2 theta_i`; then
//! the light of F^G is T_f times the mean albedo. [`Spread::Radiance`] is the note's. With `d_f = d_b = 1`
//! and the full sum, infinite layers reflect the share `a_b + A_b`, which solves the adding equation of
//! layers; without absorption it is 1.
//!
//! Latitudes. A fiber scatters light of mean latitude m forward at `m - s(m)`, with its own variance
//! `beta^2(m)`. So to first order the mean and variance of light that passes fibers are `m' = m - s(m)`,
//! `V' = (1 - ds/dm)^2 V + beta^2(m)`. Narrow lobes have s near 0, and V = n beta^2 as in the note; wide ones
//! have `s > 0` above the equator, where cos^2 cuts them, and V levels off. [`DualOptions::drift`] switches
//! between the two.
//!
//! Attenuations a_f, a_b and the moments of latitude are integrals of f over the azimuths of light and fiber,
//! estimated from the model's own samples at points of low discrepancy, so that narrow lobes and caustics
//! have their correct weight. The longitudinal shape of F^G is a Gaussian with the mean and variance of f
//! there, convolved with the spread's; [`DualScattering::global`] integrates f itself.
//! docs/explain/dual_scattering.md has the errors against traced layers and bundles.

mod attenuation;
mod bsdf;
mod lobe;
mod sums;

pub use attenuation::{Attenuation, DualScattering};
pub use bsdf::{DualBsdf, DualTerms, Occlusion};
pub use sums::{Backscattering, Stack, stack};

#[cfg(doc)]
use crate::Bsdf;

/// The quantity that the spread of light through fibers conserves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// Flux on the fiber: energy is balanced.
    Flux,
    /// Radiance, as in the note: off by the mean of cos theta_i over cos theta_d.
    Radiance,
}

/// Options of dual scattering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DualOptions {
    /// d_f, 0 to 1: fraction of the passing light that hits the fibers before.
    pub forward_density: f32,
    /// d_b, 0 to 1: density of the neighbors that reflect light.
    pub backward_density: f32,
    /// A_b.
    pub backscattering: Backscattering,
    /// S_f.
    pub spread: Spread,
    /// Whether the latitude of light that passes fibers drifts, and its spread levels off, as lobes near a
    /// pole have their light on the equator's side; if false, the latitude is that of straight light and the
    /// variance `n beta^2` of TT's width beta ([`Attenuation::forward_beta`]), as in the note.
    pub drift: bool,
    /// Number of samples of f per latitude, 64 to 1000000; powers of two fill the directions most evenly.
    pub samples: u32,
    /// Number of rotations of the fiber about its axis that are averaged, 1 to 1000; a round fiber needs one.
    pub turns: u32,
}

impl Default for DualOptions {
    /// Zinke's densities 0.7, all orders, flux, drift; one rotation.
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
