//! The parts folder: finished shards on disk, each written to a temporary name and renamed, so that whatever moment a run
//! dies at, a file there is whole.

use crate::error::SimError;
use crate::options::SimOptions;
use crate::shard::Sums;
use plywave::Error;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Finished shards of one run.
pub(crate) struct Parts {
    folder: PathBuf,
}

fn io(path: &Path) -> impl FnOnce(std::io::Error) -> SimError + '_ {
    move |source| Error::Io { file: path.display().to_string(), source }.into()
}

impl Parts {
    /// Open the folder for a run; what it holds is kept only when `resume` is set and it is of the same run.
    pub fn open(folder: &Path, resume: bool, spec_text: &str, options: &SimOptions) -> Result<Parts, SimError> {
        let run = format!("plywave {}\n{options:?}\nspec:\n{spec_text}\n", env!("CARGO_PKG_VERSION"));
        let marker = folder.join("run.txt");
        let parts = Parts { folder: folder.to_path_buf() };
        if folder.exists() {
            let found = fs::read_to_string(&marker).unwrap_or_default();
            if resume && found == run {
                return Ok(parts);
            }
            // Without a marker the folder is ours only when nothing else is in it: a run killed before it wrote the marker.
            let ours =
                found.starts_with("plywave ") || (found.is_empty() && holds_shards_only(folder).map_err(io(folder))?);
            if !ours {
                return Err(Error::Format {
                    file: folder.display().to_string(),
                    what: "exists and holds what is no shard of plywave".into(),
                    mend: "move it away or choose another output".into(),
                }
                .into());
            }
            if resume && !found.is_empty() {
                return Err(Error::Format {
                    file: folder.display().to_string(),
                    what: "holds the shards of another run (spec, preset, seed or version differ)".into(),
                    mend: "give the same spec and options, or leave --resume out to start afresh".into(),
                }
                .into());
            }
            fs::remove_dir_all(folder).map_err(io(folder))?;
        }
        fs::create_dir_all(folder).map_err(io(folder))?;
        write_whole(&marker, run.as_bytes())?;
        Ok(parts)
    }

    /// File of shard `s` of incident latitude `m`, or of all its shards summed.
    fn path(&self, m: usize, s: Option<usize>) -> PathBuf {
        self.folder.join(match s {
            Some(s) => format!("theta{m:02}_shard{s:03}.safetensors"),
            None => format!("theta{m:02}.safetensors"),
        })
    }

    /// Delete the shards of a latitude whose sum is written. What cannot be deleted stays, unused.
    pub fn remove_shards(&self, m: usize, shards: usize) {
        for s in 0..shards {
            let _ = fs::remove_file(self.path(m, Some(s)));
        }
    }

    /// Read a shard, or the sum of a latitude's, into `sums` (whose sizes say what is expected); false when there is none. A file that is damaged is
    /// as good as none.
    pub fn read(&self, m: usize, s: Option<usize>, sums: &mut Sums) -> Result<bool, SimError> {
        let path = self.path(m, s);
        let bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(false),
            Err(e) => return Err(io(&path)(e)),
        };
        let Ok(file) = SafeTensors::deserialize(&bytes) else { return Ok(false) };
        let get = |name: &str, len: usize, size: usize| {
            file.tensor(name).ok().map(|t| t.data().to_vec()).filter(|d| d.len() == len * size)
        };
        let doubles = |bytes: Vec<u8>, to: &mut [f64]| {
            for (v, b) in to.iter_mut().zip(bytes.chunks_exact(8)) {
                *v = f64::from_le_bytes(b.try_into().unwrap_or_default());
            }
        };
        let Some(bins) = get("bins", sums.bins.len(), 4) else { return Ok(false) };
        for (v, b) in sums.bins.iter_mut().zip(bins.chunks_exact(4)) {
            *v = f32::from_le_bytes(b.try_into().unwrap_or_default());
        }
        for (name, to) in sums.doubles_mut() {
            let Some(bytes) = get(name, to.len(), 8) else { return Ok(false) };
            doubles(bytes, to);
        }
        Ok(true)
    }

    /// Write a finished shard.
    pub fn write(&self, m: usize, s: Option<usize>, sums: &Sums) -> Result<(), SimError> {
        let path = self.path(m, s);
        let mut tensors: Vec<(&str, Dtype, usize, Vec<u8>)> =
            vec![("bins", Dtype::F32, sums.bins.len(), sums.bins.iter().flat_map(|v| v.to_le_bytes()).collect())];
        for (name, v) in sums.doubles() {
            tensors.push((name, Dtype::F64, v.len(), v.iter().flat_map(|v| v.to_le_bytes()).collect()));
        }
        let damaged = |e: safetensors::SafeTensorError| {
            SimError::from(Error::Format {
                file: path.display().to_string(),
                what: e.to_string(),
                mend: "free some disk space and resume".into(),
            })
        };
        let views: Vec<(&str, TensorView<'_>)> = tensors
            .iter()
            .map(|(name, dtype, len, bytes)| TensorView::new(*dtype, vec![*len], bytes).map(|v| (*name, v)))
            .collect::<Result<_, _>>()
            .map_err(damaged)?;
        let bytes = safetensors::serialize(views, None).map_err(damaged)?;
        write_whole(&path, &bytes)
    }
}

/// Whether a folder holds nothing but files named as shards are.
fn holds_shards_only(folder: &Path) -> std::io::Result<bool> {
    for entry in fs::read_dir(folder)? {
        let name = entry?.file_name().to_string_lossy().into_owned();
        let shard = name.starts_with("theta") && (name.ends_with(".safetensors") || name.ends_with(".part"));
        if !(shard || name == "run.part") {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Write under a temporary name, flush to the disk, rename.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), SimError> {
    let temporary = path.with_extension("part");
    let mut file = fs::File::create(&temporary).map_err(io(&temporary))?;
    file.write_all(bytes).and_then(|()| file.sync_all()).map_err(io(&temporary))?;
    fs::rename(&temporary, path).map_err(io(path))
}
