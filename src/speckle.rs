//! Speckle: patterns of simulated fibers and the statistics that noise must match; and noise, whose spectrum
//! is stored in a model, whose tiles are made from it at first use, and which a query looks up.

mod lookup;
mod noise;
mod patterns;
mod spectrum;
mod tiles;

pub(crate) use lookup::Speckle;
pub use noise::Noise;
pub use patterns::{FORWARD_RAD, SpecklePatterns, SpecklePolarization, SpeckleSide, SpeckleStatistics};
pub use spectrum::NoiseSpectrum;
pub use tiles::{Instance, NoiseTiles, SEAM_RAD};
