//! Mixtures of ASG lobes on a latitude-longitude grid: weighted squared distance to a slice, and its
//! gradient.
//!
//! Along a row of the grid the three dot products of a lobe are `a cos phi + b sin phi + c` with constants
//! per (lobe, row), so the exponential dominates the cost. Values are f32 in lanes of 16, which the compiler
//! vectorizes for the processor; sums over a row and all parameters are f64. Bins outside a lobe's support
//! (the half sphere v.z <= 0, and where the Gaussian factor is below e^-18) are skipped in chunks.
//!
//! Tables hold bin averages, but lobes are compared at bin centers: the variance of a fitted lobe exceeds the
//! true one by that of a bin, (pi / rows)^2 / 12 along theta. With 2 degree bins that is 0.5 % of the width
//! of a lobe of standard deviation 0.1 rad; it is not corrected.

use multiversion::{multiversion, target::target_cfg_f};
use plywave::ply::asg::{Lobe, PARAMS, unit_energy_gradient};
use plywave_tables::table::OutgoingGrid;

/// Number of lanes of the kernels.
const LANES: usize = 16;
/// Exponents below minus this value give zero: e^-18 = 1.5e-8, below an ulp of the f32 peak.
const CUT: f64 = 18.0;

/// Trigonometry and solid angles of an outgoing grid, rows padded to whole chunks of lanes.
#[derive(Clone, Debug)]
pub struct SphereGrid {
    grid: OutgoingGrid,
    padded: usize,
    cos_phi: Vec<f32>,
    sin_phi: Vec<f32>,
    cos_theta: Vec<f64>,
    sin_theta: Vec<f64>,
    solid_angle: Vec<f64>,
    /// Sines of the latitudes between the rows, the poles included.
    edges: Vec<f64>,
}

/// A slice `[theta_o][phi_o]` with rows padded for the kernels of [`SphereGrid`].
#[derive(Clone, Debug, PartialEq)]
pub struct PaddedSlice {
    values: Vec<f32>,
}

/// Buffers of the kernels, reused between calls.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    rows: Vec<RowLobe>,
    axes: Vec<LobeAxes>,
    sums: Vec<[[f32; LANES]; 6]>,
    exps: Vec<f32>,
    model: Vec<f32>,
}

/// A lobe's axes and bandwidths and the derivatives of its normalizer.
#[derive(Clone, Copy, Debug)]
struct LobeAxes {
    frame: [[f64; 3]; 3],
    /// Sine and cosine of theta_z.
    theta_z: (f64, f64),
    phi_z: f64,
    phi_xy: f64,
    /// Smallest z at which the Gaussian factor is not negligible.
    z_min: f64,
    mu1: f64,
    mu2: f64,
    /// 1 / unit energy.
    inverse: f64,
    /// d ln(unit energy) / d ln mu1, 2.
    d_ln: [f64; 2],
    energy: f64,
}

/// A lobe on one row: `u = ux cos phi + uy sin phi + u0`, likewise w and z.
#[derive(Clone, Copy, Debug, Default)]
struct RowLobe {
    u: [f32; 3],
    w: [f32; 3],
    z: [f32; 3],
    mu1: f32,
    mu2: f32,
    /// Amplitude per unit of energy.
    amplitude: f32,
    energy: f32,
    /// Ranges of chunks inside the lobe's support.
    chunks: [(usize, usize); 2],
}

impl SphereGrid {
    /// Computes the tables of `grid`.
    pub fn new(grid: OutgoingGrid) -> Self {
        let padded = grid.phi_o.div_ceil(LANES) * LANES;
        let (mut cos_phi, mut sin_phi) = (vec![0.0; padded], vec![0.0; padded]);
        for j in 0..grid.phi_o {
            let (s, c) = grid.phi(j).sin_cos();
            (cos_phi[j], sin_phi[j]) = (c as f32, s as f32);
        }
        let rows = 0..grid.theta_o;
        SphereGrid {
            grid,
            padded,
            cos_phi,
            sin_phi,
            cos_theta: rows.clone().map(|i| grid.theta(i).cos()).collect(),
            sin_theta: rows.clone().map(|i| grid.theta(i).sin()).collect(),
            edges: (0..=grid.theta_o)
                .map(|k| (std::f64::consts::PI * (k as f64 / grid.theta_o as f64 - 0.5)).sin())
                .collect(),
            solid_angle: rows.map(|i| grid.solid_angle(i)).collect(),
        }
    }

    /// Sines of the latitudes between the rows.
    pub(crate) fn edges(&self) -> &[f64] {
        &self.edges
    }

    /// Length of a row including padding.
    pub(crate) fn padded(&self) -> usize {
        self.padded
    }

    /// Replaces `model` by the derivatives of `integral (model - target)^2 d omega` with respect to its bins,
    /// times `gain`; returns the integral.
    pub(crate) fn residual(&self, model: &mut PaddedSlice, target: &PaddedSlice, gain: f64) -> f64 {
        let rows = model.values.chunks_exact_mut(self.padded).zip(target.values.chunks_exact(self.padded));
        rows.zip(&self.solid_angle)
            .map(|((m, t), weight)| {
                let sum = residual(t, m, self.grid.phi_o, (2.0 * gain * weight) as f32);
                weight * f64::from(sum)
            })
            .sum()
    }

    /// The grid to which these tables belong.
    pub fn grid(&self) -> OutgoingGrid {
        self.grid
    }

    /// `slice[theta_o][phi_o]` times `scale`, padded.
    pub fn pad(&self, slice: &[f32], scale: f64) -> PaddedSlice {
        let mut values = vec![0.0; self.grid.theta_o * self.padded];
        for (row, from) in values.chunks_exact_mut(self.padded).zip(slice.chunks_exact(self.grid.phi_o)) {
            for (to, &v) in row.iter_mut().zip(from) {
                *to = (v as f64 * scale) as f32;
            }
        }
        PaddedSlice { values }
    }

    /// Bins `[theta_o][phi_o]` of a padded slice, without padding.
    pub fn unpad(&self, slice: &PaddedSlice) -> Vec<f32> {
        slice.values.chunks_exact(self.padded).flat_map(|row| row[..self.grid.phi_o].iter().copied()).collect()
    }

    /// `integral a b d omega`.
    pub fn inner(&self, a: &PaddedSlice, b: &PaddedSlice) -> f64 {
        let rows = a.values.chunks_exact(self.padded).zip(b.values.chunks_exact(self.padded));
        rows.zip(&self.solid_angle)
            .map(|((a, b), weight)| weight * a.iter().zip(b).map(|(&a, &b)| a as f64 * b as f64).sum::<f64>())
            .sum()
    }

    /// `integral (a - b)^2 d omega`.
    pub fn distance2(&self, a: &PaddedSlice, b: &PaddedSlice) -> f64 {
        let rows = a.values.chunks_exact(self.padded).zip(b.values.chunks_exact(self.padded));
        rows.zip(&self.solid_angle)
            .map(|((a, b), weight)| weight * a.iter().zip(b).map(|(&a, &b)| (a as f64 - b as f64).powi(2)).sum::<f64>())
            .sum()
    }

    /// Solid angle of a bin of each row [sr].
    pub fn solid_angles(&self) -> &[f64] {
        &self.solid_angle
    }

    /// The mixture `gain * sum of lobes` at the bin centers. `params` contains the lobes one after the other
    /// in the order of [`Lobe`].
    pub fn mixture(&self, params: &[f64], gain: f64, scratch: &mut Scratch) -> PaddedSlice {
        let lobes = params.len() / PARAMS;
        scratch.prepare(params, self.padded, lobes);
        let mut values = vec![0.0; self.grid.theta_o * self.padded];
        for (i, row) in values.chunks_exact_mut(self.padded).enumerate() {
            self.row_lobes(i, gain, scratch);
            forward(&self.cos_phi, &self.sin_phi, &scratch.rows, &mut scratch.exps, row);
            row[self.grid.phi_o..].fill(0.0);
        }
        PaddedSlice { values }
    }

    /// The cost `integral (gain * sum of lobes - target)^2 d omega`; its derivatives with respect to the
    /// parameters of the lobes, at fixed gain, go to `gradient` (same layout as `params`).
    pub fn cost_gradient(
        &self,
        target: &PaddedSlice,
        params: &[f64],
        gain: f64,
        gradient: &mut [f64],
        scratch: &mut Scratch,
    ) -> f64 {
        let lobes = params.len() / PARAMS;
        scratch.prepare(params, self.padded, lobes);
        scratch.sums.clear();
        scratch.sums.resize(lobes, [[0.0; LANES]; 6]);
        let mut cost = 0.0;
        for i in 0..self.grid.theta_o {
            self.row_lobes(i, gain, scratch);
            let row = &target.values[i * self.padded..(i + 1) * self.padded];
            let Scratch { rows, sums, exps, model, .. } = scratch;
            forward(&self.cos_phi, &self.sin_phi, rows, exps, model);
            let weight = self.solid_angle[i];
            cost += weight * residual(row, model, self.grid.phi_o, 2.0 * weight as f32) as f64;
            backward(&self.cos_phi, &self.sin_phi, rows, exps, model, sums);
        }
        for (l, lobe) in scratch.axes.iter().enumerate() {
            let total = scratch.sums[l].map(|lanes| lanes.iter().map(|&v| v as f64).sum::<f64>());
            lobe.chain(&total, &mut gradient[l * PARAMS..(l + 1) * PARAMS]);
        }
        cost
    }

    fn row_lobes(&self, i: usize, gain: f64, scratch: &mut Scratch) {
        let (ct, st) = (self.cos_theta[i], self.sin_theta[i]);
        let chunks = self.padded / LANES;
        for (row, lobe) in scratch.rows.iter_mut().zip(&scratch.axes) {
            let axis = |k: usize| {
                [(ct * lobe.frame[k][0]) as f32, (ct * lobe.frame[k][1]) as f32, (st * lobe.frame[k][2]) as f32]
            };
            *row = RowLobe {
                u: axis(0),
                w: axis(1),
                z: axis(2),
                mu1: lobe.mu1 as f32,
                mu2: lobe.mu2 as f32,
                amplitude: (gain * lobe.inverse) as f32,
                energy: lobe.energy as f32,
                chunks: self.support(lobe, ct, st, chunks),
            };
        }
    }

    /// Chunks of a row where z > z_min, with z_min^2 = 1 - CUT / min(mu) and `z = a cos(phi - phi_z) + b`.
    fn support(&self, lobe: &LobeAxes, ct: f64, st: f64, chunks: usize) -> [(usize, usize); 2] {
        let ((sz, cz), z_min) = (lobe.theta_z, lobe.z_min);
        let (a, b) = (ct * cz, st * sz);
        if a.abs() + b <= z_min {
            return [(0, 0); 2];
        }
        if b - a.abs() > z_min || a.abs() < 1e-12 {
            return [(0, chunks), (0, 0)];
        }
        let center = if a > 0.0 { lobe.phi_z } else { lobe.phi_z + std::f64::consts::PI };
        let half = ((z_min - b) / a.abs()).clamp(-1.0, 1.0).acos();
        let columns = self.grid.phi_o as f64;
        let per_radian = columns / std::f64::consts::TAU;
        let width = 2.0 * half * per_radian + 2.0;
        if width >= columns - LANES as f64 {
            return [(0, chunks), (0, 0)];
        }
        let start = ((center - half) * per_radian - 1.5).rem_euclid(columns);
        let end = start + width + 1.0;
        let first = start as usize / LANES;
        if end <= columns {
            return [(first, (end.ceil() as usize).div_ceil(LANES).min(chunks)), (0, 0)];
        }
        let wrapped = ((end - columns).ceil() as usize).div_ceil(LANES);
        if wrapped >= first { [(0, chunks), (0, 0)] } else { [(first, chunks), (0, wrapped)] }
    }
}

impl PaddedSlice {
    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    pub(crate) fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    pub(crate) fn scale(&mut self, by: f32) {
        self.values.iter_mut().for_each(|v| *v *= by);
    }

    /// Adds `scale * other`.
    pub fn add(&mut self, other: &PaddedSlice, scale: f64) {
        for (a, &b) in self.values.iter_mut().zip(&other.values) {
            *a += (scale * b as f64) as f32;
        }
    }
}

impl Scratch {
    fn prepare(&mut self, params: &[f64], padded: usize, lobes: usize) {
        self.axes.clear();
        self.axes.extend(params.chunks_exact(PARAMS).map(LobeAxes::new));
        self.rows.resize(lobes, RowLobe::default());
        self.exps.resize(lobes * padded, 0.0);
        self.model.resize(padded, 0.0);
    }
}

impl LobeAxes {
    fn new(params: &[f64]) -> Self {
        let lobe = Lobe::from_params(params);
        let (mu1, mu2) = (lobe.ln_mu1.exp(), lobe.ln_mu2.exp());
        let (unit, d1, d2) = unit_energy_gradient(mu1, mu2);
        LobeAxes {
            frame: lobe.frame(),
            theta_z: lobe.theta_z.sin_cos(),
            z_min: (1.0 - CUT / mu1.min(mu2)).max(0.0).sqrt(),
            phi_z: lobe.phi_z,
            phi_xy: lobe.phi_xy,
            mu1,
            mu2,
            inverse: 1.0 / unit,
            d_ln: [d1, d2],
            energy: lobe.energy,
        }
    }

    /// Computes derivatives with respect to the parameters from the sums over the sphere of `g e z` times 1,
    /// u^2, w^2, u w, and of `g e u (1 + 2 mu1 z^2)`, `g e w (1 + 2 mu2 z^2)`, where e is the amplitude of a
    /// unit of energy times the Gaussian factor, and g the derivative of the cost with respect to the model.
    /// The last three sums are the lobe's response to rotations of its frame about its own axes.
    fn chain(&self, s: &[f64; 6], gradient: &mut [f64]) {
        let turn_z = self.energy * 2.0 * (self.mu2 - self.mu1) * s[3];
        let (toward_x, toward_y) = (self.energy * s[4], self.energy * s[5]);
        let (sx, cx) = self.phi_xy.sin_cos();
        let (st, ct) = self.theta_z;
        gradient[0] = sx * toward_x + cx * toward_y;
        gradient[1] = ct * (cx * toward_x - sx * toward_y) + st * turn_z;
        gradient[2] = turn_z;
        gradient[3] = -self.energy * (self.mu1 * s[1] + self.d_ln[0] * s[0]);
        gradient[4] = -self.energy * (self.mu2 * s[2] + self.d_ln[1] * s[0]);
        gradient[5] = s[0];
    }
}

/// `a * b + c`, fused if the processor has a fused multiply-add.
#[inline(always)]
fn fma<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// e^-q for q >= 0, relative error below 3e-7; q above 80 counts as 80.
#[inline(always)]
fn exp_neg<const FMA: bool>(q: f32) -> f32 {
    const MAGIC: f32 = 12_582_912.0; // 1.5 * 2^23: adding it rounds to an integer in the low bits.
    let x = q.min(80.0) * -std::f32::consts::LOG2_E;
    let t = x + MAGIC;
    let f = x - (t - MAGIC);
    // 2^f on [-1/2, 1/2], minimax.
    let mut p = 1.535_336_2e-4;
    p = fma::<FMA>(p, f, 1.339_887_4e-3);
    p = fma::<FMA>(p, f, 9.618_437e-3);
    p = fma::<FMA>(p, f, 5.550_332_5e-2);
    p = fma::<FMA>(p, f, 2.402_264_8e-1);
    p = fma::<FMA>(p, f, 6.931_472e-1);
    p = fma::<FMA>(p, f, 1.0);
    f32::from_bits(p.to_bits().wrapping_add(t.to_bits() << 23))
}

#[inline(always)]
fn forward_kernel<const FMA: bool>(cos: &[f32], sin: &[f32], rows: &[RowLobe], exps: &mut [f32], model: &mut [f32]) {
    model.fill(0.0);
    let (cos, sin) = (cos.as_chunks::<LANES>().0, sin.as_chunks::<LANES>().0);
    let model = model.as_chunks_mut::<LANES>().0;
    for (lobe, exps) in rows.iter().zip(exps.as_chunks_mut::<LANES>().0.chunks_exact_mut(cos.len())) {
        let lobe = *lobe;
        for (first, end) in lobe.chunks {
            let chunks = cos[first..end].iter().zip(&sin[first..end]).zip(&mut exps[first..end]);
            for (((cos, sin), exps), model) in chunks.zip(&mut model[first..end]) {
                for i in 0..LANES {
                    let z = fma::<FMA>(lobe.z[0], cos[i], fma::<FMA>(lobe.z[1], sin[i], lobe.z[2]));
                    let u = fma::<FMA>(lobe.u[0], cos[i], fma::<FMA>(lobe.u[1], sin[i], lobe.u[2]));
                    let w = fma::<FMA>(lobe.w[0], cos[i], fma::<FMA>(lobe.w[1], sin[i], lobe.w[2]));
                    let q = fma::<FMA>(lobe.mu1 * u, u, lobe.mu2 * w * w);
                    let e = lobe.amplitude * exp_neg::<FMA>(q);
                    let e = if z > 0.0 { e } else { 0.0 };
                    exps[i] = e;
                    model[i] = fma::<FMA>(lobe.energy * e, z, model[i]);
                }
            }
        }
    }
}

#[inline(always)]
fn backward_kernel<const FMA: bool>(
    cos: &[f32],
    sin: &[f32],
    rows: &[RowLobe],
    exps: &[f32],
    g: &[f32],
    sums: &mut [[[f32; LANES]; 6]],
) {
    let (cos, sin) = (cos.as_chunks::<LANES>().0, sin.as_chunks::<LANES>().0);
    let g = g.as_chunks::<LANES>().0;
    for ((lobe, exps), sums) in rows.iter().zip(exps.as_chunks::<LANES>().0.chunks_exact(cos.len())).zip(sums) {
        let lobe = *lobe;
        let (two_mu1, two_mu2) = (2.0 * lobe.mu1, 2.0 * lobe.mu2);
        let mut s = *sums;
        for (first, end) in lobe.chunks {
            let chunks = cos[first..end].iter().zip(&sin[first..end]).zip(&exps[first..end]);
            for (((cos, sin), exps), g) in chunks.zip(&g[first..end]) {
                for i in 0..LANES {
                    let z = fma::<FMA>(lobe.z[0], cos[i], fma::<FMA>(lobe.z[1], sin[i], lobe.z[2]));
                    let u = fma::<FMA>(lobe.u[0], cos[i], fma::<FMA>(lobe.u[1], sin[i], lobe.u[2]));
                    let w = fma::<FMA>(lobe.w[0], cos[i], fma::<FMA>(lobe.w[1], sin[i], lobe.w[2]));
                    let ge = g[i] * exps[i];
                    let f = ge * z;
                    let (fu, fw) = (f * u, f * w);
                    s[0][i] += f;
                    s[1][i] = fma::<FMA>(fu, u, s[1][i]);
                    s[2][i] = fma::<FMA>(fw, w, s[2][i]);
                    s[3][i] = fma::<FMA>(fu, w, s[3][i]);
                    s[4][i] = fma::<FMA>(ge * u, fma::<FMA>(two_mu1 * z, z, 1.0), s[4][i]);
                    s[5][i] = fma::<FMA>(ge * w, fma::<FMA>(two_mu2 * z, z, 1.0), s[5][i]);
                }
            }
        }
        *sums = s;
    }
}

/// Replaces `model` by `twice_weight * (model - target)` and returns the sum of squared differences of the
/// row.
#[multiversion(targets("x86_64+avx2+fma"))]
fn residual(target: &[f32], model: &mut [f32], columns: usize, twice_weight: f32) -> f32 {
    model[columns..].fill(0.0);
    let mut sum = [0.0f32; LANES];
    for (m, t) in model.chunks_exact_mut(LANES).zip(target.chunks_exact(LANES)) {
        for i in 0..LANES {
            let r = m[i] - t[i];
            sum[i] += r * r;
            m[i] = twice_weight * r;
        }
    }
    sum.iter().sum()
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn forward(cos: &[f32], sin: &[f32], rows: &[RowLobe], exps: &mut [f32], model: &mut [f32]) {
    if target_cfg_f!(target_feature = "fma") {
        forward_kernel::<true>(cos, sin, rows, exps, model)
    } else {
        forward_kernel::<false>(cos, sin, rows, exps, model)
    }
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn backward(cos: &[f32], sin: &[f32], rows: &[RowLobe], exps: &[f32], g: &[f32], sums: &mut [[[f32; LANES]; 6]]) {
    if target_cfg_f!(target_feature = "fma") {
        backward_kernel::<true>(cos, sin, rows, exps, g, sums)
    } else {
        backward_kernel::<false>(cos, sin, rows, exps, g, sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lobes() -> Vec<f64> {
        let a = Lobe { theta_z: 0.3, phi_z: 4.6, phi_xy: 0.4, ln_mu1: 3.0, ln_mu2: 1.2, energy: 0.4 };
        let b = Lobe { theta_z: -0.5, phi_z: 0.1, phi_xy: 1.1, ln_mu1: 0.5, ln_mu2: 4.5, energy: 0.3 };
        let c = Lobe { theta_z: 1.4, phi_z: 6.2, phi_xy: -0.7, ln_mu1: -1.0, ln_mu2: 0.1, energy: 0.2 };
        let d = Lobe { theta_z: -1.2, phi_z: -1.0, phi_xy: 2.0, ln_mu1: 7.0, ln_mu2: 6.0, energy: 0.1 };
        [a, b, c, d].iter().flat_map(|l| l.to_params()).collect()
    }

    fn grid() -> SphereGrid {
        SphereGrid::new(OutgoingGrid { theta_o: 45, phi_o: 90 })
    }

    #[test]
    fn mixture_is_the_sum_of_lobe_eval() {
        let sphere = grid();
        let params = lobes();
        let got = sphere.unpad(&sphere.mixture(&params, 0.8, &mut Scratch::default()));
        let g = sphere.grid();
        let mut peak = 0.0f64;
        for i in 0..g.theta_o {
            for j in 0..g.phi_o {
                let (theta, phi) = (g.theta(i), g.phi(j));
                let v = [theta.cos() * phi.cos(), theta.cos() * phi.sin(), theta.sin()];
                let want: f64 = params.chunks_exact(PARAMS).map(|p| 0.8 * Lobe::from_params(p).eval(v)).sum();
                peak = peak.max(want);
                let got = got[i * g.phi_o + j] as f64;
                assert!((got - want).abs() < 2e-5 * peak.max(0.1), "bin {i} {j}: got {got}, want {want}");
            }
        }
    }

    #[test]
    fn gradient_matches_differences() {
        let sphere = grid();
        let mut scratch = Scratch::default();
        let params = lobes();
        let mut other = params.clone();
        for (i, p) in other.iter_mut().enumerate() {
            *p += 0.2 * ((i * 7 % 5) as f64 / 5.0 - 0.4);
        }
        let target = sphere.mixture(&other, 1.0, &mut scratch);
        let mut gradient = vec![0.0; params.len()];
        sphere.cost_gradient(&target, &params, 0.9, &mut gradient, &mut scratch);
        let scale = gradient.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        let cost = |p: &[f64]| {
            let mut scratch = Scratch::default();
            sphere.distance2(&sphere.mixture(p, 0.9, &mut scratch), &target)
        };
        for i in 0..params.len() {
            let step = 1e-3;
            let moved = |by: f64| {
                let mut p = params.clone();
                p[i] += by;
                cost(&p)
            };
            // The difference is of fourth order, because the narrowest lobe is only twenty steps wide.
            let want = (8.0 * (moved(step) - moved(-step)) - (moved(2.0 * step) - moved(-2.0 * step))) / (12.0 * step);
            assert!((gradient[i] - want).abs() < 2e-4 * scale, "param {i}: got {}, want {want}", gradient[i]);
        }
    }

    #[test]
    fn exponential_is_accurate() {
        for i in 0..8000 {
            let q = i as f32 * 0.01;
            for got in [exp_neg::<true>(q), exp_neg::<false>(q)] {
                let want = (-(q as f64)).exp();
                assert!((got as f64 / want - 1.0).abs() < 5e-6, "q {q}: got {got}, want {want}");
            }
        }
    }
}
