//! The share of the high-order lobes that a slit diffracts (`src/gap/slit.rs`), and sampling of the rest.

use super::kernel::energy::Core;
use super::kernel::lobe::{sin_cos, unit};
use super::kernel::mixture::{Mixture, Params};
use crate::math::simd::{fma, max, min};
use std::f32::consts::FRAC_1_PI;

/// Share of f_high that a slit diffracts: energy, and the chance that a sample belongs to it.
#[derive(Clone, Copy)]
pub(super) struct Diffracted<const N: usize> {
    pub(super) energy: [f32; N],
    pub(super) chance: f32,
}

/// Kind of a sample; slit light and missed light carry the remainder of the number that chose the kind.
#[derive(Clone, Copy)]
pub(super) enum SlitSample {
    Lobe([f32; 3]),
    Slit(f32),
    Missed(f32),
    None,
}

impl<const H: usize, const R: usize, const L: usize, const J: usize, const N: usize> Mixture<H, R, L, J, N> {
    /// Removes from each high-order lobe the share that a slit diffracts (`src/gap/slit.rs`): `share` times
    /// the cosine between the lobe's axis and the forward direction, nothing for a lobe that points back.
    /// Returns the diffracted energy, and its mean over the absorptions.
    #[inline(always)]
    fn take<const FMA: bool>(
        &mut self,
        params: &Params<L>,
        mean: &[f32; L],
        (share, theta_i): (f32, f32),
    ) -> ([f32; N], f32) {
        let (s_i, c_i) = sin_cos::<FMA>(theta_i.abs() * FRAC_1_PI);
        let (mut taken, mut sum) = ([0.0; L], 0.0);
        for i in 0..H {
            let (s, c) = sin_cos::<FMA>(params[0][i]);
            let (sp, _) = sin_cos::<FMA>(params[1][i]);
            let forward = fma::<FMA>(-c_i * c, sp, -s_i * s);
            taken[i] = self.energy[i] * (share * min(max(forward, 0.0), 1.0));
            self.energy[i] -= taken[i];
        }
        for i in 0..H {
            sum = fma::<FMA>(taken[i], mean[i], sum);
        }
        (self.weigh::<FMA>(&taken).1, sum)
    }

    /// [`Mixture::eval_pdf`] less the slit's share, and that share; `by` is from [`Mixture::take`]. For a
    /// mixture without shapes, not scaled.
    #[inline(always)]
    pub(super) fn slit_eval_pdf<const FMA: bool>(
        &mut self,
        params: &Params<L>,
        bandwidth: (f32, f32),
        by: (f32, f32),
        wo: [f32; 3],
    ) -> (Core<N>, Diffracted<N>) {
        self.scale::<FMA>();
        let mean = self.mean::<FMA>();
        let (energy, sum) = self.take::<FMA>(params, &mean, by);
        let x = self.shapes::<FMA>(params, bandwidth);
        let (refl, high, pdf) = self.eval_pdf::<FMA>(&x, &mean, wo);
        let total = self.total();
        (self.core(refl, high, pdf), Diffracted { energy, chance: if total > 0.0 { sum / total } else { 0.0 } })
    }

    /// Kind of a sample when a slit diffracts its share.
    #[inline(always)]
    pub(super) fn slit_sample<const FMA: bool>(
        &mut self,
        params: &Params<L>,
        bandwidth: (f32, f32),
        by: (f32, f32),
        u: [f32; 3],
    ) -> SlitSample {
        let u = unit(u);
        let (total, left) = (self.total(), u[0] * self.total());
        let missed = self.energies.r_d;
        if left >= total - missed {
            let part = (left - (total - missed)) / missed;
            return SlitSample::Missed(if missed > 0.0 { part } else { 0.0 });
        }
        self.scale::<FMA>();
        let mean = self.mean::<FMA>();
        let (_, sum) = self.take::<FMA>(params, &mean, by);
        let kept = total - missed - sum;
        if left >= kept && sum > 0.0 {
            return SlitSample::Slit((left - kept) / sum);
        }
        match self.sample_lobe::<FMA>(params, bandwidth, &mean, left, u) {
            Some((wo, _)) => SlitSample::Lobe(wo),
            None => SlitSample::None,
        }
    }
}
