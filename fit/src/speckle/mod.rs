//! Noise tiles from the patterns of simulated fibers (Yu 2025, 6.2, Eq. 19-23; supplement not at hand, `docs/papers.md`).
//!
//! The light of one kind in one direction is taken for `N = |a + sqrt(b) g|^2` times its mean, a a constant phasor and g a circular complex Gaussian process of
//! unit variance and correlation mu, `a^2 + b = 1`. Then N has mean 1 and, by the moments of Gaussian variables,
//!
//! ```text
//! C(d) = <N(x) N(x + d)> - 1 = 2 b (1 - b) mu(d) + b^2 mu(d)^2            (mu real)
//! C(0) = 1 - (1 - b)^2
//! ```
//!
//! so that b follows from the contrast sqrt(C(0)) and mu from the covariance, `noise/spectrum.rs`. The paper's form is b = 1, a fully developed speckle of contrast 1
//! with `C = mu^2`, whose covariance cannot be negative. The light of one smooth fiber is the sum of few rays: its contrast is below 1, and its
//! covariance swings below 0 as their fringes do, which the constant phasor allows.
//!
//! A contrast above 1 (glints of flat faces, turned at random) is more than N can have; b = 1 then, and the report tells it. Where several fibers are in view
//! whose light adds up without phase, C is that of one over their number.
//!
//! One field serves all wavelengths by a stretch, so C / C(0) is the mean over the simulated wavelengths, each at its stretched lag. Their contrasts differ too;
//! a straight line over the wavelength is fitted to them, the field has the largest on it, and N fades to the others as `1 + s (N - 1)`, s <= 1, which keeps mean
//! and sign and scales C by s^2.

mod covariance;
mod line;
mod spectrum;
mod tile;

pub use covariance::{PatternCovariance, refl_and_high, stretched_mean};
pub use line::{LineComparison, LinePatterns, compare_lines};
pub use spectrum::{FieldModel, intensity_covariance};

use plywave::{Error, NoiseTiles, SpecklePatterns, SpecklePolarization, SpeckleSide};

/// What the noise is to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoiseContrast {
    /// The contrast and the covariance of the simulated fibers.
    Measured,
    /// Contrast 1 and `mu^2 = max(C / C(0), 0)`: Yu 2025, Eq. 19-22.
    Developed,
}

/// Sizes and choices.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseOptions {
    /// Seed of the tiles.
    pub seed: u64,
    /// Tiles a kind, a power of two.
    pub tiles: usize,
    /// Nodes along v, a power of two.
    pub rows: usize,
    /// Nodes along u, a power of two.
    pub columns: usize,
    /// Nodes in the half width at half height of the covariance.
    pub nodes_a_half_width: f64,
    /// Waist of the beam on the ply [um], which is the length that is lit.
    pub w0_um: f64,
    /// Light of which polarization; renderers have unpolarized light.
    pub polarization: SpecklePolarization,
    /// Fibers that are in view at once, whose patterns add up.
    pub fibers: u32,
    /// Contrast of the noise.
    pub contrast: NoiseContrast,
}

impl Default for NoiseOptions {
    fn default() -> Self {
        NoiseOptions {
            seed: 1,
            tiles: 4,
            rows: 512,
            columns: 1024,
            nodes_a_half_width: 4.0,
            w0_um: 10.0,
            polarization: SpecklePolarization::Unpolarized,
            fibers: 1,
            contrast: NoiseContrast::Measured,
        }
    }
}

/// The azimuths that the statistics of f_refl and f_high look at. Behind a dark fiber there is diffracted light, which is no reflection.
pub const KIND_SIDES: [SpeckleSide; 2] = [SpeckleSide::Reflection, SpeckleSide::All];
/// Names of the kinds.
pub const KIND_NAMES: [&str; 2] = ["refl", "high"];

/// What a kind's noise was made of.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseKind {
    /// Of the simulated patterns at all wavelengths, stretched to the shortest.
    pub measured: PatternCovariance,
    /// The field fitted to it.
    pub model: FieldModel,
    /// Contrast of the tiles at their nodes.
    pub contrast_nodes: f64,
    /// Contrast of the tiles looked up between the nodes, on average.
    pub contrast: f64,
    /// Largest error of a coded value, over the standard deviation of the tile.
    pub coding_error: f64,
}

/// Tiles of the light of `patterns`, which need clear and absorbing fibers (first and last kappa), and what they were made of, f_refl first. The shortest
/// wavelength is the tiles' own. `file` is for messages.
///
/// # Errors
/// [`Error::Invalid`] for patterns without absorbing fibers or of fewer than two instances.
pub fn noise_tiles(
    patterns: &SpecklePatterns,
    options: &NoiseOptions,
    file: &str,
) -> Result<(NoiseTiles, [NoiseKind; 2]), Error> {
    let models = field_models(patterns, options, file)?;
    let mut tiles = Vec::new();
    let mut code = Vec::new();
    let (mut step, mut contrast, mut fade) = ([[0.0; 2]; 2], [[0.0; 2]; 2], [[0.0; 2]; 2]);
    let mut kinds = Vec::new();
    for (k, (measured, model)) in models.into_iter().enumerate() {
        let made =
            tile::tiles(&model, patterns.lambda_um[0], options, options.seed.wrapping_mul(2).wrapping_add(k as u64));
        tiles.extend(made.codes);
        code.extend(made.code);
        step[k] = made.step;
        fade[k] = model.fade;
        contrast[k] = [measured.contrast(), made.contrast];
        kinds.push(NoiseKind {
            measured,
            model,
            contrast_nodes: made.contrast_nodes,
            contrast: made.contrast,
            coding_error: made.coding_error,
        });
    }
    let sizes = [options.tiles, options.rows, options.columns];
    let tiles = NoiseTiles { tiles, sizes, code, step, lambda_um: patterns.lambda_um[0], fade, contrast };
    let [refl, high]: [NoiseKind; 2] = match kinds.try_into() {
        Ok(kinds) => kinds,
        Err(_) => unreachable!("one for each of the two kinds"),
    };
    Ok((tiles, [refl, high]))
}

/// Covariance and field of each kind.
fn field_models(
    patterns: &SpecklePatterns,
    options: &NoiseOptions,
    file: &str,
) -> Result<[(PatternCovariance, FieldModel); 2], Error> {
    let invalid = |key: &str, value: String, mend: &str| Error::Invalid {
        file: file.into(),
        key: key.into(),
        value,
        mend: mend.into(),
    };
    if patterns.kappa.len() < 2 {
        let mend = "noise needs clear and absorbing fibers: give `plywave wave speckle` two values of --kappa";
        return Err(invalid("kappa", format!("{:?}", patterns.kappa), mend));
    }
    if patterns.instances < 2 {
        return Err(invalid("instances", patterns.instances.to_string(), "statistics need two or more"));
    }
    let mut covariances = [Vec::new(), Vec::new()];
    for lambda in 0..patterns.lambda_um.len() {
        for (k, light) in refl_and_high(patterns, lambda, options.polarization).iter().enumerate() {
            covariances[k].push(PatternCovariance::of(light, KIND_SIDES[k]).of_fibers(options.fibers));
        }
    }
    Ok(covariances.map(|covariances| {
        let (fade, contrast) = fade(&covariances, &patterns.lambda_um);
        let measured = stretched_mean(&covariances, &patterns.lambda_um, contrast);
        let strip = (options.contrast == NoiseContrast::Developed).then(|| strip(patterns, &measured)).flatten();
        let model = match strip {
            Some(covariance) => FieldModel::developed(&covariance, patterns.azimuths),
            None => FieldModel::of(&measured, options.contrast, patterns.azimuths),
        };
        let fade = if options.contrast == NoiseContrast::Developed { [1.0, 0.0] } else { fade };
        let model = FieldModel { fade, ..model };
        (measured, model)
    }))
}

/// The line `s = fade[0] + fade[1] lambda` by which contrasts fall from the largest on it at a simulated wavelength, and that largest. A contrast above 1, which N
/// cannot have, counts as 1 in the line; the largest is as measured where all are above.
fn fade(covariances: &[PatternCovariance], lambda_um: &[f64]) -> ([f64; 2], f64) {
    let contrasts: Vec<f64> = covariances.iter().map(PatternCovariance::contrast).collect();
    let n = contrasts.len() as f64;
    let capped: Vec<f64> = contrasts.iter().map(|c| c.min(1.0)).collect();
    let (x, y) = (lambda_um.iter().sum::<f64>() / n, capped.iter().sum::<f64>() / n);
    let spread: f64 = lambda_um.iter().map(|l| (l - x).powi(2)).sum();
    let slope = if spread > 0.0 {
        lambda_um.iter().zip(&capped).map(|(l, c)| (l - x) * (c - y)).sum::<f64>() / spread
    } else {
        0.0
    };
    let top = lambda_um.iter().map(|l| y + slope * (l - x)).fold(0.0, f64::max);
    if top.is_nan() || top <= 0.0 {
        return ([1.0, 0.0], 0.0);
    }
    let least = contrasts.iter().copied().fold(f64::INFINITY, f64::min);
    ([(y - slope * x) / top, slope / top], if least >= 1.0 { contrasts.iter().sum::<f64>() / n } else { top })
}

/// mu^2 of a rough strip as wide as the fiber, mu = `sin(x) / x` with `x = k D d / 2`, for patterns without grains (C does not fall to half within the lags): the
/// reflection of a smooth round fiber has none, that of a rough one is a speckle of this correlation. D is half the extinction width of the dark fibers, as it
/// is for all that is large beside the wavelength (van de Hulst 1957, 8.22).
fn strip(patterns: &SpecklePatterns, measured: &PatternCovariance) -> Option<Vec<f64>> {
    if measured.values.iter().any(|c| *c <= 0.5 * measured.variance()) {
        return None;
    }
    let (kinds, n) = (2 * patterns.instances, patterns.kappa.len() * patterns.lambda_um.len());
    let from = (n - patterns.lambda_um.len()) * kinds;
    let width = |all: &[f64]| all[from..from + kinds].iter().sum::<f64>() / kinds as f64;
    let diameter_um = 0.5 * (width(&patterns.c_sca_um) + width(&patterns.c_abs_um));
    let covariance = |lag: usize| {
        let x = std::f64::consts::PI / patterns.lambda_um[0] * diameter_um * measured.step_rad * lag as f64;
        if x > 0.0 { (x.sin() / x).powi(2) } else { 1.0 }
    };
    Some((0..measured.values.len()).map(covariance).collect())
}
