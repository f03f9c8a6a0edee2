//! Checks of memory and file sizes that come from a flag or a file, before the work.

use crate::RenderError;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Refuses a size that does not fit in memory: more than the system has available (known on Linux), or than
/// one allocation can get.
pub(crate) fn check_room(what: &str, bytes: u64) -> Result<(), RenderError> {
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

/// Opens a regular file of at most `most` bytes with the reader of `plywave::io`; also returns its size.
pub(crate) fn open_file(path: &Path, most: u64) -> Result<(BufReader<File>, u64), RenderError> {
    let file = plywave::io::open_file(path, most).map_err(|e| of_reader(path, e))?.into_inner();
    let size = file.metadata().map_err(|source| RenderError::Io { file: path.display().to_string(), source })?.len();
    Ok((BufReader::new(file), size))
}

/// The bytes of a regular file of at most `most` bytes, by the reader of `plywave::io`.
pub(crate) fn read_file(path: &Path, most: u64) -> Result<Vec<u8>, RenderError> {
    // The reader reports a missing file.
    let size = std::fs::metadata(path).map_or(0, |about| about.len());
    check_room(&path.display().to_string(), size.min(most))?;
    plywave::io::read_file(path, most).map_err(|e| of_reader(path, e))
}

fn of_reader(path: &Path, error: plywave::Error) -> RenderError {
    match error {
        plywave::Error::Io { file, source } => RenderError::Io { file, source },
        plywave::Error::Format { file, what, hint } => RenderError::Picture { file, what: format!("{what}; {hint}") },
        other => RenderError::Picture { file: path.display().to_string(), what: other.to_string() },
    }
}
