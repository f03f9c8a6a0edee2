//! Standard output that tolerates a closed pipe, and output files that are written atomically.

use crate::failure::{Failure, Outcome};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes to standard output, buffered; the last line is flushed.
pub fn print(write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Outcome {
    let mut out = std::io::BufWriter::with_capacity(1 << 16, std::io::stdout().lock());
    write(&mut out).and_then(|()| out.flush()).map_err(stdout_failure)
}

/// Prints a value as indented JSON.
pub fn print_json(value: &impl serde::Serialize) -> Outcome {
    print(|out| {
        serde_json::to_writer_pretty(&mut *out, value).map_err(std::io::Error::from)?;
        writeln!(out)
    })
}

/// Failure for a failed write to standard output.
fn stdout_failure(error: std::io::Error) -> Failure {
    match error.kind() {
        std::io::ErrorKind::BrokenPipe => Failure::BrokenPipe,
        _ => Failure::Input(format!("standard output: {error}; give it a place that can be written")),
    }
}

/// Whether two paths refer to one file, through links, other spellings or other names.
fn is_same(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let [a, b] = [a, b].map(std::fs::metadata);
        if let (Ok(a), Ok(b)) = (a, b) {
            return (a.dev(), a.ino()) == (b.dev(), b.ino());
        }
    }
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Refuses an output path that cannot be written, before any work: its folder must exist and accept a new
/// file; the path must be new or a regular file, and must not be an input of the command. What killed runs
/// left beside it is removed.
pub fn check_writable(path: &Path, inputs: &[&Path]) -> Outcome {
    let refuse = |what: String, hint: &str| Err(Failure::input(path.display(), "-o", what, hint));
    if inputs.iter().any(|input| is_same(input, path)) {
        return refuse("an input of this command".into(), "name another file");
    }
    if path.file_name().is_none() || path.is_dir() {
        return refuse("a folder".into(), "name a file in it");
    }
    if std::fs::metadata(path).is_ok_and(|m| !m.is_file()) {
        return refuse("a device or pipe".into(), "name a regular file");
    }
    let target = target_of(path);
    let folder = folder(&target);
    if !folder.is_dir() {
        return refuse(format!("a file in {}", folder.display()), "this folder does not exist; make it first");
    }
    match tempfile::tempfile_in(folder) {
        // The probe file is removed when it is dropped.
        Ok(_) => {
            plywave::io::remove_leftovers(path);
            Ok(())
        }
        Err(error) => refuse(error.to_string(), "choose a place that can be written"),
    }
}

/// Refuses an output folder that cannot be created or contains anything but an earlier run: an existing
/// folder must be empty or contain `mark`.
pub fn check_folder(path: &Path, mark: &str, inputs: &[&Path]) -> Outcome {
    let refuse = |what: String, hint: &str| Err(Failure::input(path.display(), "-o", what, hint));
    if !path.exists() {
        return check_writable(path, inputs);
    }
    if !path.is_dir() {
        return refuse("a file".into(), "name a folder");
    }
    let empty = std::fs::read_dir(path).map(|mut entries| entries.next().is_none());
    match empty {
        Ok(empty) if empty || path.join(mark).is_file() => check_writable(&path.join(mark), inputs),
        Ok(_) => refuse(format!("a folder without {mark}"), "name another folder, or an empty one"),
        Err(error) => refuse(error.to_string(), "choose a folder that can be read"),
    }
}

/// An output that is locked against other runs.
pub struct Held {
    lock: PathBuf,
    // The file is stored for its lock.
    _file: std::fs::File,
}

impl Drop for Held {
    fn drop(&mut self) {
        // The lock file of a killed run, or one that cannot be removed, does no harm.
        let _ = std::fs::remove_file(&self.lock);
    }
}

/// Locks an output against other runs while the result lives, by a locked file beside it; refuses an output
/// that another run has locked.
pub fn hold(path: &Path) -> Outcome<Held> {
    let target = plywave::io::output_target(path)?;
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    let lock = target.with_file_name(format!(".{name}.lock"));
    match plywave::io::lock_file(&lock)? {
        Some(file) => Ok(Held { lock, _file: file }),
        None => {
            let hint = "wait for its end, or name another output";
            Err(Failure::input(path.display(), "-o", "written by another run", hint))
        }
    }
}

/// Writes a file atomically.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Outcome {
    write_whole_by(path, |out| out.write_all(bytes))
}

/// Writes a file atomically in pieces, with the writer of `plywave::io`.
pub fn write_whole_by(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Outcome {
    plywave::io::write_file_with(path, write).map_err(unwritten)
}

/// Writes several files as one: either all of them, or none.
pub fn write_set<P: AsRef<Path>, B: AsRef<[u8]>>(files: &[(P, B)]) -> Outcome {
    plywave::io::write_files(files).map_err(unwritten)
}

/// Failure for a failed write to a file.
fn unwritten(error: plywave::Error) -> Failure {
    match error {
        plywave::Error::Io { file, source } => Failure::input(file, "-o", source, "choose a place that can be written"),
        other => other.into(),
    }
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// The file to which a link leads; a path that is not a link is returned unchanged.
fn target_of(path: &Path) -> PathBuf {
    match std::fs::symlink_metadata(path) {
        Ok(about) if about.is_symlink() => path.canonicalize().unwrap_or_else(|_| path.to_path_buf()),
        _ => path.to_path_buf(),
    }
}

/// `path` with another ending in the current folder: the default output without `-o`.
pub fn default_output(input: &Path, extension: &str) -> PathBuf {
    let mut name = input.file_stem().unwrap_or("out".as_ref()).to_os_string();
    name.push(".");
    name.push(extension);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_refused_or_whole() {
        let dir = tempfile::tempdir().unwrap();
        assert!(check_writable(dir.path(), &[]).is_err());
        assert!(check_writable(&dir.path().join("none/x.pwm"), &[]).is_err());
        let file = dir.path().join("x.pwm");
        check_writable(&file, &[]).unwrap();
        assert!(!file.exists());
        write_whole(&file, b"abc").unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"abc");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(check_writable(&file, &[&dir.path().join(".").join("x.pwm")]).is_err(), "an input is not overwritten");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_refused() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let dir = tempfile::tempdir().unwrap();
        let (file, link, twin) = (dir.path().join("a"), dir.path().join("link"), dir.path().join("twin"));
        write_whole(&file, b"1").unwrap();
        assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode() & 0o400, 0o400);
        symlink(&file, &link).unwrap();
        std::fs::hard_link(&file, &twin).unwrap();
        for input in [&link, &twin] {
            assert!(check_writable(&file, &[input]).is_err(), "{input:?} is the same file");
        }
        write_whole(&link, b"2").unwrap();
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(std::fs::read(&file).unwrap(), b"2");
        assert!(check_writable(Path::new("/dev/null"), &[]).is_err());
        // A write that fails midway leaves the old file and nothing else.
        assert!(write_whole_by(&file, |_| Err(std::io::Error::other("full"))).is_err());
        assert_eq!(std::fs::read(&file).unwrap(), b"2");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 3);
    }

    #[test]
    fn outputs_have_one_holder() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let held = hold(&path).unwrap();
        assert!(matches!(hold(&path), Err(Failure::Input(line)) if line.contains("another run")));
        // Another name of the same file, and another file.
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("a.png", dir.path().join("link.png")).unwrap();
            assert!(hold(&dir.path().join("link.png")).is_err());
            std::fs::remove_file(dir.path().join("link.png")).unwrap();
        }
        hold(&dir.path().join("b.png")).unwrap();
        drop(held);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        hold(&path).unwrap();
    }

    #[test]
    fn default_outputs_stand_in_the_current_folder() {
        assert_eq!(default_output(Path::new("fabrics/wool.toml"), "pwm"), Path::new("wool.pwm"));
        assert_eq!(default_output(Path::new("silk.v2.toml"), "pwm"), Path::new("silk.v2.pwm"));
    }
}
