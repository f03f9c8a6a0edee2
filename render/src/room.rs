//! Memory and files whose size comes from a flag or a file: looked at before the work, refused in one line.

use crate::RenderError;
use std::io::Read;
use std::path::Path;

/// Refuses what memory does not hold: more than the system has to give (Linux tells), or than one allocation gets.
pub(crate) fn check_room(what: &str, bytes: u64) -> Result<(), RenderError> {
    let refuse = || RenderError::TooLarge { what: what.to_string(), gib: bytes as f64 / (1u64 << 30) as f64 };
    if available().is_some_and(|free| bytes > free) {
        return Err(refuse());
    }
    let size = usize::try_from(bytes).map_err(|_| refuse())?;
    Vec::<u8>::new().try_reserve_exact(size).map_err(|_| refuse())
}

/// Bytes that the system can give; unknown where it does not tell.
fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    Some(1024 * line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()?)
}

/// The bytes of a regular file of at most `most` bytes.
pub(crate) fn read_file(path: &Path, most: u64) -> Result<Vec<u8>, RenderError> {
    let file = path.display().to_string();
    let io = |source| RenderError::Io { file: file.clone(), source };
    let bad = |what: String| RenderError::Picture { file: file.clone(), what };
    let about = std::fs::metadata(path).map_err(io)?;
    if !about.is_file() {
        return Err(bad("no regular file; give the path of a file".into()));
    }
    if about.len() > most {
        return Err(bad(format!("{} bytes, at most {most} are read", about.len())));
    }
    check_room("this file", about.len()).map_err(|e| bad(e.to_string()))?;
    let mut bytes = Vec::new();
    std::fs::File::open(path).map_err(io)?.take(most).read_to_end(&mut bytes).map_err(io)?;
    Ok(bytes)
}
