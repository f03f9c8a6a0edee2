//! Puts the viewer's site into the program, if the variable `PLYWAVE_VIEWER` names its folder (`viewer/dist`
//! after `npm run build`).

use std::fmt::Write;
use std::path::{Path, PathBuf};

fn files(folder: &Path, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            files(&path, found)?;
        } else {
            found.push(path);
        }
    }
    Ok(())
}

fn main() -> std::io::Result<()> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=PLYWAVE_VIEWER");
    let mut list = "&[\n".to_string();
    if let Some(folder) = std::env::var_os("PLYWAVE_VIEWER").filter(|value| !value.is_empty()) {
        let folder = std::fs::canonicalize(folder)?;
        println!("cargo::rerun-if-changed={}", folder.display());
        let mut found = Vec::new();
        files(&folder, &mut found)?;
        found.sort();
        for path in found {
            let parts = path.strip_prefix(&folder).map_err(std::io::Error::other)?.iter();
            let name = parts.map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/");
            writeln!(list, "({name:?}, include_bytes!({path:?})),").map_err(std::io::Error::other)?;
        }
    }
    list.push(']');
    let out = std::env::var_os("OUT_DIR").ok_or_else(|| std::io::Error::other("no OUT_DIR"))?;
    std::fs::write(Path::new(&out).join("site.rs"), list)
}
