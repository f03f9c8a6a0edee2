//! Matrices in fixed point of 40 bits, with ten bytes per complex number in place of sixteen, for long-lived
//! data of merged groups that is used a panel at a time.
//!
//! The allowed error of an interpolation's coefficients is the same within a column: the error of an omitted
//! site's field is the sum of the errors of its coefficients times the fields of the sites that represent it.
//! Each column has its own step, the power of 2 that is 2^-39 to 2^-38 of its largest real or imaginary part;
//! the rounding error is half of it, at most 1.8e-12 of that part. Single precision has an error of 6e-8 of
//! each coefficient, which is too much.

use crate::C64;
use faer::MatRef;
use std::ops::Range;

/// Bits of a number of steps, without the sign.
const BITS: i64 = 39;
/// Number of columns unpacked at a time.
pub(crate) const PANEL: usize = 256;
/// Memory of an entry over that of a complex number.
pub(crate) const SHARE: f64 = 10.0 / 16.0;

/// A matrix, column after column.
pub(crate) struct Packed {
    rows: usize,
    /// Size of a step, by column; NaN if an entry is not finite.
    steps: Vec<f64>,
    /// Steps of real and imaginary parts: the upper 32 bits with the sign, the lower 8.
    upper: Vec<[i32; 2]>,
    lower: Vec<[u8; 2]>,
}

/// 2^e, for exponents of normal numbers.
fn power(e: i64) -> f64 {
    f64::from_bits(((e + 1023) as u64) << 52)
}

impl Packed {
    /// Packs `values`, columns of `rows` entries.
    pub fn new(values: &[C64], rows: usize) -> Self {
        let columns = values.len().checked_div(rows).unwrap_or(0);
        let mut packed = Self {
            rows,
            steps: Vec::with_capacity(columns),
            upper: Vec::with_capacity(values.len()),
            lower: Vec::with_capacity(values.len()),
        };
        for column in values.chunks(rows.max(1)) {
            let finite = column.iter().all(|c| c.is_finite());
            let largest = column.iter().map(|c| c.re.abs().max(c.im.abs())).fold(0.0, f64::max);
            // largest < 2^(exponent + 1); columns too small for steps of their own are zero.
            let exponent = (largest.to_bits() >> 52) as i64 - 1023;
            let (step, per_step) = match exponent + 1 - BITS {
                _ if !finite => (f64::NAN, 0.0),
                e if e > -1022 => (power(e), power(-e)),
                _ => (0.0, 0.0),
            };
            packed.steps.push(step);
            for c in column {
                let max = (1i64 << BITS) - 1;
                let steps = [c.re, c.im].map(|x| ((x * per_step).round() as i64).clamp(-max, max));
                packed.upper.push(steps.map(|n| (n >> 8) as i32));
                packed.lower.push(steps.map(|n| (n & 255) as u8));
            }
        }
        packed
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        size_of_val(self.steps.as_slice()) + size_of_val(self.upper.as_slice()) + size_of_val(self.lower.as_slice())
    }

    /// Unpacks panels of some rows, one after the other, and passes each with its columns to `take`.
    pub fn panels(&self, rows: Range<usize>, mut take: impl FnMut(Range<usize>, MatRef<'_, C64>)) {
        let mut panel = Vec::new();
        for first in (0..self.steps.len()).step_by(PANEL) {
            let columns = first..(first + PANEL).min(self.steps.len());
            self.unpack(rows.clone(), columns.clone(), &mut panel);
            take(columns.clone(), MatRef::from_column_major_slice(&panel, rows.len(), columns.len()));
        }
    }

    /// Unpacks some rows of some columns, replacing the contents of `out`.
    fn unpack(&self, rows: Range<usize>, columns: Range<usize>, out: &mut Vec<C64>) {
        let tall = rows.len();
        out.clear();
        out.resize(tall * columns.len(), C64::ZERO);
        for (column, out) in columns.zip(out.chunks_mut(tall.max(1))) {
            let step = self.steps[column];
            let own = column * self.rows + rows.start..column * self.rows + rows.end;
            for ((out, upper), lower) in out.iter_mut().zip(&self.upper[own.clone()]).zip(&self.lower[own]) {
                let part = |k: usize| (f64::from(upper[k]) * 256.0 + f64::from(lower[k])) * step;
                *out = C64::new(part(0), part(1));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns from 1e-200 to 1e300 are restored to 2^-39 of their largest entry, multiples of a step
    /// exactly, and parts of the matrix as in the whole.
    #[test]
    fn entries_come_back() {
        let (rows, sizes) = (300, [1.0, 1e-200, 7e300, 0.0, 3e-5]);
        let entry = |i: usize, j: usize| {
            let k = (i + rows * j) as f64;
            C64::new((1.7 * k).sin().powi(5), (0.9 * k).cos().powi(9)) * sizes[j]
        };
        let mut values: Vec<C64> = (0..sizes.len()).flat_map(|j| (0..rows).map(move |i| entry(i, j))).collect();
        values[4] = C64::new(-2.0, 0.125);
        let packed = Packed::new(&values, rows);
        assert_eq!(packed.bytes(), 10 * values.len() + 8 * sizes.len());
        let mut whole = vec![C64::ONE; 3];
        packed.unpack(0..rows, 0..sizes.len(), &mut whole);
        for (j, (got, want)) in whole.chunks(rows).zip(values.chunks(rows)).enumerate() {
            let largest = want.iter().map(|c| c.re.abs().max(c.im.abs())).fold(0.0, f64::max);
            for (got, want) in got.iter().zip(want) {
                let off = (got.re - want.re).abs().max((got.im - want.im).abs());
                assert!(off <= 0.5f64.powi(39) * largest, "column {j}: {got} for {want}");
            }
        }
        assert_eq!(whole[4], values[4]);
        let mut part = Vec::new();
        packed.unpack(20..290, 1..3, &mut part);
        let mut unpacked = Vec::new();
        packed.panels(20..290, |columns, panel| {
            assert_eq!(columns, 0..sizes.len());
            unpacked.extend(columns.map(|j| panel[(7, j)]));
        });
        assert!(unpacked.iter().enumerate().all(|(j, v)| *v == whole[rows * j + 27]));
        for (j, part) in part.chunks(270).enumerate() {
            assert_eq!(part, &whole[rows * (j + 1) + 20..][..270]);
        }
    }

    /// Non-finite values stay visible; matrices may have no rows or columns.
    #[test]
    fn odd_matrices() {
        let (nan, infinite) = (C64::new(f64::NAN, 0.0), C64::new(0.0, f64::INFINITY));
        let packed = Packed::new(&[C64::ONE, nan, C64::ONE, C64::ONE, infinite, C64::ONE], 2);
        let mut out = Vec::new();
        packed.unpack(0..2, 0..3, &mut out);
        let bad = out.iter().map(|c| c.is_nan()).collect::<Vec<bool>>();
        assert_eq!(bad, [true, true, false, false, true, true]);
        for (values, rows) in [(0, 0), (0, 5)] {
            let none = Packed::new(&vec![C64::ONE; values], rows);
            none.unpack(0..rows, 0..0, &mut out);
            assert!(out.is_empty() && none.bytes() == 0);
        }
    }
}
