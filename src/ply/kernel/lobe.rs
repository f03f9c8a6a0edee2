//! The arithmetic of one anisotropic spherical Gaussian (Yu 2025, Eq. 4; [`crate::ply::asg`]): axes,
//! amplitude, value in a direction, sampling. Loops over lanes call these functions.

use crate::math::simd::{exp2, exp2_within, fma, ln, max, min, signed, sin_cos_half_turns};
use std::f32::consts::{LN_2, LOG2_E, PI};

// Coefficients of the mean over s of 1 - exp(-1/b(s)) (see asg.rs), as a polynomial in x = (a + b)/2 and y =
// a b with a = (2 - mu1)/(2 + mu1) and b the same of mu2; row j multiplies y^j. They are a minimax fit for
// bandwidths from MU_MIN to MU_MAX with a relative error of 9e-5 in f32 (tested). The quadrature with 12
// nodes, whose own error is 1e-4, takes ten times as long.
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
/// All of them.
pub const LOBE_MEAN: [&[f32]; 6] = [&MEAN_0, &MEAN_1, &MEAN_2, &MEAN_3, &MEAN_4, &MEAN_5];

/// Polynomial of even degree in x, constant term first. Even and odd powers are evaluated separately, which
/// halves the dependency chain of Horner's rule.
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

/// Energy of a lobe with amplitude 1, times sqrt(mu1 mu2) / pi, from the bandwidths mu log2 e.
#[inline(always)]
fn unit_mean<const FMA: bool>(t1: f32, t2: f32) -> f32 {
    let (d1, d2) = (2.0 * LOG2_E + t1, 2.0 * LOG2_E + t2);
    let both = 1.0 / (d1 * d2);
    let (a, b) = ((2.0 * LOG2_E - t1) * (d2 * both), (2.0 * LOG2_E - t2) * (d1 * both));
    let (x, y) = (0.5 * (a + b), a * b);
    let (x2, y2) = (x * x, y * y);
    let p01 = fma::<FMA>(polynomial::<FMA, 9>(MEAN_1, x, x2), y, polynomial::<FMA, 11>(MEAN_0, x, x2));
    let p23 = fma::<FMA>(polynomial::<FMA, 5>(MEAN_3, x, x2), y, polynomial::<FMA, 7>(MEAN_2, x, x2));
    let p45 = fma::<FMA>(MEAN_5[0], y, polynomial::<FMA, 3>(MEAN_4, x, x2));
    fma::<FMA>(fma::<FMA>(p45, y2, p23), y2, p01)
}

/// Axes of a lobe: sines and cosines of theta_z, phi_z and phi_xy. The sign of the last pair does not matter,
/// since a lobe is even.
#[derive(Clone, Copy)]
pub(in crate::ply) struct Axes {
    pub(in crate::ply) theta: (f32, f32),
    pub(in crate::ply) phi: (f32, f32),
    pub(in crate::ply) xy: (f32, f32),
}

impl Axes {
    /// The direction with these components along x, y and z.
    #[inline(always)]
    pub(in crate::ply) fn direction(&self, [u, w, cz]: [f32; 3]) -> [f32; 3] {
        let Axes { theta: (st, ct), phi: (sp, cp), xy: (sx, cx) } = *self;
        let across = cx * u - sx * w;
        let up = sx * u + cx * w;
        let along = ct * cz - st * up;
        [cp * along - sp * across, sp * along + cp * across, st * cz + ct * up]
    }
}

/// Sine and cosine of x half turns.
#[inline(always)]
pub(in crate::ply) fn sin_cos<const FMA: bool>(x: f32) -> (f32, f32) {
    let (s, c, sign) = sin_cos_half_turns::<FMA>(x);
    (signed(s, sign), signed(c, sign))
}

#[inline(always)]
pub(in crate::ply) fn axes<const FMA: bool>(theta: f32, phi: f32, xy: f32) -> Axes {
    let (st, ct, sign_t) = sin_cos_half_turns::<FMA>(theta);
    let (sp, cp, sign_p) = sin_cos_half_turns::<FMA>(phi);
    let (sx, cx, _) = sin_cos_half_turns::<FMA>(xy);
    Axes {
        theta: (signed(st, sign_t), signed(ct, sign_t)),
        phi: (signed(sp, sign_p), signed(cp, sign_p)),
        xy: (sx, cx),
    }
}

/// Square root of a bandwidth times log2 e, from the stored number, which is clamped to `bounds`.
#[inline(always)]
pub(in crate::ply) fn root_width<const FMA: bool>(stored: f32, bounds: (f32, f32)) -> f32 {
    exp2_within::<FMA>(min(max(stored, bounds.0), bounds.1))
}

/// `sqrt(mu1 mu2) / pi`, from s1 and s2.
#[inline(always)]
pub(in crate::ply) fn norm(s1: f32, s2: f32) -> f32 {
    s1 * s2 * (1.0 / (PI * LOG2_E))
}

/// [`norm`], and the amplitude of a lobe of energy 1.
#[inline(always)]
pub(in crate::ply) fn amplitudes<const FMA: bool>(s1: f32, s2: f32) -> (f32, f32) {
    let norm = norm(s1, s2);
    (norm, norm / unit_mean::<FMA>(s1 * s1, s2 * s2))
}

/// Components of `v` along x, y and z of a lobe; the first two share an arbitrary sign.
#[inline(always)]
pub(in crate::ply) fn project<const FMA: bool>(x: Axes, v: [f32; 3]) -> [f32; 3] {
    let ((st, ct), (sp, cp), (sx, cx)) = (x.theta, x.phi, x.xy);
    let across = fma::<FMA>(cp, v[1], -sp * v[0]);
    let along = fma::<FMA>(cp, v[0], sp * v[1]);
    let up = fma::<FMA>(ct, v[2], -st * along);
    let cz = fma::<FMA>(ct, along, st * v[2]);
    [fma::<FMA>(cx, across, sx * up), fma::<FMA>(cx, up, -sx * across), cz]
}

/// `cz 2^-q` in the hemisphere of the lobe, else 0. NaN gives 0, since the comparisons are false.
#[inline(always)]
pub(in crate::ply) fn shape<const FMA: bool>(q: f32, cz: f32) -> f32 {
    let value = cz * exp2_within::<FMA>(-q);
    // Below 2^-100 a lobe is dark. Products of smaller numbers could be denormal, which is slow.
    if cz > 0.0 && cz < 2.0 && q < 100.0 { value } else { 0.0 }
}

/// `1 - 2^-a`, the share of a lobe's plane that lies within the unit disc. The bounds of the bandwidths keep
/// it above 0.05; the clamp is for an invalid direction, whose squares overflow.
#[inline(always)]
pub(in crate::ply) fn disc_share<const FMA: bool>(a: f32) -> f32 {
    max(1.0 - exp2::<FMA>(-a), 1e-6)
}

/// Clamps uniform numbers to [0, 1); NaN becomes 0.
#[inline(always)]
pub(in crate::ply) fn unit(u: [f32; 3]) -> [f32; 3] {
    use crate::math::clamp_unit;
    [clamp_unit(u[0]), clamp_unit(u[1]), clamp_unit(u[2])]
}

/// Samples a direction of a lobe with two uniform numbers; returns its components along the lobe's x, y and
/// z.
#[inline(always)]
pub(in crate::ply) fn disc_point<const FMA: bool>(s1: f32, s2: f32, u1: f32, u2: f32) -> [f32; 3] {
    // tan t = sqrt(mu1/mu2) tan(2 pi u1), in the same quadrant.
    let (s, c) = sin_cos::<FMA>(2.0 * u1);
    let (c, s) = (s2 * c, s1 * s);
    let n2 = 1.0 / (c * c + s * s);
    let a = ((s1 * c) * (s1 * c) + (s2 * s) * (s2 * s)) * n2;
    let drop = -ln::<FMA>(1.0 - u2 * (1.0 - exp2::<FMA>(-a)));
    let r2 = min(max(drop / (LN_2 * a), 0.0), 1.0 - f32::EPSILON);
    let r = (r2 * n2).sqrt();
    [r * c, r * s, (1.0 - r2).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ply::asg::{MU_MAX, MU_MIN};

    /// The mean over s of 1 - exp(-1/b(s)), with many nodes.
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
                let (t1, t2) = (mu1 as f32 * LOG2_E, mu2 as f32 * LOG2_E);
                for got in [unit_mean::<true>(t1, t2), unit_mean::<false>(t1, t2)] {
                    let err = (f64::from(got) / want - 1.0).abs();
                    assert!(err < 1e-4, "mu {mu1} {mu2}: got {got}, want {want}, relative {err}");
                }
            }
        }
    }
}
