//! Tests of the wave code. One program, so that they share loaded data.

mod fiber;
mod fiber_truths;
mod filament_rays;
mod refused;
mod speckle;
mod speckle_field;
#[path = "../../../../tests/it/synthetic/mod.rs"]
mod synthetic;
