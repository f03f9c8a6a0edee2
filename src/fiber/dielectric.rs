//! Smooth dielectric fibers of circular section (Zinke 2007, 5.1, 6, 7.1): all orders, far field and near field.
//!
//! ```text
//! far field    f = sum over p of M_p(theta_i, theta_o) sum over roots h of a_p(h) |dh/dphi| / 2
//! near field   f = sum over p of M_p(theta_i, theta_o) a_p(h) g(pi, phi - phi_p(h), beta_n)
//! ```
//!
//! A perfect cylinder keeps the latitude: M is a delta, which no host can evaluate. Here M is d'Eon's, of width `beta_m`, with the attenuations at theta_i: all orders add up to 1
//! where nothing is absorbed, at every incidence, which the paper's Gaussians with theta_d do not (those are `RoughDielectricFiber`'s). The far field's azimuth is the perfect
//! cylinder's, caustics included; the near field's is a delta, spread by `beta_n`. Orders beyond `orders` are spread evenly over the azimuth, with their energy.
//!
//! The near field is f at the offset of the query's ray. Light leaves at -h, so that the same number is Eq. 38's for a viewer: with `omega_i` towards the viewer, whose ray has the
//! offset, f towards a light is what arrives from it, but for `cos theta` of the two (`cylinder`, table).

use super::FiberQuery;
use super::azimuthal::{CrossSection, OFFSETS};
use super::gaussian::Gaussian;
use super::longitudinal::{Latitude, Longitudinal};
use super::range::{invalid, parameter};
use crate::bsdf::Outcomes;
use crate::frame::is_direction;
use crate::math::clamp_unit;
use crate::{Bsdf, BsdfSample, Result};
use std::f32::consts::{PI, TAU};

/// Most orders that are kept apart, R included.
pub const MOST_ORDERS: usize = 8;

/// What a [`DielectricFiber`] is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DielectricParameters {
    /// Index of refraction, 1.01 to 4.
    pub eta: f32,
    /// Radius [um], 0.01 to 1e5.
    pub radius_um: f32,
    /// Longitudinal widths of R, TT, and TRT with all beyond [rad], 0.001 to 2.
    pub beta_m: [f32; 3],
    /// Longitudinal shifts of the same [rad], -1 to 1: light goes about the latitude `shift - theta_i`. Tiles of a cuticle shift hair's.
    pub shift: [f32; 3],
    /// Azimuthal width of the near field [rad], 0.001 to 10.
    pub beta_n: f32,
    /// Orders kept apart, 3 for R, TT, TRT; 1 to [`MOST_ORDERS`].
    pub orders: usize,
}

impl Default for DielectricParameters {
    /// Clear, of 10 um and index 1.55.
    fn default() -> Self {
        DielectricParameters { eta: 1.55, radius_um: 10.0, beta_m: [0.1; 3], shift: [0.0; 3], beta_n: 0.1, orders: 5 }
    }
}

/// A smooth dielectric fiber.
///
/// ```
/// use plywave::fiber::{DielectricFiber, DielectricParameters};
/// use plywave::frame::direction;
/// use plywave::{Bsdf, FiberModel, FiberQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let fiber: FiberModel = DielectricFiber::new(DielectricParameters::default())?.into();
/// let clear = FiberQuery::new(direction(0.4, 1.1), [0.61, 0.55, 0.465]);
/// let dyed = fiber.at(&FiberQuery { sigma_per_um: [0.001, 0.01, 0.1], ..clear }).albedo();
/// assert!((fiber.at(&clear).albedo()[0] - 1.0).abs() < 1e-5 && dyed[0] > dyed[1] && dyed[1] > dyed[2]);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DielectricFiber {
    parameters: DielectricParameters,
    longitudinal: [Longitudinal; 3],
    /// Sine and cosine of the shifts.
    shift: [[f32; 2]; 3],
    azimuthal: Gaussian,
}

impl DielectricFiber {
    /// A fiber of these parameters.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for a parameter outside its range.
    pub fn new(parameters: DielectricParameters) -> Result<DielectricFiber> {
        const MODEL: &str = "dielectric fiber";
        let p = &parameters;
        parameter(MODEL, "eta", p.eta, [1.01, 4.0])?;
        parameter(MODEL, "radius_um", p.radius_um, [0.01, 1e5])?;
        for lobe in 0..3 {
            parameter(MODEL, "beta_m", p.beta_m[lobe], [1e-3, 2.0])?;
            parameter(MODEL, "shift", p.shift[lobe], [-1.0, 1.0])?;
        }
        parameter(MODEL, "beta_n", p.beta_n, [1e-3, 10.0])?;
        if !(1..=MOST_ORDERS).contains(&p.orders) {
            return Err(invalid(MODEL, "orders", p.orders, format!("use 1 to {MOST_ORDERS}")));
        }
        Ok(DielectricFiber {
            parameters,
            longitudinal: p.beta_m.map(Longitudinal::new),
            shift: p.shift.map(|s| <[f32; 2]>::from(s.sin_cos())),
            azimuthal: Gaussian::new(p.beta_n, PI),
        })
    }

    /// What the fiber was made of.
    pub fn parameters(&self) -> &DielectricParameters {
        &self.parameters
    }

    /// The cross section that light of a latitude's sine sees.
    pub fn cross_section(&self, sin_theta: f32) -> CrossSection {
        CrossSection::new(self.parameters.eta, self.parameters.radius_um, sin_theta)
    }

    /// The fiber at a query. Where an input is not finite, or `omega_i` is no direction, nothing is scattered.
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> DielectricBsdf<'_, N> {
        let finite = query.sigma_per_um.iter().all(|s| s.is_finite()) && query.h_rel.is_none_or(f32::is_finite);
        let valid = is_direction(query.omega_i) && finite;
        let wi = if valid { query.omega_i } else { [1.0, 0.0, 0.0] };
        let latitude = Latitude::of(wi);
        let mut at = DielectricBsdf {
            fiber: self,
            section: self.cross_section(latitude.sin),
            azimuth: if latitude.cos > 0.0 { [wi[0] / latitude.cos, wi[1] / latitude.cos] } else { [1.0, 0.0] },
            latitude: self.shift.map(|s| shifted(latitude, s)),
            sigma_per_um: query.sigma_per_um.map(|s| s.clamp(0.0, 1e6)),
            h_rel: query.h_rel.map(|h| h.clamp(-1.0, 1.0)),
            beyond: [0.0; N],
            beyond_share: 0.0,
            valid,
        };
        if valid {
            let mut all = 0.0;
            let mut add = |(h, weight): (f32, f32)| {
                let path = at.section.path(h);
                for n in 0..N {
                    at.beyond[n] += weight * path.from_order(self.parameters.orders as u32, at.sigma_per_um[n]);
                    all += weight * path.from_order(0, at.sigma_per_um[n]);
                }
            };
            match at.h_rel {
                None => OFFSETS.into_iter().for_each(add),
                Some(h) => add((h, 1.0)),
            }
            at.beyond_share = if all > 0.0 { (at.beyond.iter().sum::<f32>() / all).min(1.0) } else { 0.0 };
        }
        at
    }
}

/// The latitude whose mirror image is the middle of a lobe that is shifted by an angle of this sine and cosine.
fn shifted(i: Latitude, [sin, cos]: [f32; 2]) -> Latitude {
    // sin(theta_i - shift); beyond a pole the latitude comes back on the other side.
    Latitude { sin: (i.sin * cos - i.cos * sin).clamp(-1.0, 1.0), cos: (i.cos * cos + i.sin * sin).abs() }
}

/// A [`DielectricFiber`] at a query.
#[derive(Clone, Copy, Debug)]
pub struct DielectricBsdf<'a, const N: usize> {
    fiber: &'a DielectricFiber,
    section: CrossSection,
    /// Cosine and sine of phi_i; of 0 for light along the fiber.
    azimuth: [f32; 2],
    /// Of the light, less the shifts.
    latitude: [Latitude; 3],
    sigma_per_um: [f32; N],
    h_rel: Option<f32>,
    /// Energy of the orders beyond those kept apart, and the chance with which samples are theirs.
    beyond: [f32; N],
    beyond_share: f32,
    valid: bool,
}

impl<const N: usize> DielectricBsdf<'_, N> {
    /// The fiber's diameter [um]; 0 where the query was refused.
    pub fn width_um(&self) -> [f32; N] {
        [if self.valid { 2.0 * self.fiber.parameters.radius_um } else { 0.0 }; N]
    }

    fn orders(&self) -> u32 {
        self.fiber.parameters.orders as u32
    }

    /// Attenuations of an order at an offset, and the chance with which a sample at that offset is of the order.
    fn order(&self, order: u32, h_rel: f32) -> ([f32; N], f32) {
        let path = self.section.path(h_rel);
        let mut a = [0.0; N];
        let (mut sum, mut kept) = (0.0, 0.0);
        for n in 0..N {
            let sigma = self.sigma_per_um[n];
            a[n] = path.attenuation(order, sigma);
            sum += a[n];
            kept += path.kept(self.orders(), sigma);
        }
        (a, if kept > 0.0 { (1.0 - self.beyond_share) * sum / kept } else { 0.0 })
    }

    /// M of the lobes R, TT, TRT.
    fn longitudinal(&self, w: [f32; 3]) -> [f32; 3] {
        let o = Latitude::of(w);
        std::array::from_fn(|lobe| self.fiber.longitudinal[lobe].eval(self.latitude[lobe], o))
    }

    /// Chooses an order at an offset by the number `u`, the orders beyond first; gives the order and a number left for other use.
    fn choose(&self, h_rel: f32, u: f32) -> (u32, f32) {
        if u < self.beyond_share {
            return (self.orders(), clamp_unit(u / self.beyond_share));
        }
        let mut left = u - self.beyond_share;
        let last = self.orders() - 1;
        for order in 0..last {
            let (_, chance) = self.order(order, h_rel);
            if left < chance {
                return (order, clamp_unit(left / chance));
            }
            left -= chance;
        }
        let (_, chance) = self.order(last, h_rel);
        (last, if chance > 0.0 { clamp_unit(left / chance) } else { 0.5 })
    }
}

impl<const N: usize> Bsdf<N> for DielectricBsdf<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.eval_pdf(w).0
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.eval_pdf(w).1
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        let (mut f, mut pdf) = ([0.0; N], 0.0);
        if !(self.valid && is_direction(w)) {
            return (f, pdf);
        }
        let m = self.longitudinal(w);
        let [x, y] = self.azimuth;
        let phi = (x * w[1] - y * w[0]).atan2(x * w[0] + y * w[1]);
        let mut add = |lobe: usize, density: f32, (a, chance): ([f32; N], f32)| {
            let density = m[lobe] * density;
            (0..N).for_each(|n| f[n] += density * a[n]);
            pdf += density * chance;
        };
        for order in 0..self.orders() {
            let lobe = (order as usize).min(2);
            match self.h_rel {
                None => self.section.roots(order, phi, |h, density| add(lobe, density, self.order(order, h))),
                Some(h) => {
                    let off = phi - self.section.turn(order, h);
                    let off = off - TAU * (off / TAU).round();
                    add(lobe, self.fiber.azimuthal.eval(off), self.order(order, h));
                }
            }
        }
        let lobe = (self.orders() as usize).min(2);
        add(lobe, 1.0 / TAU, (self.beyond, self.beyond_share));
        (f, pdf)
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        if !(self.valid && u.iter().all(|v| (0.0..1.0).contains(v))) {
            return BsdfSample::Absorbed;
        }
        let h = self.h_rel.unwrap_or(2.0 * u[0] - 1.0);
        let (order, left) = self.choose(h, u[2]);
        // The azimuth: of what is beyond, anywhere; by the order's turn; of the near field, about it.
        let azimuth = match (order < self.orders(), self.h_rel) {
            (false, _) => TAU * u[0],
            (true, None) => self.section.turn(order, h),
            (true, Some(_)) => self.section.turn(order, h) + self.fiber.azimuthal.sample(u[0]),
        };
        let lobe = (order as usize).min(2);
        let latitude = self.fiber.longitudinal[lobe].sample(self.latitude[lobe], [u[1], left]);
        let [x, y] = self.azimuth;
        let (sin, cos) = azimuth.sin_cos();
        let w = [latitude.cos * (x * cos - y * sin), latitude.cos * (x * sin + y * cos), latitude.sin];
        let (f, pdf) = self.eval_pdf(w);
        BsdfSample::scattered(w, f, pdf)
    }

    /// Mean over the offsets, or at the query's, of what is not absorbed.
    fn albedo(&self) -> [f32; N] {
        if !self.valid {
            return [0.0; N];
        }
        let at = |h: f32| self.sigma_per_um.map(|s| self.section.path(h).from_order(0, s));
        match self.h_rel {
            Some(h) => at(h),
            None => OFFSETS.iter().fold([0.0; N], |sum, (h, weight)| {
                let a = at(*h);
                std::array::from_fn(|n| sum[n] + weight * a[n])
            }),
        }
    }

    fn outcomes(&self) -> Outcomes {
        if self.valid { Outcomes::SCATTERED } else { Outcomes::ABSORBED }
    }
}
