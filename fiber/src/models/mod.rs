//! Analytic models of a fiber.

pub mod dielectric;
pub(crate) mod far_table;
pub mod kajiya_kay;
pub mod khungurn;
pub(crate) mod normalized;
pub mod opaque;
pub mod reflectance;
pub mod rough_dielectric;
