//! Tests of the pipeline. One program, so that they share what is loaded.

mod build;
mod exits;
