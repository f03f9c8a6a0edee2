//! Seeds and random streams by their position in a job. A result therefore depends on the job alone, not on
//! threads or on the order of its shards.

use plywave::math::hash::SplitMix64;
use rand_pcg::Pcg64Mcg;

/// Random stream with a well-mixed 128-bit state from the seed and the stream's position in the job.
pub fn stream(seed: u64, place: [u64; 2]) -> Pcg64Mcg {
    let mut state = SplitMix64(seed);
    let mut word = |salt: u64| {
        state.0 ^= salt;
        state.next_u64()
    };
    let hi = word(place[0]);
    let lo = word(place[1]);
    Pcg64Mcg::new(u128::from(hi) << 64 | u128::from(lo))
}

/// Seed of the geometry of instance `i`: distinct for every i and every seed below 2^32.
pub fn instance_seed(seed: u64, i: u32) -> u64 {
    seed.wrapping_mul(0x1_0000_0000).wrapping_add(u64::from(i))
}
