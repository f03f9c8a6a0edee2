//! The ply model evaluated at a query (Yu 2025, 7.1): f_refl + f_high + f_edge, with optional relief,
//! speckle, slit light and second layer.
//!
//! The model conserves energy. At sigma = 0 the scattered energy plus the straight light is 1 at every
//! incidence: for |h| up to R + d_cut, and beyond, where the beam passes with its own divergence.

use super::lobes::{Cached, Lobes};
use super::model::PlyModel;
use super::query::{PlyQuery, PlyTerms};
use super::single_layer::{SingleLayer, UncachedPly};
use super::two_layers::TwoLayered;
use crate::bsdf::Outcomes;
use crate::ply::speckle::Speckle;
use crate::{Bsdf, BsdfSample};

impl PlyModel {
    /// The model at a query. The result is a value on the stack; with four wavelengths it takes 1.3 KB.
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
    #[inline(always)]
    pub fn at<'a, const N: usize>(&'a self, query: &PlyQuery<'a, N>) -> PlyBsdf<'a, N> {
        let lobes = self.cached(query.theta_i, query.h_um, query.sigma_per_um);
        let ply = SingleLayer { model: self, query: *query, lobes, speckle: self.speckle(query) };
        // Prepared after the move, because prepared lobes are too large to move.
        let mut bsdf = PlyBsdf { ply, two: None };
        bsdf.prepare();
        bsdf
    }

    /// The model at a query, uncached: every call interpolates its lobes, which is best if there is a single
    /// call.
    #[inline(always)]
    pub(crate) fn uncached_at<'a, const N: usize>(&'a self, query: &PlyQuery<'a, N>) -> UncachedPly<'a, N> {
        let lobes = self.uncached(query.theta_i, query.h_um, query.sigma_per_um);
        UncachedPly { model: self, query: *query, lobes }
    }

    /// Factors of the relief on f_refl and f_high in a direction; `None` if the query has no place, switches
    /// relief off, or the model has no relief.
    #[inline(always)]
    pub(super) fn relief_at<const N: usize>(&self, query: &PlyQuery<'_, N>, w: [f32; 3]) -> Option<[f32; 2]> {
        let relief = self.relief.as_ref().filter(|_| query.relief)?;
        Some(relief.factors(query.place.as_ref()?, query.h_um, w))
    }

    /// The speckle patterns at a query; `None` if the query has no place, switches speckle off, or the model
    /// has no noise.
    #[inline(always)]
    pub(super) fn speckle<const N: usize>(&self, query: &PlyQuery<'_, N>) -> Option<Speckle<N>> {
        let noise = self.noise().filter(|_| query.speckle)?;
        noise.at(query.place.as_ref()?, query.h_um, query.theta_i, &query.lambda_um)
    }
}

/// A ply model at a query, from [`PlyModel::at`].
///
/// ```
/// use plywave::{Bsdf, PlyModel, PlyQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let model = PlyModel::load(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/polyester.pwm"))?;
/// let ply = model.at(&PlyQuery::new(0.2, -5.0, [0.0, 0.02], [0.55; 2]));
/// let terms = ply.terms([0.0, -1.0, 0.0]); // f_refl, f_high, f_edge apart
/// assert!(terms.high[0] > terms.high[1] && ply.albedo()[0] > ply.albedo()[1]);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PlyBsdf<'a, const N: usize> {
    ply: SingleLayer<'a, Cached<'a, N>, N>,
    two: Option<TwoLayered<N>>,
}

impl<'a, const N: usize> PlyBsdf<'a, N> {
    #[inline(always)]
    fn prepare(&mut self) {
        if self.ply.query.cached {
            self.ply.lobes.prepare();
        }
        if let Some(below) = self.ply.query.below {
            self.two = TwoLayered::new(&self.ply, &below);
            if self.two.is_some() {
                self.ply.query.slit = None;
            }
        }
    }

    /// The query that this was prepared from.
    pub fn query(&self) -> &PlyQuery<'a, N> {
        &self.ply.query
    }

    /// Whether a second layer is included, which requires that the query has one and the model has layer
    /// factors.
    pub fn is_double(&self) -> bool {
        self.two.is_some()
    }

    /// Fraction of the beam that hits no fiber.
    pub fn r_d(&self) -> f32 {
        self.ply.lobes.energies().r_d
    }

    /// The separate terms of f in direction `w`, for the smooth ply without a second layer.
    pub fn terms(&self, w: [f32; 3]) -> PlyTerms<N> {
        self.ply.all().eval_pdf(w)
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
