//! Linear least-squares regression of several outputs on the same terms: the normal equations are accumulated
//! over samples and solved by a Cholesky factorization with a small ridge.

use nalgebra::{Cholesky, DMatrix};

/// Substitute for a pivot that rounding makes 0 or negative.
const MIN_PIVOT: f64 = 1e-30;

/// Sums of a regression on T terms: the normal matrix and one right side for each output.
pub(super) struct RegressionSums<const T: usize> {
    normal: [[f64; T]; T],
    right: Vec<[f64; T]>,
}

impl<const T: usize> RegressionSums<T> {
    pub fn new(outputs: usize) -> RegressionSums<T> {
        RegressionSums { normal: [[0.0; T]; T], right: vec![[0.0; T]; outputs] }
    }

    /// Adds the sums of another set of samples.
    pub fn join(&mut self, other: &RegressionSums<T>) {
        let all = |sums: &mut [[f64; T]], others: &[[f64; T]]| {
            for (sum, other) in sums.as_flattened_mut().iter_mut().zip(others.as_flattened()) {
                *sum += other;
            }
        };
        all(&mut self.normal, &other.normal);
        all(&mut self.right, &other.right);
    }

    /// Adds a sample at these terms to the normal matrix.
    pub fn add_sample(&mut self, terms: &[f32; T]) {
        for i in 0..T {
            for j in 0..=i {
                self.normal[i][j] += f64::from(terms[i] * terms[j]);
            }
        }
    }

    /// Adds the value of one output at the terms of a sample.
    pub fn add(&mut self, output: usize, value: f32, terms: &[f32; T]) {
        for (sum, t) in self.right[output].iter_mut().zip(terms) {
            *sum += f64::from(value * t);
        }
    }

    /// Adds to one output sums over samples of its value times the terms.
    pub fn add_sums(&mut self, output: usize, sums: &[f64; T]) {
        self.right[output].iter_mut().zip(sums).for_each(|(sum, more)| *sum += more);
    }

    /// `[output][term]`: coefficients of each output.
    pub fn solve(&self) -> Vec<[f32; T]> {
        let ridge = 1e-5 * self.normal[0][0].max(1e-30);
        let lower = DMatrix::from_fn(T, T, |i, j| self.normal[i.max(j)][i.min(j)]);
        let right = DMatrix::from_fn(T, self.right.len(), |i, output| self.right[output][i]);
        let solved = solve(lower, ridge, right);
        (0..self.right.len()).map(|output| std::array::from_fn(|i| solved[(i, output)] as f32)).collect()
    }
}

/// Solves `(normal + ridge I) x = right` for each column; `normal` is positive semidefinite up to rounding.
pub(super) fn solve(mut normal: DMatrix<f64>, ridge: f64, right: DMatrix<f64>) -> DMatrix<f64> {
    (0..normal.nrows()).for_each(|i| normal[(i, i)] += ridge);
    // The substitute for pivots guarantees a factorization.
    Cholesky::new_with_substitute(normal, MIN_PIVOT).map_or_else(|| right.map(|_| 0.0), |factor| factor.solve(&right))
}
