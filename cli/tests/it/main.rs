//! Tests of the program. One program, so that they share what is loaded.

mod bad_input;
mod common;
mod compare;
mod docs;
mod fabrics;
mod false_alarms;
mod family;
mod fiber;
mod field;
mod figures;
mod filaments;
mod full_disk;
mod kinds;
mod library;
mod noise;
mod parts_folder;
mod pictures;
mod pipeline;
mod resume;
mod shell;
mod strands;
mod threads;
mod twin;
mod wave;
mod weave;
mod yarn;
