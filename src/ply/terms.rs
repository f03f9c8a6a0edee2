//! All terms of the model at once: what met fibers, and what passed beside the ply and was diffracted at its edge.

use super::edge::EdgeTables;
use super::energy::Core;
use super::lobe::unit;
use super::lobes::Lobes;
use super::slit::SlitSample;
use super::{dispatch, edge};
use crate::{PlyModel, PlyTerms, Slit};

/// The terms of a model at one incidence, of lobes `L`.
pub(crate) struct Terms<'a, L, const N: usize> {
    lobes: &'a L,
    edge: Option<&'a EdgeTables>,
    theta_i: f32,
    h_um: f32,
    lambda_um: [f32; N],
}

impl<L: Lobes<N>, const N: usize> Terms<'_, L, N> {
    /// In direction `wo`; `pdf` is left at 0.
    pub(crate) fn eval(&self, wo: [f32; 3]) -> PlyTerms<N> {
        let core = self.lobes.eval(wo);
        let light = match self.lit(&core, wo) {
            Some(tables) => edge::eval(tables, self.theta_i, self.h_um, &self.lambda_um, wo),
            None => [0.0; N],
        };
        join(&core, light, 0.0)
    }

    /// [`Terms::eval`] with the density of [`Terms::sample`].
    pub(crate) fn eval_pdf(&self, wo: [f32; 3]) -> PlyTerms<N> {
        self.with_edge_pdf(&self.lobes.eval_pdf(wo), wo)
    }

    /// The density [1/sr] alone.
    pub(crate) fn pdf(&self, wo: [f32; 3]) -> f32 {
        self.with_edge_pdf(&self.lobes.pdf(wo), wo).pdf
    }

    /// A direction and the terms there.
    pub(crate) fn sample(&self, u: [f32; 3]) -> Option<([f32; 3], PlyTerms<N>)> {
        let u = unit(u);
        let (wo, core) = self.lobes.sample(u);
        if let Some(wo) = wo {
            return Some((wo, self.with_edge_pdf(&core, wo)));
        }
        if core.missed <= 0.0 {
            return None;
        }
        // The missed light is the last part of the unit interval: what is left of the number chooses the wavelength.
        let left = 1.0 - (1.0 - u[0]) / core.missed;
        let wo = edge::sample(self.edge?, self.theta_i, self.h_um, &self.lambda_um, unit([left, u[1], u[2]]))?;
        Some((wo, self.eval_pdf(wo)))
    }

    fn with_edge_pdf(&self, core: &Core<N>, wo: [f32; 3]) -> PlyTerms<N> {
        let (light, pdf) = match self.lit(core, wo) {
            Some(tables) => edge::eval_pdf(tables, self.theta_i, self.h_um, &self.lambda_um, wo),
            None => ([0.0; N], 0.0),
        };
        join(core, light, pdf)
    }

    /// The edge lobes where they have light in a direction.
    fn lit(&self, core: &Core<N>, wo: [f32; 3]) -> Option<&EdgeTables> {
        self.edge.filter(|tables| core.r_d > 0.0 && !tables.dark(self.h_um, wo[0]))
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

impl PlyModel {
    /// Whether the model has edge lobes.
    pub fn has_edge(&self) -> bool {
        self.edge.is_some()
    }

    /// Terms of given lobes.
    pub(crate) fn terms_of<'a, L: Lobes<N>, const N: usize>(
        &'a self,
        lobes: &'a L,
        theta_i: f32,
        h_um: f32,
        lambda_um: [f32; N],
    ) -> Terms<'a, L, N> {
        Terms { lobes, edge: self.edge.as_ref(), theta_i, h_um, lambda_um }
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
        let lobes = self.fresh(theta_i, h_um, sigma_per_um);
        self.terms_of(&lobes, theta_i, h_um, lambda_um).eval(wo)
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
        let lobes = self.fresh(theta_i, h_um, sigma_per_um);
        self.terms_of(&lobes, theta_i, h_um, lambda_um).eval_pdf(wo)
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
        let lobes = self.fresh(theta_i, h_um, sigma_per_um);
        self.terms_of(&lobes, theta_i, h_um, lambda_um).sample(u)
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
        let lobes = self.fresh(theta_i, h_um, sigma_per_um);
        let mut terms = self.terms_of(&lobes, theta_i, h_um, lambda_um).with_edge_pdf(&core, wo);
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
}
