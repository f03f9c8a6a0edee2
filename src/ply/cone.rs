//! The cone lobe, for the light of smooth, nearly parallel fibers.
//!
//! A smooth cylinder scatters light of latitude theta_i onto the cone theta_o = -theta_i about its axis and
//! nowhere else, whatever happens inside it; many parallel cylinders do the same. No sum of round lobes fits
//! a ring of zero width. In s = sin theta_o, where `d omega = d s d phi`, a lobe here is
//!
//! ```text
//! f = energy N(x) M(s; s0(x)),    x = phi_o - phi_z wrapped into [-pi, pi]
//! N(x)      = sqrt(mu1 / pi) exp(-mu1 x^2) / erf(pi sqrt(mu1))
//! M(s; s0)  = 2 sqrt(t / pi) exp(-t (s - s0)^2) / [erf(sqrt(t) (1 - s0)) + erf(sqrt(t) (1 + s0))],    t = mu2 / g^2
//! s0(x)     = -sin theta_i + g (offset + slope sin x), clamped to [-1, 1],    g = max(cos theta_i, 0.05)
//! ```
//!
//! N integrates to 1 over a turn of x, and M to 1 over s in [-1, 1] at every x, so the integral over the
//! sphere is exactly the energy. Both are truncated normal distributions. A sample draws x and then s by the
//! inverse of erf, and its density is exactly f / energy. The mean of f over a bin of s is a difference of
//! two erf, so a lobe far narrower than a bin can be fitted to binned light. (The function of d'Eon 2011 has
//! no such integral.)
//!
//! `offset` and `1 / sqrt(mu2)` are angles: `d s = cos theta d theta` near the cone. A fiber that is tilted
//! by tau towards the azimuth phi_t has the cone
//! `sin theta_o = -sin theta_i - tan tau (cos theta_o cos(phi_o - phi_t) + cos theta_i cos(phi_i - phi_t))`:
//! the ring of a twisted ply shifts and tilts with the azimuth, which `offset` and `slope` describe, and the
//! mixture of all tilts widens it. All parameters are relative to the cone of the incidence, so lobes
//! interpolated between nodes stay on the cone. For the same reason, if theta_i is beyond the last node, the
//! cone still follows it while the lobe's parameters stay constant.

use super::asg::{MU_MAX, MU_MIN};
use crate::math::erf::erf;
use std::f64::consts::{PI, TAU};

/// The kind of a model's lobes. Both kinds have the same number of parameters and the same interpolation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LobeKind {
    /// Anisotropic spherical Gaussians ([`crate::ply::asg`]; Yu 2025, Eq. 4).
    #[default]
    Round,
    /// Cones ([`crate::ply::cone`]).
    Cone,
}

impl LobeKind {
    /// "round" or "cone".
    pub fn name(self) -> &'static str {
        match self {
            LobeKind::Round => "round",
            LobeKind::Cone => "cone",
        }
    }

    /// Minimum and maximum of mu1, then of mu2.
    pub fn bandwidths(self) -> [(f64, f64); 2] {
        match self {
            LobeKind::Round => [(MU_MIN, MU_MAX); 2],
            LobeKind::Cone => [(CONE_MU_MIN, CONE_MU1_MAX), (CONE_MU_MIN, CONE_MU2_MAX)],
        }
    }
}

/// Minimum mu1 and mu2: the profiles are flat to 1 % over their range.
pub const CONE_MU_MIN: f64 = 1e-3;
/// Maximum mu1, as for round lobes: a standard deviation of 0.005 rad in azimuth.
pub const CONE_MU1_MAX: f64 = 20_000.0;
/// Maximum mu2: a standard deviation of 0.001 rad from the cone, a fifth of the radius of the sun and a 35th
/// of a bin of a standard table.
pub const CONE_MU2_MAX: f64 = 500_000.0;
/// Minimum of g, reached where cos theta_i vanishes.
pub const GRAZING: f64 = 0.05;
/// Maximum offset and slope: with it a lobe can reach all latitudes at any g.
pub(crate) const CONE_OFFSET_MAX: f64 = 2.0 / GRAZING;

/// One lobe by its six interpolable parameters, in the order of files and fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConeLobe {
    /// Latitude of the lobe from the cone at phi_z [rad].
    pub offset: f64,
    /// Azimuth of the center [rad], not wrapped to an interval.
    pub phi_z: f64,
    /// Coefficient of sin x in the latitude from the cone [rad].
    pub slope: f64,
    /// ln of the bandwidth along the azimuth.
    pub ln_mu1: f64,
    /// ln of the bandwidth across the cone.
    pub ln_mu2: f64,
    /// Integral of the lobe over the sphere.
    pub energy: f64,
}

impl ConeLobe {
    /// A lobe from the parameter order of files and fits: offset, phi_z, slope, ln mu1, ln mu2, energy.
    pub fn from_params(p: &[f64]) -> Self {
        ConeLobe { offset: p[0], phi_z: p[1], slope: p[2], ln_mu1: p[3], ln_mu2: p[4], energy: p[5] }
    }

    /// Value in the unit direction `v` [1/sr], for light of latitude `theta_i` >= 0 [rad].
    pub fn eval(&self, theta_i: f64, v: [f64; 3]) -> f64 {
        let x = v[1].atan2(v[0]) - self.phi_z;
        let x = x - TAU * (x / TAU).round();
        let g = theta_i.cos().max(GRAZING);
        let s0 = (g * (self.offset + self.slope * x.sin()) - theta_i.sin()).clamp(-1.0, 1.0);
        let (r1, r2) = ((0.5 * self.ln_mu1).exp(), (0.5 * self.ln_mu2).exp() / g);
        let n = r1 / PI.sqrt() * (-(r1 * x).powi(2)).exp() / erf(PI * r1);
        let all = erf(r2 * (1.0 - s0)) + erf(r2 * (1.0 + s0));
        let m = 2.0 * r2 / PI.sqrt() * (-(r2 * (v[2] - s0)).powi(2)).exp() / all;
        self.energy * n * m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eval_integrates_to_the_energy() {
        for (offset, slope, ln_mu1, ln_mu2, theta_i) in [
            (0.0, 0.0, 1.0, 5.0, 0.4f64),
            (0.3, -0.4, -3.0, 2.0, 0.9),
            (-0.5, 1.0, 3.0, -2.0, 0.1),
            (1.0, 0.2, 0.0, -6.0, 1.2),
            (-3.0, 0.1, 4.0, 4.0, 1.54),
        ] {
            let lobe = ConeLobe { offset, phi_z: 9.0, slope, ln_mu1, ln_mu2, energy: 0.37 };
            let (rows, columns) = (4000, 400);
            let mut sum = 0.0;
            for i in 0..rows {
                let s = -1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(rows);
                let c = (1.0 - s * s).sqrt();
                for j in 0..columns {
                    let p = TAU * (f64::from(j) + 0.5) / f64::from(columns);
                    sum += lobe.eval(theta_i, [c * p.cos(), c * p.sin(), s]);
                }
            }
            let got = sum * 2.0 * TAU / f64::from(rows * columns);
            assert!((got - 0.37).abs() < 2e-5, "offset {offset}: got {got}, want 0.37");
        }
    }
}
