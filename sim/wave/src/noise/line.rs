//! One-dimensional patterns N(lambda, phi) (Yu 2025, Eq. 19-22), for comparison with the simulated ones.

use super::covariance::{PatternCovariance, refl_and_high};
use super::fields::field_models;
use super::options::{KIND_NAMES, KIND_SIDES, NoiseOptions};
use super::spectrum::FieldModel;
use plywave::Error;
use plywave::math::axis;
use plywave_tables::speckle::SpecklePatterns;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rustfft::{FftPlanner, num_complex::Complex};
use std::f64::consts::{PI, TAU};

/// Samples on the circle per azimuth of the patterns, linear between them.
const FINE: usize = 8;

/// Synthesized N of many instances: `[lambda][instance][azimuth]`.
#[derive(Clone, Debug, PartialEq)]
pub struct LinePatterns(pub Vec<Vec<Vec<f64>>>);

impl LinePatterns {
    /// Draws `count` instances at wavelengths [um]. The field is drawn at the first wavelength; at the others
    /// it is stretched about exact forward, where all are in phase.
    pub fn draw(model: &FieldModel, lambda_um: &[f64], count: usize, seed: u64) -> LinePatterns {
        let (d, n) = (model.azimuths, FINE * model.azimuths);
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let fft = FftPlanner::new().plan_fft_inverse(n);
        let mut patterns = vec![Vec::with_capacity(count); lambda_um.len()];
        let constant = (1.0 - model.share).sqrt();
        let mut field = vec![Complex::default(); n];
        for _ in 0..count {
            field.fill(Complex::default());
            for (k, power) in model.spectrum.iter().enumerate() {
                let draw = |rng: &mut Pcg64Mcg| -> Complex<f64> {
                    let size = (0.5 * model.share * power).sqrt();
                    Complex::new(StandardNormal.sample(rng), StandardNormal.sample(rng)) * size
                };
                field[k] = draw(&mut rng);
                if k > 0 && 2 * k != d {
                    field[n - k] = draw(&mut rng);
                }
            }
            fft.process(&mut field);
            for (patterns, lambda) in patterns.iter_mut().zip(lambda_um) {
                let fade = model.faded(*lambda);
                let at = |j: usize| {
                    let off = (TAU * j as f64 / d as f64 + 0.5 * PI).rem_euclid(TAU);
                    let off = if off > PI { off - TAU } else { off } * lambda_um[0] / lambda;
                    let x = (off / TAU * n as f64).rem_euclid(n as f64);
                    let (i, next, t) = axis::cell_periodic(x, n);
                    (field[i] * (1.0 - t) + field[next] * t + constant).norm_sqr()
                };
                let at = |j: usize| 1.0 + fade * (at(j) - 1.0);
                patterns.push((0..d).map(at).collect());
            }
        }
        LinePatterns(patterns)
    }
}

/// Comparison of simulated and synthesized patterns of one kind at one wavelength.
#[derive(Clone, Debug)]
pub struct LineComparison {
    /// "refl" or "high".
    pub kind: &'static str,
    /// Wavelength [um].
    pub lambda_um: f64,
    /// Covariance of the simulated patterns.
    pub simulated: PatternCovariance,
    /// Covariances of the two halves (every other) of the simulated patterns: half their distance is the
    /// uncertainty of the estimate from all.
    pub halves: [PatternCovariance; 2],
    /// Covariance of the synthesized patterns, mean times N.
    pub synthesized: PatternCovariance,
    /// `[azimuth]`: mean of the simulated patterns [um/rad].
    pub mean: Vec<f64>,
    /// `[2][azimuth]`: two simulated patterns [um/rad].
    pub two_simulated: [Vec<f64>; 2],
    /// `[2][azimuth]`: two synthesized patterns [um/rad].
    pub two_synthesized: [Vec<f64>; 2],
}

/// Compares both kinds at every wavelength, f_refl first, with `count` synthesized instances. One field
/// serves all wavelengths. With several fibers in view the covariances are those of their sum; the two
/// simulated patterns are those of single fibers.
///
/// # Errors
/// The errors of [`super::noise_spectrum`].
pub fn compare_lines(
    patterns: &SpecklePatterns,
    options: &NoiseOptions,
    count: usize,
    file: &str,
) -> Result<Vec<LineComparison>, Error> {
    let models = field_models(patterns, options, file)?;
    let mut rows = Vec::new();
    for (k, (_, model)) in models.iter().enumerate() {
        let drawn = LinePatterns::draw(model, &patterns.lambda_um, count.max(2), options.seed.wrapping_add(k as u64));
        for (l, noise) in drawn.0.into_iter().enumerate() {
            let light = std::mem::take(&mut refl_and_high(patterns, l, options.polarization)[k]);
            let n = light.len() as f64;
            let mean: Vec<f64> = (0..patterns.azimuths).map(|j| light.iter().map(|v| v[j]).sum::<f64>() / n).collect();
            let synthesized: Vec<Vec<f64>> =
                noise.into_iter().map(|row| row.iter().zip(&mean).map(|(n, m)| n * m).collect()).collect();
            rows.push(LineComparison {
                kind: KIND_NAMES[k],
                lambda_um: patterns.lambda_um[l],
                simulated: PatternCovariance::from_patterns(&light, KIND_SIDES[k]).of_fibers(options.fibers),
                halves: [0, 1].map(|first| {
                    let half: Vec<_> = light.iter().skip(first).step_by(2).cloned().collect();
                    PatternCovariance::from_patterns(&half, KIND_SIDES[k]).of_fibers(options.fibers)
                }),
                synthesized: PatternCovariance::from_patterns(&synthesized, KIND_SIDES[k]),
                two_simulated: [light[0].clone(), light[1].clone()],
                two_synthesized: [synthesized[0].clone(), synthesized[1].clone()],
                mean,
            });
        }
    }
    Ok(rows)
}
