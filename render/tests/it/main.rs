//! Tests of the reference host. One program, so that they share loaded data.

mod colors;
mod host;
mod lights;
mod pbrt_text;
mod skies;
mod strand_dual;
mod strand_files;
mod strand_light;
mod strands;
