//! Commands that make tables, models and cloths.

pub mod build;
pub mod cloth_file;
pub mod family;
pub mod farm;
pub mod fibers;
pub mod fit;
pub mod merge;
pub mod new;
pub mod simulate;
pub mod swatch;
pub mod twin;
pub mod weave;
