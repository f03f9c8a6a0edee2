//! The boundary integral equations of walls between media, assembled and factorized.
//!
//! Unknowns on every wall are the four continuous fields of [`wave`](crate): `e`,
//! `P = (k_0 eps d_n e + k_z d_t h)/kappa^2`, `h` and `Q = (k_0 d_n h - k_z d_t e)/kappa^2`, all of the unit
//! of e. With the single layer S, its adjoint double layer K' and double layer K of a medium's Green function
//! G, Green's representation of both fields, `u = +-(K u - S d_n u)`, with
//! `d_n e = (kappa^2 P - k_z d_t h)/(k_0 eps)` inserted and tangential derivatives moved onto G by parts,
//! reads (upper sign: the medium lies outside of the wall)
//!
//! ```text
//! eps e = +-[eps K e - (kappa^2/k_0) S P - (k_z/k_0) A h]                              A(x, y)  = d_t(y) G
//!     h = +-[    K h - (kappa^2/k_0) S Q + (k_z/k_0) A e]                              A'(x, y) = d_t(x) G
//!     P = +-[-K' P - (W/k_0 - k_0 eps n.n' S) e - (k_z/k_0) A' Q + k_z t.n' S h]       W(x, y)  = d_t(x) d_t(y) G
//! eps Q = +-[-eps K' Q - (W/k_0 - k_0 eps n.n' S) h + (k_z/k_0) A' P - k_z eps t.n' S e]
//! ```
//!
//! In P the hypersingular operators of e and h have the factors `k_0 eps/kappa^2` and `-k_z^2/(k_0 kappa^2)`,
//! whose sum is 1/k_0 in every medium, and `d_t K + K' d_t = kappa^2 t.S n'` removes the other terms in
//! 1/kappa^2. So with these weights the sum of the equations from both sides of a wall contains only
//! differences of W, A, A' and S between the media, all weakly singular or smooth: a Fredholm system of the
//! second kind at every incidence, with `(eps_o + eps_i)/2, 1, 1, (eps_o + eps_i)/2` on its diagonal
//! (Müller's choice, here for 2.5 dimensions). At normal incidence (e, P) and (h, Q) are two separate
//! systems.

use crate::boundary::assemble::Assembly;
use crate::boundary::entries::{E, H, P, Q};
#[cfg(test)]
use crate::boundary::kernel::Medium;
use crate::boundary::lu::{Lu, par};
use crate::boundary::walls::{Wall, check_overlap, trace_walls};
use crate::scene::curve::{CurvePoint, Resolution};
use crate::scene::symmetry::Group;
use crate::{Body, C64, Wave, WaveError};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef};
use plywave_runs::memory;
use rayon::prelude::*;

/// Minimum guaranteed tolerance.
const MIN_TOLERANCE: f64 = 1e-12;
/// Number of a system's rows whose residual is computed.
const WITNESSES: usize = 64;

/// One diagonal block, factorized.
struct Block {
    lu: Lu<C64>,
    /// Indices of rows whose values before the factorization are stored, `[column][witness]`.
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
    assembly: Assembly,
    outer: usize,
    parts: Vec<Part>,
    peak_bytes: usize,
}

impl BoundarySystem {
    /// Assembles and factorizes the equations of `bodies`.
    ///
    /// # Errors
    /// Bad numbers and shapes, walls that overlap, a system larger than memory.
    pub(crate) fn new(bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Self, WaveError> {
        Self::build(bodies, wave, tolerance, &Resolution::new(bodies, tolerance), true)
    }

    /// Assembles and factorizes the equations at a chosen resolution; `symmetric` = false ignores symmetry.
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
                hint: "use a number between 0 and 1, such as 1e-6".into(),
            });
        }
        if tolerance < MIN_TOLERANCE {
            return Err(WaveError::Unreachable { method: "nystrom", asked: tolerance, reachable: MIN_TOLERANCE });
        }
        if bodies.is_empty() {
            return Err(WaveError::Invalid {
                key: "fiber".into(),
                value: "[]".into(),
                hint: "give at least one fiber".into(),
            });
        }
        let (media, mut walls) = trace_walls(bodies, wave, resolution)?;
        // Outermost walls, which radiate, come first.
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
        let assembly = Assembly { wave: *wave, media, walls, nodes, group, tolerance };
        let size = assembly.group.orbits.len();
        let parts = components
            .iter()
            .zip(assembly.matrices(components)?)
            .map(|(&c, blocks)| Part {
                components: c,
                blocks: blocks.into_iter().map(|m| Block::factorize(m, c.len() * size)).collect(),
            })
            .collect();
        Ok(Self { assembly, outer, parts, peak_bytes: need as usize })
    }

    /// Walls, those that border on the exterior first.
    pub(crate) fn walls(&self) -> &[Wall] {
        &self.assembly.walls
    }

    /// Nodes of all walls, in their order.
    pub(crate) fn nodes(&self) -> &[CurvePoint] {
        &self.assembly.nodes
    }

    /// Number of nodes on outermost walls; they come first.
    pub(crate) fn outer_nodes(&self) -> usize {
        self.outer
    }

    /// Arc length of each node of outermost walls [um].
    pub(crate) fn outer_weights(&self) -> Vec<f64> {
        let weights = |w: &Wall| -> Vec<f64> { w.curve.nodes.iter().map(|p| p.speed * w.curve.step()).collect() };
        self.assembly.walls.iter().filter(|w| w.outside == 0).flat_map(weights).collect()
    }

    /// The components that are solved together: all four, or (e, P) and (h, Q) at normal incidence.
    pub(crate) fn parts(&self) -> impl Iterator<Item = &'static [usize]> + '_ {
        self.parts.iter().map(|p| p.components)
    }

    /// Size of the largest block.
    pub(crate) fn unknowns(&self) -> usize {
        self.parts.iter().flat_map(|p| &p.blocks).map(|b| b.lu.size()).max().unwrap_or(0)
    }

    /// Symmetry of the walls.
    pub(crate) fn group(&self) -> &Group {
        &self.assembly.group
    }

    /// Estimated memory [bytes].
    pub(crate) fn peak_bytes(&self) -> usize {
        self.peak_bytes
    }

    /// Media, the exterior first.
    #[cfg(test)]
    pub(crate) fn media(&self) -> &[Medium] {
        &self.assembly.media
    }

    /// Solves for the densities of one part. `rhs` has `components.len()` values per node, side by side, for
    /// all nodes, column after column; on entry the fields that arrive from outside on outermost walls (zero
    /// on others), on exit the total fields on all walls. Returns the relative residual.
    pub(crate) fn solve(&self, part: usize, rhs: &mut [C64], columns: usize) -> f64 {
        let part = &self.parts[part];
        let c = part.components.len();
        let full = c * self.assembly.nodes.len();
        assert_eq!(rhs.len(), full * columns);
        if columns == 0 {
            return 0.0;
        }
        if self.assembly.group.order() == 1 {
            return part.blocks[0].solve(rhs, columns);
        }
        let order = self.assembly.group.order();
        let orbits = &self.assembly.group.orbits;
        let size = c * orbits.len();
        let sign = |gamma: usize, k: usize| {
            if self.assembly.group.elements[gamma].mirror && part.components[k] >= H { -1.0 } else { 1.0 }
        };
        let mut residual: f64 = 0.0;
        let mut reduced: Vec<Vec<C64>> = Vec::with_capacity(order);
        for (chi, block) in part.blocks.iter().enumerate() {
            let mut b = vec![C64::ZERO; size * columns];
            b.par_chunks_mut(size).zip(rhs.par_chunks(full)).for_each(|(b, rhs)| {
                for (gamma, element) in self.assembly.group.elements.iter().enumerate() {
                    let factor = self.assembly.group.characters[chi][gamma] / order as f64;
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
                for (gamma, element) in self.assembly.group.elements.iter().enumerate() {
                    let factor = self.assembly.group.characters[chi][gamma].conj();
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
    fn factorize(matrix: Vec<C64>, size: usize) -> Self {
        let count = WITNESSES.min(size);
        let witnesses: Vec<usize> = (0..count).map(|j| j * size / count).collect();
        let rows = matrix.chunks(size).flat_map(|column| witnesses.iter().map(|&w| column[w])).collect();
        Self { lu: Lu::new(matrix, size), witnesses, rows }
    }

    /// Solves in place; returns the largest residual over the witness rows, relative to the column's largest
    /// right-hand side or solution.
    fn solve(&self, rhs: &mut [C64], columns: usize) -> f64 {
        let n = self.lu.size();
        let count = self.witnesses.len();
        let mut residual = vec![C64::ZERO; count * columns];
        for (out, column) in residual.chunks_mut(count).zip(rhs.chunks(n)) {
            for (out, &w) in out.iter_mut().zip(&self.witnesses) {
                *out = column[w];
            }
        }
        self.lu.solve(MatMut::from_column_major_slice_mut(rhs, n, columns));
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
