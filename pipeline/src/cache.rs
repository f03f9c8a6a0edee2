//! The user's cache of cloths and of the models of their plies, and the digests that are its keys.

use plywave::Document;
use sha2::{Digest, Sha256};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Folder of cached cloths: the environment variable PLYWAVE_CACHE, or `plywave` in the user's cache folder;
/// `None` if neither exists.
pub fn cloth_cache() -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    of("PLYWAVE_CACHE").or_else(|| {
        let user = of("XDG_CACHE_HOME").or_else(|| of("LOCALAPPDATA")).or_else(|| Some(of("HOME")?.join(".cache")))?;
        Some(user.join("plywave"))
    })
}

/// Largest file whose digest is computed [bytes].
const MAX_INPUT: u64 = 1 << 32;

/// SHA-256 of a file's bytes, in hex.
///
/// # Errors
/// [`plywave::Error::Io`].
pub fn digest_of_file(path: &Path) -> plywave::Result<String> {
    let mut file = plywave::io::open_file(path, MAX_INPUT)?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(hex(&hash.finalize())),
            Ok(n) => hash.update(&buffer[..n]),
            Err(source) => return Err(plywave::Error::Io { file: path.display().to_string(), source }),
        }
    }
}

/// SHA-256 of bytes, in hex.
pub fn digest_of_bytes(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// Saves a document in the cache.
pub(crate) fn keep(data: &impl Document, path: &Path) -> plywave::Result<()> {
    if let Some(folder) = path.parent() {
        let io = |source| plywave::Error::Io { file: folder.display().to_string(), source };
        std::fs::create_dir_all(folder).map_err(io)?;
    }
    data.save(path)
}
