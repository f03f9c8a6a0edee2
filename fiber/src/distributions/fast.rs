//! Elementary functions for the analytic models, as wrappers of `math::simd`, with their accuracy.

use plywave::math::simd;
use std::f32::consts::{LOG2_E, TAU};

/// `e^x` for x <= 0, with a relative error of 3e-7 for x above -87; 1e-38 below.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    simd::exp2::<false>(x * LOG2_E)
}

/// Arc tangent of y / x, with an error of 4e-7.
#[inline(always)]
pub(crate) fn atan2(y: f32, x: f32) -> f32 {
    simd::atan2::<false>(y, x)
}

/// Arc tangents of y / x, with an error of 4e-7.
#[inline(always)]
pub(crate) fn atan2_each<const K: usize>(y: [f32; K], x: [f32; K]) -> [f32; K] {
    lanes(|k| simd::atan2::<false>(y[k], x[k]))
}

/// Arc sine of x in [-1, 1], with an error of 4e-7.
#[inline(always)]
pub(crate) fn asin(x: f32) -> f32 {
    atan2(x, ((1.0 - x) * (1.0 + x)).max(0.0).sqrt())
}

/// Logarithm of a normal x > 0.
#[inline(always)]
pub(crate) fn ln(x: f32) -> f32 {
    simd::ln::<false>(x)
}

/// An angle of at most 1e6, wrapped to [-pi, pi].
#[inline(always)]
pub(crate) fn wrapped(angle: f32) -> f32 {
    // Adding this number rounds to an integer.
    const ROUND: f32 = 12_582_912.0;
    angle - TAU * ((angle * (1.0 / TAU) + ROUND) - ROUND)
}

/// Sine and cosine of an angle of at most 1e3, with an error of 3e-7.
#[inline(always)]
pub(crate) fn sin_cos(angle: f32) -> (f32, f32) {
    let (sin, cos, sign) = simd::sin_cos_half_turns::<false>(angle * std::f32::consts::FRAC_1_PI);
    (simd::signed(sin, sign), simd::signed(cos, sign))
}

/// An array from a function of the index. `array::map` and `from_fn` compile to calls; this compiles to a
/// loop that vectorizes.
#[inline(always)]
pub(crate) fn lanes<T: Copy + Default, const N: usize>(mut of: impl FnMut(usize) -> T) -> [T; N] {
    let mut all = [T::default(); N];
    for n in 0..N {
        all[n] = of(n);
    }
    all
}
