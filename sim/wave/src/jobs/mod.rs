//! Jobs of the wave code: far fields of scenes, fiber tables, speckle patterns, and the comparison of waves
//! with rays.

pub(crate) mod choice;
pub(crate) mod compare;
#[cfg(test)]
mod compare_tests;
pub(crate) mod rays;
pub(crate) mod scatter;
pub(crate) mod similarity;
pub(crate) mod speckle;
pub(crate) mod tabulate;
#[cfg(test)]
mod tabulate_tests;
pub(crate) mod total_field;
