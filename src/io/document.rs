//! The one loader and saver: what the files of tables, models, fibers and speckle patterns have in common.

use super::container::{FileKind, Reader, Writer};
use super::{Axis, disk, read_kind};
use crate::Result;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Keys of every document, which describe the origin of its numbers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of the program that computed the numbers.
    pub program_version: String,
    /// Name of the preset.
    pub preset: String,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Text of the yarn spec or scene.
    pub spec: String,
}

/// A type that can be stored in a file. The required items describe its content; the file follows from them.
pub trait Document: Sized {
    /// Kind of file.
    const KIND: FileKind;
    /// Keys of the JSON document besides those of [`Provenance`].
    type Keys: Serialize + DeserializeOwned;

    /// Names of the tensors that a file may contain.
    fn names() -> Vec<&'static str>;

    /// Checks that the value is valid. Reading and writing call this; `name` identifies the file in errors.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for the first invalid value.
    fn check(&self, name: &str) -> Result<()>;

    /// The origin of the numbers.
    fn provenance(&self) -> Provenance;

    /// Further keys of the JSON document.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for values that cannot be stored in a file.
    fn keys(&self, name: &str) -> Result<Self::Keys>;

    /// Axes and statistics, for people who read only the header.
    fn summary(&self) -> (Vec<Axis>, serde_json::Value);

    /// Writes the arrays.
    fn tensors(&self, writer: &mut Writer);

    /// Builds the value from the parts of a file, of which only types and shapes are checked so far.
    ///
    /// # Errors
    /// Those of the reader.
    fn read(reader: &Reader<'_>, provenance: Provenance, keys: &Self::Keys) -> Result<Self>;

    /// The bytes of the file.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for values that are not allowed in a file.
    fn to_bytes(&self) -> Result<Vec<u8>> {
        encode(self, Self::KIND.name())
    }

    /// Reads and checks a value from the bytes of its file; `name` identifies the file in errors.
    ///
    /// # Errors
    /// [`crate::Error::Format`] for other files and versions and for damage; [`crate::Error::Invalid`] for
    /// values that are not allowed in a file.
    fn from_bytes(bytes: &[u8], name: &str) -> Result<Self> {
        Ok(with_keys(bytes, name)?.0)
    }

    /// Writes the file, which is afterwards complete or absent.
    ///
    /// # Errors
    /// Those of [`Document::to_bytes`], and [`crate::Error::Io`].
    fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        disk::write_file(path, &encode(self, &path.display().to_string())?)
    }

    /// Reads and checks the file.
    ///
    /// # Errors
    /// Those of [`Document::from_bytes`], and [`crate::Error::Io`].
    fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Self::from_bytes(&read_kind(path, Self::KIND)?, &path.display().to_string())
    }
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

/// Checks a document and returns the bytes of its file.
fn encode<D: Document>(document: &D, name: &str) -> Result<Vec<u8>> {
    document.check(name)?;
    let (axes, statistics) = document.summary();
    let mut writer = Writer::new();
    document.tensors(&mut writer);
    let (provenance, keys) = (&document.provenance(), &document.keys(name)?);
    let (format, version) = (D::KIND.format(), D::KIND.version());
    writer.finish(name, &Envelope { format, version, provenance, keys, axes, statistics })
}

/// Reads and checks a document and its further keys from the bytes of its file.
pub(crate) fn with_keys<D: Document>(bytes: &[u8], name: &str) -> Result<(D, D::Keys)> {
    let (reader, text) = Reader::open(name, bytes, D::KIND, &D::names())?;
    let (provenance, keys) = (reader.keys(&text)?, reader.keys(&text)?);
    let document = D::read(&reader, provenance, &keys)?;
    document.check(name)?;
    Ok((document, keys))
}
