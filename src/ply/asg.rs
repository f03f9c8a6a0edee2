//! The anisotropic spherical Gaussian lobe (Yu 2025, Eq. 4): its value, exact energy and exact sampling.
//!
//! Let u = v.x and w = v.y. The factor v.z cancels the Jacobian of the projection onto the lobe's disc, so
//! that `integral G d omega = c * integral over u^2 + w^2 <= 1 of exp(-mu1 u^2 - mu2 w^2) du dw`. In the
//! angle t about the axis this is `c * integral of (1 - e^-a(t)) / (2 a(t)) dt` with a(t) = mu1 cos^2 t + mu2
//! sin^2 t. The substitution `tan t = sqrt(mu1/mu2) tan s` turns it into
//! `c pi / sqrt(mu1 mu2) * mean over s of (1 - exp(-1/b(s)))` with b(s) = cos^2 s / mu1 + sin^2 s / mu2. That
//! integrand is smooth and periodic, so a few midpoint nodes give full accuracy.
//!
//! A lobe here stores its *energy*, not its amplitude c, because energies can be interpolated and added and
//! amplitudes cannot.

use std::f64::consts::PI;

/// Number of parameters of a lobe: theta_z, phi_z, phi_xy [rad], ln mu1, ln mu2, energy.
pub const PARAMS: usize = 6;

/// One lobe, by its six parameters that can be interpolated.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Lobe {
    /// Latitude of the axis z [rad].
    pub theta_z: f64,
    /// Azimuth of the axis z [rad], not wrapped to an interval.
    pub phi_z: f64,
    /// Rotation of x, y about z [rad]; at 0, x points along increasing azimuth and y along increasing
    /// latitude.
    pub phi_xy: f64,
    /// ln of the bandwidth along x.
    pub ln_mu1: f64,
    /// ln of the bandwidth along y.
    pub ln_mu2: f64,
    /// Integral of the lobe over the sphere.
    pub energy: f64,
}

impl Lobe {
    /// A lobe from the parameter order of files and fits: theta_z, phi_z, phi_xy, ln mu1, ln mu2, energy.
    pub fn from_params(p: &[f64]) -> Self {
        Lobe { theta_z: p[0], phi_z: p[1], phi_xy: p[2], ln_mu1: p[3], ln_mu2: p[4], energy: p[5] }
    }

    /// The inverse of [`Lobe::from_params`].
    pub fn to_params(self) -> [f64; PARAMS] {
        [self.theta_z, self.phi_z, self.phi_xy, self.ln_mu1, self.ln_mu2, self.energy]
    }

    /// The axes x, y, z of the lobe in the ply frame.
    pub fn frame(&self) -> [[f64; 3]; 3] {
        let (st, ct) = self.theta_z.sin_cos();
        let (sp, cp) = self.phi_z.sin_cos();
        let (sx, cx) = self.phi_xy.sin_cos();
        let (x0, y0) = ([-sp, cp, 0.0], [-st * cp, -st * sp, ct]);
        let mix = |a: f64, b: f64| [a * x0[0] + b * y0[0], a * x0[1] + b * y0[1], a * x0[2] + b * y0[2]];
        [mix(cx, sx), mix(-sx, cx), [ct * cp, ct * sp, st]]
    }

    /// Value in the unit direction `v` [1/sr]; 0 in the hemisphere away from the axis.
    pub fn eval(&self, v: [f64; 3]) -> f64 {
        let [x, y, z] = self.frame();
        let dot = |a: [f64; 3]| a[0] * v[0] + a[1] * v[1] + a[2] * v[2];
        let (u, w, cz) = (dot(x), dot(y), dot(z));
        if cz <= 0.0 {
            return 0.0;
        }
        let (mu1, mu2) = (self.ln_mu1.exp(), self.ln_mu2.exp());
        self.energy / unit_energy(mu1, mu2) * cz * (-mu1 * u * u - mu2 * w * w).exp()
    }
}

/// Minimum bandwidth of a lobe. At 0.2 the Gaussian factor is 0.82 or more everywhere, so a flatter lobe is
/// practically the same, and the energy quadrature below keeps its accuracy.
pub const MU_MIN: f64 = 0.2;
/// Maximum bandwidth of a lobe: a standard deviation of 0.005 rad, below the beam's own divergence.
pub const MU_MAX: f64 = 20_000.0;

/// Midpoint nodes in s over a quarter turn. The integrand 1 - exp(-1/b) is smooth in b; with 12 nodes the
/// error is at most 1e-4 of the integral for any bandwidths >= MU_MIN (tested against the integral over t).
const NODES: usize = 12;

/// Energy of a lobe of amplitude c = 1: `integral over the unit disc of exp(-mu1 u^2 - mu2 w^2) du dw`. It
/// tends to pi / sqrt(mu1 mu2) for large bandwidths and to pi for small ones.
pub fn unit_energy(mu1: f64, mu2: f64) -> f64 {
    unit_energy_gradient(mu1, mu2).0
}

/// [`unit_energy`] and the derivatives of its logarithm by ln mu1 and ln mu2, all from the same quadrature.
pub fn unit_energy_gradient(mu1: f64, mu2: f64) -> (f64, f64, f64) {
    let (b1, b2) = (1.0 / mu1, 1.0 / mu2);
    let (mut mean, mut d1, mut d2) = (0.0, 0.0, 0.0);
    for j in 0..NODES {
        let s2 = (0.5 * PI * (j as f64 + 0.5) / NODES as f64).sin().powi(2);
        let c2 = 1.0 - s2;
        let b = c2 * b1 + s2 * b2;
        let e = (-1.0 / b).exp();
        mean -= (-1.0 / b).exp_m1();
        // d(1 - e^{-1/b})/db = -e^{-1/b}/b^2, and d b/d ln mu1 = -c2 b1.
        let g = e / (b * b);
        d1 += g * c2 * b1;
        d2 += g * s2 * b2;
    }
    let n = NODES as f64;
    let value = PI * (b1 * b2).sqrt() * mean / n;
    (value, d1 / mean - 0.5, d2 / mean - 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral over t of `docs/explain/papers/yu_2025.md`, by brute force.
    fn energy_over_t(mu1: f64, mu2: f64) -> f64 {
        let n = 100_000;
        (0..n)
            .map(|i| {
                let t = 2.0 * PI * (i as f64 + 0.5) / n as f64;
                let a = mu1 * t.cos().powi(2) + mu2 * t.sin().powi(2);
                -(-a).exp_m1() / (2.0 * a)
            })
            .sum::<f64>()
            * 2.0
            * PI
            / n as f64
    }

    #[test]
    fn energy_matches_the_integral_over_t() {
        for mu1 in [MU_MIN, 0.5, 1.0, 4.0, 30.0, 1000.0, MU_MAX] {
            for mu2 in [MU_MIN, 0.5, 1.0, 4.0, 30.0, 1000.0, MU_MAX] {
                let (got, want) = (unit_energy(mu1, mu2), energy_over_t(mu1, mu2));
                assert!(
                    (got / want - 1.0).abs() < 1e-4,
                    "mu {mu1} {mu2}: got {got}, want {want}, rel {}",
                    got / want - 1.0
                );
            }
        }
    }

    #[test]
    fn gradient_matches_differences() {
        for (mu1, mu2) in [(0.5, 3.0), (10.0, 10.0), (80.0, 0.7)] {
            let (_, g1, g2) = unit_energy_gradient(mu1, mu2);
            let h = 1e-5f64;
            let ln = |a: f64, b: f64| unit_energy(a, b).ln();
            let d1 = (ln(mu1 * h.exp(), mu2) - ln(mu1 * (-h).exp(), mu2)) / (2.0 * h);
            let d2 = (ln(mu1, mu2 * h.exp()) - ln(mu1, mu2 * (-h).exp())) / (2.0 * h);
            assert!((g1 - d1).abs() < 1e-7 && (g2 - d2).abs() < 1e-7, "{g1} {d1} {g2} {d2}");
        }
    }

    #[test]
    fn eval_integrates_to_the_energy() {
        let lobe = Lobe { theta_z: 0.4, phi_z: 2.0, phi_xy: 0.7, ln_mu1: 1.5, ln_mu2: -0.5, energy: 0.37 };
        let n = 400;
        let mut sum = 0.0;
        for i in 0..n {
            let s = -1.0 + 2.0 * (i as f64 + 0.5) / n as f64;
            let c = (1.0 - s * s).sqrt();
            for j in 0..n {
                let p = 2.0 * PI * (j as f64 + 0.5) / n as f64;
                sum += lobe.eval([c * p.cos(), c * p.sin(), s]);
            }
        }
        let got = sum * 4.0 * PI / (n * n) as f64;
        assert!((got - 0.37).abs() < 2e-5, "got {got}, want 0.37");
    }
}
