//! One interface to all models of a fiber: [`FiberModel`] evaluated at a [`FiberQuery`].
//!
//! It dispatches to tables of wave or ray optics (Xia 2020) and to the analytic models of `models`. Every
//! model at a query is a [`Bsdf`](plywave::Bsdf) of omega_o, relative to the light on the fiber's width.

use crate::models::dielectric::{DielectricBsdf, DielectricFiber};
use crate::models::kajiya_kay::{KajiyaKayBsdf, KajiyaKayFiber};
use crate::models::khungurn::{KhungurnBsdf, KhungurnFiber};
use crate::models::opaque::{OpaqueBsdf, OpaqueFiber};
use crate::models::rough_dielectric::{RoughDielectricBsdf, RoughDielectricFiber};
use crate::query::FiberQuery;
use crate::table::tabulated::{TabulatedBsdf, TabulatedFiber};
use plywave::bsdf::Outcomes;
use plywave::{Bsdf, BsdfSample, Result};
use std::path::Path;

/// A scattering model of one fiber: a table that `plywave wave tabulate` writes, loaded by
/// `FiberModel::load("fiber.pwf")`, or an analytic model. [`FiberModel::at`] evaluates it.
#[derive(Clone, Debug)]
pub enum FiberModel {
    /// A table from wave or ray optics (Xia 2020).
    Tabulated(TabulatedFiber),
    /// A smooth dielectric cylinder (Zinke 2007).
    Dielectric(DielectricFiber),
    /// An opaque cylinder, for metals, matte and varnished surfaces (Zinke 2007).
    Opaque(OpaqueFiber),
    /// A rough dielectric cylinder: R, TT, TRT and diffuse light; includes Marschner's model (Zinke 2007).
    RoughDielectric(RoughDielectricFiber),
    /// Kajiya and Kay's phenomenological model (1989).
    KajiyaKay(KajiyaKayFiber),
    /// The R and TT lobes of Khungurn (2015).
    Khungurn(KhungurnFiber),
}

impl FiberModel {
    /// Reads and checks a fiber file (.pwf).
    ///
    /// # Errors
    /// Those of [`FiberTable::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<FiberModel> {
        TabulatedFiber::load(path).map(FiberModel::Tabulated)
    }

    /// The model at a query.
    ///
    /// ```
    /// use plywave_fiber::{FiberTable, OutlineSymmetry};
    /// use plywave::Bsdf;
    /// use plywave_fiber::{FiberModel, FiberQuery};
    ///
    /// fn shade(fiber: &FiberModel, omega_i: [f32; 3], omega_o: [f32; 3], offset_um: f32) -> [f32; 3] {
    ///     let at = fiber.at(&FiberQuery::new(omega_i, [0.61, 0.55, 0.465]));
    ///     let (f, width_um) = (at.eval(omega_o), at.width_um());
    ///     // A ray beyond the width at a wavelength passes the fiber there.
    ///     std::array::from_fn(|k| if offset_um.abs() <= 0.5 * width_um[k] { f[k] } else { 0.0 })
    /// }
    /// ```
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> FiberBsdf<'_, N> {
        match self {
            FiberModel::Tabulated(fiber) => FiberBsdf(At::Tabulated(fiber.at(query))),
            FiberModel::Dielectric(fiber) => FiberBsdf(At::Dielectric(fiber.at(query))),
            FiberModel::Opaque(fiber) => FiberBsdf(At::Opaque(fiber.at(query))),
            FiberModel::RoughDielectric(fiber) => FiberBsdf(At::RoughDielectric(fiber.at(query))),
            FiberModel::KajiyaKay(fiber) => FiberBsdf(At::KajiyaKay(fiber.at(query))),
            FiberModel::Khungurn(fiber) => FiberBsdf(At::Khungurn(fiber.at(query))),
        }
    }

    /// Diameter [um] of the cylinder outside which the fiber scatters no ray, for any direction and
    /// wavelength.
    pub fn max_width_um(&self) -> f32 {
        match self {
            FiberModel::Tabulated(fiber) => fiber.max_width_um(),
            FiberModel::Dielectric(fiber) => 2.0 * fiber.parameters().radius_um,
            FiberModel::Opaque(fiber) => 2.0 * fiber.parameters().radius_um,
            FiberModel::RoughDielectric(fiber) => fiber.max_width_um(),
            FiberModel::KajiyaKay(fiber) => 2.0 * fiber.parameters().radius_um,
            FiberModel::Khungurn(fiber) => 2.0 * fiber.parameters().radius_um,
        }
    }
}

impl FiberModel {
    /// Longitudinal width of TT, the forward lobe [rad]; `None` for models without such a parameter.
    pub(crate) fn forward_beta(&self) -> Option<f32> {
        match self {
            FiberModel::Tabulated(fiber) => Some(fiber.table().beta_m as f32),
            FiberModel::Dielectric(fiber) => Some(fiber.parameters().beta_m[1]),
            FiberModel::RoughDielectric(fiber) => Some(fiber.parameters().width_theta[1]),
            FiberModel::Khungurn(fiber) => Some(fiber.parameters().beta_tt),
            FiberModel::Opaque(_) | FiberModel::KajiyaKay(_) => None,
        }
    }
}

impl From<OpaqueFiber> for FiberModel {
    fn from(fiber: OpaqueFiber) -> FiberModel {
        FiberModel::Opaque(fiber)
    }
}

impl From<RoughDielectricFiber> for FiberModel {
    fn from(fiber: RoughDielectricFiber) -> FiberModel {
        FiberModel::RoughDielectric(fiber)
    }
}

impl From<KajiyaKayFiber> for FiberModel {
    fn from(fiber: KajiyaKayFiber) -> FiberModel {
        FiberModel::KajiyaKay(fiber)
    }
}

impl From<KhungurnFiber> for FiberModel {
    fn from(fiber: KhungurnFiber) -> FiberModel {
        FiberModel::Khungurn(fiber)
    }
}

impl From<DielectricFiber> for FiberModel {
    fn from(fiber: DielectricFiber) -> FiberModel {
        FiberModel::Dielectric(fiber)
    }
}

impl From<TabulatedFiber> for FiberModel {
    fn from(fiber: TabulatedFiber) -> FiberModel {
        FiberModel::Tabulated(fiber)
    }
}

/// A fiber model at a query, from [`FiberModel::at`].
///
/// ```
/// use plywave::{Bsdf, BsdfSample};
/// use plywave_fiber::FiberBsdf;
///
/// fn bounce(fiber: &FiberBsdf<'_, 3>, u: [f32; 3]) -> Option<([f32; 3], [f32; 3])> {
///     match fiber.sample(u) {
///         BsdfSample::Scattered(light) => Some((light.w, light.weight)),
///         _ => None, // absorbed; light that hits an opaque fiber never goes straight on
///     }
/// }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct FiberBsdf<'a, const N: usize>(At<'a, N>);

#[derive(Clone, Copy, Debug)]
enum At<'a, const N: usize> {
    Tabulated(TabulatedBsdf<'a, N>),
    Dielectric(DielectricBsdf<'a, N>),
    Opaque(OpaqueBsdf<'a, N>),
    RoughDielectric(RoughDielectricBsdf<'a, N>),
    KajiyaKay(KajiyaKayBsdf<'a, N>),
    Khungurn(KhungurnBsdf<'a, N>),
}

/// Evaluates one expression for a model of any kind.
macro_rules! each {
    ($self:ident, $at:ident => $does:expr) => {
        match &$self.0 {
            At::Tabulated($at) => $does,
            At::Dielectric($at) => $does,
            At::Opaque($at) => $does,
            At::RoughDielectric($at) => $does,
            At::KajiyaKay($at) => $does,
            At::Khungurn($at) => $does,
        }
    };
}

impl<const N: usize> FiberBsdf<'_, N> {
    /// Width over which the fiber intercepts light [um], one for each wavelength.
    pub fn width_um(&self) -> [f32; N] {
        each!(self, at => at.width_um())
    }

    /// Whether a ray hits the fiber at each wavelength, if it passes the center line at the distance
    /// `offset_um` on either side.
    pub fn hit(&self, offset_um: f32) -> [bool; N] {
        self.width_um().map(|width| offset_um.abs() <= 0.5 * width)
    }
}

impl<const N: usize> Bsdf<N> for FiberBsdf<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        each!(self, at => at.eval(w))
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        each!(self, at => at.pdf(w))
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        each!(self, at => at.eval_pdf(w))
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        each!(self, at => at.sample(u))
    }

    fn albedo(&self) -> [f32; N] {
        each!(self, at => at.albedo())
    }

    fn outcomes(&self) -> Outcomes {
        each!(self, at => at.outcomes())
    }
}
