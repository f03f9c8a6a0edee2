//! Knits of the cloth spec: named knits, and charts from text or from a picture.

pub(crate) mod chart;
pub(crate) mod picture;
pub(crate) mod spec;
