//! Fitter of plywave.

mod lbfgsb;

pub use lbfgsb::{CostGradient, Lbfgsb, LbfgsbError, LbfgsbOptions, LbfgsbSolution, LbfgsbState, LbfgsbStop, minimize};
