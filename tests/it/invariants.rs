//! Invariants of the code in ARCHITECTURE.md, checked in the sources: dependencies of crates, access to
//! files, unsafe code.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Rust files below a folder, by their path from the root.
fn sources(folder: &str) -> Vec<String> {
    let mut open: Vec<PathBuf> = vec![root().join(folder)];
    let mut found = Vec::new();
    while let Some(at) = open.pop() {
        for entry in std::fs::read_dir(&at).unwrap_or_else(|e| panic!("{}: {e}", at.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path.strip_prefix(root()).unwrap().to_string_lossy().replace('\\', "/"));
            }
        }
    }
    found.sort();
    assert!(!found.is_empty(), "{folder}: no source");
    found
}

/// Lines of a file without comments.
fn code(file: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join(file)).unwrap();
    text.lines().map(|line| line.split("//").next().unwrap_or_default().to_owned()).collect()
}

/// Dependencies of a crate, without those of its tests.
fn dependencies(manifest: &str) -> BTreeSet<String> {
    let text = std::fs::read_to_string(root().join(manifest)).unwrap();
    let table: toml::Table = text.parse().unwrap();
    table["dependencies"].as_table().unwrap().keys().cloned().collect()
}

#[test]
fn crates_depend_on_those_below() {
    let edges: [(&str, &[&str]); 8] = [
        ("Cargo.toml", &[]),
        ("sim/Cargo.toml", &["plywave"]),
        ("fit/Cargo.toml", &["plywave"]),
        ("render/Cargo.toml", &["plywave"]),
        ("capi/Cargo.toml", &["plywave"]),
        ("pipeline/Cargo.toml", &["plywave", "plywave-fit", "plywave-models", "plywave-sim"]),
        ("cli/Cargo.toml", &["plywave", "plywave-fit", "plywave-pipeline", "plywave-render", "plywave-sim"]),
        ("python/Cargo.toml", &["plywave", "plywave-fit", "plywave-pipeline", "plywave-sim"]),
    ];
    for (manifest, expected) in edges {
        let own: Vec<String> = dependencies(manifest).into_iter().filter(|d| d.starts_with("plywave")).collect();
        assert_eq!(own, expected, "{manifest}");
    }
}

/// The runtime that a host links has no simulator, optimizer, thread pool or random numbers.
#[test]
fn the_runtime_is_light() {
    let allowed = ["configparser", "multiversion", "safetensors", "serde", "serde_json", "thiserror", "toml"];
    assert_eq!(dependencies("Cargo.toml").into_iter().collect::<Vec<_>>(), allowed);
}

/// Random numbers come in as arguments, and whoever calls decides on threads.
#[test]
fn the_runtime_starts_no_thread_and_draws_no_number() {
    for file in sources("src").iter().filter(|f| *f != "src/math/hash.rs") {
        let mut in_tests = false;
        for (i, line) in code(file).iter().enumerate() {
            in_tests |= line.contains("#[cfg(test)]");
            let found = ["std::thread", "thread::", "rayon", "rand::", "rand_pcg", "SplitMix64"];
            let found = found.iter().find(|word| line.contains(**word));
            assert!(in_tests || found.is_none(), "{file}:{}: {line}", i + 1);
        }
    }
}

/// Hosts without a file system hand in bytes by name.
#[test]
fn the_runtime_touches_files_in_io_alone() {
    for file in sources("src").iter().filter(|f| !f.starts_with("src/io/")) {
        for (i, line) in code(file).iter().enumerate() {
            let touches = ["std::fs", "fs::", "File::"].iter().any(|word| line.contains(word));
            assert!(!touches, "{file}:{}: {line}: go through plywave::io", i + 1);
        }
    }
}

#[test]
fn unsafe_code_is_where_architecture_says() {
    let allowed = ["render/src/strands/wide.rs"];
    for folder in ["src", "sim/src", "fit/src", "pipeline/src", "render/src", "cli/src"] {
        for file in sources(folder).iter().filter(|f| !allowed.contains(&f.as_str())) {
            for (i, line) in code(file).iter().enumerate() {
                let is_unsafe = line.contains("unsafe {") || line.contains("unsafe fn") || line.contains("unsafe impl");
                assert!(!is_unsafe, "{file}:{}: {line}", i + 1);
            }
        }
    }
}

/// Production code does not use its reference implementations; `src/check` compares with them.
#[test]
fn reference_implementations_are_for_tests() {
    for folder in ["src", "fit/src", "sim/src", "render/src", "pipeline/src", "cli/src"] {
        for file in sources(folder) {
            let mut in_tests = false;
            for (i, line) in code(&file).iter().enumerate() {
                in_tests |= line.contains("#[cfg(test)]");
                let uses = line.contains("ply::reference") || line.contains("super::reference");
                let declares = file == "src/ply.rs" || file == "src/ply/reference.rs" || file.starts_with("src/check");
                assert!(in_tests || declares || !uses, "{file}:{}: {line}", i + 1);
            }
        }
    }
}

/// Absorption and wavelength are the host's at evaluation: no ply kernel knows a wavelength.
#[test]
fn ply_kernels_know_no_wavelength() {
    for file in sources("src/ply/kernel") {
        for (i, line) in code(&file).iter().enumerate() {
            assert!(!line.contains("lambda"), "{file}:{}: {line}", i + 1);
        }
    }
}
