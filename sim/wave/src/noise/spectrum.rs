//! Power spectrum of the field whose intensity has a given covariance.
//!
//! mu solves `b^2 mu^2 + 2 b (1 - b) mu = C`; its spectrum must not be negative. Clipping the transform of mu
//! at 0 (Yu 2024) changes the covariance by the clipped part, up to a tenth here, and where b = 1 the root
//! turns noise in C into a tail. The spectrum is therefore the non-negative one whose C is nearest to the
//! measured one over its lags, found by accelerated projected gradient steps from the clipped transform (Beck
//! and Teboulle 2009).

use super::covariance::PatternCovariance;
use super::options::NoiseContrast;
use rustfft::{FftPlanner, num_complex::Complex};

/// Number of steps of the projected gradient; the error has converged to three digits after about a hundred.
const STEPS: usize = 1500;

/// The Gaussian field behind a kind's noise over the azimuth.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldModel {
    /// Share b of the fluctuating field in the mean intensity, 0 to 1.
    pub share: f64,
    /// Power at harmonics 0 to azimuths / 2 of the circle, >= 0; with all others counted twice they add up to
    /// 1.
    pub spectrum: Vec<f64>,
    /// N fades to `1 + s (N - 1)` with `s = fade[0] + fade[1] lambda_um`, within 0 and 1.
    pub fade: [f64; 2],
    /// Number of azimuths of the spectrum.
    pub azimuths: usize,
}

/// Covariance of N for a field correlation `mu` (module head of [`super`]).
pub fn intensity_covariance(share: f64, mu: f64) -> f64 {
    share * mu * (2.0 * (1.0 - share) + share * mu)
}

/// Share b of a field whose intensity has this variance: `1 - sqrt(1 - C(0))`, and 1 for variances above 1.
pub fn share_of(variance: f64) -> f64 {
    1.0 - (1.0 - variance.clamp(0.0, 1.0)).sqrt()
}

/// mu of a covariance: the root that is 1 at lag 0. If C is below the range of all mu, it is the mu of the
/// minimum of C.
fn correlation(share: f64, c: f64) -> f64 {
    let rest = 1.0 - share;
    // c / (sqrt(rest^2 + c) + rest) is the root without cancellation for small shares.
    let root = (rest * rest + c).max(0.0).sqrt();
    let mu = if root + rest > 0.0 { (root * root - rest * rest) / (root + rest) / share } else { 0.0 };
    mu.clamp(-1.0, 1.0)
}

impl FieldModel {
    /// Field of a measured covariance.
    pub fn from_covariance(measured: &PatternCovariance, contrast: NoiseContrast, azimuths: usize) -> FieldModel {
        let variance = measured.variance();
        if variance.is_nan() || variance <= 0.0 {
            // The intensity does not vary, so there is no field and its spectrum is arbitrary.
            let mut spectrum = vec![0.0; azimuths / 2 + 1];
            spectrum[0] = 1.0;
            return FieldModel { share: 0.0, spectrum, fade: [1.0, 0.0], azimuths };
        }
        match contrast {
            NoiseContrast::Developed => {
                let covariance: Vec<f64> = measured.values.iter().map(|c| (c / variance).max(0.0)).collect();
                FieldModel::developed(&covariance, azimuths)
            }
            NoiseContrast::Measured => {
                let share = share_of(variance);
                // A variance that N cannot have is scaled to its largest possible one.
                let scale = if variance > 1.0 { 1.0 / variance } else { 1.0 };
                let covariance: Vec<f64> = measured.values.iter().map(|c| scale * c).collect();
                FieldModel { share, spectrum: spectrum_of(share, &covariance, azimuths), fade: [1.0, 0.0], azimuths }
            }
        }
    }

    /// A fully developed speckle of the covariance `mu^2`, `[lag]`.
    pub fn developed(covariance: &[f64], azimuths: usize) -> FieldModel {
        FieldModel { share: 1.0, spectrum: spectrum_of(1.0, covariance, azimuths), fade: [1.0, 0.0], azimuths }
    }

    /// s at a wavelength [um].
    pub fn faded(&self, lambda_um: f64) -> f64 {
        (self.fade[0] + self.fade[1] * lambda_um).clamp(0.0, 1.0)
    }

    /// mu at a lag [rad].
    pub fn correlation(&self, lag_rad: f64) -> f64 {
        let twice = |k: usize| if k == 0 || 2 * k == self.azimuths { 1.0 } else { 2.0 };
        self.spectrum.iter().enumerate().map(|(k, s)| twice(k) * s * (lag_rad * k as f64).cos()).sum()
    }

    /// Covariance of N at a lag [rad].
    pub fn covariance(&self, lag_rad: f64) -> f64 {
        intensity_covariance(self.share, self.correlation(lag_rad))
    }

    /// Lag [rad] at which the covariance first falls to half, at most `max_rad`.
    pub fn half_width_rad(&self, max_rad: f64) -> f64 {
        let half = 0.5 * self.covariance(0.0);
        let step = max_rad / 4000.0;
        (1..4000).map(|i| step * f64::from(i)).find(|d| self.covariance(*d) <= half).unwrap_or(max_rad)
    }
}

/// The spectrum, `[n / 2 + 1]`, >= 0 and of sum 1 (harmonics beside 0 and n / 2 twice), with which the
/// covariance of N on n points of a circle is nearest to `covariance`, `[lag]`.
pub fn spectrum_of(share: f64, covariance: &[f64], n: usize) -> Vec<f64> {
    let lags = covariance.len().min(n / 2 + 1);
    let mut planner = FftPlanner::new();
    let fft = planner.plan_fft_forward(n);
    let mut scratch = vec![Complex::default(); fft.get_inplace_scratch_len()];
    let mut z = vec![Complex::default(); n];
    // The transform of even sequences of length n is real, and its own inverse up to the factor n.
    let mut transform = |even: &[f64], out: &mut [f64]| {
        z.iter_mut().zip(even).for_each(|(z, v)| *z = Complex::new(*v, 0.0));
        fft.process_with_scratch(&mut z, &mut scratch);
        out.iter_mut().zip(&z).for_each(|(o, z)| *o = z.re);
    };
    let fold = |j: usize| j.min(n - j);
    let normalize = |s: &mut [f64]| {
        let sum: f64 = s.iter().sum();
        if sum > 0.0 {
            s.iter_mut().for_each(|v| *v /= sum);
        } else {
            s[0] = 1.0;
        }
    };
    let mu: Vec<f64> =
        (0..n).map(|j| if fold(j) < lags { correlation(share, covariance[fold(j)]) } else { 0.0 }).collect();
    let mut s = vec![0.0; n];
    transform(&mu, &mut s);
    s.iter_mut().for_each(|v| *v = v.max(0.0));
    normalize(&mut s);
    // The slope of C / (2 b) = (1 - b) mu + b mu^2 / 2 is at most 1, and the transform's norm is sqrt(n), so
    // steps of 1/n descend.
    let want: Vec<f64> = covariance.iter().take(lags).map(|c| c / (2.0 * share)).collect();
    let (mut ahead, mut momentum) = (s.clone(), 1.0f64);
    let (mut mu, mut gradient) = (vec![0.0; n], vec![0.0; n]);
    for _ in 0..STEPS {
        transform(&ahead, &mut mu);
        for (j, mu) in mu.iter_mut().enumerate() {
            *mu = match want.get(fold(j)) {
                Some(want) => (1.0 - share + share * *mu) * ((1.0 - share) * *mu + 0.5 * share * *mu * *mu - want),
                None => 0.0,
            };
        }
        transform(&mu, &mut gradient);
        let next: Vec<f64> = ahead.iter().zip(&gradient).map(|(a, g)| (a - g / n as f64).max(0.0)).collect();
        let faster = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
        let push = (momentum - 1.0) / faster;
        ahead.iter_mut().zip(&next).zip(&s).for_each(|((a, next), s)| *a = next + push * (next - s));
        (s, momentum) = (next, faster);
    }
    normalize(&mut s);
    s.truncate(n / 2 + 1);
    s
}
