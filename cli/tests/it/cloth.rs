//! `plywave weave`, `plot` and `twin` of cloth specs.

use crate::common::{json, refused, succeed};
use std::path::Path;

const JERSEY: &str = "name = \"jersey\"\n[knit]\nkind = \"jersey\"\nwales_per_cm = 14\ncourses_per_cm = 20\n\
    loop_mm = 2.7\n[yarn]\ncount = { ne = 30 }\ndensity_g_per_cm3 = 1.52\n";

fn plain(per_cm: f64) -> String {
    let yarn = |key: &str| format!("count = {{ tex = 20 }}\ndensity_g_per_cm3 = 1.5\n{key} = {per_cm}\n");
    let (warp, weft) = (yarn("ends_per_cm"), yarn("picks_per_cm"));
    format!("name = \"plain\"\n[weave]\nkind = \"plain\"\n[warp]\n{warp}[weft]\n{weft}")
}

fn folder(specs: &[(&str, String)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in specs {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// A cloth is measured, and its curves come back from the file they are written to.
#[test]
fn cloths_are_measured_and_written() {
    let folder = folder(&[("jersey.toml", JERSEY.into()), ("plain.toml", plain(20.0))]);
    let dir = folder.path();
    let said = json(&succeed(dir, &["weave", "jersey.toml", "--json"]));
    let number = |of: &serde_json::Value, key: &str| of[key].as_f64().unwrap();
    // 19.7 tex in loops of 2.7 mm, 280 a square centimeter.
    let mass = 590.54 / 30.0 * 2.7 * 280.0 * 1e-2;
    assert!((number(&said["measures"], "mass_g_per_m2") / mass - 1.0).abs() < 0.01, "{said}");
    assert!(number(&said["measures"], "overlap") < 0.02 && number(&said["relaxed"], "force") < 0.01);
    let text = succeed(dir, &["weave", "plain.toml", "-o", "curves.toml"]);
    for word in ["crimp", "thickness", "cover", "g/m2", "curves.toml"] {
        assert!(text.contains(word), "{text}");
    }
    let again =
        "name = \"again\"\n[curves]\nfile = \"curves.toml\"\n[yarn]\ncount = { tex = 20 }\ndensity_g_per_cm3 = 1.5\n";
    std::fs::write(dir.join("again.toml"), again).unwrap();
    let [first, second] = ["plain.toml", "again.toml"].map(|name| json(&succeed(dir, &["weave", name, "--json"])));
    for key in ["thickness_um", "openness", "overlap"] {
        let [a, b] = [&first, &second].map(|said| number(&said["measures"], key));
        assert!((a - b).abs() < 1e-6 * a.abs().max(1.0), "{key}: {a} {b}");
    }
    // Weft is the second kind, of which the spec of curves has none.
    assert!(number(&second["measures"], "mass_g_per_m2") > 0.0);
    succeed(dir, &["plot", "plain.toml", "-o", "plain.png"]);
    assert!(image::open(dir.join("plain.png")).unwrap().width() > 900);
}

/// What cannot be made is refused in one line.
#[test]
fn bad_cloths_are_refused_in_one_line() {
    let knit = JERSEY.replace("\"jersey\"\nwales", "\"grid\"\nrows = [\"KK\", \"K.\"]\nwales");
    let folder = folder(&[
        ("plain.toml", plain(20.0)),
        ("close.toml", plain(60.0)),
        ("runs.toml", knit),
        ("units.toml", plain(20.0).replace("tex = 20", "tex = 20, ne = 30")),
        (
            "skew.toml",
            "name = \"x\"\n[curves]\nfile = \"none.tg3\"\n[yarn]\ncount = { tex = 2 }\ndensity_g_per_cm3 = 1\n".into(),
        ),
    ]);
    let dir = folder.path();
    refused(dir, &["weave", "close.toml"], &["too thick", "ends and", "picks a cm go"]);
    refused(dir, &["weave", "runs.toml"], &["the knit runs", "course 1", "course 2, wale 2"]);
    refused(dir, &["weave", "units.toml"], &["warp.count", "tex and ne", "give one of"]);
    refused(dir, &["weave", "skew.toml"], &["none.tg3"]);
    refused(dir, &["weave", "plain.toml", "-o", "curves.obj"], &["curves.obj", ".toml, .bcc or .tg3"]);
    refused(dir, &["weave", "plain.toml", "--pixels", "4"], &["--pixels", "cloth spec"]);
    refused(dir, &["twin", "plain.toml", "--paths", "10"], &["warp.model", "(absent)"]);
    refused(dir, &["render", "plain.toml"], &["plain.toml", "cloth spec"]);
    assert!(!dir.join("curves.obj").exists());
}

/// The twin of a cloth traces the fibers of its curves.
#[test]
fn twins_of_cloths_are_traced() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/cloths");
    let ply = std::fs::read_to_string(shipped.join("plies/polyester_bundle.toml")).unwrap();
    let yarn = |key: &str| {
        format!(
            "model = \"ply.toml\"\ncount = {{ dtex = 11.904 }}\ndensity_g_per_cm3 = 1.38\npacking = 0.65\n{key} = 150\n"
        )
    };
    let (warp, weft) = (yarn("ends_per_cm"), yarn("picks_per_cm"));
    let spec = format!("name = \"voile\"\n[weave]\nkind = \"plain\"\n[warp]\n{warp}[weft]\n{weft}");
    let folder = folder(&[("voile.toml", spec), ("ply.toml", ply)]);
    let dir = folder.path();
    let said = json(&succeed(
        dir,
        &["twin", "voile.toml", "--paths", "3000", "--views", "0:0", "--sigma", "0", "-o", "v.pwx", "--json"],
    ));
    let light = &said["views"][0]["light"][0];
    let sum = ["reflected", "transmitted"].map(|key| light[key].as_f64().unwrap()).iter().sum::<f64>()
        + said["views"][0]["straight"].as_f64().unwrap()
        + said["views"][0]["killed"].as_f64().unwrap();
    assert!((sum - 1.0).abs() < 1e-9, "{said}");
    // Open by about a sixth; more between the fibers.
    let straight = said["views"][0]["straight"].as_f64().unwrap();
    assert!((0.1..0.4).contains(&straight), "{straight}");
}
