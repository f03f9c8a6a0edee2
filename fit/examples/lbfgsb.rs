//! Bounded Rosenbrock in argmin's executor, with an observer that prints the progress.
//!
//! ```sh
//! cargo run --release -p plywave-fit --example lbfgsb
//! ```

use argmin::core::observers::{Observe, ObserverMode};
use argmin::core::{CostFunction, Error, Executor, Gradient, KV, State};
use plywave_fit::{Lbfgsb, LbfgsbState};

/// (1 - x)^2 + 100 (y - x^2)^2.
struct Rosenbrock;

impl CostFunction for Rosenbrock {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, p: &Vec<f64>) -> Result<f64, Error> {
        Ok((1.0 - p[0]).powi(2) + 100.0 * (p[1] - p[0] * p[0]).powi(2))
    }
}

impl Gradient for Rosenbrock {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, p: &Vec<f64>) -> Result<Vec<f64>, Error> {
        let valley = p[1] - p[0] * p[0];
        Ok(vec![-2.0 * (1.0 - p[0]) - 400.0 * p[0] * valley, 200.0 * valley])
    }
}

struct Progress;

impl Observe<LbfgsbState> for Progress {
    fn observe_iter(&mut self, state: &LbfgsbState, kv: &KV) -> Result<(), Error> {
        let (iteration, cost) = (state.get_iter(), state.get_cost());
        let pg_norm = kv.get("pg_norm").and_then(|norm| norm.get_float()).unwrap_or(f64::NAN);
        println!("{iteration:4}  cost {cost:.6e}  projected gradient {pg_norm:.2e}  at {:.6?}", state.get_param());
        Ok(())
    }
}

fn main() -> Result<(), Error> {
    // The free minimum (1, 1) lies outside: x may not pass 0.8, y has a lower bound only.
    let solver = Lbfgsb::new(vec![-1.5, -0.5], vec![0.8, f64::INFINITY]).with_memory(5).with_pgtol(1e-8).with_ftol(0.0);
    let result = Executor::new(Rosenbrock, solver)
        .configure(|state| state.param(vec![-1.2, 1.0]).max_iters(100))
        .add_observer(Progress, ObserverMode::Always)
        .run()?;
    let state = result.state();
    println!("{}", state.get_termination_status());
    println!("minimum {:.9} at {:.9?}", state.get_best_cost(), state.get_best_param());
    println!("{} evaluations of cost and gradient", result.solver.evaluations());
    Ok(())
}
