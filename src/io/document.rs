//! The one loader and saver: common parts of the files of tables, models, fibers and speckle patterns.

use super::container::{FileKind, Reader, Writer};
use super::{Axis, disk, read_kind};
use crate::Result;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Keys of every document: the origin of its numbers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Provenance {
    pub(crate) program_version: String,
    pub(crate) preset: String,
    pub(crate) seed: u64,
    /// Text of the yarn spec or scene.
    pub(crate) spec: String,
}

/// A type that can be stored in a file.
pub(crate) trait Document: Sized {
    /// Its format.
    const KIND: FileKind;
    /// Keys of the JSON document besides those of [`Provenance`].
    type Keys: Serialize + DeserializeOwned;

    /// Tensors that a file may contain.
    fn names() -> Vec<&'static str>;

    /// Checks that the value is valid, when read or written; `name` identifies the file in errors.
    fn check(&self, name: &str) -> Result<()>;

    fn provenance(&self) -> Provenance;

    fn keys(&self, name: &str) -> Result<Self::Keys>;

    /// Axes and statistics, for readers that read only the header.
    fn summary(&self) -> (Vec<Axis>, serde_json::Value);

    fn tensors(&self, writer: &mut Writer);

    /// A value from the parts of a file; only types and shapes are checked so far.
    fn read(reader: &Reader<'_>, provenance: Provenance, keys: &Self::Keys) -> Result<Self>;
}

#[derive(Serialize)]
struct Envelope<'a, K> {
    format: &'static str,
    version: u64,
    #[serde(flatten)]
    provenance: &'a Provenance,
    #[serde(flatten)]
    keys: &'a K,
    axes: Vec<Axis>,
    statistics: serde_json::Value,
}

/// The bytes of a file, checked.
pub(crate) fn to_bytes<D: Document>(document: &D, name: &str) -> Result<Vec<u8>> {
    document.check(name)?;
    let (axes, statistics) = document.summary();
    let mut writer = Writer::new();
    document.tensors(&mut writer);
    let (provenance, keys) = (&document.provenance(), &document.keys(name)?);
    writer.finish(
        name,
        &Envelope { format: D::KIND.format(), version: D::KIND.version(), provenance, keys, axes, statistics },
    )
}

/// A document and its further keys from the bytes of its file, checked.
pub(crate) fn from_bytes<D: Document>(bytes: &[u8], name: &str) -> Result<(D, D::Keys)> {
    let (reader, text) = Reader::open(name, bytes, D::KIND, &D::names())?;
    let (provenance, keys) = (reader.keys(&text)?, reader.keys(&text)?);
    let document = D::read(&reader, provenance, &keys)?;
    document.check(name)?;
    Ok((document, keys))
}

/// Writes a file atomically.
pub(crate) fn save<D: Document>(document: &D, path: &Path) -> Result<()> {
    disk::write_file(path, &to_bytes(document, &path.display().to_string())?)
}

/// Reads a file.
pub(crate) fn load<D: Document>(path: &Path) -> Result<D> {
    Ok(from_bytes(&read_kind(path, D::KIND)?, &path.display().to_string())?.0)
}
