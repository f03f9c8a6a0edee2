//! The spectrum of a kind's tiles: the intensity of a periodic Gaussian field over (v, u), which the runtime
//! synthesizes ([`NoiseSpectrum`]).
//!
//! The field's correlation is that of the azimuth along u times that of the illuminated length along v.
//!
//! Bilinear interpolation between four nodes keeps the mean but not the variance: over a cell,
//! `(4 + 2 c_10 + 2 c_01 + c_11) / 9` of it remains, where c is the covariance of neighboring nodes over the
//! variance. The nodes' variance is raised to compensate, up to 1.

use super::options::NoiseOptions;
use super::spectrum::{FieldModel, intensity_covariance, share_of, spectrum_of};
use plywave::speckle::{NoiseSpectrum, NoiseTiles};
use std::f64::consts::PI;

/// Largest lag of the field model [rad].
const LAGS_RAD: f64 = PI / 6.0;

/// Field of the tiles of one kind of light.
pub struct TileField {
    /// Share of the fluctuating field at the nodes.
    pub share: f64,
    /// Power at harmonics 0 to U/2 along u.
    pub spectrum_u: Vec<f64>,
    /// Variance between the nodes over that at the nodes.
    pub kept: f64,
}

/// Step between nodes along v: the square of the correlation, the narrowest that the covariance can be, has
/// its half width at s sqrt(ln 2).
pub fn step_v(lambda_um: f64, options: &NoiseOptions) -> f64 {
    NoiseSpectrum::width_v(lambda_um, options.w0_um) * 2f64.ln().sqrt() / options.nodes_a_half_width
}

/// Step between nodes along u [rad].
pub fn step_u(model: &FieldModel, options: &NoiseOptions) -> f64 {
    model.half_width_rad(LAGS_RAD) / options.nodes_a_half_width
}

/// The field of one kind on the nodes.
pub fn field(model: &FieldModel, lambda_um: f64, options: &NoiseOptions) -> TileField {
    let columns = options.columns;
    let s = NoiseSpectrum::width_v(lambda_um, options.w0_um);
    let (step_v, step_u) = (step_v(lambda_um, options), step_u(model, options));
    let along_v = |node: f64| (-0.5 * (node * step_v / s).powi(2)).exp();
    let lags = ((LAGS_RAD / step_u) as usize).min(2 * columns / 5);
    // More variance at the nodes compensates for the loss of the interpolation between them; the loss depends
    // on the share.
    let wanted = intensity_covariance(model.share, 1.0);
    let kept = |share: f64| {
        let c = |v: f64, u: f64| intensity_covariance(share, along_v(v) * model.correlation(u * step_u));
        (4.0 * c(0.0, 0.0) + 2.0 * (c(1.0, 0.0) + c(0.0, 1.0)) + c(1.0, 1.0)) / 9.0
    };
    let mut variance = wanted;
    for _ in 0..20 {
        let loss = kept(share_of(variance));
        variance = if loss > 0.0 { (variance * wanted / loss).min(1.0) } else { 0.0 };
    }
    let share = share_of(variance);
    let covariance = |j: usize| intensity_covariance(share, model.correlation(step_u * j as f64));
    let spectrum_u = if share > 0.0 {
        spectrum_of(share, &(0..=lags).map(covariance).collect::<Vec<_>>(), columns)
    } else {
        // Without a field the spectrum is arbitrary.
        (0..=columns / 2).map(|q| if q == 0 { 1.0 } else { 0.0 }).collect()
    };
    TileField { share, spectrum_u, kept: if variance > 0.0 { kept(share) / variance } else { 0.0 } }
}

/// Measured properties of the tiles of one kind.
pub struct Measured {
    /// Contrast at the nodes.
    pub contrast_nodes: f64,
    /// Largest error of a coded value, over the standard deviation of its tile.
    pub coding_error: f64,
}

/// Measures the tiles that the runtime synthesizes from `spectrum`, against the values that they code.
pub fn measured(spectrum: &NoiseSpectrum, tiles: &NoiseTiles, kind: usize) -> Measured {
    let (mut squares, mut coding_error) = (0.0, 0.0f64);
    for tile in 0..spectrum.sizes[0] {
        let values = spectrum.values(kind, tile);
        let variance = values.iter().map(|v| (v - 1.0).powi(2)).sum::<f64>() / values.len() as f64;
        squares += variance / spectrum.sizes[0] as f64;
        if variance > 0.0 {
            let coded = tiles.tile(kind, tile);
            let worst = coded.iter().zip(&values).map(|(c, v)| (f64::from(*c) - v).abs()).fold(0.0, f64::max);
            coding_error = coding_error.max(worst / variance.sqrt());
        }
    }
    Measured { contrast_nodes: squares.sqrt(), coding_error }
}
