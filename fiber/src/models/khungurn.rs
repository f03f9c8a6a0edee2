//! The fiber model of Khungurn et al. 2015, "Matching Real Fabrics with Micro-Appearance Models", as written
//! in section 2 of Khungurn's note on dual scattering.
//!
//! The model has two lobes, each a Gaussian over the latitude times a density over the azimuth:
//!
//! ```text
//! f = cos theta_o (F(theta_i) g_R / (2 pi) + (1 - F(theta_i)) C_TT g_TT v(phi_o - phi_i - pi))
//! F(theta_i) = C_R + (1 - C_R) (1 - cos theta_i)^5
//! g(theta_o) = exp(-(theta_o + theta_i)^2 / (2 beta^2)) / G(theta_i),  G = integral over (-pi/2, pi/2) of exp(-(x + theta_i)^2 / (2 beta^2)) cos^2 x dx
//! ```
//!
//! v is the von Mises density of concentration `1 / gamma^2`. The paper replaces G by a polynomial that is
//! above the integral with cos^2 and keeps the energy of the lobes below 1. Here G is the integral itself, in
//! closed form through the Faddeeva function, so the energy is 1 and the albedo is exactly
//! `F + (1 - F) C_TT`.
//!
//! The paper's colors C_R and C_TT are shares by wavelength, [`Reflectance`]; the query's absorption is
//! ignored. The model does not resolve the offset and returns its mean at every `h_rel`. It is not
//! reciprocal, since F depends on theta_i alone and each lobe is normalized over theta_o alone.

use crate::FiberQuery;
use crate::distributions::gaussian::TruncatedGaussian;
use crate::distributions::longitudinal::Latitude;
use crate::distributions::von_mises::VonMises;
use crate::incident::Incident;
use crate::models::reflectance::Reflectance;
use crate::range::parameter;
use plywave::bsdf::Outcomes;
use plywave::frame::is_direction;
use plywave::math::clamp_unit;
use plywave::math::faddeeva::diffraction_factor;
use plywave::{Bsdf, BsdfSample, Result};
use std::f32::consts::{FRAC_PI_2, TAU};
use std::f64::consts::{FRAC_1_PI, SQRT_2};

/// Parameters of a [`KhungurnFiber`].
#[derive(Clone, Debug, PartialEq)]
pub struct KhungurnParameters {
    /// Radius [um], 0.01 to 1e5.
    pub radius_um: f32,
    /// C_R, the reflected share at normal incidence.
    pub c_r: Reflectance,
    /// C_TT, the transmitted share of the entering light.
    pub c_tt: Reflectance,
    /// Longitudinal width of R as a standard deviation [rad], 0.005 to 10.
    pub beta_r: f32,
    /// Longitudinal width of TT as a standard deviation [rad], 0.005 to 10.
    pub beta_tt: f32,
    /// Azimuthal width gamma_TT of TT [rad], 0.01 to 1000; the concentration is `1 / gamma_tt^2`.
    pub gamma_tt: f32,
}

impl Default for KhungurnParameters {
    /// A clear fiber of radius 10 um.
    fn default() -> Self {
        KhungurnParameters {
            radius_um: 10.0,
            c_r: 0.05.into(),
            c_tt: 0.9.into(),
            beta_r: 0.1,
            beta_tt: 0.2,
            gamma_tt: 0.4,
        }
    }
}

/// The fiber model of Khungurn et al. 2015.
///
/// ```
/// use plywave_fiber::{KhungurnFiber, KhungurnParameters, Reflectance};
/// use plywave::frame::direction;
/// use plywave::Bsdf;
/// use plywave_fiber::{FiberModel, FiberQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let red = KhungurnParameters { c_tt: Reflectance::of_srgb([0.8, 0.1, 0.1]),
/// ..KhungurnParameters::default() }; let fiber: FiberModel = KhungurnFiber::new(red)?.into(); let [r, g, b]
/// = fiber.at(&FiberQuery::new(direction(0.3, 0.0), [0.61, 0.55, 0.465])).albedo(); assert!(r > 2.0 * g && r
/// > 2.0 * b);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct KhungurnFiber {
    parameters: KhungurnParameters,
    r: Normalizer,
    tt: Normalizer,
    azimuth: VonMises,
}

impl KhungurnFiber {
    /// Builds a fiber with these parameters.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] if a parameter is outside its range.
    pub fn new(parameters: KhungurnParameters) -> Result<KhungurnFiber> {
        const MODEL: &str = "Khungurn fiber";
        let p = &parameters;
        parameter(MODEL, "radius_um", p.radius_um, [0.01, 1e5])?;
        p.c_r.check(MODEL, "c_r")?;
        p.c_tt.check(MODEL, "c_tt")?;
        parameter(MODEL, "beta_r", p.beta_r, [0.005, 10.0])?;
        parameter(MODEL, "beta_tt", p.beta_tt, [0.005, 10.0])?;
        parameter(MODEL, "gamma_tt", p.gamma_tt, [0.01, 1000.0])?;
        let (r, tt) = (Normalizer::new(p.beta_r), Normalizer::new(p.beta_tt));
        let azimuth = VonMises::new(p.gamma_tt);
        Ok(KhungurnFiber { parameters, r, tt, azimuth })
    }

    /// The fiber's parameters.
    pub fn parameters(&self) -> &KhungurnParameters {
        &self.parameters
    }

    /// The fiber at a query, whose offset and absorption are ignored. If an input is not finite or `omega_i`
    /// is not a direction, no light is scattered.
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> KhungurnBsdf<'_, N> {
        let finite = query.lambda_um.iter().all(|l| l.is_finite());
        let incident = Incident::new(query.omega_i, finite);
        let latitude = incident.latitude;
        let theta_i = latitude.sin.atan2(latitude.cos);
        let p = &self.parameters;
        let grazing = (1.0 - latitude.cos).max(0.0).powi(5);
        let fresnel: [f32; N] = query.lambda_um.map(|lambda| schlick(p.c_r.at(lambda), grazing));
        let through = std::array::from_fn(|n| (1.0 - fresnel[n]) * p.c_tt.at(query.lambda_um[n]));
        let (r, tt) = (fresnel.iter().sum::<f32>(), through.iter().sum::<f32>());
        let ends = [theta_i - FRAC_PI_2, theta_i + FRAC_PI_2];
        let drawn = [p.beta_r, p.beta_tt].map(|beta| TruncatedGaussian::new(beta, ends));
        KhungurnBsdf {
            fiber: self,
            incident,
            theta_i,
            fresnel,
            through,
            scale: [1.0 / self.r.at(theta_i), 1.0 / self.tt.at(theta_i)],
            drawn,
            peak: drawn.map(|d| d.eval(0.0)),
            chance: if r + tt > 0.0 { r / (r + tt) } else { 1.0 },
            scatters: incident.valid && r + tt > 0.0,
        }
    }
}

/// Schlick's approximation of Fresnel's reflectance, where `grazing` is `(1 - cos theta_i)^5`.
fn schlick(c_r: f32, grazing: f32) -> f32 {
    c_r + (1.0 - c_r) * grazing
}

/// A [`KhungurnFiber`] at a query.
#[derive(Clone, Copy, Debug)]
pub struct KhungurnBsdf<'a, const N: usize> {
    fiber: &'a KhungurnFiber,
    incident: Incident,
    theta_i: f32,
    /// Energies of R and of TT, one for each wavelength.
    fresnel: [f32; N],
    through: [f32; N],
    /// 1/G of both lobes.
    scale: [f32; 2],
    /// Distributions of theta_o + theta_i from which the two lobes are sampled.
    drawn: [TruncatedGaussian; 2],
    /// Densities of these distributions at 0.
    peak: [f32; 2],
    /// Probability that a sample is of R.
    chance: f32,
    /// Whether any light is scattered.
    scatters: bool,
}

impl<const N: usize> KhungurnBsdf<'_, N> {
    /// The fiber's diameter [um]; 0 if the query is invalid.
    pub fn width_um(&self) -> [f32; N] {
        [if self.incident.valid { 2.0 * self.fiber.parameters.radius_um } else { 0.0 }; N]
    }
}

impl<const N: usize> Bsdf<N> for KhungurnBsdf<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.eval_pdf(w).0
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.eval_pdf(w).1
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        if !(self.scatters && is_direction(w)) {
            return ([0.0; N], 0.0);
        }
        let o = Latitude::from_direction(w);
        let along = o.sin.atan2(o.cos) + self.theta_i;
        let p = &self.fiber.parameters;
        let gaussian = |beta: f32| (-0.5 * (along / beta) * (along / beta)).exp();
        let [g_r, g_tt] = [gaussian(p.beta_r), gaussian(p.beta_tt)];
        // Chord of the azimuth from the straight direction; any azimuth serves at the pole, where f is 0.
        let [across, side] = self.incident.relative(w);
        let inverse = 1.0 / o.cos.max(1e-6);
        let chord = [across * inverse + 1.0, side * inverse];
        let v = self.fiber.azimuth.eval(chord[0] * chord[0] + chord[1] * chord[1]);
        const EVEN: f32 = 1.0 / TAU;
        let [r, tt] = [o.cos * self.scale[0] * g_r * EVEN, o.cos * self.scale[1] * g_tt * v];
        let f = std::array::from_fn(|n| self.fresnel[n] * r + self.through[n] * tt);
        let pdf = self.chance * self.peak[0] * g_r * EVEN + (1.0 - self.chance) * self.peak[1] * g_tt * v;
        (f, pdf * inverse)
    }

    /// Samples a direction. The weights vary with cos^2 theta_o within a lobe; their mean square is at most 3
    /// times the square of their mean, which is attained at grazing light.
    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        if !(self.scatters && u.iter().all(|v| (0.0..1.0).contains(v))) {
            return BsdfSample::Absorbed;
        }
        let reflected = u[2] < self.chance;
        let lobe = usize::from(!reflected);
        let theta_o = (self.drawn[lobe].sample(u[1]) - self.theta_i).clamp(-FRAC_PI_2, FRAC_PI_2);
        let turn =
            if reflected { TAU * u[0] } else { std::f32::consts::PI + self.fiber.azimuth.sample(clamp_unit(u[0])) };
        let (sin, cos) = theta_o.sin_cos();
        let (b, a) = turn.sin_cos();
        let w = self.incident.direction([a, b].map(|v| cos.max(0.0) * v), sin);
        let (f, pdf) = self.eval_pdf(w);
        BsdfSample::scattered(w, f, pdf)
    }

    /// F + (1 - F) C_TT.
    fn albedo(&self) -> [f32; N] {
        std::array::from_fn(|n| if self.incident.valid { self.fresnel[n] + self.through[n] } else { 0.0 })
    }

    fn outcomes(&self) -> Outcomes {
        if self.scatters { Outcomes::SCATTERED } else { Outcomes::ABSORBED }
    }
}

/// G(theta_i) of the module text, for a width beta of 0.005 to 10.
///
/// With `cos^2 x = (1 + cos 2x) / 2`, G is `(k(0) + Re(exp(2 i theta_i) k(1/pi))) / 2`, where k is
/// [`diffraction_factor`]: `integral of exp(-t^2 / (2 beta^2) - 2 pi i f t) dt` between the ends. Far from
/// the poles the ends can be taken at infinity, and
/// `G = beta sqrt(2 pi) (1 + exp(-2 beta^2) cos 2 theta_i) / 2`. Within 8 widths of a pole G is tabulated.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Normalizer {
    beta: f32,
    /// First latitude of the table, and the reciprocal of its step.
    first: f32,
    per_rad: f32,
    /// Values, and slopes times the step.
    nodes: Vec<[f32; 2]>,
}

impl Normalizer {
    const CELLS: usize = 64;

    pub(crate) fn new(beta: f32) -> Normalizer {
        let b = f64::from(beta);
        let half = std::f64::consts::FRAC_PI_2;
        let first = (half - 8.0 * b).max(0.0);
        let step = (half - first) / Self::CELLS as f64;
        let nodes = (0..=Self::CELLS)
            .map(|k| first + k as f64 * step)
            .map(|x| {
                [Self::exact(x, b), 0.5 * (Self::exact(x + 1e-3 * step, b) - Self::exact(x - 1e-3 * step, b)) / 1e-3]
            })
            .map(|pair| pair.map(|v| v as f32))
            .collect();
        Normalizer { beta, first: first as f32, per_rad: (1.0 / step) as f32, nodes }
    }

    /// The closed form, at any latitude up to the pole and slightly beyond.
    pub(crate) fn exact(theta_i: f64, beta: f64) -> f64 {
        let half = std::f64::consts::FRAC_PI_2;
        let k = |f: f64| diffraction_factor(theta_i - half, theta_i + half, f, SQRT_2 * beta);
        let ([plain, _], [re, im]) = (k(0.0), k(FRAC_1_PI));
        let (sin, cos) = (2.0 * theta_i).sin_cos();
        // x = t - theta_i, so exp(2 i x) = exp(2 i t) exp(-2 i theta_i); k has the conjugate of the first
        // factor.
        0.5 * (plain + re * cos - im * sin)
    }

    pub(crate) fn at(&self, theta_i: f32) -> f32 {
        let theta = theta_i.abs().min(FRAC_PI_2);
        let at = (theta - self.first) * self.per_rad;
        if at < 0.0 {
            let b = self.beta;
            return 0.5 * b * TAU.sqrt() * (1.0 + (-2.0 * b * b).exp() * (2.0 * theta).cos());
        }
        let cell = (at as usize).min(Self::CELLS - 1);
        let t = at - cell as f32;
        let ([low, a], [high, b]) = (self.nodes[cell], self.nodes[cell + 1]);
        let rise = high - low;
        low + t * (a + t * (3.0 * rise - 2.0 * a - b + t * (a + b - 2.0 * rise)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral of g cos^2 is 1: G agrees with the midpoint rule in f64, in closed form and as a table,
    /// for every width and latitude.
    #[test]
    fn normalizer_is_the_integral() {
        for beta in [0.005, 0.02, 0.1, 0.3, 1.0, 10.0f32] {
            let table = Normalizer::new(beta);
            let b = f64::from(beta);
            for k in 0..=157 {
                let theta = (0.01 * f64::from(k)).min(std::f64::consts::FRAC_PI_2);
                let half = std::f64::consts::FRAC_PI_2;
                let (low, high) = ((-theta - 12.0 * b).max(-half), (-theta + 12.0 * b).min(half));
                let n = 4000;
                let step = (high - low) / f64::from(n);
                let want: f64 = (0..n)
                    .map(|k| low + (f64::from(k) + 0.5) * step)
                    .map(|x| (-0.5 * ((x + theta) / b).powi(2)).exp() * x.cos().powi(2) * step)
                    .sum();
                let exact = Normalizer::exact(theta, b);
                assert!((exact / want - 1.0).abs() < 1e-4, "{beta} {theta}: {exact}, want {want}");
                let got = f64::from(table.at(theta as f32));
                // Between 8 widths from the pole and the pole, 1 / cos^2 magnifies the rounding of an angle,
                // 1e-7.
                let tolerance = 2e-5 + 4e-7 / b;
                assert!((got / exact - 1.0).abs() < tolerance, "{beta} {theta}: {got}, want {exact}");
                assert_eq!(table.at(-theta as f32), table.at(theta as f32));
            }
        }
    }
}
