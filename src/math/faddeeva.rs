//! The Faddeeva function `w(z) = exp(-z^2) erfc(-i z)` in the upper half plane, and the diffraction factor of
//! a Gaussian beam that is cut by two straight edges, expressed by it (Yu 2025, Eq. 12, separated).
//!
//! `w` is computed by Weideman's rational series: with `Z = (L + i z)/(L - i z)`,
//! `w = 2 p(Z)/(L - i z)^2 + 1/(sqrt(pi) (L - i z))`, where p is a polynomial whose coefficients are
//! trapezoidal sums, lowest power first (J. A. C. Weideman, "Computation of the complex error function", SIAM
//! J. Numer. Anal. 31, 1994). The series has no branches, so the f32 form vectorizes.
//!
//! The factor is `k(a, b, f) = integral_a^b exp(-x^2/w0^2 - 2 pi i f x) dx`. With s = pi f w0 and D(t) =
//! exp(-s^2) erf(t + i s) it is `k = sqrt(pi)/2 w0 (D(b/w0) - D(a/w0))`. erf overflows where exp(-s^2)
//! underflows, but their product does neither: `D(t) = exp(-s^2) - E(t)` with
//! `E(t) = exp(-t^2 - 2 i s t) w(-s + i t)` for t >= 0, and D is odd up to conjugation, `D(-t) = -conj D(t)`.
//! So w is needed only in the upper half plane, where |w| <= 1.

use super::erf::erf_from_0;
use crate::math::simd::{exp2, fma, max, min, signed, sin_cos_half_turns};
use std::f64::consts::PI;

/// Number of terms and scale of the series in f64: accurate to 3e-14 relative to |w| (tested against SciPy).
const TERMS: usize = 40;
const SCALE: f64 = 5.318295896944989;
const SERIES: [f64; TERMS] = [
    2.8996245093897053,
    2.61605415276186,
    2.201513794878312,
    1.7253830848179779,
    1.2563815675765133,
    0.8472174576593818,
    0.5266528988277086,
    0.29989437996150065,
    0.15504263802479495,
    0.07182361779074337,
    0.029202916471241867,
    0.010048186242783424,
    0.0027054056330737914,
    0.0004398070159869668,
    -3.939363145489569e-05,
    -5.591309264248318e-05,
    -1.8007447144750956e-05,
    -1.0660138984947143e-06,
    1.483566113220078e-06,
    5.912136951899494e-07,
    1.4198642399935674e-08,
    -6.35177348504429e-08,
    -1.8315616783040462e-08,
    3.2497465180436973e-09,
    3.0177805400090707e-09,
    2.1086006347066517e-10,
    -3.5632339865976533e-10,
    -9.055124450928292e-11,
    3.47272670930455e-11,
    1.7714495214011192e-11,
    -2.7276023158200452e-12,
    -2.907688342182867e-12,
    1.2031458219387989e-13,
    4.5329666782606727e-13,
    1.37256205867155e-14,
    -7.074086260286855e-14,
    -5.409310282882142e-15,
    1.1357687198999241e-14,
    1.128073562364402e-15,
    -1.899694947394927e-15,
];
/// The series in f32, whose truncation error is below the rounding error of 7e-7.
/// Number of coefficients in single precision.
pub const TERMS_F32: usize = 16;
const SCALE_F32: f32 = 3.3635857;
const SERIES_F32: [f32; TERMS_F32] = [
    1.7483959,
    1.3622408,
    0.88644785,
    0.4692909,
    0.19124173,
    0.0518224,
    0.0036825673,
    -0.003881015,
    -0.0015276597,
    8.7031585e-05,
    0.00021071057,
    2.1709868e-05,
    -2.7346405e-05,
    -5.5842333e-06,
    3.9812876e-06,
    9.939323e-07,
];

/// `w(z)` for `z = x + i y`, y >= 0, as real and imaginary part, to 3e-14 of |w|. Below the real axis, where
/// w grows without bound, y is clamped to 0.
pub fn faddeeva(x: f64, y: f64) -> [f64; 2] {
    // Squares of numbers beyond 1e100 overflow; w is 0 there to all significant digits.
    let (x, y) = (x.clamp(-1e100, 1e100), y.clamp(0.0, 1e100));
    let d = [SCALE + y, -x];
    let norm = 1.0 / (d[0] * d[0] + d[1] * d[1]);
    let r = [d[0] * norm, -d[1] * norm];
    let mul = |a: [f64; 2], b: [f64; 2]| [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
    let z = mul([SCALE - y, x], r);
    let p = SERIES.iter().rev().fold([0.0; 2], |p, c| {
        let p = mul(p, z);
        [p[0] + c, p[1]]
    });
    let series = mul(mul(p, r), r);
    [2.0 * series[0] + r[0] / PI.sqrt(), 2.0 * series[1] + r[1] / PI.sqrt()]
}

/// `k(a, b, f) = integral_a^b exp(-x^2/w0^2 - 2 pi i f x) dx` [um], as real and imaginary part: one of the
/// two factors of the diffraction integral K (Yu 2025, Eq. 12). Edges are in um and `f_per_um` is in 1/um. No
/// finite argument overflows.
pub fn diffraction_factor(a_um: f64, b_um: f64, f_per_um: f64, w0_um: f64) -> [f64; 2] {
    let s = (PI * f_per_um * w0_um).clamp(-1e100, 1e100);
    // sign(t) (exp(-s^2) - E) without its first term, which cancels between the edges.
    let edge = |x_um: f64| {
        let t = (x_um / w0_um).abs().min(30.0);
        let w = faddeeva(-s, t);
        let (sin, cos) = (2.0 * s * t).sin_cos();
        let amplitude = (-t * t).exp();
        let sign = if x_um < 0.0 { -1.0 } else { 1.0 };
        [-sign * amplitude * (w[0] * cos + w[1] * sin), -amplitude * (w[1] * cos - w[0] * sin), sign]
    };
    let (ea, eb) = (edge(a_um), edge(b_um));
    let scale = 0.5 * PI.sqrt() * w0_um;
    [scale * ((eb[2] - ea[2]) * (-s * s).exp() + eb[0] - ea[0]), scale * (eb[1] - ea[1])]
}

/// `integral_a^b exp(-2 x^2/w0^2) dx` [um]: the beam's power between two edges relative to the power density
/// at its center.
pub fn power_between(a_um: f64, b_um: f64, w0_um: f64) -> f64 {
    diffraction_factor(a_um, b_um, 0.0, w0_um * std::f64::consts::FRAC_1_SQRT_2)[0].max(0.0)
}

/// Scale and coefficients of the series in single precision.
pub const SINGLE: (f32, [f32; TERMS_F32]) = (SCALE_F32, SERIES_F32);

/// One edge of a diffraction factor in f32: its position in waists and its side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Edge {
    /// |x| / w0, and the side as -1 or 1.
    t: f32,
    sign: f32,
    /// exp(-t^2).
    amplitude: f32,
}

/// Two edges in a beam: the f32 form of [`diffraction_factor`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Factor {
    edges: [Edge; 2],
    w0_um: f32,
    /// Scale of `|D(b) - D(a)|^2` [um] for a spectrum whose integral over f is 1; 0 if no light passes.
    scale_um: f32,
}

impl Factor {
    /// The factor for edges a <= b [um] in a beam of waist w0 [um].
    pub(crate) fn new(a_um: f64, b_um: f64, w0_um: f64) -> Factor {
        let edge = |x: f64| {
            let t = (x / w0_um).abs().min(30.0);
            Edge { t: t as f32, sign: if x < 0.0 { -1.0 } else { 1.0 }, amplitude: (-t * t).exp() as f32 }
        };
        let power = power_between(a_um, b_um, w0_um);
        // Parseval: the integral of |k|^2 over f is that of exp(-2 x^2/w0^2) over x.
        let scale = if power > 1e-12 * w0_um { 0.25 * PI * w0_um * w0_um / power } else { 0.0 };
        Factor { edges: [edge(a_um), edge(b_um)], w0_um: w0_um as f32, scale_um: scale as f32 }
    }

    /// [`Factor::new`] in f32, for apertures that are evaluated once. The edges are `before_um` below and
    /// `beyond_um` above the beam's center, both 0 or more. The power is a sum of two terms of the same sign,
    /// accurate to f32 rounding for any width of the aperture.
    #[inline]
    pub(crate) fn about(before_um: f32, beyond_um: f32, w0_um: f32) -> Factor {
        let edge = |x_um: f32, sign: f32| {
            let t = min(x_um / w0_um, 30.0);
            Edge { t, sign, amplitude: exp2::<false>(-std::f32::consts::LOG2_E * t * t) }
        };
        let edges = [edge(before_um, -1.0), edge(beyond_um, 1.0)];
        // In waists, the power is sqrt(pi/8) times the sum of erf(sqrt(2) t) of both edges.
        let [a, b] = [0, 1].map(|e| erf_from_0(std::f32::consts::SQRT_2 * edges[e].t));
        let power = 0.626_657_1 * (a + b);
        let scale_um = if power > 1e-12 { 0.25 * std::f32::consts::PI * w0_um / power } else { 0.0 };
        Factor { edges, w0_um, scale_um }
    }

    /// Power between the edges of this factor relative to that of another factor of the same beam.
    pub(crate) fn power_over(&self, other: &Factor) -> f32 {
        other.scale_um / self.scale_um
    }

    /// The beam's waist [um].
    pub(crate) fn w0_um(&self) -> f32 {
        self.w0_um
    }

    /// t, sign and amplitude of the two edges, then w0 and the scale [um], for hosts that evaluate the
    /// spectrum themselves.
    pub(crate) fn numbers(&self) -> [f32; 8] {
        let [a, b] = &self.edges;
        [a.t, a.sign, a.amplitude, b.t, b.sign, b.amplitude, self.w0_um, self.scale_um]
    }

    /// Whether any light passes.
    pub(crate) fn passes(&self) -> bool {
        self.scale_um > 0.0
    }

    /// Mean of [`spectra`] over the interference of the two edges, for frequencies far above those of the
    /// beam: the sum of the light that each edge scatters.
    pub(crate) fn smooth_spectrum(&self, f_per_um: f32) -> f32 {
        let s = std::f32::consts::PI * f_per_um * self.w0_um;
        let edge = |e: &Edge| {
            let w = faddeeva_f32::<false>(-s, e.t);
            e.amplitude * e.amplitude * (w[0] * w[0] + w[1] * w[1])
        };
        self.scale_um * (edge(&self.edges[0]) + edge(&self.edges[1]))
    }
}

/// `|k|^2` of two factors at N frequencies [1/um] each, scaled to an integral of 1 over f [um]. The four
/// edges lie side by side in 4 N lanes, enough for the compiler to vectorize the loop.
#[inline(always)]
pub(crate) fn spectra<const FMA: bool, const N: usize>(
    factors: [&Factor; 2],
    f_per_um: [&[f32; N]; 2],
) -> [[f32; N]; 2] {
    let zero = [[0.0; N]; 4];
    let (mut g, mut t, mut amplitude, mut re, mut im) = (zero, zero, zero, zero, zero);
    for (e, row) in g.iter_mut().enumerate() {
        let factor = factors[e / 2];
        t[e] = [factor.edges[e % 2].t; N];
        amplitude[e] = [factor.edges[e % 2].amplitude; N];
        for k in 0..N {
            // Above 2^20 half turns f32 cannot resolve the phase; the light there is below 1e-10.
            row[k] = min(max(f_per_um[e / 2][k] * factor.w0_um, -1e4), 1e4);
        }
    }
    let (g_, t_, a_) = (g.as_flattened(), t.as_flattened(), amplitude.as_flattened());
    let (re_, im_) = (re.as_flattened_mut(), im.as_flattened_mut());
    for i in 0..g_.len() {
        let w = faddeeva_f32::<FMA>(-std::f32::consts::PI * g_[i], t_[i]);
        let (sin, cos, sign) = sin_cos_half_turns::<FMA>(2.0 * g_[i] * t_[i]);
        let (sin, cos) = (signed(sin, sign), signed(cos, sign));
        re_[i] = a_[i] * fma::<FMA>(w[0], cos, w[1] * sin);
        im_[i] = a_[i] * fma::<FMA>(w[1], cos, -w[0] * sin);
    }
    let mut value = [[0.0; N]; 2];
    for (c, value) in value.iter_mut().enumerate() {
        let factor = factors[c];
        let (low, high) = (factor.edges[0].sign, factor.edges[1].sign);
        for k in 0..N {
            let s = std::f32::consts::PI * g[2 * c][k];
            let middle = (high - low) * exp2::<FMA>(-std::f32::consts::LOG2_E * s * s);
            let re = middle - high * re[2 * c + 1][k] + low * re[2 * c][k];
            let im = im[2 * c][k] - im[2 * c + 1][k];
            value[k] = factor.scale_um * fma::<FMA>(re, re, im * im);
        }
    }
    value
}

/// [`faddeeva`] in f32, for y in [0, 30] and |x| <= 1e5, with an error of 1e-6 of |w|.
#[inline(always)]
fn faddeeva_f32<const FMA: bool>(x: f32, y: f32) -> [f32; 2] {
    let d = SCALE_F32 + y;
    let norm = 1.0 / fma::<FMA>(d, d, x * x);
    let r = [d * norm, x * norm];
    let mul = |a: [f32; 2], b: [f32; 2]| [fma::<FMA>(a[0], b[0], -a[1] * b[1]), fma::<FMA>(a[0], b[1], a[1] * b[0])];
    let z = mul([SCALE_F32 - y, x], r);
    let z2 = mul(z, z);
    // Even and odd powers are summed separately, which halves the dependency chain.
    let (mut even, mut odd) = ([SERIES_F32[TERMS_F32 - 2], 0.0], [SERIES_F32[TERMS_F32 - 1], 0.0]);
    for j in (0..TERMS_F32 / 2 - 1).rev() {
        (even, odd) = (mul(even, z2), mul(odd, z2));
        even[0] += SERIES_F32[2 * j];
        odd[0] += SERIES_F32[2 * j + 1];
    }
    let odd = mul(odd, z);
    let series = mul(mul([even[0] + odd[0], even[1] + odd[1]], r), r);
    const ROOT: f32 = 0.564_189_6; // 1/sqrt(pi)
    [fma::<FMA>(2.0, series[0], ROOT * r[0]), fma::<FMA>(2.0, series[1], ROOT * r[1])]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x, y, Re w, Im w from SciPy 1.16.3, `scipy.special.wofz(x + 1j*y)`; mpmath 1.3 with 40 digits gives
    /// the same digits.
    const SCIPY: [[f64; 4]; 12] = [
        [0.0, 0.0, 1.0, 0.0],
        [1.0, 0.0, 0.36787944117144233, 0.6071577058413937],
        [0.0, 1.0, 0.427583576155807, 0.0],
        [2.0, 0.0, 0.01831563888873418, 0.3400262170660662],
        [3.0, 4.0, 0.09093390419476544, 0.06559233052791438],
        [-0.7, 0.2, 0.549738999833096, -0.43244230202791684],
        [6.3, 0.001, 1.478934451416542e-05, 0.09072765723891489],
        [-40.0, 2.0, 0.000704134979876027, -0.014073911686075087],
        [12.5, 0.0, 1.3851193699226017e-68, 0.04528100846614442],
        [160.0, 0.5, 1.1019865899873544e-05, 0.0035262193329090447],
        [0.5, 8.0, 0.06972284936251098, 0.004292337763204675],
        [-5.0, 0.05, 0.0012038808400454595, -0.1152330726939764],
    ];

    #[test]
    fn values_are_those_of_scipy() {
        for [x, y, re, im] in SCIPY {
            let size = f64::hypot(re, im);
            let got = faddeeva(x, y);
            let err = f64::hypot(got[0] - re, got[1] - im) / size;
            assert!(err < 3e-14, "w({x}, {y}): got {got:?}, want [{re}, {im}], err {err}");
            for got in [faddeeva_f32::<true>(x as f32, y as f32), faddeeva_f32::<false>(x as f32, y as f32)] {
                let err = f64::hypot(f64::from(got[0]) - re, f64::from(got[1]) - im) / size;
                assert!(err < 1e-6, "w({x}, {y}) in f32: got {got:?}, want [{re}, {im}], err {err}");
            }
        }
    }

    /// The coefficients are Weideman's trapezoidal sums.
    #[test]
    fn series_is_the_trapezoid_sum() {
        let sum = |n: usize, terms: usize, scale: f64| {
            let m = 2 * terms as i32;
            let term = |k: i32| {
                let angle = PI * f64::from(k) / f64::from(m);
                let t = scale * (0.5 * angle).tan();
                (-t * t).exp() * (scale * scale + t * t) * (n as f64 * angle).cos()
            };
            (1 - m..m).map(term).sum::<f64>() / f64::from(2 * m)
        };
        let scale = |terms: usize| (terms as f64 / 2f64.sqrt()).sqrt();
        assert!((scale(TERMS) - SCALE).abs() < 1e-15 * SCALE && (scale(TERMS_F32) - f64::from(SCALE_F32)).abs() < 2e-7);
        for (i, c) in SERIES.iter().enumerate() {
            let want = sum(i + 1, TERMS, SCALE);
            assert!((c - want).abs() < 1e-14, "term {i}: got {c}, want {want}");
        }
        for (i, c) in SERIES_F32.iter().enumerate() {
            let want = sum(i + 1, TERMS_F32, scale(TERMS_F32));
            assert!((f64::from(*c) - want).abs() < 1.3e-7, "term {i}: got {c}, want {want}");
        }
    }

    /// f32 agrees with f64 over the half plane.
    #[test]
    fn f32_follows_f64() {
        let mut worst = 0.0f64;
        for i in -400..=400i32 {
            for j in 0..80 {
                let x = f64::from(i) * 0.01 * 1.0f64.max(f64::from(i.abs()) * 0.05);
                let y = 0.05 * f64::from(j);
                let (x, y) = (x as f32, y as f32);
                let want = faddeeva(x.into(), y.into());
                let got = faddeeva_f32::<false>(x, y);
                let err = f64::hypot(f64::from(got[0]) - want[0], f64::from(got[1]) - want[1]) / want[0].hypot(want[1]);
                worst = worst.max(err);
            }
        }
        assert!(worst < 1e-6, "worst {worst}");
        println!("w in f32: worst relative error {worst:.1e}");
    }

    /// The factor of an aperture that is evaluated once equals that of [`Factor::new`], for narrow ones too.
    #[test]
    fn factors_in_f32_follow_f64() {
        let mut worst = 0.0f32;
        for before in [0.0, 0.03, 0.4, 2.7, 11.0, 20.0f32] {
            for beyond in [0.07, 0.9, 5.0, 19.9f32] {
                let want = Factor::new(-f64::from(before), f64::from(beyond), 10.0);
                let got = Factor::about(before, beyond, 10.0);
                worst = worst.max((got.scale_um / want.scale_um - 1.0).abs());
                for f in [0.0f32, 0.02, -0.3, 1.7] {
                    let [[got], [want]] = spectra::<false, 1>([&got, &want], [&[f]; 2]);
                    let peak = before + beyond;
                    assert!((got - want).abs() < 1e-3 * peak, "{before} {beyond} at {f}: {got}, want {want}");
                }
            }
        }
        assert!(worst < 2e-6, "scale: {worst}");
    }

    /// The integral by Gauss-Legendre panels of half a period or of a tenth of the waist.
    fn quadrature(a: f64, b: f64, f: f64, w0: f64) -> [f64; 2] {
        const NODES: [(f64, f64); 5] = [
            (0.0, 0.568_888_888_888_888_9),
            (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (0.906_179_845_938_664, 0.236_926_885_056_189_08),
            (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
        ];
        let (a, b) = (a.clamp(-8.0 * w0, 8.0 * w0), b.clamp(-8.0 * w0, 8.0 * w0));
        let panels = ((b - a) * (10.0 / w0 + 4.0 * f.abs())).ceil().max(4.0) as usize;
        let half = 0.5 * (b - a) / panels as f64;
        let mut sum = [0.0; 2];
        for p in 0..panels {
            for (x, w) in NODES {
                let x = a + half * (2.0 * p as f64 + 1.0 + x);
                let g = w * half * (-(x / w0).powi(2)).exp();
                let (sin, cos) = (2.0 * PI * f * x).sin_cos();
                sum = [sum[0] + g * cos, sum[1] - g * sin];
            }
        }
        sum
    }

    const EDGES: [[f64; 2]; 12] = [
        [-20.0, 20.0],
        [-5.0, 5.0],
        [-1.0, 1.0],
        [0.0, 20.0],
        [-20.0, 3.0],
        [7.5, 20.0],
        [-19.0, -2.0],
        [-0.25, 0.0],
        [2.0, 2.5],
        [19.0, 20.0],
        [-300.0, 400.0],
        [-20.0, -20.0],
    ];

    #[test]
    fn factor_is_the_integral() {
        let (mut worst, mut worst_f32) = (0.0f64, 0.0f64);
        for [a, b] in EDGES {
            for w0 in [10.0, 3.0, 40.0] {
                let open = quadrature(-1e3, 1e3, 0.0, w0)[0];
                let factor = Factor::new(a, b, w0);
                let power = power_between(a, b, w0);
                for f in [0.0, 1e-4, -0.013, 0.1, -0.77, 1.9, 5.3] {
                    let (got, want) = (diffraction_factor(a, b, f, w0), quadrature(a, b, f, w0));
                    let err = f64::hypot(got[0] - want[0], got[1] - want[1]) / open;
                    assert!(err < 1e-8, "k({a}, {b}, {f}), w0 {w0}: got {got:?}, want {want:?}, err {err}");
                    worst = worst.max(err);
                    // The runtime's value: amplitudes, relative to an open beam.
                    let got = f64::from(spectra::<false, 1>([&factor; 2], [&[f as f32]; 2])[1][0]) * power;
                    worst_f32 = worst_f32.max((got.sqrt() - want[0].hypot(want[1])).abs() / open);
                }
                let integral = quadrature(a, b, 0.0, w0 / 2f64.sqrt())[0];
                assert!((power - integral).abs() < 1e-10 * w0, "power {a} {b} {w0}: got {power}, want {integral}");
            }
        }
        println!("k, on the scale of an open beam: f64 {worst:.1e}, f32 {worst_f32:.1e}");
        assert!(worst_f32 < 2e-6, "f32: {worst_f32}");
    }

    #[test]
    fn nothing_overflows() {
        for a in [-1e300, -20.0, 0.0, 1e-300, 20.0] {
            for b in [20.0, 1e300, f64::MAX] {
                for f in [0.0, 1e3, -1e150, 1e300] {
                    for w0 in [1e-3, 10.0, 1e6] {
                        let k = diffraction_factor(a, b, f, w0);
                        assert!(k[0].is_finite() && k[1].is_finite(), "k({a}, {b}, {f}, {w0}) = {k:?}");
                    }
                }
            }
        }
        let factor = Factor::new(-20.0, 20.0, 10.0);
        for f in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 1e30] {
            assert!(spectra::<true, 1>([&factor; 2], [&[f]; 2])[0][0].is_finite(), "{f}");
        }
    }
}
