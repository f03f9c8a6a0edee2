//! Tests of the fits. One program, so that they share loaded data.

mod fabric;
mod family;
mod fit;
mod khungurn;
mod layers;
mod lbfgsb;
mod mgh;
mod planted;
mod speckle;
#[path = "../../../tests/it/synthetic/mod.rs"]
mod synthetic;
mod table_distance;
