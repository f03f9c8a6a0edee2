//! Memory of the machine and of this process, where the system reports it (Linux' `/proc`); `None` elsewhere.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read() {
        assert_eq!(kib_of("VmPeak:\t 12 kB\nVmHWM:\t    5072 kB\n", "VmHWM:"), Some(5072 * 1024));
        assert_eq!(kib_of("VmHWM: many kB", "VmHWM:"), None);
        assert_eq!(kib_of("", "VmHWM:"), None);
    }

    /// A block that is written to shows in the peak.
    #[test]
    #[cfg(target_os = "linux")]
    fn peak_grows_with_use() {
        let before = peak_bytes().unwrap();
        let block = std::hint::black_box(vec![1u8; before + (64 << 20)]);
        assert!(peak_bytes().unwrap() >= block.len());
        assert!(available_bytes().unwrap() > 0);
    }
}
