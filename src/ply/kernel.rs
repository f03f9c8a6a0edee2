//! The arithmetic of the runtime: the lobes of a model at one incidence side by side in the lanes of vectors, and their sums.
//!
//! High-order lobes fill the first H of L lanes, reflection lobes the R after them; lanes without a lobe have energy 0. Every
//! loop over lanes is contiguous, of constant length, and long enough a body that the compiler makes it vector code before it
//! would unroll it. With T the transmittances of the J path lengths, e_l and p_l the energy and spectrum of lobe l and G_l its
//! value, `f_high = scale * sum_j T_j sum_l e_l G_l p_lj`, so the sum over lobes is done once for all absorptions.

use super::layout::{HEAD, Layout};
use super::reference::LEAST_TRANSMITTANCE;
use crate::simd::{exp, fma, max, min, sin_cos};
use std::f32::consts::PI;

/// The lobes at one incidence: H high-order lanes of L, J path lengths, N absorptions.
pub(super) struct Mixture<const H: usize, const L: usize, const J: usize, const N: usize> {
    sin_theta: [f32; L],
    cos_theta: [f32; L],
    sin_phi: [f32; L],
    cos_phi: [f32; L],
    sin_xy: [f32; L],
    cos_xy: [f32; L],
    mu1: [f32; L],
    mu2: [f32; L],
    /// Energy * sqrt(mu1 mu2) / pi.
    norm: [f32; L],
    /// Energy / energy of the lobe with amplitude 1.
    amplitude: [f32; L],
    /// Energy before the scale to the simulated energy.
    energy: [f32; L],
    /// Path-length spectra of the high-order lobes.
    spectrum: [[f32; J]; H],
    /// Transmittance of each path length.
    transmittance: [[f32; N]; J],
    /// What makes the high-order lobes add up to the simulated energy.
    scale_high: [f32; N],
    /// What makes the reflection lobes add up to the simulated energy.
    scale_refl: f32,
    /// Number of high-order lobes.
    lobes_high: usize,
    /// Whether theta_i < 0: directions are mirrored on the way in and out.
    flip: bool,
    energies: Energies<N>,
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
    if h_um.is_nan() || theta_i.is_nan() || h_um.abs() > layout.h_last {
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

/// `len` floats at `at`; the layout is made so that they are there.
#[inline(always)]
fn floats(values: &[f32], at: usize, len: usize) -> Option<&[f32]> {
    values.get(at..at.checked_add(len)?)
}

/// Transmittances of the path lengths. Absorption that is not a number counts as 0; its range is 0 to 1e6 per um.
#[inline(always)]
fn transmittances<const FMA: bool, const J: usize, const N: usize>(
    layout: &Layout,
    sigma: &[f32; N],
) -> Option<[[f32; N]; J]> {
    let path = layout.path.first_chunk::<J>()?;
    let mut t = [[0.0; N]; J];
    for j in 0..J {
        for k in 0..N {
            t[j][k] = -min(max(sigma[k], 0.0), 1e6) * path[j];
        }
    }
    for x in t.as_flattened_mut() {
        *x = exp::<FMA>(*x) + LEAST_TRANSMITTANCE as f32;
    }
    Some(t)
}

#[inline(always)]
fn interpolate_energies<const FMA: bool, const J: usize, const N: usize>(
    layout: &Layout,
    p: Place,
    t: &[[f32; N]; J],
) -> Option<Energies<N>> {
    let stride = HEAD + J;
    let at = (p.m * layout.nodes_h + p.n) * stride;
    let a = floats(&layout.nodes, at, 2 * stride)?;
    let b = floats(&layout.nodes, at + layout.nodes_h * stride, 2 * stride)?;
    let w = bilinear(p.fm, p.fn_);
    let node = |i: usize| {
        let s = fma::<FMA>(w[1], a[i + stride], w[0] * a[i]);
        fma::<FMA>(w[3], b[i + stride], fma::<FMA>(w[2], b[i], s))
    };
    let mut spectrum = [0.0; J];
    for j in 0..J {
        spectrum[j] = node(HEAD + j);
    }
    Some(Energies { r_d: node(0), refl: node(1), high: absorb::<FMA, J, N>(&spectrum, t) })
}

/// Sum over path lengths of a spectrum times its transmittances.
#[inline(always)]
fn absorb<const FMA: bool, const J: usize, const N: usize>(spectrum: &[f32; J], t: &[[f32; N]; J]) -> [f32; N] {
    // Two sums halve the chain of dependent additions.
    let (mut even, mut odd) = ([0.0; N], [0.0; N]);
    for j in 0..J / 2 {
        for k in 0..N {
            even[k] = fma::<FMA>(spectrum[2 * j], t[2 * j][k], even[k]);
            odd[k] = fma::<FMA>(spectrum[2 * j + 1], t[2 * j + 1][k], odd[k]);
        }
    }
    for k in 0..N {
        even[k] += odd[k];
    }
    even
}

/// Exact energies at an incidence: what `albedo` and `r_d` report and what the lobes are scaled to.
#[inline(always)]
pub(super) fn energies<const FMA: bool, const J: usize, const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
) -> Option<Energies<N>> {
    let p = place(layout, theta_i, h_um)?;
    interpolate_energies::<FMA, J, N>(layout, p, &transmittances::<FMA, J, N>(layout, sigma)?)
}

/// Lobe parameters by lane, and spectra of the high-order lobes.
type Lobes<const H: usize, const L: usize, const J: usize> = ([[f32; L]; 6], [[f32; J]; H]);

/// Interpolates the lobes of both kinds.
#[inline(always)]
fn interpolate<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize>(
    layout: &Layout,
    p: Place,
) -> Option<Lobes<H, L, J>> {
    let (wm, wn) = (catmull_rom(p.fm), catmull_rom(p.fn_));
    let row = |a: usize| floats(&layout.refl, ((p.m + a) * (layout.nodes_h + 2) + p.n) * 6 * R, 24 * R);
    let (r0, r1, r2, r3) = (row(0)?, row(1)?, row(2)?, row(3)?);
    let mut refl = [[0.0; R]; 6];
    for (i, value) in refl.as_flattened_mut().iter_mut().enumerate() {
        let mut sum = 0.0;
        for (r, w) in [(r0, wm[0]), (r1, wm[1]), (r2, wm[2]), (r3, wm[3])] {
            let s = fma::<FMA>(wn[1], r[i + 6 * R], wn[0] * r[i]);
            let s = fma::<FMA>(wn[2], r[i + 12 * R], s);
            sum = fma::<FMA>(w, fma::<FMA>(wn[3], r[i + 18 * R], s), sum);
        }
        *value = sum;
    }

    // Block (m/2, n/2) spans two cells each way.
    let block = (p.m / 2) * (layout.nodes_h / 2) + p.n / 2;
    let w = bilinear(0.5 * ((p.m % 2) as f32 + p.fm), 0.5 * ((p.n % 2) as f32 + p.fn_));
    let corner = H * (6 + J);
    let c = floats(&layout.high, block * 4 * corner, 4 * corner)?;
    let at = |i: usize| {
        let s = fma::<FMA>(w[1], c[i + corner], w[0] * c[i]);
        fma::<FMA>(w[3], c[i + 3 * corner], fma::<FMA>(w[2], c[i + 2 * corner], s))
    };
    let (mut high, mut spectrum) = ([[0.0; H]; 6], [[0.0; J]; H]);
    for (i, value) in high.as_flattened_mut().iter_mut().enumerate() {
        *value = at(i);
    }
    for (i, value) in spectrum.as_flattened_mut().iter_mut().enumerate() {
        *value = at(6 * H + i);
    }
    let mut params = [[0.0; L]; 6];
    for k in 0..6 {
        params[k][..H].copy_from_slice(&high[k]);
        params[k][H..].copy_from_slice(&refl[k]);
    }
    Some((params, spectrum))
}

// Coefficients of the mean over s of 1 - exp(-1/b(s)) (see asg.rs) in x = (a + b)/2 and y = a b, a = (2 - mu1)/(2 + mu1) and b
// likewise of mu2: row j multiplies y^j. A minimax fit for bandwidths from MU_MIN to MU_MAX, relative error 9e-5 in f32 (tested);
// the 12-node quadrature, good to 1e-4 itself, costs ten times as much.
const MEAN_0: [f32; 11] = [
    0.86472696,
    -0.5413396,
    -1.0858794,
    -0.33280998,
    0.20640504,
    -3.191828,
    -0.32349062,
    10.540188,
    -7.891373,
    -42.007984,
    -28.1854,
];
const MEAN_1: [f32; 9] =
    [0.54242563, 0.51795506, -0.022908885, 3.760259, 1.3267359, -18.587229, 12.092752, 99.15994, 81.44035];
const MEAN_2: [f32; 7] = [0.008833905, -0.87465584, -0.9746874, 9.540781, -4.5728836, -78.518135, -82.348946];
const MEAN_3: [f32; 5] = [0.103313036, -1.2792708, 0.07296818, 23.176245, 33.99076];
const MEAN_4: [f32; 3] = [0.04638332, -1.8602276, -4.9093513];
const MEAN_5: [f32; 1] = [0.121228844];

/// Polynomial of even degree in x, constant term first, its even and odd powers apart: half the chain of Horner's rule.
#[inline(always)]
fn polynomial<const FMA: bool, const M: usize>(c: [f32; M], x: f32, x2: f32) -> f32 {
    let (mut even, mut odd) = (c[M - 1], c[M - 2]);
    for i in (0..M / 2).rev() {
        even = fma::<FMA>(even, x2, c[2 * i]);
    }
    for i in (0..M / 2 - 1).rev() {
        odd = fma::<FMA>(odd, x2, c[2 * i + 1]);
    }
    fma::<FMA>(odd, x, even)
}

/// Energy of a lobe with amplitude 1, times sqrt(mu1 mu2) / pi.
#[inline(always)]
fn unit_mean<const FMA: bool>(mu1: f32, mu2: f32) -> f32 {
    let (d1, d2) = (2.0 + mu1, 2.0 + mu2);
    let both = 1.0 / (d1 * d2);
    let (a, b) = ((2.0 - mu1) * (d2 * both), (2.0 - mu2) * (d1 * both));
    let (x, y) = (0.5 * (a + b), a * b);
    let (x2, y2) = (x * x, y * y);
    let p01 = fma::<FMA>(polynomial::<FMA, 9>(MEAN_1, x, x2), y, polynomial::<FMA, 11>(MEAN_0, x, x2));
    let p23 = fma::<FMA>(polynomial::<FMA, 5>(MEAN_3, x, x2), y, polynomial::<FMA, 7>(MEAN_2, x, x2));
    let p45 = fma::<FMA>(MEAN_5[0], y, polynomial::<FMA, 3>(MEAN_4, x, x2));
    fma::<FMA>(fma::<FMA>(p45, y2, p23), y2, p01)
}

/// The lobes at an incidence; `None` where the beam misses.
#[inline(always)]
pub(super) fn mixture<
    const FMA: bool,
    const H: usize,
    const R: usize,
    const L: usize,
    const J: usize,
    const N: usize,
>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
) -> Option<Mixture<H, L, J, N>> {
    let p = place(layout, theta_i, h_um)?;
    let (params, spectrum) = interpolate::<FMA, H, R, L, J>(layout, p)?;
    let transmittance = transmittances::<FMA, J, N>(layout, sigma)?;
    let energies = interpolate_energies::<FMA, J, N>(layout, p, &transmittance)?;
    let least = layout.least.first_chunk::<L>()?;
    let mut x = Mixture {
        sin_theta: [0.0; L],
        cos_theta: [0.0; L],
        sin_phi: [0.0; L],
        cos_phi: [0.0; L],
        sin_xy: [0.0; L],
        cos_xy: [0.0; L],
        mu1: [0.0; L],
        mu2: [0.0; L],
        norm: [0.0; L],
        amplitude: [0.0; L],
        energy: [0.0; L],
        spectrum,
        transmittance,
        scale_high: [0.0; N],
        scale_refl: 0.0,
        lobes_high: layout.lobes_high,
        flip: p.flip,
        energies,
    };
    // ln of asg::MU_MIN and asg::MU_MAX.
    let (low, high) = (-1.609_438, 9.903_487);
    for i in 0..L {
        (x.sin_theta[i], x.cos_theta[i]) = sin_cos::<FMA>(params[0][i]);
        (x.sin_phi[i], x.cos_phi[i]) = sin_cos::<FMA>(params[1][i]);
        (x.sin_xy[i], x.cos_xy[i]) = sin_cos::<FMA>(params[2][i]);
    }
    for i in 0..L {
        let mu1 = exp::<FMA>(min(max(params[3][i], low), high));
        let mu2 = exp::<FMA>(min(max(params[4][i], low), high));
        let energy = max(params[5][i], least[i]);
        let norm = energy * ((mu1 * mu2).sqrt() * (1.0 / PI));
        x.mu1[i] = mu1;
        x.mu2[i] = mu2;
        x.norm[i] = norm;
        x.energy[i] = energy;
        x.amplitude[i] = norm / unit_mean::<FMA>(mu1, mu2);
    }
    let (refl, high) = x.absorbed::<FMA>(&x.energy);
    x.scale_refl = energies.refl / refl;
    for k in 0..N {
        x.scale_high[k] = energies.high[k] / high[k];
    }
    Some(x)
}

/// Reflection part plus the mean of the high-order parts.
#[inline(always)]
fn mean_sum<const N: usize>(refl: f32, high: &[f32; N]) -> f32 {
    refl + high.iter().sum::<f32>() * (1.0 / N.max(1) as f32)
}

#[inline(always)]
fn mirrored(flip: bool, w: [f32; 3]) -> [f32; 3] {
    if flip { crate::mirror_incidence(w) } else { w }
}

impl<const H: usize, const L: usize, const J: usize, const N: usize> Mixture<H, L, J, N> {
    /// Sums over the lobes of `value` by lane: reflection, and high-order after absorption. Not scaled.
    #[inline(always)]
    fn absorbed<const FMA: bool>(&self, value: &[f32; L]) -> (f32, [f32; N]) {
        // Of as many turns as there are pairs of lobes, which the compiler does not know: it then keeps the path lengths in vectors.
        let (mut even, mut odd) = ([0.0; J], [0.0; J]);
        let pairs = value.as_chunks::<2>().0.iter().zip(self.spectrum.as_chunks::<2>().0);
        for (value, spectrum) in pairs.take(self.lobes_high.div_ceil(2)) {
            for j in 0..J {
                even[j] = fma::<FMA>(value[0], spectrum[0][j], even[j]);
                odd[j] = fma::<FMA>(value[1], spectrum[1][j], odd[j]);
            }
        }
        for j in 0..J {
            even[j] += odd[j];
        }
        let mut refl = [0.0; 4];
        for octet in value[H..].as_chunks::<8>().0 {
            for i in 0..4 {
                refl[i] += octet[i] + octet[i + 4];
            }
        }
        ((refl[0] + refl[2]) + (refl[1] + refl[3]), absorb::<FMA, J, N>(&even, &self.transmittance))
    }

    /// [`Mixture::absorbed`], scaled to the simulated energies.
    #[inline(always)]
    fn weigh<const FMA: bool>(&self, value: &[f32; L]) -> (f32, [f32; N]) {
        let (refl, mut high) = self.absorbed::<FMA>(value);
        for k in 0..N {
            high[k] *= self.scale_high[k];
        }
        (refl * self.scale_refl, high)
    }

    /// Per lane: the value of the lobe in direction `wo`, and its density of sampling times its energy [1/sr].
    #[inline(always)]
    fn values<const FMA: bool>(&self, wo: [f32; 3]) -> ([f32; L], [f32; L]) {
        let v = mirrored(self.flip, wo);
        let (mut value, mut density) = ([0.0; L], [0.0; L]);
        for i in 0..L {
            let across = fma::<FMA>(self.cos_phi[i], v[1], -self.sin_phi[i] * v[0]);
            let along = fma::<FMA>(self.cos_phi[i], v[0], self.sin_phi[i] * v[1]);
            let up = fma::<FMA>(self.cos_theta[i], v[2], -self.sin_theta[i] * along);
            let cz = fma::<FMA>(self.cos_theta[i], along, self.sin_theta[i] * v[2]);
            let u = fma::<FMA>(self.cos_xy[i], across, self.sin_xy[i] * up);
            let w = fma::<FMA>(self.cos_xy[i], up, -self.sin_xy[i] * across);
            let (u2, w2) = (u * u, w * w);
            let q = fma::<FMA>(self.mu1[i], u2, self.mu2[i] * w2);
            // Only finite directions in front of the lobe count; the comparisons are false for what is not a number.
            let front = if cz > 0.0 && cz < 2.0 { cz } else { 0.0 };
            let shape = front * exp::<FMA>(-q);
            // a(t) of the direction t of (u, w); at the axis, where t is undefined, any mean of mu1 and mu2 serves.
            let a = (q + 1e-30) / (u2 + w2 + 1e-30);
            value[i] = shape * self.amplitude[i];
            density[i] = shape * self.norm[i] / (1.0 - exp::<FMA>(-a));
        }
        (value, density)
    }

    /// f_refl and f_high per sigma [1/sr].
    #[inline(always)]
    pub(super) fn eval<const FMA: bool>(&self, wo: [f32; 3]) -> (f32, [f32; N]) {
        self.weigh::<FMA>(&self.values::<FMA>(wo).0)
    }

    /// Mean scattered energy plus the missed: what a sample is chosen from.
    #[inline(always)]
    fn total(&self) -> f32 {
        mean_sum(self.energies.refl, &self.energies.high) + self.energies.r_d
    }

    #[inline(always)]
    fn density<const FMA: bool>(&self, density: &[f32; L]) -> f32 {
        let (refl, high) = self.weigh::<FMA>(density);
        let total = self.total();
        if total > 0.0 { mean_sum(refl, &high) / total } else { 0.0 }
    }

    /// Density of sampling `wo` [1/sr], missing included.
    #[inline(always)]
    pub(super) fn pdf<const FMA: bool>(&self, wo: [f32; 3]) -> f32 {
        self.density::<FMA>(&self.values::<FMA>(wo).1)
    }

    /// f_refl and f_high per sigma and the density of sampling `wo` [1/sr].
    #[inline(always)]
    pub(super) fn eval_pdf<const FMA: bool>(&self, wo: [f32; 3]) -> (f32, [f32; N], f32) {
        let (value, density) = self.values::<FMA>(wo);
        let (refl, high) = self.weigh::<FMA>(&value);
        (refl, high, self.density::<FMA>(&density))
    }

    /// Energy of each lobe averaged over the absorptions, scaled.
    #[inline(always)]
    fn mean_energies(&self) -> [f32; L] {
        let share = 1.0 / N.max(1) as f32;
        let mut by_path = [0.0; J];
        for j in 0..J {
            for k in 0..N {
                by_path[j] += share * self.scale_high[k] * self.transmittance[j][k];
            }
        }
        let mut mean = self.energy.map(|e| e * self.scale_refl);
        for l in 0..H {
            let mut sum = 0.0;
            for j in 0..J {
                sum += self.spectrum[l][j] * by_path[j];
            }
            mean[l] = self.energy[l] * sum;
        }
        mean
    }

    /// A direction, f and pdf there; `None` for the light that missed.
    #[inline(always)]
    pub(super) fn sample<const FMA: bool>(&self, u: [f32; 3]) -> Option<([f32; 3], [f32; N], f32)> {
        // Below 1, and 0 for what is not a number.
        let u = u.map(|x| min(max(x, 0.0), 1.0 - f32::EPSILON / 2.0));
        let total = self.total();
        let mut left = u[0] * total;
        if left >= total - self.energies.r_d {
            return None;
        }
        let mut chosen = None;
        for (i, energy) in self.mean_energies().into_iter().enumerate() {
            if energy > 0.0 {
                chosen = Some(i);
                if left < energy {
                    break;
                }
                left -= energy;
            }
        }
        let i = chosen?;
        // tan t = sqrt(mu1/mu2) tan(2 pi u1), in the same quadrant.
        let (mu1, mu2) = (self.mu1[i], self.mu2[i]);
        let (s, c) = sin_cos::<FMA>(2.0 * PI * u[1]);
        let (c, s) = (mu2.sqrt() * c, mu1.sqrt() * s);
        let n2 = 1.0 / (c * c + s * s);
        let a = (mu1 * c * c + mu2 * s * s) * n2;
        let r2 = min(-(-u[2] * (1.0 - exp::<FMA>(-a))).ln_1p() / a, 1.0 - f32::EPSILON);
        let r = (r2 * n2).sqrt();
        let (u_, w_, cz) = (r * c, r * s, (1.0 - r2).sqrt());
        let across = self.cos_xy[i] * u_ - self.sin_xy[i] * w_;
        let up = self.sin_xy[i] * u_ + self.cos_xy[i] * w_;
        let along = self.cos_theta[i] * cz - self.sin_theta[i] * up;
        let (sp, cp) = (self.sin_phi[i], self.cos_phi[i]);
        let z = self.sin_theta[i] * cz + self.cos_theta[i] * up;
        let wo = mirrored(self.flip, [cp * along - sp * across, sp * along + cp * across, z]);
        let (refl, high, pdf) = self.eval_pdf::<FMA>(wo);
        Some((wo, high.map(|f| refl + f), pdf))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asg::{MU_MAX, MU_MIN};

    /// The mean over s of 1 - exp(-1/b(s)) with many nodes.
    fn mean(mu1: f64, mu2: f64) -> f64 {
        let n = 2000;
        let node = |j: usize| {
            let s2 = (0.5 * std::f64::consts::PI * (j as f64 + 0.5) / n as f64).sin().powi(2);
            -(-1.0 / ((1.0 - s2) / mu1 + s2 / mu2)).exp_m1()
        };
        (0..n).map(node).sum::<f64>() / n as f64
    }

    #[test]
    fn unit_mean_matches_the_integral() {
        let step = (MU_MAX / MU_MIN).ln() / 60.0;
        for i in 0..=60 {
            for j in 0..=60 {
                let (mu1, mu2) = (MU_MIN * (step * f64::from(i)).exp(), MU_MIN * (step * f64::from(j)).exp());
                let want = mean(mu1, mu2);
                for got in [unit_mean::<true>(mu1 as f32, mu2 as f32), unit_mean::<false>(mu1 as f32, mu2 as f32)] {
                    let err = (f64::from(got) / want - 1.0).abs();
                    assert!(err < 1e-4, "mu {mu1} {mu2}: got {got}, want {want}, relative {err}");
                }
            }
        }
    }
}
