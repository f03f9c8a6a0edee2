//! `plywave new`: the specs that ship come with all that they need, from the program alone; and a copied spec
//! does as well.

use crate::common::{json, names, refused, run, succeed, text};
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
    assert_eq!(names(dir), ["denim.toml"]);
    let woven = json(&succeed(dir, &["weave", "denim.toml", "--json", "-q"]));
    let grams_per_m2 = woven["measures"]["mass_g_per_m2"].as_f64().unwrap();
    let expected = 14.0 * 28.3495 / 0.836127;
    assert!((grams_per_m2 / expected - 1.0).abs() < 0.1, "{grams_per_m2}, {expected}");
    // Its plies are those that ship.
    let twin = run(dir, &["twin", "denim.toml", "--plan"]);
    assert!(twin.status.success(), "{}", text(&twin.stderr));
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
    refused(dir, &["new", "velvet"], &["NAME = velvet", "no cloth or yarn spec", "`plywave new`"]);
    refused(dir, &["new", "../denim"], &["NAME = ../denim"]);
}

/// What is there stays: the same files count as written, others are refused before any is.
#[test]
fn nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    succeed(dir, &["new", "flannel"]);
    let written = json(&succeed(dir, &["new", "jersey", "--json"]));
    assert_eq!(written["written"], serde_json::json!(["jersey.toml"]));
    assert!(succeed(dir, &["new", "jersey"]).contains("jersey.toml: is there already"));
    std::fs::write(dir.join("organza.toml"), "name = \"mine\"\n").unwrap();
    let before = names(dir);
    refused(dir, &["new", "organza"], &["organza.toml", "other contents", "-o"]);
    assert_eq!(std::fs::read(dir.join("organza.toml")).unwrap(), b"name = \"mine\"\n");
    assert_eq!(names(dir), before);
    std::fs::write(dir.join("file"), "").unwrap();
    refused(dir, &["new", "organza", "-o", "file"], &["file"]);
}

/// A cloth's spec that is copied alone has its plies from the program.
#[test]
fn a_copied_spec_is_enough() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::copy(fabrics().join("cloths/denim.toml"), dir.join("denim.toml")).unwrap();
    for command in [&["weave", "denim.toml", "--json", "-q"][..], &["twin", "denim.toml", "--plan"]] {
        let run = run(dir, command);
        assert!(run.status.success(), "{command:?}: {}", text(&run.stderr));
    }
    // Refused for the picture's folder alone.
    refused(dir, &["render", "denim.toml", "-o", "absent/d.png"], &["absent"]);
    assert_eq!(names(dir), ["denim.toml"]);
    // A spec that ships and is not there.
    refused(dir, &["weave", "jersey.toml"], &["jersey.toml: no such file", "`plywave new jersey`"]);
    refused(dir, &["build", "gold.toml"], &["gold.toml: no such file", "`plywave new gold --yarn`"]);
}
