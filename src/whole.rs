//! The whole ply model: f_refl + f_high + f_edge (Yu 2025, 7.1, all three beam cases), one [`Scatter`] that keeps all light: at sigma = 0
//! its energy is 1 at every incidence, |h| up to R + d_cut and beyond, where the beam goes on with its own divergence.

use crate::noise::Look;
use crate::ply::Drawn;
use crate::{Instance, NoiseTiles, PlyModel, Scatter, ScatterSample, Slit};

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

impl<const N: usize> WholePly<'_, N> {
    /// The terms of f in direction `wo`.
    pub fn terms(&self, wo: [f32; 3]) -> PlyTerms<N> {
        let (sigma, lambda) = (self.sigma_per_um, self.lambda_um);
        match self.slit {
            Some(slit) => self.model.terms_slit(slit, self.theta_i, self.h_um, sigma, lambda, wo),
            None => self.model.eval_terms(self.theta_i, self.h_um, sigma, lambda, wo),
        }
    }

    /// f_refl and f_high alone, those of the instance, without the light that passed beside the ply.
    pub fn split(&self, wo: [f32; 3]) -> ([f32; N], [f32; N]) {
        let Some((tiles, instance)) = self.speckle() else {
            let (refl, high) = self.model.eval_split(self.theta_i, self.h_um, self.sigma_per_um, wo);
            return ([refl; N], high);
        };
        let look = Look::new(tiles, instance, self.theta_i, wo, self.lambda_um);
        let (refl, high) = self.model.eval_split(self.theta_i, self.h_um, self.sigma_per_um, wo);
        speckled(refl, high, &look.read(tiles))
    }

    /// Sum of f_refl and f_high of the instance, and the density of the lobes' samples, missing included.
    pub(crate) fn lobes_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        let Some((tiles, instance)) = self.speckle() else {
            let (refl, high, pdf) = self.model.split_pdf(self.theta_i, self.h_um, self.sigma_per_um, wo);
            return (high.map(|high| refl + high), pdf);
        };
        let look = Look::new(tiles, instance, self.theta_i, wo, self.lambda_um);
        let (refl, high, pdf) = self.model.split_pdf(self.theta_i, self.h_um, self.sigma_per_um, wo);
        let (refl, high) = speckled(refl, high, &look.read(tiles));
        (std::array::from_fn(|k| refl[k] + high[k]), pdf)
    }

    /// A direction of the lobes, with [`WholePly::lobes_pdf`] there.
    pub(crate) fn sample_lobes(&self, u: [f32; 3]) -> Option<Drawn<([f32; N], f32)>> {
        let (wo, (refl, high, pdf)) = self.model.sample_split(self.theta_i, self.h_um, self.sigma_per_um, u)?;
        let Some((tiles, instance)) = self.speckle() else {
            return Some((wo, (high.map(|high| refl + high), pdf)));
        };
        let factors = tiles.factors(instance, self.theta_i, wo, self.lambda_um);
        let (refl, high) = speckled(refl, high, &factors);
        Some((wo, (std::array::from_fn(|k| refl[k] + high[k]), pdf)))
    }

    /// The terms with the density of all samples.
    fn terms_pdf(&self, wo: [f32; 3]) -> PlyTerms<N> {
        let (sigma, lambda) = (self.sigma_per_um, self.lambda_um);
        match self.slit {
            Some(slit) => self.model.terms_slit(slit, self.theta_i, self.h_um, sigma, lambda, wo),
            None => self.model.terms_pdf(self.theta_i, self.h_um, sigma, lambda, wo),
        }
    }

    /// Tiles and instance, where there are both. A [`Look`] at a direction comes before the lobes are summed: while they are, the tiles' memory comes.
    fn speckle(&self) -> Option<(&NoiseTiles, Instance)> {
        Some((self.model.noise()?, self.instance?))
    }
}

/// f_refl and f_high of the instance, from the smooth ones and their factors.
fn speckled<const N: usize>(
    refl: f32,
    mut high: [f32; N],
    (of_refl, of_high): &([f32; N], [f32; N]),
) -> ([f32; N], [f32; N]) {
    high.iter_mut().zip(of_high).for_each(|(h, n)| *h *= n);
    (of_refl.map(|n| refl * n), high)
}

impl<const N: usize> Scatter<N> for WholePly<'_, N> {
    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        let Some((tiles, instance)) = self.speckle() else { return self.terms(wo).sum() };
        let look = Look::new(tiles, instance, self.theta_i, wo, self.lambda_um);
        let terms = self.terms(wo);
        terms.sum_noised(&look.read(tiles))
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        let (sigma, lambda) = (self.sigma_per_um, self.lambda_um);
        match self.slit {
            Some(_) => self.terms_pdf(wo).pdf,
            None => self.model.density_of_terms(self.theta_i, self.h_um, sigma, lambda, wo),
        }
    }

    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        let Some((tiles, instance)) = self.speckle() else {
            let terms = self.terms_pdf(wo);
            return (terms.sum(), terms.pdf);
        };
        let look = Look::new(tiles, instance, self.theta_i, wo, self.lambda_um);
        let terms = self.terms_pdf(wo);
        (terms.sum_noised(&look.read(tiles)), terms.pdf)
    }

    fn sample(&self, u: [f32; 3]) -> Option<ScatterSample<N>> {
        let (sigma, lambda) = (self.sigma_per_um, self.lambda_um);
        let (wo, terms) = match self.slit {
            Some(slit) => self.model.sample_slit(slit, self.theta_i, self.h_um, sigma, lambda, u)?,
            None => self.model.sample_terms(self.theta_i, self.h_um, sigma, lambda, u)?,
        };
        let pdf = terms.pdf;
        let f = match self.speckle() {
            None => terms.sum(),
            Some((tiles, instance)) => terms.sum_noised(&tiles.factors(instance, self.theta_i, wo, self.lambda_um)),
        };
        Some(ScatterSample { wo, weight: f.map(|f| if pdf > 0.0 { f / pdf } else { 0.0 }), pdf })
    }

    fn albedo(&self) -> [f32; N] {
        let edge = if self.model.has_edge() { self.model.r_d(self.theta_i, self.h_um) } else { 0.0 };
        self.model.albedo(self.theta_i, self.h_um, self.sigma_per_um).map(|a| a + edge)
    }

    fn miss(&self) -> f32 {
        let r_d = self.model.r_d(self.theta_i, self.h_um);
        let scattered =
            self.model.albedo(self.theta_i, self.h_um, self.sigma_per_um).iter().sum::<f32>() / N.max(1) as f32;
        match scattered + r_d {
            total if total > 0.0 => {
                if self.model.has_edge() && N > 0 {
                    0.0
                } else {
                    r_d / total
                }
            }
            _ => 1.0,
        }
    }
}
