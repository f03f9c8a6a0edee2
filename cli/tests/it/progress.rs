//! Long commands show what they do and how far they are: on a terminal, which `script` of util-linux gives
//! them, a bar.
#![cfg(target_os = "linux")]

use crate::common::{folder, succeed, text};
use std::path::Path;
use std::process::{Command, Stdio};

/// What a terminal would show of a command.
fn on_a_terminal(dir: &Path, args: &str) -> String {
    let command = format!("'{}' {args}", env!("CARGO_BIN_EXE_plywave"));
    let mut script = Command::new("script");
    script.args(["-qec", &command, "/dev/null"]).current_dir(dir).stdin(Stdio::null()).env("TERM", "xterm");
    let output = script.env("PLYWAVE_CACHE", dir.join("cache")).output().expect("script of util-linux");
    let shown = text(&output.stdout);
    assert!(output.status.success(), "{shown}");
    shown
}

#[test]
fn cloths_and_packings_show_how_far_they_are() {
    let folder = folder();
    let dir = folder.path();
    succeed(dir, &["new", "percale", "-q"]);
    succeed(dir, &["new", "cotton", "-q"]);
    let shown = on_a_terminal(dir, "weave percale.toml");
    assert!(shown.contains("curves [") && shown.contains(" left") && shown.contains("thickness"), "{shown}");
    let shown = on_a_terminal(dir, "info cotton.toml");
    assert!(shown.contains("pack [") && shown.contains(" plies/s") && shown.contains("yarn spec of cotton"), "{shown}");
    for quiet in ["weave percale.toml -q", "info cotton.toml -q"] {
        let shown = on_a_terminal(dir, quiet);
        assert!(!shown.contains("curves [") && !shown.contains("pack ["), "{shown}");
    }
}
