//! `plywave wave tabulate` and `plywave info` of what it writes: files load, runs resume bit for bit, bad
//! input is refused in one line.
#![cfg(unix)]

use crate::common::{folder, names, plywave, refused, run, succeed, text};
use plywave::Document;
use plywave_fiber::{FiberSource, FiberTable, TabulatedFiber};
use std::path::Path;
use std::time::{Duration, Instant};

const HEAD: &str = "lambda_um = [0.5]\ntheta_i_deg = [0.0]\nphi_i_deg = [0.0]\n";
const CIRCLE: &str = "[[fiber]]\nshape = \"circle\"\nradius_um = 0.4\neta = 1.55\nkappa = 0.02\n";
const ELLIPSE: &str = "[[fiber]]\nshape = \"ellipse\"\na_um = 0.4\nb_um = 0.25\neta = 1.55\n";

fn write(folder: &Path, name: &str, parts: &[&str]) {
    std::fs::write(folder.join(name), parts.concat()).unwrap();
}

#[test]
fn scenes_and_yarns_become_fibers() {
    let folder = folder();
    let dir = folder.path();
    write(dir, "circle.toml", &[HEAD, CIRCLE]);
    write(dir, "ellipse.toml", &[HEAD, ELLIPSE]);
    let small = ["--preset", "preview", "--lambdas", "2", "--thetas", "3", "--quiet"];
    let tabulate = |args: &[&str]| succeed(dir, &[&["wave", "tabulate"], args, &small].concat());
    tabulate(&["circle.toml"]);
    tabulate(&["ellipse.toml", "-o", "e.pwf", "--beta-m", "10"]);
    tabulate(&["circle.toml", "--rays", "--ray-count", "2000", "-o", "r.pwf"]);
    tabulate(&["tiny.toml", "-o", "y.pwf", "--rays", "--ray-count", "2000", "--sigma", "0.05"]);
    assert_eq!(
        names(dir),
        ["circle.pwf", "circle.toml", "e.pwf", "ellipse.toml", "r.pwf", "tiny.toml", "y.pwf"],
        "no shards are left"
    );
    let load = |name: &str| FiberTable::load(dir.join(name)).unwrap();
    let (circle, ellipse, rays, yarn) = (load("circle.pwf"), load("e.pwf"), load("r.pwf"), load("y.pwf"));
    assert_eq!((circle.source, rays.source, yarn.source), (FiberSource::Wave, FiberSource::Ray, FiberSource::Ray));
    assert_eq!((circle.symmetry.folds, ellipse.symmetry.folds), (0, 2));
    assert!(circle.spec_text.contains("kappa = 0.02") && yarn.spec_text.contains("name = \"tiny\""));
    assert!((ellipse.beta_m - 10f64.to_radians()).abs() < 1e-12);
    assert!(circle.c_abs_um.iter().all(|c| *c > 0.0) && ellipse.ledger_error() < 1e-3);
    // The absorption of waves and rays is of one kind: a thin fiber takes in light from all of its section.
    let (w, r) = (circle.c_abs_um[0], rays.c_abs_um[0]);
    assert!((0.5..2.0).contains(&(w / r)), "absorbed {w} um by waves, {r} um by rays");
    TabulatedFiber::load(dir.join("e.pwf")).unwrap();

    let said = succeed(dir, &["info", "e.pwf"]);
    assert!(said.contains("wave optics") && said.contains("2-fold with mirrors") && said.contains("ledger"), "{said}");
    let json: serde_json::Value = serde_json::from_str(&succeed(dir, &["info", "r.pwf", "--json"])).unwrap();
    assert_eq!((json["kind"].as_str(), json["source"].as_str()), (Some("fiber"), Some("ray")));
    assert_eq!(json["theta_i_deg"].as_array().unwrap().len(), 3);
}

#[test]
fn killed_runs_resume_bit_for_bit() {
    let folder = folder();
    let dir = folder.path();
    write(dir, "ellipse.toml", &[HEAD, ELLIPSE]);
    let command = ["wave", "tabulate", "ellipse.toml", "--preset", "preview", "--lambdas", "6", "--quiet"];
    succeed(dir, &[&command[..], &["-o", "whole.pwf", "--threads", "2"]].concat());
    let mut child = plywave(dir, &[&command[..], &["-o", "killed.pwf", "--threads", "1"]].concat()).spawn().unwrap();
    let parts = dir.join("killed.pwf.parts");
    let begun = Instant::now();
    while !parts.is_dir() || names(&parts).iter().filter(|n| n.ends_with(".pwp")).count() < 2 {
        assert!(child.try_wait().unwrap().is_none(), "ended before it could be stopped");
        assert!(begun.elapsed() < Duration::from_secs(60), "no shard within a minute");
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(names(dir), ["ellipse.toml", "killed.pwf.parts", "tiny.toml", "whole.pwf"]);
    // Other sizes do not take the shards up.
    let other = run(dir, &[&command[..], &["-o", "killed.pwf", "--thetas", "4", "--resume"]].concat());
    assert_eq!(other.status.code(), Some(2), "{}", text(&other.stderr));
    succeed(dir, &[&command[..], &["-o", "killed.pwf", "--threads", "2", "--resume"]].concat());
    let bytes = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert!(bytes("killed.pwf") == bytes("whole.pwf"), "the resumed table differs");
    assert_eq!(names(dir), ["ellipse.toml", "killed.pwf", "tiny.toml", "whole.pwf"]);
}

#[test]
fn bad_input_is_refused_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    let negative = CIRCLE.replace("0.02", "-0.02");
    let crossed =
        "[[fiber]]\nshape = \"polygon\"\npoints_um = [[0, 0], [1, 1], [1, 0], [0, 1]]\nrounding_um = 0.05\neta = 1.5\n";
    write(dir, "two.toml", &[HEAD, CIRCLE, ELLIPSE, "center_um = [3.0, 0.0]\n"]);
    write(dir, "negative.toml", &[HEAD, &negative]);
    write(dir, "crossed.toml", &[HEAD, crossed]);
    write(dir, "circle.toml", &[HEAD, CIRCLE]);
    write(dir, "filled.toml", &[HEAD, CIRCLE, "[fiber.lumen]\nshape = \"circle\"\nradius_um = 0.2\neta = 1.3\n"]);
    write(dir, "text.pwf", &["no fiber"]);
    for (args, word) in [
        (&["wave", "tabulate", "none.toml"][..], "none.toml"),
        (&["wave", "tabulate", "two.toml"], "2 fibers"),
        (&["wave", "tabulate", "negative.toml"], "kappa"),
        (&["wave", "tabulate", "crossed.toml"], "crosse"),
        (&["wave", "tabulate", "circle.toml", "--sigma", "0.1"], "sigma"),
        (&["wave", "tabulate", "tiny.toml", "--sigma", "-1"], "--sigma"),
        (&["wave", "tabulate", "tiny.toml", "--sigma", "nan"], "--sigma"),
        (&["wave", "tabulate", "tiny.toml", "--beta-m", "0"], "--beta-m"),
        (&["wave", "tabulate", "circle.toml", "--lambdas", "0"], "--lambdas"),
        (&["wave", "tabulate", "circle.toml", "--ray-count", "5"], "--rays"),
        (&["wave", "tabulate", "filled.toml", "--rays"], "filled core"),
        (&["wave", "tabulate", "circle.toml", "-o", "no/f.pwf"], "no"),
        (&["wave", "tabulate", "circle.toml", "-o", "circle.toml"], "input"),
        (&["info", "text.pwf"], "text.pwf"),
        (&["check", "text.pwf"], "text.pwf"),
    ] {
        refused(dir, args, &[word]);
    }
}
