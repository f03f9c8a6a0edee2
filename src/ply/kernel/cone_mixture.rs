//! Mixtures of cone lobes ([`crate::ply::cone`]) instead of round ones: the weights of a [`Mixture`] with
//! other shapes.

use super::cone_lobe::{ConeShapes, azimuth, incidence};
use super::energy::{Core, DrawnBy, Energies, sum};
use super::grid_cell::mirrored;
use super::layout::Tables;
use super::lobe::unit;
use super::mixture::{Mixture, Params, Values, weights};
use crate::math::simd::{fma, max, min};
use crate::ply::Queries;
use crate::ply::slit::{Diffracted, SlitSample};

/// The lobes at an incidence.
pub(in crate::ply) struct ConeMixture<const H: usize, const R: usize, const L: usize, const J: usize, const N: usize> {
    weights: Mixture<H, R, L, J, N>,
    shapes: ConeShapes<L>,
    theta_i: f32,
}

impl<const H: usize, const R: usize, const L: usize, const J: usize, const N: usize> ConeMixture<H, R, L, J, N> {
    /// `None` where the beam misses.
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool>(
        tables: &Tables<H, R, J>,
        theta_i: f32,
        h_um: f32,
        sigma: &[f32; N],
    ) -> Option<Self> {
        let (mut weights, params): (_, Params<L>) = weights::<FMA, H, R, L, J, N>(tables, theta_i, h_um, sigma)?;
        weights.scale::<FMA>();
        let bounds = [tables.bandwidth, tables.bandwidth_across];
        let shapes = ConeShapes::new::<FMA>(&params, &weights.energy, theta_i, bounds);
        Some(ConeMixture { weights, shapes, theta_i })
    }

    /// f_refl and f_high per sigma [1/sr].
    #[inline(always)]
    pub(in crate::ply) fn eval<const FMA: bool>(&self, wo: [f32; 3]) -> (f32, [f32; N]) {
        self.weights.weigh::<FMA>(&values::<FMA, L>(&self.shapes, self.weights.flip, wo))
    }

    /// f_refl and f_high per sigma and the density of sampling `wo` [1/sr], including missed light. `mean` is
    /// from [`Mixture::mean`].
    #[inline(always)]
    pub(in crate::ply) fn eval_pdf<const FMA: bool>(&self, mean: &[f32; L], wo: [f32; 3]) -> Values<N> {
        let value = values::<FMA, L>(&self.shapes, self.weights.flip, wo);
        let mut density = 0.0;
        for i in 0..L {
            density = fma::<FMA>(value[i], mean[i], density);
        }
        let (refl, high) = self.weights.weigh::<FMA>(&value);
        let total = self.weights.total();
        (refl, high, if total > 0.0 { density / total } else { 0.0 })
    }

    #[inline(always)]
    pub(in crate::ply) fn mean<const FMA: bool>(&self) -> [f32; L] {
        self.weights.mean::<FMA>()
    }

    #[inline(always)]
    pub(in crate::ply) fn core(&self, (refl, high, pdf): Values<N>) -> Core<N> {
        self.weights.core(refl, high, pdf)
    }

    /// A direction and [`ConeMixture::eval_pdf`] there; no direction for missed light.
    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        let u = unit(u);
        let total = self.weights.total();
        let left = u[0] * total;
        if left < total - self.weights.energies.r_d {
            let mean = self.mean::<FMA>();
            if let Some(wo) = self.sample_lobe::<FMA>(&mean, left, u) {
                return (Some(wo), self.core(self.eval_pdf::<FMA>(&mean, wo)));
            }
        }
        (None, self.weights.core(0.0, [0.0; N], 0.0))
    }

    #[inline(always)]
    fn sample_lobe<const FMA: bool>(&self, mean: &[f32; L], left: f32, u: [f32; 3]) -> Option<[f32; 3]> {
        let i = self.weights.choose::<FMA>(mean, left)?;
        Some(mirrored(self.weights.flip, self.shapes.draw::<FMA>(i, u[1], u[2])))
    }

    /// Removes a slit's share from each lobe, as for round ones: `share` times the cosine between its middle
    /// and the forward direction.
    #[inline(always)]
    fn take<const FMA: bool>(&mut self, mean: &[f32; L], share: f32) -> ([f32; N], f32) {
        let at = incidence::<FMA>(self.theta_i);
        let (mut taken, mut sum) = ([0.0; L], 0.0);
        for i in 0..H {
            let part = share * min(max(self.shapes.forward::<FMA>(i, at), 0.0), 1.0);
            taken[i] = self.weights.energy[i] * part;
            self.weights.energy[i] -= taken[i];
            self.shapes.amplitude[i] *= 1.0 - part;
            sum = fma::<FMA>(taken[i], mean[i], sum);
        }
        (self.weights.weigh::<FMA>(&taken).1, sum)
    }

    /// [`ConeMixture::eval_pdf`] less the slit's share, and that share.
    #[inline(always)]
    pub(in crate::ply) fn slit_eval_pdf<const FMA: bool>(
        &mut self,
        share: f32,
        wo: [f32; 3],
    ) -> (Core<N>, Diffracted<N>) {
        let mean = self.mean::<FMA>();
        let (energy, sum) = self.take::<FMA>(&mean, share);
        let total = self.weights.total();
        let chance = if total > 0.0 { sum / total } else { 0.0 };
        (self.core(self.eval_pdf::<FMA>(&mean, wo)), Diffracted { energy, chance })
    }

    /// Kind of a sample when a slit diffracts its share.
    #[inline(always)]
    pub(in crate::ply) fn slit_sample<const FMA: bool>(&mut self, share: f32, u: [f32; 3]) -> SlitSample {
        let u = unit(u);
        let (total, missed) = (self.weights.total(), self.weights.energies.r_d);
        let left = u[0] * total;
        if left >= total - missed {
            let part = (left - (total - missed)) / missed;
            return SlitSample::Missed(if missed > 0.0 { part } else { 0.0 });
        }
        let mean = self.mean::<FMA>();
        let (_, sum) = self.take::<FMA>(&mean, share);
        let kept = total - missed - sum;
        if left >= kept && sum > 0.0 {
            return SlitSample::Slit((left - kept) / sum);
        }
        self.sample_lobe::<FMA>(&mean, left, u).map_or(SlitSample::None, SlitSample::Lobe)
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

/// f at `queries`; 0 beyond their shortest array.
#[inline(always)]
pub(in crate::ply) fn eval_batch<
    const FMA: bool,
    const H: usize,
    const R: usize,
    const L: usize,
    const J: usize,
    const N: usize,
>(
    tables: &Tables<H, R, J>,
    queries: &Queries<'_, N>,
    f: &mut [[f32; N]],
) {
    f.fill([0.0; N]);
    let at = |i: usize| {
        let (theta_i, h_um, sigma, wo) = queries.get(i)?;
        Some((ConeMixture::<H, R, L, J, N>::new::<FMA>(tables, theta_i, h_um, &sigma), wo))
    };
    let mut kept = None;
    let one = queries.one_incidence(f.len());
    for (i, f) in f.iter_mut().enumerate() {
        let Some((mixture, wo)) = (match (&kept, one) {
            (Some(mixture), true) => queries.get(i).map(|(_, _, _, wo)| (mixture, wo)),
            _ => at(i).map(|(mixture, wo)| (&*kept.insert(mixture), wo)),
        }) else {
            return;
        };
        if let Some(mixture) = mixture {
            let (refl, high) = mixture.eval::<FMA>(wo);
            *f = sum(refl, high);
        }
    }
}

/// Prepared cone lobes at one incidence, for many directions: H high-order ones first, then those of f_refl.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedCones<const H: usize, const L: usize, const N: usize> {
    shapes: ConeShapes<L>,
    /// Factor from a value to its density: the lobe's mean over the absorptions, over the total energy.
    density: [f32; L],
    /// Running sum of the mean energies, and the total; infinite in empty lanes.
    sums: [f32; L],
    sum: f32,
    /// By high-order lobe: the fraction that absorption leaves, scaled to the simulated energy.
    weight: [[f32; N]; H],
    scale_refl: f32,
    flip: bool,
    total: f32,
    pub(in crate::ply) energies: Energies<N>,
}

impl<const H: usize, const L: usize, const N: usize> PreparedCones<H, L, N> {
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool, const R: usize, const J: usize>(
        m: &ConeMixture<H, R, L, J, N>,
        drawn_by: DrawnBy,
    ) -> Self {
        let (x, mut density, weight) = (&m.weights, m.mean::<FMA>(), m.weights.left::<FMA>());
        if drawn_by == DrawnBy::First {
            for l in 0..H {
                density[l] = weight[l].first().copied().unwrap_or(0.0);
            }
        }
        let (mut sums, mut sum) = ([f32::INFINITY; L], 0.0);
        for i in 0..H + R {
            sum = fma::<FMA>(x.energy[i], density[i], sum);
            sums[i] = sum;
        }
        let total = drawn_by.total(&x.energies);
        let per_total = if total > 0.0 { 1.0 / total } else { 0.0 };
        for density in &mut density {
            *density *= per_total;
        }
        let scale_refl = x.scale_refl;
        PreparedCones {
            shapes: m.shapes,
            density,
            sums,
            sum,
            weight,
            scale_refl,
            flip: x.flip,
            total,
            energies: x.energies,
        }
    }

    #[inline(always)]
    pub(in crate::ply) fn eval_pdf<const FMA: bool>(&self, wo: [f32; 3]) -> Core<N> {
        let value = values::<FMA, L>(&self.shapes, self.flip, wo);
        let (mut high, mut refl, mut pdf) = ([0.0; N], 0.0, 0.0);
        for l in 0..H {
            for k in 0..N {
                high[k] = fma::<FMA>(value[l], self.weight[l][k], high[k]);
            }
        }
        for i in 0..L {
            pdf = fma::<FMA>(value[i], self.density[i], pdf);
        }
        for value in &value[H..] {
            refl += value;
        }
        self.core(refl * self.scale_refl, high, pdf)
    }

    #[inline(always)]
    fn core(&self, refl: f32, high: [f32; N], pdf: f32) -> Core<N> {
        let r_d = self.energies.r_d;
        Core { refl, high, pdf, r_d, missed: if self.total > 0.0 { r_d / self.total } else { 0.0 } }
    }

    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        let u = unit(u);
        let left = u[0] * self.total;
        if left >= self.total - self.energies.r_d || self.sum <= 0.0 {
            return (None, self.core(0.0, [0.0; N], 0.0));
        }
        // As in `Mixture::choose`.
        let left = min(left, self.sum * (1.0 - f32::EPSILON));
        let passed = self.sums.iter().map(|x| u32::from(*x <= left)).sum::<u32>();
        let i = passed as usize & (L - 1);
        let wo = mirrored(self.flip, self.shapes.draw::<FMA>(i, u[1], u[2]));
        (Some(wo), self.eval_pdf::<FMA>(wo))
    }
}
