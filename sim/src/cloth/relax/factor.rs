//! Sparse symmetric matrices of 3 x 3 blocks, one row of blocks for each node, and their Cholesky factors.
//!
//! Nodes are ordered by approximate minimum degree on the graph of the blocks (Amestoy, Davis and Duff 1996);
//! the factorization is supernodal (faer). It runs on one thread, so that its sums have one order.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, amd};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use rayon::prelude::*;

/// A block of the matrix.
pub type Block = [[f64; 3]; 3];

/// A sparse matrix with its factor.
pub struct Factor {
    /// Place of each node in the order of elimination.
    place: Vec<u32>,
    /// `[place]`: first of the column's blocks above the diagonal in `rows`; and their number last.
    first: Vec<usize>,
    /// Places of the rows of blocks, ascending in each column.
    rows: Vec<u32>,
    /// Compressed columns of the upper triangle, in numbers instead of blocks.
    column: Vec<u32>,
    row: Vec<u32>,
    values: Vec<f64>,
    symbolic: SymbolicCholesky<u32>,
    lower: Vec<f64>,
    /// Vector in the order of elimination.
    ordered: Vec<f64>,
    factor_scratch: MemBuffer,
    solve_scratch: MemBuffer,
}

/// Sorted edges without repeats, as compressed columns: first of each column, and rows.
fn columns(nodes: usize, edges: &mut Vec<(u32, u32)>) -> (Vec<usize>, Vec<u32>) {
    edges.par_sort_unstable();
    edges.dedup();
    let mut first = vec![0; nodes + 1];
    edges.iter().for_each(|(column, _)| first[*column as usize + 1] += 1);
    (0..nodes).for_each(|i| first[i + 1] += first[i]);
    (first, edges.iter().map(|(_, row)| *row).collect())
}

impl Factor {
    /// A matrix of zeros with blocks on its diagonal and at `edges`, pairs of nodes in any order. `None` if
    /// there is not enough memory or if the factor has more than 2^31 numbers.
    pub fn new(nodes: usize, edges: &mut Vec<(u32, u32)>) -> Option<Factor> {
        edges.retain(|(a, b)| a != b);
        edges.iter_mut().for_each(|(a, b)| (*a, *b) = ((*a).max(*b), (*a).min(*b)));
        let (first, rows) = columns(nodes, edges);
        let first: Vec<u32> = first.iter().map(|v| *v as u32).collect();
        let graph = SymbolicSparseColMatRef::<u32>::new_checked(nodes, nodes, &first, None, &rows);
        let (mut order, mut place) = (vec![0u32; nodes], vec![0u32; nodes]);
        let mut scratch = MemBuffer::try_new(amd::order_scratch::<u32>(nodes, rows.len())).ok()?;
        let control = amd::Control::default();
        amd::order(&mut order, &mut place, graph, control, MemStack::new(&mut scratch)).ok()?;
        drop(scratch);
        edges.par_iter_mut().for_each(|(a, b)| {
            let (p, q) = (place[*a as usize], place[*b as usize]);
            (*a, *b) = (p.max(q), p.min(q));
        });
        let (first, rows) = columns(nodes, edges);
        let (mut column, mut row) = (vec![0u32], Vec::with_capacity(9 * rows.len() + 6 * nodes));
        for place in 0..nodes {
            for axis in 0..3u32 {
                rows[first[place]..first[place + 1]].iter().for_each(|r| row.extend([3 * r, 3 * r + 1, 3 * r + 2]));
                row.extend((0..=axis).map(|i| 3 * place as u32 + i));
                column.push(u32::try_from(row.len()).ok()?);
            }
        }
        let matrix = SymbolicSparseColMatRef::<u32>::new_checked(3 * nodes, 3 * nodes, &column, None, &row);
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..CholeskySymbolicParams::default()
        };
        let symbolic = factorize_symbolic_cholesky(matrix, Side::Upper, SymmetricOrdering::Identity, params).ok()?;
        let of_factor = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let of_solve = symbolic.solve_in_place_scratch::<f64>(1, Par::Seq);
        let mut lower = Vec::new();
        lower.try_reserve_exact(symbolic.len_val()).ok()?;
        lower.resize(symbolic.len_val(), 0.0);
        Some(Factor {
            values: vec![0.0; row.len()],
            ordered: vec![0.0; 3 * nodes],
            factor_scratch: MemBuffer::try_new(of_factor).ok()?,
            solve_scratch: MemBuffer::try_new(of_solve).ok()?,
            place,
            first,
            rows,
            column,
            row,
            symbolic,
            lower,
        })
    }

    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds to the blocks (a, b) and (b, a), or to (a, a) if a is b. Returns `false` if the matrix has no
    /// such block.
    pub fn add(&mut self, a: usize, b: usize, block: &Block) -> bool {
        let (p, q) = (self.place[a] as usize, self.place[b] as usize);
        let column = p.max(q);
        let blocks = self.first[column + 1] - self.first[column];
        let start = 9 * self.first[column] + 6 * column;
        if p == q {
            for c in 0..3 {
                let at = start + (c + 1) * 3 * blocks + c * (c + 1) / 2;
                (0..=c).for_each(|r| self.values[at + r] += block[r][c]);
            }
            return true;
        }
        let Ok(k) = self.rows[self.first[column]..self.first[column + 1]].binary_search(&(p.min(q) as u32)) else {
            return false;
        };
        for c in 0..3 {
            let at = start + c * 3 * blocks + c * (c + 1) / 2 + 3 * k;
            (0..3).for_each(|r| self.values[at + r] += if p < q { block[r][c] } else { block[c][r] });
        }
        true
    }

    /// Factorizes the matrix. Returns `false` if it is not positive definite.
    pub fn factorize(&mut self) -> bool {
        let n = self.ordered.len();
        let symbolic = SymbolicSparseColMatRef::<u32>::new_checked(n, n, &self.column, None, &self.row);
        let matrix = SparseColMatRef::new(symbolic, &self.values);
        self.symbolic
            .factorize_numeric_llt(
                &mut self.lower,
                matrix,
                Side::Upper,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.factor_scratch),
                Default::default(),
            )
            .is_ok()
    }

    /// Replaces a vector by the inverse of the factorized matrix times it.
    pub fn solve(&mut self, vector: &mut [f64]) {
        for (node, place) in self.place.iter().enumerate() {
            let to = 3 * *place as usize;
            self.ordered[to..to + 3].copy_from_slice(&vector[3 * node..3 * node + 3]);
        }
        let n = self.ordered.len();
        let ordered = MatMut::from_column_major_slice_mut(&mut self.ordered, n, 1);
        let factor = LltRef::new(&self.symbolic, &self.lower);
        factor.solve_in_place_with_conj(Conj::No, ordered, Par::Seq, MemStack::new(&mut self.solve_scratch));
        for (node, place) in self.place.iter().enumerate() {
            let from = 3 * *place as usize;
            vector[3 * node..3 * node + 3].copy_from_slice(&self.ordered[from..from + 3]);
        }
    }
}
