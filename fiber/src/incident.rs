//! The light that arrives at a fiber, as the analytic models use it, and directions relative to it.

use crate::distributions::longitudinal::Latitude;
use plywave::frame::is_direction;

/// A query's incident light in the fiber's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Incident {
    pub(crate) latitude: Latitude,
    /// Cosine and sine of phi_i; for light along the fiber phi_i is 0.
    azimuth: [f32; 2],
    /// Whether the query is valid. For an invalid one the other fields describe light across the fiber.
    pub(crate) valid: bool,
}

impl Incident {
    /// Light from `omega_i`. It is invalid if that is not a direction or if the query's other inputs are not
    /// `finite`.
    #[inline]
    pub(crate) fn new(omega_i: [f32; 3], finite: bool) -> Incident {
        let valid = is_direction(omega_i) && finite;
        let wi = if valid { omega_i } else { [1.0, 0.0, 0.0] };
        let latitude = Latitude::from_direction(wi);
        let azimuth = if latitude.cos > 0.0 { [wi[0] / latitude.cos, wi[1] / latitude.cos] } else { [1.0, 0.0] };
        Incident { latitude, azimuth, valid }
    }

    /// Cosine and sine of phi_i.
    #[inline]
    pub(crate) fn azimuth(&self) -> [f32; 2] {
        self.azimuth
    }

    /// Cosine and sine of the relative azimuth phi_o - phi_i of a direction, both times the cosine of its
    /// latitude.
    #[inline]
    pub(crate) fn relative(&self, w: [f32; 3]) -> [f32; 2] {
        let [x, y] = self.azimuth;
        [x * w[0] + y * w[1], x * w[1] - y * w[0]]
    }

    /// The direction whose [`Incident::relative`] is `across` and whose latitude has the sine `sin_theta`.
    #[inline]
    pub(crate) fn direction(&self, [cos, sin]: [f32; 2], sin_theta: f32) -> [f32; 3] {
        let [x, y] = self.azimuth;
        [x * cos - y * sin, y * cos + x * sin, sin_theta]
    }
}
