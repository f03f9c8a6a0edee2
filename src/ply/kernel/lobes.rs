//! f_refl and f_high at one incidence, from lobes interpolated at every call (uncached), or once for many
//! calls (cached).

use super::dispatch::{self, Prepared};
use super::energy::{Core, DrawnBy, Energies};
use super::layout::Layout;
use crate::ply::model::PlyModel;

/// Values of the lobes in one direction, with the instance's patterns, and the density of sampling it from
/// them [1/sr]; light of slits is in f_high.
#[derive(Clone, Copy, Debug)]
pub struct LobeLight<const N: usize> {
    /// f_refl.
    pub refl: [f32; N],
    /// f_high.
    pub high: [f32; N],
    /// Density among directions that the lobes yield, without missed light: its integral is 1.
    pub pdf: f32,
}

/// The lobes of a model at one incidence, N absorptions.
pub(crate) trait Lobes<const N: usize> {
    /// f_refl and f_high in a direction.
    fn eval(&self, wo: [f32; 3]) -> Core<N>;

    /// f_refl and f_high in a direction with the density of [`Lobes::sample`].
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N>;

    /// A direction with [`Lobes::eval_pdf`] there; none for light that missed the fibers.
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

/// Lobes that [`Cached::prepare`] interpolates once; models with more lobes than the fast kernels support
/// stay [`Uncached`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cached<'a, const N: usize> {
    uncached: Uncached<'a, N>,
    prepared: Prepared<N>,
}

impl<const N: usize> Uncached<'_, N> {
    /// Prepares the lobes in place: they are too large to move.
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
    /// Prepares in place: lobes are too large to move.
    #[inline]
    pub(crate) fn prepare(&mut self) {
        self.uncached.prepare(&mut self.prepared);
    }

    #[inline(always)]
    fn kept(&self) -> Kept<'_, N> {
        Kept::new(&self.uncached, &self.prepared)
    }
}

/// Lobes with what [`Uncached::prepare`] made of them: [`Uncached`] of nothing.
#[derive(Clone, Copy)]
pub(crate) struct Kept<'a, const N: usize> {
    uncached: &'a Uncached<'a, N>,
    prepared: &'a Prepared<N>,
}

impl<'a, const N: usize> Kept<'a, N> {
    #[inline(always)]
    pub(crate) fn new(uncached: &'a Uncached<'a, N>, prepared: &'a Prepared<N>) -> Kept<'a, N> {
        Kept { uncached, prepared }
    }
}

/// Lobes of a ply that is hit, for many absorptions; directions are sampled by the first of them.
#[derive(Clone, Copy, Debug)]
pub struct ByFirst<'a, const N: usize> {
    lobes: Cached<'a, N>,
    energies: Energies<N>,
    /// Scattered share of all light that a sample may choose.
    hit: f32,
}

impl<const N: usize> ByFirst<'_, N> {
    /// Scattered energies.
    pub fn albedo(&self) -> [f32; N] {
        self.energies.albedo()
    }

    /// A direction, and the lobes there with the density of sampling it by the first absorption.
    #[inline]
    pub fn sample(&self, u: [f32; 3]) -> Option<([f32; 3], LobeLight<N>)> {
        // The last numbers belong to missed light.
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

impl<const N: usize> Lobes<N> for Kept<'_, N> {
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
        self.kept().eval(wo)
    }

    #[inline]
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N> {
        self.kept().eval_pdf(wo)
    }

    #[inline]
    fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        self.kept().sample(u)
    }

    #[inline]
    fn energies(&self) -> Energies<N> {
        self.kept().energies()
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

    /// The lobes at an incidence, interpolated once, for directions sampled by the first absorption.
    #[doc(hidden)]
    pub fn by_first<const N: usize>(&self, theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> ByFirst<'_, N> {
        let mut lobes = self.cached(theta_i, h_um, sigma_per_um);
        lobes.uncached.prepare_drawn_by(DrawnBy::First, &mut lobes.prepared);
        let energies = lobes.energies();
        let of_first = energies.albedo().first().copied().unwrap_or(0.0);
        let hit = if of_first > 0.0 { of_first / (of_first + energies.r_d) } else { 0.0 };
        ByFirst { lobes, energies, hit }
    }

    /// Fraction of a beam that passes the ply.
    #[inline]
    pub(crate) fn r_d(&self, theta_i: f32, h_um: f32) -> f32 {
        // Without absorptions nothing else is interpolated.
        self.uncached::<0>(theta_i, h_um, []).energies().r_d
    }
}
