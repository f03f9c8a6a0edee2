//! Comparison of a cloth model with its twin: energies and distributions, direction by direction.
//!
//! The model's distribution is the mean of its `eval` over points in the traced repeats and over directions
//! within each bin. The distance in a half of the sphere is the relative L2 distance over the bins with the
//! twin's noise removed. With the twin's density t, its variance v and the model's density m, it is
//! `sqrt((sum (m - t)^2 - v) / (sum t^2 - v))`, since the expected value of `(m - t)^2` is `(m - E t)^2 + v`
//! and that of `t^2` is `(E t)^2 + v`.

use super::{ClothTwin, SphereBins};
use plywave::cloth::ClothModel;
use plywave::{Bsdf, ClothQuery};

/// Outgoing light, as fractions of the incident light.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Light {
    /// Light scattered to the side from which it came.
    pub reflected: f64,
    /// Light scattered to the other side.
    pub transmitted: f64,
    /// Light that passes without scattering.
    pub straight: f64,
}

/// Comparison of a model with its twin, for one view and one pair of absorptions.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// Index of the view.
    pub view: usize,
    /// Index of the pair of absorptions.
    pub sigma: usize,
    /// The twin's light.
    pub twin: Light,
    /// The model's light; `transmitted` includes light diffracted by gaps, if the model has it.
    pub model: Light,
    /// Relative L2 distance in the half from which the light came, noise removed.
    pub upper: f64,
    /// Relative L2 distance in the other half, noise removed; NaN if noise exceeds the twin's light.
    pub lower: f64,
}

/// Sampling of a model's mean over the repeats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparisonOptions {
    /// Number of points, distributed uniformly over the traced repeats.
    pub places: usize,
    /// Number of directions per side of a bin.
    pub directions: usize,
}

impl Default for ComparisonOptions {
    /// One direction per bin at each point. With a quarter of the points and four directions, the straight
    /// light through denim differed by up to 0.009 from that of 100 000 points.
    fn default() -> Self {
        ComparisonOptions { places: 4096, directions: 1 }
    }
}

/// Number of absorptions that are evaluated together.
const N: usize = 4;

/// The inverse of the plastic number and its square: steps of a low-discrepancy sequence in the plane.
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Steps of the low-discrepancy sequence for the directions within a bin and for the repeats. They are powers
/// of the root of x^5 = x + 1, incommensurate with the steps of the points.
const STEPS_OF_DIRECTIONS: [f64; 2] = [0.856_674_883_854_502_9, 0.733_891_856_627_126];
const STEPS_OF_REPEATS: [f64; 2] = [0.628_706_721_042_211_5, 0.538_597_257_223_612_7];

/// Number of repeats along each side over which the points lie. Hairs and unevenness differ from one repeat
/// to the next; the twin has some of its own, which are not those of the model.
const REPEATS: f64 = 32.0;

/// Compares a view of the twin at all of its absorptions, in their order. The absorptions are those of the
/// twin; the cloth's own colors are ignored.
pub fn compare(cloth: &ClothModel, twin: &ClothTwin, view: usize, options: &ComparisonOptions) -> Vec<Comparison> {
    let mut all = Vec::with_capacity(twin.sigma_count());
    for first in (0..twin.sigma_count()).step_by(N) {
        let (densities, straight) = mean_of_model(cloth, twin, view, first, options);
        for k in 0..N.min(twin.sigma_count() - first) {
            let model: Vec<f64> = densities.iter().map(|d| d[k]).collect();
            all.push(comparison_of(twin, view, first + k, &model, straight[k]));
        }
    }
    all
}

/// Half-angle of the cone around the straight direction that is integrated separately [rad], since light
/// beside plies and through gaps has narrow lobes there.
const CONE_RAD: f64 = 0.2;
/// Number of directions in the cone at each point.
const CONE_DIRECTIONS: usize = 64;

/// Directions with their solid angles and bins, sampled again for each point.
struct Directions {
    w: Vec<[f32; 3]>,
    solid_angle: Vec<f64>,
    bin: Vec<usize>,
}

impl Directions {
    /// Fills in directions: uniform over cells of the bins outside of the cone around the straight direction,
    /// and denser towards the middle within the cone. They differ between points, so that the mean over
    /// points resolves lobes narrower than the cells.
    fn fill(&mut self, bins: &SphereBins, wo: [f32; 3], side: usize, place: usize) {
        let straight = wo.map(|v| f64::from(-v));
        let shift = STEPS_OF_DIRECTIONS.map(|step| (0.5 + place as f64 * step).fract());
        let inside = |k: usize, shift: f64| (k as f64 + shift) / side as f64;
        self.w.clear();
        self.solid_angle.clear();
        self.bin.clear();
        let cell = bins.solid_angle() / (side * side) as f64;
        for i in 0..bins.len() * side * side {
            let bin = i / (side * side);
            let w = bins.direction(bin, inside(i / side % side, shift[0]), inside(i % side, shift[1]));
            if (0..3).map(|k| f64::from(w[k]) * straight[k]).sum::<f64>() < CONE_RAD.cos() {
                self.push(w, cell, bin);
            }
        }
        // Two axes perpendicular to the straight direction.
        let [x, y, z] = straight;
        let a = if x.abs() < 0.7 { [0.0, z, -y] } else { [-z, 0.0, x] };
        let norm = a.iter().map(|v| v * v).sum::<f64>().sqrt();
        let a = a.map(|v| v / norm);
        let b = [y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]];
        for i in 0..CONE_DIRECTIONS {
            let u = (i as f64 + shift[0]) / CONE_DIRECTIONS as f64;
            let tilt = CONE_RAD * u * u;
            let turn = std::f64::consts::TAU * ((i as f64 * STEPS[0] + shift[1]).fract());
            let (sin, cos) = tilt.sin_cos();
            let w = std::array::from_fn(|k| (cos * straight[k] + sin * (turn.cos() * a[k] + turn.sin() * b[k])) as f32);
            // The solid angle is sin(tilt) d tilt d turn.
            let solid_angle = sin * 2.0 * CONE_RAD * u * std::f64::consts::TAU / CONE_DIRECTIONS as f64;
            self.push(w, solid_angle, bins.bin(w));
        }
    }

    fn push(&mut self, w: [f32; 3], solid_angle: f64, bin: usize) {
        self.w.push(w);
        self.solid_angle.push(solid_angle);
        self.bin.push(bin);
    }
}

/// Densities `[bin][N]` and straight light `[N]` of the model, for the N absorptions from `first` on.
fn mean_of_model(
    cloth: &ClothModel,
    twin: &ClothTwin,
    view: usize,
    first: usize,
    options: &ComparisonOptions,
) -> (Vec<[f64; N]>, [f64; N]) {
    let last = twin.sigma_count() - 1;
    let sigma = [0, 1].map(|family| std::array::from_fn(|k| twin.sigma((first + k).min(last))[family] as f32));
    let wo = twin.view(view).map(|v| v as f32);
    let side = options.directions.max(1);
    let count = twin.bins.len() * side * side + CONE_DIRECTIONS;
    let mut directions = Directions { w: Vec::new(), solid_angle: Vec::new(), bin: Vec::new() };
    let (mut f, mut pdf) = (vec![[0.0f32; N]; count], vec![0.0f32; count]);
    let mut sums = vec![[0.0f64; N]; twin.bins.len()];
    let mut straight = [0.0f64; N];
    let places = options.places.max(1);
    for place in 0..places {
        // Repeats have their own sequence, since steps over many repeats are not uniform within one.
        let at = [0, 1].map(|k| {
            let even = |steps: [f64; 2]| (0.5 + place as f64 * steps[k]).fract();
            let repeat = (even(STEPS_OF_REPEATS) * REPEATS).floor();
            (twin.repeat_um[k] * (repeat + even(STEPS))) as f32
        });
        let query = ClothQuery { sigma_per_um: sigma.map(Some), ..ClothQuery::new(at, wo, [0.55; N]) };
        let bsdf = cloth.at(&query);
        directions.fill(&twin.bins, wo, side, place);
        bsdf.eval_batch(&directions.w, &mut f, &mut pdf);
        for ((f, bin), solid_angle) in f.iter().zip(&directions.bin).zip(&directions.solid_angle) {
            (0..N).for_each(|k| sums[*bin][k] += f64::from(f[k]) * solid_angle);
        }
        bsdf.straight().iter().zip(&mut straight).for_each(|(s, sum)| *sum += f64::from(*s) / places as f64);
    }
    let scale = 1.0 / (places as f64 * twin.bins.solid_angle());
    (sums.into_iter().map(|sum| sum.map(|s| s * scale)).collect(), straight)
}

/// Compares the densities of a model with those of the twin.
fn comparison_of(twin: &ClothTwin, view: usize, sigma: usize, model: &[f64], straight: f64) -> Comparison {
    let (density, variance) = twin.distribution(view, sigma);
    let from_face = twin.view(view)[2] > 0.0;
    let solid_angle = twin.bins.solid_angle();
    // For the upper half, from which the light comes, then for the lower one: the model's energy, squared
    // difference and squared density, both minus the noise.
    let mut halves = [[0.0f64; 3]; 2];
    for bin in 0..twin.bins.len() {
        let half = &mut halves[usize::from(twin.bins.is_up(bin) != from_face)];
        let (t, v, m) = (f64::from(density[bin]), f64::from(variance[bin]), model[bin]);
        half[0] += m * solid_angle;
        half[1] += (m - t).powi(2) - v;
        half[2] += t * t - v;
    }
    let distance = |[_, off, norm]: [f64; 3]| if norm > 0.0 { (off.max(0.0) / norm).sqrt() } else { f64::NAN };
    Comparison {
        view,
        sigma,
        twin: twin.light(view, sigma),
        model: Light { reflected: halves[0][0], transmitted: halves[1][0], straight },
        upper: distance(halves[0]),
        lower: distance(halves[1]),
    }
}
