//! A peer for comparison: the formula of pbrt-v4's hair (Chiang 2016 with d'Eon's M, Marschner's
//! attenuations, trimmed logistics over the azimuth), N wavelengths, near field.
//!
//! Written from the published formula. Directions are the fiber's frame of this crate, z along it; the peer's
//! own is x along it.

use std::f32::consts::{PI, TAU};

/// Separate lobes: R, TT, TRT; a last one holds all higher orders.
const LOBES: usize = 3;

/// Parameters of the hair, prepared once per material.
pub struct Hair {
    eta: f32,
    /// Longitudinal variances.
    v: [f32; LOBES + 1],
    /// Scale of the logistic.
    s: f32,
    /// Sines and cosines of 1, 2 and 4 tilts.
    tilt: [[f32; 2]; 3],
}

/// The hair at a hit.
pub struct HairAt<'a, const N: usize> {
    hair: &'a Hair,
    h: f32,
    gamma_o: f32,
    sigma: [f32; N],
}

impl Hair {
    pub fn new(eta: f32, beta_m: f32, beta_n: f32, alpha_rad: f32) -> Hair {
        let m = 0.726 * beta_m + 0.812 * beta_m * beta_m + 3.7 * beta_m.powi(20);
        let v0 = m * m;
        let s = 0.626_657_07 * (0.265 * beta_n + 1.194 * beta_n * beta_n + 5.372 * beta_n.powi(22));
        let tilt = [1.0, 2.0, 4.0f32].map(|k| <[f32; 2]>::from((k * alpha_rad).sin_cos()));
        Hair { eta, v: [v0, 0.25 * v0, 4.0 * v0, 4.0 * v0], s, tilt }
    }

    /// `sigma` times the radius, by wavelength.
    pub fn at<const N: usize>(&self, h: f32, sigma: [f32; N]) -> HairAt<'_, N> {
        HairAt { hair: self, h, gamma_o: h.clamp(-1.0, 1.0).asin(), sigma }
    }
}

fn i0(x: f32) -> f32 {
    let (mut value, mut x2i, mut factorial, mut power) = (0.0, 1.0f32, 1.0f32, 1.0f32);
    for i in 0..10u32 {
        if i > 1 {
            factorial *= i as f32;
        }
        value += x2i / (power * factorial * factorial);
        x2i *= x * x;
        power *= 4.0;
    }
    value
}

fn ln_i0(x: f32) -> f32 {
    if x > 12.0 { x + 0.5 * (-TAU.ln() + (1.0 / x).ln() + 1.0 / (8.0 * x)) } else { i0(x).ln() }
}

fn mp(cos_i: f32, cos_o: f32, sin_i: f32, sin_o: f32, v: f32) -> f32 {
    let (a, b) = (cos_i * cos_o / v, sin_i * sin_o / v);
    if v <= 0.1 {
        (ln_i0(a) - b - 1.0 / v + std::f32::consts::LN_2 + (1.0 / (2.0 * v)).ln()).exp()
    } else {
        (-b).exp() * i0(a) / ((1.0 / v).sinh() * 2.0 * v)
    }
}

fn logistic(x: f32, s: f32) -> f32 {
    let e = (-x.abs() / s).exp();
    e / (s * (1.0 + e) * (1.0 + e))
}

fn logistic_cdf(x: f32, s: f32) -> f32 {
    1.0 / (1.0 + (-x / s).exp())
}

fn np(phi: f32, p: usize, s: f32, gamma_o: f32, gamma_t: f32) -> f32 {
    let mut x = phi - (2.0 * p as f32 * gamma_t - 2.0 * gamma_o + p as f32 * PI);
    while x > PI {
        x -= TAU;
    }
    while x < -PI {
        x += TAU;
    }
    logistic(x, s) / (logistic_cdf(PI, s) - logistic_cdf(-PI, s))
}

fn fresnel(cos_i: f32, eta: f32) -> f32 {
    let cos_i = cos_i.clamp(0.0, 1.0);
    let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).max(0.0).sqrt();
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let across = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    0.5 * (parallel * parallel + across * across)
}

impl<const N: usize> HairAt<'_, N> {
    /// f without the division by the cosine, which makes it an energy density as this crate's.
    pub fn f(&self, wo: [f32; 3], wi: [f32; 3]) -> [f32; N] {
        let hair = self.hair;
        let (sin_o, sin_i) = (wo[2], wi[2]);
        let cos = |s: f32| (1.0 - s * s).max(0.0).sqrt();
        let (cos_o, cos_i) = (cos(sin_o), cos(sin_i));
        let phi = wi[1].atan2(wi[0]) - wo[1].atan2(wo[0]);
        let sin_t = sin_o / hair.eta;
        let cos_t = cos(sin_t);
        let etap = (hair.eta * hair.eta - sin_o * sin_o).max(0.0).sqrt() / cos_o;
        let sin_gamma_t = self.h / etap;
        let cos_gamma_t = cos(sin_gamma_t);
        let gamma_t = sin_gamma_t.clamp(-1.0, 1.0).asin();
        let transmittance = self.sigma.map(|s| (-s * (2.0 * cos_gamma_t / cos_t)).exp());
        let f0 = fresnel(cos_o * cos(self.h), hair.eta);
        let mut ap = [[0.0; N]; LOBES + 1];
        for n in 0..N {
            let t = transmittance[n];
            ap[0][n] = f0;
            ap[1][n] = (1.0 - f0) * (1.0 - f0) * t;
            ap[2][n] = ap[1][n] * t * f0;
            if 1.0 - t * f0 != 0.0 {
                ap[3][n] = ap[2][n] * f0 * t / (1.0 - t * f0);
            }
        }
        let mut sum = [0.0; N];
        for p in 0..LOBES {
            let [[s1, c1], [s2, c2], [s4, c4]] = hair.tilt;
            let (sin_op, cos_op) = match p {
                0 => (sin_o * c2 - cos_o * s2, cos_o * c2 + sin_o * s2),
                1 => (sin_o * c1 + cos_o * s1, cos_o * c1 - sin_o * s1),
                _ => (sin_o * c4 + cos_o * s4, cos_o * c4 - sin_o * s4),
            };
            let m = mp(cos_i, cos_op.abs(), sin_i, sin_op, hair.v[p]) * np(phi, p, hair.s, self.gamma_o, gamma_t);
            (0..N).for_each(|n| sum[n] += m * ap[p][n]);
        }
        let m = mp(cos_i, cos_o, sin_i, sin_o, hair.v[LOBES]) / TAU;
        (0..N).for_each(|n| sum[n] += m * ap[LOBES][n]);
        sum
    }
}
