//! Hashes, and the random stream that is built from them. None is cryptographic. All give the same numbers on
//! every machine.

/// The odd number nearest to 2^64 divided by the golden ratio: the increment of SplitMix64, and a factor that
/// spreads small integers over 64 bits.
pub const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finalizer of SplitMix64 (Steele, Lea and Flood 2014): every bit of the result depends on every bit of
/// `x`.
#[inline(always)]
pub fn mix64(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A mixing hash of 32 bits (C. Wellons' lowbias32, 2018).
#[inline(always)]
pub fn mix32(x: u32) -> u32 {
    let x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    let x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// The random stream SplitMix64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SplitMix64(pub u64);

impl SplitMix64 {
    /// The next 64 bits.
    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GAMMA);
        mix64(self.0)
    }

    /// The next number in [0, 1), 53 bits.
    #[inline]
    pub fn next_f64(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Hash of a sequence of bytes (FNV-1a, 64 bits), to distinguish settings and files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fnv64(u64);

impl Fnv64 {
    /// The hash of an empty sequence.
    pub const fn new() -> Fnv64 {
        Fnv64(0xcbf2_9ce4_8422_2325)
    }

    /// The hash after further bytes.
    #[must_use]
    pub fn with(self, bytes: &[u8]) -> Fnv64 {
        Fnv64(bytes.iter().fold(self.0, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3)))
    }

    /// The hash.
    pub fn value(self) -> u64 {
        self.0
    }

    /// The hash as 16 hexadecimal digits.
    pub fn hex(self) -> String {
        format!("{:016x}", self.0)
    }
}

impl Default for Fnv64 {
    fn default() -> Self {
        Fnv64::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published vectors: SplitMix64 of seed 1234567 (Rosetta Code), FNV-1a (Noll's test suite).
    #[test]
    fn published_values_come_out() {
        let mut stream = SplitMix64(1_234_567);
        let got: Vec<u64> = (0..5).map(|_| stream.next_u64()).collect();
        assert_eq!(
            got,
            [
                6_457_827_717_110_365_317,
                3_203_168_211_198_807_973,
                9_817_491_932_198_370_423,
                4_593_380_528_125_082_431,
                16_408_922_859_458_223_821
            ]
        );
        assert_eq!(Fnv64::new().value(), 0xcbf2_9ce4_8422_2325);
        assert_eq!(Fnv64::new().with(b"a").value(), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(Fnv64::new().with(b"foo").with(b"bar").hex(), "85944171f73967e8");
    }

    #[test]
    fn streams_are_uniform() {
        let mut stream = SplitMix64(1);
        let n = 100_000;
        let (mut sum, mut lowest, mut highest) = (0.0, 1.0f64, 0.0f64);
        for _ in 0..n {
            let u = stream.next_f64();
            (sum, lowest, highest) = (sum + u, lowest.min(u), highest.max(u));
        }
        let (mean, se) = (sum / f64::from(n), (1.0 / 12.0 / f64::from(n)).sqrt());
        assert!((mean - 0.5).abs() < 5.0 * se, "mean {mean}");
        assert!((0.0..1e-3).contains(&lowest) && (0.999..1.0).contains(&highest), "{lowest} {highest}");
    }

    #[test]
    fn small_hashes_differ_in_half_of_their_bits() {
        let (mut bits, mut wide) = (0, 0);
        for i in 0..1000u32 {
            bits += (mix32(i) ^ mix32(i + 1)).count_ones();
            wide += (mix64(u64::from(i)) ^ mix64(u64::from(i + 1))).count_ones();
        }
        // 32 000 and 64 000 coins: 5 standard deviations are 447 and 632.
        assert!((bits as f64 - 16_000.0).abs() < 447.0, "{bits}");
        assert!((wide as f64 - 32_000.0).abs() < 632.0, "{wide}");
    }
}
