//! The ply model at a query (Yu 2025, 7.1): f_refl + f_high + f_edge, with optional speckle, slit light and
//! second layer.
//!
//! It conserves energy: at sigma = 0 its energy is 1 at every incidence, |h| up to R + d_cut and beyond,
//! where the beam goes straight on with its own divergence.

use super::kernel::lobes::{Cached, Lobes};
use super::model::PlyModel;
use super::on::{PlyOn, UncachedPly};
use super::query::{PlyQuery, PlyTerms};
use super::two_layers::TwoLayered;
use crate::bsdf::Outcomes;
use crate::speckle::Speckle;
use crate::{Bsdf, BsdfSample};

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
    #[inline(always)]
    pub fn at<'a, const N: usize>(&'a self, query: &PlyQuery<'a, N>) -> PlyBsdf<'a, N> {
        let lobes = self.cached(query.theta_i, query.h_um, query.sigma_per_um);
        let ply = PlyOn { model: self, query: *query, lobes, speckle: self.speckle(query) };
        // Prepared in its place: lobes are too large to move.
        let mut bsdf = PlyBsdf { ply, two: None };
        bsdf.prepare();
        bsdf
    }

    /// The model at a query, uncached: its lobes are interpolated at every call. For single calls.
    #[inline]
    pub(crate) fn uncached_at<'a, const N: usize>(&'a self, query: &PlyQuery<'a, N>) -> UncachedPly<'a, N> {
        let lobes = self.uncached(query.theta_i, query.h_um, query.sigma_per_um);
        PlyOn { model: self, query: *query, lobes, speckle: self.speckle(query) }
    }

    /// Factors of the relief in a direction, if the query has a place and the ply shows fibers.
    #[inline]
    pub(super) fn relief_at<const N: usize>(&self, query: &PlyQuery<'_, N>, w: [f32; 3]) -> Option<[f32; 2]> {
        let relief = self.relief.as_ref().filter(|_| query.relief)?;
        Some(relief.factors(query.place.as_ref()?, query.h_um, w))
    }

    /// The patterns of a query, if it has a place and the model has noise.
    #[inline(always)]
    fn speckle<const N: usize>(&self, query: &PlyQuery<'_, N>) -> Option<Speckle<N>> {
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
    ply: PlyOn<'a, Cached<'a, N>, N>,
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

    /// The query.
    pub fn query(&self) -> &PlyQuery<'a, N> {
        &self.ply.query
    }

    /// Whether a second layer is included: the query has one and the model has layer factors.
    pub fn is_double(&self) -> bool {
        self.two.is_some()
    }

    /// Fraction of the beam that hits no fiber.
    pub fn r_d(&self) -> f32 {
        self.ply.lobes.energies().r_d
    }

    /// The separate terms of f in direction `w`, smooth and without a second layer.
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
