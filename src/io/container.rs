//! The container of plywave's files: safetensors with one JSON document in its metadata
//! (`docs/reference/format/index.md`).
//!
//! Reading checks names, types and shapes and returns owned arrays. The types that own the arrays check the
//! values.

use crate::math::half::{from_half, to_half};
use crate::{Error, Result};
use safetensors::tensor::{Dtype, Metadata, SafeTensors, TensorInfo, TensorView};
use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

/// Key of the JSON document in the safetensors metadata.
pub(crate) const KEY: &str = "plywave";
/// Maximum size of a header. The header of a table is a few kilobytes plus the text of the spec.
const MAX_HEADER: u64 = 16 << 20;

/// Kind of content of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A `plywave_tables::Table`.
    Table,
    /// A ply model, [`crate::ply::PlyData`].
    Model,
    /// Scattering of a fiber, `plywave_fiber::FiberTable`.
    Fiber,
    /// Patterns of single fibers, `plywave_tables::speckle::SpecklePatterns`.
    Speckle,
    /// Path-traced scattering of a cloth's explicit fibers, `plywave_tables::twin::ClothTwin`.
    Twin,
    /// A continuous family of plies, [`crate::ply::FamilyData`].
    Family,
    /// A cloth prepared for shading, [`crate::cloth::ClothData`].
    Cloth,
}

impl FileKind {
    /// Name of the format in the file.
    pub fn format(self) -> &'static str {
        match self {
            FileKind::Table => "plywave-table",
            FileKind::Model => "plywave-ply",
            FileKind::Fiber => "plywave-fiber",
            FileKind::Speckle => "plywave-speckle",
            FileKind::Twin => "plywave-twin",
            FileKind::Family => "plywave-family",
            FileKind::Cloth => "plywave-cloth",
        }
    }

    /// Name of the content in errors, for content that is not in a file yet.
    pub fn name(self) -> &'static str {
        match self {
            FileKind::Table => "table",
            FileKind::Model => "model",
            FileKind::Fiber => "fiber table",
            FileKind::Speckle => "speckle patterns",
            FileKind::Twin => "twin",
            FileKind::Family => "family",
            FileKind::Cloth => "cloth",
        }
    }

    /// Version of the format that this program writes and reads.
    pub fn version(self) -> u64 {
        match self {
            // 2: energies as splines on separate grids. 3: noise as sources.
            FileKind::Model => 3,
            // 2: brightness in all meanings of colors.
            FileKind::Cloth => 3,
            FileKind::Table | FileKind::Fiber | FileKind::Speckle | FileKind::Twin | FileKind::Family => 1,
        }
    }

    /// Maximum size of a file [bytes]: the maximum number of cells that a spec allows, and as much again for
    /// other content.
    pub fn most_bytes(self) -> u64 {
        match self {
            FileKind::Table => 4 << 30,
            FileKind::Model | FileKind::Twin | FileKind::Family => 1 << 30,
            FileKind::Fiber | FileKind::Speckle => 2 << 30,
            FileKind::Cloth => 256 << 20,
        }
    }

    fn remake(self) -> &'static str {
        match self {
            FileKind::Table => "write it again with `plywave simulate`",
            FileKind::Model => "write it again with `plywave fit`",
            FileKind::Fiber => "write it again with `plywave wave tabulate`",
            FileKind::Speckle => "write it again with `plywave wave speckle`",
            FileKind::Twin => "write it again with `plywave twin`",
            FileKind::Family => "write it again with `plywave family`",
            FileKind::Cloth => "write it again with `plywave weave`",
        }
    }
}

/// The kind of a file from its header alone, without reading the arrays.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read; [`Error::Format`] if it is not a plywave file or has another
/// version.
pub fn file_kind(path: impl AsRef<Path>) -> Result<FileKind> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let io = |source| Error::Io { file: name.clone(), source };
    let mut file = super::disk::open_file(path, u64::MAX)?;
    let mut size = [0u8; 8];
    let foreign = || format_error(&name, "no safetensors header", "give a table or model written by plywave");
    match file.read_exact(&mut size) {
        Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Err(foreign()),
        other => other.map_err(io)?,
    }
    let size = u64::from_le_bytes(size);
    if size > MAX_HEADER {
        return Err(foreign());
    }
    let mut header = Vec::new();
    file.take(size).read_to_end(&mut header).map_err(io)?;
    let header: serde_json::Value = serde_json::from_slice(&header).map_err(|_| foreign())?;
    let text = header["__metadata__"][KEY].as_str().ok_or_else(foreign)?;
    let head: Head = parse_head(&name, text)?;
    use FileKind::{Cloth, Family, Fiber, Model, Speckle, Table, Twin};
    let kind = [Table, Model, Fiber, Speckle, Twin, Family, Cloth]
        .into_iter()
        .find(|k| k.format() == head.format)
        .ok_or_else(foreign)?;
    check_version(&name, &head, kind)?;
    Ok(kind)
}

/// The keys that determine the meaning of the other keys of the document.
#[derive(serde::Deserialize)]
struct Head {
    format: String,
    version: u64,
}

fn parse_head(name: &str, text: &str) -> Result<Head> {
    serde_json::from_str(text).map_err(|e| {
        format_error(name, &format!("metadata {KEY}: {}", one_line(&e)), "the file is damaged: write it again")
    })
}

fn check_version(name: &str, head: &Head, kind: FileKind) -> Result<()> {
    let version = kind.version();
    if head.version == version {
        return Ok(());
    }
    let hint = if head.version > version {
        "it was written by a newer plywave: update plywave or the file".to_string()
    } else {
        kind.remake().to_string()
    };
    Err(format_error(name, &format!("version {} of {}, expected {version}", head.version, head.format), &hint))
}

pub(crate) fn format_error(file: &str, what: &str, hint: &str) -> Error {
    Error::Format { file: file.to_string(), what: what.to_string(), hint: hint.to_string() }
}

/// An error about `key` of a file.
pub fn invalid(file: &str, key: &str, value: impl std::fmt::Display, hint: &str) -> Error {
    Error::Invalid { file: file.to_string(), key: key.to_string(), value: value.to_string(), hint: hint.to_string() }
}

/// The message of an error, on one line and of bounded length, since it may quote the file.
pub(crate) fn one_line(e: &dyn std::fmt::Display) -> String {
    crate::one_line(&e.to_string(), 160)
}

/// Arrays to write, in the order of the calls. (safetensors then sorts them by type and name.)
pub struct Writer {
    tensors: Vec<(&'static str, Dtype, Vec<usize>, Vec<u8>)>,
}

impl Writer {
    pub(crate) fn new() -> Self {
        Writer { tensors: Vec::new() }
    }

    /// Adds a tensor of F64.
    pub fn f64(&mut self, name: &'static str, shape: &[usize], values: &[f64]) {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.tensors.push((name, Dtype::F64, shape.to_vec(), bytes));
    }

    /// Adds a tensor of F32.
    pub fn f32(&mut self, name: &'static str, shape: &[usize], values: impl Iterator<Item = f32>) {
        let bytes = values.flat_map(f32::to_le_bytes).collect();
        self.tensors.push((name, Dtype::F32, shape.to_vec(), bytes));
    }

    /// Adds a tensor of F16, rounded to the nearest value.
    pub fn f16(&mut self, name: &'static str, shape: &[usize], values: impl Iterator<Item = f32>) {
        let bytes = values.flat_map(|v| to_half(v).to_le_bytes()).collect();
        self.tensors.push((name, Dtype::F16, shape.to_vec(), bytes));
    }

    /// Adds a tensor of U8.
    pub fn u8(&mut self, name: &'static str, shape: &[usize], values: &[u8]) {
        self.tensors.push((name, Dtype::U8, shape.to_vec(), values.to_vec()));
    }

    /// Adds a tensor of U64.
    pub fn u64(&mut self, name: &'static str, shape: &[usize], values: &[u64]) {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.tensors.push((name, Dtype::U64, shape.to_vec(), bytes));
    }

    /// The bytes of the file; `file` names it in errors.
    pub(crate) fn finish(self, file: &str, document: &impl serde::Serialize) -> Result<Vec<u8>> {
        let text = serde_json::to_string(document)
            .map_err(|e| format_error(file, &one_line(&e), "the values cannot be written as JSON"))?;
        let mut views = Vec::new();
        for (name, dtype, shape, bytes) in &self.tensors {
            let view = TensorView::new(*dtype, shape.clone(), bytes)
                .map_err(|e| invalid(file, name, one_line(&e), "its length must be the product of its axes"))?;
            views.push((*name, view));
        }
        safetensors::serialize(views, Some(HashMap::from([(KEY.to_string(), text)])))
            .map_err(|e| format_error(file, &one_line(&e), "make the spec's text shorter"))
    }
}

/// A parsed file: its arrays by name.
pub struct Reader<'a> {
    file: &'a str,
    kind: FileKind,
    metadata: Metadata,
    data: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Parses the header, and also returns the text of the JSON document. Tensors with other names than
    /// `names` are errors.
    pub(crate) fn open(file: &'a str, bytes: &'a [u8], kind: FileKind, names: &[&str]) -> Result<(Self, String)> {
        let damaged = |what: &str| format_error(file, what, kind.remake());
        match bytes.first_chunk::<8>().map(|n| u64::from_le_bytes(*n)) {
            None => return Err(damaged("shorter than a safetensors header")),
            // The number is not reported because in a foreign file it is part of the file's text.
            Some(n) if n > MAX_HEADER => return Err(damaged(&format!("header of more than {MAX_HEADER} bytes"))),
            Some(_) => {}
        }
        let (n, metadata) = SafeTensors::read_metadata(bytes)
            .map_err(|e| damaged(&format!("not a whole safetensors file: {}", one_line(&e))))?;
        let text = metadata.metadata().as_ref().and_then(|m| m.get(KEY));
        let Some(text) = text.cloned() else {
            return Err(format_error(file, &format!("no metadata {KEY}"), "give a file written by plywave"));
        };
        let head = parse_head(file, &text)?;
        if head.format != kind.format() {
            let what = format!("format {:?}, expected {:?}", one_line(&head.format), kind.format());
            let hint = match kind {
                FileKind::Table => "give a table (`plywave simulate` writes one)",
                FileKind::Model => "give a ply model (`plywave fit` writes one)",
                FileKind::Fiber => "give a fiber table (`plywave wave tabulate` writes one)",
                FileKind::Speckle => "give speckle patterns (`plywave wave speckle` writes some)",
                FileKind::Twin => "give the twin of a cloth (`plywave twin` writes one)",
                FileKind::Family => "give a family of plies (`plywave family` writes one)",
                FileKind::Cloth => "give a cloth (`plywave weave SPEC -o X.pwc` writes one)",
            };
            return Err(format_error(file, &what, hint));
        }
        check_version(file, &head, kind)?;
        for name in metadata.offset_keys() {
            if !names.contains(&name.as_str()) {
                return Err(damaged(&format!("unknown tensor {:?}", one_line(&name))));
            }
        }
        Ok((Reader { file, kind, metadata, data: &bytes[8 + n..] }, text))
    }

    /// Name of the file in errors.
    pub fn file(&self) -> &'a str {
        self.file
    }

    /// Keys of the JSON document.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::Format`] if a key is missing or has another type.
    pub fn keys<D: serde::de::DeserializeOwned>(&self, text: &str) -> Result<D> {
        serde_json::from_str(text)
            .map_err(|e| format_error(self.file, &format!("metadata {KEY}: {}", one_line(&e)), self.kind.remake()))
    }

    fn info(&self, name: &str) -> Result<(&TensorInfo, &'a [u8])> {
        let info = self
            .metadata
            .info(name)
            .ok_or_else(|| format_error(self.file, &format!("tensor {name} is missing"), self.kind.remake()))?;
        let bytes = self.data.get(info.data_offsets.0..info.data_offsets.1).ok_or_else(|| {
            format_error(self.file, &format!("tensor {name} ends beyond the file"), self.kind.remake())
        })?;
        Ok((info, bytes))
    }

    /// Whether there is a tensor `name`, for optional ones.
    pub fn has(&self, name: &str) -> bool {
        self.metadata.info(name).is_some()
    }

    /// Shape of tensor `name`, which must have `rank` axes.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::Format`] if the tensor is missing or has another rank.
    pub fn shape(&self, name: &str, rank: usize) -> Result<Vec<usize>> {
        let (info, _) = self.info(name)?;
        if info.shape.len() != rank {
            return Err(invalid(self.file, name, format!("{:?}", info.shape), &format!("expected {rank} axes")));
        }
        Ok(info.shape.clone())
    }

    fn check_shape(&self, name: &str, info: &TensorInfo, shape: &[usize]) -> Result<()> {
        if info.shape == shape {
            return Ok(());
        }
        Err(invalid(self.file, name, format!("{:?}", info.shape), &format!("expected the shape {shape:?}")))
    }

    fn type_error(&self, name: &str, info: &TensorInfo, expected: &str) -> Error {
        invalid(self.file, name, format!("{:?}", info.dtype), &format!("expected the type {expected}"))
    }

    /// A tensor of floats, F64 or F32, of this shape.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::Format`] if the tensor is missing or has another type or shape.
    pub fn f64(&self, name: &str, shape: &[usize]) -> Result<Vec<f64>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::F64 => Ok(bytes.as_chunks().0.iter().map(|c| f64::from_le_bytes(*c)).collect()),
            Dtype::F32 => Ok(bytes.as_chunks().0.iter().map(|c| f64::from(f32::from_le_bytes(*c))).collect()),
            _ => Err(self.type_error(name, info, "F64 or F32")),
        }
    }

    /// A tensor of F32 of this shape.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::Format`] if the tensor is missing or has another type or shape.
    pub fn f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::F32 => Ok(bytes.as_chunks().0.iter().map(|c| f32::from_le_bytes(*c)).collect()),
            _ => Err(self.type_error(name, info, "F32")),
        }
    }

    /// A tensor of F16 of this shape.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::Format`] if the tensor is missing or has another type or shape.
    pub fn f16(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::F16 => Ok(bytes.as_chunks().0.iter().map(|c| from_half(u16::from_le_bytes(*c))).collect()),
            _ => Err(self.type_error(name, info, "F16")),
        }
    }

    /// A tensor of U8 of this shape.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::Format`] if the tensor is missing or has another type or shape.
    pub fn u8(&self, name: &str, shape: &[usize]) -> Result<Vec<u8>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::U8 => Ok(bytes.to_vec()),
            _ => Err(self.type_error(name, info, "U8")),
        }
    }

    /// A tensor of U64 of this shape.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::Format`] if the tensor is missing or has another type or shape.
    pub fn u64(&self, name: &str, shape: &[usize]) -> Result<Vec<u64>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::U64 => Ok(bytes.as_chunks().0.iter().map(|c| u64::from_le_bytes(*c)).collect()),
            _ => Err(self.type_error(name, info, "U64")),
        }
    }
}
