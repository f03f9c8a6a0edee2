//! Fresnel reflectances of unpolarized light that arrives from outside.

/// Reflectance of a dielectric of relative index `eta` at the cosine `cos` of the angle of incidence.
///
/// For light that arrives from inside at the refracted angle the reflectance is the same.
#[inline]
pub fn dielectric(cos: f32, eta: f32) -> f32 {
    let cos = cos.max(0.0);
    let eta2 = eta * eta;
    let inside = (eta2 - 1.0 + cos * cos).max(0.0).sqrt();
    let perpendicular = (cos - inside) / (cos + inside).max(f32::MIN_POSITIVE);
    let parallel = (eta2 * cos - inside) / (eta2 * cos + inside).max(f32::MIN_POSITIVE);
    (0.5 * (perpendicular * perpendicular + parallel * parallel)).min(1.0)
}

/// Indices `[n', n'']` of a cylinder's cross section for light of latitude `theta` (Bravais; Zinke 2007,
/// 5.1). n' bends the projected path and determines the reflectance of light polarized across the plane of
/// incidence; n'' determines that of the other polarization.
#[inline]
pub fn cross_section_indices(sin_theta: f32, eta: f32) -> [f32; 2] {
    let cos = (1.0 - sin_theta * sin_theta).max(1e-8).sqrt();
    let across = (eta * eta - sin_theta * sin_theta).max(0.0).sqrt() / cos;
    [across, eta * eta / across]
}
