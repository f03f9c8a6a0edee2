//! Fitter of plywave: from tables of simulated scattering to ply models of anisotropic spherical Gaussian lobes.

mod absorption;
mod block;
mod canonical;
mod dark;
mod diagnose;
mod diff;
mod edge;
mod fit;
mod fit_errors;
mod init;
mod layers;
mod lbfgsb;
mod minimize;
mod model;
mod nnls;
pub mod noise;
mod reflection;
mod sphere;
mod table_distance;

pub use absorption::{PATHS, choose_paths, energy_spectrum};
pub use block::{BlockEffort, CORNERS, corner_weights};
pub use canonical::{canonical, canonical_order, canonicalize, nearest_representation};
pub use diagnose::{Part, PartFit, fit_block, fit_single_slices};
pub use diff::{DiffReport, DiffTolerance, LobeDrift, diff, lobe_drift};
pub use edge::{EdgeFit, EdgeOptions, edge_error, fit_edge, fit_edge_lobes};
pub use fit::{FitError, FitOptions, Progress, Stage, fit};
pub use fit_errors::{FitErrors, errors};
pub use init::kmeans_lobes;
pub use layers::layer_factors;
pub use lbfgsb::{CostGradient, Lbfgsb, LbfgsbError, LbfgsbOptions, LbfgsbSolution, LbfgsbState, LbfgsbStop, minimize};
pub use model::{Place, ScaledLobes, energy_high, high_lobes, high_lobes_in_block, locate, refl_lobes};
pub use nnls::nnls;
pub use reflection::ReflectionEffort;
pub use sphere::{PaddedSlice, Scratch, SphereGrid};
pub use table_distance::{TableDistance, model_distance, table_distance};
