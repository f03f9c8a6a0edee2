//! The binary file of a cloth.

pub(crate) mod pwc;
