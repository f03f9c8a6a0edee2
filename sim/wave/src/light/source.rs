//! Incident light: plane waves, and Gaussian beams as sums of plane waves.

use crate::{C64, Polarization, Wave, WaveError};
use std::f64::consts::PI;

/// Maximum waist and offset of a beam [um], as in scenes.
const MAX_BEAM_UM: f64 = 1e5;

/// A Gaussian beam focused on the fibers (Yu 2025, 4.2): amplitude `exp(-s^2 / w0^2)` across, unlimited along
/// z.
///
/// s is measured from the beam's center along `(sin phi_i, -cos phi_i)`, which is +x for light from +y (phi_i
/// = 90 degrees), and the waist lies in the plane through the origin. The field is an exact solution of
/// Maxwell's equations: a sum of propagating plane waves of one k_z, each with the polarization vector of its
/// own azimuth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamSource {
    /// Waist w0 [um].
    pub w0_um: f64,
    /// Offset h of the center [um].
    pub h_um: f64,
}

impl BeamSource {
    /// Amplitude per transverse wavenumber q [um], such that
    /// `integral spectrum(q) exp(i q s) dq = exp(-(s - h)^2 / w0^2)`.
    pub fn spectrum(&self, q: f64) -> C64 {
        let size = self.w0_um / (2.0 * PI.sqrt()) * (-(0.5 * self.w0_um * q).powi(2)).exp();
        C64::from_polar(size, -q * self.h_um)
    }
}

/// One incident field at the wavelength and latitude of a [`Wave`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Azimuth phi_i from which the light comes [rad].
    pub phi_i: f64,
    /// Polarization.
    pub pol: Polarization,
    /// The beam; `None` for a plane wave of unit amplitude.
    pub beam: Option<BeamSource>,
}

/// `amplitude * e_pol * exp(i k . x)` with `k = -k_0 omega_i`, omega_i at azimuth `phi_i`.
///
/// Its axial fields at (x, y) are `e = cos theta_i` (TM) or `h = -cos theta_i` (TE), times
/// `amplitude exp(-i k_rho (x cos phi_i + y sin phi_i))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneWave {
    /// Azimuth from which the wave comes [rad].
    pub phi_i: f64,
    /// Complex amplitude of |E|.
    pub amplitude: C64,
}

/// Maximum part of a beam's amplitude in evanescent waves, which are omitted.
const EVANESCENT: f64 = 1e-3;

impl Source {
    /// The plane waves of this source within `extent_um` of the origin.
    ///
    /// A beam of waist w0 has the spectrum `w0 / (2 sqrt(pi)) exp(-w0^2 q^2 / 4 - i q h)` over the transverse
    /// wavenumber q; q is sampled so finely that the beam's periodic images stay clear of the scene.
    ///
    /// # Errors
    /// [`WaveError::Invalid`] for a waist so narrow that its spectrum does not fit in the propagating waves,
    /// and for a waist or an offset beyond 1e5 um.
    pub fn plane_waves(&self, wave: &Wave, extent_um: f64) -> Result<Vec<PlaneWave>, WaveError> {
        let Some(beam) = self.beam else {
            return Ok(vec![PlaneWave { phi_i: self.phi_i, amplitude: C64::new(1.0, 0.0) }]);
        };
        let k_rho = wave.k_rho();
        let min_um = 2.0 * (-EVANESCENT.ln()).sqrt() / k_rho;
        if !(min_um..=MAX_BEAM_UM).contains(&beam.w0_um) {
            return Err(WaveError::Invalid {
                key: "beam.w0_um".into(),
                value: beam.w0_um.to_string(),
                hint: format!("use {min_um:.3} to {MAX_BEAM_UM} at this wavelength and latitude"),
            });
        }
        if !(-MAX_BEAM_UM..=MAX_BEAM_UM).contains(&beam.h_um) {
            return Err(WaveError::Invalid {
                key: "beam.h_um".into(),
                value: beam.h_um.to_string(),
                hint: format!("use -{MAX_BEAM_UM} to {MAX_BEAM_UM}"),
            });
        }
        // exp(-w0^2 q^2 / 4) is below 1e-16 at q = 12.2 / w0. Beside the beam, q may be sampled as if it had
        // period 2 pi / dq: images of the waist at that distance must miss the scene, with the beam's spread
        // over the depth of the scene allowed for.
        let reach = (12.2 / beam.w0_um).min(k_rho * (1.0 - 1e-9));
        let spread = extent_um * (reach / k_rho).asin().tan().min(4.0);
        let period = 2.0 * (extent_um + spread) + beam.h_um.abs() + 12.0 * beam.w0_um;
        let n = (reach * period / (2.0 * PI)).ceil().max(1.0);
        let dq = reach / n;
        let n = n as i64;
        Ok((-n..=n)
            .map(|j| {
                let q = j as f64 * dq;
                // Travel along -(cos phi_i, sin phi_i) rotated so that its component along s is q.
                let phi_i = self.phi_i + (q / k_rho).asin();
                PlaneWave { phi_i, amplitude: beam.spectrum(q) * dq }
            })
            .collect())
    }

    /// Axial amplitude of a unit plane wave: `(e, h)` at phase zero.
    pub fn axial(&self, wave: &Wave) -> (f64, f64) {
        match self.pol {
            Polarization::Tm => (wave.theta_i.cos(), 0.0),
            Polarization::Te => (0.0, -wave.theta_i.cos()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(waves: &[PlaneWave], k_rho: f64, x: f64, y: f64) -> C64 {
        waves.iter().map(|w| w.amplitude * C64::from_polar(1.0, -k_rho * (x * w.phi_i.cos() + y * w.phi_i.sin()))).sum()
    }

    /// In the plane of the waist the amplitude is the Gaussian, centered at x = h for light from +y, and
    /// travels towards -y.
    #[test]
    fn beam_is_gaussian_at_its_waist() {
        let wave = Wave { lambda_um: 0.5, theta_i: 0.3 };
        let source =
            Source { phi_i: PI / 2.0, pol: Polarization::Tm, beam: Some(BeamSource { w0_um: 10.0, h_um: 7.0 }) };
        let waves = source.plane_waves(&wave, 60.0).unwrap();
        for x in [-60.0, -20.0, 0.0, 7.0, 12.0, 33.0, 60.0_f64] {
            let got = field(&waves, wave.k_rho(), x, 0.0);
            let want = (-((x - 7.0) / 10.0f64).powi(2)).exp();
            assert!((got - want).norm() < 1e-13, "x {x}: got {got}, want {want}");
        }
        let step = 1e-4;
        let ahead = field(&waves, wave.k_rho(), 7.0, -step) / field(&waves, wave.k_rho(), 7.0, 0.0);
        assert!((ahead.arg() / step - wave.k_rho()).abs() < 0.01 * wave.k_rho(), "travels towards -y");
    }

    /// The field does not depend on the extent for which it was sampled: images of the beam stay out of the
    /// scene.
    #[test]
    fn beam_has_no_images_within_the_scene() {
        let wave = Wave { lambda_um: 0.7, theta_i: 0.0 };
        let source = Source { phi_i: 1.0, pol: Polarization::Te, beam: Some(BeamSource { w0_um: 3.0, h_um: -20.0 }) };
        let (near, far) = (source.plane_waves(&wave, 50.0).unwrap(), source.plane_waves(&wave, 200.0).unwrap());
        for (x, y) in [(50.0, 0.0), (0.0, 50.0), (-35.0, 35.0), (-35.0, -35.0), (10.0, -45.0)] {
            let (a, b) = (field(&near, wave.k_rho(), x, y), field(&far, wave.k_rho(), x, y));
            assert!((a - b).norm() < 1e-9, "({x}, {y}): {a} against {b}");
        }
    }

    #[test]
    fn endless_waists_and_offsets_are_refused() {
        for (w0_um, h_um, key) in
            [(1e308, 0.0, "beam.w0_um"), (f64::NAN, 0.0, "beam.w0_um"), (10.0, -1e300, "beam.h_um")]
        {
            let source = Source { phi_i: 0.0, pol: Polarization::Tm, beam: Some(BeamSource { w0_um, h_um }) };
            let error = source.plane_waves(&Wave { lambda_um: 0.5, theta_i: 0.0 }, 10.0).unwrap_err().to_string();
            assert!(error.contains(key), "{error}");
        }
    }

    #[test]
    fn narrow_waists_are_refused() {
        let source = Source { phi_i: 0.0, pol: Polarization::Tm, beam: Some(BeamSource { w0_um: 0.1, h_um: 0.0 }) };
        assert!(source.plane_waves(&Wave { lambda_um: 0.5, theta_i: 0.0 }, 5.0).is_err());
    }
}
