//! Far fields of a cylinder whose azimuths are spread by Gaussians, tabulated once a fiber (Zinke 2007, 9.2: "a two-dimensional lookup table with respect to theta_d and phi").
//!
//! The paper's table is of one absorption. Here a node holds, of the offsets whose light leaves there, the energy E without absorption and the first two moments of
//! `d = cos gamma_t - c`, to which path lengths are in proportion; with s = p sigma 2 r / cos theta_t the light is
//!
//! ```text
//! E exp(-s (c + <d>)) (1 + x/2 + x^2/24),   x = s^2 (<d^2> - <d>^2)
//! ```
//!
//! which is exact where one path, or two of one weight up to x^3, leave there. cos gamma_t lies within 1 - 1/n^2 of its square, so that x is small where light is left.
//! Nodes are linear in latitude and azimuth; the Gaussian is narrowed by what linear interpolation adds to its variance. Sampling inverts the same interpolation.

use super::azimuthal::CrossSection;
use super::fast::{exp, lanes};
use std::f32::consts::{FRAC_PI_2, PI};

/// Least width that is tabulated [rad]: narrower ones would take more than 20 MB.
pub(super) const LEAST_WIDTH: f32 = 0.05;
/// Largest absorption times length: nothing is left long before.
const MOST: f32 = 1e4;

/// The table of a fiber's orders.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FarTable {
    orders: usize,
    cells: usize,
    rows: usize,
    /// c.
    middle: f32,
    /// `[row][azimuth][order]` of E, its two moments [1/rad], and the integral of E from 0 on; azimuths from 0 to pi.
    nodes: Vec<[f32; 4]>,
    /// `[row][order + 1]`: the same over all azimuths, and of the order that comes next.
    totals: Vec<[f32; 4]>,
    /// `[row]`: energy of all orders that come next.
    beyond: Vec<f32>,
}

/// A latitude in the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Row {
    first: usize,
    second: usize,
    t: f32,
}

impl FarTable {
    /// Of a fiber of index `eta`, by the widths of its orders [rad], of which a width below [`LEAST_WIDTH`] counts as that.
    pub(super) fn new(eta: f32, widths: &[f32]) -> FarTable {
        let least = widths.iter().copied().fold(f32::INFINITY, f32::min).max(LEAST_WIDTH);
        let cells = ((10.0 * PI / least).ceil() as usize).clamp(64, 640);
        let rows = ((8.0 / least).ceil() as usize).clamp(64, 160);
        let orders = widths.len();
        let middle = 0.5 * (1.0 + (1.0 - 1.0 / (eta * eta)).max(0.0).sqrt());
        let mut table = FarTable {
            orders,
            cells,
            rows,
            middle,
            nodes: vec![[0.0; 4]; rows * (cells + 1) * orders],
            totals: vec![[0.0; 4]; rows * (orders + 1)],
            beyond: vec![0.0; rows],
        };
        let kernels: Vec<Vec<f64>> = widths.iter().map(|w| kernel(w.max(LEAST_WIDTH), cells)).collect();
        for row in 0..rows {
            let theta = FRAC_PI_2 * row as f32 / (rows - 1) as f32;
            table.fill(row, &CrossSection::new(eta, 1.0, theta.sin()), &kernels);
        }
        table
    }

    fn fill(&mut self, row: usize, section: &CrossSection, kernels: &[Vec<f64>]) {
        let (cells, turn) = (self.cells, 2 * self.cells);
        let offsets = 6 * cells;
        let step = std::f64::consts::FRAC_PI_2 / offsets as f64;
        let all: f64 = (0..offsets).map(|k| ((k as f64 + 0.5) * step).cos()).sum();
        let per_rad = cells as f64 / std::f64::consts::PI;
        let mut beyond = 0.0;
        for order in 0..=self.orders {
            let mut mass = vec![[0.0f64; 3]; turn];
            let mut total = [0.0; 3];
            for k in 0..offsets {
                let gamma = (k as f64 + 0.5) * step;
                let h = gamma.sin() as f32;
                let weight = gamma.cos() / all;
                let path = section.path(h);
                let a = weight * f64::from(path.attenuation(order as u32, 0.0));
                let d = f64::from(section.cos_t(h) - self.middle);
                let moments = [a, a * d, a * d * d];
                (0..3).for_each(|m| total[m] += moments[m]);
                if order == self.orders {
                    beyond += weight * f64::from(path.from_order(order as u32, 0.0));
                    continue;
                }
                let at = f64::from(section.turn(order as u32, h)) * per_rad;
                // Light at h and at -h, in the two nodes about its azimuth.
                for at in [at, -at] {
                    let at = at.rem_euclid(turn as f64);
                    let (j, t) = (at as usize, at - at.floor());
                    for (j, share) in [(j, 1.0 - t), (j + 1, t)] {
                        (0..3).for_each(|m| mass[j % turn][m] += 0.5 * share * moments[m]);
                    }
                }
            }
            self.totals[row * (self.orders + 1) + order] = [total[0] as f32, total[1] as f32, total[2] as f32, 0.0];
            if order == self.orders {
                continue;
            }
            let kernel = &kernels[order];
            let reach = kernel.len() / 2;
            let (mut below, mut last) = (0.0, 0.0);
            for j in 0..=cells {
                let mut sums = [0.0; 3];
                for (k, weight) in kernel.iter().enumerate() {
                    let from = &mass[(j + turn + k - reach) % turn];
                    (0..3).for_each(|m| sums[m] += weight * from[m]);
                }
                let [e, first, second] = sums.map(|s| s * per_rad);
                if j > 0 {
                    below += 0.5 * (last + e) / per_rad;
                }
                last = e;
                self.nodes[(row * (cells + 1) + j) * self.orders + order] =
                    [e as f32, first as f32, second as f32, below as f32];
            }
        }
        self.beyond[row] = beyond as f32;
    }

    /// A latitude [rad], of either sign.
    #[inline]
    pub(super) fn row(&self, theta: f32) -> Row {
        let at = (theta.abs() * ((self.rows - 1) as f32 / FRAC_PI_2)).min((self.rows - 1) as f32);
        let first = (at as usize).min(self.rows - 2);
        Row { first, second: first + 1, t: at - first as f32 }
    }

    /// Calls for each order with its moments in the relative azimuth `phi`, in [-pi, pi].
    #[inline]
    pub(super) fn each_order(&self, row: Row, phi: f32, mut visit: impl FnMut(usize, [f32; 4])) {
        let at = (phi.abs() * (self.cells as f32 / PI)).min(self.cells as f32);
        let cell = (at as usize).min(self.cells - 1);
        let t = at - cell as f32;
        let (p, n) = (self.orders, self.orders * (self.cells + 1));
        let slice = |row: usize| &self.nodes[row * n + cell * p..][..2 * p];
        let (a, b) = (slice(row.first), slice(row.second));
        let weights = [(1.0 - row.t) * (1.0 - t), (1.0 - row.t) * t, row.t * (1.0 - t), row.t * t];
        for order in 0..p {
            let corners = [&a[order], &a[p + order], &b[order], &b[p + order]];
            visit(
                order,
                lanes(|m| {
                    corners[0][m] * weights[0]
                        + corners[1][m] * weights[1]
                        + corners[2][m] * weights[2]
                        + corners[3][m] * weights[3]
                }),
            );
        }
    }

    /// Moments of an order over all azimuths, of the order that comes after the last, too.
    #[inline]
    pub(super) fn total(&self, row: Row, order: usize) -> [f32; 4] {
        let at = |row: usize| &self.totals[row * (self.orders + 1) + order];
        let (a, b) = (at(row.first), at(row.second));
        lanes(|m| a[m] + row.t * (b[m] - a[m]))
    }

    /// Light of moments where absorption times length is `s` at a cosine of 1, by wavelength; `order` such lengths.
    #[inline(always)]
    pub(super) fn light<const N: usize>(&self, order: usize, moments: [f32; 4], s: &[f32; N]) -> [f32; N] {
        let [energy, first, second, _] = moments;
        if order == 0 || energy <= 0.0 {
            return [energy.max(0.0); N];
        }
        let inverse = 1.0 / energy;
        let mean = first * inverse;
        let variance = (second * inverse - mean * mean).max(0.0);
        let (c, p) = ((self.middle + mean).max(0.0), order as f32);
        lanes(|n| {
            let s = (p * s[n]).min(MOST);
            let x = s * s * variance;
            energy * exp(-s * c) * (1.0 + x * (0.5 + x * (1.0 / 24.0)))
        })
    }

    /// Light of the orders that come after the last.
    #[inline]
    pub(super) fn beyond<const N: usize>(&self, row: Row, s: &[f32; N]) -> [f32; N] {
        let (a, b) = (self.beyond[row.first], self.beyond[row.second]);
        let all = a + row.t * (b - a);
        let next = self.total(row, self.orders);
        if all <= 0.0 || next[0] <= 0.0 {
            return [0.0; N];
        }
        // A mean reflectance: without absorption the orders are a geometric series of it, as are they with it, times their transmittance.
        let f = (1.0 - next[0] / all).max(0.0);
        let c = (self.middle + next[1] / next[0]).max(0.0);
        let light = self.light(self.orders, next, s);
        lanes(|n| light[n] / (1.0 - f * exp(-s[n].min(MOST) * c)).max(1e-6))
    }

    /// The azimuth in [-pi, pi] below which an order's light without absorption has the share `u`.
    #[inline]
    pub(super) fn sample(&self, row: Row, order: usize, u: f32) -> f32 {
        let (sign, u) = if u < 0.5 { (-1.0, 2.0 * u) } else { (1.0, 2.0 * u - 1.0) };
        let n = self.orders * (self.cells + 1);
        let at = |j: usize| {
            let (a, b) = (
                &self.nodes[row.first * n + j * self.orders + order],
                &self.nodes[row.second * n + j * self.orders + order],
            );
            [a[0] + row.t * (b[0] - a[0]), a[3] + row.t * (b[3] - a[3])]
        };
        let target = u * at(self.cells)[1];
        let (mut low, mut high) = (0, self.cells);
        while high - low > 1 {
            let middle = (low + high) / 2;
            if at(middle)[1] <= target { low = middle } else { high = middle }
        }
        let ([from, below], [to, above]) = (at(low), at(high));
        // Mass t (from + t (to - from) / 2) of the cell's whole is x.
        let x = if above > below { ((target - below) / (above - below)).clamp(0.0, 1.0) } else { 0.5 };
        let root = (from * from + x * (to * to - from * from)).max(0.0).sqrt();
        let t = if from + root > 0.0 { x * (from + to) / (from + root) } else { x };
        sign * (low as f32 + t.clamp(0.0, 1.0)) * (PI / self.cells as f32)
    }
}

/// The Gaussian of a width at the table's azimuths, of sum 1, odd in number.
fn kernel(width: f32, cells: usize) -> Vec<f64> {
    let step = std::f64::consts::PI / cells as f64;
    // Two linear interpolations, of the light into nodes and of the nodes, add step^2 / 6 each.
    let variance = f64::from(width).powi(2) - step * step / 3.0;
    let reach = ((6.0 * f64::from(width) / step).ceil() as usize).min(cells - 1);
    let mut kernel: Vec<f64> =
        (0..=2 * reach).map(|k| (k as f64 - reach as f64) * step).map(|x| (-0.5 * x * x / variance).exp()).collect();
    let sum: f64 = kernel.iter().sum();
    kernel.iter_mut().for_each(|k| *k /= sum);
    kernel
}
