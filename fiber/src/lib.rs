//! Scattering models of single fibers behind one interface, [`FiberModel`]: tables from wave or ray optics
//! (Xia 2020), analytic models (Zinke 2007; Kajiya and Kay 1989; Khungurn 2015), and dual scattering by many
//! fibers ([`dual_scattering`]).
//!
//! f is an energy density relative to the light on the fiber's width; [`cylinder`] relates it to the
//! quantities of the papers. Fibers are round, so the azimuth of a query matters only for a table of an
//! outline that is not round, and for an elliptic cross section.

pub mod cylinder;
mod distributions;
pub mod dual_scattering;
mod incident;
mod model;
mod models;
mod query;
mod range;
mod spec;
mod table;

pub use distributions::azimuthal;
pub use model::{FiberBsdf, FiberModel};
pub use models::dielectric::{DielectricBsdf, DielectricFiber, DielectricParameters, MAX_ORDERS, MIN_FAR_WIDTH};
pub use models::kajiya_kay::{KajiyaKayBsdf, KajiyaKayFiber, KajiyaKayParameters};
pub use models::khungurn::{KhungurnBsdf, KhungurnFiber, KhungurnParameters};
pub use models::opaque;
pub use models::opaque::{Mirror, OpaqueBsdf, OpaqueFiber, OpaqueParameters};
pub use models::reflectance::Reflectance;
pub use models::rough_dielectric::{RoughDielectricBsdf, RoughDielectricFiber, RoughDielectricParameters};
pub use query::FiberQuery;
#[doc(hidden)]
pub use spec::FILAMENT_RULES;
pub use spec::{FILAMENT_KINDS, FilamentSpec, filament_of};
pub use table::table::{FiberSource, FiberTable, OutlineSymmetry};
pub use table::tabulated::{TabulatedBsdf, TabulatedFiber, WIDTH_LIMIT};

/// Compiles the examples of the documentation page.
#[cfg(doctest)]
mod pages {
    #[doc = include_str!("../../docs/explain/dual_scattering.md")]
    struct DualScattering;
}
