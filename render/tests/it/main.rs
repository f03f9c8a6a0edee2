//! Tests of the reference host. One program, so that they share loaded data.

mod host;
mod lights;
mod pbrt_text;
mod skies;
#[path = "../../../tests/it/small_cloth.rs"]
mod small_cloth;
mod strand_dual;
mod strand_files;
mod strand_light;
mod strands;
