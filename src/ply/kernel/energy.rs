//! Energies at an incidence, interpolated between the nodes: r_d, the energy of f_refl, and the path-length
//! spectrum of the energy of f_high ([`crate::ply::data::energies`]).

use super::absorption::energies_by_sigma;
use super::grid_cell::{GridCell, locate};
use super::layout::{Shares, Tables};
use crate::math::simd::{fma, max, min};

/// r_d, the energy of f_refl, and the energy of f_high at each absorption.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Energies<const N: usize> {
    pub(crate) r_d: f32,
    pub(in crate::ply) refl: f32,
    pub(in crate::ply) high: [f32; N],
}

impl<const N: usize> Energies<N> {
    /// Total scattered energy, one for each absorption.
    pub(crate) fn albedo(&self) -> [f32; N] {
        let mut all = self.high;
        all.iter_mut().for_each(|e| *e += self.refl);
        all
    }
}

/// The absorptions whose energies determine which lobe a sample chooses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::ply) enum DrawnBy {
    /// The mean over all absorptions.
    Mean,
    First,
}

/// Values of the lobes in one direction, and the missed light.
#[derive(Clone, Copy)]
pub(crate) struct Core<const N: usize> {
    pub(crate) refl: f32,
    pub(crate) high: [f32; N],
    /// Density of sampling the direction; 0 if it was not requested.
    pub(crate) pdf: f32,
    pub(in crate::ply) r_d: f32,
    /// Probability that a sample chooses the missed light.
    pub(in crate::ply) missed: f32,
}

/// The fields of [`Core`] except f_high.
#[derive(Clone, Copy)]
pub(in crate::ply) struct Rest {
    pub(in crate::ply) refl: f32,
    pub(in crate::ply) pdf: f32,
    pub(in crate::ply) r_d: f32,
    pub(in crate::ply) missed: f32,
}

impl Rest {
    /// The values for a beam beyond the nodes.
    pub(in crate::ply) const MISS: Self = Rest { refl: 0.0, pdf: 0.0, r_d: 1.0, missed: 1.0 };

    /// Adds f_high.
    #[inline(always)]
    pub(in crate::ply) fn with<const N: usize>(self, high: [f32; N]) -> Core<N> {
        let Rest { refl, pdf, r_d, missed } = self;
        Core { refl, high, pdf, r_d, missed }
    }
}

/// `w[0] x[0] + .. + w[3] x[3]`.
#[inline(always)]
pub(in crate::ply) fn mix<const FMA: bool>(w: [f32; 4], x: [f32; 4]) -> f32 {
    fma::<FMA>(w[3], x[3], fma::<FMA>(w[2], x[2], fma::<FMA>(w[1], x[1], w[0] * x[0])))
}

/// A entries of a table from index `at` on, by one comparison.
#[inline(always)]
pub(in crate::ply) fn some<T, const A: usize>(table: &[T], at: u32) -> Option<&[T; A]> {
    let at = at as usize;
    table.get(at..at.wrapping_add(A))?.first_chunk()
}

/// Interpolated r_d and energies of the scattered light.
#[derive(Clone, Copy)]
pub(in crate::ply) struct Node<const J: usize> {
    pub(in crate::ply) r_d: f32,
    pub(in crate::ply) refl: f32,
    /// Path-length spectrum of the energy of f_high.
    pub(in crate::ply) high: [f32; J],
}

/// r_d, the energy of f_refl and the spectrum of the energy of f_high at an incidence, from their splines.
#[inline(always)]
pub(in crate::ply) fn interpolate_node<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    p: &GridCell,
) -> Option<Node<J>> {
    let mut r_d = 0.0;
    for a in 0..3 {
        let [x, y, z] = some(&tables.miss, p.miss.at + a as u32 * tables.grid.miss.row)?;
        let [u, v, w] = p.miss.wn;
        r_d = fma::<FMA>(p.miss.wm[a], fma::<FMA>(w, *z, fma::<FMA>(v, *y, u * x)), r_d);
    }
    let (mut refl, mut high) = (0.0, [0.0; J]);
    for a in 0..3 {
        let row: &[Shares<J>; 3] = some(&tables.shares, p.shares.at + a as u32 * tables.grid.shares.row)?;
        for b in 0..3 {
            let w = p.shares.wm[a] * p.shares.wn[b];
            refl = fma::<FMA>(w, row[b].refl, refl);
            for j in 0..J {
                high[j] = fma::<FMA>(w, row[b].high[j], high[j]);
            }
        }
    }
    // Weights and coefficients are 0 or more, except beyond the ends, where rounding may make them slightly
    // negative.
    let r_d = min(max(r_d, 0.0), 1.0);
    let hit = 1.0 - r_d;
    for e in &mut high {
        *e = max(*e, 0.0) * hit;
    }
    Some(Node { r_d, refl: max(refl, 0.0) * hit, high })
}

/// Returns r_d and the energy of f_refl at an incidence, and writes the energy of f_high at each absorption
/// to `high`. `albedo` and `r_d` return these energies, and the lobes are scaled to them. Where the beam
/// misses, r_d is 1 and the energies are 0.
#[inline(always)]
pub(in crate::ply) fn energies<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32],
    high: &mut [f32],
) -> [f32; 2] {
    let p = &locate::<FMA>(&tables.grid, theta_i, h_um);
    if !p.hit {
        return [1.0, 0.0];
    }
    let Some(node) = interpolate_node::<FMA, H, R, J>(tables, p) else { return [1.0, 0.0] };
    energies_by_sigma::<FMA, J>(&node.high, &tables.path, sigma, high);
    [node.r_d, node.refl]
}
