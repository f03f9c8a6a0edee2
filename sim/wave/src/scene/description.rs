//! The scene of `plywave wave scatter`: bodies, lists of incidences, and checks across them. `scene_toml.rs`
//! reads its text; `scene_check.rs` checks walls against each other.

use crate::scene::scene_check::check_walls;
use crate::{BeamSource, Body, Polarization, Source, Wave, WaveError};

/// Maximum number of complex amplitudes of one run: 0.6 GiB in memory, about 1.5 GiB as JSON.
const MAX_AMPLITUDES: f64 = 4e7;
/// Solver for a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The cheapest solver that suits the scene.
    #[default]
    Auto,
    /// Series of one circle, with concentric circular lumens or none.
    Mie,
    /// Series of several circles.
    Multipole,
    /// Boundary integrals over all walls.
    Nystrom,
    /// Boundary integrals fiber by fiber, coupled through compressed responses.
    Compressed,
    /// As `Compressed`, with the coupling solved by merging groups, for many fibers.
    Hierarchical,
}

impl Method {
    /// All methods, in the order of messages.
    pub(crate) const ALL: [Method; 6] =
        [Method::Auto, Method::Mie, Method::Multipole, Method::Nystrom, Method::Compressed, Method::Hierarchical];

    /// Name of the method in scenes and reports.
    pub fn name(self) -> &'static str {
        match self {
            Method::Auto => "auto",
            Method::Mie => "mie",
            Method::Multipole => "multipole",
            Method::Nystrom => "nystrom",
            Method::Compressed => "compressed",
            Method::Hierarchical => "hierarchical",
        }
    }
}

/// Beams of one waist at several offsets.
#[derive(Clone, Debug, PartialEq)]
pub struct Beams {
    /// Waist w0 [um].
    pub w0_um: f64,
    /// Offsets h of the center [um].
    pub h_um: Vec<f64>,
}

/// Scene of `plywave wave scatter`. Every combination of wavelength, incidence, offset and polarization is
/// one case.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Vacuum wavelengths [um].
    pub lambda_um: Vec<f64>,
    /// Latitudes theta_i [rad].
    pub theta_i: Vec<f64>,
    /// Azimuths phi_i from which the light comes [rad].
    pub phi_i: Vec<f64>,
    /// Number of azimuths of the far field, from 0 in equal steps.
    pub n_phi_out: usize,
    /// Maximum error of the far field, relative to its greatest value.
    pub tolerance: f64,
    /// Solver to use.
    pub method: Method,
    /// Beams; `None` for plane waves.
    pub beams: Option<Beams>,
    /// The fibers.
    pub bodies: Vec<Body>,
}

impl Scene {
    /// Checks conditions across the parts: the walls, the beams at every wave, the number of cases. Parsed
    /// scenes have passed it.
    ///
    /// # Errors
    /// The errors of [`Scene::parse`].
    pub fn check(&self) -> Result<(), WaveError> {
        if self.bodies.is_empty() {
            return Err(invalid("fiber", "(absent)", "give one or more [[fiber]]"));
        }
        let amplitudes = self.cases() as f64 * 2.0 * self.n_phi_out as f64;
        if amplitudes > MAX_AMPLITUDES {
            let value = format!("{} for {} cases", self.n_phi_out, self.cases());
            let hint = format!(
                "{amplitudes:.1e} amplitudes; take fewer azimuths or cases, {MAX_AMPLITUDES:.0e} amplitudes at most"
            );
            return Err(invalid("n_phi_out", value, hint));
        }
        self.check_waists()?;
        for &theta_i in &self.theta_i {
            self.check_indices(theta_i)?;
        }
        check_walls(&self.bodies)
    }

    /// Refuses a waist that is too narrow at any wave; the longest transverse wavelength requires the widest.
    fn check_waists(&self) -> Result<(), WaveError> {
        let Some(beams) = &self.beams else { return Ok(()) };
        let lambda_um = self.lambda_um.iter().copied().fold(0.0, f64::max);
        let theta_i = self.theta_i.iter().copied().fold(0.0, |a: f64, b: f64| if b.abs() > a.abs() { b } else { a });
        let beam = Some(BeamSource { w0_um: beams.w0_um, h_um: 0.0 });
        Source { phi_i: 0.0, pol: Polarization::Tm, beam }.plane_waves(&Wave { lambda_um, theta_i }, 0.0)?;
        Ok(())
    }

    /// Refuses a medium with a transverse wavenumber of zero, which does not depend on the wavelength.
    fn check_indices(&self, theta_i: f64) -> Result<(), WaveError> {
        let wave = Wave { lambda_um: 1.0, theta_i };
        for (i, fiber) in self.bodies.iter().enumerate() {
            let (mut body, mut name) = (Some(fiber), format!("fiber[{i}]"));
            while let Some(at) = body {
                if wave.k_rho_in(at.index()).norm() < MIN_K_RHO * wave.k0() {
                    let hint = format!(
                        "light of theta_i_deg = {} does not travel across a medium of this index; change one of them",
                        degrees(theta_i)
                    );
                    return Err(invalid(&format!("{name}.eta"), at.eta, hint));
                }
                body = at.lumen.as_deref();
                name.push_str(".lumen");
            }
        }
        Ok(())
    }

    /// Wavelength and latitude of every slice, latitudes within wavelengths.
    pub fn waves(&self) -> Vec<Wave> {
        let at = |lambda_um: f64| self.theta_i.iter().map(move |&theta_i| Wave { lambda_um, theta_i });
        self.lambda_um.iter().flat_map(|&lambda_um| at(lambda_um)).collect()
    }

    /// Sources of every slice: azimuths, within them offsets, within them TM and TE.
    pub fn sources(&self) -> Vec<Source> {
        let beams: Vec<Option<BeamSource>> = match &self.beams {
            None => vec![None],
            Some(beams) => beams.h_um.iter().map(|&h_um| Some(BeamSource { w0_um: beams.w0_um, h_um })).collect(),
        };
        let mut sources = Vec::with_capacity(self.phi_i.len() * beams.len() * 2);
        for &phi_i in &self.phi_i {
            for &beam in &beams {
                for pol in [Polarization::Tm, Polarization::Te] {
                    sources.push(Source { phi_i, pol, beam });
                }
            }
        }
        sources
    }

    /// Number of cases, which may be too large to run.
    pub fn cases(&self) -> usize {
        let offsets = self.beams.as_ref().map_or(1, |b| b.h_um.len());
        [self.lambda_um.len(), self.theta_i.len(), self.phi_i.len(), offsets, 2]
            .iter()
            .fold(1usize, |n, &m| n.saturating_mul(m))
    }
}

/// Least |kappa_j| / k_0 of a medium: the fields on walls are divided by its square.
const MIN_K_RHO: f64 = 1e-3;

/// An angle as written in files [degrees], rounded to 1e-12 so that round numbers read back exactly.
pub(crate) fn degrees(angle: f64) -> f64 {
    let rounded = (angle.to_degrees() * 1e12).round() / 1e12;
    // No negative zeros.
    rounded + 0.0
}

pub(crate) fn invalid(key: &str, value: impl std::fmt::Display, hint: impl Into<String>) -> WaveError {
    WaveError::Invalid { key: short(key), value: short(&value.to_string()), hint: hint.into() }
}

/// One line of at most 80 characters.
fn short(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let flat: String = words.join(" ").chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    if flat.chars().count() <= 80 { flat } else { flat.chars().take(77).chain("...".chars()).collect() }
}
