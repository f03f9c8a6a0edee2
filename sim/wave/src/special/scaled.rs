//! Complex numbers with a separate binary exponent, which do not overflow for large orders or lossy media.

use super::C64;
use std::f64::consts::LN_2;

/// A complex number with a separate binary exponent: `mantissa * 2^exponent`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scaled {
    /// Complex mantissa, of ordinary size.
    pub mantissa: C64,
    /// Binary exponent.
    pub exponent: i32,
}

impl Scaled {
    pub(super) const ZERO: Self = Self { mantissa: C64::new(0.0, 0.0), exponent: 0 };

    /// `exp(w)` of any size.
    pub fn exp(w: C64) -> Self {
        let exponent = (w.re / LN_2).round();
        // 2^exponent is removed in two parts, so that no digit of w.re is lost.
        const HIGH: f64 = 0.693_147_180_369_123_8;
        const LOW: f64 = 1.908_214_929_270_587_7e-10;
        let rest = (w.re - exponent * HIGH) - exponent * LOW;
        Self { mantissa: C64::from_polar(rest.exp(), w.im), exponent: exponent as i32 }
    }

    /// The plain number: zero or infinite beyond the range of f64.
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

/// 2^e, zero or infinite beyond the range of f64.
pub fn power_of_two(e: i32) -> f64 {
    match e {
        -1022..=1023 => f64::from_bits(((e + 1023) as u64) << 52),
        ..-1022 => 0.0,
        _ => f64::INFINITY,
    }
}

pub(super) fn size(z: C64) -> f64 {
    z.re.abs() + z.im.abs()
}

/// Normalizes a number to a mantissa in about [1/2, 2).
pub(super) fn normal(v: Scaled) -> Scaled {
    let s = size(v.mantissa);
    if !(s.is_finite() && s > 0.0) {
        return v;
    }
    let shift = ((s.to_bits() >> 52) & 0x7ff) as i32 - 1023;
    Scaled { mantissa: v.mantissa * power_of_two(-shift), exponent: v.exponent + shift }
}
