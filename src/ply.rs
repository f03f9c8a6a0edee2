//! The ply model (Yu 2025, Eq. 8).
//!
//! Reflection lobes are interpolated over (theta_i, h), high-order lobes in overlapping blocks of the grid.
//! Each lobe's path-length spectrum gives its absorption, and the result is scaled so that it has exactly the
//! simulated energies.

pub mod asg;
mod brightness;
mod bsdf;
pub mod cone;
pub(crate) mod data;
mod edge;
mod family;
mod file;
mod kernel;
mod layers;
mod lines;
mod lobes;
mod model;
mod place;
mod queries;
mod query;
mod relief;
mod single_layer;
pub mod speckle;
mod terms;
mod two_layers;

pub use bsdf::PlyBsdf;
pub use cone::LobeKind;
pub use data::drift::{DRIFT_BINS, DRIFT_MAX, DRIFT_QUANTILES, ExitDrift, drift_bin};
pub use data::edge_lobes::{EDGE_MU_MAX, EdgeLobes, beam_mu};
pub use data::energies::{EnergiesAt, PlyEnergies, spline_coefficients};
pub use data::exits::{
    EXIT_KINDS, EXIT_LENGTH_UM, EXIT_LENGTHS, EXIT_TERMS, ExitOffsets, ExitShape, USUAL_EXIT_LENGTHS, exit_terms,
};
#[doc(hidden)]
pub use data::exits::{EXIT_OFFSETS, ExitDensity, ExitLine, ExitsAt, OffsetShares};
pub use data::layer_factors::LayerFactors;
pub use data::{ENERGY_TOLERANCE, MIN_ENERGY, MIN_TRANSMITTANCE, PlyData, extended};
pub(crate) use data::{MAX_LOBES, MAX_PATHS};
pub use family::{FamilyAxis, FamilyData, FamilyGradient, FamilyParam, FamilyParams, FamilyPly, PlyFamily};
pub(crate) use kernel::dispatch::Prepared;
pub(crate) use kernel::lobe::LOBE_MEAN;
pub use layers::{Layer, TwoLayers};
pub(crate) use lines::{PASSED_COLUMNS, PASSED_ROWS};
#[doc(hidden)]
pub use lobes::{ByFirst, LobeLight};
pub use model::{PlyModel, ReferenceValue};
pub use place::{FibersAround, PlyPlace};
pub use queries::Queries;
pub use query::{PlyQuery, PlyTerms};
pub use relief::Relief;
pub(crate) use single_layer::{UncachedPly, hit_chance};
