//! Covariance of the patterns of instances, from sums over all azimuths.
//!
//! `C(d) = <(I(phi) - m(phi)) (I(phi + d) - m(phi + d))> / <m(phi) m(phi + d)>`, where m is the mean over the
//! instances. This is a ratio of sums over the azimuths, so directions are weighted by their light. The mean
//! of the ratios, [`plywave_tables::speckle::SpeckleStatistics`], is meaningless for high-order light: that
//! is the difference of two patterns, so its mean over the instances may be near 0.

use plywave_tables::speckle::{SpecklePatterns, SpecklePolarization, SpeckleSide};
use rustfft::{FftPlanner, num_complex::Complex};
use std::f64::consts::{PI, TAU};

/// Maximum lag [rad].
const LAGS_RAD: f64 = PI / 6.0;

/// Covariance of patterns over the square of their mean.
#[derive(Clone, Debug, PartialEq)]
pub struct PatternCovariance {
    /// Distance of two lags [rad].
    pub step_rad: f64,
    /// `[lag]`, from 0 to 30 degrees.
    pub values: Vec<f64>,
    /// `[lag]`: standard error, from instance to instance.
    pub errors: Vec<f64>,
}

impl PatternCovariance {
    /// Covariance of `patterns`, `[n][azimuths]`, over the azimuths of a side.
    pub fn from_patterns(patterns: &[Vec<f64>], side: SpeckleSide) -> PatternCovariance {
        let (n, d) = (patterns.len(), patterns.first().map_or(0, Vec::len));
        let step_rad = TAU / d.max(1) as f64;
        let lags = ((LAGS_RAD / step_rad).round() as usize).min(d / 2) + 1;
        let mut mean = vec![0.0; d];
        for pattern in patterns {
            mean.iter_mut().zip(pattern).for_each(|(m, v)| *m += v / n as f64);
        }
        let is_included = |j: usize| side.holds(step_rad * j as f64);
        let weight: Vec<f64> = (0..d).map(|j| if is_included(j) { mean[j] } else { 0.0 }).collect();
        let (mut sums, mut squares) = (vec![0.0; lags], vec![0.0; lags]);
        let mut planner = FftPlanner::new();
        let (forward, inverse) = (planner.plan_fft_forward(d), planner.plan_fft_inverse(d));
        let own = |values: Vec<f64>| -> Vec<f64> {
            let mut z: Vec<Complex<f64>> = values.into_iter().map(|v| Complex::new(v, 0.0)).collect();
            forward.process(&mut z);
            z.iter_mut().for_each(|z| *z = Complex::new(z.norm_sqr() / d as f64, 0.0));
            inverse.process(&mut z);
            z.into_iter().take(lags).map(|z| z.re).collect()
        };
        for pattern in patterns {
            let off = (0..d).map(|j| if is_included(j) { pattern[j] - mean[j] } else { 0.0 }).collect();
            for ((sum, square), own) in sums.iter_mut().zip(&mut squares).zip(own(off)) {
                *sum += own;
                *square += own * own;
            }
        }
        let norm = own(weight);
        // The mean includes the instance itself, which removes 1/n of the covariance.
        let unbiased = if n > 1 { n as f64 / (n - 1) as f64 } else { 0.0 };
        let over = |v: f64, lag: usize| if norm[lag] > 0.0 { v / norm[lag] } else { 0.0 };
        let values = (0..lags).map(|lag| over(unbiased * sums[lag] / n as f64, lag)).collect();
        let errors = (0..lags)
            .map(|lag| {
                let spread = (squares[lag] - sums[lag] * sums[lag] / n as f64).max(0.0);
                over((spread * unbiased).sqrt() / n as f64, lag)
            })
            .collect();
        PatternCovariance { step_rad, values, errors }
    }

    /// Covariance of the sum of `fibers` independent patterns.
    pub fn of_fibers(mut self, fibers: u32) -> PatternCovariance {
        let scale = 1.0 / f64::from(fibers.max(1));
        self.values.iter_mut().chain(&mut self.errors).for_each(|v| *v *= scale);
        self
    }

    /// Standard deviation of the intensity over its mean.
    pub fn contrast(&self) -> f64 {
        self.variance().max(0.0).sqrt()
    }

    /// Square of the contrast.
    pub fn variance(&self) -> f64 {
        self.values.first().copied().unwrap_or(0.0)
    }

    /// Maximum distance to another covariance at lags up to `max_rad`, relative to this one's value at
    /// lag 0.
    pub fn distance(&self, other: &PatternCovariance, max_rad: f64) -> f64 {
        let lags = (max_rad / self.step_rad).round() as usize + 1;
        let off = self.values.iter().zip(&other.values).take(lags).map(|(a, b)| (a - b).abs());
        off.fold(0.0, f64::max) / self.variance()
    }
}

/// Mean of the covariances at several wavelengths, each relative to its value at lag 0, times the square of a
/// contrast. Lags are scaled by `lambda_um[0] / lambda` to those at the first wavelength; values between
/// measured lags are cubic, and a wavelength contributes only within its measured lags.
pub fn stretched_mean(covariances: &[PatternCovariance], lambda_um: &[f64], contrast: f64) -> PatternCovariance {
    let first = &covariances[0];
    let mean = |of: &dyn Fn(&PatternCovariance) -> &Vec<f64>| -> Vec<f64> {
        (0..first.values.len())
            .map(|lag| {
                let at = |(c, l): (&PatternCovariance, &f64)| {
                    let scale = if c.variance() > 0.0 { contrast * contrast / c.variance() } else { 0.0 };
                    cubic(of(c), lag as f64 * l / lambda_um[0]).map(|v| scale * v)
                };
                let there: Vec<f64> = covariances.iter().zip(lambda_um).filter_map(at).collect();
                there.iter().sum::<f64>() / there.len().max(1) as f64
            })
            .collect()
    };
    PatternCovariance { step_rad: first.step_rad, values: mean(&|c| &c.values), errors: mean(&|c| &c.errors) }
}

/// Interpolates an even function, given at 0, 1, ..., by the cubic through the four nearest values; `None`
/// beyond the last.
fn cubic(values: &[f64], x: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    if x > last as f64 {
        return None;
    }
    let j = (x as usize).min(last.saturating_sub(1));
    let t = x - j as f64;
    let at = |i: isize| values[(j as isize + i).unsigned_abs().min(last)];
    let weights = [
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    ];
    Some((-1..3).zip(weights).map(|(i, w)| w * at(i)).sum())
}

/// Patterns of reflection (those of the darkest fibers) and of high-order light (those of the clearest minus
/// those of the darkest fibers), `[n][azimuths]` each.
pub fn refl_and_high(patterns: &SpecklePatterns, lambda: usize, pol: SpecklePolarization) -> [Vec<Vec<f64>>; 2] {
    let refl = patterns.instances_of(patterns.kappa.len() - 1, lambda, pol);
    let mut high = patterns.instances_of(0, lambda, pol);
    for (high, refl) in high.iter_mut().flatten().zip(refl.iter().flatten()) {
        *high -= refl;
    }
    [refl, high]
}
