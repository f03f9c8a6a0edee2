//! Edge lobes at run time: bandwidths interpolated for N wavelengths side by side, the lobe's value, density and sampling.

use super::kernel::{amplitudes, disc_point, root_width, shape, sin_cos};
use crate::EdgeLobes;
use crate::asg::MU_MIN;
use crate::edge::EDGE_MU_MAX;
use crate::simd::{exp2, fma, max, min};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2};
use std::f64::consts::LOG2_E;

/// [`EdgeLobes`] laid out for the kernels: f32, bandwidths in the units of `layout.rs`.
#[derive(Clone, Debug)]
pub(super) struct EdgeTables {
    radius_um: f32,
    lambda: Axis,
    inside: Axis,
    /// `[L][E][2]`.
    nodes: Vec<[f32; 2]>,
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

    /// Cell and fraction, clamped to the axis; not a number counts as its end.
    #[inline(always)]
    fn place(&self, x: f32) -> (usize, f32) {
        let t = max(min((x - self.first) * self.per, self.last), 0.0);
        let i = min(t.floor(), self.last - 1.0);
        (i as usize, t - i)
    }
}

/// A bandwidth in the units of the kernels.
fn stored(ln_mu: f64) -> f32 {
    (0.5 * (ln_mu * LOG2_E + LOG2_E.log2())) as f32
}

impl EdgeTables {
    /// From checked lobes.
    pub(super) fn new(d: &EdgeLobes) -> EdgeTables {
        EdgeTables {
            radius_um: d.radius_um as f32,
            lambda: Axis::new(&d.lambda_um),
            inside: Axis::new(&d.inside_um),
            nodes: d.ln_mu.as_chunks::<2>().0.iter().map(|m| m.map(stored)).collect(),
            bounds: (stored(MU_MIN.ln()), stored(EDGE_MU_MAX.ln())),
        }
    }

    /// The lobes at one incidence and N wavelengths. An angle that is not a number counts as pi/2, other numbers as the ends of their axes.
    #[inline(always)]
    pub(super) fn at<const FMA: bool, const N: usize>(
        &self,
        theta_i: f32,
        h_um: f32,
        lambda_um: &[f32; N],
    ) -> Edges<N> {
        let theta = max(min(theta_i, FRAC_PI_2), -FRAC_PI_2);
        let (e, fe) = self.inside.place(self.radius_um - h_um.abs());
        let per_row = self.inside.last as usize + 1;
        let (mut s1, mut s2) = ([0.0; N], [0.0; N]);
        for k in 0..N {
            let (l, fl) = self.lambda.place(lambda_um[k]);
            let row = |l: usize| self.nodes.get(l * per_row + e..).and_then(|x| x.first_chunk::<2>());
            let (Some([a, b]), Some([c, d])) = (row(l), row(l + 1)) else { continue };
            let mix = |i: usize| {
                let (low, high) = (a[i] + fe * (b[i] - a[i]), c[i] + fe * (d[i] - c[i]));
                low + fl * (high - low)
            };
            (s1[k], s2[k]) = (mix(0), mix(1));
        }
        let (mut norm, mut amplitude) = ([0.0; N], [0.0; N]);
        for k in 0..N {
            s1[k] = root_width::<FMA>(s1[k], self.bounds);
            s2[k] = root_width::<FMA>(s2[k], self.bounds);
            (norm[k], amplitude[k]) = amplitudes::<FMA>(s1[k], s2[k]);
        }
        Edges { theta: sin_cos::<FMA>(theta * FRAC_1_PI), s1, s2, norm, amplitude }
    }
}

/// Edge lobes of energy 1 at N wavelengths.
#[derive(Clone, Copy)]
pub(super) struct Edges<const N: usize> {
    /// Sine and cosine of theta_i.
    theta: (f32, f32),
    s1: [f32; N],
    s2: [f32; N],
    norm: [f32; N],
    amplitude: [f32; N],
}

impl<const N: usize> Edges<N> {
    /// Components along the lobe's axes: x, `(0, -sin, cos)` and the forward direction `(0, -cos, -sin)`.
    #[inline(always)]
    fn project<const FMA: bool>(&self, wo: [f32; 3]) -> [f32; 3] {
        let (s, c) = self.theta;
        [wo[0], fma::<FMA>(c, wo[2], -s * wo[1]), fma::<FMA>(-c, wo[1], -s * wo[2])]
    }

    /// Values [1/sr] in direction `wo`, of energy 1.
    #[inline(always)]
    pub(super) fn eval<const FMA: bool>(&self, wo: [f32; 3]) -> [f32; N] {
        let [u, w, cz] = self.project::<FMA>(wo);
        let mut value = [0.0; N];
        for k in 0..N {
            let (u, w) = (self.s1[k] * u, self.s2[k] * w);
            value[k] = shape::<FMA>(fma::<FMA>(u, u, w * w), cz) * self.amplitude[k];
        }
        value
    }

    /// Values, and the mean over the wavelengths of the densities with which [`Edges::sample`] gives `wo`.
    #[inline(always)]
    pub(super) fn eval_pdf<const FMA: bool>(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        let [u, w, cz] = self.project::<FMA>(wo);
        let (mut value, mut density) = ([0.0; N], [0.0; N]);
        for k in 0..N {
            let (su, sw) = (self.s1[k] * u, self.s2[k] * w);
            let q = fma::<FMA>(su, su, sw * sw);
            let shape = shape::<FMA>(q, cz);
            let a = (q + 1e-30) / (fma::<FMA>(u, u, w * w) + 1e-30);
            value[k] = shape * self.amplitude[k];
            density[k] = shape * self.norm[k] / (1.0 - exp2::<FMA>(-a));
        }
        (value, density.iter().sum::<f32>() * (1.0 / N.max(1) as f32))
    }

    /// A direction: `v` in [0, 1) chooses the wavelength, `u` the place on its disc.
    #[inline(always)]
    pub(super) fn sample<const FMA: bool>(&self, v: f32, u: [f32; 2]) -> Option<[f32; 3]> {
        let k = ((v * N as f32) as usize).min(N.checked_sub(1)?);
        let [x, y, z] = disc_point::<FMA>(self.s1[k], self.s2[k], u[0], u[1]);
        let (s, c) = self.theta;
        Some([x, fma::<FMA>(-s, y, -c * z), fma::<FMA>(c, y, -s * z)])
    }
}
