//! Functions of a direction of the half sphere in a basis of quadratic B-splines.
//!
//! Knots are uniform in `z^(2/3)` from 0 to 1, which is denser towards the plane, and uniform and periodic in
//! the azimuth. The basis functions sum to 1.

use crate::cloth::shade::shadow_table::two_thirds;
use std::f32::consts::TAU;

/// Number of intervals of z^(2/3), and of basis functions over them.
const INTERVALS: usize = 5;
const ROWS: usize = INTERVALS + 2;
/// Number of basis functions over the azimuth.
const COLUMNS: usize = 24;
/// Number of coefficients of a function.
pub const COUNT: usize = ROWS * COLUMNS;
/// Number of basis functions that are nonzero at a direction.
const FEW: usize = 9;

/// Coefficients of F functions, interleaved: `[coefficient][function]`.
pub type Several<const F: usize> = [[f32; F]; COUNT];

/// The basis functions that are nonzero at a direction.
#[derive(Clone, Copy, Debug)]
pub struct At {
    /// Indices of their coefficients.
    pub index: [u16; FEW],
    /// Values of the basis functions.
    pub weight: [f32; FEW],
}

/// The three quadratic B-splines at the fraction u of an interval.
#[inline(always)]
fn quadratic(u: f32) -> [f32; 3] {
    [0.5 * (1.0 - u) * (1.0 - u), 0.5 + u * (1.0 - u), 0.5 * u * u]
}

impl At {
    /// Evaluates the basis at a unit direction; z counts as |z|.
    #[inline(always)]
    pub fn new(w: [f32; 3]) -> At {
        let x = two_thirds(w[2].abs().min(1.0)) * INTERVALS as f32;
        let row = (x as usize).min(INTERVALS - 1);
        let rows = quadratic(x - row as f32);
        let (column, u) =
            crate::math::floor_fraction(crate::math::simd::atan2::<false>(w[1], w[0]) / TAU * COLUMNS as f32);
        let columns = quadratic(u);
        let mut at = At { index: [0; FEW], weight: [0.0; FEW] };
        for i in 0..3 {
            for j in 0..3 {
                let column = (column + j as i32 + COLUMNS as i32) as usize % COLUMNS;
                at.index[3 * i + j] = ((row + i) * COLUMNS + column) as u16;
                at.weight[3 * i + j] = rows[i] * columns[j];
            }
        }
        at
    }

    /// Adds the values of the functions to `sums`.
    #[inline(always)]
    pub fn add<const F: usize>(&self, several: &Several<F>, sums: &mut [f32; F]) {
        for (index, weight) in self.index.iter().zip(self.weight) {
            let c = &several[usize::from(*index).min(COUNT - 1)];
            for f in 0..F {
                sums[f] += weight * c[f];
            }
        }
    }
}
