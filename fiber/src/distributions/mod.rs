//! Distributions over latitude and azimuth, and the azimuths of paths through a cross section.

pub mod azimuthal;
pub(crate) mod fast;
pub(crate) mod gaussian;
pub(crate) mod latitudes;
pub(crate) mod longitudinal;
pub(crate) mod von_mises;
