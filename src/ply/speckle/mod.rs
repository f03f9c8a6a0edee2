//! Speckle noise (Yu 2025, 6.2): the spectrum that a model stores, and the field of sources that a query
//! evaluates.

mod field;
mod lookup;
mod spectrum;

pub use field::NoiseField;
pub use lookup::SEAM_RAD;
pub(crate) use lookup::Speckle;
pub(crate) use spectrum::NAMES as NOISE_NAMES;
pub use spectrum::NoiseSpectrum;
