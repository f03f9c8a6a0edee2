//! Interpolative decomposition of large matrices by pivoted elimination of a sketch:
//! `A ~ A[:, retained] [1 C]`.
//!
//! A few random sums of A's rows hold its row space (Halko, Martinsson and Tropp 2011). Gaussian elimination
//! with partial pivoting of their transpose picks columns of A almost as well as a QR decomposition with
//! column pivots (Dong and Martinsson 2023). It runs as matrix products; the QR decomposition passes over the
//! whole matrix once per pivot.

use crate::C64;
use crate::boundary::lu::par;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor;
use faer::linalg::triangular_solve::solve_unit_upper_triangular_in_place;
use faer::{MatMut, MatRef};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

/// Number of sums that a row of the matrix is added to.
const SPREAD: usize = 8;
/// Number of sums beyond the rank that must vanish.
const BEYOND: usize = 24;

/// Columns of a matrix as combinations of some of them.
pub(crate) struct Interpolation {
    /// Retained columns, ascending.
    pub retained: Vec<usize>,
    /// All other columns, ascending.
    pub dropped: Vec<usize>,
    /// C, `retained x dropped`, column after column.
    pub coefficients: Vec<C64>,
}

/// Decomposes the `tests x count` matrix that `column` writes, so that the remainder is below `tolerance` of
/// its largest entries. `guess` is a rank to begin with.
pub(crate) fn interpolate(
    tests: usize,
    count: usize,
    column: impl Fn(usize, &mut [C64]) + Sync,
    tolerance: f64,
    seed: u64,
    guess: usize,
) -> Interpolation {
    let mut rows = guess + 2 * BEYOND;
    loop {
        // As many sums as rows or columns have the full rank. The rows themselves would be worse, since their
        // order would affect the pivots.
        let max_rows = tests.min(count);
        rows = rows.min(max_rows);
        let sketch = sketch(tests, count, &column, rows, seed);
        let (pivots, rank, l) = eliminate(sketch, count, rows, tolerance);
        if rank + BEYOND > rows && rows < max_rows {
            rows += rows / 3;
            continue;
        }
        return sorted(&pivots, rank, &l, count);
    }
}

/// Transposed sketch, `count x rows`, column after column.
fn sketch(
    tests: usize,
    count: usize,
    column: &(impl Fn(usize, &mut [C64]) + Sync),
    rows: usize,
    seed: u64,
) -> Vec<C64> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let spread: Vec<[(u32, f64); SPREAD]> = (0..tests)
        .map(|test| {
            std::array::from_fn(|k| {
                // The first sum in turn, as an empty sum would be a pivot of zero.
                let row = if k == 0 { (test % rows) as u32 } else { rng.random_range(0..rows as u32) };
                (row, if rng.random::<bool>() { 1.0 } else { -1.0 })
            })
        })
        .collect();
    let mut sums = vec![C64::ZERO; rows * count];
    sums.par_chunks_mut(rows.max(1)).enumerate().for_each_init(
        || vec![C64::ZERO; tests],
        |values, (j, sums)| {
            column(j, values);
            for (value, spread) in values.iter().zip(&spread) {
                for &(row, sign) in spread {
                    sums[row as usize] += value * sign;
                }
            }
        },
    );
    let mut transposed = vec![C64::ZERO; rows * count];
    // Stripes that fit in the cache on both sides.
    const STRIPE: usize = 32;
    transposed.par_chunks_mut(STRIPE * count.max(1)).enumerate().for_each(|(stripe, out)| {
        let first = stripe * STRIPE;
        let wide = out.len() / count;
        for (j, sums) in sums.chunks(rows).enumerate() {
            for (k, value) in sums[first..first + wide].iter().enumerate() {
                out[k * count + j] = *value;
            }
        }
    });
    transposed
}

/// Order of the pivots, the rank, and the factor L (`count x rows`).
fn eliminate(mut matrix: Vec<C64>, count: usize, rows: usize, tolerance: f64) -> (Vec<u32>, usize, Vec<C64>) {
    let (mut forward, mut inverse) = (vec![0u32; count], vec![0u32; count]);
    let scratch = factor::lu_in_place_scratch::<u32, C64>(count, rows, par(), Default::default());
    let mut buffer = MemBuffer::new(scratch);
    factor::lu_in_place(
        MatMut::from_column_major_slice_mut(&mut matrix, count, rows),
        &mut forward,
        &mut inverse,
        par(),
        MemStack::new(&mut buffer),
        Default::default(),
    );
    let size = |k: usize| matrix[k * count + k].norm();
    let steps = count.min(rows);
    let largest = (0..steps).map(size).fold(0.0, f64::max);
    // A NaN propagates to the residual.
    let small = |k: usize| size(k) <= tolerance * largest;
    let rank = (0..steps).rfind(|&k| !small(k)).map_or(0, |k| k + 1);
    (forward, rank, matrix)
}

/// Coefficients from L: the rows of the dropped columns are solved by the triangle of the retained ones.
fn sorted(pivots: &[u32], rank: usize, l: &[C64], count: usize) -> Interpolation {
    let dropped = count - rank;
    let mut order: Vec<usize> = (0..rank).collect();
    order.sort_by_key(|&k| pivots[k]);
    let mut others: Vec<usize> = (rank..count).collect();
    others.sort_by_key(|&k| pivots[k]);
    // L1^T C = L2^T.
    let mut solved = vec![C64::ZERO; rank * dropped];
    for (column, &k) in solved.chunks_mut(rank.max(1)).zip(&others) {
        for (i, out) in column.iter_mut().enumerate() {
            *out = l[i * count + k];
        }
    }
    if rank > 0 && dropped > 0 {
        let triangle = MatRef::from_column_major_slice(&l[..rank * count], count, rank).subrows(0, rank);
        let rhs = MatMut::from_column_major_slice_mut(&mut solved, rank, dropped);
        solve_unit_upper_triangular_in_place(triangle.transpose(), rhs, par());
    }
    let mut coefficients = Vec::with_capacity(solved.len());
    for column in solved.chunks(rank.max(1)) {
        coefficients.extend(order.iter().map(|&k| column[k]));
    }
    let site = |k: &usize| pivots[*k] as usize;
    Interpolation {
        retained: order.iter().map(site).collect(),
        dropped: others.iter().map(site).collect(),
        coefficients,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::{Accum, linalg::matmul::matmul};

    /// A matrix of rank 30 with singular values from 1 to 1e-6, 400 x 250: few columns give back all others,
    /// to the tolerance.
    #[test]
    fn columns_are_interpolated() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let mut random = |n: usize| -> Vec<C64> {
            (0..n).map(|_| C64::new(rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5)).collect()
        };
        let (tests, count, inner) = (400, 250, 30);
        let (mut left, right) = (random(tests * inner), random(inner * count));
        for (k, column) in left.chunks_mut(tests).enumerate() {
            let size = 10f64.powf(-6.0 * k as f64 / (inner - 1) as f64);
            column.iter_mut().for_each(|v| *v *= size);
        }
        let mut matrix = vec![C64::ZERO; tests * count];
        matmul(
            MatMut::from_column_major_slice_mut(&mut matrix, tests, count),
            Accum::Replace,
            MatRef::from_column_major_slice(&left, tests, inner),
            MatRef::from_column_major_slice(&right, inner, count),
            C64::ONE,
            par(),
        );
        let largest = matrix.iter().map(|v| v.norm()).fold(0.0, f64::max);
        for (tolerance, guess, ranks) in [(1e-3, 10, 12..26), (1e-3, 500, 12..26), (1e-9, 4, 30..31)] {
            let column = |j: usize, out: &mut [C64]| out.copy_from_slice(&matrix[j * tests..][..tests]);
            let got = interpolate(tests, count, column, tolerance, 7, guess);
            let k = got.retained.len();
            assert!(ranks.contains(&k), "rank {k}, tolerance {tolerance:e}");
            assert_eq!(k + got.dropped.len(), count);
            let mut worst: f64 = 0.0;
            for (&j, c) in got.dropped.iter().zip(got.coefficients.chunks(k)) {
                for t in 0..tests {
                    let sum: C64 = got.retained.iter().zip(c).map(|(&i, c)| matrix[i * tests + t] * c).sum();
                    worst = worst.max((sum - matrix[j * tests + t]).norm() / largest);
                }
            }
            assert!(worst < 30.0 * tolerance, "off by {worst:e}, asked {tolerance:e}");
        }
    }
}
