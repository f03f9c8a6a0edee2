//! Shadows: the probability that light which leaves a ply escapes without hitting another ply.

pub(crate) mod shadow_table;
pub(crate) mod shadows;
pub(crate) mod splines;

pub use shadow_table::{
    BANDS, COLUMNS, LANES, MAX_SHARE, MEAN_Z, OFFSETS, ROWS, SIZE as SHADOW_BYTES, Toward, exit, z_of,
};
pub use shadows::{ClothShade, ClothShadows, is_own};
pub use splines::{At as SplinesAt, COUNT as SPLINES, Several as SeveralSplines};
