//! Incident light as sums of plane waves, and the expansion of plane waves in cylindrical ones.

pub(crate) mod series;
pub(crate) mod source;
