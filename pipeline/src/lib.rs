//! Pipeline of plywave: from a yarn's spec to its ply model, from a cloth spec to its cloth.
//!
//! A [`Recipe`] consists of a spec, a [`Quality`], a seed, overrides of sizes, and the source of speckle.
//! [`build`] builds its model, with progress, a stop flag and finished shards on disk. The stages are also
//! separate functions:
//!
//! ```text
//! spec --simulate--> table of a ply --yarn_table--> table of the yarn --fit_model--> model, edge lobes, layer factors --add_speckle--> model with noise
//! ```
//!
//! A [`ClothRecipe`] precomputes the cloth of a cloth spec, or loads it from the cache. [`exports`] writes a
//! cloth for other programs. [`swatch`] fits a cloth spec to two photographs.
//!
//! ```no_run
//! use plywave::Document;
//! use plywave_pipeline::{Quality, Recipe, Run, build};
//!
//! # fn main() -> Result<(), plywave_pipeline::Error> {
//! let built = build(&Recipe::load("silk.toml", Quality::Preview)?, &Run::plain())?;
//! built.model.save("silk.pwm")?;
//! # Ok(())
//! # }
//! ```

mod build;
mod cache;
mod cloth;
mod error;
pub mod exports;
mod family;
mod job;
mod plies;
mod recipe;
mod run;
mod shipped;
mod stages;
pub mod swatch;

pub use build::{Built, Times, build};
pub use cache::{cloth_cache, digest_of_bytes, digest_of_file};
pub use cloth::{ClothRecipe, PrecomputedCloth};
pub use error::Error;
pub use family::{
    FamilyFolder, FamilyJob, FamilyOptions, build_family, check_family_spec, energies_off, family_jobs, member,
};
pub use job::{AnyJob, Output, merge_parts};
pub use plies::{ClothPlies, ClothPlyModels};
pub use recipe::{Quality, Recipe, Speckle, with_keys};
pub use run::{Progress, Run, Stage};
pub use shipped::{SHIPPED_MODELS, ShippedKind, ShippedSpec, model_library};
pub use stages::{
    FitQuality, MIN_MET, add_speckle, check_fit, fit_model, held_errors, simulate, simulate_job, solve_speckle,
    speckle_options, yarn_table,
};
