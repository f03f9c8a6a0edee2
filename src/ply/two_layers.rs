//! A ply over a second layer of yarns (Yu 2025, 5.4 and 7.1).

use super::layers::{Layer, layer, layer_and_forward};
use super::lobes::{LobeLight, Lobes};
use super::model::PlyModel;
use super::query::PlyQuery;
use super::single_layer::SingleLayer;
use crate::BsdfSample;
use crate::bsdf::Outcomes;
use crate::frame::is_direction;
use std::f32::consts::PI;

impl PlyModel {
    /// The fractions r, t, r* and t* of a layer of this ply's yarns at a latitude [rad]; `None` for a model
    /// without layer factors.
    pub fn layer<const N: usize>(&self, theta_i: f32, sigma_per_um: [f32; N]) -> Option<Layer<N>> {
        Some(layer(self.layer_tables()?, theta_i, &sigma_per_um))
    }

    /// Energy of f_refl + f_high in the half space away from the light, y < 0; `None` for a model without
    /// layer factors.
    pub fn forward_energy<const N: usize>(&self, theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Option<[f32; N]> {
        let at = self.uncached_at(&PlyQuery::lobes(theta_i, h_um, sigma_per_um));
        let (all, r_d) = at.lit().albedo_r_d();
        let (_, forward) = layer_and_forward(self.layer_tables()?, theta_i, h_um, r_d, &sigma_per_um);
        Some(std::array::from_fn(|k| forward[k].min(all[k])))
    }
}

/// A ply in the upper one of two layers, at a query (Yu 2025, 5.4 and 7.1).
///
/// Light that the ply reflects keeps its lobes. Light that it transmits becomes diffuse and is scaled to T.
/// Light that returns from the lower layer, R - r, is added as diffuse light. The light that passes beside
/// the ply, r_d, hits only the lower layer and is diffuse after it.
///
/// Let E_f be the energy that the ply scatters forward, and r_2, t_2 the fractions of the layer below at the
/// first hit. The diffuse parts are `(E_f T/t + r_d t_2) |y|/pi` below and `(E_f (R - r)/t + r_d r_2) y/pi`
/// above, where y is the component of the outgoing direction towards the light in the ply frame. At sigma = 0
/// energy is conserved.
///
/// The methods take the ply that [`TwoLayered::new`] was called with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TwoLayered<const N: usize> {
    /// Energies of the diffuse light above (y > 0) and below, one for each absorption.
    above: [f32; N],
    below: [f32; N],
    albedo: [f32; N],
    /// Probability of sampling a diffuse direction, and of an upward one among those.
    diffuse: f32,
    up: f32,
    /// Probability that the ply's lobes alone yield a direction: [`super::single_layer::hit_chance`].
    hit: f32,
}

/// f_refl + f_high, and the density.
fn both<const N: usize>(light: &LobeLight<N>) -> ([f32; N], f32) {
    (std::array::from_fn(|k| light.refl[k] + light.high[k]), light.pdf)
}

impl<const N: usize> TwoLayered<N> {
    pub(crate) fn new(upper: &SingleLayer<'_, impl Lobes<N>, N>, below: &Layer<N>) -> Option<TwoLayered<N>> {
        let PlyQuery { theta_i, h_um, sigma_per_um, .. } = upper.query;
        let (scattered, r_d) = upper.lit().albedo_r_d();
        let (layer, mut forward) = layer_and_forward(upper.model.layer_tables()?, theta_i, h_um, r_d, &sigma_per_um);
        let below = &below.conserved();
        let two = layer.over(below);
        for k in 0..N {
            forward[k] = forward[k].min(scattered[k]);
        }
        let share = |part: f32, k: usize| {
            if layer.transmitted[k] > 0.0 { forward[k] * part / layer.transmitted[k] } else { 0.0 }
        };
        let down: [f32; N] = std::array::from_fn(|k| share(two.transmitted[k], k) + r_d * below.transmitted[k]);
        let up: [f32; N] = std::array::from_fn(|k| {
            share(two.reflected[k] - layer.reflected[k], k).max(0.0) + r_d * below.reflected[k]
        });
        let mean = |x: &[f32; N]| x.iter().sum::<f32>() / N.max(1) as f32;
        let back = (mean(&scattered) - mean(&forward)).max(0.0);
        let both = mean(&up) + mean(&down);
        let ratio = |a: f32, b: f32| if b > 0.0 { a / b } else { 0.0 };
        let hit = ratio(mean(&scattered), mean(&scattered) + r_d);
        Some(TwoLayered {
            above: up,
            below: down,
            albedo: std::array::from_fn(|k| scattered[k] - forward[k] + down[k] + up[k]),
            diffuse: if hit > 1e-6 { ratio(both, both + back) } else { 1.0 },
            up: ratio(mean(&up), both),
            hit,
        })
    }

    /// Density of the diffuse directions [1/sr].
    fn diffuse_pdf(&self, y: f32) -> f32 {
        (if y >= 0.0 { self.up } else { 1.0 - self.up }) * y.abs().min(1.0) / PI
    }

    /// f and the density in a direction, from the values of the ply's lobes there.
    fn over(&self, wo: [f32; 3], (lobes, lobes_pdf): ([f32; N], f32)) -> ([f32; N], f32) {
        let y = wo[1].clamp(-1.0, 1.0);
        let mut f = self.below.map(|e| e * -y / PI);
        if y > 0.0 {
            for k in 0..N {
                f[k] = lobes[k] + self.above[k] * y / PI;
            }
        }
        let mut pdf = self.diffuse * self.diffuse_pdf(wo[1]);
        if self.diffuse < 1.0 {
            pdf += (1.0 - self.diffuse) * lobes_pdf;
        }
        (f, pdf)
    }

    pub(crate) fn eval(&self, upper: &SingleLayer<'_, impl Lobes<N>, N>, wo: [f32; 3]) -> [f32; N] {
        let y = if is_direction(wo) { wo[1].clamp(-1.0, 1.0) } else { 0.0 };
        if y > 0.0 {
            let lobes = upper.lit().eval(wo);
            std::array::from_fn(|k| lobes[k] + self.above[k] * y / PI)
        } else {
            self.below.map(|e| e * -y / PI)
        }
    }

    pub(crate) fn pdf(&self, upper: &SingleLayer<'_, impl Lobes<N>, N>, wo: [f32; 3]) -> f32 {
        if !is_direction(wo) {
            return 0.0;
        }
        let mut pdf = self.diffuse * self.diffuse_pdf(wo[1]);
        if self.diffuse < 1.0 {
            pdf += (1.0 - self.diffuse) * upper.lit().pdf(self.hit, wo);
        }
        pdf
    }

    pub(crate) fn eval_pdf(&self, upper: &SingleLayer<'_, impl Lobes<N>, N>, wo: [f32; 3]) -> ([f32; N], f32) {
        if is_direction(wo) {
            self.over(wo, both(&upper.lit().eval_pdf(self.hit, wo)))
        } else {
            (self.eval(upper, wo), 0.0)
        }
    }

    /// Samples a direction. If a lobe yields a forward direction, it is used with the diffuse value there;
    /// the density covers both sampling strategies.
    pub(crate) fn sample(&self, upper: &SingleLayer<'_, impl Lobes<N>, N>, u: [f32; 3]) -> BsdfSample<N> {
        // The numbers are clamped below 1, and NaN becomes 0.
        let u = u.map(crate::math::clamp_unit);
        let (wo, lobes) = if u[0] < self.diffuse {
            let side = u[0] / self.diffuse;
            let (s, c, sign) = crate::math::simd::sin_cos_half_turns::<false>(2.0 * u[2]);
            let radius = crate::math::simd::signed(u[1].sqrt(), sign);
            let y = (1.0 - u[1]).max(0.0).sqrt();
            let wo = [radius * c, if side < self.up { y } else { -y }, radius * s];
            (wo, both(&upper.lit().eval_pdf(self.hit, wo)))
        } else {
            let first = (u[0] - self.diffuse) / (1.0 - self.diffuse);
            match upper.lit().sample(self.hit, [first, u[1], u[2]]) {
                Some((wo, light)) => (wo, both(&light)),
                None => return BsdfSample::Absorbed,
            }
        };
        let (f, pdf) = self.over(wo, lobes);
        BsdfSample::scattered(wo, f, pdf)
    }

    pub(crate) fn albedo(&self) -> [f32; N] {
        self.albedo
    }

    pub(crate) fn outcomes(&self) -> Outcomes {
        Outcomes::SCATTERED
    }
}
