//! Lookups on uniform axes: the cell of a value, and the fraction of the way through it.
//!
//! Every function takes a position in units of nodes or bins, or computes it from the nodes. Positions
//! outside the axis are clamped to it, and NaN gives the first node. The functions are inlined and
//! branch-free. The f64 and f32 variants share their code.

use super::simd;

macro_rules! lookups {
    ($real:ty, $cell:ident, $cell_periodic:ident, $max:expr, $min:expr) => {
        /// Cell and fraction in [0, 1] of position `t` on an axis of `nodes` nodes. The value there is
        /// `(1 - f) v[i] + f v[i + 1]`. The axis must have at least 2 nodes.
        #[inline(always)]
        pub fn $cell(t: $real, nodes: usize) -> (usize, $real) {
            let t = $min($max(t, 0.0), (nodes - 1) as $real);
            let i = (t as i32 as usize).min(nodes - 2);
            (i, t - i as $real)
        }

        /// Node, next node and fraction in [0, 1] of position `t` in [0, nodes] on a closed axis, where the
        /// last node is followed by the first.
        #[inline(always)]
        pub fn $cell_periodic(t: $real, nodes: usize) -> (usize, usize, $real) {
            let t = $min($max(t, 0.0), nodes as $real);
            let i = (t as i32 as usize).min(nodes - 1);
            let next = if i + 1 == nodes { 0 } else { i + 1 };
            (i, next, t - i as $real)
        }
    };
}

lookups!(f32, cell_f32, cell_periodic_f32, simd::max, simd::min);
lookups!(f64, cell, cell_periodic, max, min);

/// The larger of two numbers; `b` if `a` is NaN.
#[inline(always)]
fn max(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The smaller of two numbers; `b` if `a` is NaN.
#[inline(always)]
fn min(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// [`cell`] of `x` on a uniform ascending axis of at least 2 nodes.
#[inline]
pub fn locate(x: f64, axis: &[f64]) -> (usize, f64) {
    let last = axis.len() - 1;
    cell((x - axis[0]) / (axis[last] - axis[0]) * last as f64, axis.len())
}

/// A uniform axis prepared for many lookups in f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UniformAxis {
    first: f32,
    per_unit: f32,
    last: f32,
}

impl UniformAxis {
    /// Prepares a uniform ascending axis of at least 2 nodes.
    pub fn new(nodes: &[f64]) -> UniformAxis {
        let last = nodes.len() - 1;
        UniformAxis {
            first: nodes[0] as f32,
            per_unit: (last as f64 / (nodes[last] - nodes[0])) as f32,
            last: last as f32,
        }
    }

    /// Number of nodes.
    #[inline(always)]
    pub fn nodes(&self) -> usize {
        self.last as i32 as usize + 1
    }

    /// Cell and fraction of `x`, as [`cell_f32`].
    #[inline(always)]
    pub fn locate(&self, x: f32) -> (usize, f32) {
        let t = simd::min(simd::max((x - self.first) * self.per_unit, 0.0), self.last);
        let i = simd::min(t, self.last - 1.0) as i32;
        (i as usize, t - i as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference implementation: the last node at or below x, found by a search over all nodes.
    fn searched(x: f64, axis: &[f64]) -> (usize, f64) {
        let i = axis[..axis.len() - 1].iter().rposition(|node| *node <= x).unwrap_or(0);
        (i, ((x - axis[i]) / (axis[i + 1] - axis[i])).clamp(0.0, 1.0))
    }

    #[test]
    fn lookups_agree_with_a_search() {
        for nodes in [2usize, 3, 7, 64] {
            let axis: Vec<f64> = (0..nodes).map(|i| -1.5 + 0.25 * i as f64).collect();
            let prepared = UniformAxis::new(&axis);
            assert_eq!(prepared.nodes(), nodes);
            for k in -100..4000 {
                // 1e-3 of a cell away from the nodes, where rounding cannot move a value to the next cell.
                let x = -2.0 + 0.00525 * f64::from(k) + 1e-4;
                let (i, f) = searched(x, &axis);
                let (j, g) = locate(x, &axis);
                assert!(i == j && (f - g).abs() < 1e-12, "{x} of {nodes}: ({j}, {g}), want ({i}, {f})");
                for (j, g) in [prepared.locate(x as f32), cell_f32(((x - axis[0]) / 0.25) as f32, nodes)] {
                    let same = i as f64 + f - (j as f64 + f64::from(g));
                    assert!(same.abs() < 1e-5, "{x} of {nodes}: ({j}, {g}), want ({i}, {f})");
                }
            }
        }
    }

    #[test]
    fn ends_and_nan_stay_on_the_axis() {
        for t in [f64::NAN, f64::NEG_INFINITY, -1.0, -0.0] {
            assert_eq!(cell(t, 5), (0, 0.0));
            assert_eq!(cell_f32(t as f32, 5), (0, 0.0));
        }
        for t in [4.0, 4.5, 1e300, f64::INFINITY] {
            assert_eq!(cell(t, 5), (3, 1.0));
            assert_eq!(cell_f32(t as f32, 5), (3, 1.0));
        }
        assert_eq!(cell(1e9, 2), (0, 1.0));
        let axis = UniformAxis::new(&[1.0, 2.0, 3.0]);
        assert_eq!(axis.locate(f32::NAN), (0, 0.0));
        assert_eq!([axis.locate(-9.0), axis.locate(3.0), axis.locate(9.0)], [(0, 0.0), (1, 1.0), (1, 1.0)]);
    }

    #[test]
    fn closed_axes_go_round() {
        assert_eq!(cell_periodic(0.25, 4), (0, 1, 0.25));
        assert_eq!(cell_periodic(3.5, 4), (3, 0, 0.5));
        // A remainder that is rounded up to the length is the first node again.
        assert_eq!(cell_periodic(4.0, 4), (3, 0, 1.0));
        assert_eq!(cell_periodic_f32(f32::NAN, 4), (0, 1, 0.0));
        assert_eq!(cell_periodic_f32(0.5, 1), (0, 0, 0.5));
    }
}
