//! Regression of several functions on the same terms, in least squares.

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

    /// Coefficients, by Cholesky's factorization.
    pub fn solve(&self) -> Vec<[f32; T]> {
        let mut l = self.normal;
        let ridge = 1e-6 * self.normal[0][0].max(1e-30);
        for i in 0..T {
            l[i][i] += ridge;
        }
        for i in 0..T {
            for j in 0..=i {
                let sum = l[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
                l[i][j] = if i == j { sum.max(1e-30).sqrt() } else { sum / l[j][j] };
            }
        }
        let solved = |right: &[f64; T]| {
            let mut x = *right;
            for i in 0..T {
                x[i] = (x[i] - (0..i).map(|k| l[i][k] * x[k]).sum::<f64>()) / l[i][i];
            }
            for i in (0..T).rev() {
                x[i] = (x[i] - (i + 1..T).map(|k| l[k][i] * x[k]).sum::<f64>()) / l[i][i];
            }
            x.map(|v| v as f32)
        };
        self.right.iter().map(solved).collect()
    }
}
