//! The ply frame (Yu 2025, Eq. 1-3): z points along the ply, light comes from +y, and h is measured along x.

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

/// Whether `w` can be a unit vector: no component exceeds 1 by more than rounding, and none is NaN. Squares
/// and products of such a vector cannot overflow. For other vectors f is 0.
#[inline(always)]
pub fn is_direction(w: [f32; 3]) -> bool {
    w[0].abs() <= 1.001 && w[1].abs() <= 1.001 && w[2].abs() <= 1.001
}

/// Mirrors a direction together with its incidence. A ply rotated by pi about the y axis is the same ply, so
/// `f(theta_i, h; wo) = f(-theta_i, -h; mirror_incidence(wo))`: theta_o changes sign and phi_o becomes pi -
/// phi_o.
pub fn mirror_incidence(wo: [f32; 3]) -> [f32; 3] {
    [-wo[0], wo[1], -wo[2]]
}

/// Transforms a direction from the surface's frame to that of the pattern, which is rotated by an angle with
/// this cosine and sine.
pub(crate) fn to_pattern([c, s]: [f32; 2], w: [f32; 3]) -> [f32; 3] {
    [c * w[0] + s * w[1], c * w[1] - s * w[0], w[2]]
}

/// The inverse of [`to_pattern`].
pub(crate) fn to_surface([c, s]: [f32; 2], w: [f32; 3]) -> [f32; 3] {
    to_pattern([c, -s], w)
}
