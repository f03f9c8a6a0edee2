//! Opaque fibers of circular cross section with a reflecting surface (Zinke 2007, 9.1).
//!
//! Light leaves where it arrives, so the surface's BRDF replaces the BFSDF, and for a whole fiber (Eq. 48,
//! with gamma = asin h_i)
//!
//! ```text
//! f_BCSDF(phi) = 1/2 integral of f_BRDF cos gamma cos(gamma - phi) dgamma    over the lit part that is seen
//! ```
//!
//! The surface here is a mirror of Fresnel reflectance F over a Lambertian base of albedo rho:
//! `F delta + (1 - F) rho / pi`, with F at the angle of the incident light, as in the paper's Fig. 11. A
//! cylindrical mirror preserves the latitude. As in the dielectric model, d'Eon's M of width `beta_m` spreads
//! the latitude, and in the near field `beta_n` spreads the azimuth. With F = 0 the fiber is Lambertian,
//! exactly: `f_BCSDF = rho / (4 pi) (sin|phi| + (pi - |phi|) cos phi)`, which the paper approximates by a
//! polynomial ([`lambertian_by_zinke`]).

use crate::FiberQuery;
use crate::distributions::azimuthal::OFFSETS;
use crate::distributions::fast::{asin, atan2, lanes, sin_cos, wrapped};
use crate::distributions::gaussian::Gaussian;
use crate::distributions::longitudinal::{Latitude, Longitudinal};
use crate::incident::Incident;
use crate::range::parameter;
use plywave::bsdf::Outcomes;
use plywave::frame::is_direction;
use plywave::math::clamp_unit;
use plywave::optics::fresnel;
use plywave::optics::{Metal, conductor};
use plywave::{Bsdf, BsdfSample, Result};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, PI, TAU};

/// Specular reflection of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Mirror {
    /// No specular reflection.
    None,
    /// Reflection as by a dielectric of this refractive index, 1.01 to 4, for varnish and plastic.
    Dielectric(f32),
    /// Reflection as by a conductor of the index `[eta, kappa]` at every wavelength, 0.01 to 20 and 0 to 50.
    Conductor([f32; 2]),
    /// Reflection as by a metal with measured indices.
    Metal(Metal),
}

/// Parameters of an [`OpaqueFiber`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpaqueParameters {
    /// Radius [um], 0.01 to 1e5.
    pub radius_um: f32,
    /// Specular reflection of the surface.
    pub mirror: Mirror,
    /// Albedo of the Lambertian base, pi k_d of the paper, 0 to 1, relative to the light that is not
    /// mirrored.
    pub diffuse: f32,
    /// Longitudinal width of the mirrored light [rad], 0.001 to 2.
    pub beta_m: f32,
    /// Azimuthal width of the mirrored light in the near field [rad], 0.001 to 10.
    pub beta_n: f32,
}

impl Default for OpaqueParameters {
    /// Silver wire of radius 10 um.
    fn default() -> Self {
        OpaqueParameters {
            radius_um: 10.0,
            mirror: Mirror::Metal(Metal::Silver),
            diffuse: 0.0,
            beta_m: 0.1,
            beta_n: 0.1,
        }
    }
}

/// An opaque fiber.
///
/// ```
/// use plywave_fiber::{Mirror, OpaqueFiber, OpaqueParameters};
/// use plywave::optics::Metal;
/// use plywave::frame::direction;
/// use plywave::Bsdf;
/// use plywave_fiber::{FiberModel, FiberQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let wire = OpaqueParameters { mirror: Mirror::Metal(Metal::Gold), ..OpaqueParameters::default() };
/// let wire: FiberModel = OpaqueFiber::new(wire)?.into();
/// let [red, green, blue] = wire.at(&FiberQuery::new(direction(0.2, 0.0), [0.61, 0.55, 0.465])).albedo();
/// assert!(red > green && green > blue);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct OpaqueFiber {
    parameters: OpaqueParameters,
    longitudinal: Longitudinal,
    azimuthal: Gaussian,
    /// `[latitude][azimuth]`: the integral of Eq. 48 for the BRDF `(1 - F) / pi`, the far field of a base of
    /// albedo 1 under a mirror of one index.
    base: Option<Vec<f32>>,
}

/// Numbers of nodes of the base's table, over latitudes (cosines from 0 to 1) and azimuths (0 to pi).
const BASE: [usize; 2] = [129, 97];

impl OpaqueFiber {
    /// Builds a fiber with these parameters.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] if a parameter is outside its range.
    pub fn new(parameters: OpaqueParameters) -> Result<OpaqueFiber> {
        const MODEL: &str = "opaque fiber";
        let p = &parameters;
        parameter(MODEL, "radius_um", p.radius_um, [0.01, 1e5])?;
        match p.mirror {
            Mirror::Dielectric(eta) => parameter(MODEL, "eta", eta, [1.01, 4.0])?,
            Mirror::Conductor([eta, kappa]) => {
                parameter(MODEL, "eta", eta, [0.01, 20.0])?;
                parameter(MODEL, "kappa", kappa, [0.0, 50.0])?;
            }
            Mirror::None | Mirror::Metal(_) => {}
        }
        parameter(MODEL, "diffuse", p.diffuse, [0.0, 1.0])?;
        parameter(MODEL, "beta_m", p.beta_m, [1e-3, 2.0])?;
        parameter(MODEL, "beta_n", p.beta_n, [1e-3, 10.0])?;
        let fixed = match p.mirror {
            Mirror::Dielectric(eta) => Some([eta, 0.0]),
            Mirror::Conductor(index) => Some(index),
            Mirror::None | Mirror::Metal(_) => None,
        };
        let base = fixed.filter(|_| p.diffuse > 0.0).map(|index| {
            let node = |k: usize| {
                let (theta, phi) = (k / BASE[1], k % BASE[1]);
                // Nodes are squares because the function varies most near grazing light.
                let cos_theta = (theta as f32 / (BASE[0] - 1) as f32).powi(2);
                let [f] = bcsdf_of_brdf(PI * phi as f32 / (BASE[1] - 1) as f32, |[cos, _]| {
                    [FRAC_1_PI * (1.0 - conductor(cos_theta * cos, index))]
                });
                f
            };
            (0..BASE[0] * BASE[1]).map(node).collect()
        });
        Ok(OpaqueFiber {
            parameters,
            longitudinal: Longitudinal::new(p.beta_m),
            azimuthal: Gaussian::new(p.beta_n, PI),
            base,
        })
    }

    /// The fiber's parameters.
    pub fn parameters(&self) -> &OpaqueParameters {
        &self.parameters
    }

    /// The fiber at a query, whose absorption is ignored. If an input is not finite or `omega_i` is not a
    /// direction, no light is scattered.
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> OpaqueBsdf<'_, N> {
        let finite = query.lambda_um.iter().all(|l| l.is_finite()) && query.h_rel.is_none_or(f32::is_finite);
        let index = lanes(|n| match self.parameters.mirror {
            Mirror::None => [1.0, 0.0],
            Mirror::Dielectric(eta) => [eta, 0.0],
            Mirror::Conductor(index) => index,
            Mirror::Metal(metal) => metal.index(query.lambda_um[n]),
        });
        let mut at = OpaqueBsdf {
            fiber: self,
            incident: Incident::new(query.omega_i, finite),
            index,
            near: None,
            chance: 1.0,
            dark: self.parameters.diffuse == 0.0
                && matches!(self.parameters.mirror, Mirror::None | Mirror::Conductor([1.0, 0.0])),
        };
        at.near = query.h_rel.map(|h| h.clamp(-1.0, 1.0)).map(|h| {
            let cos = ((1.0 - h) * (1.0 + h)).max(0.0).sqrt();
            let (mirrored, diffuse) = at.shares(cos);
            OffsetTerms { h_rel: h, cos, gamma: asin(h), mirrored, diffuse }
        });
        if self.parameters.diffuse > 0.0 {
            // In the far field this is estimated from three offsets; any probability strictly between 0 and 1
            // is valid.
            let (mut m, mut d) = (0.0, 0.0);
            let mut add = |(mirrored, diffuse): ([f32; N], [f32; N])| {
                m += mirrored.iter().sum::<f32>();
                d += diffuse.iter().sum::<f32>();
            };
            match &at.near {
                Some(near) => add((near.mirrored, near.diffuse)),
                None => [0.3, 0.7, 0.95f32].iter().for_each(|cos| add(at.shares(*cos))),
            }
            let chance = if m + d > 0.0 { m / (m + d) } else { 0.0 };
            // Both are sampled, since either may be weak at some offset.
            at.chance = if self.parameters.mirror == Mirror::None { 0.0 } else { chance.max(0.05).min(0.95) };
        }
        at
    }

    /// The far field of a base of albedo 1 under a mirror of one index; `None` if there is no table.
    #[inline]
    fn base(&self, cos_theta: f32, phi: f32) -> Option<f32> {
        let table = self.base.as_ref()?;
        let place = |x: f32, count: usize| {
            let x = x.clamp(0.0, 1.0) * (count - 1) as f32;
            let first = (x as usize).min(count - 2);
            (first, x - first as f32)
        };
        let (row, s) = place(cos_theta.sqrt(), BASE[0]);
        let (column, t) = place(phi.abs() * FRAC_1_PI, BASE[1]);
        let at = |row: usize| {
            let pair = &table[row * BASE[1] + column..][..2];
            pair[0] + t * (pair[1] - pair[0])
        };
        let (a, b) = (at(row), at(row + 1));
        Some(a + s * (b - a))
    }
}

/// Quantities at a query's offset.
#[derive(Clone, Copy, Debug)]
struct OffsetTerms<const N: usize> {
    h_rel: f32,
    /// Cosine of the offset's angle gamma.
    cos: f32,
    gamma: f32,
    mirrored: [f32; N],
    diffuse: [f32; N],
}

/// The BCSDF of an opaque fiber in the relative azimuth `phi` [rad] for any BRDF (Zinke 2007, Eq. 48). `brdf`
/// is the surface's BRDF [1/sr] for light that arrives at the offset angle gamma = asin h_i, given as its
/// cosine and sine. Gauss quadrature with 16 points is exact to 1e-6 for integrands that are smooth on the
/// fiber.
pub fn bcsdf_of_brdf<const N: usize>(phi: f32, brdf: impl Fn([f32; 2]) -> [f32; N]) -> [f32; N] {
    let mut sum = [0.0; N];
    each_lit(phi, |gamma, weight| {
        let f = brdf(gamma);
        (0..N).for_each(|n| sum[n] += weight * f[n]);
    });
    sum
}

/// Visits quadrature points of the part that is lit and visible in the relative azimuth `phi`, with the
/// cosine and sine of gamma and with the weight `cos gamma cos(gamma - phi) dgamma / 2`.
#[inline]
fn each_lit(phi: f32, mut visit: impl FnMut([f32; 2], f32)) {
    let phi = phi - TAU * (phi / TAU).round();
    let (low, high) = ((phi - FRAC_PI_2).max(-FRAC_PI_2), (phi + FRAC_PI_2).min(FRAC_PI_2));
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let (sin_phi, cos_phi) = phi.sin_cos();
    for (x, w) in GAUSS {
        for x in [x, -x] {
            let (sin, cos) = (middle + half * x).sin_cos();
            visit([cos, sin], 0.5 * half * w * (cos * (cos * cos_phi + sin * sin_phi)).max(0.0));
        }
    }
}

/// Positive points and weights of Gauss-Legendre quadrature with 16 points on [-1, 1].
const GAUSS: [(f32, f32); 8] = [
    (0.095_012_51, 0.189_450_6),
    (0.281_603_55, 0.182_603_42),
    (0.458_016_78, 0.169_156_52),
    (0.617_876_24, 0.149_595_99),
    (0.755_404_4, 0.124_628_97),
    (0.865_631_2, 0.095_158_51),
    (0.944_575, 0.062_253_52),
    (0.989_400_9, 0.027_152_46),
];

/// BCSDF of a Lambertian fiber [1/sr], exact (Zinke 2007, Eq. 49).
#[inline]
pub fn lambertian(k_d: f32, phi: f32) -> f32 {
    let phi = (phi - TAU * (phi / TAU).round()).abs();
    0.25 * k_d * (phi.sin() + (PI - phi) * phi.cos()).max(0.0)
}

/// [`lambertian`] from the sine and cosine of phi, both times `scale`.
#[inline]
fn lambertian_of(k_d: f32, phi: f32, cos: f32, sin: f32, scale: f32) -> f32 {
    let inverse = 1.0 / scale.max(1e-20);
    0.25 * k_d * ((sin.abs() + (PI - phi.abs()) * cos) * inverse).max(0.0)
}

/// The paper's polynomial for [`lambertian`], phi from 0 to pi (Zinke 2007, Eq. 51), for comparison only. It
/// is off by 6 % at 0 and by 87 % at 150 degrees.
pub fn lambertian_by_zinke(k_d: f32, phi: f32) -> f32 {
    let (s, c) = phi.sin_cos();
    0.5 * k_d * (5.0 / 6.0 * c + c * c - c.powi(4) / 6.0 + 0.5 * s - 0.5 * s * c * c).abs()
}

/// An [`OpaqueFiber`] at a query.
#[derive(Clone, Copy, Debug)]
pub struct OpaqueBsdf<'a, const N: usize> {
    fiber: &'a OpaqueFiber,
    incident: Incident,
    /// `[eta, kappa]`, one for each wavelength.
    index: [[f32; 2]; N],
    near: Option<OffsetTerms<N>>,
    /// Probability that a sample is mirrored.
    chance: f32,
    /// Whether all light is absorbed.
    dark: bool,
}

impl<const N: usize> OpaqueBsdf<'_, N> {
    /// The fiber's diameter [um]; 0 if the query is invalid.
    pub fn width_um(&self) -> [f32; N] {
        [if self.incident.valid { 2.0 * self.fiber.parameters.radius_um } else { 0.0 }; N]
    }

    /// Mirrored and diffuse albedo at an offset whose angle has the cosine `cos_gamma`.
    #[inline]
    fn shares(&self, cos_gamma: f32) -> ([f32; N], [f32; N]) {
        let cos = self.incident.latitude.cos * cos_gamma;
        let rho = self.fiber.parameters.diffuse;
        let mirrored = match self.fiber.parameters.mirror {
            Mirror::None => [0.0; N],
            Mirror::Dielectric(eta) => [fresnel::dielectric(cos, eta); N],
            _ => lanes(|n| conductor(cos, self.index[n])),
        };
        (mirrored, lanes(|n| (1.0 - mirrored[n]) * rho))
    }
}

impl<const N: usize> Bsdf<N> for OpaqueBsdf<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.eval_pdf(w).0
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.eval_pdf(w).1
    }

    #[inline]
    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        let (mut f, mut pdf) = ([0.0; N], 0.0);
        if !(self.incident.valid && is_direction(w)) || self.dark {
            return (f, pdf);
        }
        let p = &self.fiber.parameters;
        let o = Latitude::from_direction(w);
        let [across, side] = self.incident.relative(w);
        let phi = atan2(side, across);
        let mut add = |density: f32, part: &[f32; N], chance: f32| {
            (0..N).for_each(|n| f[n] += density * part[n]);
            pdf += density * chance;
        };
        if p.mirror != Mirror::None {
            let m = self.fiber.longitudinal.eval(self.incident.latitude, o);
            match &self.near {
                None => {
                    let cos_phi = if o.cos > 0.0 { (across / o.cos).clamp(-1.0, 1.0) } else { 1.0 };
                    let cos = (0.5 * (1.0 + cos_phi)).sqrt();
                    add(m * 0.25 * cos, &self.shares(cos).0, self.chance);
                }
                Some(near) => {
                    let density = self.fiber.azimuthal.eval(wrapped(phi - 2.0 * near.gamma));
                    add(m * density, &near.mirrored, self.chance);
                }
            }
        }
        if p.diffuse > 0.0 {
            match &self.near {
                None => {
                    let even = o.cos * lambertian_of(FRAC_1_PI, phi, across, side, o.cos);
                    if p.mirror == Mirror::None {
                        add(even, &[p.diffuse; N], 1.0);
                    } else {
                        add(even, &[0.0; N], 1.0 - self.chance);
                        match self.fiber.base(self.incident.latitude.cos, phi) {
                            Some(base) => add(o.cos * base, &[p.diffuse; N], 0.0),
                            // For metals F depends on the wavelength.
                            None => each_lit(phi, |[cos, _], weight| {
                                add(o.cos * weight * FRAC_1_PI, &self.shares(cos).1, 0.0);
                            }),
                        }
                    }
                }
                Some(near) => {
                    let visible = (near.cos * across + near.h_rel * side).max(0.0);
                    add(visible * FRAC_1_PI, &near.diffuse, 1.0 - self.chance);
                }
            }
        }
        (f, pdf)
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        if !(self.incident.valid && u.iter().all(|v| (0.0..1.0).contains(v))) || self.dark {
            return BsdfSample::Absorbed;
        }
        let (h, cos_gamma, gamma) = match &self.near {
            Some(near) => (near.h_rel, near.cos, near.gamma),
            None => {
                let h = 2.0 * u[0] - 1.0;
                (h, ((1.0 - h) * (1.0 + h)).max(0.0).sqrt(), asin(h))
            }
        };
        // Cosine and sine of the relative azimuth, both times the cosine of the latitude; and the sine of the
        // latitude.
        let (across, along) = if u[2] < self.chance {
            let i = self.fiber.longitudinal.sample(self.incident.latitude, [u[1], clamp_unit(u[2] / self.chance)]);
            let phi = 2.0 * gamma + if self.near.is_some() { self.fiber.azimuthal.sample(u[0]) } else { 0.0 };
            let (sin, cos) = sin_cos(phi);
            ([i.cos * cos, i.cos * sin], i.sin)
        } else {
            // Cosine-weighted about the normal, which has the azimuth gamma.
            let turn = TAU * clamp_unit((u[2] - self.chance) / (1.0 - self.chance));
            let (sin, cos) = sin_cos(turn);
            let (radius, up) = (u[1].sqrt(), (1.0 - u[1]).sqrt());
            let side = radius * cos;
            ([up * cos_gamma - side * h, up * h + side * cos_gamma], radius * sin)
        };
        let w = self.incident.direction(across, along);
        let (f, pdf) = self.eval_pdf(w);
        BsdfSample::scattered(w, f, pdf)
    }

    /// The albedo at the query's offset, or the mean over the offsets.
    fn albedo(&self) -> [f32; N] {
        if !self.incident.valid {
            return [0.0; N];
        }
        let at = |cos: f32| {
            let (mirrored, diffuse) = self.shares(cos);
            std::array::from_fn(|n| mirrored[n] + diffuse[n])
        };
        match &self.near {
            Some(near) => at(near.cos),
            None => OFFSETS.iter().fold([0.0; N], |sum, (h, weight)| {
                let a: [f32; N] = at((1.0 - h * h).sqrt());
                std::array::from_fn(|n| sum[n] + weight * a[n])
            }),
        }
    }

    fn outcomes(&self) -> Outcomes {
        if self.incident.valid && !self.dark { Outcomes::SCATTERED } else { Outcomes::ABSORBED }
    }
}
