//! `plywave check` of analytic fibers: each kind passes, bad values are told in one line.

use crate::common::{refused, succeed};

fn fiber(keys: &str) -> String {
    format!("name = \"a fiber\"\nsigma_per_um = [0.002, 0.005, 0.012]\n[filament]\n{keys}\n")
}

#[test]
fn each_kind_is_checked() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    for (k, keys) in [
        "kind = \"dielectric\"",
        "kind = \"rough_dielectric\"\nk_d = 0.01",
        "kind = \"opaque\"\nmetal = \"gold\"",
        "kind = \"opaque\"\neta = 1.5\ndiffuse = 0.5",
        "kind = \"kajiya_kay\"",
        "kind = \"khungurn\"\nc_r = 0.1\nc_tt = [0.8, 0.3, 0.1]",
    ]
    .into_iter()
    .enumerate()
    {
        let file = format!("{k}.toml");
        std::fs::write(dir.join(&file), fiber(keys)).unwrap();
        succeed(dir, &["check", &file]);
    }
}

/// The albedo without absorption that is farthest from 1 is told, with what mends it.
#[test]
fn albedos_that_miss_1_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let hint = "(filament.normalize = true brings it to 1)";
    for (keys, want, hinted) in [
        ("kind = \"rough_dielectric\"", 2.4457, true),
        ("kind = \"rough_dielectric\"\nnormalize = true", 1.0, false),
        ("kind = \"dielectric\"\neta = 1.01\nradius_um = 40", 1.0, false),
    ] {
        std::fs::write(dir.join("a.toml"), fiber(keys)).unwrap();
        let text = succeed(dir, &["check", "a.toml"]);
        let line =
            text.lines().find(|line| line.starts_with("albedo without absorption, farthest from 1 at ")).unwrap();
        let albedo: f64 = line.split("degrees: ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((albedo - want).abs() < 1e-3 && line.ends_with(hint) == hinted, "{keys}: {line}");
    }
}

#[test]
fn bad_values_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let bad = |keys: &str, said: &[&str]| {
        std::fs::write(dir.join("bad.toml"), fiber(keys)).unwrap();
        refused(dir, &["check", "bad.toml"], said);
    };
    bad("kind = \"dielectric\"\neta = 0.9", &["bad.toml", "filament.eta", "0.9"]);
    bad("kind = \"dielectric\"\nbeta_m = [0.1, 0, 0.1]", &["bad.toml", "filament.beta_m"]);
    bad("kind = \"dielectric\"\nbeta_n = 0", &["bad.toml", "filament.beta_n", "0"]);
    bad("kind = \"opaque\"\neta = 0.5\nkappa = -1", &["bad.toml", "filament.kappa", "-1"]);
    bad("kind = \"opaque\"\nkappa = 2", &["bad.toml", "filament.kappa", "eta"]);
    bad("kind = \"opaque\"\nmetal = \"gold\"\neta = 1.5", &["bad.toml", "filament.eta", "metal"]);
    bad("kind = \"opaque\"\nmetal = \"tin\"", &["bad.toml", "filament.metal", "tin", "gold"]);
    bad("kind = \"khungurn\"\nbeta_r = 0", &["bad.toml", "filament.beta_r", "0"]);
    bad("kind = \"khungurn\"\nc_tt = [0.5, -0.1, 0.5]", &["bad.toml", "filament.c_tt"]);
    bad("kind = \"khungurn\"\nc_r = 1.5", &["bad.toml", "filament.c_r", "1.5"]);
    bad("kind = \"kajiya_kay\"\nexponent = nan", &["bad.toml", "filament.exponent"]);
    bad("kind = \"khungurn\"\nnormalize = true", &["bad.toml", "filament.normalize", "c_tt"]);
    bad(
        "kind = \"rough_dielectric\"\neccentricity = 0.9\nnormalize = true",
        &["filament.normalize", "eccentricity = 1"],
    );
    bad("kind = \"wool\"", &["bad.toml", "wool", "rough_dielectric"]);
}
