//! Families from the command line: nodes chosen by error, stopped and resumed, models taken out, bad input.
#![cfg(unix)]

use crate::common::{ANY_FIT, TINY, folder, json, names, plywave, refused, succeed};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

const MAKE: &[&str] = &["family", "family.toml", "--preset", "preview", "--nodes", "2", "--most-nodes", "3", "--quiet"];

fn spec(folder: &Path, ranges: &str) {
    std::fs::write(folder.join("family.toml"), format!("{TINY}\n[family]\n{ranges}\n")).unwrap();
}

#[test]
#[ignore = "slow: 55 s: a family is made killed resumed and taken apart"]
fn a_family_is_made_killed_resumed_and_taken_apart() {
    let folder = folder();
    let dir = folder.path();
    spec(dir, "fiber_pitch_um = [300.0, 4000.0]\nalpha_fiber = [0.1, 0.4]");
    succeed(dir, &[MAKE, &["-o", "whole.pwfam", "--threads", "2"]].concat());
    let whole = std::fs::read(dir.join("whole.pwfam")).unwrap();
    // So few paths never agree to 0.004: every axis gets all nodes that it may.
    let info = json(&succeed(dir, &["info", "whole.pwfam", "--json"]));
    let axes = info["axes"].as_array().unwrap();
    assert_eq!(info["nodes"], 9);
    for (axis, ends) in axes.iter().zip([[300.0, 4000.0], [0.1, 0.4]]) {
        let values: Vec<f64> = axis["values"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        assert_eq!(values.len(), 3, "{axis}");
        assert!([values[0], values[2]] == ends && values.is_sorted(), "{values:?}");
    }

    // Killed after some tables: what is done stays, and the family is the same to the bit.
    let args = [MAKE, &["-o", "killed.pwfam", "--threads", "1"]].concat();
    let mut child = plywave(dir, &args).stderr(Stdio::null()).spawn().unwrap();
    let (nodes, begun) = (dir.join("killed.pwfam.nodes"), Instant::now());
    let tables = || if nodes.is_dir() { names(&nodes).iter().filter(|n| n.ends_with(".pwt")).count() } else { 0 };
    while tables() < 2 {
        assert!(child.try_wait().unwrap().is_none(), "ended before it could be stopped");
        assert!(begun.elapsed() < Duration::from_secs(120), "no table within two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!dir.join("killed.pwfam").exists());
    refused(dir, &args, &["killed.pwfam.nodes", "--resume", "--fresh"]);
    succeed(dir, &[args.clone(), vec!["--resume"]].concat());
    assert!(std::fs::read(dir.join("killed.pwfam")).unwrap() == whole, "resumed to another family");
    assert!(!nodes.exists());

    // A model of one of its yarns, which every command reads.
    let take =
        ["family", "whole.pwfam", "--param", "fiber_pitch_um=1200", "--param", "alpha_fiber=0.3", "-o", "one.pwm"];
    succeed(dir, &take);
    let one = json(&succeed(dir, &["info", "one.pwm", "--json"]));
    let spec = one["spec"].as_str().unwrap();
    assert!(spec.contains("1200") && spec.contains("0.3") && !spec.contains("[family]"), "{spec}");
    succeed(dir, &[&["check", "one.pwm", "--quiet"], ANY_FIT].concat());
}

#[test]
#[ignore = "slow: 5 s: bad families are refused"]
fn bad_families_are_refused() {
    let folder = folder();
    let dir = folder.path();
    let args = [MAKE, &["-o", "f.pwfam"]].concat();
    for (ranges, words) in [
        ("", ["family", "(empty)"]),
        ("alpha_fiber = [0.3, 0.1]", ["family.alpha_fiber", "lesser"]),
        ("alpha_fiber = [0.3, 0.4]", ["family.alpha_fiber", "0.2"]),
        ("fiber_pitch_um = [10.0, 900.0]", ["family.fiber_pitch_um", "radius"]),
        ("fibers = [3, 4]", ["family.fibers", "unknown"]),
    ] {
        spec(dir, ranges);
        refused(dir, &args, &words);
    }
    refused(dir, &["family", "tiny.toml", "--preset", "preview"], &["tiny.toml", "family", "(absent)"]);
    spec(dir, "alpha_fiber = [0.1, 0.4]");
    refused(dir, &[&args[..], &["--param", "eta=1.5"]].concat(), &["--param", "make the family first"]);
    refused(dir, &[&args[..], &["--param", "color=1"]].concat(), &["fiber_pitch_um, alpha_fiber and eta"]);
    assert!(!dir.join("f.pwfam").exists() && !dir.join("f.pwfam.nodes").exists());

    let made = [
        &["family", "family.toml", "--preset", "preview", "--nodes", "2", "--most-nodes", "2"][..],
        &["-o", "f.pwfam", "--quiet"],
    ];
    succeed(dir, &made.concat());
    for (param, words) in [("alpha_fiber=0.5", ["alpha_fiber", "0.1 to 0.4"]), ("eta=1.4", ["eta", "does not vary"])] {
        refused(dir, &["family", "f.pwfam", "--param", param, "-o", "no.pwm"], &words);
    }
    assert!(!dir.join("no.pwm").exists());
}
