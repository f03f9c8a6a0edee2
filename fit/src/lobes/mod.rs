//! Mixtures of lobes: evaluation on the outgoing grid, fits to slices of f_high and f_refl, canonical form,
//! and the lobes of a model at an incidence.

pub(crate) mod absorption;
pub(crate) mod block;
pub(crate) mod canonical;
pub(crate) mod cone;
pub(crate) mod dark;
pub(crate) mod init;
pub(crate) mod model;
pub(crate) mod reflection;
pub(crate) mod sphere;

pub use absorption::{PATHS, choose_paths, energy_spectrum};
pub use block::{BlockEffort, CORNERS, corner_weights};
pub use canonical::{canonical, canonical_order, canonicalize, nearest_representation};
pub use cone::SliceLobes;
pub use init::kmeans_lobes;
pub use model::{GridCell, ScaledLobes, energies, energy_high, high_lobes, high_lobes_in_block, locate, refl_lobes};
pub use reflection::ReflectionEffort;
pub use sphere::{PaddedSlice, Scratch, SphereGrid};
