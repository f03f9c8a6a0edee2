//! Disk access of runs, through the reader and the atomic writer of `plywave::io`, with the errors of runs
//! and a limit on the size of files.

use crate::error::RunError;
use plywave::{Error, io as files};
use std::path::Path;

/// Maximum size of a file of parts that is read [bytes].
const MAX_BYTES: u64 = 16 << 30;

pub(super) fn io(path: &Path) -> impl Fn(std::io::Error) -> RunError + '_ {
    move |source| Error::Io { file: path.display().to_string(), source }.into()
}

/// The content of a regular file of at most 16 GiB.
pub(super) fn read_whole(path: &Path) -> Result<Vec<u8>, RunError> {
    Ok(files::read_file(path, MAX_BYTES)?)
}

/// Writes a file atomically: it is complete or absent afterwards.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RunError> {
    Ok(files::write_file(path, bytes)?)
}
