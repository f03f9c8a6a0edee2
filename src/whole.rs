//! The whole ply model: f_refl + f_high + f_edge (Yu 2025, 7.1, all three beam cases), one [`Scatter`] that keeps all light: at sigma = 0
//! its energy is 1 at every incidence, |h| up to R + d_cut and beyond, where the beam goes on with its own divergence.

use crate::noise::Speckle;
use crate::ply::{Core, Drawn, Fresh, Lobes, Ready, Terms};
use crate::{Instance, PlyModel, Scatter, ScatterSample, Slit};

/// The terms of a ply model in one direction [1/sr].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyTerms<const N: usize> {
    /// Single reflection; the same at every absorption.
    pub refl: f32,
    /// All other light that met fibers.
    pub high: [f32; N],
    /// Light that passed beside the ply and was diffracted (Yu 2025, Eq. 18); 0 in a model without edge lobes.
    pub edge: [f32; N],
    /// Light of f_high that small slits diffract, where there is a [`Slit`]; `high` is then without it.
    pub slit: [f32; N],
    /// Density of sampling the direction, all terms together [1/sr]; 0 where it was not asked for.
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
}

/// A ply model with its edge light at one incidence, N absorptions each with its wavelength.
///
/// Of a model without edge lobes the missed light goes on unscattered, as [`crate::PlyIncidence`] has it. Wavelengths outside the tables
/// count as the nearest in them, and so does what is not a number.
///
/// Every call interpolates the model anew. A host that evaluates and samples at one point does better with [`WholePly::prepare`].
#[derive(Clone, Copy, Debug)]
pub struct WholePly<'a, const N: usize> {
    /// The model.
    pub model: &'a PlyModel,
    /// Incident latitude [rad].
    pub theta_i: f32,
    /// Offset of the beam's center [um].
    pub h_um: f32,
    /// Absorptions [1/um].
    pub sigma_per_um: [f32; N],
    /// Wavelengths [um].
    pub lambda_um: [f32; N],
    /// Small gaps between the fibers (Yu 2025, 7.3), for those who want their colors.
    pub slit: Option<&'a Slit>,
    /// Which speckle patterns f_refl and f_high carry (Yu 2025, Eq. 23); `None` for the smooth model. Of a model without tiles both are the same. Sampling is
    /// that of the smooth model, and so is the albedo, the mean over instances.
    pub instance: Option<Instance>,
}

impl<'a, const N: usize> WholePly<'a, N> {
    /// The ply with its lobes interpolated and its patterns chosen, once for all directions. Of a ply with a [`Slit`], and of a model of more than 12
    /// high-order or 4 reflection lobes or 8 path lengths, the lobes are interpolated at every call all the same.
    pub fn prepare(self) -> PreparedPly<'a, N> {
        let mut ply = self.unprepared();
        ply.make();
        ply
    }

    /// Answers as [`WholePly::prepare`]'s, but interpolates at every call until [`PreparedPly::make`].
    pub(crate) fn unprepared(self) -> PreparedPly<'a, N> {
        let lobes = self.model.ready(self.theta_i, self.h_um, self.sigma_per_um);
        PreparedPly(PlyOn { lobes, speckle: self.speckle(), ply: self })
    }

    /// The smooth terms of f in direction `wo`.
    pub fn terms(&self, wo: [f32; 3]) -> PlyTerms<N> {
        self.without_speckle().smooth(wo)
    }

    /// f_refl and f_high alone, those of the instance, without the light that passed beside the ply.
    pub fn split(&self, wo: [f32; 3]) -> ([f32; N], [f32; N]) {
        self.fresh().split(wo)
    }

    pub(crate) fn fresh(&self) -> FreshPly<'a, N> {
        PlyOn { speckle: self.speckle(), ..self.without_speckle() }
    }

    /// For what patterns do not change: densities and energies.
    fn without_speckle(&self) -> FreshPly<'a, N> {
        let lobes = self.model.fresh(self.theta_i, self.h_um, self.sigma_per_um);
        PlyOn { lobes, speckle: None, ply: *self }
    }

    /// The patterns, where there are both tiles and an instance.
    fn speckle(&self) -> Option<Speckle<'a, N>> {
        Some(Speckle::new(self.model.noise()?, self.instance?, self.theta_i, &self.lambda_um))
    }
}

/// A [`WholePly`] made ready: two to three times as fast in each direction, and as costly to make as a call of the other. For four wavelengths it holds 1.1 KB on
/// the stack.
#[derive(Clone, Copy, Debug)]
pub struct PreparedPly<'a, const N: usize>(pub(crate) PlyOn<'a, Ready<'a, N>, N>);

/// A ply whose lobes are interpolated at every call, with its patterns.
pub(crate) type FreshPly<'a, const N: usize> = PlyOn<'a, Fresh<'a, N>, N>;

impl<'a, const N: usize> PreparedPly<'a, N> {
    /// Interpolates the lobes.
    pub(crate) fn make(&mut self) {
        self.0.lobes.make();
    }

    /// The ply it was made of.
    pub fn ply(&self) -> &WholePly<'a, N> {
        &self.0.ply
    }
}

/// A ply at one incidence, what answers for its lobes, and its patterns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlyOn<'a, L, const N: usize> {
    ply: WholePly<'a, N>,
    lobes: L,
    speckle: Option<Speckle<'a, N>>,
}

impl<L: Lobes<N>, const N: usize> PlyOn<'_, L, N> {
    /// Energies of f_refl + f_high and of the light that missed.
    pub(crate) fn albedo_r_d(&self) -> ([f32; N], f32) {
        let energies = self.lobes.energies();
        (energies.albedo(), energies.r_d)
    }

    /// Sum of f_refl and f_high of the instance.
    pub(crate) fn lobes(&self, wo: [f32; 3]) -> [f32; N] {
        let (refl, high) = self.split(wo);
        std::array::from_fn(|k| refl[k] + high[k])
    }

    /// Density of the lobes' samples, missing included.
    pub(crate) fn lobes_density(&self, wo: [f32; 3]) -> f32 {
        self.lobes.pdf(wo).pdf
    }

    /// Both.
    pub(crate) fn lobes_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        self.sum(wo, |lobes| lobes.eval_pdf(wo))
    }

    /// A direction of the lobes, with [`PlyOn::lobes_pdf`] there.
    pub(crate) fn sample_lobes(&self, u: [f32; 3]) -> Option<Drawn<([f32; N], f32)>> {
        let (wo, core) = self.lobes.sample(u);
        let wo = wo?;
        Some((wo, self.sum(wo, |_| core)))
    }

    fn all(&self) -> Terms<'_, L, N> {
        let WholePly { model, theta_i, h_um, lambda_um, .. } = self.ply;
        model.terms_of(&self.lobes, theta_i, h_um, lambda_um)
    }

    /// The smooth terms.
    fn smooth(&self, wo: [f32; 3]) -> PlyTerms<N> {
        let WholePly { model, theta_i, h_um, sigma_per_um, lambda_um, .. } = self.ply;
        match self.ply.slit {
            Some(slit) => model.terms_slit(slit, theta_i, h_um, sigma_per_um, lambda_um, wo),
            None => self.all().eval(wo),
        }
    }

    /// The smooth terms with the density of all samples.
    fn smooth_pdf(&self, wo: [f32; 3]) -> PlyTerms<N> {
        if self.ply.slit.is_some() { self.smooth(wo) } else { self.all().eval_pdf(wo) }
    }

    /// Terms of the instance summed. The look at the tiles comes before the lobes are summed: while they are, the tiles' memory comes.
    fn noised(&self, wo: [f32; 3], terms: impl FnOnce() -> PlyTerms<N>) -> ([f32; N], f32) {
        let Some(speckle) = &self.speckle else {
            let terms = terms();
            return (terms.sum(), terms.pdf);
        };
        let look = speckle.look(wo);
        let terms = terms();
        (terms.sum_noised(&look.factors()), terms.pdf)
    }

    /// f_refl and f_high of the instance.
    fn split(&self, wo: [f32; 3]) -> ([f32; N], [f32; N]) {
        let Some(speckle) = &self.speckle else {
            let core = self.lobes.eval(wo);
            return ([core.refl; N], core.high);
        };
        let look = speckle.look(wo);
        let Core { refl, mut high, .. } = self.lobes.eval(wo);
        let (of_refl, of_high) = look.factors();
        for k in 0..N {
            high[k] *= of_high[k];
        }
        (of_refl.map(|n| refl * n), high)
    }

    /// Sum of f_refl and f_high of the instance, and the density, of what `of` the lobes gives.
    fn sum(&self, wo: [f32; 3], of: impl FnOnce(&L) -> Core<N>) -> ([f32; N], f32) {
        let terms = |core: Core<N>| PlyTerms {
            refl: core.refl,
            high: core.high,
            edge: [0.0; N],
            slit: [0.0; N],
            pdf: core.pdf,
        };
        self.noised(wo, || terms(of(&self.lobes)))
    }
}

impl<L: Lobes<N>, const N: usize> Scatter<N> for PlyOn<'_, L, N> {
    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        self.noised(wo, || self.smooth(wo)).0
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        if self.ply.slit.is_some() { self.smooth(wo).pdf } else { self.all().pdf(wo) }
    }

    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        self.noised(wo, || self.smooth_pdf(wo))
    }

    fn sample(&self, u: [f32; 3]) -> Option<ScatterSample<N>> {
        let WholePly { model, theta_i, h_um, sigma_per_um, lambda_um, .. } = self.ply;
        let (wo, terms) = match self.ply.slit {
            Some(slit) => model.sample_slit(slit, theta_i, h_um, sigma_per_um, lambda_um, u)?,
            None => self.all().sample(u)?,
        };
        let (f, pdf) = self.noised(wo, || terms);
        Some(ScatterSample { wo, weight: f.map(|f| if pdf > 0.0 { f / pdf } else { 0.0 }), pdf })
    }

    fn albedo(&self) -> [f32; N] {
        let energies = self.lobes.energies();
        let edge = if self.ply.model.has_edge() { energies.r_d } else { 0.0 };
        energies.albedo().map(|a| a + edge)
    }

    fn miss(&self) -> f32 {
        let energies = self.lobes.energies();
        let scattered = energies.albedo().iter().sum::<f32>() / N.max(1) as f32;
        match scattered + energies.r_d {
            total if total > 0.0 => {
                if self.ply.model.has_edge() && N > 0 {
                    0.0
                } else {
                    energies.r_d / total
                }
            }
            _ => 1.0,
        }
    }
}

impl<const N: usize> Scatter<N> for WholePly<'_, N> {
    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        self.fresh().eval(wo)
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        self.without_speckle().pdf(wo)
    }

    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        self.fresh().eval_pdf(wo)
    }

    fn sample(&self, u: [f32; 3]) -> Option<ScatterSample<N>> {
        self.fresh().sample(u)
    }

    fn albedo(&self) -> [f32; N] {
        self.without_speckle().albedo()
    }

    fn miss(&self) -> f32 {
        self.without_speckle().miss()
    }
}

impl<const N: usize> Scatter<N> for PreparedPly<'_, N> {
    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        self.0.eval(wo)
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        self.0.pdf(wo)
    }

    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        self.0.eval_pdf(wo)
    }

    fn sample(&self, u: [f32; 3]) -> Option<ScatterSample<N>> {
        self.0.sample(u)
    }

    fn albedo(&self) -> [f32; N] {
        self.0.albedo()
    }

    fn miss(&self) -> f32 {
        self.0.miss()
    }
}
