//! Self-consistency checks of a scattering model: the furnace test, the integral of the sampler's density,
//! eval = weight * pdf, and a chi-square test of samples.
//!
//! `plywave check` and the tests share this code. A closure provides uniform random numbers in [0, 1).

pub mod chi2;
mod fiber;
mod nodes;
pub mod reference;
mod whole;

pub use fiber::{ClearAlbedo, FiberReport, check_fiber, clear_albedo};
pub use whole::{KEPT_TOLERANCE, LAYER_TOLERANCE, PART_INCIDENCES, PartReport, check_layers, check_whole};

use crate::reference::Mixture;
use chi2::{chi2_test, threshold};
use nodes::{BINS, Feature, integrate};
use plywave::frame::theta_phi;
use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Sizes of a check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckOptions {
    /// Number of incidences. The first few are the center, the rims and grazing light; the others are random.
    pub incidences: usize,
    /// Number of samples at each incidence.
    pub samples: usize,
    /// Probability that a correct model fails any of its chi-square tests, over [`check_model`],
    /// [`check_whole`] and [`check_layers`] together.
    pub significance: f64,
}

impl CheckOptions {
    /// Minimum p-value at which a single chi-square test passes, chosen so that all tests of `model` together
    /// fail with the probability `significance`.
    pub fn chi2_threshold(&self, model: &PlyModel) -> f64 {
        let d = model.data();
        let parts = usize::from(d.edge.is_some()) + usize::from(d.layers.is_some());
        threshold(self.significance, self.incidences + parts * PART_INCIDENCES)
    }
}

impl Default for CheckOptions {
    fn default() -> Self {
        CheckOptions { incidences: 100, samples: 20_000, significance: 0.01 }
    }
}

/// Result of the check of one incidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IncidenceReport {
    /// Incident latitude [rad].
    pub theta_i: f32,
    /// Beam offset [um].
    pub h_um: f32,
    /// Maximum of |integral of eval - albedo| over the absorptions.
    pub furnace_error: f64,
    /// |integral of pdf - probability of being scattered|, or |sum of the probabilities of all outcomes - 1|.
    pub pdf_error: f64,
    /// Maximum of |weight * pdf - eval| over the samples, relative to the maximum of eval.
    pub weight_error: f64,
    /// Maximum of |mean weight - albedo| over the absorptions, in standard errors (1e-4 is added to the
    /// standard error).
    pub sampled_furnace_se: f64,
    /// p-value of the samples, including missed light, against the pdf.
    pub chi2_p: f64,
}

/// Result of the check of a model at all incidences.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckReport {
    /// Results of all incidences.
    pub incidences: Vec<IncidenceReport>,
    /// Minimum p-value that passes, from [`CheckOptions::chi2_threshold`].
    pub chi2_threshold: f64,
    /// [`PlyModel::reference_error`].
    pub reference_error: f32,
}

/// Limit of the errors of the furnace and of the integral of the pdf. The energy quadrature of a lobe is
/// accurate to 2e-4.
pub const FURNACE_TOLERANCE: f64 = 1e-3;
/// Limit of |weight * pdf - eval|, due to f32 rounding.
pub const WEIGHT_TOLERANCE: f64 = 1e-4;
/// Limit of the distance between sampled and exact energy, in standard errors.
pub const SAMPLED_TOLERANCE_SE: f64 = 5.0;
/// Limit of the difference of eval from the stored values, because processors round differently.
pub const REFERENCE_TOLERANCE: f32 = 1e-3;

impl CheckReport {
    /// Maximum furnace error.
    pub fn furnace_error(&self) -> f64 {
        self.worst(|i| i.furnace_error)
    }

    /// Maximum error of the integral of the pdf.
    pub fn pdf_error(&self) -> f64 {
        self.worst(|i| i.pdf_error)
    }

    /// Maximum difference of weight * pdf from eval.
    pub fn weight_error(&self) -> f64 {
        self.worst(|i| i.weight_error)
    }

    /// Maximum distance of the sampled from the exact energy [standard errors].
    pub fn sampled_furnace_se(&self) -> f64 {
        self.worst(|i| i.sampled_furnace_se)
    }

    /// Minimum p-value.
    pub fn chi2_p(&self) -> f64 {
        self.incidences.iter().map(|i| i.chi2_p).fold(1.0, f64::min)
    }

    /// Whether every check passes.
    pub fn passed(&self) -> bool {
        self.furnace_error() <= FURNACE_TOLERANCE
            && self.pdf_error() <= FURNACE_TOLERANCE
            && self.weight_error() <= WEIGHT_TOLERANCE
            && self.sampled_furnace_se() <= SAMPLED_TOLERANCE_SE
            && self.chi2_p() >= self.chi2_threshold
            && self.reference_error <= REFERENCE_TOLERANCE
    }

    /// Maximum of a number over the incidences; NaN becomes infinite.
    fn worst(&self, of: impl Fn(&IncidenceReport) -> f64) -> f64 {
        self.incidences.iter().map(of).fold(0.0, |a, b| if b.is_nan() { f64::INFINITY } else { a.max(b) })
    }
}

/// Checks a model at the center, at its rims, at grazing light and at random incidences of both signs.
pub fn check_model(model: &PlyModel, options: &CheckOptions, uniform: &mut dyn FnMut() -> f32) -> CheckReport {
    let d = model.data();
    let (theta, h) = (d.theta_i[d.theta_i.len() - 1] as f32, d.h_um[d.h_um.len() - 1] as f32);
    let sigma_last = d.sigma_per_um[d.sigma_per_um.len() - 1] as f32;
    let fixed = [(0.0, 0.0), (0.0, 0.999), (-0.5, -0.999), (0.999, 0.3), (-0.999, -0.1), (1.1, 0.0)];
    let incidences = (0..options.incidences)
        .map(|i| {
            let (t, x) = *fixed.get(i).unwrap_or(&(2.0 * uniform() - 1.0, 2.0 * uniform() - 1.0));
            let sigma = [0.0, 0.03 * sigma_last, 0.3 * sigma_last * uniform(), sigma_last];
            let theta_i = (t * theta).clamp(-1.57, 1.57);
            check_incidence(model, theta_i, x * h, sigma, options.samples, uniform)
        })
        .collect();
    CheckReport { incidences, chi2_threshold: options.chi2_threshold(model), reference_error: model.reference_error() }
}

/// Result of [`check_bsdf`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfReport {
    /// Maximum of |integral of eval - albedo| over the absorptions.
    pub furnace_error: f64,
    /// |integral of pdf - probability of being scattered|, or |sum of the probabilities of all outcomes - 1|.
    pub pdf_error: f64,
    /// Maximum of |weight * pdf - eval| over the samples, relative to the maximum of eval.
    pub weight_error: f64,
    /// Maximum of |mean weight - albedo| over the absorptions, in standard errors (1e-4 is added to the
    /// standard error).
    pub sampled_furnace_se: f64,
    /// p-value of the samples, including missed ones, against the pdf.
    pub chi2_p: f64,
}

/// Checks a ply model at one incidence.
pub fn check_incidence(
    model: &PlyModel,
    theta_i: f32,
    h_um: f32,
    sigma_per_um: [f32; 4],
    samples: usize,
    uniform: &mut dyn FnMut() -> f32,
) -> IncidenceReport {
    let lobes = lobe_features(model, theta_i, h_um);
    let r = check_lobes(&model.at(&PlyQuery::lobes(theta_i, h_um, sigma_per_um)), &lobes, samples, uniform);
    IncidenceReport {
        theta_i,
        h_um,
        furnace_error: r.furnace_error,
        pdf_error: r.pdf_error,
        weight_error: r.weight_error,
        sampled_furnace_se: r.sampled_furnace_se,
        chi2_p: r.chi2_p,
    }
}

/// Lobes that the integrals at an incidence must resolve.
fn lobe_features(model: &PlyModel, theta_i: f32, h_um: f32) -> Vec<Feature> {
    let Some(mixture) = Mixture::new(model.data(), theta_i.into(), h_um.into(), &[]) else { return Vec::new() };
    mixture.lobes().map(|lobe| Feature::from_lobe(lobe, mixture.theta_i(), mixture.is_mirrored())).collect()
}

/// Checks a scattering function that is smooth except for these lobes.
fn check_lobes<const N: usize>(
    s: &impl Bsdf<N>,
    lobes: &[Feature],
    samples: usize,
    uniform: &mut dyn FnMut() -> f32,
) -> BsdfReport {
    check_integrated(s, integrate(s, [1.0; 2], lobes), samples, uniform)
}

/// Checks any scattering function whose finest features have the standard deviations `sd_rad` along latitude
/// and azimuth.
pub fn check_bsdf<const N: usize>(
    s: &impl Bsdf<N>,
    sd_rad: [f64; 2],
    samples: usize,
    uniform: &mut dyn FnMut() -> f32,
) -> BsdfReport {
    check_integrated(s, integrate(s, sd_rad, &[]), samples, uniform)
}

/// Checks a scattering function from its integrals: of eval over the sphere, and of the pdf over each bin.
fn check_integrated<const N: usize>(
    s: &impl Bsdf<N>,
    (f, bins): ([f64; N], Vec<f64>),
    samples: usize,
    uniform: &mut dyn FnMut() -> f32,
) -> BsdfReport {
    let (albedo, straight) = (s.albedo().map(f64::from), s.straight().map(f64::from));
    let outcomes = s.outcomes();
    let [scattered, chance_straight, absorbed] =
        [outcomes.scattered, outcomes.straight, outcomes.absorbed].map(f64::from);

    let furnace_error = f.iter().zip(albedo).map(|(f, a)| (f - a).abs()).fold(0.0, f64::max);
    let outcomes_error = (scattered + chance_straight + absorbed - 1.0).abs();
    let pdf_error = (bins.iter().sum::<f64>() - scattered).abs().max(outcomes_error);

    let (mut sum, mut squares) = ([0.0f64; N], [0.0f64; N]);
    let mut sum_straight = [0.0f64; N];
    // Bins of the sphere, then light that goes straight on, then absorbed light.
    let mut observed = vec![0.0; bins.len() + 2];
    let (mut error, mut peak) = (0.0f64, 0.0f64);
    for _ in 0..samples {
        let u = [uniform(), uniform(), uniform()];
        let sample = match s.sample(u) {
            BsdfSample::Scattered(sample) => sample,
            BsdfSample::Straight { weight, probability } => {
                observed[bins.len()] += 1.0;
                for k in 0..N {
                    sum_straight[k] += f64::from(weight[k]);
                    // A delta function has no direction to compare at; weight times probability is its
                    // energy.
                    error = error.max((f64::from(weight[k] * probability) - straight[k]).abs());
                }
                continue;
            }
            BsdfSample::Absorbed => {
                observed[bins.len() + 1] += 1.0;
                continue;
            }
        };
        observed[bin(sample.w)] += 1.0;
        let f = s.eval(sample.w);
        for k in 0..N {
            sum[k] += f64::from(sample.weight[k]);
            squares[k] += f64::from(sample.weight[k]).powi(2);
            peak = peak.max(f64::from(f[k]));
            error = error.max(f64::from((sample.weight[k] * sample.pdf - f[k]).abs()));
        }
        error = error.max(f64::from((sample.pdf - s.pdf(sample.w)).abs()));
        peak = peak.max(f64::from(sample.pdf));
    }
    let n = samples.max(1) as f64;
    let sampled_furnace_se = (0..N)
        .map(|k| {
            let mean = sum[k] / n;
            let sampled = squares[k] / n - mean * mean;
            // If hits are rare, a few of them do not determine their spread. By Cauchy and Schwarz the mean
            // square weight is at least albedo^2 divided by the probability of a hit.
            let min_variance = |energy: f64, chance: f64| energy * energy * (1.0 / chance.max(1e-12) - 1.0).max(0.0);
            let se = (sampled.max(min_variance(albedo[k], scattered)).max(0.0) / n).sqrt();
            // Straight light has a single weight, so its spread is that of its count.
            let se_straight = (min_variance(straight[k], chance_straight) / n).sqrt();
            let off_straight = (sum_straight[k] / n - straight[k]).abs() / (se_straight + 1e-4);
            ((mean - albedo[k]).abs() / (se + 1e-4)).max(off_straight)
        })
        .fold(0.0, f64::max);
    let mut expected: Vec<f64> = bins.iter().map(|b| b * n).collect();
    expected.extend([chance_straight * n, absorbed * n]);
    BsdfReport {
        furnace_error,
        pdf_error,
        weight_error: if peak > 0.0 { error / peak } else { error },
        sampled_furnace_se,
        chi2_p: chi2_test(&observed, &expected).p_value,
    }
}

fn bin(wo: [f32; 3]) -> usize {
    let (theta, phi) = theta_phi(wo);
    let i = ((f64::from(theta) + FRAC_PI_2) / PI * BINS[0] as f64) as usize;
    let j = (f64::from(phi) / TAU * BINS[1] as f64) as usize;
    i.min(BINS[0] - 1) * BINS[1] + j.min(BINS[1] - 1)
}
