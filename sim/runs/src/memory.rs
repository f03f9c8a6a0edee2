//! Memory of the machine and of this process, as reported by Linux (`/proc`); `None` on other systems.

/// Free memory [bytes].
pub fn available_bytes() -> Option<usize> {
    kib_of(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable:")
}

/// Peak memory of this process since its start [bytes].
pub fn peak_bytes() -> Option<usize> {
    kib_of(&std::fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// The number of a line `name   123 kB`, in bytes.
fn kib_of(text: &str, name: &str) -> Option<usize> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<usize>().ok()?.checked_mul(1024)
}

/// Maximum number of shards of `bytes` each that are in memory at once: as many as fit in half of the free
/// memory, and at most one per thread.
pub(super) fn lanes(bytes: usize) -> usize {
    let threads = rayon::current_num_threads();
    if bytes == 0 {
        return threads;
    }
    available_bytes().map_or(1, |free| free / 2 / bytes).clamp(1, threads)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read() {
        assert_eq!(kib_of("VmPeak:\t 12 kB\nVmHWM:\t    5072 kB\n", "VmHWM:"), Some(5072 * 1024));
        assert_eq!(kib_of("VmHWM: many kB", "VmHWM:"), None);
        assert_eq!(kib_of("", "VmHWM:"), None);
    }

    /// The peak includes a block of memory that was written.
    #[test]
    #[cfg(target_os = "linux")]
    fn peak_grows_with_use() {
        let before = peak_bytes().unwrap();
        let block = std::hint::black_box(vec![1u8; before + (64 << 20)]);
        assert!(peak_bytes().unwrap() >= block.len());
        assert!(available_bytes().unwrap() > 0);
    }
}
