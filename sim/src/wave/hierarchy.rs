//! The coupled system of many bodies by merging groups: a direct solver whose time grows as the number of bodies to the power 1.5.
//!
//! Bodies are halved again and again; the pieces form a binary tree. A group of bodies deals with all others through sites of its own, as a body does: their
//! number is that of the waves that fit around the group, which grows as the root of its area. The response of a group, S, takes what arrives at its
//! sites from outside (u) to what they radiate (s), all multiple scattering inside of it included. Two groups A and B see each other through fewer
//! sites still, those of their common border: `K_AB ~ Z_A^T K'_AB Z_B`, with K' between these sites. From
//!
//! ```text
//! s_A = S_A (u_A + Z_A^T K'_AB Z_B s_B)        s_B = S_B (u_B + Z_B^T K'_BA Z_A s_A)
//! ```
//!
//! follow the strengths of the borders, `p = (Z_A s_A, Z_B s_B)`, from a system of their size, and from them everything else:
//!
//! ```text
//! [ 1              -Z_A S_A Z_A^T K'_AB ] [p_A]   [Z_A S_A u_A]
//! [ -Z_B S_B Z_B^T K'_BA              1 ] [p_B] = [Z_B S_B u_B]
//! ```
//!
//! The union is reduced to its own sites, `s = X (s_A, s_B)` and `(u_A, u_B) = X^T u`, and answers in turn. X and Z are interpolative
//! decompositions ([`interpolate`](super::interpolate)): sites of a group are some of its bodies' sites, all interactions have the one kernel `L_x L_y G`
//! ([`skeleton`](super::skeleton)), and X, K', Z are the same for all fields and polarizations. (Recursive skeletonization: Martinsson and
//! Rokhlin 2005, Ho and Greengard 2012; merged scattering matrices: Bremer, Gillman and Martinsson 2015.)
//!
//! For X, everything outside of a group is tested by points on a curve around it, the rim of the union of discs about its bodies, and by those sites of
//! other bodies that lie inside of this curve (Green's representation: fields on the curve determine those beyond).

use super::C64;
use super::basis::{Basis, gemm};
use super::coupling::Number;
use super::curve::CurvePoint;
use super::interpolate::interpolate;
use super::kernel::MediumKernel;
use super::lu::Lu;
use super::skeleton::{Site, combined};
use faer::{Accum, MatMut, MatRef};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Distance of the curve of tests from the bodies' circles: in wavelengths, and in radii.
const RIM_WAVES: f64 = 1.5;
const RIM_RADII: f64 = 0.2;
/// Points on it over those that resolve the fields there, and the part of the tolerance down to which these are resolved: sites excite fast variations
/// more strongly than slow ones. With too few points the interpolation holds on them and fails between.
const OVERSAMPLING: f64 = 1.8;
const RIM_MARGIN: f64 = 1e-3;

/// Groups at this depth of the tree and above are merged one after the other, each by all threads: side by side they would take more memory.
const SEQUENTIAL: usize = 2;

/// A body as the tree sees it.
pub(crate) struct Leaf<'a> {
    pub sites: &'a [Site],
    /// A circle around its wall: center and radius [um].
    pub center: [f64; 2],
    pub radius: f64,
}

/// The exterior between all bodies.
#[derive(Clone, Copy)]
pub(crate) struct Exterior<'a> {
    pub kernel: &'a MediumKernel,
    pub k_rho: f64,
    /// Tolerance of the interpolations.
    pub tolerance: f64,
}

impl Exterior<'_> {
    fn between(&self, target: &Site, source: &Site) -> C64 {
        combined(self.kernel, self.k_rho, target, source)
    }
}

/// Two groups that make one.
struct Branch<T> {
    children: [usize; 2],
    /// Z of both.
    faces: [Basis<T>; 2],
    /// K'_AB.
    across: Vec<T>,
    /// X of both; none at the root.
    outward: Option<[Basis<T>; 2]>,
}

/// A group.
struct Group<T> {
    depth: usize,
    bodies: Vec<u32>,
    /// Its sites, each as `(body, site)`.
    names: Vec<(u32, u32)>,
    branch: Option<Branch<T>>,
}

/// How the borders of a pair answer to what arrives, for one part of the fields.
struct Merge<T> {
    /// `Z S` of both.
    gathered: [Vec<T>; 2],
    /// The factorized system of the borders.
    lu: Lu<T>,
}

/// The groups of a scene in one precision.
pub(crate) struct Tree<T> {
    groups: Vec<Group<T>>,
}

/// The groups of a scene. Single precision does not serve: coefficients of X grow from level to level, and its rounding with them, to residuals of 4e-5 for 7
/// fibers and 1e-3 for 19 at a tolerance of 4e-10.
pub(crate) type Hierarchy = Tree<C64>;

/// Merges of all groups for one part of the fields, `[group]`.
pub(crate) struct Merges<T>(Vec<Option<Merge<T>>>);

/// The factorized system of one part.
pub(crate) type Factored = Merges<C64>;

/// Memory [bytes].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bytes {
    /// Groups and borders, held already.
    pub plan: f64,
    /// What is kept of each part.
    pub part: f64,
    /// The most that comes on top while a part is factorized.
    pub work: f64,
}

/// Halves groups until bodies are alone: `(depth, bodies, children)`, parents before children.
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

/// What stands for all beyond a group: points on the curve around its bodies, and sites of others inside of it.
fn surroundings(leaves: &[Leaf<'_>], bodies: &[u32], exterior: Exterior<'_>) -> Vec<Site> {
    let own: Vec<&Leaf<'_>> = bodies.iter().map(|&b| &leaves[b as usize]).collect();
    let wavelength = TAU / exterior.k_rho;
    let mean = own.iter().map(|l| l.radius).sum::<f64>() / own.len() as f64;
    let off = RIM_WAVES * wavelength + RIM_RADII * mean;
    let within = |p: [f64; 2], leaf: &Leaf<'_>| {
        (p[0] - leaf.center[0]).powi(2) + (p[1] - leaf.center[1]).powi(2) < (leaf.radius + off).powi(2)
    };
    // Waves that vary along the curve as fast as k_t decay on their way there by exp(-sqrt(k_t^2 - k^2) off).
    let fastest = exterior.k_rho.hypot((1.0 / (RIM_MARGIN * exterior.tolerance)).ln() / off);
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

/// A group's number, the names of the sites on its rim, and what it was merged by.
type Made<T> = (usize, Vec<(u32, u32)>, Branch<T>);

impl<T: Number> Tree<T> {
    /// Finds groups and borders.
    pub(crate) fn plan(leaves: &[Leaf<'_>], exterior: Exterior<'_>) -> Self {
        let shape = halves(leaves);
        let deepest = shape.iter().map(|g| g.0).max().unwrap_or(0);
        let mut groups: Vec<Group<T>> = shape
            .iter()
            .map(|(depth, bodies, children)| {
                let sites = |b: u32| (0..leaves[b as usize].sites.len() as u32).map(move |j| (b, j));
                let names = if children.is_none() { sites(bodies[0]).collect() } else { Vec::new() };
                Group { depth: *depth, bodies: bodies.clone(), names, branch: None }
            })
            .collect();
        let site = |name: &(u32, u32)| leaves[name.0 as usize].sites[name.1 as usize];
        for depth in (0..deepest).rev() {
            let made: Vec<Made<T>> = (0..groups.len())
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
                        interpolate(targets.len(), sources.len(), column, exterior.tolerance, seed, guess)
                    };
                    let faces = [face(0), face(1)];
                    let across: Vec<T> = faces[1]
                        .kept
                        .iter()
                        .flat_map(|&j| faces[0].kept.iter().map(move |&i| (i, j)))
                        .map(|(i, j)| T::round(exterior.between(&sites[0][i], &sites[1][j])))
                        .collect();
                    let joined: Vec<Site> = sites.iter().flatten().copied().collect();
                    let mut names = Vec::new();
                    let outward = (depth > 0).then(|| {
                        let tests = surroundings(leaves, &groups[g].bodies, exterior);
                        let column = |j: usize, out: &mut [C64]| {
                            for (out, target) in out.iter_mut().zip(&tests) {
                                *out = exterior.between(target, &joined[j]);
                            }
                        };
                        let guess = joined.len() * 4 / 5;
                        let seed = 3 * g as u64 + 2;
                        let x = interpolate(tests.len(), joined.len(), column, exterior.tolerance, seed, guess);
                        let name = |&j: &usize| if j < a.len() { a[j] } else { b[j - a.len()] };
                        names = x.kept.iter().map(name).collect();
                        [Basis::of(&x, 0, a.len()), Basis::of(&x, a.len(), b.len())]
                    });
                    let faces = [0, 1].map(|k| Basis::of(&faces[k], 0, sites[k].len()));
                    (g, names, Branch { children, faces, across, outward })
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
        let border = |g: &Group<T>| g.branch.as_ref().map_or(0, |b| b.faces[0].outputs + b.faces[1].outputs);
        [group, self.groups.iter().map(border).max().unwrap_or(0)]
    }

    /// Memory of systems of `fields` each.
    pub(crate) fn bytes(&self, fields: usize) -> Bytes {
        let each = size_of::<T>() as f64;
        let (mut plan, mut part, mut work) = (0.0, 0.0, 0.0f64);
        let deepest = self.groups.iter().map(|g| g.depth).max().unwrap_or(0);
        for depth in 0..=deepest {
            let (mut before, mut after, mut largest) = (0.0, 0.0, 0.0f64);
            for group in self.groups.iter().filter(|g| g.depth == depth) {
                let n = group.names.len() as f64;
                after += n * n;
                let Some(branch) = &group.branch else { continue };
                plan += branch.across.len() as f64 * each;
                plan +=
                    branch.faces.iter().chain(branch.outward.iter().flatten()).map(Basis::bytes).sum::<usize>() as f64;
                let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
                    branch.faces.iter().map(|z| f(z.inputs as f64, z.outputs as f64)).sum()
                };
                let r = sum(&|_, r| r);
                let gathered = sum(&|m, r| m * r);
                part += gathered + r * r;
                before += sum(&|m, _| m * m);
                // Until the borders are solved, and after.
                let wide = 0.5 * sum(&|m, _| m);
                largest = largest.max(gathered + r * r + 2.0 * r * n + 1.4 * wide * n);
            }
            let at_once = if depth <= SEQUENTIAL { 1.0 } else { 2.0 };
            work = work.max(before.max(after) + 0.5 * before.min(after) + at_once * largest);
        }
        let each = each * (fields * fields) as f64;
        Bytes { plan, part: each * part, work: each * work }
    }

    /// Merges all groups for bodies that answer as `transfer` tells, `fields k` square.
    pub(crate) fn factorize(&self, fields: usize, transfer: &(dyn Fn(usize) -> Vec<C64> + Sync)) -> Merges<T> {
        let groups = &self.groups;
        let deepest = groups.iter().map(|g| g.depth).max().unwrap_or(0);
        let mut responses: Vec<Option<Vec<T>>> = groups.iter().map(|_| None).collect();
        let mut merges: Vec<Option<Merge<T>>> = groups.iter().map(|_| None).collect();
        let make = |g: usize, responses: &[Option<Vec<T>>]| match &groups[g].branch {
            None => (transfer(groups[g].bodies[0] as usize).into_iter().map(T::round).collect(), None),
            Some(branch) => {
                let inner = branch.children.map(|c| responses[c].as_deref().expect("children come before parents"));
                let (response, merge) = branch.merge(inner, fields);
                (response, Some(merge))
            }
        };
        for depth in (0..=deepest).rev() {
            let own: Vec<usize> = (0..groups.len()).filter(|&g| groups[g].depth == depth).collect();
            // Large groups one after the other, on all threads; small ones side by side.
            for some in own.chunks(if depth <= SEQUENTIAL { 1 } else { own.len().max(1) }) {
                let made: Vec<(Vec<T>, Option<Merge<T>>)> = match some {
                    [g] => vec![make(*g, &responses)],
                    _ => some.par_iter().map(|&g| make(g, &responses)).collect(),
                };
                for (&g, (response, merge)) in some.iter().zip(made) {
                    responses[g] = Some(response);
                    merges[g] = merge;
                    if let Some(branch) = &groups[g].branch {
                        branch.children.iter().for_each(|&c| responses[c] = None);
                    }
                }
            }
        }
        Merges(merges)
    }

    /// From the external fields at all bodies' sites to all that arrives there, in place (as [`Coupling::solve`](super::coupling::Coupling::solve)).
    pub(crate) fn solve(&self, merges: &Merges<T>, fields: usize, v: &mut [Vec<C64>]) {
        let counts: Vec<usize> = v.iter().map(Vec::len).collect();
        let mut arrived: Vec<Option<Vec<T>>> = self.groups.iter().map(|_| None).collect();
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
            let mut inner = match (&branch.outward, arrived[g].take()) {
                (Some(outward), Some(u)) => [0, 1].map(|k| {
                    let mut out = vec![T::round(C64::ZERO); fields * outward[k].inputs * columns];
                    outward[k].spread(&mut out, &u, columns, fields);
                    out
                }),
                // At the root all comes from outside.
                _ => branch.children.map(|c| {
                    let names = &self.groups[c].names;
                    let at = |column: usize, field: usize, &(b, j): &(u32, u32)| {
                        let k = sites[b as usize];
                        T::round(v[b as usize][(column * fields + field) * k + j as usize])
                    };
                    (0..columns)
                        .flat_map(|column| (0..fields).map(move |field| (column, field)))
                        .flat_map(|(column, field)| names.iter().map(move |name| at(column, field, name)))
                        .collect()
                }),
            };
            if let Some(merge) = &merges.0[g] {
                branch.arrive(merge, &mut inner, columns, fields);
            }
            for (values, &child) in inner.into_iter().zip(&branch.children) {
                arrived[child] = Some(values);
            }
        }
        for (group, values) in self.groups.iter().zip(arrived) {
            if let Some(values) = values {
                v[group.bodies[0] as usize] = values.into_iter().map(T::wide).collect();
            }
        }
    }
}

impl<T: Number> Branch<T> {
    /// `out += K'_AB b` of every field, or with K'_BA where `own` is 1.
    fn cross(&self, own: usize, out: MatMut<'_, T>, b: MatRef<'_, T>, fields: usize) {
        let [ra, rb] = [0, 1].map(|k| self.faces[k].outputs);
        let k = MatRef::from_column_major_slice(&self.across, ra, rb);
        let k = if own == 0 { k } else { k.transpose() };
        let mut out = out;
        for field in 0..fields {
            let rows = out.as_mut().subrows_mut(field * k.nrows(), k.nrows());
            gemm(rows, Accum::Add, k, b.subrows(field * k.ncols(), k.ncols()), T::round(C64::ONE));
        }
    }

    /// The response of the union and what solves need, from those of the children.
    fn merge(&self, inner: [&[T]; 2], fields: usize) -> (Vec<T>, Merge<T>) {
        let (zero, one) = (T::round(C64::ZERO), T::round(C64::ONE));
        let f = fields;
        let r = self.faces.each_ref().map(|z| f * z.outputs);
        let m = self.faces.each_ref().map(|z| f * z.inputs);
        let border = r[0] + r[1];
        let gathered: [Vec<T>; 2] = [0, 1].map(|k| {
            let mut out = vec![zero; r[k] * m[k]];
            self.faces[k].left(&mut out, inner[k], m[k], f);
            out
        });
        // The system of the borders.
        let mut system = vec![zero; border * border];
        for k in 0..2 {
            let mut own = vec![zero; r[k] * r[k]];
            self.faces[k].right(&mut own, &gathered[k], r[k], f);
            let own = MatRef::from_column_major_slice(&own, r[k], r[k]);
            let across = MatRef::from_column_major_slice(&self.across, r[0] / f, r[1] / f);
            let across = if k == 0 { across } else { across.transpose() };
            let (rows, columns) = if k == 0 { (0, r[0]) } else { (r[0], 0) };
            for field in 0..f {
                let (n, wide) = (r[k] / f, r[1 - k] / f);
                gemm(
                    MatMut::from_column_major_slice_mut(&mut system, border, border).submatrix_mut(
                        rows,
                        columns + field * wide,
                        r[k],
                        wide,
                    ),
                    Accum::Replace,
                    own.subcols(field * n, n),
                    across,
                    T::round(-C64::ONE),
                );
            }
        }
        for j in 0..border {
            system[j * border + j] = one;
        }
        let lu = Lu::new(system, border);
        let Some(outward) = &self.outward else {
            return (Vec::new(), Merge { gathered, lu });
        };
        let n = f * outward[0].outputs;
        // Strengths of the borders for a unit at each site of the union.
        let mut border_strengths = vec![zero; border * n];
        let mut first = 0;
        for k in 0..2 {
            let mut own = vec![zero; r[k] * n];
            outward[k].right(&mut own, &gathered[k], r[k], f);
            for (out, own) in border_strengths.chunks_mut(border).zip(own.chunks(r[k])) {
                out[first..first + r[k]].copy_from_slice(own);
            }
            first += r[k];
        }
        lu.solve(MatMut::from_column_major_slice_mut(&mut border_strengths, border, n));
        let mut response = vec![zero; n * n];
        let strengths = MatRef::from_column_major_slice(&border_strengths, border, n);
        for k in 0..2 {
            // X S X^T
            let mut seen = vec![zero; m[k] * n];
            outward[k].right(&mut seen, inner[k], m[k], f);
            outward[k].left(&mut response, &seen, n, f);
            drop(seen);
            // What the other's border makes arrive, through X S Z^T.
            let mut crossed = vec![zero; r[k] * n];
            let from = if k == 0 { strengths.subrows(r[0], r[1]) } else { strengths.subrows(0, r[0]) };
            self.cross(k, MatMut::from_column_major_slice_mut(&mut crossed, r[k], n), from, f);
            let mut behind = vec![zero; m[k] * r[k]];
            self.faces[k].right(&mut behind, inner[k], m[k], f);
            let mut radiated = vec![zero; n * r[k]];
            outward[k].left(&mut radiated, &behind, r[k], f);
            drop(behind);
            gemm(
                MatMut::from_column_major_slice_mut(&mut response, n, n),
                Accum::Add,
                MatRef::from_column_major_slice(&radiated, n, r[k]),
                MatRef::from_column_major_slice(&crossed, r[k], n),
                one,
            );
        }
        (response, Merge { gathered, lu })
    }

    /// Adds to what arrives at both children from outside what they send each other.
    fn arrive(&self, merge: &Merge<T>, inner: &mut [Vec<T>; 2], columns: usize, fields: usize) {
        let zero = T::round(C64::ZERO);
        let r = self.faces.each_ref().map(|z| fields * z.outputs);
        let m = self.faces.each_ref().map(|z| fields * z.inputs);
        let border = r[0] + r[1];
        let mut strengths = vec![zero; border * columns];
        let mut first = 0;
        for k in 0..2 {
            gemm(
                MatMut::from_column_major_slice_mut(&mut strengths, border, columns).subrows_mut(first, r[k]),
                Accum::Replace,
                MatRef::from_column_major_slice(&merge.gathered[k], r[k], m[k]),
                MatRef::from_column_major_slice(&inner[k], m[k], columns),
                T::round(C64::ONE),
            );
            first += r[k];
        }
        merge.lu.solve(MatMut::from_column_major_slice_mut(&mut strengths, border, columns));
        let strengths = MatRef::from_column_major_slice(&strengths, border, columns);
        for k in 0..2 {
            let from = if k == 0 { strengths.subrows(r[0], r[1]) } else { strengths.subrows(0, r[0]) };
            let mut crossed = vec![zero; r[k] * columns];
            self.cross(k, MatMut::from_column_major_slice_mut(&mut crossed, r[k], columns), from, fields);
            self.faces[k].spread(&mut inner[k], &crossed, columns, fields);
        }
    }
}
