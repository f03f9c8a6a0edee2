//! Interfaces between media: Fresnel's equations, metals with measured indices, and the reflections of opaque
//! fibers.

pub mod fresnel;
mod metal;
pub mod reflections;

pub use metal::{Metal, conductor};
pub use reflections::{OpaqueIndex, Reflections};
