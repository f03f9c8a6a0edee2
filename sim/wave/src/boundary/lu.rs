//! LU factors of a dense complex matrix with partial pivoting, in either precision: the only use of faer's
//! factorization.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::perm::PermRef;
use faer::traits::ComplexField;
use faer::{MatMut, MatRef, Par};

/// Parallelism of faer's routines: the pool this runs in.
pub(crate) fn par() -> Par {
    if rayon::current_num_threads() > 1 { Par::rayon(0) } else { Par::Seq }
}

/// A factorized square matrix, in place of the matrix.
pub(crate) struct Lu<T> {
    size: usize,
    lu: Vec<T>,
    forward: Vec<u32>,
    inverse: Vec<u32>,
}

impl<T: ComplexField> Lu<T> {
    /// Factorizes a matrix of `size * size` values, column after column.
    pub fn new(mut lu: Vec<T>, size: usize) -> Self {
        let (mut forward, mut inverse) = (vec![0u32; size], vec![0u32; size]);
        let mut buffer = MemBuffer::new(factor::lu_in_place_scratch::<u32, T>(size, size, par(), Default::default()));
        factor::lu_in_place(
            MatMut::from_column_major_slice_mut(&mut lu, size, size),
            &mut forward,
            &mut inverse,
            par(),
            MemStack::new(&mut buffer),
            Default::default(),
        );
        Self { size, lu, forward, inverse }
    }

    /// Rows of the matrix.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Solves for the columns of `rhs`, in place.
    pub fn solve(&self, rhs: MatMut<'_, T>) {
        let lu = MatRef::from_column_major_slice(&self.lu, self.size, self.size);
        let perm = PermRef::new_checked(&self.forward, &self.inverse, self.size);
        let mut buffer = MemBuffer::new(solve::solve_in_place_scratch::<u32, T>(self.size, rhs.ncols(), par()));
        solve::solve_in_place(lu, lu, perm, rhs, par(), MemStack::new(&mut buffer));
    }
}
