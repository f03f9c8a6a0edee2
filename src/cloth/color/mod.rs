//! Senses of colors, and conversion of yarn colors to absorptions.

pub mod color_of;
pub(crate) mod dye;
pub(crate) mod yarn_colors;
