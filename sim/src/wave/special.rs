//! Bessel and Hankel functions of integer order, of real and complex argument with Im z >= 0.
//!
//! Three needs, three tools:
//! - [`cylinder01`], [`hankel01`], [`bessel01`]: orders 0 and 1 at any one argument;
//! - [`Ray`], [`real01`]: the same many times over along one ray `z = k r` of the complex plane, ten times faster;
//! - [`Sequence`]: all orders 0..=n with exponents of their own, so that neither large orders nor lossy media overflow.
//!
//! Power series below |z| = 1, asymptotic series above 50; between them H comes from the crate `complex-bessel` (Amos' algorithm 644) and J from its
//! recurrence. Formulas by their number in DLMF (dlmf.nist.gov).

use super::C64;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_4, LN_2, PI};
use std::sync::LazyLock;

const I: C64 = C64::new(0.0, 1.0);
/// Euler's constant, DLMF 5.2.3.
const EULER: f64 = 0.577_215_664_901_532_9;

/// `J_0, J_1` and `H_0^(1), H_1^(1)` at one argument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder01 {
    /// `[J_0, J_1]`.
    pub j: [C64; 2],
    /// `[H_0, H_1]`, outgoing.
    pub h: [C64; 2],
}

/// `[J_0(z), J_1(z)]`. Not finite where they overflow (|Im z| > 709).
pub fn bessel01(z: C64) -> [C64; 2] {
    if z == C64::new(0.0, 0.0) {
        return [C64::new(1.0, 0.0), z];
    }
    if z.norm() > ASYMPTOTIC_ABOVE {
        let size = z.im.abs().exp();
        return bessel01_scaled(z).map(|j| j * size);
    }
    let mut values = [Scaled::ZERO; 2];
    downward(z, &mut values);
    values.map(Scaled::value)
}

/// `exp(-|Im z|) [J_0(z), J_1(z)]` for |z| > [`ASYMPTOTIC_ABOVE`].
fn bessel01_scaled(z: C64) -> [C64; 2] {
    let size = z.norm();
    let v: [C64; 4] = horner(&asymptotic(z / size), 1.0 / size);
    let (out, back) = (exp_i(C64::new(z.re, z.im + z.im.abs())), exp_i(C64::new(-z.re, -z.im + z.im.abs())));
    let root = (z / size).sqrt() * size.sqrt();
    [0, 1].map(|n| 0.5 * (v[n] * out + v[2 + n] * back) / root)
}

/// `[H_0(z), H_1(z)]`, outgoing. Not finite at z = 0; zero where it underflows.
pub fn hankel01(z: C64) -> [C64; 2] {
    if z.norm() < POWERS_BELOW {
        return power_series(z).h;
    }
    let e = exp_i(z);
    hankel01_scaled(z).map(|h| h * e)
}

/// `exp(-iz) [H_0(z), H_1(z)]` for |z| >= 1.
fn hankel01_scaled(z: C64) -> [C64; 2] {
    if z.norm() > ASYMPTOTIC_ABOVE {
        let size = z.norm();
        let root = (z / size).sqrt() * size.sqrt();
        let v: [C64; 2] = horner(&asymptotic(z / size), 1.0 / size);
        return v.map(|h| h / root);
    }
    [0.0, 1.0].map(|nu| complex_bessel::hankel1_scaled(nu, z).unwrap_or(C64::new(f64::NAN, f64::NAN)))
}

/// Both pairs at one argument.
pub fn cylinder01(z: C64) -> Cylinder01 {
    Cylinder01 { j: bessel01(z), h: hankel01(z) }
}

/// `J_0, J_1, Y_0, Y_1` at real x > 0, as the real and imaginary parts of `[H_0(x), H_1(x)]`.
pub fn real01(x: f64) -> [C64; 2] {
    static REAL: LazyLock<Ray> = LazyLock::new(|| Ray::new(C64::new(1.0, 0.0)));
    REAL.hankel01(x)
}

/// Degree of a piece of a [`Ray`]. A piece spans a quarter of an octave of r; the singularity at r = 0 leaves 1e-16 from degree 11 on.
const DEGREE: usize = 11;
/// Pieces cover 2^0..2^6 of |z|: the power series serves below, the asymptotic series above.
const OCTAVES: usize = 6;
/// Terms of the power series for |z| < 1: the last is 1e-19 of the first.
const POWERS: usize = 10;
/// The power series serves below this |z|, without cancellation.
const POWERS_BELOW: f64 = 1.0;
/// The asymptotic series serves above this |z|.
const ASYMPTOTIC_ABOVE: f64 = 50.0;
/// Terms of the asymptotic series: the first left out is below 1e-17 there.
const ASYMPTOTIC: usize = 12;

/// One piece: polynomials of `s = (|z| - middle) / half` for `sqrt(z) exp(-iz) H_n` and `sqrt(z) exp(iz) H_n^(2)`, n = 0, 1.
struct Piece {
    middle: f64,
    inverse_half: f64,
    coeffs: [[C64; 4]; DEGREE + 1],
}

/// Hankel and Bessel functions of orders 0 and 1 along the ray `z = k r`, r > 0, of one complex k with Im k >= 0.
///
/// With the exponential and the root taken out, the functions are smooth in r on every scale, so piecewise polynomials in |z| with four pieces an
/// octave hold them to rounding. Building one takes about 1 ms.
pub struct Ray {
    k: C64,
    size: f64,
    /// sqrt of k/|k|, taken with the root of |z|.
    root: C64,
    pieces: Vec<Piece>,
    /// `i^m a_m(n) / (k/|k|)^m` for H and its conjugate twin for H^(2), DLMF 10.17.5-6, `[m][h0, h1, g0, g1]`.
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
                pieces.push(Piece {
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

/// Coefficients of 1/|z|^m in the smooth parts of H_0, H_1, H_0^(2), H_1^(2) along the ray through `unit`, DLMF 10.17.5-6.
fn asymptotic(unit: C64) -> [[C64; 4]; ASYMPTOTIC] {
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
fn exp_i(z: C64) -> C64 {
    let (sin, cos) = z.re.sin_cos();
    let size = if z.im == 0.0 { 1.0 } else { (-z.im).exp() };
    C64::new(size * cos, size * sin)
}

#[inline]
fn horner<const N: usize, const M: usize>(coeffs: &[[C64; 4]; M], s: f64) -> [C64; N] {
    let mut v: [C64; N] = std::array::from_fn(|i| coeffs[M - 1][i]);
    for c in coeffs[..M - 1].iter().rev() {
        for i in 0..N {
            v[i] = v[i] * s + c[i];
        }
    }
    v
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

/// Power series for |z| < 1, DLMF 10.2.2 and 10.8.1-2.
fn power_series(z: C64) -> Cylinder01 {
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

/// A complex number with a binary exponent of its own: `mantissa * 2^exponent`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scaled {
    /// Complex mantissa, of ordinary size.
    pub mantissa: C64,
    /// Binary exponent.
    pub exponent: i32,
}

impl Scaled {
    const ZERO: Self = Self { mantissa: C64::new(0.0, 0.0), exponent: 0 };

    /// `exp(w)` of any size.
    pub fn exp(w: C64) -> Self {
        let exponent = (w.re / LN_2).round();
        // 2^exponent taken out in two parts, so that no digit of w.re is lost.
        const HIGH: f64 = 0.693_147_180_369_123_8;
        const LOW: f64 = 1.908_214_929_270_587_7e-10;
        let rest = (w.re - exponent * HIGH) - exponent * LOW;
        Self { mantissa: C64::from_polar(rest.exp(), w.im), exponent: exponent as i32 }
    }

    /// The plain number: zero or infinite where it leaves the range of f64.
    pub fn value(self) -> C64 {
        self.mantissa * power_of_two(self.exponent)
    }

    /// Base-2 logarithm of the modulus.
    pub fn log2_norm(self) -> f64 {
        self.mantissa.norm().log2() + self.exponent as f64
    }

    /// Inverse.
    pub fn recip(self) -> Self {
        Self { mantissa: 1.0 / self.mantissa, exponent: -self.exponent }
    }
}

impl std::ops::Mul for Scaled {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { mantissa: self.mantissa * other.mantissa, exponent: self.exponent + other.exponent }
    }
}

/// 2^e, zero or infinite where it leaves the range of f64.
pub fn power_of_two(e: i32) -> f64 {
    match e {
        -1022..=1023 => f64::from_bits(((e + 1023) as u64) << 52),
        ..-1022 => 0.0,
        _ => f64::INFINITY,
    }
}

/// `F_0(z), .., F_n(z)` of one kind, each with its own exponent: no order and no loss makes it overflow.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    values: Vec<Scaled>,
}

/// Mantissas are brought back to about 1 when they grow beyond this.
const RESCALE: i32 = 200;

impl Sequence {
    /// `J_0..=J_n` by downward recurrence.
    ///
    /// J decays beyond the order |z| and is the smaller solution there, so the recurrence is stable downwards (DLMF 10.74(iv)).
    pub fn bessel(z: C64, n: usize) -> Self {
        let mut values = vec![Scaled::ZERO; n.max(1) + 1];
        downward(z, &mut values);
        Self { values }
    }

    /// `H_0..=H_n`, outgoing, by upward recurrence, which is stable for Im z >= 0.
    pub fn hankel(z: C64, n: usize) -> Self {
        let (start, e) = if z.norm() < POWERS_BELOW {
            (power_series(z).h, Scaled { mantissa: C64::new(1.0, 0.0), exponent: 0 })
        } else {
            (hankel01_scaled(z), Scaled::exp(I * z))
        };
        let mut exponent = e.exponent;
        let (mut last, mut this) = (start[0] * e.mantissa, start[1] * e.mantissa);
        let step = Step::new(z);
        let mut values = Vec::with_capacity(n.max(1) + 1);
        values.push(Scaled { mantissa: last, exponent });
        for m in 1..=n.max(1) {
            values.push(Scaled { mantissa: this, exponent });
            let next = step.factor(m) * this - last;
            (last, this) = (this, next);
            if size(this) > f64::powi(2.0, RESCALE) {
                let down = f64::powi(2.0, -RESCALE);
                (last, this) = (last * down, this * down);
                exponent += RESCALE;
            }
        }
        for v in &mut values {
            *v = normal(*v);
        }
        Self { values }
    }

    /// Highest order held.
    pub fn order(&self) -> usize {
        self.values.len() - 1
    }

    /// `F_n` with its exponent; negative orders by `F_{-n} = (-1)^n F_n`.
    pub fn get(&self, n: i64) -> Scaled {
        let mut v = self.values[n.unsigned_abs() as usize];
        if n < 0 && n & 1 != 0 {
            v.mantissa = -v.mantissa;
        }
        v
    }

    /// `F_n` as a plain number.
    pub fn value(&self, n: i64) -> C64 {
        self.get(n).value()
    }

    /// `F_n' = (F_{n-1} - F_{n+1}) / 2` with the exponent of F_n, for |n| < order.
    pub fn derivative(&self, n: i64) -> Scaled {
        let at = self.get(n).exponent;
        let part = |m: i64| {
            let v = self.get(m);
            v.mantissa * power_of_two(v.exponent - at)
        };
        Scaled { mantissa: 0.5 * (part(n - 1) - part(n + 1)), exponent: at }
    }
}

/// `2 m / z` for the recurrence `F_{m-1} + F_{m+1} = (2 m / z) F_m`.
///
/// The rounding of 2/z is the same in each step and would add up to a phase of |z| roundings; with its remainder, the steps' roundings are independent.
struct Step {
    high: C64,
    low: C64,
}

impl Step {
    fn new(z: C64) -> Self {
        let high = 2.0 / z;
        // 2 - z * high without the rounding of the products.
        let product = |a: f64, b: f64| {
            let p = a * b;
            (p, a.mul_add(b, -p))
        };
        let ((a, a_low), (b, b_low)) = (product(z.re, high.re), product(z.im, high.im));
        let ((c, c_low), (d, d_low)) = (product(z.re, high.im), product(z.im, high.re));
        let rest = C64::new(((2.0 - a) + b) - a_low + b_low, -(c + d) - c_low - d_low);
        Self { high, low: rest / z }
    }

    #[inline]
    fn factor(&self, m: usize) -> C64 {
        let m = m as f64;
        self.high * m + self.low * m
    }
}

fn size(z: C64) -> f64 {
    z.re.abs() + z.im.abs()
}

/// The same number with a mantissa in about [1/2, 2).
fn normal(v: Scaled) -> Scaled {
    let s = size(v.mantissa);
    if !(s.is_finite() && s > 0.0) {
        return v;
    }
    let shift = ((s.to_bits() >> 52) & 0x7ff) as i32 - 1023;
    Scaled { mantissa: v.mantissa * power_of_two(-shift), exponent: v.exponent + shift }
}

/// `J_0, J_1, ..` into `values` by downward recurrence. A sum over all orders ties it to J, or the larger of J_0 and J_1 from their asymptotic series.
///
/// (The crate's J is off by up to 6e-15 of its envelope near the real axis, and by a rounding of z at large |z|.)
fn downward(z: C64, values: &mut [Scaled]) {
    let start = start_order(z, values.len() - 1);
    let step = Step::new(z);
    let zero = C64::new(0.0, 0.0);
    let (mut above, mut this) = (zero, C64::new(1.0, 0.0));
    let mut exponent = 0;
    // sum of (-+ i)^m J_m over m != 0, which is (exp(-+ i z) - J_0) / 2: the sign for which nothing cancels (DLMF 10.12.1).
    let turn = if z.im >= 0.0 { I } else { -I };
    let mut sum = zero;
    for m in (0..=start).rev() {
        // Here `this` is F_m and `above` is F_{m+1}.
        if m < values.len() {
            values[m] = Scaled { mantissa: this, exponent };
        }
        if m == 0 {
            break;
        }
        // Horner: sum_m = F_m + sum_{m+1} / turn, so that each order gets its own power.
        sum = this - turn * sum;
        let below = step.factor(m) * this - above;
        (above, this) = (this, below);
        if size(this) > f64::powi(2.0, RESCALE) {
            let down = f64::powi(2.0, -RESCALE);
            (above, this, sum) = (above * down, this * down, sum * down);
            exponent += RESCALE;
        }
    }
    let wave = Scaled::exp(-turn * z);
    let ratio = if z.norm() <= ASYMPTOTIC_ABOVE {
        let sum = this - 2.0 * turn * sum;
        Scaled { mantissa: wave.mantissa / sum, exponent: wave.exponent - exponent }
    } else {
        let truth = bessel01_scaled(z);
        let m = usize::from(truth[1].norm_sqr() > truth[0].norm_sqr());
        let scale = Scaled::exp(C64::new(z.im.abs(), 0.0));
        Scaled {
            mantissa: truth[m] * scale.mantissa / values[m].mantissa,
            exponent: scale.exponent - values[m].exponent,
        }
    };
    for v in values {
        *v = normal(*v * ratio);
        if z.im == 0.0 {
            v.mantissa.im = 0.0;
        }
    }
}

/// Order at which a downward recurrence may start from (0, 1) so that J_n and all below it are exact: where the growing solution has gained 2^60 (Olver).
fn start_order(z: C64, n: usize) -> usize {
    let mut m = n.max(1).max(z.norm().ceil() as usize);
    let two_over_z = 2.0 / z;
    let (mut last, mut this) = (C64::new(0.0, 0.0), C64::new(1.0, 0.0));
    while size(this) < f64::powi(2.0, 60) {
        let next = two_over_z * m as f64 * this - last;
        (last, this) = (this, next);
        m += 1;
    }
    m
}

#[cfg(test)]
mod tests {
    //! Truth: digits of an arbitrary-precision calculation, and Wronskians (DLMF 10.5.3) over the range in use.
    use super::*;

    /// `(z, [J_0, J_1, H_0, H_1])`. Python 3.11, mpmath 1.3:
    /// ```text
    /// from mpmath import *; mp.dps = 60
    /// J = besselj; H = lambda n, z: 2/(pi*1j)*exp(-1j*pi*n/2)*besselk(n, -1j*z)
    /// print([nstr(f(n, mpc(x, y)), 17) for f in (J, H) for n in (0, 1)])
    /// ```
    #[rustfmt::skip]
    #[allow(clippy::excessive_precision, reason = "digits as printed")]
    const ORDERS_01: &[(C64, [C64; 4])] = &[
        (C64::new(0.01, 0.0), [C64::new(9.9997500015624957e-1, 0.0), C64::new(4.9999375002604162e-3, 0.0), C64::new(9.9997500015624957e-1, -3.0054556370836459), C64::new(4.9999375002604162e-3, -6.3678596282060655e+1)]),
        (C64::new(0.9, 0.3), [C64::new(8.236514129547051e-1, -1.2314376134552576e-1), C64::new(4.1957229153533372e-1, 1.0809565042502828e-1), C64::new(5.6703841796650785e-1, -7.5249480121988787e-2), C64::new(1.4794412287531321e-1, -7.1471933096250323e-1)]),
        (C64::new(1.0, 0.001), [C64::new(7.6519784913152653e-1, -4.4005063993611924e-4), C64::new(4.4005074831849513e-1, 3.2514713911419623e-4), C64::new(7.6441663645513775e-1, 8.781734831049604e-2), C64::new(4.3918127908320607e-1, -7.8088723942690445e-1)]),
        (C64::new(2.2, 0.0), [C64::new(1.1036226692217385e-1, 0.0), C64::new(5.5596304981906391e-1, 0.0), C64::new(1.1036226692217385e-1, 5.2078428538802269e-1), C64::new(5.5596304981906391e-1, 1.4877892897633682e-3)]),
        (C64::new(3.9, 2.5), [C64::new(-2.2392626715478611, 5.3248771896268702e-1), C64::new(-7.0823977467754778e-1, -2.0379142225350786), C64::new(-2.8329322163908924e-2, 9.7753376726571046e-3), C64::new(7.9246116669252642e-3, 3.0860794525068786e-2)]),
        (C64::new(0.5, 7.0), [C64::new(1.5064619056892836e+2, -7.5170399756533819e+1), C64::new(7.044083579997843e+1, 1.3907384222581328e+2), C64::new(1.3760478528165293e-4, -2.3243126818536466e-4), C64::new(-2.4777623324944589e-4, -1.4818834724994887e-4)]),
        (C64::new(17.0, 0.0), [C64::new(-1.6985425215118355e-1, 0.0), C64::new(-9.766849275778065e-2, 0.0), C64::new(-1.6985425215118355e-1, -9.2637198442323693e-2), C64::new(-9.766849275778065e-2, 1.6720503607723369e-1)]),
        (C64::new(63.9, 0.5), [C64::new(1.0808462384968411e-1, -1.483653014853409e-2), C64::new(3.2230488533372695e-2, 4.9731919698333935e-2), C64::new(5.8231520842029651e-2, 1.6548253360286356e-2), C64::new(1.7005334678620123e-2, -5.8107405132406569e-2)]),
        (C64::new(64.1, 12.0), [C64::new(6.7567088594805513e+3, -4.3632458866497857e+3), C64::new(4.4081997127974448e+3, 6.7144360190360019e+3), C64::new(5.616597739186301e-7, 2.297822543468608e-7), C64::new(2.3433927279082296e-7, -5.6073828004736396e-7)]),
        (C64::new(250.0, 0.0), [C64::new(-2.6053373425204234e-2, 0.0), C64::new(-4.326903841033075e-2, 0.0), C64::new(-2.6053373425204234e-2, -4.3216845440366268e-2), C64::new(-4.326903841033075e-2, 2.5966992185484582e-2)]),
        (C64::new(250.0, 40.0), [C64::new(-2.6370111276495144e+15, 5.2802686047562397e+15), C64::new(-5.2837748601274895e+15, -2.6258931299991297e+15), C64::new(-1.2408660059889608e-19, -1.731423829218914e-19), C64::new(-1.7343862787805303e-19, 1.2378801199915944e-19)]),
        (C64::new(3000.0, 0.0), [C64::new(-7.7918452618898996e-3, 0.0), C64::new(1.2306980664764856e-2, 0.0), C64::new(-7.7918452618898996e-3, 1.2308279134657472e-2), C64::new(1.2306980664764856e-2, 7.7938967499087473e-3)]),
    ];

    /// `(hankel, n, z, digits, power of ten)`, by the same functions with `e = floor(log10(abs(v)))`, `nstr(v/mpf(10)**e, 17)`.
    #[rustfmt::skip]
    #[allow(clippy::excessive_precision, reason = "digits as printed")]
    const HIGH_ORDERS: &[(bool, i64, C64, C64, i32)] = &[
        (false, 50, C64::new(1.0, 0.0), C64::new(2.9060049481732394, 0.0), -80),
        (true, 50, C64::new(1.0, 0.0), C64::new(0.0, -2.191142812605339), 77),
        (false, 200, C64::new(100.0, 0.0), C64::new(2.0594424939411679, 0.0), -41),
        (true, 200, C64::new(100.0, 0.0), C64::new(0.0, -8.9236648125530524), 37),
        (false, 30, C64::new(0.001, 0.0), C64::new(3.5110745564222169, 0.0), -132),
        (true, 30, C64::new(0.001, 0.0), C64::new(0.0, -3.0219607629673332), 129),
        (false, 100, C64::new(80.0, 300.0), C64::new(-5.2425923233070328, -6.422826611997922), 121),
        (true, 100, C64::new(80.0, 300.0), C64::new(7.157426797847272e-1, 9.4287661914216356e-1), -125),
        (false, 2000, C64::new(1900.0, 0.0), C64::new(6.8030992025913941, 0.0), -12),
        (true, 2000, C64::new(1900.0, 0.0), C64::new(6.8030992025913941e-19, -7.4933501621804225), 7),
        (false, 3000, C64::new(3100.0, 5.0), C64::new(-4.8727132459305088, 2.0675957105906788), -2),
        (true, 3000, C64::new(3100.0, 5.0), C64::new(-7.3373749243090628, -3.4159220797215308), -3),
        (false, 5, C64::new(20.0, 800.0), C64::new(3.4373218649714491, 1.5866852102868498), 345),
        (true, 5, C64::new(20.0, 800.0), C64::new(-4.1635212552780029e-1, -9.646149123737493e-1), -349),
    ];

    /// Largest error of any route; that of J against its envelope (|H^(1)| + |H^(2)|) / 2, since J has zeros near the real axis.
    fn error(z: C64, got: Cylinder01, want: &[C64; 4]) -> f64 {
        (0..2)
            .map(|n| {
                let (j, h) = (want[n].norm(), want[2 + n].norm());
                let floor = if z.norm() < 1.0 { j } else { 0.5 * (h + (2.0 * want[n] - want[2 + n]).norm()) };
                ((got.j[n] - want[n]).norm() / floor).max((got.h[n] - want[2 + n]).norm() / h)
            })
            .fold(0.0, f64::max)
    }

    /// The phase of a wave at |z| carries |z| roundings; beyond that 1e-15 or so.
    fn allowed(z: C64) -> f64 {
        3e-15 + 4e-16 * z.norm()
    }

    #[test]
    fn orders_0_and_1_agree_with_published_digits() {
        for (z, want) in ORDERS_01 {
            let err = error(*z, cylinder01(*z), want);
            assert!(err < allowed(*z), "crate at {z}: error {err:e}");
            let ray = Ray::new(*z / 3.0);
            let err = error(*z, ray.cylinder01(3.0), want);
            assert!(err < allowed(*z), "ray at {z}: error {err:e}");
            let h = ray.hankel01(3.0);
            assert!((h[0] - want[2]).norm() < allowed(*z) * want[2].norm(), "ray's hankel01 at {z}");
            let (js, hs) = (Sequence::bessel(*z, 1), Sequence::hankel(*z, 1));
            let got = Cylinder01 { j: [js.value(0), js.value(1)], h: [hs.value(0), hs.value(1)] };
            let err = error(*z, got, want);
            assert!(err < allowed(*z), "sequence at {z}: error {err:e}");
            if z.im == 0.0 {
                let h = real01(z.re);
                for n in 0..2 {
                    assert!((h[n] - want[2 + n]).norm() < allowed(*z) * want[2 + n].norm(), "real01 at {z}");
                }
            }
        }
        // Abramowitz and Stegun, Table 9.1, x = 1 and 10.
        let (one, ten) = (real01(1.0), real01(10.0));
        for (got, want) in [
            (one[0], (0.765_197_686_6, 0.088_256_964_2)),
            (one[1], (0.440_050_585_7, -0.781_212_821_3)),
            (ten[0], (-0.245_935_764_5, 0.055_671_167_3)),
            (ten[1], (0.043_472_746_2, 0.249_015_424_2)),
        ] {
            assert!((got.re - want.0).abs() < 6e-11 && (got.im - want.1).abs() < 6e-11, "{got} against {want:?}");
        }
    }

    #[test]
    fn high_orders_agree_with_published_digits() {
        for (hankel, n, z, want, power) in HIGH_ORDERS {
            let top = *n as usize + 5;
            let sequence = if *hankel { Sequence::hankel(*z, top) } else { Sequence::bessel(*z, top) };
            let got = sequence.get(*n);
            // Ten to a power in two halves, since the whole may leave the range.
            let half = 10f64.powi(power / 2);
            let rest = 10f64.powi(power - power / 2);
            let got = got.mantissa / half * power_of_two(got.exponent / 2) / rest
                * power_of_two(got.exponent - got.exponent / 2);
            let err = (got - want).norm() / want.norm();
            assert!(
                err < 2e-14 + 2e-16 * z.norm(),
                "hankel {hankel} order {n} at {z}: {got}, want {want}, error {err:e}"
            );
        }
    }

    /// J_{n+1} H_n - J_n H_{n+1} = 2 i / (pi z), DLMF 10.5.3 with H = J + i Y.
    #[test]
    fn wronskians_hold_at_all_orders() {
        let mut worst: f64 = 0.0;
        for size in [1e-3, 0.1, 1.0, 4.7, 30.0, 64.5, 300.0, 2000.0, 13000.0] {
            for angle in [0.0, 1e-9, 1e-3, 0.1, 0.7, 1.3, PI / 2.0] {
                let z = C64::from_polar(size, angle);
                let z = C64::new(if angle == PI / 2.0 { 0.0 } else { z.re }, z.im);
                let top = (1.3 * size) as usize + 60;
                let (j, h) = (Sequence::bessel(z, top), Sequence::hankel(z, top));
                // Roundings of the recurrence's |z| steps, most of which average out.
                let allowed = 2e-14 + 5e-17 * size;
                for n in 0..top as i64 {
                    let (a, b) = (j.get(n + 1) * h.get(n), j.get(n) * h.get(n + 1));
                    let (a, b) = (a.value(), b.value());
                    let want = 2.0 * I / (PI * z);
                    let err = (a - b - want).norm() / (a.norm() + b.norm());
                    worst = worst.max(err / allowed);
                    assert!(err < allowed, "n {n} z {z}: error {err:e}");
                    // The same with derivatives, J_n H_n' - J_n' H_n.
                    let (a, b) = ((j.get(n) * h.derivative(n)).value(), (j.derivative(n) * h.get(n)).value());
                    let err = (a - b - want).norm() / (a.norm() + b.norm());
                    assert!(err < allowed, "n {n} z {z}: error {err:e} with derivatives");
                }
            }
        }
        println!("largest error of a Wronskian: {worst:.2} of the allowance");
    }

    /// The fast path against the crate at many points of several rays, over all pieces and both series.
    #[test]
    fn rays_agree_with_the_crate() {
        for angle in [0.0, 1e-6, 0.01, 0.2, 0.9, 1.5, PI / 2.0] {
            let k = C64::from_polar(1.7, angle);
            let ray = Ray::new(k);
            let mut worst: f64 = 0.0;
            for i in 0..4000 {
                let r = 1e-6 * 1.006f64.powi(i);
                let z = k * r;
                if z.norm() > 500.0 || z.im > 600.0 {
                    break;
                }
                let (got, want) = (ray.cylinder01(r), cylinder01(z));
                let e = error(z, got, &[want.j[0], want.j[1], want.h[0], want.h[1]]);
                // The crate's H_0 is off by up to 6e-15 about |z| = 2.
                let allowed = 5e-15 + allowed(z);
                worst = worst.max(e / allowed);
                assert!(e < allowed, "z {z}: error {e:e}");
            }
            println!("angle {angle}: largest error {worst:.2} of the allowance");
        }
    }
}
