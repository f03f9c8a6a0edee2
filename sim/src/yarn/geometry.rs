//! Flights between the plies, in the plane across the yarn: where a ray that leaves one ply hits the others
//! (Yu 2025, 5.3, Fig. 9a).
//!
//! A ray leaves ply 0 in azimuth phi at lateral position t along x' = (-sin phi, cos phi). It hits ply p,
//! whose center is c, at the offset h' = t - c . x' in that ply's frame, whose y' axis points back along the
//! ray. A ply stops only the share s(h') of a line that hits a fiber. The plies are visited in their order
//! along the ray; each stops the share s of the remaining light, and the light that remains at the end
//! escapes. The shares therefore add up to 1 exactly.

use plywave::math::axis;
use plywave::spec::PlyRing;
use plywave_tables::table::Table;
use std::f64::consts::TAU;

/// Share of a line through a ply that hits a fiber, over the line's offset.
pub(crate) struct Intercept {
    /// Values at the centers of equal parts of [-reach, reach].
    values: Vec<f64>,
    pub reach_um: f64,
}

impl Intercept {
    /// Intercepts at each incident latitude of the table. They come from the paths that hit the ply if the
    /// table records them, otherwise from 1 - r_d of the beam, whose waist blurs the ply's edge.
    pub fn of_table(table: &Table, radius_um: f64) -> Vec<Intercept> {
        let rows = table.theta_i.len();
        let columns = table.h_um.len();
        (0..rows)
            .map(|m| match &table.exit {
                Some(exit) => {
                    let width = exit.met.len() / rows;
                    let hits = &exit.met[m * width..(m + 1) * width];
                    Intercept { values: hits.iter().map(|v| f64::from(*v)).collect(), reach_um: radius_um }
                }
                None => {
                    let reach_um = table.h_um[columns - 1];
                    let hit = |x: f64| {
                        let (n, t) = axis::cell((x + reach_um) / (2.0 * reach_um) * (columns - 1) as f64, columns);
                        let r_d = &table.r_d[m * columns + n..];
                        1.0 - (r_d[0] + t * (r_d[1] - r_d[0]))
                    };
                    let cells = 8 * columns;
                    let x = |i: usize| reach_um * ((2 * i + 1) as f64 / cells as f64 - 1.0);
                    Intercept { values: (0..cells).map(|i| hit(x(i)).clamp(0.0, 1.0)).collect(), reach_um }
                }
            })
            .collect()
    }

    /// Intercepts at each latitude of the table's fine energies; empty for a table without them.
    pub fn fine(table: &Table) -> Vec<Intercept> {
        let Some(energies) = table.energies.as_ref().filter(|e| !e.met.is_empty()) else { return Vec::new() };
        let (rows, reach_um) = (energies.miss_theta_i.len(), energies.miss_h_um[energies.miss_h_um.len() - 1]);
        let values = energies.met.chunks_exact(energies.met.len() / rows);
        values.map(|hits| Intercept { values: hits.iter().map(|v| f64::from(*v)).collect(), reach_um }).collect()
    }

    /// Intercepts at the latitudes of the table's slices, from its fine energies if it has them. Their parts
    /// are finer than those of [`Intercept::of_table`].
    pub fn of_beams(table: &Table) -> Option<Vec<Intercept>> {
        let fine = Intercept::fine(table);
        let steps = fine.len().checked_sub(1)? / (table.theta_i.len() - 1);
        Some(fine.into_iter().step_by(steps.max(1)).collect())
    }

    /// Mean over the latitudes, weighted by uniform light from the whole sphere, and over both signs of the
    /// offset, which a rotation of the ply exchanges.
    pub fn mean(all: &[Intercept], theta: &[f64]) -> Intercept {
        let n = all[0].values.len();
        let total: f64 = theta.iter().map(|t| t.cos()).sum();
        let at = |i: usize| {
            let sum = |i: usize| all.iter().zip(theta).map(|(a, t)| a.values[i] * t.cos()).sum::<f64>();
            0.5 * (sum(i) + sum(n - 1 - i)) / total
        };
        Intercept { values: (0..n).map(at).collect(), reach_um: all[0].reach_um }
    }

    /// Share at offset `h_um`; 0 beyond the reach.
    pub fn at(&self, h_um: f64) -> f64 {
        if h_um.abs() > self.reach_um {
            return 0.0;
        }
        let count = self.values.len();
        let (i, t) = axis::cell((h_um / self.reach_um + 1.0) * 0.5 * count as f64 - 0.5, count);
        self.values[i] + t * (self.values[i + 1] - self.values[i])
    }
}

/// Sizes of the grids of light between plies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Level {
    /// Rows of latitude theta_o.
    pub rows: usize,
    /// Bins of azimuth phi_o; three times the cells.
    pub azimuths: usize,
    /// Cells of the yarn's orientation psi; a multiple of the plies.
    pub cells: usize,
    /// Offsets h' at which light hits plies.
    pub offsets: usize,
}

/// Azimuth bins in a cell of psi.
pub(crate) const BINS_A_CELL: usize = 3;

impl Level {
    pub fn new(plies: u32, rows: usize, min_cells: usize, offsets: usize) -> Level {
        let plies = plies as usize;
        let cells = plies * min_cells.div_ceil(plies);
        Level { rows: 2 * rows.div_ceil(2), azimuths: BINS_A_CELL * cells, cells, offsets: 2 * offsets.div_ceil(2) }
    }

    /// Number of energies of a state over all cells.
    pub fn state_len(&self) -> usize {
        self.cells * self.rows * self.azimuths
    }
}

/// Flights of the light that leaves a ply, by azimuth relative to psi and by lateral position.
pub(crate) struct Flights {
    pub azimuths: usize,
    pub positions: usize,
    pub others: usize,
    pub offsets: usize,
    /// `[azimuth - psi][position][ply - 1][h']`: share that hits that ply at h'.
    pub hits: Vec<f32>,
    /// `[azimuth - psi][position]`: share that hits no other ply.
    pub escape: Vec<f32>,
}

/// Number of samples per azimuth bin, per cell of psi and per lateral position.
const SUB: usize = 4;

impl Flights {
    /// Flights over bins of azimuth of the same width as the bins of psi, both filled uniformly, for light
    /// that leaves at `positions` equal parts of [-R, R].
    pub fn new(ring: &PlyRing, azimuths: usize, positions: usize, offsets: usize, intercept: &Intercept) -> Flights {
        let others = ring.plies as usize - 1;
        let mut flights = Flights {
            azimuths,
            positions,
            others,
            offsets,
            hits: vec![0.0; azimuths * positions * others * offsets],
            escape: vec![0.0; azimuths * positions],
        };
        let step = TAU / azimuths as f64;
        let weight = 1.0 / (SUB * SUB * SUB) as f64;
        let inside = |k: usize| (k as f64 + 0.5) / SUB as f64;
        let centers: Vec<[f64; 2]> = (1..ring.plies).map(|p| ring.center(p, 0.0)).collect();
        let mut order: Vec<usize> = (0..others).collect();
        for j in 0..azimuths {
            for (a, b) in (0..SUB * SUB).map(|k| (k / SUB, k % SUB)) {
                let (sin, cos) = ((j as f64 + inside(a) - inside(b)) * step).sin_cos();
                let along = |p: usize| centers[p][0] * cos + centers[p][1] * sin;
                order.sort_by(|&p, &q| along(p).total_cmp(&along(q)));
                for i in 0..positions {
                    for k in 0..SUB {
                        let t = ring.radius_um * (2.0 * (i as f64 + inside(k)) / positions as f64 - 1.0);
                        let mut remaining = weight;
                        for &p in order.iter().filter(|&&p| along(p) > 0.0) {
                            let h = t - (centers[p][1] * cos - centers[p][0] * sin);
                            let stopped = remaining * intercept.at(h);
                            if stopped > 0.0 {
                                let at = ((j * positions + i) * others + p) * offsets;
                                for (x, share) in split(h, intercept.reach_um, offsets) {
                                    flights.hits[at + x] += (stopped * share) as f32;
                                }
                                remaining -= stopped;
                            }
                        }
                        flights.escape[j * positions + i] += remaining as f32;
                    }
                }
            }
        }
        flights
    }

    /// Flights of light that is uniform over the positions and over cells of psi:
    /// `hits[azimuth - first bin of the cell][ply - 1][h']` and `escape[azimuth - first bin of the cell]`.
    pub fn of_cells(&self) -> CellFlights {
        let (n, width) = (self.azimuths, self.others * self.offsets);
        let (mut hits, mut escape) = (vec![0.0f32; n * width], vec![0.0f32; n]);
        let weight = 1.0 / (BINS_A_CELL * self.positions) as f32;
        for j in 0..n {
            for k in 0..BINS_A_CELL {
                let relative = (j + n - k) % n;
                for i in 0..self.positions {
                    let from = &self.hits[(relative * self.positions + i) * width..][..width];
                    hits[j * width..(j + 1) * width].iter_mut().zip(from).for_each(|(to, v)| *to += weight * v);
                    escape[j] += weight * self.escape[relative * self.positions + i];
                }
            }
        }
        CellFlights { hits, escape }
    }
}

/// Flights from whole cells of psi.
pub(crate) struct CellFlights {
    pub hits: Vec<f32>,
    pub escape: Vec<f32>,
}

/// The two of `count` equal parts of [-reach, reach] between whose centers `h` lies, with their linear
/// weights.
pub(crate) fn split(h: f64, reach: f64, count: usize) -> [(usize, f64); 2] {
    let (i, t) = axis::cell((h / reach + 1.0) * 0.5 * count as f64 - 0.5, count);
    [(i, 1.0 - t), (i + 1, t)]
}
