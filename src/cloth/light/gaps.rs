//! The gaps of a cloth: the aperture that a line passes if it hits no ply.
//!
//! Each ply that the line passes within the beam's reach is a straight edge, perpendicular to the in-plane
//! direction `n` in which the line reaches the ply soonest. Its distance is `d = (|h| - R) / |c|`, where c is
//! the in-plane part of the x axis of the ply's frame, along which h changes as the line moves. The aperture
//! is a rectangle, aligned with the weighted mean direction of its edges; angles are multiplied by four so
//! that perpendicular edges agree, and nearer edges weigh more. Its extent along an axis e is the smallest
//! `d / (n . e)` of all edges that face e. Light through the rectangle is diffracted as in Yu 2025, 6.1
//! (`gap.rs`).

use crate::Result;
use crate::cloth::geometry::grid::Grid;
use crate::cloth::geometry::lines::{ClothLines, LineHit, visit};
use crate::cloth::geometry::plies::{MARGIN_UM, frame};
use crate::cloth::{ClothCurves, Lattice};
use crate::gap::{Apertures, GapAt, Opening};
use crate::spec::GaussianBeam;
use std::f32::consts::FRAC_PI_2;

/// Smallest cosine between an edge's normal and an axis at which the edge bounds the aperture along that
/// axis, and the range of cosines over which it comes into full effect.
const FACES: f32 = 0.5;
const FACES_IN_FULL: f32 = 0.2;
/// Largest number of edges of an aperture.
const MAX_EDGES: usize = 16;

/// The plies near lines, and the spectra of the apertures between them.
#[derive(Clone, Debug)]
pub(crate) struct ClothGaps {
    grid: Grid,
    apertures: Apertures,
}

/// An edge of a gap: in-plane direction towards the ply, distance of the ply [um], and weight in the mean
/// direction of the aperture.
#[derive(Clone, Copy, Default)]
struct Edge {
    n: [f32; 2],
    away_um: f32,
    weight: f32,
}

impl ClothGaps {
    /// Builds the grid and the spectra for a cloth's curves in a beam.
    ///
    /// # Errors
    /// As [`ClothLines::new`].
    pub fn new(curves: &ClothCurves, lattice: &Lattice, beam: &GaussianBeam) -> Result<ClothGaps> {
        let apertures = Apertures::new(beam);
        let grid = Grid::new(curves, lattice, f64::from(apertures.reach_um()))?;
        Ok(ClothGaps { grid, apertures })
    }

    /// The spectra of apertures.
    pub fn apertures(&self) -> &Apertures {
        &self.apertures
    }

    /// The grid of plies, widened by the reach of the beam.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    pub fn memory_bytes(&self) -> usize {
        self.grid.memory_bytes() + self.apertures.memory_bytes()
    }

    /// Light through the gap that a line towards the viewer `wo` passes at a point of the middle plane [um];
    /// `None` if no light passes.
    #[inline(never)]
    pub fn at<const N: usize>(
        &self,
        lines: &ClothLines,
        at_um: [f32; 2],
        wo: [f32; 3],
        lambda_um: [f32; N],
    ) -> Option<(Opening, GapAt<'_, N>)> {
        let (mut edges, mut count) = ([Edge::default(); MAX_EDGES], 0);
        self.edges(lines, at_um, wo, |edge| {
            if count < MAX_EDGES {
                edges[count] = edge;
                count += 1;
            }
        });
        let (sides, turn) = rectangle(&edges[..count], self.apertures.reach_um());
        self.apertures.at(sides, turn, wo, lambda_um)
    }

    /// Calls `each` for the edges near the line.
    fn edges(&self, lines: &ClothLines, at_um: [f32; 2], wo: [f32; 3], mut each: impl FnMut(Edge)) {
        let reach = self.apertures.reach_um();
        let distance = (self.grid.half_thickness_um + MARGIN_UM) / wo[2].abs().max(1e-4);
        let from = [at_um[0] + distance * wo[0], at_um[1] + distance * wo[1], distance * wo[2]];
        let d = wo.map(|v| -v);
        visit(lines, (&self.grid, reach), from, d, |hit: LineHit| {
            let x = frame(&hit, d)[0];
            let per_um = x[0].hypot(x[1]).max(1e-3);
            let clearance = hit.h_um.abs() - hit.radius_um;
            // The edge lies in the direction that decreases |h|.
            let sign = -1f32.copysign(hit.h_um) / per_um;
            let nearness = (1.0 - clearance / reach).clamp(0.0, 1.0);
            each(Edge {
                n: [sign * x[0], sign * x[1]],
                away_um: clearance.max(0.0) / per_um,
                weight: nearness * nearness,
            });
            1.0
        });
    }
}

/// Fits a rectangle to edges. Returns its extents before and beyond the line along its first axis and along
/// its second [um], and the cosine and sine of the angle from x to the first axis, in [0, pi/2).
fn rectangle(edges: &[Edge], reach_um: f32) -> ([f32; 4], [f32; 2]) {
    let mut sum = [0.0f32; 2];
    for edge in edges {
        let [x, y] = edge.n;
        // Double the angle, then double it again.
        let [c, s] = [x * x - y * y, 2.0 * x * y];
        sum[0] += edge.weight * (c * c - s * s);
        sum[1] += edge.weight * 2.0 * c * s;
    }
    let angle = (0.25 * sum[1].atan2(sum[0])).rem_euclid(FRAC_PI_2);
    let (s, c) = angle.sin_cos();
    let axes = [[-c, -s], [c, s], [s, -c], [-s, c]];
    let sides = axes.map(|e| {
        edges.iter().fold(reach_um, |side, edge| {
            let facing = edge.n[0] * e[0] + edge.n[1] * e[1];
            let share = ((facing - FACES) / FACES_IN_FULL).clamp(0.0, 1.0);
            if share > 0.0 { side.min(edge.away_um / (facing * share)) } else { side }
        })
    });
    (sides, [c, s])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloth::{ClothYarn, LineHits, PlyCurve};
    use crate::math::hash::SplitMix64;

    fn edge(degrees: f32, away_um: f32) -> Edge {
        let (s, c) = degrees.to_radians().sin_cos();
        Edge { n: [c, s], away_um, weight: 1.0 }
    }

    /// A rotated rectangle is recovered, in any order of its edges.
    #[test]
    fn a_rectangle_is_found_however_it_is_turned() {
        for turn in [0.0f32, 20.0, 44.0, 46.0, 75.0, 89.0, 100.0, 170.0] {
            let mut edges = [edge(turn, 3.0), edge(turn + 90.0, 5.0), edge(turn + 180.0, 7.0), edge(turn + 270.0, 9.0)];
            for _ in 0..4 {
                edges.rotate_left(1);
                let (sides, [c, s]) = rectangle(&edges, 20.0);
                assert!(c >= 0.0 && s >= 0.0, "{turn}: {c} {s}");
                for (i, e) in [[-c, -s], [c, s], [s, -c], [-s, c]].into_iter().enumerate() {
                    let angle = e[1].atan2(e[0]).to_degrees();
                    let nth = ((angle - turn).rem_euclid(360.0) / 90.0).round() as usize % 4;
                    let want = [3.0, 5.0, 7.0, 9.0][nth];
                    assert!((sides[i] - want).abs() < 1e-3, "{turn}: {sides:?}, {angle} is {want}");
                }
            }
        }
        assert_eq!(rectangle(&[], 20.0), ([20.0; 4], [1.0, 0.0]));
        // With one edge the other sides are open.
        let (sides, _) = rectangle(&[edge(30.0, 4.0)], 20.0);
        let mut sorted = sides;
        sorted.sort_by(f32::total_cmp);
        assert!((sorted[0] - 4.0).abs() < 1e-4 && sorted[1..] == [20.0; 3], "{sides:?}");
    }

    /// A net of bent curves, none along x or y.
    fn net() -> ClothCurves {
        let cell_um = [[150.0, 60.0], [-40.0, 170.0]];
        let lattice = Lattice::new(cell_um).unwrap();
        let mut cloth = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
        for (kind, shift) in [[0, 1], [1, 0]].into_iter().enumerate() {
            let period = lattice.vector(shift);
            let points: Vec<[f64; 3]> = (0..16)
                .map(|i| {
                    let t = f64::from(i) / 16.0;
                    let (s, c) = (std::f64::consts::TAU * t).sin_cos();
                    let z = if kind == 0 { 30.0 * c } else { -30.0 * c };
                    [t * period[0] + 0.02 * s * period[1], t * period[1] - 0.02 * s * period[0], z]
                })
                .collect();
            cloth.yarns.push(ClothYarn { kind: kind as u32, number: 0, step: [1, 0], period: shift });
            cloth.curves.push(PlyCurve::through(kind as u32, 40.0, shift, &points, &lattice));
        }
        cloth
    }

    /// Each extent equals the distance by which the line can be moved until it hits a ply, found by stepping.
    #[test]
    fn sides_end_where_moved_lines_hit() {
        let curves = net();
        let lattice = Lattice::new(curves.cell_um).unwrap();
        let lines = ClothLines::new(&curves).unwrap();
        let gaps =
            ClothGaps::new(&curves, &lattice, &GaussianBeam { w0_um: 10.0, lambda_um: 0.55, d_cut_um: 20.0 }).unwrap();
        let mut random = SplitMix64(3);
        let mut number = || random.next_f64() as f32;
        let (mut sides_seen, mut off, mut hits) = (0, Vec::new(), LineHits::default());
        let mut is_hit = |at: [f32; 2], wo: [f32; 3]| {
            let distance = (lines.half_thickness_um() + 1.0) / wo[2].abs();
            lines.hits(
                [at[0] + distance * wo[0], at[1] + distance * wo[1], distance * wo[2]],
                wo.map(|v| -v),
                &mut hits,
            );
            !hits.as_slice().is_empty()
        };
        for _ in 0..4000 {
            let at = [600.0 * number() - 300.0, 600.0 * number() - 300.0];
            let (z, turn): (f32, f32) = (1.0 - 0.6 * number(), std::f32::consts::TAU * number());
            let across = (1.0 - z * z).sqrt();
            let wo = [across * turn.cos(), across * turn.sin(), if number() < 0.5 { z } else { -z }];
            if is_hit(at, wo) {
                continue;
            }
            let mut edges = Vec::new();
            gaps.edges(&lines, at, wo, |edge| edges.push(edge));
            let (sides, [c, s]) = rectangle(&edges, 20.0);
            for (side, e) in sides.into_iter().zip([[-c, -s], [c, s], [s, -c], [-s, c]]) {
                let moved = |by: f32| [at[0] + by * e[0], at[1] + by * e[1]];
                let free = (1..80).map(|i| 0.25 * i as f32).find(|by| is_hit(moved(*by), wo)).unwrap_or(20.0);
                sides_seen += usize::from(free < 20.0);
                off.push((side - free).abs());
            }
        }
        off.sort_by(f32::total_cmp);
        let at = |share: f64| off[(share * off.len() as f64) as usize];
        println!("{sides_seen} of {} sides end within 20 um; off by {} {} {}", off.len(), at(0.5), at(0.9), at(0.99));
        assert!(sides_seen > 500);
        assert!(at(0.5) < 0.2 && at(0.9) < 0.5, "{} {}", at(0.5), at(0.9));
    }

    /// The extents change continuously as an edge rotates.
    #[test]
    fn sides_change_steadily() {
        let at = |degrees: f32| rectangle(&[edge(0.0, 6.0), edge(180.0, 4.0), edge(degrees, 5.0)], 20.0).0;
        for i in 0..3600 {
            let [a, b] = [i, i + 1].map(|i| at(0.1 * i as f32));
            let mut sorted = [a, b];
            sorted.iter_mut().for_each(|s| s.sort_by(f32::total_cmp));
            for k in 0..4 {
                // Extents are compared by the light of a beam of 10 um beyond them.
                let [a, b] = [0, 1].map(|i: usize| (-0.01 * sorted[i][k] * sorted[i][k]).exp());
                assert!((a - b).abs() < 0.02, "{}: {sorted:?}", 0.1 * i as f32);
            }
        }
    }
}
