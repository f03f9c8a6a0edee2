//! Pictures, strands and exports.

pub mod export;
pub mod hairs;
pub mod render;
pub mod render_strands;
