//! Incident plane waves at a point of a wall, in the unknowns of the boundary equations.

use crate::scene::curve::CurvePoint;
use crate::{C64, PlaneWave, Polarization, Wave};

/// Plane waves with their amplitudes, as they fall on a wall: `(e, P, h, Q)` at a point.
pub(crate) fn incident(wave: &Wave, pol: Polarization, waves: &[PlaneWave], point: &CurvePoint) -> [C64; 4] {
    let k_rho = wave.k_rho();
    let (sin_theta, cos_theta) = wave.theta_i.sin_cos();
    let [nx, ny] = point.normal;
    let (mut axial, mut along_n, mut along_t) = (C64::ZERO, C64::ZERO, C64::ZERO);
    for w in waves {
        let (sin, cos) = w.phi_i.sin_cos();
        let field = w.amplitude * C64::from_polar(1.0, -k_rho * (point.at[0] * cos + point.at[1] * sin));
        axial += field;
        along_n += field * (cos * nx + sin * ny);
        along_t += field * (sin * nx - cos * ny);
    }
    // d_n brings -i k_rho omega.n; the rest is the definition of P and Q.
    match pol {
        Polarization::Tm => [axial * cos_theta, -C64::I * along_n, C64::ZERO, -C64::I * sin_theta * along_t],
        Polarization::Te => [C64::ZERO, -C64::I * sin_theta * along_t, -axial * cos_theta, C64::I * along_n],
    }
}
