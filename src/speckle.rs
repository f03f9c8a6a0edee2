//! Speckle: patterns of simulated fibers, the statistics of light that noise has to match; and tiles of noise, which a model carries and a query looks up.

mod lookup;
mod patterns;
pub(crate) mod tiles;

pub(crate) use lookup::Speckle;
pub use patterns::{FORWARD_RAD, SpecklePatterns, SpecklePolarization, SpeckleSide, SpeckleStatistics};
pub use tiles::{Instance, NoiseTiles, SEAM_RAD};
