//! `plywave completions`, `plywave man` and `plywave help`: every command is in each.

use crate::common::{names, refused, succeed};

const COMMANDS: &[&str] = &[
    "simulate",
    "fit",
    "build",
    "info",
    "eval",
    "sample",
    "check",
    "diff",
    "plot",
    "noise",
    "color",
    "weave",
    "wave",
    "compare",
    "render",
    "completions",
    "man",
];

#[test]
fn completions_know_all_commands_and_their_flags() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    for (shell, mark) in [
        ("bash", "complete -F _plywave"),
        ("zsh", "#compdef plywave"),
        ("fish", "complete -c plywave"),
        ("elvish", "edit:completion:arg-completer[plywave]"),
        ("powershell", "Register-ArgumentCompleter"),
    ] {
        let script = succeed(dir, &["completions", shell]);
        assert!(script.contains(mark), "{shell}: no {mark}");
        for word in COMMANDS.iter().chain(&["decades", "tilt", "theta-i"]) {
            assert!(script.contains(word), "{shell}: no {word}");
        }
    }
    refused(dir, &["completions", "tcsh"], &["tcsh", "bash"]);
}

/// The script is one that bash can read.
#[test]
#[cfg(unix)]
fn bash_reads_its_completions() {
    let folder = tempfile::tempdir().unwrap();
    let script = succeed(folder.path(), &["completions", "bash"]);
    std::fs::write(folder.path().join("plywave.bash"), script).unwrap();
    let source = "source ./plywave.bash && COMP_WORDS=(plywave pl) COMP_CWORD=1 && _plywave plywave pl plywave && echo \"${COMPREPLY[@]}\"";
    match std::process::Command::new("bash").args(["-c", source]).current_dir(folder.path()).output() {
        Ok(output) => {
            assert_eq!(crate::common::text(&output.stdout), "plot\n", "{}", crate::common::text(&output.stderr))
        }
        // Not every machine has it.
        Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::NotFound),
    }
}

#[test]
fn manual_pages_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let page = succeed(dir, &["man"]);
    assert!(page.contains(".TH plywave 1") && page.contains(".SH SYNOPSIS") && page.contains("plot"), "{page}");
    succeed(dir, &["man", "-o", "share/man1", "--quiet"]);
    let pages = names(&dir.join("share/man1"));
    assert!(pages.contains(&"plywave.1".into()) && pages.contains(&"plywave-wave-scatter.1".into()), "{pages:?}");
    for command in COMMANDS {
        let page = std::fs::read_to_string(dir.join(format!("share/man1/plywave-{command}.1"))).unwrap();
        assert!(page.contains(".SH OPTIONS") && page.contains("quiet"), "{command}: {page}");
    }
    std::fs::write(dir.join("file"), "").unwrap();
    refused(dir, &["man", "-o", "file"], &["file", "-o"]);
}

#[test]
fn help_is_a_command_too() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    assert_eq!(succeed(dir, &["help", "eval"]), succeed(dir, &["eval", "--help"]));
    assert_eq!(succeed(dir, &["help", "wave", "scatter"]), succeed(dir, &["wave", "scatter", "--help"]));
    assert!(succeed(dir, &["help"]).contains("simulate"));
    refused(dir, &["help", "evaluate"], &["evaluate"]);
}
