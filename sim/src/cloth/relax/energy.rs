//! Energy of a cloth of chains, its gradient, and a positive definite approximation of its Hessian.

use super::contacts::{Contact, Middles, Pair, contacts, pairs};
use super::elements::{Chain, Elements, Hold, Nodes};
use super::factor::{Block, Factor};
use plywave::math::vec3::{dot, sub};
use rayon::prelude::*;

/// Stiffness that equalizes the lengths of a chain's elements, over its tension.
const ALIKE: f64 = 2.0;
/// Stiffness of a held length, over the tension.
const HOLD: f64 = 60.0;
/// Distance that nodes may move before neighbors are searched again, over the largest radius: at soft
/// contacts, under which yarns move far, and at stiff ones.
const SKIN: [f64; 2] = [0.6, 0.2];
/// Minimum gap within which pairs get a place in the matrix, over the mean radius.
const NEAR: f64 = 0.15;
/// Overlap and gap between which the stiffness of a contact grows from 0 to its own, over tension per contact
/// stiffness: less than the overlap that a yarn's tension causes. Without it contacts flicker as the cloth
/// moves.
const SOFT: f64 = 0.35;
/// The same of the Hessian over that of the energy: contacts that a step may close resist it.
const WIDER: f64 = 6.0;

/// A yarn's section with its nodes in one list.
struct Members {
    /// Range in [`System::members`].
    from: usize,
    to: usize,
    /// Cohesion times length [force/um].
    stiffness: f64,
    length_um: f64,
    hold: Option<Hold>,
}

/// A cloth while it is relaxed.
pub struct System<'a> {
    cloth: &'a Elements,
    pub nodes: Nodes,
    /// Node and translation [um] of the strands of all sections.
    members: Vec<(u32, [f64; 2])>,
    sections: Vec<Members>,
    /// Mean tension and mean radius [um] of the strands.
    pub tension: f64,
    pub radius_um: f64,
    skin_um: f64,
    /// Contact stiffness [force/um].
    stiffness: f64,
    pairs: Vec<Pair>,
    /// Where the pairs were searched.
    searched: Vec<f64>,
    middles: Middles,
    contacts: Vec<Contact>,
    factor: Option<Factor>,
}

/// Length and reference length of a chain: the latter does not depend on the coordinates.
fn rest_um(chain: &Chain, period: [f64; 2]) -> f64 {
    chain.length_um.unwrap_or(0.0).max(period[0].hypot(period[1])) / chain.points_um.len() as f64
}

/// Element `i` of a chain's nodes: difference of its ends and length.
fn edge(x: &[f64], period: [f64; 2], i: usize) -> ([f64; 3], f64) {
    let n = x.len() / 3;
    let mut d = sub(Nodes::at(x, (i + 1) % n), Nodes::at(x, i));
    if i + 1 == n {
        d[0] += period[0];
        d[1] += period[1];
    }
    (d, dot(d, d).sqrt().max(1e-12))
}

/// Energy of one chain and the force that its held length or its tension exerts; fills its gradient.
fn chain_energy(chain: &Chain, period: [f64; 2], x: &[f64], gradient: &mut [f64]) -> f64 {
    gradient.fill(0.0);
    let n = x.len() / 3;
    let (pull, mut all) = pull(chain, period, x);
    let rest = rest_um(chain, period);
    let alike = ALIKE * chain.tension / rest;
    let bend = chain.bending / (rest * rest * rest);
    let mut before = edge(x, period, n - 1).1;
    let mut this = edge(x, period, 0);
    for i in 0..n {
        let (j, k) = ((i + 1) % n, (i + 2) % n);
        let after = edge(x, period, j);
        let ((d, l), (d2, l2)) = (this, after);
        let diff = l - l2;
        all += 0.5 * alike * diff * diff;
        // The tension of element i is pull + alike * (l_i - l_{i+1}) - alike * (l_{i-1} - l_i).
        let f = pull + alike * (2.0 * l - before - l2);
        let curve = sub(d2, d);
        all += 0.5 * bend * dot(curve, curve);
        for axis in 0..3 {
            let along = f * d[axis] / l;
            let b = bend * curve[axis];
            gradient[3 * j + axis] += along - 2.0 * b;
            gradient[3 * i + axis] += b - along;
            gradient[3 * k + axis] += b;
        }
        (before, this) = (l, after);
    }
    all
}

/// Force of a chain's tension or held length, and the energy of it.
fn pull(chain: &Chain, period: [f64; 2], x: &[f64]) -> (f64, f64) {
    let length: f64 = (0..x.len() / 3).map(|i| edge(x, period, i).1).sum();
    match chain.length_um {
        None => (chain.tension, chain.tension * length),
        Some(held) => {
            let strain = length / held - 1.0;
            (HOLD * chain.tension * strain, 0.5 * HOLD * chain.tension * strain * strain * held)
        }
    }
}

fn scaled(a: [f64; 3], b: [f64; 3], factor: f64) -> Block {
    a.map(|a| b.map(|b| factor * a * b))
}

fn diagonal(value: f64) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { value } else { 0.0 }))
}

fn sum(a: &Block, b: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + b[i][j]))
}

impl<'a> System<'a> {
    pub fn new(cloth: &'a Elements) -> System<'a> {
        let nodes = Nodes::new(cloth);
        let (mut members, mut sections) = (Vec::new(), Vec::new());
        for section in &cloth.sections {
            let from = members.len();
            let of =
                |(c, i, cells): &(usize, usize, [i32; 2])| ((nodes.first[*c] + i) as u32, cloth.lattice.vector(*cells));
            members.extend(section.station.iter().map(of));
            let stiffness = section.cohesion * section.length_um;
            let (to, length_um, hold) = (members.len(), section.length_um, section.hold);
            sections.push(Members { from, to, stiffness, length_um, hold });
        }
        let count = cloth.chains.len() as f64;
        System {
            tension: cloth.chains.iter().map(|c| c.tension).sum::<f64>() / count,
            radius_um: cloth.chains.iter().map(|c| c.radius_um).sum::<f64>() / count,
            skin_um: 0.0,
            stiffness: 0.0,
            pairs: Vec::new(),
            searched: Vec::new(),
            middles: Middles::default(),
            contacts: Vec::new(),
            factor: None,
            cloth,
            nodes,
            members,
            sections,
        }
    }

    /// Sets the contact stiffness, over tension over radius.
    pub fn stiffen(&mut self, stiffness: f64, is_first: bool) {
        self.stiffness = stiffness * self.tension / self.radius_um;
        let largest = self.cloth.chains.iter().map(|c| c.radius_um).fold(0.0, f64::max);
        self.skin_um = SKIN[usize::from(!is_first)] * largest;
        self.searched.clear();
    }

    /// Searches pairs again if nodes have moved far.
    fn search(&mut self, x: &[f64]) {
        let limit = 0.25 * self.skin_um * self.skin_um;
        let is_far = |(p, q): (&[f64], &[f64])| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>() > limit;
        if self.searched.is_empty() || x.chunks_exact(3).zip(self.searched.chunks_exact(3)).any(is_far) {
            // Pairs that do not touch yet push and get a place in the matrix, too.
            let margin = (WIDER * self.soft_um()).max(NEAR * self.radius_um);
            self.pairs = pairs(self.cloth, &self.nodes, x, self.skin_um + margin);
            self.searched = x.to_vec();
        }
    }

    /// Returns the energy and fills its gradient.
    pub fn energy(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        self.search(x);
        let (cloth, nodes) = (self.cloth, &self.nodes);
        let mut parts = Vec::with_capacity(cloth.chains.len());
        let mut rest = &mut *gradient;
        for (c, chain) in cloth.chains.iter().enumerate() {
            let (own, after) = rest.split_at_mut(3 * chain.points_um.len());
            parts.push((chain, nodes.period[c], &x[3 * nodes.first[c]..3 * nodes.first[c + 1]], own));
            rest = after;
        }
        let of = |(chain, period, x, own): (&Chain, [f64; 2], &[f64], &mut [f64])| chain_energy(chain, period, x, own);
        let mut all = parts.into_par_iter().with_min_len(8).map(of).collect::<Vec<f64>>().iter().sum::<f64>();
        for section in &self.sections {
            let members = &self.members[section.from..section.to];
            let mean = section_mean(members, x);
            if section.stiffness > 0.0 {
                for (g, by) in members {
                    let at = 3 * *g as usize;
                    for axis in 0..3 {
                        let off = x[at + axis] + if axis < 2 { by[axis] } else { 0.0 } - mean[axis];
                        all += 0.5 * section.stiffness * off * off;
                        gradient[at + axis] += section.stiffness * off;
                    }
                }
            }
            if let Some(hold) = &section.hold {
                let off = hold.across[0] * mean[0] + hold.across[1] * mean[1] - hold.line_um;
                let [energy, force, _] = hold.energy(off, section.length_um);
                all += energy;
                for (g, _) in members {
                    for axis in 0..2 {
                        gradient[3 * *g as usize + axis] += force * hold.across[axis] / members.len() as f64;
                    }
                }
            }
        }
        if let Some(thickness) = cloth.thickness_um {
            for g in 0..nodes.len() {
                let z = x[3 * g + 2];
                let overlap = z.abs() + nodes.radius[g] - 0.5 * thickness;
                if overlap > 0.0 {
                    all += 0.5 * self.stiffness * overlap * overlap;
                    gradient[3 * g + 2] += self.stiffness * overlap.copysign(z);
                }
            }
        }
        self.middles.fill(nodes, x);
        let soft = self.soft_um();
        contacts(nodes, &self.middles, &self.pairs, x, soft, &mut self.contacts);
        for contact in &self.contacts {
            let [energy, force, _] = push(contact.overlap, soft);
            all += self.stiffness * energy;
            let force = -self.stiffness * force;
            for (g, weight) in self.nodes_of(contact).into_iter().zip(contact.weights()) {
                for axis in 0..3 {
                    gradient[3 * g + axis] += force * weight * contact.normal[axis];
                }
            }
        }
        all
    }

    /// Half the width of the onset of contacts [um].
    fn soft_um(&self) -> f64 {
        SOFT * self.tension / self.stiffness
    }

    /// The four nodes of a contact.
    fn nodes_of(&self, contact: &Contact) -> [usize; 4] {
        let pair = &self.pairs[contact.pair as usize];
        let (a, b) = (pair.a as usize, pair.b as usize);
        [a, self.nodes.next[a] as usize, b, self.nodes.next[b] as usize]
    }

    /// Pairs of nodes that share a block of the Hessian.
    fn edges(&mut self, x: &[f64]) -> Vec<(u32, u32)> {
        self.middles.fill(&self.nodes, x);
        let margin = (WIDER * self.soft_um()).max(NEAR * self.radius_um);
        contacts(&self.nodes, &self.middles, &self.pairs, x, margin, &mut self.contacts);
        let mut edges = Vec::with_capacity(2 * self.nodes.len() + 4 * self.contacts.len());
        for g in 0..self.nodes.len() {
            let next = self.nodes.next[g];
            edges.extend([(g as u32, next), (g as u32, self.nodes.next[next as usize])]);
        }
        for section in &self.sections {
            let members = &self.members[section.from..section.to];
            for (i, (a, _)) in members.iter().enumerate() {
                edges.extend(members[..i].iter().map(|(b, _)| (*a, *b)));
            }
        }
        for contact in &self.contacts {
            let [a, a2, b, b2] = self.nodes_of(contact).map(|g| g as u32);
            edges.extend([(a, b), (a, b2), (a2, b), (a2, b2)]);
        }
        edges
    }

    /// Factorizes a positive definite approximation of the Hessian at `x`, with `damping` times tension over
    /// radius on its diagonal. Returns `false` if there is no memory for the factor.
    pub fn renew(&mut self, x: &[f64], damping: f64) -> bool {
        self.search(x);
        self.middles.fill(&self.nodes, x);
        let soft = WIDER * self.soft_um();
        contacts(&self.nodes, &self.middles, &self.pairs, x, soft, &mut self.contacts);
        let mut factor = self.factor.take();
        if !factor.as_mut().is_some_and(|factor| self.assemble(x, damping, factor)) {
            drop(factor);
            let mut edges = self.edges(x);
            factor = Factor::new(self.nodes.len(), &mut edges);
            contacts(&self.nodes, &self.middles, &self.pairs, x, soft, &mut self.contacts);
            let Some(factor) = &mut factor else { return false };
            self.assemble(x, damping, factor);
        }
        let is_done = factor.as_mut().is_some_and(Factor::factorize);
        self.factor = factor;
        is_done
    }

    /// Applies the inverse of the factorized matrix.
    pub fn solve(&mut self, vector: &mut [f64]) {
        if let Some(factor) = &mut self.factor {
            factor.solve(vector);
        }
    }

    /// Fills the matrix: all terms without the parts of their second derivatives that can be negative.
    /// Returns `false` if it has no place for a block.
    fn assemble(&self, x: &[f64], damping: f64, matrix: &mut Factor) -> bool {
        matrix.clear();
        let smallest = diagonal(damping * self.tension / self.radius_um);
        for (c, chain) in self.cloth.chains.iter().enumerate() {
            let (first, n) = (self.nodes.first[c], chain.points_um.len());
            let (x, period) = (&x[3 * first..3 * (first + n)], self.nodes.period[c]);
            let (pull, _) = pull(chain, period, x);
            let rest = rest_um(chain, period);
            let alike = ALIKE * chain.tension / rest;
            let bend = chain.bending / (rest * rest * rest);
            let mut before = edge(x, period, n - 1).1;
            let mut this = edge(x, period, 0);
            for i in 0..n {
                let after = edge(x, period, (i + 1) % n);
                let ((d, l), (d2, l2)) = (this, after);
                let three = [first + i, first + (i + 1) % n, first + (i + 2) % n];
                matrix.add(three[0], three[0], &smallest);
                // Of a force f along an element, f / l across it.
                let across = (pull + alike * (2.0 * l - before - l2)).max(0.0) / l;
                let (t, t2) = (d.map(|d| d / l), d2.map(|d| d / l2));
                let along = sum(&diagonal(across), &scaled(t, t, -across));
                let against = along.map(|row| row.map(|v| -v));
                matrix.add(three[0], three[0], &along);
                matrix.add(three[1], three[1], &along);
                matrix.add(three[0], three[1], &against);
                // Derivatives of l - l2 and of the curve by the three nodes.
                let of_lengths = [t.map(|t| -t), [0, 1, 2].map(|k| t[k] + t2[k]), t2.map(|t| -t)];
                let of_curve = [1.0, -2.0, 1.0];
                for a in 0..3 {
                    for b in a..3 {
                        let lengths = scaled(of_lengths[a], of_lengths[b], alike);
                        let block = sum(&lengths, &diagonal(bend * of_curve[a] * of_curve[b]));
                        matrix.add(three[a], three[b], &block);
                    }
                }
                (before, this) = (l, after);
            }
        }
        for section in &self.sections {
            let members = &self.members[section.from..section.to];
            let count = members.len() as f64;
            let hold = section.hold.map_or([[0.0; 3]; 3], |hold| {
                let mean = section_mean(members, x);
                let off = hold.across[0] * mean[0] + hold.across[1] * mean[1] - hold.line_um;
                let across = [hold.across[0], hold.across[1], 0.0];
                scaled(across, across, hold.energy(off, section.length_um)[2] / (count * count))
            });
            for (i, (a, _)) in members.iter().enumerate() {
                for (b, _) in &members[..=i] {
                    let own = if a == b { section.stiffness } else { 0.0 };
                    let block = sum(&hold, &diagonal(own - section.stiffness / count));
                    matrix.add(*a as usize, *b as usize, &block);
                }
            }
        }
        if let Some(thickness) = self.cloth.thickness_um {
            for g in 0..self.nodes.len() {
                if x[3 * g + 2].abs() + self.nodes.radius[g] > 0.5 * thickness {
                    matrix.add(g, g, &scaled([0.0, 0.0, 1.0], [0.0, 0.0, 1.0], self.stiffness));
                }
            }
        }
        let soft = WIDER * self.soft_um();
        self.contacts.iter().all(|contact| {
            let nodes = self.nodes_of(contact);
            let weights = contact.weights();
            let stiffness = self.stiffness * push(contact.overlap, soft)[2];
            let of = scaled(contact.normal, contact.normal, stiffness);
            let add = |matrix: &mut Factor, a: usize, b: usize| {
                // A pair of an element and its own image shares nodes.
                let twice = if a != b && nodes[a] == nodes[b] { 2.0 } else { 1.0 };
                let factor = twice * weights[a] * weights[b];
                matrix.add(nodes[a], nodes[b], &of.map(|row| row.map(|v| factor * v)))
            };
            (0..4).all(|a| (a..4).all(|b| add(matrix, a, b)))
        })
    }
}

/// Energy of an overlap at stiffness 1, with its derivatives: half its square plus `soft^2 / 6`, with an
/// onset between `-soft` and `soft` in which the stiffness grows linearly.
fn push(overlap: f64, soft: f64) -> [f64; 3] {
    if overlap >= soft {
        return [0.5 * overlap * overlap + soft * soft / 6.0, overlap, 1.0];
    }
    let u = overlap + soft;
    [u * u * u / (12.0 * soft), u * u / (4.0 * soft), u / (2.0 * soft)]
}

/// Mean of the members of a section.
fn section_mean(members: &[(u32, [f64; 2])], x: &[f64]) -> [f64; 3] {
    let mut mean = [0.0; 3];
    for (g, by) in members {
        let p = Nodes::at(x, *g as usize);
        mean = [mean[0] + p[0] + by[0], mean[1] + p[1] + by[1], mean[2] + p[2]];
    }
    mean.map(|v| v / members.len() as f64)
}
