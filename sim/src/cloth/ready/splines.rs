//! Functions of a direction of the half sphere, in the cloth's splines, by least squares of samples.

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
        let mut normal = self.normal.clone();
        for i in 0..COUNT {
            for j in 0..i {
                normal[j * COUNT + i] = normal[i * COUNT + j];
            }
        }
        let rows: Vec<f64> = normal.chunks_exact(COUNT).map(|row| row.iter().sum()).collect();
        let count: f64 = normal.iter().sum();
        let mut matrix = cholesky::Lower::new(&normal, RIDGE);
        matrix.factor();
        let solved = |function: usize| {
            let mut x: [f64; COUNT] = std::array::from_fn(|i| self.right[i][function]);
            let mean = if count > 0.0 { x.iter().sum::<f64>() / count } else { 0.0 };
            x.iter_mut().zip(&rows).for_each(|(x, row)| *x -= mean * row);
            matrix.solve(&mut x);
            x.map(|v| (v + mean) as f32)
        };
        (0..F).map(solved).collect()
    }
}

/// Cholesky's factorization.
mod cholesky {
    use super::COUNT;

    pub(super) struct Lower(Vec<f64>);

    impl Lower {
        pub fn new(normal: &[f64], ridge: f64) -> Lower {
            let mut l = normal.to_vec();
            (0..COUNT).for_each(|i| l[i * COUNT + i] += ridge);
            Lower(l)
        }

        pub fn factor(&mut self) {
            let l = &mut self.0;
            for i in 0..COUNT {
                for j in 0..=i {
                    let sum = l[i * COUNT + j] - (0..j).map(|k| l[i * COUNT + k] * l[j * COUNT + k]).sum::<f64>();
                    l[i * COUNT + j] = if i == j { sum.max(1e-30).sqrt() } else { sum / l[j * COUNT + j] };
                }
            }
        }

        pub fn solve(&self, x: &mut [f64; COUNT]) {
            let l = &self.0;
            for i in 0..COUNT {
                x[i] = (x[i] - (0..i).map(|k| l[i * COUNT + k] * x[k]).sum::<f64>()) / l[i * COUNT + i];
            }
            for i in (0..COUNT).rev() {
                x[i] = (x[i] - (i + 1..COUNT).map(|k| l[k * COUNT + i] * x[k]).sum::<f64>()) / l[i * COUNT + i];
            }
        }
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
