//! Skeleton of a body: a few directional points on its outer wall that represent all its sources and
//! receivers for other bodies.
//!
//! A body's radiation is a sum of monopoles, normal dipoles and tangential dipoles on its outer wall. Its
//! boundary equations need an arriving field's value, normal and tangential derivative there. Both maps are
//! one matrix, since Green's function is symmetric. Its numerical rank is little more than the number of
//! waves that fit around the wall, `2 k_rho r`, so an interpolative decomposition (Cheng, Gimbutas,
//! Martinsson and Rokhlin 2005) expresses it by `k` of its own rows and columns.
//!
//! The candidate rows and columns belong to the combined functional
//!
//! ```text
//! L = s (d_n / k_rho - i)
//! ```
//!
//! at points of the wall (s: root of a point's arc length). As a source it is Brakhage and Werner's combined
//! layer, as a receiver the impedance trace; either layer alone fails at some interior wavenumbers (single
//! and double layer alone need coefficients hundreds of times larger). With one kind of point, all
//! interactions have one kernel, `L_x L_y G`, in [`combined`].
//!
//! The tests are a circle around the body, which represents everything beyond it (Green), and the points of
//! other walls within the circle, as circumscribed circles may overlap. If another wall is so close that the
//! nodes do not resolve the kernel, finer points replace them in a smooth window. Densities are interpolated
//! to these points, and arriving fields are projected from them by the transposed matrix.

use crate::C64;
use crate::boundary::close::WINDOW_NODES;
use crate::boundary::kernel::MediumKernel;
use crate::scene::curve::{Curve, CurvePoint};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::{Accum, MatMut, MatRef, Par};
use num_complex::Complex32;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::borrow::Cow;
use std::f64::consts::{PI, TAU};

/// Number of the sketch's rows that a row of the test matrix is spread over.
const SPREAD: usize = 8;
/// Radius of the circle of tests over the body's, and an additional radius in wavelengths.
const CIRCLE: f64 = 1.3;
const CIRCLE_WAVES: f64 = 0.1;

/// A point that radiates and receives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Site {
    /// Position and normal.
    pub point: CurvePoint,
    /// s of the functional, root of the arc length [um^(1/2)].
    pub scale: f64,
}

/// Functionals of `G(x, y)` at a pair: `L_x` at the target with value, `d_n / k_rho` and `d_t / k_rho` at the
/// source.
#[inline(always)]
fn received(kernel: &MediumKernel, k_rho: f64, target: &Site, source: &CurvePoint) -> [C64; 3] {
    let ([nx, ny], [sx, sy]) = (target.point.normal, source.normal);
    let (dx, dy) = (target.point.at[0] - source.at[0], target.point.at[1] - source.at[1]);
    let rho = dx * dx + dy * dy;
    let (g, d) = kernel.eval(rho.sqrt());
    let per_k = 1.0 / k_rho;
    let rn = dx * nx + dy * ny;
    let rns = dx * sx + dy * sy;
    let rts = dy * sx - dx * sy;
    let nn = nx * sx + ny * sy;
    // n.t'
    let nt = ny * sx - nx * sy;
    // G'' = -k^2 G - D, so that d/dR of D, over R, is -(k^2 G + 2 D)/R^2.
    let bend = (g * (k_rho * k_rho) + d * 2.0) / rho;
    let s = target.scale;
    let along = d * (s * per_k);
    let minus_i = |c: C64| C64::new(c.im, -c.re);
    [
        along * rn + minus_i(g) * s,
        ((bend * rns * rn - d * nn) * per_k - minus_i(d) * rns) * (s * per_k),
        ((bend * rts * rn - d * nt) * per_k - minus_i(d) * rts) * (s * per_k),
    ]
}

/// The exterior between all bodies.
#[derive(Clone, Copy)]
pub(crate) struct Exterior<'a> {
    pub kernel: &'a MediumKernel,
    pub k_rho: f64,
}

impl Exterior<'_> {
    /// Value that a site receives from a unit at another.
    pub(crate) fn between(&self, target: &Site, source: &Site) -> C64 {
        combined(self.kernel, self.k_rho, target, source)
    }
}

/// `L_x L_y G` for two sites.
#[inline(always)]
pub(crate) fn combined(kernel: &MediumKernel, k_rho: f64, target: &Site, source: &Site) -> C64 {
    let [value, normal, _] = received(kernel, k_rho, target, &source.point);
    (normal + C64::new(value.im, -value.re)) * source.scale
}

/// Candidate points of a wall for interaction with other walls, and the map of densities from its nodes to
/// them.
pub(crate) struct Candidates {
    /// The points, in the frame of their curve.
    pub points: Vec<CurvePoint>,
    /// Root of each point's arc length [um^(1/2)].
    pub scales: Vec<f64>,
    /// Nodes among them, with their weights outside the window; they come first.
    retained: Vec<(u32, f64)>,
    /// Weights of the nodes in the others, `[point][node]`.
    fine: Vec<f64>,
    nodes: usize,
}

impl Candidates {
    /// The nodes of `curve`, finer by `refinement` around the parameters `close`.
    pub(crate) fn new(curve: &Curve, close: &mut [f64], refinement: usize) -> Self {
        let n = curve.nodes.len();
        let h = curve.step();
        let zones = if close.is_empty() { Vec::new() } else { zones(close, h) };
        let whole = zones.iter().map(|(a, b)| (b - a) / h + 2.0 * WINDOW_NODES).sum::<f64>() > n as f64 - WINDOW_NODES;
        let window = |t: f64| {
            if whole {
                return 1.0;
            }
            let outside: f64 = zones
                .iter()
                .map(|(a, b)| {
                    let off = (t - 0.5 * (a + b) + PI).rem_euclid(TAU) - PI;
                    let d = (off.abs() - 0.5 * (b - a)).max(0.0) / h;
                    1.0 - (-(d / WINDOW_NODES).powi(8)).exp()
                })
                .product();
            1.0 - outside
        };
        let mut made =
            Self { points: Vec::new(), scales: Vec::new(), retained: Vec::new(), fine: Vec::new(), nodes: n };
        for (j, node) in curve.nodes.iter().enumerate() {
            let remaining = 1.0 - if zones.is_empty() { 0.0 } else { window(curve.parameter(j)) };
            if remaining > 1e-16 {
                made.retained.push((j as u32, remaining));
                made.points.push(*node);
                made.scales.push((h * node.speed).sqrt());
            }
        }
        if zones.is_empty() {
            return made;
        }
        let count = n * refinement;
        let step = TAU / count as f64;
        for k in 0..count {
            let t = step * (k as f64 + 0.5);
            let share = window(t);
            if share < 1e-16 {
                continue;
            }
            let point = curve.point(t);
            made.scales.push((step * point.speed).sqrt());
            made.points.push(point);
            // Periodic sinc of n nodes: sin(n u / 2) cot(u / 2) / n, whose sine alternates from node to node.
            let u0 = t - curve.parameter(0);
            let sine = share / refinement as f64 * (0.5 * n as f64 * u0).sin() / n as f64;
            for j in 0..n {
                let half = 0.5 * (u0 - j as f64 * h);
                let s = half.sin();
                made.fine.push(if s.abs() < 1e-13 {
                    share / refinement as f64
                } else {
                    (if j.is_multiple_of(2) { sine } else { -sine }) * half.cos() / s
                });
            }
        }
        made
    }

    /// From coefficients of the points to those of the nodes: `x` has `rows` rows and one column per point,
    /// column after column.
    fn fold(&self, x: &[C64], rows: usize) -> Vec<C64> {
        let mut out = vec![C64::ZERO; rows * self.nodes];
        let (retained, fine) = x.split_at(rows * self.retained.len());
        if !self.fine.is_empty() {
            let weights: Vec<C64> = self.fine.iter().map(|&w| C64::new(w, 0.0)).collect();
            let count = weights.len() / self.nodes;
            matmul(
                MatMut::from_column_major_slice_mut(&mut out, rows, self.nodes),
                Accum::Replace,
                MatRef::from_column_major_slice(fine, rows, count),
                MatRef::from_row_major_slice(&weights, count, self.nodes),
                C64::ONE,
                Par::Seq,
            );
        }
        for (&(j, remaining), column) in self.retained.iter().zip(retained.chunks(rows)) {
            for (out, value) in out[j as usize * rows..].iter_mut().zip(column) {
                *out += value * remaining;
            }
        }
        out
    }
}

/// Intervals of parameters, apart by more than two windows, on an axis cut in the longest gap.
fn zones(close: &mut [f64], h: f64) -> Vec<(f64, f64)> {
    for t in close.iter_mut() {
        *t = t.rem_euclid(TAU);
    }
    close.sort_by(f64::total_cmp);
    let n = close.len();
    let gap = |j: usize| (close[(j + 1) % n] - close[j]).rem_euclid(TAU);
    let cut = (0..n).max_by(|&a, &b| gap(a).total_cmp(&gap(b))).unwrap_or(0);
    let mut zones: Vec<(f64, f64)> = Vec::new();
    for k in 1..=n {
        let at = (cut + k) % n;
        let t = close[at] + if cut + k >= n { TAU } else { 0.0 };
        match zones.last_mut() {
            Some((_, end)) if t - *end < 2.0 * WINDOW_NODES * h => *end = t,
            _ => zones.push((t, t)),
        }
    }
    zones
}

/// The chosen sites of a body, and the coefficients of all sources and receivers on its outer wall.
pub(crate) struct Skeleton {
    /// The sites, in the scene.
    pub sites: Vec<Site>,
    /// Coefficients of a value (or monopole), a `d_n / k_rho` and a `d_t / k_rho` at each node:
    /// `[node][site]`; the last are empty at normal incidence.
    pub value: Coefficients,
    pub normal: Coefficients,
    pub tangential: Coefficients,
}

/// Minimum tolerance of a skeleton whose coefficients are held in single precision: its rounding, 6e-8, is
/// well below.
const SINGLE: f64 = 1e-6;

/// Coefficients of a skeleton, in the precision for its tolerance: they are most of a body's memory.
pub(crate) enum Coefficients {
    Single(Vec<Complex32>),
    Double(Vec<C64>),
}

impl Coefficients {
    fn new(values: Vec<C64>, tolerance: f64) -> Self {
        if tolerance < SINGLE {
            return Self::Double(values);
        }
        Self::Single(values.into_iter().map(|c| Complex32::new(c.re as f32, c.im as f32)).collect())
    }

    /// In double precision.
    pub fn wide(&self) -> Cow<'_, [C64]> {
        match self {
            Self::Double(values) => Cow::Borrowed(values),
            Self::Single(values) => {
                values.iter().map(|c| C64::new(f64::from(c.re), f64::from(c.im))).collect::<Vec<C64>>().into()
            }
        }
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        match self {
            Self::Double(values) => size_of_val(values.as_slice()),
            Self::Single(values) => size_of_val(values.as_slice()),
        }
    }
}

/// Points on a circle around `points` that represent everything beyond it, and its center and radius.
pub(crate) fn circle(points: &[CurvePoint], k_rho: f64, tolerance: f64) -> (Vec<Site>, [f64; 2], f64) {
    let mut center = [0.0; 2];
    for k in 0..2 {
        let (low, high) = points.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.at[k]), h.max(p.at[k])));
        center[k] = 0.5 * (low + high);
    }
    let inner = points.iter().map(|p| (p.at[0] - center[0]).hypot(p.at[1] - center[1])).fold(0.0, f64::max);
    let radius = CIRCLE * inner + CIRCLE_WAVES * TAU / k_rho;
    // Orders up to the decay of the body's, and as many as the circle's own field has, to avoid aliasing.
    let digits = 2.0 - tolerance.log10();
    let order = |x: f64| x + 1.8 * digits.powf(2.0 / 3.0) * x.max(1.0).cbrt() + digits;
    let count = (order(k_rho * inner) + order(k_rho * radius)).ceil() as usize + 2;
    let scale = (TAU * radius / count as f64).sqrt();
    let sites = (0..count)
        .map(|j| {
            let (sin, cos) = (TAU * j as f64 / count as f64).sin_cos();
            let at = [center[0] + radius * cos, center[1] + radius * sin];
            Site { point: CurvePoint { at, normal: [cos, sin], speed: radius, curvature: 1.0 / radius }, scale }
        })
        .collect();
    (sites, center, radius)
}

impl Skeleton {
    /// Chooses sites among `candidates` (whose points are in the scene) so that fields at the `tests` have an
    /// error of about `tolerance`. Tangential sources are omitted unless the incidence is `oblique`.
    pub(crate) fn new(
        kernel: &MediumKernel,
        k_rho: f64,
        candidates: &Candidates,
        tests: &[Site],
        oblique: bool,
        tolerance: f64,
        seed: u64,
    ) -> Self {
        let m = candidates.points.len();
        let mut rows = (0.7 * m as f64 + 32.0) as usize / LANES * LANES;
        loop {
            let [value, normal, tangential] = sketch(kernel, k_rho, candidates, tests, rows, seed);
            let mut own: Vec<C64> = Vec::with_capacity(rows * m);
            for (j, scale) in candidates.scales.iter().enumerate() {
                let columns = normal[j * rows..][..rows].iter().zip(&value[j * rows..][..rows]);
                own.extend(columns.map(|(n, v)| (n + C64::new(v.im, -v.re)) * scale));
            }
            let picked = pick(&own, rows, tolerance);
            let k = picked.pivots.len();
            // If all rows were in use, the sketch may have hidden some of the rank.
            if k + 16 > rows && rows < m {
                rows = (m + 32).next_multiple_of(LANES);
                continue;
            }
            let sites = picked
                .pivots
                .iter()
                .map(|&j| Site { point: candidates.points[j], scale: candidates.scales[j] })
                .collect();
            let coefficients =
                |columns: &[C64]| Coefficients::new(candidates.fold(&picked.coefficients(columns, rows), k), tolerance);
            return Self {
                sites,
                value: coefficients(&value),
                normal: coefficients(&normal),
                tangential: if oblique { coefficients(&tangential) } else { Coefficients::Double(Vec::new()) },
            };
        }
    }
}

/// Fields at the tests from value, normal and tangential sources at the candidates, each row added with
/// random signs to a few of `rows` sums.
fn sketch(
    kernel: &MediumKernel,
    k_rho: f64,
    candidates: &Candidates,
    tests: &[Site],
    rows: usize,
    seed: u64,
) -> [Vec<C64>; 3] {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let spread: Vec<[(u32, f64); SPREAD]> = tests
        .iter()
        .map(|_| {
            std::array::from_fn(|_| {
                let row = rng.random_range(0..rows as u32);
                (row, if rng.random::<bool>() { 1.0 } else { -1.0 })
            })
        })
        .collect();
    let mut out = [(); 3].map(|()| vec![C64::ZERO; rows * candidates.points.len()]);
    let [value, normal, tangential] = &mut out;
    let columns = value.chunks_mut(rows).zip(normal.chunks_mut(rows)).zip(tangential.chunks_mut(rows));
    for (((value, normal), tangential), point) in columns.zip(&candidates.points) {
        for (test, spread) in tests.iter().zip(&spread) {
            let [v, n, t] = received(kernel, k_rho, test, point);
            for &(row, sign) in spread {
                let row = row as usize;
                value[row] += v * sign;
                normal[row] += n * sign;
                tangential[row] += t * sign;
            }
        }
    }
    out
}

/// Columns chosen by a pivoted QR decomposition.
struct Picked {
    pivots: Vec<usize>,
    /// Orthonormal columns, and the triangle R of the pivots, `k * k` column after column.
    q: Vec<C64>,
    r: Vec<C64>,
}

/// Lanes that sums over a column are split into, so that they run in vector registers.
const LANES: usize = 8;

/// `q^H c` of columns that hold their real parts first, then their imaginary parts.
fn project(q: &[f64], c: &[f64]) -> C64 {
    let half = q.len() / 2;
    let ((qr, qi), (cr, ci)) = (q.split_at(half), c.split_at(half));
    let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
    let chunks = |v| <[f64]>::chunks_exact(v, LANES);
    for (((qr, qi), cr), ci) in chunks(qr).zip(chunks(qi)).zip(chunks(cr)).zip(chunks(ci)) {
        for k in 0..LANES {
            re[k] += qr[k] * cr[k] + qi[k] * ci[k];
            im[k] += qr[k] * ci[k] - qi[k] * cr[k];
        }
    }
    C64::new(re.iter().sum(), im.iter().sum())
}

/// `c -= along q`; returns `|c|^2`.
fn subtract(c: &mut [f64], along: C64, q: &[f64]) -> f64 {
    let half = q.len() / 2;
    let ((qr, qi), (cr, ci)) = (q.split_at(half), c.split_at_mut(half));
    let mut sum = [0.0; LANES];
    let chunks = |v| <[f64]>::chunks_exact(v, LANES);
    for (((qr, qi), cr), ci) in
        chunks(qr).zip(chunks(qi)).zip(cr.chunks_exact_mut(LANES)).zip(ci.chunks_exact_mut(LANES))
    {
        for k in 0..LANES {
            cr[k] -= along.re * qr[k] - along.im * qi[k];
            ci[k] -= along.re * qi[k] + along.im * qr[k];
            sum[k] += cr[k] * cr[k] + ci[k] * ci[k];
        }
    }
    sum.iter().sum()
}

/// Gram-Schmidt with column pivots, until the largest remaining column is below `tolerance` of the first.
/// `rows` is a multiple of [`LANES`].
fn pick(columns: &[C64], rows: usize, tolerance: f64) -> Picked {
    let mut split: Vec<f64> = Vec::with_capacity(2 * columns.len());
    for column in columns.chunks(rows) {
        split.extend(column.iter().map(|c| c.re));
        split.extend(column.iter().map(|c| c.im));
    }
    let length = 2 * rows;
    let mut sizes: Vec<f64> = split.chunks(length).map(|c| c.iter().map(|v| v * v).sum()).collect();
    let count = sizes.len();
    let mut order: Vec<usize> = (0..count).collect();
    let first = sizes.iter().copied().fold(0.0, f64::max);
    let mut q: Vec<f64> = Vec::new();
    let mut projections: Vec<Vec<C64>> = Vec::new();
    for step in 0..rows.min(count) {
        let (best, size) = (step..count)
            .map(|j| (j, sizes[order[j]]))
            .fold((step, -1.0), |best, this| if this.1 > best.1 { this } else { best });
        if size <= tolerance * tolerance * first {
            break;
        }
        order.swap(step, best);
        let pivot = order[step];
        let mut direction = split[pivot * length..][..length].to_vec();
        let mut size = size;
        // Orthogonalize again against the earlier ones, as the running remainders lose orthogonality.
        for earlier in q.chunks(length) {
            let along = project(earlier, &direction);
            size = subtract(&mut direction, along, earlier);
        }
        let size = size.sqrt();
        for d in &mut direction {
            *d /= size;
        }
        let mut row = vec![C64::ZERO; count];
        row[pivot] = C64::new(size, 0.0);
        for &j in &order[step + 1..] {
            let column = &mut split[j * length..][..length];
            row[j] = project(&direction, column);
            sizes[j] = subtract(column, row[j], &direction);
        }
        projections.push(row);
        q.extend(direction);
    }
    let k = projections.len();
    let pivots = order[..k].to_vec();
    let mut r = vec![C64::ZERO; k * k];
    for (column, &pivot) in pivots.iter().enumerate() {
        for row in 0..=column {
            r[column * k + row] = projections[row][pivot];
        }
    }
    let joined = |c: &[f64]| -> Vec<C64> { (0..rows).map(|j| C64::new(c[j], c[rows + j])).collect() };
    Picked { pivots, q: q.chunks(length).flat_map(joined).collect(), r }
}

impl Picked {
    /// `R^-1 Q^H columns`: coefficients of the columns by the pivots, k per column.
    fn coefficients(&self, columns: &[C64], rows: usize) -> Vec<C64> {
        let k = self.pivots.len();
        let count = columns.len() / rows;
        let mut out = vec![C64::ZERO; k * count];
        matmul(
            MatMut::from_column_major_slice_mut(&mut out, k, count),
            Accum::Replace,
            MatRef::from_column_major_slice(&self.q, rows, k).adjoint(),
            MatRef::from_column_major_slice(columns, rows, count),
            C64::ONE,
            Par::Seq,
        );
        solve_upper_triangular_in_place(
            MatRef::from_column_major_slice(&self.r, k, k),
            MatMut::from_column_major_slice_mut(&mut out, k, count),
            Par::Seq,
        );
        out
    }
}
