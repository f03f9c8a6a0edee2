//! All terms of the model at once: what met fibers, and what passed beside the ply and was diffracted at its edge.

use super::energy::Core;
use super::lobe::unit;
use super::slit::SlitSample;
use super::{dispatch, edge};
use crate::{PlyModel, PlyTerms, Slit};

impl PlyModel {
    /// Whether the model has edge lobes.
    pub fn has_edge(&self) -> bool {
        self.edge.is_some()
    }

    /// All terms of the model in direction `wo`, the light diffracted at the ply's edge (Yu 2025, Eq. 18) at the wavelengths
    /// `lambda_um` among them, each on its own; `pdf` is left at 0.
    pub fn eval_terms<const N: usize>(
        &self,
        theta_i: f32,
        h_um: f32,
        sigma_per_um: [f32; N],
        lambda_um: [f32; N],
        wo: [f32; 3],
    ) -> PlyTerms<N> {
        let core = dispatch::run_eval(&self.layout, theta_i, h_um, sigma_per_um, wo);
        let mut light = [0.0; N];
        if core.r_d > 0.0
            && let Some(tables) = &self.edge
            && !tables.dark(h_um, wo[0])
        {
            light = edge::eval(tables, theta_i, h_um, &lambda_um, wo);
        }
        join(&core, light, 0.0)
    }

    /// [`PlyModel::eval_terms`] with the density of [`PlyModel::sample_terms`].
    pub fn terms_pdf<const N: usize>(
        &self,
        theta_i: f32,
        h_um: f32,
        sigma_per_um: [f32; N],
        lambda_um: [f32; N],
        wo: [f32; 3],
    ) -> PlyTerms<N> {
        let core = dispatch::run_eval_pdf(&self.layout, theta_i, h_um, sigma_per_um, wo);
        self.with_edge_pdf(&core, theta_i, h_um, lambda_um, wo)
    }

    /// Density [1/sr] of [`PlyModel::sample_terms`] alone, for what asks for no more.
    pub(crate) fn density_of_terms<const N: usize>(
        &self,
        theta_i: f32,
        h_um: f32,
        sigma_per_um: [f32; N],
        lambda_um: [f32; N],
        wo: [f32; 3],
    ) -> f32 {
        let core = dispatch::run_pdf(&self.layout, theta_i, h_um, sigma_per_um, wo);
        self.with_edge_pdf(&core, theta_i, h_um, lambda_um, wo).pdf
    }

    /// A direction drawn from all terms, edge light included, with density proportional to their energies averaged over the N
    /// wavelengths. `None` where nothing is scattered, and for the missed light of a model without edge lobes.
    pub fn sample_terms<const N: usize>(
        &self,
        theta_i: f32,
        h_um: f32,
        sigma_per_um: [f32; N],
        lambda_um: [f32; N],
        u: [f32; 3],
    ) -> Option<([f32; 3], PlyTerms<N>)> {
        let u = unit(u);
        let (wo, core) = dispatch::run_sample(&self.layout, theta_i, h_um, sigma_per_um, u);
        if let Some(wo) = wo {
            return Some((wo, self.with_edge_pdf(&core, theta_i, h_um, lambda_um, wo)));
        }
        if core.missed <= 0.0 {
            return None;
        }
        // The missed light is the last part of the unit interval: what is left of the number chooses the wavelength.
        let left = 1.0 - (1.0 - u[0]) / core.missed;
        let wo = edge::sample(self.edge.as_ref()?, theta_i, h_um, &lambda_um, unit([left, u[1], u[2]]))?;
        Some((wo, self.terms_pdf(theta_i, h_um, sigma_per_um, lambda_um, wo)))
    }

    /// [`PlyModel::terms_pdf`] of a ply whose forward light has a part that small slits diffract (Yu 2025, 7.3).
    pub fn terms_slit<const N: usize>(
        &self,
        slit: &Slit,
        theta_i: f32,
        h_um: f32,
        sigma_per_um: [f32; N],
        lambda_um: [f32; N],
        wo: [f32; 3],
    ) -> PlyTerms<N> {
        let (core, taken) = dispatch::run_slit_eval(&self.layout, slit.share(), theta_i, h_um, sigma_per_um, wo);
        let mut terms = self.with_edge_pdf(&core, theta_i, h_um, lambda_um, wo);
        let (light, pdf) = slit.eval_pdf(theta_i, lambda_um, wo);
        for k in 0..N {
            terms.slit[k] = taken.energy[k] * light[k];
        }
        terms.pdf += taken.chance * pdf;
        terms
    }

    /// [`PlyModel::sample_terms`] of what [`PlyModel::terms_slit`] gives.
    pub fn sample_slit<const N: usize>(
        &self,
        slit: &Slit,
        theta_i: f32,
        h_um: f32,
        sigma_per_um: [f32; N],
        lambda_um: [f32; N],
        u: [f32; 3],
    ) -> Option<([f32; 3], PlyTerms<N>)> {
        let u = unit(u);
        let wo = match dispatch::run_slit_sample(&self.layout, slit.share(), theta_i, h_um, sigma_per_um, u) {
            SlitSample::Lobe(wo) => wo,
            SlitSample::Slit(left) => slit.sample(theta_i, lambda_um, unit([left, u[1], u[2]]))?,
            SlitSample::Missed(left) => {
                edge::sample(self.edge.as_ref()?, theta_i, h_um, &lambda_um, unit([left, u[1], u[2]]))?
            }
            SlitSample::None => return None,
        };
        Some((wo, self.terms_slit(slit, theta_i, h_um, sigma_per_um, lambda_um, wo)))
    }

    fn with_edge_pdf<const N: usize>(
        &self,
        core: &Core<N>,
        theta_i: f32,
        h_um: f32,
        lambda_um: [f32; N],
        wo: [f32; 3],
    ) -> PlyTerms<N> {
        let (mut light, mut pdf) = ([0.0; N], 0.0);
        if core.r_d > 0.0
            && let Some(tables) = &self.edge
            && !tables.dark(h_um, wo[0])
        {
            (light, pdf) = edge::eval_pdf(tables, theta_i, h_um, &lambda_um, wo);
        }
        join(core, light, pdf)
    }
}

/// The terms, of edge light of energy 1 and the density of its samples.
fn join<const N: usize>(core: &Core<N>, light: [f32; N], pdf: f32) -> PlyTerms<N> {
    let mut edge = light;
    for f in &mut edge {
        *f *= core.r_d;
    }
    PlyTerms { refl: core.refl, high: core.high, edge, slit: [0.0; N], pdf: core.pdf + core.missed * pdf }
}
