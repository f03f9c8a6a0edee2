//! Relaxation of a cloth: chains of digital elements find the least energy.
//!
//! A strand, a ply or a bundle of filaments, is a closed chain of nodes (Wang and Sun 2001; Zhou, Sun and
//! Wang 2004). Its energy is that of its tension T, or of a held length, of bending, of contact with every
//! strand that it overlaps, and of the cohesion of its yarn:
//! ```text
//! E = sum T L + B/2 sum kappa^2 l + c/2 sum l |p - mean p|^2 + k/2 sum overlap^2
//! ```
//! L is the chain's length, l the length of an element, kappa the curvature, c / T the cohesion, which holds
//! the strands of a yarn together (interlacing, friction).
//! Elements are straight; two of them overlap by the sum of their radii less their distance. The distance is
//! softened by [`EVEN`] where elements are parallel, so that it has a derivative everywhere.
//! A pressed cloth lies between two planes, which nodes touch like other strands.
//! The result is the same on any number of threads: contacts are found in parallel and added in order.

use super::minimize::minimize;
use super::ready::Effort;
use plywave::cloth::{Buckets, Lattice, whole_times};
use plywave::math::vec3::{dot, sub};
use rayon::prelude::*;

/// Weight of the middles of two elements in their squared distance, over the square of their radius.
const EVEN: f64 = 0.005;
/// Stiffness that keeps the elements of a chain alike, over its tension.
const ALIKE: f64 = 2.0;
/// Stiffness of a held length, over the tension.
const HOLD: f64 = 60.0;
/// How far nodes may move before neighbors are searched again, over the largest radius.
const SKIN: f64 = 0.6;

/// Stages: stiffness of contact over mean tension and radius, force at which it ends over the tension, steps.
const STAGES: [(f64, f64, usize); 4] =
    [(4.0, 1e-2, 600), (20.0, 3e-3, 1200), (100.0, 2e-3, 3000), (500.0, 2e-3, 12_000)];
/// Most steps of a stage of a draft.
const DRAFT_STEPS: usize = 600;
/// Places along a chain nearer than this do not touch each other, over its radius.
const OWN: f64 = 3.5;
/// Largest overlap of two strands of a cloth over their mean radius.
pub const MAX_OVERLAP: f64 = 0.02;

/// A strand of the cloth.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    /// Nodes over one period [um].
    pub points_um: Vec<[f64; 3]>,
    /// The period, in vectors of the cell.
    pub shift: [i32; 2],
    /// Radius [um].
    pub radius_um: f64,
    /// Tension, in any unit of force.
    pub tension: f64,
    /// Bending stiffness [that unit um2].
    pub bending: f64,
    /// Length that one period keeps [um], in place of a tension that shortens it.
    pub length_um: Option<f64>,
}

/// The strands of a yarn at one place along it: chain, node, and cells by which the node is moved.
pub(super) type Station = Vec<(usize, usize, [i32; 2])>;

/// A cloth to relax.
#[derive(Clone, Debug)]
pub(super) struct Elements {
    pub lattice: Lattice,
    pub chains: Vec<Chain>,
    /// Stations with their cohesion [force per um2], and length [um].
    pub stations: Vec<(Station, f64, f64)>,
    /// Distance of two planes about z = 0 between which the cloth is pressed [um].
    pub thickness_um: Option<f64>,
}

/// How a relaxation ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxed {
    /// Nodes.
    pub nodes: usize,
    /// Steps of the minimization.
    pub steps: usize,
    /// Largest force on a node that is not balanced, over the mean tension of a strand.
    pub force: f64,
    /// Largest overlap of two strands over their mean radius.
    pub overlap: f64,
}

#[derive(Clone, Copy)]
struct Pair {
    a: u32,
    b: u32,
    /// By how much b is moved [um].
    by: [f64; 2],
}

struct Contact {
    force: [f64; 3],
    s: f64,
    t: f64,
    overlap: f64,
}

/// The chains as one list of nodes.
struct Nodes {
    first: Vec<usize>,
    chain: Vec<u32>,
    /// Next node and whether it lies a period further.
    next: Vec<u32>,
    period: Vec<[f64; 2]>,
    radius: Vec<f64>,
}

impl Nodes {
    fn new(cloth: &Elements) -> Nodes {
        let mut nodes = Nodes { first: vec![0], chain: vec![], next: vec![], period: vec![], radius: vec![] };
        for (c, chain) in cloth.chains.iter().enumerate() {
            let (first, n) = (nodes.chain.len(), chain.points_um.len());
            for i in 0..n {
                nodes.chain.push(c as u32);
                nodes.next.push((first + (i + 1) % n) as u32);
                nodes.radius.push(chain.radius_um);
            }
            nodes.period.push(cloth.lattice.vector(chain.shift));
            nodes.first.push(first + n);
        }
        nodes
    }

    fn len(&self) -> usize {
        self.chain.len()
    }

    fn at(x: &[f64], g: usize) -> [f64; 3] {
        [x[3 * g], x[3 * g + 1], x[3 * g + 2]]
    }

    /// End of the element from node g.
    fn end(&self, x: &[f64], g: usize) -> [f64; 3] {
        let h = self.next[g] as usize;
        let mut p = Nodes::at(x, h);
        if h <= g {
            let period = self.period[self.chain[g] as usize];
            p[0] += period[0];
            p[1] += period[1];
        }
        p
    }
}

/// Softened least squared distance of the elements p + s u and q + t v, with s and t.
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
fn pairs(cloth: &Elements, nodes: &Nodes, x: &[f64], skin: f64) -> Vec<Pair> {
    let n = nodes.len();
    let (mut middles, mut halves) = (Vec::with_capacity(n), Vec::with_capacity(n));
    for g in 0..n {
        let (p, q) = (Nodes::at(x, g), nodes.end(x, g));
        let d = sub(q, p);
        middles.push([0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])]);
        halves.push(0.5 * dot(d, d).sqrt());
    }
    let largest = (0..n).map(|g| nodes.radius[g] + halves[g]).fold(0.0, f64::max);
    let buckets = Buckets::new(&cloth.lattice, &middles, 2.0 * largest + skin);
    let found: Vec<Vec<Pair>> = (0..n)
        .into_par_iter()
        .map(|a| {
            let mut list = Vec::new();
            buckets.near(middles[a], |b, cells| {
                // Each pair once.
                if b < a || (a == b && cells <= [0, 0]) {
                    return;
                }
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

fn contact(nodes: &Nodes, x: &[f64], pair: &Pair, stiffness: f64) -> Option<Contact> {
    let (a, b) = (pair.a as usize, pair.b as usize);
    let p = Nodes::at(x, a);
    let mut q = Nodes::at(x, b);
    let (u, v) = (sub(nodes.end(x, a), p), sub(nodes.end(x, b), q));
    q[0] += pair.by[0];
    q[1] += pair.by[1];
    let reach = nodes.radius[a] + nodes.radius[b];
    let (d2, s, t) = distance2(p, u, q, v, EVEN * 0.25 * reach * reach);
    if d2 >= reach * reach {
        return None;
    }
    let d = d2.sqrt().max(1e-9 * reach);
    let overlap = reach - d;
    // dE/d(difference) = -k overlap / d * difference
    let k = -stiffness * overlap / d;
    let force = std::array::from_fn(|i| k * (p[i] + s * u[i] - q[i] - t * v[i]));
    Some(Contact { force, s, t, overlap })
}

/// Energy and its gradient.
fn energy(cloth: &Elements, nodes: &Nodes, pairs: &[Pair], stiffness: f64, x: &[f64], gradient: &mut [f64]) -> f64 {
    gradient.fill(0.0);
    let mut all = 0.0;
    for (c, chain) in cloth.chains.iter().enumerate() {
        let (first, n) = (nodes.first[c], chain.points_um.len());
        let edges: Vec<([f64; 3], f64)> = (first..first + n)
            .map(|g| {
                let d = sub(nodes.end(x, g), Nodes::at(x, g));
                (d, dot(d, d).sqrt().max(1e-12))
            })
            .collect();
        let length: f64 = edges.iter().map(|e| e.1).sum();
        let pull = match chain.length_um {
            None => {
                all += chain.tension * length;
                chain.tension
            }
            Some(held) => {
                let strain = length / held - 1.0;
                all += 0.5 * HOLD * chain.tension * strain * strain * held;
                HOLD * chain.tension * strain
            }
        };
        // A length that does not change with x.
        let rest = chain.length_um.unwrap_or(0.0).max(nodes.period[c][0].hypot(nodes.period[c][1])) / n as f64;
        let alike = ALIKE * chain.tension / rest;
        let bend = chain.bending / (rest * rest * rest);
        for i in 0..n {
            let j = (i + 1) % n;
            let (g, h) = (first + i, first + j);
            let ((d, l), (d2, l2)) = (edges[i], edges[j]);
            let diff = l - l2;
            all += 0.5 * alike * diff * diff;
            // Element i gets pull + alike * (l_i - l_{i+1}) - alike * (l_{i-1} - l_i).
            let before = edges[(i + n - 1) % n].1;
            let f = pull + alike * (2.0 * l - before - l2);
            let curve = sub(d2, d);
            all += 0.5 * bend * dot(curve, curve);
            let k = nodes.next[h] as usize;
            for axis in 0..3 {
                let along = f * d[axis] / l;
                gradient[3 * h + axis] += along;
                gradient[3 * g + axis] -= along;
                let b = bend * curve[axis];
                gradient[3 * g + axis] += b;
                gradient[3 * h + axis] -= 2.0 * b;
                gradient[3 * k + axis] += b;
            }
        }
    }
    for (station, cohesion, length) in &cloth.stations {
        let points: Vec<[f64; 3]> = station
            .iter()
            .map(|(c, i, cells)| {
                let mut p = Nodes::at(x, nodes.first[*c] + i);
                let by = cloth.lattice.vector(*cells);
                p[0] += by[0];
                p[1] += by[1];
                p
            })
            .collect();
        let k = cohesion * length;
        let count = points.len() as f64;
        for axis in 0..3 {
            let mean = points.iter().map(|p| p[axis]).sum::<f64>() / count;
            for ((c, i, _), p) in station.iter().zip(&points) {
                all += 0.5 * k * (p[axis] - mean).powi(2);
                gradient[3 * (nodes.first[*c] + i) + axis] += k * (p[axis] - mean);
            }
        }
    }
    if let Some(thickness) = cloth.thickness_um {
        for g in 0..nodes.len() {
            let z = x[3 * g + 2];
            let overlap = z.abs() + nodes.radius[g] - 0.5 * thickness;
            if overlap > 0.0 {
                all += 0.5 * stiffness * overlap * overlap;
                gradient[3 * g + 2] += stiffness * overlap.copysign(z);
            }
        }
    }
    let contacts: Vec<Option<Contact>> =
        pairs.par_iter().with_min_len(4096).map(|pair| contact(nodes, x, pair, stiffness)).collect();
    for (pair, contact) in pairs.iter().zip(&contacts) {
        let Some(contact) = contact else { continue };
        all += 0.5 * stiffness * contact.overlap * contact.overlap;
        let (a, b) = (pair.a as usize, pair.b as usize);
        let (a2, b2) = (nodes.next[a] as usize, nodes.next[b] as usize);
        for axis in 0..3 {
            let f = contact.force[axis];
            gradient[3 * a + axis] += (1.0 - contact.s) * f;
            gradient[3 * a2 + axis] += contact.s * f;
            gradient[3 * b + axis] -= (1.0 - contact.t) * f;
            gradient[3 * b2 + axis] -= contact.t * f;
        }
    }
    all
}

/// Relaxes a cloth in stages of stiffer contact. `go_on` is asked at every step and may stop the work.
pub(super) fn relax(cloth: &mut Elements, effort: Effort, go_on: &(dyn Fn() -> bool + Sync)) -> Option<Relaxed> {
    let nodes = Nodes::new(cloth);
    let mut x: Vec<f64> = cloth.chains.iter().flat_map(|c| c.points_um.as_flattened().to_vec()).collect();
    let count = cloth.chains.len() as f64;
    let tension = cloth.chains.iter().map(|c| c.tension).sum::<f64>() / count;
    let radius = cloth.chains.iter().map(|c| c.radius_um).sum::<f64>() / count;
    let skin = SKIN * cloth.chains.iter().map(|c| c.radius_um).fold(0.0, f64::max);
    let mut relaxed = Relaxed { nodes: nodes.len(), steps: 0, force: f64::INFINITY, overlap: 0.0 };
    let mut list = Vec::new();
    for (stiffness, force, steps) in STAGES {
        let steps = if effort == Effort::Draft { steps.min(DRAFT_STEPS) } else { steps };
        let stiffness = stiffness * tension / radius;
        let mut searched: Vec<f64> = Vec::new();
        let minimum = minimize(&mut x, force * tension, steps, 0.2 * skin, |x, gradient| {
            if !go_on() {
                // Flat: the minimization ends.
                gradient.fill(0.0);
                return 0.0;
            }
            let is_far = |g: usize| {
                (0..3).map(|i| (x[3 * g + i] - searched[3 * g + i]).powi(2)).sum::<f64>() > 0.25 * skin * skin
            };
            if searched.is_empty() || (0..nodes.len()).any(is_far) {
                list = pairs(cloth, &nodes, x, skin);
                searched = x.to_vec();
            }
            energy(cloth, &nodes, &list, stiffness, x, gradient)
        });
        if !go_on() {
            return None;
        }
        relaxed.steps += minimum.steps;
        relaxed.force = minimum.slope / tension;
    }
    // The planes hold a pressed cloth; another is moved to the middle.
    let height = match cloth.thickness_um {
        Some(_) => 0.0,
        None => x.iter().skip(2).step_by(3).sum::<f64>() / nodes.len() as f64,
    };
    for (c, chain) in cloth.chains.iter_mut().enumerate() {
        for (i, p) in chain.points_um.iter_mut().enumerate() {
            *p = Nodes::at(&x, nodes.first[c] + i);
            p[2] -= height;
        }
    }
    relaxed.overlap = overlap(cloth);
    Some(relaxed)
}

/// Largest overlap of two strands over their mean radius.
pub(super) fn overlap(cloth: &Elements) -> f64 {
    let nodes = Nodes::new(cloth);
    let x: Vec<f64> = cloth.chains.iter().flat_map(|c| c.points_um.as_flattened().to_vec()).collect();
    let list = pairs(cloth, &nodes, &x, 0.0);
    let of = |pair: &Pair| {
        let mean = 0.5 * (nodes.radius[pair.a as usize] + nodes.radius[pair.b as usize]);
        contact(&nodes, &x, pair, 1.0).map_or(0.0, |c| c.overlap / mean)
    };
    list.iter().map(of).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn the_gradient_is_that_of_the_energy() {
        let lattice = Lattice::new([[100.0, 10.0], [0.0, 120.0]]).unwrap();
        let chain = |z: f64, shift: [i32; 2], length_um| {
            let v = lattice.vector(shift);
            let n = 9;
            let points_um = (0..n)
                .map(|i| {
                    let t = i as f64 / n as f64;
                    [t * v[0] + 20.0 + 3.0 * (7.0 * t).sin(), t * v[1] + 30.0, z + 5.0 * (9.0 * t).cos()]
                })
                .collect();
            Chain { points_um, shift, radius_um: 20.0, tension: 1.3, bending: 500.0, length_um }
        };
        let chains = vec![chain(0.0, [1, 0], None), chain(15.0, [0, 1], Some(130.0)), chain(25.0, [1, 0], None)];
        let stations = (0..9).map(|i| (vec![(0, i, [0, 0]), (2, i, [0, 0])], 0.01, 10.0)).collect();
        let cloth = Elements { lattice, chains, stations, thickness_um: Some(70.0) };
        let nodes = Nodes::new(&cloth);
        let x: Vec<f64> = cloth.chains.iter().flat_map(|c| c.points_um.as_flattened().to_vec()).collect();
        let list = pairs(&cloth, &nodes, &x, 5.0);
        let mut g = vec![0.0; x.len()];
        energy(&cloth, &nodes, &list, 0.3, &x, &mut g);
        let mut other = g.clone();
        for i in 0..x.len() {
            let mut y = x.clone();
            y[i] += 1e-5;
            let up = energy(&cloth, &nodes, &list, 0.3, &y, &mut other);
            y[i] -= 2e-5;
            let down = energy(&cloth, &nodes, &list, 0.3, &y, &mut other);
            let want = (up - down) / 2e-5;
            assert!((g[i] - want).abs() < 1e-5 * (1.0 + want.abs()), "{i}: {} {want}", g[i]);
        }
    }
}
