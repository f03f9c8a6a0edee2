//! First hits of the beam: ply 0, or another ply in front of it or beside it (Yu 2025, 5.3, last paragraphs).
//!
//! The beam's lateral profile is divided into thin lines. The plies are visited in the order of their height,
//! and each stops the share of a line that hits a fiber. Ply 0 then scatters its own slice of the table,
//! f(theta_i, h), scaled to the energy that it stops; any other ply scatters the slices at the offsets of the
//! lines that it stops. Light that no ply stops misses the yarn. The energies therefore follow from the lines
//! alone and do not depend on the slices' Monte Carlo errors near the rim.

use super::geometry::Intercept;
use plywave::math::axis;
use plywave::spec::{GaussianBeam, PlyRing};
use plywave_tables::table::Table;
use std::f64::consts::TAU;

/// Number of samples of psi in the overlap of a bin and a valid range.
const SUB: usize = 8;
/// Number of lines of a beam, and of standard deviations that they cover to each side.
const LINES: usize = 96;
const SDS: f64 = 5.0;
/// Minimum share of a beam that hits, used as the divisor of its slice's factors.
const MIN_HIT: f64 = 1e-6;
/// Number of bins of psi over which the missed light alone is averaged.
const BINS: usize = 36;

/// Distribution of a beam's power, averaged over the valid orientations of the yarn.
pub(crate) struct FirstHits {
    /// `(n', [psi])`: factors of the table's slice at offset n' that a ply at psi (bins of a turn) scatters.
    pub parts: Vec<(usize, Vec<f64>)>,
    /// Fraction that misses the yarn.
    pub r_d: f64,
}

/// First hits of the beam at node `(m, n)`, with `bins` of psi.
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
    let own = |primary: f64| primary / (1.0 - r_d[n]).max(MIN_HIT);
    let mut parts = vec![vec![0.0; bins]; columns];
    let (orientations, mut missed) = (orientations(ring, h, bins), 0.0);
    let mut order: Vec<usize> = (0..plies).collect();
    for (psi, share) in orientations {
        let own_bin = ((psi / TAU * bins as f64) as usize).min(bins - 1);
        let centers: Vec<[f64; 2]> = (0..ring.plies).map(|p| ring.center(p, psi)).collect();
        order.sort_by(|&p, &q| centers[q][1].total_cmp(&centers[p][1]));
        let mut primary = 0.0;
        for &(x, weight) in &lines {
            let mut remaining = share * weight;
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
                // Ply p lies at psi + 2 pi p / P.
                let bin = (own_bin + bins * p / plies) % bins;
                for (node, factor) in at_nodes(table, r_d, offset) {
                    parts[node][bin] += stopped * factor;
                }
            }
            missed += remaining;
        }
        parts[n][own_bin] += own(primary);
    }
    let parts = parts.into_iter().enumerate().filter(|(_, part)| part.iter().any(|w| *w > 0.0)).collect();
    FirstHits { parts, r_d: missed }
}

/// Valid orientations psi of the yarn for a beam at `h`, and their shares. They are the middles of equal
/// parts of the overlap of each bin with each valid range, which resolves the sharp ends of the ranges.
fn orientations(ring: &PlyRing, h: f64, bins: usize) -> Vec<(f64, f64)> {
    let ranges = ring.valid_ranges(h);
    let per_turn = 1.0 / ranges.iter().map(|(a, b)| b - a).sum::<f64>().max(f64::MIN_POSITIVE);
    let bin = |i: usize| (TAU * i as f64 / bins as f64, TAU * (i + 1) as f64 / bins as f64);
    let within = |(a, b): (f64, f64), (c, d): (f64, f64)| (a.max(c), b.min(d));
    let pieces = ranges.iter().flat_map(|range| (0..bins).map(|i| within(*range, bin(i)))).filter(|(a, b)| a < b);
    pieces
        .flat_map(|(a, b)| {
            let step = (b - a) / SUB as f64;
            (0..SUB).map(move |i| (a + step * (i as f64 + 0.5), step * per_turn))
        })
        .collect()
}

/// Share of the beam at offset `h` that misses the whole yarn, averaged over its valid orientations: the
/// remaining share of its lines behind all plies.
pub(crate) fn missed(ring: &PlyRing, beam: &GaussianBeam, intercept: &Intercept, h: f64) -> f64 {
    let lines = lines(beam, h);
    let missed = |(psi, share): (f64, f64)| -> f64 {
        let centers: Vec<f64> = (0..ring.plies).map(|p| ring.center(p, psi)[0]).collect();
        let passes = |x: f64| centers.iter().map(|c| 1.0 - intercept.at(x - c)).product::<f64>();
        share * lines.iter().map(|(x, w)| w * passes(*x)).sum::<f64>()
    };
    orientations(ring, h, BINS).into_iter().map(missed).sum()
}

/// Lateral positions of a beam's lines and their shares of its power.
fn lines(beam: &GaussianBeam, h: f64) -> Vec<(f64, f64)> {
    let sd = beam.sd_um();
    let t = |i: usize| SDS * ((2 * i + 1) as f64 / LINES as f64 - 1.0);
    let total: f64 = (0..LINES).map(|i| (-0.5 * t(i) * t(i)).exp()).sum();
    (0..LINES).map(|i| (h + sd * t(i), (-0.5 * t(i) * t(i)).exp() / total)).collect()
}

/// Nodes around an offset, with factors that normalize the table's slices there to a unit of scattered and
/// absorbed energy.
fn at_nodes(table: &Table, r_d: &[f64], h: f64) -> [(usize, f64); 2] {
    let last = table.h_um.len() - 1;
    let step = (table.h_um[last] - table.h_um[0]) / last as f64;
    let (n, t) = axis::cell((h - table.h_um[0]) / step, last + 1);
    let unit = ((1.0 - t) * (1.0 - r_d[n]) + t * (1.0 - r_d[n + 1])).max(MIN_HIT);
    [(n, (1.0 - t) / unit), (n + 1, t / unit)]
}
