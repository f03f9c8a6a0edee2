//! What every scattering model answers at one incidence, so that one set of checks serves them all.

use crate::PlyModel;
use crate::ply::Lobes;

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterSample<const N: usize> {
    /// Outgoing direction, unit.
    pub wo: [f32; 3],
    /// f / pdf for each absorption (or wavelength).
    pub weight: [f32; N],
    /// Density of the direction [1/sr], the chance of not missing included.
    pub pdf: f32,
}

/// A scattering function f at one incidence, for N absorptions at once (N = 1 where a call has one wavelength).
///
/// f is an energy density [1/sr]: its integral over the sphere is the scattered fraction of the light that counts as incident, the cosine of an
/// outgoing surface or curve included. Directions are unit vectors that point away from the scatterer. No call fails, allocates or panics.
pub trait Scatter<const N: usize> {
    /// f in direction `wo` [1/sr].
    fn eval(&self, wo: [f32; 3]) -> [f32; N];

    /// Density [1/sr] with which [`Scatter::sample`] gives `wo`; integrates to `1 - miss`.
    fn pdf(&self, wo: [f32; 3]) -> f32;

    /// [`Scatter::eval`] and [`Scatter::pdf`], for models that share their work.
    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        (self.eval(wo), self.pdf(wo))
    }

    /// A direction from three uniform numbers in [0, 1); `None` for light that goes on unscattered.
    fn sample(&self, u: [f32; 3]) -> Option<ScatterSample<N>>;

    /// Integral of f over the sphere.
    fn albedo(&self) -> [f32; N];

    /// Chance that [`Scatter::sample`] gives `None`.
    fn miss(&self) -> f32;

    /// [`Scatter::eval`] and [`Scatter::pdf`] in many directions; the shortest slice sets how many.
    fn eval_directions(&self, wo: &[[f32; 3]], f: &mut [[f32; N]], pdf: &mut [f32]) {
        for ((wo, f), pdf) in wo.iter().zip(f).zip(pdf) {
            (*f, *pdf) = self.eval_pdf(*wo);
        }
    }
}

/// A ply model at one incidence.
#[derive(Clone, Copy, Debug)]
pub struct PlyIncidence<'a, const N: usize> {
    /// The model.
    pub model: &'a PlyModel,
    /// Incident latitude [rad].
    pub theta_i: f32,
    /// Offset of the beam's center [um].
    pub h_um: f32,
    /// Absorptions [1/um].
    pub sigma_per_um: [f32; N],
}

impl<const N: usize> Scatter<N> for PlyIncidence<'_, N> {
    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        self.model.eval(self.theta_i, self.h_um, self.sigma_per_um, wo)
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        self.model.pdf(self.theta_i, self.h_um, self.sigma_per_um, wo)
    }

    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        let core = self.model.fresh(self.theta_i, self.h_um, self.sigma_per_um).eval_pdf(wo);
        (core.high.map(|high| core.refl + high), core.pdf)
    }

    fn sample(&self, u: [f32; 3]) -> Option<ScatterSample<N>> {
        self.model.sample(self.theta_i, self.h_um, self.sigma_per_um, u)
    }

    fn albedo(&self) -> [f32; N] {
        self.model.albedo(self.theta_i, self.h_um, self.sigma_per_um)
    }

    fn miss(&self) -> f32 {
        let r_d = self.model.r_d(self.theta_i, self.h_um);
        let total = self.albedo().iter().sum::<f32>() / N.max(1) as f32 + r_d;
        if total > 0.0 { r_d / total } else { 1.0 }
    }

    fn eval_directions(&self, wo: &[[f32; 3]], f: &mut [[f32; N]], pdf: &mut [f32]) {
        self.model.eval_directions(self.theta_i, self.h_um, self.sigma_per_um, wo, f, pdf);
    }
}
