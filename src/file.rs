//! The container of plywave's files: safetensors with one JSON document in its metadata (`docs/format.md`).
//!
//! Reading checks names, types and shapes and hands out owned arrays; what the numbers may be is checked by their owners.
//! Writing goes to a temporary name in the same folder, is flushed to the disk, then renamed.

use crate::{Error, Result};
use safetensors::tensor::{Dtype, Metadata, SafeTensors, TensorInfo, TensorView};
use std::collections::HashMap;
use std::io::{Read, Write};
use std::path::Path;

/// Key of the JSON document in the safetensors metadata.
pub(crate) const KEY: &str = "plywave";
/// Version of both formats that this program writes and reads.
pub(crate) const VERSION: u64 = 1;
/// Largest header accepted. A table's header is a few kilobytes plus the spec's text.
const MAX_HEADER: u64 = 16 << 20;

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A [`crate::Table`].
    Table,
    /// A ply model, [`crate::PlyData`].
    Model,
    /// A fiber's scattering, [`crate::fiber::FiberTable`].
    Fiber,
    /// Patterns of single fibers, [`crate::SpecklePatterns`].
    Speckle,
}

impl FileKind {
    /// Format name in the file.
    pub(crate) fn format(self) -> &'static str {
        match self {
            FileKind::Table => "plywave-table",
            FileKind::Model => "plywave-ply",
            FileKind::Fiber => "plywave-fiber",
            FileKind::Speckle => "plywave-speckle",
        }
    }

    fn remake(self) -> &'static str {
        match self {
            FileKind::Table => "write it again with `plywave simulate`",
            FileKind::Model => "write it again with `plywave fit`",
            FileKind::Fiber => "write it again with `plywave wave tabulate`",
            FileKind::Speckle => "write it again with `plywave wave speckle`",
        }
    }
}

/// Tells what a file holds by its header alone, without reading the arrays.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Format`] when it is nothing of plywave's or of another version.
pub fn file_kind(path: impl AsRef<Path>) -> Result<FileKind> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let io = |source| Error::Io { file: name.clone(), source };
    let mut file = std::fs::File::open(path).map_err(io)?;
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
    let kind = [FileKind::Table, FileKind::Model, FileKind::Fiber, FileKind::Speckle]
        .into_iter()
        .find(|k| k.format() == head.format)
        .ok_or_else(foreign)?;
    check_version(&name, &head, kind)?;
    Ok(kind)
}

/// The keys that tell what the rest of the document means.
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
    if head.version == VERSION {
        return Ok(());
    }
    let mend = if head.version > VERSION {
        "it was written by a newer plywave: update plywave or the file".to_string()
    } else {
        kind.remake().to_string()
    };
    Err(format_error(name, &format!("version {} of {}, expected {VERSION}", head.version, head.format), &mend))
}

pub(crate) fn format_error(file: &str, what: &str, mend: &str) -> Error {
    Error::Format { file: file.to_string(), what: what.to_string(), mend: mend.to_string() }
}

pub(crate) fn invalid(file: &str, key: &str, value: impl std::fmt::Display, mend: &str) -> Error {
    Error::Invalid { file: file.to_string(), key: key.to_string(), value: value.to_string(), mend: mend.to_string() }
}

/// The message of an error, on one line and of bounded length (it may quote the file).
fn one_line(e: &dyn std::fmt::Display) -> String {
    let text = e.to_string();
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().count() > 160 { text.chars().take(157).chain("...".chars()).collect() } else { text }
}

/// The whole content of a file.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|source| Error::Io { file: path.display().to_string(), source })
}

/// Writes `bytes` to a temporary name beside `path`, flushes them to the disk and renames: `path` never holds half a file.
pub(crate) fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    let io = |source| Error::Io { file: path.display().to_string(), source };
    let Some(file_name) = path.file_name() else {
        return Err(io(std::io::Error::new(std::io::ErrorKind::InvalidInput, "not a file name")));
    };
    let mut temporary = std::ffi::OsString::from(".");
    temporary.push(file_name);
    temporary.push(format!(".{}.tmp", std::process::id()));
    let temporary = path.with_file_name(temporary);
    let written = std::fs::File::create(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    let renamed = written.and_then(|()| std::fs::rename(&temporary, path));
    if renamed.is_err() {
        // The first error is the one to report; a leftover that cannot be removed changes nothing about it.
        let _ = std::fs::remove_file(&temporary);
    }
    renamed.map_err(io)
}

/// Arrays to be written, in the order of the calls (safetensors then sorts them by type and name).
pub(crate) struct Writer {
    tensors: Vec<(&'static str, Dtype, Vec<usize>, Vec<u8>)>,
}

impl Writer {
    pub(crate) fn new() -> Self {
        Writer { tensors: Vec::new() }
    }

    pub(crate) fn f64(&mut self, name: &'static str, shape: &[usize], values: &[f64]) {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.tensors.push((name, Dtype::F64, shape.to_vec(), bytes));
    }

    pub(crate) fn f32(&mut self, name: &'static str, shape: &[usize], values: impl Iterator<Item = f32>) {
        let bytes = values.flat_map(f32::to_le_bytes).collect();
        self.tensors.push((name, Dtype::F32, shape.to_vec(), bytes));
    }

    pub(crate) fn u8(&mut self, name: &'static str, shape: &[usize], values: &[u8]) {
        self.tensors.push((name, Dtype::U8, shape.to_vec(), values.to_vec()));
    }

    pub(crate) fn u64(&mut self, name: &'static str, shape: &[usize], values: &[u64]) {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.tensors.push((name, Dtype::U64, shape.to_vec(), bytes));
    }

    /// The file's bytes. `file` names it in errors.
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
pub(crate) struct Reader<'a> {
    file: &'a str,
    kind: FileKind,
    metadata: Metadata,
    data: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Parses the header and the JSON document. Only `names` may be present as tensors.
    pub(crate) fn open<D: serde::de::DeserializeOwned>(
        file: &'a str,
        bytes: &'a [u8],
        kind: FileKind,
        names: &[&str],
    ) -> Result<(Self, D)> {
        let damaged = |what: &str| format_error(file, what, kind.remake());
        match bytes.first_chunk::<8>().map(|n| u64::from_le_bytes(*n)) {
            None => return Err(damaged("shorter than a safetensors header")),
            Some(n) if n > MAX_HEADER => return Err(damaged(&format!("header of {n} bytes, at most {MAX_HEADER}"))),
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
            let mend = match kind {
                FileKind::Table => "give a table (`plywave simulate` writes one)",
                FileKind::Model => "give a ply model (`plywave fit` writes one)",
                FileKind::Fiber => "give a fiber table (`plywave wave tabulate` writes one)",
                FileKind::Speckle => "give speckle patterns (`plywave wave speckle` writes some)",
            };
            return Err(format_error(file, &what, mend));
        }
        check_version(file, &head, kind)?;
        let document =
            serde_json::from_str(&text).map_err(|e| damaged(&format!("metadata {KEY}: {}", one_line(&e))))?;
        for name in metadata.offset_keys() {
            if !names.contains(&name.as_str()) {
                return Err(damaged(&format!("unknown tensor {:?}", one_line(&name))));
            }
        }
        Ok((Reader { file, kind, metadata, data: &bytes[8 + n..] }, document))
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

    /// Whether there is a tensor `name`, for those that may be left out.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.metadata.info(name).is_some()
    }

    /// Shape of tensor `name`, which must have `rank` axes.
    pub(crate) fn shape(&self, name: &str, rank: usize) -> Result<Vec<usize>> {
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
    pub(crate) fn f64(&self, name: &str, shape: &[usize]) -> Result<Vec<f64>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::F64 => Ok(bytes.as_chunks().0.iter().map(|c| f64::from_le_bytes(*c)).collect()),
            Dtype::F32 => Ok(bytes.as_chunks().0.iter().map(|c| f64::from(f32::from_le_bytes(*c))).collect()),
            _ => Err(self.type_error(name, info, "F64 or F32")),
        }
    }

    /// A tensor of F32 of this shape.
    pub(crate) fn f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::F32 => Ok(bytes.as_chunks().0.iter().map(|c| f32::from_le_bytes(*c)).collect()),
            _ => Err(self.type_error(name, info, "F32")),
        }
    }

    /// A tensor of U8 of this shape.
    pub(crate) fn u8(&self, name: &str, shape: &[usize]) -> Result<Vec<u8>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::U8 => Ok(bytes.to_vec()),
            _ => Err(self.type_error(name, info, "U8")),
        }
    }

    /// A tensor of U64 of this shape.
    pub(crate) fn u64(&self, name: &str, shape: &[usize]) -> Result<Vec<u64>> {
        let (info, bytes) = self.info(name)?;
        self.check_shape(name, info, shape)?;
        match info.dtype {
            Dtype::U64 => Ok(bytes.as_chunks().0.iter().map(|c| u64::from_le_bytes(*c)).collect()),
            _ => Err(self.type_error(name, info, "U64")),
        }
    }
}

/// Checks on arrays, each with the file's name at hand.
pub(crate) struct Check<'a>(pub(crate) &'a str);

impl Check<'_> {
    /// Every value in `[low, high]` and finite.
    pub(crate) fn range(&self, name: &str, values: &[f64], low: f64, high: f64) -> Result<()> {
        match values.iter().position(|v| !(*v >= low && *v <= high)) {
            None => Ok(()),
            Some(i) => {
                let mend = format!("expected a value in [{low}, {high}]");
                Err(invalid(self.0, &format!("{name}[{i}]"), values[i], &mend))
            }
        }
    }

    /// [`Check::range`] for f32.
    pub(crate) fn range_f32(&self, name: &str, values: &[f32], low: f32, high: f32) -> Result<()> {
        match values.iter().position(|v| !(*v >= low && *v <= high)) {
            None => Ok(()),
            Some(i) => {
                let mend = format!("expected a value in [{low}, {high}]");
                Err(invalid(self.0, &format!("{name}[{i}]"), values[i], &mend))
            }
        }
    }

    /// Length is the product of `shape`.
    pub(crate) fn len(&self, name: &str, len: usize, shape: &[usize]) -> Result<()> {
        let want = shape.iter().try_fold(1usize, |a, b| a.checked_mul(*b));
        if want == Some(len) {
            return Ok(());
        }
        Err(invalid(self.0, name, format!("{len} values"), &format!("expected the shape {shape:?}")))
    }

    /// Finite, strictly ascending.
    pub(crate) fn ascending(&self, name: &str, axis: &[f64]) -> Result<()> {
        self.range(name, axis, f64::MIN, f64::MAX)?;
        match axis.windows(2).position(|w| w[1] <= w[0]) {
            None => Ok(()),
            Some(i) => Err(invalid(self.0, &format!("{name}[{}]", i + 1), axis[i + 1], "the axis must ascend")),
        }
    }

    /// Ascending with equal steps, to 1e-6 of a step.
    pub(crate) fn uniform(&self, name: &str, axis: &[f64]) -> Result<()> {
        self.ascending(name, axis)?;
        let step = (axis[axis.len() - 1] - axis[0]) / (axis.len() - 1).max(1) as f64;
        for (i, v) in axis.iter().enumerate() {
            let want = axis[0] + step * i as f64;
            if (v - want).abs() > 1e-6 * step {
                let mend = format!("the axis must have equal steps: expected {want}");
                return Err(invalid(self.0, &format!("{name}[{i}]"), v, &mend));
            }
        }
        Ok(())
    }

    /// The axis of incident latitudes: uniform from 0, below pi/2.
    pub(crate) fn theta_axis(&self, axis: &[f64]) -> Result<()> {
        self.uniform("theta_i", axis)?;
        self.range("theta_i", axis, 0.0, std::f64::consts::FRAC_PI_2)?;
        if axis[0] != 0.0 {
            return Err(invalid(self.0, "theta_i[0]", axis[0], "the first incident latitude must be 0"));
        }
        Ok(())
    }

    /// The axis of offsets: uniform and symmetric about 0, since negative latitudes are mirrored onto it.
    pub(crate) fn h_axis(&self, axis: &[f64]) -> Result<()> {
        self.uniform("h_um", axis)?;
        self.range("h_um", axis, -1e6, 1e6)?;
        let (first, last) = (axis[0], axis[axis.len() - 1]);
        if (first + last).abs() > 1e-6 * last.abs() || (last <= 0.0 && axis.len() > 1) {
            return Err(invalid(
                self.0,
                "h_um[0]",
                first,
                &format!("the offsets must be symmetric: expected {}", -last),
            ));
        }
        Ok(())
    }

    /// The axis of absorption coefficients: ascending from 0.
    pub(crate) fn sigma_axis(&self, axis: &[f64]) -> Result<()> {
        self.ascending("sigma_per_um", axis)?;
        self.range("sigma_per_um", axis, 0.0, 1e6)?;
        if axis[0] != 0.0 {
            return Err(invalid(self.0, "sigma_per_um[0]", axis[0], "the first absorption coefficient must be 0"));
        }
        Ok(())
    }
}

/// Unit and length of an axis, for the JSON document.
#[derive(serde::Serialize, serde::Deserialize)]
pub(crate) struct Axis {
    pub(crate) name: String,
    pub(crate) unit: String,
    pub(crate) size: usize,
}

impl Axis {
    pub(crate) fn new(name: &str, unit: &str, size: usize) -> Self {
        Axis { name: name.to_string(), unit: unit.to_string(), size }
    }
}

/// Least, mean and greatest value of an array, for the JSON document. Empty arrays give zeros.
#[derive(serde::Serialize)]
pub(crate) struct Summary {
    min: f64,
    mean: f64,
    max: f64,
}

impl Summary {
    pub(crate) fn of(values: impl Iterator<Item = f64>) -> Self {
        let (mut min, mut max, mut sum, mut n) = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0u64);
        for v in values {
            (min, max, sum, n) = (min.min(v), max.max(v), sum + v, n + 1);
        }
        if n == 0 { Summary { min: 0.0, mean: 0.0, max: 0.0 } } else { Summary { min, mean: sum / n as f64, max } }
    }
}
