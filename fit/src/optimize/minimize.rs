//! Bounded minimization for the fits: keeps the best point and stops by the gain over a window of
//! evaluations.

use crate::optimize::lbfgsb::{CostGradient, LbfgsbOptions, minimize};
use std::cell::RefCell;
use std::collections::VecDeque;

/// Stopping criteria and memory.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MinimizeOptions {
    /// Largest number of iterations.
    pub iterations: usize,
    /// Relative decrease of the cost over [`WINDOW`] evaluations below which the run stops; single steps of a
    /// quasi-Newton method are too uneven to judge by.
    pub tolerance: f64,
    /// Number of correction pairs of the quasi-Newton model.
    pub memory: usize,
}

/// Result of a minimization.
#[derive(Clone, Debug)]
pub(crate) struct Minimum {
    pub x: Vec<f64>,
    pub cost: f64,
    pub evaluations: usize,
}

/// Number of evaluations over which progress is judged.
const WINDOW: usize = 11;

/// Error that ends a run whose window shows no more gain.
#[derive(Debug, thiserror::Error)]
#[error("the cost no longer falls")]
struct Settled;

struct Watched<F> {
    objective: RefCell<F>,
    watch: RefCell<Watch>,
    tolerance: f64,
}

struct Watch {
    best: f64,
    x: Vec<f64>,
    evaluations: usize,
    window: VecDeque<f64>,
}

impl<F: FnMut(&[f64], &mut [f64]) -> f64> CostGradient for Watched<F> {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        let cost = (self.objective.borrow_mut())(x, gradient);
        let watch = &mut *self.watch.borrow_mut();
        watch.evaluations += 1;
        if cost < watch.best {
            watch.best = cost;
            watch.x.copy_from_slice(x);
        }
        watch.window.push_back(watch.best);
        if watch.window.len() > WINDOW {
            let old = watch.window.pop_front().unwrap_or(watch.best);
            if old - watch.best <= self.tolerance * old.abs() {
                return Err(Settled.into());
            }
        }
        Ok(cost)
    }
}

/// Minimizes `objective(x, gradient) -> cost` within the bounds, from `start` clamped to them. Returns the
/// best point found, whatever ends the run.
pub(crate) fn minimize_bounded(
    start: &[f64],
    lower: &[f64],
    upper: &[f64],
    options: MinimizeOptions,
    objective: impl FnMut(&[f64], &mut [f64]) -> f64,
) -> Minimum {
    let start: Vec<f64> = start.iter().zip(lower).zip(upper).map(|((x, l), u)| x.max(*l).min(*u)).collect();
    let watch = Watch { best: f64::INFINITY, x: start.clone(), evaluations: 0, window: VecDeque::new() };
    let watched =
        Watched { objective: RefCell::new(objective), watch: RefCell::new(watch), tolerance: options.tolerance };
    let settings = LbfgsbOptions {
        memory: options.memory,
        pgtol: 1e-12,
        ftol: 0.0,
        max_iterations: options.iterations as u64,
        ..LbfgsbOptions::default()
    };
    // An error is either `Settled` or a start without finite cost; in both cases the watch contains the best
    // result.
    let _ = minimize(&watched, &start, lower, upper, &settings);
    let watch = watched.watch.into_inner();
    Minimum { x: watch.x, cost: watch.best, evaluations: watch.evaluations }
}
