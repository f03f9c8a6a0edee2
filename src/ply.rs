//! The ply model (Yu 2025, Eq. 8): reflection lobes interpolated over (theta_i, h), high-order lobes in
//! overlapping blocks, absorption by each lobe's path-length spectrum, and the simulated energies, which the
//! evaluator reproduces exactly.

pub mod asg;
mod bsdf;
pub mod cone;
pub(crate) mod data;
mod edge;
mod family;
mod kernel;
mod layers;
mod lines;
mod model;
mod on;
mod place;
mod queries;
mod query;
#[doc(hidden)]
pub mod reference;
mod relief;
mod slit;
mod terms;
mod two_layers;

pub use bsdf::PlyBsdf;
pub use cone::LobeKind;
pub use data::PlyData;
pub use data::edge_lobes::{EDGE_MU_MAX, EdgeLobes, beam_mu};
pub use data::energies::{EnergiesAt, PlyEnergies, spline_coefficients};
pub use data::exits::{
    EXIT_KINDS, EXIT_LENGTH_UM, EXIT_LENGTHS, EXIT_TERMS, ExitOffsets, ExitShape, USUAL_EXIT_LENGTHS, exit_terms,
};
#[doc(hidden)]
pub use data::exits::{ExitDensity, ExitLine, ExitsAt};
pub use data::file::ReferenceValue;
pub use data::layer_factors::LayerFactors;
pub(crate) use data::{MAX_LOBES, MAX_PATHS};
pub use family::{FamilyAxis, FamilyData, FamilyGradient, FamilyParam, FamilyParams, FamilyPly, PlyFamily};
pub(crate) use kernel::dispatch::Prepared;
#[doc(hidden)]
pub use kernel::lobes::{ByFirst, LobeLight};
pub use layers::{Layer, TwoLayers};
pub(crate) use lines::{PASSED_COLUMNS, PASSED_ROWS};
pub use model::PlyModel;
pub(crate) use on::{UncachedPly, hit_chance};
pub use place::{FibersAround, PlyPlace};
pub use queries::Queries;
pub use query::{PlyQuery, PlyTerms};
pub use relief::Relief;
