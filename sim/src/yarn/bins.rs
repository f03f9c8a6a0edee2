//! Conversion between the table's bins of the outgoing sphere and the coarser bins of light between plies. It
//! conserves energy: a bin's energy is divided in proportion to the solid angles of its overlaps.

use plywave::math::axis;
use plywave_tables::table::OutgoingGrid;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Overlaps of the table's rows and columns with coarse ones: for each coarse index, the table's indices and
/// their measures.
pub(crate) struct Overlap {
    /// `[coarse row]`: table row and the difference of the sines of their common latitudes.
    rows: Vec<Vec<(usize, f64)>>,
    /// `[coarse column]`: table column and the common azimuth [rad].
    columns: Vec<Vec<(usize, f64)>>,
    phi_o: usize,
}

impl Overlap {
    /// Overlaps with coarse columns that begin at azimuth `start` [rad]. When `mirrored`, coarse (theta, phi)
    /// is the table's (-theta, pi - phi).
    pub fn new(grid: OutgoingGrid, rows: usize, columns: usize, start: f64, mirrored: bool) -> Overlap {
        let latitude = |i: usize, n: usize| PI * i as f64 / n as f64 - FRAC_PI_2;
        let row = |i: usize| {
            let i = if mirrored { rows - 1 - i } else { i };
            let (low, high) = (latitude(i, rows), latitude(i + 1, rows));
            (0..grid.theta_o)
                .filter_map(|r| {
                    let (a, b) = (latitude(r, grid.theta_o).max(low), latitude(r + 1, grid.theta_o).min(high));
                    (b - a > 1e-12).then(|| (r, b.sin() - a.sin()))
                })
                .collect()
        };
        let width = TAU / columns as f64;
        let fine = TAU / grid.phi_o as f64;
        let column = |j: usize| {
            let low = start + j as f64 * width;
            let low = if mirrored { PI - low - width } else { low }.rem_euclid(TAU);
            let high = low + width;
            let (first, last) = ((low / fine) as usize, (high / fine).ceil() as usize);
            (first..=last)
                .filter_map(|c| {
                    let common = (high.min((c + 1) as f64 * fine) - low.max(c as f64 * fine)).min(fine);
                    (common > 1e-12).then_some((c % grid.phi_o, common))
                })
                .collect()
        };
        Overlap { rows: (0..rows).map(row).collect(), columns: (0..columns).map(column).collect(), phi_o: grid.phi_o }
    }

    /// Adds `weight` times the energies of `slice[theta_o][phi_o]` [1/sr] to `to[row][column]`.
    pub fn add(&self, slice: &[f32], weight: f64, to: &mut [f32]) {
        let columns = self.columns.len();
        let mut line = vec![0.0f64; self.phi_o];
        for (row, to) in self.rows.iter().zip(to.chunks_exact_mut(columns)) {
            line.fill(0.0);
            for &(r, measure) in row {
                let from = &slice[r * self.phi_o..(r + 1) * self.phi_o];
                line.iter_mut().zip(from).for_each(|(l, v)| *l += measure * f64::from(*v));
            }
            for (column, to) in self.columns.iter().zip(to) {
                *to += (weight * column.iter().map(|&(c, width)| width * line[c]).sum::<f64>()) as f32;
            }
        }
    }

    /// Means over the table's columns of a profile that is constant within each coarse column.
    pub fn refine(&self, profile: &[f32], to: &mut [f64]) {
        to.fill(0.0);
        let fine = TAU / self.phi_o as f64;
        for (column, value) in self.columns.iter().zip(profile) {
            column.iter().for_each(|&(c, width)| to[c] += f64::from(*value) * width / fine);
        }
    }
}

/// Density [1/sr] on the table's grid of energies in coarse bins `[rows][columns]`: linear between the coarse
/// bins' mean densities, scaled to the energy that they hold.
pub(crate) fn density(grid: OutgoingGrid, rows: usize, columns: usize, energies: &[f64], out: &mut [f64]) {
    let coarse = OutgoingGrid { theta_o: rows, phi_o: columns };
    let mean: Vec<f64> =
        energies.iter().enumerate().map(|(i, e)| e.max(0.0) / coarse.solid_angle(i / columns)).collect();
    let total: f64 = energies.iter().map(|e| e.max(0.0)).sum();
    let mut sum = 0.0;
    for r in 0..grid.theta_o {
        let (i, u) = axis::cell((r as f64 + 0.5) * rows as f64 / grid.theta_o as f64 - 0.5, rows);
        let solid_angle = grid.solid_angle(r);
        for c in 0..grid.phi_o {
            let at = ((c as f64 + 0.5) * columns as f64 / grid.phi_o as f64 - 0.5).rem_euclid(columns as f64);
            let (j, next, v) = axis::cell_periodic(at, columns);
            let mix = |i: usize| {
                let row = &mean[i * columns..(i + 1) * columns];
                row[j] + v * (row[next] - row[j])
            };
            let value = mix(i) + u * (mix(i + 1) - mix(i));
            out[r * grid.phi_o + c] = value;
            sum += value * solid_angle;
        }
    }
    let scale = if sum > 0.0 { total / sum } else { 0.0 };
    out.iter_mut().for_each(|v| *v *= scale);
}
