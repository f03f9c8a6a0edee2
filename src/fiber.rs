//! Scattering models of single fibers behind one interface, [`FiberModel`]: tables from wave or ray optics
//! (Xia 2020), and analytic models (Zinke 2007).
//!
//! f is an energy density relative to the light on the fiber's width; `cylinder` relates it to the measures
//! of the papers. A fiber is round, so a query's azimuth counts only for a table of an outline that is not
//! round, and for an elliptic section.

pub mod azimuthal;
pub mod cylinder;
mod dielectric;
pub mod dual_scattering;
mod far_table;
mod fast;
pub mod fresnel;
mod gaussian;
mod incident;
mod kajiya_kay;
mod khungurn;
mod latitudes;
mod longitudinal;
mod metal;
mod normalized;
pub mod opaque;
mod range;
mod reflectance;
pub mod reflections;
mod rough_dielectric;
mod spec;
mod table;
mod tabulated;
mod von_mises;

use crate::bsdf::Outcomes;
use crate::{Bsdf, BsdfSample, Result};
use std::path::Path;

pub use dielectric::{DielectricBsdf, DielectricFiber, DielectricParameters, MAX_ORDERS, MIN_FAR_WIDTH};
pub use kajiya_kay::{KajiyaKayBsdf, KajiyaKayFiber, KajiyaKayParameters};
pub use khungurn::{KhungurnBsdf, KhungurnFiber, KhungurnParameters};
pub use metal::{Metal, conductor};
pub use opaque::{Mirror, OpaqueBsdf, OpaqueFiber, OpaqueParameters};
pub use reflectance::Reflectance;
pub use reflections::{OpaqueIndex, Reflections};
pub use rough_dielectric::{RoughDielectricBsdf, RoughDielectricFiber, RoughDielectricParameters};
#[doc(hidden)]
pub use spec::FILAMENT_RULES;
pub use spec::{FILAMENT_KINDS, FilamentSpec, filament_of};
pub use table::{FiberSource, FiberTable, OutlineSymmetry};
pub use tabulated::{TabulatedBsdf, TabulatedFiber, WIDTH_LIMIT};

/// A query at a shading point of a fiber, for N wavelengths.
///
/// ```
/// use plywave::FiberQuery;
/// use plywave::frame::direction;
///
/// let query = FiberQuery::new(direction(0.4, 1.1), [0.65, 0.55, 0.45]);
/// # assert!(query.h_rel.is_none());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiberQuery<const N: usize> {
    /// Direction that light comes from (the papers' omega_i), unit, in the fiber's frame: z along the fiber,
    /// x and y the axes of the outline.
    pub omega_i: [f32; 3],
    /// Offset of the ray from the center line over half the fiber's width, -1 to 1, for models that resolve
    /// it; `None` for the mean over all offsets. Tables contain only that mean and return it at every offset.
    pub h_rel: Option<f32>,
    /// Wavelengths [um].
    pub lambda_um: [f32; N],
    /// Absorption inside the fiber [1/um], by wavelength: its color. Tables ignore it, since they have their
    /// own.
    pub sigma_per_um: [f32; N],
}

impl<const N: usize> FiberQuery<N> {
    /// A query of light from `omega_i`, averaged over the offsets, on a clear fiber.
    pub fn new(omega_i: [f32; 3], lambda_um: [f32; N]) -> Self {
        FiberQuery { omega_i, h_rel: None, lambda_um, sigma_per_um: [0.0; N] }
    }
}

/// A scattering model of one fiber: a table that `plywave wave tabulate` writes, from
/// `FiberModel::load("fiber.pwf")`, or an analytic model; see [`FiberModel::at`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum FiberModel {
    /// A table, from wave or ray optics (Xia 2020).
    Tabulated(TabulatedFiber),
    /// A smooth dielectric cylinder (Zinke 2007).
    Dielectric(DielectricFiber),
    /// An opaque cylinder: metals, matte and varnished surfaces (Zinke 2007).
    Opaque(OpaqueFiber),
    /// A rough dielectric cylinder by R, TT, TRT and a diffuse rest; Marschner's model (Zinke 2007).
    RoughDielectric(RoughDielectricFiber),
    /// Kajiya and Kay's phenomenological model.
    KajiyaKay(KajiyaKayFiber),
    /// Khungurn's R and TT (2015).
    Khungurn(KhungurnFiber),
}

impl FiberModel {
    /// Reads and checks a fiber file (.pwf).
    ///
    /// # Errors
    /// As [`FiberTable::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<FiberModel> {
        TabulatedFiber::load(path).map(FiberModel::Tabulated)
    }

    /// The model at a query.
    ///
    /// ```
    /// use plywave::fiber::{FiberTable, OutlineSymmetry};
    /// use plywave::{Bsdf, FiberModel, FiberQuery};
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

    /// Diameter of the cylinder outside which the fiber scatters no ray, for any direction and wavelength
    /// [um].
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
    /// Longitudinal width of the forward lobe, TT's [rad], for models that have it as a parameter.
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
/// use plywave::{Bsdf, BsdfSample, FiberBsdf};
///
/// fn bounce(fiber: &FiberBsdf<'_, 3>, u: [f32; 3]) -> Option<([f32; 3], [f32; 3])> {
///     match fiber.sample(u) {
///         BsdfSample::Scattered(light) => Some((light.w, light.weight)),
///         _ => None, // absorbed: a fiber that takes light lets none pass
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

/// Evaluates one expression for the model of any kind.
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
    /// Width from which the fiber intercepts light [um], by wavelength.
    pub fn width_um(&self) -> [f32; N] {
        each!(self, at => at.width_um())
    }

    /// Whether a ray that passes the center line at the distance `offset_um`, on either side, hits the fiber,
    /// by wavelength.
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
