//! Solver of the coupled system of many bodies by merging groups: a direct solver whose time grows as the
//! number of bodies to the power 1.5.
//!
//! Bodies are halved recursively; the pieces form a binary tree. A group of bodies interacts with all others
//! through its own sites, as a body does: their number is that of the waves that fit around the group, which
//! grows as the root of its area. The response of a group, S, maps the fields that arrive at its sites from
//! outside (u) to the strengths that they radiate (s), including all multiple scattering inside. Two groups A
//! and B interact through even fewer sites, those of their common border: `K_AB ~ Z_A^T K'_AB Z_B`, with K'
//! between these sites. From
//!
//! ```text
//! s_A = S_A (u_A + Z_A^T K'_AB Z_B s_B)        s_B = S_B (u_B + Z_B^T K'_BA Z_A s_A)
//! ```
//!
//! follow the strengths of the borders, `p = (Z_A s_A, Z_B s_B)`, from a system of their size, and from them
//! everything else:
//!
//! ```text
//! [ 1              -Z_A S_A Z_A^T K'_AB ] [p_A]   [Z_A S_A u_A]
//! [ -Z_B S_B Z_B^T K'_BA              1 ] [p_B] = [Z_B S_B u_B]
//! ```
//!
//! (in [`merge`](crate::many::merge)). The union is reduced to its own sites, `s = X (s_A, s_B)` and
//! `(u_A, u_B) = X^T u`, and is merged in turn. X and Z are interpolative decompositions
//! ([`interpolate`](crate::many::interpolate)): sites of a group are some of its bodies' sites, all
//! interactions have the one kernel `L_x L_y G` ([`skeleton`](crate::many::skeleton)), and X, K', Z are the
//! same for all fields and polarizations. (Recursive skeletonization: Martinsson and Rokhlin 2005, Ho and
//! Greengard 2012; merged scattering matrices: Bremer, Gillman and Martinsson 2015.)
//!
//! For X, everything outside of a group is tested by points on a curve around it, the rim of the union of
//! discs about its bodies, and by those sites of other bodies that lie inside of this curve (Green's
//! representation: fields on the curve determine those beyond).

use crate::C64;
use crate::many::basis::Basis;
use crate::many::interpolate::interpolate;
use crate::many::merge::{Branch, Merge};
use crate::many::skeleton::{Exterior, Site};
use crate::scene::curve::CurvePoint;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Distance of the curve of tests from the bodies' circles: in wavelengths, and in radii.
const RIM_WAVES: f64 = 1.5;
const RIM_RADII: f64 = 0.2;
/// Points on the curve over those that resolve the fields there, and the part of the tolerance down to which
/// these are resolved: sites excite fast variations more strongly than slow ones. With too few points the
/// interpolation is accurate on them but fails between.
const OVERSAMPLING: f64 = 1.8;
const RIM_MARGIN: f64 = 1e-3;

/// Depth of the tree above which the halves of groups are computed one after the other, each by all threads:
/// in parallel they would take more memory.
const SEQUENTIAL: usize = 2;

/// A body as a leaf of the tree.
pub(crate) struct Leaf<'a> {
    pub sites: &'a [Site],
    /// A circle around its wall: center and radius [um].
    pub center: [f64; 2],
    pub radius: f64,
}

/// A group.
struct Group {
    depth: usize,
    bodies: Vec<u32>,
    /// Its sites, each as `(body, site)`.
    names: Vec<(u32, u32)>,
    branch: Option<Branch>,
}

/// A part during merging.
struct UnderWay<'a> {
    fields: usize,
    exterior: Exterior<'a>,
    transfer: &'a (dyn Fn(usize) -> Vec<C64> + Sync),
    merges: Vec<OnceLock<Merge>>,
}

/// The groups of a scene. Single precision does not suffice: coefficients of X grow from level to level, and
/// its rounding with them, to residuals of 4e-5 for 7 fibers and 1e-3 for 19 at a tolerance of 4e-10.
pub(crate) struct Hierarchy {
    groups: Vec<Group>,
}

/// The factorized system of one part of the fields: merges of all groups, `[group]`.
pub(crate) struct Factored(Vec<OnceLock<Merge>>);

/// Memory [bytes].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bytes {
    /// Groups and borders, already held.
    pub plan: f64,
    /// Stored data of each part.
    pub part: f64,
    /// Peak of additional memory while a part is factorized.
    pub work: f64,
}

/// Halves groups down to single bodies: `(depth, bodies, children)`, parents before children.
fn halves(leaves: &[Leaf<'_>]) -> Vec<(usize, Vec<u32>, Option<[usize; 2]>)> {
    let mut all = vec![(0, (0..leaves.len() as u32).collect::<Vec<u32>>(), None)];
    let mut at = 0;
    while at < all.len() {
        let (depth, bodies) = (all[at].0, all[at].1.clone());
        if bodies.len() > 1 {
            let place = |b: &u32, k: usize| leaves[*b as usize].center[k];
            let width = |k: usize| {
                let (low, high) =
                    bodies.iter().fold((f64::MAX, f64::MIN), |(l, h), b| (l.min(place(b, k)), h.max(place(b, k))));
                high - low
            };
            let axis = if width(0) >= width(1) { 0 } else { 1 };
            let mut sorted = bodies.clone();
            sorted.sort_by(|a, b| place(a, axis).total_cmp(&place(b, axis)).then(a.cmp(b)));
            let right = sorted.split_off(sorted.len() / 2);
            all[at].2 = Some([all.len(), all.len() + 1]);
            all.push((depth + 1, sorted, None));
            all.push((depth + 1, right, None));
        }
        at += 1;
    }
    all
}

/// Test points that represent everything outside of a group: points on the curve around its bodies, and sites
/// of others inside of it.
fn surroundings(leaves: &[Leaf<'_>], bodies: &[u32], exterior: Exterior<'_>, tolerance: f64) -> Vec<Site> {
    let own: Vec<&Leaf<'_>> = bodies.iter().map(|&b| &leaves[b as usize]).collect();
    let wavelength = TAU / exterior.k_rho;
    let mean = own.iter().map(|l| l.radius).sum::<f64>() / own.len() as f64;
    let off = RIM_WAVES * wavelength + RIM_RADII * mean;
    let within = |p: [f64; 2], leaf: &Leaf<'_>| {
        (p[0] - leaf.center[0]).powi(2) + (p[1] - leaf.center[1]).powi(2) < (leaf.radius + off).powi(2)
    };
    // Waves that vary along the curve as fast as k_t decay on their way there by exp(-sqrt(k_t^2 - k^2) off).
    let fastest = exterior.k_rho.hypot((1.0 / (RIM_MARGIN * tolerance)).ln() / off);
    let mut tests = Vec::new();
    for (b, leaf) in own.iter().enumerate() {
        let radius = leaf.radius + off;
        let count = (OVERSAMPLING * 2.0 * radius * fastest).ceil() as usize + 8;
        let scale = (TAU * radius / count as f64).sqrt();
        let reach = |other: &Leaf<'_>| {
            let apart = (other.center[0] - leaf.center[0]).hypot(other.center[1] - leaf.center[1]);
            apart < radius + other.radius + off
        };
        let near: Vec<&&Leaf<'_>> =
            own.iter().enumerate().filter(|(c, o)| *c != b && reach(o)).map(|(_, o)| o).collect();
        for j in 0..count {
            let (sin, cos) = (TAU * j as f64 / count as f64).sin_cos();
            let at = [leaf.center[0] + radius * cos, leaf.center[1] + radius * sin];
            if !near.iter().any(|o| within(at, o)) {
                let point = CurvePoint { at, normal: [cos, sin], speed: radius, curvature: 1.0 / radius };
                tests.push(Site { point, scale });
            }
        }
    }
    let mut inside = vec![false; leaves.len()];
    bodies.iter().for_each(|&b| inside[b as usize] = true);
    for leaf in leaves.iter().zip(&inside).filter(|(_, inside)| !**inside).map(|(l, _)| l) {
        let near: Vec<&&Leaf<'_>> = own
            .iter()
            .filter(|o| {
                (o.center[0] - leaf.center[0]).hypot(o.center[1] - leaf.center[1]) < o.radius + off + leaf.radius
            })
            .collect();
        if !near.is_empty() {
            tests.extend(leaf.sites.iter().filter(|s| near.iter().any(|o| within(s.point.at, o))));
        }
    }
    tests
}

/// A group's number, the names of the sites on its rim, and its merge.
type Made = (usize, Vec<(u32, u32)>, Branch);

impl Hierarchy {
    /// Finds groups and borders, with interpolations to a tolerance.
    pub(crate) fn plan(leaves: &[Leaf<'_>], exterior: Exterior<'_>, tolerance: f64) -> Self {
        let shape = halves(leaves);
        let deepest = shape.iter().map(|g| g.0).max().unwrap_or(0);
        let mut groups: Vec<Group> = shape
            .iter()
            .map(|(depth, bodies, children)| {
                let sites = |b: u32| (0..leaves[b as usize].sites.len() as u32).map(move |j| (b, j));
                let names = if children.is_none() { sites(bodies[0]).collect() } else { Vec::new() };
                Group { depth: *depth, bodies: bodies.clone(), names, branch: None }
            })
            .collect();
        let site = |name: &(u32, u32)| leaves[name.0 as usize].sites[name.1 as usize];
        for depth in (0..deepest).rev() {
            let made: Vec<Made> = (0..groups.len())
                .into_par_iter()
                .filter(|&g| groups[g].depth == depth)
                .filter_map(|g| shape[g].2.map(|children| (g, children)))
                .map(|(g, children)| {
                    let [a, b] = children.map(|c| groups[c].names.as_slice());
                    let sites: [Vec<Site>; 2] = [a, b].map(|names| names.iter().map(site).collect());
                    let face = |own: usize| {
                        let (sources, targets) = (&sites[own], &sites[1 - own]);
                        let column = |j: usize, out: &mut [C64]| {
                            for (out, target) in out.iter_mut().zip(targets) {
                                *out = exterior.between(target, &sources[j]);
                            }
                        };
                        let guess = sources.len().min(targets.len()) / 2;
                        let seed = 3 * g as u64 + own as u64;
                        interpolate(targets.len(), sources.len(), column, tolerance, seed, guess)
                    };
                    let faces = [face(0), face(1)];
                    let border = |k: usize| faces[k].retained.iter().map(|&j| sites[k][j]).collect();
                    let borders = [border(0), border(1)];
                    let joined: Vec<Site> = sites.iter().flatten().copied().collect();
                    let mut names = Vec::new();
                    let outward = (depth > 0).then(|| {
                        let tests = surroundings(leaves, &groups[g].bodies, exterior, tolerance);
                        let column = |j: usize, out: &mut [C64]| {
                            for (out, target) in out.iter_mut().zip(&tests) {
                                *out = exterior.between(target, &joined[j]);
                            }
                        };
                        let guess = joined.len() * 4 / 5;
                        let seed = 3 * g as u64 + 2;
                        let x = interpolate(tests.len(), joined.len(), column, tolerance, seed, guess);
                        let name = |&j: &usize| if j < a.len() { a[j] } else { b[j - a.len()] };
                        names = x.retained.iter().map(name).collect();
                        [Basis::from_interpolation(&x, 0, a.len()), Basis::from_interpolation(&x, a.len(), b.len())]
                    });
                    let faces = [0, 1].map(|k| Basis::from_interpolation(&faces[k], 0, sites[k].len()));
                    (g, names, Branch { children, faces, borders, outward })
                })
                .collect();
            for (g, names, branch) in made {
                groups[g].names = names;
                groups[g].branch = Some(branch);
            }
        }
        Self { groups }
    }

    /// Sites of the largest group and of the largest border.
    #[cfg(test)]
    pub(crate) fn largest(&self) -> [usize; 2] {
        let group = self.groups.iter().map(|g| g.names.len()).max().unwrap_or(0);
        let border = |g: &Group| g.branch.as_ref().map_or(0, |b| b.faces[0].outputs + b.faces[1].outputs);
        [group, self.groups.iter().map(border).max().unwrap_or(0)]
    }

    /// Memory of systems of `fields` each.
    pub(crate) fn bytes(&self, fields: usize) -> Bytes {
        let plan = self.groups.iter().filter_map(|g| g.branch.as_ref()).map(Branch::bytes).sum::<usize>() as f64;
        let [peak, part, _] = self.peak_count(0, None, fields as f64);
        let each = size_of::<C64>() as f64;
        Bytes { plan, part: each * part, work: each * (peak - part) }
    }

    /// Z of the halves if nothing else is needed of them.
    fn through<'a>(&self, branch: &'a Branch) -> [Option<&'a Basis>; 2] {
        branch.faces.each_ref().map(|z| branch.outward.is_none().then_some(z))
    }

    /// Peak count of numbers during the merge of a group, numbers stored for solves, and numbers of its
    /// response.
    fn peak_count(&self, g: usize, face: Option<&Basis>, fields: f64) -> [f64; 3] {
        let group = &self.groups[g];
        let n = fields * group.names.len() as f64;
        let response = n * face.map_or(n, |z| fields * z.outputs as f64);
        let Some(branch) = &group.branch else { return [n * n + response, 0.0, response] };
        let through = self.through(branch);
        let [[first, stored, held], [second, also, _]] =
            [0, 1].map(|k| self.peak_count(branch.children[k], through[k], fields));
        // Halvings after which every thread has its own group.
        let halvings = rayon::current_num_threads().next_power_of_two().ilog2() as usize;
        let side_by_side = (SEQUENTIAL..SEQUENTIAL + halvings).contains(&group.depth);
        let children = if side_by_side { first + second } else { first.max(stored + held + second) };
        let [merging, own] = branch.numbers(face, fields);
        [children.max(stored + also + merging), stored + also + own, response]
    }

    /// Merges all groups for bodies with the responses `transfer`, `fields k` square.
    pub(crate) fn factorize(
        &self,
        fields: usize,
        exterior: Exterior<'_>,
        transfer: &(dyn Fn(usize) -> Vec<C64> + Sync),
    ) -> Factored {
        let under_way =
            UnderWay { fields, exterior, transfer, merges: self.groups.iter().map(|_| OnceLock::new()).collect() };
        self.respond(0, None, &under_way);
        Factored(under_way.merges)
    }

    /// The response of a group, one half after the other, so that few are held at once; with a `face`, the
    /// response through it; at the root nothing.
    fn respond(&self, g: usize, face: Option<&Basis>, under_way: &UnderWay<'_>) -> Vec<C64> {
        let (fields, exterior) = (under_way.fields, under_way.exterior);
        let group = &self.groups[g];
        let Some(branch) = &group.branch else {
            let transfer = (under_way.transfer)(group.bodies[0] as usize);
            return match face {
                None => transfer,
                Some(z) => Branch::face(z, &transfer, fields),
            };
        };
        let through = self.through(branch);
        let half = |k: usize| self.respond(branch.children[k], through[k], under_way);
        let inner = if group.depth < SEQUENTIAL {
            [half(0), half(1)]
        } else {
            let (a, b) = rayon::join(|| half(0), || half(1));
            [a, b]
        };
        let (response, merge) = match &branch.outward {
            None => (Vec::new(), Merge::Root(branch.root(inner, fields, exterior))),
            Some(outward) => {
                let (response, sent) = branch.merge(outward, inner, face, fields, exterior);
                (response, Merge::Inner(sent))
            }
        };
        // A group is merged once.
        under_way.merges[g].get_or_init(|| merge);
        response
    }

    /// Replaces the external fields at all bodies' sites by all arriving fields (as
    /// [`Coupling::solve`](crate::many::coupling::Coupling::solve)).
    pub(crate) fn solve(&self, merges: &Factored, fields: usize, exterior: Exterior<'_>, v: &mut [Vec<C64>]) {
        let counts: Vec<usize> = v.iter().map(Vec::len).collect();
        let mut arrived: Vec<Option<Vec<C64>>> = self.groups.iter().map(|_| None).collect();
        let sites: Vec<usize> = {
            let mut sites = vec![0; v.len()];
            for group in self.groups.iter().filter(|g| g.branch.is_none()) {
                sites[group.bodies[0] as usize] = group.names.len();
            }
            sites
        };
        let columns = counts[0] / (fields * sites[0]);
        // Parents come before children.
        for (g, group) in self.groups.iter().enumerate() {
            let Some(branch) = &group.branch else { continue };
            let inner = match merges.0[g].get() {
                Some(Merge::Inner(sent)) => match arrived[g].take() {
                    Some(u) => branch.arrive(sent, &u, columns, fields),
                    None => continue,
                },
                // At the root all fields come from outside.
                Some(Merge::Root(root)) => {
                    let outside = branch.children.map(|c| {
                        let names = &self.groups[c].names;
                        let at = |column: usize, field: usize, &(b, j): &(u32, u32)| {
                            let k = sites[b as usize];
                            v[b as usize][(column * fields + field) * k + j as usize]
                        };
                        (0..columns)
                            .flat_map(|column| (0..fields).map(move |field| (column, field)))
                            .flat_map(|(column, field)| names.iter().map(move |name| at(column, field, name)))
                            .collect()
                    });
                    branch.arrive_at_root(root, outside, columns, fields, exterior)
                }
                None => continue,
            };
            for (values, &child) in inner.into_iter().zip(&branch.children) {
                arrived[child] = Some(values);
            }
        }
        for (group, values) in self.groups.iter().zip(arrived) {
            if let Some(values) = values {
                v[group.bodies[0] as usize] = values;
            }
        }
    }
}
