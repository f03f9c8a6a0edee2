//! Tests of the simulators. One program, so that they share loaded data.

mod cloth;
mod cloth_energy;
mod cloth_gaps;
mod cloth_model;
mod mesh;
mod packing;
mod scattering;
mod shapes;
mod tracers;
mod twin;
mod yarn;
mod yarn_fibers;
mod yarn_table;
