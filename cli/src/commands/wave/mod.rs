//! Commands of wave optics: scenes, fiber tables, speckle, diffraction, and comparisons with rays.

pub mod compare;
pub mod diffraction_view;
pub mod noise;
pub mod noise_view;
pub mod speckle_view;
pub mod wave_scatter;
pub mod wave_speckle;
pub mod wave_tabulate;
