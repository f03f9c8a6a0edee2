//! Bessel functions of all orders 0..=n at one argument, by recurrence.

use super::C64;
use super::expansions::{ASYMPTOTIC_ABOVE, I, POWERS_BELOW, bessel01_scaled, hankel01_scaled, power_series};
use super::scaled::{Scaled, normal, power_of_two, size};

/// `F_0(z), .., F_n(z)` of one kind, each with its own exponent, without overflow at any order or loss.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    values: Vec<Scaled>,
}

/// Exponent beyond which mantissas are rescaled to about 1.
const RESCALE: i32 = 200;

impl Sequence {
    /// `J_0..=J_n` by downward recurrence.
    ///
    /// J decays beyond the order |z| and is the smaller solution there, so the recurrence is stable downwards
    /// (DLMF 10.74(iv)).
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
/// The rounding of 2/z is the same in each step and would add up to a phase of |z| roundings. With its
/// remainder, the steps' roundings are independent.
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

/// `J_0, J_1, ..` into `values` by downward recurrence. A sum over all orders ties it to J, or the larger of
/// J_0 and J_1 from their asymptotic series.
///
/// (The error of the crate's J is up to 6e-15 of its envelope near the real axis, and a rounding of z at
/// large |z|.)
pub(super) fn downward(z: C64, values: &mut [Scaled]) {
    let start = start_order(z, values.len() - 1);
    let step = Step::new(z);
    let zero = C64::new(0.0, 0.0);
    let (mut above, mut this) = (zero, C64::new(1.0, 0.0));
    let mut exponent = 0;
    // sum of (-+ i)^m J_m over m != 0, which is (exp(-+ i z) - J_0) / 2: the sign for which nothing cancels
    // (DLMF 10.12.1).
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

/// Order at which a downward recurrence may start from (0, 1) so that J_n and all below it are exact: where
/// the growing solution has gained 2^60 (Olver).
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
