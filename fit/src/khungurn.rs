//! Fits Khungurn's fiber model (Khungurn 2015) to the scattering of another fiber, which may be a table from
//! waves or rays, and to the reflectance of a swatch by dual scattering.
//!
//! The lobes are separable: for light at a latitude theta_i, f is `F L_R(theta_o) / (2 pi) + (1 - F) C_TT
//! L_TT(theta_o) v(phi)` with `L = cos theta_o g / G`. A cost over a product of latitudes and azimuths
//! therefore needs one row of each lobe per latitude. Its gradient needs the derivatives of the rows, which
//! have closed forms except for the integrals G, `integral of t^2 g cos^2` and I_1/I_0. [`minimize`] fits the
//! logarithms of the widths, and the fractions directly, within [0, 1].

use crate::{CostGradient, LbfgsbError, LbfgsbOptions, LbfgsbSolution, minimize};
use plywave::Bsdf;
use plywave::frame::direction;
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_fiber::{KhungurnFiber, KhungurnParameters, Reflectance};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Errors of a fit of Khungurn's model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum KhungurnFitError {
    /// A number of the target or the options is out of range.
    #[error("Khungurn fit: {name} = {value}: {hint}")]
    Input {
        /// Name of the number.
        name: &'static str,
        /// Its value as text.
        value: String,
        /// Accepted values.
        hint: &'static str,
    },
    /// The start or the result is not a valid model.
    #[error(transparent)]
    Model(#[from] plywave::Error),
    /// Error of the minimizer.
    #[error(transparent)]
    Solver(#[from] LbfgsbError),
}

fn input(name: &'static str, value: impl ToString, hint: &'static str) -> KhungurnFitError {
    KhungurnFitError::Input { name, value: value.to_string(), hint }
}

/// A fitted model.
#[derive(Clone, Debug)]
pub struct KhungurnFit {
    /// The parameters; C_R and C_TT have one node per wavelength.
    pub parameters: KhungurnParameters,
    /// Square root of the cost: the L2 distance relative to the target's norm.
    pub error: f64,
    /// Result of the minimizer; x contains `ln beta_R, ln beta_TT, ln gamma_TT`, then C_R and C_TT by
    /// wavelength.
    pub solution: LbfgsbSolution,
}

/// Bounds of the widths: those of the model, narrowed to what the grid of a fit resolves.
const WIDTHS: [[f64; 2]; 3] = [[0.03, 3.0], [0.03, 3.0], [0.06, 30.0]];
/// Latitudes of the incident light in a fit to scattering [rad].
const THETA_I: [f64; 5] = [0.0, 0.3, 0.6, 0.9, 1.2];
/// Numbers of latitudes and azimuths of the scattered light.
const ROWS: usize = 160;
const COLUMNS: usize = 96;

/// The parameters as a vector, with wavelength-dependent ones in the order of the fit's wavelengths.
fn start_vector(start: &KhungurnParameters, lambda_um: &[f64]) -> Vec<f64> {
    let widths = [start.beta_r, start.beta_tt, start.gamma_tt].map(f64::from);
    let mut x: Vec<f64> = (0..3).map(|k| widths[k].clamp(WIDTHS[k][0], WIDTHS[k][1]).ln()).collect();
    for share in [&start.c_r, &start.c_tt] {
        x.extend(lambda_um.iter().map(|lambda| f64::from(share.at(*lambda as f32))));
    }
    x
}

fn bounds(wavelengths: usize) -> [Vec<f64>; 2] {
    [0, 1].map(|end| {
        let mut bound: Vec<f64> = WIDTHS.iter().map(|w| w[end].ln()).collect();
        bound.resize(3 + 2 * wavelengths, end as f64);
        bound
    })
}

fn finish(
    start: &KhungurnParameters,
    lambda_um: &[f64],
    solution: LbfgsbSolution,
) -> Result<KhungurnFit, KhungurnFitError> {
    let (widths, shares) = solution.x.split_at(3);
    let (c_r, c_tt) = shares.split_at(lambda_um.len());
    let nodes = |shares: &[f64]| {
        let mut nodes: Vec<[f32; 2]> = lambda_um.iter().zip(shares).map(|(l, s)| [*l as f32, *s as f32]).collect();
        nodes.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Reflectance::Nodes(nodes)
    };
    let parameters = KhungurnParameters {
        radius_um: start.radius_um,
        c_r: nodes(c_r),
        c_tt: nodes(c_tt),
        beta_r: widths[0].exp() as f32,
        beta_tt: widths[1].exp() as f32,
        gamma_tt: widths[2].exp() as f32,
    };
    KhungurnFiber::new(parameters.clone())?;
    Ok(KhungurnFit { parameters, error: solution.cost.max(0.0).sqrt(), solution })
}

fn check_wavelengths(lambda_um: &[f64]) -> Result<(), KhungurnFitError> {
    if lambda_um.is_empty() {
        return Err(input("lambda_um", "[]", "give one wavelength or more"));
    }
    for (k, lambda) in lambda_um.iter().enumerate() {
        if !(lambda.is_finite() && *lambda > 0.0) || lambda_um[..k].contains(lambda) {
            return Err(input("lambda_um", lambda, "give different positive wavelengths [um]"));
        }
    }
    Ok(())
}

fn options() -> LbfgsbOptions {
    LbfgsbOptions { memory: 20, pgtol: 1e-9, ftol: 1e-15, max_iterations: 2000, ..LbfgsbOptions::default() }
}

/// Fits the model to the scattering of `target` at these wavelengths, in the L2 norm over the sphere, at five
/// latitudes of incident light. The target is averaged over `turns` azimuths of incidence (1 for a round
/// fiber). Latitudes are weighted by `cos^2 theta_i`, the power that the fiber receives from uniform light.
/// Lobes narrower than 0.03 rad are not resolved.
///
/// # Errors
/// An infinite or NaN wavelength or absorption, a target without light, a start that is not a valid model.
pub fn fit_khungurn(
    target: &FiberModel,
    lambda_um: &[f64],
    sigma_per_um: &[f64],
    turns: u32,
    start: &KhungurnParameters,
) -> Result<KhungurnFit, KhungurnFitError> {
    check_wavelengths(lambda_um)?;
    if sigma_per_um.len() != lambda_um.len() {
        return Err(input("sigma_per_um", sigma_per_um.len(), "give one absorption a wavelength"));
    }
    if let Some(sigma) = sigma_per_um.iter().find(|s| !(s.is_finite() && **s >= 0.0)) {
        return Err(input("sigma_per_um", sigma, "give absorptions that are not negative [1/um]"));
    }
    if !(1..=1000).contains(&turns) {
        return Err(input("turns", turns, "use 1 to 1000"));
    }
    KhungurnFiber::new(start.clone())?;
    let mut objective = Scattering { wavelengths: lambda_um.len(), values: Vec::new(), norm: 0.0 };
    for (lambda, sigma) in lambda_um.iter().zip(sigma_per_um) {
        for theta_i in THETA_I {
            let first = objective.values.len();
            objective.values.resize(first + ROWS * COLUMNS, 0.0);
            for turn in 0..turns {
                let phi_i = TAU * f64::from(turn) / f64::from(turns);
                let query = FiberQuery {
                    sigma_per_um: [*sigma as f32],
                    ..FiberQuery::new(direction(theta_i as f32, phi_i as f32), [*lambda as f32])
                };
                let at = target.at(&query);
                for (k, value) in objective.values[first..].iter_mut().enumerate() {
                    let w = direction(row(k / COLUMNS) as f32, (phi_i + column(k % COLUMNS)) as f32);
                    *value += f64::from(at.eval(w)[0]) / f64::from(turns);
                }
            }
            let values = objective.values[first..].iter().enumerate();
            objective.norm += theta_i.cos().powi(2) * values.map(|(k, v)| row(k / COLUMNS).cos() * v * v).sum::<f64>();
        }
    }
    if !(objective.norm > 0.0 && objective.norm.is_finite()) {
        return Err(input("target", objective.norm, "the fiber scatters no light at these wavelengths"));
    }
    let [lower, upper] = bounds(lambda_um.len());
    let solution = minimize(&objective, &start_vector(start, lambda_um), &lower, &upper, &options())?;
    finish(start, lambda_um, solution)
}

fn row(k: usize) -> f64 {
    (k as f64 + 0.5) / ROWS as f64 * PI - FRAC_PI_2
}

fn column(k: usize) -> f64 {
    (k as f64 + 0.5) / COLUMNS as f64 * TAU
}

/// Squared distance of the model from the target's f.
struct Scattering {
    wavelengths: usize,
    /// `[wavelength][theta_i][ROWS][COLUMNS]`.
    values: Vec<f64>,
    norm: f64,
}

/// The row `cos theta_o g / G` of a width, and its derivative with respect to the width's logarithm.
fn longitudinal(theta_i: f64, beta: f64) -> Vec<[f64; 2]> {
    let (mut integral, mut second) = (0.0, 0.0);
    let n = 1000;
    let (low, high) = ((-theta_i - 9.0 * beta).max(-FRAC_PI_2), (-theta_i + 9.0 * beta).min(FRAC_PI_2));
    for k in 0..n {
        let x = low + (f64::from(k) + 0.5) * (high - low) / f64::from(n);
        let t2 = ((x + theta_i) / beta).powi(2);
        let light = (-0.5 * t2).exp() * x.cos().powi(2) * (high - low) / f64::from(n);
        integral += light;
        second += t2 * light;
    }
    (0..ROWS)
        .map(|k| {
            let t2 = ((row(k) + theta_i) / beta).powi(2);
            let value = row(k).cos() * (-0.5 * t2).exp() / integral;
            [value, value * (t2 - second / integral)]
        })
        .collect()
}

/// A von Mises density about pi; its integrals are computed by quadrature.
struct Azimuth {
    kappa: f64,
    /// `2 pi i0e(kappa)`, followed by I_1/I_0.
    norm: f64,
    mean_cos: f64,
}

impl Azimuth {
    fn new(gamma: f64) -> Azimuth {
        let kappa = 1.0 / (gamma * gamma);
        let n = 2000;
        let (mut norm, mut cosine) = (0.0, 0.0);
        let reach = PI.min(9.0 * gamma);
        for k in 0..n {
            let x = (f64::from(k) + 0.5) / f64::from(n) * reach;
            let value = (kappa * (x.cos() - 1.0)).exp() * 2.0 * reach / f64::from(n);
            norm += value;
            cosine += value * x.cos();
        }
        Azimuth { kappa, norm, mean_cos: cosine / norm }
    }

    /// Density at an angle from the straight direction, and its derivative with respect to ln gamma.
    fn at(&self, x: f64) -> [f64; 2] {
        let value = (self.kappa * (x.cos() - 1.0)).exp() / self.norm;
        [value, -2.0 * self.kappa * value * (x.cos() - self.mean_cos)]
    }

    /// Fraction of the light that goes forward, averaged over the azimuths of incidence, `1 - E|x|/pi`
    /// (Khungurn 2015, 3.1), and its derivative with respect to ln gamma.
    fn forward(&self) -> [f64; 2] {
        let n = 4000;
        let reach = PI.min(9.0 / self.kappa.sqrt());
        let mut sums = [0.0; 2];
        for k in 0..n {
            let x = (f64::from(k) + 0.5) / f64::from(n) * reach;
            let v = self.at(x);
            (0..2).for_each(|d| sums[d] += 2.0 * v[d] * (1.0 - x / PI) * reach / f64::from(n));
        }
        sums
    }
}

/// The factor `(1 - cos theta_i)^5` of Schlick's reflectance.
fn grazing(theta_i: f64) -> f64 {
    (1.0 - theta_i.cos()).powi(5)
}

impl CostGradient for Scattering {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        gradient.fill(0.0);
        let azimuth = Azimuth::new(x[2].exp());
        let around: Vec<[f64; 2]> = (0..COLUMNS).map(|k| azimuth.at(column(k) - PI)).collect();
        let mut cost = 0.0;
        for (i, theta_i) in THETA_I.into_iter().enumerate() {
            let (r, tt) = (longitudinal(theta_i, x[0].exp()), longitudinal(theta_i, x[1].exp()));
            let q = grazing(theta_i);
            for l in 0..self.wavelengths {
                let (c_r, c_tt) = (x[3 + l], x[3 + self.wavelengths + l]);
                let f = c_r + (1.0 - c_r) * q;
                let through = (1.0 - f) * c_tt;
                let values = &self.values[(l * THETA_I.len() + i) * ROWS * COLUMNS..];
                // Sums of residuals times R, times TT, and times the derivatives by the widths.
                let (mut by_r, mut by_tt, mut by_widths) = (0.0, 0.0, [0.0; 3]);
                for o in 0..ROWS {
                    let weight = theta_i.cos().powi(2) * row(o).cos() / self.norm;
                    let ([r, dr], [tt, dtt]) = (r[o].map(|v| v / TAU), tt[o]);
                    let (mut sum, mut sum_v, mut sum_dv) = (0.0, 0.0, 0.0);
                    for (value, [v, dv]) in values[o * COLUMNS..][..COLUMNS].iter().zip(&around) {
                        let off = f * r + through * tt * v - value;
                        cost += weight * off * off;
                        sum += off;
                        sum_v += off * v;
                        sum_dv += off * dv;
                    }
                    by_r += weight * sum * r;
                    by_tt += weight * sum_v * tt;
                    by_widths[0] += weight * sum * f * dr;
                    by_widths[1] += weight * sum_v * through * dtt;
                    by_widths[2] += weight * sum_dv * through * tt;
                }
                (0..3).for_each(|k| gradient[k] += 2.0 * by_widths[k]);
                gradient[3 + l] += 2.0 * (1.0 - q) * (by_r - c_tt * by_tt);
                gradient[3 + self.wavelengths + l] += 2.0 * (1.0 - f) * by_tt;
            }
        }
        Ok(cost)
    }
}

/// Reflectance of a swatch of aligned fibers for light at one latitude and all azimuths of its half space:
/// measured, or from a photograph of a surface next to a white standard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwatchSample {
    /// Latitude of the light in the fibers' frame [rad].
    pub theta_i: f64,
    /// Wavelength [um].
    pub lambda_um: f64,
    /// Reflected fraction of the light, 0 to 1.
    pub reflectance: f64,
}

/// Options of a fit to a swatch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwatchOptions {
    /// Number of layers of fibers, at least 1; `None` for an opaque swatch.
    pub layers: Option<u32>,
    /// Whether C_R is fitted, which needs samples at several latitudes.
    pub c_r: bool,
    /// Whether gamma_TT is fitted in place of C_R, which needs samples at several latitudes.
    pub gamma_tt: bool,
}

impl Default for SwatchOptions {
    /// An opaque swatch; only C_TT is fitted.
    fn default() -> Self {
        SwatchOptions { layers: None, c_r: false, gamma_tt: false }
    }
}

/// Fits the model to the reflectance of the samples: `a_b + A_b` with all orders of backscattering, or the
/// reflectance of a number of layers. The longitudinal widths have no effect and stay those of the start, as
/// do parameters that the options do not fit.
///
/// With `u = 1 - (1 - cos theta_i)^5` and the fraction s of TT that goes forward, `a_f = 1/2 + u (1 - C_R)
/// (C_TT s - 1/2)` and `a_b = 1/2 + u (1 - C_R) (C_TT (1 - s) - 1/2)`: two numbers per wavelength, whatever
/// the latitudes, for C_R, C_TT and an s shared by all wavelengths. Reflectances therefore cannot separate
/// C_R and gamma_TT, and one of the two must be known.
///
/// # Errors
/// No sample or layer, a number out of range, a fit of both C_R and gamma_TT, a start that is not a valid
/// model.
pub fn fit_khungurn_swatch(
    samples: &[SwatchSample],
    options: &SwatchOptions,
    start: &KhungurnParameters,
) -> Result<KhungurnFit, KhungurnFitError> {
    if samples.is_empty() {
        return Err(input("samples", 0, "give one reflectance or more"));
    }
    if options.layers == Some(0) {
        return Err(input("layers", 0, "a swatch has one layer of fibers or more; leave it out for an opaque one"));
    }
    if options.c_r && options.gamma_tt {
        return Err(input("gamma_tt", true, "a reflectance does not tell it from C_R; fit one of the two"));
    }
    for s in samples {
        if s.theta_i.is_nan() || s.theta_i.abs() > FRAC_PI_2 {
            return Err(input("theta_i", s.theta_i, "use -pi/2 to pi/2"));
        }
        if !((0.0..=1.0).contains(&s.reflectance)) {
            return Err(input("reflectance", s.reflectance, "use 0 to 1"));
        }
    }
    let mut lambda_um: Vec<f64> = samples.iter().map(|s| s.lambda_um).collect();
    lambda_um.sort_by(f64::total_cmp);
    lambda_um.dedup();
    check_wavelengths(&lambda_um)?;
    KhungurnFiber::new(start.clone())?;
    let norm: f64 = samples.iter().map(|s| s.reflectance * s.reflectance).sum();
    let objective = Swatch { samples, lambda_um: &lambda_um, layers: options.layers, norm: norm.max(1e-12) };
    let mut x = start_vector(start, &lambda_um);
    let [mut lower, mut upper] = bounds(lambda_um.len());
    // The slope of the reflectance is infinite at a white fiber, so the reflectance stays below 1.
    let whitest = 1.0 - 1e-6;
    upper[3 + lambda_um.len()..].fill(whitest);
    let fixed =
        |k: usize| k < 2 || (k == 2 && !options.gamma_tt) || ((3..3 + lambda_um.len()).contains(&k) && !options.c_r);
    for k in 0..x.len() {
        x[k] = x[k].clamp(lower[k], upper[k]);
        // The start lies off the bounds, where the gradient would not move it.
        if k >= 3 + lambda_um.len() {
            x[k] = x[k].clamp(0.02, 0.98);
        }
        if fixed(k) {
            if k < 3 {
                let width = [start.beta_r, start.beta_tt, start.gamma_tt][k];
                x[k] = f64::from(width).ln();
            }
            (lower[k], upper[k]) = (x[k], x[k]);
        }
    }
    let solution = minimize(&objective, &x, &lower, &upper, &self::options())?;
    finish(start, &lambda_um, solution)
}

struct Swatch<'a> {
    samples: &'a [SwatchSample],
    lambda_um: &'a [f64],
    layers: Option<u32>,
    norm: f64,
}

/// Reflectance of layers that each transmit `f` and reflect `b`, and its derivatives with respect to both.
fn layers_reflect(f: f64, b: f64, layers: Option<u32>) -> [f64; 3] {
    let Some(layers) = layers else {
        // R is the smaller root of b R^2 - (1 + b^2 - f^2) R + b = 0, computed without cancellation, with its
        // derivatives.
        let p = 1.0 + b * b - f * f;
        let root = ((1.0 - (f + b)) * (1.0 + f + b) * (1.0 - (f - b).powi(2))).max(1e-30).sqrt();
        let r = 2.0 * b / (p + root);
        let slope = 2.0 * b * r - p;
        return [r, -2.0 * f * r / slope, -(r * r - 2.0 * b * r + 1.0) / slope];
    };
    let mut r = [0.0; 3];
    for _ in 0..layers {
        let between = 1.0 / (1.0 - b * r[0]);
        let lit = f * f * between * between;
        r = [b + f * f * r[0] * between, 2.0 * f * r[0] * between + lit * r[1], 1.0 + lit * r[0] * r[0] + lit * r[2]];
    }
    r
}

impl CostGradient for Swatch<'_> {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        gradient.fill(0.0);
        let count = self.lambda_um.len();
        let [share, slope] = Azimuth::new(x[2].exp()).forward();
        let mut cost = 0.0;
        for s in self.samples {
            let l = self.lambda_um.partition_point(|v| *v < s.lambda_um);
            let (c_r, c_tt) = (x[3 + l], x[3 + count + l]);
            let q = grazing(s.theta_i);
            let f = c_r + (1.0 - c_r) * q;
            let through = (1.0 - f) * c_tt;
            let (a_f, a_b) = (0.5 * f + through * share, 0.5 * f + through * (1.0 - share));
            let [r, by_f, by_b] = layers_reflect(a_f, a_b, self.layers);
            let off = r - s.reflectance;
            cost += off * off / self.norm;
            let scale = 2.0 * off / self.norm;
            let through_slope = by_f * share + by_b * (1.0 - share);
            gradient[2] += scale * through * slope * (by_f - by_b);
            gradient[3 + l] += scale * (1.0 - q) * (0.5 * (by_f + by_b) - c_tt * through_slope);
            gradient[3 + count + l] += scale * (1.0 - f) * through_slope;
        }
        Ok(cost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn differences(objective: &dyn CostGradient, x: &[f64]) {
        let mut gradient = vec![0.0; x.len()];
        objective.cost_gradient(x, &mut gradient).unwrap();
        for k in 0..x.len() {
            let cost = |step: f64| {
                let mut moved = x.to_vec();
                moved[k] += step;
                objective.cost_gradient(&moved, &mut vec![0.0; x.len()]).unwrap()
            };
            let want = (cost(1e-5) - cost(-1e-5)) / 2e-5;
            assert!((gradient[k] - want).abs() < 1e-5 * (want.abs() + 1e-2), "{k}: {} and {want}", gradient[k]);
        }
    }

    /// Without noise the fit recovers C_TT with C_R, or with gamma_TT.
    #[test]
    fn planted_swatch_without_noise_comes_back() {
        let share = Azimuth::new(0.52).forward()[0];
        let planted = [(0.45, 0.03, 0.15), (0.55, 0.06, 0.5), (0.65, 0.12, 0.9)];
        let c_r = Reflectance::Nodes(planted.map(|(lambda, c_r, _)| [lambda as f32, c_r as f32]).to_vec());
        for layers in [None, Some(3)] {
            let mut samples = Vec::new();
            for theta_i in [0.0, 0.4, 0.8, 1.1, 1.3, 1.45] {
                for (lambda_um, c_r, c_tt) in planted {
                    let f: f64 = c_r + (1.0 - c_r) * grazing(theta_i);
                    let through = (1.0 - f) * c_tt;
                    let [a_f, a_b] = [0.5 * f + through * share, 0.5 * f + through * (1.0 - share)];
                    let reflectance = layers_reflect(a_f, a_b, layers)[0];
                    samples.push(SwatchSample { theta_i, lambda_um, reflectance });
                }
            }
            for fits_c_r in [true, false] {
                let free = SwatchOptions { layers, c_r: fits_c_r, gamma_tt: !fits_c_r };
                let start = KhungurnParameters { c_tt: 0.5.into(), ..Default::default() };
                let start = if fits_c_r {
                    KhungurnParameters { c_r: 0.3.into(), gamma_tt: 0.52, ..start }
                } else {
                    KhungurnParameters { c_r: c_r.clone(), gamma_tt: 0.9, ..start }
                };
                let fit = fit_khungurn_swatch(&samples, &free, &start).unwrap();
                println!("{layers:?}: error {:.1e}, {:?}", fit.error, fit.parameters);
                assert!((fit.parameters.gamma_tt - 0.52).abs() < 1e-3, "{fit:?}");
                for (lambda, c_r, c_tt) in planted {
                    assert!((f64::from(fit.parameters.c_r.at(lambda as f32)) - c_r).abs() < 1e-3, "{fit:?}");
                    assert!((f64::from(fit.parameters.c_tt.at(lambda as f32)) - c_tt).abs() < 1e-3, "{fit:?}");
                }
            }
        }
    }

    #[test]
    fn gradients_are_the_differences() {
        let n = 2 * THETA_I.len() * ROWS * COLUMNS;
        let values = (0..n).map(|k| 0.05 + 0.05 * (0.37 * k as f64).sin()).collect();
        let x = [-2.0, -1.5, -0.7, 0.1, 0.3, 0.8, 0.4];
        differences(&Scattering { wavelengths: 2, values, norm: 300.0 }, &x);
        let sample = |theta_i, lambda_um, reflectance| SwatchSample { theta_i, lambda_um, reflectance };
        let samples = [sample(0.0, 0.5, 0.3), sample(1.1, 0.5, 0.35), sample(1.4, 0.6, 0.7)];
        for layers in [None, Some(1), Some(7)] {
            differences(&Swatch { samples: &samples, lambda_um: &[0.5, 0.6], layers, norm: 1.0 }, &x);
        }
    }
}
