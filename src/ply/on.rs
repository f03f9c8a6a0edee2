//! A ply without a second layer at a query, of lobes that are cached or not.

use super::dispatch;
use super::energy::Core;
use super::lobes::{Lobes, Uncached};
use super::model::PlyModel;
use super::query::{PlyQuery, PlyTerms};
use super::terms::{Drawn, Terms};
use crate::bsdf::Outcomes;
use crate::speckle::Speckle;
use crate::{Bsdf, BsdfSample};

/// A direction, f and density there.
pub(crate) type LobeSample<const N: usize> = ([f32; 3], ([f32; N], f32));

/// A ply whose lobes are interpolated at every call.
pub(crate) type UncachedPly<'a, const N: usize> = PlyOn<'a, Uncached<'a, N>, N>;

/// A ply at a query, what answers for its lobes, and its patterns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlyOn<'a, L, const N: usize> {
    pub(crate) model: &'a PlyModel,
    pub(crate) query: PlyQuery<'a, N>,
    pub(super) lobes: L,
    pub(super) speckle: Option<Speckle<'a, N>>,
}

impl<L: Lobes<N>, const N: usize> PlyOn<'_, L, N> {
    /// Energies of f_refl + f_high and of the light that missed.
    pub(crate) fn albedo_r_d(&self) -> ([f32; N], f32) {
        let energies = self.lobes.energies();
        (energies.albedo(), energies.r_d)
    }

    /// f_refl + f_high, those of the instance.
    pub(crate) fn eval_lobes(&self, w: [f32; 3]) -> [f32; N] {
        let Some(speckle) = &self.speckle else {
            let core = self.lobes.eval(w);
            return std::array::from_fn(|k| core.refl + core.high[k]);
        };
        let lookup = speckle.look(w);
        let Core { refl, mut high, .. } = self.lobes.eval(w);
        let (of_refl, of_high) = lookup.factors();
        for k in 0..N {
            high[k] = refl * of_refl[k] + high[k] * of_high[k];
        }
        high
    }

    /// Density of the lobes' samples, the chance of missing included.
    pub(crate) fn pdf_lobes(&self, w: [f32; 3]) -> f32 {
        self.lobes.pdf(w).pdf
    }

    /// Both.
    pub(crate) fn eval_pdf_lobes(&self, w: [f32; 3]) -> ([f32; N], f32) {
        self.sum_lobes(w, |lobes| lobes.eval_pdf(w))
    }

    /// A direction of the lobes, with [`PlyOn::eval_pdf_lobes`] there.
    pub(crate) fn sample_lobes(&self, u: [f32; 3]) -> Option<LobeSample<N>> {
        let (w, core) = self.lobes.sample(u);
        let w = w?;
        Some((w, self.sum_lobes(w, |_| core)))
    }

    #[inline]
    pub(super) fn all(&self) -> Terms<'_, L, N> {
        Terms { model: self.model, query: &self.query, lobes: &self.lobes }
    }

    /// Terms of the instance summed. The tiles are looked up before the lobes are summed: their memory comes meanwhile.
    fn speckled(&self, w: [f32; 3], terms: impl FnOnce() -> PlyTerms<N>) -> ([f32; N], f32) {
        let Some(speckle) = &self.speckle else {
            let terms = terms();
            return (terms.sum(), terms.pdf);
        };
        let lookup = speckle.look(w);
        let terms = terms();
        (terms.sum_speckled(&lookup.factors()), terms.pdf)
    }

    /// Sum of f_refl and f_high of the instance, and the density, of what `of` the lobes gives.
    fn sum_lobes(&self, w: [f32; 3], of: impl FnOnce(&L) -> Core<N>) -> ([f32; N], f32) {
        self.speckled(w, || {
            let core = of(&self.lobes);
            PlyTerms { refl: core.refl, high: core.high, edge: [0.0; N], slit: [0.0; N], pdf: core.pdf }
        })
    }

    /// Light that is diffracted at the edge is scattered; of other plies it goes straight on.
    #[inline]
    fn has_edge(&self) -> bool {
        self.query.edge && self.model.has_edge()
    }
}

impl<L: Lobes<N>, const N: usize> Bsdf<N> for PlyOn<'_, L, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.speckled(w, || self.all().eval(w)).0
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.all().pdf(w)
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        self.speckled(w, || self.all().eval_pdf(w))
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        match self.all().sample(u) {
            Drawn::Scattered(w, terms) => {
                let (f, pdf) = self.speckled(w, || terms);
                BsdfSample::scattered(w, f, pdf)
            }
            Drawn::Missed => BsdfSample::straight(self.straight(), self.outcomes().straight),
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
        let PlyQuery { theta_i, h_um, sigma_per_um, slit, .. } = self.query;
        if self.has_edge() || slit.is_some() || self.speckle.is_some() {
            for ((w, f), pdf) in w.iter().zip(f).zip(pdf) {
                (*f, *pdf) = self.eval_pdf(*w);
            }
        } else {
            dispatch::run_directions(&self.model.layout, theta_i, h_um, sigma_per_um, w, f, pdf);
        }
    }
}
