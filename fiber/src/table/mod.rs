//! Tables of a fiber: the file format, and the model that evaluates a table.

// The type of the file and that of the model belong to one module.
#[allow(clippy::module_inception)]
pub(crate) mod table;
pub(crate) mod tabulated;
