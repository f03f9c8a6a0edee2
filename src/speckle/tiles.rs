//! Speckle noise at run time (Yu 2025, 6.2, Eq. 23): factors of mean 1 that convert the smooth f_refl and
//! f_high to those of one instance of the ply.
//!
//! A tile stores N over a plane that wraps in both axes, made at one wavelength ([`super::NoiseSpectrum`]). A
//! speckle pattern is the Fourier transform of the lit area, so at the wavelength lambda it is the same
//! pattern stretched about the direction in which all wavelengths are in phase: angles are looked up times
//! `lambda_ref / lambda`. A difference in contrast is faded, `1 + s(lambda) (N - 1)`. The two coordinates of
//! a direction are
//!
//! ```text
//! f_high:   u = beta cos theta_o                 v = sin theta_o                   beta: azimuth about exact forward
//! f_refl:   u = alpha sqrt(1 - (v/2)^2)          v = sin theta_o + sin theta_i     alpha: azimuth about the light's
//! ```
//!
//! v is the spatial frequency along the ply, `q_z = (omega_o + omega_i)_z` for reflection: a surface's phase
//! is a function of it, so the pattern moves with the light and is otherwise unchanged (memory effect);
//! high-order light has no such memory. Across the ply the patterns of fibers are stationary in the azimuth,
//! not in `q_x = cos theta_o cos phi_o`, whose grains would smear without bound at phi_o = 0 and whose front
//! and back would be mirror images; so u is the arc about the ply's axis, cos theta_o times the azimuth, in
//! which a pattern has no pole. For reflection the cosine is that of the latitude of the half vector, a
//! function of v alone, so the shift is exact. u has a seam opposite to its origin: exact forward for
//! reflection, which is dark there, and the light's azimuth for high-order light; and the pole of f_refl is
//! not the ply's axis, about which its grains narrow. Over [`SEAM_RAD`] beside the seam the two sides are
//! blended; the mean stays 1, the contrast falls to 0.71 of its value at the seam.

use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};
use crate::math::hash::mix64;

/// Half width of the blend at the seam of a pattern [rad].
pub const SEAM_RAD: f32 = 0.15;
/// Names of the tensors in a model file.
pub(crate) const NAMES: [&str; 2] = ["noise_tiles", "noise_code"];
/// Names of the tensors that spectra have too.
pub(crate) const FRAME_NAMES: [&str; 4] = ["noise_step", "noise_lambda_um", "noise_fade", "noise_contrast"];
/// Largest size of tiles [bytes].
const MAX_BYTES: usize = 64 << 20;

/// Tiles of noise, those of f_refl first.
///
/// `N = (low + step code)^2` from a tile's codes, [`NoiseTiles::code`]; its mean over each tile is 1. Between
/// the nodes N is bilinear.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseTiles {
    /// `[2][T][V][U]`: codes. T, V and U are powers of two.
    pub tiles: Vec<u8>,
    /// Number of tiles per kind, of nodes along v and along u.
    pub sizes: [usize; 3],
    /// `[2][T][2]`: low and step of each tile.
    pub code: Vec<f32>,
    /// `[2][2]`: distance between the nodes along v and u.
    pub step: [[f64; 2]; 2],
    /// Wavelength at which the tiles are not stretched [um].
    pub lambda_um: f64,
    /// `[2][2]`: for each kind, N at a wavelength fades to `1 + s (N - 1)` with
    /// `s = fade[0] + fade[1] lambda_um`, clamped to 0 to 1.
    pub fade: [[f64; 2]; 2],
    /// `[2][2]`: for each kind, the contrast of the simulated fibers and that of lookups in these tiles; for
    /// the record.
    pub contrast: [[f64; 2]; 2],
}

/// Selects the patterns of a point of a ply: the tile, the position on it, and its mirroring.
///
/// It is made from a number, 0 for the unstretched corner of the first tile; [`Instance::new`] hashes ply and
/// position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instance(pub(super) u64);

impl Instance {
    /// The instance at a position along a ply's fibers and the offset h of the beam across them [um], in
    /// grains of `grain_um`, for the ply's number: all points within one grain have the same patterns. Grains
    /// lie in rows along the ply, each row shifted by its own part of a grain. Beams of waist w0 at the
    /// distance d light the same fibers up to the covariance `exp(-(d / w0)^2)` of their fields, whose
    /// integral over d is 1.8 w0: grains of twice the waist are a good value, in both directions.
    ///
    /// A grain that is not above 0, or NaN, gives one instance for the whole ply; a NaN position counts as 0.
    pub fn new(ply_id: u32, [along_um, h_um]: [f32; 2], grain_um: f32) -> Instance {
        let [along, across] = [along_um, h_um].map(|um| if grain_um > 0.0 { um / grain_um } else { 0.0 });
        let row = mix64(u64::from(ply_id) << 32 | u64::from((across + 0.5).floor() as i32 as u32));
        const UNIT: f32 = 1.0 / (1u32 << 20) as f32;
        let shift = (row >> 44) as f32 * UNIT;
        let grain = if grain_um > 0.0 { (along + shift).floor() as i32 as u32 } else { 0 };
        Instance(mix64((row ^ 0x9e37_79b9_7f4a_7c15).wrapping_add(u64::from(grain))))
    }

    /// The instance of any number, for hosts with their own hash.
    pub fn from_hash(hash: u64) -> Instance {
        Instance(mix64(hash))
    }
}

impl NoiseTiles {
    /// Values N at the nodes of a tile, `[V][U]`; `kind` 0 for f_refl, 1 for f_high. Empty if there is no
    /// such tile.
    pub fn tile(&self, kind: usize, tile: usize) -> Vec<f32> {
        let [count, rows, columns] = self.sizes;
        if kind > 1 || tile >= count {
            return Vec::new();
        }
        let index = kind * count + tile;
        let (low, step) = (self.code[2 * index], self.code[2 * index + 1]);
        let codes = &self.tiles[index * rows * columns..(index + 1) * rows * columns];
        codes.iter().map(|c| (low + step * f32::from(*c)).powi(2)).collect()
    }

    /// The codes of a tile of values `N >= 0`, with low and step of the root scaled so that the mean of the
    /// coded values is 1: the least and greatest root get the codes 0 and 255. Values that are all 0 or not
    /// finite give a tile of 1.
    pub fn code(values: &[f64]) -> (Vec<u8>, [f32; 2]) {
        NoiseTiles::code_of(values.len(), values.iter().map(|v| v.max(0.0).sqrt()))
    }

    /// [`NoiseTiles::code`] of the roots of values.
    pub(super) fn code_roots(roots: &[f32]) -> (Vec<u8>, [f32; 2]) {
        NoiseTiles::code_of(roots.len(), roots.iter().map(|root| f64::from(*root)))
    }

    fn code_of(count: usize, roots: impl Iterator<Item = f64> + Clone) -> (Vec<u8>, [f32; 2]) {
        let (mut low, mut high) = (f64::INFINITY, 0.0f64);
        for root in roots.clone() {
            (low, high) = (low.min(root), high.max(root));
        }
        if !(high > 0.0 && high.is_finite() && low.is_finite()) {
            return (vec![0; count], [1.0, 0.0]);
        }
        let step = (high - low) / 255.0;
        let per_step = if step > 0.0 { 1.0 / step } else { 0.0 };
        let codes: Vec<u8> = roots.map(|root| ((root - low) * per_step + 0.5) as u8).collect();
        let mut counts = [0u32; 256];
        codes.iter().for_each(|c| counts[usize::from(*c)] += 1);
        let squares = counts.iter().enumerate().map(|(c, n)| f64::from(*n) * (low + step * c as f64).powi(2));
        let scale = (squares.sum::<f64>() / count as f64).sqrt().recip();
        (codes, [(low * scale) as f32, (step * scale) as f32])
    }

    pub(crate) fn write(&self, w: &mut Writer) {
        let [count, rows, columns] = self.sizes;
        w.u8(NAMES[0], &[2, count, rows, columns], &self.tiles);
        w.f32(NAMES[1], &[2, count, 2], self.code.iter().copied());
        write_frame(w, &self.step, self.lambda_um, &self.fade, &self.contrast);
    }

    pub(crate) fn read(r: &Reader<'_>) -> Result<NoiseTiles> {
        let shape = r.shape(NAMES[0], 4)?;
        let (step, lambda_um, fade, contrast) = read_frame(r)?;
        Ok(NoiseTiles {
            tiles: r.u8(NAMES[0], &[2, shape[1], shape[2], shape[3]])?,
            sizes: [shape[1], shape[2], shape[3]],
            code: r.f32(NAMES[1], &[2, shape[1], 2])?,
            step,
            lambda_um,
            fade,
            contrast,
        })
    }

    /// Smallest and largest step between the nodes of a tile in a file, along v [1] and u [rad].
    pub const STEPS: [f64; 2] = [1e-6, 10.0];

    pub(crate) fn check(&self, c: &Check<'_>) -> Result<()> {
        let [count, rows, columns] = self.sizes;
        let small = |n: usize| n.is_power_of_two() && n <= 1 << 20;
        if !(small(count) && small(rows) && small(columns) && rows >= 2 && columns >= 2) {
            let hint = "expected powers of two, two or more nodes along v and u";
            return Err(invalid(c.0, NAMES[0], format!("{:?}", self.sizes), hint));
        }
        if (2 * count * rows).saturating_mul(columns) > MAX_BYTES {
            let hint = format!("expected {MAX_BYTES} values at most");
            return Err(invalid(c.0, NAMES[0], format!("{:?}", self.sizes), &hint));
        }
        check_frame(c, &self.step, self.lambda_um, &self.fade, &self.contrast)?;
        c.len(NAMES[0], self.tiles.len(), &[2, count, rows, columns])?;
        c.len(NAMES[1], self.code.len(), &[2, count, 2])?;
        c.range_f32(NAMES[1], &self.code, 0.0, 100.0)?;
        for kind in 0..2 {
            for tile in 0..count {
                let values = self.tile(kind, tile);
                let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64;
                if (mean - 1.0).abs() > 1e-3 {
                    let key = format!("{} mean of tile [{kind}][{tile}]", NAMES[0]);
                    return Err(invalid(c.0, &key, mean, "expected 1, to 1e-3"));
                }
            }
        }
        Ok(())
    }
}

type Pairs = [[f64; 2]; 2];

/// Writes the tensors that tiles and spectra share: step, wavelength, fade and contrast.
pub(super) fn write_frame(w: &mut Writer, step: &Pairs, lambda_um: f64, fade: &Pairs, contrast: &Pairs) {
    w.f64(FRAME_NAMES[0], &[2, 2], step.as_flattened());
    w.f64(FRAME_NAMES[1], &[1], &[lambda_um]);
    w.f64(FRAME_NAMES[2], &[2, 2], fade.as_flattened());
    w.f64(FRAME_NAMES[3], &[2, 2], contrast.as_flattened());
}

pub(super) fn read_frame(r: &Reader<'_>) -> Result<(Pairs, f64, Pairs, Pairs)> {
    let pairs = |name: &str| {
        let v = r.f64(name, &[2, 2])?;
        Ok([[v[0], v[1]], [v[2], v[3]]])
    };
    let lambda_um = r.f64(FRAME_NAMES[1], &[1])?[0];
    Ok((pairs(FRAME_NAMES[0])?, lambda_um, pairs(FRAME_NAMES[2])?, pairs(FRAME_NAMES[3])?))
}

pub(super) fn check_frame(c: &Check<'_>, step: &Pairs, lambda_um: f64, fade: &Pairs, contrast: &Pairs) -> Result<()> {
    c.range(FRAME_NAMES[0], step.as_flattened(), NoiseTiles::STEPS[0], NoiseTiles::STEPS[1])?;
    c.range(FRAME_NAMES[1], &[lambda_um], 0.01, 100.0)?;
    c.range(FRAME_NAMES[2], fade.as_flattened(), -100.0, 100.0)?;
    c.range(FRAME_NAMES[3], contrast.as_flattened(), 0.0, 1e3)
}
