//! Standard output that outlives a closed pipe, and output files that are whole or absent.

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

/// What a failed write to standard output means.
fn stdout_failure(error: std::io::Error) -> Failure {
    match error.kind() {
        std::io::ErrorKind::BrokenPipe => Failure::BrokenPipe,
        _ => Failure::Input(format!("standard output: {error}; give it a place that can be written")),
    }
}

/// Refuses an output path that cannot be written, before any work is done: its folder must exist and take a new file, the path
/// itself must not be a folder, nor one of the command's inputs.
pub fn check_writable(path: &Path, inputs: &[&Path]) -> Outcome {
    let refuse = |what: String, mend: &str| Err(Failure::input(path.display(), "-o", what, mend));
    if let Ok(there) = path.canonicalize()
        && inputs.iter().any(|input| input.canonicalize().is_ok_and(|input| input == there))
    {
        return refuse("an input of this command".into(), "name another file");
    }
    if path.file_name().is_none() || path.is_dir() {
        return refuse("a folder".into(), "name a file in it");
    }
    let folder = folder(path);
    if !folder.is_dir() {
        return refuse(format!("a file in {}", folder.display()), "this folder does not exist; make it first");
    }
    let probe = temporary(path);
    match std::fs::File::create(&probe) {
        Ok(_) => {
            // A probe that cannot be taken away again was at least written, which was the question.
            let _ = std::fs::remove_file(&probe);
            Ok(())
        }
        Err(error) => refuse(error.to_string(), "choose a place that can be written"),
    }
}

/// Refuses a folder to be written that could not be made, or that holds what is not from an earlier run: an existing one must be empty or hold `mark`.
pub fn check_folder(path: &Path, mark: &str, inputs: &[&Path]) -> Outcome {
    let refuse = |what: String, mend: &str| Err(Failure::input(path.display(), "-o", what, mend));
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

/// Writes a file under a temporary name beside it, then renames it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Outcome {
    write_whole_by(path, |out| out.write_all(bytes))
}

/// As [`write_whole`], piece by piece.
pub fn write_whole_by(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Outcome {
    let part = temporary(path);
    let written = std::fs::File::create(&part).and_then(|file| {
        let mut out = std::io::BufWriter::with_capacity(1 << 16, file);
        write(&mut out)?;
        out.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()?;
        std::fs::rename(&part, path)
    });
    written.map_err(|error| {
        let _ = std::fs::remove_file(&part);
        Failure::input(path.display(), "-o", error, "choose a place that can be written")
    })
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

fn temporary(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.part", std::process::id()));
    folder(path).join(name)
}

/// `path` with another ending, in the current folder: where an output goes when no `-o` is given.
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

    #[test]
    fn default_outputs_stand_in_the_current_folder() {
        assert_eq!(default_output(Path::new("fabrics/wool.toml"), "pwm"), Path::new("wool.pwm"));
        assert_eq!(default_output(Path::new("silk.v2.toml"), "pwm"), Path::new("silk.v2.pwm"));
    }
}
