//! L-BFGS-B, minimization under simple bounds l <= x <= u, as a solver of argmin and as a plain function.
//!
//! The algorithm is that of Byrd, Lu, Nocedal, Zhu, "A limited memory algorithm for bound constrained
//! optimization" (SIAM J. Sci. Comput. 16, 1995) with the subspace step of Morales and Nocedal (ACM TOMS 38,
//! 2011): generalized Cauchy point, subspace minimization, Moré-Thuente search for the strong Wolfe
//! conditions. The numerics are those of the crate `basin`, driven one iteration at a time; this file adds
//! what argmin and the fits need around them:
//! - [`Lbfgsb`], an argmin [`Solver`] over `IterState<Vec<f64>, Vec<f64>, (), (), (), f64>`: observers see
//!   every iteration, and since the whole history is part of the serialized solver, a run resumed from a
//!   checkpoint continues bit for bit;
//! - [`CostGradient`], one call for cost and gradient: every argmin problem with `CostFunction` and
//!   `Gradient` has it, and an objective that computes both at once implements it alone;
//! - [`minimize`], the same steps without argmin's executor;
//! - a line search that steps back from costs and gradients that are not finite and never accepts such a
//!   point;
//! - errors and stopping reasons as values.
//!
//! No evaluation lies outside the bounds. An infeasible start is projected onto them, and l = u fixes a
//! variable. Not supported: general linear constraints, and scaling of the variables, which is up to the
//! caller because only the caller knows the units.

pub(crate) mod problem;
mod run;

use argmin::core::{IterState, KV, Problem, Solver, State, TerminationReason};
use serde::{Deserialize, Serialize};

pub use problem::{CostGradient, LbfgsbError, LbfgsbOptions, LbfgsbSolution, LbfgsbStop};
use run::{Run, projected_gradient};

/// The argmin state that [`Lbfgsb`] works on.
pub type LbfgsbState = IterState<Vec<f64>, Vec<f64>, (), (), (), f64>;

/// Minimizes `objective` within `lower <= x <= upper` from `x0`.
///
/// All three vectors have the same length; `f64::NEG_INFINITY` and `f64::INFINITY` stand for no bound.
///
/// # Errors
/// Bounds, options or start out of range, a start whose cost is not finite, or an error of the objective. A
/// line search without success is not an error: see [`LbfgsbStop::NoProgress`].
pub fn minimize<O: CostGradient + ?Sized>(
    objective: &O,
    x0: &[f64],
    lower: &[f64],
    upper: &[f64],
    options: &LbfgsbOptions,
) -> Result<LbfgsbSolution, LbfgsbError> {
    let mut run = Run::start(objective, x0, lower, upper, options)?;
    while run.stop.is_none() {
        if run.iterations >= options.max_iterations {
            run.stop = Some(LbfgsbStop::MaxIterations);
            break;
        }
        run.advance(objective, options)?;
    }
    let (x, cost, gradient) = run.current()?;
    Ok(LbfgsbSolution {
        x: x.clone(),
        cost,
        gradient: gradient.clone(),
        projected_gradient: projected_gradient(x, gradient, &run.lower, &run.upper),
        iterations: run.iterations,
        evaluations: run.evaluations,
        stop: run.stop.clone().unwrap_or(LbfgsbStop::MaxIterations),
    })
}

/// L-BFGS-B as a solver of argmin.
///
/// It stops with `SolverConverged` for `pgtol` and `ftol` ([`Lbfgsb::stop`] tells which), and with
/// `SolverExit` if no further progress is possible. Observers receive `pg_norm` (largest component of the
/// projected gradient) and `evaluations`. A checkpoint needs a format that preserves every bit and
/// infinities, like argmin's own file checkpoints; plain JSON does not.
///
/// ```
/// use argmin::core::{CostFunction, Error, Executor, Gradient};
/// use plywave_fit::Lbfgsb;
///
/// struct Parabola;
/// impl CostFunction for Parabola {
///     type Param = Vec<f64>;
///     type Output = f64;
///     fn cost(&self, x: &Vec<f64>) -> Result<f64, Error> {
///         Ok((x[0] - 3.0).powi(2) + x[1].powi(2))
///     }
/// }
/// impl Gradient for Parabola {
///     type Param = Vec<f64>;
///     type Gradient = Vec<f64>;
///     fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Error> {
///         Ok(vec![2.0 * (x[0] - 3.0), 2.0 * x[1]])
///     }
/// }
///
/// let solver = Lbfgsb::new(vec![-1.0, -1.0], vec![2.0, f64::INFINITY]);
/// let result = Executor::new(Parabola, solver).configure(|state| state.param(vec![0.0, 5.0]).max_iters(100)).run()?;
/// assert_eq!(result.state.best_param.unwrap()[0], 2.0);
/// # Ok::<(), Error>(())
/// ```
#[derive(Serialize, Deserialize)]
pub struct Lbfgsb {
    lower: Option<Vec<f64>>,
    upper: Option<Vec<f64>>,
    options: LbfgsbOptions,
    run: Option<Run>,
}

impl Lbfgsb {
    /// Solver for `lower <= x <= upper`; infinities stand for no bound. The bounds are checked when the run
    /// starts.
    #[must_use]
    pub fn new(lower: Vec<f64>, upper: Vec<f64>) -> Self {
        Self { lower: Some(lower), upper: Some(upper), options: LbfgsbOptions::default(), run: None }
    }

    /// Solver without bounds.
    #[must_use]
    pub fn unbounded() -> Self {
        Self { lower: None, upper: None, options: LbfgsbOptions::default(), run: None }
    }

    /// Sets all options at once.
    #[must_use]
    pub fn with_options(mut self, options: LbfgsbOptions) -> Self {
        self.options = options;
        self
    }

    /// Sets the number of correction pairs, see [`LbfgsbOptions::memory`].
    #[must_use]
    pub fn with_memory(mut self, memory: usize) -> Self {
        self.options.memory = memory;
        self
    }

    /// Sets the tolerance on the projected gradient, see [`LbfgsbOptions::pgtol`].
    #[must_use]
    pub fn with_pgtol(mut self, pgtol: f64) -> Self {
        self.options.pgtol = pgtol;
        self
    }

    /// Sets the tolerance on the relative decrease, see [`LbfgsbOptions::ftol`].
    #[must_use]
    pub fn with_ftol(mut self, ftol: f64) -> Self {
        self.options.ftol = ftol;
        self
    }

    /// Sets the number of evaluations allowed in one line search, see [`LbfgsbOptions::max_line_search`].
    #[must_use]
    pub fn with_max_line_search(mut self, max_line_search: u32) -> Self {
        self.options.max_line_search = max_line_search;
        self
    }

    /// Reason for which the run stopped; `None` while it runs and if argmin's executor stopped it.
    #[must_use]
    pub fn stop(&self) -> Option<&LbfgsbStop> {
        self.run.as_ref().and_then(|run| run.stop.as_ref())
    }

    /// Number of evaluations of cost and gradient together since the start, including those before a
    /// checkpoint.
    #[must_use]
    pub fn evaluations(&self) -> u64 {
        self.run.as_ref().map_or(0, |run| run.evaluations)
    }

    /// Publishes the run's current point in argmin's state.
    fn publish<O>(
        run: &Run,
        before: u64,
        problem: &mut Problem<O>,
        state: LbfgsbState,
    ) -> Result<(LbfgsbState, Option<KV>), argmin::core::Error> {
        for name in ["cost_count", "gradient_count"] {
            *problem.counts.entry(name).or_insert(0) += run.evaluations - before;
        }
        let (x, cost, gradient) = run.current()?;
        let pg_norm = projected_gradient(x, gradient, &run.lower, &run.upper);
        let state = state.param(x.clone()).gradient(gradient.clone()).cost(cost);
        let state = match &run.stop {
            None => state,
            Some(LbfgsbStop::NoProgress(what)) => state.terminate_with(TerminationReason::SolverExit(what.clone())),
            Some(_) => state.terminate_with(TerminationReason::SolverConverged),
        };
        let kv = argmin::core::KV::from_iter([("pg_norm", pg_norm.into()), ("evaluations", run.evaluations.into())]);
        Ok((state, Some(kv)))
    }
}

impl<O: CostGradient> Solver<O, LbfgsbState> for Lbfgsb {
    fn name(&self) -> &str {
        "L-BFGS-B"
    }

    fn init(
        &mut self,
        problem: &mut Problem<O>,
        mut state: LbfgsbState,
    ) -> Result<(LbfgsbState, Option<KV>), argmin::core::Error> {
        let x0 = state.take_param().ok_or(LbfgsbError::NoStart)?;
        let lower = self.lower.clone().unwrap_or_else(|| vec![f64::NEG_INFINITY; x0.len()]);
        let upper = self.upper.clone().unwrap_or_else(|| vec![f64::INFINITY; x0.len()]);
        let objective = problem.problem.as_ref().ok_or(LbfgsbError::NoStart)?;
        let run = self.run.insert(Run::start(objective, &x0, &lower, &upper, &self.options).map_err(unwrapped)?);
        Self::publish(run, 0, problem, state)
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<O>,
        state: LbfgsbState,
    ) -> Result<(LbfgsbState, Option<KV>), argmin::core::Error> {
        let run = self.run.as_mut().ok_or(LbfgsbError::NoStart)?;
        let before = run.evaluations;
        let objective = problem.problem.as_ref().ok_or(LbfgsbError::NoStart)?;
        run.advance(objective, &self.options).map_err(unwrapped)?;
        Self::publish(run, before, problem, state)
    }
}

/// Passes an objective's error unchanged to argmin, so that it can be downcast.
fn unwrapped(error: LbfgsbError) -> argmin::core::Error {
    match error {
        LbfgsbError::Objective(error) => error,
        error => error.into(),
    }
}
