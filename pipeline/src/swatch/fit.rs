//! The fit of a table to the blocks of two pictures, with error bars.
//!
//! Unknowns are the coordinates of [`LightTable::at`]. Exposure, white balance, vignetting and a gradient of
//! each picture are unknown too: they are linear in the logarithm of the light, with Gaussian priors, and are
//! solved for at every evaluation. The residual of a block counts as one number for all its channels and for
//! its neighbors, since a model's errors are smooth. L-BFGS-B minimizes; bars are the larger of the curvature
//! of the cost and the deviation of refits to resampled parts of the pictures, with the errors of the model.

use super::geometry::SwatchGeometry;
use super::photo::{BLOCKS, Blocks, SIDE};
use super::table::{LightTable, UNKNOWNS, of_sigma, sigma_range};
use nalgebra::{SMatrix, SVector, SymmetricEigen};
use plywave_fit::{CostGradient, LbfgsbOptions, minimize};

/// Nuisances of a picture: exposure, red, blue, vignetting, gradient across and down, with the standard
/// deviations of their priors.
const NUISANCES: usize = 6;
const NUISANCE_SD: [f64; NUISANCES] = [10.0, 0.05, 0.05, 0.08, 0.06, 0.06];
/// Deviation of an exposure that a white patch fixes.
const WHITE_SD: f64 = 0.05;
/// Least relative error of a block, and numbers of a block and its neighbors that count as one.
const MIN_ERROR: f64 = 0.03;
const ALIKE: f64 = 12.0;
/// Blocks along a side of the middle of the back-lit picture, where the lamp's image is; they count as one.
const MIDDLE: usize = 2;
/// Share of saturated pixels from which a block says only how bright it is at least.
const MAX_SATURATED: f64 = 0.02;
/// Value of a channel, 1 for white, that counts half.
const DARK: f64 = 0.01;
/// Deviation of the logarithm of a mass that is given.
pub const MASS_SD: f64 = 0.03;
/// Parts of a picture along a side that are resampled, and number of refits.
const PARTS: usize = 4;
const REFITS: usize = 10;
/// Steps of differences.
const STEP: f64 = 1e-4;
const STEP_2: f64 = 2e-2;
/// Most turns of the solver of eigenvalues; a few for each unknown are enough.
const MAX_TURNS: usize = 1000;

/// A Gaussian prior of an unknown.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// Deviation that errors of the model leave.
    pub model_sd: f64,
}

/// The data of a fit.
pub struct SwatchData {
    /// `[picture][block][channel]`: logarithms of the light.
    light: Vec<[f64; 3]>,
    /// `[picture][block][channel]`: weights.
    weights: Vec<[f64; 3]>,
    /// `[picture][block]`: whether the light is a lower bound.
    is_bound: Vec<bool>,
    /// Light of the lamp's image over the middle, per share that goes straight on.
    lamp: f64,
    /// Logarithm of the exposure of the front picture, if a white patch tells it.
    exposure: Option<f64>,
    /// Mass per area that is known [g/m2].
    g_per_m2: Option<f64>,
}

/// Weight of a channel of this value, 1 for white: dark channels are cut off by the camera's gamut.
fn trust(value: f64) -> f64 {
    1.0 / (1.0 + (DARK / value.max(1e-5)).powi(2))
}

/// Whether a block lies in the middle.
fn is_middle(block: usize) -> bool {
    let near = |at: usize| ((SIDE - MIDDLE) / 2..(SIDE + MIDDLE) / 2).contains(&at);
    near(block % SIDE) && near(block / SIDE)
}

impl SwatchData {
    /// The data of two pictures.
    pub fn new(
        pictures: [&Blocks; 2],
        geometry: &SwatchGeometry,
        aspect: f64,
        (exposure, g_per_m2): (Option<f64>, Option<f64>),
    ) -> SwatchData {
        let (mut light, mut weights, mut is_bound) = (Vec::new(), Vec::new(), Vec::new());
        for (k, blocks) in pictures.into_iter().enumerate() {
            for block in 0..BLOCKS {
                light.push(blocks.rgb[block].map(|v| v.max(1e-5).ln()));
                let [covered, saturated] = [blocks.covered[block], blocks.saturated[block]];
                weights.push(blocks.rgb[block].map(|v| if covered < 0.5 { 0.0 } else { trust(v) }));
                is_bound.push(saturated > MAX_SATURATED);
                if k == 1 && is_middle(block) {
                    weights[BLOCKS + block] = [0.0; 3];
                }
            }
        }
        // The middle of the back-lit picture as one number, kept at its first block.
        let middle: Vec<usize> = (0..BLOCKS).filter(|block| is_middle(*block)).collect();
        let count = middle.len() as f64;
        let mean: [f64; 3] =
            std::array::from_fn(|c| middle.iter().map(|b| pictures[1].rgb[*b][c]).sum::<f64>() / count);
        let first = BLOCKS + middle[0];
        light[first] = mean.map(|v| v.max(1e-5).ln());
        weights[first] = mean.map(|v| count * trust(v));
        is_bound[first] = middle.iter().map(|b| pictures[1].saturated[*b]).sum::<f64>() / count > MAX_SATURATED / 4.0;
        let (camera, lamp) = (geometry.camera_mm, -geometry.back_lamp_mm[2]);
        let block_mm2 = geometry.seen_mm().powi(2) * aspect / BLOCKS as f64;
        // The lamp gives an irradiance of 1 at the camera's distance; its image is seen through the cloth.
        let image = camera.powi(2) * (camera / (camera + lamp)).powi(2) / (block_mm2 * count);
        SwatchData { light, weights, is_bound, lamp: image, exposure, g_per_m2 }
    }
}

/// A cost over a table, with weights of the parts of the pictures.
struct Cost<'a> {
    table: &'a LightTable,
    data: &'a SwatchData,
    priors: &'a [Prior; UNKNOWNS],
    /// `[part]`: how often it was drawn; 1 for the fit itself.
    parts: Vec<f64>,
    /// Error of a block.
    error: f64,
}

/// Columns of the nuisances at a block and channel.
fn nuisances(block: usize, channel: usize) -> [f64; NUISANCES] {
    let [x, y] = [block % SIDE, block / SIDE].map(|at| (2 * at + 1) as f64 / SIDE as f64 - 1.0);
    let of = |c: usize| f64::from(u8::from(channel == c));
    [1.0, of(0), of(2), 0.5 * (x * x + y * y), x, y]
}

/// Of the unknowns.
pub type Covariance = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// What a cost is made of.
pub struct Evaluated {
    /// The cost: half of the sum of squares over variances.
    pub cost: f64,
    /// Root mean square of the residuals of the blocks.
    pub rms: f64,
    /// How many independent numbers the blocks count as.
    pub count: f64,
    /// Exposures of the pictures, logarithms.
    pub exposures: [f64; 2],
}

impl Cost<'_> {
    fn evaluate(&self, x: &[f64; UNKNOWNS]) -> Evaluated {
        let model = self.model(x);
        let per = 1.0 / (self.error * self.error * ALIKE);
        let (mut cost, mut squares, mut count) = (0.0, 0.0, 0.0);
        let mut exposures = [0.0; 2];
        for picture in 0..2 {
            let (mut a, mut b) = (SMatrix::<f64, NUISANCES, NUISANCES>::zeros(), SVector::<f64, NUISANCES>::zeros());
            for (k, sd) in NUISANCE_SD.iter().enumerate() {
                a[(k, k)] = 1.0 / (sd * sd);
            }
            if let (0, Some(exposure)) = (picture, self.data.exposure) {
                a[(0, 0)] = 1.0 / (WHITE_SD * WHITE_SD);
                b[0] = exposure * a[(0, 0)];
            }
            let prior = (a, b);
            let each = |of: &mut dyn FnMut(usize, usize, f64, f64)| {
                for block in 0..BLOCKS {
                    let i = picture * BLOCKS + block;
                    let part = block / SIDE * PARTS / SIDE * PARTS + block % SIDE * PARTS / SIDE;
                    let of_part = self.parts[picture * PARTS * PARTS + part] * per;
                    for c in 0..3 {
                        let w = self.data.weights[i][c] * of_part;
                        if w > 0.0 {
                            of(block, c, w, self.data.light[i][c] - model[i][c]);
                        }
                    }
                }
            };
            let bound = |block: usize| self.data.is_bound[picture * BLOCKS + block];
            each(&mut |block, c, w, r| {
                if !bound(block) {
                    let columns = SVector::from(nuisances(block, c));
                    a += w * columns * columns.transpose();
                    b += w * r * columns;
                }
            });
            // With the priors the matrix is positive.
            let b = a.cholesky().map_or(b, |factor| factor.solve(&b));
            exposures[picture] = b[0];
            each(&mut |block, c, w, r| {
                let columns = nuisances(block, c);
                let left = r - (0..NUISANCES).map(|k| columns[k] * b[k]).sum::<f64>();
                // A saturated block is at least as bright as it seems.
                let left = if bound(block) { left.max(0.0) } else { left };
                cost += 0.5 * w * left * left;
                squares += w * left * left / per;
                count += w / per;
            });
            for k in 0..NUISANCES {
                let precision = prior.0[(k, k)];
                cost += 0.5 * precision * (b[k] - prior.1[k] / precision).powi(2);
            }
        }
        for (x, prior) in x.iter().zip(self.priors) {
            cost += 0.5 * ((x - prior.mean) / prior.sd).powi(2);
        }
        if let Some(known) = self.data.g_per_m2 {
            cost += 0.5 * ((self.table.measures(x).g_per_m2 / known).ln() / MASS_SD).powi(2);
        }
        Evaluated { cost, rms: (squares / f64::max(count, 1e-9)).sqrt(), count: count / ALIKE, exposures }
    }

    /// Logarithms of the light, with the lamp's image in the middle of the back-lit picture.
    fn model(&self, x: &[f64; UNKNOWNS]) -> Vec<[f64; 3]> {
        let mut model = self.table.at(x);
        let middle: Vec<usize> = (0..BLOCKS).filter(|block| is_middle(*block)).collect();
        let straight = self.data.lamp * self.table.measures(x).openness;
        let mean: [f64; 3] = std::array::from_fn(|c| {
            let diffuse: f64 = middle.iter().map(|b| model[BLOCKS + b][c].exp()).sum();
            (diffuse / middle.len() as f64 + straight).ln()
        });
        model[BLOCKS + middle[0]] = mean;
        model
    }

    fn gradient(&self, x: &[f64; UNKNOWNS]) -> [f64; UNKNOWNS] {
        std::array::from_fn(|k| {
            let at = |by: f64| {
                let mut x = *x;
                x[k] += by;
                self.evaluate(&x).cost
            };
            (at(STEP) - at(-STEP)) / (2.0 * STEP)
        })
    }
}

impl CostGradient for Cost<'_> {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        let x: [f64; UNKNOWNS] = std::array::from_fn(|k| x[k]);
        gradient.copy_from_slice(&self.gradient(&x));
        Ok(self.evaluate(&x).cost)
    }
}

/// A fit with its bars.
#[derive(Clone, Debug)]
pub struct SwatchSolution {
    /// The unknowns.
    pub x: [f64; UNKNOWNS],
    /// Their standard deviations: the larger of those by curvature and by refits, with the model's errors.
    pub sd: [f64; UNKNOWNS],
    /// By the curvature of the cost.
    pub curvature: Covariance,
    /// By refits to resampled parts.
    pub refits: Vec<[f64; UNKNOWNS]>,
    /// The cost.
    pub cost: f64,
    /// The cost with the blocks' error, so that fits of other weaves compare: minus a log-likelihood.
    pub unlikely: f64,
    /// Root mean square of the residuals of the blocks, relative.
    pub rms: f64,
    /// Logarithms of exposures.
    pub exposures: [f64; 2],
    /// Evaluations of the cost.
    pub evaluations: usize,
}

fn run(cost: &Cost<'_>, starts: &[[f64; UNKNOWNS]]) -> Option<([f64; UNKNOWNS], f64, usize)> {
    let [low, high] = sigma_range();
    let ranges: [[f64; 2]; UNKNOWNS] = std::array::from_fn(|k| if k < 4 { cost.table.range(k) } else { [low, high] });
    let [lower, upper] = [0, 1].map(|end| ranges.map(|r| r[end]).to_vec());
    let options = LbfgsbOptions { max_iterations: 60, ftol: 1e-9, pgtol: 1e-5, ..LbfgsbOptions::default() };
    let mut best: Option<([f64; UNKNOWNS], f64, usize)> = None;
    for start in starts {
        let start: Vec<f64> = (0..UNKNOWNS).map(|k| start[k].clamp(lower[k], upper[k])).collect();
        let Ok(solution) = minimize(cost, &start, &lower, &upper, &options) else { continue };
        let evaluations = solution.evaluations as usize * (2 * UNKNOWNS + 1) + best.as_ref().map_or(0, |b| b.2);
        let better = best.as_ref().is_none_or(|b| solution.cost < b.1);
        let (x, value) = match (better, &best) {
            (false, Some(best)) => (best.0, best.1),
            _ => (std::array::from_fn(|k| solution.x[k]), solution.cost),
        };
        best = Some((x, value, evaluations));
    }
    best
}

/// Fits a table to the data, from several starts. `None` if no start has a finite cost.
pub fn fit_table(table: &LightTable, data: &SwatchData, priors: &[Prior; UNKNOWNS]) -> Option<SwatchSolution> {
    let mut cost = Cost { table, data, priors, parts: vec![1.0; 2 * PARTS * PARTS], error: 0.06 };
    let usual: [f64; UNKNOWNS] = std::array::from_fn(|k| priors[k].mean);
    let mut starts = vec![usual];
    for sigma in [0.002, 0.015] {
        for ln_alpha in [table.range(3)[0] + 0.3, table.range(3)[1] - 0.3] {
            let mut start = usual;
            start[3] = ln_alpha;
            start[4..].fill(of_sigma(sigma));
            starts.push(start);
        }
    }
    let (x, ..) = run(&cost, &starts)?;
    cost.error = cost.evaluate(&x).rms.max(MIN_ERROR);
    let (x, value, evaluations) = run(&cost, &[x])?;
    let Evaluated { rms, count, exposures, .. } = cost.evaluate(&x);
    let unlikely = value + count * cost.error.ln();
    let curvature = covariance(&cost, &x);
    let mut refits = Vec::new();
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    for _ in 0..REFITS {
        let count = PARTS * PARTS;
        cost.parts = vec![0.0; 2 * count];
        for picture in 0..2 {
            for _ in 0..count {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                cost.parts[picture * count + (state >> 33) as usize % count] += 1.0;
            }
        }
        refits.extend(run(&cost, &[x]).map(|found| found.0));
    }
    let sd = std::array::from_fn(|k| {
        let squares: f64 = refits.iter().map(|other| (other[k] - x[k]).powi(2)).sum();
        let of_refits = squares / refits.len().max(1) as f64;
        curvature[(k, k)].max(of_refits).sqrt().hypot(priors[k].model_sd).min(priors[k].sd)
    });
    Some(SwatchSolution { x, sd, curvature, refits, cost: value, unlikely, rms, exposures, evaluations })
}

/// The inverse of the cost's matrix of second derivatives.
fn covariance(cost: &Cost<'_>, x: &[f64; UNKNOWNS]) -> Covariance {
    let of_axis = |k: usize| {
        let at = |by: f64| {
            let mut x = *x;
            x[k] += by;
            SVector::from(cost.gradient(&x))
        };
        (at(STEP_2) - at(-STEP_2)) / (2.0 * STEP_2)
    };
    let columns: [SVector<f64, UNKNOWNS>; UNKNOWNS] = std::array::from_fn(of_axis);
    let half = SMatrix::from_columns(&columns);
    above_priors(&(0.5 * (half + half.transpose())), &std::array::from_fn(|k| cost.priors[k].sd))
}

/// The inverse of a matrix of second derivatives of which no direction curves less than the priors do, in
/// units of their deviations.
fn above_priors(hessian: &Covariance, sd: &[f64; UNKNOWNS]) -> Covariance {
    let units = Covariance::from_diagonal(&SVector::from(*sd));
    let eigen = SymmetricEigen::try_new(units * hessian * units, f64::EPSILON, MAX_TURNS);
    let Some(eigen) = eigen.filter(|e| e.eigenvalues.iter().all(|c| c.is_finite())) else {
        return units * units;
    };
    let variances = eigen.eigenvalues.map(|curvature| 1.0 / curvature.max(1.0));
    let turned = units * eigen.eigenvectors;
    turned * Covariance::from_diagonal(&variances) * turned.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions that the pictures tell keep their bars beside those that they do not, saddles among them.
    #[test]
    fn bars_are_at_most_the_priors_in_every_direction() {
        let sd = [0.5, 0.3, 0.8, 0.5, 1.2, 1.0, 2.0];
        let any = Covariance::from_fn(|i, j| ((3 * i + 5 * j * j + i * j) as f64).sin());
        let turn = any.qr().q();
        let units = Covariance::from_diagonal(&SVector::from(sd));
        let back = Covariance::from_diagonal(&SVector::from(sd.map(|s| 1.0 / s)));
        let told = SVector::from([100.0, 25.0, 4.0, 1.0, 0.2, 0.0, -5.0]);
        let hessian = back * turn * Covariance::from_diagonal(&told) * turn.transpose() * back;
        let variances = SVector::from([0.01, 0.04, 0.25, 1.0, 1.0, 1.0, 1.0]);
        let want = units * turn * Covariance::from_diagonal(&variances) * turn.transpose() * units;
        let found = above_priors(&hessian, &sd);
        assert!((found - want).abs().max() < 1e-12, "{found} {want}");
        let unknown = above_priors(&Covariance::repeat(f64::NAN), &sd);
        assert_eq!(unknown, units * units);
    }
}
