//! Maps between the sites of a group and the few retained ones that represent them, applied to vectors and to
//! matrices in strips of columns.

use crate::C64;
use crate::boundary::lu::par;
use crate::many::interpolate::Interpolation;
use crate::many::packed::{PANEL, Packed};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef};
use std::ops::Range;

/// Number of columns in a copied strip of a large matrix: small beside the matrix, large enough for products
/// at full speed.
pub(crate) const STRIP: usize = 512;

/// `out = a b`, or added to it; all column after column.
pub(crate) fn gemm(mut out: MatMut<'_, C64>, accum: Accum, a: MatRef<'_, C64>, b: MatRef<'_, C64>, factor: C64) {
    if a.ncols() == 0 {
        if matches!(accum, Accum::Replace) {
            out.fill(C64::ZERO);
        }
        return;
    }
    if out.nrows() > 0 && out.ncols() > 0 {
        matmul(out, accum, a, b, factor, par());
    }
}

/// The columns X of an interpolation that belong to some of its sites: strengths s at `inputs` sites radiate
/// as `X s` at `outputs` sites, and received values u at the outputs give `X^T u` at the inputs. Vectors of
/// several fields have one field after the other.
pub(crate) struct Basis {
    pub outputs: usize,
    pub inputs: usize,
    /// Inputs that are outputs: `(output, input)`.
    retained: Vec<(u32, u32)>,
    /// The other inputs.
    dropped: Vec<u32>,
    /// Their coefficients, `outputs x dropped`.
    coefficients: Packed,
}

impl Basis {
    /// The columns of the inputs `first .. first + inputs`.
    pub fn from_interpolation(all: &Interpolation, first: usize, inputs: usize) -> Self {
        let outputs = all.retained.len();
        let own = first..first + inputs;
        let retained = all.retained.iter().enumerate().filter(|(_, j)| own.contains(j));
        let columns = all.dropped.partition_point(|&j| j < first)..all.dropped.partition_point(|&j| j < own.end);
        let values = &all.coefficients[columns.start * outputs..columns.end * outputs];
        Self {
            outputs,
            inputs,
            retained: retained.map(|(i, &j)| (i as u32, (j - first) as u32)).collect(),
            dropped: all.dropped[columns].iter().map(|&j| (j - first) as u32).collect(),
            coefficients: Packed::new(values, outputs),
        }
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.coefficients.bytes() + 8 * self.retained.len() + 4 * self.dropped.len()
    }

    /// Adds `X a` to `out`: from `fields inputs x columns` to `fields outputs x columns`.
    pub fn left(&self, out: &mut [C64], a: &[C64], columns: usize, fields: usize) {
        let (m, n, d) = (self.inputs, self.outputs, self.dropped.len());
        let mut taken = vec![C64::ZERO; d * columns.min(STRIP)];
        let strips = out.chunks_mut((fields * n * STRIP).max(1)).zip(a.chunks((fields * m * STRIP).max(1)));
        for (out, a) in strips {
            let columns = a.len() / (fields * m);
            for field in 0..fields {
                for (taken, a) in taken.chunks_mut(d.max(1)).zip(a.chunks(fields * m)) {
                    for (taken, &j) in taken.iter_mut().zip(&self.dropped) {
                        *taken = a[field * m + j as usize];
                    }
                }
                let taken = MatRef::from_column_major_slice(&taken[..d * columns], d, columns);
                self.coefficients.panels(0..n, |some, panel| {
                    let whole = MatMut::from_column_major_slice_mut(out, fields * n, columns);
                    let taken = taken.subrows(some.start, some.len());
                    gemm(whole.subrows_mut(field * n, n), Accum::Add, panel, taken, C64::ONE);
                });
                for (out, a) in out.chunks_mut(fields * n).zip(a.chunks(fields * m)) {
                    for &(i, j) in &self.retained {
                        out[field * n + i as usize] += a[field * m + j as usize];
                    }
                }
            }
        }
    }

    /// Adds `a X^T` to `out`: from `rows x fields inputs` to `rows x fields outputs`.
    pub fn right(&self, out: &mut [C64], a: &[C64], rows: usize) {
        for (field, out) in out.chunks_mut((rows * self.outputs).max(1)).enumerate() {
            self.right_some(out, a, rows, field, 0..self.outputs);
        }
    }

    /// Adds `a X^T` to `out` for some outputs of a field: `out` has a column for each of them.
    fn right_some(&self, out: &mut [C64], a: &[C64], rows: usize, field: usize, some: Range<usize>) {
        let columns = &a[rows * self.inputs * field..rows * self.inputs * (field + 1)];
        let mut taken: Vec<C64> = Vec::with_capacity(rows * self.dropped.len().min(PANEL));
        self.coefficients.panels(some.clone(), |dropped, panel| {
            taken.clear();
            for &j in &self.dropped[dropped] {
                taken.extend_from_slice(&columns[rows * j as usize..][..rows]);
            }
            gemm(
                MatMut::from_column_major_slice_mut(out, rows, some.len()),
                Accum::Add,
                MatRef::from_column_major_slice(&taken, rows, panel.ncols()),
                panel.transpose(),
                C64::ONE,
            );
        });
        for &(i, j) in self.retained.iter().filter(|(i, _)| some.contains(&(*i as usize))) {
            let from = &columns[rows * j as usize..][..rows];
            for (out, a) in out[rows * (i as usize - some.start)..][..rows].iter_mut().zip(from) {
                *out += *a;
            }
        }
    }

    /// Adds `X a Y^T` to `out`, or `Z X a Y^T`. X is this basis and `a` a square matrix over all fields of
    /// the inputs of X and Y; no product with `a` is held whole.
    pub fn around(&self, out: &mut [C64], a: &[C64], y: &Self, z: Option<&Self>, fields: usize) {
        let zero = C64::ZERO;
        let (m, n) = (fields * self.inputs, fields * self.outputs);
        let rows = z.map_or(n, |z| fields * z.outputs);
        let (mut strip, mut left) = (Vec::new(), Vec::new());
        for field in 0..fields {
            for first in (0..y.outputs).step_by(STRIP) {
                let some = first..(first + STRIP).min(y.outputs);
                let wide = some.len();
                strip.clear();
                strip.resize(m * wide, zero);
                y.right_some(&mut strip, a, m, field, some);
                let out = &mut out[rows * (field * y.outputs + first)..][..rows * wide];
                match z {
                    None => self.left(out, &strip, wide, fields),
                    Some(z) => {
                        left.clear();
                        left.resize(n * wide, zero);
                        self.left(&mut left, &strip, wide, fields);
                        z.left(out, &left, wide, fields);
                    }
                }
            }
        }
    }

    /// Adds `X^T v` to `out`: from `fields outputs x columns` to `fields inputs x columns`.
    pub fn spread(&self, out: &mut [C64], v: &[C64], columns: usize, fields: usize) {
        let (m, n, d) = (self.inputs, self.outputs, self.dropped.len());
        let mut values = vec![C64::ZERO; d * columns];
        for field in 0..fields {
            let v_matrix = MatRef::from_column_major_slice(v, fields * n, columns);
            self.coefficients.panels(0..n, |some, panel| {
                let values = MatMut::from_column_major_slice_mut(&mut values, d, columns);
                let values = values.subrows_mut(some.start, some.len());
                gemm(values, Accum::Replace, panel.transpose(), v_matrix.subrows(field * n, n), C64::ONE);
            });
            for (column, out) in out.chunks_mut(fields * m).enumerate() {
                for (k, &j) in self.dropped.iter().enumerate() {
                    out[field * m + j as usize] += values[column * d + k];
                }
                for &(i, j) in &self.retained {
                    out[field * m + j as usize] += v[column * fields * n + field * n + i as usize];
                }
            }
        }
    }
}
