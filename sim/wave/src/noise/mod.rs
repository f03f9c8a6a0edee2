//! Noise from the patterns of simulated fibers (Yu 2025, 6.2, Eq. 19-23; supplement not at hand,
//! `docs/explain/papers/yu_2025.md`).
//!
//! The light of one kind in one direction is modeled as `N = |a + sqrt(b) g|^2` times its mean, a a constant
//! phasor and g a circular complex Gaussian process of unit variance and correlation mu, `a^2 + b = 1`. Then
//! N has mean 1 and, by the moments of Gaussian variables,
//!
//! ```text
//! C(d) = <N(x) N(x + d)> - 1 = 2 b (1 - b) mu(d) + b^2 mu(d)^2            (mu real)
//! C(0) = 1 - (1 - b)^2
//! ```
//!
//! so that b follows from the contrast sqrt(C(0)) and mu from the covariance, `spectrum.rs`. The paper's form
//! is b = 1, a fully developed speckle of contrast 1 with `C = mu^2`, whose covariance cannot be negative.
//! The light of one smooth fiber is the sum of few rays: its contrast is below 1, and its covariance swings
//! below 0 as their fringes do, which the constant phasor allows.
//!
//! N cannot have a contrast above 1 (glints of flat faces, rotated at random); then b = 1, and the report
//! says so. Where several fibers are in view, their light adds up incoherently, and C is that of one fiber
//! divided by their number.
//!
//! One field serves all wavelengths by a stretch, so C / C(0) is the mean over the simulated wavelengths,
//! each at its stretched lag. Their contrasts differ too:
//! a straight line over the wavelength is fitted to them. The field has the largest contrast on that line; at
//! the other wavelengths N fades to `1 + s (N - 1)`, s <= 1, which keeps mean and sign and scales C by s^2.
//!
//! The power of the field at harmonic q of the azimuth is that of sources at `q lambda / (2 pi)` across the
//! fiber, which a model stores ([`NoiseSpectrum`]).

mod covariance;
mod fields;
mod line;
mod options;
mod spectrum;

pub use covariance::{PatternCovariance, refl_and_high, stretched_mean};
pub use line::{LineComparison, LinePatterns, compare_lines};
pub use options::{KIND_NAMES, KIND_SIDES, NoiseContrast, NoiseOptions};
pub use spectrum::{FieldModel, intensity_covariance};

use fields::field_models;
use plywave::Error;
use plywave::speckle::NoiseSpectrum;
use plywave_tables::speckle::SpecklePatterns;
use std::f64::consts::TAU;

/// Source of the noise of one kind of light.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseKind {
    /// Covariance of the simulated patterns at all wavelengths, stretched to the shortest.
    pub measured: PatternCovariance,
    /// Field fitted to that covariance.
    pub model: FieldModel,
}

/// Computes the noise of the light of `patterns`, which need clear and absorbing fibers (first and last
/// kappa). Also returns its sources, f_refl first. `file` is for messages.
///
/// # Errors
/// [`Error::Invalid`] for patterns without absorbing fibers or of fewer than two instances.
pub fn noise_spectrum(
    patterns: &SpecklePatterns,
    options: &NoiseOptions,
    file: &str,
) -> Result<(NoiseSpectrum, [NoiseKind; 2]), Error> {
    check_savable(patterns, options, file)?;
    let kinds = field_models(patterns, options, file)?.map(|(measured, model)| NoiseKind { measured, model });
    let noise = NoiseSpectrum {
        spectrum: kinds.iter().flat_map(|kind| powers(&kind.model)).collect(),
        share: kinds.each_ref().map(|kind| kind.model.share),
        fade: kinds.each_ref().map(|kind| kind.model.fade),
        contrast: kinds.each_ref().map(|kind| kind.measured.contrast()),
        ..frame(patterns, options)
    };
    noise.check_frame(file)?;
    Ok((noise, kinds))
}

/// Power of the sources at 0, step, 2 step ... of which all but the first count twice.
fn powers(model: &FieldModel) -> impl Iterator<Item = f32> {
    let once = |k: usize| if k > 0 && 2 * k == model.azimuths { 0.5 } else { 1.0 };
    model.spectrum.iter().enumerate().map(move |(k, power)| (once(k) * power) as f32)
}

/// Refuses patterns and options whose noise no model can hold for any values of the patterns. This costs
/// nothing. `file` stands for the patterns in messages.
///
/// # Errors
/// [`Error::Invalid`] for such patterns or options.
pub fn check_savable(patterns: &SpecklePatterns, options: &NoiseOptions, file: &str) -> Result<(), Error> {
    frame(patterns, options).check_frame(file)
}

/// The noise with the options alone, before the patterns are evaluated.
fn frame(patterns: &SpecklePatterns, options: &NoiseOptions) -> NoiseSpectrum {
    let lambda_um = patterns.lambda_um[0];
    NoiseSpectrum {
        seed: options.seed,
        spectrum: Vec::new(),
        step_um: [lambda_um / TAU; 2],
        share: [0.0; 2],
        w0_um: options.w0_um,
        lambda_um,
        fade: [[1.0, 0.0]; 2],
        contrast: [0.0; 2],
    }
}
