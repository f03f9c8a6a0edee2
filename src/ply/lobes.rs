//! f_refl and f_high at one incidence (Yu 2025, Eq. 8), from lobes that are interpolated at every call
//! (uncached) or once for many calls (cached).

use super::kernel::dispatch::{self, Prepared};
use super::kernel::energy::{Core, DrawnBy, Energies};
use super::kernel::layout::Layout;
use super::model::PlyModel;

/// f_refl and f_high in one direction, times the factors of the query's place, and the density with which the
/// lobes sample that direction [1/sr]. Slit light is included in f_high.
#[derive(Clone, Copy, Debug)]
pub struct LobeLight<const N: usize> {
    /// f_refl, one value for each absorption.
    pub refl: [f32; N],
    /// f_high, one value for each absorption.
    pub high: [f32; N],
    /// Density among the directions that the lobes yield; missed light is excluded, so the integral is 1.
    pub pdf: f32,
}

/// The lobes of a model at one incidence, for N absorptions.
pub(crate) trait Lobes<const N: usize> {
    /// f_refl and f_high in an outgoing direction.
    fn eval(&self, wo: [f32; 3]) -> Core<N>;

    /// f_refl and f_high in an outgoing direction, and the density with which [`Lobes::sample`] samples it.
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N>;

    /// Samples an outgoing direction and evaluates [`Lobes::eval_pdf`] there; `None` if the sample chose
    /// missed light.
    fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>);

    /// The energies that the lobes are scaled to.
    fn energies(&self) -> Energies<N>;
}

/// Lobes interpolated at every call.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncached<'a, const N: usize> {
    layout: &'a Layout,
    theta_i: f32,
    h_um: f32,
    sigma_per_um: [f32; N],
}

impl<const N: usize> Lobes<N> for Uncached<'_, N> {
    #[inline]
    fn eval(&self, wo: [f32; 3]) -> Core<N> {
        dispatch::eval(self.layout, self.theta_i, self.h_um, &self.sigma_per_um, wo)
    }

    #[inline]
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N> {
        dispatch::eval_pdf(self.layout, self.theta_i, self.h_um, &self.sigma_per_um, wo)
    }

    #[inline]
    fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        dispatch::sample(self.layout, self.theta_i, self.h_um, &self.sigma_per_um, u)
    }

    #[inline]
    fn energies(&self) -> Energies<N> {
        dispatch::energies(self.layout, self.theta_i, self.h_um, &self.sigma_per_um)
    }
}

/// Lobes that [`Cached::prepare`] interpolates once. A model with more lobes than the fast kernels support
/// stays [`Uncached`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cached<'a, const N: usize> {
    uncached: Uncached<'a, N>,
    prepared: Prepared<N>,
}

impl<const N: usize> Uncached<'_, N> {
    /// Interpolates the lobes into `prepared`. They are written in place because they are too large to move.
    #[inline]
    pub(crate) fn prepare(&self, prepared: &mut Prepared<N>) {
        self.prepare_drawn_by(DrawnBy::Mean, prepared);
    }

    #[inline]
    fn prepare_drawn_by(&self, drawn_by: DrawnBy, prepared: &mut Prepared<N>) {
        prepared.set(self.layout, self.theta_i, self.h_um, &self.sigma_per_um, drawn_by);
    }
}

impl<const N: usize> Cached<'_, N> {
    /// Interpolates the lobes in place, because they are too large to move.
    #[inline]
    pub(crate) fn prepare(&mut self) {
        self.uncached.prepare(&mut self.prepared);
    }

    #[inline(always)]
    fn with_prepared(&self) -> WithPrepared<'_, N> {
        WithPrepared::new(&self.uncached, &self.prepared)
    }
}

/// Lobes together with what [`Uncached::prepare`] prepared. If nothing was prepared, they behave as
/// [`Uncached`].
#[derive(Clone, Copy)]
pub(crate) struct WithPrepared<'a, const N: usize> {
    uncached: &'a Uncached<'a, N>,
    prepared: &'a Prepared<N>,
}

impl<'a, const N: usize> WithPrepared<'a, N> {
    #[inline(always)]
    pub(crate) fn new(uncached: &'a Uncached<'a, N>, prepared: &'a Prepared<N>) -> WithPrepared<'a, N> {
        WithPrepared { uncached, prepared }
    }
}

/// Cached lobes at one incidence for many absorptions. Directions are sampled in proportion to the energies
/// of the first absorption.
#[derive(Clone, Copy, Debug)]
pub struct ByFirst<'a, const N: usize> {
    lobes: Cached<'a, N>,
    energies: Energies<N>,
    /// Scattered energy over scattered plus missed energy, at the first absorption.
    hit: f32,
}

impl<const N: usize> ByFirst<'_, N> {
    /// Scattered energies, one for each absorption.
    pub fn albedo(&self) -> [f32; N] {
        self.energies.albedo()
    }

    /// Samples a direction, and evaluates the lobes there with the density by the first absorption.
    #[inline]
    pub fn sample(&self, u: [f32; 3]) -> Option<([f32; 3], LobeLight<N>)> {
        // The numbers above `hit` would choose missed light.
        let u = [(u[0] * self.hit).min(self.hit * (1.0 - 1e-6)), u[1], u[2]];
        let (w, core) = if self.lobes.prepared.is_nothing() {
            let Uncached { layout, theta_i, h_um, sigma_per_um } = self.lobes.uncached;
            let first = [sigma_per_um.first().copied().unwrap_or(0.0)];
            let (w, drawn) = Uncached { layout, theta_i, h_um, sigma_per_um: first }.sample(u);
            let w = w?;
            (w, Core { pdf: drawn.pdf, ..self.lobes.uncached.eval(w) })
        } else {
            let (w, core) = self.lobes.prepared.sample(u);
            (w?, core)
        };
        Some((w, LobeLight { refl: [core.refl; N], high: core.high, pdf: core.pdf / self.hit }))
    }
}

impl<const N: usize> Lobes<N> for WithPrepared<'_, N> {
    #[inline]
    fn eval(&self, wo: [f32; 3]) -> Core<N> {
        if self.prepared.is_nothing() { self.uncached.eval(wo) } else { self.prepared.eval(wo) }
    }

    #[inline]
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N> {
        if self.prepared.is_nothing() { self.uncached.eval_pdf(wo) } else { self.prepared.eval_pdf(wo) }
    }

    #[inline]
    fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        if self.prepared.is_nothing() { self.uncached.sample(u) } else { self.prepared.sample(u) }
    }

    #[inline]
    fn energies(&self) -> Energies<N> {
        self.prepared.energies().copied().unwrap_or_else(|| self.uncached.energies())
    }
}

impl<const N: usize> Lobes<N> for Cached<'_, N> {
    #[inline]
    fn eval(&self, wo: [f32; 3]) -> Core<N> {
        self.with_prepared().eval(wo)
    }

    #[inline]
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N> {
        self.with_prepared().eval_pdf(wo)
    }

    #[inline]
    fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        self.with_prepared().sample(u)
    }

    #[inline]
    fn energies(&self) -> Energies<N> {
        self.with_prepared().energies()
    }
}

impl PlyModel {
    #[inline(always)]
    pub(crate) fn uncached<const N: usize>(&self, theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Uncached<'_, N> {
        Uncached { layout: &self.layout, theta_i, h_um, sigma_per_um }
    }

    #[inline(always)]
    pub(crate) fn cached<const N: usize>(&self, theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Cached<'_, N> {
        Cached { uncached: self.uncached(theta_i, h_um, sigma_per_um), prepared: Prepared::nothing() }
    }

    /// The lobes at an incidence, interpolated once. Directions are sampled by the energies of the first
    /// absorption.
    #[doc(hidden)]
    pub fn by_first<const N: usize>(&self, theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> ByFirst<'_, N> {
        let mut lobes = self.cached(theta_i, h_um, sigma_per_um);
        lobes.uncached.prepare_drawn_by(DrawnBy::First, &mut lobes.prepared);
        let energies = lobes.energies();
        let of_first = energies.albedo().first().copied().unwrap_or(0.0);
        let hit = if of_first > 0.0 { of_first / (of_first + energies.r_d) } else { 0.0 };
        ByFirst { lobes, energies, hit }
    }

    /// Fraction of a beam that misses all fibers of the ply.
    #[inline]
    pub(crate) fn r_d(&self, theta_i: f32, h_um: f32) -> f32 {
        // With zero absorptions nothing but r_d is interpolated.
        self.uncached::<0>(theta_i, h_um, []).energies().r_d
    }
}
