//! Two layers of yarn (Yu 2025, 5.4): how much light a layer sends back and lets through, and what two of them do together.
//!
//! A layer seen from above at latitude theta_i sends back the fraction `r` of the light that meets its fibers and lets `t` through, averaged over the
//! offsets h, which is what light spread evenly over the layer meets. Light that comes diffuse from the other layer meets `r*` and `t*`. Between
//! the layers light goes to and fro; the sums of the series are
//!
//! ```text
//! T = t_1 t*_2 / (1 - r*_1 r*_2)
//! R = r_1 + t_1 r*_2 t*_1 / (1 - r*_1 r*_2)
//! ```
//!
//! Without absorption r + t = 1 in every layer, and then `T + R = r_1 + t_1 ((1 - r*_2) + r*_2 (1 - r*_1)) / (1 - r*_1 r*_2) = 1`.

use crate::file::{Check, Reader, Writer};
use crate::ply::PlyData;
use crate::{PlyModel, Result, Scatter, ScatterSample, WholePly};
use std::f32::consts::PI;

/// Names of the tensors in a model file.
pub(crate) const NAMES: [&str; 2] = ["layer_forward", "layer_diffuse"];

/// The tensors of a model from which its layers follow. Flat arrays, last index fastest; of the last axis the first entry is f_refl, the others are
/// the path-length spectrum of f_high on `PlyData::path_um`, so that a factor holds at every absorption.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerFactors {
    /// `[2 M - 1][2 H - 1][1 + J]`, at the nodes and half way between them: energy that leaves into the half space away from the light, y < 0 in the ply frame.
    /// Lobes turn and blocks change between nodes, and what goes forward with them.
    pub forward: Vec<f64>,
    /// `[2][1 + J]`: fraction of diffuse light that is sent back and that passes, of the light that meets fibers.
    pub diffuse: Vec<f64>,
}

impl LayerFactors {
    pub(crate) fn write(&self, w: &mut Writer, data: &PlyData) {
        let (m, h, _, j) = data.sizes();
        w.f64(NAMES[0], &[2 * m - 1, 2 * h - 1, 1 + j], &self.forward);
        w.f64(NAMES[1], &[2, 1 + j], &self.diffuse);
    }

    pub(crate) fn read(r: &Reader<'_>, (m, h, j): (usize, usize, usize)) -> Result<Option<LayerFactors>> {
        if !NAMES.iter().any(|name| r.has(name)) {
            return Ok(None);
        }
        Ok(Some(LayerFactors {
            forward: r.f64(NAMES[0], &[2 * m - 1, 2 * h - 1, 1 + j])?,
            diffuse: r.f64(NAMES[1], &[2, 1 + j])?,
        }))
    }

    pub(crate) fn check(&self, c: &Check<'_>, data: &PlyData) -> Result<()> {
        let (m, h, _, j) = data.sizes();
        for (name, values, shape) in
            [(NAMES[0], &self.forward, &[2 * m - 1, 2 * h - 1, 1 + j][..]), (NAMES[1], &self.diffuse, &[2, 1 + j])]
        {
            c.len(name, values.len(), shape)?;
            c.range(name, values, 0.0, 1.0 + crate::table::TOLERANCE)?;
        }
        Ok(())
    }
}

/// What evaluation needs of [`LayerFactors`]: f32, averaged over h.
#[derive(Clone, Debug)]
pub(crate) struct LayerTables {
    rows: usize,
    columns: usize,
    theta_last: f32,
    h_last: f32,
    /// Path lengths [um].
    path_um: Vec<f32>,
    /// `[rows][columns][1 + J]`.
    forward: Vec<f32>,
    /// `[rows][2][1 + J]`: r and t at the latitudes.
    first: Vec<f32>,
    /// `[2][1 + J]`.
    diffuse: Vec<f32>,
}

impl LayerTables {
    pub(crate) fn new(d: &PlyData) -> Option<LayerTables> {
        let factors = d.layers.as_ref()?;
        let (m, h, _, j) = d.sizes();
        let (rows, columns) = (2 * m - 1, 2 * h - 1);
        // Between the nodes energies are bilinear: the mean of the two or four nodes around.
        let between = |row: usize, column: usize, of: &dyn Fn(usize) -> f64| {
            let (m0, m1, n0, n1) = (row / 2, row.div_ceil(2), column / 2, column.div_ceil(2));
            0.25 * (of(m0 * h + n0) + of(m0 * h + n1) + of(m1 * h + n0) + of(m1 * h + n1))
        };
        let mut first = Vec::with_capacity(rows * 2 * (1 + j));
        for row in 0..rows {
            // Trapezoids over h; the ends, where a beam meets next to nothing, count half.
            let weight = |n: usize| if n == 0 || n + 1 == columns { 0.5 } else { 1.0 };
            let mean = |of: &dyn Fn(usize) -> f64| (0..columns).map(|n| weight(n) * of(n)).sum::<f64>();
            let met = mean(&|n| between(row, n, &|i| 1.0 - d.r_d[i])).max(f64::MIN_POSITIVE);
            let forward = |p: usize| mean(&|n| factors.forward[(row * columns + n) * (1 + j) + p]) / met;
            let energy = |i: usize, p: usize| if p == 0 { d.energy_refl[i] } else { d.energy_high[i * j + p - 1] };
            let all = |p: usize| mean(&|n| between(row, n, &|i| energy(i, p))) / met;
            first.extend((0..=j).map(|p| (all(p) - forward(p)) as f32));
            first.extend((0..=j).map(|p| forward(p) as f32));
        }
        Some(LayerTables {
            rows,
            columns,
            theta_last: d.theta_i[m - 1] as f32,
            h_last: d.h_um[h - 1] as f32,
            path_um: d.path_um.iter().map(|p| *p as f32).collect(),
            forward: factors.forward.iter().map(|v| *v as f32).collect(),
            first,
            diffuse: factors.diffuse.iter().map(|v| *v as f32).collect(),
        })
    }

    /// `spectrum[0] + sum_j spectrum[j] exp(-sigma path_j)` for each absorption, at least 0.
    fn absorbed<const N: usize>(&self, spectrum: impl Fn(usize) -> f32, sigma: &[f32; N]) -> [f32; N] {
        let mut sum = [spectrum(0); N];
        for (j, path) in self.path_um.iter().enumerate() {
            let p = spectrum(j + 1);
            for (sum, sigma) in sum.iter_mut().zip(sigma) {
                *sum += p * (-sigma.clamp(0.0, 1e6) * path).exp();
            }
        }
        sum.map(|v| v.max(0.0))
    }

    /// Node below `x` and the fraction to the next, of nodes 0 to `last`; 0 for what is not a number.
    fn place(x: f32, count: usize) -> (usize, f32) {
        let x = x.clamp(0.0, (count - 1) as f32);
        let at = (x as usize).min(count - 2);
        (at, if x.is_nan() { 0.0 } else { x - at as f32 })
    }

    fn layer<const N: usize>(&self, theta_i: f32, sigma: &[f32; N]) -> Layer<N> {
        let (m, s) = Self::place(theta_i.abs() / self.theta_last * (self.rows - 1) as f32, self.rows);
        let size = 1 + self.path_um.len();
        let first = |half: usize| {
            let at = |m: usize, p: usize| self.first[(m * 2 + half) * size + p];
            self.absorbed(|p| (1.0 - s) * at(m, p) + s * at(m + 1, p), sigma)
        };
        let diffuse = |half: usize| self.absorbed(|p| self.diffuse[half * size + p], sigma);
        Layer {
            reflected: first(0),
            transmitted: first(1),
            reflected_diffuse: diffuse(0),
            transmitted_diffuse: diffuse(1),
        }
    }

    fn forward<const N: usize>(&self, theta_i: f32, h_um: f32, sigma: &[f32; N]) -> [f32; N] {
        let h = if theta_i < 0.0 { -h_um } else { h_um };
        let (m, s) = Self::place(theta_i.abs() / self.theta_last * (self.rows - 1) as f32, self.rows);
        let (n, t) = Self::place((h / self.h_last + 1.0) * 0.5 * (self.columns - 1) as f32, self.columns);
        let size = 1 + self.path_um.len();
        let at = |m: usize, n: usize, p: usize| self.forward[(m * self.columns + n) * size + p];
        self.absorbed(
            |p| {
                let low = (1.0 - t) * at(m, n, p) + t * at(m, n + 1, p);
                let high = (1.0 - t) * at(m + 1, n, p) + t * at(m + 1, n + 1, p);
                (1.0 - s) * low + s * high
            },
            sigma,
        )
    }
}

/// What one layer of yarns does to the light that meets its fibers, for N absorptions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer<const N: usize> {
    /// Fraction sent back into the half space the light came from, r.
    pub reflected: [f32; N],
    /// Fraction let through, t.
    pub transmitted: [f32; N],
    /// r* of diffuse light.
    pub reflected_diffuse: [f32; N],
    /// t* of diffuse light.
    pub transmitted_diffuse: [f32; N],
}

impl<const N: usize> Layer<N> {
    /// R and T of this layer with `below` beneath it (module text).
    pub fn over(&self, below: &Layer<N>) -> TwoLayers<N> {
        let mut two = TwoLayers { reflected: [0.0; N], transmitted: [0.0; N] };
        for k in 0..N {
            let (r1, r2) = (self.reflected_diffuse[k], below.reflected_diffuse[k]);
            // Two layers that let nothing diffuse through would trap light for good; none are known.
            let through = self.transmitted[k] / (1.0 - r1 * r2).max(1e-6);
            two.transmitted[k] = through * below.transmitted_diffuse[k];
            two.reflected[k] = self.reflected[k] + through * r2 * self.transmitted_diffuse[k];
        }
        two
    }
}

/// What two layers do to the light that meets fibers of the upper one, for N absorptions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoLayers<const N: usize> {
    /// Fraction sent back, R.
    pub reflected: [f32; N],
    /// Fraction let through, T.
    pub transmitted: [f32; N],
}

impl PlyModel {
    /// A layer of this ply's yarns at a latitude [rad]. `None` for a model without layer factors.
    pub fn layer<const N: usize>(&self, theta_i: f32, sigma_per_um: [f32; N]) -> Option<Layer<N>> {
        Some(self.layer_tables()?.layer(theta_i, &sigma_per_um))
    }

    /// Energy that f_refl + f_high sends into the half space away from the light, y < 0. `None` for a model without layer factors.
    pub fn forward_energy<const N: usize>(&self, theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Option<[f32; N]> {
        let tables = self.layer_tables()?;
        if h_um.abs() <= tables.h_last && !theta_i.is_nan() {
            let forward = tables.forward(theta_i, h_um, &sigma_per_um);
            let all = self.albedo(theta_i, h_um, sigma_per_um);
            Some(std::array::from_fn(|k| forward[k].min(all[k])))
        } else {
            Some([0.0; N])
        }
    }
}

/// A ply of the upper of two layers at one incidence (Yu 2025, 5.4 and 7.1): what it sends back keeps its lobes, what it sends on is made diffuse and
/// scaled to T, and what comes back from the lower layer, R - r, is added as diffuse light. The light that passes beside the ply, r_d, meets the lower layer alone
/// and is diffuse after it.
///
/// With E_f the energy the ply sends forward and r_2, t_2 the first-hit factors of the layer below, the diffuse parts are
/// `(E_f T/t + r_d t_2) |y|/pi` below and `(E_f (R - r)/t + r_d r_2) y/pi` above; y is that of the ply frame, toward the light. At sigma = 0 all light is kept.
#[derive(Clone, Copy, Debug)]
pub struct DoubleLayer<'a, const N: usize> {
    upper: WholePly<'a, N>,
    /// Energy of the diffuse light above and below.
    above: [f32; N],
    below: [f32; N],
    albedo: [f32; N],
    /// Chance of a diffuse direction, and of one above among those.
    diffuse: f32,
    up: f32,
    /// Chance that the lobes of the ply alone give a direction.
    hit: f32,
}

impl<'a, const N: usize> DoubleLayer<'a, N> {
    /// The ply `upper` over a layer `below` (of its own or another model, at a latitude that the host finds typical).
    /// `None` for a model without layer factors. Units as in [`PlyModel`].
    pub fn new(upper: WholePly<'a, N>, below: &Layer<N>) -> Option<DoubleLayer<'a, N>> {
        let WholePly { model, theta_i, h_um, sigma_per_um, .. } = upper;
        let layer = model.layer(theta_i, sigma_per_um)?;
        let two = layer.over(below);
        let forward = model.forward_energy(theta_i, h_um, sigma_per_um)?;
        let scattered = model.albedo(theta_i, h_um, sigma_per_um);
        let r_d = model.r_d(theta_i, h_um);
        let share = |part: f32, k: usize| {
            if layer.transmitted[k] > 0.0 { forward[k] * part / layer.transmitted[k] } else { 0.0 }
        };
        let down: [f32; N] = std::array::from_fn(|k| share(two.transmitted[k], k) + r_d * below.transmitted[k]);
        let up: [f32; N] = std::array::from_fn(|k| {
            share(two.reflected[k] - layer.reflected[k], k).max(0.0) + r_d * below.reflected[k]
        });
        let mean = |x: &[f32; N]| x.iter().sum::<f32>() / N.max(1) as f32;
        let back = (mean(&scattered) - mean(&forward)).max(0.0);
        let both = mean(&up) + mean(&down);
        let ratio = |a: f32, b: f32| if b > 0.0 { a / b } else { 0.0 };
        let hit = ratio(mean(&scattered), mean(&scattered) + r_d);
        Some(DoubleLayer {
            upper,
            above: up,
            below: down,
            albedo: std::array::from_fn(|k| scattered[k] - forward[k] + down[k] + up[k]),
            diffuse: if hit > 1e-6 { ratio(both, both + back) } else { 1.0 },
            up: ratio(mean(&up), both),
            hit,
        })
    }

    /// Density of the diffuse directions [1/sr].
    fn diffuse_pdf(&self, y: f32) -> f32 {
        (if y >= 0.0 { self.up } else { 1.0 - self.up }) * y.abs().min(1.0) / PI
    }
}

impl<const N: usize> Scatter<N> for DoubleLayer<'_, N> {
    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        let y = if wo.iter().all(|v| v.is_finite()) { wo[1].clamp(-1.0, 1.0) } else { 0.0 };
        if y > 0.0 {
            let (refl, high) = self.upper.split(wo);
            std::array::from_fn(|k| refl[k] + high[k] + self.above[k] * y / PI)
        } else {
            self.below.map(|e| e * -y / PI)
        }
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        if !wo.iter().all(|v| v.is_finite()) {
            return 0.0;
        }
        let mut pdf = self.diffuse * self.diffuse_pdf(wo[1]);
        if self.diffuse < 1.0 {
            let WholePly { model, theta_i, h_um, sigma_per_um, .. } = self.upper;
            pdf += (1.0 - self.diffuse) / self.hit * model.pdf(theta_i, h_um, sigma_per_um, wo);
        }
        pdf
    }

    /// Lobe directions that go forward count too, with the diffuse value there: the density covers both ways of drawing.
    fn sample(&self, u: [f32; 3]) -> Option<ScatterSample<N>> {
        // Below 1, and 0 for what is not a number.
        let u = u.map(|x| crate::simd::min(crate::simd::max(x, 0.0), 1.0 - f32::EPSILON / 2.0));
        let wo = if u[0] < self.diffuse {
            let side = u[0] / self.diffuse;
            let (radius, turn) = (u[1].sqrt(), 2.0 * PI * u[2]);
            let y = (1.0 - radius * radius).max(0.0).sqrt();
            [radius * turn.cos(), if side < self.up { y } else { -y }, radius * turn.sin()]
        } else {
            let WholePly { model, theta_i, h_um, sigma_per_um, .. } = self.upper;
            let first = (u[0] - self.diffuse) / (1.0 - self.diffuse) * self.hit;
            // The lobes alone: the numbers beyond `hit` are those of the missed light.
            let first = first.min(self.hit * (1.0 - 1e-6));
            model.sample(theta_i, h_um, sigma_per_um, [first, u[1], u[2]])?.wo
        };
        let pdf = self.pdf(wo);
        let f = self.eval(wo);
        Some(ScatterSample { wo, weight: f.map(|f| if pdf > 0.0 { f / pdf } else { 0.0 }), pdf })
    }

    fn albedo(&self) -> [f32; N] {
        self.albedo
    }

    fn miss(&self) -> f32 {
        0.0
    }
}
