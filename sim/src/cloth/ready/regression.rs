//! Regression of several functions on the same terms, in least squares.

use nalgebra::{Cholesky, DMatrix};

/// In place of a pivot that rounding makes 0 or less.
const MIN_PIVOT: f64 = 1e-30;

/// Sums of a regression on T terms.
pub(super) struct Sums<const T: usize> {
    normal: [[f64; T]; T],
    right: Vec<[f64; T]>,
}

impl<const T: usize> Sums<T> {
    pub fn new(outputs: usize) -> Sums<T> {
        Sums { normal: [[0.0; T]; T], right: vec![[0.0; T]; outputs] }
    }

    /// With the sums of another.
    pub fn join(&mut self, other: &Sums<T>) {
        let all = |sums: &mut [[f64; T]], others: &[[f64; T]]| {
            for (sum, other) in sums.as_flattened_mut().iter_mut().zip(others.as_flattened()) {
                *sum += other;
            }
        };
        all(&mut self.normal, &other.normal);
        all(&mut self.right, &other.right);
    }

    /// A sample at these terms.
    pub fn seen(&mut self, terms: &[f32; T]) {
        for i in 0..T {
            for j in 0..=i {
                self.normal[i][j] += f64::from(terms[i] * terms[j]);
            }
        }
    }

    /// A sample's value of one output.
    pub fn add(&mut self, output: usize, value: f32, terms: &[f32; T]) {
        for (sum, t) in self.right[output].iter_mut().zip(terms) {
            *sum += f64::from(value * t);
        }
    }

    /// What samples of one output add up to, each times the terms.
    pub fn add_sums(&mut self, output: usize, sums: &[f64; T]) {
        self.right[output].iter_mut().zip(sums).for_each(|(sum, more)| *sum += more);
    }

    /// Coefficients of each output.
    pub fn solve(&self) -> Vec<[f32; T]> {
        let ridge = 1e-6 * self.normal[0][0].max(1e-30);
        let lower = DMatrix::from_fn(T, T, |i, j| self.normal[i.max(j)][i.min(j)]);
        let right = DMatrix::from_fn(T, self.right.len(), |i, output| self.right[output][i]);
        let solved = solve(lower, ridge, right);
        (0..self.right.len()).map(|output| std::array::from_fn(|i| solved[(i, output)] as f32)).collect()
    }
}

/// Solves `(normal + ridge) x = right` for each column; `normal` has no negative eigenvalues but by rounding.
pub(super) fn solve(mut normal: DMatrix<f64>, ridge: f64, right: DMatrix<f64>) -> DMatrix<f64> {
    (0..normal.nrows()).for_each(|i| normal[(i, i)] += ridge);
    // With a substitute for pivots there always is a factorization.
    Cholesky::new_with_substitute(normal, MIN_PIVOT).map_or_else(|| right.map(|_| 0.0), |factor| factor.solve(&right))
}
