//! The longitudinal function M_0 of d'Eon et al. 2011 and its exact sampling.
//!
//! Take a von Mises-Fisher distribution of concentration kappa = 1/v about the direction of latitude
//! -theta_i. The density of the latitude alone is `M(theta_i, theta_o) cos theta_o`: integrating
//! `kappa / (4 pi sinh kappa) exp(kappa cos gamma)` over the azimuth gives
//!
//! ```text
//! M = csch(1/v) / (2 v) exp(-sin theta_i sin theta_o / v) I_0(cos theta_i cos theta_o / v)
//! ```
//!
//! M therefore integrates to 1 over `cos theta_o d theta_o` at every theta_i and v, and its latitudes are
//! those of von Mises-Fisher samples. The exponents are cancelled analytically: with `I_0(x) = e^x i0e(x)`
//! and `chord^2 = (cos theta_i - cos theta_o)^2 + (sin theta_i + sin theta_o)^2`,
//!
//! ```text
//! M = exp(-chord^2 / (2 v)) i0e(cos theta_i cos theta_o / v) / (v (1 - exp(-2/v)))
//! ```
//!
//! which neither overflows nor loses digits for any small v.

use crate::distributions::fast::{exp, lanes, ln, sin_cos};

/// Sine and cosine of a latitude; the cosine is 0 or more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Latitude {
    pub(crate) sin: f32,
    pub(crate) cos: f32,
}

impl Latitude {
    #[inline]
    pub(crate) fn from_direction(w: [f32; 3]) -> Self {
        Latitude { sin: w[2], cos: (w[0] * w[0] + w[1] * w[1]).sqrt() }
    }
}

/// M_0 with the variance v = beta_m^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Longitudinal {
    v: f32,
    /// 1 / v.
    inverse: f32,
    /// 1 / (v (1 - exp(-2/v))).
    scale: f32,
    /// exp(-2/v).
    tail: f32,
}

impl Longitudinal {
    pub(crate) fn new(beta_m: f32) -> Self {
        let v = beta_m * beta_m;
        Longitudinal { v, inverse: 1.0 / v, scale: 1.0 / (-v * (-2.0 / v).exp_m1()), tail: (-2.0 / v).exp() }
    }

    /// M_0(theta_i, theta_o), a density over `cos theta_o d theta_o` (d'Eon 2011, Eq. 7).
    #[inline]
    pub(crate) fn eval(&self, i: Latitude, o: Latitude) -> f32 {
        let (across, along) = (i.cos - o.cos, i.sin + o.sin);
        let chord2 = across * across + along * along;
        self.scale * exp(-0.5 * chord2 * self.inverse) * i0e(i.cos * o.cos * self.inverse)
    }

    /// Samples a latitude with the density `M_0 cos theta_o` from two uniform numbers in [0, 1).
    ///
    /// The angle gamma from the mean direction has `P(1 - cos gamma < w) = (1 - e^(-w/v)) / (1 - e^(-2/v))`.
    #[inline]
    pub(crate) fn sample(&self, i: Latitude, u: [f32; 2]) -> Latitude {
        let w = (-self.v * ln(((1.0 - u[0]) + u[0] * self.tail).max(f32::MIN_POSITIVE))).clamp(0.0, 2.0);
        let (cos_gamma, sin_gamma) = (1.0 - w, (w * (2.0 - w)).max(0.0).sqrt());
        let (sin_psi, cos_psi) = sin_cos(std::f32::consts::TAU * u[1]);
        // The components, along the fiber's normal and its axis, of the mean direction at latitude -theta_i,
        // rotated by gamma.
        let x = i.cos * cos_gamma + i.sin * sin_gamma * cos_psi;
        let y = sin_gamma * sin_psi;
        let z = i.cos * sin_gamma * cos_psi - i.sin * cos_gamma;
        Latitude { sin: z.clamp(-1.0, 1.0), cos: (x * x + y * y).sqrt() }
    }
}

/// M_0 of three lobes at once, side by side in a vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ThreeLobes {
    inverse: [f32; 4],
    scale: [f32; 4],
}

impl ThreeLobes {
    pub(crate) fn new(lobes: &[Longitudinal; 3]) -> Self {
        let of = |get: fn(&Longitudinal) -> f32| lanes(|k| get(&lobes[k.min(2)]));
        ThreeLobes { inverse: of(|lobe| lobe.inverse), scale: of(|lobe| lobe.scale) }
    }

    /// [`Longitudinal::eval`] of each lobe at its own latitude. The fourth number repeats the third.
    #[inline]
    pub(crate) fn eval(&self, i: &[Latitude; 3], o: Latitude) -> [f32; 4] {
        let (sin, cos): ([f32; 4], [f32; 4]) = (lanes(|k| i[k.min(2)].sin), lanes(|k| i[k.min(2)].cos));
        let shape: [f32; 4] = lanes(|k| {
            let (across, along) = (cos[k] - o.cos, sin[k] + o.sin);
            self.scale[k] * exp(-0.5 * (across * across + along * along) * self.inverse[k])
        });
        let x: [f32; 4] = lanes(|k| cos[k] * o.cos * self.inverse[k]);
        let far: [f32; 4] = lanes(|k| i0e_far(x[k].max(LIMIT)));
        if x[0].min(x[1]).min(x[2]) > LIMIT {
            return lanes(|k| shape[k] * far[k]);
        }
        let near: [f32; 4] = lanes(|k| i0e_near(x[k].min(LIMIT)));
        lanes(|k| shape[k] * if x[k] <= LIMIT { near[k] } else { far[k] })
    }
}

/// Polynomial coefficients in t of `i0e(4 (t + 1))` and of `sqrt(x) i0e(x)` at `x = 16 / (t + 1)`, for t in
/// [-1, 1]. They were computed by `numpy.polynomial.chebyshev.chebinterpolate` (degrees 17 and 9, the latter
/// truncated) from `scipy.special.i0e`; the relative error is 1.3e-8 before rounding.
const NEAR: [f32; 18] = [
    0.207_001_93,
    -0.113_004_32,
    0.094_515_22,
    -0.089_043_29,
    0.087_354_05,
    -0.084_967_43,
    0.079_167_05,
    -0.069_500_05,
    0.057_325_88,
    -0.043_194_886,
    0.028_625_288,
    -0.019_090_662,
    0.014_507_777,
    -0.007_766_333,
    0.001_240_379_9,
    -0.000_899_162_3,
    0.001_978_308_7,
    -0.000_817_972_6,
];
const FAR: [f32; 6] = [0.402_176_5, 3.360_555_7e-3, 1.361_560_3e-4, 1.111_214_7e-5, 1.639_135e-6, 3.626_677e-7];

/// `e^-x I_0(x)` for x >= 0.
#[inline]
pub(crate) fn i0e(x: f32) -> f32 {
    if x <= LIMIT { i0e_near(x) } else { i0e_far(x) }
}

/// Argument at which the two forms meet.
const LIMIT: f32 = 8.0;

#[inline(always)]
fn i0e_near(x: f32) -> f32 {
    let t = 0.25 * x - 1.0;
    let t2 = t * t;
    // Even and odd powers are summed separately, as two chains that run in parallel.
    let part = |odd: usize| (0..9).rev().fold(0.0, |sum, k| sum * t2 + NEAR[2 * k + odd]);
    part(0) + t * part(1)
}

#[inline(always)]
fn i0e_far(x: f32) -> f32 {
    let t = 16.0 / x - 1.0;
    FAR.iter().rev().fold(0.0, |sum, c| sum * t + c) / x.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_lobes_are_each_lobe() {
        let lobes = [0.001, 0.3, 2.0].map(Longitudinal::new);
        for a in -9..=9 {
            for b in -9..=9 {
                let theta = [0.17 * f64::from(a), 0.17 * f64::from(b) + 1e-3];
                let i = [at(theta[0]), at(theta[0] + 0.1), at(0.5 * theta[0])];
                let got = ThreeLobes::new(&lobes).eval(&i, at(theta[1]));
                for k in 0..3 {
                    let want = lobes[k].eval(i[k], at(theta[1]));
                    assert!((got[k] - want).abs() <= 1e-6 * want, "{theta:?} {k}: {got:?}, want {want}");
                }
            }
        }
    }
    use plywave_check::chi2::chi2_test;
    use rand::{RngExt, SeedableRng};
    use std::f64::consts::{FRAC_PI_2, PI};

    fn at(theta: f64) -> Latitude {
        Latitude { sin: theta.sin() as f32, cos: theta.cos().abs() as f32 }
    }

    /// `e^-x I_0(x) = 1/pi integral over [0, pi] of exp(-x (1 - cos t))`, for which the trapezoidal rule
    /// converges exponentially.
    fn i0e_reference(x: f64) -> f64 {
        let n = 64 + 8 * x.sqrt() as usize;
        let value = |k: usize| (-x * (1.0 - (PI * k as f64 / n as f64).cos())).exp();
        (0.5 * (value(0) + value(n)) + (1..n).map(value).sum::<f64>()) / n as f64
    }

    /// M_0 as printed, in f64. It fails below v of about 0.003, where csch underflows.
    fn printed(v: f64, i: f64, o: f64) -> f64 {
        let x = i.cos() * o.cos() / v;
        (-i.sin() * o.sin() / v).exp() * i0e_reference(x) * x.exp() / (2.0 * v * (1.0 / v).sinh())
    }

    #[test]
    fn i0e_matches_published_digits_and_its_integral() {
        // scipy.special.i0e
        for (x, want) in [
            (0.0, 1.0),
            (0.1, 0.907_100_925_782_301),
            (1.0, 0.465_759_607_593_640_4),
            (3.0, 0.243_000_354_161_825_4),
            (8.1, 0.142_511_809_488_295_25),
            (20.0, 0.089_780_311_884_826),
            (500.0, 0.017_845_706_500_153_165),
            (1e6, 3.989_423_302_692_457_7e-4),
        ] {
            let (got, reference) = (f64::from(i0e(x as f32)), i0e_reference(x));
            assert!(
                (got / want - 1.0).abs() < 3e-6 && (reference / want - 1.0).abs() < 1e-11,
                "x {x}: {got} {reference} {want}"
            );
        }
        for k in 0..4000 {
            let x = 0.01 * k as f32;
            let (got, want) = (f64::from(i0e(x)), i0e_reference(f64::from(x)));
            assert!((got / want - 1.0).abs() < 3e-6, "x {x}: got {got}, want {want}");
        }
    }

    #[test]
    fn stable_form_is_the_printed_one() {
        for beta in [0.06, 0.1, 0.3, 1.0, 2.0_f64] {
            let m = Longitudinal::new(beta as f32);
            for i in [0.0, 0.4, 1.2, 1.5_f64] {
                for o in [-1.55, -1.2, -0.5, -0.4, -0.35, 0.0, 0.3, 1.5_f64] {
                    let (got, want) = (f64::from(m.eval(at(i), at(o))), printed(beta * beta, i, o));
                    let peak = printed(beta * beta, i, -i);
                    assert!((got - want).abs() < 1e-5 * peak, "beta {beta}, {i}, {o}: got {got}, want {want}");
                }
            }
        }
    }

    /// The integral of M_0 over `cos theta_o d theta_o` is 1 for every width and latitude, down to widths for
    /// which the printed form is 0/0.
    #[test]
    fn integrates_to_one() {
        for beta in [1e-3, 0.01, 0.05, 0.2, 0.7, 2.0_f64] {
            let m = Longitudinal::new(beta as f32);
            for i in [0.0, 0.3, 1.0, 1.4, 1.56, FRAC_PI_2] {
                // Midpoints over the interval within 12 widths of the peak, or over all latitudes for a wide
                // peak.
                let (low, high) = ((-i - 12.0 * beta).max(-FRAC_PI_2), (-i + 12.0 * beta).min(FRAC_PI_2));
                let n = 4000;
                let step = (high - low) / n as f64;
                let sum: f64 = (0..n)
                    .map(|k| low + (k as f64 + 0.5) * step)
                    .map(|o| f64::from(m.eval(at(i), at(o))) * o.cos() * step)
                    .sum();
                // f32 sines resolve a peak 1e-3 wide to 6e-5 of its width.
                let tolerance = 2e-5 + 1e-7 / beta;
                assert!((sum - 1.0).abs() < tolerance, "beta {beta}, theta_i {i}: {sum}");
            }
        }
    }

    #[test]
    fn samples_follow_the_density() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(11);
        let threshold = plywave_check::chi2::threshold(0.01, 20);
        for beta in [0.005, 0.05, 0.2, 0.7, 2.0_f64] {
            let m = Longitudinal::new(beta as f32);
            for i in [0.0, 0.7, -1.3, 1.565_f64] {
                let (low, high) = ((-i - 5.0 * beta).max(-FRAC_PI_2), (-i + 5.0 * beta).min(FRAC_PI_2));
                let bins = 60;
                let width = (high - low) / f64::from(bins);
                let trials = 100_000;
                let mut observed = vec![0.0; bins as usize + 1];
                for _ in 0..trials {
                    let s = m.sample(at(i), [rng.random(), rng.random()]);
                    assert!((s.sin * s.sin + s.cos * s.cos - 1.0).abs() < 1e-5, "{s:?}");
                    let theta = f64::from(s.sin).atan2(f64::from(s.cos));
                    let bin = (theta - low) / width;
                    let bin = if (0.0..f64::from(bins)).contains(&bin) { bin as usize } else { bins as usize };
                    observed[bin] += 1.0;
                }
                let mut expected: Vec<f64> = (0..bins)
                    .map(|b| {
                        let n = 40;
                        let step = width / f64::from(n);
                        let first = low + f64::from(b) * width;
                        (0..n)
                            .map(|k| first + (f64::from(k) + 0.5) * step)
                            .map(|o| f64::from(m.eval(at(i), at(o))) * o.cos() * step)
                            .sum::<f64>()
                            * f64::from(trials)
                    })
                    .collect();
                expected.push((f64::from(trials) - expected.iter().sum::<f64>()).max(0.0));
                let test = chi2_test(&observed, &expected);
                assert!(test.p_value > threshold, "beta {beta}, theta_i {i}: {test:?}");
            }
        }
    }
}
