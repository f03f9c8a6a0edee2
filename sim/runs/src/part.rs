//! The file that holds one or several parts: safetensors with a JSON document and a SHA-256 checksum
//! (`docs/reference/format/parts.md`, "plywave-part").

use super::arrays::{Part, Values};
use super::disk;
use super::job::{Description, PART_VERSION, Plan, Shards, hex_digest};
use crate::error::RunError;
use plywave::Error;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;

/// Format name in the file.
const FORMAT: &str = "plywave-part";
/// Key of the JSON document in the metadata.
const KEY: &str = "plywave";
/// Tensor of the checksum. It is the only tensor of bytes, so safetensors puts it last.
const CHECKSUM: &str = "sha256";
/// Length of the checksum [bytes].
const CHECKSUM_BYTES: usize = 32;

/// Checks the layout and the values of the part of shards `first..first + count` of `job`.
pub(super) fn check_part(part: &Part, job: &dyn Shards, first: usize, count: usize) -> Result<(), String> {
    let layout = job.layout(first);
    if layout.len() != part.arrays.len() {
        return Err(format!("{} arrays, expected {}", part.arrays.len(), layout.len()));
    }
    for (array, values) in layout.iter().zip(&part.arrays) {
        let name = array.name;
        if values.len() != array.len() || array.single != matches!(values, Values::F32(_)) {
            return Err(format!("{name} has {} values, expected the shape {:?}", values.len(), array.shape));
        }
        let [low, high] = array.range;
        // The comparison is written such that a NaN fails it.
        let bad = match values {
            Values::F32(v) => v.iter().position(|v| !(f64::from(*v) >= low && f64::from(*v) <= high)),
            Values::F64(v) => v.iter().position(|v| !(*v >= low && *v <= high)),
        };
        if let Some(at) = bad {
            return Err(format!("{name}[{at}] is not between {low} and {high}"));
        }
    }
    job.check(first, count, part)
}

/// A part and its shards.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// First shard.
    pub first: usize,
    /// Number of shards, added up in their order.
    pub count: usize,
    /// Their sum.
    pub part: Part,
}

impl Entry {
    /// The shards.
    pub fn shards(&self) -> Range<usize> {
        self.first..self.first + self.count
    }
}

#[derive(Serialize, Deserialize)]
struct EntryHead {
    first: usize,
    count: usize,
    seconds: f64,
    peak_bytes: u64,
}

/// The JSON document of a file of parts.
#[derive(Serialize, Deserialize)]
struct Document {
    format: String,
    version: u64,
    program_version: String,
    kind: String,
    job: String,
    shards: usize,
    extent: u64,
    description: Description,
    entries: Vec<EntryHead>,
}

/// A file of parts that was read and checked: its checksum matches, and the job's digest is that of its
/// description.
pub struct PartFile {
    /// Name of the file for messages.
    name: String,
    document: Document,
    bytes: Vec<u8>,
}

/// Bytes of the file of `entries` of a job.
pub(super) fn encode(job: &dyn Shards, plan: &Plan, entries: &[Entry], name: &str) -> Result<Vec<u8>, RunError> {
    let failed = |e: &dyn std::fmt::Display| -> RunError {
        Error::Format { file: name.into(), what: e.to_string(), hint: "use fewer shards a part".into() }.into()
    };
    let document = Document {
        format: FORMAT.into(),
        version: PART_VERSION,
        program_version: plan.description.program_version.clone(),
        kind: plan.description.kind.clone(),
        job: plan.digest.clone(),
        shards: plan.shards,
        extent: plan.extent,
        description: plan.description.clone(),
        entries: entries
            .iter()
            .map(|e| EntryHead {
                first: e.first,
                count: e.count,
                seconds: e.part.seconds,
                peak_bytes: e.part.peak_bytes,
            })
            .collect(),
    };
    let text = serde_json::to_string(&document).map_err(|e| failed(&e))?;
    let mut tensors = Vec::new();
    for entry in entries {
        for (array, values) in job.layout(entry.first).iter().zip(&entry.part.arrays) {
            tensors.push((tensor_name(entry.first, array.name), values.dtype(), array.shape.clone(), values.bytes()));
        }
    }
    tensors.push((CHECKSUM.into(), Dtype::U8, vec![CHECKSUM_BYTES], vec![0; CHECKSUM_BYTES]));
    let mut views = Vec::with_capacity(tensors.len());
    for (name, dtype, shape, bytes) in &tensors {
        let view = TensorView::new(*dtype, shape.clone(), bytes).map_err(|e| failed(&e))?;
        views.push((name.as_str(), view));
    }
    let metadata = HashMap::from([(KEY.to_string(), text)]);
    let mut bytes = safetensors::serialize(views, Some(metadata)).map_err(|e| failed(&e))?;
    let end = bytes.len() - CHECKSUM_BYTES;
    let (content, checksum) = bytes.split_at_mut(end);
    checksum.copy_from_slice(Sha256::digest(&*content).as_slice());
    Ok(bytes)
}

fn tensor_name(first: usize, array: &str) -> String {
    format!("{first:06}.{array}")
}

impl PartFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be read, [`Error::Format`] when it is not a file of parts, has another
    /// version or is damaged.
    pub fn open(path: &Path) -> Result<PartFile, RunError> {
        PartFile::from_bytes(disk::read_whole(path)?, &path.display().to_string())
    }

    /// Reads a file from its bytes; `name` stands for the file in errors.
    ///
    /// # Errors
    /// The errors of [`PartFile::open`].
    pub fn from_bytes(bytes: Vec<u8>, name: &str) -> Result<PartFile, RunError> {
        let refuse = |what: &str, hint: &str| -> RunError {
            Error::Format { file: name.into(), what: what.into(), hint: hint.into() }.into()
        };
        let damaged = |what: &str| refuse(what, "the part is damaged: run its shards again");
        let foreign = || refuse("not a part of plywave", "give files written with --shards");
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|_| foreign())?;
        let text = metadata.metadata().as_ref().and_then(|m| m.get(KEY)).ok_or_else(foreign)?;
        let (content, checksum) = bytes.split_at(bytes.len().saturating_sub(CHECKSUM_BYTES));
        #[derive(Deserialize)]
        struct Head {
            format: String,
            version: u64,
        }
        let head: Head = serde_json::from_str(text).map_err(|_| foreign())?;
        if head.format != FORMAT {
            return Err(foreign());
        }
        if Sha256::digest(content).as_slice() != checksum {
            return Err(damaged("its checksum does not hold"));
        }
        if head.version != PART_VERSION {
            let what = format!("version {} of {FORMAT}, expected {PART_VERSION}", head.version);
            return Err(refuse(&what, "merge it with the program that wrote it, or run its shards again"));
        }
        let document: Document = serde_json::from_str(text).map_err(|_| damaged("its description cannot be read"))?;
        if document.job != hex_digest(document.description.text().as_bytes())
            || document.kind != document.description.kind
        {
            return Err(damaged("the job's digest is not that of its description"));
        }
        let mut last = 0;
        for entry in &document.entries {
            let end = entry.first.checked_add(entry.count).filter(|end| *end <= document.shards);
            let Some(end) = end.filter(|_| entry.count > 0 && entry.first >= last) else {
                return Err(damaged("its shards are not in ascending order"));
            };
            if !(entry.seconds >= 0.0 && entry.seconds.is_finite()) {
                return Err(damaged("the time of its work is no time"));
            }
            last = end;
        }
        if document.entries.is_empty() {
            return Err(damaged("it holds no shards"));
        }
        Ok(PartFile { name: name.into(), document, bytes })
    }

    /// Description of the job.
    pub fn description(&self) -> &Description {
        &self.document.description
    }

    /// The job's identity.
    pub fn digest(&self) -> &str {
        &self.document.job
    }

    /// Shards of the whole job.
    pub fn shards(&self) -> usize {
        self.document.shards
    }

    /// Extent of the job, see [`Shards::extent`].
    pub fn extent(&self) -> u64 {
        self.document.extent
    }

    /// First shard and number of shards of each entry, ascending.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.document.entries.iter().map(|e| (e.first, e.count))
    }

    /// Entry `at`, with sizes and values checked against the job.
    ///
    /// # Errors
    /// [`Error::Format`] for arrays that do not fit the job's layout.
    pub fn entry(&self, job: &dyn Shards, at: usize) -> Result<Entry, RunError> {
        let head = &self.document.entries[at];
        let bad = |what: String| -> RunError {
            let hint = "the part is damaged: run its shards again".into();
            Error::Format { file: self.name.clone(), what: format!("shard {}: {what}", head.first), hint }.into()
        };
        if head.count > 1 && (!head.first.is_multiple_of(job.group()) || head.count > job.group()) {
            return Err(bad("a sum that is no group of the job's".into()));
        }
        let file = SafeTensors::deserialize(&self.bytes).map_err(|e| bad(e.to_string()))?;
        let mut arrays = Vec::new();
        for array in job.layout(head.first) {
            let tensor = file
                .tensor(&tensor_name(head.first, array.name))
                .map_err(|_| bad(format!("array {} is missing", array.name)))?;
            let dtype = if array.single { Dtype::F32 } else { Dtype::F64 };
            if tensor.shape() != array.shape || tensor.dtype() != dtype {
                let what = format!("{} has the shape {:?}, expected {:?}", array.name, tensor.shape(), array.shape);
                return Err(bad(what));
            }
            let data = tensor.data();
            arrays.push(if array.single {
                Values::F32(data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
            } else {
                Values::F64(data.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect())
            });
        }
        let part = Part { arrays, seconds: head.seconds, peak_bytes: head.peak_bytes };
        check_part(&part, job, head.first, head.count).map_err(bad)?;
        Ok(Entry { first: head.first, count: head.count, part })
    }
}
