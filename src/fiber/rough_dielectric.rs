//! Zinke 2007's parametric model of rough dielectric fibers (9.2, Eq. 52-53, Table 1), and Marschner's far field as an instance of it (Eq. 42-43).
//!
//! ```text
//! f / cos theta_o = 2 k_d + sum over p of g(pi/2, theta_o + theta_i - shift_p, w_theta_p) a_p(theta_d, h) g(pi, phi - phi_p(h), w_phi_p) / cos^2 theta_d
//! ```
//!
//! of the offset of the query (Eq. 53, with the argument of TRT as Eq. 23 has it), or its mean over the offsets; theta_d = (theta_o - theta_i) / 2 stands for theta_i in
//! attenuations and n'. A lobe with `w_phi = 0` is the smooth cylinder's, by the roots of its offsets, at every offset of the query: with three of them this is Marschner's basic model.
//!
//! As printed the lobes do not conserve energy: their integral is `integral of g cos^2 theta_o / cos^2 theta_d`, which is 1 for narrow lobes away from grazing light alone, and light
//! beyond TRT is in `k_d`. [`Bsdf::albedo`] says how much it is. `DielectricFiber` conserves. What is left out: elliptical sections, widths along the fiber (w_s) and of the offset (w_h), which the
//! paper takes as narrow too.

use super::FiberQuery;
use super::azimuthal::CrossSection;
use super::gaussian::{Gaussian, TruncatedGaussian};
use super::longitudinal::Latitude;
use super::range::{invalid, parameter};
use crate::bsdf::Outcomes;
use crate::frame::is_direction;
use crate::math::clamp_unit;
use crate::{Bsdf, BsdfSample, Result};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Offsets of the far field a side: the mean of the near field over midpoints of gamma. Their azimuths lie 0.1 rad apart at most, 1.6 of the least width, at which a sum of
/// Gaussians is flat to 2e-3.
const OFFSETS_A_SIDE: usize = 32;
/// Steps of the albedo's integral over the latitude.
const LATITUDES: usize = 64;

/// Table 1 of Zinke 2007, but for the eccentricity, with the absorption in the query; three values are of R, TT, TRT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughDielectricParameters {
    /// n, 1.01 to 4.
    pub eta: f32,
    /// Radius [um], 0.01 to 1e5.
    pub radius_um: f32,
    /// Longitudinal shifts of the cones [rad], -1 to 1.
    pub shift: [f32; 3],
    /// Longitudinal widths, w_theta [rad], 0.005 to 1.
    pub width_theta: [f32; 3],
    /// Azimuthal widths, w_phi [rad], 0.06 to 10, or 0 for a smooth cylinder's.
    pub width_phi: [f32; 3],
    /// k_d of light beyond TRT, 0 to `1 / (2 pi^2)`, which alone is white.
    pub k_d: f32,
}

impl Default for RoughDielectricParameters {
    /// Clear, about hair's widths and shifts in Marschner 2003.
    fn default() -> Self {
        RoughDielectricParameters {
            eta: 1.55,
            radius_um: 40.0,
            shift: [-0.1, 0.05, 0.15],
            width_theta: [0.1, 0.05, 0.2],
            width_phi: [0.1, 0.1, 0.2],
            k_d: 0.0,
        }
    }
}

impl RoughDielectricParameters {
    /// Marschner's basic model (Zinke 2007, Eq. 42): the smooth cylinder's azimuths, caustics included.
    pub fn marschner(eta: f32, radius_um: f32, shift: [f32; 3], width_theta: [f32; 3]) -> Self {
        RoughDielectricParameters { eta, radius_um, shift, width_theta, width_phi: [0.0; 3], k_d: 0.0 }
    }
}

/// A rough dielectric fiber.
///
/// ```
/// use plywave::fiber::{RoughDielectricFiber, RoughDielectricParameters};
/// use plywave::frame::direction;
/// use plywave::{Bsdf, FiberModel, FiberQuery};
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
    /// h of the positive offsets of the far field, and the weight of each sign.
    offsets: [(f32, f32); OFFSETS_A_SIDE],
}

impl RoughDielectricFiber {
    /// A fiber of these parameters.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for a parameter outside its range.
    pub fn new(parameters: RoughDielectricParameters) -> Result<RoughDielectricFiber> {
        const MODEL: &str = "rough dielectric fiber";
        let p = &parameters;
        parameter(MODEL, "eta", p.eta, [1.01, 4.0])?;
        parameter(MODEL, "radius_um", p.radius_um, [0.01, 1e5])?;
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
        Ok(RoughDielectricFiber {
            parameters,
            longitudinal: p.width_theta.map(|w| Gaussian::new(w, FRAC_PI_2)),
            azimuthal: p.width_phi.map(|w| (w > 0.0).then(|| Gaussian::new(w, PI))),
            offsets: std::array::from_fn(offset),
        })
    }

    /// What the fiber was made of.
    pub fn parameters(&self) -> &RoughDielectricParameters {
        &self.parameters
    }

    /// The fiber at a query. Where an input is not finite, or `omega_i` is no direction, nothing is scattered.
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> RoughDielectricBsdf<'_, N> {
        let finite = query.sigma_per_um.iter().all(|s| s.is_finite()) && query.h_rel.is_none_or(f32::is_finite);
        let valid = is_direction(query.omega_i) && finite;
        let wi = if valid { query.omega_i } else { [1.0, 0.0, 0.0] };
        let latitude = Latitude::of(wi);
        let theta_i = latitude.sin.atan2(latitude.cos);
        let p = &self.parameters;
        let mut at = RoughDielectricBsdf {
            fiber: self,
            azimuth: if latitude.cos > 0.0 { [wi[0] / latitude.cos, wi[1] / latitude.cos] } else { [1.0, 0.0] },
            theta_i,
            latitude: std::array::from_fn(|lobe| {
                let middle = p.shift[lobe] - theta_i;
                TruncatedGaussian::new(p.width_theta[lobe], [-FRAC_PI_2 - middle, FRAC_PI_2 - middle])
            }),
            sigma_per_um: query.sigma_per_um.map(|s| s.clamp(0.0, 1e6)),
            h_rel: query.h_rel.map(|h| h.clamp(-1.0, 1.0)),
            chance: [0.0; 3],
            valid,
        };
        if valid {
            let section = CrossSection::new(p.eta, p.radius_um, latitude.sin);
            let energy: [f32; 3] = std::array::from_fn(|lobe| at.energy(&section, lobe).iter().sum());
            let total = energy.iter().sum::<f32>() + N as f32 * 2.0 * PI * PI * p.k_d;
            if total > 0.0 {
                at.chance = energy.map(|e| e / total);
            }
        }
        at
    }
}

/// A [`RoughDielectricFiber`] at a query.
#[derive(Clone, Copy, Debug)]
pub struct RoughDielectricBsdf<'a, const N: usize> {
    fiber: &'a RoughDielectricFiber,
    /// Cosine and sine of phi_i; of 0 for light along the fiber.
    azimuth: [f32; 2],
    theta_i: f32,
    /// Of samples: theta_o less the middle of each lobe.
    latitude: [TruncatedGaussian; 3],
    sigma_per_um: [f32; N],
    h_rel: Option<f32>,
    /// Chances of the lobes; what they lack to 1 is the diffuse term's.
    chance: [f32; 3],
    valid: bool,
}

impl<const N: usize> RoughDielectricBsdf<'_, N> {
    /// The fiber's diameter [um]; 0 where the query was refused.
    pub fn width_um(&self) -> [f32; N] {
        [if self.valid { 2.0 * self.fiber.parameters.radius_um } else { 0.0 }; N]
    }

    fn section(&self, theta_o: f32) -> CrossSection {
        let p = &self.fiber.parameters;
        CrossSection::new(p.eta, p.radius_um, (0.5 * (theta_o - self.theta_i)).sin())
    }

    /// Offsets that a lobe's light comes from, the weight of each of its signs, and their number of signs: the query's, or all.
    fn each_offset(&self, lobe: usize, mut visit: impl FnMut(f32, f32)) {
        match self.h_rel {
            Some(h) if self.fiber.azimuthal[lobe].is_some() => visit(h, 1.0),
            _ => self.fiber.offsets.iter().for_each(|(h, weight)| {
                visit(*h, *weight);
                visit(-*h, *weight);
            }),
        }
    }

    fn attenuation(&self, section: &CrossSection, lobe: usize, h_rel: f32) -> [f32; N] {
        let path = section.path(h_rel);
        self.sigma_per_um.map(|s| path.attenuation(lobe as u32, s))
    }

    /// Mean attenuation of a lobe.
    fn energy(&self, section: &CrossSection, lobe: usize) -> [f32; N] {
        let mut sum = [0.0; N];
        self.each_offset(lobe, |h, weight| {
            let a = self.attenuation(section, lobe, h);
            (0..N).for_each(|n| sum[n] += weight * a[n]);
        });
        sum
    }

    /// A lobe's light in the relative azimuth `phi` [1/rad], and the density of samples there.
    fn azimuthal(&self, section: &CrossSection, lobe: usize, phi: f32) -> ([f32; N], f32) {
        let (mut f, mut density) = ([0.0; N], 0.0);
        let Some(gaussian) = &self.fiber.azimuthal[lobe] else {
            section.roots(lobe as u32, phi, |h, each| {
                let a = self.attenuation(section, lobe, h);
                (0..N).for_each(|n| f[n] += each * a[n]);
                density += each;
            });
            return (f, density);
        };
        let mut total = 0.0;
        self.each_offset(lobe, |h, weight| {
            let a = self.attenuation(section, lobe, h);
            let off = phi - section.turn(lobe as u32, h);
            let g = weight * gaussian.eval(off - TAU * (off / TAU).round());
            (0..N).for_each(|n| f[n] += g * a[n]);
            let sum = a.iter().sum::<f32>();
            density += g * sum;
            total += weight * sum;
        });
        (f, if total > 0.0 { density / total } else { 0.0 })
    }

    /// The azimuth of a sample of a lobe by the number `u`.
    fn draw_azimuth(&self, section: &CrossSection, lobe: usize, u: f32) -> f32 {
        let Some(gaussian) = &self.fiber.azimuthal[lobe] else {
            return section.turn(lobe as u32, 2.0 * u - 1.0);
        };
        let weigh = |h: f32, weight: f32| weight * self.attenuation(section, lobe, h).iter().sum::<f32>();
        let mut total = 0.0;
        self.each_offset(lobe, |h, weight| total += weigh(h, weight));
        let (mut left, mut found) = (u * total, None);
        let mut last = (0.0, 0.0);
        self.each_offset(lobe, |h, weight| {
            let share = weigh(h, weight);
            if found.is_none() && share > 0.0 {
                last = (h, 1.0);
                if left < share {
                    found = Some((h, left / share));
                }
                left -= share;
            }
        });
        let (h, u) = found.unwrap_or(last);
        section.turn(lobe as u32, h) + gaussian.sample(clamp_unit(u))
    }
}

impl<const N: usize> Bsdf<N> for RoughDielectricBsdf<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.eval_pdf(w).0
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.eval_pdf(w).1
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        if !(self.valid && is_direction(w)) {
            return ([0.0; N], 0.0);
        }
        let o = Latitude::of(w);
        let theta_o = o.sin.atan2(o.cos);
        let cos_d = (0.5 * (theta_o - self.theta_i)).cos();
        let [x, y] = self.azimuth;
        let phi = (x * w[1] - y * w[0]).atan2(x * w[0] + y * w[1]);
        let section = self.section(theta_o);
        let mut f = [2.0 * self.fiber.parameters.k_d * o.cos; N];
        let mut pdf = (1.0 - self.chance.iter().sum::<f32>()).max(0.0) / (2.0 * TAU);
        for lobe in 0..3 {
            let off = theta_o + self.theta_i - self.fiber.parameters.shift[lobe];
            let m = o.cos / (cos_d * cos_d).max(1e-6) * self.fiber.longitudinal[lobe].eval(off);
            let drawn = self.chance[lobe] * self.latitude[lobe].eval(off) / o.cos.max(1e-6);
            if m == 0.0 && drawn == 0.0 {
                continue;
            }
            let (azimuthal, density) = self.azimuthal(&section, lobe, phi);
            (0..N).for_each(|n| f[n] += m * azimuthal[n]);
            pdf += drawn * density;
        }
        (f, pdf)
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        if !(self.valid && u.iter().all(|v| (0.0..1.0).contains(v))) {
            return BsdfSample::Absorbed;
        }
        let mut left = u[2];
        let mut chosen = None;
        for lobe in 0..3 {
            if left < self.chance[lobe] {
                chosen = Some(lobe);
                break;
            }
            left -= self.chance[lobe];
        }
        let diffuse = 1.0 - self.chance.iter().sum::<f32>();
        if chosen.is_none() && self.fiber.parameters.k_d == 0.0 {
            // What rounding leaves over is the strongest lobe's.
            chosen = (0..3).max_by(|a, b| self.chance[*a].total_cmp(&self.chance[*b]));
            if diffuse >= 0.5 {
                return BsdfSample::Absorbed;
            }
        }
        let (latitude, azimuth) = match chosen {
            Some(lobe) => {
                let middle = self.fiber.parameters.shift[lobe] - self.theta_i;
                let theta_o = (middle + self.latitude[lobe].sample(u[1])).clamp(-FRAC_PI_2, FRAC_PI_2);
                let (sin, cos) = theta_o.sin_cos();
                (Latitude { sin, cos: cos.max(0.0) }, self.draw_azimuth(&self.section(theta_o), lobe, u[0]))
            }
            None => {
                let sin = 2.0 * u[1] - 1.0;
                (Latitude { sin, cos: (1.0 - sin * sin).max(0.0).sqrt() }, TAU * u[0])
            }
        };
        let [x, y] = self.azimuth;
        let (sin, cos) = azimuth.sin_cos();
        let w = [latitude.cos * (x * cos - y * sin), latitude.cos * (x * sin + y * cos), latitude.sin];
        let (f, pdf) = self.eval_pdf(w);
        BsdfSample::scattered(w, f, pdf)
    }

    /// Integral of f, by Gauss's midpoints over the latitude: some 10 us in the far field.
    fn albedo(&self) -> [f32; N] {
        if !self.valid {
            return [0.0; N];
        }
        let p = &self.fiber.parameters;
        let mut sum = [2.0 * PI * PI * p.k_d; N];
        for lobe in 0..3 {
            let middle = p.shift[lobe] - self.theta_i;
            let reach = 6.0 * p.width_theta[lobe];
            let (low, high) = ((middle - reach).max(-FRAC_PI_2), (middle + reach).min(FRAC_PI_2));
            let step = (high - low).max(0.0) / LATITUDES as f32;
            for k in 0..LATITUDES {
                let theta_o = low + (k as f32 + 0.5) * step;
                let cos_d = (0.5 * (theta_o - self.theta_i)).cos();
                let ratio = theta_o.cos().powi(2) / (cos_d * cos_d).max(1e-6);
                let m = step * ratio * self.fiber.longitudinal[lobe].eval(theta_o - middle);
                let a = self.energy(&self.section(theta_o), lobe);
                (0..N).for_each(|n| sum[n] += m * a[n]);
            }
        }
        sum
    }

    fn outcomes(&self) -> Outcomes {
        let lit = self.valid && (self.fiber.parameters.k_d > 0.0 || self.chance.iter().sum::<f32>() > 0.5);
        if lit { Outcomes::SCATTERED } else { Outcomes::ABSORBED }
    }
}
