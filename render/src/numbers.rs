//! Random numbers of a path: for each pixel, an Owen-scrambled Sobol sequence over its samples (Burley,
//! "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020), with one dimension for each number that the path
//! draws.

use plywave::math::hash::{GAMMA, mix64};
use rand::TryRng;
use sobol_burley::{NUM_DIMENSION_SETS_4D, sample_4d};
use std::convert::Infallible;

/// Number of bits of a sample's index within one sequence.
const INDEX_BITS: u32 = 16;
const UNIT: f32 = (1u64 << 32) as f32;

/// Random numbers of one sample of a pixel, in order. Each is uniform by itself. Over the samples of a pixel,
/// the numbers of one dimension, and pairs from dimensions of one set of four, are stratified.
#[derive(Clone, Debug)]
pub struct PathNumbers {
    index: u32,
    seed: u64,
    /// Number of dimensions drawn.
    taken: u32,
    four: [f32; 4],
    is_even: bool,
}

impl PathNumbers {
    /// Numbers of the sample with index `sample`; `seed` belongs to the pixel.
    pub fn new(seed: u64, sample: u32) -> PathNumbers {
        let seed = mix64(seed ^ u64::from(sample >> INDEX_BITS).wrapping_mul(GAMMA));
        PathNumbers { index: sample & ((1 << INDEX_BITS) - 1), seed, taken: 0, four: [0.0; 4], is_even: true }
    }

    /// Independent numbers, for paths so long that stratification has no effect: the variance over samples
    /// then gives the variance of their mean.
    pub fn independent(seed: u64, sample: u32) -> PathNumbers {
        PathNumbers {
            is_even: false,
            seed: mix64(seed).wrapping_add(u64::from(sample)),
            ..PathNumbers::new(seed, sample)
        }
    }

    /// The next number, 0 to 1.
    fn take(&mut self) -> f32 {
        if !self.is_even {
            self.taken = self.taken.wrapping_add(1);
            let word = mix64(mix64(self.seed).wrapping_add(u64::from(self.taken).wrapping_mul(GAMMA)));
            return (word >> 40) as f32 / (1u32 << 24) as f32;
        }
        let within = self.taken % 4;
        if within == 0 {
            // Dimensions beyond the last one continue in another sequence.
            let set = self.taken / 4;
            let seed = mix64(self.seed.wrapping_add(u64::from(set / NUM_DIMENSION_SETS_4D)));
            self.four = sample_4d(self.index, set % NUM_DIMENSION_SETS_4D, seed as u32);
        }
        self.taken = self.taken.wrapping_add(1);
        self.four[within as usize]
    }
}

impl TryRng for PathNumbers {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok((self.take() * UNIT) as u32)
    }

    /// Draws one dimension; a hash fills the bits below single precision.
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        let high = (self.take() * UNIT) as u64;
        let low = mix64(self.seed ^ u64::from(self.index) << 32 ^ u64::from(self.taken));
        Ok(high << 32 | low & 0xffff_ffff)
    }

    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        for chunk in bytes.chunks_mut(4) {
            let word = self.try_next_u32()?.to_le_bytes();
            chunk.copy_from_slice(&word[..chunk.len()]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    /// In 256 samples, each sixteenth of a dimension contains sixteen numbers and each cell of two
    /// neighboring dimensions one; other pixels and later sequences have different numbers.
    #[test]
    fn samples_are_evenly_spread() {
        let of = |seed: u64, first: u32, dimension: usize| -> Vec<f32> {
            (first..first + 256)
                .map(|sample| {
                    let mut numbers = PathNumbers::new(seed, sample);
                    (0..dimension).for_each(|_| {
                        let _: f32 = numbers.random();
                    });
                    numbers.random()
                })
                .collect()
        };
        for dimension in [0, 1, 7, 255, 300, 1023] {
            let mut counts = [0; 16];
            of(9, 0, dimension).iter().for_each(|v| counts[(v * 16.0) as usize] += 1);
            assert_eq!(counts, [16; 16], "{dimension}");
        }
        let mut cells = [0; 256];
        for (a, b) in of(9, 0, 0).iter().zip(of(9, 0, 1)) {
            cells[16 * (a * 16.0) as usize + (b * 16.0) as usize] += 1;
        }
        assert_eq!(cells, [1; 256]);
        let numbers = of(9, 0, 0);
        for other in [of(8, 0, 0), of(9, 0, 256), of(9, 1 << 16, 0)] {
            let same = numbers.iter().zip(&other).filter(|(a, b)| a == b).count();
            assert!(same < 3, "{same}");
        }
        // A number in double precision uses one dimension.
        let (mut a, mut b) = (PathNumbers::new(3, 5), PathNumbers::new(3, 5));
        let (double, single): (f64, f32) = (a.random(), b.random());
        assert!((double - f64::from(single)).abs() < 1e-6);
        assert_eq!(a.random::<f32>(), b.random::<f32>());
    }
}
