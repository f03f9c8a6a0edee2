//! Speckle: patterns of simulated fibers and the statistics that noise must match; and noise, whose spectrum
//! is stored in a model, and the field of sources that a query evaluates.

mod field;
mod lookup;
mod patterns;
mod spectrum;

pub use field::NoiseField;
pub use lookup::SEAM_RAD;
pub(crate) use lookup::Speckle;
pub use patterns::{FORWARD_RAD, SpecklePatterns, SpecklePolarization, SpeckleSide, SpeckleStatistics};
pub(crate) use spectrum::NAMES as NOISE_NAMES;
pub use spectrum::NoiseSpectrum;
