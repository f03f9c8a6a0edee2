//! Sources of the files that a spec names: folders on disk and files in memory.

use super::disk::read_file;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// A source of files by the names in a spec, such as a folder, a map in memory, an archive or a network.
pub trait AssetSource {
    /// The bytes of `name`, at most `max_bytes` of them.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Format`] if the name is unknown or not allowed, or the file is larger.
    fn read(&self, name: &str, max_bytes: u64) -> Result<Vec<u8>>;

    /// Whether there is a file `name`; by default, whether it can be read.
    fn has(&self, name: &str) -> bool {
        self.read(name, u64::MAX).is_ok()
    }

    /// The name that messages use for `name`, such as its path.
    fn display(&self, name: &str) -> String {
        name.to_string()
    }
}

/// Files of a folder on the disk. Names are paths relative to the folder. Absolute paths, `..` and symbolic
/// links that lead out of the folder are errors, unless [`Folder::anywhere`] allows them.
#[derive(Clone, Debug)]
pub struct Folder {
    root: PathBuf,
    anywhere: bool,
}

impl Folder {
    /// The folder `root`; the empty path is the current folder.
    pub fn new(root: impl Into<PathBuf>) -> Folder {
        Folder { root: root.into(), anywhere: false }
    }

    /// The folder that contains the file `path`.
    pub fn of_file(path: &Path) -> Folder {
        Folder::new(path.parent().unwrap_or(Path::new("")))
    }

    /// The same folder, with names that may lead out of it.
    #[must_use]
    pub fn anywhere(self) -> Folder {
        Folder { anywhere: true, ..self }
    }

    /// Whether a name is allowed: it stays in the folder, links included, or may lead out. A missing file is
    /// allowed.
    fn allows(&self, name: &str) -> bool {
        let inside = Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
        let real = |path: &Path| path.canonicalize().ok();
        let root = if self.root.as_os_str().is_empty() { Path::new(".") } else { &self.root };
        let out =
            || matches!((real(root), real(&self.path(name))), (Some(root), Some(file)) if !file.starts_with(&root));
        self.anywhere || inside && !out()
    }

    /// The path of a name.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }
}

impl AssetSource for Folder {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Vec<u8>> {
        if !self.allows(name) {
            return Err(Error::Format {
                file: super::container::one_line(&name),
                what: "leads out of the folder of the file that names it".into(),
                hint: "use a file in that folder or below".into(),
            });
        }
        read_file(self.path(name), max_bytes)
    }

    fn has(&self, name: &str) -> bool {
        self.allows(name) && self.path(name).metadata().is_ok_and(|about| !about.is_dir())
    }

    fn display(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }
}

/// Files in memory by name, for hosts without a file system. Cloning shares the bytes.
///
/// ```
/// use plywave::io::{AssetSource, MemoryAssets};
/// let assets = MemoryAssets::new().with("a.txt", *b"text");
/// assert_eq!(assets.read("a.txt", 100)?, b"text");
/// assert!(assets.read("b.txt", 100).is_err() && assets.read("a.txt", 3).is_err());
/// # Ok::<(), plywave::Error>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct MemoryAssets {
    files: BTreeMap<String, Arc<[u8]>>,
}

impl MemoryAssets {
    /// An empty set of files.
    pub fn new() -> MemoryAssets {
        MemoryAssets::default()
    }

    /// Adds or replaces a file.
    pub fn insert(&mut self, name: impl Into<String>, bytes: impl Into<Arc<[u8]>>) {
        self.files.insert(name.into(), bytes.into());
    }

    /// The same files and another one.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, bytes: impl Into<Arc<[u8]>>) -> MemoryAssets {
        self.insert(name, bytes);
        self
    }
}

impl AssetSource for MemoryAssets {
    fn has(&self, name: &str) -> bool {
        self.files.contains_key(name)
    }

    fn read(&self, name: &str, max_bytes: u64) -> Result<Vec<u8>> {
        let format =
            |what: String, hint: String| Err(Error::Format { file: super::container::one_line(&name), what, hint });
        match self.files.get(name) {
            Some(bytes) if bytes.len() as u64 <= max_bytes => Ok(bytes.to_vec()),
            Some(_) => format(format!("larger than {max_bytes} bytes"), "use a smaller file".into()),
            None => {
                let known: Vec<&str> = self.files.keys().map(String::as_str).take(8).collect();
                let known = if known.is_empty() { "none".to_string() } else { known.join(", ") };
                format("no such asset in memory".into(), format!("hand it in by this name; there are: {known}"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_inside_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        std::fs::create_dir_all(inner.join("deep")).unwrap();
        std::fs::write(inner.join("deep/a"), "a").unwrap();
        std::fs::write(folder.path().join("secret"), "s").unwrap();
        let source = Folder::new(&inner);
        for name in ["deep/a", "./deep/a", "deep/./a"] {
            assert_eq!(source.read(name, 9).unwrap(), b"a");
        }
        let absolute = folder.path().join("secret").display().to_string();
        for name in ["../secret", "deep/../../secret", &absolute] {
            let message = source.read(name, 9).unwrap_err().to_string();
            assert!(message.contains("leads out of the folder"), "{message}");
            assert_eq!(source.clone().anywhere().read(name, 9).unwrap(), b"s");
        }
        assert!(matches!(source.read("none", 9), Err(Error::Io { .. })));
    }

    /// A link is checked by its target, whether it is the file or a folder on the way. The folder itself may
    /// be reached through a link.
    #[cfg(unix)]
    #[test]
    fn links_stay_inside_the_folder() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        std::fs::create_dir_all(inner.join("deep")).unwrap();
        std::fs::write(inner.join("deep/a"), "a").unwrap();
        std::fs::create_dir(folder.path().join("inner2")).unwrap();
        std::fs::write(folder.path().join("inner2/secret"), "s").unwrap();
        symlink("deep/a", inner.join("within")).unwrap();
        symlink("../inner2/secret", inner.join("out")).unwrap();
        symlink(folder.path().join("inner2"), inner.join("folder")).unwrap();
        symlink("folder/secret", inner.join("twice")).unwrap();
        symlink("nowhere", inner.join("dangling")).unwrap();
        symlink(&inner, folder.path().join("door")).unwrap();
        for source in [Folder::new(&inner), Folder::new(folder.path().join("door"))] {
            assert_eq!(source.read("within", 9).unwrap(), b"a");
            for name in ["out", "folder/secret", "twice"] {
                let message = source.read(name, 9).unwrap_err().to_string();
                assert!(message.contains("leads out of the folder"), "{message}");
                assert_eq!(source.clone().anywhere().read(name, 9).unwrap(), b"s");
            }
            assert!(matches!(source.read("dangling", 9), Err(Error::Io { .. })));
        }
    }
}
