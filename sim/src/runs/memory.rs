//! Number of shards that may be in memory at once.

use crate::wave::memory::available_bytes;

/// Number of shards of `bytes` each that may be in memory at once: as many as fit in half of the free memory,
/// at most one per thread.
pub(super) fn lanes(bytes: usize) -> usize {
    let threads = rayon::current_num_threads();
    if bytes == 0 {
        return threads;
    }
    available_bytes().map_or(1, |free| free / 2 / bytes).clamp(1, threads)
}
