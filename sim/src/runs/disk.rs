//! The only place where runs touch the disk: reading a whole regular file, and writing one so that it is whole or absent.

use crate::error::SimError;
use plywave::Error;
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest file of parts that is read [bytes].
const MAX_BYTES: u64 = 16 << 30;
/// First and last letters of the names that files have while they are written.
const TEMPORARY: [&str; 2] = [".shard-", ".tmp"];

pub(super) fn io(path: &Path) -> impl Fn(std::io::Error) -> SimError + '_ {
    move |source| Error::Io { file: path.display().to_string(), source }.into()
}

/// The content of a regular file.
///
/// # Errors
/// [`Error::Io`] when it cannot be read, is no regular file, or is larger than memory or 16 GiB.
pub(super) fn read_whole(path: &Path) -> Result<Vec<u8>, SimError> {
    let refuse = |what: &str| io(path)(std::io::Error::other(what.to_string()));
    // Asked before it is opened: opening a pipe would wait for its writer.
    if !fs::metadata(path).map_err(io(path))?.is_file() {
        return Err(refuse("not a regular file; give a part that plywave wrote"));
    }
    let file = fs::File::open(path).map_err(io(path))?;
    let size = file.metadata().map_err(io(path))?.len();
    let mut bytes = Vec::new();
    if size > MAX_BYTES || bytes.try_reserve_exact(size as usize).is_err() {
        return Err(refuse("larger than can be read; split the run into more parts"));
    }
    file.take(size).read_to_end(&mut bytes).map_err(io(path))?;
    Ok(bytes)
}

/// Writes a file under a temporary name beside it, flushes it to the disk, renames it, and flushes the folder.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), SimError> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let [first, last] = TEMPORARY;
    let unique = format!("{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let temporary = path.with_file_name(format!("{first}{name}-{unique}{last}"));
    // A name that is taken, by a link too, is refused.
    let written = fs::File::create_new(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    if let Err(error) = written.and_then(|()| fs::rename(&temporary, path)) {
        // The first error is the one to report.
        let _ = fs::remove_file(&temporary);
        return Err(io(path)(error));
    }
    // Not every file system lets a folder be flushed; the rename itself has succeeded.
    if let Some(folder) = folder_of(path).and_then(|folder| fs::File::open(folder).ok()) {
        let _ = folder.sync_all();
    }
    Ok(())
}

/// Whether a name is one that [`write_whole`] gives to files that are not finished.
pub(super) fn is_temporary(name: &str) -> bool {
    name.starts_with(TEMPORARY[0]) && name.ends_with(TEMPORARY[1])
}

fn folder_of(path: &Path) -> Option<PathBuf> {
    let parent = path.parent()?;
    Some(if parent.as_os_str().is_empty() { ".".into() } else { parent.into() })
}
