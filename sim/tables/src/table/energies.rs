//! Energies of a table on separate grids, finer than those of its slices.
//!
//! The beam's profile g has a standard deviation of a few um, which is also the width of the ply's edge in
//! `r_d(h)`, while the slices are nodes for lobes that change slowly. Energies are single numbers: one pass
//! of rays gives the probability m(x) that the line at lateral position x hits a fiber, and thus
//! `r_d(h) = 1 - integral of m(x) g(x - h) dx` at every h. The scattering of the light that hits fibers is
//! also tallied by lateral position. See `docs/explain/papers/yu_2025.md`, departure 19.

use super::Table;
use plywave::Result;
use plywave::io::{Check, Reader, Writer, invalid};
use plywave::ply::ENERGY_TOLERANCE as TOLERANCE;

/// Missed light and the shares of scattered light, over grids that contain the nodes of the slices. Arrays
/// are flat, last index fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct TableEnergies {
    /// `[A]` latitudes of `miss` [rad], uniform from 0 to the table's last.
    pub miss_theta_i: Vec<f64>,
    /// `[B]` offsets of `miss` [um], uniform over the table's range.
    pub miss_h_um: Vec<f64>,
    /// `[A][B]`: fraction of the beam that hits no fiber.
    pub miss: Vec<f64>,
    /// `[A][B]`: standard error of `miss` over the instances.
    pub miss_se: Vec<f64>,
    /// `[A][X]`: fraction of the lines at lateral position x that hit a fiber; x in X equal parts of [-h, h],
    /// h the last offset. It is empty except for a single ply.
    pub met: Vec<f32>,
    /// `[P]` latitudes of the shares [rad], uniform from 0 to the table's last.
    pub share_theta_i: Vec<f64>,
    /// `[Q]` offsets of the shares [um], uniform over the table's range.
    pub share_h_um: Vec<f64>,
    /// `[P][Q]`: share of the light that hits fibers that is only reflected.
    pub share_refl: Vec<f64>,
    /// `[P][Q][K]`: share of the light that hits fibers that is scattered otherwise.
    pub share_high: Vec<f64>,
    /// `[P][Q][1 + K]`: standard errors of the shares; above sigma = 0 an upper bound.
    pub share_se: Vec<f64>,
}

/// Energies at an incidence.
#[derive(Clone, Debug, PartialEq)]
pub struct TableEnergiesAt {
    /// Fraction of the beam that hits no fiber.
    pub r_d: f64,
    /// Energy of the light that was only reflected.
    pub refl: f64,
    /// `[K]`: energy of all other scattered light.
    pub high: Vec<f64>,
}

/// Number of parts of a step between nodes for interpolated energies.
const PARTS: usize = 4;

/// An axis with each step divided into [`PARTS`].
fn refined(axis: &[f64]) -> Vec<f64> {
    let at = |i: usize, part: usize| axis[i] + (axis[i + 1] - axis[i]) * part as f64 / PARTS as f64;
    let inner = (0..axis.len() - 1).flat_map(|i| (0..PARTS).map(move |part| at(i, part)));
    inner.chain(axis.last().copied()).collect()
}

/// Names of the tensors in a file.
pub(super) const NAMES: [&str; 10] = [
    "miss_theta_i",
    "miss_h_um",
    "miss",
    "miss_se",
    "miss_met",
    "share_theta_i",
    "share_h_um",
    "share_refl",
    "share_high",
    "share_se",
];

impl TableEnergies {
    /// Energies of a table that has only those of its slices: a yarn computed from a ply's table, or plies
    /// traced together. At offsets without hits, the shares are those of the nearest offset with hits.
    pub fn of_nodes(table: &Table) -> TableEnergies {
        let (rows, columns, k) = (table.theta_i.len(), table.h_um.len(), table.sigma_per_um.len());
        let hit = |i: usize| 1.0 - table.r_d[i];
        let (mut refl, mut high) = (Vec::new(), Vec::new());
        for i in 0..rows * columns {
            let row = i / columns * columns..(i / columns + 1) * columns;
            let from = row.filter(|j| hit(*j) > 1e-9).min_by_key(|j| j.abs_diff(i));
            let share = |e: f64| from.map_or(0.0, |j| e / hit(j));
            refl.push(share(from.map_or(0.0, |j| table.energy_refl[j])));
            high.extend((0..k).map(|s| share(from.map_or(0.0, |j| table.energy_high[j * k + s]))));
        }
        // Interpolation between the nodes is bilinear, since a spline through them would be negative near the
        // rim.
        let (theta_i, h_um) = (refined(&table.theta_i), refined(&table.h_um));
        let (fine_rows, fine_columns) = (theta_i.len(), h_um.len());
        let fill = |values: &[f64], stride: usize| -> Vec<f64> {
            let node = |m: usize, n: usize, s: usize| values[(m * columns + n) * stride + s];
            let mut out = Vec::with_capacity(fine_rows * fine_columns * stride);
            for m in 0..fine_rows {
                for n in 0..fine_columns {
                    let (m0, n0) = ((m / PARTS).min(rows - 2), (n / PARTS).min(columns - 2));
                    let (a, b) = ((m - m0 * PARTS) as f64 / PARTS as f64, (n - n0 * PARTS) as f64 / PARTS as f64);
                    out.extend((0..stride).map(|s| {
                        let row = |m: usize| (1.0 - b) * node(m, n0, s) + b * node(m, n0 + 1, s);
                        (1.0 - a) * row(m0) + a * row(m0 + 1)
                    }));
                }
            }
            out
        };
        let nodes = fine_rows * fine_columns;
        TableEnergies {
            miss_theta_i: theta_i.clone(),
            miss_h_um: h_um.clone(),
            miss: fill(&table.r_d, 1),
            miss_se: vec![0.0; nodes],
            met: Vec::new(),
            share_theta_i: theta_i,
            share_h_um: h_um,
            share_refl: fill(&refl, 1),
            share_high: fill(&high, k),
            share_se: vec![0.0; nodes * (1 + k)],
        }
    }

    /// Energies at the nodes (theta_i, h) of the slices, which the grids contain.
    pub fn at_node(&self, theta_i: f64, h_um: f64) -> TableEnergiesAt {
        let nearest = |axis: &[f64], x: f64| {
            let last = axis.len() - 1;
            let t = (x - axis[0]) / (axis[last] - axis[0]) * last as f64;
            (t.round().max(0.0) as usize).min(last)
        };
        let i = nearest(&self.miss_theta_i, theta_i) * self.miss_h_um.len() + nearest(&self.miss_h_um, h_um);
        let j = nearest(&self.share_theta_i, theta_i) * self.share_h_um.len() + nearest(&self.share_h_um, h_um);
        let (r_d, k) = (self.miss[i], self.share_high.len() / self.share_refl.len());
        TableEnergiesAt {
            r_d,
            refl: (1.0 - r_d) * self.share_refl[j],
            high: self.share_high[j * k..(j + 1) * k].iter().map(|e| (1.0 - r_d) * e).collect(),
        }
    }

    pub(super) fn write(&self, w: &mut Writer) {
        let (a, b) = (self.miss_theta_i.len(), self.miss_h_um.len());
        let (p, q) = (self.share_theta_i.len(), self.share_h_um.len());
        let k = self.share_high.len() / (p * q).max(1);
        w.f64("miss_theta_i", &[a], &self.miss_theta_i);
        w.f64("miss_h_um", &[b], &self.miss_h_um);
        w.f64("miss", &[a, b], &self.miss);
        w.f64("miss_se", &[a, b], &self.miss_se);
        w.f32("miss_met", &[a, self.met.len() / a.max(1)], self.met.iter().copied());
        w.f64("share_theta_i", &[p], &self.share_theta_i);
        w.f64("share_h_um", &[q], &self.share_h_um);
        w.f64("share_refl", &[p, q], &self.share_refl);
        w.f64("share_high", &[p, q, k], &self.share_high);
        w.f64("share_se", &[p, q, 1 + k], &self.share_se);
    }

    pub(super) fn read(r: &Reader<'_>, k: usize) -> Result<Option<TableEnergies>> {
        if !NAMES.iter().any(|name| r.has(name)) {
            return Ok(None);
        }
        let size = |name: &str| r.shape(name, 1).map(|shape| shape[0]);
        let (a, b) = (size("miss_theta_i")?, size("miss_h_um")?);
        let (p, q) = (size("share_theta_i")?, size("share_h_um")?);
        let positions = r.shape("miss_met", 2)?[1];
        Ok(Some(TableEnergies {
            miss_theta_i: r.f64("miss_theta_i", &[a])?,
            miss_h_um: r.f64("miss_h_um", &[b])?,
            miss: r.f64("miss", &[a, b])?,
            miss_se: r.f64("miss_se", &[a, b])?,
            met: r.f32("miss_met", &[a, positions])?,
            share_theta_i: r.f64("share_theta_i", &[p])?,
            share_h_um: r.f64("share_h_um", &[q])?,
            share_refl: r.f64("share_refl", &[p, q])?,
            share_high: r.f64("share_high", &[p, q, k])?,
            share_se: r.f64("share_se", &[p, q, 1 + k])?,
        }))
    }

    /// Checks the energies of a table with these nodes.
    pub(super) fn check(&self, c: &Check<'_>, theta_i: &[f64], h_um: &[f64], k: usize) -> Result<()> {
        for (name, axis, nodes) in [
            ("miss_theta_i", &self.miss_theta_i, theta_i),
            ("miss_h_um", &self.miss_h_um, h_um),
            ("share_theta_i", &self.share_theta_i, theta_i),
            ("share_h_um", &self.share_h_um, h_um),
        ] {
            if axis.is_empty() {
                return Err(invalid(c.0, name, "0 values", "expected 2 or more"));
            }
            c.uniform(name, axis)?;
            // Every node of the slices must be a node of the grid.
            let (cells, steps) = (axis.len().max(1) - 1, nodes.len() - 1);
            let ends = |a: f64, b: f64| (a - b).abs() <= 1e-6 * nodes[steps].abs();
            if steps == 0
                || cells == 0
                || cells % steps != 0
                || !ends(axis[0], nodes[0])
                || !ends(axis[cells], nodes[steps])
            {
                let hint = format!("expected a grid that holds the {} nodes of the slices", nodes.len());
                return Err(invalid(c.0, name, format!("{} values", axis.len()), &hint));
            }
        }
        let (a, b) = (self.miss_theta_i.len(), self.miss_h_um.len());
        let (p, q) = (self.share_theta_i.len(), self.share_h_um.len());
        for (key, values, shape, max) in [
            ("miss", &self.miss, &[a, b][..], 1.0),
            ("miss_se", &self.miss_se, &[a, b], f64::MAX),
            ("share_refl", &self.share_refl, &[p, q], 1.0 + TOLERANCE),
            ("share_high", &self.share_high, &[p, q, k], 1.0 + TOLERANCE),
            ("share_se", &self.share_se, &[p, q, 1 + k], f64::MAX),
        ] {
            c.len(key, values.len(), shape)?;
            c.range(key, values, 0.0, max)?;
        }
        c.len("miss_met", self.met.len(), &[a, self.met.len() / a])?;
        c.range_f32("miss_met", &self.met, 0.0, 1.0)?;
        for (i, (refl, high)) in self.share_refl.iter().zip(self.share_high.chunks_exact(k)).enumerate() {
            if refl + high[0] > 1.0 + TOLERANCE {
                let key = format!("share_refl + share_high at node {i}");
                return Err(invalid(c.0, &key, refl + high[0], &format!("expected at most {}", 1.0 + TOLERANCE)));
            }
        }
        Ok(())
    }
}
