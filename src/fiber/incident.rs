//! Light that arrives at a fiber, as the analytic models use it, and directions about it.

use super::longitudinal::Latitude;
use crate::frame::is_direction;

/// A query's light in the fiber's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Incident {
    pub(super) latitude: Latitude,
    /// Cosine and sine of phi_i; those of 0 for light along the fiber.
    azimuth: [f32; 2],
    /// Whether there is light to scatter: refused light counts as light across the fiber.
    pub(super) valid: bool,
}

impl Incident {
    /// Light from `omega_i`, refused if that is not a direction or if the query's other inputs are not
    /// `finite`.
    #[inline]
    pub(super) fn new(omega_i: [f32; 3], finite: bool) -> Incident {
        let valid = is_direction(omega_i) && finite;
        let wi = if valid { omega_i } else { [1.0, 0.0, 0.0] };
        let latitude = Latitude::from_direction(wi);
        let azimuth = if latitude.cos > 0.0 { [wi[0] / latitude.cos, wi[1] / latitude.cos] } else { [1.0, 0.0] };
        Incident { latitude, azimuth, valid }
    }

    /// Cosine and sine of phi_i.
    #[inline]
    pub(super) fn azimuth(&self) -> [f32; 2] {
        self.azimuth
    }

    /// Cosine and sine of the azimuth phi_o - phi_i of a direction, both times the cosine of its latitude.
    #[inline]
    pub(super) fn relative(&self, w: [f32; 3]) -> [f32; 2] {
        let [x, y] = self.azimuth;
        [x * w[0] + y * w[1], x * w[1] - y * w[0]]
    }

    /// The direction whose [`Incident::relative`] is `across`, and whose latitude has this sine.
    #[inline]
    pub(super) fn direction(&self, [cos, sin]: [f32; 2], sin_theta: f32) -> [f32; 3] {
        let [x, y] = self.azimuth;
        [x * cos - y * sin, y * cos + x * sin, sin_theta]
    }
}
