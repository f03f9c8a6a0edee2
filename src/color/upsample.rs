//! A smooth reflectance of a given color (Jakob and Hanika 2019): `S(c0 x^2 + c1 x + c2)` with
//! `S(t) = 1/2 + t / (2 sqrt(1 + t^2))`. Here x goes from -1 to 1 over 0.38 to 0.78 um, which conditions the
//! problem better than their [0, 1] and spans the same functions.
//!
//! They tabulate the coefficients over the RGB cube. Here each color is solved on demand, by damped
//! Gauss-Newton steps on the three residuals in CIELAB under D65. With `dS/dt = (1 + t^2)^(-3/2) / 2` the
//! derivative of XYZ by c_k is the sum over the spectrum of `x^(2 - k) dS/dt`, and that of CIELAB follows
//! from its roots. For colors at the border of the cube the coefficients diverge (a step in the spectrum);
//! they are clamped to a bound, and the remaining error is reported.

use super::{D65, X_BAR, Y_BAR, Z_BAR};
use super::{SPECTRUM_NODES, SPECTRUM_UM, lab_of_xyz, lab_root, spectrum_lambda_um, white_d65, xyz_of_reflectance};
use super::{delta_e, srgb_decode, xyz_of_linear_srgb};

/// Bound of each coefficient: S(300) = 1 - 3e-6, and the steepest step is a hundredth of the range wide.
const MAX: f64 = 300.0;
/// Maximum number of steps; a solve takes about ten.
const STEPS: usize = 200;

/// A reflectance in (0, 1) that is smooth in the wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothReflectance {
    /// Coefficients of x^2, x and 1, where x goes from -1 to 1 over 0.38 to 0.78 um.
    pub coefficients: [f64; 3],
    /// Delta E (1976) between the target color and that of this reflectance under D65.
    pub delta_e: f64,
}

/// S and its slope.
fn sigmoid(t: f64) -> (f64, f64) {
    let r = 1.0 / (1.0 + t * t).sqrt();
    (0.5 + 0.5 * t * r, 0.5 * r * r * r)
}

fn x_of(lambda_um: f64) -> f64 {
    let [from, to] = SPECTRUM_UM;
    (2.0 * (lambda_um - from) / (to - from) - 1.0).clamp(-1.0, 1.0)
}

fn value(c: &[f64; 3], x: f64) -> (f64, f64) {
    sigmoid((c[0] * x + c[1]) * x + c[2])
}

/// Residuals in CIELAB against `want` and their derivatives by the coefficients.
fn residuals(c: &[f64; 3], want: &[f64; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
    let (mut xyz, mut slopes, mut white) = ([0.0; 3], [[0.0; 3]; 3], 0.0);
    for i in 0..SPECTRUM_NODES {
        let x = x_of(spectrum_lambda_um(i));
        let (s, ds) = value(c, x);
        let powers = [x * x, x, 1.0];
        white += D65[i] * Y_BAR[i];
        for (k, bar) in [&X_BAR, &Y_BAR, &Z_BAR].into_iter().enumerate() {
            let weight = D65[i] * bar[i];
            xyz[k] += weight * s;
            (0..3).for_each(|p| slopes[k][p] += weight * ds * powers[p]);
        }
    }
    let lab = lab_of_xyz(xyz.map(|v| v / white));
    let d65 = white_d65();
    let root: [f64; 3] = std::array::from_fn(|k| lab_root(xyz[k] / white / d65[k]).1 / (white * d65[k]));
    let jacobian = std::array::from_fn(|row| {
        std::array::from_fn(|p| {
            let d = |k: usize| root[k] * slopes[k][p];
            match row {
                0 => 116.0 * d(1),
                1 => 500.0 * (d(0) - d(1)),
                _ => 200.0 * (d(1) - d(2)),
            }
        })
    });
    (std::array::from_fn(|k| lab[k] - want[k]), jacobian)
}

/// Solves the 3 x 3 system of the damped normal equations.
fn damped_step(j: &[[f64; 3]; 3], r: &[f64; 3], damping: f64) -> [f64; 3] {
    let mut normal: [[f64; 3]; 3] =
        std::array::from_fn(|a| std::array::from_fn(|b| (0..3).map(|k| j[k][a] * j[k][b]).sum()));
    let top = (0..3).map(|a| normal[a][a]).fold(0.0, f64::max);
    (0..3).for_each(|a| normal[a][a] += damping * (normal[a][a] + 1e-9 * top));
    let gradient: [f64; 3] = std::array::from_fn(|a| -(0..3).map(|k| j[k][a] * r[k]).sum::<f64>());
    super::times(&super::inverse(&normal), gradient)
}

impl SmoothReflectance {
    /// A reflectance with a color in encoded sRGB. Components are clamped to [0, 1]; NaN becomes 0.
    pub fn of_srgb(srgb: [f64; 3]) -> SmoothReflectance {
        SmoothReflectance::of_xyz(xyz_of_linear_srgb(srgb.map(|v| srgb_decode(v.max(0.0).min(1.0)))))
    }

    /// A reflectance with a color in XYZ under D65. A color that no reflectance reaches gives a near one, and
    /// `delta_e` is the error.
    pub fn of_xyz(xyz: [f64; 3]) -> SmoothReflectance {
        // Colors that are not finite become black.
        let xyz = if xyz.iter().all(|v| v.is_finite()) { xyz } else { [0.0; 3] };
        let want = lab_of_xyz(xyz);
        let gray = xyz[1].clamp(1e-6, 1.0 - 1e-6);
        // Solves S(t) = gray.
        let t = (gray - 0.5) / (gray * (1.0 - gray)).sqrt();
        let mut c = [0.0, 0.0, t.clamp(-MAX, MAX)];
        let cost = |r: &[f64; 3]| r.iter().map(|v| v * v).sum::<f64>();
        let (mut r, mut j) = residuals(&c, &want);
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            if cost(&r) < 1e-12 {
                break;
            }
            let step = damped_step(&j, &r, damping);
            let next: [f64; 3] = std::array::from_fn(|k| (c[k] + step[k]).clamp(-MAX, MAX));
            let (next_r, next_j) = residuals(&next, &want);
            if cost(&next_r) < cost(&r) {
                (c, r, j) = (next, next_r, next_j);
                damping = (damping * 0.3).max(1e-12);
            } else {
                damping *= 4.0;
                if damping > 1e12 {
                    break;
                }
            }
        }
        let mut got = SmoothReflectance { coefficients: c, delta_e: 0.0 };
        got.delta_e = delta_e(xyz_of_reflectance(|lambda| got.at(lambda)), xyz);
        got
    }

    /// The reflectance at a wavelength [um], 0 to 1; constant beyond 0.38 to 0.78 um; NaN gives the value at
    /// 0.38 um.
    pub fn at(&self, lambda_um: f64) -> f64 {
        let x = x_of(lambda_um);
        value(&self.coefficients, if x.is_nan() { -1.0 } else { x }).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Derivatives agree with finite differences.
    #[test]
    fn jacobian_is_the_derivative() {
        let (c, want) = ([3.0, -2.0, 0.4], [50.0, 10.0, -20.0]);
        let (_, j) = residuals(&c, &want);
        for p in 0..3 {
            let mut d = [c; 2];
            d[0][p] += 1e-5;
            d[1][p] -= 1e-5;
            let [a, b] = d.map(|c| residuals(&c, &want).0);
            for k in 0..3 {
                let slope = (a[k] - b[k]) / 2e-5;
                assert!((slope - j[k][p]).abs() < 1e-6 * (1.0 + slope.abs()), "{k} {p}: {slope} {}", j[k][p]);
            }
        }
    }

    /// The sRGB cube survives a round trip: Delta E is below 0.01 inside and below 1 at the faces, and
    /// reflectances are within (0, 1).
    #[test]
    fn colors_come_back() {
        let (mut inside, mut border, n) = (0.0f64, 0.0f64, 8);
        for i in 0..=n {
            for j in 0..=n {
                for k in 0..=n {
                    let srgb = [i, j, k].map(|v| f64::from(v) / f64::from(n));
                    let r = SmoothReflectance::of_srgb(srgb);
                    assert!((0..=90).all(|l| (0.0..=1.0).contains(&r.at(0.36 + 0.005 * f64::from(l)))));
                    if [i, j, k].iter().all(|v| (1..n).contains(v)) {
                        inside = inside.max(r.delta_e);
                    } else {
                        border = border.max(r.delta_e);
                    }
                }
            }
        }
        println!("Delta E: {inside:.2e} inside, {border:.3} at the faces");
        assert!(inside < 0.01 && border < 1.0, "{inside} {border}");
    }

    /// Grays are flat, white and black are nearly 1 and 0, and NaN is black.
    #[test]
    fn grays_are_flat() {
        for gray in [0.2, 0.5, 0.735_36] {
            let r = SmoothReflectance::of_srgb([gray; 3]);
            let linear = srgb_decode(gray);
            assert!((0..81).all(|i| (r.at(spectrum_lambda_um(i)) - linear).abs() < 1e-7), "{r:?}");
        }
        assert!(SmoothReflectance::of_srgb([1.0; 3]).at(0.5) > 0.999);
        assert!(SmoothReflectance::of_srgb([f64::NAN, 0.0, -1.0]).at(f64::NAN) < 1e-3);
        assert!(SmoothReflectance::of_xyz([f64::NAN; 3]).at(0.5) >= 0.0);
    }
}
