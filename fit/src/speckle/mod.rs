//! Noise from the patterns of simulated fibers (Yu 2025, 6.2, Eq. 19-23; supplement not at hand,
//! `docs/explain/papers.md`).
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
//! N cannot have a contrast above 1 (glints of flat faces, turned at random); then b = 1, and the report says
//! so. Where several fibers are in view, their light adds up incoherently, and C is that of one fiber divided
//! by their number.
//!
//! One field serves all wavelengths by a stretch, so C / C(0) is the mean over the simulated wavelengths,
//! each at its stretched lag. Their contrasts differ too:
//! a straight line over the wavelength is fitted to them. The field has the largest contrast on that line; at
//! the other wavelengths N fades to `1 + s (N - 1)`, s <= 1, which keeps mean and sign and scales C by s^2.

mod covariance;
mod fields;
mod line;
mod options;
mod spectrum;
mod tile;

pub use covariance::{PatternCovariance, refl_and_high, stretched_mean};
pub use line::{LineComparison, LinePatterns, compare_lines};
pub use options::{KIND_NAMES, KIND_SIDES, NoiseContrast, NoiseOptions};
pub use spectrum::{FieldModel, intensity_covariance};

use fields::field_models;
use plywave::Error;
use plywave::speckle::{NoiseSpectrum, NoiseTiles, SpecklePatterns};

/// Source of the noise of one kind of light.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseKind {
    /// Covariance of the simulated patterns at all wavelengths, stretched to the shortest.
    pub measured: PatternCovariance,
    /// Field fitted to that covariance.
    pub model: FieldModel,
    /// Contrast of the tiles at their nodes.
    pub contrast_nodes: f64,
    /// Mean contrast of lookups between the tiles' nodes.
    pub contrast: f64,
    /// Largest error of a coded value, over the standard deviation of the tile.
    pub coding_error: f64,
}

/// Computes the noise of the light of `patterns`, which need clear and absorbing fibers (first and last
/// kappa). Also returns its sources, f_refl first. Its tiles, which the runtime synthesizes, are those of the
/// shortest wavelength. `file` is for messages.
///
/// # Errors
/// [`Error::Invalid`] for patterns without absorbing fibers or of fewer than two instances.
pub fn noise_tiles(
    patterns: &SpecklePatterns,
    options: &NoiseOptions,
    file: &str,
) -> Result<(NoiseSpectrum, [NoiseKind; 2]), Error> {
    check_savable(patterns, options, file)?;
    let models = field_models(patterns, options, file)?;
    let mut noise = frame(patterns, options, Some(&models));
    noise.check_frame(file)?;
    let fields = models.each_ref().map(|(_, model)| tile::field(model, patterns.lambda_um[0], options));
    noise.share = fields.each_ref().map(|field| field.share);
    noise.spectrum = fields.iter().flat_map(|field| &field.spectrum_u).map(|power| *power as f32).collect();
    let tiles = noise.tiles();
    let measured = [0, 1].map(|kind| tile::measured(&noise, &tiles, kind));
    let mut kind = 0;
    let kinds = models.map(|(covariance, model)| {
        let (of, field) = (&measured[kind], &fields[kind]);
        let contrast = of.contrast_nodes * field.kept.sqrt();
        noise.contrast[kind][1] = contrast;
        kind += 1;
        let (contrast_nodes, coding_error) = (of.contrast_nodes, of.coding_error);
        NoiseKind { measured: covariance, model, contrast_nodes, contrast, coding_error }
    });
    Ok((noise, kinds))
}

/// Refuses patterns and options whose tiles no model can hold, whatever the patterns' values. This costs
/// nothing. `file` stands for the patterns in messages.
///
/// # Errors
/// [`Error::Invalid`].
pub fn check_savable(patterns: &SpecklePatterns, options: &NoiseOptions, file: &str) -> Result<(), Error> {
    let ([least, most], step) = (NoiseTiles::STEPS, tile::step_v(patterns.lambda_um[0], options));
    // The step is inversely proportional to the waist.
    let waist = |other: f64| options.w0_um * step / other;
    if !(step >= least && step <= most) {
        let hint = format!(
            "patterns of {} um make tiles that a model can hold in a beam of waist {:.3} to {:.3} um",
            patterns.lambda_um[0],
            waist(most),
            waist(least)
        );
        return Err(Error::Invalid { file: file.into(), key: "w0_um".into(), value: options.w0_um.to_string(), hint });
    }
    frame(patterns, options, None).check_frame(file)
}

/// The noise without its spectrum; without `models`, also without data of the light.
fn frame(
    patterns: &SpecklePatterns,
    options: &NoiseOptions,
    models: Option<&[(PatternCovariance, FieldModel); 2]>,
) -> NoiseSpectrum {
    let step_v = tile::step_v(patterns.lambda_um[0], options);
    let kinds = models.map_or([None; 2], |models| models.each_ref().map(Some));
    NoiseSpectrum {
        sizes: [options.tiles, options.rows, options.columns],
        seed: options.seed,
        spectrum: Vec::new(),
        share: [0.0; 2],
        w0_um: options.w0_um,
        step: kinds.map(|kind| [step_v, kind.map_or(step_v, |(_, model)| tile::step_u(model, options))]),
        lambda_um: patterns.lambda_um[0],
        fade: kinds.map(|kind| kind.map_or([1.0, 0.0], |(_, model)| model.fade)),
        contrast: kinds.map(|kind| [kind.map_or(0.0, |(measured, _)| measured.contrast()), 0.0]),
    }
}
