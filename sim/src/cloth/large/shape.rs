//! The shape of both yarns about each crossing of a relaxed tile.

use crate::cloth::relax::Elements;
use crate::cloth::woven::smooth;
use plywave::cloth::{Lattice, PlyCurve};
use plywave::math::vec3::{dot, sub};

/// Steps of a quadrature between two samples of a yarn.
const STEPS: usize = 8;

/// The yarns about a crossing, from the crossing before to the crossing after it.
#[derive(Clone, Debug)]
pub struct Shape {
    /// `[set][sample]`: displacement of the axis from the straight yarn, at equal lengths along it, with
    /// heights relative to those of the crossing [um].
    pub yarns: [Vec<[f64; 3]>; 2],
    /// Heights of the crossings after it, along x and y, above its own [um].
    pub after: [f64; 2],
    /// Its own height above those of the crossings before it [um].
    pub before: [f64; 2],
}

/// A relaxed tile. A yarn's number is that of the end or of the pick.
pub struct Shapes {
    spacing_um: [f64; 2],
    size: [usize; 2],
    cell_um: [f64; 2],
    /// `[set][yarn][crossing]`: points of the axis from this crossing to the next [um].
    segments: [Vec<Vec<Vec<[f64; 3]>>>; 2],
    /// `[set][yarn][crossing]`: height of the axis [um].
    heights: [Vec<Vec<f64>>; 2],
}

impl Shapes {
    /// Reads a tile of this many ends and picks, whose chains are those of the ends, then those of the picks;
    /// `samples` are the numbers of points of an end and of a pick from crossing to crossing.
    pub fn new(tile: &Elements, size: [usize; 2], spacing_um: [f64; 2], samples: [usize; 2]) -> Shapes {
        let cell_um = [0, 1].map(|k| size[k] as f64 * spacing_um[k]);
        let mut shapes =
            Shapes { spacing_um, size, cell_um, segments: [Vec::new(), Vec::new()], heights: [Vec::new(), Vec::new()] };
        for (c, chain) in tile.chains.iter().enumerate() {
            let set = usize::from(c >= size[0]);
            let curve = smooth(chain, 0, &tile.lattice);
            // Ends run along y, picks along x.
            let axis = 1 - set;
            let count = size[axis];
            let mut places: Vec<f64> = (0..count)
                .map(|k| crossing(&curve, &tile.lattice, axis, (k as f64 + 0.5) * spacing_um[axis], count))
                .collect();
            let at = |u: f64| curve.at(&tile.lattice, u).point_um;
            shapes.heights[set].push(places.iter().map(|u| at(*u)[2]).collect());
            places.push(places[0] + curve.control_um.len() as f64);
            let segment = |ends: &[f64]| even(&curve, &tile.lattice, [ends[0], ends[1]], samples[set]);
            shapes.segments[set].push(places.windows(2).map(segment).collect());
        }
        shapes
    }

    pub fn height(&self, [end, pick]: [usize; 2]) -> f64 {
        0.5 * (self.heights[0][end][pick] + self.heights[1][pick][end])
    }

    /// The shape about the crossing of an end and a pick of the tile.
    pub fn at(&self, crossing: [usize; 2]) -> Shape {
        let own = self.height(crossing);
        let step = |k: usize, by: usize| {
            let mut to = crossing;
            to[k] = (to[k] + by) % self.size[k];
            to
        };
        let yarns = [0, 1].map(|set| {
            let axis = 1 - set;
            let segments = &self.segments[set][crossing[set]];
            let (k, count) = (crossing[axis], self.size[axis]);
            let before = segments[(k + count - 1) % count].iter().map(|p| {
                let mut p = *p;
                p[axis] -= if k == 0 { self.cell_um[axis] } else { 0.0 };
                p
            });
            let points: Vec<[f64; 3]> = before.chain(segments[k].iter().copied()).collect();
            let half = 0.5 * points.len() as f64;
            let mut displaced = Vec::with_capacity(points.len());
            for (i, p) in points.into_iter().enumerate() {
                let mut straight = [0, 1].map(|k| (crossing[k] as f64 + 0.5) * self.spacing_um[k]);
                straight[axis] += ((i as f64 + 0.5) / half - 1.0) * self.spacing_um[axis];
                displaced.push([p[0] - straight[0], p[1] - straight[1], p[2] - own]);
            }
            displaced
        });
        Shape {
            yarns,
            after: [0, 1].map(|k| self.height(step(k, 1)) - own),
            before: [0, 1].map(|k| own - self.height(step(k, self.size[k] - 1))),
        }
    }
}

/// Parameter of a yarn of `count` crossings at which it passes a place along its axis, by bisection.
fn crossing(curve: &PlyCurve, lattice: &Lattice, axis: usize, place_um: f64, count: usize) -> f64 {
    let knots = curve.control_um.len() as f64;
    let step = knots / count as f64;
    let is_before = |u: f64| curve.at(lattice, u).point_um[axis] < place_um;
    // Nodes may have slid along the yarn.
    let guess = place_um / lattice.cell_um[axis][axis] * knots;
    let (mut low, mut high) = (guess - step, guess + step);
    for _ in 0..count {
        low -= if is_before(low) { 0.0 } else { step };
        high += if is_before(high) { step } else { 0.0 };
    }
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        *(if is_before(middle) { &mut low } else { &mut high }) = middle;
    }
    0.5 * (low + high)
}

/// Points in the middles of `count` parts of equal length between two parameters.
fn even(curve: &PlyCurve, lattice: &Lattice, [from, to]: [f64; 2], count: usize) -> Vec<[f64; 3]> {
    let steps = STEPS * count;
    let at = |i: usize| curve.at(lattice, from + (to - from) * i as f64 / steps as f64).point_um;
    let points: Vec<[f64; 3]> = (0..=steps).map(at).collect();
    let mut lengths = vec![0.0];
    for pair in points.windows(2) {
        let d = sub(pair[1], pair[0]);
        lengths.push(lengths[lengths.len() - 1] + dot(d, d).sqrt());
    }
    let all = lengths[steps];
    let part = |i: usize| {
        let length = all * (i as f64 + 0.5) / count as f64;
        let k = lengths.partition_point(|l| *l <= length).clamp(1, steps) - 1;
        let t = (length - lengths[k]) / (lengths[k + 1] - lengths[k]).max(1e-12);
        curve.at(lattice, from + (to - from) * (k as f64 + t) / steps as f64).point_um
    };
    (0..count).map(part).collect()
}
