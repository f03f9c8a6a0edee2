//! The share of the high-order lobes that a slit diffracts (`src/gap/slit.rs`), and sampling of the remaining
//! light (Yu 2025, 7.3).

use super::absorption::PathBlock;
use super::energy::Rest;
use super::lobe::{sin_cos, unit};
use super::mixture::{Drawing, Mixture, Params};
use crate::math::simd::{fma, max, min};
use std::f32::consts::FRAC_1_PI;

/// Kind of a sample. Slit light and missed light carry the rest of the random number that chose the kind.
#[derive(Clone, Copy)]
pub(in crate::ply) enum SlitSample {
    Lobe([f32; 3]),
    Slit(f32),
    Missed(f32),
    None,
}

/// Results for each absorption: f_high, and the energy of the slit's share of it.
pub(super) struct SlitValues<'a> {
    pub(super) high: &'a mut [f32],
    pub(super) diffracted: &'a mut [f32],
}

/// Chooses by a uniform number between lobes, slit light of energy `diffracted` and missed light. `Ok` holds
/// the position in the running sum of the lobes' energies.
#[inline(always)]
pub(super) fn kind(u: f32, total: f32, missed: f32, diffracted: f32) -> Result<f32, SlitSample> {
    let target = u * total;
    if target >= total - missed {
        let part = (target - (total - missed)) / missed;
        return Err(SlitSample::Missed(if missed > 0.0 { part } else { 0.0 }));
    }
    let lobes = total - missed - diffracted;
    if target >= lobes && diffracted > 0.0 {
        return Err(SlitSample::Slit((target - lobes) / diffracted));
    }
    Ok(target)
}

impl<const H: usize, const R: usize, const L: usize, const J: usize> Mixture<'_, H, R, L, J> {
    /// Removes from each high-order lobe the share that a slit diffracts (`src/gap/slit.rs`): `share` times
    /// the cosine between the lobe's axis and the forward direction, and nothing from a lobe that points
    /// backward. Returns the removed energies by lane. The mixture must be scaled and without shapes.
    #[inline(always)]
    fn remove_share<const FMA: bool>(&mut self, params: &Params<L>, (share, theta_i): (f32, f32)) -> [f32; L] {
        let (s_i, c_i) = sin_cos::<FMA>(theta_i.abs() * FRAC_1_PI);
        let mut diffracted = [0.0; L];
        for i in 0..H {
            let (s, c) = sin_cos::<FMA>(params[0][i]);
            let (sp, _) = sin_cos::<FMA>(params[1][i]);
            let forward = fma::<FMA>(-c_i * c, sp, -s_i * s);
            diffracted[i] = self.energy[i] * (share * min(max(forward, 0.0), 1.0));
            self.energy[i] -= diffracted[i];
        }
        diffracted
    }

    /// Writes the energy that a slit removed, for each absorption, and returns its probability among all
    /// light.
    #[inline(always)]
    pub(super) fn diffracted<const FMA: bool>(&self, diffracted: &[f32; L], sigma: &[f32], energy: &mut [f32]) -> f32 {
        let mut high = [0.0; L];
        high[..H].copy_from_slice(&diffracted[..H]);
        self.absorb::<FMA, true>((&high, &high), (sigma, None), energy).pdf
    }

    /// Values and density without the slit's share, and the probability of that share; `by` is the argument
    /// of [`Mixture::take`]. The mixture must be without shapes and not scaled yet.
    #[inline(always)]
    pub(super) fn slit_eval_pdf<const FMA: bool>(
        &mut self,
        params: &Params<L>,
        bandwidth: (f32, f32),
        by: (f32, f32),
        (sigma, wo): (&[f32], [f32; 3]),
        values: SlitValues<'_>,
    ) -> (Rest, f32) {
        self.scale::<FMA>();
        let diffracted = self.remove_share::<FMA>(params, by);
        let chance = self.diffracted::<FMA>(&diffracted, sigma, values.diffracted);
        let x = self.shapes::<FMA>(params, bandwidth);
        (self.eval::<FMA, true>(&x, (sigma, None), wo, values.high), chance)
    }

    /// Samples the kind of light, if a slit diffracts its share.
    #[inline(always)]
    pub(super) fn slit_sample<const FMA: bool>(
        &mut self,
        params: &Params<L>,
        bandwidth: (f32, f32),
        by: (f32, f32),
        sigma: &[f32],
        u: [f32; 3],
    ) -> SlitSample {
        let u = unit(u);
        self.scale::<FMA>();
        let Drawing { mean, total } = self.drawing(sigma, &mut PathBlock::none());
        let (diffracted, mut sum) = (self.remove_share::<FMA>(params, by), 0.0);
        for i in 0..H {
            sum = fma::<FMA>(diffracted[i], mean[i], sum);
        }
        match kind(u[0], total, self.r_d, sum) {
            Err(kind) => kind,
            Ok(target) => match self.sample_lobe::<FMA>(params, bandwidth, &mean, target, u) {
                Some((wo, _)) => SlitSample::Lobe(wo),
                None => SlitSample::None,
            },
        }
    }
}
