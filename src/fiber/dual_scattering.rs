//! Multiple scattering between parallel fibers by dual scattering (Zinke et al. 2008), in the form of
//! Khungurn's note of 2015, from any fiber model.
//!
//! Light on its way to a fiber passes n others. Their forward scattering leaves the share `T_f` of it, spread
//! over the half turn of azimuths about where it came from and, by a Gaussian, over the latitudes; the fiber
//! scatters that (`F^G`). Its neighbors send back a share of what passes them, A_b, as a wide lobe (`F^L`).
//!
//! Measures. The note gives radiance, `L_o = integral (F^G + d_b F^L) L_d domega_d`, for a BCSDF f_s. A
//! [`Bsdf`] gives energy, `f = f_s cos theta_o`. Where the flux on a fiber's axis, `L_d cos theta_d`, is the
//! light that counts as incident, the energy density is `(F^G + d_b F^L) cos theta_o / cos theta_d`
//! ([`DualBsdf::eval`]), which for a fiber with nothing before it is f itself, plus its neighbors' light. The
//! factor that the note's integrator needs is [`DualBsdf::radiance`].
//!
//! Balance. What passes n fibers has the flux `T_f L_d cos theta_d`. The note's S_f is a density over
//! directions of *radiance*: its flux is `T_f L_d` times the mean of cos theta_i, which for wide spreads is
//! not that of theta_d. [`Spread::Flux`] keeps the flux, `S_f = s g cos theta_d / cos^2 theta_i`; then the
//! light of F^G is T_f times the mean albedo. [`Spread::Radiance`] is the note's. With `d_f = d_b = 1` and
//! the full sum, light on endless layers comes back with the share `a_b + A_b`, which solves the adding
//! equation of layers; where nothing is absorbed it is 1.
//!
//! Latitudes. A fiber sends light of the mean latitude m on at `m - s(m)`, with the variance `beta^2(m)` of
//! its own. So to first order the mean and variance of light that passes fibers are `m' = m - s(m)`,
//! `V' = (1 - ds/dm)^2 V + beta^2(m)`. Narrow lobes have s near 0, and V = n beta^2 as the note has it; wide
//! ones have `s > 0` above the equator, where cos^2 cuts them, and V levels off. [`DualOptions::drift`]
//! switches between the two.
//!
//! Attenuations a_f, a_b and the moments of latitude are integrals of f over the azimuths of light and fiber,
//! as the model's own samples at points of low discrepancy give them: so that narrow lobes and caustics count
//! as they should. Of F^G the longitudinal shape is a Gaussian that has the mean and variance of f there,
//! convolved with the spread's; [`DualScattering::global`] integrates f itself. Errors against traced layers
//! and bundles stand in docs/explain/dual_scattering.md.

mod attenuation;
mod bsdf;
mod lobe;
mod sums;

pub use attenuation::{Attenuation, DualScattering};
pub use bsdf::{DualBsdf, DualTerms, Occlusion};
pub use sums::{Backscattering, Stack, stack};

#[cfg(doc)]
use crate::Bsdf;

/// Which measure the spread of light that has passed fibers keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// Flux on the fiber: balanced.
    Flux,
    /// Radiance, as in the note: off by the mean of cos theta_i over cos theta_d.
    Radiance,
}

/// How light between fibers is counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DualOptions {
    /// d_f, 0 to 1: how much of the light that is on its way meets the fibers before.
    pub forward_density: f32,
    /// d_b, 0 to 1: how much of the neighbors is there to send light back.
    pub backward_density: f32,
    /// A_b.
    pub backscattering: Backscattering,
    /// S_f.
    pub spread: Spread,
    /// Whether the latitude of light that passes fibers drifts, and its spread levels off, as lobes near a
    /// pole have their light on the equator's side; else the latitude is that of straight light and the
    /// variance `n beta^2` of TT's width beta ([`Attenuation::forward_beta`]), as in the note.
    pub drift: bool,
    /// Samples of f a latitude, 64 to 1000000; powers of two fill the directions most evenly.
    pub samples: u32,
    /// Turns of the fiber about its axis that are averaged, 1 to 1000; a round fiber needs one.
    pub turns: u32,
}

impl Default for DualOptions {
    /// Zinke's densities 0.7, all orders, flux, drift; one turn.
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
