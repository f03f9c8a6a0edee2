//! Colors of small gaps between fibers (Yu 2025, 7.3): a slit along the ply diffracts a part of the forward
//! light.
//!
//! This is an optional effect of the paper, not a simulation: neither the number nor the widths of a ply's
//! slits have been measured. Forward light is taken from each lobe of f_high: `share` times the cosine
//! between the lobe's axis and the forward direction, nothing from a lobe that points backwards. It is sent
//! through one slit of the given width, of length +-d_cut along the ply, about the forward direction. The
//! energy of each lobe is exact, so energy is conserved at every absorption. Through so narrow a slit
//! Kirchhoff's approximation loses light (5 % and more below 5 um); the pattern here is the spectrum of the
//! slit alone, scaled to an integral of 1 over the propagating directions.

use super::{Aperture, Gap};
use crate::spec::GaussianBeam;
use crate::{Error, Result};

/// Widest slit [um]: wider gaps belong to the weave (Yu 2025, 7.3).
pub const SLIT_MAX_UM: f32 = 5.0;
/// Share of the forward light in the paper.
pub const SLIT_SHARE: f32 = 0.25;
/// Smallest cosine of the incident latitude; more grazing light is clamped to it.
const MIN_COSINE: f32 = 1e-3;

/// A slit along the ply, with the share of the forward light that passes through it.
#[derive(Clone, Copy, Debug)]
pub struct Slit {
    gap: Gap,
    width_um: f32,
    share: f32,
}

impl Slit {
    /// A slit of this width [um] in a beam; `share` is [`SLIT_SHARE`] in the paper.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a width outside (0, [`SLIT_MAX_UM`]] or a share outside [0, 1].
    pub fn new(width_um: f32, share: f32, beam: &GaussianBeam) -> Result<Slit> {
        let invalid = |key: &str, value: f32, hint: String| {
            Err(Error::Invalid { file: "slit".into(), key: key.into(), value: value.to_string(), hint })
        };
        if !(width_um > 0.0 && width_um <= SLIT_MAX_UM) {
            return invalid("width_um", width_um, format!("expected a width above 0 and at most {SLIT_MAX_UM}"));
        }
        if !(0.0..=1.0).contains(&share) {
            return invalid("share", share, "expected a share in [0, 1]".into());
        }
        let (x, y) = (0.5 * width_um, beam.d_cut_um as f32);
        let gap = Gap::new(&Aperture { x_um: [-x, x], y_um: [-y, y] }, beam);
        Ok(Slit { gap, width_um, share })
    }

    /// Width [um].
    pub fn width_um(&self) -> f32 {
        self.width_um
    }

    /// Share of the forward light.
    pub fn share(&self) -> f32 {
        self.share
    }

    /// Numbers of the spectra across and along the ply ([`super::Spectrum`]), for hosts that evaluate them
    /// themselves.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = f32> {
        self.gap.x.numbers().chain(self.gap.y.numbers())
    }

    /// The pattern in direction `wo` of the ply frame, scaled to energy 1 [1/sr], and the density of
    /// [`Slit::sample`]. A beam from latitude `theta_i` spreads over the cone of the forward latitude.
    pub fn eval_pdf<const N: usize>(&self, theta_i: f32, lambda_um: [f32; N], wo: [f32; 3]) -> ([f32; N], f32) {
        self.gap.at(incident(theta_i), lambda_um).conserved(swapped(wo))
    }

    /// Samples a direction of the pattern, by numbers in [0, 1); the first chooses the wavelength.
    pub fn sample<const N: usize>(&self, theta_i: f32, lambda_um: [f32; N], u: [f32; 3]) -> Option<[f32; 3]> {
        self.gap.at(incident(theta_i), lambda_um).conserved_sample(u).map(swapped)
    }
}

/// Converts between the ply's frame and the slit's, whose y is the ply's z. The map is a mirror image, under
/// which the symmetric pattern is unchanged.
fn swapped(w: [f32; 3]) -> [f32; 3] {
    [w[0], w[2], w[1]]
}

/// The incident direction in the slit's frame; NaN counts as grazing.
fn incident(theta_i: f32) -> [f32; 3] {
    use std::f32::consts::FRAC_PI_2;
    let (s, c) = crate::math::simd::max(crate::math::simd::min(theta_i, FRAC_PI_2), -FRAC_PI_2).sin_cos();
    [0.0, s, c.max(MIN_COSINE)]
}
