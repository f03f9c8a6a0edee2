//! Radial parts of Helmholtz's Green function, tabulated over distance, with the logarithm split off.
//!
//! `G(R) = (i/4) H0(kappa R)` and `D(R) = G'(R)/R = -(i kappa/4) H1(kappa R)/R` suffice for the boundary
//! operators: their kernels are these two times dot products of the distance with normals and tangents. At
//! one wavelength and latitude they are functions of R alone, so they are sampled once: near R = 0 as
//! `L(R^2) ln R + B(R^2) + c/R^2` with power series L and B (Abramowitz and Stegun 9.1.12-13), farther out by
//! piecewise polynomials through Chebyshev points.
//!
//! On a wall between media o (outside) and i (inside) a second-kind equation has differences only.
//! [`WallKernel`] tabulates its four sums, so that their 1/R^2 and log parts cancel in the series and not in
//! rounded numbers.
//!
//! The quadrature on clear walls needs the factor L of the logarithm, `-J0(kappa R)/(2 pi)` for G: -2/pi
//! times the imaginary part of the tabulated functions. With loss J0 grows as `exp(Im kappa R)` while G
//! decays; such walls do not split the logarithm off ([`vicinity`](crate::boundary::vicinity)).

use crate::C64;
use crate::special::Ray;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Euler's constant.
const EULER: f64 = 0.577_215_664_901_532_9;
/// Terms of the power series: the last one is below 1e-16 at `|kappa| R = NEAR`.
const TERMS: usize = 18;
/// The series is used for `|kappa| R` below this.
const NEAR: f64 = 4.0;
/// Coefficients of a polynomial piece, which spans `1/|kappa|`: with [`NEAR`] the error of the first piece is
/// 1e-14.
const DEGREE: usize = 12;

/// `G` and `D` at a distance.
fn green(kappa: C64, ray: &Ray, r: f64) -> [C64; 2] {
    let [h0, h1] = ray.hankel01(r);
    [C64::I * h0 * 0.25, -C64::I * kappa * h1 * (0.25 / r)]
}

/// `log(R^2) ln R + regular(R^2) + pole / R^2`.
#[derive(Clone, Copy)]
struct Series {
    log: [C64; TERMS],
    regular: [C64; TERMS],
    pole: C64,
}

impl Series {
    const ZERO: Self = Self { log: [C64::ZERO; TERMS], regular: [C64::ZERO; TERMS], pole: C64::ZERO };

    /// The series of G and D.
    fn green(kappa: C64) -> [Self; 2] {
        // One more term than stored, for the derivative.
        let (mut log, mut regular) = ([C64::ZERO; TERMS + 1], [C64::ZERO; TERMS + 1]);
        let quarter = -0.25 * kappa * kappa;
        let at_zero = (0.5 * kappa).ln() + EULER;
        let (mut power, mut harmonic) = (C64::ONE, 0.0);
        for k in 0..=TERMS {
            if k > 0 {
                power *= quarter / (k * k) as f64;
                harmonic += 1.0 / k as f64;
            }
            // J0 = sum power R^2k;  Y0 = (2/pi) [(ln R + at_zero) J0 - sum harmonic power R^2k].
            log[k] = power * (-0.5 / PI);
            regular[k] = 0.25 * C64::I * power - (at_zero - harmonic) * power * (0.5 / PI);
        }
        let mut value = Self::ZERO;
        let mut slope = Self::ZERO;
        for k in 0..TERMS {
            let next = 2.0 * (k + 1) as f64;
            value.log[k] = log[k];
            value.regular[k] = regular[k];
            slope.log[k] = next * log[k + 1];
            slope.regular[k] = next * regular[k + 1] + log[k + 1];
        }
        slope.pole = log[0];
        [value, slope]
    }

    fn add(&mut self, factor: C64, other: &Self) {
        for k in 0..TERMS {
            self.log[k] += factor * other.log[k];
            self.regular[k] += factor * other.regular[k];
        }
        self.pole += factor * other.pole;
    }

    /// Factor of the logarithm, and the regular part.
    fn parts(&self, rho: f64) -> (C64, C64) {
        let (mut log, mut regular) = (C64::ZERO, C64::ZERO);
        for k in (0..TERMS).rev() {
            log = log * rho + self.log[k];
            regular = regular * rho + self.regular[k];
        }
        (log, regular)
    }

    /// Value, and factor of the logarithm.
    fn eval(&self, r: f64) -> (C64, C64) {
        let (log, regular) = self.parts(r * r);
        (log * r.ln() + regular + self.pole / (r * r), log)
    }

    /// Value without the pole.
    fn smoother(&self, r: f64) -> C64 {
        let (log, regular) = self.parts(r * r);
        log * r.ln() + regular
    }
}

/// F real functions on `[start, ..)` by polynomials on equal pieces.
struct Piecewise<const F: usize> {
    start: f64,
    per_um: f64,
    /// `[piece][power]`, the functions side by side.
    pieces: Vec<[[f64; F]; DEGREE]>,
}

impl<const F: usize> Piecewise<F> {
    fn new(start: f64, end: f64, step: f64, f: impl Fn(f64) -> [f64; F] + Sync) -> Self {
        // From values at the Chebyshev points to Chebyshev coefficients to powers.
        let nodes: [f64; DEGREE] = std::array::from_fn(|j| (PI * (j as f64 + 0.5) / DEGREE as f64).cos());
        let mut to_power = [[0.0; DEGREE]; DEGREE];
        let (mut before, mut this) = ([0.0; DEGREE], [0.0; DEGREE]);
        this[0] = 1.0;
        for n in 0..DEGREE {
            for j in 0..DEGREE {
                let at_node = (n as f64 * PI * (j as f64 + 0.5) / DEGREE as f64).cos();
                let weight = if n == 0 { 1.0 } else { 2.0 } / DEGREE as f64;
                for p in 0..DEGREE {
                    to_power[p][j] += this[p] * at_node * weight;
                }
            }
            let mut next = [0.0; DEGREE];
            for p in 0..DEGREE {
                if p > 0 {
                    next[p] += if n == 0 { 1.0 } else { 2.0 } * this[p - 1];
                }
                if n > 0 {
                    next[p] -= before[p];
                }
            }
            before = this;
            this = next;
        }
        let count = ((end - start) / step).ceil().max(1.0) as usize + 1;
        let pieces = (0..count)
            .into_par_iter()
            .map(|piece| {
                let values = nodes.map(|x| f(start + step * (piece as f64 + 0.5 * (x + 1.0))));
                let mut powers = [[0.0; F]; DEGREE];
                for p in 0..DEGREE {
                    for j in 0..DEGREE {
                        for k in 0..F {
                            powers[p][k] += to_power[p][j] * values[j][k];
                        }
                    }
                }
                powers
            })
            .collect();
        Self { start, per_um: 1.0 / step, pieces }
    }

    #[inline(always)]
    fn eval(&self, r: f64) -> [f64; F] {
        let s = (r - self.start) * self.per_um;
        let piece = (s as usize).min(self.pieces.len() - 1);
        let x = 2.0 * (s - piece as f64) - 1.0;
        let c = &self.pieces[piece];
        let mut value = c[DEGREE - 1];
        for p in (0..DEGREE - 1).rev() {
            for k in 0..F {
                value[k] = value[k] * x + c[p][k];
            }
        }
        value
    }

    fn end(&self) -> f64 {
        self.start + self.pieces.len() as f64 / self.per_um
    }
}

/// One medium that takes part in a kernel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Medium {
    /// Transverse wavenumber [1/um].
    pub kappa: C64,
    /// Relative permittivity.
    pub eps: C64,
}

/// The radial sums of the equations' kernels over media j with signs s: `g = sum s G_j`,
/// `eg = sum s eps_j G_j`, `d = sum s D_j`, `ed = sum s eps_j D_j`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Radial {
    pub g: C64,
    pub eg: C64,
    pub d: C64,
    pub ed: C64,
}

impl Radial {
    fn from_sums(v: [C64; 4]) -> Self {
        Self { g: v[0], eg: v[1], d: v[2], ed: v[3] }
    }
}

/// `G` and `D` of one medium at distances away from zero.
pub(crate) struct MediumKernel {
    medium: Medium,
    series: [Series; 2],
    near: f64,
    table: Piecewise<4>,
}

impl MediumKernel {
    /// Tabulates distances up to `reach_um`.
    pub(crate) fn new(medium: Medium, reach_um: f64) -> Self {
        let kappa = medium.kappa;
        let step = 1.0 / kappa.norm();
        let near = NEAR * step;
        let ray = Ray::new(kappa);
        let table = Piecewise::new(near, reach_um.max(near), step, |r| {
            let [g, d] = green(kappa, &ray, r);
            [g.re, g.im, d.re, d.im]
        });
        Self { medium, series: Series::green(kappa), near, table }
    }

    /// `(G, D)` at distance r.
    #[inline(always)]
    pub(crate) fn eval(&self, r: f64) -> (C64, C64) {
        if r < self.near {
            return (self.series[0].eval(r).0, self.series[1].eval(r).0);
        }
        let v = self.table.eval(r);
        (C64::new(v[0], v[1]), C64::new(v[2], v[3]))
    }

    /// The sums of the equations for this medium alone, times `factor`.
    #[inline(always)]
    pub(crate) fn radial(&self, r: f64, factor: f64) -> Radial {
        let (g, d) = self.eval(r);
        let (g, d) = (g * factor, d * factor);
        Radial { g, eg: g * self.medium.eps, d, ed: d * self.medium.eps }
    }
}

/// The sums over both sides of a wall, outside minus inside.
pub(crate) struct WallKernel {
    series: [Series; 4],
    near: f64,
    table: Piecewise<8>,
}

impl WallKernel {
    /// Tabulates distances up to `reach_um`.
    pub(crate) fn new(outside: Medium, inside: Medium, reach_um: f64) -> Self {
        let mut series = [Series::ZERO; 4];
        for (sign, medium) in [(1.0, outside), (-1.0, inside)] {
            let [g, d] = Series::green(medium.kappa);
            for (sum, (factor, part)) in
                series.iter_mut().zip([(C64::ONE, &g), (medium.eps, &g), (C64::ONE, &d), (medium.eps, &d)])
            {
                sum.add(factor * sign, part);
            }
        }
        let rays = [Ray::new(outside.kappa), Ray::new(inside.kappa)];
        let step = 1.0 / outside.kappa.norm().max(inside.kappa.norm());
        let near = NEAR * step;
        let table = Piecewise::new(near, reach_um.max(near), step, |r| {
            let [go, do_] = green(outside.kappa, &rays[0], r);
            let [gi, di] = green(inside.kappa, &rays[1], r);
            let v = [go - gi, outside.eps * go - inside.eps * gi, do_ - di, outside.eps * do_ - inside.eps * di];
            std::array::from_fn(|k| if k % 2 == 0 { v[k / 2].re } else { v[k / 2].im })
        });
        Self { series, near, table }
    }

    /// The sums at distance `r > 0` on a wall between clear media, times `h`, plus half the logarithm's
    /// factor (of ln R) times `q`.
    #[inline(always)]
    pub(crate) fn weighted(&self, r: f64, h: f64, q: f64) -> Radial {
        if r < self.near {
            let q = 0.5 * q;
            return Radial::from_sums(std::array::from_fn(|k| {
                let (value, log) = self.series[k].eval(r);
                value * h + log * q
            }));
        }
        debug_assert!(r <= self.table.end(), "distance {r} beyond the table's {}", self.table.end());
        let mut v = self.table.eval(r);
        // L = -(2/pi) Im: the factor is real.
        let q = -q / PI;
        for k in 0..4 {
            v[2 * k] = v[2 * k] * h + v[2 * k + 1] * q;
            v[2 * k + 1] *= h;
        }
        Radial::from_sums(std::array::from_fn(|k| C64::new(v[2 * k], v[2 * k + 1])))
    }

    /// The sums at distance `r > 0`, times `h`, without the pole of `ed`.
    #[inline(always)]
    pub(crate) fn without_pole(&self, r: f64, h: f64) -> Radial {
        if r < self.near {
            return Radial::from_sums(std::array::from_fn(|k| self.series[k].smoother(r) * h));
        }
        let v = self.table.eval(r);
        let mut sums: [C64; 4] = std::array::from_fn(|k| C64::new(v[2 * k], v[2 * k + 1]));
        sums[3] -= self.pole() / (r * r);
        Radial::from_sums(sums.map(|sum| sum * h))
    }

    /// The factor of `1/R^2` in `ed`.
    pub(crate) fn pole(&self) -> C64 {
        self.series[3].pole
    }

    /// Limits at R = 0 on a curve of parameter speed `speed`: the sums times `h`, plus half the logarithm's
    /// factor times `q`, with `ln speed` in place of `ln R`, without the pole of `ed`, which multiplies
    /// `r.n / R^2`.
    pub(crate) fn diagonal(&self, speed: f64, h: f64, q: f64) -> Radial {
        let limits = std::array::from_fn(|k| {
            let s = &self.series[k];
            (s.log[0] * speed.ln() + s.regular[0]) * h + s.log[0] * (0.5 * q)
        });
        Radial::from_sums(limits)
    }
}

/// Weights of the logarithm on n (even) equispaced nodes of [0, 2 pi):
/// `integral ln(4 sin^2((t - s)/2)) f(s) ds = sum_j weights[|i - j|] f(s_j)` for trigonometric polynomials f
/// (Kress, Linear Integral Equations, 12.3), minus the trapezoidal rule's own `h ln(4 sin^2)`; the latter is
/// omitted at 0.
pub(crate) fn log_weights(n: usize) -> Vec<f64> {
    let half = n / 2;
    let h = 2.0 * PI / n as f64;
    let cosines: Vec<f64> = (0..n).map(|j| (h * j as f64).cos()).collect();
    let mut weights = vec![0.0; n];
    for j in 0..=half {
        let mut sum = 0.0;
        let mut at = 0;
        for m in 1..half {
            at += j;
            if at >= n {
                at -= n;
            }
            sum += cosines[at] / m as f64;
        }
        let last = if j.is_multiple_of(2) { 1.0 } else { -1.0 };
        let mut weight = -2.0 * h * sum - h * last / half as f64;
        if j > 0 {
            let s = (0.5 * h * j as f64).sin();
            weight -= h * (4.0 * s * s).ln();
        }
        weights[j] = weight;
        if j > 0 {
            weights[n - j] = weight;
        }
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::special::{bessel01, hankel01};

    fn green(kappa: C64, r: f64) -> [C64; 2] {
        let [h0, h1] = hankel01(kappa * r);
        [C64::I * h0 * 0.25, -C64::I * kappa * h1 * (0.25 / r)]
    }

    fn green_log(kappa: C64, r: f64) -> [C64; 2] {
        let [j0, j1] = bessel01(kappa * r);
        [j0 * (-0.5 / PI), kappa * j1 * (0.5 / (PI * r))]
    }

    fn close(got: C64, want: C64, tolerance: f64, what: &str) {
        let err = (got - want).norm() / want.norm().max(1e-300);
        assert!(err <= tolerance, "{what}: got {got}, want {want}, err {err:e}");
    }

    /// Tables and series against the special functions, on both sides of the seam, for real and complex
    /// wavenumbers.
    #[test]
    fn tables_reproduce_the_functions() {
        for kappa in [C64::new(13.6, 0.0), C64::new(23.04, 0.7), C64::new(20.0, 8.0)] {
            let kernel = MediumKernel::new(Medium { kappa, eps: C64::ONE }, 4.0);
            for j in 1..400 {
                let r = 4.0 * (j as f64 / 400.0).powi(2);
                let [g, d] = green(kappa, r);
                let (got_g, got_d) = kernel.eval(r);
                // Below 1e-12 of the largest value in reach relative digits fade: the decay is that of a
                // lossy medium.
                close(got_g, g, 2e-12, &format!("G, kappa {kappa}, r {r}"));
                close(got_d, d, 2e-12, &format!("D, kappa {kappa}, r {r}"));
            }
        }
    }

    /// Differences of media against the special functions, with the pole and without; without loss the
    /// logarithm's factor against J0, J1.
    #[test]
    fn wall_sums_and_their_logarithms() {
        let outside = Medium { kappa: C64::new(13.6, 0.0), eps: C64::ONE };
        for loss in [0.0, 0.4, 40.0] {
            let inside = Medium { kappa: C64::new(23.0, loss), eps: C64::new(2.4, 0.1 * loss) };
            let kernel = WallKernel::new(outside, inside, 3.0);
            for j in 1..300 {
                let r = 3.0 * (j as f64 / 300.0).powi(2);
                let ([go, d_o], [gi, di]) = (green(outside.kappa, r), green(inside.kappa, r));
                let bare = kernel.without_pole(r, 1.0);
                let pole = kernel.pole() / (r * r);
                let value = Radial { ed: bare.ed + pole, ..bare };
                let size = 1e-11 * (gi.norm() + go.norm());
                let steep = 1e-11 * (di.norm() + d_o.norm());
                let eps = inside.eps.norm();
                assert!((value.g - (go - gi)).norm() < size, "g at {r}");
                assert!((value.eg - (go - inside.eps * gi)).norm() < eps * size, "eg at {r}");
                assert!((value.d - (d_o - di)).norm() < steep, "d at {r}");
                assert!((value.ed - (d_o - inside.eps * di)).norm() < eps * steep, "ed at {r}");
                if loss == 0.0 {
                    let ([jo, ko], [ji, ki]) = (green_log(outside.kappa, r), green_log(inside.kappa, r));
                    let whole = kernel.weighted(r, 1.0, 0.0);
                    let log = kernel.weighted(r, 0.0, 2.0);
                    assert!((whole.g - value.g).norm() < size && (whole.ed - value.ed).norm() < eps * steep, "{r}");
                    assert!((log.g - (jo - ji)).norm() < 1e-11, "log of g at {r}: {} {}", log.g, jo - ji);
                    assert!((log.ed - (ko - inside.eps * ki)).norm() < 1e-9, "log of ed at {r}");
                }
            }
        }
    }

    /// Fourier coefficients of the logarithm: -2 pi / |m|, 0 for m = 0 (Kress, 8.21).
    #[test]
    fn log_weights_integrate_cosines() {
        for n in [14, 16, 48] {
            let h = 2.0 * PI / n as f64;
            let weights = log_weights(n);
            for m in 0..n / 2 {
                let sum: f64 = (0..n)
                    .map(|j| {
                        let s = (0.5 * h * j as f64).sin();
                        let plain = if j == 0 { 0.0 } else { h * (4.0 * s * s).ln() };
                        (weights[j] + plain) * (m as f64 * h * j as f64).cos()
                    })
                    .sum();
                let want = if m == 0 { 0.0 } else { -2.0 * PI / m as f64 };
                assert!((sum - want).abs() < 1e-12, "n {n}, m {m}: got {sum}, want {want}");
            }
        }
    }
}
