//! Files: the container of tables, models, fibers and speckle patterns, its one reader and writer, and the
//! sources of named files.
//!
//! No other module of this crate accesses the file system. Loading goes through an [`AssetSource`], so a host
//! without a file system (a browser, a renderer with its own archive) can provide bytes by name.
//!
//! A host needs [`AssetSource`] and its implementations, and [`Document`] if it writes files. The rest is for
//! crates that add a kind of file.

pub(crate) mod check;
pub(crate) mod container;
pub mod disk;
pub(crate) mod document;
mod library;
mod set;
mod source;

pub use check::{Axis, Check, Summary};
pub use container::{FileKind, Reader, Writer, file_kind, invalid};
pub use disk::{
    is_temporary, lock_file, open_file, output_target, read_file, read_text, remove_leftovers, write_file,
    write_file_with,
};
pub use document::{Document, Provenance};
pub use library::{MODELS_VARIABLE, ModelLibrary};
pub use set::write_files;
pub use source::{AssetSource, Folder, MemoryAssets};

use crate::{Error, Result};
use std::path::Path;

/// The bytes of a file of the given kind, up to the kind's maximum size.
pub(crate) fn read_kind(path: &Path, kind: FileKind) -> Result<Vec<u8>> {
    read_file(path, kind.most_bytes())
}

/// The bytes of a model file.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    read_kind(path, FileKind::Model)
}

/// Text of at most `max_bytes` bytes from a source.
pub(crate) fn text_of(source: &dyn AssetSource, name: &str, max_bytes: u64) -> Result<String> {
    utf8(source.read(name, max_bytes)?, &source.display(name))
}

/// Adds `file`, `key` and `name` to an error from reading the file that `key` of the spec `file` names. `way`
/// is a further hint, or empty.
pub(crate) fn of_key(file: &str, key: &str, name: &str, error: Error, way: &str) -> Error {
    match error {
        Error::Io { file: path, source } => Error::Io { file: format!("{file}: {key}: {path}"), source },
        Error::Format { what, hint, .. } => {
            let way = if way.is_empty() { String::new() } else { format!(", or {way}") };
            Error::Format { file: format!("{file}: {key} = {}", container::one_line(&name)), what, hint: hint + &way }
        }
        other => other,
    }
}

fn utf8(bytes: Vec<u8>, file: &str) -> Result<String> {
    String::from_utf8(bytes).map_err(|_| Error::Format {
        file: file.to_string(),
        what: "not text in UTF-8".into(),
        hint: "save it as UTF-8 text".into(),
    })
}
