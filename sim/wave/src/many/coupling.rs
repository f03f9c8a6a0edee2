//! The coupled system of skeletons for the fields that arrive at each body from all others,
//! `v_b - sum_c K_bc T_c v_c = v_b^ext`.
//!
//! v holds a body's combined functionals (see [`skeleton`](crate::many::skeleton)) of the fields that arrive
//! from outside, T_c maps them to the strengths of its sites as sources, and K_bc is the kernel between
//! sites, the same for e and h. The matrix is dense; where the tolerance allows, it is held and factorized in
//! single precision, which is half the memory and twice the speed, and the solution is refined against
//! residuals in double precision, for which K is computed again. The residual is that of the whole system in
//! double precision in either case.

use crate::C64;
use crate::boundary::kernel::MediumKernel;
use crate::boundary::lu::Lu;
use crate::many::skeleton::{Site, combined};
use faer::linalg::matmul::matmul;
use faer::traits::ComplexField;
use faer::{Accum, MatMut, MatRef, Par};
use num_complex::Complex32;
use rayon::prelude::*;
use std::ops::AddAssign;

/// Minimum tolerance for which single precision suffices.
pub(crate) const SINGLE: f64 = 1e-6;
/// Number of sites whose equations are checked if a system is not solved whole.
const WITNESSES: usize = 1024;
/// Maximum number of refinements.
const REFINEMENTS: usize = 30;

/// Exterior and sites of all bodies.
pub(crate) struct Coupling<'a> {
    pub kernel: &'a MediumKernel,
    pub k_rho: f64,
    /// Sites of each body.
    pub sites: Vec<&'a [Site]>,
}

impl Coupling<'_> {
    /// K_bc, column after column.
    fn block(&self, b: usize, c: usize) -> Vec<C64> {
        let targets = self.sites[b];
        let mut out = Vec::with_capacity(targets.len() * self.sites[c].len());
        for source in self.sites[c] {
            out.extend(targets.iter().map(|target| combined(self.kernel, self.k_rho, target, source)));
        }
        out
    }

    /// Fields that arrive from strengths: `[body]`, columns of one value per site, in and out.
    pub(crate) fn apply(&self, strengths: &[Vec<C64>]) -> Vec<Vec<C64>> {
        (0..self.sites.len())
            .into_par_iter()
            .map(|b| {
                let k = self.sites[b].len();
                let columns = strengths[0].len() / self.sites[0].len();
                let mut out = vec![C64::ZERO; k * columns];
                for (c, strengths) in strengths.iter().enumerate().filter(|(c, _)| *c != b) {
                    product(&mut out, Accum::Add, &self.block(b, c), k, strengths, self.sites[c].len(), C64::ONE);
                }
                out
            })
            .collect()
    }

    /// Residual of the equations of some sites, spread over all bodies, for the strengths that v excites:
    /// root mean square relative to that of the external fields at the same sites, the largest over all
    /// columns. Arrays as in [`solve`](Self::solve).
    pub(crate) fn witness(&self, strengths: &[Vec<C64>], v: &[Vec<C64>], external: &[Vec<C64>], fields: usize) -> f64 {
        let all: usize = self.sites.iter().map(|s| s.len()).sum();
        let columns = v[0].len() / (fields * self.sites[0].len());
        let apart = (all as f64 / WITNESSES as f64).max(1.0);
        let mut next = 0.5 * apart;
        let mut first = 0;
        let mut chosen: Vec<Vec<usize>> = Vec::new();
        for sites in &self.sites {
            let mut own = Vec::new();
            while next < (first + sites.len()) as f64 {
                own.push(next as usize - first);
                next += apart;
            }
            first += sites.len();
            chosen.push(own);
        }
        let sums: Vec<Vec<[f64; 2]>> = (0..self.sites.len())
            .into_par_iter()
            .filter(|&b| !chosen[b].is_empty())
            .map(|b| {
                let (rows, k) = (&chosen[b], self.sites[b].len());
                let mut arrived = vec![C64::ZERO; rows.len() * fields * columns];
                for (c, strengths) in strengths.iter().enumerate().filter(|(c, _)| *c != b) {
                    let mut block = Vec::with_capacity(rows.len() * self.sites[c].len());
                    for source in self.sites[c] {
                        block
                            .extend(rows.iter().map(|&j| combined(self.kernel, self.k_rho, &self.sites[b][j], source)));
                    }
                    product(&mut arrived, Accum::Add, &block, rows.len(), strengths, self.sites[c].len(), C64::ONE);
                }
                let mut sums = vec![[0.0; 2]; columns];
                for (column, arrived) in arrived.chunks(rows.len()).enumerate() {
                    let sum = &mut sums[column / fields];
                    for (arrived, &j) in arrived.iter().zip(rows) {
                        let external = external[b][column * k + j];
                        sum[0] += (external + arrived - v[b][column * k + j]).norm_sqr();
                        sum[1] += external.norm_sqr();
                    }
                }
                sums
            })
            .collect();
        (0..columns)
            .map(|column| {
                let sum = |k: usize| sums.iter().map(|s| s[column][k]).sum::<f64>();
                if sum(1) == 0.0 { 0.0 } else { (sum(0) / sum(1)).sqrt() }
            })
            .fold(0.0, |worst: f64, r| if r.is_nan() { f64::NAN } else { worst.max(r) })
    }

    /// `1 - K T` in one precision for several T at once (`[system][body]`, each `fields k` square), body
    /// after body, with the fields of a body side by side.
    fn matrices<T: Number>(&self, transfers: &[Vec<Vec<C64>>], fields: usize) -> Vec<Vec<T>> {
        let firsts = self.firsts(fields);
        let n = firsts[self.sites.len()];
        let mut matrices: Vec<Vec<T>> = transfers.iter().map(|_| vec![T::round(C64::ZERO); n * n]).collect();
        // Columns of one body, in all matrices.
        let mut slabs: Vec<Vec<&mut [T]>> = self.sites.iter().map(|_| Vec::new()).collect();
        for matrix in &mut matrices {
            let mut rest = matrix.as_mut_slice();
            for (slab, ends) in slabs.iter_mut().zip(firsts.windows(2)) {
                let (columns, others) = rest.split_at_mut((ends[1] - ends[0]) * n);
                slab.push(columns);
                rest = others;
            }
        }
        slabs.into_par_iter().enumerate().for_each(|(c, mut slab)| {
            let kc = self.sites[c].len();
            for (j, b) in
                (0..self.sites.len()).map(|b| (b, self.sites[b].len())).filter(|(b, _)| *b != c).map(|(b, k)| (k, b))
            {
                let block = self.block(b, c);
                // (fields j) x (fields kc), from one field of the sources: T's rows of that field.
                let mut received = vec![C64::ZERO; j * fields * kc];
                for (columns, transfer) in slab.iter_mut().zip(transfers) {
                    for field in 0..fields {
                        // Rows of T that belong to the field.
                        let lines = MatRef::from_column_major_slice(&transfer[c], fields * kc, fields * kc)
                            .subrows(field * kc, kc);
                        matmul(
                            MatMut::from_column_major_slice_mut(&mut received, j, fields * kc),
                            Accum::Replace,
                            MatRef::from_column_major_slice(&block, j, kc),
                            lines,
                            -C64::ONE,
                            Par::Seq,
                        );
                        let row = firsts[b] + field * j;
                        for (out, values) in columns.chunks_mut(n).zip(received.chunks(j)) {
                            for (out, value) in out[row..row + j].iter_mut().zip(values) {
                                *out = T::round(*value);
                            }
                        }
                    }
                }
            }
            for columns in &mut slab {
                for (j, column) in columns.chunks_mut(n).enumerate() {
                    column[firsts[c] + j] = T::round(C64::ONE);
                }
            }
        });
        matrices
    }

    fn firsts(&self, fields: usize) -> Vec<usize> {
        let mut firsts = vec![0];
        for sites in &self.sites {
            firsts.push(firsts[firsts.len() - 1] + fields * sites.len());
        }
        firsts
    }

    /// Factorizes one system for each of `transfers`.
    pub(crate) fn factorize(&self, transfers: &[Vec<Vec<C64>>], fields: usize, single: bool) -> Vec<Factors> {
        let n = self.firsts(fields)[self.sites.len()];
        if single {
            self.matrices::<Complex32>(transfers, fields).into_iter().map(|m| Factors::Single(Lu::new(m, n))).collect()
        } else {
            self.matrices::<C64>(transfers, fields).into_iter().map(|m| Factors::Double(Lu::new(m, n))).collect()
        }
    }

    /// Solves for the arriving fields, in place (`[body]`, columns of `fields` values per site), until the
    /// residual is below `tolerance` or no longer falls. Returns it, relative to the external fields, and the
    /// number of refinements.
    pub(crate) fn solve(
        &self,
        factors: &Factors,
        transfer: &[Vec<C64>],
        fields: usize,
        v: &mut [Vec<C64>],
        tolerance: f64,
    ) -> (f64, usize) {
        let columns = v[0].len() / (fields * self.sites[0].len());
        let external = v.to_vec();
        let sizes = norms(&external, columns);
        let mut rest = external.clone();
        for part in v.iter_mut() {
            part.fill(C64::ZERO);
        }
        let mut best = f64::INFINITY;
        for pass in 0..=REFINEMENTS {
            self.step(factors, fields, &rest, columns, v);
            // rest = external - v + K T v
            let strengths: Vec<Vec<C64>> = v
                .par_iter()
                .zip(transfer)
                .map(|(v, t)| {
                    let k = v.len() / columns;
                    let mut out = vec![C64::ZERO; v.len()];
                    product(&mut out, Accum::Replace, t, k, v, k, C64::ONE);
                    out
                })
                .collect();
            rest = self.apply(&strengths);
            for ((rest, v), external) in rest.iter_mut().zip(v.iter()).zip(&external) {
                for ((rest, v), external) in rest.iter_mut().zip(v).zip(external) {
                    *rest += external - v;
                }
            }
            let residual = norms(&rest, columns)
                .iter()
                .zip(&sizes)
                .map(|(r, s)| if *s == 0.0 { 0.0 } else { r / s })
                .fold(0.0, |worst: f64, r| if r.is_nan() { f64::NAN } else { worst.max(r) });
            if residual.is_nan() || residual <= tolerance || residual > 0.5 * best {
                return (residual, pass);
            }
            best = residual;
        }
        (best, REFINEMENTS)
    }

    /// Adds the factors' solution for `rest` to v.
    fn step(&self, factors: &Factors, fields: usize, rest: &[Vec<C64>], columns: usize, v: &mut [Vec<C64>]) {
        let firsts = self.firsts(fields);
        let n = firsts[self.sites.len()];
        let mut rhs = vec![C64::ZERO; n * columns];
        for (column, rhs) in rhs.chunks_mut(n).enumerate() {
            for (ends, rest) in firsts.windows(2).zip(rest) {
                let k = ends[1] - ends[0];
                rhs[ends[0]..ends[1]].copy_from_slice(&rest[column * k..][..k]);
            }
        }
        match factors {
            Factors::Double(lu) => lu.solve(MatMut::from_column_major_slice_mut(&mut rhs, n, columns)),
            Factors::Single(lu) => {
                // Residuals fall below the range of single precision, so each column is scaled to 1.
                let scales: Vec<f64> = rhs
                    .chunks(n)
                    .map(|c| c.iter().map(|v| v.norm_sqr()).fold(0.0, f64::max).sqrt())
                    .map(|s| if s > 0.0 { s } else { 1.0 })
                    .collect();
                let mut small: Vec<Complex32> = Vec::with_capacity(rhs.len());
                for (column, scale) in rhs.chunks(n).zip(&scales) {
                    small.extend(column.iter().map(|v| Complex32::round(*v / *scale)));
                }
                lu.solve(MatMut::from_column_major_slice_mut(&mut small, n, columns));
                for ((rhs, small), scale) in rhs.chunks_mut(n).zip(small.chunks(n)).zip(&scales) {
                    for (out, value) in rhs.iter_mut().zip(small) {
                        *out = value.wide() * *scale;
                    }
                }
            }
        }
        for (column, answer) in rhs.chunks(n).enumerate() {
            for (ends, v) in firsts.windows(2).zip(v.iter_mut()) {
                let k = ends[1] - ends[0];
                for (v, a) in v[column * k..][..k].iter_mut().zip(&answer[ends[0]..ends[1]]) {
                    *v += a;
                }
            }
        }
    }
}

/// Norm of each column of vectors that are cut into bodies.
fn norms(v: &[Vec<C64>], columns: usize) -> Vec<f64> {
    let mut sums = vec![0.0; columns];
    for part in v {
        for (sum, column) in sums.iter_mut().zip(part.chunks(part.len() / columns)) {
            *sum += column.iter().map(|c| c.norm_sqr()).sum::<f64>();
        }
    }
    sums.into_iter().map(f64::sqrt).collect()
}

/// `out = factor a b` (or added), all column after column: a is `rows x inner`.
pub(crate) fn product(out: &mut [C64], accum: Accum, a: &[C64], rows: usize, b: &[C64], inner: usize, factor: C64) {
    let columns = out.len() / rows;
    matmul(
        MatMut::from_column_major_slice_mut(out, rows, columns),
        accum,
        MatRef::from_column_major_slice(a, rows, inner),
        MatRef::from_column_major_slice(b, inner, columns),
        factor,
        Par::Seq,
    );
}

/// Complex numbers of either precision.
pub(crate) trait Number: ComplexField + Copy + Send + Sync + AddAssign {
    fn round(value: C64) -> Self;
    fn wide(self) -> C64;
}

impl Number for C64 {
    fn round(value: C64) -> Self {
        value
    }

    fn wide(self) -> C64 {
        self
    }
}

impl Number for Complex32 {
    fn round(value: C64) -> Self {
        Complex32::new(value.re as f32, value.im as f32)
    }

    fn wide(self) -> C64 {
        C64::new(f64::from(self.re), f64::from(self.im))
    }
}

/// A factorized system.
pub(crate) enum Factors {
    Single(Lu<Complex32>),
    Double(Lu<C64>),
}
