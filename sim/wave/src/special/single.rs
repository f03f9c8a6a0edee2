//! Bessel functions of orders 0 and 1 at any one argument.

use super::C64;
use super::expansions::{
    ASYMPTOTIC_ABOVE, Cylinder01, POWERS_BELOW, bessel01_scaled, exp_i, hankel01_scaled, power_series,
};
use super::scaled::Scaled;
use super::sequence::downward;

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

/// `[H_0(z), H_1(z)]`, outgoing. Not finite at z = 0; zero where it underflows.
pub fn hankel01(z: C64) -> [C64; 2] {
    if z.norm() < POWERS_BELOW {
        return power_series(z).h;
    }
    let e = exp_i(z);
    hankel01_scaled(z).map(|h| h * e)
}

/// Bessel and Hankel functions of orders 0 and 1 at one argument.
pub fn cylinder01(z: C64) -> Cylinder01 {
    Cylinder01 { j: bessel01(z), h: hankel01(z) }
}
