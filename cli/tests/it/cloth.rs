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
    refused(dir, &["twin", "plain.toml", "--paths", "10"], &["warp.model", "(absent)"]);
    refused(dir, &["render", "plain.toml"], &["plain.toml", "warp.model", "(absent)"]);
    refused(dir, &["weave", "plain.toml", "-o", "plain.pwc"], &["plain.toml", "warp.model", "(absent)"]);
    assert!(!dir.join("curves.obj").exists() && !dir.join("plain.pwc").exists());
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

/// Runs with a cache folder of its own; returns what went to stderr.
fn with_cache(dir: &Path, args: &[&str]) -> (bool, String) {
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_plywave"))
        .current_dir(dir)
        .env("PLYWAVE_CACHE", dir.join("kept"))
        .args(args)
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&run.stdout) + String::from_utf8_lossy(&run.stderr);
    (run.status.success(), told.into_owned())
}

/// A cloth goes into one file, which is described, drawn, rendered and held to a twin; of a spec the cloth is
/// made once and kept.
#[test]
#[ignore = "slow: 33 s: a cloth is one file"]
fn a_cloth_is_one_file() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/cloths");
    let of = |name: &str| std::fs::read_to_string(shipped.join(name)).unwrap();
    let folder = folder(&[
        ("jersey.toml", of("jersey.toml")),
        ("unmade.toml", of("jersey.toml").replace("cotton_single", "unmade")),
    ]);
    let dir = folder.path();
    std::fs::create_dir(dir.join("plies")).unwrap();
    for name in ["cotton_single.toml", "cotton_single.pwm"] {
        std::fs::copy(shipped.join("plies").join(name), dir.join("plies").join(name)).unwrap();
    }
    std::fs::write(dir.join("plies/unmade.toml"), of("plies/cotton_single.toml")).unwrap();
    refused(dir, &["weave", "unmade.toml", "-o", "x.pwc"], &["yarn.model", "plywave build"]);

    let small = ["--setup", "swatch", "--width", "24", "--height", "16", "--samples", "2", "--no-exr"];
    let render = |cloth: &str, png: &str| with_cache(dir, &[&["render", cloth, "-o", png], &small[..]].concat());
    let (good, told) = render("jersey.toml", "a.png");
    assert!(good && told.contains("the cloth was made and is kept in"), "{told}");
    let kept: Vec<_> = std::fs::read_dir(dir.join("kept")).unwrap().map(|e| e.unwrap().path()).collect();
    assert!(kept.len() == 1, "{kept:?}");
    std::fs::copy(&kept[0], dir.join("jersey.pwc")).unwrap();
    for (cloth, png) in [("jersey.toml", "b.png"), ("jersey.pwc", "c.png")] {
        let (good, told) = render(cloth, png);
        assert!(good && !told.contains("was made"), "{told}");
        let pixels = ["a.png", png].map(|name| image::open(dir.join(name)).unwrap().into_rgb8());
        assert_eq!(pixels[0], pixels[1]);
    }
    // A damaged one is made again.
    std::fs::write(&kept[0], b"nothing").unwrap();
    assert!(render("jersey.toml", "d.png").1.contains("was made"));

    let said = json(&succeed(dir, &["info", "jersey.pwc", "--json"]));
    assert_eq!((&said["kind"], &said["far"], &said["curves"]), (&"cloth".into(), &true.into(), &1.into()));
    assert!(said["bytes"].as_u64().unwrap() < 8 << 20);
    succeed(dir, &["plot", "jersey.pwc", "-o", "jersey.png"]);
    let twin = ["--paths", "4000", "--views", "30:90", "--sigma", "0", "-o", "jersey.pwx", "-q"];
    succeed(dir, &[&["twin", "jersey.toml"], &twin[..]].concat());
    let text = with_cache(dir, &["check", "jersey.pwc", "--twin", "jersey.pwx"]).1;
    assert!(text.contains("twin / model") && text.contains("30.0"), "{text}");
    std::fs::write(dir.join("loose.toml"), of("jersey.toml").replace("loop_mm = 2.7", "loop_mm = 2.9")).unwrap();
    let (good, told) = with_cache(dir, &["check", "loose.toml", "--twin", "jersey.pwx"]);
    assert!(!good && told.contains("not the twin's"), "{told}");
    refused(dir, &["weave", "jersey.pwc"], &["jersey.pwc", "a cloth (.pwc)"]);
    refused(dir, &["render", "jersey.pwc", "--integrator", "dual"], &["--integrator = dual", "strands"]);
}
