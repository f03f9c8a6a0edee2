//! Frames and measures of a fiber's enclosing cylinder (Zinke 2007, 3.2, 4, 6).
//!
//! A point on the cylinder and a direction have two sets of coordinates. Those of the surface are `xi`, the
//! azimuth of the point about the axis, and the direction's angles `alpha` about the normal, measured from
//! the axis, and `beta` from the normal. Those of parallel light are the direction's latitude `theta` and
//! azimuth `phi`, and the offset `h_rel = sin gamma'` in [-1, 1] of its line from the axis, in radii. The
//! point lies at `xi = phi + asin h_rel`: seen along the outward direction, positive offsets are those of
//! increasing azimuth.
//!
//! Measures: Zinke's scattering functions give radiance, [`Bsdf`](plywave::Bsdf) gives energy.
//!
//! | | integral that gives | f of [`Bsdf`](plywave::Bsdf) |
//! |---|---|---|
//! | BFSDF, Eq. 7 [1/(um^2 sr)] | `L_o = integral f L_i cos^2 theta_i dtheta_i dphi_i dh_i dDelta s`, Eq. 12 | |
//! | near field, Eq. 37-38 [1/sr] | `L_o(h_o) = integral f L_i cos^2 theta_i dtheta_i dphi_i` | of the mean over h: `f cos theta_o` |
//! | BCSDF, Eq. 34-36 [1/sr] | `L_o = D integral f L_i cos^2 theta_i dtheta_i dphi_i` | `f cos theta_o` |
//!
//! About the last column: a curve of width D and radiance L_o emits `L_o cos theta_o` per length and solid
//! angle for incident light of `D L_i cos theta_i` per length and solid angle.

use std::f64::consts::{PI, TAU};

/// An angle wrapped to (-pi, pi] (Zinke 2007, Eq. 16, extended to any angle).
///
/// ```
/// # use plywave_fiber::cylinder::relative_azimuth;
/// assert!((relative_azimuth(4.0) - (4.0 - std::f64::consts::TAU)).abs() < 1e-12);
/// ```
pub fn relative_azimuth(angle: f64) -> f64 {
    let turned = angle.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

/// A point on the cylinder and an outward direction, in the surface's frame [rad].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceDirection {
    /// Azimuth of the point, in [0, 2 pi).
    pub xi: f64,
    /// Azimuth of the direction about the normal, measured from the axis, in [0, 2 pi).
    pub alpha: f64,
    /// Angle of the direction from the normal, in [0, pi/2].
    pub beta: f64,
}

/// A point on the cylinder and an outward direction, in the frame of parallel light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiberDirection {
    /// Offset of the direction's line from the axis, in radii, in [-1, 1].
    pub h_rel: f64,
    /// Azimuth of the direction [rad].
    pub phi: f64,
    /// Latitude of the direction [rad], in [-pi/2, pi/2].
    pub theta: f64,
}

impl FiberDirection {
    /// Cosine of the angle from the normal (Zinke 2007, Eq. 1-3).
    pub fn cos_beta(&self) -> f64 {
        self.theta.cos() * (1.0 - self.h_rel * self.h_rel).max(0.0).sqrt()
    }

    /// The direction in the surface's frame (Zinke 2007, Eq. 3-6). For beta = 0 alpha is 0.
    pub fn on_surface(&self) -> SurfaceDirection {
        let along = self.theta.sin();
        let across = -self.h_rel * self.theta.cos();
        SurfaceDirection {
            xi: (self.phi + self.h_rel.clamp(-1.0, 1.0).asin()).rem_euclid(TAU),
            alpha: across.atan2(along).rem_euclid(TAU),
            beta: along.hypot(across).atan2(self.cos_beta()),
        }
    }

    /// `|d(xi, alpha, beta) / d(h, phi, theta)|`, which times `sin beta cos beta` is `cos^2 theta` (Zinke
    /// 2007, Eq. 11 and 12). It is infinite at the rim.
    pub fn jacobian(&self) -> f64 {
        let sin_beta = (1.0 - self.cos_beta().powi(2)).max(0.0).sqrt();
        self.theta.cos() / ((1.0 - self.h_rel * self.h_rel).max(0.0).sqrt() * sin_beta)
    }
}

impl SurfaceDirection {
    /// The direction in the frame of parallel light, the inverse of [`FiberDirection::on_surface`]; phi is in
    /// (-pi, pi].
    pub fn in_fiber(&self) -> FiberDirection {
        let (sin_beta, cos_beta) = self.beta.sin_cos();
        let (sin_alpha, cos_alpha) = self.alpha.sin_cos();
        let gamma = (-sin_beta * sin_alpha).atan2(cos_beta);
        FiberDirection {
            h_rel: gamma.sin(),
            phi: relative_azimuth(self.xi - gamma),
            theta: (sin_beta * cos_alpha).clamp(-1.0, 1.0).asin(),
        }
    }
}

/// Energy density [1/sr] of a BCSDF in Zinke's or Marschner's definition, for light that leaves at a latitude
/// of this cosine.
pub fn energy_of_bcsdf(bcsdf: f64, cos_theta_o: f64) -> f64 {
    bcsdf * cos_theta_o
}

/// BCSDF [1/sr] of an energy density, the inverse of [`energy_of_bcsdf`].
pub fn bcsdf_of_energy(f: f64, cos_theta_o: f64) -> f64 {
    f / cos_theta_o
}
