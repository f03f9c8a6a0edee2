//! The Gaussian of Zinke 2007, 9.2: `g(I, x, w) = N exp(-x^2 / (2 w^2))`, normalized on [-I, I]. The square is missing in print.

use super::fast::{exp, lanes, ln};
use crate::math::clamp_unit;
use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2, TAU};

/// A Gaussian normalized on an interval about 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gaussian {
    width: f32,
    /// 1 / width.
    inverse: f32,
    half: f32,
    normalizer: f32,
    /// Share of the Gaussian without limits that the interval holds.
    inside: f32,
}

impl Gaussian {
    /// Of the standard deviation `width` before it is cut at -half and half.
    pub(crate) fn new(width: f32, half: f32) -> Gaussian {
        let inside = erf(f64::from(half) / (f64::from(width) * std::f64::consts::SQRT_2)) as f32;
        Gaussian {
            width,
            inverse: 1.0 / width,
            half,
            inside,
            normalizer: 1.0 / (inside * width * std::f32::consts::TAU.sqrt()),
        }
    }

    /// Density at 0.
    #[inline]
    pub(crate) fn normalizer(&self) -> f32 {
        self.normalizer
    }

    /// Density at `x`, which the caller keeps within the interval.
    #[inline]
    pub(crate) fn eval(&self, x: f32) -> f32 {
        let t = x * self.inverse;
        self.normalizer * exp(-0.5 * t * t)
    }

    /// The place below which the share `u` lies.
    #[inline]
    pub(crate) fn sample(&self, u: f32) -> f32 {
        let x = SQRT_2 * self.width * erf_inverse(self.inside * (2.0 * clamp_unit(u) - 1.0));
        x.clamp(-self.half, self.half)
    }
}

/// A Gaussian cut to an interval and normalized there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TruncatedGaussian {
    width: f32,
    /// 1 / width.
    inverse: f32,
    ends: [f32; 2],
    /// The error function at the ends.
    erf: [f32; 2],
    normalizer: f32,
}

impl TruncatedGaussian {
    /// About 0, of the standard deviation `width` before it is cut. An interval with less than 1e-4 of its light has the density 0.
    #[inline]
    pub(crate) fn new(width: f32, ends: [f32; 2]) -> TruncatedGaussian {
        let at = FRAC_1_SQRT_2 / width;
        TruncatedGaussian::of_erf(width, ends, [fast_erf(ends[0] * at), fast_erf(ends[1] * at)])
    }

    /// Three at once, side by side in a vector: of each the width and the ends.
    #[inline]
    pub(crate) fn three(width: [f32; 3], ends: [[f32; 2]; 3]) -> [TruncatedGaussian; 3] {
        let erf: [f32; 8] = lanes(|k| {
            let lobe = (k / 2).min(2);
            fast_erf(ends[lobe][k % 2] * (FRAC_1_SQRT_2 / width[lobe]))
        });
        std::array::from_fn(|k| TruncatedGaussian::of_erf(width[k], ends[k], [erf[2 * k], erf[2 * k + 1]]))
    }

    #[inline(always)]
    fn of_erf(width: f32, ends: [f32; 2], erf: [f32; 2]) -> TruncatedGaussian {
        let inverse = 1.0 / width;
        let inside = 0.5 * (erf[1] - erf[0]);
        let normalizer = if inside > 1e-4 { inverse / (inside * TAU.sqrt()) } else { 0.0 };
        TruncatedGaussian { width, inverse, ends, erf, normalizer }
    }

    /// Whether any density is above 0.
    pub(crate) fn is_lit(&self) -> bool {
        self.normalizer > 0.0
    }

    /// Density at `x`.
    #[inline]
    pub(crate) fn eval(&self, x: f32) -> f32 {
        let t = x * self.inverse;
        self.normalizer * exp(-0.5 * t * t)
    }

    /// Density at 0.
    #[inline]
    pub(crate) fn normalizer(&self) -> f32 {
        self.normalizer
    }

    /// The place below which the share `u` lies.
    #[inline]
    pub(crate) fn sample(&self, u: f32) -> f32 {
        let e = self.erf[0] + clamp_unit(u) * (self.erf[1] - self.erf[0]);
        (SQRT_2 * self.width * erf_inverse(e.clamp(-1.0, 1.0))).max(self.ends[0]).min(self.ends[1])
    }
}

/// The error function to 5e-7 absolute (Abramowitz and Stegun 1964, 7.1.26).
#[inline]
fn fast_erf(x: f32) -> f32 {
    let z = x.abs();
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let p = ((((1.061_405_4 * t - 1.453_152) * t + 1.421_413_7) * t - 0.284_496_74) * t + 0.254_829_6) * t;
    (1.0 - p * exp(-(z * z).min(80.0))).copysign(x)
}

/// The error function: its series, and 1 beyond 5, where it is within 2e-12 of it.
pub(crate) fn erf(x: f64) -> f64 {
    if x.abs() > 5.0 {
        return x.signum();
    }
    // erf x = 2/sqrt(pi) exp(-x^2) sum of 2^n x^(2n+1) / (2n+1)!!: all terms of one sign.
    let (mut term, mut sum) = (x, x);
    for n in 1..120 {
        term *= 2.0 * x * x / f64::from(2 * n + 1);
        sum += term;
    }
    sum * (-x * x).exp() * std::f64::consts::FRAC_2_SQRT_PI
}

/// The inverse error function in single precision (Giles 2010, "Approximating the erfinv function").
#[inline]
fn erf_inverse(x: f32) -> f32 {
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
    let w = -ln(((1.0 - x) * (1.0 + x)).max(f32::MIN_POSITIVE));
    let (t, c) = if w < 5.0 { (w - 2.5, &NEAR) } else { (w.sqrt() - 3.0, &FAR) };
    x * c.iter().fold(0.0, |sum, c| sum * t + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erf_and_its_inverse_match_published_digits() {
        // scipy.special.erf
        for (x, want) in
            [(0.1, 0.112_462_916_018_284_9), (1.0, 0.842_700_792_949_714_9), (3.0, 0.999_977_909_503_001_4)]
        {
            assert!((erf(x) - want).abs() < 1e-14, "{x}: {}", erf(x));
            assert!((erf(-x) + want).abs() < 1e-14);
            for x in [x, -x] {
                let (got, want) = (f64::from(fast_erf(x as f32)), erf(x));
                assert!((got - want).abs() < 5e-7, "{x}: {got}, want {want}");
            }
        }
        for k in -99..100 {
            let x = 0.03 * f64::from(k);
            let (y, error) = (erf(x) as f32, f64::from(erf_inverse(erf(x) as f32)) - x);
            // An ulp of y counts 1/erf' in x.
            let ulp = 1.2e-7 * f64::from(y).abs() / (std::f64::consts::FRAC_2_SQRT_PI * (-x * x).exp());
            assert!(error.abs() < 2e-6 + ulp, "{x}: off by {error}");
        }
    }

    #[test]
    fn integrates_to_one_and_samples_are_its_quantiles() {
        for (width, half) in [(0.01, std::f32::consts::PI), (0.5, 1.0), (3.0, std::f32::consts::PI)] {
            let g = Gaussian::new(width, half);
            let n = 20_000;
            let step = 2.0 * half / n as f32;
            let mut below = 0.0f64;
            for k in 0..n {
                below += f64::from(g.eval((k as f32 + 0.5) * step - half) * step);
                let x = (k + 1) as f32 * step - half;
                if k % 500 == 0 && (0.01..0.99).contains(&below) {
                    let got = g.sample(below as f32);
                    assert!((got - x).abs() < 2e-4 * width + step, "{width}: {got}, want {x}");
                }
            }
            assert!((below - 1.0).abs() < 1e-4, "{width} {half}: {below}");
        }
    }
}
