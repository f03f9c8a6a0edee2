//! Writing of several files as one: all of them are new, or all are as they were.

use super::disk::{create_new, error_at, fill, folder_of, output_target, unused};
use crate::{Error, Result};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// A file of a set: its content lies under a temporary name in the folder of its target.
struct Staged {
    path: PathBuf,
    target: PathBuf,
    temporary: PathBuf,
    /// Another name of what was at the target.
    old: Option<PathBuf>,
    is_placed: bool,
}

/// What is undone unless the whole set is in place.
#[derive(Default)]
struct FileSet {
    /// Folders that were made for it.
    folders: Vec<PathBuf>,
    files: Vec<Staged>,
    is_done: bool,
}

/// Writes several files whole: either all have their new content, or all are as they were. Each is written
/// under a temporary name beside its target and flushed to the disk; only then are they renamed, in the order
/// given, and where a rename fails the old files come back. Folders that do not exist are made. Links,
/// permissions and errors are those of [`super::write_file_with`].
///
/// # Errors
/// As [`super::write_file_with`], and [`Error::Format`] for two names of one file.
pub fn write_files<P: AsRef<Path>, B: AsRef<[u8]>>(files: &[(P, B)]) -> Result<()> {
    let mut set = FileSet::default();
    for (path, bytes) in files {
        set.stage(path.as_ref(), bytes.as_ref())?;
    }
    set.place()?;
    set.forget_old();
    Ok(())
}

impl FileSet {
    /// Writes a file under a temporary name.
    fn stage(&mut self, path: &Path, bytes: &[u8]) -> Result<()> {
        let target = output_target(path)?;
        if self.files.iter().any(|staged| staged.target == target) {
            let (what, hint) = ("named twice".into(), "give each file a name of its own".into());
            return Err(Error::Format { file: path.display().to_string(), what, hint });
        }
        let folder = folder_of(&target);
        self.make_folders(folder).map_err(error_at(path))?;
        let (temporary, file) = create_new(folder).map_err(error_at(path))?;
        self.files.push(Staged { path: path.into(), target, temporary, old: None, is_placed: false });
        fill(file, |out| out.write_all(bytes)).map_err(error_at(path))
    }

    /// Makes a folder and those above it, and remembers them.
    fn make_folders(&mut self, folder: &Path) -> std::io::Result<()> {
        if folder.is_dir() {
            return Ok(());
        }
        if let Some(above) = folder.parent().filter(|above| !above.as_os_str().is_empty()) {
            self.make_folders(above)?;
        }
        fs::create_dir(folder)?;
        self.folders.push(folder.into());
        Ok(())
    }

    /// Gives all files their names.
    fn place(&mut self) -> Result<()> {
        for staged in &mut self.files {
            staged.place().map_err(error_at(&staged.path))?;
        }
        self.is_done = true;
        Ok(())
    }

    /// Removes the other names of what was replaced, and flushes the folders: a rename is on the disk once
    /// its folder is, and some file systems do not flush folders.
    fn forget_old(&self) {
        for staged in &self.files {
            if let Some(old) = &staged.old {
                // The new files are in place: a leftover name does not change that.
                let _ = fs::remove_file(old);
            }
        }
        for folder in self.files.iter().map(|staged| folder_of(&staged.target)) {
            if let Ok(folder) = File::open(folder) {
                let _ = folder.sync_all();
            }
        }
    }
}

impl Staged {
    fn place(&mut self) -> std::io::Result<()> {
        if let Ok(old) = fs::metadata(&self.target) {
            // What has come there since the set was begun and is no file is not moved away.
            if !old.is_file() {
                return Err(taken());
            }
            fs::set_permissions(&self.temporary, old.permissions())?;
            self.old = Some(second_name(&self.target)?);
        }
        fs::rename(&self.temporary, &self.target)?;
        self.is_placed = true;
        Ok(())
    }

    /// Brings back what was there. The first error has been reported; nothing more can be done about others.
    fn undo(&self) {
        let _ = match (&self.old, self.is_placed) {
            (None, false) => fs::remove_file(&self.temporary),
            (None, true) => fs::remove_file(&self.target),
            (Some(old), true) => fs::rename(old, &self.target),
            (Some(old), false) => {
                let _ = fs::remove_file(&self.temporary);
                // A rename between two names of one file would leave both.
                if self.target.exists() { fs::remove_file(old) } else { fs::rename(old, &self.target) }
            }
        };
    }
}

/// A further name of a file in its folder; its only one where the file system has no hard links.
fn second_name(target: &Path) -> std::io::Result<PathBuf> {
    let name = unused(folder_of(target), |name| fs::hard_link(target, name));
    name.or_else(|_| {
        unused(folder_of(target), |name| if name.exists() { Err(taken()) } else { fs::rename(target, name) })
    })
    .map(|(name, ())| name)
}

fn taken() -> std::io::Error {
    std::io::ErrorKind::AlreadyExists.into()
}

impl Drop for FileSet {
    fn drop(&mut self) {
        if self.is_done {
            return;
        }
        self.files.iter().rev().for_each(Staged::undo);
        for folder in self.folders.iter().rev() {
            // It has been filled by another program meanwhile, if it cannot be removed.
            let _ = fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    //! A set that fails at any of its files leaves all old files and nothing else.
    use super::*;

    /// Every path below a folder, and the content of files.
    fn tree(folder: &Path) -> Vec<(PathBuf, Option<Vec<u8>>)> {
        let mut all = Vec::new();
        for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap()) {
            let path = entry.path();
            all.push((path.clone(), fs::read(&path).ok()));
            if path.is_dir() {
                all.extend(tree(&path));
            }
        }
        all.sort();
        all
    }

    #[test]
    fn sets_are_whole_or_nothing_changes() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("old"), b"old").unwrap();
        fs::create_dir(at("taken")).unwrap();
        let before = tree(folder.path());
        // A folder at the place of a file, before and after the others; one file with two names.
        for names in [["old", "new/deep/a", "taken"], ["taken", "old", "new/b"], ["old", "new/c", "new/c"]] {
            let files = names.map(|name| (at(name), b"next"));
            let error = write_files(&files).unwrap_err();
            assert_eq!(error.to_string().lines().count(), 1, "{error}");
            assert_eq!(tree(folder.path()), before, "{names:?}");
        }
        write_files(&[(at("old"), b"next"), (at("new/deep/a"), b"last")]).unwrap();
        let names: Vec<PathBuf> = tree(folder.path()).into_iter().map(|(path, _)| path).collect();
        assert_eq!(names, ["new", "new/deep", "new/deep/a", "old", "taken"].map(at));
        assert_eq!(
            (fs::read(at("old")).unwrap(), fs::read(at("new/deep/a")).unwrap()),
            (b"next".into(), b"last".into())
        );
    }

    /// A rename that fails after others have succeeded: a folder takes the place of a file meanwhile.
    #[test]
    fn old_files_come_back_where_a_rename_fails() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["a", "b"] {
            fs::write(at(name), b"old").unwrap();
        }
        let mut set = FileSet::default();
        for name in ["a", "b", "c", "d"] {
            set.stage(&at(name), b"next").unwrap();
        }
        fs::create_dir(at("d")).unwrap();
        fs::write(at("d/x"), b"").unwrap();
        set.place().unwrap_err();
        drop(set);
        let files = tree(folder.path());
        let names: Vec<&Path> = files.iter().map(|(path, _)| path.as_path()).collect();
        assert_eq!(names, ["a", "b", "d", "d/x"].map(at));
        assert!(files[..2].iter().all(|(_, bytes)| bytes.as_deref() == Some(b"old")));
    }
}
