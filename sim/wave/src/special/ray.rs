//! Bessel functions of orders 0 and 1 for many arguments along one ray `z = k r` of the complex plane, by
//! piecewise polynomials.

use super::C64;
use super::expansions::{
    ASYMPTOTIC, Cylinder01, POWERS_BELOW, asymptotic, exp_i, hankel01_scaled, horner, power_series,
};
use super::single::bessel01;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Degree of a piece of a [`Ray`]. A piece spans a quarter of an octave of r; the singularity at r = 0 leaves
/// 1e-16 from degree 11 on.
const DEGREE: usize = 11;
/// Pieces cover 2^0..2^6 of |z|: the power series serves below, the asymptotic series above.
const OCTAVES: usize = 6;
/// One piece: polynomials of `s = (|z| - middle) / half` for `sqrt(z) exp(-iz) H_n` and
/// `sqrt(z) exp(iz) H_n^(2)`, n = 0, 1.
struct RayPiece {
    middle: f64,
    inverse_half: f64,
    coeffs: [[C64; 4]; DEGREE + 1],
}

/// Hankel and Bessel functions of orders 0 and 1 along the ray `z = k r`, r > 0, of one complex k with Im k
/// >= 0.
///
/// Without the exponential and the root, the functions are smooth in r on every scale, so piecewise
/// polynomials in |z| with four pieces per octave represent them to rounding. Building one takes about 1 ms.
pub struct Ray {
    k: C64,
    size: f64,
    /// sqrt of k/|k|, taken with the root of |z|.
    root: C64,
    pieces: Vec<RayPiece>,
    /// `i^m a_m(n) / (k/|k|)^m` for H and its conjugate for H^(2), DLMF 10.17.5-6, `[m][h0, h1, g0, g1]`.
    asymptotic: [[C64; 4]; ASYMPTOTIC],
}

impl Ray {
    /// Tables for the ray through `k` [1/um], k != 0.
    pub fn new(k: C64) -> Self {
        let size = k.norm();
        let unit = k / size;
        let root = unit.sqrt();
        let mut pieces = Vec::with_capacity(4 * OCTAVES);
        for octave in 0..OCTAVES {
            for quarter in 0..4 {
                let low = f64::powi(2.0, octave as i32) * (1.0 + 0.25 * quarter as f64);
                let half = 0.125 * f64::powi(2.0, octave as i32);
                pieces.push(RayPiece {
                    middle: low + half,
                    inverse_half: 1.0 / half,
                    coeffs: fit(|s| smooth_parts(unit, low + half + half * s)),
                });
            }
        }
        Self { k, size, root, pieces, asymptotic: asymptotic(unit) }
    }

    /// `[H_0(k r), H_1(k r)]`.
    #[inline]
    pub fn hankel01(&self, r: f64) -> [C64; 2] {
        let x = self.size * r;
        let z = self.k * r;
        if x < POWERS_BELOW {
            return power_series(z).h;
        }
        let v = self.smooth::<2>(x);
        let e = exp_i(z) / (self.root * x.sqrt());
        [v[0] * e, v[1] * e]
    }

    /// Bessel and Hankel functions at `k r`.
    #[inline]
    pub fn cylinder01(&self, r: f64) -> Cylinder01 {
        let x = self.size * r;
        let z = self.k * r;
        if x < POWERS_BELOW {
            return power_series(z);
        }
        let v = self.smooth::<4>(x);
        let root = 1.0 / (self.root * x.sqrt());
        let (out, back) = (root * exp_i(z), root * exp_i(-z));
        let h = [v[0] * out, v[1] * out];
        Cylinder01 { j: [0.5 * (h[0] + v[2] * back), 0.5 * (h[1] + v[3] * back)], h }
    }

    /// The first N of the four smooth functions at |z| = x >= 1.
    #[inline]
    fn smooth<const N: usize>(&self, x: f64) -> [C64; N] {
        // Exponent and two leading bits of the mantissa name the piece.
        let index = (x.to_bits() >> 50) as usize - (1023 << 2);
        if let Some(piece) = self.pieces.get(index) {
            horner(&piece.coeffs, (x - piece.middle) * piece.inverse_half)
        } else {
            horner(&self.asymptotic, 1.0 / x)
        }
    }
}

/// `sqrt(z) exp(-iz) H_n(z)` and `sqrt(z) exp(iz) H_n^(2)(z)` for n = 0, 1 at z = unit x.
fn smooth_parts(unit: C64, x: f64) -> [C64; 4] {
    let z = unit * x;
    let root = unit.sqrt() * x.sqrt();
    let [h0, h1] = hankel01_scaled(z);
    // H^(2) = 2 J - H^(1); exp(2iz) is no larger than 1.
    let wave = exp_i(z);
    let [j0, j1] = bessel01(z);
    [h0 * root, h1 * root, (2.0 * j0 * wave - h0 * wave * wave) * root, (2.0 * j1 * wave - h1 * wave * wave) * root]
}

/// Polynomial coefficients of the interpolant of `f` through the Chebyshev nodes of [-1, 1].
fn fit(f: impl Fn(f64) -> [C64; 4]) -> [[C64; 4]; DEGREE + 1] {
    const N: usize = DEGREE + 1;
    let zero = [C64::new(0.0, 0.0); 4];
    let angle = |k: usize| PI * (k as f64 + 0.5) / N as f64;
    let values: [[C64; 4]; N] = std::array::from_fn(|k| f(angle(k).cos()));
    let mut out = [zero; N];
    // T_m as powers of s, by T_{m+1} = 2 s T_m - T_{m-1}.
    let (mut last, mut this) = ([0.0; N], [0.0; N]);
    this[0] = 1.0;
    for m in 0..N {
        let weight = if m == 0 { 1.0 } else { 2.0 } / N as f64;
        for i in 0..4 {
            let c: C64 = (0..N).map(|k| values[k][i] * (m as f64 * angle(k)).cos()).sum::<C64>() * weight;
            for p in 0..N {
                out[p][i] += c * this[p];
            }
        }
        let mut next = [0.0; N];
        for p in 0..N {
            let up = if p > 0 { this[p - 1] } else { 0.0 };
            next[p] = if m == 0 { up } else { 2.0 * up - last[p] };
        }
        (last, this) = (this, next);
    }
    out
}

/// `J_0, J_1, Y_0, Y_1` at real x > 0, as the real and imaginary parts of `[H_0(x), H_1(x)]`.
pub fn real01(x: f64) -> [C64; 2] {
    static REAL: LazyLock<Ray> = LazyLock::new(|| Ray::new(C64::new(1.0, 0.0)));
    REAL.hankel01(x)
}
