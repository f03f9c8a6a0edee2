//! `plywave new`: the specs that ship come with all that they need, from the program alone; and what a copied
//! spec says that lacks its plies.

use crate::common::{json, names, plywave, refused, run, succeed, text};
use std::path::Path;

fn fabrics() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics")
}

/// Names of the specs in a folder of the sources.
fn specs(folder: &Path) -> Vec<String> {
    let toml = |name: String| name.strip_suffix(".toml").filter(|name| *name != "Cargo").map(str::to_string);
    names(folder).into_iter().filter_map(toml).collect()
}

#[test]
fn the_list_has_all_that_ships() {
    let folder = tempfile::tempdir().unwrap();
    let listed = json(&succeed(folder.path(), &["new", "--json"]));
    let of = |kinds: &[&str]| {
        let all = listed.as_array().unwrap().iter();
        let mut names: Vec<String> = all
            .filter(|spec| kinds.contains(&spec["kind"].as_str().unwrap()))
            .map(|spec| spec["name"].as_str().unwrap().to_string())
            .collect();
        names.sort();
        names
    };
    assert_eq!(of(&["cloth"]), specs(&fabrics().join("cloths")));
    assert_eq!(of(&["yarn", "family"]), specs(&fabrics()));
    assert_eq!(of(&["family"]), ["cotton_family", "polyester_family"]);
    let shown = succeed(folder.path(), &["new"]);
    assert!(shown.contains("  denim            Denim: 3/1 twill of single cotton yarns"), "{shown}");
    assert!(names(folder.path()).is_empty());
}

/// In an empty folder: the cloth is woven, and has the weight of a cloth of 14 ounces a square yard.
#[test]
fn a_new_cloth_is_woven_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    succeed(dir, &["new", "denim"]);
    assert_eq!(names(dir), ["denim.toml", "plies"]);
    assert_eq!(names(&dir.join("plies")), ["cotton_bundle_ne7.pwm", "cotton_bundle_ne7.toml"]);
    let woven = json(&succeed(dir, &["weave", "denim.toml", "--json", "-q"]));
    let grams_per_m2 = woven["measures"]["mass_g_per_m2"].as_f64().unwrap();
    let expected = 14.0 * 28.3495 / 0.836127;
    assert!((grams_per_m2 / expected - 1.0).abs() < 0.1, "{grams_per_m2}, {expected}");
    // Its plies are those of the sources.
    let twin = run(dir, &["twin", "denim.toml", "--plan"]);
    assert!(twin.status.success(), "{}", text(&twin.stderr));
    let model = std::fs::read(fabrics().join("cloths/plies/cotton_bundle_ne7.pwm")).unwrap();
    assert_eq!(std::fs::read(dir.join("plies/cotton_bundle_ne7.pwm")).unwrap(), model);
}

#[test]
#[ignore = "slow: 40 s: new cloths become cloth files"]
fn new_cloths_become_cloth_files() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["denim", "gold"] {
        succeed(folder.path(), &["new", name, "-o", "cloths"]);
        let spec = format!("cloths/{name}.toml");
        succeed(folder.path(), &["weave", &spec, "-q", "-o", "cloth.pwc"]);
    }
}

#[test]
fn yarns_and_names_of_two() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    succeed(dir, &["new", "silk", "-o", "a/b"]);
    assert_eq!(std::fs::read(dir.join("a/b/silk.toml")).unwrap(), std::fs::read(fabrics().join("silk.toml")).unwrap());
    assert!(succeed(dir, &["info", "a/b/silk.toml", "-q"]).contains("yarn spec of silk"));
    let gold = |flags: &[&str]| json(&succeed(dir, &[&["new", "gold", "--json"][..], flags].concat()));
    assert_eq!(gold(&["-o", "cloth"])["kind"], "cloth");
    assert_eq!(gold(&["-o", "yarn", "--yarn"])["kind"], "yarn");
    let same =
        |path: &str, of: &str| std::fs::read(dir.join(path)).unwrap() == std::fs::read(fabrics().join(of)).unwrap();
    assert!(same("cloth/gold.toml", "cloths/gold.toml") && same("yarn/gold.toml", "gold.toml"));
    refused(dir, &["new", "denim", "--yarn"], &["NAME = denim", "no yarn spec", "`plywave new`"]);
    refused(dir, &["new", "damask"], &["NAME = damask", "no cloth or yarn spec", "`plywave new`"]);
    refused(dir, &["new", "../denim"], &["NAME = ../denim"]);
}

/// What is there stays: the same files count as written, others are refused before any is.
#[test]
fn nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    succeed(dir, &["new", "flannel"]);
    // Of the same ply.
    let written = json(&succeed(dir, &["new", "jersey", "--json"]));
    assert_eq!(written["written"], serde_json::json!(["jersey.toml"]));
    assert!(succeed(dir, &["new", "jersey"]).contains("jersey.toml: is there already"));
    std::fs::write(dir.join("organza.toml"), "name = \"mine\"\n").unwrap();
    let before = names(&dir.join("plies"));
    refused(dir, &["new", "organza"], &["organza.toml", "other contents", "-o"]);
    assert_eq!(std::fs::read(dir.join("organza.toml")).unwrap(), b"name = \"mine\"\n");
    assert_eq!(names(&dir.join("plies")), before);
    std::fs::write(dir.join("file"), "").unwrap();
    refused(dir, &["new", "organza", "-o", "file"], &["file"]);
}

/// A cloth's spec copied without its plies: what is missing, and a command that exists and mends it.
#[test]
fn a_copied_spec_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::copy(fabrics().join("cloths/denim.toml"), dir.join("denim.toml")).unwrap();
    let words =
        ["denim.toml: warp.model = plies/cotton_bundle_ne7.toml", "no such file", "`plywave new denim -o FOLDER`"];
    for command in [&["weave", "denim.toml", "-o", "d.pwc"][..], &["twin", "denim.toml"], &["render", "denim.toml"]] {
        let err = text(&run(dir, command).stderr);
        assert!(words.iter().all(|word| err.contains(word)) && !err.contains("plywave build"), "{command:?}: {err}");
    }
    // A model alone is enough, and a spec alone is to be built.
    let ply = fabrics().join("cloths/plies/cotton_bundle_ne7.toml");
    std::fs::create_dir(dir.join("plies")).unwrap();
    std::fs::copy(&ply, dir.join("plies/cotton_bundle_ne7.toml")).unwrap();
    refused(
        dir,
        &["weave", "denim.toml", "-o", "d.pwc"],
        &["build its model first: `plywave build plies/cotton_bundle_ne7.toml"],
    );
    // The advice does it.
    succeed(dir, &["new", "denim"]);
    let mut weave = plywave(dir, &["render", "denim.toml", "-o", "absent/d.png"]);
    let err = text(&weave.output().unwrap().stderr);
    assert!(err.contains("absent") && !err.contains("plies"), "{err}");
    // A spec that ships and is not there.
    refused(dir, &["weave", "jersey.toml"], &["jersey.toml: no such file", "`plywave new jersey`"]);
    refused(dir, &["build", "gold.toml"], &["gold.toml: no such file", "`plywave new gold --yarn`"]);
}
