//! One minimization with the numerics of `basin`, an iteration at a time.

use std::cell::Cell;

use basin::{
    BoxBounds, ConstraintDescription, ConstraintSet, ConstraintSolveError, Constraints, FirstOrderState, LineSearch,
    LineSearchBounds, LineSearchOutcome, LineSearchResult, MoreThuente, NumericalFailure, Solver as _, State as _,
    Termination,
};
use serde::{Deserialize, Serialize};

use super::problem::{CostGradient, LbfgsbError, LbfgsbOptions, LbfgsbStop};

/// Relative changes of cost or variables up to this value count as rounding.
const ROUNDING: f64 = 10.0 * f64::EPSILON;

/// State of a minimization between two iterations: everything that a checkpoint needs.
#[derive(Serialize, Deserialize)]
pub(super) struct Run {
    pub(super) lower: Vec<f64>,
    pub(super) upper: Vec<f64>,
    numerics: basin::Lbfgsb<Vec<f64>, f64, SteppingBack>,
    /// Point, cost and gradient; moved out during an iteration, and lost only if the objective fails in it.
    progress: Option<FirstOrderState<Vec<f64>>>,
    pub(super) iterations: u64,
    pub(super) evaluations: u64,
    pub(super) stop: Option<LbfgsbStop>,
}

impl Run {
    /// Checks the input, projects the start onto the bounds and evaluates it.
    pub(super) fn start<O: CostGradient + ?Sized>(
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
    pub(super) fn current(&self) -> Result<(&Vec<f64>, f64, &Vec<f64>), LbfgsbError> {
        self.progress.as_ref().and_then(FirstOrderState::current).ok_or(LbfgsbError::NoStart)
    }

    /// Performs one iteration; sets `stop` if it was the last.
    pub(super) fn advance<O: CostGradient + ?Sized>(
        &mut self,
        objective: &O,
        options: &LbfgsbOptions,
    ) -> Result<(), LbfgsbError> {
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
            // A search that cannot narrow its interval further returns its last point, whose cost may exceed
            // that of the first.
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

/// Largest component of P(x - g) - x, P the projection onto the bounds.
pub(super) fn projected_gradient(x: &[f64], gradient: &[f64], lower: &[f64], upper: &[f64]) -> f64 {
    let components = (0..x.len())
        .map(|i| if gradient[i] < 0.0 { gradient[i].max(x[i] - upper[i]) } else { gradient[i].min(x[i] - lower[i]) });
    components.fold(0.0, |norm, component| component.abs().max(norm))
}

/// An evaluation that is not passed to `basin`.
enum Refusal {
    /// Cost or gradient is infinite or NaN at `x`.
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

/// Moré-Thuente search that restarts nearer to its origin when it reaches a point where the cost is infinite
/// or NaN.
///
/// The search interpolates, so an infinity would spoil its bracket. Half of the failed step becomes the new
/// bound, a quarter of it the new first trial.
#[derive(Serialize, Deserialize)]
struct SteppingBack(MoreThuente<f64>);

/// Largest number of retreats, each to a quarter: 4^-26 is the resolution of f64.
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
