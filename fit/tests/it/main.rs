//! Tests of the fits. One program, so that they share loaded data.

mod cloth;
mod family;
mod fit;
mod khungurn;
mod layers;
mod lbfgsb;
mod mgh;
mod planted;
#[path = "../../../tests/it/small_cloth.rs"]
mod small_cloth;
#[path = "../../../tests/it/synthetic/mod.rs"]
mod synthetic;
mod table_distance;
