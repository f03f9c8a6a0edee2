//! All terms of a ply model in one direction: light that hit fibers, light diffracted at the ply's edge, and
//! slit light (Yu 2025, Eq. 8 and 18, and 7.3).

use super::edge;
use super::edge::EdgeTables;
use super::kernel::dispatch;
use super::kernel::energy::Core;
use super::kernel::lobe::unit;
use super::kernel::slit::SlitSample;
use super::lobes::Lobes;
use super::model::PlyModel;
use super::query::{PlyQuery, PlyTerms};
use crate::gap::Slit;

/// A direction sampled from all terms, or another outcome of a sample.
pub(crate) enum Drawn<const N: usize> {
    Scattered([f32; 3], PlyTerms<N>),
    /// Missed light that goes straight on, and if they are known its energy and probability.
    Missed(Option<(f32, f32)>),
    Absorbed,
}

/// The terms of a model at one query, with lobes `L`.
pub(crate) struct Terms<'a, L, const N: usize> {
    pub(super) model: &'a PlyModel,
    pub(super) query: &'a PlyQuery<'a, N>,
    pub(super) lobes: &'a L,
}

impl<L: Lobes<N>, const N: usize> Terms<'_, L, N> {
    /// The terms in direction `w`. `pdf` is set only if the query has a slit, and is 0 otherwise.
    pub(crate) fn eval(&self, w: [f32; 3]) -> PlyTerms<N> {
        if let Some(slit) = self.query.slit {
            return self.slit_eval_pdf(slit, w);
        }
        let core = self.lobes.eval(w);
        let light = match self.edge_at(&core, w) {
            Some(tables) => edge::eval(tables, self.query.theta_i, self.query.h_um, &self.query.lambda_um, w),
            None => [0.0; N],
        };
        join(&core, light, 0.0)
    }

    /// [`Terms::eval`] with the density of [`Terms::sample`].
    pub(crate) fn eval_pdf(&self, w: [f32; 3]) -> PlyTerms<N> {
        match self.query.slit {
            Some(slit) => self.slit_eval_pdf(slit, w),
            None => self.with_edge_pdf(&self.lobes.eval_pdf(w), w),
        }
    }

    /// The density [1/sr] alone.
    pub(crate) fn pdf(&self, w: [f32; 3]) -> f32 {
        match self.query.slit {
            Some(slit) => self.slit_eval_pdf(slit, w).pdf,
            None => self.with_edge_pdf(&self.lobes.eval_pdf(w), w).pdf,
        }
    }

    /// Samples a direction and evaluates the terms there.
    pub(crate) fn sample(&self, u: [f32; 3]) -> Drawn<N> {
        let u = unit(u);
        if let Some(slit) = self.query.slit {
            return self.slit_sample(slit, u);
        }
        let (w, core) = self.lobes.sample(u);
        if let Some(w) = w {
            return Drawn::Scattered(w, self.with_edge_pdf(&core, w));
        }
        if core.missed <= 0.0 {
            return Drawn::Absorbed;
        }
        // Missed light takes the end of the unit interval, so the rest of the number is uniform again and
        // chooses the wavelength.
        self.sample_missed(1.0 - (1.0 - u[0]) / core.missed, u, Some((core.r_d, core.missed)))
    }

    /// Samples the edge lobes, which scatter all missed light if the model has them and the query enables
    /// them.
    fn sample_missed(&self, remaining: f32, u: [f32; 3], known: Option<(f32, f32)>) -> Drawn<N> {
        let Some(tables) = self.edge() else { return Drawn::Missed(known) };
        let q = self.query;
        match edge::sample(tables, q.theta_i, q.h_um, &q.lambda_um, unit([remaining, u[1], u[2]])) {
            Some(w) => Drawn::Scattered(w, self.eval_pdf(w)),
            None => Drawn::Absorbed,
        }
    }

    fn with_edge_pdf(&self, core: &Core<N>, w: [f32; 3]) -> PlyTerms<N> {
        let (light, pdf) = match self.edge_at(core, w) {
            Some(tables) => edge::eval_pdf(tables, self.query.theta_i, self.query.h_um, &self.query.lambda_um, w),
            None => ([0.0; N], 0.0),
        };
        join(core, light, pdf)
    }

    #[inline]
    fn edge(&self) -> Option<&EdgeTables> {
        if self.query.edge { self.model.edge.as_ref() } else { None }
    }

    /// The edge lobes, if they scatter light into direction `w`.
    fn edge_at(&self, core: &Core<N>, w: [f32; 3]) -> Option<&EdgeTables> {
        self.edge().filter(|tables| core.r_d > 0.0 && !tables.dark(self.query.h_um, w[0]))
    }

    /// The terms of a ply with a slit that diffracts part of its forward light (Yu 2025, 7.3). The lobes are
    /// interpolated at every call.
    fn slit_eval_pdf(&self, slit: &Slit, w: [f32; 3]) -> PlyTerms<N> {
        let (core, light, pdf) = self.slit_lobes(slit, w);
        let terms = self.with_edge_pdf(&core, w);
        PlyTerms { slit: light, pdf: terms.pdf + pdf, ..terms }
    }

    /// The lobes without the slit's share, the slit light, and the slit's part of the density.
    pub(super) fn slit_lobes(&self, slit: &Slit, w: [f32; 3]) -> (Core<N>, [f32; N], f32) {
        let q = self.query;
        let layout = &self.model.layout;
        let (core, diffracted) = dispatch::slit_eval_pdf(layout, slit.share(), (q.theta_i, q.h_um), &q.sigma_per_um, w);
        let (mut light, pdf) = slit.eval_pdf(q.theta_i, q.lambda_um, w);
        for k in 0..N {
            light[k] *= diffracted.energy[k];
        }
        (core, light, diffracted.chance * pdf)
    }

    fn slit_sample(&self, slit: &Slit, u: [f32; 3]) -> Drawn<N> {
        match self.slit_direction(slit, u) {
            Ok(Some(w)) => Drawn::Scattered(w, self.slit_eval_pdf(slit, w)),
            Ok(None) => Drawn::Absorbed,
            Err(remaining) => self.sample_missed(remaining, u, None),
        }
    }

    /// Samples a direction of the lobes or of the slit light. `Err` is missed light, with the rest of the
    /// random number that chose it.
    pub(super) fn slit_direction(&self, slit: &Slit, u: [f32; 3]) -> Result<Option<[f32; 3]>, f32> {
        let q = self.query;
        let layout = &self.model.layout;
        match dispatch::slit_sample(layout, slit.share(), (q.theta_i, q.h_um), &q.sigma_per_um, u) {
            SlitSample::Lobe(w) => Ok(Some(w)),
            SlitSample::Slit(remaining) => Ok(slit.sample(q.theta_i, q.lambda_um, unit([remaining, u[1], u[2]]))),
            SlitSample::Missed(remaining) => Err(remaining),
            SlitSample::None => Ok(None),
        }
    }
}

/// The terms from the lobes, edge light of energy 1 and the density of sampling that light.
fn join<const N: usize>(core: &Core<N>, light: [f32; N], pdf: f32) -> PlyTerms<N> {
    let mut edge = light;
    for f in &mut edge {
        *f *= core.r_d;
    }
    PlyTerms { refl: core.refl, high: core.high, edge, slit: [0.0; N], pdf: core.pdf + core.missed * pdf }
}
