//! The speckle data that a model stores: for each kind, the distribution of the positions across a fiber from
//! which the light comes. The sources of [`super::NoiseField`] are sampled from it.
//!
//! The power spectrum of a pattern over its angle is the distribution of its sources across the fiber: a
//! source at x emits the wave `exp(2 pi i x u / lambda)`. The power is stored at the positions 0, step, 2
//! step, ...; it is the same at -x and x.

use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};
use std::f64::consts::PI;

/// Names of the tensors in a model file.
pub(crate) const NAMES: [&str; 8] = [
    "noise_spectrum",
    "noise_share",
    "noise_seed",
    "noise_step_um",
    "noise_w0_um",
    "noise_lambda_um",
    "noise_fade",
    "noise_contrast",
];
/// Maximum number of positions.
const MAX_POSITIONS: usize = 1 << 13;
/// Maximum waist and position, in wavelengths: beyond, f32 does not resolve the phase.
const MAX_WAVES: f64 = 1e4;

/// Parameters of the speckle noise of a ply (Yu 2025, 6.2).
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseSpectrum {
    /// Seed of the sources.
    pub seed: u64,
    /// `[2][n]`: for each kind, the power of the sources at the positions 0, step, 2 step ... across the
    /// fiber, 0 or more. They sum to 1 if all but the first are counted twice.
    pub spectrum: Vec<f32>,
    /// `[2]`: for each kind, the distance between two positions [um].
    pub step_um: [f64; 2],
    /// `[2]`: for each kind, the field's share b of the mean intensity, 0 to 1.
    pub share: [f64; 2],
    /// Waist of the beam on the ply [um].
    pub w0_um: f64,
    /// Shortest wavelength of the simulated patterns [um].
    pub lambda_um: f64,
    /// `[2][2]`: for each kind, N at a wavelength fades to `1 + s (N - 1)` with
    /// `s = fade[0] + fade[1] lambda_um`, clamped to [0, 1].
    pub fade: [[f64; 2]; 2],
    /// `[2]`: for each kind, the contrast of the simulated fibers, for information.
    pub contrast: [f64; 2],
}

impl NoiseSpectrum {
    /// Width s of the correlation `exp(-q^2 / (2 s^2))` along v, for a beam of waist w0 at a wavelength.
    pub fn width_v(lambda_um: f64, w0_um: f64) -> f64 {
        lambda_um / (PI * w0_um)
    }

    /// Powers of the sources of a kind (0 or 1) by position; empty for any other kind.
    pub fn powers(&self, kind: usize) -> &[f32] {
        let n = self.spectrum.len() / 2;
        if kind > 1 { &[] } else { &self.spectrum[kind * n..(kind + 1) * n] }
    }

    /// Correlation of the field of a kind at two angles u that differ by `lag_rad`, at a wavelength.
    pub fn correlation(&self, kind: usize, lag_rad: f64, lambda_um: f64) -> f64 {
        let turn = 2.0 * PI * self.step_um[kind.min(1)] / lambda_um * lag_rad;
        let wave = |(j, p): (usize, &f32)| f64::from(if j > 0 { 2.0 * p } else { *p }) * (turn * j as f64).cos();
        self.powers(kind).iter().enumerate().map(wave).sum()
    }

    pub(crate) fn write(&self, w: &mut Writer) {
        w.f32(NAMES[0], &[2, self.spectrum.len() / 2], self.spectrum.iter().copied());
        w.f64(NAMES[1], &[2], &self.share);
        w.u64(NAMES[2], &[1], &[self.seed]);
        w.f64(NAMES[3], &[2], &self.step_um);
        w.f64(NAMES[4], &[1], &[self.w0_um]);
        w.f64(NAMES[5], &[1], &[self.lambda_um]);
        w.f64(NAMES[6], &[2, 2], self.fade.as_flattened());
        w.f64(NAMES[7], &[2], &self.contrast);
    }

    pub(crate) fn read(r: &Reader<'_>) -> Result<Option<NoiseSpectrum>> {
        if !NAMES.iter().any(|name| r.has(name)) {
            return Ok(None);
        }
        let pair = |name: &str| r.f64(name, &[2]).map(|v| [v[0], v[1]]);
        let positions = r.shape(NAMES[0], 2)?[1];
        let fade = r.f64(NAMES[6], &[2, 2])?;
        Ok(Some(NoiseSpectrum {
            seed: r.u64(NAMES[2], &[1])?[0],
            spectrum: r.f32(NAMES[0], &[2, positions])?,
            step_um: pair(NAMES[3])?,
            share: pair(NAMES[1])?,
            w0_um: r.f64(NAMES[4], &[1])?[0],
            lambda_um: r.f64(NAMES[5], &[1])?[0],
            fade: [[fade[0], fade[1]], [fade[2], fade[3]]],
            contrast: pair(NAMES[7])?,
        }))
    }

    /// Checks the parts of the noise that do not depend on its spectrum: wavelength, waist, contrasts. The
    /// spectrum may be absent, so a fit can call this before it starts. `name` identifies the file in
    /// messages.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid), the same that saving returns.
    pub fn check_frame(&self, name: &str) -> Result<()> {
        let c = Check(name);
        c.range(NAMES[5], &[self.lambda_um], 0.01, 100.0)?;
        let max_um = MAX_WAVES * self.lambda_um;
        c.range(NAMES[4], &[self.w0_um], 1e-9, max_um)?;
        c.range(NAMES[3], &self.step_um, 1e-9, max_um)?;
        c.range(NAMES[6], self.fade.as_flattened(), -100.0, 100.0)?;
        c.range(NAMES[7], &self.contrast, 0.0, 1e3)
    }

    pub(crate) fn check(&self, c: &Check<'_>) -> Result<()> {
        self.check_frame(c.0)?;
        let n = self.spectrum.len() / 2;
        if !(1..=MAX_POSITIONS).contains(&n) {
            return Err(invalid(
                c.0,
                NAMES[0],
                format!("{n} values a kind"),
                &format!("expected 1 to {MAX_POSITIONS}"),
            ));
        }
        c.len(NAMES[0], self.spectrum.len(), &[2, n])?;
        c.range_f32(NAMES[0], &self.spectrum, 0.0, 1.0)?;
        c.range(NAMES[1], &self.share, 0.0, 1.0)?;
        let max_um = MAX_WAVES * self.lambda_um / n as f64;
        c.range(NAMES[3], &self.step_um, 1e-9, max_um)?;
        for kind in 0..2 {
            let powers = self.powers(kind);
            let sum = 2.0 * powers.iter().map(|p| f64::from(*p)).sum::<f64>() - f64::from(powers[0]);
            if (sum - 1.0).abs() > 1e-3 {
                return Err(invalid(c.0, &format!("{} [{kind}]", NAMES[0]), sum, "the powers must add up to 1"));
            }
        }
        Ok(())
    }
}
