//! Tests of fiber models. One program, so that they share loaded data.

mod dual_scattering;
mod dual_truth;
mod fiber;
mod filament;
mod khungurn;
#[path = "../../../tests/it/no_direction.rs"]
mod no_direction;
mod trust;
