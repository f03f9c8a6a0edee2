//! Tests of the pipeline. One program, so that they share loaded data.

mod build;
mod exits;
mod exports;
mod runs;
