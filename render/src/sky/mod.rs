//! Skies: pictures in latitude and longitude as environment light.

pub(crate) mod environment;
mod exr;
mod file;
mod picture;
pub(crate) mod primaries;
