//! Numerics that several models share: lookups on uniform axes, hashes, vectors, vectorizable functions, the
//! Faddeeva function, the error function.
//!
//! The module is public for the crates of this workspace; a host needs nothing from here.

pub mod axis;
pub mod erf;
pub mod faddeeva;
pub mod half;
pub mod hash;
pub mod simd;
pub mod vec3;

use simd::{max, min};

/// The largest f32 below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// A random number clamped to [0, 1): negative numbers and NaN become 0, and numbers of 1 or more become the
/// largest number below 1.
#[inline(always)]
pub fn clamp_unit(u: f32) -> f32 {
    min(max(u, 0.0), BELOW_ONE)
}

/// The integer at or below `x`, and the fraction in [0, 1], for |x| < 2^31. (`f32::floor` is a call into a
/// library on processors without SSE 4.)
#[inline(always)]
pub fn floor_fraction(x: f32) -> (i32, f32) {
    let whole = x as i32;
    let rest = x - whole as f32;
    if rest < 0.0 { (whole.wrapping_sub(1), rest + 1.0) } else { (whole, rest) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_numbers_are_clamped_to_the_half_open_interval() {
        assert_eq!(BELOW_ONE, 1f32.next_down());
        for (input, want) in [
            (0.25, 0.25),
            (0.0, 0.0),
            (-1.0, 0.0),
            (f32::NAN, 0.0),
            (1.0, BELOW_ONE),
            (f32::INFINITY, BELOW_ONE),
            (f32::NEG_INFINITY, 0.0),
        ] {
            assert_eq!(clamp_unit(input), want, "{input}");
        }
    }

    #[test]
    fn floors_are_those_of_the_library() {
        for i in -4000..4000 {
            let x = i as f32 * 0.0625 + 1e-3;
            let (whole, fraction) = floor_fraction(x);
            assert_eq!(whole as f32, x.floor());
            assert!((fraction - (x - x.floor())).abs() < 1e-6, "{x}: {fraction}");
        }
        assert_eq!(floor_fraction(-2.0), (-2, 0.0));
    }
}
