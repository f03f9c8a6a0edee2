//! Two layers of yarn (Yu 2025, 5.4): the fractions of light that one layer, and two layers together, reflect
//! and transmit.
//!
//! A layer lit from above at latitude theta_i reflects the fraction `r` of the light that hits its fibers and
//! transmits the fraction `t`. Both are averages over the offsets h, as for light spread evenly over the
//! layer. Diffuse light from the other layer is reflected and transmitted by the fractions `r*` and `t*`.
//! Light bounces between the layers, and the geometric series of the bounces sums to
//!
//! ```text
//! T = t_1 t*_2 / (1 - r*_1 r*_2)
//! R = r_1 + t_1 r*_2 t*_1 / (1 - r*_1 r*_2)
//! ```
//!
//! Without absorption r + t = 1 in every layer, and then
//! `T + R = r_1 + t_1 ((1 - r*_2) + r*_2 (1 - r*_1)) / (1 - r*_1 r*_2) = 1`.

use super::asg::PARAMS;
use super::data::layer_factors::half_nodes;
use super::data::{MAX_PATHS, PlyData};
use super::kernel::absorption::clamped_sigma;
use crate::math::simd::{exp2, fma, halves, max, min};
use multiversion::{multiversion, target::target_cfg_f};
use std::f64::consts::LOG2_E;

/// [`super::LayerFactors`] laid out for evaluation: in f32, with the factors averaged over h.
#[derive(Clone, Debug)]
pub(crate) struct LayerTables {
    rows: usize,
    columns: usize,
    theta_last: f32,
    h_last: f32,
    /// -log2 e times the path lengths [um], padded with zeros.
    path: [f32; MAX_PATHS],
    /// Entries of one spectrum: J path lengths padded with zeros to a multiple of [`LANES`], then the entry
    /// of f_refl.
    size: usize,
    /// `[rows][columns][size]`: spectra of the energy scattered forward, at the nodes and half-way between
    /// them.
    forward: Vec<f32>,
    /// `[rows - 1][columns - 1]`, each at the four corners of a cell: the sum of the energies of its block's
    /// lobes at sigma = 0, the energy f_high that they are scaled to, and the share of the beam that hits
    /// fibers.
    lobes: Vec<[[f32; 4]; 3]>,
    /// `[rows][2][size]`: spectra of r and t at the latitudes.
    first: Vec<f32>,
    /// `[2][size]`: spectra of r* and t*.
    diffuse: Vec<f32>,
}

/// Path lengths that are processed side by side.
const LANES: usize = 8;

/// A spectrum over path lengths, and the share of f_refl, which is not absorbed.
struct Spectrum {
    refl: f32,
    high: [f32; MAX_PATHS],
}

impl LayerTables {
    pub(crate) fn new(d: &PlyData) -> Option<LayerTables> {
        let factors = d.layers.as_ref()?;
        let (m, h, _, j) = d.sizes();
        let (rows, columns) = (2 * m - 1, 2 * h - 1);
        let half_nodes = half_nodes(&d.energies, &d.theta_i, &d.h_um);
        let at = |row: usize, column: usize| &half_nodes[row * columns + column];
        let mut first = Vec::with_capacity(rows * 2 * (1 + j));
        for row in 0..rows {
            // The trapezoidal rule over h; the end nodes, where a beam hits almost nothing, have half the
            // weight.
            let weight = |n: usize| if n == 0 || n + 1 == columns { 0.5 } else { 1.0 };
            let mean = |of: &dyn Fn(usize) -> f64| (0..columns).map(|n| weight(n) * of(n)).sum::<f64>();
            let hit = mean(&|n| 1.0 - at(row, n).r_d).max(f64::MIN_POSITIVE);
            let forward = |p: usize| mean(&|n| factors.forward[(row * columns + n) * (1 + j) + p]) / hit;
            let all = |p: usize| mean(&|n| at(row, n).part(p)) / hit;
            first.extend((0..=j).map(|p| (all(p) - forward(p)) as f32));
            first.extend((0..=j).map(|p| forward(p) as f32));
        }
        let energy_high = |row: usize, column: usize| at(row, column).high.iter().sum::<f64>();
        // The spectrum of a lobe sums to 1, so at sigma = 0 the sum over a block's lobes is bilinear between
        // the block's corners, which are four half cells apart.
        let corner = d.lobes_high * PARAMS;
        let sum = |lobes: &[f64]| lobes.iter().skip(PARAMS - 1).step_by(PARAMS).sum::<f64>() as f32;
        let corner_sums: Vec<f32> = d.high.chunks_exact(corner).map(sum).collect();
        let mut lobes = Vec::with_capacity((rows - 1) * (columns - 1));
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let block = (row / 4) * ((h - 1) / 2) + column / 4;
                let within = |c: usize| {
                    ((row + c / 2 - row / 4 * 4) as f32 / 4.0, (column + c % 2 - column / 4 * 4) as f32 / 4.0)
                };
                let sums = [0, 1, 2, 3].map(within).map(|(s, t)| {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|c| corner_sums[4 * block + c]);
                    (1.0 - s) * ((1.0 - t) * a + t * b) + s * ((1.0 - t) * c + t * d)
                });
                let corners =
                    |of: &dyn Fn(usize, usize) -> f64| [0, 1, 2, 3].map(|c| of(row + c / 2, column + c % 2) as f32);
                lobes.push([sums, corners(&energy_high), corners(&|m, n| 1.0 - at(m, n).r_d)]);
            }
        }
        let size = j.next_multiple_of(LANES) + 1;
        let padded = |spectra: &[f32]| -> Vec<f32> {
            let of = |s: &[f32], p: usize| if p + 1 == size { s[0] } else { s.get(p + 1).copied().unwrap_or(0.0) };
            spectra.chunks(1 + j).flat_map(|s| (0..size).map(move |p| of(s, p))).collect()
        };
        let f32s = |x: &[f64]| x.iter().map(|v| *v as f32).collect::<Vec<f32>>();
        Some(LayerTables {
            rows,
            columns,
            theta_last: d.theta_i[m - 1] as f32,
            h_last: d.h_um[h - 1] as f32,
            path: std::array::from_fn(|p| d.path_um.get(p).map_or(0.0, |path| (-LOG2_E * path) as f32)),
            size,
            forward: padded(&f32s(&factors.forward)),
            lobes,
            first: padded(&first),
            diffuse: padded(&f32s(&factors.diffuse)),
        })
    }

    /// Transmittances of the path lengths. For a list of J path lengths only the first J, padded to
    /// [`LANES`], are set.
    #[inline(always)]
    fn transmittances<const FMA: bool>(&self, sigma: f32) -> [f32; MAX_PATHS] {
        let sigma = clamped_sigma(sigma);
        let mut t = [0.0; MAX_PATHS];
        let chunks = t.as_chunks_mut::<LANES>().0.iter_mut().zip(self.path.as_chunks::<LANES>().0);
        for (t, path) in chunks.take(self.size / LANES) {
            for i in 0..LANES {
                t[i] = exp2::<FMA>(sigma * path[i]);
            }
        }
        t
    }

    /// The weighted sum of spectra.
    #[inline(always)]
    fn mix<const FMA: bool, const A: usize>(&self, spectra: [(f32, &[f32]); A]) -> Spectrum {
        let mut sum = Spectrum { refl: 0.0, high: [0.0; MAX_PATHS] };
        for (weight, spectrum) in spectra {
            if let Some(last) = spectrum.last() {
                sum.refl = fma::<FMA>(weight, *last, sum.refl);
            }
            for (sum, spectrum) in sum.high.as_chunks_mut::<LANES>().0.iter_mut().zip(spectrum.as_chunks::<LANES>().0) {
                for i in 0..LANES {
                    sum[i] = fma::<FMA>(weight, spectrum[i], sum[i]);
                }
            }
        }
        sum
    }

    /// Sum of a spectrum's entries, each times its transmittance.
    #[inline(always)]
    fn absorbed<const FMA: bool>(&self, spectrum: &Spectrum, t: &[f32; MAX_PATHS]) -> f32 {
        let mut sum = [0.0; LANES];
        let chunks = spectrum.high.as_chunks::<LANES>().0.iter().zip(t.as_chunks::<LANES>().0);
        for (spectrum, t) in chunks.take(self.size / LANES) {
            for i in 0..LANES {
                sum[i] = fma::<FMA>(spectrum[i], t[i], sum[i]);
            }
        }
        spectrum.refl + halves(sum)
    }

    /// Spectrum `i` of an array of spectra.
    #[inline(always)]
    fn spectrum<'a>(&self, of: &'a [f32], i: usize) -> &'a [f32] {
        of.get(i * self.size..(i + 1) * self.size).unwrap_or(&[])
    }

    /// Index of the node below `x`, and the fraction of the way to the next node, for nodes 0 to `count - 1`.
    /// `x` is clamped to the nodes; NaN gives node 0 and fraction 0.
    #[inline(always)]
    fn place(x: f32, count: usize) -> (usize, f32) {
        let x = x.clamp(0.0, (count - 1) as f32);
        let at = (x as usize).min(count - 2);
        (at, if x.is_nan() { 0.0 } else { x - at as f32 })
    }

    /// Row of theta_i, and the fraction of the way to the next row.
    #[inline(always)]
    fn row(&self, theta_i: f32) -> (usize, f32) {
        Self::place(theta_i.abs() / self.theta_last * (self.rows - 1) as f32, self.rows)
    }

    /// Spectra of r, t, r* and t* at a latitude.
    #[inline(always)]
    fn layer<const FMA: bool>(&self, theta_i: f32) -> [Spectrum; 4] {
        let (m, s) = self.row(theta_i);
        [
            self.first::<FMA>(m, s, 0),
            self.first::<FMA>(m, s, 1),
            self.mix::<FMA, 1>([(1.0, self.spectrum(&self.diffuse, 0))]),
            self.mix::<FMA, 1>([(1.0, self.spectrum(&self.diffuse, 1))]),
        ]
    }

    /// Spectrum of r (`half` = 0) or t (`half` = 1), at the fraction `s` from row `m` to the next.
    #[inline(always)]
    fn first<const FMA: bool>(&self, m: usize, s: f32, half: usize) -> Spectrum {
        let (a, b) = (self.spectrum(&self.first, m * 2 + half), self.spectrum(&self.first, m * 2 + 2 + half));
        self.mix::<FMA, 2>([(1.0 - s, a), (s, b)])
    }

    /// Spectrum of the energy scattered forward, and the factor by which its absorbed sum is multiplied.
    /// `None` if the beam hits nothing: |h| is beyond the nodes, or theta_i or h is NaN.
    #[inline(always)]
    fn forward<const FMA: bool>(&self, theta_i: f32, h_um: f32, r_d: f32) -> Option<(Spectrum, f32)> {
        // Beams beyond the nodes hit nothing.
        if h_um.abs() > self.h_last || h_um.is_nan() || theta_i.is_nan() {
            return None;
        }
        let h = if theta_i < 0.0 { -h_um } else { h_um };
        let (m, s) = self.row(theta_i);
        let (n, x) = Self::place((h / self.h_last + 1.0) * 0.5 * (self.columns - 1) as f32, self.columns);
        let (low, high) = (m * self.columns + n, (m + 1) * self.columns + n);
        let weights = [(1.0 - s) * (1.0 - x), (1.0 - s) * x, s * (1.0 - x), s * x];
        let spectra = [low, low + 1, high, high + 1].map(|i| self.spectrum(&self.forward, i));
        let [sums, energies, hit] = self.lobes.get(m * (self.columns - 1) + n)?;
        // Lobes are interpolated linearly between the corners and then scaled to the energy, so the weight of
        // a corner is in proportion to the energy of its lobes.
        let (mut sum, mut energy, mut linear) = (0.0, 0.0, 0.0);
        for c in 0..4 {
            sum = fma::<FMA>(weights[c], sums[c], sum);
            energy = fma::<FMA>(weights[c], energies[c], energy);
            linear = fma::<FMA>(weights[c], hit[c], linear);
        }
        // The share that hits fibers is not linear in h near the ply's edge, and all energies are in
        // proportion to it.
        let hit = max(1.0 - r_d, 0.0) / max(linear, MIN);
        let scale = energy / max(sum, MIN);
        let (mut corners, mut refl) = ([(0.0, spectra[0]); 4], 0.0);
        for c in 0..4 {
            let weight = weights[c] * scale * sums[c] / max(energies[c], MIN);
            corners[c] = (weight, spectra[c]);
            // The shares of f_refl are interpolated linearly.
            if let Some(last) = spectra[c].last() {
                refl = fma::<FMA>(weights[c] - weight, *last, refl);
            }
        }
        let mut spectrum = self.mix::<FMA, 4>(corners);
        spectrum.refl += refl;
        Some((spectrum, hit))
    }
}

/// Lower bound of the divisors, against division by zero.
const MIN: f32 = 1e-12;

/// [`PlyModel::layer`] and the tabulated [`PlyModel::forward_energy`] at an incidence at which the share
/// `r_d` of the beam misses the fibers.
///
/// [`PlyModel::layer`]: super::PlyModel::layer
/// [`PlyModel::forward_energy`]: super::PlyModel::forward_energy
#[inline]
pub(super) fn layer_and_forward<const N: usize>(
    tables: &LayerTables,
    theta_i: f32,
    h_um: f32,
    r_d: f32,
    sigma: &[f32; N],
) -> (Layer<N>, [f32; N]) {
    let (mut layer, mut forward) = ([[0.0; 4]; N], [0.0; N]);
    layer_into(tables, theta_i, sigma, &mut layer);
    forward_into(tables, [theta_i, h_um], r_d, sigma, &mut forward);
    (Layer::of(layer), forward)
}

/// [`PlyModel::layer`] from the tables.
///
/// [`PlyModel::layer`]: super::PlyModel::layer
#[inline]
pub(super) fn layer<const N: usize>(tables: &LayerTables, theta_i: f32, sigma: &[f32; N]) -> Layer<N> {
    let mut layer = [[0.0; 4]; N];
    layer_into(tables, theta_i, sigma, &mut layer);
    Layer::of(layer)
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn layer_into(tables: &LayerTables, theta_i: f32, sigma: &[f32], layer: &mut [[f32; 4]]) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let spectra = tables.layer::<FMA>(theta_i);
    for (sigma, layer) in sigma.iter().zip(layer) {
        let t = tables.transmittances::<FMA>(*sigma);
        for i in 0..4 {
            layer[i] = tables.absorbed::<FMA>(&spectra[i], &t);
        }
    }
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn forward_into(tables: &LayerTables, [theta_i, h_um]: [f32; 2], r_d: f32, sigma: &[f32], energy: &mut [f32]) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let Some((spectrum, hit)) = tables.forward::<FMA>(theta_i, h_um, r_d) else { return };
    for (sigma, energy) in sigma.iter().zip(energy) {
        let t = tables.transmittances::<FMA>(*sigma);
        *energy = max(tables.absorbed::<FMA>(&spectrum, &t), 0.0) * hit;
    }
}

/// Reflected and transmitted fractions of the light that hits one layer's fibers, for N absorptions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer<const N: usize> {
    /// Fraction r, reflected into the half space that the light came from.
    pub reflected: [f32; N],
    /// Fraction t, transmitted to the other half space.
    pub transmitted: [f32; N],
    /// Fraction r*, reflected of diffuse light.
    pub reflected_diffuse: [f32; N],
    /// Fraction t*, transmitted of diffuse light.
    pub transmitted_diffuse: [f32; N],
}

impl<const N: usize> Layer<N> {
    /// The layer from `[r, t, r*, t*]` for each absorption, made to conserve energy.
    fn of(of: [[f32; 4]; N]) -> Layer<N> {
        Layer {
            reflected: std::array::from_fn(|k| of[k][0]),
            transmitted: std::array::from_fn(|k| of[k][1]),
            reflected_diffuse: std::array::from_fn(|k| of[k][2]),
            transmitted_diffuse: std::array::from_fn(|k| of[k][3]),
        }
        .conserved()
    }

    /// Clamps the fractions to 0 or more and scales each pair to a sum of at most 1, because simulated
    /// energies have noise and a layer cannot scatter more than it receives. NaN becomes 0.
    pub(super) fn conserved(mut self) -> Self {
        for k in 0..N {
            for (r, t) in [
                (&mut self.reflected[k], &mut self.transmitted[k]),
                (&mut self.reflected_diffuse[k], &mut self.transmitted_diffuse[k]),
            ] {
                let (back, through) = (min(max(*r, 0.0), 1e6), min(max(*t, 0.0), 1e6));
                let scale = 1.0 / max(back + through, 1.0);
                (*r, *t) = (back * scale, through * scale);
            }
        }
        self
    }

    /// R and T of this layer with the layer `below` beneath it, by the formulas of the module.
    pub fn over(&self, below: &Layer<N>) -> TwoLayers<N> {
        let mut two = TwoLayers { reflected: [0.0; N], transmitted: [0.0; N] };
        for k in 0..N {
            let (r1, r2) = (self.reflected_diffuse[k], below.reflected_diffuse[k]);
            // The denominator vanishes only for two layers that reflect all diffuse light; no real yarn does.
            let through = self.transmitted[k] / (1.0 - r1 * r2).max(1e-6);
            two.transmitted[k] = through * below.transmitted_diffuse[k];
            two.reflected[k] = self.reflected[k] + through * r2 * self.transmitted_diffuse[k];
        }
        two
    }
}

/// Reflected and transmitted fractions of the light that hits the upper one of two layers, for N absorptions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoLayers<const N: usize> {
    /// Fraction R, reflected by both layers together.
    pub reflected: [f32; N],
    /// Fraction T, transmitted through both layers.
    pub transmitted: [f32; N],
}
