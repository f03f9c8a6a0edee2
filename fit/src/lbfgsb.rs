//! L-BFGS-B, minimisation under simple bounds l <= x <= u, as a solver of argmin and as a plain function.
//!
//! The algorithm is that of Byrd, Lu, Nocedal, Zhu, "A limited memory algorithm for bound constrained optimization"
//! (SIAM J. Sci. Comput. 16, 1995) with the subspace step of Morales and Nocedal (ACM TOMS 38, 2011): generalized Cauchy
//! point, subspace minimisation, Moré-Thuente search for the strong Wolfe conditions. The numerics are those of the crate
//! `basin`, driven one iteration at a time; this file adds what argmin and the fits need around them:
//! - [`Lbfgsb`], an argmin [`Solver`] over `IterState<Vec<f64>, Vec<f64>, (), (), (), f64>`: observers see every iteration,
//!   and since the whole history is part of the serialised solver, a run resumed from a checkpoint continues bit for bit;
//! - [`CostGradient`], one call for cost and gradient: every argmin problem with `CostFunction` and `Gradient` has it, and an
//!   objective that computes both at once implements it alone;
//! - [`minimize`], the same steps without argmin's executor;
//! - a line search that steps back from costs and gradients that are not finite: such a point is never accepted;
//! - errors and stopping reasons as values.
//!
//! No evaluation lies outside the bounds. An infeasible start is projected onto them, and l = u fixes a variable. What is left
//! out: general linear constraints, and scaling of the variables (the caller's, since only the caller knows the units).

use std::cell::Cell;

use argmin::core::{CostFunction, Gradient, IterState, KV, Problem, Solver, State, TerminationReason};
use basin::{
    BoxBounds, ConstraintDescription, ConstraintSet, ConstraintSolveError, Constraints, FirstOrderState, LineSearch,
    LineSearchBounds, LineSearchOutcome, LineSearchResult, MoreThuente, NumericalFailure, Solver as _, State as _,
    Termination,
};
use serde::{Deserialize, Serialize};

/// The argmin state that [`Lbfgsb`] works on.
pub type LbfgsbState = IterState<Vec<f64>, Vec<f64>, (), (), (), f64>;

/// An objective whose cost and gradient come out of one evaluation.
///
/// Every argmin problem with `CostFunction<Param = Vec<f64>, Output = f64>` and `Gradient<Param = Vec<f64>, Gradient =
/// Vec<f64>>` implements it by calling the two in turn.
pub trait CostGradient {
    /// Cost at `x`; writes the gradient to `gradient`, which has the length of `x`.
    ///
    /// A cost or gradient that is not finite makes the line search step back.
    ///
    /// # Errors
    /// An error ends the whole minimisation.
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

/// Why a minimisation could not start or go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LbfgsbError {
    /// A vector has the wrong length.
    #[error("L-BFGS-B: {name} has length {len}, give {expected}")]
    Length {
        /// Which vector.
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
    /// An option outside its range.
    #[error("L-BFGS-B: option {name} = {value}, give {allowed}")]
    Option {
        /// Which option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// No start was given, or an iteration was asked for before the start.
    #[error("L-BFGS-B: no start, give one with `configure(|state| state.param(x0))`")]
    NoStart,
    /// The start is not finite.
    #[error("L-BFGS-B: x0[{index}] = {value}, give a finite start")]
    Start {
        /// Index of the variable.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// Cost or gradient at the (projected) start is not finite.
    #[error("L-BFGS-B: cost {cost} or its gradient is not finite at the start, give another x0")]
    NotFinite {
        /// The cost there.
        cost: f64,
    },
    /// The objective itself failed.
    #[error("L-BFGS-B: the objective failed: {0}")]
    Objective(argmin::core::Error),
}

/// Tolerances and sizes of [`Lbfgsb`] and [`minimize`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LbfgsbOptions {
    /// Number of correction pairs kept, 1 to 200; 3 to 20 are useful (SciPy's `maxcor`).
    pub memory: usize,
    /// Stop when the largest component of the projected gradient is at most this (SciPy's `gtol`).
    pub pgtol: f64,
    /// Stop when (f_k - f_k+1) / max(|f_k|, |f_k+1|, 1) is at most this (SciPy's `ftol`).
    pub ftol: f64,
    /// Evaluations in one line search, at least 1 (SciPy's `maxls`).
    pub max_line_search: u32,
    /// Iterations of [`minimize`]; argmin's executor has its own `max_iters`.
    pub max_iterations: u64,
}

impl Default for LbfgsbOptions {
    /// SciPy's values: memory 10, pgtol 1e-5, ftol 1e7 epsilon, 20 line search steps, 15000 iterations.
    fn default() -> Self {
        Self { memory: 10, pgtol: 1e-5, ftol: 1e7 * f64::EPSILON, max_line_search: 20, max_iterations: 15_000 }
    }
}

impl LbfgsbOptions {
    fn check(&self) -> Result<(), LbfgsbError> {
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

/// Why a minimisation stopped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum LbfgsbStop {
    /// The projected gradient's largest component is at most `pgtol`.
    Gradient,
    /// The relative decrease of the last iteration is at most `ftol`.
    Decrease,
    /// `max_iterations` reached.
    MaxIterations,
    /// No step decreased the cost, not even along the projected gradient: rounding has been reached, or cost and gradient do not
    /// belong together, or no point ahead is finite. The point reported is the best one seen. Holds the numerics' own words.
    NoProgress(String),
}

/// What [`minimize`] found.
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
    /// Iterations done.
    pub iterations: u64,
    /// Evaluations of cost and gradient together.
    pub evaluations: u64,
    /// Why it stopped.
    pub stop: LbfgsbStop,
}

/// Minimises `objective` within `lower <= x <= upper` from `x0`.
///
/// All three vectors have the same length; `f64::NEG_INFINITY` and `f64::INFINITY` stand for no bound.
///
/// # Errors
/// Bounds, options or start out of range, a start whose cost is not finite, or an error of the objective. A line search that
/// finds nothing is no error: see [`LbfgsbStop::NoProgress`].
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
/// Its reasons to stop: `SolverConverged` for `pgtol` and `ftol` ([`Lbfgsb::stop`] tells which), `SolverExit` when no further
/// progress is possible. Observers get `pg_norm` (largest component of the projected gradient) and `evaluations`. A
/// checkpoint needs a format that keeps every bit and infinities, like argmin's own file checkpoints; plain JSON does not.
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
    /// Solver for `lower <= x <= upper`; infinities stand for no bound. The bounds are checked when the run starts.
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

    /// Why the run stopped, `None` while it goes on or when argmin's executor stopped it.
    #[must_use]
    pub fn stop(&self) -> Option<&LbfgsbStop> {
        self.run.as_ref().and_then(|run| run.stop.as_ref())
    }

    /// Evaluations of cost and gradient together since the start, checkpoints included.
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

/// An objective's own error comes out of argmin as it went in, so that it can be downcast.
fn unwrapped(error: LbfgsbError) -> argmin::core::Error {
    match error {
        LbfgsbError::Objective(error) => error,
        error => error.into(),
    }
}

/// Relative changes of cost or variables up to this are rounding.
const ROUNDING: f64 = 10.0 * f64::EPSILON;

/// One minimisation between two iterations: everything that a checkpoint must hold.
#[derive(Serialize, Deserialize)]
struct Run {
    lower: Vec<f64>,
    upper: Vec<f64>,
    numerics: basin::Lbfgsb<Vec<f64>, f64, SteppingBack>,
    /// Point, cost, gradient; taken during an iteration, and lost only when the objective fails in it.
    progress: Option<FirstOrderState<Vec<f64>>>,
    iterations: u64,
    evaluations: u64,
    stop: Option<LbfgsbStop>,
}

impl Run {
    /// Checks the input, projects the start and evaluates there.
    fn start<O: CostGradient + ?Sized>(
        objective: &O,
        x0: &[f64],
        lower: &[f64],
        upper: &[f64],
        options: &LbfgsbOptions,
    ) -> Result<Self, LbfgsbError> {
        options.check()?;
        if x0.is_empty() {
            return Err(LbfgsbError::Length { name: "x0", len: 0, expected: 1 });
        }
        for (name, bounds) in [("lower", lower), ("upper", upper)] {
            if bounds.len() != x0.len() {
                return Err(LbfgsbError::Length { name, len: bounds.len(), expected: x0.len() });
            }
        }
        for (index, (&lower, &upper)) in lower.iter().zip(upper).enumerate() {
            // An infinity means no bound on its own side only.
            if lower.is_nan() || upper.is_nan() || lower > upper || lower == f64::INFINITY || upper == f64::NEG_INFINITY
            {
                return Err(LbfgsbError::Bounds { index, lower, upper });
            }
        }
        if let Some(index) = x0.iter().position(|v| !v.is_finite()) {
            return Err(LbfgsbError::Start { index, value: x0[index] });
        }
        let mut run = Self {
            lower: lower.to_vec(),
            upper: upper.to_vec(),
            numerics: basin::Lbfgsb::with_line_search(SteppingBack(MoreThuente::new().maxfev(options.max_line_search)))
                .with_m_capacity(options.memory)
                .with_absolute_projected_gradient_tolerance(options.pgtol)
                .with_relative_cost_reduction_tolerance(options.ftol),
            progress: None,
            iterations: 0,
            evaluations: 0,
            stop: None,
        };
        let mut problem = basin::Problem::new(Boxed::new(objective, &run.lower, &run.upper));
        let progress = run.numerics.init(&mut problem, FirstOrderState::new(x0.to_vec()))?;
        run.evaluations = problem.inner().evaluations.get();
        run.progress = Some(progress);
        let (x, _, gradient) = run.current()?;
        if projected_gradient(x, gradient, &run.lower, &run.upper) <= options.pgtol {
            run.stop = Some(LbfgsbStop::Gradient);
        }
        Ok(run)
    }

    /// Current point, cost and gradient.
    fn current(&self) -> Result<(&Vec<f64>, f64, &Vec<f64>), LbfgsbError> {
        self.progress.as_ref().and_then(FirstOrderState::current).ok_or(LbfgsbError::NoStart)
    }

    /// One iteration; sets `stop` when it was the last.
    fn advance<O: CostGradient + ?Sized>(&mut self, objective: &O, options: &LbfgsbOptions) -> Result<(), LbfgsbError> {
        let (x, cost, gradient) = self.current()?;
        let (x_old, cost_old, gradient_old) = (x.clone(), cost, gradient.clone());
        let progress = self.progress.take().ok_or(LbfgsbError::NoStart)?;
        let mut problem = basin::Problem::new(Boxed::new(objective, &self.lower, &self.upper));
        let step = self.numerics.next_iter(&mut problem, progress);
        self.evaluations += problem.inner().evaluations.get();
        let (mut progress, completed, termination) = step?.into_parts();
        if completed {
            progress.increment_iter();
            self.iterations += 1;
        }
        let (x, cost, gradient) = progress.current().ok_or(LbfgsbError::NoStart)?;
        let rise = (cost - cost_old) / cost.abs().max(cost_old.abs()).max(1.0);
        let stationary = projected_gradient(x, gradient, &self.lower, &self.upper) <= options.pgtol;
        let moved = x.iter().zip(&x_old).any(|(x, old)| (x - old).abs() > ROUNDING * x.abs().max(old.abs()));
        self.stop = if stationary && rise <= ROUNDING {
            Some(LbfgsbStop::Gradient)
        } else if rise > 0.0 || (completed && rise == 0.0 && !moved) {
            // A search that can narrow its interval no further gives its last point, which may lie above the first one.
            let restored = progress.replace(x_old, cost_old, gradient_old);
            restored.map_err(|error| LbfgsbError::Objective(argmin::core::Error::msg(error.to_string())))?;
            Some(if rise <= ROUNDING && moved {
                LbfgsbStop::Decrease
            } else {
                LbfgsbStop::NoProgress("L-BFGS-B line search found no decrease.".to_string())
            })
        } else {
            let termination = termination.or_else(|| self.numerics.check_convergence(&problem, &progress));
            termination.map(|termination| match termination {
                Termination::Converged(_) => LbfgsbStop::Decrease,
                Termination::Failed(NumericalFailure::Solver { message, .. }) => LbfgsbStop::NoProgress(message),
                other => LbfgsbStop::NoProgress(format!("{other:?}")),
            })
        };
        self.progress = Some(progress);
        Ok(())
    }
}

/// Largest component of P(x - g) - x, P the projection onto the bounds (Byrd et al. 1995, Eq. 6.1).
fn projected_gradient(x: &[f64], gradient: &[f64], lower: &[f64], upper: &[f64]) -> f64 {
    let components = (0..x.len())
        .map(|i| if gradient[i] < 0.0 { gradient[i].max(x[i] - upper[i]) } else { gradient[i].min(x[i] - lower[i]) });
    components.fold(0.0, |norm, component| component.abs().max(norm))
}

/// An evaluation that the numerics may not use.
enum Refusal {
    /// Cost or gradient is not finite at `x`.
    NotFinite { x: Vec<f64>, cost: f64 },
    /// The objective failed.
    Objective(argmin::core::Error),
}

impl From<ConstraintSolveError<Refusal>> for LbfgsbError {
    fn from(error: ConstraintSolveError<Refusal>) -> Self {
        match error {
            ConstraintSolveError::Evaluation(Refusal::NotFinite { cost, .. }) => Self::NotFinite { cost },
            ConstraintSolveError::Evaluation(Refusal::Objective(error)) => Self::Objective(error),
            other => Self::Objective(argmin::core::Error::msg(match other {
                ConstraintSolveError::InvalidConstraints(error) => error.to_string(),
                _ => "the numerics refused the problem".to_string(),
            })),
        }
    }
}

/// The objective and its bounds as a problem of `basin`, counting evaluations.
struct Boxed<'a, O: ?Sized> {
    objective: &'a O,
    lower: &'a Vec<f64>,
    upper: &'a Vec<f64>,
    evaluations: Cell<u64>,
}

impl<'a, O: CostGradient + ?Sized> Boxed<'a, O> {
    fn new(objective: &'a O, lower: &'a Vec<f64>, upper: &'a Vec<f64>) -> Self {
        Self { objective, lower, upper, evaluations: Cell::new(0) }
    }
}

impl<O: ?Sized> Constraints for Boxed<'_, O> {
    type Set = ConstraintSet<BoxBounds<Vec<f64>>>;

    fn constraints(&self) -> <Self::Set as ConstraintDescription>::Borrowed<'_> {
        ConstraintSet::new().with_bounds(BoxBounds::new(Some(self.lower), Some(self.upper)))
    }
}

impl<O: CostGradient + ?Sized> basin::CostFunction for Boxed<'_, O> {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = Refusal;

    fn cost(&self, x: &Vec<f64>) -> Result<f64, Refusal> {
        basin::Gradient::cost_and_gradient(self, x).map(|(cost, _)| cost)
    }
}

impl<O: CostGradient + ?Sized> basin::Gradient for Boxed<'_, O> {
    type Gradient = Vec<f64>;

    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Refusal> {
        basin::Gradient::cost_and_gradient(self, x).map(|(_, gradient)| gradient)
    }

    fn cost_and_gradient(&self, x: &Vec<f64>) -> Result<(f64, Vec<f64>), Refusal> {
        let mut gradient = vec![0.0; x.len()];
        let cost = self.cost_and_gradient_into(x, &mut gradient)?;
        Ok((cost, gradient))
    }

    fn cost_and_gradient_into(&self, x: &Vec<f64>, gradient: &mut Vec<f64>) -> Result<f64, Refusal> {
        self.evaluations.set(self.evaluations.get() + 1);
        gradient.resize(x.len(), 0.0);
        let cost = self.objective.cost_gradient(x, gradient).map_err(Refusal::Objective)?;
        if cost.is_finite() && gradient.iter().all(|g| g.is_finite()) {
            Ok(cost)
        } else {
            Err(Refusal::NotFinite { x: x.clone(), cost })
        }
    }
}

/// Moré-Thuente search that starts over nearer to its origin when it meets a point that is not finite.
///
/// The search interpolates, so one infinity would poison its bracket. Half the step that failed becomes the new bound, a quarter
/// of it the new first trial.
#[derive(Serialize, Deserialize)]
struct SteppingBack(MoreThuente<f64>);

/// A quarter each time: 4^-26 is the resolution of f64.
const MAX_RETREATS: usize = 26;

impl<O: CostGradient + ?Sized> LineSearch<Boxed<'_, O>, Vec<f64>, f64> for SteppingBack {
    type Error = Refusal;

    fn next(
        &mut self,
        problem: &mut basin::Problem<Boxed<'_, O>>,
        x: &Vec<f64>,
        cost: f64,
        gradient: &Vec<f64>,
        direction: &Vec<f64>,
    ) -> Result<f64, Refusal> {
        self.0.next(problem, x, cost, gradient, direction)
    }

    fn next_with_bounds(
        &mut self,
        problem: &mut basin::Problem<Boxed<'_, O>>,
        x: &Vec<f64>,
        cost: f64,
        gradient: &Vec<f64>,
        direction: &Vec<f64>,
        bounds: LineSearchBounds<f64>,
    ) -> Result<LineSearchResult<Vec<f64>, f64>, Refusal> {
        let (mut first, mut max) = (bounds.initial(), bounds.max());
        for _ in 0..MAX_RETREATS {
            let interval = LineSearchBounds::new(first, max);
            match self.0.next_with_bounds(problem, x, cost, gradient, direction, interval) {
                Err(Refusal::NotFinite { x: trial, .. }) => {
                    let along: f64 = (0..x.len()).map(|i| (trial[i] - x[i]) * direction[i]).sum();
                    let step = along / direction.iter().map(|d| d * d).sum::<f64>();
                    max = max.min(0.5 * step);
                    first = first.min(0.25 * step);
                    if !(first > 0.0 && first <= max) {
                        break;
                    }
                }
                outcome => return outcome,
            }
        }
        Ok(LineSearchResult::new(LineSearchOutcome::Failed))
    }
}
