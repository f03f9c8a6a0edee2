//! Tables that simulations write and fits read, with their files: the scattering of plies ([`table`]), of
//! cloths of explicit fibers ([`twin`]), and the patterns of single fibers ([`speckle`]).

pub mod speckle;
pub mod table;
pub mod twin;

pub use table::Table;
