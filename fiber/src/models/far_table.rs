//! Far fields of a cylinder whose azimuths are spread by Gaussians, tabulated once for each fiber (Zinke
//! 2007, 9.2: "a two-dimensional lookup table with respect to theta_d and phi").
//!
//! The paper's table is for one absorption. Here a node stores the energy, without absorption, of the offsets
//! whose light leaves in its azimuth, distributed to a few chords c_k. The chords are Chebyshev points of the
//! range of c = cos gamma_t, which path lengths are proportional to, and an offset's energy is distributed to
//! them by the Lagrange polynomials of its c. With s = sigma 2 r / cos theta_t the light of order p is
//!
//! ```text
//! sum over k of E_k exp(-p s c_k)
//! ```
//!
//! which interpolates `exp(-p s c)` over c. For an index of 1.2 or more, where c varies by at most 0.45, four
//! chords approximate it to 3e-5 of the light at every absorption. For a smaller index, where c may lie
//! anywhere between 0.14 and 1, eight chords approximate it to 2e-5.
//!
//! Nodes are linear in azimuth and in `1 - sqrt(1 - 2 theta / pi)`, which spaces them by the root of the
//! distance from the pole: Fresnel's reflectance rises to 1 there, within 3 degrees at index 1.01. The
//! Gaussian is narrowed by the variance that linear interpolation adds. Sampling inverts the same
//! interpolation.

use crate::distributions::azimuthal::CrossSection;
use crate::distributions::fast::{exp, lanes};
use crate::distributions::longitudinal::Latitude;
use std::f32::consts::{FRAC_2_PI, FRAC_PI_2, PI};

/// Minimum width that is tabulated [rad]; a narrower one would take more than 40 MB.
pub(crate) const MIN_WIDTH: f32 = 0.05;
/// Maximum product of absorption and length; all light is absorbed well below it.
const MAX: f32 = 1e4;
/// Chords per vector, and maximum number of vectors of a table.
const FOUR: usize = 4;
const MAX_VECTORS: usize = 2;
/// Refractive index from which on four chords suffice.
const FEW_CHORDS: f32 = 1.2;

/// Transmission along one inner segment of a path, `[wavelength][vector][chord]`.
pub(crate) type Through<const N: usize> = [[[f32; FOUR]; MAX_VECTORS]; N];

/// The table of all orders of a fiber.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FarTable {
    orders: usize,
    cells: usize,
    rows: usize,
    /// Number of vectors of chords in use, 1 or 2.
    vectors: usize,
    chords: [[f32; FOUR]; MAX_VECTORS],
    /// `[row][azimuth][order][vector]`: energies [1/rad], at azimuths from 0 to pi.
    nodes: Vec<[f32; FOUR]>,
    /// `[row][azimuth][order]`: the integral from azimuth 0 of their sum over the chords.
    below: Vec<f32>,
    /// `[row][order][vector]`: energies over all azimuths, for two more orders.
    totals: Vec<[f32; FOUR]>,
    /// `[row]`: the sum of the last of these two orders and all that follow, as a [`Series`].
    series: Vec<Series>,
}

/// Sum of an order of energy 1 and all orders after it, at the transmittance T of an inner segment:
/// `sum over two reflectances f of share / (1 - f T)`. Reflectances and shares match four moments of
/// Fresnel's reflectance over the offsets, so without absorption the sum is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Series {
    /// 1 - f.
    passed: [f32; 2],
    share: [f32; 2],
}

/// A latitude in the table: two rows, and the weight of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Row {
    first: usize,
    second: usize,
    t: f32,
}

impl FarTable {
    /// The table of a fiber of index `eta`, for the azimuthal widths of its orders [rad], which are clamped
    /// to at least [`MIN_WIDTH`].
    pub(crate) fn new(eta: f32, widths: &[f32]) -> FarTable {
        let min_width = widths.iter().copied().fold(f32::INFINITY, f32::min).max(MIN_WIDTH);
        let cells = ((10.0 * PI / min_width).ceil() as usize).clamp(64, 640);
        let rows = ((12.0 / min_width).ceil() as usize).clamp(128, 224);
        let orders = widths.len();
        let vectors = if eta < FEW_CHORDS { 2 } else { 1 };
        let min_cos = f64::from((1.0 - 1.0 / (eta * eta)).max(0.0).sqrt());
        let count = vectors * FOUR;
        let chords: Vec<f64> = (0..count)
            .map(|k| (std::f64::consts::PI * (k as f64 + 0.5) / count as f64).cos())
            .map(|x| 0.5 * (1.0 + min_cos) + 0.5 * (1.0 - min_cos) * x)
            .collect();
        let mut table = FarTable {
            orders,
            cells,
            rows,
            vectors,
            chords: [[1.0; FOUR]; MAX_VECTORS],
            nodes: vec![[0.0; FOUR]; rows * (cells + 1) * orders * vectors],
            below: vec![0.0; rows * (cells + 1) * orders],
            totals: vec![[0.0; FOUR]; rows * (orders + 2) * vectors],
            series: vec![Series::default(); rows],
        };
        chords.iter().enumerate().for_each(|(k, c)| table.chords[k / FOUR][k % FOUR] = *c as f32);
        let kernels: Vec<Vec<f64>> = widths.iter().map(|w| kernel(w.max(MIN_WIDTH), cells)).collect();
        for row in 0..rows {
            let from_pole = 1.0 - row as f32 / (rows - 1) as f32;
            let theta = FRAC_PI_2 * (1.0 - from_pole * from_pole);
            let (sin, cos) = theta.sin_cos();
            let latitude = Latitude { sin, cos: cos.max(0.0) };
            table.fill(row, &CrossSection::at(eta, 1.0, latitude), &chords, &kernels);
        }
        table
    }

    fn fill(&mut self, row: usize, section: &CrossSection, chords: &[f64], kernels: &[Vec<f64>]) {
        let (cells, turn) = (self.cells, 2 * self.cells);
        let per_rad = cells as f64 / std::f64::consts::PI;
        let offsets = Offset::all(section, chords, 6 * cells);
        for order in 0..self.orders + 2 {
            let mut mass = vec![[0.0f64; FOUR * MAX_VECTORS]; turn];
            let mut total = [0.0; FOUR * MAX_VECTORS];
            for offset in &offsets {
                let a = offset.energy(order);
                (0..chords.len()).for_each(|k| total[k] += a * offset.shares[k]);
                if order >= self.orders {
                    continue;
                }
                let at = f64::from(section.turn(order as u32, offset.h_rel)) * per_rad;
                // The light at h and at -h, distributed to the two nodes around its azimuth.
                for at in [at, -at] {
                    let at = at.rem_euclid(turn as f64);
                    let (j, t) = (at as usize, at - at.floor());
                    for (j, part) in [(j, 1.0 - t), (j + 1, t)] {
                        let mass = &mut mass[j % turn];
                        (0..chords.len()).for_each(|k| mass[k] += 0.5 * part * a * offset.shares[k]);
                    }
                }
            }
            for vector in 0..self.vectors {
                self.totals[(row * (self.orders + 2) + order) * self.vectors + vector] =
                    lanes(|k| total[vector * FOUR + k] as f32);
            }
            if order >= self.orders {
                continue;
            }
            let kernel = &kernels[order];
            let reach = kernel.len() / 2;
            let (mut below, mut last) = (0.0, 0.0);
            for j in 0..=cells {
                let mut sums = [0.0; FOUR * MAX_VECTORS];
                for (k, weight) in kernel.iter().enumerate() {
                    let from = &mass[(j + turn + k - reach) % turn];
                    (0..chords.len()).for_each(|m| sums[m] += weight * from[m]);
                }
                let e = sums.iter().sum::<f64>() * per_rad;
                if j > 0 {
                    below += 0.5 * (last + e) / per_rad;
                }
                last = e;
                let node = (row * (cells + 1) + j) * self.orders + order;
                self.below[node] = below as f32;
                for vector in 0..self.vectors {
                    self.nodes[node * self.vectors + vector] = lanes(|k| (sums[vector * FOUR + k] * per_rad) as f32);
                }
            }
        }
        self.series[row] = Series::from_offsets(&offsets, self.orders + 1);
    }

    /// The row of a latitude [rad] of either sign.
    #[inline]
    pub(crate) fn row(&self, theta: f32) -> Row {
        let from_pole = (1.0 - FRAC_2_PI * theta.abs()).max(0.0).sqrt();
        let at = (1.0 - from_pole) * (self.rows - 1) as f32;
        let first = (at as usize).min(self.rows - 2);
        Row { first, second: first + 1, t: at - first as f32 }
    }

    /// The transmissions of the chords, for the product `s` of absorption and diameter at each wavelength.
    #[inline(always)]
    pub(crate) fn through<const N: usize>(&self, s: &[f32; N]) -> Through<N> {
        let mut through = [[[1.0; FOUR]; MAX_VECTORS]; N];
        for n in 0..N {
            let s = s[n].min(MAX);
            for vector in 0..self.vectors {
                through[n][vector] = lanes(|k| exp(-s * self.chords[vector][k]));
            }
        }
        through
    }

    /// Calls `visit` for each order with its light in the relative azimuth `phi`, in [-pi, pi], and with that
    /// light without absorption [1/rad].
    #[inline]
    pub(crate) fn each_order<const N: usize>(
        &self,
        row: Row,
        phi: f32,
        through: &Through<N>,
        mut visit: impl FnMut(usize, [f32; N], f32),
    ) {
        let at = (phi.abs() * (self.cells as f32 / PI)).min(self.cells as f32);
        let cell = (at as usize).min(self.cells - 1);
        let t = at - cell as f32;
        let (p, n) = (self.orders * self.vectors, self.orders * self.vectors * (self.cells + 1));
        let slice = |row: usize| &self.nodes[row * n + cell * p..][..2 * p];
        let (a, b) = (slice(row.first), slice(row.second));
        let weights = [(1.0 - row.t) * (1.0 - t), (1.0 - row.t) * t, row.t * (1.0 - t), row.t * t];
        self.each_light(
            self.orders,
            through,
            |at| {
                let corners = [&a[at], &a[p + at], &b[at], &b[p + at]];
                lanes(|m| {
                    corners[0][m] * weights[0]
                        + corners[1][m] * weights[1]
                        + corners[2][m] * weights[2]
                        + corners[3][m] * weights[3]
                })
            },
            &mut visit,
        );
    }

    /// Calls `visit` for each order with its light over all azimuths, and with that light without absorption.
    #[inline]
    pub(crate) fn each_total<const N: usize>(
        &self,
        row: Row,
        through: &Through<N>,
        mut visit: impl FnMut(usize, [f32; N], f32),
    ) {
        self.each_light(self.orders, through, |at| self.total(row, at), &mut visit);
    }

    /// Light of an order over all azimuths.
    #[inline]
    pub(crate) fn total_light<const N: usize>(&self, row: Row, order: usize, through: &Through<N>) -> [f32; N] {
        let mut light = [0.0; N];
        for v in 0..self.vectors {
            let shares = self.total(row, order * self.vectors + v);
            for n in 0..N {
                let mut part = shares;
                (0..order).for_each(|_| part = lanes(|k| part[k] * through[n][v][k]));
                light[n] += sum(part);
            }
        }
        lanes(|n| light[n].max(0.0))
    }

    /// Energies of the orders over all azimuths, without absorption; 0 beyond the tabulated orders.
    #[inline]
    pub(crate) fn energies<const P: usize>(&self, row: Row) -> [f32; P] {
        lanes(|order| {
            if order >= self.orders {
                return 0.0;
            }
            (0..self.vectors).map(|v| sum(self.total(row, order * self.vectors + v))).sum::<f32>().max(0.0)
        })
    }

    /// A vector of `totals`, interpolated between the rows.
    #[inline(always)]
    fn total(&self, row: Row, at: usize) -> [f32; FOUR] {
        let of = |row: usize| &self.totals[row * (self.orders + 2) * self.vectors + at];
        let (a, b) = (of(row.first), of(row.second));
        lanes(|m| a[m] + row.t * (b[m] - a[m]))
    }

    /// Calls `visit` for each order, whose energies `vector` returns, in sequence.
    #[inline(always)]
    fn each_light<const N: usize>(
        &self,
        orders: usize,
        through: &Through<N>,
        vector: impl Fn(usize) -> [f32; FOUR],
        visit: &mut impl FnMut(usize, [f32; N], f32),
    ) {
        let mut power = [[[1.0f32; FOUR]; MAX_VECTORS]; N];
        for order in 0..orders {
            let (mut light, mut energy) = ([0.0; N], 0.0);
            for v in 0..self.vectors {
                let shares = vector(order * self.vectors + v);
                energy += sum(shares);
                for n in 0..N {
                    light[n] += sum(lanes(|k| shares[k] * power[n][v][k]));
                    power[n][v] = lanes(|k| power[n][v][k] * through[n][v][k]);
                }
            }
            // Lagrange polynomials have both signs, so where there is almost no light, rounding may make it
            // negative.
            visit(order, lanes(|n| light[n].max(0.0)), energy.max(0.0));
        }
    }

    /// Light of the orders after the last separate one.
    #[inline]
    pub(crate) fn beyond<const N: usize>(&self, row: Row, through: &Through<N>) -> [f32; N] {
        let mut beyond = [0.0; N];
        let mut powers = [[[1.0; FOUR]; MAX_VECTORS]; N];
        for n in 0..N {
            for v in 0..self.vectors {
                let power = &mut powers[n][v];
                (0..self.orders).for_each(|_| *power = lanes(|k| power[k] * through[n][v][k]));
            }
        }
        for (at, weight) in [(row.first, 1.0 - row.t), (row.second, row.t)] {
            let of = |order: usize, v: usize| &self.totals[(at * (self.orders + 2) + order) * self.vectors + v];
            let series = &self.series[at];
            for n in 0..N {
                let (mut next, mut after, mut later, mut energy) = (0.0, 0.0, 0.0, 0.0);
                for v in 0..self.vectors {
                    let t = through[n][v];
                    let power = powers[n][v];
                    next += sum(lanes(|k| of(self.orders, v)[k] * power[k]));
                    after += sum(lanes(|k| of(self.orders + 1, v)[k] * power[k] * t[k]));
                    later += sum(lanes(|k| of(self.orders + 1, v)[k] * t[k]));
                    energy += sum(*of(self.orders + 1, v));
                }
                let t = if energy > 0.0 { (later / energy).clamp(0.0, 1.0) } else { 0.0 };
                beyond[n] += weight * (next.max(0.0) + after.max(0.0) * series.sum(t));
            }
        }
        beyond
    }

    /// The azimuth in [-pi, pi] below which the share `u` of an order's light without absorption lies.
    #[inline]
    pub(crate) fn sample(&self, row: Row, order: usize, u: f32) -> f32 {
        let (sign, u) = if u < 0.5 { (-1.0, 2.0 * u) } else { (1.0, 2.0 * u - 1.0) };
        let node = |row: usize, j: usize| (row * (self.cells + 1) + j) * self.orders + order;
        let below = |j: usize| {
            let (a, b) = (self.below[node(row.first, j)], self.below[node(row.second, j)]);
            a + row.t * (b - a)
        };
        let density = |j: usize| {
            let of = |row: usize| -> f32 {
                (0..self.vectors).map(|v| sum(self.nodes[node(row, j) * self.vectors + v])).sum()
            };
            let (a, b) = (of(row.first), of(row.second));
            (a + row.t * (b - a)).max(0.0)
        };
        let target = u * below(self.cells);
        let (mut low, mut high) = (0, self.cells);
        while high - low > 1 {
            let middle = (low + high) / 2;
            if below(middle) <= target { low = middle } else { high = middle }
        }
        let ([from, below], [to, above]) = ([density(low), below(low)], [density(high), below(high)]);
        // Solves t (from + t (to - from) / 2) = x times the cell's whole mass.
        let x = if above > below { ((target - below) / (above - below)).clamp(0.0, 1.0) } else { 0.5 };
        let root = (from * from + x * (to * to - from * from)).max(0.0).sqrt();
        let t = if from + root > 0.0 { x * (from + to) / (from + root) } else { x };
        sign * (low as f32 + t.clamp(0.0, 1.0)) * (PI / self.cells as f32)
    }
}

#[inline(always)]
fn sum([a, b, c, d]: [f32; FOUR]) -> f32 {
    (a + b) + (c + d)
}

/// An offset, as a sample of the uniform beam.
struct Offset {
    h_rel: f32,
    weight: f64,
    /// Fresnel's reflectance.
    reflectance: f64,
    /// Values of the Lagrange polynomials at its chord.
    shares: [f64; FOUR * MAX_VECTORS],
}

impl Offset {
    /// The midpoints of `count` steps in gamma.
    fn all(section: &CrossSection, chords: &[f64], count: usize) -> Vec<Offset> {
        let step = std::f64::consts::FRAC_PI_2 / count as f64;
        let gamma = |k: usize| (k as f64 + 0.5) * step;
        let all: f64 = (0..count).map(|k| gamma(k).cos()).sum();
        let offset = |k: usize| {
            let h_rel = gamma(k).sin() as f32;
            let c = f64::from(section.cos_t(h_rel));
            let lagrange = |k: usize| {
                let others = chords.iter().enumerate().filter(|(j, _)| *j != k);
                others.map(|(_, other)| (c - other) / (chords[k] - other)).product::<f64>()
            };
            Offset {
                h_rel,
                weight: gamma(k).cos() / all,
                reflectance: f64::from(section.path(h_rel).reflectance),
                shares: std::array::from_fn(|k| if k < chords.len() { lagrange(k) } else { 0.0 }),
            }
        };
        (0..count).map(offset).collect()
    }

    /// Energy of an order without absorption.
    fn energy(&self, order: usize) -> f64 {
        let f = self.reflectance;
        if order == 0 { self.weight * f } else { self.weight * (1.0 - f) * (1.0 - f) * f.powi(order as i32 - 1) }
    }
}

impl Series {
    /// The series of the orders from `order` on, where `order` is 1 or more.
    fn from_offsets(offsets: &[Offset], order: usize) -> Series {
        // Moments of 1 - f over the light that is still inside; those of f would lose their digits for f near
        // 1.
        let mut moments = [0.0; 4];
        for offset in offsets {
            let passed = 1.0 - offset.reflectance;
            let mut all = offset.weight * passed * offset.reflectance.powi(order as i32 - 1);
            for moment in &mut moments {
                *moment += all;
                all *= passed;
            }
        }
        let [all, first, second, third] = moments;
        if first <= 0.0 {
            return Series { passed: [1.0; 2], share: [0.0; 2] };
        }
        // Gauss quadrature with two points, from these moments.
        let mean = first / all;
        let variance = (second / all - mean * mean).max(0.0);
        if variance <= 1e-12 * mean * mean {
            return Series { passed: [mean as f32; 2], share: [(0.5 * mean * all / first) as f32; 2] };
        }
        let skew = third / all - 3.0 * mean * second / all + 2.0 * mean * mean * mean;
        let half = 0.5 * skew / variance;
        let root = (half * half + variance).sqrt();
        let [low, high] = [half - root, half + root];
        let passed = [mean + low, mean + high];
        let weight = [high / (high - low), -low / (high - low)];
        let share = |k: usize| (weight[k] * passed[k] * all / first) as f32;
        Series { passed: passed.map(|p| p as f32), share: [share(0), share(1)] }
    }

    #[inline]
    fn sum(&self, t: f32) -> f32 {
        // 1 - f T without cancellation for both near 1.
        let one = |k: usize| self.share[k] / (self.passed[k] + (1.0 - self.passed[k]) * (1.0 - t)).max(1e-9);
        one(0) + one(1)
    }
}

/// The Gaussian of a width at the table's azimuths, with sum 1 and an odd number of entries.
fn kernel(width: f32, cells: usize) -> Vec<f64> {
    let step = std::f64::consts::PI / cells as f64;
    // The two linear interpolations, of the light into nodes and between the nodes, add step^2 / 6 each.
    let variance = f64::from(width).powi(2) - step * step / 3.0;
    let reach = ((6.0 * f64::from(width) / step).ceil() as usize).min(cells - 1);
    let mut kernel: Vec<f64> =
        (0..=2 * reach).map(|k| (k as f64 - reach as f64) * step).map(|x| (-0.5 * x * x / variance).exp()).collect();
    let sum: f64 = kernel.iter().sum();
    kernel.iter_mut().for_each(|k| *k /= sum);
    kernel
}
