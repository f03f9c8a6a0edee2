//! Branch-free scalar functions that vectorize in a loop over an array of lanes.
//!
//! Each function takes the type parameter `FMA`: a fused multiply-add if the target has it, otherwise a
//! product and a sum (there the fused form would be a call). The functions are not exact to the last bit;
//! tests check the accuracies below.

use std::f32::consts::{FRAC_PI_2, PI};

/// `a * b + c`.
#[inline(always)]
pub fn fma<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// The larger of two numbers; `b` if `a` is NaN.
#[inline(always)]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller of two numbers; `b` if `a` is NaN.
#[inline(always)]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Adding this to |x| < 2^22 rounds x to an integer, stored in the low bits of the sum.
const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23

/// `2^x` with a relative error of 3e-7 for x in [-126, 127]. Smaller x and NaN give 2^-126. Larger x is not
/// valid.
#[inline(always)]
pub fn exp2<const FMA: bool>(x: f32) -> f32 {
    exp2_within::<FMA>(max(x, -126.0))
}

/// [`exp2`] for x in [-126, 127] only. The result for other x is unspecified.
#[inline(always)]
pub fn exp2_within<const FMA: bool>(x: f32) -> f32 {
    let shifted = x + ROUND;
    let r = x - (shifted - ROUND);
    // Minimax polynomial on |r| <= 1/2, with a relative error of 1.1e-7, exact at 0.
    let p = fma::<FMA>(r, 1.330_026_4e-3, 9.669_708e-3);
    let p = fma::<FMA>(p, r, 5.550_56e-2);
    let p = fma::<FMA>(p, r, 2.402_228_2e-1);
    let p = fma::<FMA>(p, r, std::f32::consts::LN_2);
    let p = fma::<FMA>(p, r, 1.0);
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// `ln x` for normal x > 0, with an error of 1e-7 absolute plus 1e-7 relative.
#[inline(always)]
pub fn ln<const FMA: bool>(x: f32) -> f32 {
    // x = m 2^e with m in [sqrt(1/2), sqrt(2)). Subtracting the bits of sqrt(1/2) moves the border of e
    // there.
    const SQRT_HALF: u32 = 0x3f35_04f3;
    let shifted = x.to_bits().wrapping_sub(SQRT_HALF);
    let e = (shifted as i32 >> 23) as f32;
    let r = f32::from_bits((shifted & 0x007f_ffff) + SQRT_HALF) - 1.0;
    let r2 = r * r;
    // Minimax polynomial (Cephes logf).
    let p = fma::<FMA>(r, 7.037_683_6e-2, -1.151_461e-1);
    let p = fma::<FMA>(p, r, 1.167_7e-1);
    let p = fma::<FMA>(p, r, -1.242_014_1e-1);
    let p = fma::<FMA>(p, r, 1.424_932_3e-1);
    let p = fma::<FMA>(p, r, -1.666_805_8e-1);
    let p = fma::<FMA>(p, r, 2.000_071_5e-1);
    let p = fma::<FMA>(p, r, -2.499_999_4e-1);
    let p = fma::<FMA>(p, r, 3.333_333e-1);
    let p = fma::<FMA>(e, -2.121_944_4e-4, p * r * r2);
    let p = fma::<FMA>(r2, -0.5, p);
    fma::<FMA>(e, 0.693_359_4, r + p)
}

/// Sine and cosine of x half turns, both up to a common sign, which is the top bit of the third number. They
/// are accurate to 2e-7 for |x| <= 1000, because subtracting whole half turns is exact.
#[inline(always)]
pub fn sin_cos_half_turns<const FMA: bool>(x: f32) -> (f32, f32, u32) {
    let shifted = x + ROUND;
    let r = x - (shifted - ROUND);
    let r2 = r * r;
    // Minimax polynomials on |r| <= 1/2, with errors of 4e-9 and 6e-8.
    let s = fma::<FMA>(r2, 7.722_013e-2, -5.980_452e-1);
    let s = fma::<FMA>(s, r2, 2.550_031_4);
    let s = fma::<FMA>(s, r2, -5.167_707);
    let s = fma::<FMA>(s, r2, 3.141_592_5);
    let c = fma::<FMA>(r2, 2.200_806_6e-1, -1.332_093_8);
    let c = fma::<FMA>(c, r2, 4.058_451);
    let c = fma::<FMA>(c, r2, -4.934_795_4);
    let c = fma::<FMA>(c, r2, 1.0);
    (r * s, c, shifted.to_bits() << 31)
}

/// Coefficients by least squares on the Chebyshev nodes of [0, 1].
const ATAN: [f32; 8] = [
    0.999_999_34,
    -0.333_298_62,
    0.199_465_66,
    -0.139_086_32,
    0.096_421_994,
    -0.055_912_323,
    0.021_862_94,
    -0.004_054_559_4,
];

/// Arc tangent of y / x in (-pi, pi], with an error of 4e-7; 0 if both are 0.
#[inline(always)]
pub fn atan2<const FMA: bool>(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let top = max(ax, ay);
    let t = if top > 0.0 { min(ax, ay) / top } else { 0.0 };
    let s = t * t;
    let mut p = ATAN[7];
    for i in (0..7).rev() {
        p = fma::<FMA>(p, s, ATAN[i]);
    }
    let a = t * p;
    let a = if ay > ax { FRAC_PI_2 - a } else { a };
    let a = if x < 0.0 { PI - a } else { a };
    if y < 0.0 { -a } else { a }
}

/// `x` with its sign flipped if the top bit of `sign` is set.
#[inline(always)]
pub fn signed(x: f32, sign: u32) -> f32 {
    f32::from_bits(x.to_bits() ^ sign)
}

/// Sum by halves; the length must be a power of 2.
#[inline(always)]
pub fn halves<const J: usize>(mut x: [f32; J]) -> f32 {
    let mut n = J;
    while n > 1 {
        n /= 2;
        for j in 0..n {
            x[j] += x[j + n];
        }
    }
    x[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp2_is_accurate() {
        for i in 0..200_000 {
            let x = -126.0 + i as f32 * (252.9 / 200_000.0);
            let want = f64::from(x).exp2();
            for got in [exp2::<true>(x), exp2::<false>(x)] {
                let err = (f64::from(got) / want - 1.0).abs();
                assert!(err < 3e-7, "exp2({x}): got {got}, want {want}, err {err}");
            }
        }
        let lowest = 2f32.powi(-126);
        assert_eq!([exp2::<true>(f32::NAN), exp2::<true>(f32::NEG_INFINITY), exp2::<true>(-190.0)], [lowest; 3]);
        assert_eq!(exp2::<true>(0.0), 1.0);
    }

    #[test]
    fn ln_is_accurate() {
        for i in 0..400_000 {
            let x = (i as f32 * 4.3e-4 - 86.0).exp();
            let want = f64::from(x).ln();
            for got in [ln::<true>(x), ln::<false>(x)] {
                let err = (f64::from(got) - want).abs();
                assert!(err < 1e-7 + 1e-7 * want.abs(), "ln({x}): got {got}, want {want}, err {err}");
            }
        }
        assert_eq!(ln::<true>(1.0), 0.0);
    }

    #[test]
    fn sin_cos_is_accurate() {
        for i in 0..400_000 {
            let x = -100.0 + i as f32 * 5e-4;
            let (want_s, want_c) = (std::f64::consts::PI * f64::from(x)).sin_cos();
            for (s, c, sign) in [sin_cos_half_turns::<true>(x), sin_cos_half_turns::<false>(x)] {
                let (s, c) = (signed(s, sign), signed(c, sign));
                let err = (f64::from(s) - want_s).abs().max((f64::from(c) - want_c).abs());
                assert!(err < 2e-7, "sin, cos of {x} half turns: got {s} {c}, want {want_s} {want_c}, err {err}");
            }
        }
    }

    #[test]
    fn atan2_is_accurate() {
        for i in 0..400_000 {
            let angle = (f64::from(i) - 200_000.0) * (std::f64::consts::PI / 200_000.0);
            let (y, x) = ((1.7 * angle.sin()) as f32, (1.7 * angle.cos()) as f32);
            let want = f64::from(y).atan2(f64::from(x));
            for got in [atan2::<true>(y, x), atan2::<false>(y, x)] {
                let err = (f64::from(got) - want).abs();
                assert!(err < 4e-7, "atan2({y}, {x}): got {got}, want {want}, err {err}");
            }
        }
        assert_eq!([atan2::<true>(0.0, 0.0), atan2::<true>(0.0, 1.0), atan2::<true>(1.0, 0.0)], [0.0, 0.0, FRAC_PI_2]);
    }
}
