//! Speckle: patterns of simulated fibers, the statistics of light that noise has to match; and noise, whose
//! spectrum a model carries, whose tiles are made of that when first asked for, and which a query looks up.

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
