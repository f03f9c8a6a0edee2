//! Quadrature around a target on walls beside a lossy medium.
//!
//! In a medium of wavenumber k with loss, the factor of the logarithm, `J0(k R)`, grows as `exp(Im k R)`
//! while the kernel decays: splitting it off along a wall ([`kernel`](crate::boundary::kernel)) cancels
//! digits, all of them if the wall is some tens of skin depths long. Here nothing is split off. A window chi,
//! 1 at the target and 0 some nodes away, cuts the integral over the parameter in two:
//!
//! ```text
//! integral K f = sum_j h (1 - chi) K f (t_j) + integral chi K f
//! ```
//!
//! The first integrand is smooth, as the nodes resolve the kernel at that distance or the loss has damped it.
//! The second uses a Gauss-Legendre rule, with panels short enough for the distance from the target and the
//! skin depth, and the trigonometric interpolant of f. The offsets of its points from the target are the same
//! at every node. So the interpolation is one real matrix, and the rows of all targets are one product with
//! it.
//!
//! Joints of graded outlines lie half-way between nodes; there panels end.
//!
//! The `1/R^2` of `ed` gives the kernel `r.n'/R^2` of the static double layer, which is smooth along a wall.
//! It is integrated at the nodes, as `r.n'` of points close to each other is a small difference of large
//! numbers.

use crate::C64;
use crate::boundary::entries::{COMPONENTS, Pair, Wavenumbers};
use crate::boundary::kernel::WallKernel;
use crate::boundary::lu::par;
use crate::scene::curve::{Curve, CurvePoint};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Power of the substitution `u = a x^p` on the panel that begins at the target: the error of the rule of N
/// points is `N^(-2 p)` for a logarithm.
const POWER: i32 = 5;
/// Maximum change of a kernel's phase (or decay) along a panel.
const PHASE: f64 = 6.0;
/// Decay beyond which a kernel counts as zero: exp(-40).
const DEAD: f64 = 40.0;

/// The rule around the nodes of one wall.
pub(crate) struct Vicinity {
    /// 1 - chi at a node, by its distance from the target in nodes.
    pub outside: Vec<f64>,
    /// Offsets of the parameter from the target.
    offsets: Vec<f64>,
    /// Weights, with chi.
    weights: Vec<f64>,
    /// Weight of a node's density in that at a point: `[point][node after the target]`.
    interpolation: Vec<f64>,
}

/// Exponent beta of the window, whose jump at both ends is exp(-beta).
pub(crate) fn steepness(tolerance: f64) -> f64 {
    (100.0 / tolerance).ln()
}

/// Number of nodes from the target to the end of the window. The Fourier transform of chi falls to exp(-beta)
/// at `2 beta / width`. This must be within the gap between the kernel's and the density's waves and the
/// nodes' 2 pi: 0.4 of it at 3.4 nodes per wavelength.
pub(crate) fn width_nodes(tolerance: f64) -> f64 {
    (2.0 * steepness(tolerance) / (0.4 * 2.0 * PI)).ceil()
}

/// Points and weights on [-1, 1].
fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    (0..n)
        .map(|j| {
            let mut x = (PI * (j as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..8 {
                let (mut last, mut this) = (0.0, 1.0);
                for k in 0..n {
                    let k = k as f64;
                    (last, this) = (this, ((2.0 * k + 1.0) * x * this - k * last) / (k + 1.0));
                }
                slope = n as f64 * (x * this - last) / (x * x - 1.0);
                x -= this / slope;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// `chi` at a distance, in units of its end: the integral of `exp(beta sqrt(1 - x^2))` from there to the end,
/// over the whole integral. No other bump has a Fourier transform that falls much faster (Barnett, Magland
/// and af Klinteberg 2019).
fn window(beta: f64, rule: &[(f64, f64)], distance: f64) -> f64 {
    if distance >= 1.0 {
        return 0.0;
    }
    let bump = |x: f64| (beta * ((1.0 - x * x).max(0.0).sqrt() - 1.0)).exp();
    let tail = |from: f64| {
        let half = 0.5 * (1.0 - from);
        rule.iter().map(|(x, w)| half * w * bump(from + half * (x + 1.0))).sum::<f64>()
    };
    // Half of the bump lies on either side of its middle.
    let (half, from) = (tail(0.0), 2.0 * distance - 1.0);
    if from < 0.0 { 1.0 - 0.5 * tail(-from) / half } else { 0.5 * tail(from) / half }
}

impl Vicinity {
    /// The rule for a wall between media of transverse wavenumbers `kappas` [1/um].
    pub fn new(curve: &Curve, kappas: [C64; 2], tolerance: f64) -> Self {
        let n = curve.nodes.len();
        let h = curve.step();
        let beta = steepness(tolerance);
        let fine = gauss_legendre(64);
        let width = width_nodes(tolerance);
        // If the window would overlap itself, it covers the whole wall.
        let whole = 2.0 * width >= n as f64;
        let end = if whole { PI } else { width * h };
        let chi = |u: f64| if whole { 1.0 } else { window(beta, &fine, u / end) };
        let fastest = curve.nodes.iter().map(|p| p.speed).fold(0.0, f64::max);
        // Longest panel that starts at u: the fastest speed counts, except those at which the kernel counts
        // as zero there.
        let longest = |u: f64| {
            let each = kappas.map(|k| PHASE / (k.norm() * fastest.min(DEAD / (k.im * u).max(1e-300))));
            each[0].min(each[1]).min(u)
        };
        let steepest = kappas[0].norm().max(kappas[1].norm()) * fastest;
        let first = (0.125 * h).min(1.0 / steepest);
        let count = (5.0 - 0.6 * tolerance.log10()).ceil() as usize;
        let mut half_rule: Vec<(f64, f64)> = gauss_legendre(2 * count + 4)
            .into_iter()
            .map(|(x, w)| {
                let x = 0.5 * (x + 1.0);
                (first * x.powi(POWER), 0.5 * w * first * f64::from(POWER) * x.powi(POWER - 1))
            })
            .collect();
        let panel = gauss_legendre(count);
        let mut start = first;
        while start < end * (1.0 - 1e-12) {
            // Joints: odd multiples of half a step.
            let joint = h * ((start / h + 0.5 + 1e-9).floor() + 0.5);
            let limit = joint.min(end);
            let pieces = ((limit - start) / longest(start)).ceil().max(1.0);
            let stop = if pieces > 1.0 { start + longest(start).min(0.5 * (limit - start)) } else { limit };
            let half = 0.5 * (stop - start);
            half_rule.extend(panel.iter().map(|(x, w)| (start + half * (x + 1.0), half * w)));
            start = stop;
        }
        let (mut offsets, mut weights) = (Vec::new(), Vec::new());
        for (u, w) in half_rule {
            let w = w * chi(u);
            offsets.extend([u, -u]);
            weights.extend([w, w]);
        }
        let mut interpolation = vec![0.0; n * offsets.len()];
        interpolation.par_chunks_mut(n).zip(&offsets).for_each(|(row, &u)| {
            // Periodic sinc of n nodes: sin(n u / 2) cot(u / 2) / n, whose sine alternates from node to node.
            let sine = (0.5 * n as f64 * u).sin() / n as f64;
            for (j, out) in row.iter_mut().enumerate() {
                let half = 0.5 * (u - j as f64 * h);
                let s = half.sin();
                *out = if s.abs() < 1e-13 {
                    1.0
                } else {
                    (if j.is_multiple_of(2) { sine } else { -sine }) * half.cos() / s
                };
            }
        });
        let outside = (0..n).map(|j| 1.0 - chi(h * j.min(n - j) as f64)).collect();
        Self { outside, offsets, weights, interpolation }
    }

    /// The window's part of the rows of some targets, given by their node on the wall:
    /// `[target][pair of components][real, imaginary][node after the target]`, pairs `(to, from)` as in
    /// `pairs`.
    pub fn rows(
        &self,
        wavenumbers: &Wavenumbers,
        kernel: &WallKernel,
        curve: &Curve,
        targets: &[usize],
        pairs: &[(usize, usize)],
    ) -> Vec<f64> {
        let (n, points) = (curve.nodes.len(), self.offsets.len());
        let each = 2 * pairs.len();
        let mut values = vec![0.0; points * each * targets.len()];
        values.par_chunks_mut(points * each).zip(targets).for_each(|(values, &target)| {
            let (x, t): (&CurvePoint, f64) = (&curve.nodes[target], curve.parameter(target));
            for (q, (u, w)) in self.offsets.iter().zip(&self.weights).enumerate() {
                let y = curve.point(t + u);
                let pair = Pair::new(x, &y);
                // The point equals the target in floating point; its weight is negligible.
                if pair.r == 0.0 {
                    continue;
                }
                let radial = kernel.without_pole(pair.r, w * y.speed);
                let entries = wavenumbers.regular(&radial, &pair);
                for (k, &(to, from)) in pairs.iter().enumerate() {
                    values[2 * k * points + q] = entries[to][from].re;
                    values[(2 * k + 1) * points + q] = entries[to][from].im;
                }
            }
        });
        let columns = each * targets.len();
        let mut rows = vec![0.0; n * columns];
        matmul(
            MatMut::from_column_major_slice_mut(&mut rows, n, columns),
            Accum::Replace,
            MatRef::from_column_major_slice(&self.interpolation, n, points),
            MatRef::from_column_major_slice(&values, points, columns),
            1.0,
            par(),
        );
        rows
    }
}

/// Pairs `(to, from)` in the parts of the equations.
pub(crate) fn pairs_of(parts: &[&'static [usize]]) -> Vec<(usize, usize)> {
    let mut pairs = Vec::with_capacity(COMPONENTS * COMPONENTS);
    for c in parts {
        pairs.extend(c.iter().flat_map(|&to| c.iter().map(move |&from| (to, from))));
    }
    pairs
}
