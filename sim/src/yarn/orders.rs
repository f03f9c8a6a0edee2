//! Orders of scattering beyond the second ply, computed one after the other until little energy remains. The
//! remaining energy is distributed like the last order.

use super::geometry::{BINS_A_CELL, CellFlights, Level};
use super::kernel::{Kernel, Scratch};
use std::sync::Arc;

/// Maximum number of orders before a chain ends in its geometric series.
const MAX_ORDERS: usize = 100;

/// Light of one kind that has hit a second ply, with all of its further orders.
pub(crate) struct Chain {
    /// Sizes (rows, azimuths) of `first` and of `later`.
    pub fine: (usize, usize),
    pub coarse: (usize, usize),
    /// `[theta_o][phi_o]`: energies that escaped after the second ply.
    pub first: Vec<f64>,
    /// `[theta_o][phi_o]`: energies that escaped after three or more plies.
    pub later: Vec<f64>,
    /// Sum of `first`; `residual` is that of `later`.
    pub conv: f64,
    pub residual: f64,
    /// Energy that plies absorbed.
    pub absorbed: f64,
}

impl Chain {
    pub fn new(fine: Level) -> Chain {
        let coarse = (fine.rows / 2, fine.azimuths / 2);
        Chain {
            fine: (fine.rows, fine.azimuths),
            coarse,
            first: vec![0.0; fine.rows * fine.azimuths],
            later: vec![0.0; coarse.0 * coarse.1],
            conv: 0.0,
            residual: 0.0,
            absorbed: 0.0,
        }
    }

    /// Removes the escaping light from `state[cell][theta_o][phi_o]`, the light that leaves the second ply.
    pub fn escape(&mut self, level: Level, state: &mut [f32], escape: &[f32]) {
        self.conv = escape_from(level, state, escape, &mut self.first);
    }
}

/// Removes the escaping light from a state and adds it to `map[theta_o][phi_o]`; returns its energy.
fn escape_from(level: Level, state: &mut [f32], escape: &[f32], map: &mut [f64]) -> f64 {
    let Level { rows, azimuths, cells, .. } = level;
    let mut total = 0.0;
    for cell in 0..cells {
        for r in 0..rows {
            let line = &mut state[(cell * rows + r) * azimuths..][..azimuths];
            for (j, v) in line.iter_mut().enumerate() {
                let out = *v * escape[(j + azimuths - BINS_A_CELL * cell) % azimuths];
                *v -= out;
                map[r * azimuths + j] += f64::from(out);
                total += f64::from(out);
            }
        }
    }
    total
}

/// The orders of one kind of light.
pub(crate) struct Orders {
    kernel: Kernel,
    level: Level,
    plies: usize,
    flights: Arc<CellFlights>,
}

impl Orders {
    pub fn new(kernel: Kernel, level: Level, plies: u32, flights: Arc<CellFlights>) -> Orders {
        Orders { kernel, level, plies: plies as usize, flights }
    }

    /// Computes all orders from `stopped[cell][theta_o][phi_o]`, the light that left the second ply and that
    /// a third one stopped, given on a grid twice as fine.
    pub fn run(&self, chain: &mut Chain, fine: Level, stopped: &[f32], tolerance: f64, scratch: &mut Scratch) {
        let sum = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>();
        let mut energy = sum(stopped);
        let least = tolerance * energy.max(1e-30);
        if energy <= 1e-12 {
            chain.absorbed += energy;
            return;
        }
        let mut state = self.coarsen(fine, stopped);
        let mut arrivals = vec![0.0f32; self.level.state_len() * self.level.offsets];
        // This light has already been stopped, so the share that would escape on the coarser grid is not
        // removed.
        self.arrive(&state, &mut arrivals);
        let scale = (energy / sum(&arrivals).max(1e-30)) as f32;
        arrivals.iter_mut().for_each(|v| *v *= scale);
        for order in 0..MAX_ORDERS {
            self.kernel.scatter(&arrivals, &mut state, scratch);
            let absorbed = energy - sum(&state);
            let mut map = vec![0.0; chain.later.len()];
            let escaped = {
                let mut remaining = state.clone();
                escape_from(self.level, &mut remaining, &self.flights.escape, &mut map)
            };
            let before = energy;
            energy = before - absorbed - escaped;
            // In the geometric series each further order has the share `ratio` of the previous one.
            let ratio = (energy / before).clamp(0.0, 0.999);
            let last = energy <= least || order + 1 == MAX_ORDERS;
            let times = if last { 1.0 / (1.0 - ratio) } else { 1.0 };
            chain.later.iter_mut().zip(&map).for_each(|(to, v)| *to += times * v);
            chain.residual += times * escaped;
            chain.absorbed += times * absorbed;
            if last {
                return;
            }
            self.arrive(&state, &mut arrivals);
        }
    }

    /// Computes `arrivals[cell][theta_o][h'][phi_o]` of the light that leaves.
    fn arrive(&self, state: &[f32], arrivals: &mut [f32]) {
        let Level { rows, azimuths, cells, offsets } = self.level;
        let others = self.plies - 1;
        arrivals.fill(0.0);
        for cell in 0..cells {
            for p in 1..self.plies {
                let there = (cell + cells * p / self.plies) % cells;
                for r in 0..rows {
                    let from = &state[(cell * rows + r) * azimuths..][..azimuths];
                    let to = &mut arrivals[(there * rows + r) * offsets * azimuths..][..offsets * azimuths];
                    for (j, v) in from.iter().enumerate() {
                        let relative = (j + azimuths - BINS_A_CELL * cell) % azimuths;
                        let hits = &self.flights.hits[(relative * others + p - 1) * offsets..][..offsets];
                        for (x, hit) in hits.iter().enumerate() {
                            to[x * azimuths + j] += v * hit;
                        }
                    }
                }
            }
        }
    }

    /// Converts a state to the grid that is half as fine.
    fn coarsen(&self, fine: Level, state: &[f32]) -> Vec<f32> {
        let Level { rows, azimuths, .. } = self.level;
        let mut out = vec![0.0f32; self.level.state_len()];
        for cell in 0..fine.cells {
            for r in 0..fine.rows {
                let from = &state[(cell * fine.rows + r) * fine.azimuths..][..fine.azimuths];
                let to = &mut out[((cell / 2) * rows + r / 2) * azimuths..][..azimuths];
                for (to, pair) in to.iter_mut().zip(from.chunks_exact(2)) {
                    *to += pair[0] + pair[1];
                }
            }
        }
        out
    }
}
