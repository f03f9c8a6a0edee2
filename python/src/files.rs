//! Files that Python handles as arrays: reading, checking, writing.

use crate::errors::{Failure, Outcome};
use plywave::Document;
use plywave::cloth::ClothData;
use plywave::io::{self, FileKind};
use plywave::ply::{FamilyData, PlyData};
use plywave_fiber::FiberTable;
use plywave_tables::speckle::SpecklePatterns;
use plywave_tables::table::Table;
use plywave_tables::twin::ClothTwin;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

const KINDS: [(&str, FileKind); 7] = [
    ("table", FileKind::Table),
    ("model", FileKind::Model),
    ("fiber", FileKind::Fiber),
    ("speckle", FileKind::Speckle),
    ("twin", FileKind::Twin),
    ("family", FileKind::Family),
    ("cloth", FileKind::Cloth),
];

fn kind_of(name: &str) -> Outcome<FileKind> {
    let kind = KINDS.into_iter().find(|(known, _)| *known == name);
    kind.map(|(_, kind)| kind).ok_or_else(|| Failure::input("files", "kind", name, "there is no such"))
}

fn check(kind: FileKind, bytes: &[u8], name: &str) -> Outcome {
    match kind {
        FileKind::Table => Table::from_bytes(bytes, name).map(drop)?,
        FileKind::Model => PlyData::from_bytes(bytes, name).map(drop)?,
        FileKind::Fiber => FiberTable::from_bytes(bytes, name).map(drop)?,
        FileKind::Speckle => SpecklePatterns::from_bytes(bytes, name).map(drop)?,
        FileKind::Twin => ClothTwin::from_bytes(bytes, name).map(drop)?,
        FileKind::Family => FamilyData::from_bytes(bytes, name).map(drop)?,
        FileKind::Cloth => ClothData::from_bytes(bytes, name).map(drop)?,
    }
    Ok(())
}

/// Reads and checks a file of this kind; returns its bytes.
#[pyfunction]
pub(crate) fn read_checked<'py>(py: Python<'py>, kind: &str, path: PathBuf) -> Outcome<Bound<'py, PyBytes>> {
    let kind = kind_of(kind)?;
    let bytes = py.detach(|| -> Outcome<Vec<u8>> {
        let bytes = io::read_file(&path, kind.most_bytes())?;
        check(kind, &bytes, &path.display().to_string())?;
        Ok(bytes)
    })?;
    Ok(PyBytes::new(py, &bytes))
}

/// Refuses bytes that are not a file of this kind.
#[pyfunction]
pub(crate) fn check_bytes(py: Python<'_>, kind: &str, bytes: &[u8], name: &str) -> Outcome {
    let kind = kind_of(kind)?;
    py.detach(|| check(kind, bytes, name))
}

/// Rewrites the bytes of a file, which another program may have made, as this program writes them: checked,
/// with recomputed statistics and reference values.
#[pyfunction]
pub(crate) fn rewritten<'py>(py: Python<'py>, kind: &str, bytes: &[u8], name: &str) -> Outcome<Bound<'py, PyBytes>> {
    let kind = kind_of(kind)?;
    let bytes = py.detach(|| match kind {
        FileKind::Table => Table::from_bytes(bytes, name)?.to_bytes(),
        FileKind::Model => PlyData::from_bytes(bytes, name)?.to_bytes(),
        FileKind::Fiber => FiberTable::from_bytes(bytes, name)?.to_bytes(),
        FileKind::Speckle => SpecklePatterns::from_bytes(bytes, name)?.to_bytes(),
        FileKind::Twin => ClothTwin::from_bytes(bytes, name)?.to_bytes(),
        FileKind::Family => FamilyData::from_bytes(bytes, name)?.to_bytes(),
        FileKind::Cloth => ClothData::from_bytes(bytes, name)?.to_bytes(),
    });
    Ok(PyBytes::new(py, &bytes?))
}

/// Kind of a file, according to its header.
#[pyfunction]
pub(crate) fn file_kind(path: PathBuf) -> Outcome<&'static str> {
    let kind = io::file_kind(path)?;
    Ok(KINDS.into_iter().find(|(_, known)| *known == kind).map_or("", |(name, _)| name))
}

/// Writes a file atomically.
#[pyfunction]
pub(crate) fn write_file(py: Python<'_>, path: PathBuf, bytes: &[u8]) -> Outcome {
    Ok(py.detach(|| io::write_file(path, bytes))?)
}

/// Converts a JSON document to TOML.
#[pyfunction]
pub(crate) fn toml_of_json(json: &str, name: &str) -> Outcome<String> {
    let value: serde_json::Value = serde_json::from_str(json)
        .map_err(|e| Failure::Input(format!("{name}: {e}; give a dict of numbers, texts, lists and dicts")))?;
    toml::to_string(&value)
        .map_err(|e| Failure::Input(format!("{name}: {e}; give a dict of numbers, texts, lists and dicts")))
}

/// Converts a TOML text to a JSON document.
#[pyfunction]
pub(crate) fn json_of_toml(text: &str, name: &str) -> Outcome<String> {
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| {
        let line = e.span().map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
        Failure::Input(format!("{name}: line {line}: {}; see docs/howto/cluster.md", e.message().replace('\n', " ")))
    })?;
    serde_json::to_string(&table).map_err(|e| Failure::Input(format!("{name}: {e}; use finite numbers")))
}
