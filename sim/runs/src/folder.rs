//! The parts folder of a run: a lock that the running process holds, and one file for every finished shard or
//! group of shards.

use super::disk::{self, io};
use super::job::{Plan, Shards};
use super::part::{Entry, PartFile, encode};
use crate::error::RunError;
use plywave::Error;
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Name of the file that is locked.
const LOCK: &str = "lock";

/// Policy for shards of an earlier run in the folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Refuse to run, so that they are neither used nor deleted without the user's consent.
    Refuse,
    /// Resume: use them.
    Resume,
    /// Replace: delete them and run all shards.
    Replace,
}

/// A folder of parts, locked by this process. The system releases the lock when the process ends for any
/// reason. Files of other programs stay untouched.
#[derive(Debug)]
pub struct PartsFolder {
    path: PathBuf,
    found: Found,
    notes: Mutex<Vec<String>>,
    // The open file holds the lock.
    _lock: fs::File,
}

impl PartsFolder {
    /// Creates the folder if it does not exist, and locks it.
    ///
    /// # Errors
    /// [`RunError::PartsInUse`] when another process has the lock, [`Error::Io`] when the folder cannot be
    /// created, [`Error::Format`] when it holds something else.
    pub fn open(path: impl Into<PathBuf>, found: Found) -> Result<PartsFolder, RunError> {
        let path = path.into();
        let names = if path.exists() { names_in(&path)? } else { Vec::new() };
        let ours = |name: &String| name == LOCK || plywave::io::is_temporary(name) || parse_name(name).is_some();
        if !names.is_empty() && !names.iter().any(ours) {
            return Err(Error::Format {
                file: path.display().to_string(),
                what: "a folder that holds something else than the shards of a run".into(),
                hint: "move it away, or choose another output".into(),
            }
            .into());
        }
        let lock = lock(&path)?;
        let folder = PartsFolder { path, found, notes: Mutex::default(), _lock: lock };
        // Incomplete files of a killed run are removed.
        for name in folder.names()? {
            if plywave::io::is_temporary(&name) {
                let _ = fs::remove_file(folder.path.join(name));
            }
        }
        Ok(folder)
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns and clears the notes for the user on parts that were dropped, one line each.
    pub fn take_notes(&self) -> Vec<String> {
        std::mem::take(&mut *self.notes.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Deletes the parts, and the folder if it has no other files. Files that cannot be deleted are ignored.
    pub fn remove(self) {
        for name in self.names().unwrap_or_default() {
            if parse_name(&name).is_some() {
                let _ = fs::remove_file(self.path.join(name));
            }
        }
    }

    /// Undamaged entries of `job` in the folder, as first shard and number of shards.
    ///
    /// # Errors
    /// [`RunError::PartsFound`] and [`RunError::PartsOfAnotherRun`] for parts that the policy allows neither
    /// to use nor to delete.
    pub(super) fn scan(&self, job: &dyn Shards, plan: &Plan) -> Result<HashSet<(usize, usize)>, RunError> {
        let mut whole = HashSet::new();
        for name in self.names()? {
            let Some((first, count)) = parse_name(&name) else { continue };
            let path = self.path.join(&name);
            if self.found == Found::Replace {
                fs::remove_file(&path).map_err(io(&path))?;
                continue;
            }
            let file = match PartFile::open(&path) {
                Ok(file) => file,
                Err(error) => {
                    self.note(&error);
                    continue;
                }
            };
            if file.digest() != plan.digest {
                return Err(RunError::PartsOfAnotherRun { folder: self.path.display().to_string() });
            }
            // Shards beyond the end belong to a longer run.
            if first + count > plan.shards {
                continue;
            }
            match self.entry(job, &file, first, count) {
                Ok(_) => {
                    whole.insert((first, count));
                }
                Err(error) => self.note(&error),
            }
        }
        if self.found == Found::Refuse && !whole.is_empty() {
            let found = whole.iter().map(|(_, count)| count).sum();
            let folder = self.path.display().to_string();
            return Err(RunError::PartsFound { folder, found, total: plan.shards });
        }
        Ok(whole)
    }

    /// Reads an entry that [`PartsFolder::scan`] found.
    pub(super) fn read(&self, job: &dyn Shards, first: usize, count: usize) -> Result<Entry, RunError> {
        self.entry(job, &PartFile::open(&self.file(first, count))?, first, count)
    }

    fn entry(&self, job: &dyn Shards, file: &PartFile, first: usize, count: usize) -> Result<Entry, RunError> {
        if !file.entries().eq([(first, count)]) {
            return Err(Error::Format {
                file: self.file(first, count).display().to_string(),
                what: "its name is that of other shards".into(),
                hint: "the shards are run again".into(),
            }
            .into());
        }
        file.entry(job, 0)
    }

    /// Writes a finished shard or group.
    pub(super) fn write(&self, job: &dyn Shards, plan: &Plan, entry: &Entry) -> Result<(), RunError> {
        let path = self.file(entry.first, entry.count);
        let bytes = encode(job, plan, std::slice::from_ref(entry), &path.display().to_string())?;
        disk::write_whole(&path, &bytes)
    }

    /// Deletes the file of a shard after its group was written. A file that cannot be deleted stays unused.
    pub(super) fn forget(&self, shard: usize) {
        let _ = fs::remove_file(self.file(shard, 1));
    }

    fn note(&self, error: &RunError) {
        let line = format!("{error} (dropped, its shards are run again)");
        let mut notes = self.notes.lock().unwrap_or_else(PoisonError::into_inner);
        if !notes.contains(&line) {
            notes.push(line);
        }
    }

    fn file(&self, first: usize, count: usize) -> PathBuf {
        self.path.join(block_name(first, count))
    }

    fn names(&self) -> Result<Vec<String>, RunError> {
        names_in(&self.path)
    }
}

/// File name of shards `first..first + count`, which are one shard or a group.
pub fn block_name(first: usize, count: usize) -> String {
    match count {
        1 => format!("shard-{first:06}.pwp"),
        _ => format!("shard-{first:06}-{:06}.pwp", first + count - 1),
    }
}

/// Names in a folder, sorted.
fn names_in(folder: &Path) -> Result<Vec<String>, RunError> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(io(folder))? {
        names.push(entry.map_err(io(folder))?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

impl Drop for PartsFolder {
    /// Removes a folder without parts, so that a refused run leaves nothing behind.
    fn drop(&mut self) {
        let ours = |name: &String| parse_name(name).is_some();
        if self.names().is_ok_and(|names| !names.iter().any(ours)) {
            let _ = fs::remove_file(self.path.join(LOCK));
            let _ = fs::remove_dir(&self.path);
        }
    }
}

/// First shard and number of shards of a file name.
fn parse_name(name: &str) -> Option<(usize, usize)> {
    let numbers = name.strip_prefix("shard-")?.strip_suffix(".pwp")?;
    let number = |text: &str| text.bytes().all(|b| b.is_ascii_digit()).then(|| text.parse::<usize>().ok()).flatten();
    match numbers.split_once('-') {
        None => Some((number(numbers)?, 1)),
        Some((first, last)) => {
            let (first, last) = (number(first)?, number(last)?);
            (last > first && last < usize::MAX).then(|| (first, last - first + 1))
        }
    }
}

fn lock(folder: &Path) -> Result<fs::File, RunError> {
    // Another process may remove an empty folder with its lock at its end; the next attempt creates both
    // again.
    for _ in 0..100 {
        fs::create_dir_all(folder).map_err(io(folder))?;
        match plywave::io::lock_file(folder.join(LOCK)) {
            Ok(Some(file)) => return Ok(file),
            Ok(None) => break,
            Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(error.into()),
        }
    }
    Err(RunError::PartsInUse { folder: folder.display().to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for (name, want) in [
            ("shard-000012.pwp", Some((12, 1))),
            ("shard-000008-000015.pwp", Some((8, 8))),
            ("shard-000008-000008.pwp", None),
            ("shard-+00012.pwp", None),
            ("shard-12.pwp.bak", None),
            ("notes.txt", None),
        ] {
            assert_eq!(parse_name(name), want, "{name}");
        }
    }

    /// A second process is refused while the first one holds the folder. The holder removes an empty folder.
    #[test]
    fn folders_have_one_holder() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.parts");
        let held = PartsFolder::open(&path, Found::Refuse).unwrap();
        let second = PartsFolder::open(&path, Found::Resume);
        assert!(matches!(second, Err(RunError::PartsInUse { .. })), "{second:?}");
        drop(held);
        assert!(!path.exists());
        let held = PartsFolder::open(&path, Found::Refuse).unwrap();
        fs::write(path.join("diary.txt"), "mine").unwrap();
        fs::write(path.join("shard-000000.pwp"), "not whole").unwrap();
        fs::write(path.join(".plywave-1-0.tmp"), "half").unwrap();
        drop(held);
        let held = PartsFolder::open(&path, Found::Refuse).unwrap();
        assert!(!path.join(".plywave-1-0.tmp").exists());
        held.remove();
        assert_eq!(fs::read_dir(&path).unwrap().count(), 1);
        assert!(path.join("diary.txt").exists());
    }
}
