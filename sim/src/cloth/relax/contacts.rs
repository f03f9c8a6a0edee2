//! Contacts of elements: pairs that may touch, and the overlap of a pair.

use super::elements::{Elements, Nodes};
use plywave::cloth::{Buckets, whole_times};
use plywave::math::vec3::{dot, sub};
use rayon::prelude::*;

/// Weight of the offset from the elements' middles in their squared distance, over the square of their
/// radius.
const EVEN: f64 = 0.005;
/// Distance along a chain, over its radius, within which its elements have no contact with each other.
const OWN: f64 = 3.5;

/// Two elements that may touch.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    pub a: u32,
    pub b: u32,
    /// Translation of b [um].
    pub by: [f64; 2],
}

/// Two elements that overlap.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Index of the pair.
    pub pair: u32,
    /// Places of the closest points on the elements, from 0 to 1.
    pub s: f64,
    pub t: f64,
    /// Overlap [um].
    pub overlap: f64,
    /// Derivative of the distance by the place of the first point: a vector of length 1 at most.
    pub normal: [f64; 3],
}

impl Contact {
    /// Derivatives of the distance by the four nodes are these times the normal.
    pub fn weights(&self) -> [f64; 4] {
        [1.0 - self.s, self.s, self.t - 1.0, -self.t]
    }
}

/// Middle and half length of every element.
#[derive(Default)]
pub struct Middles(Vec<([f64; 3], f64)>);

impl Middles {
    pub fn fill(&mut self, nodes: &Nodes, x: &[f64]) {
        let of = |g: usize| {
            let (p, q) = (Nodes::at(x, g), nodes.end(x, g));
            let d = sub(q, p);
            ([0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])], 0.5 * dot(d, d).sqrt())
        };
        (0..nodes.len()).into_par_iter().with_min_len(4096).map(of).collect_into_vec(&mut self.0);
    }
}

/// Softened minimum squared distance of the elements p + s u and q + t v, with its s and t.
fn distance2(p: [f64; 3], u: [f64; 3], q: [f64; 3], v: [f64; 3], e: f64) -> (f64, f64, f64) {
    let w = sub(p, q);
    let (uu, uv, vv, uw, vw, ww) = (dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w), dot(w, w));
    let value = |s: f64, t: f64| {
        ww + s * s * uu
            + t * t * vv
            + 2.0 * (s * uw - t * vw - s * t * uv)
            + e * ((s - 0.5).powi(2) + (t - 0.5).powi(2))
    };
    let (a, c) = (uu + e, vv + e);
    let (f, g) = (0.5 * e - uw, 0.5 * e + vw);
    let det = a * c - uv * uv;
    let (s, t) = ((f * c + g * uv) / det, (g * a + f * uv) / det);
    if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
        return (value(s, t), s, t);
    }
    let mut best = (f64::INFINITY, 0.5, 0.5);
    for edge in [0.0, 1.0] {
        let t = ((g + edge * uv) / c).clamp(0.0, 1.0);
        let s = ((f + edge * uv) / a).clamp(0.0, 1.0);
        for (s, t) in [(edge, t), (s, edge)] {
            let d = value(s, t);
            if d < best.0 {
                best = (d, s, t);
            }
        }
    }
    best
}

/// Pairs of elements that may overlap while no node moves by more than half of `skin`.
pub fn pairs(cloth: &Elements, nodes: &Nodes, x: &[f64], skin: f64) -> Vec<Pair> {
    let n = nodes.len();
    let (mut middles, mut halves) = (Vec::with_capacity(n), Vec::with_capacity(n));
    for g in 0..n {
        let (p, q) = (Nodes::at(x, g), nodes.end(x, g));
        let d = sub(q, p);
        middles.push([0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])]);
        halves.push(0.5 * dot(d, d).sqrt());
    }
    let largest = (0..n).map(|g| nodes.radius[g] + halves[g]).fold(0.0, f64::max);
    // Buckets of a sheared cell, such as that of a satin, would be long.
    let (reduced, steps) = cloth.lattice.reduced();
    let buckets = Buckets::new(&reduced, &middles, 2.0 * largest + skin);
    let found: Vec<Vec<Pair>> = (0..n)
        .into_par_iter()
        .map(|a| {
            let mut list = Vec::new();
            buckets.near(middles[a], |b, [i, j]| {
                // Each pair is listed once.
                if b < a || (a == b && [i, j] <= [0, 0]) {
                    return;
                }
                let cells = [0, 1].map(|k| i * steps[0][k] + j * steps[1][k]);
                let by = cloth.lattice.vector(cells);
                let m = middles[b];
                let d = sub([m[0] + by[0], m[1] + by[1], m[2]], middles[a]);
                let reach = nodes.radius[a] + nodes.radius[b] + halves[a] + halves[b] + skin;
                if dot(d, d) > reach * reach {
                    return;
                }
                let c = nodes.chain[a];
                if c == nodes.chain[b] {
                    let chain = &cloth.chains[c as usize];
                    if let Some(k) = whole_times(cells, chain.shift) {
                        let nodes_apart = b as i64 - a as i64 + i64::from(k) * chain.points_um.len() as i64;
                        let length = halves[a] + halves[b];
                        if nodes_apart.abs() as f64 * length < OWN * nodes.radius[a] {
                            return;
                        }
                    }
                }
                list.push(Pair { a: a as u32, b: b as u32, by });
            });
            list.sort_by(|p: &Pair, q: &Pair| {
                p.b.cmp(&q.b).then(p.by[0].total_cmp(&q.by[0])).then(p.by[1].total_cmp(&q.by[1]))
            });
            list
        })
        .collect();
    found.concat()
}

/// Contact of a pair whose overlap exceeds `-margin` [um].
pub fn contact(
    nodes: &Nodes,
    middles: &Middles,
    x: &[f64],
    (index, pair): (usize, &Pair),
    margin: f64,
) -> Option<Contact> {
    let (a, b) = (pair.a as usize, pair.b as usize);
    let ((ma, la), (mb, lb)) = (middles.0[a], middles.0[b]);
    let reach = nodes.radius[a] + nodes.radius[b];
    let off = [mb[0] + pair.by[0] - ma[0], mb[1] + pair.by[1] - ma[1], mb[2] - ma[2]];
    let most = reach + margin + la + lb;
    if dot(off, off) >= most * most {
        return None;
    }
    let p = Nodes::at(x, a);
    let mut q = Nodes::at(x, b);
    let (u, v) = (sub(nodes.end(x, a), p), sub(nodes.end(x, b), q));
    q[0] += pair.by[0];
    q[1] += pair.by[1];
    let (d2, s, t) = distance2(p, u, q, v, EVEN * 0.25 * reach * reach);
    if d2 >= (reach + margin).powi(2) {
        return None;
    }
    let d = d2.sqrt().max(1e-9 * reach);
    let normal = std::array::from_fn(|i| (p[i] + s * u[i] - q[i] - t * v[i]) / d);
    Some(Contact { pair: index as u32, s, t, overlap: reach - d, normal })
}

/// The contacts among pairs whose overlap exceeds `-margin` [um], in the order of the pairs.
pub fn contacts(nodes: &Nodes, middles: &Middles, pairs: &[Pair], x: &[f64], margin: f64, found: &mut Vec<Contact>) {
    const PART: usize = 1 << 12;
    found.clear();
    if pairs.len() <= 2 * PART {
        found.extend(pairs.iter().enumerate().filter_map(|pair| contact(nodes, middles, x, pair, margin)));
        return;
    }
    let of = |(part, pairs): (usize, &[Pair])| {
        let of = |(i, pair)| contact(nodes, middles, x, (part * PART + i, pair), margin);
        pairs.iter().enumerate().filter_map(of).collect::<Vec<_>>()
    };
    let parts: Vec<Vec<Contact>> = pairs.par_chunks(PART).enumerate().map(of).collect();
    parts.iter().for_each(|part| found.extend_from_slice(part));
}
