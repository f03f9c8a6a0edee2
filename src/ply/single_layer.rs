//! A ply without a second layer at a query: the lobes, cached or uncached, times the factors of relief and
//! speckle, plus edge light and slit light (Yu 2025, Eq. 8, 18 and 23).

use super::kernel::dispatch::Prepared;
use super::kernel::energy::Core;
use super::lobes::{LobeLight, Lobes, Uncached, WithPrepared};
use super::model::PlyModel;
use super::query::{PlyQuery, PlyTerms};
use super::terms::{Drawn, Terms};
use crate::bsdf::Outcomes;
use crate::gap::Slit;
use crate::ply::speckle::Speckle;
use crate::{Bsdf, BsdfSample};

/// A ply whose lobes and speckle patterns are computed at every call. Its state is small: a cloth holds
/// several.
#[derive(Clone, Copy, Debug)]
pub(crate) struct UncachedPly<'a, const N: usize> {
    pub(crate) model: &'a PlyModel,
    pub(crate) query: PlyQuery<'a, N>,
    pub(super) lobes: Uncached<'a, N>,
}

/// A ply at a query, with its lobes and its speckle patterns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SingleLayer<'a, L, const N: usize> {
    pub(super) model: &'a PlyModel,
    pub(super) query: PlyQuery<'a, N>,
    pub(super) lobes: L,
    pub(super) speckle: Option<Speckle<N>>,
}

impl<const N: usize> UncachedPly<'_, N> {
    /// Interpolates the lobes at the query into `prepared`, for [`UncachedPly::lit_by`].
    #[inline(always)]
    pub(crate) fn prepare_into(&self, prepared: &mut Prepared<N>) {
        self.lobes.prepare(prepared);
    }

    /// The lobes together with what [`UncachedPly::prepare_into`] prepared. If nothing was prepared, they are
    /// interpolated at every call.
    #[inline(always)]
    pub(crate) fn kept<'b>(&'b self, prepared: &'b Prepared<N>) -> WithPrepared<'b, N> {
        WithPrepared::new(&self.lobes, prepared)
    }

    /// The speckle patterns at the query, if it has some.
    #[inline(always)]
    pub(crate) fn speckle(&self) -> Option<Speckle<N>> {
        self.model.speckle(&self.query)
    }

    /// The light of the lobes alone, without edge light and speckle.
    #[inline(always)]
    pub(crate) fn lit(&self) -> Lit<'_, Uncached<'_, N>, N> {
        self.lit_by(&self.lobes, None)
    }

    /// The light of the lobes alone, without edge light, computed with other lobes of the same incidence.
    #[inline(always)]
    pub(crate) fn lit_by<'b, K: Lobes<N>>(&'b self, lobes: &'b K, speckle: Option<&'b Speckle<N>>) -> Lit<'b, K, N> {
        Lit { model: self.model, query: &self.query, lobes, speckle }
    }

    /// Light diffracted at the ply's edge for a beam that passes entirely, and the density with which
    /// [`UncachedPly::edge_sample`] samples it; `None` for a model without edge lobes.
    pub(crate) fn edge_eval_pdf(&self, w: [f32; 3]) -> Option<([f32; N], f32)> {
        let q = &self.query;
        Some(super::edge::eval_pdf(self.model.edge.as_ref()?, q.theta_i, q.h_um, &q.lambda_um, w))
    }

    /// Samples a direction of the edge light; `None` for a model without edge lobes or a query without
    /// wavelengths.
    pub(crate) fn edge_sample(&self, u: [f32; 3]) -> Option<[f32; 3]> {
        let q = &self.query;
        super::edge::sample(self.model.edge.as_ref()?, q.theta_i, q.h_um, &q.lambda_um, u)
    }
}

impl<L: Lobes<N>, const N: usize> SingleLayer<'_, L, N> {
    /// The light of the lobes alone, without edge light.
    #[inline(always)]
    pub(crate) fn lit(&self) -> Lit<'_, L, N> {
        Lit { model: self.model, query: &self.query, lobes: &self.lobes, speckle: self.speckle.as_ref() }
    }

    #[inline]
    pub(super) fn all(&self) -> Terms<'_, L, N> {
        Terms { model: self.model, query: &self.query, lobes: &self.lobes }
    }

    /// Sum of the terms, with the factors of the query's place.
    #[inline(always)]
    fn placed(&self, w: [f32; 3], terms: &PlyTerms<N>) -> [f32; N] {
        // Without a place the numbers stay in registers. Stored singly and read as pairs, they would wait.
        if self.query.place.is_none() { terms.sum_with(&([terms.refl; N], terms.high)) } else { self.there(w, terms) }
    }

    #[inline(never)]
    fn there(&self, w: [f32; 3], terms: &PlyTerms<N>) -> [f32; N] {
        terms.sum_with(&placed(self.model, &self.query, self.speckle.as_ref(), w, (terms.refl, terms.high)))
    }

    /// Whether edge lobes scatter the light that misses the fibers. If not, that light goes straight on.
    #[inline]
    fn has_edge(&self) -> bool {
        self.query.edge && self.model.has_edge()
    }
}

/// f_refl and f_high of the lobes times the factors of relief and of speckle at the query's place.
#[inline(always)]
fn placed<const N: usize>(
    model: &PlyModel,
    query: &PlyQuery<'_, N>,
    speckle: Option<&Speckle<N>>,
    w: [f32; 3],
    (refl, mut high): (f32, [f32; N]),
) -> ([f32; N], [f32; N]) {
    let mut refl = [refl; N];
    if let Some([of_refl, of_high]) = model.relief_at(query, w) {
        refl.iter_mut().for_each(|f| *f *= of_refl);
        high.iter_mut().for_each(|f| *f *= of_high);
    }
    if let Some(speckle) = speckle {
        let (of_refl, of_high) = speckle.factors(w);
        for k in 0..N {
            refl[k] *= of_refl[k];
            high[k] *= of_high[k];
        }
    }
    (refl, high)
}

/// Probability that a sample chooses the lobes rather than the missed light, in proportion to their energies.
#[inline(always)]
pub(crate) fn hit_chance<const N: usize>(albedo: &[f32; N], r_d: f32) -> f32 {
    let mean = albedo.iter().sum::<f32>() / N.max(1) as f32;
    if mean > 0.0 { mean / (mean + r_d) } else { 0.0 }
}

/// The light of a ply's lobes at a query, with relief and speckle, without edge light.
#[derive(Clone, Copy)]
pub(crate) struct Lit<'b, L, const N: usize> {
    model: &'b PlyModel,
    query: &'b PlyQuery<'b, N>,
    lobes: &'b L,
    speckle: Option<&'b Speckle<N>>,
}

impl<L: Lobes<N>, const N: usize> Lit<'_, L, N> {
    /// Energies of f_refl + f_high, one for each absorption, and r_d, the energy of the missed light.
    #[inline(always)]
    pub(crate) fn albedo_r_d(&self) -> ([f32; N], f32) {
        let energies = self.lobes.energies();
        (energies.albedo(), energies.r_d)
    }

    /// f_refl + f_high in a direction.
    pub(crate) fn eval(&self, w: [f32; 3]) -> [f32; N] {
        let light = match self.query.slit {
            None => self.light(w, 1.0, |lobes| lobes.eval(w)),
            Some(slit) => self.slit_light(slit, 1.0, w),
        };
        std::array::from_fn(|k| light.refl[k] + light.high[k])
    }

    /// f_refl, f_high and the density in a direction; `hit` is [`hit_chance`].
    #[inline(always)]
    pub(crate) fn eval_pdf(&self, hit: f32, w: [f32; 3]) -> LobeLight<N> {
        match self.query.slit {
            None => self.light(w, hit, |lobes| lobes.eval_pdf(w)),
            Some(slit) => self.slit_light(slit, hit, w),
        }
    }

    /// f_refl and f_high in a direction, without the density.
    #[inline(always)]
    pub(crate) fn eval_apart(&self, w: [f32; 3]) -> LobeLight<N> {
        match self.query.slit {
            None => self.light(w, 0.0, |lobes| lobes.eval(w)),
            Some(slit) => self.slit_light(slit, 1.0, w),
        }
    }

    /// The density alone.
    #[inline(always)]
    pub(crate) fn pdf(&self, hit: f32, w: [f32; 3]) -> f32 {
        if let Some(slit) = self.query.slit {
            return self.slit_light(slit, hit, w).pdf;
        }
        if hit > 0.0 { self.lobes.eval_pdf(w).pdf / hit } else { 0.0 }
    }

    /// Samples a direction from the lobes, and evaluates [`Lit::eval_pdf`] there.
    #[inline(always)]
    pub(crate) fn sample(&self, hit: f32, u: [f32; 3]) -> Option<([f32; 3], LobeLight<N>)> {
        // The numbers above `hit` would choose missed light.
        let u = [(u[0] * hit).min(hit * (1.0 - 1e-6)), u[1], u[2]];
        if let Some(slit) = self.query.slit {
            let w = self.terms().slit_direction(slit, u).ok().flatten()?;
            return Some((w, self.slit_light(slit, hit, w)));
        }
        let (w, core) = self.lobes.sample(u);
        let w = w?;
        Some((w, self.light(w, hit, |_| core)))
    }

    /// The values that `of` computes from the lobes, times the factors of the query's place.
    #[inline(always)]
    fn light(&self, w: [f32; 3], hit: f32, of: impl FnOnce(&L) -> Core<N>) -> LobeLight<N> {
        let Core { refl, high, pdf, .. } = of(self.lobes);
        let (refl, high) = placed(self.model, self.query, self.speckle, w, (refl, high));
        LobeLight { refl, high, pdf: if hit > 0.0 { pdf / hit } else { 0.0 } }
    }

    /// [`Lit::eval_pdf`] with a slit. Slit light, which has no speckle, replaces its share of f_high. The
    /// lobes are interpolated at every call.
    #[inline(never)]
    fn slit_light(&self, slit: &Slit, hit: f32, w: [f32; 3]) -> LobeLight<N> {
        let (core, diffracted, pdf) = self.terms().slit_lobes(slit, w);
        let mut light = self.light(w, hit, |_| core);
        for k in 0..N {
            light.high[k] += diffracted[k];
        }
        light.pdf += if hit > 0.0 { pdf / hit } else { 0.0 };
        light
    }

    #[inline]
    fn terms(&self) -> Terms<'_, L, N> {
        Terms { model: self.model, query: self.query, lobes: self.lobes }
    }
}

impl<L: Lobes<N>, const N: usize> Bsdf<N> for SingleLayer<'_, L, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.placed(w, &self.all().eval(w))
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.all().pdf(w)
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        let terms = self.all().eval_pdf(w);
        (self.placed(w, &terms), terms.pdf)
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        match self.all().sample(u) {
            Drawn::Scattered(w, terms) => BsdfSample::scattered(w, self.placed(w, &terms), terms.pdf),
            Drawn::Missed(Some((r_d, chance))) => BsdfSample::straight([r_d; N], chance),
            Drawn::Missed(None) => BsdfSample::straight(self.straight(), self.outcomes().straight),
            Drawn::Absorbed => BsdfSample::Absorbed,
        }
    }

    fn albedo(&self) -> [f32; N] {
        let energies = self.lobes.energies();
        let edge = if self.has_edge() { energies.r_d } else { 0.0 };
        energies.albedo().map(|a| a + edge)
    }

    fn straight(&self) -> [f32; N] {
        if self.has_edge() { [0.0; N] } else { [self.lobes.energies().r_d; N] }
    }

    fn outcomes(&self) -> Outcomes {
        let energies = self.lobes.energies();
        let scattered = energies.albedo().iter().sum::<f32>() / N.max(1) as f32;
        if self.has_edge() && N > 0 {
            Outcomes::in_proportion(scattered + energies.r_d, 0.0)
        } else {
            Outcomes::in_proportion(scattered, energies.r_d)
        }
    }

    fn eval_batch(&self, w: &[[f32; 3]], f: &mut [[f32; N]], pdf: &mut [f32]) {
        let PlyQuery { theta_i, h_um, sigma_per_um, slit, place, .. } = self.query;
        if self.has_edge() || slit.is_some() || place.is_some() {
            for ((w, f), pdf) in w.iter().zip(f).zip(pdf) {
                (*f, *pdf) = self.eval_pdf(*w);
            }
        } else {
            let mut lobes = self.model.cached(theta_i, h_um, sigma_per_um);
            lobes.prepare();
            for ((w, f), pdf) in w.iter().zip(f).zip(pdf) {
                let Core { refl, high, pdf: density, .. } = lobes.eval_pdf(*w);
                (*f, *pdf) = (std::array::from_fn(|k| refl + high[k]), density);
            }
        }
    }
}
