//! Fitter of plywave: from tables of simulated scattering to ply models of anisotropic spherical Gaussian lobes.

mod absorption;
mod block;
mod fit;
mod fit_errors;
mod init;
mod minimize;
mod model;
mod nnls;
mod reflection;
mod sphere;

pub use absorption::{PATHS, choose_paths, energy_spectrum};
pub use block::{BlockEffort, CORNERS, corner_weights};
pub use fit::{FitError, FitOptions, Progress, Stage, fit};
pub use fit_errors::{FitErrors, errors};
pub use init::kmeans_lobes;
pub use model::{Place, ScaledLobes, energy_high, high_lobes, high_lobes_in_block, locate, refl_lobes};
pub use nnls::nnls;
pub use reflection::ReflectionEffort;
pub use sphere::{PaddedSlice, Scratch, SphereGrid};
