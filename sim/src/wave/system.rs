//! The boundary integral equations of walls between media, assembled and factorized.
//!
//! Unknowns on every wall are the four continuous fields of [`wave`](super): `e`, `P = (k_0 eps d_n e + k_z d_t h)/kappa^2`, `h` and
//! `Q = (k_0 d_n h - k_z d_t e)/kappa^2`, all of the unit of e. With the single layer S, its adjoint double layer K' and double layer K of a medium's Green
//! function G, Green's representation of both fields, `u = +-(K u - S d_n u)`, with `d_n e = (kappa^2 P - k_z d_t h)/(k_0 eps)` put in and tangential
//! derivatives moved onto G by parts, reads (upper sign: the medium lies outside of the wall)
//!
//! ```text
//! eps e = +-[eps K e - (kappa^2/k_0) S P - (k_z/k_0) A h]                              A(x, y)  = d_t(y) G
//!     h = +-[    K h - (kappa^2/k_0) S Q + (k_z/k_0) A e]                              A'(x, y) = d_t(x) G
//!     P = +-[-K' P - (W/k_0 - k_0 eps n.n' S) e - (k_z/k_0) A' Q + k_z t.n' S h]       W(x, y)  = d_t(x) d_t(y) G
//! eps Q = +-[-eps K' Q - (W/k_0 - k_0 eps n.n' S) h + (k_z/k_0) A' P - k_z eps t.n' S e]
//! ```
//!
//! In P the hypersingular operators of e and h meet with the factors `k_0 eps/kappa^2` and `-k_z^2/(k_0 kappa^2)`, whose sum is 1/k_0 in every medium, and
//! `d_t K + K' d_t = kappa^2 t.S n'` removes what else has 1/kappa^2. So with these weights the sum of the equations from both sides of a wall holds
//! only differences of W, A, A' and S between the media, all weakly singular or smooth: a Fredholm system of the second kind at every incidence,
//! with `(eps_o + eps_i)/2, 1, 1, (eps_o + eps_i)/2` on its diagonal (Müller's choice, here for 2.5 dimensions). At normal incidence (e, P) and (h, Q)
//! part into two systems.
//!
//! Quadrature: trapezoidal rule on periodic nodes, the logarithm by Kussmaul and Martensen (see [`kernel`](super::kernel)). Targets close to another wall see it
//! through finer nodes, on which the density is interpolated by trigonometric polynomials.

use super::curve::{Curve, CurvePoint, Resolution};
use super::kernel::{Medium, MediumKernel, Radial, WallKernel, log_weights};
use super::symmetry::Group;
use super::{Body, C64, Wave, WaveError, memory};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::linalg::matmul::matmul;
use faer::perm::PermRef;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Least tolerance that is promised.
const LEAST_TOLERANCE: f64 = 1e-12;
/// Rows of a system whose residual is computed.
const WITNESSES: usize = 64;
/// Half width of the window in which a close wall is refined, in its nodes.
pub(crate) const WINDOW_NODES: f64 = 12.0;
/// Most nodes a close wall's node is refined to.
pub(crate) const FINEST: f64 = 64.0;

/// Components in the order of unknowns at a node.
pub(crate) const COMPONENTS: usize = 4;
/// Index of e, P, h, Q.
pub(crate) const E: usize = 0;
pub(crate) const P: usize = 1;
pub(crate) const H: usize = 2;
pub(crate) const Q: usize = 3;

/// Kernel values at a pair: row component by column component.
type Entries = [[C64; COMPONENTS]; COMPONENTS];

/// Parallelism of faer's routines: the pool this runs in.
pub(crate) fn par() -> Par {
    if rayon::current_num_threads() > 1 { Par::rayon(0) } else { Par::Seq }
}

/// A wall, its place among the nodes and its media.
pub(crate) struct Wall {
    /// The outline and its nodes.
    pub curve: Curve,
    /// Index of its first node among all.
    pub first: usize,
    /// Media (of [`BoundarySystem::media`]) on both sides.
    pub outside: usize,
    pub inside: usize,
    /// Its name in errors.
    pub name: String,
}

/// One diagonal block: LU factors in place.
struct Block {
    size: usize,
    lu: Vec<C64>,
    forward: Vec<u32>,
    inverse: Vec<u32>,
    /// Rows kept from before the factorization, `[column][witness]`, and which.
    witnesses: Vec<usize>,
    rows: Vec<C64>,
}

/// Components that are solved together, one block for each character of the symmetry group.
struct Part {
    components: &'static [usize],
    blocks: Vec<Block>,
}

/// The factorized boundary equations of bodies at one [`Wave`].
pub(crate) struct BoundarySystem {
    wave: Wave,
    media: Vec<Medium>,
    walls: Vec<Wall>,
    nodes: Vec<CurvePoint>,
    outer: usize,
    group: Group,
    parts: Vec<Part>,
    tolerance: f64,
    peak_bytes: usize,
}

/// What depends on the pair of points alone.
struct Pair {
    r: f64,
    /// Distance vector dotted with the target's normal and tangent, and the source's.
    rn: f64,
    rt: f64,
    rns: f64,
    rts: f64,
    /// n.n' and t.n'.
    nn: f64,
    tn: f64,
}

impl Pair {
    #[inline(always)]
    fn new(target: &CurvePoint, source: &CurvePoint) -> Self {
        let (dx, dy) = (target.at[0] - source.at[0], target.at[1] - source.at[1]);
        let ([nx, ny], [sx, sy]) = (target.normal, source.normal);
        Self {
            r: (dx * dx + dy * dy).sqrt(),
            rn: dx * nx + dy * ny,
            rt: dy * nx - dx * ny,
            rns: dx * sx + dy * sy,
            rts: dy * sx - dx * sy,
            nn: nx * sx + ny * sy,
            tn: nx * sy - ny * sx,
        }
    }
}

/// Wavenumbers that the entries are made with.
#[derive(Clone, Copy)]
struct Factors {
    k0: f64,
    kz: f64,
}

impl Factors {
    /// The equations' kernels (what stands on the left hand side) from the radial sums over media; `q` is `(t.r)(t'.r)/R^2`.
    #[inline(always)]
    fn entries(&self, radial: &Radial, pair: &Pair, q: f64) -> Entries {
        let Radial { g, eg, d, ed } = *radial;
        let per_k0 = 1.0 / self.k0;
        let ratio = self.kz * per_k0;
        // sum s kappa^2 G, over k_0.
        let kk = eg * self.k0 - g * (self.kz * ratio);
        let w = (kk + d * (2.0 * per_k0)) * q - d * (pair.nn * per_k0) - eg * (self.k0 * pair.nn);
        let z = C64::ZERO;
        [
            [ed * pair.rns, kk, d * (-ratio * pair.rts), z],
            [w, d * pair.rn, g * (-self.kz * pair.tn), d * (ratio * pair.rt)],
            [d * (ratio * pair.rts), z, d * pair.rns, kk],
            [eg * (self.kz * pair.tn), d * (-ratio * pair.rt), w, ed * pair.rn],
        ]
    }

    #[inline(always)]
    fn regular(&self, radial: &Radial, pair: &Pair) -> Entries {
        self.entries(radial, pair, pair.rt * pair.rts / (pair.r * pair.r))
    }
}

/// How walls see each other.
struct Kernels {
    factors: Factors,
    walls: Vec<WallKernel>,
    logs: Vec<Vec<f64>>,
    media: Vec<Option<MediumKernel>>,
}

impl BoundarySystem {
    /// Assembles and factorizes the equations of `bodies`.
    ///
    /// # Errors
    /// Bad numbers and shapes, walls that overlap, a system larger than memory.
    pub(crate) fn new(bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Self, WaveError> {
        Self::build(bodies, wave, tolerance, &Resolution::for_tolerance(tolerance), true)
    }

    /// The same at a chosen resolution, with symmetry left unused where `symmetric` is false.
    pub(crate) fn build(
        bodies: &[Body],
        wave: &Wave,
        tolerance: f64,
        resolution: &Resolution,
        symmetric: bool,
    ) -> Result<Self, WaveError> {
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(WaveError::Invalid {
                key: "tolerance".into(),
                value: tolerance.to_string(),
                mend: "use a number between 0 and 1, such as 1e-6".into(),
            });
        }
        if tolerance < LEAST_TOLERANCE {
            return Err(WaveError::Unreachable { method: "nystrom", asked: tolerance, reachable: LEAST_TOLERANCE });
        }
        if bodies.is_empty() {
            return Err(WaveError::Invalid {
                key: "fiber".into(),
                value: "[]".into(),
                mend: "give at least one fiber".into(),
            });
        }
        let (media, mut walls) = trace_walls(bodies, wave, resolution)?;
        // Outermost walls first: what radiates stands in front.
        walls.sort_by_key(|w| w.outside != 0);
        let mut nodes = Vec::new();
        for wall in &mut walls {
            wall.first = nodes.len();
            nodes.extend_from_slice(&wall.curve.nodes);
        }
        let outer = walls.iter().filter(|w| w.outside == 0).map(|w| w.curve.nodes.len()).sum();
        check_overlap(&walls)?;
        let group = if symmetric && bodies.len() == 1 {
            let points: Vec<C64> = nodes.iter().map(|p| C64::new(p.at[0], p.at[1])).collect();
            let lengths: Vec<usize> = walls.iter().map(|w| w.curve.nodes.len()).collect();
            Group::detect(&points, &lengths)
        } else {
            Group::trivial(nodes.len())
        };
        let components: &[&'static [usize]] = if wave.kz() == 0.0 { &[&[E, P], &[H, Q]] } else { &[&[E, P, H, Q]] };
        let blocks = group.order() as f64;
        let size = |c: usize| (c * group.orbits.len()) as f64;
        let need: f64 =
            components.iter().map(|c| blocks * size(c.len()) * (size(c.len()) + WITNESSES as f64) * 16.0).sum();
        // Right-hand sides, tables and close rows come on top.
        let need = 1.15 * need + 64e6;
        if let Some(have) = memory::available_bytes().map(|b| b as f64).filter(|have| need > *have) {
            let gib = 1.0 / (1u64 << 30) as f64;
            return Err(WaveError::TooLarge {
                unknowns: components[0].len() * nodes.len(),
                need_gib: need * gib,
                have_gib: have * gib,
            });
        }
        let mut system = Self {
            wave: *wave,
            media,
            walls,
            nodes,
            outer,
            group,
            parts: Vec::new(),
            tolerance,
            peak_bytes: need as usize,
        };
        let kernels = system.kernels();
        system.parts = system.assemble(&kernels, components)?;
        Ok(system)
    }

    /// Walls, those that border on the exterior first.
    #[allow(dead_code, reason = "for the solver of many fibers")]
    pub(crate) fn walls(&self) -> &[Wall] {
        &self.walls
    }

    /// Nodes of all walls, in their order.
    pub(crate) fn nodes(&self) -> &[CurvePoint] {
        &self.nodes
    }

    /// Number of nodes on outermost walls; they come first.
    pub(crate) fn outer_nodes(&self) -> usize {
        self.outer
    }

    /// Arc length that each node of outermost walls stands for [um].
    pub(crate) fn outer_weights(&self) -> Vec<f64> {
        let weights = |w: &Wall| -> Vec<f64> { w.curve.nodes.iter().map(|p| p.speed * w.curve.step()).collect() };
        self.walls.iter().filter(|w| w.outside == 0).flat_map(weights).collect()
    }

    /// The components that are solved together: all four, or (e, P) and (h, Q) at normal incidence.
    pub(crate) fn parts(&self) -> impl Iterator<Item = &'static [usize]> + '_ {
        self.parts.iter().map(|p| p.components)
    }

    /// Size of the largest block.
    pub(crate) fn unknowns(&self) -> usize {
        self.parts.iter().flat_map(|p| &p.blocks).map(|b| b.size).max().unwrap_or(0)
    }

    /// Symmetry of the walls.
    pub(crate) fn group(&self) -> &Group {
        &self.group
    }

    /// Estimated memory [bytes].
    pub(crate) fn peak_bytes(&self) -> usize {
        self.peak_bytes
    }

    /// Media, the exterior first.
    #[allow(dead_code, reason = "for the solver of many fibers")]
    pub(crate) fn media(&self) -> &[Medium] {
        &self.media
    }

    fn kernels(&self) -> Kernels {
        let reach = |walls: &[&Wall]| {
            let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
            for p in walls.iter().flat_map(|w| &w.curve.nodes) {
                for k in 0..2 {
                    low[k] = low[k].min(p.at[k]);
                    high[k] = high[k].max(p.at[k]);
                }
            }
            // Finer nodes of close walls may stand a little outside of the box.
            1.02 * (high[0] - low[0]).hypot(high[1] - low[1])
        };
        let walls = self
            .walls
            .iter()
            .map(|w| WallKernel::new(self.media[w.outside], self.media[w.inside], reach(&[w]), self.tolerance))
            .collect();
        let logs = self.walls.iter().map(|w| log_weights(w.curve.nodes.len())).collect();
        let media = (0..self.media.len())
            .map(|m| {
                let around: Vec<&Wall> = self.walls.iter().filter(|w| w.outside == m || w.inside == m).collect();
                (around.len() > 1).then(|| MediumKernel::new(self.media[m], reach(&around)))
            })
            .collect();
        Kernels { factors: Factors { k0: self.wave.k0(), kz: self.wave.kz() }, walls, logs, media }
    }

    /// The medium that targets on wall a see wall b through, and the sign of b's layers in it.
    fn between(&self, a: usize, b: usize) -> Option<(usize, f64)> {
        let (a, b) = (&self.walls[a], &self.walls[b]);
        if b.outside == a.outside || b.outside == a.inside {
            Some((b.outside, 1.0))
        } else if b.inside == a.outside {
            Some((b.inside, -1.0))
        } else {
            None
        }
    }

    fn wall_of(&self, node: usize) -> usize {
        self.walls.partition_point(|w| w.first <= node) - 1
    }

    /// Fills and factorizes the blocks of all parts.
    fn assemble(&self, kernels: &Kernels, components: &[&'static [usize]]) -> Result<Vec<Part>, WaveError> {
        let orbits = &self.group.orbits;
        let (n, order) = (orbits.len(), self.group.order());
        // Orbits are ascending: those of a wall are a run.
        let runs: Vec<(usize, usize)> = self
            .walls
            .iter()
            .map(|w| {
                let end = w.first + w.curve.nodes.len();
                (orbits.partition_point(|&j| (j as usize) < w.first), orbits.partition_point(|&j| (j as usize) < end))
            })
            .collect();
        let mut matrices: Vec<Vec<Vec<C64>>> =
            components.iter().map(|c| (0..order).map(|_| vec![C64::ZERO; (c.len() * n).pow(2)]).collect()).collect();
        // Columns of one source orbit, in every matrix.
        let mut slabs: Vec<Vec<Vec<&mut [C64]>>> = (0..n).map(|_| Vec::new()).collect();
        for (part, c) in matrices.iter_mut().zip(components) {
            for slab in &mut slabs {
                slab.push(Vec::with_capacity(order));
            }
            for matrix in part {
                for (slab, columns) in slabs.iter_mut().zip(matrix.chunks_mut(c.len() * c.len() * n)) {
                    slab.last_mut().expect("pushed above").push(columns);
                }
            }
        }
        slabs.into_par_iter().enumerate().for_each(|(column, mut slab)| {
            for (gamma, element) in self.group.elements.iter().enumerate() {
                let source = element.image[orbits[column] as usize] as usize;
                let b = self.wall_of(source);
                for (a, &(start, end)) in runs.iter().enumerate() {
                    for row in start..end {
                        let target = orbits[row] as usize;
                        let Some(entries) = self.pair(kernels, a, target, b, source) else { break };
                        self.scatter_entries(&mut slab, components, gamma, n, row, &entries);
                    }
                }
            }
        });
        self.refine_close(kernels, components, &runs, &mut matrices)?;
        Ok(components
            .iter()
            .zip(matrices)
            .map(|(&c, blocks)| Part {
                components: c,
                blocks: blocks.into_iter().map(|m| Block::factorize(m, c.len() * n)).collect(),
            })
            .collect())
    }

    /// Adds the kernel of one image of the source to the columns of its orbit.
    #[inline(always)]
    fn scatter_entries(
        &self,
        slab: &mut [Vec<&mut [C64]>],
        components: &[&'static [usize]],
        gamma: usize,
        n: usize,
        row: usize,
        entries: &Entries,
    ) {
        let mirror = self.group.elements[gamma].mirror;
        for (part, c) in slab.iter_mut().zip(components) {
            let size = c.len() * n;
            for (chi, columns) in part.iter_mut().enumerate() {
                let factor = self.group.characters[chi][gamma].conj();
                for (b, &from) in c.iter().enumerate() {
                    let factor = if mirror && from >= H { -factor } else { factor };
                    let at = b * size + row * c.len();
                    for (out, &to) in columns[at..at + c.len()].iter_mut().zip(c.iter()) {
                        *out += factor * entries[to][from];
                    }
                }
            }
        }
    }

    /// The matrix entries of one pair of nodes; none where the walls share no medium.
    #[inline(always)]
    fn pair(&self, kernels: &Kernels, a: usize, target: usize, b: usize, source: usize) -> Option<Entries> {
        let (x, y) = (&self.nodes[target], &self.nodes[source]);
        let wall = &self.walls[b];
        let h = wall.curve.step();
        if a != b {
            let (medium, sign) = self.between(a, b)?;
            let pair = Pair::new(x, y);
            let radial = kernels.media[medium].as_ref()?.radial(pair.r, sign * h * y.speed);
            return Some(kernels.factors.regular(&radial, &pair));
        }
        let log = &kernels.logs[b];
        let kernel = &kernels.walls[b];
        if target != source {
            let apart = target.abs_diff(source);
            let pair = Pair::new(x, y);
            let radial = kernel.weighted(pair.r, h * y.speed, log[apart] * y.speed);
            return Some(kernels.factors.regular(&radial, &pair));
        }
        let (radial, pole) = kernel.diagonal(y.speed, h * y.speed, log[0] * y.speed);
        let pair = Pair { r: 0.0, rn: 0.0, rt: 0.0, rns: 0.0, rts: 0.0, nn: 1.0, tn: 0.0 };
        let mut entries = kernels.factors.entries(&radial, &pair, 1.0);
        // r.n'/R^2 tends to -curvature/2, r.n/R^2 to the opposite.
        let bend = pole * (0.5 * y.curvature * h * y.speed);
        let mean = 0.5 * (self.media[wall.outside].eps + self.media[wall.inside].eps);
        entries[E][E] += mean - bend;
        entries[P][P] += 1.0;
        entries[H][H] += 1.0;
        entries[Q][Q] += mean + bend;
        Some(entries)
    }

    /// Replaces the rows of targets that stand so close to another wall that its nodes do not resolve the kernel.
    fn refine_close(
        &self,
        kernels: &Kernels,
        components: &[&'static [usize]],
        runs: &[(usize, usize)],
        matrices: &mut [Vec<Vec<C64>>],
    ) -> Result<(), WaveError> {
        let n = self.group.orbits.len();
        for (b, wall) in self.walls.iter().enumerate() {
            for (a, &(start, end)) in runs.iter().enumerate() {
                let Some((medium, sign)) = self.between(a, b).filter(|_| a != b) else { continue };
                let Some(kernel) = kernels.media[medium].as_ref() else { continue };
                let rows: Vec<Option<(usize, Vec<Entries>)>> = (start..end)
                    .into_par_iter()
                    .map(|row| {
                        let target = &self.nodes[self.group.orbits[row] as usize];
                        let Some((nearest, refinement)) = closeness(target, &wall.curve, self.tolerance) else {
                            return Ok(None);
                        };
                        if refinement > FINEST {
                            return Err(WaveError::Overlap {
                                first: self.walls[a].name.clone(),
                                second: wall.name.clone(),
                            });
                        }
                        let row_entries =
                            close_row(&kernels.factors, kernel, sign, target, &wall.curve, nearest, refinement);
                        Ok(Some((row, row_entries)))
                    })
                    .collect::<Result<_, WaveError>>()?;
                let (first, last) = runs[b];
                for (row, entries) in rows.into_iter().flatten() {
                    for (part, c) in matrices.iter_mut().zip(components) {
                        let size = c.len() * n;
                        for (chi, matrix) in part.iter_mut().enumerate() {
                            for column in first..last {
                                for (from_at, &from) in c.iter().enumerate() {
                                    for (to_at, &to) in c.iter().enumerate() {
                                        let mut sum = C64::ZERO;
                                        for (gamma, element) in self.group.elements.iter().enumerate() {
                                            let source = element.image[self.group.orbits[column] as usize] as usize;
                                            let value = entries[source - wall.first][to][from];
                                            let factor = self.group.characters[chi][gamma].conj();
                                            sum += if element.mirror && from >= H { -factor } else { factor } * value;
                                        }
                                        matrix[(column * c.len() + from_at) * size + row * c.len() + to_at] = sum;
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Solves for the densities of one part. `rhs` has `components.len()` values a node, side by side, for all nodes, column after column; on entry the fields
    /// that arrive from outside on outermost walls (zero on others), on exit the total fields on all walls. Returns the relative residual.
    pub(crate) fn solve(&self, part: usize, rhs: &mut [C64], columns: usize) -> f64 {
        let part = &self.parts[part];
        let c = part.components.len();
        let full = c * self.nodes.len();
        assert_eq!(rhs.len(), full * columns);
        if columns == 0 {
            return 0.0;
        }
        if self.group.order() == 1 {
            return part.blocks[0].solve(rhs, columns);
        }
        let order = self.group.order();
        let orbits = &self.group.orbits;
        let size = c * orbits.len();
        let sign = |gamma: usize, k: usize| {
            if self.group.elements[gamma].mirror && part.components[k] >= H { -1.0 } else { 1.0 }
        };
        let mut residual: f64 = 0.0;
        let mut reduced: Vec<Vec<C64>> = Vec::with_capacity(order);
        for (chi, block) in part.blocks.iter().enumerate() {
            let mut b = vec![C64::ZERO; size * columns];
            b.par_chunks_mut(size).zip(rhs.par_chunks(full)).for_each(|(b, rhs)| {
                for (gamma, element) in self.group.elements.iter().enumerate() {
                    let factor = self.group.characters[chi][gamma] / order as f64;
                    for (row, &node) in orbits.iter().enumerate() {
                        let from = element.image[node as usize] as usize;
                        for k in 0..c {
                            b[row * c + k] += factor * sign(gamma, k) * rhs[from * c + k];
                        }
                    }
                }
            });
            residual = residual.max(block.solve(&mut b, columns));
            reduced.push(b);
        }
        rhs.par_chunks_mut(full).enumerate().for_each(|(column, rhs)| {
            rhs.fill(C64::ZERO);
            for (chi, b) in reduced.iter().enumerate() {
                let b = &b[column * size..][..size];
                for (gamma, element) in self.group.elements.iter().enumerate() {
                    let factor = self.group.characters[chi][gamma].conj();
                    for (row, &node) in orbits.iter().enumerate() {
                        let to = element.image[node as usize] as usize;
                        for k in 0..c {
                            rhs[to * c + k] += factor * sign(gamma, k) * b[row * c + k];
                        }
                    }
                }
            }
        });
        residual
    }
}

impl Block {
    fn factorize(mut lu: Vec<C64>, size: usize) -> Self {
        let count = WITNESSES.min(size);
        let witnesses: Vec<usize> = (0..count).map(|j| j * size / count).collect();
        let rows = lu.chunks(size).flat_map(|column| witnesses.iter().map(|&w| column[w])).collect();
        let (mut forward, mut inverse) = (vec![0u32; size], vec![0u32; size]);
        let mut buffer = MemBuffer::new(factor::lu_in_place_scratch::<u32, C64>(size, size, par(), Default::default()));
        factor::lu_in_place(
            MatMut::from_column_major_slice_mut(&mut lu, size, size),
            &mut forward,
            &mut inverse,
            par(),
            MemStack::new(&mut buffer),
            Default::default(),
        );
        Self { size, lu, forward, inverse, witnesses, rows }
    }

    /// Solves in place; returns the largest residual over the witness rows, relative to the column's largest right-hand side or solution.
    fn solve(&self, rhs: &mut [C64], columns: usize) -> f64 {
        let n = self.size;
        let count = self.witnesses.len();
        let mut residual = vec![C64::ZERO; count * columns];
        for (out, column) in residual.chunks_mut(count).zip(rhs.chunks(n)) {
            for (out, &w) in out.iter_mut().zip(&self.witnesses) {
                *out = column[w];
            }
        }
        let lu = MatRef::from_column_major_slice(&self.lu, n, n);
        let perm = PermRef::new_checked(&self.forward, &self.inverse, n);
        let mut buffer = MemBuffer::new(solve::solve_in_place_scratch::<u32, C64>(n, columns, par()));
        solve::solve_in_place(
            lu,
            lu,
            perm,
            MatMut::from_column_major_slice_mut(rhs, n, columns),
            par(),
            MemStack::new(&mut buffer),
        );
        matmul(
            MatMut::from_column_major_slice_mut(&mut residual, count, columns),
            Accum::Add,
            MatRef::from_column_major_slice(&self.rows, count, n),
            MatRef::from_column_major_slice(rhs, n, columns),
            -C64::ONE,
            par(),
        );
        residual
            .chunks(count)
            .zip(rhs.chunks(n))
            .map(|(r, x)| {
                let largest = |v: &[C64]| v.iter().map(|c| c.norm_sqr()).fold(0.0, f64::max).sqrt();
                let size = largest(x);
                if size == 0.0 { 0.0 } else { largest(r) / size }
            })
            .fold(0.0, f64::max)
    }
}

/// Parameter of the point of `curve` nearest to `target` and the refinement its kernel needs there; none where the nodes do.
pub(crate) fn closeness(target: &CurvePoint, curve: &Curve, tolerance: f64) -> Option<(f64, f64)> {
    let digits = (10.0 / tolerance).ln();
    // The trapezoidal rule is off by exp(-2 pi distance / spacing).
    let needed = |distance: f64, speed: f64| digits * curve.step() * speed / (TAU * distance);
    let apart = |p: &CurvePoint| (p.at[0] - target.at[0]).hypot(p.at[1] - target.at[1]);
    let (nearest, distance) =
        curve.nodes.iter().map(apart).enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).expect("a wall has nodes");
    let node = &curve.nodes[nearest];
    // Nodes may stand half a spacing beside the nearest point.
    let least = (distance * distance - (0.6 * curve.step() * node.speed).powi(2)).max(0.0).sqrt();
    if least > 0.0 && needed(least, node.speed) <= 1.0 {
        return None;
    }
    let mut t = curve.parameter(nearest);
    let mut point = *node;
    for _ in 0..8 {
        let along = (target.at[1] - point.at[1]) * point.normal[0] - (target.at[0] - point.at[0]) * point.normal[1];
        t += (along / point.speed).clamp(-0.5 * curve.step(), 0.5 * curve.step());
        point = curve.point(t);
    }
    let refinement = needed(apart(&point).min(distance), point.speed).ceil();
    (refinement > 1.0).then_some((t, refinement))
}

/// Entries of one target against all nodes of a wall close to it: inside a smooth window around the nearest point the wall's own nodes give way to
/// finer ones, to which the density is interpolated.
fn close_row(
    factors: &Factors,
    kernel: &MediumKernel,
    sign: f64,
    target: &CurvePoint,
    curve: &Curve,
    nearest: f64,
    refinement: f64,
) -> Vec<Entries> {
    let n = curve.nodes.len();
    let h = curve.step();
    let whole = 3.0 * WINDOW_NODES >= n as f64;
    // Distance along the wall in nodes, and the window there.
    let window = |t: f64| {
        if whole {
            return 1.0;
        }
        let d = ((t - nearest + PI).rem_euclid(TAU) - PI) / h;
        (-(d / WINDOW_NODES).powi(8)).exp()
    };
    let at = |point: &CurvePoint, weight: f64| {
        let pair = Pair::new(target, point);
        factors.regular(&kernel.radial(pair.r, sign * weight * point.speed), &pair)
    };
    let mut row: Vec<Entries> = curve
        .nodes
        .iter()
        .enumerate()
        .map(|(j, node)| {
            let outside = 1.0 - window(curve.parameter(j));
            if outside == 0.0 { [[C64::ZERO; COMPONENTS]; COMPONENTS] } else { at(node, h * outside) }
        })
        .collect();
    let fine = n * refinement as usize;
    let step = TAU / fine as f64;
    let reach = if whole { fine as i64 / 2 } else { (1.5 * WINDOW_NODES * refinement).ceil() as i64 };
    let middle = (nearest / step - 0.5).round() as i64;
    let end = if whole { middle - reach + fine as i64 } else { middle + reach };
    for k in middle - reach..end {
        let t = step * (k as f64 + 0.5);
        let entries = at(&curve.point(t), step * window(t));
        // Periodic sinc of n nodes: sin(n u / 2) cot(u / 2) / n, whose sine alternates from node to node.
        let u0 = t - curve.parameter(0);
        let sine = (0.5 * n as f64 * u0).sin() / n as f64;
        for (j, out) in row.iter_mut().enumerate() {
            let half = 0.5 * (u0 - j as f64 * h);
            let s = half.sin();
            let weight =
                if s.abs() < 1e-13 { 1.0 } else { (if j.is_multiple_of(2) { sine } else { -sine }) * half.cos() / s };
            for (out, entries) in out.iter_mut().zip(&entries) {
                for (out, value) in out.iter_mut().zip(entries) {
                    *out += value * weight;
                }
            }
        }
    }
    row
}

/// Media and walls of bodies, each with the nodes its wavelength asks for.
pub(crate) fn trace_walls(
    bodies: &[Body],
    wave: &Wave,
    resolution: &Resolution,
) -> Result<(Vec<Medium>, Vec<Wall>), WaveError> {
    let mut media = vec![Medium { kappa: C64::new(wave.k_rho(), 0.0), eps: C64::ONE }];
    let mut walls = Vec::new();
    for (index, top) in bodies.iter().enumerate() {
        let mut outside = 0;
        let mut name = format!("fiber[{index}]");
        let mut next = Some(top);
        while let Some(body) = next {
            if !(body.eta > 0.0 && body.eta.is_finite()) {
                return Err(WaveError::Invalid {
                    key: format!("{name}.eta"),
                    value: body.eta.to_string(),
                    mend: "use a positive index".into(),
                });
            }
            if !(body.kappa >= 0.0 && body.kappa.is_finite()) {
                return Err(WaveError::Invalid {
                    key: format!("{name}.kappa"),
                    value: body.kappa.to_string(),
                    mend: "use 0 or more (absorption)".into(),
                });
            }
            let inside = media.len();
            media.push(Medium { kappa: wave.k_rho_in(body.index()), eps: body.index() * body.index() });
            let largest: f64 = media[outside].kappa.norm().max(media[inside].kappa.norm());
            let curve = Curve::new(body, resolution, TAU / largest, &name)?;
            walls.push(Wall { curve, first: 0, outside, inside, name: name.clone() });
            outside = inside;
            name.push_str(".lumen");
            next = body.lumen.as_deref();
        }
    }
    Ok((media, walls))
}

/// Refuses walls that cross: a node of one on the wrong side of another.
pub(crate) fn check_overlap(walls: &[Wall]) -> Result<(), WaveError> {
    for (j, a) in walls.iter().enumerate() {
        for b in &walls[j + 1..] {
            // b inside of a, or both beside each other with boxes that meet.
            let nested = b.outside == a.inside;
            if !nested && (b.outside != a.outside || apart(a, b)) {
                continue;
            }
            let crosses = b.curve.nodes.iter().any(|p| encloses(&a.curve, p.at) != nested)
                || a.curve.nodes.iter().any(|p| encloses(&b.curve, p.at));
            if crosses {
                return Err(WaveError::Overlap { first: a.name.clone(), second: b.name.clone() });
            }
        }
    }
    Ok(())
}

/// Whether the boxes of two walls are apart.
fn apart(a: &Wall, b: &Wall) -> bool {
    let side = |w: &Wall, k: usize| {
        w.curve.nodes.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.at[k]), h.max(p.at[k])))
    };
    (0..2).any(|k| {
        let ((al, ah), (bl, bh)) = (side(a, k), side(b, k));
        al > bh || bl > ah
    })
}

/// Whether the polygon of a wall's nodes encloses a point.
fn encloses(curve: &Curve, p: [f64; 2]) -> bool {
    let mut inside = false;
    let mut last = curve.nodes[curve.nodes.len() - 1].at;
    for node in &curve.nodes {
        let this = node.at;
        if (this[1] > p[1]) != (last[1] > p[1])
            && p[0] < (last[0] - this[0]) * (p[1] - this[1]) / (last[1] - this[1]) + this[0]
        {
            inside = !inside;
        }
        last = this;
    }
    inside
}
