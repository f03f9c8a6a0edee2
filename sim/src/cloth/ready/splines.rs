//! Functions of a direction of the half sphere, in the cloth's splines, by least squares of samples.

use super::regression::solve;
use nalgebra::DMatrix;
use plywave::cloth::making::{SPLINES as COUNT, SeveralSplines as Several, SplinesAt as At};

/// Weight of the mean, of a coefficient that a few samples bear upon.
const RIDGE: f64 = 0.05;

/// A function's coefficients.
pub(super) type Coefficients = [f32; COUNT];

/// Functions, each F side by side.
pub(super) fn several<const F: usize>(functions: &[Coefficients]) -> Vec<Several<F>> {
    let each = functions.as_chunks::<F>().0;
    each.iter().map(|of| std::array::from_fn(|i| std::array::from_fn(|f| of[f][i]))).collect()
}

/// Sums of samples of F functions.
pub(super) struct Sums<const F: usize> {
    /// Of the lower half; the matrix is symmetric.
    normal: Vec<f64>,
    /// Functions side by side.
    right: Vec<[f64; F]>,
}

impl<const F: usize> Sums<F> {
    pub fn new() -> Sums<F> {
        Sums { normal: vec![0.0; COUNT * COUNT], right: vec![[0.0; F]; COUNT] }
    }

    /// With the sums of another.
    pub fn join(&mut self, other: &Sums<F>) {
        self.normal.iter_mut().zip(&other.normal).for_each(|(sum, other)| *sum += other);
        for (sum, other) in self.right.as_flattened_mut().iter_mut().zip(other.right.as_flattened()) {
            *sum += other;
        }
    }

    /// The functions' values at a direction.
    pub fn add(&mut self, values: &[f32; F], at: &At) {
        for (i, (index, wi)) in at.index.iter().zip(at.weight).enumerate() {
            for (other, wj) in at.index[..=i].iter().zip(at.weight) {
                let [row, column] = [*index.max(other), *index.min(other)].map(usize::from);
                self.normal[row * COUNT + column] += f64::from(wi * wj);
            }
            for (sum, value) in self.right[usize::from(*index)].iter_mut().zip(values) {
                *sum += f64::from(wi * value);
            }
        }
    }

    /// The functions; where there are few samples, their means.
    pub fn solve(&self) -> Vec<Coefficients> {
        let normal = DMatrix::from_fn(COUNT, COUNT, |i, j| self.normal[i.max(j) * COUNT + i.min(j)]);
        let (rows, count) = (normal.column_sum(), normal.sum());
        // Less the mean, which the ridge then leaves alone.
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
        let mut sums = Sums::<2>::new();
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
            // About the normal x falls as a root of 1 - z, which no spline of z does.
            assert!(off < if w[2] > 0.9 { 2e-2 } else { 4e-3 }, "{w:?}: {off}");
            assert!((got[1] - 0.7).abs() < 1e-5, "{w:?}");
        }
    }
}
