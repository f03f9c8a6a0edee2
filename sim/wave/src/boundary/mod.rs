//! Boundary integral equations for fibers of any outline: assembly, quadrature, solution, and far fields.

#[cfg(test)]
mod absorbing_tests;
pub(crate) mod assemble;
pub(crate) mod close;
pub(crate) mod entries;
pub(crate) mod extinction;
pub(crate) mod incident;
pub(crate) mod kernel;
pub(crate) mod lu;
pub(crate) mod nystrom;
#[cfg(test)]
mod nystrom_tests;
pub(crate) mod system;
pub(crate) mod vicinity;
pub(crate) mod walls;
