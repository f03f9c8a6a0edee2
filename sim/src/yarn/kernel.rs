//! Scattering of light from another ply: a matrix over latitude and offset for each azimuthal frequency (Yu
//! 2025, 5.3).
//!
//! Light that travels in direction (theta_o, phi_o) arrives at the latitude theta_i' = -theta_o, and a global
//! azimuth phi is phi' = phi - phi_o - pi/2 in the ply's frame. The energy that leaves is
//!
//! ```text
//! E'(theta, phi) = sum over theta_o, h', phi_o of A(theta_o, h', phi_o) F(-theta_o, h'; theta, phi - phi_o - pi/2)
//! ```
//!
//! where A is the energy that arrives and F the table's distribution of light that hits the ply. This is a
//! circular convolution over the azimuth, which is a product at each frequency.

use super::bins::Overlap;
use super::geometry::Level;
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use num_complex::Complex;
use plywave::math::axis;
use plywave_tables::table::{OutgoingGrid, Table};
use rayon::prelude::*;
use rustfft::{Fft, FftPlannerScalar};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

type C32 = Complex<f32>;

/// Part of the light in a slice of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Light {
    /// Reflection-only light.
    Reflected,
    /// All light at absorption k.
    All(usize),
}

/// The scattering matrices of one [`Light`].
pub(crate) struct Kernel {
    level: Level,
    /// `[frequency][theta_o][h'][theta]`, theta fastest.
    spectra: Vec<C32>,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
}

/// Buffers of [`Kernel::scatter`].
#[derive(Default)]
pub(crate) struct Scratch {
    spectra: Vec<C32>,
    out: Vec<C32>,
    line: Vec<C32>,
    work: Vec<C32>,
}

/// Response to a unit of energy that hits the ply at latitude `theta_i` (any sign) and offset `h_um`, in the
/// coarse bins of the level. Azimuths are relative to the light's direction of propagation.
fn response(table: &Table, light: Light, level: Level, theta_i: f64, h_um: f64) -> Vec<f32> {
    let width = TAU / level.azimuths as f64;
    let mirrored = theta_i < 0.0;
    let overlap = Overlap::new(table.grid, level.rows, level.azimuths, -FRAC_PI_2 - 0.5 * width, mirrored);
    let (theta, h) = if mirrored { (-theta_i, -h_um) } else { (theta_i, h_um) };
    let (rows, columns) = (table.theta_i.len(), table.h_um.len());
    let ((m, s), (n, t)) = (axis::locate(theta, &table.theta_i), axis::locate(h, &table.h_um));
    let mut out = vec![0.0f32; level.rows * level.azimuths];
    let mut hit = 0.0;
    let nodes = [(0, 0, (1.0 - s) * (1.0 - t)), (0, 1, (1.0 - s) * t), (1, 0, s * (1.0 - t)), (1, 1, s * t)];
    for (a, b, weight) in nodes.into_iter().filter(|node| node.2 > 0.0) {
        let (m, n) = ((m + a).min(rows - 1), (n + b).min(columns - 1));
        hit += weight * (1.0 - table.r_d[m * columns + n]);
        overlap.add(table.refl_slice(m, n), weight, &mut out);
        if let Light::All(k) = light {
            overlap.add(table.high_slice(m, n, k), weight, &mut out);
        }
    }
    let unit = (1.0 / hit.max(1e-6)) as f32;
    out.iter_mut().for_each(|v| *v *= unit);
    out
}

impl Kernel {
    pub fn new(table: &Table, light: Light, level: Level, reach_um: f64) -> Kernel {
        let (rows, azimuths, offsets) = (level.rows, level.azimuths, level.offsets);
        let sphere = OutgoingGrid { theta_o: rows, phi_o: azimuths };
        let mut planner = FftPlannerScalar::new();
        let (forward, inverse) = (planner.plan_fft_forward(azimuths), planner.plan_fft_inverse(azimuths));
        let frequencies = azimuths / 2 + 1;
        let inputs = rows * offsets;
        let responses: Vec<Vec<C32>> = (0..inputs)
            .into_par_iter()
            .map(|input| {
                let (i, x) = (input / offsets, input % offsets);
                let h = reach_um * ((2 * x + 1) as f64 / offsets as f64 - 1.0);
                let mut bins: Vec<C32> =
                    response(table, light, level, -sphere.theta(i), h).into_iter().map(C32::from).collect();
                bins.chunks_exact_mut(azimuths).for_each(|row| forward.process(row));
                bins
            })
            .collect();
        let mut spectra = vec![C32::default(); frequencies * inputs * rows];
        for (input, bins) in responses.iter().enumerate() {
            for k in 0..frequencies {
                for r in 0..rows {
                    spectra[(k * inputs + input) * rows + r] = bins[r * azimuths + k];
                }
            }
        }
        Kernel { level, spectra, forward, inverse }
    }

    /// Computes the energies that leave, `out[cell][theta][phi]`, from those that arrive,
    /// `arrivals[cell][theta_o][h'][phi_o]`.
    pub fn scatter(&self, arrivals: &[f32], out: &mut [f32], scratch: &mut Scratch) {
        let Level { rows, azimuths, cells, offsets } = self.level;
        let (frequencies, inputs) = (azimuths / 2 + 1, rows * offsets);
        scratch.line.resize(azimuths, C32::default());
        scratch
            .work
            .resize(self.forward.get_inplace_scratch_len().max(self.inverse.get_inplace_scratch_len()), C32::default());
        // A transform takes two real lines, one of them as the imaginary part. The spectra are
        // `[frequency][cell][theta_o][h']`.
        scratch.spectra.resize(frequencies * cells * inputs, C32::default());
        let half = C32::new(0.5, 0.0);
        let minus_half_i = C32::new(0.0, -0.5);
        for pair in 0..cells * inputs / 2 {
            let lines = &arrivals[2 * pair * azimuths..2 * (pair + 1) * azimuths];
            let (a, b) = lines.split_at(azimuths);
            if lines.iter().all(|v| *v == 0.0) {
                for k in 0..frequencies {
                    scratch.spectra[k * cells * inputs + 2 * pair..][..2].fill(C32::default());
                }
                continue;
            }
            for ((z, a), b) in scratch.line.iter_mut().zip(a).zip(b) {
                *z = C32::new(*a, *b);
            }
            self.forward.process_with_scratch(&mut scratch.line, &mut scratch.work);
            for k in 0..frequencies {
                let (z, w) = (scratch.line[k], scratch.line[(azimuths - k) % azimuths].conj());
                let to = &mut scratch.spectra[k * cells * inputs + 2 * pair..][..2];
                (to[0], to[1]) = ((z + w) * half, (z - w) * minus_half_i);
            }
        }
        scratch.out.resize(frequencies * cells * rows, C32::default());
        for k in 0..frequencies {
            matmul(
                MatMut::from_column_major_slice_mut(&mut scratch.out[k * cells * rows..][..cells * rows], rows, cells),
                Accum::Replace,
                MatRef::from_column_major_slice(&self.spectra[k * inputs * rows..][..inputs * rows], rows, inputs),
                MatRef::from_column_major_slice(
                    &scratch.spectra[k * cells * inputs..][..cells * inputs],
                    inputs,
                    cells,
                ),
                C32::new(1.0, 0.0),
                Par::Seq,
            );
        }
        let scale = 1.0 / azimuths as f32;
        let i = C32::new(0.0, 1.0);
        for pair in 0..cells * rows / 2 {
            for k in 0..azimuths {
                let from =
                    |k: usize| (scratch.out[k * cells * rows + 2 * pair], scratch.out[k * cells * rows + 2 * pair + 1]);
                scratch.line[k] = if k < frequencies {
                    let (a, b) = from(k);
                    a + i * b
                } else {
                    let (a, b) = from(azimuths - k);
                    a.conj() + i * b.conj()
                };
            }
            self.inverse.process_with_scratch(&mut scratch.line, &mut scratch.work);
            let (a, b) = out[2 * pair * azimuths..2 * (pair + 1) * azimuths].split_at_mut(azimuths);
            for ((z, a), b) in scratch.line.iter().zip(a).zip(b) {
                (*a, *b) = (z.re * scale, z.im * scale);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A table of random slices without any symmetry.
    fn table() -> Table {
        let grid = OutgoingGrid { theta_o: 7, phi_o: 10 };
        let (rows, columns) = (3usize, 5usize);
        let mut x = 1u32;
        let mut random = |n: usize, scale: f64| -> Vec<f64> {
            (0..n)
                .map(|_| {
                    x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    scale * f64::from(x >> 8) / f64::from(1 << 24)
                })
                .collect()
        };
        let floats = |v: Vec<f64>| v.into_iter().map(|v| v as f32).collect();
        Table {
            spec_text: String::new(),
            program_version: String::new(),
            preset: String::new(),
            seed: 0,
            plies: 1,
            traced: false,
            theta_i: vec![0.0, 0.7, 1.4],
            h_um: vec![-70.0, -35.0, 0.0, 35.0, 70.0],
            sigma_per_um: vec![0.0],
            grid,
            r_d: random(rows * columns, 0.5),
            energy_refl: vec![],
            energy_high: vec![],
            energy_se: vec![],
            energy_killed: vec![],
            refl: floats(random(rows * columns * grid.len(), 0.1)),
            high: floats(random(rows * columns * grid.len(), 0.1)),
            noise_refl: vec![],
            noise_high: vec![],
            paths: vec![],
            interactions: vec![],
            exit: None,
            energies: None,
        }
    }

    /// The kernel agrees with a brute-force reference: the sum over all arriving bins of their responses,
    /// rotated to their azimuths.
    #[test]
    fn convolution_by_frequencies_is_the_double_loop() {
        let table = table();
        for (light, azimuths, cells) in [(Light::Reflected, 12, 4), (Light::All(0), 15, 5)] {
            let level = Level { rows: 6, azimuths, cells, offsets: 4 };
            let kernel = Kernel::new(&table, light, level, 50.0);
            let arrivals: Vec<f32> =
                (0..level.state_len() * level.offsets).map(|i| if i % 7 < 3 { (i % 11) as f32 } else { 0.0 }).collect();
            let mut got = vec![0.0; level.state_len()];
            kernel.scatter(&arrivals, &mut got, &mut Scratch::default());
            let mut want = vec![0.0f64; level.state_len()];
            let sphere = OutgoingGrid { theta_o: level.rows, phi_o: azimuths };
            for i in 0..level.rows {
                for x in 0..level.offsets {
                    let h = 50.0 * ((2 * x + 1) as f64 / level.offsets as f64 - 1.0);
                    let response = response(&table, light, level, -sphere.theta(i), h);
                    for cell in 0..cells {
                        let from = &arrivals[((cell * level.rows + i) * level.offsets + x) * azimuths..][..azimuths];
                        for (j, energy) in from.iter().enumerate() {
                            for (b, share) in response.iter().enumerate() {
                                let to = b / azimuths * azimuths + (b % azimuths + j) % azimuths;
                                want[cell * level.rows * azimuths + to] += f64::from(energy * share);
                            }
                        }
                    }
                }
            }
            let max = want.iter().fold(0.0, |a: f64, b| a.max(*b));
            for (i, (got, want)) in got.iter().zip(&want).enumerate() {
                assert!((f64::from(*got) - want).abs() < 1e-5 * max, "{light:?}, bin {i}: {got}, want {want}");
            }
        }
    }

    /// Exact forward in the table's frame is the light's own direction, so light that is not deflected keeps
    /// it.
    #[test]
    fn exact_forward_is_straight_on() {
        let mut table = table();
        table.r_d.fill(0.0);
        table.high.fill(0.0);
        table.grid = OutgoingGrid { theta_o: 30, phi_o: 40 };
        let (rows, columns) = (table.theta_i.len(), table.h_um.len());
        table.refl = vec![0.0; rows * columns * table.grid.len()];
        let forward: Vec<_> = (0..rows)
            .map(|m| {
                table.grid.bin(plywave::frame::direction(-table.theta_i[m] as f32, 1.5 * std::f32::consts::PI + 1e-3))
            })
            .collect();
        for m in 0..rows {
            for n in 0..columns {
                let unit = 1.0 / table.grid.solid_angle(forward[m] / table.grid.phi_o);
                table.refl[(m * columns + n) * table.grid.len() + forward[m]] = unit as f32;
            }
        }
        let level = Level { rows: 6, azimuths: 12, cells: 4, offsets: 4 };
        for theta_o in [0.7, -0.7] {
            let out = response(&table, Light::Reflected, level, -theta_o, 13.0);
            // The light leaves within a bin of its incident azimuth, at its own latitude.
            let row = ((theta_o / std::f64::consts::PI + 0.5) * 6.0) as usize;
            let straight = out[row * 12] + out[row * 12 + 11] + out[row * 12 + 1];
            assert!((straight - 1.0).abs() < 1e-5, "theta_o {theta_o}: {out:?}");
        }
    }
}
