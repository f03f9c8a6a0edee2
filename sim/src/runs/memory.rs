//! How many shards may be held in memory side by side.

use crate::wave::memory::available_bytes;

/// Shards that may be held at once where each takes `bytes`: one a thread, in half of the memory that is
/// free; one a thread where they take nothing to speak of.
pub(super) fn lanes(bytes: usize) -> usize {
    let threads = rayon::current_num_threads();
    if bytes == 0 {
        return threads;
    }
    available_bytes().map_or(1, |free| free / 2 / bytes).clamp(1, threads)
}
