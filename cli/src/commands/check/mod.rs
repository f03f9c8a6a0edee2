//! Checks of models, cloths and fibers.

// The command of the same name is one of them.
#[allow(clippy::module_inception)]
pub mod check;
pub mod check_cloth;
pub mod check_filament;
pub mod check_traced;
