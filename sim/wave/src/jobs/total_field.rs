//! Far field of a beam together with the light that the fibers scatter, as energy over the azimuth. For rays
//! this is f_miss + f_refl + f_high (Yu 2025, 4.5).
//!
//! A beam is an integral of plane waves over the azimuth alpha that they come from,
//! `E = integral A(alpha) e_pol(alpha) exp(-i k_rho rho cos(phi - alpha)) d alpha`, with
//! `A(alpha) = k_rho cos(alpha - phi_i) a(q)`, `q = k_rho sin(alpha - phi_i)` and a(q) the beam's spectrum.
//! At large rho the phase is stationary at `alpha = phi + pi`, for outgoing waves, and at `alpha = phi`, for
//! incoming ones. The first gives
//!
//! ```text
//! E -> sqrt(2 pi / (k_rho rho)) exp(i (k_rho rho - pi/4)) A(phi + pi) e_pol(phi + pi),
//! ```
//!
//! in the form of [`Scattered`]: `F_inc = pi A(phi + pi)`, along u for TM and, since `e_TE(phi + pi) = -phi`,
//! along -phi for TE. The outgoing light is `|F_s + F_inc|^2`. Its cross term, over all azimuths, is minus
//! the extinction (the optical theorem), so that the total is the beam's power minus the absorbed power.
//! Nothing is scaled to make it so.

use crate::{C64, Polarization, Scattered, Source, Wave, WaveError};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Powers per length over |S| at the beam's center [um], as in [`Scattered`], and densities of them over the
/// beam's power [1/rad] at the azimuths of the far field.
#[derive(Clone, Debug, PartialEq)]
pub struct TotalField {
    /// `[j]`: scattered and incident light together, at azimuth 2 pi j / n.
    pub total: Vec<f64>,
    /// `[j]`: the scattered field alone.
    pub scattered: Vec<f64>,
    /// Power of the beam [um].
    pub beam_um: f64,
}

/// Far-field amplitude of the incident beam itself at azimuths 2 pi j / n_phi_out: F_u for TM, F_phi for TE.
///
/// # Errors
/// [`WaveError::Unsupported`] for a plane wave, whose far field is not a function.
pub fn incident_far_field(source: &Source, wave: &Wave, n_phi_out: usize) -> Result<Vec<C64>, WaveError> {
    let beam = source.beam.ok_or_else(plane)?;
    let k_rho = wave.k_rho();
    let sign = match source.pol {
        Polarization::Tm => PI,
        Polarization::Te => -PI,
    };
    Ok((0..n_phi_out)
        .map(|j| {
            // Off the direction of travel, phi_i + pi, in (-pi, pi].
            let off = (TAU * j as f64 / n_phi_out as f64 - source.phi_i).rem_euclid(TAU) - PI;
            if off.abs() >= FRAC_PI_2 {
                return C64::new(0.0, 0.0);
            }
            let (sin, cos) = off.sin_cos();
            beam.spectrum(k_rho * sin) * (sign * k_rho * cos)
        })
        .collect())
}

/// Power of a beam per length, over |S| at its center [um]:
/// `2 pi / k_0 integral |a(q)|^2 k_rho cos(alpha - phi_i) dq`, in the limit of wide beams
/// `cos theta_i w0 sqrt(pi/2)`.
///
/// # Errors
/// [`WaveError::Unsupported`] for a plane wave.
pub fn beam_power(source: &Source, wave: &Wave) -> Result<f64, WaveError> {
    let beam = source.beam.ok_or_else(plane)?;
    let k_rho = wave.k_rho();
    // exp(-w0^2 q^2 / 2) is below 1e-32 there.
    let reach = (12.2 / beam.w0_um).min(k_rho);
    let n = 2000;
    let dq = reach / f64::from(n);
    let sum: f64 = (-n..=n)
        .map(|j| {
            let q = f64::from(j) * dq;
            beam.spectrum(q).norm_sqr() * (k_rho * k_rho - q * q).max(0.0).sqrt()
        })
        .sum();
    Ok(TAU / wave.k0() * sum * dq)
}

/// Densities over the azimuth of the outgoing light, from the scattered light of `source`.
///
/// # Errors
/// [`WaveError::Unsupported`] for a plane wave.
pub fn total_field(source: &Source, wave: &Wave, scattered: &Scattered) -> Result<TotalField, WaveError> {
    let n = scattered.f_u.len();
    let incident = incident_far_field(source, wave, n)?;
    let beam_um = beam_power(source, wave)?;
    let scale = 2.0 / (PI * wave.k0() * beam_um);
    let (co, cross) = match source.pol {
        Polarization::Tm => (&scattered.f_u, &scattered.f_phi),
        Polarization::Te => (&scattered.f_phi, &scattered.f_u),
    };
    let total = (0..n).map(|j| scale * ((co[j] + incident[j]).norm_sqr() + cross[j].norm_sqr())).collect();
    let alone = (0..n).map(|j| scale * (co[j].norm_sqr() + cross[j].norm_sqr())).collect();
    Ok(TotalField { total, scattered: alone, beam_um })
}

/// Azimuths that resolve `|F_s + F_inc|^2` of fibers within `extent_um` of the origin and of this source: a
/// multiple of `multiple`.
///
/// A far field has harmonics up to `k_rho extent` and some more, its intensity twice as many. With more
/// azimuths than that the sum over them is exact, and 4 resolve a speckle.
pub fn azimuths(wave: &Wave, source: &Source, extent_um: f64, multiple: usize) -> usize {
    let reach = wave.k_rho() * (extent_um.max(source.beam.map_or(0.0, |b| b.h_um.abs() + 3.0 * b.w0_um)));
    let harmonics = reach + 6.0 * reach.cbrt() + 10.0;
    ((4.0 * harmonics) as usize / multiple.max(1)).saturating_add(1).saturating_mul(multiple.max(1))
}

fn plane() -> WaveError {
    WaveError::Unsupported {
        method: "total field",
        what: "a plane wave goes into one direction".into(),
        hint: "give a beam".into(),
    }
}

#[cfg(test)]
mod tests {
    //! References: the beam's own far field, summed from its plane waves; the energy of beam and scattered
    //! light together.
    use super::*;
    use crate::{BeamSource, Body, MieSolver, Shape, WaveSolver};

    const POLS: [Polarization; 2] = [Polarization::Tm, Polarization::Te];

    fn beam(pol: Polarization, phi_i: f64, w0_um: f64, h_um: f64) -> Source {
        Source { phi_i, pol, beam: Some(BeamSource { w0_um, h_um }) }
    }

    fn nothing(n: usize) -> Scattered {
        let zeros = vec![C64::new(0.0, 0.0); n];
        Scattered { f_u: zeros.clone(), f_phi: zeros, c_sca_um: 0.0, c_abs_um: 0.0, c_ext_um: 0.0 }
    }

    /// The axial field of the beam's plane waves at a far point agrees with the asymptotic form: phase, sign
    /// and size, with an error that halves with the distance.
    #[test]
    fn far_field_is_the_limit_of_the_beam() {
        let wave = Wave { lambda_um: 0.6, theta_i: 0.4 };
        let k_rho = wave.k_rho();
        for pol in POLS {
            let source = beam(pol, 1.1, 2.5, -4.0);
            let n = 3600;
            let far = incident_far_field(&source, &wave, n).unwrap();
            // F_u = a_e / cos theta_i and F_phi = a_h / cos theta_i, and the axial amplitude of a unit wave
            // is cos theta_i (TM: e), -cos theta_i (TE: h).
            let (e, h) = source.axial(&wave);
            let axial = e + h;
            let mut last = f64::INFINITY;
            // Parallax leaves a phase k_rho h^2 / (2 rho).
            for rho in [10_000.0, 20_000.0] {
                let waves = source.plane_waves(&wave, rho).unwrap();
                let mut worst: f64 = 0.0;
                for degrees in [-6.0, -2.0, 0.0, 1.0, 5.0f64] {
                    let j = ((source.phi_i + PI + degrees.to_radians()) / TAU * n as f64).round() as usize % n;
                    let phi = TAU * j as f64 / n as f64;
                    let field: C64 = waves
                        .iter()
                        .map(|w| w.amplitude * C64::from_polar(1.0, -k_rho * rho * (phi - w.phi_i).cos()))
                        .sum();
                    let spread = C64::from_polar((2.0 / (PI * k_rho * rho)).sqrt(), k_rho * rho - PI / 4.0);
                    let want = spread * far[j] * wave.theta_i.cos();
                    worst = worst.max((field * axial - want).norm());
                }
                let peak = (2.0 / (PI * k_rho * rho)).sqrt() * far.iter().map(|f| f.norm()).fold(0.0, f64::max);
                worst /= peak;
                assert!(worst < 0.01 && worst < 0.6 * last, "{pol:?} at {rho} um: {worst:e} after {last:e}");
                last = worst;
            }
        }
    }

    /// The beam alone: all of its power, about phi_i + pi, with standard deviation 1/(w0 k_rho), which is the
    /// rays' lambda/(2 pi w0) over cos theta_i.
    #[test]
    fn beam_alone_keeps_its_power_and_spread() {
        for (theta_i, w0, h) in [(0.0, 10.0, 0.0), (0.7, 6.0, 31.0), (0.3, 1.0, -3.0)] {
            let wave = Wave { lambda_um: 0.5, theta_i };
            for pol in POLS {
                let source = beam(pol, PI / 2.0, w0, h);
                let n = azimuths(&wave, &source, 40.0, 360);
                let got = total_field(&source, &wave, &nothing(n)).unwrap();
                let dphi = TAU / n as f64;
                let energy: f64 = got.total.iter().sum::<f64>() * dphi;
                assert!((energy - 1.0).abs() < 1e-12, "energy {energy}");
                let moment = |p: i32| -> f64 {
                    let off = |j: usize| j as f64 * dphi - 1.5 * PI;
                    got.total.iter().enumerate().map(|(j, v)| v * off(j).powi(p)).sum::<f64>() * dphi
                };
                let want = 1.0 / (w0 * wave.k_rho());
                assert!(moment(1).abs() < 1e-10, "mean {}", moment(1));
                let sd = moment(2).sqrt();
                // Narrow beams leave the paraxial form by their angle squared.
                assert!((sd / want - 1.0).abs() < 3.0 * want * want + 1e-9, "sd {sd}, want {want}");
                let wide = wave.theta_i.cos() * w0 * (PI / 2.0).sqrt();
                assert!((got.beam_um / wide - 1.0).abs() < want * want, "{} against {wide}", got.beam_um);
            }
        }
    }

    fn cylinder(x: f64, y: f64, radius_um: f64, kappa: f64) -> Body {
        Body { shape: Shape::Circle { radius_um }, center_um: [x, y], rotation_rad: 0.0, eta: 1.55, kappa, lumen: None }
    }

    /// From a clear fiber in a beam of its own width, off the axis and oblique, all light leaves. An
    /// absorbing fiber removes C_abs. Behind a thick dark fiber in a thin beam it is dark: the beam's own far
    /// field is canceled, not added to.
    #[test]
    fn total_energy_is_the_beams() {
        for (theta_i, h, kappa) in
            [(0.0, 0.0, 0.0), (0.0, 5.5, 0.0), (0.5, -3.0, 0.0), (0.5, 2.0, 0.02), (0.0, 5.0, 0.1)]
        {
            let wave = Wave { lambda_um: 0.5, theta_i };
            let solver = MieSolver::new(&cylinder(2.0, -1.0, 5.0, kappa), &wave, 1e-10).unwrap();
            for pol in POLS {
                let source = beam(pol, PI / 2.0, 4.0, h);
                let n = azimuths(&wave, &source, 8.0, 360);
                let scattered = &solver.scatter(&[source], n).unwrap()[0];
                let got = total_field(&source, &wave, scattered).unwrap();
                let sum = |v: &[f64]| v.iter().sum::<f64>() * TAU / n as f64;
                let (energy, want) = (sum(&got.total), 1.0 - scattered.c_abs_um / got.beam_um);
                assert!((energy - want).abs() < 1e-8, "theta {theta_i} h {h} kappa {kappa}: {energy}, want {want}");
                let alone = sum(&got.scattered) * got.beam_um;
                assert!((alone / scattered.c_sca_um - 1.0).abs() < 1e-8, "{alone}, want {}", scattered.c_sca_um);
            }
        }
        let wave = Wave { lambda_um: 0.5, theta_i: 0.0 };
        let solver = MieSolver::new(&cylinder(0.0, 0.0, 12.0, 0.05), &wave, 1e-10).unwrap();
        let source = beam(Polarization::Te, PI / 2.0, 3.0, 0.0);
        let n = azimuths(&wave, &source, 12.0, 360);
        let scattered = &solver.scatter(&[source], n).unwrap()[0];
        let got = total_field(&source, &wave, scattered).unwrap();
        let forward = n * 3 / 4;
        assert!(
            got.total[forward] < 1e-4 * got.scattered[forward],
            "{} of {}",
            got.total[forward],
            got.scattered[forward]
        );
    }
}
