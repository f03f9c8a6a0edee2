//! Heights of crossings from their differences to neighbors, by least squares.
//!
//! Tiles give the height of each crossing over its neighbors, but not over the whole cloth. The heights H
//! whose differences fit best solve a Poisson equation, which is diagonal in the discrete Fourier transform:
//! with `d = e^(i k) - 1` along each axis, `H = (conj(dx) Gx + conj(dy) Gy) / (|dx|^2 + |dy|^2)`.

use rustfft::num_complex::Complex;
use rustfft::{FftDirection, FftPlanner};
use std::f64::consts::TAU;

/// Heights `[row][column]` of mean 0 on a torus, from their increments to the next column and to the next
/// row.
pub fn heights([columns, rows]: [usize; 2], increments: &[[f64; 2]]) -> Vec<f64> {
    let mut axes = [0, 1].map(|k| increments.iter().map(|g| Complex::new(g[k], 0.0)).collect::<Vec<_>>());
    axes.iter_mut().for_each(|axis| transform(axis, [columns, rows], FftDirection::Forward));
    let step = |i: usize, count: usize| Complex::from_polar(1.0, TAU * i as f64 / count as f64) - 1.0;
    let [gx, gy] = axes;
    let mut sums: Vec<Complex<f64>> = (0..columns * rows)
        .map(|i| {
            let (dx, dy) = (step(i % columns, columns), step(i / columns, rows));
            let square = dx.norm_sqr() + dy.norm_sqr();
            if square < 1e-20 { Complex::ZERO } else { (dx.conj() * gx[i] + dy.conj() * gy[i]) / square }
        })
        .collect();
    transform(&mut sums, [columns, rows], FftDirection::Inverse);
    sums.iter().map(|v| v.re / (columns * rows) as f64).collect()
}

/// Transforms rows, then columns.
fn transform(values: &mut [Complex<f64>], [columns, rows]: [usize; 2], direction: FftDirection) {
    let mut planner = FftPlanner::new();
    planner.plan_fft(columns, direction).process(values);
    let along = planner.plan_fft(rows, direction);
    let mut column = vec![Complex::ZERO; rows];
    for c in 0..columns {
        (0..rows).for_each(|r| column[r] = values[r * columns + c]);
        along.process(&mut column);
        (0..rows).for_each(|r| values[r * columns + c] = column[r]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Heights come back from their increments; increments that no heights have are fitted so that the normal
    /// equations hold.
    #[test]
    fn heights_fit_their_increments() {
        let (columns, rows) = (7, 12);
        let noise = |i: usize, k: usize| (1.3 * (i * i + 5 * k) as f64).sin();
        let mean = (0..columns * rows).map(|i| noise(i, 0)).sum::<f64>() / (columns * rows) as f64;
        let want: Vec<f64> = (0..columns * rows).map(|i| noise(i, 0) - mean).collect();
        let next = |i: usize| [i - i % columns + (i + 1) % columns, (i + columns) % (columns * rows)];
        let of = |heights: &[f64]| -> Vec<[f64; 2]> {
            (0..columns * rows).map(|i| next(i).map(|k| heights[k] - heights[i])).collect()
        };
        let found = heights([columns, rows], &of(&want));
        assert!(found.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-12));

        let any: Vec<[f64; 2]> = (0..columns * rows).map(|i| [noise(i, 1), noise(i, 2)]).collect();
        let found = heights([columns, rows], &any);
        let left: Vec<[f64; 2]> = of(&found).iter().zip(&any).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect();
        let mut divergence = vec![0.0; columns * rows];
        for i in 0..columns * rows {
            for (k, to) in next(i).into_iter().enumerate() {
                divergence[i] -= left[i][k];
                divergence[to] += left[i][k];
            }
        }
        assert!(divergence.iter().all(|v| v.abs() < 1e-10), "{divergence:?}");
    }
}
