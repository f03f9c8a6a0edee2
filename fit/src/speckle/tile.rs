//! Tiles: the intensity of a periodic Gaussian field over (v, u), coded in bytes.
//!
//! The field's correlation is that of the azimuth along u times that of the illuminated length along v. A beam of waist w0 illuminates the ply with the intensity
//! exp(-2 z^2 / w0^2); the correlation of the far field is the Fourier transform of that (van Cittert and Zernike, Goodman 2007, 4.4):
//! `mu(q) = exp(-(k w0 q)^2 / 8)`, q the difference of sin theta.
//!
//! Bilinear interpolation between four nodes keeps the mean but not the variance: over a cell, `(4 + 2 c_10 + 2 c_01 + c_11) / 9` of it remains, c the covariance of
//! neighboring nodes over the variance. The nodes' variance is raised to compensate, up to 1.

use super::options::NoiseOptions;
use super::spectrum::{FieldModel, intensity_covariance, share_of, spectrum_of};
use plywave::speckle::NoiseTiles;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rustfft::{FftPlanner, num_complex::Complex};
use std::f64::consts::{PI, TAU};

/// Largest lag that the field model knows [rad].
const LAGS_RAD: f64 = PI / 6.0;

/// The tiles of one kind of light, coded, and what the coding keeps of their contrast.
pub struct TileSet {
    pub codes: Vec<u8>,
    /// `[T][2]`.
    pub code: Vec<f32>,
    /// Along v and u.
    pub step: [f64; 2],
    pub contrast_nodes: f64,
    pub contrast: f64,
    pub coding_error: f64,
}

/// s of the correlation `exp(-q^2 / (2 s^2))` along v.
fn width_v(lambda_um: f64, options: &NoiseOptions) -> f64 {
    2.0 * lambda_um / (TAU * options.w0_um)
}

/// Step between nodes along v: the square of the correlation, the narrowest that the covariance can be, has its half width at s sqrt(ln 2).
pub fn step_v(lambda_um: f64, options: &NoiseOptions) -> f64 {
    width_v(lambda_um, options) * 2f64.ln().sqrt() / options.nodes_a_half_width
}

/// Step between nodes along u [rad].
pub fn step_u(model: &FieldModel, options: &NoiseOptions) -> f64 {
    model.half_width_rad(LAGS_RAD) / options.nodes_a_half_width
}

/// The tiles of one kind.
pub fn tiles(model: &FieldModel, lambda_um: f64, options: &NoiseOptions, seed: u64) -> TileSet {
    let (rows, columns) = (options.rows, options.columns);
    let s = width_v(lambda_um, options);
    let (step_v, step_u) = (step_v(lambda_um, options), step_u(model, options));
    let along_v = |node: f64| (-0.5 * (node * step_v / s).powi(2)).exp();
    let lags = ((LAGS_RAD / step_u) as usize).min(2 * columns / 5);
    // More variance at the nodes makes up for what the interpolation loses between them; each share has its own loss.
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
        vec![0.0; columns / 2 + 1]
    };
    let spectrum_v: Vec<f64> =
        (0..=rows / 2).map(|k| (-0.5 * (TAU * k as f64 / (rows as f64 * step_v) * s).powi(2)).exp()).collect();
    let twice = |k: usize| if k == 0 || 2 * k == rows { 1.0 } else { 2.0 };
    let sum: f64 = spectrum_v.iter().enumerate().map(|(k, v)| twice(k) * v).sum();
    let (mut codes, mut code, mut coding_error) = (Vec::new(), Vec::new(), 0.0f64);
    let mut squares = 0.0;
    for t in 0..options.tiles {
        let mut rng = Pcg64Mcg::seed_from_u64(seed ^ (t as u64 + 1).wrapping_mul(plywave::math::hash::GAMMA));
        let mut field: Vec<Complex<f64>> = Vec::with_capacity(rows * columns);
        for r in 0..rows {
            for c in 0..columns {
                let power = spectrum_v[r.min(rows - r)] / sum * spectrum_u[c.min(columns - c)];
                let size = (0.5 * share * power).sqrt();
                field.push(Complex::new(StandardNormal.sample(&mut rng), StandardNormal.sample(&mut rng)) * size);
            }
        }
        transform(&mut field, rows, columns);
        let constant = (1.0 - share).sqrt();
        let mut values: Vec<f64> = field.iter().map(|g| (g + constant).norm_sqr()).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        values.iter_mut().for_each(|v| *v /= mean);
        let (coded, [low, step]) = NoiseTiles::code(&values);
        let variance = values.iter().map(|v| (v - 1.0).powi(2)).sum::<f64>() / values.len() as f64;
        squares += variance / options.tiles as f64;
        if variance > 0.0 {
            let back = |c: &u8| (f64::from(low) + f64::from(step) * f64::from(*c)).powi(2);
            let worst = coded.iter().zip(&values).map(|(c, v)| (back(c) - v).abs()).fold(0.0, f64::max);
            coding_error = coding_error.max(worst / variance.sqrt());
        }
        codes.extend(coded);
        code.extend([low, step]);
    }
    let contrast = if variance > 0.0 { (squares * kept(share) / variance).sqrt() } else { 0.0 };
    TileSet { codes, code, step: [step_v, step_u], contrast_nodes: squares.sqrt(), contrast, coding_error }
}

/// Inverse Fourier transform along both axes, not normalized.
fn transform(field: &mut [Complex<f64>], rows: usize, columns: usize) {
    let mut planner = FftPlanner::new();
    planner.plan_fft_inverse(columns).process(field);
    let along = planner.plan_fft_inverse(rows);
    let mut column = vec![Complex::default(); rows];
    for c in 0..columns {
        (0..rows).for_each(|r| column[r] = field[r * columns + c]);
        along.process(&mut column);
        (0..rows).for_each(|r| field[r * columns + c] = column[r]);
    }
}
