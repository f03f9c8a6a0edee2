//! The parts folder of a run: a lock that the running process holds, and one file for every finished shard or
//! group of shards.

use super::disk::{self, io};
use super::job::{Job, Plan};
use super::part::{Entry, PartFile, encode};
use crate::error::SimError;
use plywave::Error;
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Name of the file that is locked.
const LOCK: &str = "lock";

/// What to do with an earlier run's shards in the folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Refuse to run, so that they are neither used nor deleted unasked.
    Refuse,
    /// Use them.
    Resume,
    /// Delete them.
    Replace,
}

/// A folder of parts, locked by this process. The system releases the lock whenever and however the process
/// ends. Files that are not plywave's stay untouched.
#[derive(Debug)]
pub struct PartsFolder {
    path: PathBuf,
    found: Found,
    notes: Mutex<Vec<String>>,
    // Kept open for its lock.
    _lock: fs::File,
}

impl PartsFolder {
    /// Creates the folder if it does not exist, and locks it.
    ///
    /// # Errors
    /// [`SimError::PartsInUse`] when another process has the lock, [`Error::Io`] when the folder cannot be
    /// created, [`Error::Format`] when it holds something else.
    pub fn open(path: impl Into<PathBuf>, found: Found) -> Result<PartsFolder, SimError> {
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
        // Remove partial files of a killed run.
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

    /// Takes the notes for the user, a line each: parts that were dropped.
    pub fn take_notes(&self) -> Vec<String> {
        std::mem::take(&mut *self.notes.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Deletes the parts, and the folder when nothing else is in it. Files that cannot be deleted do no harm.
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
    /// [`SimError::PartsFound`] and [`SimError::PartsOfAnotherRun`] for parts that may not be used or deleted
    /// unasked.
    pub(super) fn scan<J: Job + ?Sized>(&self, job: &J, plan: &Plan) -> Result<HashSet<(usize, usize)>, SimError> {
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
                return Err(SimError::PartsOfAnotherRun { folder: self.path.display().to_string() });
            }
            // Shards beyond the end are those of a longer run.
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
            return Err(SimError::PartsFound { folder, found, total: plan.shards });
        }
        Ok(whole)
    }

    /// Reads an entry that [`PartsFolder::scan`] found.
    pub(super) fn read<J: Job + ?Sized>(&self, job: &J, first: usize, count: usize) -> Result<Entry, SimError> {
        self.entry(job, &PartFile::open(&self.file(first, count))?, first, count)
    }

    fn entry<J: Job + ?Sized>(&self, job: &J, file: &PartFile, first: usize, count: usize) -> Result<Entry, SimError> {
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
    pub(super) fn write<J: Job + ?Sized>(&self, job: &J, plan: &Plan, entry: &Entry) -> Result<(), SimError> {
        let path = self.file(entry.first, entry.count);
        let bytes = encode(job, plan, std::slice::from_ref(entry), &path.display().to_string())?;
        disk::write_whole(&path, &bytes)
    }

    /// Deletes a shard whose group is written. A file that cannot be deleted stays unused.
    pub(super) fn forget(&self, shard: usize) {
        let _ = fs::remove_file(self.file(shard, 1));
    }

    fn note(&self, error: &SimError) {
        let line = format!("{error} (dropped, its shards are run again)");
        let mut notes = self.notes.lock().unwrap_or_else(PoisonError::into_inner);
        if !notes.contains(&line) {
            notes.push(line);
        }
    }

    fn file(&self, first: usize, count: usize) -> PathBuf {
        self.path.join(block_name(first, count))
    }

    fn names(&self) -> Result<Vec<String>, SimError> {
        names_in(&self.path)
    }
}

/// Name of the file of shards `first..first + count`, one shard or a group.
pub fn block_name(first: usize, count: usize) -> String {
    match count {
        1 => format!("shard-{first:06}.pwp"),
        _ => format!("shard-{first:06}-{:06}.pwp", first + count - 1),
    }
}

/// Names in a folder, sorted.
fn names_in(folder: &Path) -> Result<Vec<String>, SimError> {
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

/// First shard and number of shards by a file's name.
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

fn lock(folder: &Path) -> Result<fs::File, SimError> {
    // A process that ends removes an empty folder and its lock; another try then creates both again.
    for _ in 0..100 {
        fs::create_dir_all(folder).map_err(io(folder))?;
        match plywave::io::lock_file(folder.join(LOCK)) {
            Ok(Some(file)) => return Ok(file),
            Ok(None) => break,
            Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(error.into()),
        }
    }
    Err(SimError::PartsInUse { folder: folder.display().to_string() })
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

    /// A second process is refused while the first holds the folder; the holder removes an empty folder.
    #[test]
    fn folders_have_one_holder() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.parts");
        let held = PartsFolder::open(&path, Found::Refuse).unwrap();
        let second = PartsFolder::open(&path, Found::Resume);
        assert!(matches!(second, Err(SimError::PartsInUse { .. })), "{second:?}");
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
