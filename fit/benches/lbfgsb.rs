//! Cost of L-BFGS-B itself: extended Rosenbrock with bounds, by the plain function, by argmin's executor, by
//! basin's executor.
//!
//! ```sh
//! cargo bench -p plywave-fit --bench lbfgsb
//! ```
//!
//! The objective is a dozen operations per pair of variables, so that the time is the algorithm's. All three
//! do the same evaluations.

use argmin::core::{Executor, State};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use plywave_fit::{CostGradient, Lbfgsb, LbfgsbOptions, minimize};

struct Rosenbrock {
    lower: Vec<f64>,
    upper: Vec<f64>,
}

impl Rosenbrock {
    /// Every third variable may not reach its minimum.
    fn new(n: usize) -> Self {
        let upper = (0..n).map(|i| if i % 3 == 0 { 0.8 } else { 2.0 }).collect();
        Self { lower: vec![-2.0; n], upper }
    }

    fn start(&self) -> Vec<f64> {
        [-1.2, 1.0].repeat(self.lower.len() / 2)
    }

    fn evaluate(x: &[f64], gradient: &mut [f64]) -> f64 {
        let mut cost = 0.0;
        for (p, g) in x.chunks_exact(2).zip(gradient.chunks_exact_mut(2)) {
            let valley = p[1] - p[0] * p[0];
            cost += 100.0 * valley * valley + (1.0 - p[0]).powi(2);
            g[0] = -400.0 * p[0] * valley - 2.0 * (1.0 - p[0]);
            g[1] = 200.0 * valley;
        }
        cost
    }
}

impl CostGradient for Rosenbrock {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        Ok(Self::evaluate(x, gradient))
    }
}

impl basin::Constraints for Rosenbrock {
    type Set = basin::ConstraintSet<basin::BoxBounds<Vec<f64>>>;
    fn constraints(&self) -> <Self::Set as basin::ConstraintDescription>::Borrowed<'_> {
        basin::ConstraintSet::new().with_bounds(basin::BoxBounds::new(Some(&self.lower), Some(&self.upper)))
    }
}

impl basin::CostFunction for Rosenbrock {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = std::convert::Infallible;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Self::Error> {
        Ok(Self::evaluate(x, &mut vec![0.0; x.len()]))
    }
}

impl basin::Gradient for Rosenbrock {
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Self::Error> {
        Ok(self.cost_and_gradient(x)?.1)
    }
    fn cost_and_gradient(&self, x: &Vec<f64>) -> Result<(f64, Vec<f64>), Self::Error> {
        let mut gradient = vec![0.0; x.len()];
        let cost = Self::evaluate(x, &mut gradient);
        Ok((cost, gradient))
    }
    fn cost_and_gradient_into(&self, x: &Vec<f64>, gradient: &mut Vec<f64>) -> Result<f64, Self::Error> {
        Ok(Self::evaluate(x, gradient))
    }
}

fn overhead(c: &mut Criterion) {
    let mut group = c.benchmark_group("lbfgsb");
    let options = LbfgsbOptions { pgtol: 1e-6, ftol: 1e-15, ..Default::default() };
    for n in [20, 200, 2000] {
        let problem = Rosenbrock::new(n);
        let found = minimize(&problem, &problem.start(), &problem.lower, &problem.upper, &options).expect("minimum");
        println!("n = {n}: {} iterations, {} evaluations, cost {}", found.iterations, found.evaluations, found.cost);
        group.bench_function(BenchmarkId::new("function", n), |b| {
            b.iter(|| minimize(&problem, &problem.start(), &problem.lower, &problem.upper, &options).expect("minimum"));
        });
        group.bench_function(BenchmarkId::new("argmin", n), |b| {
            b.iter(|| {
                let problem = Rosenbrock::new(n);
                let solver = Lbfgsb::new(problem.lower.clone(), problem.upper.clone()).with_options(options);
                let x0 = problem.start();
                let result = Executor::new(problem, solver).configure(|state| state.param(x0)).run().expect("minimum");
                assert_eq!(result.state.get_iter(), found.iterations);
            });
        });
        group.bench_function(BenchmarkId::new("basin", n), |b| {
            b.iter(|| {
                let problem = Rosenbrock::new(n);
                let solver = basin::Lbfgsb::<Vec<f64>>::new()
                    .with_m_capacity(options.memory)
                    .with_absolute_projected_gradient_tolerance(options.pgtol)
                    .with_relative_cost_reduction_tolerance(options.ftol);
                let state = basin::FirstOrderState::new(problem.start());
                let result = basin::Executor::new(problem, solver, state).run().expect("minimum");
                assert_eq!(basin::State::iter(&result.state), found.iterations);
            });
        });
    }
    group.finish();
}

criterion_group!(benches, overhead);
criterion_main!(benches);
