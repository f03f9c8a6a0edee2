//! Mixtures of cone lobes ([`crate::ply::cone`]) instead of round ones. The weights are those of a
//! [`Mixture`]; the shapes differ.

use super::absorption::{PathBlock, attenuate};
use super::cone_lobe::{ConeShapes, azimuth, incidence};
use super::energy::Rest;
use super::grid_cell::mirrored;
use super::layout::Tables;
use super::lobe::unit;
use super::mixture::{Drawing, Mixture, Params, weights};
use super::prepared::Choice;
use crate::math::simd::{fma, max, min};
use crate::ply::kernel::slit::{SlitSample, SlitValues, kind};
use crate::ply::queries::Channels;

/// The cone lobes of a model at one incidence.
pub(in crate::ply) struct ConeMixture<'a, const H: usize, const R: usize, const L: usize, const J: usize> {
    pub(in crate::ply) weights: Mixture<'a, H, R, L, J>,
    shapes: ConeShapes<L>,
    theta_i: f32,
}

impl<'a, const H: usize, const R: usize, const L: usize, const J: usize> ConeMixture<'a, H, R, L, J> {
    /// Interpolates the lobes; `None` if the beam misses.
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

    /// Writes f_high for each absorption [1/sr] to `high`, and returns the other values. The density of
    /// sampling `wo` is computed only if `PDF`.
    #[inline(always)]
    pub(in crate::ply) fn eval<const FMA: bool, const PDF: bool>(
        &self,
        sigma: (&[f32], Option<&PathBlock<J>>),
        wo: [f32; 3],
        high: &mut [f32],
    ) -> Rest {
        // The value of a cone lobe is its own density.
        let values = values::<FMA, L>(&self.shapes, self.weights.flip, wo);
        self.weights.absorb::<FMA, PDF>((&values, &values), sigma, high)
    }

    /// Samples a direction and evaluates [`ConeMixture::eval`] there; the direction is `None` for missed
    /// light.
    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(
        &self,
        sigma: &[f32],
        u: [f32; 3],
        high: &mut [f32],
    ) -> (Option<[f32; 3]>, Rest) {
        let u = unit(u);
        let mut block = PathBlock::none();
        let drawing = self.weights.drawing(sigma, &mut block);
        let target = u[0] * drawing.total;
        if target < drawing.total - self.weights.r_d
            && let Some(wo) = self.sample_lobe::<FMA>(&drawing.mean, target, u)
        {
            return (Some(wo), self.eval::<FMA, true>((sigma, Some(&block)), wo, high));
        }
        high.fill(0.0);
        (None, self.weights.dark(&drawing))
    }

    #[inline(always)]
    fn sample_lobe<const FMA: bool>(&self, mean: &[f32; L], target: f32, u: [f32; 3]) -> Option<[f32; 3]> {
        let i = self.weights.choose::<FMA>(mean, target)?;
        Some(mirrored(self.weights.flip, self.shapes.draw::<FMA>(i, u[1], u[2])))
    }

    /// Removes a slit's share from each lobe, as for round lobes: `share` times the cosine between the lobe's
    /// center and the forward direction. Returns the removed energies by lane.
    #[inline(always)]
    fn remove_share<const FMA: bool>(&mut self, share: f32) -> [f32; L] {
        let at = incidence::<FMA>(self.theta_i);
        let mut diffracted = [0.0; L];
        for i in 0..H {
            let part = share * min(max(self.shapes.forward::<FMA>(i, at), 0.0), 1.0);
            diffracted[i] = self.weights.energy[i] * part;
            self.weights.energy[i] -= diffracted[i];
            self.shapes.amplitude[i] *= 1.0 - part;
        }
        diffracted
    }

    /// [`ConeMixture::eval`] without the slit's share, and the probability that a sample belongs to that
    /// share.
    #[inline(always)]
    pub(super) fn slit_eval_pdf<const FMA: bool>(
        &mut self,
        share: f32,
        sigma: &[f32],
        wo: [f32; 3],
        values: SlitValues<'_>,
    ) -> (Rest, f32) {
        let diffracted = self.remove_share::<FMA>(share);
        let chance = self.weights.diffracted::<FMA>(&diffracted, sigma, values.diffracted);
        (self.eval::<FMA, true>((sigma, None), wo, values.high), chance)
    }

    /// Samples the kind of light, if a slit diffracts its share.
    #[inline(always)]
    pub(super) fn slit_sample<const FMA: bool>(&mut self, share: f32, sigma: &[f32], u: [f32; 3]) -> SlitSample {
        let u = unit(u);
        let Drawing { mean, total } = self.weights.drawing(sigma, &mut PathBlock::none());
        let (diffracted, mut sum) = (self.remove_share::<FMA>(share), 0.0);
        for i in 0..H {
            sum = fma::<FMA>(diffracted[i], mean[i], sum);
        }
        match kind(u[0], total, self.weights.r_d, sum) {
            Err(kind) => kind,
            Ok(target) => self.sample_lobe::<FMA>(&mean, target, u).map_or(SlitSample::None, SlitSample::Lobe),
        }
    }
}

/// Values of the lobes before absorption and before the scale to the simulated energy.
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

/// f at `queries`, `[query][absorption]` flat; 0 beyond their shortest array.
#[inline(always)]
pub(in crate::ply) fn eval_batch<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    queries: &Channels<'_>,
    f: &mut [f32],
) {
    f.fill(0.0);
    let mut cached = None;
    let one = queries.one_incidence(f.len() / queries.count.max(1));
    for (i, f) in f.chunks_exact_mut(queries.count.max(1)).enumerate() {
        let Some((theta_i, h_um, sigma, wo)) = queries.get(i) else { return };
        if cached.is_none() || !one {
            cached = Some(ConeMixture::<H, R, L, J>::new::<FMA>(tables, theta_i, h_um, sigma));
        }
        if let Some(Some(mixture)) = &cached {
            let refl = mixture.eval::<FMA, false>((sigma, None), wo, f).refl;
            f.iter_mut().for_each(|f| *f += refl);
        }
    }
}

/// Prepared cone lobes at one incidence, for many directions: H high-order lobes first, then those of f_refl.
#[derive(Clone, Copy, Debug)]
pub(in crate::ply) struct PreparedCones<const H: usize, const L: usize> {
    shapes: ConeShapes<L>,
    /// Factor from a lobe's value to its density: its mean over the absorptions, divided by the total energy.
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
    pub(in crate::ply) fn eval_pdf<const FMA: bool>(
        &self,
        transmittance: &[f32],
        wo: [f32; 3],
        high: &mut [f32],
    ) -> Rest {
        let value = values::<FMA, L>(&self.shapes, self.flip, wo);
        let (mut refl, mut pdf) = (0.0, 0.0);
        attenuate::<FMA, H>(value.first_chunk().unwrap_or(&[0.0; H]), transmittance, high);
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
        transmittance: &[f32],
        u: [f32; 3],
        high: &mut [f32],
    ) -> (Option<[f32; 3]>, Rest) {
        let u = unit(u);
        let Some(i) = self.choice.lane(u[0]) else {
            high.fill(0.0);
            return (None, self.choice.rest(0.0, 0.0));
        };
        let wo = mirrored(self.flip, self.shapes.draw::<FMA>(i, u[1], u[2]));
        (Some(wo), self.eval_pdf::<FMA>(transmittance, wo, high))
    }
}
