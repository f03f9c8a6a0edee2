//! Minimizers: L-BFGS-B for smooth costs within bounds, and non-negative least squares.

pub(crate) mod lbfgsb;
pub(crate) mod minimize;
pub(crate) mod nnls;

pub use lbfgsb::{CostGradient, Lbfgsb, LbfgsbError, LbfgsbOptions, LbfgsbSolution, LbfgsbState, LbfgsbStop, minimize};
pub use nnls::nnls;
