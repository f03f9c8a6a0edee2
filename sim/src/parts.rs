//! The parts folder: finished shards on disk, each written to a temporary name and renamed, so that whatever moment a run
//! dies at, a file there is whole.

use crate::error::SimError;
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
    pub fn open(
        folder: &Path,
        resume: bool,
        spec_text: &str,
        options: &dyn std::fmt::Debug,
    ) -> Result<Parts, SimError> {
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
        let Some(file) = File::open(self.path(m, s))? else { return Ok(false) };
        Ok(file.floats("bins", &mut sums.bins) && sums.doubles_mut().into_iter().all(|(n, to)| file.doubles(n, to)))
    }

    /// Write a finished shard.
    pub fn write(&self, m: usize, s: Option<usize>, sums: &Sums) -> Result<(), SimError> {
        write_arrays(&self.path(m, s), ("bins", &sums.bins), &sums.doubles())
    }

    /// File of the fiber shard that begins at latitude `m` of wavelength `l`.
    fn fiber_path(&self, l: usize, m: usize) -> PathBuf {
        self.folder.join(format!("theta{m:03}_lambda{l:03}.safetensors"))
    }

    /// Read part of a fiber table, whose sizes say what is expected; false when there is none or it is damaged.
    pub fn read_fiber(
        &self,
        l: usize,
        m: usize,
        azimuthal: &mut [f32],
        widths: [&mut [f64]; 2],
    ) -> Result<bool, SimError> {
        let Some(file) = File::open(self.fiber_path(l, m))? else { return Ok(false) };
        let [c_x, c_abs] = widths;
        Ok(file.floats("azimuthal", azimuthal) && file.doubles("c_x_um", c_x) && file.doubles("c_abs_um", c_abs))
    }

    /// Write part of a fiber table.
    pub fn write_fiber(&self, l: usize, m: usize, azimuthal: &[f32], widths: [&[f64]; 2]) -> Result<(), SimError> {
        let doubles = [("c_x_um", widths[0]), ("c_abs_um", widths[1])];
        write_arrays(&self.fiber_path(l, m), ("azimuthal", azimuthal), &doubles)
    }
}

/// The bytes of a shard's file that holds together.
struct File(Vec<u8>);

impl File {
    fn open(path: PathBuf) -> Result<Option<File>, SimError> {
        match fs::read(&path) {
            Ok(bytes) => Ok(SafeTensors::deserialize(&bytes).is_ok().then_some(File(bytes))),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(io(&path)(e)),
        }
    }

    fn read<const N: usize, T>(&self, name: &str, to: &mut [T], from: impl Fn([u8; N]) -> T) -> bool {
        let Ok(file) = SafeTensors::deserialize(&self.0) else { return false };
        let Ok(tensor) = file.tensor(name) else { return false };
        let (values, rest) = tensor.data().as_chunks::<N>();
        if values.len() != to.len() || !rest.is_empty() {
            return false;
        }
        to.iter_mut().zip(values).for_each(|(to, bytes)| *to = from(*bytes));
        true
    }

    fn floats(&self, name: &str, to: &mut [f32]) -> bool {
        self.read(name, to, f32::from_le_bytes)
    }

    fn doubles(&self, name: &str, to: &mut [f64]) -> bool {
        self.read(name, to, f64::from_le_bytes)
    }
}

/// Write one array of f32 and several of f64.
fn write_arrays(path: &Path, floats: (&str, &[f32]), doubles: &[(&str, &[f64])]) -> Result<(), SimError> {
    let bytes = floats.1.iter().flat_map(|v| v.to_le_bytes()).collect();
    let mut tensors: Vec<(&str, Dtype, usize, Vec<u8>)> = vec![(floats.0, Dtype::F32, floats.1.len(), bytes)];
    for (name, v) in doubles {
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
    write_whole(path, &bytes)
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
