//! Least-squares fit of functions of a direction on the hemisphere, in the splines of a cloth
//! ([`SplinesAt`](plywave::cloth::shade::SplinesAt)). A ridge pulls coefficients with few samples to the
//! mean.

use super::regression::solve;
use nalgebra::DMatrix;
use plywave::cloth::shade::{SPLINES as COUNT, SeveralSplines as Several, SplinesAt as At};

/// Weight of the ridge that pulls coefficients with few samples to the mean.
const RIDGE: f64 = 0.05;

/// Spline coefficients of one function.
pub(super) type Coefficients = [f32; COUNT];

/// Groups functions by F, with the coefficients of a group interleaved.
pub(super) fn several<const F: usize>(functions: &[Coefficients]) -> Vec<Several<F>> {
    let each = functions.as_chunks::<F>().0;
    each.iter().map(|of| std::array::from_fn(|i| std::array::from_fn(|f| of[f][i]))).collect()
}

/// Sums over samples of F functions: the normal matrix and the right sides.
pub(super) struct SplineSums<const F: usize> {
    /// Normal matrix, row by row; only its lower half is filled, since it is symmetric.
    normal: Vec<f64>,
    /// `[spline][function]`: right sides.
    right: Vec<[f64; F]>,
}

impl<const F: usize> SplineSums<F> {
    pub fn new() -> SplineSums<F> {
        SplineSums { normal: vec![0.0; COUNT * COUNT], right: vec![[0.0; F]; COUNT] }
    }

    /// Adds the sums of another set of samples.
    pub fn join(&mut self, other: &SplineSums<F>) {
        self.normal.iter_mut().zip(&other.normal).for_each(|(sum, other)| *sum += other);
        for (sum, other) in self.right.as_flattened_mut().iter_mut().zip(other.right.as_flattened()) {
            *sum += other;
        }
    }

    /// Adds a sample: the values of the functions at a direction.
    pub fn add(&mut self, values: &[f32; F], at: &At) {
        self.add_weighted(1.0, values, at);
    }

    /// Adds a sample of this weight.
    pub fn add_weighted(&mut self, weight: f32, values: &[f32; F], at: &At) {
        for (i, (index, wi)) in at.index.iter().zip(at.weight.map(|w| weight * w)).enumerate() {
            for (other, wj) in at.index[..=i].iter().zip(at.weight) {
                let [row, column] = [*index.max(other), *index.min(other)].map(usize::from);
                self.normal[row * COUNT + column] += f64::from(wi * wj);
            }
            for (sum, value) in self.right[usize::from(*index)].iter_mut().zip(values) {
                *sum += f64::from(wi * value);
            }
        }
    }

    /// `[function]`: fitted coefficients, which tend to the function's mean where samples are few.
    pub fn solve(&self) -> Vec<Coefficients> {
        let normal = DMatrix::from_fn(COUNT, COUNT, |i, j| self.normal[i.max(j) * COUNT + i.min(j)]);
        let (rows, count) = (normal.column_sum(), normal.sum());
        // The mean is subtracted, so that the ridge does not shrink it.
        let mut right = DMatrix::from_fn(COUNT, F, |i, function| self.right[i][function]);
        let means: Vec<f64> = right.column_iter().map(|of| if count > 0.0 { of.sum() / count } else { 0.0 }).collect();
        right.column_iter_mut().zip(&means).for_each(|(mut of, mean)| of.axpy(-mean, &rows, 1.0));
        let solved = solve(normal, RIDGE, right);
        let function = |f: usize| std::array::from_fn(|i| (solved[(i, f)] + means[f]) as f32);
        (0..F).map(function).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::TAU;

    /// A smooth function is found from samples, a constant exactly.
    #[test]
    fn functions_are_found() {
        let mut sums = SplineSums::<2>::new();
        let direction = |k: usize| {
            let even = |step: f64| (0.5 + k as f64 * step).fract() as f32;
            let (z, turn) = (even(0.754_877_666), TAU * even(0.569_840_291));
            let r = (1.0 - z * z).sqrt();
            [r * turn.cos(), r * turn.sin(), z]
        };
        let f = |w: [f32; 3]| 0.3 + 0.4 * w[2] * w[2] - 0.2 * w[0] * w[2] + 0.1 * (w[0] * w[0] - w[1] * w[1]);
        for k in 0..60_000 {
            sums.add(&[f(direction(k)), 0.7], &At::new(direction(k)));
        }
        let found = several::<2>(&sums.solve());
        for k in 0..500 {
            let w = direction(3 * k + 1);
            let mut got = [0.0; 2];
            At::new(w).add(&found[0], &mut got);
            let off = (got[0] - f(w)).abs();
            // Near the normal, x behaves like the root of 1 - z, which splines of z cannot represent.
            assert!(off < if w[2] > 0.9 { 2e-2 } else { 4e-3 }, "{w:?}: {off}");
            assert!((got[1] - 0.7).abs() < 1e-5, "{w:?}");
        }
    }
}
