//! What the beam hits first: ply 0, or another ply that stands in front of it or beside it (Yu 2025, 5.3, last paragraphs).
//!
//! The beam's lateral profile is cut into thin lines. The plies are visited in the order of their height, and each stops the share of a line that hits
//! a fiber. Ply 0 then scatters its own slice of the table, f(theta_i, h), times the unblocked share u of what it intercepts. The rest of the
//! beam, 1 - u (1 - r_d), is divided between the other plies and the light that misses the yarn in the proportions of the lines.

use super::geometry::Intercept;
use plywave::math::axis;
use plywave::spec::{GaussianBeam, PlyRing};
use plywave::table::Table;
use std::f64::consts::TAU;

/// Samples of psi in a bin.
const SUB: usize = 8;
/// Lines of a beam, and the standard deviations that they cover to each side.
const LINES: usize = 96;
const SDS: f64 = 5.0;
/// Orientations over which the missed light alone is averaged.
const ORIENTATIONS: usize = 240;

/// Where a beam's power goes, averaged over the valid orientations of the yarn.
pub(crate) struct FirstHits {
    /// `(n', [psi])`: factors of the table's slice at offset n', scattered by a ply that lies at psi (bins of a turn).
    pub parts: Vec<(usize, Vec<f64>)>,
    /// Fraction that misses the yarn.
    pub r_d: f64,
}

/// Of the beam at node `(m, n)`, with `bins` of psi.
pub(crate) fn first_hits(
    table: &Table,
    ring: &PlyRing,
    beam: &GaussianBeam,
    intercept: &Intercept,
    (m, n): (usize, usize),
    bins: usize,
) -> FirstHits {
    let (columns, h) = (table.h_um.len(), table.h_um[n]);
    let r_d = &table.r_d[m * columns..(m + 1) * columns];
    let plies = ring.plies as usize;
    let lines = lines(beam, h);
    let own: f64 = lines.iter().map(|(x, w)| w * intercept.at(*x)).sum();
    let mut parts = vec![vec![0.0; bins]; columns];
    let (mut valid, mut missed) = (0usize, 0.0);
    let mut order: Vec<usize> = (0..plies).collect();
    let mut caught = vec![0.0; columns];
    for i in 0..bins * SUB {
        let psi = TAU * (i as f64 + 0.5) / (bins * SUB) as f64;
        if !ring.is_valid(psi, h) {
            continue;
        }
        valid += 1;
        let centers: Vec<[f64; 2]> = (0..ring.plies).map(|p| ring.center(p, psi)).collect();
        order.sort_by(|&p, &q| centers[q][1].total_cmp(&centers[p][1]));
        let (mut primary, mut miss) = (0.0, 0.0);
        // Energies that other plies catch, before their common factor.
        let mut others = vec![None; plies];
        for &(x, weight) in &lines {
            let mut remaining = weight;
            for &p in &order {
                let offset = x - centers[p][0];
                let stopped = remaining * intercept.at(offset);
                if stopped <= 0.0 {
                    continue;
                }
                remaining -= stopped;
                if p == 0 {
                    primary += stopped;
                    continue;
                }
                let caught = others[p].get_or_insert_with(|| vec![0.0; columns]);
                for (node, share) in at_nodes(table, r_d, offset) {
                    caught[node] += stopped * share;
                }
            }
            miss += remaining;
        }
        let unblocked = if own > 1e-9 { (primary / own).min(1.0) } else { 1.0 };
        let rest = 1.0 - unblocked * (1.0 - r_d[n]);
        let elsewhere = 1.0 - primary;
        parts[n][i / SUB] += unblocked;
        if elsewhere < 1e-9 {
            missed += rest;
            continue;
        }
        missed += rest * miss / elsewhere;
        for (p, other) in others.iter().enumerate() {
            let Some(other) = other else { continue };
            // Ply p lies at psi + 2 pi p / P.
            let bin = (i / SUB + bins * p / plies) % bins;
            caught.copy_from_slice(other);
            for (part, energy) in parts.iter_mut().zip(&caught) {
                part[bin] += energy * rest / elsewhere;
            }
        }
    }
    let scale = 1.0 / valid.max(1) as f64;
    let parts = parts
        .into_iter()
        .enumerate()
        .filter(|(_, part)| part.iter().any(|w| *w > 0.0))
        .map(|(node, part)| (node, part.into_iter().map(|w| w * scale).collect()))
        .collect();
    FirstHits { parts, r_d: missed * scale }
}

/// Share of the beam at offset `h` that misses the whole yarn, averaged over its valid orientations: what every line of it has left behind all plies.
pub(crate) fn missed(ring: &PlyRing, beam: &GaussianBeam, intercept: &Intercept, h: f64) -> f64 {
    let lines = lines(beam, h);
    let (mut valid, mut missed) = (0usize, 0.0);
    for i in 0..ORIENTATIONS {
        let psi = TAU * (i as f64 + 0.5) / ORIENTATIONS as f64;
        if !ring.is_valid(psi, h) {
            continue;
        }
        valid += 1;
        let centers: Vec<f64> = (0..ring.plies).map(|p| ring.center(p, psi)[0]).collect();
        missed += lines
            .iter()
            .map(|(x, w)| w * centers.iter().map(|c| 1.0 - intercept.at(x - c)).product::<f64>())
            .sum::<f64>();
    }
    missed / valid.max(1) as f64
}

/// Lateral positions of a beam's lines and their shares of its power.
fn lines(beam: &GaussianBeam, h: f64) -> Vec<(f64, f64)> {
    let sd = beam.sd_um();
    let t = |i: usize| SDS * ((2 * i + 1) as f64 / LINES as f64 - 1.0);
    let total: f64 = (0..LINES).map(|i| (-0.5 * t(i) * t(i)).exp()).sum();
    (0..LINES).map(|i| (h + sd * t(i), (-0.5 * t(i) * t(i)).exp() / total)).collect()
}

/// Nodes around an offset, with factors of the table's slices there that make a unit of scattered and absorbed energy.
fn at_nodes(table: &Table, r_d: &[f64], h: f64) -> [(usize, f64); 2] {
    let last = table.h_um.len() - 1;
    let step = (table.h_um[last] - table.h_um[0]) / last as f64;
    let (n, t) = axis::cell((h - table.h_um[0]) / step, last + 1);
    let unit = ((1.0 - t) * (1.0 - r_d[n]) + t * (1.0 - r_d[n + 1])).max(1e-6);
    [(n, (1.0 - t) / unit), (n + 1, t / unit)]
}
