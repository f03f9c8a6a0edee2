//! The random field of each kind of light, from the covariance of its simulated patterns over all
//! wavelengths.

use super::covariance::{PatternCovariance, refl_and_high, stretched_mean};
use super::options::{KIND_SIDES, NoiseContrast, NoiseOptions};
use super::spectrum::FieldModel;
use plywave::Error;
use plywave_tables::speckle::SpecklePatterns;

/// Covariance and field of each kind.
pub(super) fn field_models(
    patterns: &SpecklePatterns,
    options: &NoiseOptions,
    file: &str,
) -> Result<[(PatternCovariance, FieldModel); 2], Error> {
    let invalid = |key: &str, value: String, hint: &str| Error::Invalid {
        file: file.into(),
        key: key.into(),
        value,
        hint: hint.into(),
    };
    if patterns.kappa.len() < 2 {
        let hint = "noise needs clear and absorbing fibers: give `plywave wave speckle` two values of --kappa";
        return Err(invalid("kappa", format!("{:?}", patterns.kappa), hint));
    }
    if patterns.instances < 2 {
        return Err(invalid("instances", patterns.instances.to_string(), "statistics need two or more"));
    }
    let mut covariances = [Vec::new(), Vec::new()];
    for lambda in 0..patterns.lambda_um.len() {
        for (k, light) in refl_and_high(patterns, lambda, options.polarization).iter().enumerate() {
            covariances[k].push(PatternCovariance::from_patterns(light, KIND_SIDES[k]).of_fibers(options.fibers));
        }
    }
    Ok(covariances.map(|covariances| {
        let (fade, contrast) = fade(&covariances, &patterns.lambda_um);
        let measured = stretched_mean(&covariances, &patterns.lambda_um, contrast);
        let strip = (options.contrast == NoiseContrast::Developed).then(|| strip(patterns, &measured)).flatten();
        let model = match strip {
            Some(covariance) => FieldModel::developed(&covariance, patterns.azimuths),
            None => FieldModel::from_covariance(&measured, options.contrast, patterns.azimuths),
        };
        let fade = if options.contrast == NoiseContrast::Developed { [1.0, 0.0] } else { fade };
        let model = FieldModel { fade, ..model };
        (measured, model)
    }))
}

/// The line `s = fade[0] + fade[1] lambda` of contrasts relative to the largest on it at a simulated
/// wavelength, and that largest contrast. A contrast above 1, which N cannot have, counts as 1 in the line;
/// if all are above 1, the largest is as measured.
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
    let min_contrast = contrasts.iter().copied().fold(f64::INFINITY, f64::min);
    ([(y - slope * x) / top, slope / top], if min_contrast >= 1.0 { contrasts.iter().sum::<f64>() / n } else { top })
}

/// mu^2 of a rough strip as wide as the fiber, mu = `sin(x) / x` with `x = k D d / 2`, for patterns without
/// grains (C does not fall to half within the lags). The reflection of a smooth round fiber has no grains;
/// that of a rough one is a speckle of this correlation. D is half the extinction width of the dark fibers,
/// as for all bodies that are large against the wavelength (van de Hulst 1957, 8.22).
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
