//! The files that a format writes, and the marks that distinguish files of an earlier export from all others.

use super::Format;
use super::{blender, mitsuba, openpbr::texture_names};
use crate::error::Error;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Number of bytes at the start of a file in which its mark is searched.
const HEAD: u64 = 1 << 16;
/// Start of a report's CSV, which identifies it in place of a mark.
pub const CSV_HEAD: &str = "side,tilt_deg,azimuth_deg";

/// Ending of a path, in lower case.
pub fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// Common start of the names of files beside a main file: its name without ending, and the format, so that
/// two formats never share files.
pub fn stem_beside(format: Format, main: &Path) -> String {
    let stem = main.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let suffix = format!("_{}", format.name());
    if stem.ends_with(&suffix) { stem } else { stem + &suffix }
}

impl Format {
    /// All files that an export with these main files writes.
    pub fn outputs(self, mains: &[PathBuf]) -> Vec<PathBuf> {
        let mut all = mains.to_vec();
        for main in
            mains.iter().filter(|_| matches!(self, Format::OpenPbr | Format::Usd | Format::Blender | Format::Mitsuba))
        {
            let stem = stem_beside(self, main);
            if self == Format::Usd {
                all.push(main.with_file_name(format!("{stem}.mtlx")));
            }
            let names: Vec<String> = match self {
                Format::Blender => blender::texture_names(&stem).into(),
                Format::Mitsuba => mitsuba::texture_names(&stem).into(),
                _ => texture_names(&stem).into(),
            };
            all.extend(names.into_iter().map(|name| main.with_file_name(name)));
        }
        all
    }

    /// Refuses to replace files that this format did not write: those of other formats, commands and
    /// programs.
    ///
    /// # Errors
    /// [`Error::Runtime`] for such a file, and for one that cannot be read.
    pub fn check_outputs(self, mains: &[PathBuf]) -> Result<(), Error> {
        match self.outputs(mains).into_iter().find_map(|path| self.foreign(&path).transpose()) {
            None => Ok(()),
            Some(Err(error)) => Err(error.into()),
            Some(Ok(path)) => Err(Error::Runtime(plywave::Error::Invalid {
                file: path.display().to_string(),
                key: "output".into(),
                value: format!("a file that is not of an earlier export to {}", self.name()),
                hint: "name another file, or give --force (in Python force=True) to replace it".into(),
            })),
        }
    }

    /// The path, if a file exists there that this format did not write.
    fn foreign(self, path: &Path) -> plywave::Result<Option<PathBuf>> {
        if !path.exists() {
            return Ok(None);
        }
        let mut head = Vec::new();
        let read = plywave::io::open_file(path, u64::MAX)?.take(HEAD).read_to_end(&mut head);
        read.map_err(|source| plywave::Error::Io { file: path.display().to_string(), source })?;
        let mark = self.mark();
        let is_own = head.windows(mark.len()).any(|part| part == mark.as_bytes())
            || self == Format::Report && ending(path) == "csv" && head.starts_with(CSV_HEAD.as_bytes());
        Ok((!is_own).then(|| path.to_path_buf()))
    }
}
