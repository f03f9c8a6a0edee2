//! What f_refl and f_high answer at one incidence: of lobes interpolated anew at every call, or once for many.

use super::dispatch::{self, Made};
use super::energy::{Core, Energies};
use super::layout::Layout;
use crate::PlyModel;

/// The lobes of a model at one incidence, N absorptions.
pub(crate) trait Lobes<const N: usize> {
    /// f_refl and f_high in a direction.
    fn eval(&self, wo: [f32; 3]) -> Core<N>;

    /// The same with the density of [`Lobes::sample`].
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N>;

    /// The density, of the rest as much as it takes.
    fn pdf(&self, wo: [f32; 3]) -> Core<N>;

    /// A direction with what [`Lobes::eval_pdf`] is there; none for the light that missed.
    fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>);

    /// What the lobes are scaled to.
    fn energies(&self) -> Energies<N>;
}

/// Lobes that are interpolated at every call.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fresh<'a, const N: usize> {
    layout: &'a Layout,
    theta_i: f32,
    h_um: f32,
    sigma_per_um: [f32; N],
}

impl<const N: usize> Lobes<N> for Fresh<'_, N> {
    #[inline]
    fn eval(&self, wo: [f32; 3]) -> Core<N> {
        dispatch::run_eval(self.layout, self.theta_i, self.h_um, self.sigma_per_um, wo)
    }

    #[inline]
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N> {
        dispatch::run_eval_pdf(self.layout, self.theta_i, self.h_um, self.sigma_per_um, wo)
    }

    #[inline]
    fn pdf(&self, wo: [f32; 3]) -> Core<N> {
        dispatch::run_pdf(self.layout, self.theta_i, self.h_um, self.sigma_per_um, wo)
    }

    #[inline]
    fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        dispatch::run_sample(self.layout, self.theta_i, self.h_um, self.sigma_per_um, u)
    }

    #[inline]
    fn energies(&self) -> Energies<N> {
        dispatch::run_energies(self.layout, self.theta_i, self.h_um, self.sigma_per_um)
    }
}

/// Lobes that [`Ready::make`] interpolates once; those of models with more lobes than the fast kernels are made for stay [`Fresh`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ready<'a, const N: usize> {
    fresh: Fresh<'a, N>,
    made: Made<N>,
}

impl<const N: usize> Ready<'_, N> {
    /// In place: lobes are too large to be moved about.
    pub(crate) fn make(&mut self) {
        dispatch::run_make(
            self.fresh.layout,
            self.fresh.theta_i,
            self.fresh.h_um,
            &self.fresh.sigma_per_um,
            &mut self.made,
        );
    }
}

impl<const N: usize> Lobes<N> for Ready<'_, N> {
    #[inline]
    fn eval(&self, wo: [f32; 3]) -> Core<N> {
        match &self.made {
            Made::Few(made) => dispatch::made_eval(made, wo),
            Made::More(made) => dispatch::made_eval(made, wo),
            Made::Nothing => self.fresh.eval(wo),
        }
    }

    #[inline]
    fn eval_pdf(&self, wo: [f32; 3]) -> Core<N> {
        match &self.made {
            Made::Few(made) => dispatch::made_eval_pdf(made, wo),
            Made::More(made) => dispatch::made_eval_pdf(made, wo),
            Made::Nothing => self.fresh.eval_pdf(wo),
        }
    }

    #[inline]
    fn pdf(&self, wo: [f32; 3]) -> Core<N> {
        match &self.made {
            Made::Few(made) => dispatch::made_eval_pdf(made, wo),
            Made::More(made) => dispatch::made_eval_pdf(made, wo),
            Made::Nothing => self.fresh.pdf(wo),
        }
    }

    #[inline]
    fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        match &self.made {
            Made::Few(made) => dispatch::made_sample(made, u),
            Made::More(made) => dispatch::made_sample(made, u),
            Made::Nothing => self.fresh.sample(u),
        }
    }

    #[inline]
    fn energies(&self) -> Energies<N> {
        match &self.made {
            Made::Few(made) => made.energies,
            Made::More(made) => made.energies,
            Made::Nothing => self.fresh.energies(),
        }
    }
}

impl PlyModel {
    pub(crate) fn fresh<const N: usize>(&self, theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Fresh<'_, N> {
        Fresh { layout: &self.layout, theta_i, h_um, sigma_per_um }
    }

    pub(crate) fn ready<const N: usize>(&self, theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Ready<'_, N> {
        Ready { fresh: self.fresh(theta_i, h_um, sigma_per_um), made: Made::Nothing }
    }
}
