//! Paths of light through the cross section of a smooth dielectric cylinder, of any order, in closed form
//! (Zinke 2007, 5.1).
//!
//! Order 0 is R, 1 is TT, 2 is TRT; order p leaves after p inner segments of length l. Let gamma = asin h be
//! the offset's angle. Order p rotates light by `phi_p = p pi + 2 gamma - 2 p asin(h/n')` and has the
//! attenuation `a_0 = F`, `a_p = (1 - F)^2 F^(p-1) exp(-p sigma l)`. Fresnel's reflectance is the same at
//! every event of a path, since the angle of incidence is the same everywhere on the circle. Polarization is
//! averaged at every event, as in the paper. The orders from p on sum to `(1 - F)^2 F^(p-1) T^p / (1 - F T)`.

use crate::distributions::fast::asin;
use crate::distributions::longitudinal::Latitude;
use plywave::optics::fresnel;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Minimum slope of the azimuth over gamma at which the density is the inverse of the slope. At a caustic the
/// slope is 0 and the density, the reciprocal root of the distance, is infinite. Within this slope, which is
/// 1e-4 rad from the caustic, the density is replaced by its mean, so no quadrature or pixel meets more than
/// 50 per radian. The mean of `1 / slope` over that range is twice its value at the end.
const MIN_SLOPE: f32 = 0.02;

/// The cross section of a fiber for light of one latitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrossSection {
    eta: f32,
    inverse: f32,
    cos_theta: f32,
    /// Length of an inner segment of a path divided by the cosine of gamma_t [um].
    chord_um: f32,
    /// Advance along the axis of an inner segment divided by the cosine of gamma_t [um].
    advance_um: f32,
}

/// A path at an offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Path {
    /// Fresnel's reflectance at each event.
    pub reflectance: f32,
    /// Length of an inner segment [um] (Zinke 2007, Eq. 20).
    pub length_um: f32,
}

/// Where light that is seen at an offset and azimuth comes from: an order's term of the BFSDF (Zinke 2007,
/// Eq. 14, 15, 23).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// lambda_s: distance along the axis from where light enters to where it leaves [um].
    pub shift_um: f32,
    /// lambda_h: offset at which light enters.
    pub h_rel_i: f32,
    /// lambda_phi - phi_o: azimuth that light comes from, relative to the azimuth that it leaves to [rad], in
    /// [-pi, pi].
    pub turn: f32,
}

/// Azimuth by which an order rotates light with these angles (Zinke 2007, Eq. 17-19).
#[inline(always)]
pub(crate) fn turn(order: u32, gamma: f32, gamma_t: f32) -> f32 {
    (order % 2) as f32 * PI + 2.0 * gamma - (2 * order) as f32 * gamma_t
}

impl Path {
    /// Attenuation a_p of an order at an absorption [1/um] (Zinke 2007, Eq. 24-28).
    pub fn attenuation(&self, order: u32, sigma_per_um: f32) -> f32 {
        let f = self.reflectance;
        if order == 0 {
            return f;
        }
        let t = (-sigma_per_um * self.length_um).exp();
        (1.0 - f) * (1.0 - f) * t * (f * t).powi(order as i32 - 1)
    }

    /// Sum of the orders below `order`.
    pub(crate) fn sum_below(&self, order: u32, sigma_per_um: f32) -> f32 {
        let f = self.reflectance;
        let ft = f * (-sigma_per_um * self.length_um).exp();
        let (mut sum, mut power) = (f, (1.0 - f) * (1.0 - f) * (-sigma_per_um * self.length_um).exp());
        for _ in 1..order {
            sum += power;
            power *= ft;
        }
        sum
    }

    /// Sum of the orders from `order` on. From order 0 on it is all light, which is 1 without absorption.
    pub fn from_order(&self, order: u32, sigma_per_um: f32) -> f32 {
        let f = self.reflectance;
        let t = (-sigma_per_um * self.length_um).exp();
        let inner = |first: u32| {
            // 1 - F T without cancellation for F and T near 1.
            let lost = (1.0 - f) + f * -(-sigma_per_um * self.length_um).exp_m1();
            if lost > 0.0 { (1.0 - f) * (1.0 - f) * t * (f * t).powi(first as i32 - 1) / lost } else { 0.0 }
        };
        if order == 0 { f + inner(1) } else { inner(order) }
    }
}

impl CrossSection {
    /// The cross section of a fiber of index `eta` and a radius [um], for light whose latitude has this sine.
    #[inline]
    pub fn new(eta: f32, radius_um: f32, sin_theta: f32) -> CrossSection {
        let sin = sin_theta.clamp(-1.0, 1.0);
        CrossSection::at(eta, radius_um, Latitude { sin, cos: (1.0 - sin * sin).max(0.0).sqrt() })
    }

    /// The cross section of a fiber of index `eta` and a radius [um], for light of a latitude, whose cosine
    /// is accurate near the poles too.
    #[inline]
    pub(crate) fn at(eta: f32, radius_um: f32, theta: Latitude) -> CrossSection {
        let sin_t = -theta.sin / eta;
        let cos_t = (1.0 - sin_t * sin_t).max(0.0).sqrt();
        CrossSection {
            eta,
            // 1/n', where n' is Bravais's index.
            inverse: theta.cos / (eta * eta - theta.sin * theta.sin).max(0.0).sqrt(),
            cos_theta: theta.cos,
            chord_um: 2.0 * radius_um / cos_t,
            advance_um: 2.0 * radius_um * sin_t / cos_t,
        }
    }

    /// The path at the offset `h_rel`.
    #[inline]
    pub fn path(&self, h_rel: f32) -> Path {
        let h = h_rel.clamp(-1.0, 1.0);
        Path {
            reflectance: fresnel::dielectric(self.cos_theta * (1.0 - h * h).max(0.0).sqrt(), self.eta),
            length_um: self.chord_um * self.cos_t(h),
        }
    }

    /// Azimuth phi_o - phi_i by which an order rotates light at the offset `h_rel` [rad], not wrapped to a
    /// turn (Zinke 2007, Eq. 17-19).
    #[inline]
    pub fn turn(&self, order: u32, h_rel: f32) -> f32 {
        let [gamma, gamma_t] = self.angles(h_rel);
        turn(order, gamma, gamma_t)
    }

    /// gamma_i and gamma_t, signed.
    #[inline]
    pub(crate) fn angles(&self, h_rel: f32) -> [f32; 2] {
        let h = h_rel.clamp(-1.0, 1.0);
        [asin(h), asin((h * self.inverse).clamp(-1.0, 1.0))]
    }

    /// gamma_t at an offset in [-1, 1].
    #[inline]
    pub(crate) fn gamma_t(&self, h_rel: f32) -> f32 {
        asin(self.sin_t(h_rel))
    }

    /// Sine of gamma_t.
    #[inline]
    pub(crate) fn sin_t(&self, h_rel: f32) -> f32 {
        (h_rel * self.inverse).clamp(-1.0, 1.0)
    }

    /// Length of an inner segment of a path divided by the cosine of gamma_t [um].
    #[inline]
    pub(crate) fn chord_um(&self) -> f32 {
        self.chord_um
    }

    /// An order's term of the BFSDF at the offset where it is seen (Zinke 2007, Eq. 21-23); its weight is
    /// [`Path::attenuation`].
    pub fn peak(&self, order: u32, h_rel_o: f32) -> Peak {
        let turn = -self.turn(order, -h_rel_o);
        Peak {
            shift_um: order as f32 * self.advance_um * self.cos_t(h_rel_o.clamp(-1.0, 1.0)),
            h_rel_i: -h_rel_o,
            turn: turn - TAU * (turn / TAU).round(),
        }
    }

    /// Cosine of gamma_t.
    #[inline]
    pub(crate) fn cos_t(&self, h: f32) -> f32 {
        let s = h * self.inverse;
        (1.0 - s * s).max(0.0).sqrt()
    }

    /// Visits the offsets whose light of an order leaves in the relative azimuth `phi` [rad], each with the
    /// density `|dh/dphi| / 2` [1/rad] of a uniform beam. If `phi` is not finite, none is visited.
    ///
    /// R and TT have one root in closed form. Higher orders have one for each turn of each monotone piece,
    /// which Newton's method finds within the piece.
    pub fn roots(&self, order: u32, phi: f32, mut visit: impl FnMut(f32, f32)) {
        if !phi.is_finite() {
            return;
        }
        let phi = phi - TAU * (phi / TAU).round();
        match order {
            0 => {
                let gamma = 0.5 * phi;
                visit(gamma.sin(), 0.25 * gamma.cos().max(0.0));
            }
            1 => {
                // tan gamma_t = sin(d) / (n' - cos(d)), where d = gamma_i - gamma_t is half of the bending
                // angle.
                let bent = if phi > 0.0 { phi - PI } else { phi + PI };
                let (sin, cos) = (0.5 * bent).sin_cos();
                // Light at the rim is bent by pi/2 - asin(1/n').
                if cos > self.inverse {
                    // 1 - 2 cos / n' + 1 / n'^2 without cancellation near index 1.
                    let [slow, quarter] = [1.0 - self.inverse, (0.25 * bent).sin()];
                    let h = sin / (slow * slow + 4.0 * self.inverse * quarter * quarter).sqrt();
                    let h = h.clamp(-1.0, 1.0);
                    visit(h, self.density(1, h.asin()));
                }
            }
            _ => self.higher_roots(order, phi, &mut visit),
        }
    }

    fn higher_roots(&self, order: u32, phi: f32, visit: &mut impl FnMut(f32, f32)) {
        let p = order as f32;
        let target = phi - p % 2.0 * PI;
        let across = 1.0 / self.inverse;
        let caustic =
            if p > across { ((p * p - across * across) / (p * p - 1.0)).max(0.0).sqrt().min(1.0).asin() } else { 0.0 };
        let ends = [-FRAC_PI_2, -caustic, caustic, FRAC_PI_2];
        for piece in ends.windows(2) {
            let (from, to) = (piece[0], piece[1]);
            if to <= from {
                continue;
            }
            let (a, b) = (self.bend(p, from), self.bend(p, to));
            let (low, high) = if a < b { (a, b) } else { (b, a) };
            let mut value = target + TAU * ((low - target) / TAU).ceil();
            while value < high {
                let gamma = self.solve(p, value, [from, to], a < b);
                visit(gamma.sin(), self.density(order, gamma));
                value += TAU;
            }
        }
    }

    /// 2 gamma - 2 p gamma_t.
    fn bend(&self, p: f32, gamma: f32) -> f32 {
        2.0 * gamma - 2.0 * p * (gamma.sin() * self.inverse).clamp(-1.0, 1.0).asin()
    }

    fn slope(&self, p: f32, gamma: f32) -> f32 {
        2.0 - 2.0 * p * gamma.cos() * self.inverse / self.cos_t(gamma.sin()).max(1e-6)
    }

    /// `cos gamma / (2 |dphi/dgamma|)`, constant within [`MIN_SLOPE`] of a caustic.
    fn density(&self, order: u32, gamma: f32) -> f32 {
        let slope = self.slope(order as f32, gamma).abs();
        0.5 * gamma.cos().max(0.0) / if slope < MIN_SLOPE { 0.5 * MIN_SLOPE } else { slope }
    }

    /// The angle within a monotone piece whose bend is `value`.
    fn solve(&self, p: f32, value: f32, [mut low, mut high]: [f32; 2], rises: bool) -> f32 {
        let mut gamma = 0.5 * (low + high);
        for _ in 0..24 {
            let off = self.bend(p, gamma) - value;
            if (off > 0.0) == rises {
                high = gamma;
            } else {
                low = gamma;
            }
            let next = gamma - off / self.slope(p, gamma);
            // If the step leaves the bracket or is NaN, the bracket is halved.
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            let done = (next - gamma).abs() < 2e-7;
            gamma = next;
            if done {
                break;
            }
        }
        gamma
    }
}

/// Offsets and weights of Gauss-Legendre quadrature with 16 points in gamma on [0, pi/2]: `sum w a(h)` is the
/// mean over the offsets of an even function a.
pub(crate) const OFFSETS: [(f32, f32); 16] = [
    (8.324_39e-3, 2.132_475_3e-2),
    (4.351_693e-2, 4.884_748_6e-2),
    (1.053_372_3e-1, 7.432_152e-2),
    (1.909_255_2e-1, 9.608_275_4e-2),
    (2.956_341_7e-1, 1.122_406_5e-1),
    (4.129_334_8e-1, 1.209_993_8e-1),
    (5.347_63e-1, 1.211_871_5e-1),
    (6.524_217e-1, 1.127_645_7e-1),
    (7.578_561_4e-1, 9.707_654e-2),
    (8.450_021e-1, 7.669_378e-2),
    (9.107_612e-1, 5.486_037e-2),
    (9.553_012e-1, 3.473_477_3e-2),
    (9.816_045e-1, 1.868_843_3e-2),
    (9.944_365_6e-1, 7.872_621_9e-3),
    (9.990_527e-1, 2.127_708_1e-3),
    (9.999_653_5e-1, 1.775_217_1e-4),
];
