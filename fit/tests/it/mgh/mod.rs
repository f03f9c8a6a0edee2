//! Problems of More, Garbow, Hillstrom (ACM TOMS 7, 1981) as sums of squared residuals, with gradients by
//! forward dual numbers.
//!
//! The same residuals are in `tests/data/scipy_lbfgsb.py`; the tests compare the two at every start.

use std::cell::{Cell, RefCell};
use std::ops::{Add, Div, Mul, Sub};

use plywave_fit::CostGradient;

/// A number and its derivative along one variable.
#[derive(Debug, Clone, Copy)]
pub struct Dual(f64, f64);

macro_rules! dual_ops {
    ($($op:ident $f:ident |$a:ident, $b:ident| $dual:expr;)*) => {$(
        impl $op for Dual {
            type Output = Dual;
            fn $f(self, other: Dual) -> Dual {
                let ($a, $b) = (self, other);
                $dual
            }
        }
        impl $op<f64> for Dual {
            type Output = Dual;
            fn $f(self, other: f64) -> Dual {
                $op::$f(self, Dual(other, 0.0))
            }
        }
        impl $op<Dual> for f64 {
            type Output = Dual;
            fn $f(self, other: Dual) -> Dual {
                $op::$f(Dual(self, 0.0), other)
            }
        }
    )*};
}

dual_ops! {
    Add add |a, b| Dual(a.0 + b.0, a.1 + b.1);
    Sub sub |a, b| Dual(a.0 - b.0, a.1 - b.1);
    Mul mul |a, b| Dual(a.0 * b.0, a.1 * b.0 + a.0 * b.1);
    Div div |a, b| Dual(a.0 / b.0, (a.1 - a.0 / b.0 * b.1) / b.0);
}

impl Dual {
    fn exp(self) -> Dual {
        Dual(self.0.exp(), self.0.exp() * self.1)
    }
    fn sin(self) -> Dual {
        Dual(self.0.sin(), self.0.cos() * self.1)
    }
    fn cos(self) -> Dual {
        Dual(self.0.cos(), -self.0.sin() * self.1)
    }
    fn atan(self) -> Dual {
        Dual(self.0.atan(), self.1 / (1.0 + self.0 * self.0))
    }
    fn sqrt(self) -> Dual {
        Dual(self.0.sqrt(), 0.5 * self.1 / self.0.sqrt())
    }
    fn sq(self) -> Dual {
        self * self
    }
}

fn sum(terms: impl Iterator<Item = Dual>) -> Dual {
    terms.fold(Dual(0.0, 0.0), Add::add)
}

/// Residuals as a function of the variables.
pub type Residuals = fn(&[Dual]) -> Vec<Dual>;

/// All problems by name.
pub const PROBLEMS: [(&str, Residuals); 21] = [
    ("rosenbrock", extended_rosenbrock),
    ("brown_badly_scaled", |x| vec![x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2.0]),
    ("beale", |x| {
        let power = [x[1], x[1] * x[1], x[1] * x[1] * x[1]];
        [1.5, 2.25, 2.625].iter().zip(power).map(|(&y, p)| y - x[0] * (1.0 - p)).collect()
    }),
    ("jennrich_sampson", |x| {
        (1..=10).map(f64::from).map(|i| 2.0 + 2.0 * i - ((i * x[0]).exp() + (i * x[1]).exp())).collect()
    }),
    ("helical_valley", |x| {
        let theta = (x[1] / x[0]).atan() * (0.5 / std::f64::consts::PI) + if x[0].0 < 0.0 { 0.5 } else { 0.0 };
        vec![10.0 * (x[2] - 10.0 * theta), 10.0 * ((x[0].sq() + x[1].sq()).sqrt() - 1.0), x[2]]
    }),
    ("bard", |x| {
        let y = [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39];
        let row = |(i, y): (usize, f64)| {
            let u = (i + 1) as f64;
            y - (x[0] + u / ((16.0 - u) * x[1] + u.min(16.0 - u) * x[2]))
        };
        y.into_iter().enumerate().map(row).collect()
    }),
    ("box_3d", |x| {
        let row = |i: i32| {
            let t = 0.1 * f64::from(i);
            (-t * x[0]).exp() - (-t * x[1]).exp() - x[2] * ((-t).exp() - (-10.0 * t).exp())
        };
        (1..=10).map(row).collect()
    }),
    ("powell_singular", powell_singular),
    ("wood", |x| {
        vec![
            10.0 * (x[1] - x[0].sq()),
            1.0 - x[0],
            90f64.sqrt() * (x[3] - x[2].sq()),
            1.0 - x[2],
            10f64.sqrt() * (x[1] + x[3] - 2.0),
            (x[1] - x[3]) / 10f64.sqrt(),
        ]
    }),
    ("kowalik_osborne", |x| {
        let y = [0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246];
        let u = [4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625];
        let row = |(y, u): (f64, f64)| y - x[0] * (u * u + u * x[1]) / (u * u + u * x[2] + x[3]);
        y.into_iter().zip(u).map(row).collect()
    }),
    ("brown_dennis", |x| {
        let row = |i: i32| {
            let t = f64::from(i) / 5.0;
            (x[0] + t * x[1] - t.exp()).sq() + (x[2] + x[3] * t.sin() - t.cos()).sq()
        };
        (1..=20).map(row).collect()
    }),
    ("biggs_exp6", |x| {
        let row = |i: i32| {
            let t = 0.1 * f64::from(i);
            let y = (-t).exp() - 5.0 * (-10.0 * t).exp() + 3.0 * (-4.0 * t).exp();
            x[2] * (-t * x[0]).exp() - x[3] * (-t * x[1]).exp() + x[5] * (-t * x[4]).exp() - y
        };
        (1..=13).map(row).collect()
    }),
    ("watson", |x| {
        let row = |i: i32| {
            let t = f64::from(i) / 29.0;
            let slope = sum((1..x.len()).map(|j| j as f64 * t.powi(j as i32 - 1) * x[j]));
            let value = sum((0..x.len()).map(|j| t.powi(j as i32) * x[j]));
            slope - value.sq() - 1.0
        };
        (1..=29).map(row).chain([x[0], x[1] - x[0].sq() - 1.0]).collect()
    }),
    ("extended_rosenbrock", extended_rosenbrock),
    ("extended_powell_singular", powell_singular),
    ("penalty_1", |x| {
        let mut r: Vec<_> = x.iter().map(|&v| 1e-5f64.sqrt() * (v - 1.0)).collect();
        r.push(sum(x.iter().map(|v| v.sq())) - 0.25);
        r
    }),
    ("variably_dimensioned", |x| {
        let s = sum(x.iter().enumerate().map(|(j, &v)| (j + 1) as f64 * (v - 1.0)));
        x.iter().map(|&v| v - 1.0).chain([s, s.sq()]).collect()
    }),
    ("trigonometric", |x| {
        let rest = x.len() as f64 - sum(x.iter().map(|v| v.cos()));
        x.iter().enumerate().map(|(i, v)| rest + (i + 1) as f64 * (1.0 - v.cos()) - v.sin()).collect()
    }),
    ("discrete_boundary_value", |x| {
        let h = 1.0 / (x.len() + 1) as f64;
        let cube = |i: usize| {
            let v = x[i] + (i + 1) as f64 * h + 1.0;
            v * v * v
        };
        (0..x.len()).map(|i| 2.0 * x[i] - at(x, i, -1) - at(x, i, 1) + h * h / 2.0 * cube(i)).collect()
    }),
    ("broyden_tridiagonal", |x| {
        (0..x.len()).map(|i| (3.0 - 2.0 * x[i]) * x[i] - at(x, i, -1) - 2.0 * at(x, i, 1) + 1.0).collect()
    }),
    ("chebyquad", |x| {
        let n = x.len();
        let (mut before, mut now) = (vec![Dual(1.0, 0.0); n], x.iter().map(|&v| 2.0 * v - 1.0).collect::<Vec<_>>());
        let mut r = Vec::new();
        for i in 1..=n {
            let integral = if i % 2 == 0 { 1.0 / ((i * i) as f64 - 1.0) } else { 0.0 };
            r.push(sum(now.iter().copied()) / n as f64 + integral);
            let next = (0..n).map(|j| 2.0 * (2.0 * x[j] - 1.0) * now[j] - before[j]).collect();
            before = std::mem::replace(&mut now, next);
        }
        r
    }),
];

/// Neighbor of variable `i`, zero beyond the ends.
fn at(x: &[Dual], i: usize, offset: isize) -> Dual {
    i.checked_add_signed(offset).and_then(|i| x.get(i)).copied().unwrap_or(Dual(0.0, 0.0))
}

fn extended_rosenbrock(x: &[Dual]) -> Vec<Dual> {
    x.chunks(2).flat_map(|p| [10.0 * (p[1] - p[0].sq()), 1.0 - p[0]]).collect()
}

fn powell_singular(x: &[Dual]) -> Vec<Dual> {
    let row = |p: &[Dual]| {
        [p[0] + 10.0 * p[1], 5f64.sqrt() * (p[2] - p[3]), (p[1] - 2.0 * p[2]).sq(), 10f64.sqrt() * (p[0] - p[3]).sq()]
    };
    x.chunks(4).flat_map(row).collect()
}

/// Residuals of the problem called `name`.
pub fn residuals(name: &str) -> Residuals {
    PROBLEMS.iter().find(|(known, _)| *known == name).unwrap_or_else(|| panic!("no problem {name}")).1
}

/// Cost and gradient of a sum of squared residuals.
pub fn cost_gradient(residuals: Residuals, x: &[f64]) -> (f64, Vec<f64>) {
    let mut point: Vec<Dual> = x.iter().map(|&v| Dual(v, 0.0)).collect();
    let cost = residuals(&point).iter().map(|r| r.0 * r.0).sum();
    let mut gradient = vec![0.0; x.len()];
    for i in 0..x.len() {
        point[i].1 = 1.0;
        gradient[i] = residuals(&point).iter().map(|r| 2.0 * r.0 * r.1).sum();
        point[i].1 = 0.0;
    }
    (cost, gradient)
}

/// A problem that counts its evaluations and keeps the first point outside its bounds.
pub struct Watched {
    pub residuals: Residuals,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    pub evaluations: Cell<u64>,
    pub outside: RefCell<Option<Vec<f64>>>,
}

impl Watched {
    pub fn new(residuals: Residuals, lower: Vec<f64>, upper: Vec<f64>) -> Self {
        Self { residuals, lower, upper, evaluations: Cell::new(0), outside: RefCell::new(None) }
    }

    pub fn evaluate(&self, x: &[f64]) -> (f64, Vec<f64>) {
        self.evaluations.set(self.evaluations.get() + 1);
        if (0..x.len()).any(|i| !(self.lower[i] <= x[i] && x[i] <= self.upper[i])) {
            self.outside.borrow_mut().get_or_insert(x.to_vec());
        }
        cost_gradient(self.residuals, x)
    }
}

impl CostGradient for Watched {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        let (cost, g) = self.evaluate(x);
        gradient.copy_from_slice(&g);
        Ok(cost)
    }
}
