//! The error function and its inverse, in f32 and f64.

use super::simd::{exp2_within, fma, ln, min};
use std::f32::consts::LOG2_E;

/// The error function with an absolute error of 5e-7: 1.5e-7 of Abramowitz and Stegun 1964, 7.1.26, plus
/// rounding.
#[inline(always)]
pub fn fast_erf<const FMA: bool>(x: f32) -> f32 {
    let z = x.abs();
    let t = 1.0 / fma::<FMA>(0.327_591_1, z, 1.0);
    let mut p = 1.061_405_4;
    for c in [-1.453_152, 1.421_413_7, -0.284_496_74, 0.254_829_6] {
        p = fma::<FMA>(p, t, c);
    }
    (1.0 - p * t * exp2_within::<FMA>(-min(z * z, 80.0) * LOG2_E)).copysign(x)
}

/// Coefficients over x^2 of the numerator of [`erf_from_0`] over x.
pub const OVER: [f32; 7] =
    [-1.609_603_3e-2, -2.954_6e-3, -7.349_906_3e-4, -5.692_506_4e-5, -2.101_024e-6, 2.770_681_4e-8, -2.726_142_3e-10];
/// Coefficients over x^2 of its denominator.
pub const UNDER: [f32; 5] = [-1.426_474e-2, -7.373_329_2e-3, -1.682_827e-3, -2.133_740_6e-4, -1.456_607_2e-5];

/// The error function of x >= 0 with a relative error of 5e-7, at small x too: a quotient of polynomials, as
/// in linear algebra libraries (Eigen, XLA). Beyond 4 it is 1.
#[inline(always)]
pub fn erf_from_0(x: f32) -> f32 {
    let x = min(x, 4.0);
    let of = |c: &[f32]| c.iter().rev().fold(0.0, |sum, c| sum * (x * x) + c);
    min(x * of(&OVER) / of(&UNDER), 1.0)
}

/// The error function from its series. Beyond 5 it is 1, which is exact to 2e-12.
pub fn erf(x: f64) -> f64 {
    if x.abs() > 5.0 {
        return x.signum();
    }
    // erf x = 2/sqrt(pi) exp(-x^2) sum of 2^n x^(2n+1) / (2n+1)!!, in which all terms have the same sign.
    let (mut term, mut sum) = (x, x);
    for n in 1..120 {
        term *= 2.0 * x * x / f64::from(2 * n + 1);
        sum += term;
    }
    sum * (-x * x).exp() * std::f64::consts::FRAC_2_SQRT_PI
}

/// The inverse error function in f32 (Giles 2010, "Approximating the erfinv function").
#[inline]
pub fn erf_inverse(x: f32) -> f32 {
    const NEAR: [f32; 9] = [
        2.810_226_4e-8,
        3.432_739_4e-7,
        -3.523_387_7e-6,
        -4.391_506_5e-6,
        2.185_808_7e-4,
        -1.253_725e-3,
        -4.177_681_6e-3,
        2.466_407_3e-1,
        1.501_409_4,
    ];
    const FAR: [f32; 9] = [
        -2.002_142_6e-4,
        1.009_505_6e-4,
        1.349_343_2e-3,
        -3.673_428_5e-3,
        5.739_508e-3,
        -7.622_461e-3,
        9.438_87e-3,
        1.001_674,
        2.832_976_8,
    ];
    let w = -ln::<false>(((1.0 - x) * (1.0 + x)).max(f32::MIN_POSITIVE));
    let (t, c) = if w < 5.0 { (w - 2.5, &NEAR) } else { (w.sqrt() - 3.0, &FAR) };
    x * c.iter().fold(0.0, |sum, c| sum * t + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erf_of_small_numbers_keeps_its_digits() {
        for i in 1..9000 {
            let x = 5e-4 * i as f32 * if i % 3 == 0 { 1e-3 } else { 1.0 };
            let want = erf(f64::from(x));
            let off = (f64::from(erf_from_0(x)) / want - 1.0).abs();
            assert!(off < 5e-7, "erf({x}): off by {off}");
        }
    }

    #[test]
    fn erf_and_its_inverse_match_published_digits() {
        // scipy.special.erf
        for (x, want) in
            [(0.1, 0.112_462_916_018_284_9), (1.0, 0.842_700_792_949_714_9), (3.0, 0.999_977_909_503_001_4)]
        {
            assert!((erf(x) - want).abs() < 1e-14, "{x}: {}", erf(x));
            assert!((erf(-x) + want).abs() < 1e-14);
        }
        for i in -4000..=4000 {
            let x = 1e-3 * f64::from(i);
            for got in [fast_erf::<true>(x as f32), fast_erf::<false>(x as f32)] {
                assert!((f64::from(got) - erf(x)).abs() < 5e-7, "{x}: {got}, want {}", erf(x));
            }
        }
        for k in -99..100 {
            let x = 0.03 * f64::from(k);
            let (y, error) = (erf(x) as f32, f64::from(erf_inverse(erf(x) as f32)) - x);
            // An error of one ulp in y is an error of 1/erf' in x.
            let ulp = 1.2e-7 * f64::from(y).abs() / (std::f64::consts::FRAC_2_SQRT_PI * (-x * x).exp());
            assert!(error.abs() < 2e-6 + ulp, "{x}: off by {error}");
        }
    }
}
