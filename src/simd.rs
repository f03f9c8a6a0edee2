//! Branch-free scalar functions that a loop over an array of lanes turns into vector code.
//!
//! Each takes the type parameter `FMA`: fused multiply-add where the target has it, a product and a sum elsewhere (there the
//! fused form would be a call). Nothing here is exact to the last bit; the accuracies below are tested.

/// `a * b + c`.
#[inline(always)]
pub(crate) fn fma<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// The greater; `b` when `a` is not a number.
#[inline(always)]
pub(crate) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The lesser; `b` when `a` is not a number.
#[inline(always)]
pub(crate) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Adding this to |x| < 2^22 rounds x to an integer, which the low bits of the sum then hold.
const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23

/// `e^x` to 3e-7 relative for x in [-87, 88]; 0 below, and for what is not a number; clamped above.
#[inline(always)]
pub(crate) fn exp<const FMA: bool>(x: f32) -> f32 {
    let clamped = min(max(x, -87.0), 88.0);
    // n = round(x / ln 2), r = x - n ln 2 in two parts (Cody and Waite), |r| <= 0.347.
    let shifted = fma::<FMA>(clamped, std::f32::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = fma::<FMA>(n, -0.693_359_4, clamped);
    let r = fma::<FMA>(n, 2.121_944_4e-4, r);
    // Taylor to degree 6: the remainder is 0.347^7 / 5040 = 1.2e-7.
    let p = fma::<FMA>(r, 1.0 / 720.0, 1.0 / 120.0);
    let p = fma::<FMA>(p, r, 1.0 / 24.0);
    let p = fma::<FMA>(p, r, 1.0 / 6.0);
    let p = fma::<FMA>(p, r, 0.5);
    let p = fma::<FMA>(p, r, 1.0);
    let p = fma::<FMA>(p, r, 1.0);
    let scale = f32::from_bits((shifted.to_bits() << 23).wrapping_add(0x3f80_0000));
    if x >= -87.0 { p * scale } else { 0.0 }
}

/// Sine and cosine, to 2e-7 plus the rounding of x for |x| <= 1000.
#[inline(always)]
pub(crate) fn sin_cos<const FMA: bool>(x: f32) -> (f32, f32) {
    // n = round(x / (pi/2)), r = x - n pi/2 in three parts, |r| <= pi/4.
    let shifted = fma::<FMA>(x, std::f32::consts::FRAC_2_PI, ROUND);
    let n = shifted - ROUND;
    let r = fma::<FMA>(n, -1.570_312_5, x);
    let r = fma::<FMA>(n, -4.837_513e-4, r);
    let r = fma::<FMA>(n, -7.549_79e-8, r);
    let r2 = r * r;
    // Minimax polynomials on [-pi/4, pi/4] (Cephes sinf, cosf).
    let s = fma::<FMA>(r2, -1.951_529_6e-4, 8.332_161e-3);
    let s = fma::<FMA>(s, r2, -1.666_665_5e-1);
    let s = fma::<FMA>(s * r2, r, r);
    let c = fma::<FMA>(r2, 2.443_315_7e-5, -1.388_731_6e-3);
    let c = fma::<FMA>(c, r2, 4.166_664_6e-2);
    let c = fma::<FMA>(c * r2, r2, fma::<FMA>(r2, -0.5, 1.0));
    let quadrant = shifted.to_bits();
    let swap = quadrant & 1 != 0;
    let (a, b) = if swap { (c, s) } else { (s, c) };
    let sign_sin = (quadrant & 2) << 30;
    let sign_cos = (quadrant.wrapping_add(1) & 2) << 30;
    (f32::from_bits(a.to_bits() ^ sign_sin), f32::from_bits(b.to_bits() ^ sign_cos))
}

/// Sum of 8 lanes, by halves.
#[inline(always)]
pub(crate) fn sum8(a: [f32; 8]) -> f32 {
    ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
}

/// Sum of 16 lanes, by halves.
#[inline(always)]
pub(crate) fn sum16(a: &[f32; 16]) -> f32 {
    let mut b = [0.0; 8];
    for i in 0..8 {
        b[i] = a[i] + a[i + 8];
    }
    sum8(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_accurate() {
        for i in 0..200_000 {
            let x = -86.9 + i as f32 * (174.8 / 200_000.0);
            let want = f64::from(x).exp();
            for got in [exp::<true>(x), exp::<false>(x)] {
                let err = (f64::from(got) / want - 1.0).abs();
                assert!(err < 3e-7, "exp({x}): got {got}, want {want}, err {err}");
            }
        }
        assert_eq!([exp::<true>(f32::NAN), exp::<true>(f32::NEG_INFINITY), exp::<true>(-90.0)], [0.0; 3]);
        assert_eq!(exp::<true>(0.0), 1.0);
        assert!(exp::<true>(f32::INFINITY).is_finite());
    }

    #[test]
    fn sin_cos_is_accurate() {
        for i in 0..400_000 {
            let x = -100.0 + i as f32 * 5e-4;
            let (want_s, want_c) = f64::from(x).sin_cos();
            for (s, c) in [sin_cos::<true>(x), sin_cos::<false>(x)] {
                let err = (f64::from(s) - want_s).abs().max((f64::from(c) - want_c).abs());
                assert!(err < 2e-7, "sin_cos({x}): got {s} {c}, want {want_s} {want_c}, err {err}");
            }
        }
    }

    #[test]
    fn sums_add_every_lane() {
        let a: [f32; 16] = std::array::from_fn(|i| (1 << i) as f32);
        assert_eq!(sum16(&a), 65535.0);
        assert_eq!(sum8(std::array::from_fn(|i| a[i])), 255.0);
    }
}
