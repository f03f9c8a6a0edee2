//! The one door to the bounded minimizer.

use basin::{ApplicationStop, BoxBounds, ConstraintSet, CostFunction, Executor, FirstOrderState, Gradient, Lbfgsb};
use std::cell::RefCell;
use std::convert::Infallible;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MinimizeOptions {
    /// Largest number of iterations.
    pub iterations: usize,
    /// Stop when ten iterations together lower the cost by less than this fraction.
    pub tolerance: f64,
    /// Pairs kept by the quasi-Newton model.
    pub memory: usize,
}

/// Where it stopped.
#[derive(Clone, Debug)]
pub(crate) struct Minimum {
    pub x: Vec<f64>,
    pub cost: f64,
    pub evaluations: usize,
}

struct Problem<'a, F> {
    lower: &'a Vec<f64>,
    upper: &'a Vec<f64>,
    objective: RefCell<F>,
}

impl<F: FnMut(&[f64], &mut [f64]) -> f64> CostFunction for &Problem<'_, F> {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = Infallible;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Infallible> {
        Ok((self.objective.borrow_mut())(x, &mut vec![0.0; x.len()]))
    }
}

impl<F: FnMut(&[f64], &mut [f64]) -> f64> Gradient for &Problem<'_, F> {
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Infallible> {
        Ok(self.cost_and_gradient(x)?.1)
    }
    fn cost_and_gradient(&self, x: &Vec<f64>) -> Result<(f64, Vec<f64>), Infallible> {
        let mut gradient = vec![0.0; x.len()];
        let cost = (self.objective.borrow_mut())(x, &mut gradient);
        Ok((cost, gradient))
    }
}

impl<F> basin::Constraints for &Problem<'_, F> {
    type Set = ConstraintSet<BoxBounds<Vec<f64>>>;
    fn constraints(&self) -> <Self::Set as basin::ConstraintDescription>::Borrowed<'_> {
        ConstraintSet::new().with_bounds(BoxBounds::new(Some(self.lower), Some(self.upper)))
    }
}

/// Minimizes `objective(x, gradient) -> cost` within the box, from `start` clamped into it. A failed line search ends the run
/// with the best point found.
pub(crate) fn minimize_bounded(
    start: &[f64],
    lower: &[f64],
    upper: &[f64],
    options: MinimizeOptions,
    objective: impl FnMut(&[f64], &mut [f64]) -> f64,
) -> Minimum {
    let start: Vec<f64> = start.iter().zip(lower).zip(upper).map(|((x, l), u)| x.clamp(*l, *u)).collect();
    let best = RefCell::new((f64::INFINITY, start.clone(), 0usize));
    let mut objective = objective;
    let tracked = |x: &[f64], g: &mut [f64]| {
        let cost = objective(x, g);
        let mut best = best.borrow_mut();
        best.2 += 1;
        if cost < best.0 {
            best.0 = cost;
            best.1.clear();
            best.1.extend_from_slice(x);
        }
        cost
    };
    let (lower, upper) = (lower.to_vec(), upper.to_vec());
    let problem = Problem { lower: &lower, upper: &upper, objective: RefCell::new(tracked) };
    let solver = Lbfgsb::new()
        .with_m_capacity(options.memory)
        .with_relative_cost_reduction_tolerance(None)
        .with_absolute_projected_gradient_tolerance(1e-12);
    let mut window: std::collections::VecDeque<f64> = std::collections::VecDeque::new();
    let _ = Executor::new(&problem, solver, FirstOrderState::new(start))
        .max_iter(options.iterations as u64)
        .stop_when(move |state: &FirstOrderState<Vec<f64>>| {
            use basin::State;
            let cost = state.cost();
            window.push_back(cost);
            if window.len() > 10 {
                let old = window.pop_front().unwrap_or(cost);
                if old - cost <= options.tolerance * old.abs() {
                    return Some(ApplicationStop::new("cost_window"));
                }
            }
            None
        })
        .run();
    let (cost, x, evaluations) = best.into_inner();
    Minimum { x, cost, evaluations }
}
