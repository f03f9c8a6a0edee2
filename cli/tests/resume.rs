//! Results do not depend on the number of threads, nor on being killed and resumed.
#![cfg(unix)]

mod common;

use common::{folder, names, plywave, run, succeed, text};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Enough work to be caught in the middle of.
const RUN: &[&str] = &["build", "tiny.toml", "--preset", "preview", "--paths", "40000", "--quiet"];

fn bytes(folder: &Path, file: &str) -> Vec<u8> {
    std::fs::read(folder.join(file)).unwrap()
}

/// Starts a run that writes `output`, and waits until some of its shards are done.
fn start(folder: &Path, output: &str) -> Child {
    let mut child = plywave(folder, RUN)
        .args(["-o", output, "--keep-table", "--threads", "1"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let parts = folder.join(format!("{output}.parts"));
    let begun = Instant::now();
    while !parts.is_dir() || names(&parts).iter().filter(|n| n.contains("shard")).count() < 2 {
        assert!(child.try_wait().unwrap().is_none(), "ended before it could be stopped");
        assert!(begun.elapsed() < Duration::from_secs(60), "no shard within a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

#[test]
fn threads_kills_and_interrupts_do_not_change_the_result() {
    let folder = folder();
    let dir = folder.path();
    succeed(dir, &[RUN, &["-o", "whole.pwm", "--keep-table", "--threads", "2"]].concat());
    let (table, model) = (bytes(dir, "whole.pwt"), bytes(dir, "whole.pwm"));

    // kill -9 in the middle: the shards stay, and nothing else.
    let mut child = start(dir, "killed.pwm");
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(names(dir), ["killed.pwm.parts", "tiny.toml", "whole.pwm", "whole.pwt"]);
    // Another seed does not take them up.
    let other = run(dir, &[RUN, &["-o", "killed.pwm", "--seed", "5", "--resume"]].concat());
    assert_eq!(other.status.code(), Some(2), "{}", text(&other.stderr));
    succeed(dir, &[RUN, &["-o", "killed.pwm", "--keep-table", "--threads", "1", "--resume"]].concat());
    assert_eq!((bytes(dir, "killed.pwt"), bytes(dir, "killed.pwm")), (table.clone(), model.clone()));
    assert!(!dir.join("killed.pwm.parts").exists());

    // Ctrl-C: exit code 130, one line that says how to go on, and it does go on from there.
    let child = start(dir, "stopped.pwm");
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    assert!(err.contains("go on with: plywave build tiny.toml") && err.contains("--resume"), "{err}");
    assert!(!dir.join("stopped.pwm").exists() && !dir.join("stopped.pwt").exists());
    succeed(dir, &[RUN, &["-o", "stopped.pwm", "--keep-table", "--threads", "2", "--resume"]].concat());
    assert_eq!((bytes(dir, "stopped.pwt"), bytes(dir, "stopped.pwm")), (table, model));
}
