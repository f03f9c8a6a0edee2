//! The share of the high-order lobes that a slit diffracts (`src/gap/slit.rs`), and sampling of the rest.

use super::kernel::absorption::Block;
use super::kernel::energy::Rest;
use super::kernel::lobe::{sin_cos, unit};
use super::kernel::mixture::{Drawing, Mixture, Params};
use crate::math::simd::{fma, max, min};
use std::f32::consts::FRAC_1_PI;

/// Kind of a sample; slit light and missed light carry the remainder of the number that chose the kind.
#[derive(Clone, Copy)]
pub(super) enum SlitSample {
    Lobe([f32; 3]),
    Slit(f32),
    Missed(f32),
    None,
}

/// Results by absorption: f_high, and the energy of the slit's share of it.
pub(super) struct SlitValues<'a> {
    pub(super) high: &'a mut [f32],
    pub(super) taken: &'a mut [f32],
}

/// The kind of a sample among lobes, of which the slit took `taken`, and missed light, by a uniform number;
/// `Ok` has the part of the energy at which the lobes stand.
#[inline(always)]
pub(super) fn kind(u: f32, total: f32, missed: f32, taken: f32) -> Result<f32, SlitSample> {
    let left = u * total;
    if left >= total - missed {
        let part = (left - (total - missed)) / missed;
        return Err(SlitSample::Missed(if missed > 0.0 { part } else { 0.0 }));
    }
    let kept = total - missed - taken;
    if left >= kept && taken > 0.0 {
        return Err(SlitSample::Slit((left - kept) / taken));
    }
    Ok(left)
}

impl<const H: usize, const R: usize, const L: usize, const J: usize> Mixture<'_, H, R, L, J> {
    /// Removes from each high-order lobe the share that a slit diffracts (`src/gap/slit.rs`): `share` times
    /// the cosine between the lobe's axis and the forward direction, nothing for a lobe that points back.
    /// Returns what is taken by lane. For a scaled mixture without shapes.
    #[inline(always)]
    fn take<const FMA: bool>(&mut self, params: &Params<L>, (share, theta_i): (f32, f32)) -> [f32; L] {
        let (s_i, c_i) = sin_cos::<FMA>(theta_i.abs() * FRAC_1_PI);
        let mut taken = [0.0; L];
        for i in 0..H {
            let (s, c) = sin_cos::<FMA>(params[0][i]);
            let (sp, _) = sin_cos::<FMA>(params[1][i]);
            let forward = fma::<FMA>(-c_i * c, sp, -s_i * s);
            taken[i] = self.energy[i] * (share * min(max(forward, 0.0), 1.0));
            self.energy[i] -= taken[i];
        }
        taken
    }

    /// Energy of what a slit took by absorption, and its chance among all light.
    #[inline(always)]
    pub(super) fn diffracted<const FMA: bool>(&self, taken: &[f32; L], sigma: &[f32], energy: &mut [f32]) -> f32 {
        let mut high = [0.0; L];
        high[..H].copy_from_slice(&taken[..H]);
        self.absorb::<FMA, true>((&high, &high), (sigma, None), energy).pdf
    }

    /// Values and density less the slit's share, and the share's chance; `by` is from [`Mixture::take`]. For
    /// a mixture without shapes, not scaled.
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
        let taken = self.take::<FMA>(params, by);
        let chance = self.diffracted::<FMA>(&taken, sigma, values.taken);
        let x = self.shapes::<FMA>(params, bandwidth);
        (self.eval::<FMA, true>(&x, (sigma, None), wo, values.high), chance)
    }

    /// Kind of a sample when a slit diffracts its share.
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
        let Drawing { mean, total } = self.drawing(sigma, &mut Block::none());
        let (taken, mut sum) = (self.take::<FMA>(params, by), 0.0);
        for i in 0..H {
            sum = fma::<FMA>(taken[i], mean[i], sum);
        }
        match kind(u[0], total, self.r_d, sum) {
            Err(kind) => kind,
            Ok(left) => match self.sample_lobe::<FMA>(params, bandwidth, &mean, left, u) {
                Some((wo, _)) => SlitSample::Lobe(wo),
                None => SlitSample::None,
            },
        }
    }
}
