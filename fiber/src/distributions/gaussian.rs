//! The Gaussian of Zinke 2007, 9.2: `g(I, x, w) = N exp(-x^2 / (2 w^2))`, normalized on [-I, I]. The printed
//! formula omits the square.

use crate::distributions::fast::{exp, lanes};
use plywave::math::clamp_unit;
use plywave::math::erf::{erf, erf_inverse, fast_erf};
use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2, TAU};

/// A Gaussian normalized on an interval about 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gaussian {
    width: f32,
    /// 1 / width.
    inverse: f32,
    half: f32,
    normalizer: f32,
    /// Share of the untruncated Gaussian that lies within the interval.
    inside: f32,
}

impl Gaussian {
    /// A Gaussian of standard deviation `width` before it is truncated to [-half, half].
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

    /// Density at `x`, which must be within the interval.
    #[inline]
    pub(crate) fn eval(&self, x: f32) -> f32 {
        let t = x * self.inverse;
        self.normalizer * exp(-0.5 * t * t)
    }

    /// The point below which the share `u` lies. `u` is clamped to [0, 1); NaN becomes 0.
    #[inline]
    pub(crate) fn sample(&self, u: f32) -> f32 {
        let x = SQRT_2 * self.width * erf_inverse(self.inside * (2.0 * clamp_unit(u) - 1.0));
        x.clamp(-self.half, self.half)
    }
}

/// A Gaussian truncated to an interval and normalized there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TruncatedGaussian {
    width: f32,
    /// 1 / width.
    inverse: f32,
    ends: [f32; 2],
    /// The error function at the ends of the interval.
    erf: [f32; 2],
    normalizer: f32,
}

impl TruncatedGaussian {
    /// A Gaussian about 0, of standard deviation `width` before it is truncated. If less than 1e-4 of it lies
    /// within the interval, the density is 0.
    #[inline]
    pub(crate) fn new(width: f32, ends: [f32; 2]) -> TruncatedGaussian {
        let at = FRAC_1_SQRT_2 / width;
        TruncatedGaussian::of_erf(width, ends, [fast_erf::<false>(ends[0] * at), fast_erf::<false>(ends[1] * at)])
    }

    /// Three Gaussians at once, side by side in a vector, from the width and the ends of each.
    #[inline]
    pub(crate) fn three(width: [f32; 3], ends: [[f32; 2]; 3]) -> [TruncatedGaussian; 3] {
        let erf: [f32; 8] = lanes(|k| {
            let lobe = (k / 2).min(2);
            fast_erf::<false>(ends[lobe][k % 2] * (FRAC_1_SQRT_2 / width[lobe]))
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

    /// Share of the untruncated Gaussian within the interval; 0 if the density is 0.
    #[inline]
    pub(crate) fn share(&self) -> f32 {
        if self.normalizer > 0.0 { 0.5 * (self.erf[1] - self.erf[0]) } else { 0.0 }
    }

    /// The median. If the interval contains nearly all of the Gaussian it is 0, which is exact to a
    /// thousandth of the width.
    #[inline]
    pub(crate) fn median(&self) -> f32 {
        if self.share() > 0.999 { 0.0 } else { self.sample(0.5) }
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

    /// The point below which the share `u` lies. `u` is clamped to [0, 1); NaN becomes 0.
    #[inline]
    pub(crate) fn sample(&self, u: f32) -> f32 {
        let e = self.erf[0] + clamp_unit(u) * (self.erf[1] - self.erf[0]);
        (SQRT_2 * self.width * erf_inverse(e.clamp(-1.0, 1.0))).max(self.ends[0]).min(self.ends[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
