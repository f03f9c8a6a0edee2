//! Tests of the fits. One program, so that they share what is loaded.

#[path = "../../../tests/it/synthetic/mod.rs"]
mod synthetic;
mod fabric;
mod family;
mod fit;
mod khungurn;
mod layers;
mod lbfgsb;
mod mgh;
mod planted;
mod speckle;
mod table_distance;
