//! Position of an incidence in the tables: the cell between the nodes, the block, and the interpolation
//! weights.

use super::layout::{Grid, SplineGrid};
use crate::math::simd::{fma, max, min};

/// Indices and weights for interpolation at one incidence.
#[derive(Clone, Copy)]
pub(in crate::ply) struct GridCell {
    /// Whether the beam is within the nodes.
    pub(in crate::ply) hit: bool,
    /// Whether theta_i < 0. If so, directions are mirrored before evaluation and after sampling.
    pub(in crate::ply) flip: bool,
    /// Coefficients of r_d and of the shares.
    pub(in crate::ply) miss: Taps,
    pub(in crate::ply) shares: Taps,
    /// Index of the cell's reflection lobes in the tables, and of the block's high-order lobes.
    pub(in crate::ply) refl: u32,
    pub(in crate::ply) high: u32,
    /// Catmull-Rom weights of nodes -1..=2 of the cell, along theta_i and along h.
    pub(in crate::ply) wm: [f32; 4],
    pub(in crate::ply) wn: [f32; 4],
    /// Bilinear weights of the corners of the block, theta_i being the slower index.
    pub(in crate::ply) block: [f32; 4],
}

/// Three by three coefficients of a spline: the index of the first in the tables, and the weights along
/// theta_i and h.
#[derive(Clone, Copy)]
pub(in crate::ply) struct Taps {
    pub(in crate::ply) at: u32,
    pub(in crate::ply) wm: [f32; 3],
    pub(in crate::ply) wn: [f32; 3],
}

impl Taps {
    #[inline(always)]
    fn new<const FMA: bool>(grid: &SplineGrid, theta_i: f32, h: f32, h_last: f32) -> Taps {
        let t = min(theta_i.abs() * grid.per_theta, grid.last_theta);
        let x = min(max((h + h_last) * grid.per_h, 0.0), grid.last_h);
        let (m, n) = (min((t + 0.5).floor(), grid.last_theta), min((x + 0.5).floor(), grid.last_h));
        Taps { at: bits(m) * grid.row + bits(n), wm: spline::<FMA>(t - m), wn: spline::<FMA>(x - n) }
    }
}

/// An integer from a float: 2^23 plus an integer stores that integer in its low bits.
#[inline(always)]
fn bits(x: f32) -> u32 {
    (x + 8_388_608.0).to_bits() & 0x7f_ffff
}

/// The cell of any incidence, including those beyond the nodes, without a branch.
#[inline(always)]
pub(in crate::ply) fn locate<const FMA: bool>(grid: &Grid, theta_i: f32, h_um: f32) -> GridCell {
    let flip = theta_i < 0.0;
    let h = if flip { -h_um } else { h_um };
    let t = min(theta_i.abs() * grid.per_theta, grid.last_theta);
    let x = min(max((h + grid.h_last) * grid.per_h, 0.0), grid.last_h);
    let (m, n) = (min(t.floor(), grid.last_theta - 1.0), min(x.floor(), grid.last_h - 1.0));
    let (fm, fn_) = (t - m, x - n);
    let (half_m, half_n) = (0.5 * m, 0.5 * n);
    let (row, column) = (bits(m), bits(n));
    GridCell {
        hit: h_um.abs() <= grid.h_last && !theta_i.is_nan(),
        flip,
        miss: Taps::new::<FMA>(&grid.miss, theta_i, h, grid.h_last),
        shares: Taps::new::<FMA>(&grid.shares, theta_i, h, grid.h_last),
        refl: row * (grid.nodes_h + 2) + column,
        high: (row / 2) * (grid.nodes_h / 2) + column / 2,
        wm: catmull_rom::<FMA>(fm),
        wn: catmull_rom::<FMA>(fn_),
        block: bilinear(half_m - half_m.floor() + 0.5 * fm, half_n - half_n.floor() + 0.5 * fn_),
    }
}

/// [`GridCell`]s of W incidences side by side.
pub(in crate::ply) struct GridCells<const W: usize> {
    pub(in crate::ply) hit: [u32; W],
    flip: [u32; W],
    at: [[u32; W]; 4],
    weights: [[f32; W]; 24],
}

impl<const W: usize> GridCells<W> {
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool>(grid: &Grid, theta_i: &[f32; W], h_um: &[f32; W]) -> Self {
        let mut x = GridCells { hit: [0; W], flip: [0; W], at: [[0; W]; 4], weights: [[0.0; W]; 24] };
        for q in 0..W {
            let p = locate::<FMA>(grid, theta_i[q], h_um[q]);
            x.hit[q] = u32::from(p.hit);
            x.flip[q] = u32::from(p.flip);
            (x.at[0][q], x.at[1][q], x.at[2][q], x.at[3][q]) = (p.refl, p.high, p.miss.at, p.shares.at);
            for k in 0..4 {
                x.weights[k][q] = p.wm[k];
                x.weights[4 + k][q] = p.wn[k];
                x.weights[8 + k][q] = p.block[k];
            }
            for k in 0..3 {
                x.weights[12 + k][q] = p.miss.wm[k];
                x.weights[15 + k][q] = p.miss.wn[k];
                x.weights[18 + k][q] = p.shares.wm[k];
                x.weights[21 + k][q] = p.shares.wn[k];
            }
        }
        x
    }

    /// Mirrors the directions of incidences with theta_i < 0.
    #[inline(always)]
    pub(in crate::ply) fn mirror(&self, v: &mut [[f32; W]; 3]) {
        for q in 0..W {
            [v[0][q], v[1][q], v[2][q]] = mirrored(self.flip[q] != 0, [v[0][q], v[1][q], v[2][q]]);
        }
    }

    #[inline(always)]
    pub(in crate::ply) fn get(&self, q: usize) -> GridCell {
        let w = |k: usize| [self.weights[k][q], self.weights[k + 1][q], self.weights[k + 2][q], self.weights[k + 3][q]];
        let w3 = |k: usize| [self.weights[k][q], self.weights[k + 1][q], self.weights[k + 2][q]];
        GridCell {
            hit: self.hit[q] != 0,
            flip: self.flip[q] != 0,
            miss: Taps { at: self.at[2][q], wm: w3(12), wn: w3(15) },
            shares: Taps { at: self.at[3][q], wm: w3(18), wn: w3(21) },
            refl: self.at[0][q],
            high: self.at[1][q],
            wm: w(0),
            wn: w(4),
            block: w(8),
        }
    }
}

/// Catmull-Rom weights of nodes -1..=2 of the cell at fraction `f`: four polynomials side by side.
#[inline(always)]
fn catmull_rom<const FMA: bool>(f: f32) -> [f32; 4] {
    const C: [[f32; 4]; 4] =
        [[0.0, 1.0, 0.0, 0.0], [-0.5, 0.0, 0.5, 0.0], [1.0, -2.5, 2.0, -0.5], [-0.5, 1.5, -1.5, 0.5]];
    let mut w = C[3];
    for c in [C[2], C[1], C[0]] {
        for i in 0..4 {
            w[i] = fma::<FMA>(w[i], f, c[i]);
        }
    }
    w
}

/// Weights of a quadratic spline's coefficients before, at and after the nearest node, `f` steps beyond it.
#[inline(always)]
fn spline<const FMA: bool>(f: f32) -> [f32; 3] {
    let (low, high) = (0.5 - f, 0.5 + f);
    [0.5 * low * low, fma::<FMA>(-f, f, 0.75), 0.5 * high * high]
}

/// Bilinear weights, theta being the slower index.
#[inline(always)]
fn bilinear(fm: f32, fn_: f32) -> [f32; 4] {
    [(1.0 - fm) * (1.0 - fn_), (1.0 - fm) * fn_, fm * (1.0 - fn_), fm * fn_]
}

#[inline(always)]
pub(in crate::ply) fn mirrored(flip: bool, w: [f32; 3]) -> [f32; 3] {
    if flip { crate::frame::mirror_incidence(w) } else { w }
}
