//! Figures: false-colour maps of the outgoing sphere, energy budgets and grids of numbers, drawn with no outside help.

pub mod axes;
pub mod budget;
pub mod canvas;
pub mod colormap;
mod font;
pub mod grid;
pub mod map;
pub mod sheet;
