//! The ply model (Yu 2025, Eq. 8): reflection lobes interpolated over (theta_i, h), high-order lobes in overlapping blocks,
//! absorption by each lobe's path-length spectrum, and the simulated energies, which the evaluator holds exactly.

pub mod asg;
mod batch;
mod bsdf;
mod compiled;
pub mod cone;
mod cone_lobe;
mod cone_mixture;
mod data;
mod dispatch;
mod edge;
pub(crate) mod edge_lobes;
mod energies;
mod energy;
mod exits;
mod family;
mod file;
mod interpolate;
mod layer_factors;
mod layers;
mod layout;
mod lines;
mod lobe;
mod lobes;
mod mixture;
mod model;
mod on;
mod place;
mod prepared;
mod queries;
mod query;
#[doc(hidden)]
pub mod reference;
mod slit;
mod terms;
mod two_layers;

pub use bsdf::PlyBsdf;
pub use cone::LobeFamily;
pub use data::PlyData;
pub(crate) use data::{MAX_LOBES, MAX_PATHS};
pub use edge_lobes::{EDGE_MU_MAX, EdgeLobes, beam_mu};
pub use energies::{EnergiesAt, PlyEnergies, spline_coefficients};
pub use exits::{
    EXIT_KINDS, EXIT_LENGTH_UM, EXIT_LENGTHS, EXIT_TERMS, ExitOffsets, ExitShape, USUAL_EXIT_LENGTHS, exit_terms,
};
pub(crate) use exits::{ExitDensity, ExitLine, ExitsAt};
pub use family::{FamilyAxis, FamilyData, FamilyGradient, FamilyParam, FamilyParams, FamilyPly, PlyFamily};
pub use file::ReferenceValue;
pub use layer_factors::LayerFactors;
pub use layers::{Layer, TwoLayers};
pub(crate) use lines::{PASSED_COLUMNS, PASSED_ROWS, PassedLines};
pub(crate) use lobes::{ByFirst, Cached, LobeLight, Lobes, Uncached};
pub use model::PlyModel;
pub(crate) use on::{PlyOn, UncachedPly};
pub use queries::Queries;
pub use query::{PlyQuery, PlyTerms};
