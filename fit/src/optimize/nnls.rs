//! Non-negative least squares by the active set method of Lawson and Hanson (1974, chapter 23).

use nalgebra::{DMatrix, DVector};

/// The x >= 0 that minimizes `|a x - b|`. Exact up to rounding; `a` may have more columns than rows.
pub fn nnls(a: &DMatrix<f64>, b: &DVector<f64>) -> DVector<f64> {
    let n = a.ncols();
    let mut x = DVector::zeros(n);
    let mut free = vec![false; n];
    let scale = a.iter().fold(0.0f64, |m, v| m.max(v.abs())) * b.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let tolerance = 1e-13 * scale * a.nrows() as f64;
    let mut blocked = vec![false; n];
    for _ in 0..20 * n.max(1) {
        let w = a.transpose() * (b - a * &x);
        let enter =
            (0..n).filter(|&j| !free[j] && !blocked[j] && w[j] > tolerance).max_by(|&i, &j| w[i].total_cmp(&w[j]));
        let Some(enter) = enter else { break };
        free[enter] = true;
        loop {
            let z = solve_free(a, b, &free);
            if (0..n).all(|j| !free[j] || z[j] > 0.0) {
                x = z;
                blocked.fill(false);
                break;
            }
            if z[enter] <= 0.0 && x[enter] == 0.0 {
                // Rounding let a useless column in: it is excluded until another variable moves.
                free[enter] = false;
                blocked[enter] = true;
                break;
            }
            let step = (0..n).filter(|&j| free[j] && z[j] <= 0.0).map(|j| x[j] / (x[j] - z[j])).fold(1.0f64, f64::min);
            for j in 0..n {
                if free[j] {
                    x[j] += step * (z[j] - x[j]);
                    if x[j] <= 1e-14 * (1.0 + z[j].abs()) {
                        x[j] = 0.0;
                        free[j] = false;
                    }
                }
            }
        }
    }
    x
}

/// Least squares over the free columns; the other components are zero.
fn solve_free(a: &DMatrix<f64>, b: &DVector<f64>, free: &[bool]) -> DVector<f64> {
    let columns: Vec<usize> = (0..a.ncols()).filter(|&j| free[j]).collect();
    let sub = a.select_columns(&columns);
    let solution = sub.svd(true, true).solve(b, 1e-14).unwrap_or_else(|_| DVector::zeros(columns.len()));
    let mut z = DVector::zeros(a.ncols());
    for (value, &j) in solution.iter().zip(&columns) {
        z[j] = *value;
    }
    z
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brute-force reference: the best feasible solution over all subsets of free columns.
    fn brute_force(a: &DMatrix<f64>, b: &DVector<f64>) -> f64 {
        let n = a.ncols();
        (0..1usize << n)
            .filter_map(|mask| {
                let free: Vec<bool> = (0..n).map(|j| mask >> j & 1 == 1).collect();
                let z = if mask == 0 { DVector::zeros(n) } else { solve_free(a, b, &free) };
                z.iter().all(|v| *v >= 0.0).then(|| (a * z - b).norm())
            })
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn agrees_with_all_subsets() {
        let mut state = 7u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        for (rows, columns) in [(6, 4), (4, 6), (8, 8), (3, 1)] {
            for _ in 0..40 {
                let a = DMatrix::from_fn(rows, columns, |_, _| next());
                let b = DVector::from_fn(rows, |_, _| next());
                let x = nnls(&a, &b);
                assert!(x.iter().all(|v| *v >= 0.0));
                let (got, want) = ((&a * &x - &b).norm(), brute_force(&a, &b));
                assert!(got <= want + 1e-9, "{rows} x {columns}: got {got}, want {want}");
            }
        }
    }
}
