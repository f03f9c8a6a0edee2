//! Checks, before any work, that sizes from a flag or a file fit in memory.

use crate::RenderError;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Refuses a size that does not fit in memory: more than the system reports as available (on Linux), or more
/// than one allocation can provide.
pub(crate) fn check_memory(what: &str, bytes: u64) -> Result<(), RenderError> {
    let refuse = || RenderError::TooLarge { what: what.to_string(), gib: bytes as f64 / (1u64 << 30) as f64 };
    if available().is_some_and(|free| bytes > free) {
        return Err(refuse());
    }
    let size = usize::try_from(bytes).map_err(|_| refuse())?;
    Vec::<u8>::new().try_reserve_exact(size).map_err(|_| refuse())
}

/// Available memory [bytes]; `None` if unknown.
fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    Some(1024 * line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()?)
}

/// Opens a regular file of at most `max` bytes with the reader of `plywave::io`, and returns its size.
pub(crate) fn open_file(path: &Path, max: u64) -> Result<(BufReader<File>, u64), RenderError> {
    let file = plywave::io::open_file(path, max).map_err(|e| from_reader_error(path, e))?.into_inner();
    let size = file.metadata().map_err(|source| RenderError::Io { file: path.display().to_string(), source })?.len();
    Ok((BufReader::new(file), size))
}

/// Reads a regular file of at most `max` bytes with the reader of `plywave::io`.
pub(crate) fn read_file(path: &Path, max: u64) -> Result<Vec<u8>, RenderError> {
    // The size of a missing file counts as 0 here; the reader reports the error.
    let size = std::fs::metadata(path).map_or(0, |about| about.len());
    check_memory(&path.display().to_string(), size.min(max))?;
    plywave::io::read_file(path, max).map_err(|e| from_reader_error(path, e))
}

fn from_reader_error(path: &Path, error: plywave::Error) -> RenderError {
    match error {
        plywave::Error::Io { file, source } => RenderError::Io { file, source },
        plywave::Error::Format { file, what, hint } => RenderError::Picture { file, what: format!("{what}; {hint}") },
        other => RenderError::Picture { file: path.display().to_string(), what: other.to_string() },
    }
}
