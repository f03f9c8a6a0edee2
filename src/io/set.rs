//! Writing of several files as one: all have their new content, or all are unchanged.

use super::disk::{create_new, error_at, fill, folder_of, output_target, remove_leftovers, unused};
use crate::{Error, Result};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// A file of a set. Its content is stored under a temporary name in the folder of its target.
struct Staged {
    path: PathBuf,
    target: PathBuf,
    temporary: PathBuf,
    /// The new file, which is locked while it is open.
    _file: File,
    /// A second name of the file that was at the target, and that file, locked.
    old: Option<(PathBuf, Option<File>)>,
    is_placed: bool,
}

/// The state of a set, which is undone on drop unless the whole set is in place.
#[derive(Default)]
struct FileSet {
    /// Folders that were created for the set.
    folders: Vec<PathBuf>,
    files: Vec<Staged>,
    is_done: bool,
}

/// Writes several files: afterwards either all have their new content, or all are unchanged. Each is written
/// under a temporary name beside its target and flushed to the disk. Only then are they renamed, in the given
/// order; if a rename fails, the old files are restored. Missing folders are created. Links, permissions and
/// errors are handled as by [`super::write_file_with`].
///
/// # Errors
/// Those of [`super::write_file_with`], and [`Error::Format`] if two names refer to one file.
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
    /// Writes a file under a temporary name, and removes what killed programs left beside it.
    fn stage(&mut self, path: &Path, bytes: &[u8]) -> Result<()> {
        let target = output_target(path)?;
        if self.files.iter().any(|staged| staged.target == target) {
            let (what, hint) = ("named twice".into(), "give each file a name of its own".into());
            return Err(Error::Format { file: path.display().to_string(), what, hint });
        }
        let folder = folder_of(&target);
        self.make_folders(folder).map_err(error_at(path))?;
        remove_leftovers(&target);
        let (temporary, file) = create_new(&target).map_err(error_at(path))?;
        let filled = fill(&file, |out| out.write_all(bytes));
        self.files.push(Staged { path: path.into(), target, temporary, _file: file, old: None, is_placed: false });
        filled.map_err(error_at(path))
    }

    /// Creates a folder and its missing parents, and remembers them.
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

    /// Renames all files to their targets.
    fn place(&mut self) -> Result<()> {
        for staged in &mut self.files {
            staged.place().map_err(error_at(&staged.path))?;
        }
        self.is_done = true;
        Ok(())
    }

    /// Removes the second names of replaced files and flushes the folders. A rename is on the disk once its
    /// folder is; some file systems do not flush folders.
    fn forget_old(&self) {
        for staged in &self.files {
            if let Some((old, _)) = &staged.old {
                // The new files are in place, and a remaining old name does not change that.
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
            // If something other than a file has appeared here since the set was begun, it is not moved away.
            if !old.is_file() {
                return Err(already_exists());
            }
            fs::set_permissions(&self.temporary, old.permissions())?;
            self.old = Some(second_name(&self.target)?);
        }
        fs::rename(&self.temporary, &self.target)?;
        self.is_placed = true;
        Ok(())
    }

    /// Restores the state before. The first error has been reported already, and further errors cannot be
    /// handled.
    fn undo(&self) {
        let _ = match (&self.old, self.is_placed) {
            (None, false) => fs::remove_file(&self.temporary),
            (None, true) => fs::remove_file(&self.target),
            (Some((old, _)), true) => fs::rename(old, &self.target),
            (Some((old, _)), false) => {
                let _ = fs::remove_file(&self.temporary);
                // Renaming between two names of one file would leave both.
                if self.target.exists() { fs::remove_file(old) } else { fs::rename(old, &self.target) }
            }
        };
    }
}

/// A second name of a file in its folder. Without support for hard links the file is renamed to it.
fn second_name(target: &Path) -> std::io::Result<(PathBuf, Option<File>)> {
    // The lock comes before the name, so that `remove_leftovers` of another program leaves the name alone.
    let file = File::open(target).ok().filter(|file| file.try_lock_shared().is_ok());
    let name = unused(target, |name| fs::hard_link(target, name));
    if let Ok((name, ())) = name {
        return Ok((name, file));
    }
    // The only name of the old file now: one that `remove_leftovers` does not remove.
    let old = |name: &Path| name.with_extension("old");
    let rename = |name: &Path| if old(name).exists() { Err(already_exists()) } else { fs::rename(target, old(name)) };
    Ok((old(&unused(target, rename)?.0), file))
}

fn already_exists() -> std::io::Error {
    std::io::ErrorKind::AlreadyExists.into()
}

impl Drop for FileSet {
    fn drop(&mut self) {
        if self.is_done {
            return;
        }
        self.files.iter().rev().for_each(Staged::undo);
        for folder in self.folders.iter().rev() {
            // If it cannot be removed, another program has put files into it in the meantime.
            let _ = fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    //! A set that fails at any of its files leaves all old files and nothing else.
    use super::*;
    #[cfg(unix)]
    use crate::io::is_temporary;

    /// Every path below a folder, and the content of the files.
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
        // A folder at the place of a file, before and after the others; and one file with two names.
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

    /// A killed program has left a file of a set; the next set that has it removes that.
    #[cfg(unix)]
    #[test]
    fn leftovers_of_killed_sets_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["a", "b", "other"] {
            drop(create_new(&at(name)).unwrap());
        }
        write_files(&[(at("a"), b"next"), (at("b"), b"next")]).unwrap();
        let files = tree(folder.path());
        let left = files.iter().filter(|(path, _)| is_temporary(&path.file_name().unwrap().to_string_lossy()));
        assert_eq!((files.len(), left.count()), (3, 1), "{files:?}");
    }

    /// A rename that fails after others have succeeded, because a folder has taken the place of a file.
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
