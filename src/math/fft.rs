//! Fourier transforms of several sequences side by side, with power-of-two lengths (Cooley and Tukey 1965,
//! radix 2).
//!
//! No operation is fused and no function of the system's library is called, so results are bit-identical on
//! all machines.

use super::simd::{signed, sin_cos_half_turns};
use multiversion::multiversion;

/// Number of sequences that are transformed side by side: a cache line.
pub(crate) const LANES: usize = 16;
/// One element of all sequences.
pub(crate) type Lanes = [f32; LANES];

/// The transform of one length.
pub(crate) struct Fft {
    /// Cosine and sine of k / n turns, k below n / 2.
    turns: Vec<[f32; 2]>,
}

impl Fft {
    /// A transform of n elements, a power of two.
    pub(crate) fn new(n: usize) -> Fft {
        let turn = |k: usize| {
            let (sin, cos, sign) = sin_cos_half_turns::<false>((2 * k) as f32 / n as f32);
            [signed(cos, sign), signed(sin, sign)]
        };
        Fft { turns: (0..n / 2).map(turn).collect() }
    }

    /// `z[j] = sum over k of z[k] exp(2 pi i j k / n)`, in place and not normalized; `re` and `im` have n
    /// elements.
    pub(crate) fn inverse(&self, re: &mut [Lanes], im: &mut [Lanes]) {
        let n = 2 * self.turns.len();
        debug_assert!(n.is_power_of_two() && re.len() == n && im.len() == n);
        let shift = usize::BITS - n.trailing_zeros();
        for i in 0..n {
            let j = i.reverse_bits() >> shift;
            if i < j {
                re.swap(i, j);
                im.swap(i, j);
            }
        }
        butterflies(&self.turns, re, im);
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn butterflies(turns: &[[f32; 2]], re: &mut [Lanes], im: &mut [Lanes]) {
    let mut half = 1;
    while half <= turns.len() {
        let stride = turns.len() / half;
        for (re, im) in re.chunks_exact_mut(2 * half).zip(im.chunks_exact_mut(2 * half)) {
            let ((re_a, re_b), (im_a, im_b)) = (re.split_at_mut(half), im.split_at_mut(half));
            let a = re_a.iter_mut().zip(im_a);
            let b = re_b.iter_mut().zip(im_b);
            for (((re_a, im_a), (re_b, im_b)), [cos, sin]) in a.zip(b).zip(turns.iter().step_by(stride)) {
                for l in 0..LANES {
                    let x = re_b[l] * cos - im_b[l] * sin;
                    let y = re_b[l] * sin + im_b[l] * cos;
                    (re_b[l], im_b[l]) = (re_a[l] - x, im_a[l] - y);
                    (re_a[l], im_a[l]) = (re_a[l] + x, im_a[l] + y);
                }
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::SplitMix64;
    use std::f64::consts::TAU;

    /// Agrees with the sum itself.
    #[test]
    fn transforms_are_the_direct_ones() {
        let mut rng = SplitMix64(3);
        for n in [2usize, 4, 8, 64, 512] {
            let mut draw = || -> Vec<Lanes> {
                (0..n).map(|_| std::array::from_fn(|_| (2.0 * rng.next_f64() - 1.0) as f32)).collect()
            };
            let (re, im) = (draw(), draw());
            let (mut got_re, mut got_im) = (re.clone(), im.clone());
            Fft::new(n).inverse(&mut got_re, &mut got_im);
            for l in [0, 1, LANES - 1] {
                for j in 0..n {
                    let (mut x, mut y) = (0.0, 0.0);
                    for k in 0..n {
                        let (sin, cos) = (TAU * (j * k % n) as f64 / n as f64).sin_cos();
                        let (a, b) = (f64::from(re[k][l]), f64::from(im[k][l]));
                        (x, y) = (x + a * cos - b * sin, y + a * sin + b * cos);
                    }
                    let error = (f64::from(got_re[j][l]) - x).abs().max((f64::from(got_im[j][l]) - y).abs());
                    assert!(error < 1e-6 * (n as f64).sqrt(), "{n} {l} {j}: off by {error}");
                }
            }
        }
    }
}
