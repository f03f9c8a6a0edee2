//! Inputs and results of a minimization: objective, options, errors, solution.

use argmin::core::{CostFunction, Gradient};
use serde::{Deserialize, Serialize};

/// An objective that computes cost and gradient in one evaluation.
///
/// Every argmin problem with `CostFunction<Param = Vec<f64>, Output = f64>` and
/// `Gradient<Param = Vec<f64>, Gradient = Vec<f64>>` implements it by calling the two in turn.
pub trait CostGradient {
    /// Cost at `x`; writes the gradient to `gradient`, which has the length of `x`.
    ///
    /// An infinite or NaN cost or gradient makes the line search step back.
    ///
    /// # Errors
    /// An error ends the whole minimization.
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error>;
}

impl<O> CostGradient for O
where
    O: CostFunction<Param = Vec<f64>, Output = f64> + Gradient<Param = Vec<f64>, Gradient = Vec<f64>>,
{
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        let x = x.to_vec();
        let cost = self.cost(&x)?;
        let g = self.gradient(&x)?;
        if g.len() != gradient.len() {
            return Err(LbfgsbError::Length { name: "gradient", len: g.len(), expected: gradient.len() }.into());
        }
        gradient.copy_from_slice(&g);
        Ok(cost)
    }
}

/// Errors that prevent a minimization from starting or continuing.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LbfgsbError {
    /// A vector has the wrong length.
    #[error("L-BFGS-B: {name} has length {len}, give {expected}")]
    Length {
        /// Name of the vector.
        name: &'static str,
        /// Its length.
        len: usize,
        /// The length of x0.
        expected: usize,
    },
    /// An empty or inverted interval, or a bound that is NaN or infinite on the wrong side.
    #[error("L-BFGS-B: bounds [{lower}, {upper}] of variable {index} hold no number, give lower <= upper")]
    Bounds {
        /// Index of the variable.
        index: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// An option is outside its range.
    #[error("L-BFGS-B: option {name} = {value}, give {allowed}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Allowed values.
        allowed: &'static str,
    },
    /// No start was given, or an iteration was requested before the start.
    #[error("L-BFGS-B: no start, give one with `configure(|state| state.param(x0))`")]
    NoStart,
    /// The start is infinite or NaN.
    #[error("L-BFGS-B: x0[{index}] = {value}, give a finite start")]
    Start {
        /// Index of the variable.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// Cost or gradient at the (projected) start is infinite or NaN.
    #[error("L-BFGS-B: cost {cost} or its gradient is not finite at the start, give another x0")]
    NotFinite {
        /// Cost at the start.
        cost: f64,
    },
    /// The objective itself failed.
    #[error("L-BFGS-B: the objective failed: {0}")]
    Objective(argmin::core::Error),
}

/// Tolerances and sizes of [`Lbfgsb`] and [`minimize`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LbfgsbOptions {
    /// Number of correction pairs, 1 to 200; 3 to 20 are useful (SciPy's `maxcor`).
    pub memory: usize,
    /// Stop when the largest component of the projected gradient is at most this (SciPy's `gtol`).
    pub pgtol: f64,
    /// Stop when (f_k - f_k+1) / max(|f_k|, |f_k+1|, 1) is at most this (SciPy's `ftol`).
    pub ftol: f64,
    /// Largest number of evaluations in one line search, at least 1 (SciPy's `maxls`); the count restarts
    /// when the search steps back from an infinite or NaN cost.
    pub max_line_search: u32,
    /// Largest number of iterations of [`minimize`]; argmin's executor has its own `max_iters`.
    pub max_iterations: u64,
}

impl Default for LbfgsbOptions {
    /// SciPy's values: memory 10, pgtol 1e-5, ftol 1e7 epsilon, 20 line search steps, 15000 iterations.
    fn default() -> Self {
        Self { memory: 10, pgtol: 1e-5, ftol: 1e7 * f64::EPSILON, max_line_search: 20, max_iterations: 15_000 }
    }
}

impl LbfgsbOptions {
    pub(super) fn check(&self) -> Result<(), LbfgsbError> {
        let bad = |name, value, allowed| Err(LbfgsbError::Option { name, value, allowed });
        if !(1..=200).contains(&self.memory) {
            return bad("memory", self.memory as f64, "1 to 200");
        }
        if !(self.pgtol.is_finite() && self.pgtol >= 0.0) {
            return bad("pgtol", self.pgtol, "a finite number >= 0");
        }
        if !(self.ftol.is_finite() && self.ftol >= 0.0) {
            return bad("ftol", self.ftol, "a finite number >= 0");
        }
        if self.max_line_search == 0 {
            return bad("max_line_search", 0.0, "1 or more");
        }
        Ok(())
    }
}

/// Reason for which a minimization stopped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum LbfgsbStop {
    /// The projected gradient's largest component is at most `pgtol`.
    Gradient,
    /// The relative decrease of the last iteration is at most `ftol`.
    Decrease,
    /// The number of iterations reached `max_iterations`.
    MaxIterations,
    /// No step decreased the cost, not even along the projected gradient: the step is at rounding, or cost
    /// and gradient are inconsistent, or no point ahead is finite. The solution is the best evaluated point.
    /// The string is the message of `basin`.
    NoProgress(String),
}

/// Result of [`minimize`].
#[derive(Debug, Clone, PartialEq)]
pub struct LbfgsbSolution {
    /// The best point, within the bounds.
    pub x: Vec<f64>,
    /// Cost at `x`.
    pub cost: f64,
    /// Gradient at `x`, same length.
    pub gradient: Vec<f64>,
    /// Largest component of the projected gradient at `x`.
    pub projected_gradient: f64,
    /// Number of iterations.
    pub iterations: u64,
    /// Number of evaluations of cost and gradient together.
    pub evaluations: u64,
    /// Reason for which the minimization stopped.
    pub stop: LbfgsbStop,
}
