//! Kernels of the ply model in f32: the tables in memory, the cell of an incidence, prepared lobes, and the
//! evaluation and sampling of lobes in the lanes of vectors.

pub(super) mod absorption;
pub(super) mod batch;
pub(super) mod cone_lobe;
pub(super) mod cone_mixture;
pub(super) mod dispatch;
pub(super) mod energy;
pub(super) mod grid_cell;
pub(super) mod interpolate;
pub(super) mod layout;
pub(super) mod lobe;
pub(super) mod mixture;
pub(super) mod prepared;
pub(super) mod slit;
