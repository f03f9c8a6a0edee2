//! Disk access of runs, through the reader and writer of `plywave::io`.

use crate::error::SimError;
use plywave::{Error, io as files};
use std::path::Path;

/// Largest file of parts that is read [bytes].
const MAX_BYTES: u64 = 16 << 30;

pub(super) fn io(path: &Path) -> impl Fn(std::io::Error) -> SimError + '_ {
    move |source| Error::Io { file: path.display().to_string(), source }.into()
}

/// The content of a regular file of at most 16 GiB.
pub(super) fn read_whole(path: &Path) -> Result<Vec<u8>, SimError> {
    Ok(files::read_file(path, MAX_BYTES)?)
}

/// Writes a file that is whole or absent.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), SimError> {
    Ok(files::write_file(path, bytes)?)
}
