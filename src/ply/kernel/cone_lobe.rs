//! The arithmetic of cone lobes side by side ([`crate::ply::cone`]): shapes at an incidence, values in a
//! direction, and sampling.

use super::lobe::{root_width, sin_cos};
use super::mixture::Params;
use crate::math::erf::{erf_inverse, fast_erf};
use crate::math::simd::{atan2, exp2_within, fma, max, min};
use crate::ply::cone::GRAZING;
use std::f32::consts::{FRAC_1_PI, LN_2, PI};

/// sqrt(ln 2), which turns s = sqrt(mu log2 e) into sqrt(mu).
const ROOT_LN_2: f32 = 0.832_554_6;
/// Exponents are clamped to this: 2^-100 is dark, and smaller numbers could be denormal.
const DARK: f32 = 100.0;

/// Adding and subtracting this number rounds a small number to an integer.
const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23

/// Shapes of cone lobes at an incidence.
#[derive(Clone, Copy, Debug)]
pub(in crate::ply) struct ConeShapes<const L: usize> {
    /// Azimuths of the centers [half turns].
    phi: [f32; L],
    /// s0 at the center, and the coefficient of sin x in s0.
    center: [f32; L],
    slope: [f32; L],
    /// sqrt(mu1 log2 e), sqrt(mu2 log2 e) / g.
    s1: [f32; L],
    s2: [f32; L],
    /// Factor on the product of a lobe's exponentials that gives it its energy; the sum of erf is divided by
    /// separately.
    pub(in crate::ply) amplitude: [f32; L],
}

/// Azimuth of a direction [half turns]; `None` for an invalid direction.
#[inline(always)]
pub(in crate::ply) fn azimuth<const FMA: bool>(v: [f32; 3]) -> Option<f32> {
    let n2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    (n2 > 0.25 && n2 < 4.0).then(|| atan2::<FMA>(v[1], v[0]) * FRAC_1_PI)
}

/// Sine and cosine of the incident latitude, and g.
#[inline(always)]
pub(in crate::ply) fn incidence<const FMA: bool>(theta_i: f32) -> [f32; 3] {
    let (s, c) = sin_cos::<FMA>(min(theta_i.abs() * FRAC_1_PI, 0.5));
    let c = max(c, 0.0);
    [s, c, max(c, GRAZING as f32)]
}

impl<const L: usize> ConeShapes<L> {
    /// Shapes from interpolated parameters and the energies of the lobes. `bounds` are the bounds of the
    /// stored bandwidths mu1 and mu2.
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool>(
        params: &Params<L>,
        energy: &[f32; L],
        theta_i: f32,
        bounds: [(f32, f32); 2],
    ) -> Self {
        let [sin, _, g] = incidence::<FMA>(theta_i);
        let per_g = 1.0 / g;
        let zero = [0.0; L];
        let mut x = ConeShapes { phi: params[1], center: zero, slope: zero, s1: zero, s2: zero, amplitude: zero };
        for i in 0..L {
            x.center[i] = fma::<FMA>(g, params[0][i], -sin);
            x.slope[i] = g * params[2][i];
            x.s1[i] = root_width::<FMA>(params[3][i], bounds[0]);
            x.s2[i] = per_g * root_width::<FMA>(params[4][i], bounds[1]);
            // sqrt(mu1/pi)/erf(pi sqrt mu1) times 2 sqrt(t/pi).
            let both = x.s1[i] * x.s2[i] * (2.0 * LN_2 * FRAC_1_PI);
            x.amplitude[i] = energy[i] * both / fast_erf::<FMA>(PI * ROOT_LN_2 * x.s1[i]);
        }
        x
    }

    /// The value of lobe `i` at an azimuth [half turns] and s = sin theta_o, divided by its amplitude.
    #[inline(always)]
    pub(in crate::ply) fn shape<const FMA: bool>(&self, i: usize, phi: f32, s: f32) -> f32 {
        let turn = phi - self.phi[i];
        let x = turn - 2.0 * (fma::<FMA>(0.5, turn, ROUND) - ROUND);
        let s0 = self.center::<FMA>(i, x);
        let (u, w) = (PI * self.s1[i] * x, self.s2[i] * (s - s0));
        let q = fma::<FMA>(u, u, w * w);
        let r2 = ROOT_LN_2 * self.s2[i];
        let all = fast_erf::<FMA>(r2 * (1.0 - s0)) + fast_erf::<FMA>(r2 * (1.0 + s0));
        let value = exp2_within::<FMA>(-min(q, DARK)) / all;
        if q < DARK { value } else { 0.0 }
    }

    /// s0 at `x` half turns from the lobe's azimuth.
    #[inline(always)]
    fn center<const FMA: bool>(&self, i: usize, x: f32) -> f32 {
        let (sin, _) = sin_cos::<FMA>(x);
        min(max(fma::<FMA>(self.slope[i], sin, self.center[i]), -1.0), 1.0)
    }

    /// Samples a direction of lobe `i` with two uniform numbers.
    #[inline(always)]
    pub(in crate::ply) fn draw<const FMA: bool>(&self, i: usize, u1: f32, u2: f32) -> [f32; 3] {
        // Clamped to just inside of +-1, where the inverse is infinite.
        let inverse = |y: f32| erf_inverse(min(max(y, -1.0 + 6e-8), 1.0 - 6e-8));
        let (r1, r2) = (ROOT_LN_2 * self.s1[i], ROOT_LN_2 * self.s2[i]);
        let x = inverse((2.0 * u1 - 1.0) * fast_erf::<FMA>(PI * r1)) * FRAC_1_PI / r1;
        let x = min(max(x, -1.0), 1.0);
        let s0 = self.center::<FMA>(i, x);
        let (low, high) = (fast_erf::<FMA>(r2 * (-1.0 - s0)), fast_erf::<FMA>(r2 * (1.0 - s0)));
        let s = s0 + inverse(fma::<FMA>(high - low, u2, low)) / r2;
        let s = min(max(s, -1.0), 1.0);
        let (sin, cos) = sin_cos::<FMA>(self.phi[i] + x);
        let c = ((1.0 - s) * (1.0 + s)).sqrt();
        [c * cos, c * sin, s]
    }

    /// Cosine between the center of lobe `i` and the forward direction of an incidence ([`incidence`]).
    #[inline(always)]
    pub(in crate::ply) fn forward<const FMA: bool>(&self, i: usize, [s_i, c_i, _]: [f32; 3]) -> f32 {
        let s = min(max(self.center[i], -1.0), 1.0);
        let (sin, _) = sin_cos::<FMA>(self.phi[i]);
        fma::<FMA>(-c_i * ((1.0 - s) * (1.0 + s)).sqrt(), sin, -s_i * s)
    }
}
