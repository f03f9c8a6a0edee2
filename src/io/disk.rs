//! Reading and writing of whole files. Every reader has a size limit and accepts only regular files. Every
//! writer leaves a complete file or none.

use super::utf8;
use crate::math::hash::mix64;
use crate::{Error, Result};
use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::hash::{BuildHasher, Hasher};
use std::io::{BufWriter, ErrorKind, Read, Take, Write};
use std::path::{Path, PathBuf};

/// Maximum number of symbolic links that are followed to the target of an output, as in Linux.
const MAX_LINKS: usize = 40;
/// Prefix and suffix of the names of files while they are being written.
const TEMPORARY: [&str; 2] = [".plywave-", ".tmp"];
/// Maximum number of temporary names that are tried, and of attempts to lock a file.
const MAX_TRIES: usize = 100;
/// Maximum number of times that a file which changes while it is read is read again.
const MAX_READS: usize = 3;

fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// Converts an error of the system into one about a path.
pub(super) fn error_at(path: &Path) -> impl Fn(std::io::Error) -> Error + use<> {
    let file = shown(path);
    move |source| Error::Io { file: file.clone(), source }
}

fn format_error(path: &Path, what: String, hint: &str) -> Error {
    Error::Format { file: shown(path), what, hint: hint.to_string() }
}

/// Name of the type of a file that is not regular, for messages.
fn kind_of(metadata: &Metadata) -> &'static str {
    if metadata.is_dir() { "a folder" } else { "a device, pipe or socket" }
}

/// Returns an error if a file is not regular. The check comes before opening the file, because opening a pipe
/// would wait for its other end.
fn regular(path: &Path, metadata: &Metadata) -> Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    Err(format_error(path, format!("{}, not a regular file", kind_of(metadata)), "give a regular file"))
}

/// Opens a regular file of at most `max_bytes` bytes for reading. If the file grows in the meantime, reading
/// stops after one byte more.
///
/// # Errors
/// [`Error::Io`] if it cannot be opened; [`Error::Format`] for a folder, device, pipe or socket, and for a
/// larger file.
pub fn open_file(path: impl AsRef<Path>, max_bytes: u64) -> Result<Take<File>> {
    let path = path.as_ref();
    regular(path, &fs::metadata(path).map_err(error_at(path))?)?;
    let file = File::open(path).map_err(error_at(path))?;
    // The name may refer to another file by now.
    let metadata = file.metadata().map_err(error_at(path))?;
    regular(path, &metadata)?;
    if metadata.len() > max_bytes {
        return Err(too_large(path, max_bytes));
    }
    Ok(file.take(max_bytes.saturating_add(1)))
}

fn too_large(path: &Path, max_bytes: u64) -> Error {
    format_error(path, format!("larger than {max_bytes} bytes"), "use a smaller file")
}

/// The bytes of a regular file of at most `max_bytes` bytes. A file that another program writes in the
/// meantime is read again. A write that had begun before, and one within the resolution of the file system's
/// times, a few milliseconds, are not noticed.
///
/// # Errors
/// Those of [`open_file`], and [`Error::Format`] for a larger file, and for one that changes at every read.
pub fn read_file(path: impl AsRef<Path>, max_bytes: u64) -> Result<Vec<u8>> {
    let path = path.as_ref();
    for _ in 0..MAX_READS {
        if let Some(bytes) = read_unchanged(path, max_bytes, || {})? {
            return Ok(bytes);
        }
    }
    Err(format_error(path, "changes while it is read".into(), "run it again when the file is complete"))
}

/// The bytes of a file; `None` if its size or its time of modification changed in the meantime. Tests change
/// it when it is `opened`.
fn read_unchanged(path: &Path, max_bytes: u64, opened: impl FnOnce()) -> Result<Option<Vec<u8>>> {
    let mut file = open_file(path, max_bytes)?;
    let before = file.get_ref().metadata().map_err(error_at(path))?;
    opened();
    let size = before.len();
    let mut bytes = Vec::new();
    if bytes.try_reserve_exact(size as usize + 1).is_err() {
        return Err(format_error(path, format!("{size} bytes do not fit in memory"), "use a smaller file"));
    }
    file.read_to_end(&mut bytes).map_err(error_at(path))?;
    let after = file.get_ref().metadata().map_err(error_at(path))?;
    // Systems without times of modification tell the size alone.
    if (before.len(), before.modified().ok()) != (after.len(), after.modified().ok()) {
        return Ok(None);
    }
    if bytes.len() as u64 > max_bytes { Err(too_large(path, max_bytes)) } else { Ok(Some(bytes)) }
}

/// The text of a regular file of at most `max_bytes` bytes in UTF-8.
///
/// # Errors
/// Those of [`read_file`], and [`Error::Format`] for bytes that are not UTF-8.
pub fn read_text(path: impl AsRef<Path>, max_bytes: u64) -> Result<String> {
    let path = path.as_ref();
    utf8(read_file(path, max_bytes)?, &shown(path))
}

/// The file that an output path refers to, which is the target of its symbolic links. It need not exist.
///
/// # Errors
/// [`Error::Format`] for a folder, device, pipe or socket, for a write-protected file, and for a path without
/// a file name; [`Error::Io`] if the path cannot be read.
pub fn output_target(path: impl AsRef<Path>) -> Result<PathBuf> {
    let path = path.as_ref();
    let mut target = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match fs::symlink_metadata(&target) {
            Err(e) if e.kind() == ErrorKind::NotFound => break,
            Err(e) => return Err(error_at(path)(e)),
            Ok(metadata) if metadata.is_symlink() => {
                let next = fs::read_link(&target).map_err(error_at(path))?;
                target = target.parent().unwrap_or(Path::new("")).join(next);
            }
            Ok(metadata) if !metadata.is_file() => {
                let what = format!("{}, not a regular file", kind_of(&metadata));
                return Err(format_error(path, what, "name a regular file, or one that does not exist yet"));
            }
            Ok(metadata) if metadata.permissions().readonly() => {
                return Err(format_error(path, "write-protected".into(), "name another file, or allow writing to it"));
            }
            Ok(_) => break,
        }
    }
    if target.file_name().is_none() {
        return Err(format_error(path, "no file name".into(), "name a file"));
    }
    if target.is_symlink() {
        return Err(format_error(path, format!("more than {MAX_LINKS} symbolic links"), "name a regular file"));
    }
    Ok(target)
}

/// Writes `bytes` as the whole content of a file, in the way of [`write_file_with`].
///
/// # Errors
/// Those of [`write_file_with`].
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    write_file_with(path, |out| out.write_all(bytes))
}

/// Writes a file piece by piece. The content goes to a new file of random name in the same folder, which is
/// flushed to the disk and then renamed, so `path` has the old content or the new content, never a part of
/// it. A symbolic link is preserved and its target is written. An existing file keeps its permissions.
///
/// # Errors
/// Those of [`output_target`], and [`Error::Io`]. After an error the temporary file is removed.
pub fn write_file_with(
    path: impl AsRef<Path>,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<()> {
    let path = path.as_ref();
    let target = output_target(path)?;
    let folder = folder_of(&target);
    let (temporary, file) = create_new(&target).map_err(error_at(path))?;
    let written = fill(&file, write).and_then(|()| {
        if let Ok(old) = fs::metadata(&target) {
            fs::set_permissions(&temporary, old.permissions())?;
        }
        fs::rename(&temporary, &target)
    });
    if written.is_err() {
        // The first error is reported. Failure to remove the temporary file does not change it.
        let _ = fs::remove_file(&temporary);
    }
    drop(file);
    written.map_err(error_at(path))?;
    // The rename is on the disk once the folder is. Some file systems do not support flushing a folder.
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    Ok(())
}

/// Locks a file, which is created if absent, for as long as the handle lives; `None` while another process
/// holds the lock. The system releases the lock when a process ends for any reason. The first holder to
/// finish removes the file. On file systems without locks every process gets the lock.
///
/// # Errors
/// [`Error::Io`] if it cannot be created.
pub fn lock_file(path: impl AsRef<Path>) -> Result<Option<File>> {
    let path = path.as_ref();
    // Another process may remove the file between opening and locking. The next attempt then creates it
    // again.
    for _ in 0..MAX_TRIES {
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create(true).truncate(false).open(path).map_err(error_at(path))?;
        match file.try_lock() {
            Ok(()) if is_there(&file, path) => return Ok(Some(file)),
            Ok(()) => {}
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => return Ok(Some(file)),
            Err(TryLockError::Error(error)) => return Err(error_at(path)(error)),
            Err(TryLockError::WouldBlock) => break,
        }
    }
    Ok(None)
}

/// Whether the open file is still the one at `path`.
#[cfg(unix)]
fn is_there(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let key = |m: &Metadata| (m.dev(), m.ino());
    matches!((file.metadata(), fs::metadata(path)), (Ok(a), Ok(b)) if key(&a) == key(&b))
}

/// On other systems an open file cannot be deleted.
#[cfg(not(unix))]
fn is_there(_: &File, path: &Path) -> bool {
    path.exists()
}

/// Whether a name is that of a file that is being written; a killed program leaves such files behind.
pub fn is_temporary(name: &str) -> bool {
    name.starts_with(TEMPORARY[0]) && name.ends_with(TEMPORARY[1])
}

/// The folder of a file.
pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Fills a new file and flushes it to the disk.
pub(super) fn fill(file: &File, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 16, file);
    write(&mut out)?;
    out.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()
}

/// A new file with an unpredictable name beside `target`, locked while it is open.
pub(super) fn create_new(target: &Path) -> std::io::Result<(PathBuf, File)> {
    unused(target, |path| {
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        // It is still unlocked here, so that `remove_leftovers` may take it.
        let is_taken =
            cfg!(unix) && (matches!(file.try_lock(), Err(TryLockError::WouldBlock)) || !is_there(&file, path));
        if is_taken { Err(ErrorKind::AlreadyExists.into()) } else { Ok(file) }
    })
}

/// Removes what killed programs have left beside an output that they were writing. Files that a running
/// program writes are locked and stay; on file systems without locks, and on other systems than Unix, all
/// stay. Errors are ignored, since a leftover does no harm.
pub fn remove_leftovers(output: impl AsRef<Path>) {
    let Some(target) = output_target(output).ok().filter(|_| cfg!(unix)) else { return };
    let Ok(entries) = fs::read_dir(folder_of(&target)) else { return };
    let head = head_of(&target);
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with(&head)
            && is_temporary(&name)
            && let Ok(file) = File::open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Start of the names of temporary files beside `target`.
fn head_of(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default();
    let hash = name.as_encoded_bytes().iter().fold(0, |hash, byte| mix64(hash ^ u64::from(*byte)));
    format!("{}{hash:016x}-", TEMPORARY[0])
}

/// An unpredictable name beside `target` at which `make` finds no other file, and what `make` returned for
/// it.
pub(super) fn unused<T>(target: &Path, make: impl Fn(&Path) -> std::io::Result<T>) -> std::io::Result<(PathBuf, T)> {
    let (folder, head) = (folder_of(target), head_of(target));
    let state = std::hash::RandomState::new();
    let mut last = ErrorKind::AlreadyExists.into();
    for k in 0..MAX_TRIES {
        let mut hasher = state.build_hasher();
        hasher.write_usize(k);
        let path = folder.join(format!("{head}{:016x}{}", mix64(hasher.finish()), TEMPORARY[1]));
        match make(&path) {
            Ok(made) => return Ok((path, made)),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => last = e,
            Err(e) => return Err(e),
        }
    }
    Err(last)
}

#[cfg(test)]
mod tests {
    //! Written content is read back unchanged; files that are not regular are refused before they can block.
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn files_are_whole_or_untouched() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write_file(&path, b"old").unwrap();
        let failed = write_file_with(&path, |out| {
            out.write_all(&[b'n'; 200_000])?;
            Err(std::io::Error::other("stop"))
        });
        assert!(failed.unwrap_err().to_string().ends_with("stop"));
        assert_eq!(read_file(&path, 3).unwrap(), b"old");
        write_file(&path, b"new").unwrap();
        assert_eq!(read_text(&path, 3).unwrap(), "new");
        assert_eq!(names(folder.path()), ["a"]);
        let message = read_file(&path, 2).unwrap_err().to_string();
        assert!(message.contains("larger than 2 bytes"), "{message}");
        assert!(matches!(write_file(folder.path().join("none/a"), b""), Err(Error::Io { .. })));
        assert!(write_file("", b"").is_err());
    }

    /// A file that is rewritten, cut or continued while it is read does not count as read; one that is
    /// replaced by a rename does, with its old content.
    #[cfg(unix)]
    #[test]
    fn files_that_change_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, beside) = (folder.path().join("a"), folder.path().join("b"));
        let read = |change: &dyn Fn()| {
            fs::write(&path, b"old").unwrap();
            // Longer than the resolution of the file system's times.
            std::thread::sleep(std::time::Duration::from_millis(50));
            read_unchanged(&path, 9, change).unwrap()
        };
        assert_eq!(read(&|| {}).unwrap(), b"old");
        for content in ["new", "ol", "older"] {
            assert_eq!(read(&|| fs::write(&path, content).unwrap()), None, "{content}");
        }
        fs::write(&beside, b"new").unwrap();
        assert_eq!(read(&|| fs::rename(&beside, &path).unwrap()).unwrap(), b"old");
    }

    /// What a killed writer left goes; what another one writes, and what belongs to other outputs, stays.
    #[cfg(unix)]
    #[test]
    fn leftovers_of_killed_writers_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (killed, file) = create_new(&at("a")).unwrap();
        drop(file);
        let (alive, _locked) = create_new(&at("a")).unwrap();
        let (other, file) = create_new(&at("b")).unwrap();
        drop(file);
        fs::write(at(".plywave-diary.tmp"), "mine").unwrap();
        remove_leftovers(at("a"));
        assert!(!killed.exists() && alive.exists() && other.exists() && at(".plywave-diary.tmp").exists());
    }

    #[test]
    fn locks_have_one_holder() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let held = lock_file(&path).unwrap().unwrap();
        assert!(lock_file(&path).unwrap().is_none());
        drop(held);
        let held = lock_file(&path).unwrap().unwrap();
        // After its holder has removed the file, the next one creates it again.
        fs::remove_file(&path).unwrap();
        assert!(lock_file(&path).unwrap().is_some());
        drop(held);
        assert!(matches!(lock_file(folder.path().join("none/lock")), Err(Error::Io { .. })));
    }

    #[cfg(unix)]
    #[test]
    fn links_keep_and_devices_are_refused() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("deep")).unwrap();
        write_file(at("deep/target"), b"old").unwrap();
        fs::set_permissions(at("deep/target"), fs::Permissions::from_mode(0o640)).unwrap();
        symlink("deep/target", at("one")).unwrap();
        symlink(at("one"), at("two")).unwrap();
        write_file(at("two"), b"new").unwrap();
        assert!(at("one").is_symlink() && at("two").is_symlink() && !at("deep/target").is_symlink());
        assert_eq!(fs::read(at("deep/target")).unwrap(), b"new");
        assert_eq!(fs::metadata(at("deep/target")).unwrap().permissions().mode() & 0o777, 0o640);
        assert_eq!(names(&at("deep")), ["target"]);
        // A dangling link creates its target.
        symlink("deep/later", at("dangling")).unwrap();
        write_file(at("dangling"), b"x").unwrap();
        assert_eq!(fs::read(at("deep/later")).unwrap(), b"x");
        symlink("loop", at("loop")).unwrap();
        assert!(write_file(at("loop"), b"x").is_err() && read_file(at("loop"), 9).is_err());

        symlink("/dev/null", at("null")).unwrap();
        for path in [Path::new("/dev/null"), &at("null"), &at("deep")] {
            let (read, write) = (read_file(path, 9).unwrap_err(), write_file(path, b"x").unwrap_err());
            for error in [read, write] {
                let message = error.to_string();
                assert!(message.contains("not a regular file") && message.lines().count() == 1, "{message}");
            }
        }
        assert!(at("null").is_symlink());
        // A pipe or a socket has no end to wait for.
        let made = std::process::Command::new("mkfifo").arg(at("pipe")).status();
        assert!(made.unwrap().success());
        symlink(at("pipe"), at("to_pipe")).unwrap();
        assert!(read_file(at("pipe"), 9).is_err() && read_file(at("to_pipe"), 9).is_err());
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        assert!(read_file(at("socket"), 9).is_err() && write_file(at("socket"), b"x").is_err());
        assert!(read_file("/dev/zero", u64::MAX).is_err());

        fs::set_permissions(at("deep/target"), fs::Permissions::from_mode(0o440)).unwrap();
        let message = write_file(at("one"), b"x").unwrap_err().to_string();
        assert!(message.contains("write-protected"), "{message}");
    }
}
