//! Energies at an incidence: interpolated over the nodes, absorbed along the paths, and the factors that
//! scale lobes to them.

use super::grid_cell::{GridCell, locate};
use super::layout::{Shares, Tables};
use crate::math::simd::{exp2, fma, max, min};
use crate::ply::data::MIN_TRANSMITTANCE;

/// r_d, energy of f_refl and of f_high per sigma.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Energies<const N: usize> {
    pub(crate) r_d: f32,
    pub(in crate::ply) refl: f32,
    pub(in crate::ply) high: [f32; N],
}

impl<const N: usize> Energies<N> {
    /// A beam beyond the nodes, which hits nothing.
    pub(in crate::ply) const MISS: Self = Energies { r_d: 1.0, refl: 0.0, high: [0.0; N] };

    /// Total scattered energy.
    pub(crate) fn albedo(&self) -> [f32; N] {
        sum(self.refl, self.high)
    }
}

/// The absorptions by which directions are sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::ply) enum DrawnBy {
    /// Their mean.
    Mean,
    First,
}

impl DrawnBy {
    /// Scattered energy plus the missed light: the total from which a sample is chosen.
    #[inline(always)]
    pub(in crate::ply) fn total<const N: usize>(self, energies: &Energies<N>) -> f32 {
        energies.r_d
            + match self {
                DrawnBy::Mean => mean_sum(energies.refl, &energies.high),
                DrawnBy::First => energies.refl + energies.high.first().copied().unwrap_or(0.0),
            }
    }
}

/// Values of the lobes in one direction, and the missed light.
#[derive(Clone, Copy)]
pub(crate) struct Core<const N: usize> {
    pub(crate) refl: f32,
    pub(crate) high: [f32; N],
    /// Density of sampling the direction; 0 where it was not requested.
    pub(crate) pdf: f32,
    pub(in crate::ply) r_d: f32,
    /// Chance that a sample is missed light.
    pub(in crate::ply) missed: f32,
}

impl<const N: usize> Core<N> {
    /// A beam beyond the nodes.
    pub(in crate::ply) const MISS: Self = Core { refl: 0.0, high: [0.0; N], pdf: 0.0, r_d: 1.0, missed: 1.0 };
}

/// `w[0] x[0] + .. + w[3] x[3]`.
#[inline(always)]
pub(in crate::ply) fn mix<const FMA: bool>(w: [f32; 4], x: [f32; 4]) -> f32 {
    fma::<FMA>(w[3], x[3], fma::<FMA>(w[2], x[2], fma::<FMA>(w[1], x[1], w[0] * x[0])))
}

/// Clamps an absorption to 0 to 1e6 per um; NaN counts as 0.
#[inline(always)]
pub(crate) fn clamped_sigma<const N: usize>(sigma: &[f32; N]) -> [f32; N] {
    let mut s = [0.0; N];
    for k in 0..N {
        s[k] = min(max(sigma[k], 0.0), 1e6);
    }
    s
}

/// Transmittance of a path from its binary logarithm.
#[inline(always)]
pub(in crate::ply) fn transmittance<const FMA: bool>(log2: f32) -> f32 {
    exp2::<FMA>(log2) + MIN_TRANSMITTANCE as f32
}

/// Transmittances of the path lengths.
#[inline(always)]
pub(in crate::ply) fn transmittances<const FMA: bool, const J: usize, const N: usize>(
    path: &[f32; J],
    sigma: &[f32; N],
) -> [[f32; N]; J] {
    let sigma = clamped_sigma(sigma);
    let mut t = [[0.0; N]; J];
    for j in 0..J {
        for k in 0..N {
            t[j][k] = sigma[k] * path[j];
        }
    }
    for t in t.as_flattened_mut() {
        *t = transmittance::<FMA>(*t);
    }
    t
}

/// Missed light, and the energies of scattered light.
#[derive(Clone, Copy)]
pub(in crate::ply) struct Node<const J: usize> {
    pub(in crate::ply) r_d: f32,
    pub(in crate::ply) refl: f32,
    /// Path-length spectrum of the energy of f_high.
    pub(in crate::ply) high: [f32; J],
}

/// r_d, energy of f_refl, spectrum of the energy of f_high at an incidence, by their splines.
#[inline(always)]
pub(in crate::ply) fn interpolate_node<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    p: &GridCell,
) -> Option<Node<J>> {
    let mut r_d = 0.0;
    for a in 0..3 {
        let [x, y, z] = tables.miss.get((p.miss.at + a as u32 * tables.grid.miss.row) as usize..)?.first_chunk()?;
        let [u, v, w] = p.miss.wn;
        r_d = fma::<FMA>(p.miss.wm[a], fma::<FMA>(w, *z, fma::<FMA>(v, *y, u * x)), r_d);
    }
    let (mut refl, mut high) = (0.0, [0.0; J]);
    for a in 0..3 {
        let row: &[Shares<J>; 3] =
            tables.shares.get((p.shares.at + a as u32 * tables.grid.shares.row) as usize..)?.first_chunk()?;
        for b in 0..3 {
            let w = p.shares.wm[a] * p.shares.wn[b];
            refl = fma::<FMA>(w, row[b].refl, refl);
            for j in 0..J {
                high[j] = fma::<FMA>(w, row[b].high[j], high[j]);
            }
        }
    }
    // Weights and coefficients are not negative except beyond the ends, where rounding may make them slightly
    // negative.
    let r_d = min(max(r_d, 0.0), 1.0);
    let hit = 1.0 - r_d;
    for e in &mut high {
        *e = max(*e, 0.0) * hit;
    }
    Some(Node { r_d, refl: max(refl, 0.0) * hit, high })
}

/// Sum over path lengths of a spectrum times its transmittances.
#[inline(always)]
pub(in crate::ply) fn absorb<const FMA: bool, const J: usize, const N: usize>(
    spectrum: &[f32; J],
    t: &[[f32; N]; J],
) -> [f32; N] {
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

/// Exact energies at an incidence, as `albedo` and `r_d` return them and as lobes are scaled to.
#[inline(always)]
pub(in crate::ply) fn energies<const FMA: bool, const H: usize, const R: usize, const J: usize, const N: usize>(
    tables: &Tables<H, R, J>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
) -> Option<Energies<N>> {
    let p = &locate::<FMA>(&tables.grid, theta_i, h_um);
    if !p.hit {
        return None;
    }
    let node = interpolate_node::<FMA, H, R, J>(tables, p)?;
    let t = transmittances::<FMA, J, N>(&tables.path, sigma);
    Some(Energies { r_d: node.r_d, refl: node.refl, high: absorb::<FMA, J, N>(&node.high, &t) })
}

/// Sum over the high-order lobes after absorption. Not scaled.
#[inline(always)]
pub(in crate::ply) fn absorbed<const FMA: bool, const H: usize, const J: usize, const N: usize>(
    pairs: usize,
    value: &[f32; H],
    spectrum: &[[f32; J]; H],
    t: &[[f32; N]; J],
) -> [f32; N] {
    // The loop runs over pairs of lobes, a number unknown to the compiler: it then keeps the path lengths in
    // vectors.
    let (mut even, mut odd) = ([0.0; J], [0.0; J]);
    for (value, spectrum) in value.as_chunks::<2>().0.iter().zip(spectrum.as_chunks::<2>().0).take(pairs) {
        for j in 0..J {
            even[j] = fma::<FMA>(value[0], spectrum[0][j], even[j]);
            odd[j] = fma::<FMA>(value[1], spectrum[1][j], odd[j]);
        }
    }
    for j in 0..J {
        even[j] += odd[j];
    }
    absorb::<FMA, J, N>(&even, t)
}

/// Factors that scale lobes with these sums of energies to the simulated energies.
#[inline(always)]
pub(in crate::ply) fn scales<const N: usize>(energies: &Energies<N>, refl: f32, high: &[f32; N]) -> (f32, [f32; N]) {
    let mut scale = [0.0; N];
    for k in 0..N {
        scale[k] = energies.high[k] / high[k];
    }
    (energies.refl / refl, scale)
}

/// f_refl + f_high. (The standard `map` is not always inlined into code for instruction sets other than the
/// default.)
#[inline(always)]
pub(in crate::ply) fn sum<const N: usize>(refl: f32, mut high: [f32; N]) -> [f32; N] {
    for f in &mut high {
        *f += refl;
    }
    high
}

/// Reflection part plus the mean of the high-order parts.
#[inline(always)]
pub(in crate::ply) fn mean_sum<const N: usize>(refl: f32, high: &[f32; N]) -> f32 {
    refl + high.iter().sum::<f32>() * (1.0 / N.max(1) as f32)
}

/// Sum by halves; the length is a power of 2.
#[inline(always)]
pub(in crate::ply) fn halves<const J: usize>(mut x: [f32; J]) -> f32 {
    let mut n = J;
    while n > 1 {
        n /= 2;
        for j in 0..n {
            x[j] += x[j + n];
        }
    }
    x[0]
}
