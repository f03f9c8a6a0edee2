//! The ply model at a query (Yu 2025, 7.1): f_refl + f_high + f_edge, with speckle, light of slits and a second layer as the query asks.
//!
//! It keeps all light: at sigma = 0 its energy is 1 at every incidence, |h| up to R + d_cut and beyond, where the beam goes on with its own divergence.

use super::lobes::{Cached, Lobes, Uncached};
use super::terms::{Drawn, Terms};
use super::{Core, dispatch};
use crate::gap::Slit;
use crate::layers::{Layer, TwoLayered};
use crate::noise::Speckle;
use crate::{Bsdf, BsdfSample, Instance, Outcomes, PlyModel};

/// What fixes a shading point of a ply, for N absorptions, each with its wavelength. [`PlyQuery::new`] is the smooth ply with its edge light; the parts are
/// options to set: `PlyQuery { instance: Some(..), ..PlyQuery::new(..) }`.
///
/// Units and odd values as in [`PlyModel`]. Wavelengths outside the tables count as the nearest in them, and so does what is not a number.
#[derive(Clone, Copy, Debug)]
pub struct PlyQuery<'a, const N: usize> {
    /// Incident latitude [rad].
    pub theta_i: f32,
    /// Offset of the beam's center [um]: its x coordinate in the ply frame.
    pub h_um: f32,
    /// Absorptions of the fibers [1/um]: the host's color.
    pub sigma_per_um: [f32; N],
    /// Wavelengths [um]; edge light, slits and speckle depend on them.
    pub lambda_um: [f32; N],
    /// Light that passes beside the ply is diffracted at its edge (Yu 2025, Eq. 18). Without, and in a model without edge lobes, it goes straight on.
    pub edge: bool,
    /// Small gaps between the fibers (Yu 2025, 7.3), for those who want their colors. Has no effect over a second layer.
    pub slit: Option<&'a Slit>,
    /// Speckle patterns that f_refl and f_high carry (Yu 2025, Eq. 23); `None` for the smooth model. Of a model without tiles both are the same. Sampling and
    /// albedo are those of the smooth model, the mean over instances.
    pub instance: Option<Instance>,
    /// A second layer of yarns below (Yu 2025, 5.4), from [`PlyModel::layer`] of its model. Has no effect in a model without layer factors.
    pub below: Option<Layer<N>>,
    /// Interpolate the lobes once for all calls. Without, every call interpolates them anew: faster only where a single call is made.
    pub cached: bool,
}

impl<const N: usize> PlyQuery<'_, N> {
    /// The smooth ply with its edge light.
    pub fn new(theta_i: f32, h_um: f32, sigma_per_um: [f32; N], lambda_um: [f32; N]) -> Self {
        PlyQuery {
            theta_i,
            h_um,
            sigma_per_um,
            lambda_um,
            edge: true,
            slit: None,
            instance: None,
            below: None,
            cached: true,
        }
    }

    /// f_refl + f_high alone, which no wavelength enters: what passes beside the fibers goes straight on.
    pub fn lobes(theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Self {
        PlyQuery { edge: false, ..PlyQuery::new(theta_i, h_um, sigma_per_um, [0.55; N]) }
    }
}

/// The terms of a ply model in one direction [1/sr].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyTerms<const N: usize> {
    /// Single reflection; the same at every absorption.
    pub refl: f32,
    /// All other light that met fibers.
    pub high: [f32; N],
    /// Light that passed beside the ply and was diffracted (Yu 2025, Eq. 18).
    pub edge: [f32; N],
    /// Light of f_high that small slits diffract, where the query has a [`Slit`]; `high` is then without it.
    pub slit: [f32; N],
    /// Density of sampling the direction, all terms together [1/sr].
    pub pdf: f32,
}

impl<const N: usize> PlyTerms<N> {
    /// f_refl + f_high + f_edge, and the light of slits.
    pub fn sum(&self) -> [f32; N] {
        let mut f = [0.0; N];
        for k in 0..N {
            f[k] = self.refl + self.high[k] + self.edge[k] + self.slit[k];
        }
        f
    }

    /// The sum of the terms of one instance (Yu 2025, Eq. 23): f_refl and f_high times their speckle factors, other light as it is.
    fn sum_speckled(&self, (refl, high): &([f32; N], [f32; N])) -> [f32; N] {
        std::array::from_fn(|k| self.refl * refl[k] + self.high[k] * high[k] + self.edge[k] + self.slit[k])
    }
}

impl PlyModel {
    /// The model at a query. With four wavelengths it takes 1.3 KB on the stack.
    ///
    /// ```
    /// use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
    ///
    /// # fn main() -> plywave::Result<()> {
    /// let model = PlyModel::load(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/polyester.pwm"))?;
    /// let sigma_per_um = [0.001, 0.004, 0.010]; // R, G, B of the host's color
    /// let ply = model.at(&PlyQuery::new(0.3, 10.0, sigma_per_um, [0.61, 0.55, 0.465]));
    /// let (f, pdf) = ply.eval_pdf([0.0, 1.0, 0.0]);
    /// if let BsdfSample::Scattered(sample) = ply.sample([0.2, 0.7, 0.4]) {
    ///     assert!(sample.pdf > 0.0 && sample.weight[0] > sample.weight[2]);
    /// }
    /// # assert!(pdf > 0.0 && f[0] > f[2]);
    /// # Ok(())
    /// # }
    /// ```
    #[inline]
    pub fn at<'a, const N: usize>(&'a self, query: &PlyQuery<'a, N>) -> PlyBsdf<'a, N> {
        let mut bsdf = self.unprepared(query);
        bsdf.prepare();
        bsdf
    }

    /// What [`PlyBsdf::prepare`] makes [`PlyModel::at`] of, in place: its lobes are too large to be moved about.
    #[inline]
    pub(crate) fn unprepared<'a, const N: usize>(&'a self, query: &PlyQuery<'a, N>) -> PlyBsdf<'a, N> {
        let lobes = self.cached(query.theta_i, query.h_um, query.sigma_per_um);
        PlyBsdf { ply: PlyOn { model: self, query: *query, lobes, speckle: self.speckle(query) }, two: None }
    }

    /// The model at a query, its lobes interpolated at every call: for what is asked for once.
    #[inline]
    pub(crate) fn uncached_at<'a, const N: usize>(&'a self, query: &PlyQuery<'a, N>) -> UncachedPly<'a, N> {
        let lobes = self.uncached(query.theta_i, query.h_um, query.sigma_per_um);
        PlyOn { model: self, query: *query, lobes, speckle: self.speckle(query) }
    }

    /// The patterns of a query, where there are both tiles and an instance.
    #[inline]
    fn speckle<'a, const N: usize>(&'a self, query: &PlyQuery<'a, N>) -> Option<Speckle<'a, N>> {
        Some(Speckle::new(self.noise()?, query.instance?, query.theta_i, &query.lambda_um))
    }
}

/// A ply model at a query, from [`PlyModel::at`].
#[derive(Clone, Copy, Debug)]
pub struct PlyBsdf<'a, const N: usize> {
    ply: PlyOn<'a, Cached<'a, N>, N>,
    two: Option<TwoLayered<N>>,
}

/// A ply whose lobes are interpolated at every call.
pub(crate) type UncachedPly<'a, const N: usize> = PlyOn<'a, Uncached<'a, N>, N>;

impl<'a, const N: usize> PlyBsdf<'a, N> {
    #[inline]
    pub(crate) fn prepare(&mut self) {
        if self.ply.query.cached {
            self.ply.lobes.prepare();
        }
        if let Some(below) = self.ply.query.below {
            self.two = TwoLayered::new(&self.ply, &below);
        }
    }

    /// The query.
    pub fn query(&self) -> &PlyQuery<'a, N> {
        &self.ply.query
    }

    /// Whether a second layer is in it: the query has one and the model has layer factors.
    pub fn is_double(&self) -> bool {
        self.two.is_some()
    }

    /// Fraction of the beam that meets no fiber.
    pub fn r_d(&self) -> f32 {
        self.ply.lobes.energies().r_d
    }

    /// The terms of f in direction `w` apart, smooth and without a second layer.
    pub fn terms(&self, w: [f32; 3]) -> PlyTerms<N> {
        self.ply.all().eval_pdf(w)
    }
}

/// A direction, f and density there.
pub(crate) type LobeSample<const N: usize> = ([f32; 3], ([f32; N], f32));

/// A ply at a query, what answers for its lobes, and its patterns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlyOn<'a, L, const N: usize> {
    pub(crate) model: &'a PlyModel,
    pub(crate) query: PlyQuery<'a, N>,
    lobes: L,
    speckle: Option<Speckle<'a, N>>,
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
    fn all(&self) -> Terms<'_, L, N> {
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

impl<const N: usize> Bsdf<N> for PlyBsdf<'_, N> {
    #[inline]
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        match &self.two {
            None => self.ply.eval(w),
            Some(two) => two.eval(&self.ply, w),
        }
    }

    #[inline]
    fn pdf(&self, w: [f32; 3]) -> f32 {
        match &self.two {
            None => self.ply.pdf(w),
            Some(two) => two.pdf(&self.ply, w),
        }
    }

    #[inline]
    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        match &self.two {
            None => self.ply.eval_pdf(w),
            Some(two) => two.eval_pdf(&self.ply, w),
        }
    }

    #[inline]
    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        match &self.two {
            None => self.ply.sample(u),
            Some(two) => two.sample(&self.ply, u),
        }
    }

    #[inline]
    fn albedo(&self) -> [f32; N] {
        match &self.two {
            None => self.ply.albedo(),
            Some(two) => two.albedo(),
        }
    }

    #[inline]
    fn straight(&self) -> [f32; N] {
        match &self.two {
            None => self.ply.straight(),
            Some(_) => [0.0; N],
        }
    }

    #[inline]
    fn outcomes(&self) -> Outcomes {
        match &self.two {
            None => self.ply.outcomes(),
            Some(two) => two.outcomes(),
        }
    }

    fn eval_batch(&self, w: &[[f32; 3]], f: &mut [[f32; N]], pdf: &mut [f32]) {
        match &self.two {
            None => self.ply.eval_batch(w, f, pdf),
            Some(_) => w.iter().zip(f).zip(pdf).for_each(|((w, f), pdf)| (*f, *pdf) = self.eval_pdf(*w)),
        }
    }
}
