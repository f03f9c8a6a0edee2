//! Kajiya and Kay's model (1989) as a BCSDF (Zinke 2007, Eq. 41):
//! `K_phong cos^n(theta_o + theta_i) / cos theta_i + K_diffuse`, 0 where the cosine is negative.
//!
//! The model is phenomenological. It has no color, no Fresnel term and no dependence on azimuth, and it does
//! not conserve energy: for grazing light it scatters `1 / cos theta_i` times more than arrives.
//! [`Bsdf::albedo`] returns the ratio.

use crate::FiberQuery;
use crate::distributions::fast::{atan2, exp, ln, sin_cos};
use crate::distributions::gaussian::TruncatedGaussian;
use crate::distributions::longitudinal::Latitude;
use crate::incident::Incident;
use crate::range::{invalid, parameter};
use plywave::bsdf::Outcomes;
use plywave::frame::is_direction;
use plywave::{Bsdf, BsdfSample, Result};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Parameters of a [`KajiyaKayFiber`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KajiyaKayParameters {
    /// Radius [um], 0.01 to 1e5.
    pub radius_um: f32,
    /// K_phong [1/sr], 0 to 10.
    pub phong: f32,
    /// Exponent n, 1 to 10000.
    pub exponent: f32,
    /// K_diffuse [1/sr], 0 to `1 / pi^2`, which alone is white. K_diffuse and K_phong must not both be 0.
    pub diffuse: f32,
}

impl Default for KajiyaKayParameters {
    /// A highlight over gray, with a radius of 10 um.
    fn default() -> Self {
        KajiyaKayParameters { radius_um: 10.0, phong: 0.1, exponent: 50.0, diffuse: 0.03 }
    }
}

/// Kajiya and Kay's fiber.
///
/// ```
/// use plywave_fiber::{KajiyaKayFiber, KajiyaKayParameters};
/// use plywave::frame::direction;
/// use plywave::Bsdf;
/// use plywave_fiber::{FiberModel, FiberQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let fur: FiberModel = KajiyaKayFiber::new(KajiyaKayParameters::default())?.into();
/// let at = fur.at(&FiberQuery::new(direction(0.3, 0.0), [0.55]));
/// assert!(at.eval(direction(-0.3, 2.0)) > at.eval(direction(0.9, 2.0)));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KajiyaKayFiber {
    parameters: KajiyaKayParameters,
}

impl KajiyaKayFiber {
    /// Builds a fiber with these parameters.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] if a parameter is outside its range.
    pub fn new(parameters: KajiyaKayParameters) -> Result<KajiyaKayFiber> {
        const MODEL: &str = "Kajiya-Kay fiber";
        let p = &parameters;
        parameter(MODEL, "radius_um", p.radius_um, [0.01, 1e5])?;
        parameter(MODEL, "phong", p.phong, [0.0, 10.0])?;
        parameter(MODEL, "exponent", p.exponent, [1.0, 1e4])?;
        parameter(MODEL, "diffuse", p.diffuse, [0.0, 1.0 / (PI * PI)])?;
        if p.phong + p.diffuse < 1e-6 {
            return Err(invalid(MODEL, "phong", p.phong, "use more where nothing is diffuse".into()));
        }
        Ok(KajiyaKayFiber { parameters })
    }

    /// The fiber's parameters.
    pub fn parameters(&self) -> &KajiyaKayParameters {
        &self.parameters
    }

    /// The fiber at a query. If an input is not finite or `omega_i` is not a direction, no light is
    /// scattered.
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> KajiyaKayBsdf<'_, N> {
        let incident = Incident::new(query.omega_i, true);
        let i = incident.latitude;
        let theta_i = atan2(i.sin, i.cos);
        // cos^n x is at most exp(-n x^2 / 2), so samples of that Gaussian have bounded weights.
        let ends = [-FRAC_PI_2 + theta_i, FRAC_PI_2 + theta_i];
        let highlight = TruncatedGaussian::new(1.0 / self.parameters.exponent.sqrt(), ends);
        let p = &self.parameters;
        // Energy of the highlight if cos theta_o were 1.
        let phong = p.phong / i.cos.max(1e-3) * TAU * (TAU / p.exponent).sqrt() * i.cos * i.cos;
        let diffuse = PI * PI * p.diffuse;
        // Each term is sampled if it is not 0.
        let chance = if p.diffuse == 0.0 {
            1.0
        } else if p.phong == 0.0 {
            0.0
        } else {
            (phong / (phong + diffuse)).max(0.1).min(0.9)
        };
        KajiyaKayBsdf { fiber: self, incident, theta_i, cos_i: i.cos.max(1e-3), highlight, chance }
    }
}

/// A [`KajiyaKayFiber`] at a query.
#[derive(Clone, Copy, Debug)]
pub struct KajiyaKayBsdf<'a, const N: usize> {
    fiber: &'a KajiyaKayFiber,
    incident: Incident,
    theta_i: f32,
    /// cos theta_i, clamped to at least 1e-3.
    cos_i: f32,
    highlight: TruncatedGaussian,
    /// Probability that a sample is of the highlight.
    chance: f32,
}

impl<const N: usize> KajiyaKayBsdf<'_, N> {
    /// The fiber's diameter [um]; 0 if the query is invalid.
    pub fn width_um(&self) -> [f32; N] {
        [if self.incident.valid { 2.0 * self.fiber.parameters.radius_um } else { 0.0 }; N]
    }

    #[inline]
    fn phong(&self, o: Latitude) -> f32 {
        let p = &self.fiber.parameters;
        let cos = (o.cos * self.incident.latitude.cos - o.sin * self.incident.latitude.sin).min(1.0);
        if cos <= 0.0 {
            return 0.0;
        }
        p.phong * exp(p.exponent * ln(cos.max(f32::MIN_POSITIVE)).min(0.0)) / self.cos_i
    }
}

impl<const N: usize> Bsdf<N> for KajiyaKayBsdf<'_, N> {
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
        let theta_o = atan2(o.sin, o.cos);
        let f = (self.phong(o) + self.fiber.parameters.diffuse) * o.cos;
        let drawn = self.highlight.eval(theta_o + self.theta_i) / (TAU * o.cos.max(1e-6));
        ([f; N], self.chance * drawn + (1.0 - self.chance) / (2.0 * TAU))
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        if !(self.incident.valid && u.iter().all(|v| (0.0..1.0).contains(v))) {
            return BsdfSample::Absorbed;
        }
        let (sin, cos) = if u[2] < self.chance {
            let theta_o = (self.highlight.sample(u[1]) - self.theta_i).clamp(-FRAC_PI_2, FRAC_PI_2);
            sin_cos(theta_o)
        } else {
            let sin = 2.0 * u[1] - 1.0;
            (sin, (1.0 - sin * sin).max(0.0).sqrt())
        };
        let (y, x) = sin_cos(TAU * u[0]);
        let w = [cos.max(0.0) * x, cos.max(0.0) * y, sin];
        let (f, pdf) = self.eval_pdf(w);
        BsdfSample::scattered(w, f, pdf)
    }

    /// Integral of f, by the midpoint rule over the highlight.
    fn albedo(&self) -> [f32; N] {
        if !self.incident.valid {
            return [0.0; N];
        }
        let p = &self.fiber.parameters;
        let reach = (7.0 / p.exponent.sqrt()).min(FRAC_PI_2);
        let (low, high) = ((-self.theta_i - reach).max(-FRAC_PI_2), (-self.theta_i + reach).min(FRAC_PI_2));
        let step = (high - low) / 128.0;
        let at = |k: usize| low + (k as f32 + 0.5) * step;
        let phong: f32 =
            (0..128).map(|k| at(k).sin_cos()).map(|(sin, cos)| self.phong(Latitude { sin, cos }) * cos * cos).sum();
        [TAU * phong * step + PI * PI * p.diffuse; N]
    }

    fn outcomes(&self) -> Outcomes {
        if self.incident.valid { Outcomes::SCATTERED } else { Outcomes::ABSORBED }
    }
}
