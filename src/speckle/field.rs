//! Speckle noise at run time (Yu 2025, 6.2, Eq. 23): factors of mean 1 that convert the smooth f_refl and
//! f_high to those of a place on the ply.
//!
//! A speckle pattern is the Fourier transform of the lit area. The light of one kind is a constant phasor and
//! the sum of waves from sources on the fibers that are seen in the beam, a field of the share b,
//!
//! ```text
//! N = |sqrt(1 - b) + sqrt(b) g|^2      g = sum over j of w_j c_j exp(2 pi i (x_j u + z_j v) / lambda)
//! ```
//!
//! with complex normal c_j of `<|c_j|^2> = 1` and weights of which the sum of squares is 1, so that g is a
//! circular Gaussian variable of unit variance at each place, direction and wavelength: the mean of N is 1
//! and its contrast `sqrt(b (2 - b))`. Fields are blended, never intensities.
//!
//! **Sources.** Along each fiber of a ply one stands every w0 / 4. The window of the beam's field, `(1 - (d /
//! (2 w0))^2)^3` with d the distance to the place along the fiber, is within 0.006 of `exp(-(d / w0)^2)` in
//! the square of its correlation. Half way between two neighboring fibers, a fourth of their distance to
//! either side, both are blended, with the cosine and the sine of an angle that goes from 0 to pi / 2. Fibers
//! turn about the ply with its twist ([`PlyPlace::azimuth`]).
//!
//! **Positions.** x_j is distributed as the power over the angle (Wiener and Khinchin), which the model
//! stores ([`NoiseSpectrum`]), and z_j as the light along the beam, normally with the deviation w0 / 2 (van
//! Cittert and Zernike, Goodman 2007, 4.4). z_j is independent of where the source stands in the window: the
//! correlation of |g|^2 over place and v is the product of both either way, and the constant phasor keeps its
//! phase to g along the fiber. The positions of the sources along a fiber are a sequence of low discrepancy
//! in both (Roberts 2018, "R2"), shifted at random on each fiber, so that those in the window are distributed
//! as all are: over the directions of one place, too, the covariance is that over places, to one or two
//! hundredths. Far from a direction a rest is left, one over the number of sources that count: 1/8 of the
//! square of the field's part on one fiber, 1/15 between two, by which the light of a place in all directions
//! varies.
//!
//! **Coordinates.** All wavelengths are in phase at u = v = 0. The coordinates of a direction are
//!
//! ```text
//! f_high:   u = beta cos theta_o                 v = sin theta_o                   beta: azimuth about exact forward
//! f_refl:   u = alpha sqrt(1 - (v/2)^2)          v = sin theta_o + sin theta_i     alpha: azimuth about the light's
//! ```
//!
//! v is the spatial frequency along the ply, `q_z = (omega_o + omega_i)_z` for reflection: a surface's
//! phase is a function of it, so the pattern moves with the light and is otherwise unchanged (memory
//! effect); high-order light has no such memory. Across the ply the patterns of fibers are stationary in
//! the azimuth, not in `q_x = cos theta_o cos phi_o`, whose grains would smear without bound at phi_o = 0
//! and whose front and back would be mirror images; so u is the arc about the ply's axis, cos theta_o
//! times the azimuth, in which a pattern has no pole. For reflection the cosine is that of the latitude
//! of the half vector, a function of v alone, so the shift is exact. u has a seam opposite to its origin:
//! exact forward for reflection, which is dark there, and the light's azimuth for high-order light; and
//! the pole of f_refl is not the ply's axis, about which its grains narrow. Over [`super::SEAM_RAD`]
//! beside the seam the fields of both sides are blended, over the root of the power that they have
//! together.
//!
//! **Footprints.** Over a footprint of the deviation s, `<exp(-(d / l)^2)>` of two of its points is `1 /
//! sqrt(1 + 4 (s / l)^2)` along an axis, one over the number of grains in it. The contrast falls by its root.

use super::spectrum::NoiseSpectrum;
use crate::math::erf::erf_inverse;
use crate::math::hash::mix32;
use crate::math::simd::{ln, max};
use crate::ply::{FibersAround, PlyPlace};

/// Entries of the tables that sources are drawn from.
pub(super) const TABLE: usize = 1 << TABLE_BITS;
pub(super) const TABLE_BITS: u32 = 9;
/// Distance at which the correlation across fibers, |g|^2 of two offsets, falls to 1/e, in fibers: that of a
/// Gaussian of the same integral.
const ACROSS: f32 = 0.58;
/// Below this contrast over that of a point there is none.
const LEAST: f32 = 0.02;
/// The noise of a ply, ready for evaluation. Its tables have the same bits on every machine.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseField {
    pub(super) seed: u32,
    pub(super) around: FibersAround,
    pub(super) w0_um: f32,
    pub(super) lambda_um: f32,
    pub(super) share: [f32; 2],
    pub(super) fade: [[f32; 2]; 2],
    contrast: [f64; 2],
    /// Sizes of complex normal numbers, each as likely as the other.
    pub(super) size: [f32; TABLE],
    /// Positions along the fiber [um], up to their sign.
    pub(super) along_um: [f32; TABLE],
    /// For each kind, positions across the fiber [um], up to their sign.
    pub(super) across_um: [[f32; TABLE]; 2],
}

impl NoiseSpectrum {
    /// The noise around plies with these fibers: the same tables on every machine.
    pub fn field(&self, around: FibersAround) -> NoiseField {
        NoiseField::new(self, around)
    }
}

impl NoiseField {
    fn new(of: &NoiseSpectrum, around: FibersAround) -> NoiseField {
        let size = scaled(std::array::from_fn(|k| (-ln::<false>(quantile(k, 0.5))).sqrt()), 1.0);
        // Half normal.
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

    /// For each kind, the contrast of the simulated fibers.
    pub fn contrast(&self) -> [f64; 2] {
        self.contrast
    }

    /// The fibers around the ply.
    pub fn around(&self) -> FibersAround {
        self.around
    }

    /// Seed, numbers and tables, for hosts with kernels of their own: number of fibers around, their ring,
    /// w0, the wavelength of the patterns; of each kind share and fade; sizes, positions along and across.
    #[doc(hidden)]
    pub fn numbers(&self) -> (u32, [f32; 10], [&[f32]; 4]) {
        let FibersAround { count, ring_um } = self.around;
        let ([a, b], [[c, d], [e, f]]) = (self.share, self.fade);
        let tables = [&self.size[..], &self.along_um, &self.across_um[0], &self.across_um[1]];
        (self.seed, [count, ring_um, self.w0_um, self.lambda_um, a, b, c, d, e, f], tables)
    }

    /// Contrast of each kind that a footprint leaves, over that of a point.
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
        // Of the part of the covariance that goes as the field's correlation, and of that of its square.
        let root = |x: f32| 1.0 / x.sqrt();
        let (field, square) = (root((1.0 + 2.0 * a) * (1.0 + 2.0 * b)), root((1.0 + 4.0 * a) * (1.0 + 4.0 * b)));
        self.share.map(|b| {
            let left = (2.0 * (1.0 - b) * field + b * square) / (2.0 - b);
            max((left.sqrt() - LEAST) / (1.0 - LEAST), 0.0)
        })
    }
}

/// Middle of entry k of a table, or another place within it, as a share of all.
fn quantile(k: usize, within: f32) -> f32 {
    (k as f32 + within) / TABLE as f32
}

/// Numbers scaled to a root mean square.
fn scaled(x: [f32; TABLE], to: f64) -> [f32; TABLE] {
    let sum: f64 = x.iter().map(|x| f64::from(*x) * f64::from(*x)).sum();
    let scale = to / (sum / TABLE as f64).sqrt();
    x.map(|x| (scale * f64::from(x)) as f32)
}

/// Positions across the fiber at which the distribution of the powers reaches shares that lie at random
/// within equal parts, so that they repeat at no angle.
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
