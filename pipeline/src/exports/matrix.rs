//! Computes the mean BSDF of a cloth between patches of the hemisphere, made reciprocal with exact energies.

use super::basis::{Basis, incident, outgoing};
use super::mean::{Bands, MeanCloth, Spectrum};
use crate::error::Error;
use crate::run::Run;
use rayon::prelude::*;

/// Number of bands of a matrix: visible and solar.
pub const BANDS: usize = 2;
/// Names of the bands in WINDOW.
pub const BAND_NAMES: [&str; BANDS] = ["Visible", "Solar"];
/// Number of lines that determine the straight light of a patch.
const LINES: u32 = 2048;
/// Largest number of balancing steps.
const BALANCE_STEPS: usize = 400;

/// BSDF between the patches of two sides.
#[derive(Clone, Debug)]
pub struct MatrixBlock {
    /// `[band][outgoing][incident]`: BSDF [1/sr], the mean over both patches, straight light included.
    pub values: [Vec<f64>; BANDS],
}

/// BSDF of a cloth between all patches.
#[derive(Clone, Debug)]
pub struct Matrix {
    /// Basis of the patches.
    pub basis: Basis,
    /// `[face, back][reflected, transmitted]` blocks.
    pub blocks: [[MatrixBlock; 2]; 2],
    /// `[face, back][incident]`: straight light, which the transmitted block includes.
    pub straight: [Vec<f64>; 2],
    /// Changes by balancing.
    pub balanced: Balanced,
}

/// Changes of a matrix by balancing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Balanced {
    /// [`Matrix::asymmetry`] before balancing.
    pub asymmetry: f64,
    /// Largest relative change of a column's energy.
    pub energy_change: f64,
}

/// Numbers of directions along a side of a patch over which means are taken.
#[derive(Clone, Copy, Debug)]
pub struct Steps {
    /// Directions of incident light.
    pub incident: usize,
    /// Directions of outgoing light.
    pub outgoing: usize,
}

/// Coordinates within a patch: the centers of `side * side` equal parts.
fn fractions(side: usize) -> impl Iterator<Item = [f64; 2]> + Clone {
    let middle = move |k: usize| (k as f64 + 0.5) / side as f64;
    (0..side * side).map(move |k| [middle(k % side), middle(k / side)])
}

impl Matrix {
    /// Computes the matrix of a cloth.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if the run was stopped.
    pub fn new(cloth: &MeanCloth, basis: Basis, steps: Steps, run: &Run<'_>) -> Result<Matrix, Error> {
        let bands = Bands::new();
        let n = basis.len();
        // Patches of both sides of the cloth, the face first.
        let lights: Vec<[f64; 2]> =
            (0..n).flat_map(|patch| fractions(steps.outgoing).map(move |u| basis.disk(patch, u))).collect();
        let towards = [true, false].map(|up| lights.iter().map(|at| outgoing(*at, up)).collect::<Vec<_>>());
        let per_patch = steps.outgoing * steps.outgoing;
        let share = 1.0 / (steps.incident * steps.incident) as f64;
        // Column of one incident patch: `[reflected, transmitted][band][outgoing]`, straight light, and
        // energies of all outgoing light, by band.
        type Column = ([[Vec<f64>; BANDS]; 2], f64, [f64; BANDS]);
        let column = |number: usize| -> Result<Column, Error> {
            run.check_stop()?;
            let (is_face, patch) = (number < n, number % n);
            let mut sums = [[vec![0.0; n], vec![0.0; n]], [vec![0.0; n], vec![0.0; n]]];
            let mut f = vec![Spectrum::ZERO; lights.len()];
            let (mut scattered, mut passing) = (Spectrum::ZERO, 0.0);
            for u in fractions(steps.incident) {
                let wo = incident(basis.disk(patch, u), is_face);
                let energy = cloth.energy(wo);
                scattered.add(share, &energy.0);
                passing += share * energy.1;
                for (half, sums) in sums.iter_mut().enumerate() {
                    let side = if (half == 0) == is_face { 0 } else { 1 };
                    cloth.f(wo, &towards[side], &mut f);
                    for (k, f) in f.iter().enumerate() {
                        // f includes the cosine of the incident light.
                        let cos = f64::from(towards[side][k][2].abs());
                        let weight = share / (per_patch as f64 * cos);
                        sums[0][k / per_patch] += weight * bands.visible(f);
                        sums[1][k / per_patch] += weight * bands.solar(f);
                    }
                }
            }
            let straight = cloth.straight(&|u| incident(basis.disk(patch, u), is_face), LINES, number as u32);
            for sums in &mut sums[1] {
                sums[patch] += straight / basis.projected_solid_angle(patch);
            }
            // These lines estimate the straight light more precisely than the mean over the cell does.
            let caught = (1.0 - straight) / (1.0 - passing).max(1e-9);
            let energies = [bands.visible(&scattered), bands.solar(&scattered)].map(|e| straight + caught * e);
            Ok((sums, straight, energies))
        };
        let columns = (0..2 * n).into_par_iter().map(column).collect::<Result<Vec<_>, Error>>()?;
        let block = |side: usize, half: usize| MatrixBlock {
            values: [0, 1].map(|band| {
                let at = |o: usize, i: usize| columns[side * n + i].0[half][band][o];
                (0..n * n).map(|k| at(k / n, k % n)).collect()
            }),
        };
        let mut matrix = Matrix {
            basis,
            blocks: [0, 1].map(|side| [block(side, 0), block(side, 1)]),
            straight: [0, 1].map(|side| columns[side * n..(side + 1) * n].iter().map(|c| c.1).collect()),
            balanced: Balanced::default(),
        };
        matrix.balanced.asymmetry = matrix.asymmetry();
        for band in 0..BANDS {
            let energies: Vec<f64> = columns.iter().map(|column| column.2[band]).collect();
            matrix.balance(band, &energies);
        }
        Ok(matrix)
    }

    /// Side and patch of outgoing light whose directions are those of the incident state `at`.
    fn leaving(&self, at: usize) -> (usize, usize) {
        let n = self.basis.len();
        (at / n, self.basis.opposite(at % n))
    }

    /// Position of the value for light from the directions of one state, a side and patch of incident light,
    /// towards those of another: side of incidence, half, and index within the block.
    fn place(&self, from: usize, to: usize) -> (usize, usize, usize) {
        let n = self.basis.len();
        let (side, patch) = self.leaving(to);
        (from / n, usize::from(side != from / n), patch * n + from % n)
    }

    /// Makes a band reciprocal and gives its columns these energies.
    ///
    /// The two values of a pair of directions are estimates of the same number; S is their mean. The energies
    /// are those of the cloth's own energy balance, from which quadrature over patches and the symmetrized S
    /// deviate by some percent. S is scaled to `d(a) S(a, b) d(b)` with the positive d that gives each column
    /// its energy (Sinkhorn and Knopp 1967). Straight light is part of S.
    fn balance(&mut self, band: usize, energies: &[f64]) {
        let count = 2 * self.basis.len();
        let value = |matrix: &Matrix, from: usize, to: usize| {
            let (side, half, at) = matrix.place(from, to);
            matrix.blocks[side][half].values[band][at]
        };
        let mut s = vec![0.0; count * count];
        for from in 0..count {
            for to in 0..count {
                s[from * count + to] = 0.5 * (value(self, from, to) + value(self, to, from));
            }
        }
        let omega: Vec<f64> = (0..count).map(|at| self.basis.projected_solid_angle(at % self.basis.len())).collect();
        let sum = |d: &[f64], from: usize| -> f64 {
            let row = &s[from * count..(from + 1) * count];
            d[from] * row.iter().zip(d).zip(&omega).map(|((s, d), omega)| s * d * omega).sum::<f64>()
        };
        let mut d = vec![1.0; count];
        for _ in 0..BALANCE_STEPS {
            let ratios: Vec<f64> = (0..count)
                .map(|at| {
                    let sum = sum(&d, at);
                    if sum > 1e-12 && energies[at] > 1e-12 { energies[at] / sum } else { 1.0 }
                })
                .collect();
            d.iter_mut().zip(&ratios).for_each(|(d, ratio)| *d *= ratio.sqrt());
            if ratios.iter().all(|ratio| (ratio - 1.0).abs() < 1e-9) {
                break;
            }
        }
        for from in 0..count {
            let before: f64 = (0..count).map(|to| value(self, from, to) * omega[to]).sum();
            if before > 1e-3 {
                let change = (energies[from] / before - 1.0).abs();
                self.balanced.energy_change = self.balanced.energy_change.max(change);
            }
        }
        for from in 0..count {
            for to in 0..count {
                let (side, half, at) = self.place(from, to);
                self.blocks[side][half].values[band][at] = d[from] * s[from * count + to] * d[to];
            }
        }
    }

    /// Largest sum of reflected and transmitted light of an incident patch, over both sides and bands.
    pub fn largest_total(&self) -> f64 {
        let total = |side: usize, band: usize, patch: usize| -> f64 {
            (0..2).map(|half| self.energy(side, half, band, patch)).sum()
        };
        let all = (0..2)
            .flat_map(|side| (0..BANDS).flat_map(move |band| (0..self.basis.len()).map(move |p| (side, band, p))));
        all.map(|(side, band, patch)| total(side, band, patch)).fold(0.0, f64::max)
    }

    /// Fraction of an incident patch's light that leaves on one side: the sum over outgoing patches of the
    /// BSDF times the projected solid angle.
    pub fn energy(&self, side: usize, half: usize, band: usize, patch: usize) -> f64 {
        let n = self.basis.len();
        let values = &self.blocks[side][half].values[band];
        (0..n).map(|o| values[o * n + patch] * self.basis.projected_solid_angle(o)).sum()
    }

    /// Mean of [`Matrix::energy`] over incident light that is uniform over the hemisphere.
    pub fn hemispherical(&self, side: usize, half: usize, band: usize) -> f64 {
        let of = |i: usize| self.energy(side, half, band, i) * self.basis.projected_solid_angle(i);
        (0..self.basis.len()).map(of).sum::<f64>() / std::f64::consts::PI
    }

    /// Deviation from reciprocity in the visible band: the root mean square difference between a value and
    /// that with exchanged directions, weighted by projected solid angles, relative to that of the values.
    /// Straight light is included.
    pub fn asymmetry(&self) -> f64 {
        let n = self.basis.len();
        let (mut off, mut all) = (0.0, 0.0);
        let omega = |patch: usize| self.basis.projected_solid_angle(patch);
        for (side, half) in [(0, 0), (1, 0), (0, 1)] {
            let there = &self.blocks[side][half].values[0];
            let back = &self.blocks[if half == 0 { side } else { 1 - side }][half].values[0];
            for o in 0..n {
                for i in 0..n {
                    let (a, b) = (there[o * n + i], back[self.basis.opposite(i) * n + self.basis.opposite(o)]);
                    let weight = omega(o) * omega(i);
                    off += weight * (a - b) * (a - b);
                    all += weight * 0.5 * (a * a + b * b);
                }
            }
        }
        if all > 0.0 { (off / all).sqrt() } else { 0.0 }
    }
}
