//! Mixtures of cone lobes ([`crate::ply::cone`]) instead of round ones: the weights of a [`Mixture`] with
//! other shapes.

use super::absorption::{Block, leave};
use super::cone_lobe::{ConeShapes, azimuth, incidence};
use super::energy::Rest;
use super::grid_cell::mirrored;
use super::layout::Tables;
use super::lobe::unit;
use super::mixture::{Drawing, Mixture, Params, weights};
use super::prepared::Choice;
use crate::math::simd::{fma, max, min};
use crate::ply::queries::Channels;
use crate::ply::slit::{SlitSample, SlitValues, kind};

/// The lobes at an incidence.
pub(in crate::ply) struct ConeMixture<'a, const H: usize, const R: usize, const L: usize, const J: usize> {
    pub(in crate::ply) weights: Mixture<'a, H, R, L, J>,
    shapes: ConeShapes<L>,
    theta_i: f32,
}

impl<'a, const H: usize, const R: usize, const L: usize, const J: usize> ConeMixture<'a, H, R, L, J> {
    /// `None` where the beam misses.
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool>(
        tables: &'a Tables<H, R, J>,
        theta_i: f32,
        h_um: f32,
        sigma: &[f32],
    ) -> Option<Self> {
        let (mut weights, params): (_, Params<L>) = weights::<FMA, H, R, L, J>(tables, theta_i, h_um, sigma)?;
        weights.scale::<FMA>();
        let bounds = [tables.bandwidth, tables.bandwidth_across];
        let shapes = ConeShapes::new::<FMA>(&params, &weights.energy, theta_i, bounds);
        Some(ConeMixture { weights, shapes, theta_i })
    }

    /// f_high per sigma in `high` [1/sr]; the rest, with the density of sampling `wo` only with `PDF`.
    #[inline(always)]
    pub(in crate::ply) fn eval<const FMA: bool, const PDF: bool>(
        &self,
        sigma: (&[f32], Option<&Block<J>>),
        wo: [f32; 3],
        high: &mut [f32],
    ) -> Rest {
        // A cone is its own density.
        let values = values::<FMA, L>(&self.shapes, self.weights.flip, wo);
        self.weights.absorb::<FMA, PDF>((&values, &values), sigma, high)
    }

    /// A direction and [`ConeMixture::eval`] there; no direction for missed light.
    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(
        &self,
        sigma: &[f32],
        u: [f32; 3],
        high: &mut [f32],
    ) -> (Option<[f32; 3]>, Rest) {
        let u = unit(u);
        let mut block = Block::none();
        let drawing = self.weights.drawing(sigma, &mut block);
        let left = u[0] * drawing.total;
        if left < drawing.total - self.weights.r_d
            && let Some(wo) = self.sample_lobe::<FMA>(&drawing.mean, left, u)
        {
            return (Some(wo), self.eval::<FMA, true>((sigma, Some(&block)), wo, high));
        }
        high.fill(0.0);
        (None, self.weights.dark(&drawing))
    }

    #[inline(always)]
    fn sample_lobe<const FMA: bool>(&self, mean: &[f32; L], left: f32, u: [f32; 3]) -> Option<[f32; 3]> {
        let i = self.weights.choose::<FMA>(mean, left)?;
        Some(mirrored(self.weights.flip, self.shapes.draw::<FMA>(i, u[1], u[2])))
    }

    /// Removes a slit's share from each lobe, as for round ones: `share` times the cosine between its middle
    /// and the forward direction. Returns what is taken by lane.
    #[inline(always)]
    fn take<const FMA: bool>(&mut self, share: f32) -> [f32; L] {
        let at = incidence::<FMA>(self.theta_i);
        let mut taken = [0.0; L];
        for i in 0..H {
            let part = share * min(max(self.shapes.forward::<FMA>(i, at), 0.0), 1.0);
            taken[i] = self.weights.energy[i] * part;
            self.weights.energy[i] -= taken[i];
            self.shapes.amplitude[i] *= 1.0 - part;
        }
        taken
    }

    /// [`ConeMixture::eval`] less the slit's share, and the share's chance.
    #[inline(always)]
    pub(in crate::ply) fn slit_eval_pdf<const FMA: bool>(
        &mut self,
        share: f32,
        sigma: &[f32],
        wo: [f32; 3],
        values: SlitValues<'_>,
    ) -> (Rest, f32) {
        let taken = self.take::<FMA>(share);
        let chance = self.weights.diffracted::<FMA>(&taken, sigma, values.taken);
        (self.eval::<FMA, true>((sigma, None), wo, values.high), chance)
    }

    /// Kind of a sample when a slit diffracts its share.
    #[inline(always)]
    pub(in crate::ply) fn slit_sample<const FMA: bool>(
        &mut self,
        share: f32,
        sigma: &[f32],
        u: [f32; 3],
    ) -> SlitSample {
        let u = unit(u);
        let Drawing { mean, total } = self.weights.drawing(sigma, &mut Block::none());
        let (taken, mut sum) = (self.take::<FMA>(share), 0.0);
        for i in 0..H {
            sum = fma::<FMA>(taken[i], mean[i], sum);
        }
        match kind(u[0], total, self.weights.r_d, sum) {
            Err(kind) => kind,
            Ok(left) => self.sample_lobe::<FMA>(&mean, left, u).map_or(SlitSample::None, SlitSample::Lobe),
        }
    }
}

/// Values of the lobes before absorption, not scaled.
#[inline(always)]
fn values<const FMA: bool, const L: usize>(x: &ConeShapes<L>, flip: bool, wo: [f32; 3]) -> [f32; L] {
    let v = mirrored(flip, wo);
    let mut value = [0.0; L];
    if let Some(phi) = azimuth::<FMA>(v) {
        for i in 0..L {
            value[i] = x.shape::<FMA>(i, phi, v[2]) * x.amplitude[i];
        }
    }
    value
}

/// f at `queries`, by query and absorption; 0 beyond their shortest array.
#[inline(always)]
pub(in crate::ply) fn eval_batch<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    queries: &Channels<'_>,
    f: &mut [f32],
) {
    f.fill(0.0);
    let mut kept = None;
    let one = queries.one_incidence(f.len() / queries.count.max(1));
    for (i, f) in f.chunks_exact_mut(queries.count.max(1)).enumerate() {
        let Some((theta_i, h_um, sigma, wo)) = queries.get(i) else { return };
        if kept.is_none() || !one {
            kept = Some(ConeMixture::<H, R, L, J>::new::<FMA>(tables, theta_i, h_um, sigma));
        }
        if let Some(Some(mixture)) = &kept {
            let refl = mixture.eval::<FMA, false>((sigma, None), wo, f).refl;
            f.iter_mut().for_each(|f| *f += refl);
        }
    }
}

/// Prepared cone lobes at one incidence, for many directions: H high-order ones first, then those of f_refl.
#[derive(Clone, Copy, Debug)]
pub(in crate::ply) struct PreparedCones<const H: usize, const L: usize> {
    shapes: ConeShapes<L>,
    /// Factor from a value to its density: the lobe's mean over the absorptions, over the total energy.
    density: [f32; L],
    choice: Choice<L>,
    scale_refl: f32,
    flip: bool,
}

impl<const H: usize, const L: usize> PreparedCones<H, L> {
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool, const R: usize, const J: usize>(
        m: &ConeMixture<'_, H, R, L, J>,
        drawing: &Drawing<L>,
    ) -> Self {
        let (x, mut density) = (&m.weights, drawing.mean);
        let choice = Choice::new::<FMA>(&x.energy, &density, H + R, drawing.total, x.r_d);
        for density in &mut density {
            *density *= choice.per_total;
        }
        PreparedCones { shapes: m.shapes, density, choice, scale_refl: x.scale_refl, flip: x.flip }
    }

    #[inline(always)]
    pub(in crate::ply) fn eval_pdf<const FMA: bool>(&self, left: &[f32], wo: [f32; 3], high: &mut [f32]) -> Rest {
        let value = values::<FMA, L>(&self.shapes, self.flip, wo);
        let (mut refl, mut pdf) = (0.0, 0.0);
        leave::<FMA, H>(value.first_chunk().unwrap_or(&[0.0; H]), left, high);
        for i in 0..L {
            pdf = fma::<FMA>(value[i], self.density[i], pdf);
        }
        for value in &value[H..] {
            refl += value;
        }
        self.choice.rest(refl * self.scale_refl, pdf)
    }

    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(
        &self,
        left: &[f32],
        u: [f32; 3],
        high: &mut [f32],
    ) -> (Option<[f32; 3]>, Rest) {
        let u = unit(u);
        let Some(i) = self.choice.lane(u[0]) else {
            high.fill(0.0);
            return (None, self.choice.rest(0.0, 0.0));
        };
        let wo = mirrored(self.flip, self.shapes.draw::<FMA>(i, u[1], u[2]));
        (Some(wo), self.eval_pdf::<FMA>(left, wo, high))
    }
}
