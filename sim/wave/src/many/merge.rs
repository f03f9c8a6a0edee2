//! Merge of two groups of bodies: the response of the union from those of its halves, and the data for
//! solves. The equations are those of `hierarchy.rs`.
//!
//! The stored data are the fields that the halves send to each other's borders for a unit that arrives at
//! each site of the union, `K' p`. They are as long as the borders and as wide as the union's rim, smaller
//! than the responses and factors they come from, which are freed with the halves. They are held in fixed
//! point ([`packed`](crate::many::packed)), as interpolations are. Only the root stores factors: its fields
//! come from the sources, which are few compared with the sites. Products are formed in strips of columns, so
//! that little beside these results and the halves is held.

use crate::C64;
use crate::boundary::lu::Lu;
use crate::many::basis::{Basis, STRIP, gemm};
use crate::many::packed::{PANEL, Packed, SHARE};
use crate::many::skeleton::{Exterior, Site};
use faer::{Accum, MatMut, MatRef};
use rayon::prelude::*;

/// Two groups that merge into one.
pub(crate) struct Branch {
    pub children: [usize; 2],
    /// Z of both.
    pub faces: [Basis; 2],
    /// The sites of both borders.
    pub borders: [Vec<Site>; 2],
    /// X of both; none at the root.
    pub outward: Option<[Basis; 2]>,
}

/// Response of a pair to arriving fields, for one part of the fields.
pub(crate) enum Merge {
    /// Fields that arrive at both borders from the other half, for a unit at each site of the union.
    Inner([Packed; 2]),
    Root(Root),
}

/// The pair of all bodies.
pub(crate) struct Root {
    /// `Z S` of both.
    gathered: [Vec<C64>; 2],
    /// The factorized system of the borders.
    lu: Lu<C64>,
}

impl Branch {
    /// Sites of both borders and of both halves, of all fields.
    fn sizes(&self, fields: usize) -> [[usize; 2]; 2] {
        [self.faces.each_ref().map(|z| fields * z.outputs), self.faces.each_ref().map(|z| fields * z.inputs)]
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        let bases = self.faces.iter().chain(self.outward.iter().flatten()).map(Basis::bytes).sum::<usize>();
        bases + self.borders.iter().map(|sites| size_of_val(sites.as_slice())).sum::<usize>()
    }

    /// Peak count of numbers in [`merge`](Self::merge) and [`root`](Self::root), including inputs and
    /// results, and the count stored for solves.
    pub fn numbers(&self, face: Option<&Basis>, fields: f64) -> [f64; 2] {
        let [r, m] = [
            self.faces.each_ref().map(|z| fields * z.outputs as f64),
            self.faces.each_ref().map(|z| fields * z.inputs as f64),
        ];
        let strip = STRIP as f64;
        let border = r[0] + r[1];
        let across = r[0] * r[1] / (fields * fields);
        let gathered = [0, 1].map(|k| r[k] * m[k]);
        let own = [0, 1].map(|k| r[k] * r[k]);
        let inner = [0, 1].map(|k| m[k] * m[k]);
        let Some(outward) = &self.outward else {
            let stored = gathered[0] + gathered[1] + border * border;
            return [stored + strip * (border + m[0].max(m[1])), stored];
        };
        let n = fields * outward[0].outputs as f64;
        let rows = face.map_or(n, |z| fields * z.outputs as f64);
        // Both halves' `K' p` and `X S Z^T`, and intermediate products.
        let made = [0, 1].map(|k| r[k] * (n + rows) + own[k]);
        let strips = [0, 1].map(|k| strip * (2.0 * m[k] + n) + PANEL as f64 * n);
        let first = inner[0] + inner[1] + (gathered[0] + own[0] + r[0] * n).max(made[0] + strips[0]);
        let second = inner[1] + made[0] + (gathered[1] + own[1] + r[1] * n).max(made[1] + strips[1]);
        let solving = border * (n + rows) + border * border + across + (own[0] + own[1]).max(3.0 * border * strip);
        [rows * n + first.max(second).max(solving), SHARE * border * n]
    }

    /// K'_AB, column after column.
    fn across(&self, exterior: Exterior<'_>) -> Vec<C64> {
        let [a, b] = &self.borders;
        let mut out = vec![C64::ZERO; a.len() * b.len()];
        out.par_chunks_mut(a.len().max(1)).zip(b).for_each(|(out, source)| {
            for (out, target) in out.iter_mut().zip(a) {
                *out = exterior.between(target, source);
            }
        });
        out
    }

    /// `out = K'_AB b` of every field, or with K'_BA where `own` is 1.
    fn cross(&self, across: &[C64], own: usize, out: MatMut<'_, C64>, b: MatRef<'_, C64>, fields: usize) {
        let [ra, rb] = [0, 1].map(|k| self.faces[k].outputs);
        let k = MatRef::from_column_major_slice(across, ra, rb);
        let k = if own == 0 { k } else { k.transpose() };
        let mut out = out;
        for field in 0..fields {
            let rows = out.as_mut().subrows_mut(field * k.nrows(), k.nrows());
            gemm(rows, Accum::Replace, k, b.subrows(field * k.ncols(), k.ncols()), C64::ONE);
        }
    }

    /// The factorized system of the borders, from `Z S Z^T` of both.
    fn factorize(&self, own: [Vec<C64>; 2], across: &[C64], fields: usize) -> Lu<C64> {
        let r = self.sizes(fields)[0];
        let border = r[0] + r[1];
        let mut system = vec![C64::ZERO; border * border];
        for (k, own) in own.into_iter().enumerate() {
            let own = MatRef::from_column_major_slice(&own, r[k], r[k]);
            let across = MatRef::from_column_major_slice(across, r[0] / fields, r[1] / fields);
            let across = if k == 0 { across } else { across.transpose() };
            let (rows, columns) = if k == 0 { (0, r[0]) } else { (r[0], 0) };
            for field in 0..fields {
                let (n, wide) = (r[k] / fields, r[1 - k] / fields);
                let mut whole = MatMut::from_column_major_slice_mut(&mut system, border, border);
                let block = whole.as_mut().submatrix_mut(rows, columns + field * wide, r[k], wide);
                gemm(block, Accum::Replace, own.subcols(field * n, n), across, -C64::ONE);
            }
        }
        for j in 0..border {
            system[j * border + j] = C64::ONE;
        }
        Lu::new(system, border)
    }

    /// The part of a half's response that the root needs: `Z S`.
    pub fn face(z: &Basis, response: &[C64], fields: usize) -> Vec<C64> {
        let mut out = vec![C64::ZERO; fields * z.outputs * fields * z.inputs];
        z.left(&mut out, response, fields * z.inputs, fields);
        out
    }

    /// Data of the root for solves, from `Z S` of the halves. Here memory is at its peak, so the system is
    /// computed in strips, without other arrays of its size.
    pub fn root(&self, gathered: [Vec<C64>; 2], fields: usize, exterior: Exterior<'_>) -> Root {
        let zero = C64::ZERO;
        let [r, m] = self.sizes(fields);
        let border = r[0] + r[1];
        let mut system = vec![zero; border * border];
        for k in 0..2 {
            let (own, others) = (&self.borders[k], &self.borders[1 - k]);
            let row = if k == 0 { 0 } else { r[0] };
            let mut column = r[0] - row;
            for field in 0..fields {
                for sources in others.chunks(STRIP) {
                    // K' from these sites, and Z^T of it.
                    let mut crossed = vec![zero; r[k] * sources.len()];
                    crossed.par_chunks_mut(r[k].max(1)).zip(sources).for_each(|(out, source)| {
                        for (out, target) in out[field * own.len()..].iter_mut().zip(own) {
                            *out = exterior.between(target, source);
                        }
                    });
                    let mut arrived = vec![zero; m[k] * sources.len()];
                    self.faces[k].spread(&mut arrived, &crossed, sources.len(), fields);
                    drop(crossed);
                    let mut whole = MatMut::from_column_major_slice_mut(&mut system, border, border);
                    gemm(
                        whole.as_mut().submatrix_mut(row, column, r[k], sources.len()),
                        Accum::Replace,
                        MatRef::from_column_major_slice(&gathered[k], r[k], m[k]),
                        MatRef::from_column_major_slice(&arrived, m[k], sources.len()),
                        -C64::ONE,
                    );
                    column += sources.len();
                }
            }
        }
        for j in 0..border {
            system[j * border + j] = C64::ONE;
        }
        Root { gathered, lu: Lu::new(system, border) }
    }

    /// The response of the union and the data for solves, from the responses of the halves. With a `face`,
    /// only the response through it, `Z S`, is computed.
    pub fn merge(
        &self,
        outward: &[Basis; 2],
        inner: [Vec<C64>; 2],
        face: Option<&Basis>,
        fields: usize,
        exterior: Exterior<'_>,
    ) -> (Vec<C64>, [Packed; 2]) {
        let (zero, one) = (C64::ZERO, C64::ONE);
        let f = fields;
        let r = self.sizes(f)[0];
        let border = r[0] + r[1];
        let n = f * outward[0].outputs;
        let rows = face.map_or(n, |z| f * z.outputs);
        let mut response = vec![zero; rows * n];
        let [mut own, mut sent, mut radiated] = [(); 3].map(|()| [Vec::new(), Vec::new()]);
        for (k, inner) in inner.into_iter().enumerate() {
            let (z, x) = (&self.faces[k], &outward[k]);
            let through_face = Self::face(z, &inner, f);
            own[k] = vec![zero; r[k] * r[k]];
            z.right(&mut own[k], &through_face, r[k]);
            // Z S X^T, X S Z^T and X S X^T.
            sent[k] = vec![zero; r[k] * n];
            x.right(&mut sent[k], &through_face, r[k]);
            drop(through_face);
            radiated[k] = vec![zero; rows * r[k]];
            x.around(&mut radiated[k], &inner, z, face, f);
            x.around(&mut response, &inner, x, face, f);
        }
        let across = self.across(exterior);
        let lu = self.factorize(own, &across, f);
        for first in (0..n).step_by(STRIP) {
            let wide = STRIP.min(n - first);
            // Strengths of the borders for a unit at each of these sites of the union.
            let mut strengths = Vec::with_capacity(border * wide);
            for column in first..first + wide {
                for k in 0..2 {
                    strengths.extend_from_slice(&sent[k][r[k] * column..][..r[k]]);
                }
            }
            lu.solve(MatMut::from_column_major_slice_mut(&mut strengths, border, wide));
            let strengths = MatRef::from_column_major_slice(&strengths, border, wide);
            for k in 0..2 {
                let from = if k == 0 { strengths.subrows(r[0], r[1]) } else { strengths.subrows(0, r[0]) };
                let sent = &mut sent[k][r[k] * first..][..r[k] * wide];
                self.cross(&across, k, MatMut::from_column_major_slice_mut(sent, r[k], wide), from, f);
                // Strengths that the union radiates, through X S Z^T.
                gemm(
                    MatMut::from_column_major_slice_mut(&mut response[rows * first..][..rows * wide], rows, wide),
                    Accum::Add,
                    MatRef::from_column_major_slice(&radiated[k], rows, r[k]),
                    MatRef::from_column_major_slice(sent, r[k], wide),
                    one,
                );
            }
        }
        // One half after the other: each is freed when it is packed.
        let pack = |sent: Vec<C64>, k: usize| Packed::new(&sent, r[k]);
        let [first, second] = sent;
        (response, [pack(first, 0), pack(second, 1)])
    }

    /// Fields that arrive at the sites of both halves, from those that arrive at the union.
    pub fn arrive(&self, sent: &[Packed; 2], u: &[C64], columns: usize, fields: usize) -> [Vec<C64>; 2] {
        let zero = C64::ZERO;
        let [r, m] = self.sizes(fields);
        [0, 1].map(|k| {
            let mut out = vec![zero; m[k] * columns];
            let Some(outward) = &self.outward else { return out };
            outward[k].spread(&mut out, u, columns, fields);
            let u = MatRef::from_column_major_slice(u, fields * outward[k].outputs, columns);
            let mut crossed = vec![zero; r[k] * columns];
            sent[k].panels(0..r[k], |some, panel| {
                let crossed = MatMut::from_column_major_slice_mut(&mut crossed, r[k], columns);
                gemm(crossed, Accum::Add, panel, u.subrows(some.start, some.len()), C64::ONE);
            });
            self.faces[k].spread(&mut out, &crossed, columns, fields);
            out
        })
    }

    /// The same at the root, from the fields that arrive at both halves from outside.
    pub fn arrive_at_root(
        &self,
        root: &Root,
        mut inner: [Vec<C64>; 2],
        columns: usize,
        fields: usize,
        exterior: Exterior<'_>,
    ) -> [Vec<C64>; 2] {
        let zero = C64::ZERO;
        let [r, m] = self.sizes(fields);
        let border = r[0] + r[1];
        let mut strengths = vec![zero; border * columns];
        let mut first = 0;
        for k in 0..2 {
            gemm(
                MatMut::from_column_major_slice_mut(&mut strengths, border, columns).subrows_mut(first, r[k]),
                Accum::Replace,
                MatRef::from_column_major_slice(&root.gathered[k], r[k], m[k]),
                MatRef::from_column_major_slice(&inner[k], m[k], columns),
                C64::ONE,
            );
            first += r[k];
        }
        root.lu.solve(MatMut::from_column_major_slice_mut(&mut strengths, border, columns));
        let strengths = MatRef::from_column_major_slice(&strengths, border, columns);
        let across = self.across(exterior);
        for (k, inner) in inner.iter_mut().enumerate() {
            let from = if k == 0 { strengths.subrows(r[0], r[1]) } else { strengths.subrows(0, r[0]) };
            let mut crossed = vec![zero; r[k] * columns];
            self.cross(&across, k, MatMut::from_column_major_slice_mut(&mut crossed, r[k], columns), from, fields);
            self.faces[k].spread(inner, &crossed, columns, fields);
        }
        inner
    }
}
