//! Numbers with derivatives: forward-mode differentiation by three parameters and one absorption.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number of derivatives of a [`Dual`]: by pitch, roughness, index and one absorption.
pub(super) const SLOTS: usize = 4;

/// The evaluator's number type: f64, or [`Dual`].
pub(super) trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Whether the number has derivatives. If so, a weight of 0 still contributes.
    const DERIVED: bool;

    /// A constant, whose derivatives are 0.
    fn from_f64(x: f64) -> Self;
    /// The value, without derivatives.
    fn value(self) -> f64;
    /// A function of the number, from its value and slope there (the chain rule).
    fn chain(self, value: f64, slope: f64) -> Self;

    fn exp(self) -> Self {
        let e = self.value().exp();
        self.chain(e, e)
    }

    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = self.value().sin_cos();
        (self.chain(s, c), self.chain(c, -s))
    }

    fn atan(self) -> Self {
        let x = self.value();
        self.chain(x.atan(), 1.0 / (1.0 + x * x))
    }

    /// The number clamped to bounds, beyond which the slope is 0.
    fn within(self, low: f64, high: f64) -> Self {
        match self.value() {
            v if v < low => Self::from_f64(low),
            v if v > high => Self::from_f64(high),
            _ => self,
        }
    }
}

impl Real for f64 {
    const DERIVED: bool = false;

    fn from_f64(x: f64) -> f64 {
        x
    }

    fn value(self) -> f64 {
        self
    }

    fn chain(self, value: f64, _: f64) -> f64 {
        value
    }
}

/// A number and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dual {
    pub(super) v: f64,
    pub(super) d: [f64; SLOTS],
}

impl Dual {
    /// A variable: its derivative is 1 in its own slot and 0 in the others.
    pub(super) fn variable(v: f64, slot: usize) -> Dual {
        Dual { v, d: std::array::from_fn(|i| f64::from(u8::from(i == slot))) }
    }

    fn map(self, other: Dual, v: f64, f: impl Fn(f64, f64) -> f64) -> Dual {
        Dual { v, d: std::array::from_fn(|i| f(self.d[i], other.d[i])) }
    }
}

impl Add for Dual {
    type Output = Dual;
    fn add(self, o: Dual) -> Dual {
        self.map(o, self.v + o.v, |a, b| a + b)
    }
}

impl Sub for Dual {
    type Output = Dual;
    fn sub(self, o: Dual) -> Dual {
        self.map(o, self.v - o.v, |a, b| a - b)
    }
}

impl Mul for Dual {
    type Output = Dual;
    #[expect(clippy::suspicious_arithmetic_impl, reason = "the product rule")]
    fn mul(self, o: Dual) -> Dual {
        self.map(o, self.v * o.v, |a, b| a * o.v + self.v * b)
    }
}

impl Div for Dual {
    type Output = Dual;
    #[expect(clippy::suspicious_arithmetic_impl, reason = "the quotient rule")]
    fn div(self, o: Dual) -> Dual {
        let v = self.v / o.v;
        self.map(o, v, |a, b| (a - v * b) / o.v)
    }
}

impl Neg for Dual {
    type Output = Dual;
    fn neg(self) -> Dual {
        Dual { v: -self.v, d: self.d.map(|d| -d) }
    }
}

impl Real for Dual {
    const DERIVED: bool = true;

    fn from_f64(x: f64) -> Dual {
        Dual { v: x, d: [0.0; SLOTS] }
    }

    fn value(self) -> f64 {
        self.v
    }

    fn chain(self, value: f64, slope: f64) -> Dual {
        Dual { v: value, d: self.d.map(|d| d * slope) }
    }
}
