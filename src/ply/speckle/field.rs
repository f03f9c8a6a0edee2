//! Speckle noise at run time (Yu 2025, 6.2, Eq. 23): factors of mean 1 that turn the smooth f_refl and f_high
//! into those at a position on the ply.
//!
//! A speckle pattern is the Fourier transform of the illuminated area. The field of one kind of light is the
//! sum of a constant phasor and of waves from sources on the fibers that are visible in the beam. With b the
//! share of the waves,
//!
//! ```text
//! N = |sqrt(1 - b) + sqrt(b) g|^2      g = sum over j of w_j c_j exp(2 pi i (x_j u + z_j v) / lambda)
//! ```
//!
//! Here c_j are complex normal numbers of `<|c_j|^2> = 1`, and the squares of the weights w_j sum to 1. g is
//! therefore a circular Gaussian variable of unit variance at each position, direction and wavelength; the
//! mean of N is 1 and its contrast is `sqrt(b (2 - b))`. Fields are blended, never intensities.
//!
//! **Sources.** Along each fiber of a ply there is a source every w0 / 4. The window of the beam's field is
//! `(1 - (d / (2 w0))^2)^3`, with d the distance to the position along the fiber; the square of its
//! correlation differs from `exp(-(d / w0)^2)` by at most 0.006. Half-way between two neighboring fibers,
//! within a quarter of their distance to either side, both fibers are blended with the cosine and the sine of
//! an angle that goes from 0 to pi / 2. Fibers turn about the ply with its twist ([`PlyPlace::azimuth`]).
//!
//! **Positions.** x_j is distributed as the power over the angle (Wiener and Khinchin), which the model
//! stores ([`NoiseSpectrum`]). z_j is distributed as the light along the beam, normally with the standard
//! deviation w0 / 2 (van Cittert and Zernike, Goodman 2007, 4.4). z_j is independent of the source's position
//! in the window. The correlation of |g|^2 over position and v is the product of both either way, and with
//! independent z_j the phase between g and the constant phasor is preserved along the fiber. The positions of
//! the sources along a fiber are a low-discrepancy sequence in both (Roberts 2018, "R2"), shifted at random
//! on each fiber, so the sources in the window are distributed as all sources are. Over the directions at one
//! position, too, the covariance is that over positions, to one or two hundredths. Far from a direction a
//! residual remains, one over the effective number of sources: 1/8 of the square of the field's part on one
//! fiber, and 1/15 between two. The light of one position summed over all directions varies by it.
//!
//! **Coordinates.** All wavelengths are in phase at u = v = 0. The coordinates of a direction are
//!
//! ```text
//! f_high:   u = beta cos theta_o                 v = sin theta_o                   beta: azimuth about exact forward
//! f_refl:   u = alpha sqrt(1 - (v/2)^2)          v = sin theta_o + sin theta_i     alpha: azimuth about the light's
//! ```
//!
//! v is the spatial frequency along the ply, `q_z = (omega_o + omega_i)_z` for reflection. A surface's phase
//! is a function of it, so the pattern moves with the light and is otherwise unchanged (memory effect);
//! high-order light has no such memory.
//!
//! Across the ply, the patterns of fibers are stationary in the azimuth. In `q_x = cos theta_o cos phi_o`
//! they are not: its grains would smear without bound at phi_o = 0, and front and back would be mirror
//! images. u is therefore the arc about the ply's axis, cos theta_o times the azimuth, in which a pattern has
//! no pole. For reflection the cosine is that of the latitude of the half vector, a function of v alone, so
//! the shift is exact.
//!
//! u has a seam opposite to its origin: at exact forward for reflection, which is dark there, and at the
//! light's azimuth for high-order light. The pole of f_refl is not the ply's axis, about which its grains
//! narrow. Within [`super::SEAM_RAD`] of the seam the fields of both sides are blended, divided by the root
//! of the power that they have together.
//!
//! **Footprints.** For two points of a footprint of standard deviation s, `<exp(-(d / l)^2)>` is
//! `1 / sqrt(1 + 4 (s / l)^2)` along an axis, one over the number of grains in it. The contrast decreases by
//! its root.

use super::spectrum::NoiseSpectrum;
use crate::math::erf::erf_inverse;
use crate::math::hash::mix32;
use crate::math::simd::{ln, max};
use crate::ply::{FibersAround, PlyPlace};

/// Number of entries of the tables that sources are sampled from, and its binary logarithm.
pub(super) const TABLE: usize = 1 << TABLE_BITS;
pub(super) const TABLE_BITS: u32 = 9;
/// Distance [fibers] at which the correlation across fibers, |g|^2 at two offsets, decreases to 1/e: that of
/// a Gaussian with the same integral.
const ACROSS: f32 = 0.58;
/// Contrast, relative to that of a point, below which there is no speckle.
const MIN_CONTRAST: f32 = 0.02;
/// The speckle noise of a ply, prepared for evaluation. Its tables have the same bits on every machine.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseField {
    pub(super) seed: u32,
    pub(super) around: FibersAround,
    pub(super) w0_um: f32,
    pub(super) lambda_um: f32,
    pub(super) share: [f32; 2],
    pub(super) fade: [[f32; 2]; 2],
    contrast: [f64; 2],
    /// Absolute values of complex normal numbers, all equally probable.
    pub(super) size: [f32; TABLE],
    /// Absolute positions along the fiber [um]; the sign is sampled separately.
    pub(super) along_um: [f32; TABLE],
    /// For each kind, absolute positions across the fiber [um]; the sign is sampled separately.
    pub(super) across_um: [[f32; TABLE]; 2],
}

impl NoiseSpectrum {
    /// The noise around plies with these fibers. The tables are the same on every machine.
    pub fn field(&self, around: FibersAround) -> NoiseField {
        NoiseField::new(self, around)
    }
}

impl NoiseField {
    fn new(of: &NoiseSpectrum, around: FibersAround) -> NoiseField {
        let size = scaled(std::array::from_fn(|k| (-ln::<false>(quantile(k, 0.5))).sqrt()), 1.0);
        // Quantiles of the half-normal distribution.
        let along_um = scaled(std::array::from_fn(|k| erf_inverse(quantile(k, 0.5))), 0.5 * of.w0_um);
        NoiseField {
            seed: mix32(of.seed as u32 ^ mix32((of.seed >> 32) as u32)),
            around,
            w0_um: of.w0_um as f32,
            lambda_um: of.lambda_um as f32,
            share: of.share.map(|b| b as f32),
            fade: of.fade.map(|f| f.map(|f| f as f32)),
            contrast: of.contrast,
            size,
            along_um,
            across_um: [0, 1].map(|kind| across_um(of, kind)),
        }
    }

    /// The contrast of the simulated fibers, for each kind.
    pub fn contrast(&self) -> [f64; 2] {
        self.contrast
    }

    /// The fibers around the ply.
    pub fn around(&self) -> FibersAround {
        self.around
    }

    /// Seed, numbers and tables, for hosts with kernels of their own. The numbers are: count and ring radius
    /// of the fibers, w0, the wavelength of the patterns, then share and fade of each kind. The tables are:
    /// sizes, positions along, and positions across for each kind.
    #[doc(hidden)]
    pub fn numbers(&self) -> (u32, [f32; 10], [&[f32]; 4]) {
        let FibersAround { count, ring_um } = self.around;
        let ([a, b], [[c, d], [e, f]]) = (self.share, self.fade);
        let tables = [&self.size[..], &self.along_um, &self.across_um[0], &self.across_um[1]];
        (self.seed, [count, ring_um, self.w0_um, self.lambda_um, a, b, c, d, e, f], tables)
    }

    /// Contrast of each kind averaged over the footprint, relative to that of a point. It is 0 if an input is
    /// not finite.
    #[inline]
    pub(super) fn blur(&self, place: &PlyPlace, h_um: f32) -> [f32; 2] {
        let along = place.deviation_um() / self.w0_um;
        let valid = h_um.is_finite() && along.is_finite() && place.azimuth.is_finite() && place.along_um.is_finite();
        if !valid {
            return [0.0; 2];
        }
        if along <= 0.0 {
            return [1.0; 2];
        }
        let half = 0.5 * place.footprint_um;
        let rows = self.around.row(0.0, h_um - half) - self.around.row(0.0, h_um + half);
        let across = 0.29 / ACROSS * rows;
        let (a, b) = (along * along, across * across);
        // The part of the covariance that is the field's correlation, and the part that is its square.
        let root = |x: f32| 1.0 / x.sqrt();
        let (field, square) = (root((1.0 + 2.0 * a) * (1.0 + 2.0 * b)), root((1.0 + 4.0 * a) * (1.0 + 4.0 * b)));
        self.share.map(|b| {
            let retained = (2.0 * (1.0 - b) * field + b * square) / (2.0 - b);
            max((retained.sqrt() - MIN_CONTRAST) / (1.0 - MIN_CONTRAST), 0.0)
        })
    }
}

/// Quantile of entry `k` of a table, at the fraction `within` of the entry.
fn quantile(k: usize, within: f32) -> f32 {
    (k as f32 + within) / TABLE as f32
}

/// The numbers scaled to a root mean square of `to`.
fn scaled(x: [f32; TABLE], to: f64) -> [f32; TABLE] {
    let sum: f64 = x.iter().map(|x| f64::from(*x) * f64::from(*x)).sum();
    let scale = to / (sum / TABLE as f64).sqrt();
    x.map(|x| (scale * f64::from(x)) as f32)
}

/// Quantiles of the position across the fiber under the stored powers. Each quantile is at a random position
/// within its equal part, so that the pattern does not repeat at any angle.
fn across_um(of: &NoiseSpectrum, kind: usize) -> [f32; TABLE] {
    let powers = of.powers(kind);
    let power = |j: usize| f64::from(powers[j]) * if j > 0 { 2.0 } else { 1.0 };
    let total: f64 = (0..powers.len()).map(power).sum();
    let (mut j, mut upto) = (0, power(0));
    std::array::from_fn(|k| {
        let within = f64::from(mix32((TABLE * kind + k) as u32)) / 4_294_967_296.0;
        let share = (k as f64 + within) / TABLE as f64;
        while j + 1 < powers.len() && upto <= share * total {
            j += 1;
            upto += power(j);
        }
        (of.step_um[kind] * j as f64) as f32
    })
}
