//! `plywave compare` and `plywave wave speckle`: what they write, that threads and resumption do not matter,
//! and what they refuse.

use crate::common::{json, names, run, succeed, text};
use std::path::Path;

/// Three thin fibers in a narrow beam.
const PLY: &str = include_str!("../../../tests/data/thin.toml");

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("thin.toml"), PLY).unwrap();
    let oval = PLY.replace("kind = \"circle\", radius_um = 1.0", "kind = \"ellipse\", a_um = 1.2, b_um = 0.8");
    std::fs::write(folder.path().join("oval.toml"), oval).unwrap();
    folder
}

fn refused(dir: &Path, args: &[&str], words: &[&str]) {
    let before = names(dir);
    let output = run(dir, args);
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(2), "{args:?}: {out}{err}");
    assert!(out.is_empty() && err.starts_with("error: ") && err.lines().count() == 1, "{args:?}: {out}{err}");
    for word in words {
        assert!(err.contains(word), "{args:?}: no {word:?} in {err}");
    }
    assert_eq!(names(dir), before, "{args:?} wrote something");
}

const COMPARE: &[&str] = &["compare", "thin.toml", "--lambda", "0.5,0.7", "--h", "0,-0.8", "--paths", "2000"];

#[test]
fn compare_reports_both_optics() {
    let folder = folder();
    let dir = folder.path();
    let told = succeed(dir, &[COMPARE, &["-o", "r", "--instances", "3", "--threads", "1"]].concat());
    assert!(told.contains("3 instances") && told.contains("correlation"), "{told}");
    // A ply takes more than its beam out of it: the column says why, and has no share below 0.
    assert!(told.contains("missed / extinguished") && told.contains("up to 2") && !told.contains("/ -"), "{told}");
    assert_eq!(names(dir), ["oval.toml", "r", "thin.toml"]);
    assert_eq!(names(&dir.join("r")), ["compare.png", "report.json"]);
    let report = json(&std::fs::read_to_string(dir.join("r/report.json")).unwrap());
    let cases = report["cases"].as_array().unwrap();
    assert_eq!((cases.len(), report["across_wavelengths"].as_array().unwrap().len()), (4, 2));
    for case in cases {
        let energies = &case["energies"];
        let mean = |key: &str| energies[key]["mean"].as_f64().unwrap();
        assert!((mean("wave_total") - 1.0).abs() < 1e-3, "{energies}");
        let rays = mean("ray_miss") + mean("ray_refl") + mean("ray_high") + mean("ray_killed");
        assert!((rays - 1.0).abs() < 1e-9, "{energies}");
        assert_eq!(case["resolutions"].as_array().unwrap().len(), 4);
        assert_eq!(case["curves"]["wave_mean"].as_array().unwrap().len(), 720);
    }
    assert_eq!(cases[1]["h_um"], serde_json::json!(-3.2));

    // Fewer instances first, kept, then more on other threads: the same report. An earlier folder of ours is
    // written over.
    succeed(dir, &[COMPARE, &["-o", "s", "--instances", "2", "--keep-parts", "--quiet"]].concat());
    assert!(dir.join("s.parts").is_dir());
    refused(dir, &[COMPARE, &["-o", "s", "--seed", "2", "--resume"]].concat(), &["s.parts", "another run"]);
    let more = [COMPARE, &["-o", "s", "--instances", "3", "--resume", "--threads", "2", "--json"]].concat();
    let told = json(&succeed(dir, &more));
    assert_eq!(told["instances"], 3);
    assert!(!dir.join("s.parts").exists());
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert_eq!(read("s/report.json"), read("r/report.json"));
    assert_eq!(read("s/compare.png"), read("r/compare.png"));
}

#[test]
fn compare_refuses_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    refused(dir, &["compare", "none.toml"], &["none.toml", "no such file"]);
    let flags: &[(&[&str], &[&str])] = &[
        (&["--lambda", "0"], &["--lambda", "0.1"]),
        (&["--lambda", "nan"], &["--lambda"]),
        (&["--h", "4"], &["--h", "4", "beam"]),
        (&["--theta-i", "90"], &["--theta-i", "80"]),
        (&["--sigma", "-1"], &["--sigma"]),
        (&["--tolerance", "0.5"], &["--tolerance", "0.01"]),
        (&["--instances", "0"], &["--instances"]),
        (&["--paths", "many"], &["--paths"]),
        (&["-o", "thin.toml"], &["thin.toml"]),
        (&["-o", "no/where"], &["no/where", "folder"]),
        // Steep light widens the beam's spectrum beyond the waves that travel.
        (&["--theta-i", "75", "--lambda", "0.9"], &["beam.w0_um"]),
    ];
    for (flags, words) in flags {
        refused(dir, &[&["compare", "thin.toml", "--instances", "1"], *flags].concat(), words);
    }
    std::fs::create_dir(dir.join("mine")).unwrap();
    std::fs::write(dir.join("mine/diary.txt"), "x").unwrap();
    refused(dir, &["compare", "thin.toml", "-o", "mine"], &["mine", "report.json"]);
    assert_eq!(names(&dir.join("mine")), ["diary.txt"]);
    std::fs::write(dir.join("full.toml"), PLY.replace("fibers = 3", "fibers = 40")).unwrap();
    refused(dir, &["compare", "full.toml"], &["full.toml", "40"]);
}

const SPECKLE: &[&str] = &["wave", "speckle", "oval.toml", "--lambda", "0.5,0.7", "--w0", "30"];

#[test]
fn speckle_writes_patterns_that_are_told_and_drawn() {
    let folder = folder();
    let dir = folder.path();
    let told = succeed(dir, &[SPECKLE, &["--instances", "4", "--threads", "1"]].concat());
    assert!(told.contains("4 fibers") && told.contains("contrast"), "{told}");
    assert_eq!(names(dir), ["oval.pws", "oval.toml", "thin.toml"]);
    succeed(dir, &[SPECKLE, &["--instances", "4", "--threads", "2", "-o", "again.pws", "--quiet"]].concat());
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert_eq!(read("again.pws"), read("oval.pws"));

    assert!(succeed(dir, &["info", "oval.pws"]).contains("4 instances"));
    let info = json(&succeed(dir, &["info", "oval.pws", "--json"]));
    assert_eq!((&info["kind"], &info["instances"]), (&serde_json::json!("speckle"), &serde_json::json!(4)));
    let kinds = info["statistics"].as_array().unwrap();
    // Two absorptions, two wavelengths, three sides.
    assert_eq!(kinds.len(), 12);
    for kind in kinds {
        assert!(kind["contrast_tm"].as_f64().unwrap() > 0.0 && kind["c_sca_um"].as_f64().unwrap() > 0.5, "{kind}");
    }
    let drawn = json(&succeed(dir, &["plot", "oval.pws", "--json"]));
    assert_eq!(drawn["png"], "oval.png");
    assert!(read("oval.png").starts_with(b"\x89PNG"));

    // Not what other commands take, and nothing half of it.
    refused(dir, &["fit", "oval.pws", "-o", "x.pwm"], &["speckle patterns (.pws)"]);
    refused(dir, &["plot", "oval.pws", "--table", "oval.pws"], &["speckle patterns"]);
    std::fs::write(dir.join("half.pws"), &read("oval.pws")[..2000]).unwrap();
    refused(dir, &["info", "half.pws"], &["half.pws"]);
    refused(dir, &["plot", "half.pws", "-o", "half.png"], &["half.pws"]);
}

#[test]
fn speckle_refuses_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    refused(dir, &["wave", "speckle", "none.toml"], &["none.toml", "no such file"]);
    let flags: &[(&[&str], &[&str])] = &[
        (&["--lambda", "0.7,0.5"], &["--lambda", "0.5", "larger"]),
        (&["--lambda", "1e9"], &["--lambda"]),
        (&["--kappa", "11"], &["--kappa", "10"]),
        (&["--w0", "0"], &["--w0"]),
        (&["--w0", "0.15"], &["beam.w0_um"]),
        (&["--theta-i", "inf"], &["--theta-i"]),
        (&["--tolerance", "0"], &["--tolerance"]),
        (&["--seed", "-1"], &["--seed"]),
        (&["-o", "oval.toml"], &["oval.toml", "input"]),
        (&["-o", "no/x.pws"], &["folder"]),
    ];
    for (flags, words) in flags {
        refused(dir, &[&["wave", "speckle", "oval.toml", "--instances", "2"], *flags].concat(), words);
    }
}
