//! Tests of the C interface. One program, so that they share what is loaded.

mod calls;
mod cloth;
mod errors;
mod small_cloth;
mod status;
