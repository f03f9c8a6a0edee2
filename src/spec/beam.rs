//! The incident Gaussian beam (Yu 2025, 4.2 and 4.4): intensity `exp(-2 r^2 / w0^2)` about its center.

/// A Gaussian beam, described by its waist and the wavelength that determines its divergence.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct GaussianBeam {
    /// Waist w0 [um]: radius where the intensity is e^-2 of that at the center.
    pub w0_um: f64,
    /// Wavelength [um] of the far-field divergence.
    pub lambda_um: f64,
    /// Distance [um] beyond which the beam is treated as dark; Yu 2025 uses 2 w0.
    pub d_cut_um: f64,
}

impl GaussianBeam {
    /// Standard deviation [um] of the intensity along one transverse axis, w0 / 2.
    pub fn sd_um(&self) -> f64 {
        0.5 * self.w0_um
    }

    /// Far-field divergence theta0 = lambda / (pi w0) [rad]: the intensity decreases as exp(-2 theta^2 /
    /// theta0^2).
    pub fn divergence_rad(&self) -> f64 {
        self.lambda_um / (std::f64::consts::PI * self.w0_um)
    }

    /// Standard deviation [rad] of the far-field intensity along one axis, theta0 / 2.
    pub fn angular_sd_rad(&self) -> f64 {
        0.5 * self.divergence_rad()
    }
}
