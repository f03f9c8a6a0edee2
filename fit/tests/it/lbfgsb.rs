//! L-BFGS-B on problems of More, Garbow and Hillstrom in seven settings of bounds and start.
//!
//! Chain of trust: the residuals agree with the same in Python and the gradients with differences; the minima
//! and the numbers of evaluations are compared with SciPy's (`tests/data/scipy_lbfgsb.json`, written by the
//! script beside it), and every iterate with the crate `basin` in its own executor. argmin's executor, with
//! and without a checkpoint, must then give the same bits.

use std::cell::Cell;
use std::rc::Rc;

use crate::mgh::{PROBLEMS, Watched, cost_gradient, residuals};
use argmin::core::checkpointing::CheckpointingFrequency;
use argmin::core::observers::{Observe, ObserverMode};
use argmin::core::{CostFunction, Executor, Gradient, KV, OptimizationResult, State, TerminationReason};
use argmin_checkpointing_file::FileCheckpoint;
use basin::State as _;
use plywave_fit::{
    CostGradient, Lbfgsb, LbfgsbError, LbfgsbOptions, LbfgsbSolution, LbfgsbState, LbfgsbStop, minimize,
};
use rand::RngExt;
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
    let reference: Reference = serde_json::from_str(include_str!("../data/scipy_lbfgsb.json")).expect("reference file");
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
fn residuals_agree_with_their_twins_and_gradients_with_differences() {
    let (runs, _) = reference();
    assert_eq!(runs.len(), 7 * PROBLEMS.len());
    for run in &runs {
        let (lower, upper) = run.bounds();
        let mut x: Vec<f64> = (0..run.x0.len()).map(|i| run.x0[i].clamp(lower[i], upper[i])).collect();
        let residuals = residuals(&run.problem);
        let (cost, gradient) = cost_gradient(residuals, &x);
        let err = (cost - run.cost_at_start).abs() / run.cost_at_start.abs();
        assert!(err < 1e-12, "{} {}: got {cost}, want {}, err {err}", run.problem, run.setting, run.cost_at_start);
        if run.setting != "free" {
            continue;
        }
        for i in 0..x.len() {
            let (at, h) = (x[i], 1e-5 * x[i].abs().max(1.0));
            x[i] = at + h;
            let (ahead, _) = cost_gradient(residuals, &x);
            x[i] = at - h;
            let (behind, _) = cost_gradient(residuals, &x);
            x[i] = at;
            let want = (ahead - behind) / (2.0 * h);
            // Rounding of the difference, and its cubic term relative to the gradient.
            let allowed = 1e-6 * gradient[i].abs() + 1e-9 * cost / h * 1e-5 + 1e-7;
            let err = (gradient[i] - want).abs();
            assert!(err < allowed, "{} d/dx{i}: got {}, want {want}, err {err}", run.problem, gradient[i]);
        }
    }
}

/// Here SciPy treats infinities as convergence, at a cost of 214; the minimum is 124.362 (problem 6 of More,
/// Garbow, Hillstrom).
const LOST_BY_SCIPY: (&str, &str) = ("jennrich_sampson", "free");

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
        let name = format!("{} {}", run.problem, run.setting);
        assert_eq!(*watched.outside.borrow(), None, "{name}: infeasible evaluation");
        assert_eq!(solution.evaluations, watched.evaluations.get(), "{name}");
        let (cost, _) = watched.evaluate(&solution.x);
        assert_eq!(cost, solution.cost, "{name}: cost belongs to another point");
        if (run.problem.as_str(), run.setting.as_str()) == LOST_BY_SCIPY {
            assert!((solution.cost - 124.362).abs() < 5e-4, "{name}: got {}", solution.cost);
            continue;
        }
        assert!(matches!(solution.stop, LbfgsbStop::Gradient | LbfgsbStop::Decrease), "{name}: {:?}", solution.stop);
        let err = (solution.cost - run.cost).abs();
        assert!(err <= 1e-6 * run.cost + 1e-9, "{name}: got {}, want {}, err {err}", solution.cost, run.cost);
        // Two evaluations are allowed on top for the shortest runs.
        let difference = solution.evaluations.abs_diff(run.evaluations);
        assert!(
            difference <= 2 + run.evaluations / 5,
            "{name}: {} evaluations, SciPy {}",
            solution.evaluations,
            run.evaluations
        );
        ours += solution.evaluations;
        scipys += run.evaluations;
    }
    println!("total {ours}, SciPy {scipys}, ratio {:.4}", ours as f64 / scipys as f64);
    assert!(5 * ours <= 6 * scipys && 5 * ours >= 4 * scipys, "{ours} evaluations, SciPy {scipys}");
}

/// The watched problem for basin's own executor.
struct Peer(Watched);

impl basin::Constraints for Peer {
    type Set = basin::ConstraintSet<basin::BoxBounds<Vec<f64>>>;
    fn constraints(&self) -> <Self::Set as basin::ConstraintDescription>::Borrowed<'_> {
        basin::ConstraintSet::new().with_bounds(basin::BoxBounds::new(Some(&self.0.lower), Some(&self.0.upper)))
    }
}

impl basin::CostFunction for Peer {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = std::convert::Infallible;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Self::Error> {
        Ok(self.0.evaluate(x).0)
    }
}

impl basin::Gradient for Peer {
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Self::Error> {
        Ok(self.0.evaluate(x).1)
    }
    fn cost_and_gradient(&self, x: &Vec<f64>) -> Result<(f64, Vec<f64>), Self::Error> {
        Ok(self.0.evaluate(x))
    }
}

#[test]
fn iterates_are_those_of_basin() {
    let (runs, options) = reference();
    let mut compared = 0;
    for run in &runs {
        let solver = basin::Lbfgsb::<Vec<f64>>::new()
            .with_m_capacity(options.memory)
            .with_absolute_projected_gradient_tolerance(options.pgtol)
            .with_relative_cost_reduction_tolerance(options.ftol);
        let state = basin::FirstOrderState::new(run.x0.clone());
        let peer =
            basin::Executor::new(Peer(run.watched()), solver, state).max_iter(options.max_iterations).run().unwrap();
        let (watched, solution) = solve(run, &options);
        let name = format!("{} {}", run.problem, run.setting);
        if (run.problem.as_str(), run.setting.as_str()) == LOST_BY_SCIPY {
            // basin alone stops where SciPy does; stepping back from the infinities reaches the minimum.
            assert!(
                peer.cost() > 200.0 && solution.cost < 125.0,
                "{name}: got {}, peer {}",
                solution.cost,
                peer.cost()
            );
            continue;
        }
        assert_eq!(solution.x, *peer.param(), "{name}");
        assert_eq!(solution.iterations, peer.state.iter(), "{name}");
        assert_eq!(watched.evaluations.get(), peer.state.counts().cost_evals, "{name}");
        compared += 1;
    }
    assert_eq!(compared, runs.len() - 1);
}

/// Observer that counts the calls of argmin's executor.
#[derive(Clone, Default)]
struct Witness {
    starts: Rc<Cell<u64>>,
    iterations: Rc<Cell<u64>>,
    ends: Rc<Cell<u64>>,
    pg_norm: Rc<Cell<f64>>,
}

impl Observe<LbfgsbState> for Witness {
    fn observe_init(&mut self, name: &str, _: &LbfgsbState, _: &KV) -> Result<(), argmin::core::Error> {
        assert_eq!(name, "L-BFGS-B");
        self.starts.set(self.starts.get() + 1);
        Ok(())
    }

    fn observe_iter(&mut self, _: &LbfgsbState, kv: &KV) -> Result<(), argmin::core::Error> {
        self.iterations.set(self.iterations.get() + 1);
        self.pg_norm.set(kv.get("pg_norm").and_then(|v| v.get_float()).expect("pg_norm"));
        Ok(())
    }

    fn observe_final(&mut self, _: &LbfgsbState) -> Result<(), argmin::core::Error> {
        self.ends.set(self.ends.get() + 1);
        Ok(())
    }
}

#[test]
fn argmin_executor_gives_the_same_bits_and_tells_its_observers() {
    let (runs, options) = reference();
    for run in &runs {
        let (_, want) = solve(run, &options);
        let watched = run.watched();
        let solver = Lbfgsb::new(watched.lower.clone(), watched.upper.clone()).with_options(options);
        let witness = Witness::default();
        let got = Executor::new(watched, solver)
            .configure(|state| state.param(run.x0.clone()).counting(true))
            .add_observer(witness.clone(), ObserverMode::Always)
            .run()
            .unwrap();
        let name = format!("{} {}", run.problem, run.setting);
        // argmin keeps the older of two points with the same cost as its best.
        assert_eq!(got.state.get_param(), Some(&want.x), "{name}");
        assert_eq!(got.state.get_best_cost(), want.cost, "{name}");
        assert_eq!(got.solver.stop(), Some(&want.stop), "{name}");
        assert_eq!(got.state.get_func_counts()["cost_count"], want.evaluations, "{name}");
        assert_eq!(got.state.get_func_counts()["gradient_count"], want.evaluations, "{name}");
        assert_eq!(got.solver.evaluations(), want.evaluations, "{name}");
        assert_eq!((witness.starts.get(), witness.ends.get()), (1, 1), "{name}");
        assert_eq!(witness.iterations.get(), got.state.get_iter(), "{name}");
        if got.state.get_iter() > 0 {
            assert_eq!(witness.pg_norm.get(), want.projected_gradient, "{name}");
        }
    }
}

/// Extended Rosenbrock with separate cost and gradient, as argmin's users write it; fails once its
/// evaluations are used up.
struct Separate {
    left: Cell<u64>,
}

impl CostFunction for Separate {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        self.left.set(self.left.get().checked_sub(1).ok_or(Fire)?);
        Ok(cost_gradient(residuals("extended_rosenbrock"), x).0)
    }
}

impl Gradient for Separate {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, argmin::core::Error> {
        Ok(cost_gradient(residuals("extended_rosenbrock"), x).1)
    }
}

/// The same program each time: resumes from the checkpoint in `folder`, if there is one.
fn program(
    evaluations: u64,
    folder: &str,
) -> Result<OptimizationResult<Separate, Lbfgsb, LbfgsbState>, argmin::core::Error> {
    let x0 = [-1.2, 1.0].repeat(10);
    let lower = vec![f64::NEG_INFINITY; x0.len()];
    let upper = (0..x0.len()).map(|i| if i % 3 == 0 { 0.8 } else { f64::INFINITY }).collect();
    let solver = Lbfgsb::new(lower, upper).with_memory(5).with_pgtol(1e-8).with_ftol(0.0).with_max_line_search(30);
    Executor::new(Separate { left: Cell::new(evaluations) }, solver)
        .configure(|state| state.param(x0).max_iters(1000))
        .checkpointing(FileCheckpoint::new(folder, "lbfgsb", CheckpointingFrequency::Every(7)))
        .run()
}

#[test]
fn a_run_resumed_from_a_checkpoint_continues_bit_for_bit() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [undisturbed, disturbed] = folders.each_ref().map(|folder| folder.path().to_str().unwrap());
    let whole = program(u64::MAX, undisturbed).unwrap();
    let iterations = whole.state.get_iter();
    assert!(iterations > 30, "{iterations} iterations leave nothing to resume");
    // Stops at the start, then after 25 evaluations each: every program resumes from the last multiple of 7.
    let mut broken = 0;
    let resumed = loop {
        match program(if broken == 0 { 0 } else { 25 }, disturbed) {
            Ok(result) => break result,
            Err(error) => assert!(error.is::<Fire>(), "{error}"),
        }
        broken += 1;
        assert!(broken < 20, "no progress from checkpoint to checkpoint");
    };
    assert!(broken > 1, "the run was over before it could break off");
    assert_eq!(resumed.state.get_iter(), iterations);
    assert_eq!(resumed.state.get_best_param(), whole.state.get_best_param());
    assert_eq!(resumed.state.get_best_cost(), whole.state.get_best_cost());
    assert_eq!(resumed.state.get_gradient(), whole.state.get_gradient());
    assert_eq!(resumed.solver.evaluations(), whole.solver.evaluations());
    assert_eq!(resumed.solver.stop(), Some(&LbfgsbStop::Gradient));
    assert_eq!(resumed.state.get_termination_reason(), Some(&TerminationReason::SolverConverged));
}

/// An objective from a closure.
struct Of<F>(F);

impl<F: Fn(&[f64], &mut [f64]) -> f64> CostGradient for Of<F> {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        Ok((self.0)(x, gradient))
    }
}

const NONE: f64 = f64::INFINITY;

#[test]
fn costs_that_are_not_finite_are_stepped_back_from() {
    // x - ln x, whose first trial lands beyond zero and whose minimum is 1. Each kind of bad value must give
    // the same.
    let bad: [(f64, f64); 5] =
        [(f64::NAN, 0.0), (f64::INFINITY, 0.0), (f64::NEG_INFINITY, 0.0), (0.0, f64::NAN), (f64::NAN, f64::NAN)];
    for (bad_cost, bad_gradient) in bad {
        let met = Cell::new(0);
        let log = Of(|x: &[f64], g: &mut [f64]| {
            if x[0] <= 0.0 {
                met.set(met.get() + 1);
                g[0] = bad_gradient;
                return bad_cost;
            }
            g[0] = 50.0 * (1.0 - 1.0 / x[0]);
            50.0 * (x[0] - x[0].ln())
        });
        let options = LbfgsbOptions { pgtol: 1e-9, ftol: 0.0, ..Default::default() };
        let solution = minimize(&log, &[20.0], &[-100.0], &[100.0], &options).unwrap();
        assert!(met.get() > 0, "the wall was never met");
        assert!((solution.x[0] - 1.0).abs() < 1e-8, "{solution:?}");
        assert!((solution.cost - 50.0).abs() < 1e-8, "{solution:?}");
    }
}

#[test]
fn a_wall_all_around_ends_without_progress_at_the_start() {
    let island = Of(|x: &[f64], g: &mut [f64]| {
        g[0] = 1.0;
        if x[0] == 3.0 { 7.0 } else { f64::NAN }
    });
    let solution = minimize(&island, &[3.0], &[-NONE], &[NONE], &LbfgsbOptions::default()).unwrap();
    assert!(matches!(solution.stop, LbfgsbStop::NoProgress(_)), "{:?}", solution.stop);
    assert_eq!((solution.x[0], solution.cost), (3.0, 7.0));
    // The same through argmin: an exit with its reason, the start as best point.
    let result = Executor::new(island, Lbfgsb::unbounded()).configure(|state| state.param(vec![3.0])).run().unwrap();
    assert!(matches!(result.state.get_termination_reason(), Some(TerminationReason::SolverExit(_))));
    assert_eq!(result.state.get_best_param(), Some(&vec![3.0]));
}

#[test]
fn a_gradient_of_the_wrong_sign_ends_without_progress() {
    let liar = Of(|x: &[f64], g: &mut [f64]| {
        g[0] = -2.0 * x[0];
        x[0] * x[0]
    });
    let solution = minimize(&liar, &[1.0], &[-NONE], &[NONE], &LbfgsbOptions::default()).unwrap();
    assert!(matches!(solution.stop, LbfgsbStop::NoProgress(_)), "{:?}", solution.stop);
    assert_eq!(solution.x, [1.0]);
}

fn parabola() -> impl CostGradient {
    Of(|x: &[f64], g: &mut [f64]| {
        (0..x.len()).for_each(|i| g[i] = 2.0 * (x[i] - 1.0));
        x.iter().map(|v| (v - 1.0).powi(2)).sum()
    })
}

#[test]
fn a_start_that_is_fixed_or_optimal_costs_one_evaluation() {
    let options = LbfgsbOptions::default();
    for (x0, lower, upper) in [([5.0, 4.0], [2.0, 3.0], [2.0, 3.0]), ([1.0, 1.0], [-NONE; 2], [NONE; 2])] {
        let solution = minimize(&parabola(), &x0, &lower, &upper, &options).unwrap();
        assert_eq!((solution.stop, solution.evaluations, solution.iterations), (LbfgsbStop::Gradient, 1, 0));
        assert_eq!(solution.x, [x0[0].clamp(lower[0], upper[0]), x0[1].clamp(lower[1], upper[1])]);
    }
}

#[test]
fn solvers_can_be_sent_to_other_threads() {
    let solve = |target: f64| {
        let bowl = Of(move |x: &[f64], g: &mut [f64]| {
            g[0] = 2.0 * (x[0] - target);
            (x[0] - target).powi(2)
        });
        let executor = Executor::new(bowl, Lbfgsb::new(vec![0.0], vec![2.0]));
        executor.configure(|state| state.param(vec![0.5])).run().unwrap().state.best_param.unwrap()[0]
    };
    let threads: Vec<_> = [-1.0, 1.0, 3.0].map(|target| std::thread::spawn(move || solve(target))).into();
    let found: Vec<f64> = threads.into_iter().map(|thread| thread.join().unwrap()).collect();
    assert!(found[0] == 0.0 && (found[1] - 1.0).abs() < 1e-5 && found[2] == 2.0, "{found:?}");
    // The whole solver, with its history, moves too.
    fn sendable<T: Send + Sync>(_: &T) {}
    sendable(&Lbfgsb::unbounded());
}

#[test]
fn the_iteration_limit_is_kept() {
    let run = &reference().0[0];
    let options = LbfgsbOptions { max_iterations: 4, ..Default::default() };
    let (_, solution) = solve(run, &options);
    assert_eq!((solution.iterations, solution.stop), (4, LbfgsbStop::MaxIterations));
}

#[test]
fn bad_input_is_an_error_value() {
    let options = LbfgsbOptions::default();
    let error = |x0: &[f64], lower: &[f64], upper: &[f64], options: LbfgsbOptions| {
        minimize(&parabola(), x0, lower, upper, &options).unwrap_err().to_string()
    };
    let nan = f64::NAN;
    for (lower, upper) in [(2.0, 1.0), (nan, 1.0), (0.0, nan), (NONE, NONE), (-NONE, -NONE)] {
        let text = error(&[0.0, 0.0], &[0.0, lower], &[1.0, upper], options);
        assert!(text.contains("variable 1"), "{text}");
    }
    assert!(error(&[0.0], &[0.0, 0.0], &[1.0], options).contains("lower has length 2"));
    assert!(error(&[0.0], &[0.0], &[], options).contains("upper has length 0"));
    assert!(error(&[], &[], &[], options).contains("x0"));
    assert!(error(&[0.0, nan], &[-NONE; 2], &[NONE; 2], options).contains("x0[1]"));
    for (bad, name) in [
        (LbfgsbOptions { memory: 0, ..options }, "memory"),
        (LbfgsbOptions { memory: usize::MAX, ..options }, "memory"),
        (LbfgsbOptions { pgtol: -1.0, ..options }, "pgtol"),
        (LbfgsbOptions { ftol: nan, ..options }, "ftol"),
        (LbfgsbOptions { max_line_search: 0, ..options }, "max_line_search"),
    ] {
        assert!(error(&[0.0], &[0.0], &[1.0], bad).contains(name));
    }
    let nowhere = Of(|_: &[f64], _: &mut [f64]| f64::NAN);
    let got = minimize(&nowhere, &[0.0], &[-NONE], &[NONE], &options);
    assert!(matches!(got, Err(LbfgsbError::NotFinite { cost }) if cost.is_nan()));
    let no_start = Executor::new(parabola(), Lbfgsb::unbounded()).run().err().expect("no start");
    assert!(matches!(no_start.downcast_ref(), Some(LbfgsbError::NoStart)), "{no_start}");
}

#[derive(Debug, thiserror::Error)]
#[error("the table is on fire")]
struct Fire;

/// Fails at its third evaluation; its gradient may have the wrong length.
struct Failing(Cell<u64>, usize);

impl CostFunction for Failing {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        self.0.set(self.0.get() + 1);
        if self.0.get() == 3 { Err(Fire.into()) } else { Ok(x[0].powi(4)) }
    }
}

impl Gradient for Failing {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, argmin::core::Error> {
        Ok(vec![4.0 * x[0].powi(3); self.1])
    }
}

#[test]
fn errors_of_the_objective_come_out_as_they_are() {
    let got = minimize(&Failing(Cell::new(0), 1), &[9.0], &[-NONE], &[NONE], &LbfgsbOptions::default());
    assert!(matches!(got, Err(LbfgsbError::Objective(e)) if e.is::<Fire>()));
    let executor = Executor::new(Failing(Cell::new(0), 1), Lbfgsb::unbounded());
    let got = executor.configure(|state| state.param(vec![9.0])).run().err().expect("fire");
    assert!(got.is::<Fire>(), "{got}");
    let executor = Executor::new(Failing(Cell::new(0), 2), Lbfgsb::unbounded());
    let got = executor.configure(|state| state.param(vec![9.0])).run().err().expect("length");
    assert!(matches!(got.downcast_ref(), Some(LbfgsbError::Length { name: "gradient", len: 2, expected: 1 })), "{got}");
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(300))]
    /// A convex quadratic has one minimum in any box, and the signs of its gradient prove it.
    #[test]
    fn quadratics_end_where_the_gradient_points_out_of_the_box(
        n in 1usize..12, memory in 1usize..8, seed in proptest::prelude::any::<u64>(),
    ) {
        let mut rng = rand_pcg::Pcg64Mcg::new(u128::from(seed) | 1);
        let mut uniform = || rng.random_range(-1.0..1.0);
        let mut vector = |len: usize| -> Vec<f64> { (0..len).map(|_| uniform()).collect() };
        let (rows, b, x0) = (vector(n * n), vector(n), vector(n));
        // A bound is open, active somewhere, or equal to the other one.
        let (mut lower, mut upper) = (vec![-NONE; n], vec![NONE; n]);
        for (i, kind) in vector(n).into_iter().enumerate() {
            if kind > -0.5 {
                lower[i] = x0[i] - 0.3 * kind;
            }
            if kind.abs() < 0.5 {
                upper[i] = lower[i] + if kind < -0.3 { 0.0 } else { 0.2 };
            }
        }
        // A^T A + 0.1, gradient of half its form minus b x.
        let quadratic = Of(|x: &[f64], g: &mut [f64]| {
            let mut cost = 0.0;
            for i in 0..n {
                assert!(lower[i] <= x[i] && x[i] <= upper[i], "x{i} = {} outside [{}, {}]", x[i], lower[i], upper[i]);
                g[i] = 0.1 * x[i] - b[i];
                cost += (0.05 * x[i] - b[i]) * x[i];
            }
            for row in rows.chunks(n) {
                let r: f64 = row.iter().zip(x).map(|(a, x)| a * x).sum();
                cost += 0.5 * r * r;
                (0..n).for_each(|i| g[i] += row[i] * r);
            }
            cost
        });
        let options = LbfgsbOptions { memory, pgtol: 1e-7, ftol: 0.0, ..Default::default() };
        let solution = minimize(&quadratic, &x0, &lower, &upper, &options).unwrap();
        for i in 0..n {
            let (x, g) = (solution.x[i], solution.gradient[i]);
            let projected = (x - g).clamp(lower[i], upper[i]) - x;
            // The cost's rounding of 1e-16 leaves gradients of 1e-8 undecided.
            proptest::prop_assert!(projected.abs() < 1e-6, "x{i} = {x}, gradient {g}, {:?}", solution.stop);
        }
    }
}
