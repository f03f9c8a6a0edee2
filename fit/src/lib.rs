//! Fitter of plywave: fits ply models with lobes (anisotropic spherical Gaussians, Yu 2025, Eq. 4, or cones)
//! to tables of simulated scattering, and Khungurn's fiber model to measured or simulated fibers.

mod check;
mod diagnose;
mod diff;
mod edge;
mod energies;
mod error;
mod exits;
mod family;
mod fit;
mod fit_errors;
mod khungurn;
mod layers;
mod lobes;
mod optimize;
mod options;
mod table_distance;

pub use diagnose::{Part, PartFit, fit_block, fit_single_slices};
pub use diff::{DiffReport, DiffTolerance, LobeDrift, diff, lobe_drift};
pub use edge::{EdgeFit, EdgeOptions, edge_error, fit_edge, fit_edge_lobes};
pub use energies::has_energies_of;
pub use error::FitError;
pub use exits::{fit_exit_lengths, fit_exits};
pub use family::{FamilyMiddle, FamilyTables, fit_family};
pub use fit::{Progress, Stage, fit, frame};
pub use fit_errors::{FitErrors, errors};
pub use khungurn::{KhungurnFit, KhungurnFitError, SwatchOptions, SwatchSample, fit_khungurn, fit_khungurn_swatch};
pub use layers::layer_factors;
pub use lobes::{
    BlockEffort, CORNERS, GridCell, PATHS, PaddedSlice, ReflectionEffort, ScaledLobes, Scratch, SliceLobes, SphereGrid,
    canonical, canonical_order, canonicalize, choose_paths, corner_weights, energies, energy_high, energy_spectrum,
    high_lobes, high_lobes_in_block, kmeans_lobes, locate, nearest_representation, refl_lobes,
};
pub use optimize::{
    CostGradient, Lbfgsb, LbfgsbError, LbfgsbOptions, LbfgsbSolution, LbfgsbState, LbfgsbStop, minimize, nnls,
};
pub use options::FitOptions;
pub use table_distance::{TableDistance, model_distance, table_distance};
