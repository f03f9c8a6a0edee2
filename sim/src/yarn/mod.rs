//! Table of a yarn of P plies, computed from the table of one ply (Yu 2025, 5.3, Eq. 9-10). It is then fitted
//! like any other table.
//!
//! `f_multi = f_direct + f_conv + f_resi`, averaged over the yarn's valid orientations psi:
//!
//! - *first hits* of the beam: ply 0, and the plies that stop some of the beam before or beside it
//!   (`beam.rs`);
//! - *direct*: light of a ply's slice that no other ply stops. The flights between plies are 2D
//!   (`geometry.rs`): each ply stops the share of a line that hits a fiber, and the remaining light
//!   continues, so that the shares add up to 1;
//! - *conv*: light that a second ply stops and scatters by the same table, at the latitude -theta_o and the
//!   offset h' at which it arrives: a circular convolution over azimuth (`kernel.rs`);
//! - *residual*: all further orders of scattering, on a grid half as fine (`orders.rs`). The last 1e-4 is
//!   distributed like the last order.
//!
//! The paper stops after conv and replaces the remaining light by a diffuse lobe. Since all plies are equal,
//! light that leaves ply p of a yarn at psi leaves ply 0 of a yarn at psi + 2 pi p / P. The orders therefore
//! need only a state over (psi, theta_o, phi_o).
//!
//! f_refl and f_high are separate: light that was only reflected at every ply is f_refl, all other light
//! f_high. At each absorption the chain of all light is computed, and that of f_refl is subtracted. The
//! lateral positions of the first exit come from the table's record
//! ([`plywave_tables::table::ExitPositions`]). Later exits, and tables without the record, use the paper's
//! uniform distribution.

mod beam;
mod bins;
mod geometry;
mod kernel;
mod noise;
mod orders;

use crate::error::SimError;
use beam::{first_hits, missed};
use bins::{Overlap, density};
use geometry::{Flights, Intercept, Level};
use kernel::{Kernel, Light, Scratch};
use noise::PartsNoise;
use orders::{Chain, Orders};
use plywave::math::axis;
use plywave::spec::YarnSpec;
use plywave_tables::table::{OutgoingGrid, Table, TableEnergies};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Grid sizes of the construction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YarnOptions {
    /// Number of rows of theta_o in the light between plies; orders beyond the first have half as many.
    pub rows: usize,
    /// Minimum number of orientations psi; there are three times as many bins of phi_o. Orders beyond the
    /// first have half as many of both.
    pub cells: usize,
    /// Number of offsets h' at which light hits a ply.
    pub offsets: usize,
    /// Whether the positions of the first exit come from the table, if it has them. Otherwise light leaves
    /// uniformly over the ply's width.
    pub exits: bool,
    /// Fraction of a chain's light below which the remaining orders are summed as a geometric series.
    pub tolerance: f64,
}

impl Default for YarnOptions {
    fn default() -> Self {
        YarnOptions { rows: 32, cells: 24, offsets: 16, exits: true, tolerance: 1e-4 }
    }
}

/// Distribution of the beam's power, `[theta_i][h][sigma]` except for `r_d`. The fields sum to 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct YarnLedger {
    /// Light that exactly one ply scattered.
    pub direct: Vec<f64>,
    /// Light that exactly two plies scattered.
    pub conv: Vec<f64>,
    /// Light that three or more plies scattered.
    pub residual: Vec<f64>,
    /// Absorbed light; at sigma = 0, the table's Monte Carlo error and killed paths.
    pub absorbed: Vec<f64>,
    /// `[theta_i][h]`: light that missed the yarn.
    pub r_d: Vec<f64>,
}

/// Computes the table of the yarn of `spec` from the table of one of its plies, and the ledger of its light.
/// The result depends on table and options alone. `progress` is called with the number of finished incidences
/// and their total.
///
/// # Errors
/// [`SimError::Runtime`] if the table's arrays do not fit together, [`SimError::Table`] if it is not that of
/// a single ply, [`SimError::Option`] if a size is out of range.
pub fn yarn_table(
    table: &Table,
    spec: &YarnSpec,
    options: &YarnOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<(Table, YarnLedger), SimError> {
    table.check("table")?;
    if table.plies != 1 {
        let hint = "must be 1: this table is of a yarn already";
        return Err(SimError::Table { field: "plies", value: table.plies.to_string(), hint });
    }
    if let Some((field, _)) =
        [("theta_i", table.theta_i.len()), ("h_um", table.h_um.len())].into_iter().find(|a| a.1 < 3)
    {
        return Err(SimError::Table { field, value: "fewer than 3 nodes".into(), hint: "must have 3 or more nodes" });
    }
    for (name, value, allowed) in
        [("rows", options.rows, 4..=180), ("cells", options.cells, 8..=120), ("offsets", options.offsets, 4..=64)]
    {
        if !allowed.contains(&value) {
            return Err(SimError::Option { name, value, allowed: "rows 4 to 180, cells 8 to 120, offsets 4 to 64" });
        }
    }
    let ring = spec.ply_ring();
    if ring.plies == 1 {
        return Ok((table.clone(), YarnLedger::default()));
    }
    let yarn = Yarn::new(table, spec, options);
    let (rows, columns) = (table.theta_i.len(), table.h_um.len());
    // Number of offsets that share the work of a latitude's exit positions, limited to 32 MiB of arrivals.
    let chunk = ((8 << 20) / (yarn.fine.state_len() * yarn.fine.offsets)).clamp(1, columns);
    let jobs: Vec<(usize, Vec<usize>)> = (0..rows)
        .flat_map(|m| (0..columns).collect::<Vec<_>>().chunks(chunk).map(|n| (m, n.to_vec())).collect::<Vec<_>>())
        .collect();
    let done = AtomicUsize::new(0);
    let slices: Vec<Vec<Node>> = jobs
        .par_iter()
        .map(|(m, nodes)| {
            let out = yarn.nodes(*m, nodes);
            progress(done.fetch_add(nodes.len(), Ordering::Relaxed) + nodes.len(), rows * columns);
            out
        })
        .collect();
    let (mut out, ledger) = assemble(table, ring.plies, slices.into_iter().flatten());
    out.energies = fine_energies(table, &out, spec);
    Ok((out, ledger))
}

/// Energies of the yarn: missed light on the fine grid of the ply's, all others at the nodes of the yarn's
/// slices.
fn fine_energies(ply: &Table, yarn: &Table, spec: &YarnSpec) -> Option<TableEnergies> {
    let fine = ply.energies.as_ref()?;
    let intercepts = Intercept::fine(ply);
    if intercepts.is_empty() {
        return None;
    }
    let (ring, beam) = (spec.ply_ring(), spec.beam.beam());
    let row = |intercept: &Intercept| -> Vec<f64> {
        fine.miss_h_um.iter().map(|h| missed(&ring, &beam, intercept, *h).clamp(0.0, 1.0)).collect()
    };
    let miss: Vec<Vec<f64>> = intercepts.par_iter().map(row).collect();
    Some(TableEnergies {
        miss_theta_i: fine.miss_theta_i.clone(),
        miss_h_um: fine.miss_h_um.clone(),
        miss: miss.concat(),
        miss_se: fine.miss_se.clone(),
        met: Vec::new(),
        ..TableEnergies::of_nodes(yarn)
    })
}

/// Data shared by all incidences.
struct Yarn<'a> {
    table: &'a Table,
    spec: &'a YarnSpec,
    fine: Level,
    /// Intercepts of the incident light at each latitude of the table.
    intercepts: Vec<Intercept>,
    flights: Flights,
    escape: Vec<f32>,
    /// Kernel of the second scattering, and the orders beyond: for reflection-only light, then for all light
    /// at each sigma.
    kernels: Vec<(Kernel, Orders)>,
    /// Overlap of the table's bins with the fine level's.
    overlap: Overlap,
    exits: bool,
    tolerance: f64,
}

/// Results at one incidence.
struct Node {
    r_d: f64,
    refl: Vec<f32>,
    /// `[sigma][bin]`: density of f_high [1/sr].
    high: Vec<Vec<f32>>,
    /// Integral of the variance of f_refl, then of f_high at each sigma [1/sr]; the noise of light between
    /// plies averages out and is neglected.
    noise: Vec<f64>,
    /// `[sigma]`: direct, conv, residual, absorbed.
    ledger: Vec<[f64; 4]>,
    killed: f64,
    /// Standard error of the energy's sum from the slices that the beam hits.
    se: f64,
}

/// Direct light of one part of the table.
struct FirstExit {
    /// `[bin]`: density [1/sr] on the table's grid.
    direct: Vec<f64>,
    /// Noise of the direct light.
    noise: PartsNoise,
}

impl<'a> Yarn<'a> {
    fn new(table: &'a Table, spec: &'a YarnSpec, options: &YarnOptions) -> Yarn<'a> {
        let ring = spec.ply_ring();
        let coarse =
            Level::new(ring.plies, options.rows.div_ceil(2), options.cells.div_ceil(2), options.offsets * 3 / 4);
        let fine = Level {
            rows: 2 * coarse.rows,
            azimuths: 2 * coarse.azimuths,
            cells: 2 * coarse.cells,
            offsets: 2 * options.offsets.div_ceil(2),
        };
        let intercepts = Intercept::of_table(table, ring.radius_um);
        let mean = Intercept::mean(&intercepts, &table.theta_i);
        let positions = table.exit.as_ref().map_or(16, |e| e.positions);
        let flights = Flights::new(&ring, fine.azimuths, positions, fine.offsets, &mean);
        let escape = flights.of_cells().escape;
        let onward = Flights::new(&ring, coarse.azimuths, positions, coarse.offsets, &mean).of_cells();
        let onward = std::sync::Arc::new(onward);
        let lights = std::iter::once(Light::Reflected).chain((0..table.sigma_per_um.len()).map(Light::All));
        let kernels = lights
            .map(|light| {
                let orders =
                    Orders::new(Kernel::new(table, light, coarse, mean.reach_um), coarse, ring.plies, onward.clone());
                (Kernel::new(table, light, fine, mean.reach_um), orders)
            })
            .collect();
        let overlap = Overlap::new(table.grid, fine.rows, fine.azimuths, 0.0, false);
        let exits = options.exits && table.exit.is_some();
        let intercepts = Intercept::of_beams(table).unwrap_or(intercepts);
        Yarn { table, spec, fine, intercepts, flights, escape, kernels, overlap, exits, tolerance: options.tolerance }
    }

    /// Shares of the lateral positions at each azimuth bin, `[azimuth][position]`, of light `channel` (0
    /// reflected, 1 + k high) at node (m, n).
    fn exit_shares(&self, m: usize, n: usize, channel: usize) -> Vec<f32> {
        let (azimuths, positions) = (self.fine.azimuths, self.flights.positions);
        let Some(exit) = self.table.exit.as_ref().filter(|_| self.exits) else {
            return vec![1.0 / positions as f32; azimuths * positions];
        };
        let channels = 1 + self.table.sigma_per_um.len();
        let row = ((m * self.table.h_um.len() + n) * channels + channel) * exit.azimuths;
        let shares = &exit.shares[row * positions..(row + exit.azimuths) * positions];
        let mut out = Vec::with_capacity(azimuths * positions);
        for j in 0..azimuths {
            let at = ((j as f64 + 0.5) * exit.azimuths as f64 / azimuths as f64 - 0.5).rem_euclid(exit.azimuths as f64);
            let (a, b, t) = axis::cell_periodic(at, exit.azimuths);
            let t = t as f32;
            out.extend((0..positions).map(|i| {
                let (x, y) = (shares[a * positions + i], shares[b * positions + i]);
                x + t * (y - x)
            }));
        }
        out
    }

    /// Results at latitude `m` for the offsets `nodes`.
    fn nodes(&self, m: usize, nodes: &[usize]) -> Vec<Node> {
        let sigmas = self.table.sigma_per_um.len();
        let hits: Vec<_> = nodes
            .iter()
            .map(|&n| {
                let beam = self.spec.beam.beam();
                first_hits(self.table, &self.spec.ply_ring(), &beam, &self.intercepts[m], (m, n), self.fine.azimuths)
            })
            .collect();
        let size = self.fine.state_len() * self.fine.offsets;
        let mut reflected = vec![vec![0.0f32; size]; nodes.len()];
        let mut scratch = Scratch::default();
        let first_refl = self.first_exits(m, 0, &hits, &mut reflected);
        let chains: Vec<Chain> = reflected.iter().map(|a| self.chain(0, a, &mut scratch)).collect();
        let grid = self.table.grid;
        let integral = |f: &[f64]| {
            f.chunks_exact(grid.phi_o)
                .enumerate()
                .map(|(i, r)| grid.solid_angle(i) * r.iter().sum::<f64>())
                .sum::<f64>()
        };
        let columns = self.table.h_um.len();
        let mut out: Vec<Node> = (0..nodes.len())
            .map(|i| {
                let mut refl = first_refl[i].direct.clone();
                chains[i].add_density(None, grid, &mut refl);
                let over_hits = |values: &[f64]| -> f64 {
                    hits[i].parts.iter().map(|(n, w)| values[m * columns + n] * w.iter().sum::<f64>()).sum()
                };
                Node {
                    r_d: hits[i].r_d,
                    refl: refl.iter().map(|v| *v as f32).collect(),
                    high: Vec::with_capacity(sigmas),
                    noise: vec![first_refl[i].noise.integral],
                    ledger: Vec::with_capacity(sigmas),
                    killed: over_hits(&self.table.energy_killed),
                    se: over_hits(&self.table.energy_se),
                }
            })
            .collect();
        for k in 0..sigmas {
            let mut arrivals = reflected.clone();
            let first = self.first_exits(m, 1 + k, &hits, &mut arrivals);
            for (i, node) in out.iter_mut().enumerate() {
                let chain = self.chain(1 + k, &arrivals[i], &mut scratch);
                let direct = integral(&first[i].direct) + integral(&first_refl[i].direct);
                let stopped: f64 = arrivals[i].iter().map(|v| f64::from(*v)).sum();
                let absorbed = 1.0 - hits[i].r_d - direct - stopped + chain.absorbed;
                node.ledger.push([direct, chain.conv, chain.residual, absorbed]);
                let mut high = first[i].direct.clone();
                chain.add_density(Some(&chains[i]), grid, &mut high);
                node.high.push(high.iter().map(|v| *v as f32).collect());
                node.noise.push(first[i].noise.integral);
            }
        }
        out
    }

    /// Light `channel` of the plies that the beam hits, after its first flight: returns the light that
    /// escapes, and adds the light that arrives at other plies to `arrivals[node][cell][theta_o][h'][phi_o]`.
    fn first_exits(
        &self,
        m: usize,
        channel: usize,
        hits: &[beam::FirstHits],
        arrivals: &mut [Vec<f32>],
    ) -> Vec<FirstExit> {
        let Level { rows, azimuths, cells, offsets } = self.fine;
        let Flights { positions, others, .. } = self.flights;
        let (grid, plies) = (self.table.grid, others + 1);
        let width = others * offsets;
        let mut out: Vec<FirstExit> =
            hits.iter().map(|_| FirstExit { direct: vec![0.0; grid.len()], noise: PartsNoise::default() }).collect();
        let (mut shares_hit, mut shares_out) =
            (vec![0.0f32; azimuths * azimuths * width], vec![0.0f32; azimuths * azimuths]);
        let mut sent = vec![0.0f32; cells * offsets * azimuths];
        let mut energies = vec![0.0f32; rows * azimuths];
        let mut escape = vec![0.0f32; azimuths];
        let mut fine = vec![0.0f64; grid.phi_o];
        let columns = self.table.h_um.len();
        let correlated =
            noise::correlations(&self.table.h_um, self.spec.beam.beam().sd_um(), |x| self.intercepts[m].at(x));
        for source in 0..self.table.h_um.len() {
            if !hits.iter().any(|h| h.parts.iter().any(|p| p.0 == source)) {
                continue;
            }
            let node = m * self.table.h_um.len() + source;
            let (slice, noise) = match channel {
                0 => (self.table.refl_slice(m, source), self.table.noise_refl[node]),
                k => {
                    let at = node * self.table.sigma_per_um.len() + k - 1;
                    (self.table.high_slice(m, source, k - 1), self.table.noise_high[at])
                }
            };
            energies.fill(0.0);
            self.overlap.add(slice, 1.0, &mut energies);
            // Flights of this slice's light, `[phi_o][psi]`.
            let exit = self.exit_shares(m, source, channel);
            shares_hit.fill(0.0);
            for j in 0..azimuths {
                for psi in 0..azimuths {
                    let relative = (j + azimuths - psi) % azimuths;
                    let to = &mut shares_hit[(j * azimuths + psi) * width..][..width];
                    let mut escaped = 0.0;
                    for t in 0..positions {
                        let share = exit[j * positions + t];
                        let at = relative * positions + t;
                        escaped += share * self.flights.escape[at];
                        let from = &self.flights.hits[at * width..][..width];
                        to.iter_mut().zip(from).for_each(|(to, v)| *to += share * v);
                    }
                    shares_out[j * azimuths + psi] = escaped;
                }
            }
            for (i, hit) in hits.iter().enumerate() {
                let Some((_, weights)) = hit.parts.iter().find(|p| p.0 == source) else { continue };
                sent.fill(0.0);
                escape.fill(0.0);
                for (psi, weight) in weights.iter().enumerate().filter(|w| *w.1 > 0.0) {
                    let weight = *weight as f32;
                    for j in 0..azimuths {
                        escape[j] += weight * shares_out[j * azimuths + psi];
                        for p in 1..plies {
                            // Ply p of a yarn at psi lies at psi + 2 pi p / P.
                            let cell = (psi / geometry::BINS_A_CELL + cells * p / plies) % cells;
                            let from = &shares_hit[(j * azimuths + psi) * width + (p - 1) * offsets..][..offsets];
                            for (x, v) in from.iter().enumerate() {
                                sent[(cell * offsets + x) * azimuths + j] += weight * v;
                            }
                        }
                    }
                }
                let arrivals = &mut arrivals[i];
                for cell in 0..cells {
                    for r in 0..rows {
                        let energies = &energies[r * azimuths..(r + 1) * azimuths];
                        let to = &mut arrivals[(cell * rows + r) * offsets * azimuths..][..offsets * azimuths];
                        let sent = &sent[cell * offsets * azimuths..][..offsets * azimuths];
                        for (to, sent) in to.chunks_exact_mut(azimuths).zip(sent.chunks_exact(azimuths)) {
                            for ((to, s), e) in to.iter_mut().zip(sent).zip(energies) {
                                *to += s * e;
                            }
                        }
                    }
                }
                self.overlap.refine(&escape, &mut fine);
                let (mut variance, mut energy) = (Vec::with_capacity(grid.len()), 0.0);
                for r in 0..grid.theta_o {
                    let from = &slice[r * grid.phi_o..(r + 1) * grid.phi_o];
                    let to = &mut out[i].direct[r * grid.phi_o..(r + 1) * grid.phi_o];
                    let solid_angle = grid.solid_angle(r);
                    for ((to, v), e) in to.iter_mut().zip(from).zip(&fine) {
                        let v = f64::from(*v);
                        *to += v * e;
                        variance.push((v * e * e * solid_angle) as f32);
                        energy += v * solid_angle;
                    }
                }
                // The variance of a bin is proportional to its density.
                let scale = if energy > 0.0 { noise / energy } else { 0.0 };
                out[i].noise.add(source, variance, scale, |from| correlated[from * columns + source]);
            }
        }
        out
    }

    /// All orders of scattering of the arriving light of kernel `light`.
    fn chain(&self, light: usize, arrivals: &[f32], scratch: &mut Scratch) -> Chain {
        let (kernel, orders) = &self.kernels[light];
        let mut state = vec![0.0f32; self.fine.state_len()];
        let mut chain = Chain::new(self.fine);
        if arrivals.iter().any(|v| *v != 0.0) {
            kernel.scatter(arrivals, &mut state, scratch);
        }
        let sum = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>();
        chain.absorbed = sum(arrivals) - sum(&state);
        chain.escape(self.fine, &mut state, &self.escape);
        orders.run(&mut chain, self.fine, &state, self.tolerance, scratch);
        chain
    }
}

/// Assembles the yarn's table from its nodes in order; everything else is copied from the ply's table.
fn assemble(table: &Table, plies: u32, nodes: impl Iterator<Item = Node>) -> (Table, YarnLedger) {
    let sigmas = table.sigma_per_um.len();
    let grid: OutgoingGrid = table.grid;
    let energy = |f: &[f32]| -> f64 {
        let row = |r: &[f32]| r.iter().map(|v| f64::from(*v)).sum::<f64>();
        f.chunks_exact(grid.phi_o).enumerate().map(|(i, r)| grid.solid_angle(i) * row(r)).sum()
    };
    let mut out = Table { plies, energies: None, refl: Vec::new(), high: Vec::new(), ..table.clone() };
    let mut ledger = YarnLedger::default();
    let mean_se = (table.energy_se.iter().map(|s| s * s).sum::<f64>() / table.energy_se.len().max(1) as f64).sqrt();
    for (i, node) in nodes.enumerate() {
        out.r_d[i] = node.r_d;
        out.energy_refl[i] = energy(&node.refl);
        out.energy_killed[i] = node.killed;
        // Each later scattering adds the table's error again: once in conv, about three times in the
        // residual.
        out.energy_se[i] = (node.se + (node.ledger[0][1] + 3.0 * node.ledger[0][2]) * mean_se).min(1.0);
        out.noise_refl[i] = node.noise[0];
        out.refl.extend(node.refl);
        ledger.r_d.push(node.r_d);
        for (k, high) in node.high.into_iter().enumerate() {
            out.energy_high[i * sigmas + k] = energy(&high);
            out.noise_high[i * sigmas + k] = node.noise[1 + k];
            out.high.extend(high);
            let [direct, conv, residual, absorbed] = node.ledger[k];
            ledger.direct.push(direct);
            ledger.conv.push(conv);
            ledger.residual.push(residual);
            ledger.absorbed.push(absorbed);
        }
    }
    (out, ledger)
}

impl Chain {
    /// Adds the density of conv and residual, minus that of the chain `less`, to `out[bin]`.
    fn add_density(&self, less: Option<&Chain>, grid: OutgoingGrid, out: &mut [f64]) {
        let mut part = vec![0.0; grid.len()];
        for (map, less, level) in
            [(&self.first, less.map(|l| &l.first), self.fine), (&self.later, less.map(|l| &l.later), self.coarse)]
        {
            let map: Vec<f64> = match less {
                Some(less) => map.iter().zip(less).map(|(a, b)| (a - b).max(0.0)).collect(),
                None => map.clone(),
            };
            density(grid, level.0, level.1, &map, &mut part);
            out.iter_mut().zip(&part).for_each(|(o, p)| *o += p);
        }
    }
}
