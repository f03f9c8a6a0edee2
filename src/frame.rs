//! The ply frame (Yu 2025, Eq. 1-3): z along the ply, light from +y, h along x.

/// Direction of latitude `theta` and azimuth `phi` [rad]: `(cos theta cos phi, cos theta sin phi, sin theta)`
/// (Yu 2025, Eq. 3).
pub fn direction(theta: f32, phi: f32) -> [f32; 3] {
    let (st, ct) = theta.sin_cos();
    let (sp, cp) = phi.sin_cos();
    [ct * cp, ct * sp, st]
}

/// Incident direction `(0, cos theta_i, sin theta_i)`, pointing away from the ply (Yu 2025, Eq. 1).
pub fn incident_direction(theta_i: f32) -> [f32; 3] {
    let (s, c) = theta_i.sin_cos();
    [0.0, c, s]
}

/// Latitude in [-pi/2, pi/2] and azimuth in [0, 2 pi) of a unit vector, the inverse of [`direction`].
pub fn theta_phi(w: [f32; 3]) -> (f32, f32) {
    let theta = w[2].clamp(-1.0, 1.0).asin();
    let phi = w[1].atan2(w[0]);
    (theta, if phi < 0.0 { phi + std::f32::consts::TAU } else { phi })
}

/// Whether `w` can be a unit vector: no component exceeds 1 by more than rounding. Squares and products of
/// such a vector cannot overflow; for others f is 0.
#[inline(always)]
pub(crate) fn is_direction(w: [f32; 3]) -> bool {
    w[0].abs() <= 1.001 && w[1].abs() <= 1.001 && w[2].abs() <= 1.001
}

/// Mirrors a direction with its incidence: a ply rotated by pi about the y axis is the same ply, so
/// `f(theta_i, h; wo) = f(-theta_i, -h; mirror_incidence(wo))`: theta_o changes sign and phi_o becomes pi -
/// phi_o.
pub fn mirror_incidence(wo: [f32; 3]) -> [f32; 3] {
    [-wo[0], wo[1], -wo[2]]
}
