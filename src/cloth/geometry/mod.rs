//! Ply curves over a periodic cell, and their intersection with lines.

pub(crate) mod axis_at;
pub(crate) mod curves;
pub(crate) mod grid;
pub(crate) mod lattice;
pub(crate) mod lines;
pub(crate) mod nearest;
pub(crate) mod plies;
pub(crate) mod uneven;

pub use axis_at::AxisAt;
pub use plies::{ClothPlies, Runs, beyond, frame, start};
pub use uneven::Uneven;
