//! Orders 0 and 1 by power series about 0, by asymptotic series, and between them by the Hankel functions of
//! the crate `complex-bessel`.

use super::C64;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_4};

pub(super) const I: C64 = C64::new(0.0, 1.0);
/// Euler's constant, DLMF 5.2.3.
const EULER: f64 = 0.577_215_664_901_532_9;

/// Terms of the power series for |z| < 1: the last is 1e-19 of the first.
const POWERS: usize = 10;
/// The power series serves below this |z|, without cancellation.
pub(super) const POWERS_BELOW: f64 = 1.0;
/// The asymptotic series serves above this |z|.
pub(super) const ASYMPTOTIC_ABOVE: f64 = 50.0;
/// Terms of the asymptotic series: the first omitted term is below 1e-17 there.
pub(super) const ASYMPTOTIC: usize = 12;

/// `J_0, J_1` and `H_0^(1), H_1^(1)` at one argument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder01 {
    /// `[J_0, J_1]`.
    pub j: [C64; 2],
    /// `[H_0, H_1]`, outgoing.
    pub h: [C64; 2],
}

/// `exp(-|Im z|) [J_0(z), J_1(z)]` for |z| > [`ASYMPTOTIC_ABOVE`].
pub(super) fn bessel01_scaled(z: C64) -> [C64; 2] {
    let size = z.norm();
    let v: [C64; 4] = horner(&asymptotic(z / size), 1.0 / size);
    let (out, back) = (exp_i(C64::new(z.re, z.im + z.im.abs())), exp_i(C64::new(-z.re, -z.im + z.im.abs())));
    let root = (z / size).sqrt() * size.sqrt();
    [0, 1].map(|n| 0.5 * (v[n] * out + v[2 + n] * back) / root)
}

/// `exp(-iz) [H_0(z), H_1(z)]` for |z| >= 1.
pub(super) fn hankel01_scaled(z: C64) -> [C64; 2] {
    if z.norm() > ASYMPTOTIC_ABOVE {
        let size = z.norm();
        let root = (z / size).sqrt() * size.sqrt();
        let v: [C64; 2] = horner(&asymptotic(z / size), 1.0 / size);
        return v.map(|h| h / root);
    }
    [0.0, 1.0].map(|nu| complex_bessel::hankel1_scaled(nu, z).unwrap_or(C64::new(f64::NAN, f64::NAN)))
}

/// Coefficients of 1/|z|^m in the smooth parts of H_0, H_1, H_0^(2), H_1^(2) along the ray through `unit`,
/// DLMF 10.17.5-6.
pub(super) fn asymptotic(unit: C64) -> [[C64; 4]; ASYMPTOTIC] {
    let mut out = [[C64::new(0.0, 0.0); 4]; ASYMPTOTIC];
    for n in 0..2 {
        let phase = C64::from_polar(FRAC_2_PI.sqrt(), -FRAC_PI_4 * (1 + 2 * n) as f64);
        let (mut h, mut g) = (phase, phase.conj());
        for m in 0..ASYMPTOTIC {
            out[m][n] = h;
            out[m][2 + n] = g;
            // a_{m+1} = a_m (4 n^2 - (2 m + 1)^2) / (8 (m + 1)), DLMF 10.17.1.
            let odd = (2 * m + 1) as f64;
            let step = (4.0 * (n * n) as f64 - odd * odd) / (8.0 * (m + 1) as f64) / unit;
            h *= I * step;
            g *= -I * step;
        }
    }
    out
}

/// exp(i z), with sine and cosine of the real part.
#[inline]
pub(super) fn exp_i(z: C64) -> C64 {
    let (sin, cos) = z.re.sin_cos();
    let size = if z.im == 0.0 { 1.0 } else { (-z.im).exp() };
    C64::new(size * cos, size * sin)
}

#[inline]
pub(super) fn horner<const N: usize, const M: usize>(coeffs: &[[C64; 4]; M], s: f64) -> [C64; N] {
    let mut v: [C64; N] = std::array::from_fn(|i| coeffs[M - 1][i]);
    for c in coeffs[..M - 1].iter().rev() {
        for i in 0..N {
            v[i] = v[i] * s + c[i];
        }
    }
    v
}

/// Power series for |z| < 1, DLMF 10.2.2 and 10.8.1-2.
pub(super) fn power_series(z: C64) -> Cylinder01 {
    let q = -0.25 * z * z;
    let one = C64::new(1.0, 0.0);
    // Term m of J_0 is q^m / m!^2, of J_1 (z/2) q^m / (m! (m+1)!); psi(m+1) = -EULER + 1 + 1/2 + .. + 1/m.
    let (mut t0, mut t1) = (one, one);
    let (mut j0, mut j1) = (one, one);
    let mut psi = -EULER;
    let mut s0 = C64::new(psi, 0.0);
    let mut s1 = C64::new(2.0 * psi + 1.0, 0.0);
    for m in 1..POWERS {
        let f = m as f64;
        t0 = t0 * q * (1.0 / (f * f));
        t1 = t1 * q * (1.0 / (f * (f + 1.0)));
        psi += 1.0 / f;
        j0 += t0;
        j1 += t1;
        s0 += t0 * psi;
        s1 += t1 * (2.0 * psi + 1.0 / (f + 1.0));
    }
    let half = 0.5 * z;
    let ln = half.ln();
    let j1 = j1 * half;
    let y0 = FRAC_2_PI * (ln * j0 - s0);
    let y1 = FRAC_2_PI * (ln * j1 - 0.5 * half * s1 - 1.0 / z);
    Cylinder01 { j: [j0, j1], h: [j0 + I * y0, j1 + I * y1] }
}
