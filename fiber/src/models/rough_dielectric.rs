//! Zinke 2007's parametric model of rough dielectric fibers (9.2, Eq. 52-53, Table 1), and Marschner's far
//! field as an instance of it (Eq. 42-43).
//!
//! ```text
//! f / cos theta_o = 2 k_d + sum over p of g(pi/2, theta_o + theta_i - shift_p, w_theta_p) a_p(theta_d, h) g(pi, phi - phi_p(h), w_phi_p) / cos^2 theta_d
//! ```
//!
//! at the offset of the query (Eq. 53, with the argument of TRT from Eq. 23), or its mean over the offsets.
//! theta_d = (theta_o - theta_i) / 2 replaces theta_i in the attenuations and in n'. A lobe with `w_phi = 0`
//! is that of the smooth cylinder, computed from the roots of phi_p(h), whatever the query's offset. With
//! three such lobes this is Marschner's basic model.
//!
//! As printed the lobes do not conserve energy. Their integral is
//! `integral of g cos^2 theta_o / cos^2 theta_d`, which is 1 only for narrow lobes away from grazing light,
//! and light beyond TRT is in `k_d`. [`Bsdf::albedo`] returns the integral, and
//! [`RoughDielectricParameters::normalize`] scales it to 1; `DielectricFiber` conserves energy. Not modeled
//! are the widths along the fiber (w_s) and of the offset (w_h), which the paper assumes to be narrow too.
//!
//! Far fields come from a table that is built with the fiber (9.2) and is valid for any absorption. An
//! elliptical cross section follows Marschner: TRT has an index that depends on (phi_i + phi_o)/2, and the
//! width is the projected one. Its far TRT is a sum over offsets at every call, which takes about 2 us.

use crate::FiberQuery;
use crate::distributions::azimuthal::{CrossSection, OFFSETS, turn};
use crate::distributions::fast::{asin, atan2, atan2_each, exp, lanes, sin_cos, wrapped};
use crate::distributions::gaussian::{Gaussian, TruncatedGaussian};
use crate::distributions::longitudinal::Latitude;
use crate::incident::Incident;
use crate::models::far_table::{FarTable, Through};
use crate::models::normalized::Factors;
use crate::range::{invalid, parameter};
use plywave::bsdf::Outcomes;
use plywave::frame::{direction, is_direction};
use plywave::math::clamp_unit;
use plywave::{Bsdf, BsdfSample, Result};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Number of offsets on each side for an ellipse's far TRT, which is the mean of the near field over
/// midpoints of gamma. Their azimuths are at most 0.1 rad apart, 1.6 of the smallest width, at which a sum of
/// Gaussians is flat to 2e-3.
const OFFSETS_A_SIDE: usize = 32;
/// Minimum probability of a lobe that has any light.
const MIN_CHANCE: f32 = 0.04;
/// Number of steps of the albedo's integral over the latitude.
const LATITUDES: usize = 64;
/// Numbers of steps of an elliptical section's albedo, over latitude and azimuth.
const ELLIPTICAL: [usize; 2] = [32, 256];

/// The parameters of Table 1 of Zinke 2007; the absorption is in the query. Arrays of three are for R, TT,
/// TRT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughDielectricParameters {
    /// Refractive index n, 1.01 to 4.
    pub eta: f32,
    /// Radius [um], 0.01 to 1e5; for an ellipse the geometric mean of its half axes.
    pub radius_um: f32,
    /// Eccentricity e: half axis of the cross section along x divided by that along y, 0.8 to 1.25; 1 for a
    /// circle.
    pub eccentricity: f32,
    /// Longitudinal shifts of the cones [rad], -1 to 1.
    pub shift: [f32; 3],
    /// Longitudinal widths, w_theta [rad], 0.005 to 1.
    pub width_theta: [f32; 3],
    /// Azimuthal widths, w_phi [rad], 0.06 to 10, or 0 for a smooth cylinder.
    pub width_phi: [f32; 3],
    /// k_d of light beyond TRT, 0 to `1 / (2 pi^2)`, which is white if there are no other lobes.
    pub k_d: f32,
    /// Whether f is scaled to the albedo 1 without absorption, at every incidence, in the far and the near
    /// field; only for a circle. f is divided by the albedo of the printed lobes at the query's latitude and
    /// offset, by the same factor at every absorption. In exchange, f / cos theta_o is no longer reciprocal,
    /// and the far field is no longer exactly the mean of the near field.
    pub normalize: bool,
}

impl Default for RoughDielectricParameters {
    /// A clear fiber with widths and shifts about those of hair in Marschner 2003.
    fn default() -> Self {
        RoughDielectricParameters {
            eta: 1.55,
            radius_um: 40.0,
            eccentricity: 1.0,
            shift: [-0.1, 0.05, 0.15],
            width_theta: [0.1, 0.05, 0.2],
            width_phi: [0.1, 0.1, 0.2],
            k_d: 0.0,
            normalize: false,
        }
    }
}

impl RoughDielectricParameters {
    /// Marschner's basic model (Zinke 2007, Eq. 42), with the azimuths of the smooth cylinder, caustics
    /// included.
    pub fn marschner(eta: f32, radius_um: f32, shift: [f32; 3], width_theta: [f32; 3]) -> Self {
        RoughDielectricParameters {
            eta,
            radius_um,
            eccentricity: 1.0,
            shift,
            width_theta,
            width_phi: [0.0; 3],
            k_d: 0.0,
            normalize: false,
        }
    }
}

/// A rough dielectric fiber.
///
/// ```
/// use plywave_fiber::{RoughDielectricFiber, RoughDielectricParameters};
/// use plywave::frame::direction;
/// use plywave::Bsdf;
/// use plywave_fiber::{FiberModel, FiberQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let hair: FiberModel = RoughDielectricFiber::new(RoughDielectricParameters::default())?.into();
/// let query = FiberQuery::new(direction(0.3, 0.0), [0.61, 0.55, 0.465]);
/// let brown = FiberQuery { sigma_per_um: [0.005, 0.01, 0.02], h_rel: Some(-0.4), ..query };
/// let [red, green, blue] = hair.at(&brown).eval(direction(-0.3, 3.0));
/// assert!(red > green && green > blue);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RoughDielectricFiber {
    parameters: RoughDielectricParameters,
    longitudinal: [Gaussian; 3],
    azimuthal: [Option<Gaussian>; 3],
    lobes: Lobes,
    /// Positive offsets h of an ellipse's far TRT, and the weight of each sign.
    offsets: Vec<(f32, f32)>,
    far: FarTable,
    /// n_1 and n_2 of an ellipse; `None` for a circle.
    ellipse: Option<[f32; 2]>,
    /// Factors of a normalized fiber; `None` if it is not normalized.
    factors: Option<Factors>,
}

/// R, TT and TRT side by side in a vector; the last of the four lanes has no light.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lobes {
    shift: [f32; 4],
    /// Reciprocals of the widths of latitude and azimuth; 0 for a lobe without azimuthal width.
    inverse: [[f32; 4]; 2],
    /// Densities at the center.
    peak: [[f32; 4]; 2],
    /// Whether the cross section is a circle and all lobes have an azimuthal width.
    plain: bool,
}

impl Lobes {
    fn new(p: &RoughDielectricParameters) -> Lobes {
        let of = |get: &dyn Fn(usize) -> f32| lanes(|k| if k < 3 { get(k) } else { 0.0 });
        let azimuth = |k: usize| (p.width_phi[k] > 0.0).then(|| Gaussian::new(p.width_phi[k], PI));
        Lobes {
            shift: of(&|k| p.shift[k]),
            inverse: [
                of(&|k| 1.0 / p.width_theta[k]),
                of(&|k| if p.width_phi[k] > 0.0 { 1.0 / p.width_phi[k] } else { 0.0 }),
            ],
            peak: [
                of(&|k| Gaussian::new(p.width_theta[k], FRAC_PI_2).normalizer()),
                of(&|k| azimuth(k).map_or(0.0, |g| g.normalizer())),
            ],
            plain: p.eccentricity == 1.0 && p.width_phi.iter().all(|w| *w > 0.0),
        }
    }
}

impl RoughDielectricFiber {
    /// Builds a fiber with these parameters.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] if a parameter is outside its range.
    pub fn new(parameters: RoughDielectricParameters) -> Result<RoughDielectricFiber> {
        const MODEL: &str = "rough dielectric fiber";
        let p = &parameters;
        parameter(MODEL, "eta", p.eta, [1.01, 4.0])?;
        parameter(MODEL, "radius_um", p.radius_um, [0.01, 1e5])?;
        parameter(MODEL, "eccentricity", p.eccentricity, [0.8, 1.25])?;
        for lobe in 0..3 {
            parameter(MODEL, "shift", p.shift[lobe], [-1.0, 1.0])?;
            parameter(MODEL, "width_theta", p.width_theta[lobe], [0.005, 1.0])?;
            if !(p.width_phi[lobe] == 0.0 || (0.06..=10.0).contains(&p.width_phi[lobe])) {
                return Err(invalid(MODEL, "width_phi", p.width_phi[lobe], "use 0, or 0.06 to 10".into()));
            }
        }
        parameter(MODEL, "k_d", p.k_d, [0.0, 1.0 / (2.0 * PI * PI)])?;
        let step = std::f64::consts::FRAC_PI_2 / OFFSETS_A_SIDE as f64;
        let gamma = |k: usize| (k as f64 + 0.5) * step;
        let sum: f64 = (0..OFFSETS_A_SIDE).map(|k| gamma(k).cos()).sum();
        let offset = |k: usize| (gamma(k).sin() as f32, (0.5 * gamma(k).cos() / sum) as f32);
        if p.normalize && p.eccentricity != 1.0 {
            let hint = "an ellipse's albedo depends on the azimuth of the light: use eccentricity = 1, or leave it out";
            return Err(invalid(MODEL, "normalize", true, hint.into()));
        }
        let mut fiber = RoughDielectricFiber {
            parameters,
            longitudinal: p.width_theta.map(|w| Gaussian::new(w, FRAC_PI_2)),
            azimuthal: p.width_phi.map(|w| (w > 0.0).then(|| Gaussian::new(w, PI))),
            lobes: Lobes::new(p),
            offsets: (0..OFFSETS_A_SIDE).map(offset).collect(),
            // For a lobe without azimuthal width only the energies are used.
            far: FarTable::new(p.eta, &p.width_phi.map(|w| if w > 0.0 { w } else { 0.5 })),
            ellipse: (p.eccentricity != 1.0).then(|| ellipse_indices(p.eta, p.eccentricity)),
            factors: None,
        };
        if p.normalize {
            let albedo = |theta: f32, h_rel: Option<f32>| {
                let query = FiberQuery { h_rel, ..FiberQuery::new(direction(theta, 0.0), [0.55]) };
                fiber.at(&query).albedo()[0]
            };
            fiber.factors = Some(Factors::new(MODEL, "normalize", albedo)?);
        }
        Ok(fiber)
    }

    /// The fiber's parameters.
    pub fn parameters(&self) -> &RoughDielectricParameters {
        &self.parameters
    }

    /// The fiber at a query. If an input is not finite or `omega_i` is not a direction, no light is
    /// scattered.
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> RoughDielectricBsdf<'_, N> {
        let finite = query.sigma_per_um.iter().all(|s| s.is_finite()) && query.h_rel.is_none_or(f32::is_finite);
        let incident = Incident::new(query.omega_i, finite);
        let latitude = incident.latitude;
        let theta_i = atan2(latitude.sin, latitude.cos);
        let p = &self.parameters;
        let h_rel = query.h_rel.map(|h| h.clamp(-1.0, 1.0));
        let mut at = RoughDielectricBsdf {
            fiber: self,
            incident,
            theta_i,
            latitude: TruncatedGaussian::three(
                p.width_theta,
                p.shift.map(|shift| [-FRAC_PI_2 - (shift - theta_i), FRAC_PI_2 - (shift - theta_i)]),
            ),
            sigma_per_um: lanes(|n| query.sigma_per_um[n].clamp(0.0, 1e6)),
            near: h_rel.map(|h| [h, asin(h)]),
            factor: 1.0,
            chance: [0.0; 3],
            diffuse_chance: 1.0,
        };
        if let Some(factors) = &self.factors {
            at.factor = factors.at(theta_i, at.near.map(|[_, gamma]| gamma));
        }
        if incident.valid {
            let through = (at.near.is_none() || !self.lobes.plain).then(|| {
                let section = CrossSection::at(p.eta, p.radius_um, latitude);
                self.far.through(&lanes(|n| at.sigma_per_um[n] * section.chord_um()))
            });
            let energy: [f32; 3] = lanes(|lobe| at.energy(lobe, through.as_ref()));
            // Each lobe gets a minimum share, however weak it is at its median, so light far from the median
            // is sampled with weights of at most ten.
            let min_energy = MIN_CHANCE * energy.iter().sum::<f32>();
            let energy: [f32; 3] =
                lanes(|lobe| if at.latitude[lobe].share() > 0.0 { energy[lobe] + min_energy } else { 0.0 });
            let total = energy.iter().sum::<f32>() + N as f32 * 2.0 * PI * PI * p.k_d;
            if total > 0.0 {
                at.chance = lanes(|lobe| energy[lobe] / total);
                at.diffuse_chance = N as f32 * 2.0 * PI * PI * p.k_d / total;
            }
        }
        at
    }

    /// Width of the cross section for light of the azimuth `[cos, sin]` [um].
    fn width_um(&self, [x, y]: [f32; 2]) -> f32 {
        let e = self.parameters.eccentricity;
        2.0 * self.parameters.radius_um * (e * y * y + x * x / e).sqrt()
    }

    /// Maximum width over all azimuths [um].
    pub(crate) fn max_width_um(&self) -> f32 {
        self.width_um([1.0, 0.0]).max(self.width_um([0.0, 1.0]))
    }
}

/// n_1 and n_2: the indices of circles whose TRT is that of an ellipse, for light along x and along y
/// (Marschner 2003; Zinke 2007, 8.2).
fn ellipse_indices(eta: f32, e: f32) -> [f32; 2] {
    [e * e, 1.0 / (e * e)].map(|e2| 2.0 * (eta - 1.0) * e2 - eta + 2.0)
}

/// A [`RoughDielectricFiber`] at a query.
#[derive(Clone, Copy, Debug)]
pub struct RoughDielectricBsdf<'a, const N: usize> {
    fiber: &'a RoughDielectricFiber,
    incident: Incident,
    theta_i: f32,
    /// Distributions of theta_o relative to the center of each lobe, for sampling.
    latitude: [TruncatedGaussian; 3],
    sigma_per_um: [f32; N],
    /// Offset h and its angle gamma_i; `None` for the far field.
    near: Option<[f32; 2]>,
    /// Normalization factor of all light.
    factor: f32,
    /// Probabilities of the lobes.
    chance: [f32; 3],
    diffuse_chance: f32,
}

/// Angles at which f is evaluated: latitude, azimuth relative to phi_i, and gamma_t at the query's offset.
#[derive(Clone, Copy)]
struct Angles {
    theta_o: f32,
    phi: f32,
    gamma_t: f32,
}

/// A lobe's light in an azimuth [1/rad], and the density of samples there.
type Azimuthal<const N: usize> = ([f32; N], f32);

impl<const N: usize> RoughDielectricBsdf<'_, N> {
    /// The fiber's diameter [um], for an ellipse its width across the light; 0 if the query is invalid.
    pub fn width_um(&self) -> [f32; N] {
        [if self.incident.valid { self.fiber.width_um(self.incident.azimuth()) } else { 0.0 }; N]
    }

    /// Approximate energy of a lobe over all wavelengths, evaluated at the median of its latitudes, because
    /// near a pole the attenuations there differ from those at theta_i.
    fn energy(&self, lobe: usize, through: Option<&Through<N>>) -> f32 {
        let share = self.latitude[lobe].share();
        if share == 0.0 {
            return 0.0;
        }
        let p = &self.fiber.parameters;
        let theta_o = p.shift[lobe] - self.theta_i + self.latitude[lobe].median();
        let theta_o = theta_o.max(-FRAC_PI_2).min(FRAC_PI_2);
        let (sin, cos) = sin_cos(theta_o);
        let o = Latitude { sin, cos: cos.max(0.0) };
        let light: f32 = match (self.near, &self.fiber.azimuthal[lobe]) {
            (Some([h, _]), Some(_)) => self.attenuations(&self.section(o), h)[lobe].iter().sum(),
            _ => {
                let Some(through) = through else { return 0.0 };
                let far = &self.fiber.far;
                far.total_light(far.row(0.5 * (theta_o - self.theta_i)), lobe, through).iter().sum()
            }
        };
        let ratio = o.cos / self.half_way(o).cos.max(1e-6);
        share * ratio * ratio * light
    }

    /// The cross section for light at the latitude theta_d between theta_i and this one.
    #[inline]
    fn section(&self, o: Latitude) -> CrossSection {
        let p = &self.fiber.parameters;
        CrossSection::at(p.eta, p.radius_um, self.half_way(o))
    }

    /// theta_d without its sign. Half the sum and half the difference of the two unit vectors have the
    /// lengths of its cosine and sine.
    #[inline]
    fn half_way(&self, o: Latitude) -> Latitude {
        let i = self.incident.latitude;
        let half = |x: f32, y: f32| 0.5 * (x * x + y * y).sqrt();
        Latitude { sin: half(i.cos - o.cos, i.sin - o.sin), cos: half(i.cos + o.cos, i.sin + o.sin) }
    }

    /// The equivalent circular cross section for TRT of an ellipse, between phi_i and the relative azimuth
    /// `phi`.
    fn elliptical(&self, o: Latitude, phi: f32) -> Option<CrossSection> {
        let [first, second] = self.fiber.ellipse?;
        let p = &self.fiber.parameters;
        // cos(phi_i + phi_o) = cos(2 phi_i + phi).
        let [x, y] = self.incident.azimuth();
        let (sin, cos) = sin_cos(phi);
        let double = (x * x - y * y) * cos - 2.0 * x * y * sin;
        let eta = 0.5 * ((first + second) + double * (first - second));
        Some(CrossSection::at(eta.max(1.001), p.radius_um, self.half_way(o)))
    }

    /// Attenuations of R, TT and TRT at an offset.
    #[inline]
    fn attenuations(&self, section: &CrossSection, h_rel: f32) -> [[f32; N]; 3] {
        let path = section.path(h_rel);
        let f = path.reflectance;
        let t: [f32; N] = lanes(|n| exp(-self.sigma_per_um[n] * path.length_um));
        let inner: [f32; N] = lanes(|n| (1.0 - f) * (1.0 - f) * t[n]);
        [[f; N], inner, lanes(|n| inner[n] * f * t[n])]
    }

    /// A lobe's light at the query's offset, or the mean over all offsets as a sum.
    fn summed(&self, section: &CrossSection, lobe: usize, phi: f32, gaussian: &Gaussian) -> [f32; N] {
        let mut f = [0.0; N];
        let mut add = |h: f32, weight: f32| {
            let a = self.attenuations(section, h)[lobe];
            let g = weight * gaussian.eval(wrapped(phi - section.turn(lobe as u32, h)));
            (0..N).for_each(|n| f[n] += g * a[n]);
        };
        match self.near {
            Some([h, _]) => add(h, 1.0),
            None => self.fiber.offsets.iter().for_each(|(h, weight)| {
                add(*h, *weight);
                add(-*h, *weight);
            }),
        }
        f
    }

    /// A lobe's light and density for a smooth cylinder, from the roots.
    fn rooted(&self, section: &CrossSection, lobe: usize, phi: f32) -> Azimuthal<N> {
        let (mut f, mut density) = ([0.0; N], 0.0);
        section.roots(lobe as u32, phi, |h, each| {
            let a = self.attenuations(section, h)[lobe];
            (0..N).for_each(|n| f[n] += each * a[n]);
            density += each;
        });
        (f, density)
    }

    /// gamma_t at the query's offset; 0 for the far field.
    #[inline]
    fn gamma_t(&self, section: &CrossSection) -> f32 {
        self.near.map_or(0.0, |[h, _]| section.gamma_t(h))
    }

    /// All lobes in the relative azimuth `phi`.
    #[inline]
    fn azimuthal(
        &self,
        o: Latitude,
        section: &CrossSection,
        Angles { theta_o, phi, gamma_t }: Angles,
    ) -> [Azimuthal<N>; 3] {
        let mut all = [([0.0; N], 0.0); 3];
        if let Some([h, gamma]) = self.near {
            let a = self.attenuations(section, h);
            for lobe in 0..3 {
                if let Some(gaussian) = &self.fiber.azimuthal[lobe] {
                    let g = gaussian.eval(wrapped(phi - turn(lobe as u32, gamma, gamma_t)));
                    all[lobe] = (lanes(|n| a[lobe][n] * g), g);
                }
            }
        } else {
            let far = &self.fiber.far;
            let row = far.row(0.5 * (theta_o - self.theta_i));
            let chord_um = section.chord_um();
            let through = far.through(&lanes(|n| self.sigma_per_um[n] * chord_um));
            let totals: [f32; 3] = far.energies(row);
            far.each_order(row, phi, &through, |lobe, light, energy| {
                all[lobe] = (light, if totals[lobe] > 0.0 { energy / totals[lobe] } else { 0.0 });
            });
        }
        for lobe in 0..3 {
            if self.fiber.azimuthal[lobe].is_none() {
                all[lobe] = self.rooted(section, lobe, phi);
            }
        }
        if let Some(section) = self.elliptical(o, phi) {
            let light = match &self.fiber.azimuthal[2] {
                Some(gaussian) => self.summed(&section, 2, phi, gaussian),
                None => self.rooted(&section, 2, phi).0,
            };
            // Half of the samples follow the circle, the other half is uniform.
            all[2] = (light, 0.5 * all[2].1 + 0.5 / TAU);
        }
        all
    }

    /// Samples the azimuth of a lobe by the number `u`.
    fn draw_azimuth(&self, section: &CrossSection, theta_o: f32, gamma_t: f32, lobe: usize, mut u: f32) -> f32 {
        if lobe == 2 && self.fiber.ellipse.is_some() {
            if u < 0.5 {
                return 2.0 * TAU * u;
            }
            u = clamp_unit(2.0 * u - 1.0);
        }
        match (&self.fiber.azimuthal[lobe], self.near) {
            (None, _) => section.turn(lobe as u32, 2.0 * u - 1.0),
            (Some(gaussian), Some([_, gamma])) => turn(lobe as u32, gamma, gamma_t) + gaussian.sample(u),
            (Some(_), None) => self.fiber.far.sample(self.fiber.far.row(0.5 * (theta_o - self.theta_i)), lobe, u),
        }
    }

    /// f and its density at a latitude with its cross section, and at a relative azimuth.
    #[inline]
    fn at_angles(&self, o: Latitude, section: &CrossSection, angles: Angles) -> ([f32; N], f32) {
        let (p, lobes) = (&self.fiber.parameters, &self.fiber.lobes);
        let cos_d = self.half_way(o).cos;
        let scale = self.factor * o.cos / (cos_d * cos_d).max(1e-12);
        let inverse = 1.0 / o.cos.max(1e-6);
        let mut f = [self.factor * 2.0 * p.k_d * o.cos; N];
        let mut pdf = self.diffuse_chance / (2.0 * TAU);
        // Exponents of the Gaussians over the latitude.
        let along: [f32; 4] = lanes(|k| {
            let t = (angles.theta_o + self.theta_i - lobes.shift[k]) * lobes.inverse[0][k];
            -0.5 * t * t
        });
        if let (Some([h, gamma]), true) = (self.near, lobes.plain) {
            let turns = [0, 1, 2, 2].map(|order| turn(order, gamma, angles.gamma_t));
            let shape: [f32; 4] = lanes(|k| {
                let t = wrapped(angles.phi - turns[k]) * lobes.inverse[1][k];
                lobes.peak[1][k] * exp(along[k] - 0.5 * t * t)
            });
            let a = self.attenuations(section, h);
            for lobe in 0..3 {
                let m = scale * shape[lobe] * lobes.peak[0][lobe];
                (0..N).for_each(|n| f[n] += m * a[lobe][n]);
                pdf += self.chance[lobe] * shape[lobe] * self.latitude[lobe].normalizer() * inverse;
            }
            return (f, pdf);
        }
        let shape: [f32; 4] = lanes(|k| exp(along[k]));
        if shape[0] + shape[1] + shape[2] < 1e-30 {
            return (f, pdf);
        }
        let all = self.azimuthal(o, section, angles);
        for lobe in 0..3 {
            let m = scale * shape[lobe] * lobes.peak[0][lobe];
            let drawn = self.chance[lobe] * shape[lobe] * self.latitude[lobe].normalizer() * inverse;
            let (light, density) = &all[lobe];
            (0..N).for_each(|n| f[n] += m * light[n]);
            pdf += drawn * density;
        }
        (f, pdf)
    }
}

impl<const N: usize> Bsdf<N> for RoughDielectricBsdf<'_, N> {
    #[inline]
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.eval_pdf(w).0
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.eval_pdf(w).1
    }

    #[inline]
    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        if !(self.incident.valid && is_direction(w)) {
            return ([0.0; N], 0.0);
        }
        let o = Latitude::from_direction(w);
        let section = self.section(o);
        let [across, side] = self.incident.relative(w);
        let [sin_t, cos_t] = self.near.map_or([0.0, 1.0], |[h, _]| [section.sin_t(h), section.cos_t(h)]);
        let [theta_o, phi, gamma_t, _] = atan2_each([o.sin, side, sin_t, 0.0], [o.cos, across, cos_t, 1.0]);
        self.at_angles(o, &section, Angles { theta_o, phi, gamma_t })
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        if !(self.incident.valid && u.iter().all(|v| (0.0..1.0).contains(v))) {
            return BsdfSample::Absorbed;
        }
        let mut remaining = u[2];
        let mut chosen = None;
        for lobe in 0..3 {
            if remaining < self.chance[lobe] {
                chosen = Some(lobe);
                break;
            }
            remaining -= self.chance[lobe];
        }
        if chosen.is_none() && self.fiber.parameters.k_d == 0.0 {
            // Rounding may leave a remainder, which goes to the most probable lobe.
            chosen = (0..3).max_by(|a, b| self.chance[*a].total_cmp(&self.chance[*b]));
            if self.diffuse_chance >= 0.5 {
                return BsdfSample::Absorbed;
            }
        }
        let (latitude, section, angles) = match chosen {
            Some(lobe) => {
                let middle = self.fiber.parameters.shift[lobe] - self.theta_i;
                let theta_o = (middle + self.latitude[lobe].sample(u[1])).clamp(-FRAC_PI_2, FRAC_PI_2);
                let (sin, cos) = sin_cos(theta_o);
                let o = Latitude { sin, cos: cos.max(0.0) };
                let section = self.section(o);
                let gamma_t = self.gamma_t(&section);
                let phi = self.draw_azimuth(&section, theta_o, gamma_t, lobe, u[0]);
                (o, section, Angles { theta_o, phi: wrapped(phi), gamma_t })
            }
            None => {
                let sin = 2.0 * u[1] - 1.0;
                let o = Latitude { sin, cos: (1.0 - sin * sin).max(0.0).sqrt() };
                let section = self.section(o);
                let gamma_t = self.gamma_t(&section);
                (o, section, Angles { theta_o: atan2(o.sin, o.cos), phi: wrapped(TAU * u[0]), gamma_t })
            }
        };
        let (sin, cos) = sin_cos(angles.phi);
        let w = self.incident.direction([latitude.cos * cos, latitude.cos * sin], latitude.sin);
        // Caustics depend on the last digit of the direction, so f is evaluated as `eval` would evaluate it.
        let smooth = self.fiber.azimuthal.iter().any(Option::is_none);
        let (f, pdf) = if smooth { self.eval_pdf(w) } else { self.at_angles(latitude, &section, angles) };
        BsdfSample::scattered(w, f, pdf)
    }

    /// Integral of f, by the midpoint rule over the latitude and, for an ellipse, over the azimuth. It takes
    /// about 50 us in the far field and 20 ms for an ellipse.
    fn albedo(&self) -> [f32; N] {
        if !self.incident.valid {
            return [0.0; N];
        }
        let p = &self.fiber.parameters;
        let mut sum = [2.0 * PI * PI * p.k_d; N];
        for lobe in 0..3 {
            let elliptical = lobe == 2 && self.fiber.ellipse.is_some();
            let latitudes = if elliptical { ELLIPTICAL[0] } else { LATITUDES };
            let middle = p.shift[lobe] - self.theta_i;
            let reach = 6.0 * p.width_theta[lobe];
            let (low, high) = ((middle - reach).max(-FRAC_PI_2), (middle + reach).min(FRAC_PI_2));
            if high <= low {
                continue;
            }
            for k in 0..latitudes {
                // Midpoints of an angle whose cosine is the position: they are dense at the ends, where a
                // pole may be.
                let (sin, cos) = (PI * (k as f32 + 0.5) / latitudes as f32).sin_cos();
                let theta_o = 0.5 * (low + high) - 0.5 * (high - low) * cos;
                let step = 0.5 * PI / latitudes as f32 * (high - low) * sin;
                let (sin, cos) = theta_o.sin_cos();
                let o = Latitude { sin, cos: cos.max(0.0) };
                let cos_d = self.half_way(o).cos;
                let ratio = cos * cos / (cos_d * cos_d).max(1e-12);
                let m = step * ratio * self.fiber.longitudinal[lobe].eval(theta_o - middle);
                let mut light = [0.0; N];
                let mut add = |weight: f32, a: [f32; N]| (0..N).for_each(|n| light[n] += weight * a[n]);
                let section = self.section(o);
                let gamma_t = self.gamma_t(&section);
                if elliptical {
                    for j in 0..ELLIPTICAL[1] {
                        let phi = TAU * ((j as f32 + 0.5) / ELLIPTICAL[1] as f32 - 0.5);
                        let angles = Angles { theta_o, phi, gamma_t };
                        add(TAU / ELLIPTICAL[1] as f32, self.azimuthal(o, &section, angles)[2].0);
                    }
                } else {
                    match (self.near, &self.fiber.azimuthal[lobe]) {
                        (Some([h, _]), Some(_)) => add(1.0, self.attenuations(&section, h)[lobe]),
                        _ => OFFSETS.iter().for_each(|(h, weight)| {
                            add(*weight, self.attenuations(&section, *h)[lobe]);
                        }),
                    }
                }
                (0..N).for_each(|n| sum[n] += m * light[n]);
            }
        }
        sum.map(|light| self.factor * light)
    }

    fn outcomes(&self) -> Outcomes {
        let scatters =
            self.incident.valid && (self.fiber.parameters.k_d > 0.0 || self.chance.iter().sum::<f32>() > 0.5);
        if scatters { Outcomes::SCATTERED } else { Outcomes::ABSORBED }
    }
}
