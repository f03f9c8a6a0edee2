//! The arithmetic of the runtime: lobes of a model at one incidence, 16 to a vector, and their sums.
//!
//! High-order lobes fill the first lanes, reflection lobes those after them; lanes without a lobe have energy 0.

use super::layout::{HEAD, Layout};
use super::reference::LEAST_TRANSMITTANCE;
use crate::simd::{exp, fma, max, min, sin_cos, sum8, sum16};
use std::f32::consts::PI;

/// Lanes of a vector.
pub(super) const LANES: usize = 16;
/// Vectors of the large form: up to 32 lobes of each kind.
pub(super) const GROUPS: usize = 4;

type V<const G: usize> = [[f32; LANES]; G];

/// The lobes at one incidence, with their energies at N absorptions.
pub(super) struct Mixture<const G: usize, const N: usize> {
    sin_theta: V<G>,
    cos_theta: V<G>,
    sin_phi: V<G>,
    cos_phi: V<G>,
    sin_xy: V<G>,
    cos_xy: V<G>,
    mu1: V<G>,
    mu2: V<G>,
    /// sqrt(mu1 mu2) / pi.
    norm: V<G>,
    /// 1 / energy of the lobe with amplitude 1.
    inv_unit: V<G>,
    energy: [V<G>; N],
    /// Mean of `energy` over N.
    mean: V<G>,
    /// Whether theta_i < 0: directions are mirrored on the way in and out.
    flip: bool,
    /// Lanes below this one are high-order.
    first_refl: usize,
    r_d: f32,
    energy_refl: f32,
    energy_high: [f32; N],
}

/// Interpolation at one incidence: cell, fractions.
#[derive(Clone, Copy)]
struct Place {
    m: usize,
    n: usize,
    fm: f32,
    fn_: f32,
    flip: bool,
}

#[inline(always)]
fn place(layout: &Layout, theta_i: f32, h_um: f32) -> Option<Place> {
    // A comparison with what is not a number is false: those miss, too.
    if !(h_um.abs() <= layout.h_last) || theta_i.is_nan() {
        return None;
    }
    let flip = theta_i < 0.0;
    let h = if flip { -h_um } else { h_um };
    let t = min(theta_i.abs() * layout.per_theta, (layout.nodes_theta - 1) as f32);
    let x = min(max((h + layout.h_last) * layout.per_h, 0.0), (layout.nodes_h - 1) as f32);
    let m = (t as usize).min(layout.nodes_theta - 2);
    let n = (x as usize).min(layout.nodes_h - 2);
    Some(Place { m, n, fm: t - m as f32, fn_: x - n as f32, flip })
}

/// Catmull-Rom weights of nodes -1..=2 of the cell at fraction `f`.
#[inline(always)]
fn catmull_rom(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [0.5 * (-f3 + 2.0 * f2 - f), 0.5 * (3.0 * f3 - 5.0 * f2 + 2.0), 0.5 * (-3.0 * f3 + 4.0 * f2 + f), 0.5 * (f3 - f2)]
}

/// Bilinear weights, theta the slower index.
#[inline(always)]
fn bilinear(fm: f32, fn_: f32) -> [f32; 4] {
    [(1.0 - fm) * (1.0 - fn_), (1.0 - fm) * fn_, fm * (1.0 - fn_), fm * fn_]
}

/// r_d, energy of f_refl and of f_high per sigma.
#[derive(Clone, Copy)]
pub(super) struct Energies<const N: usize> {
    pub(super) r_d: f32,
    pub(super) refl: f32,
    pub(super) high: [f32; N],
}

impl<const N: usize> Energies<N> {
    /// What a beam beyond the nodes meets: nothing.
    pub(super) const MISS: Self = Energies { r_d: 1.0, refl: 0.0, high: [0.0; N] };
}

/// Absorption as the model understands it: not a number counts as 0, range 0 to 1e6 per um.
#[inline(always)]
fn clean<const N: usize>(sigma: [f32; N]) -> [f32; N] {
    sigma.map(|s| min(max(s, 0.0), 1e6))
}

/// Transmittance of 8 path lengths at N absorptions.
#[inline(always)]
fn transmittance<const FMA: bool, const N: usize>(sigma: &[f32; N], path: &[f32; 8]) -> [[f32; 8]; N] {
    let mut t = [[0.0; 8]; N];
    for k in 0..N {
        for j in 0..8 {
            t[k][j] = exp::<FMA>(-sigma[k] * path[j]);
        }
    }
    t
}

/// The energies of 8 path lengths, interpolated, times their transmittances.
#[inline(always)]
fn add_energy_high<const FMA: bool, const N: usize>(
    layout: &Layout,
    at: [usize; 4],
    weights: [f32; 4],
    chunk: usize,
    t: &[[f32; 8]; N],
    energy: &mut [f32; N],
) {
    let mut spectrum = [0.0; 8];
    for c in 0..4 {
        let node = octet(&layout.nodes, at[c] + HEAD + 8 * chunk);
        for j in 0..8 {
            spectrum[j] = fma::<FMA>(weights[c], node[j], spectrum[j]);
        }
    }
    for k in 0..N {
        let mut product = [0.0; 8];
        for j in 0..8 {
            product[j] = spectrum[j] * t[k][j];
        }
        energy[k] += sum8(product);
    }
}

/// Offsets of the four nodes of a cell.
#[inline(always)]
fn node_offsets(layout: &Layout, p: Place) -> [usize; 4] {
    let stride = HEAD + 8 * layout.path_chunks;
    let at = (p.m * layout.nodes_h + p.n) * stride;
    [at, at + stride, at + layout.nodes_h * stride, at + (layout.nodes_h + 1) * stride]
}

#[inline(always)]
fn head<const FMA: bool>(layout: &Layout, at: [usize; 4], weights: [f32; 4]) -> (f32, f32) {
    let (mut r_d, mut refl) = (0.0, 0.0);
    for c in 0..4 {
        r_d = fma::<FMA>(weights[c], layout.nodes[at[c]], r_d);
        refl = fma::<FMA>(weights[c], layout.nodes[at[c] + 1], refl);
    }
    (r_d, refl)
}

/// Exact energies at an incidence: what `albedo` and `r_d` report and what the lobes are scaled to.
#[inline(always)]
pub(super) fn energies<const FMA: bool, const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: [f32; N],
) -> Energies<N> {
    let Some(p) = place(layout, theta_i, h_um) else { return Energies::MISS };
    let (at, weights) = (node_offsets(layout, p), bilinear(p.fm, p.fn_));
    let (r_d, refl) = head::<FMA>(layout, at, weights);
    let sigma = clean(sigma);
    let mut high = [0.0; N];
    for chunk in 0..layout.path_chunks {
        let t = transmittance::<FMA, N>(&sigma, octet(&layout.path, 8 * chunk));
        add_energy_high::<FMA, N>(layout, at, weights, chunk, &t, &mut high);
    }
    Energies { r_d, refl, high }
}

/// Eight floats at `at`. The layout is made so that they are there.
#[inline(always)]
fn octet(values: &[f32], at: usize) -> &[f32; 8] {
    const NONE: [f32; 8] = [0.0; 8];
    values.get(at..).and_then(|v| v.first_chunk()).unwrap_or(&NONE)
}

/// `sum += weight * values`, 8 lanes.
#[inline(always)]
fn add8<const FMA: bool>(sum: &mut [f32], weight: f32, values: &[f32; 8]) {
    if let Some(sum) = sum.first_chunk_mut::<8>() {
        for i in 0..8 {
            sum[i] = fma::<FMA>(weight, values[i], sum[i]);
        }
    }
}

/// Interpolates the lobes; `None` where the beam misses.
#[inline(always)]
pub(super) fn mixture<const FMA: bool, const G: usize, const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: [f32; N],
) -> Option<Mixture<G, N>> {
    let p = place(layout, theta_i, h_um)?;
    let sigma = clean(sigma);
    // The common form has one chunk of 8 lanes for each kind; its loops then have constant lengths.
    let (high_chunks, refl_chunks) = if G == 1 { (1, 1) } else { (layout.high_chunks, layout.refl_chunks) };
    let (high_lanes, refl_lanes) = (8 * high_chunks, 8 * refl_chunks);
    let mut params = [[[0.0f32; LANES]; G]; 6];

    let (wm, wn) = (catmull_rom(p.fm), catmull_rom(p.fn_));
    for a in 0..4 {
        let row = ((p.m + a) * (layout.nodes_h + 2) + p.n) * 6 * refl_lanes;
        for b in 0..4 {
            let weight = wm[a] * wn[b];
            for k in 0..6 {
                for c in 0..refl_chunks {
                    let values = octet(&layout.refl, row + (b * 6 + k) * refl_lanes + 8 * c);
                    add8::<FMA>(&mut params[k].as_flattened_mut()[high_lanes + 8 * c..], weight, values);
                }
            }
        }
    }

    let block = (p.m / 2) * (layout.nodes_h / 2) + p.n / 2;
    let (gm, gn) = (0.5 * ((p.m % 2) as f32 + p.fm), 0.5 * ((p.n % 2) as f32 + p.fn_));
    let weights = bilinear(gm, gn);
    let corner = (6 + 8 * layout.path_chunks) * high_lanes;
    for c in 0..4 {
        for k in 0..6 {
            for i in 0..high_chunks {
                let values = octet(&layout.high, (block * 4 + c) * corner + k * high_lanes + 8 * i);
                add8::<FMA>(&mut params[k].as_flattened_mut()[8 * i..], weights[c], values);
            }
        }
    }

    let (at, node_weights) = (node_offsets(layout, p), bilinear(p.fm, p.fn_));
    let (r_d, energy_refl) = head::<FMA>(layout, at, node_weights);
    let mut energy_high = [0.0; N];
    let mut energy = [[[0.0; LANES]; G]; N];
    for chunk in 0..layout.path_chunks {
        let t = transmittance::<FMA, N>(&sigma, octet(&layout.path, 8 * chunk));
        add_energy_high::<FMA, N>(layout, at, node_weights, chunk, &t, &mut energy_high);
        for i in 0..high_chunks {
            for j in 0..8 {
                let mut spectrum = [0.0; 8];
                for c in 0..4 {
                    let from = (block * 4 + c) * corner + (6 + 8 * chunk + j) * high_lanes + 8 * i;
                    add8::<FMA>(&mut spectrum, weights[c], octet(&layout.high, from));
                }
                for k in 0..N {
                    add8::<FMA>(&mut energy[k].as_flattened_mut()[8 * i..], t[k][j], &spectrum);
                }
            }
        }
    }
    scale_energies::<G, N>(layout, &params[5], high_lanes, energy_refl, &energy_high, &mut energy);

    let mut mixture = lobes::<FMA, G, N>(&params);
    mixture.energy = energy;
    mixture.flip = p.flip;
    mixture.first_refl = high_lanes;
    (mixture.r_d, mixture.energy_refl, mixture.energy_high) = (r_d, energy_refl, energy_high);
    let share = 1.0 / N.max(1) as f32;
    for g in 0..G {
        for k in 0..N {
            for i in 0..LANES {
                mixture.mean[g][i] += share * mixture.energy[k][g][i];
            }
        }
    }
    Some(mixture)
}

/// Lobe energies times transmittances, scaled so that each kind adds up to its simulated energy. `energy` enters as the
/// transmittance of each high-order lane.
#[inline(always)]
fn scale_energies<const G: usize, const N: usize>(
    layout: &Layout,
    weight: &V<G>,
    high_lanes: usize,
    energy_refl: f32,
    energy_high: &[f32; N],
    energy: &mut [V<G>; N],
) {
    let mut least = [[0.0; LANES]; G];
    for g in 0..G {
        for i in 0..LANES {
            least[g][i] = max(weight[g][i], layout.least[g][i]);
        }
    }
    let (mut refl, mut high) = ([[0.0; LANES]; G], [[0.0; LANES]; G]);
    for g in 0..G {
        for i in 0..LANES {
            let is_high = LANES * g + i < high_lanes;
            high[g][i] = if is_high { least[g][i] } else { 0.0 };
            refl[g][i] = if is_high { 0.0 } else { least[g][i] };
        }
    }
    let total = |v: &V<G>| v.iter().map(sum16).fold(0.0, |a, b| a + b);
    let scale_refl = energy_refl / total(&refl);
    for k in 0..N {
        let mut product = [[0.0; LANES]; G];
        for g in 0..G {
            for i in 0..LANES {
                product[g][i] = high[g][i] * (energy[k][g][i] + LEAST_TRANSMITTANCE as f32);
            }
        }
        let scale = energy_high[k] / total(&product);
        for g in 0..G {
            for i in 0..LANES {
                energy[k][g][i] = product[g][i] * scale + refl[g][i] * scale_refl;
            }
        }
    }
}

/// Midpoint nodes of the energy integral, as in [`crate::asg::unit_energy`]: sin^2 s of the first half of them; the second half
/// mirrors it.
const NODES_SIN2: [f32; 6] = [0.004_277_569, 0.038_060_234, 0.103_323_49, 0.195_619_29, 0.308_658_28, 0.434_736_9];

/// Directions, bandwidths and energy integrals of all lanes.
#[inline(always)]
fn lobes<const FMA: bool, const G: usize, const N: usize>(params: &[V<G>; 6]) -> Mixture<G, N> {
    let zero = [[0.0; LANES]; G];
    let mut x = Mixture {
        sin_theta: zero,
        cos_theta: zero,
        sin_phi: zero,
        cos_phi: zero,
        sin_xy: zero,
        cos_xy: zero,
        mu1: zero,
        mu2: zero,
        norm: zero,
        inv_unit: zero,
        energy: [zero; N],
        mean: zero,
        flip: false,
        first_refl: 0,
        r_d: 0.0,
        energy_refl: 0.0,
        energy_high: [0.0; N],
    };
    // ln of asg::MU_MIN and asg::MU_MAX.
    let (low, high) = (-1.609_438, 9.903_487_6);
    for g in 0..G {
        for i in 0..LANES {
            (x.sin_theta[g][i], x.cos_theta[g][i]) = sin_cos::<FMA>(params[0][g][i]);
            (x.sin_phi[g][i], x.cos_phi[g][i]) = sin_cos::<FMA>(params[1][g][i]);
            (x.sin_xy[g][i], x.cos_xy[g][i]) = sin_cos::<FMA>(params[2][g][i]);
        }
        for i in 0..LANES {
            let mu1 = exp::<FMA>(min(max(params[3][g][i], low), high));
            let mu2 = exp::<FMA>(min(max(params[4][g][i], low), high));
            let product = mu1 * mu2;
            let mut sum = 0.0;
            for s2 in NODES_SIN2 {
                // 1/b = mu1 mu2 / (cos^2 s mu2 + sin^2 s mu1), for s and for pi/2 - s by one division.
                let d1 = fma::<FMA>(s2, mu1, (1.0 - s2) * mu2);
                let d2 = fma::<FMA>(s2, mu2, (1.0 - s2) * mu1);
                let both = -product / (d1 * d2);
                sum += exp::<FMA>(both * d2) + exp::<FMA>(both * d1);
            }
            let norm = product.sqrt() * (1.0 / PI);
            x.mu1[g][i] = mu1;
            x.mu2[g][i] = mu2;
            x.norm[g][i] = norm;
            x.inv_unit[g][i] = norm / (1.0 - sum * (1.0 / 12.0));
        }
    }
    x
}

#[inline(always)]
fn mirrored(flip: bool, w: [f32; 3]) -> [f32; 3] {
    if flip { crate::mirror_incidence(w) } else { w }
}

impl<const G: usize, const N: usize> Mixture<G, N> {
    /// Per lane: the lobe with energy 1 in direction `wo`, and the density of sampling it [1/sr].
    #[inline(always)]
    fn values<const FMA: bool>(&self, wo: [f32; 3]) -> (V<G>, V<G>) {
        let v = mirrored(self.flip, wo);
        let (mut value, mut density) = ([[0.0; LANES]; G], [[0.0; LANES]; G]);
        for g in 0..G {
            for i in 0..LANES {
                let across = fma::<FMA>(self.cos_phi[g][i], v[1], -self.sin_phi[g][i] * v[0]);
                let along = fma::<FMA>(self.cos_phi[g][i], v[0], self.sin_phi[g][i] * v[1]);
                let up = fma::<FMA>(self.cos_theta[g][i], v[2], -self.sin_theta[g][i] * along);
                let cz = fma::<FMA>(self.cos_theta[g][i], along, self.sin_theta[g][i] * v[2]);
                let u = fma::<FMA>(self.cos_xy[g][i], across, self.sin_xy[g][i] * up);
                let w = fma::<FMA>(self.cos_xy[g][i], up, -self.sin_xy[g][i] * across);
                let (u2, w2) = (u * u, w * w);
                let q = fma::<FMA>(self.mu1[g][i], u2, self.mu2[g][i] * w2);
                // Only finite directions in front of the lobe count; the comparisons are false for what is not a number.
                let front = if cz > 0.0 && cz < 2.0 { cz } else { 0.0 };
                let shape = front * exp::<FMA>(-q);
                // a(t) of the direction t of (u, w); at the axis, where t is undefined, any mean of mu1 and mu2 serves.
                let a = (q + 1e-30) / (u2 + w2 + 1e-30);
                value[g][i] = shape * self.inv_unit[g][i];
                density[g][i] = shape * self.norm[g][i] / (1.0 - exp::<FMA>(-a));
            }
        }
        (value, density)
    }

    /// f_refl + f_high per sigma [1/sr].
    #[inline(always)]
    pub(super) fn eval<const FMA: bool>(&self, wo: [f32; 3]) -> [f32; N] {
        self.weigh(&self.values::<FMA>(wo).0)
    }

    #[inline(always)]
    fn weigh(&self, value: &V<G>) -> [f32; N] {
        let mut f = [0.0; N];
        for k in 0..N {
            for g in 0..G {
                let mut product = [0.0; LANES];
                for i in 0..LANES {
                    product[i] = self.energy[k][g][i] * value[g][i];
                }
                f[k] += sum16(&product);
            }
        }
        f
    }

    /// f_refl and f_high per sigma [1/sr].
    #[inline(always)]
    pub(super) fn eval_split<const FMA: bool>(&self, wo: [f32; 3]) -> ([f32; N], [f32; N]) {
        let mut value = self.values::<FMA>(wo).0;
        let mut high = value;
        for g in 0..G {
            for i in 0..LANES {
                if LANES * g + i < self.first_refl {
                    value[g][i] = 0.0;
                } else {
                    high[g][i] = 0.0;
                }
            }
        }
        (self.weigh(&value), self.weigh(&high))
    }

    /// Mean scattered energy plus the missed: what a sample is chosen from.
    #[inline(always)]
    fn total(&self) -> f32 {
        let high: f32 = self.energy_high.iter().sum();
        self.energy_refl + high / N.max(1) as f32 + self.r_d
    }

    #[inline(always)]
    fn density(&self, density: &V<G>) -> f32 {
        let total = self.total();
        let mut sum = 0.0;
        for g in 0..G {
            let mut product = [0.0; LANES];
            for i in 0..LANES {
                product[i] = self.mean[g][i] * density[g][i];
            }
            sum += sum16(&product);
        }
        if total > 0.0 { sum / total } else { 0.0 }
    }

    /// Density of sampling `wo` [1/sr], missing included.
    #[inline(always)]
    pub(super) fn pdf<const FMA: bool>(&self, wo: [f32; 3]) -> f32 {
        self.density(&self.values::<FMA>(wo).1)
    }

    /// A direction, f and pdf there; `None` for the light that missed.
    #[inline(always)]
    pub(super) fn sample<const FMA: bool>(&self, u: [f32; 3]) -> Option<([f32; 3], [f32; N], f32)> {
        // Below 1, and 0 for what is not a number.
        let u = u.map(|x| min(max(x, 0.0), 1.0 - f32::EPSILON / 2.0));
        let scattered = self.total() - self.r_d;
        let mut left = u[0] * self.total();
        if !(left < scattered) {
            return None;
        }
        let mut chosen = None;
        for (i, energy) in self.mean.as_flattened().iter().enumerate() {
            if *energy > 0.0 {
                chosen = Some(i);
                if left < *energy {
                    break;
                }
                left -= energy;
            }
        }
        let i = chosen?;
        let at = |v: &V<G>| v.as_flattened()[i];
        // tan t = sqrt(mu1/mu2) tan(2 pi u1), in the same quadrant.
        let (mu1, mu2) = (at(&self.mu1), at(&self.mu2));
        let (s, c) = sin_cos::<FMA>(2.0 * PI * u[1]);
        let (c, s) = (mu2.sqrt() * c, mu1.sqrt() * s);
        let n2 = 1.0 / (c * c + s * s);
        let a = (mu1 * c * c + mu2 * s * s) * n2;
        let r2 = min(-(-u[2] * (1.0 - exp::<FMA>(-a))).ln_1p() / a, 1.0 - f32::EPSILON);
        let r = (r2 * n2).sqrt();
        let (u_, w_, cz) = (r * c, r * s, (1.0 - r2).sqrt());
        let across = at(&self.cos_xy) * u_ - at(&self.sin_xy) * w_;
        let up = at(&self.sin_xy) * u_ + at(&self.cos_xy) * w_;
        let along = at(&self.cos_theta) * cz - at(&self.sin_theta) * up;
        let (sp, cp) = (at(&self.sin_phi), at(&self.cos_phi));
        let v =
            [cp * along - sp * across, sp * along + cp * across, at(&self.sin_theta) * cz + at(&self.cos_theta) * up];
        let wo = mirrored(self.flip, v);
        let (value, density) = self.values::<FMA>(wo);
        Some((wo, self.weigh(&value), self.density(&density)))
    }
}

/// Runs an expression on the mixture of the small or the large form.
macro_rules! with_mixture {
    ($layout:expr, $theta_i:expr, $h_um:expr, $sigma:expr, $miss:expr, |$mixture:ident| $body:expr) => {
        if $layout.small() {
            match mixture::<FMA, 1, N>($layout, $theta_i, $h_um, $sigma) {
                Some($mixture) => $body,
                None => $miss,
            }
        } else {
            match mixture::<FMA, GROUPS, N>($layout, $theta_i, $h_um, $sigma) {
                Some($mixture) => $body,
                None => $miss,
            }
        }
    };
}
const FMA: bool = false;

pub(super) fn run_eval<const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: [f32; N],
    wo: [f32; 3],
) -> [f32; N] {
    with_mixture!(layout, theta_i, h_um, sigma, [0.0; N], |m| m.eval::<FMA>(wo))
}

pub(super) fn run_eval_split<const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: [f32; N],
    wo: [f32; 3],
) -> ([f32; N], [f32; N]) {
    with_mixture!(layout, theta_i, h_um, sigma, ([0.0; N], [0.0; N]), |m| m.eval_split::<FMA>(wo))
}

pub(super) fn run_pdf<const N: usize>(layout: &Layout, theta_i: f32, h_um: f32, sigma: [f32; N], wo: [f32; 3]) -> f32 {
    with_mixture!(layout, theta_i, h_um, sigma, 0.0, |m| m.pdf::<FMA>(wo))
}

pub(super) fn run_sample<const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: [f32; N],
    u: [f32; 3],
) -> Option<([f32; 3], [f32; N], f32)> {
    with_mixture!(layout, theta_i, h_um, sigma, None, |m| m.sample::<FMA>(u))
}

pub(super) fn run_energies<const N: usize>(layout: &Layout, theta_i: f32, h_um: f32, sigma: [f32; N]) -> Energies<N> {
    energies::<FMA, N>(layout, theta_i, h_um, sigma)
}
