//! Edge lobes at run time (Yu 2025, Eq. 18): bandwidths interpolated for several wavelengths side by side,
//! and the lobe's value, density and sampling.

use super::kernel::lobe::{amplitudes, disc_point, disc_share, norm, root_width, shape, sin_cos};
use crate::math::simd::{fma, max, min};
use crate::ply::EdgeLobes;
use crate::ply::asg::MU_MIN;
use crate::ply::data::edge_lobes::EDGE_MU_MAX;
use multiversion::{multiversion, target::target_cfg_f};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2};
use std::f64::consts::LOG2_E;

/// Wavelengths processed side by side: enough for the compiler to vectorize loops over them.
const LANES: usize = 8;

/// [`EdgeLobes`] laid out for the kernels: in f32, with bandwidths in the units of `layout.rs`.
#[derive(Clone, Debug)]
pub(super) struct EdgeTables {
    radius_um: f32,
    lambda: Axis,
    inside: Axis,
    /// `[E-1][L-1][2][4]`: at e and at the next e, mu1 and mu2 at lambda, then mu1 and mu2 at the next
    /// lambda.
    cells: Vec<[[f32; 4]; 2]>,
    /// `[E-1]`: minima of mu1 log2 e and mu2 log2 e over the cells.
    min_mu: Vec<[f32; 2]>,
    /// `[E-1]`: whether every lobe of the cells is [`NARROW`].
    narrow: Vec<bool>,
    bounds: (f32, f32),
}

/// A uniform axis: first node, nodes per unit, last index.
#[derive(Clone, Copy, Debug)]
struct Axis {
    first: f32,
    per: f32,
    last: f32,
}

impl Axis {
    fn new(nodes: &[f64]) -> Axis {
        let last = nodes.len() - 1;
        Axis { first: nodes[0] as f32, per: (last as f64 / (nodes[last] - nodes[0])) as f32, last: last as f32 }
    }

    /// The cell of [`Axis::place`], by truncation: `floor` is a function call on processors without SSE 4.
    #[inline(always)]
    fn cell(&self, x: f32) -> usize {
        max(min((x - self.first) * self.per, self.last - 1.0), 0.0) as i32 as usize
    }

    /// Cell and fraction of `x`, clamped to the axis. NaN gives an end of the axis.
    #[inline(always)]
    fn place(&self, x: f32) -> (usize, f32) {
        let t = max(min((x - self.first) * self.per, self.last), 0.0);
        let i = min(t.floor(), self.last - 1.0);
        (i as usize, t - i)
    }
}

/// A bandwidth in the units of the kernels: log2 of sqrt(mu log2 e).
fn stored(ln_mu: f64) -> f32 {
    (0.5 * (ln_mu * LOG2_E + LOG2_E.log2())) as f32
}

impl EdgeTables {
    /// The tables of checked lobes.
    pub(super) fn new(d: &EdgeLobes) -> EdgeTables {
        let (nodes_l, nodes_e) = (d.lambda_um.len(), d.inside_um.len());
        let node = |l: usize, e: usize| [0, 1].map(|c| stored(d.ln_mu[(l * nodes_e + e) * 2 + c]));
        let (mut cells, mut min_mu) = (Vec::new(), Vec::new());
        for e in 0..nodes_e - 1 {
            let row = |l: usize, e: usize| {
                let ([a, b], [c, d]) = (node(l, e), node(l + 1, e));
                [a, b, c, d]
            };
            cells.extend((0..nodes_l - 1).map(|l| [row(l, e), row(l, e + 1)]));
            let nodes = || (0..nodes_l).flat_map(|l| [node(l, e), node(l, e + 1)]);
            min_mu.push([0, 1].map(|c| (2.0 * nodes().map(|m| m[c]).fold(f32::INFINITY, f32::min)).exp2()));
        }
        let bounds = (stored(MU_MIN.ln()), stored(EDGE_MU_MAX.ln()));
        let (lambda, inside) = (Axis::new(&d.lambda_um), Axis::new(&d.inside_um));
        let narrow = min_mu.iter().map(|[a, b]| a.min(*b) >= NARROW).collect();
        EdgeTables { radius_um: d.radius_um as f32, lambda, inside, cells, min_mu, narrow, bounds }
    }

    /// Whether edge light is zero in directions with the component `across` the ply. This rejects most
    /// directions without trigonometry.
    #[inline]
    pub(super) fn dark(&self, h_um: f32, across: f32) -> bool {
        let e = self.inside.cell(self.radius_um - h_um.abs());
        self.min_mu.get(e).is_none_or(|min_mu| min_mu[0] * across * across > DARK)
    }

    /// Cell and fraction of an incidence. A NaN latitude becomes pi/2, a NaN offset the first node of the
    /// edge.
    #[inline(always)]
    fn at<const FMA: bool>(&self, theta_i: f32, h_um: f32) -> Edge<'_> {
        let theta = max(min(theta_i, FRAC_PI_2), -FRAC_PI_2);
        let (e, fraction) = self.inside.place(self.radius_um - h_um.abs());
        Edge { tables: self, theta: sin_cos::<FMA>(theta * FRAC_1_PI), e, fraction }
    }
}

/// log2 of the ratio of a lobe's peak to the value below which it is dark: the cutoff of [`shape`], with a
/// margin.
const DARK: f32 = 101.0;

/// mu log2 e from which on the part of a lobe beyond its hemisphere, exp(-mu), is below rounding.
const NARROW: f32 = 30.0;

/// The edge lobes of energy 1 at one incidence.
#[derive(Clone, Copy)]
struct Edge<'a> {
    tables: &'a EdgeTables,
    /// Sine and cosine of theta_i.
    theta: (f32, f32),
    /// Cell along e, and the fraction of the way through it.
    e: usize,
    fraction: f32,
}

impl Edge<'_> {
    /// Components along the lobe's axes: x, `(0, -sin, cos)` and the forward direction `(0, -cos, -sin)`.
    #[inline(always)]
    fn project<const FMA: bool>(&self, wo: [f32; 3]) -> [f32; 3] {
        let (s, c) = self.theta;
        [wo[0], fma::<FMA>(c, wo[2], -s * wo[1]), fma::<FMA>(-c, wo[1], -s * wo[2])]
    }

    /// sqrt(mu1 log2 e) and sqrt(mu2 log2 e) at the first W wavelengths.
    #[inline(always)]
    fn widths<const FMA: bool, const W: usize>(&self, lambda_um: &[f32]) -> ([f32; W], [f32; W]) {
        let t = self.tables;
        let per_row = t.lambda.last as usize;
        let (mut s1, mut s2) = ([0.0; W], [0.0; W]);
        for (k, lambda) in lambda_um.iter().enumerate().take(W) {
            let (l, fl) = t.lambda.place(*lambda);
            let Some([low, high]) = t.cells.get(self.e * per_row + l) else { continue };
            let mut m = [0.0; 4];
            for i in 0..4 {
                m[i] = fma::<FMA>(self.fraction, high[i] - low[i], low[i]);
            }
            (s1[k], s2[k]) = (fma::<FMA>(fl, m[2] - m[0], m[0]), fma::<FMA>(fl, m[3] - m[1], m[1]));
        }
        for k in 0..W {
            s1[k] = root_width::<FMA>(s1[k], t.bounds);
            s2[k] = root_width::<FMA>(s2[k], t.bounds);
        }
        (s1, s2)
    }

    /// Writes the values [1/sr] in direction `wo`, one for each wavelength. Returns the density with which
    /// [`Edge::sample`] samples `wo`, the mean over the wavelengths; 0 if `PDF` is false.
    #[inline(always)]
    fn eval<const FMA: bool, const PDF: bool>(&self, lambda_um: &[f32], wo: [f32; 3], values: &mut [f32]) -> f32 {
        values.fill(0.0);
        let [u, w, cz] = self.project::<FMA>(wo);
        let Some([min_mu1, min_mu2]) = self.tables.min_mu.get(self.e) else { return 0.0 };
        // Where the widest lobe is dark, all are; most directions are far from the lobe.
        if !(cz > 0.0 && fma::<FMA>(min_mu1 * u, u, min_mu2 * w * w) < DARK) {
            return 0.0;
        }
        if self.tables.narrow.get(self.e) == Some(&true) {
            self.values::<FMA, PDF, true>(lambda_um, [u, w, cz], values)
        } else {
            self.values::<FMA, PDF, false>(lambda_um, [u, w, cz], values)
        }
    }

    /// [`Edge::eval`] from the components of the direction. If `CLOSE`, all lobes are so narrow that value
    /// and density are the same and need no normalization.
    #[inline(always)]
    fn values<const FMA: bool, const PDF: bool, const CLOSE: bool>(
        &self,
        lambda_um: &[f32],
        [u, w, cz]: [f32; 3],
        values: &mut [f32],
    ) -> f32 {
        let mut pdf = 0.0;
        for (lambda_um, values) in lambda_um.chunks(LANES).zip(values.chunks_mut(LANES)) {
            let (s1, s2) = self.widths::<FMA, LANES>(lambda_um);
            let (mut value, mut density) = ([0.0; LANES], [0.0; LANES]);
            for k in 0..LANES {
                let (norm, amplitude) = if CLOSE {
                    let norm = norm(s1[k], s2[k]);
                    (norm, norm)
                } else {
                    amplitudes::<FMA>(s1[k], s2[k])
                };
                let (su, sw) = (s1[k] * u, s2[k] * w);
                let q = fma::<FMA>(su, su, sw * sw);
                let shape = shape::<FMA>(q, cz);
                value[k] = shape * amplitude;
                if PDF && CLOSE {
                    density[k] = value[k];
                } else if PDF {
                    let a = (q + 1e-30) / (fma::<FMA>(u, u, w * w) + 1e-30);
                    density[k] = shape * norm / disc_share::<FMA>(a);
                }
            }
            for (k, to) in values.iter_mut().enumerate().take(LANES) {
                *to = value[k];
                pdf += density[k];
            }
        }
        pdf * (1.0 / lambda_um.len().max(1) as f32)
    }

    /// Samples a direction: `v` in [0, 1) chooses the wavelength, `u` the point on the lobe's disc. `None`
    /// without wavelengths.
    #[inline(always)]
    fn sample<const FMA: bool>(&self, lambda_um: &[f32], v: f32, u: [f32; 2]) -> Option<[f32; 3]> {
        let count = lambda_um.len();
        let lambda = *lambda_um.get(((v * count as f32) as usize).min(count.checked_sub(1)?))?;
        let ([s1], [s2]) = self.widths::<FMA, 1>(&[lambda]);
        let [x, y, z] = disc_point::<FMA>(s1, s2, u[0], u[1]);
        let (s, c) = self.theta;
        Some([x, fma::<FMA>(-s, y, -c * z), fma::<FMA>(c, y, -s * z)])
    }
}

/// Values [1/sr] of edge light of energy 1, one for each wavelength.
#[inline]
pub(super) fn eval<const N: usize>(
    edge: &EdgeTables,
    theta_i: f32,
    h_um: f32,
    lambda_um: &[f32; N],
    wo: [f32; 3],
) -> [f32; N] {
    let mut values = [0.0; N];
    eval_into(edge, theta_i, h_um, lambda_um, wo, &mut values);
    values
}

/// [`eval`], and the density of [`sample`].
#[inline]
pub(super) fn eval_pdf<const N: usize>(
    edge: &EdgeTables,
    theta_i: f32,
    h_um: f32,
    lambda_um: &[f32; N],
    wo: [f32; 3],
) -> ([f32; N], f32) {
    let mut values = [0.0; N];
    let pdf = eval_pdf_into(edge, theta_i, h_um, lambda_um, wo, &mut values);
    (values, pdf)
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn eval_into(edge: &EdgeTables, theta_i: f32, h_um: f32, lambda_um: &[f32], wo: [f32; 3], values: &mut [f32]) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    edge.at::<FMA>(theta_i, h_um).eval::<FMA, false>(lambda_um, wo, values);
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn eval_pdf_into(
    edge: &EdgeTables,
    theta_i: f32,
    h_um: f32,
    lambda_um: &[f32],
    wo: [f32; 3],
    values: &mut [f32],
) -> f32 {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    edge.at::<FMA>(theta_i, h_um).eval::<FMA, true>(lambda_um, wo, values)
}

/// Samples a direction of edge light from three numbers in [0, 1), of which the first chooses the wavelength.
pub(super) fn sample(edge: &EdgeTables, theta_i: f32, h_um: f32, lambda_um: &[f32], u: [f32; 3]) -> Option<[f32; 3]> {
    edge.at::<false>(theta_i, h_um).sample::<false>(lambda_um, u[0], [u[1], u[2]])
}
