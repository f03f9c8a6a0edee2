//! Smooth dielectric fibers of circular cross section (Zinke 2007, 5.1, 6, 7.1): all orders, far field and
//! near field.
//!
//! ```text
//! far field    f = sum over p of M_p(theta_i, theta_o) sum over roots h of a_p(h) |dh/dphi| / 2
//! near field   f = sum over p of M_p(theta_i, theta_o) a_p(h) g(pi, phi - phi_p(h), beta_n)
//! ```
//!
//! A perfect cylinder preserves the latitude: M is a delta function, which no host can evaluate. Here M is
//! d'Eon's function of width `beta_m`, with the attenuations at theta_i, so all orders sum to 1 without
//! absorption at every incidence. (The paper's Gaussians with theta_d, which do not, are in
//! `RoughDielectricFiber`.) In azimuth the near field is a delta function, spread by `beta_n`. The far field
//! is its mean over the offsets, from a table; below [`MIN_FAR_WIDTH`] it is that of the perfect cylinder,
//! caustics included, from the roots of phi_p(h). Orders beyond `orders` are spread evenly over the azimuth
//! with their total energy.
//!
//! The near field is f at the offset of the query's ray. Light leaves at -h, so the same value is that of Eq.
//! 38 for a viewer: with `omega_i` towards the viewer, whose ray has the offset, f towards a light is the
//! light that arrives from it, up to `cos theta` of the two (see the table in `cylinder`).

use crate::FiberQuery;
use crate::distributions::azimuthal::{CrossSection, OFFSETS, turn};
use crate::distributions::fast::{atan2, exp, lanes, sin_cos, wrapped};
use crate::distributions::gaussian::Gaussian;
use crate::distributions::longitudinal::{Latitude, Longitudinal, ThreeLobes};
use crate::incident::Incident;
use crate::models::far_table::{FarTable, MIN_WIDTH, Row, Through};
use crate::range::{invalid, parameter};
use plywave::bsdf::Outcomes;
use plywave::frame::is_direction;
use plywave::math::clamp_unit;
use plywave::{Bsdf, BsdfSample, Result};
use std::f32::consts::{PI, TAU};

/// Maximum number of separate orders, R included.
pub const MAX_ORDERS: usize = 8;
/// Minimum azimuthal width that a far field is spread by [rad].
pub const MIN_FAR_WIDTH: f32 = MIN_WIDTH;

/// Parameters of a [`DielectricFiber`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DielectricParameters {
    /// Refractive index, 1.01 to 4.
    pub eta: f32,
    /// Radius [um], 0.01 to 1e5.
    pub radius_um: f32,
    /// Longitudinal widths of R, TT, and TRT with all later orders [rad], 0.001 to 2.
    pub beta_m: [f32; 3],
    /// Longitudinal shifts of the same [rad], -1 to 1: light leaves around the latitude `shift - theta_i`.
    /// The tilted scales of a cuticle shift the lobes of hair.
    pub shift: [f32; 3],
    /// Azimuthal width [rad], 0.001 to 10. Below [`MIN_FAR_WIDTH`] the far field is that of a perfect
    /// cylinder.
    pub beta_n: f32,
    /// Number of separate orders, 1 to [`MAX_ORDERS`]; 3 for R, TT, TRT.
    pub orders: usize,
}

impl Default for DielectricParameters {
    /// A clear fiber of radius 10 um and index 1.55.
    fn default() -> Self {
        DielectricParameters { eta: 1.55, radius_um: 10.0, beta_m: [0.1; 3], shift: [0.0; 3], beta_n: 0.1, orders: 5 }
    }
}

/// A smooth dielectric fiber.
///
/// ```
/// use plywave_fiber::{DielectricFiber, DielectricParameters};
/// use plywave::frame::direction;
/// use plywave::Bsdf;
/// use plywave_fiber::{FiberModel, FiberQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let fiber: FiberModel = DielectricFiber::new(DielectricParameters::default())?.into();
/// let clear = FiberQuery::new(direction(0.4, 1.1), [0.61, 0.55, 0.465]);
/// let dyed = fiber.at(&FiberQuery { sigma_per_um: [0.001, 0.01, 0.1], ..clear }).albedo();
/// assert!((fiber.at(&clear).albedo()[0] - 1.0).abs() < 1e-5 && dyed[0] > dyed[1] && dyed[1] > dyed[2]);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct DielectricFiber {
    parameters: DielectricParameters,
    longitudinal: [Longitudinal; 3],
    three: ThreeLobes,
    /// Sine and cosine of the shifts.
    shift: [[f32; 2]; 3],
    azimuthal: Gaussian,
    far: Option<FarTable>,
}

impl DielectricFiber {
    /// Builds a fiber with these parameters.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] if a parameter is outside its range.
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
        if !(1..=MAX_ORDERS).contains(&p.orders) {
            return Err(invalid(MODEL, "orders", p.orders, format!("use 1 to {MAX_ORDERS}")));
        }
        let longitudinal = p.beta_m.map(Longitudinal::new);
        Ok(DielectricFiber {
            parameters,
            longitudinal,
            three: ThreeLobes::new(&longitudinal),
            shift: p.shift.map(|s| <[f32; 2]>::from(s.sin_cos())),
            azimuthal: Gaussian::new(p.beta_n, PI),
            far: (p.beta_n >= MIN_WIDTH).then(|| FarTable::new(p.eta, &[p.beta_n; MAX_ORDERS][..p.orders])),
        })
    }

    /// The fiber's parameters.
    pub fn parameters(&self) -> &DielectricParameters {
        &self.parameters
    }

    /// The cross section for light whose latitude has this sine.
    pub fn cross_section(&self, sin_theta: f32) -> CrossSection {
        CrossSection::new(self.parameters.eta, self.parameters.radius_um, sin_theta)
    }

    /// The fiber at a query. If an input is not finite or `omega_i` is not a direction, no light is
    /// scattered.
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> DielectricBsdf<'_, N> {
        let finite = query.sigma_per_um.iter().all(|s| s.is_finite()) && query.h_rel.is_none_or(f32::is_finite);
        let incident = Incident::new(query.omega_i, finite);
        let latitude = incident.latitude;
        let section = CrossSection::at(self.parameters.eta, self.parameters.radius_um, latitude);
        let mut at = DielectricBsdf {
            fiber: self,
            incident,
            latitude: self.shift.map(|s| shifted(latitude, s)),
            sigma_per_um: lanes(|n| query.sigma_per_um[n].clamp(0.0, 1e6)),
            h_rel: query.h_rel.map(|h| h.clamp(-1.0, 1.0)),
            far: None,
            turns: [0.0; MAX_ORDERS],
            light: [[0.0; N]; MAX_ORDERS],
            chance: [0.0; MAX_ORDERS],
            beyond: [0.0; N],
            beyond_share: 0.0,
            section,
        };
        if incident.valid {
            match (at.h_rel, &self.far) {
                (Some(h), _) => at.prepare_near(h),
                (None, Some(table)) => at.prepare_far(table, atan2(latitude.sin, latitude.cos)),
                (None, None) => at.prepare_roots(),
            }
        }
        at
    }
}

/// The latitude whose mirror image is the center of a lobe that is shifted by an angle of this sine and
/// cosine.
fn shifted(i: Latitude, [sin, cos]: [f32; 2]) -> Latitude {
    // sin(theta_i - shift). Beyond a pole the latitude returns on the other side.
    Latitude { sin: (i.sin * cos - i.cos * sin).clamp(-1.0, 1.0), cos: (i.cos * cos + i.sin * sin).abs() }
}

/// A [`DielectricFiber`] at a query.
#[derive(Clone, Copy, Debug)]
pub struct DielectricBsdf<'a, const N: usize> {
    fiber: &'a DielectricFiber,
    section: CrossSection,
    incident: Incident,
    /// Latitudes of the incident light minus the shifts.
    latitude: [Latitude; 3],
    sigma_per_um: [f32; N],
    h_rel: Option<f32>,
    /// The far field's table, the position in it, and the transmission of its chords.
    far: Option<(&'a FarTable, Row, Through<N>)>,
    /// For the near field: azimuths of the orders.
    turns: [f32; MAX_ORDERS],
    /// For the near field: attenuations of the orders, one for each wavelength.
    light: [[f32; N]; MAX_ORDERS],
    /// Probabilities that a sample is of an order; for the far field divided by the order's energy without
    /// absorption.
    chance: [f32; MAX_ORDERS],
    /// Energy of the orders beyond the separate ones, and the probability that a sample is of them.
    beyond: [f32; N],
    beyond_share: f32,
}

impl<'a, const N: usize> DielectricBsdf<'a, N> {
    /// The fiber's diameter [um]; 0 if the query is invalid.
    pub fn width_um(&self) -> [f32; N] {
        [if self.incident.valid { 2.0 * self.fiber.parameters.radius_um } else { 0.0 }; N]
    }

    fn orders(&self) -> u32 {
        self.fiber.parameters.orders as u32
    }

    fn prepare_near(&mut self, h: f32) {
        let orders = self.fiber.parameters.orders;
        let [gamma, gamma_t] = self.section.angles(h);
        let path = self.section.path(h);
        let f = path.reflectance;
        let t: [f32; N] = lanes(|n| exp(-self.sigma_per_um[n] * path.length_um));
        let mut inner: [f32; N] = lanes(|n| (1.0 - f) * (1.0 - f) * t[n]);
        self.light[0] = [f; N];
        for order in 0..orders {
            self.turns[order] = turn(order as u32, gamma, gamma_t);
            if order > 0 {
                self.light[order] = inner;
                (0..N).for_each(|n| inner[n] *= f * t[n]);
            }
        }
        // 1 - F T without cancellation for F and T near 1. At the rim F is 1 and no light enters.
        self.beyond = lanes(|n| {
            let lost = (1.0 - f) + f * (1.0 - t[n]);
            if lost > 0.0 { inner[n] / lost } else { 0.0 }
        });
        self.divide();
    }

    fn prepare_far(&mut self, table: &'a FarTable, theta_i: f32) {
        let row = table.row(theta_i);
        let chord_um = self.section.chord_um();
        let through = table.through(&lanes(|n| self.sigma_per_um[n] * chord_um));
        let mut energies = [0.0; MAX_ORDERS];
        table.each_total(row, &through, |order, light, energy| (self.light[order], energies[order]) = (light, energy));
        self.beyond = table.beyond(row, &through);
        self.divide();
        // Probabilities divided by energies: the density of samples in an azimuth is this times the energy
        // there.
        let each = |order: usize| if energies[order] > 0.0 { self.chance[order] / energies[order] } else { 0.0 };
        self.chance = lanes(each);
        self.far = Some((table, row, through));
    }

    /// Sets the probabilities in proportion to the light.
    fn divide(&mut self) {
        let sum = |light: &[f32; N]| light.iter().sum::<f32>();
        let all = self.light.iter().map(sum).sum::<f32>() + sum(&self.beyond);
        if all > 0.0 {
            self.chance = lanes(|order| sum(&self.light[order]) / all);
            self.beyond_share = sum(&self.beyond) / all;
        }
    }

    fn prepare_roots(&mut self) {
        let mut all = 0.0;
        for (h, weight) in OFFSETS {
            let path = self.section.path(h);
            for n in 0..N {
                self.beyond[n] += weight * path.from_order(self.orders(), self.sigma_per_um[n]);
                all += weight * path.from_order(0, self.sigma_per_um[n]);
            }
        }
        self.beyond_share = if all > 0.0 { (self.beyond.iter().sum::<f32>() / all).min(1.0) } else { 0.0 };
    }

    /// Attenuations of an order at an offset, and the probability that a sample at that offset is of the
    /// order.
    fn order(&self, order: u32, h_rel: f32) -> ([f32; N], f32) {
        let path = self.section.path(h_rel);
        let mut a = [0.0; N];
        let (mut sum, mut separate) = (0.0, 0.0);
        for n in 0..N {
            let sigma = self.sigma_per_um[n];
            a[n] = path.attenuation(order, sigma);
            sum += a[n];
            separate += path.sum_below(self.orders(), sigma);
        }
        (a, if separate > 0.0 { (1.0 - self.beyond_share) * sum / separate } else { 0.0 })
    }

    /// Chooses an order by the number `u`, starting with the orders beyond the separate ones. Returns the
    /// order and a uniform number for further use.
    fn choose(&self, u: f32) -> (u32, f32) {
        if u < self.beyond_share {
            return (self.orders(), clamp_unit(u / self.beyond_share));
        }
        let mut remaining = u - self.beyond_share;
        let mut last = (0, 1.0);
        let energies: Option<[f32; MAX_ORDERS]> = self.far.as_ref().map(|(table, row, _)| table.energies(*row));
        for order in 0..self.fiber.parameters.orders {
            let chance = self.chance[order] * energies.map_or(1.0, |energies| energies[order]);
            if chance > 0.0 {
                if remaining < chance {
                    return (order as u32, clamp_unit(remaining / chance));
                }
                last = (order as u32, chance);
                remaining -= chance;
            }
        }
        (last.0, 0.5)
    }

    /// Chooses an order at an offset, for a far field that is computed from roots.
    fn choose_at(&self, h_rel: f32, u: f32) -> (u32, f32) {
        if u < self.beyond_share {
            return (self.orders(), clamp_unit(u / self.beyond_share));
        }
        let mut remaining = u - self.beyond_share;
        let last = self.orders() - 1;
        for order in 0..last {
            let (_, chance) = self.order(order, h_rel);
            if remaining < chance {
                return (order, clamp_unit(remaining / chance));
            }
            remaining -= chance;
        }
        let (_, chance) = self.order(last, h_rel);
        (last, if chance > 0.0 { clamp_unit(remaining / chance) } else { 0.5 })
    }
}

impl<const N: usize> Bsdf<N> for DielectricBsdf<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.eval_pdf(w).0
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.eval_pdf(w).1
    }

    #[inline]
    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        let (mut f, mut pdf) = ([0.0; N], 0.0);
        if !(self.incident.valid && is_direction(w)) {
            return (f, pdf);
        }
        // M of R, TT and TRT.
        let m = self.fiber.three.eval(&self.latitude, Latitude::from_direction(w));
        let [across, side] = self.incident.relative(w);
        let phi = atan2(side, across);
        let orders = self.fiber.parameters.orders;
        let mut add = |lobe: usize, density: f32, light: &[f32; N], chance: f32| {
            let density = m[lobe] * density;
            (0..N).for_each(|n| f[n] += density * light[n]);
            pdf += density * chance;
        };
        match (self.h_rel, &self.far) {
            (Some(_), _) => {
                let mut density = [0.0; MAX_ORDERS];
                for order in 0..MAX_ORDERS {
                    density[order] = self.fiber.azimuthal.eval(wrapped(phi - self.turns[order]));
                }
                for order in 0..orders {
                    add(order.min(2), density[order], &self.light[order], self.chance[order]);
                }
            }
            (None, Some((table, row, through))) => table.each_order(*row, phi, through, |order, light, energy| {
                add(order.min(2), 1.0, &light, energy * self.chance[order]);
            }),
            (None, None) => {
                for order in 0..orders as u32 {
                    let lobe = (order as usize).min(2);
                    self.section.roots(order, phi, |h, density| {
                        let (a, chance) = self.order(order, h);
                        add(lobe, density, &a, chance);
                    });
                }
            }
        }
        add(orders.min(2), 1.0 / TAU, &self.beyond, self.beyond_share);
        (f, pdf)
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        if !(self.incident.valid && u.iter().all(|v| (0.0..1.0).contains(v))) {
            return BsdfSample::Absorbed;
        }
        let h = self.h_rel.unwrap_or(2.0 * u[0] - 1.0);
        let roots = self.h_rel.is_none() && self.far.is_none();
        let (order, remaining) = if roots { self.choose_at(h, u[2]) } else { self.choose(u[2]) };
        // The azimuth is uniform for orders beyond the separate ones. For a far field it is sampled from its
        // table or is the order's azimuth at a random offset; for the near field it is spread about the
        // order's azimuth.
        let azimuth = match (order < self.orders(), &self.far) {
            (false, _) => TAU * u[0],
            (true, Some((table, row, _))) => table.sample(*row, order as usize, u[0]),
            (true, None) if roots => self.section.turn(order, h),
            (true, None) => self.turns[order as usize] + self.fiber.azimuthal.sample(u[0]),
        };
        let lobe = (order as usize).min(2);
        let latitude = self.fiber.longitudinal[lobe].sample(self.latitude[lobe], [u[1], remaining]);
        let (sin, cos) = sin_cos(azimuth);
        let w = self.incident.direction([latitude.cos * cos, latitude.cos * sin], latitude.sin);
        let (f, pdf) = self.eval_pdf(w);
        BsdfSample::scattered(w, f, pdf)
    }

    /// The albedo at the query's offset, or the mean over the offsets.
    fn albedo(&self) -> [f32; N] {
        if !self.incident.valid {
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
        if self.incident.valid { Outcomes::SCATTERED } else { Outcomes::ABSORBED }
    }
}
