//! The von Mises distribution of an angle about 0, `v(x) = exp(kappa cos x) / (2 pi I_0(kappa))`, for any
//! concentration.
//!
//! Both factors overflow for large kappa, but their ratio does not. It is
//! `v(x) = exp(-kappa (1 - cos x)) / (2 pi i0e(kappa))` with the scaled Bessel function `i0e = e^-kappa I_0`,
//! and `1 - cos x = 2 sin^2(x/2)` is half the squared chord, which loses no digits at small x.

use plywave::math::clamp_unit;
use std::f64::consts::PI;

/// Number of cells of the half turn, or of the part of it that contains light.
const CELLS: usize = 128;
/// Points and weights of Gauss-Legendre quadrature with 4 points on [0, 1].
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// A von Mises distribution with a table of its quantiles.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct VonMises {
    kappa: f32,
    /// 1 / (2 pi i0e(kappa)).
    normalizer: f32,
    /// Width of a cell [rad].
    step: f32,
    /// For each cell: the light at absolute angles below the cell, and within it.
    below: Vec<f32>,
    within: Vec<f32>,
    /// Density of that light at the ends of the cells, times the width of a cell.
    ends: Vec<f32>,
}

impl VonMises {
    /// The distribution of width `gamma` [rad], 0.01 to 1000, with kappa = 1 / gamma^2.
    pub(crate) fn new(gamma: f32) -> VonMises {
        let kappa = 1.0 / (f64::from(gamma) * f64::from(gamma));
        // Less than 1e-17 of the light lies beyond 9 widths.
        let reach = PI.min(9.0 * f64::from(gamma));
        let step = reach / CELLS as f64;
        let value = |x: f64| (-2.0 * kappa * (0.5 * x).sin().powi(2)).exp();
        let within: Vec<f64> =
            (0..CELLS).map(|j| GAUSS.iter().map(|(x, w)| w * step * value((j as f64 + x) * step)).sum()).collect();
        let total: f64 = within.iter().sum();
        let below = within.iter().scan(0.0, |sum, w| Some(std::mem::replace(sum, *sum + w)));
        VonMises {
            kappa: kappa as f32,
            normalizer: (0.5 / total) as f32,
            step: step as f32,
            below: below.map(|b| (b / total) as f32).collect(),
            within: within.iter().map(|w| (w / total) as f32).collect(),
            ends: (0..=CELLS).map(|j| (step * value(j as f64 * step) / total) as f32).collect(),
        }
    }

    /// Density [1/rad] at the angle whose squared chord, `2 - 2 cos x`, is `chord2`.
    pub(crate) fn eval(&self, chord2: f32) -> f32 {
        self.normalizer * (-0.5 * self.kappa * chord2).exp()
    }

    /// The angle below which the share `u` lies [rad]. Within a cell the quantile is the cubic through the
    /// shares and densities at its ends. `u` is clamped to [0, 1); NaN becomes 0.
    pub(crate) fn sample(&self, u: f32) -> f32 {
        let signed = 2.0 * clamp_unit(u) - 1.0;
        let share = signed.abs();
        let cell = self.below.partition_point(|b| *b <= share).saturating_sub(1);
        let (low, mass) = (self.step * cell as f32, self.within[cell]);
        // A cell of the far tail may have no light in f32. Its start is then as good as any point in it.
        let part = if mass > 0.0 { ((share - self.below[cell]) / mass).clamp(0.0, 1.0) } else { 0.0 };
        let slope = |end: f32| (end / mass.max(f32::MIN_POSITIVE)).min(9.0);
        let (a, b) = (slope(self.ends[cell]), slope(self.ends[cell + 1]));
        // The Hermite cubic from 0 to 1 with these slopes.
        let (c2, c3) = (3.0 - 2.0 * a - b, a + b - 2.0);
        let mut t = part;
        for _ in 0..3 {
            let value = t * (a + t * (c2 + t * c3)) - part;
            let rise = a + t * (2.0 * c2 + t * 3.0 * c3);
            t = (t - value / rise.max(1e-3)).clamp(0.0, 1.0);
        }
        (low + t * self.step).copysign(signed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distributions::longitudinal::i0e;

    #[test]
    fn normalizer_is_the_scaled_bessel_function() {
        for gamma in [0.01, 0.05, 0.3, 1.0, 3.0, 100.0f32] {
            let v = VonMises::new(gamma);
            let want = 1.0 / (std::f32::consts::TAU * i0e(1.0 / (gamma * gamma)));
            assert!((v.normalizer / want - 1.0).abs() < 2e-6, "{gamma}: {} and {want}", v.normalizer);
        }
        // scipy.special.i0e(10000), where I_0 itself overflows f64.
        let narrow = f64::from(VonMises::new(0.01).normalizer);
        assert!((narrow * std::f64::consts::TAU * 0.003_989_472_675_604_637 - 1.0).abs() < 2e-6, "{narrow}");
    }

    /// Quantiles agree with the integral of the density, in f64.
    #[test]
    fn samples_are_the_quantiles() {
        for gamma in [0.01, 0.1, 0.35, 0.8, 2.0, 1000.0f32] {
            let v = VonMises::new(gamma);
            let kappa = 1.0 / f64::from(gamma).powi(2);
            let reach = PI.min(9.0 * f64::from(gamma));
            let n = 40_000;
            let step = 2.0 * reach / f64::from(n);
            let density = |x: f64| (-2.0 * kappa * (0.5 * x).sin().powi(2)).exp();
            let total: f64 = (0..n).map(|k| density((f64::from(k) + 0.5) * step - reach) * step).sum();
            let mut below = 0.0;
            for k in 0..n {
                below += density((f64::from(k) + 0.5) * step - reach) * step / total;
                let x = f64::from(k + 1) * step - reach;
                if k % 97 == 0 && (1e-3..0.999).contains(&below) {
                    let got = f64::from(v.sample(below as f32));
                    // A share in f32 is accurate to 6e-8.
                    let tolerance = 2e-5 * f64::from(gamma).min(1.0) + 1e-7 * total / density(x);
                    assert!((got - x).abs() < tolerance, "{gamma}: {got}, want {x}");
                }
            }
        }
        let v = VonMises::new(0.2);
        assert!(v.sample(0.0) < -0.9 && v.sample(1.0) > 0.9 && v.sample(f32::NAN).is_finite());
    }
}
