//! `plywave weave`, `plot` and `twin` of cloth specs.

use crate::common::{json, refused, run, succeed, text};
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
    refused(dir, &["weave", "again.toml"], &["curves.toml", "two kinds", "[warp] and [weft]"]);
    succeed(dir, &["plot", "plain.toml", "-o", "plain.png"]);
    assert!(image::open(dir.join("plain.png")).unwrap().width() > 900);
}

/// A woven cloth of two yarns, and a spec of its curves with the same yarns.
fn woven_and_again(warp: &str, weft: &str) -> [(&'static str, String); 2] {
    let spacing = ["ends_per_cm = 20\n", "picks_per_cm = 16\n"];
    let text = |head: &str, spacing: [&str; 2]| {
        format!("name = \"two\"\n{head}\n[warp]\n{warp}{}[weft]\n{weft}{}", spacing[0], spacing[1])
    };
    [
        ("woven.toml", text("[weave]\nkind = \"twill 2/1 S\"", spacing)),
        ("again.toml", text("[curves]\nfile = \"curves.toml\"", [""; 2])),
    ]
}

/// Curves of two yarns come back with both of them: the same mass, cover, thickness and sizes of yarns.
#[test]
fn curves_of_two_yarns_come_back() {
    let warp = "count = { tex = 20 }\ndensity_g_per_cm3 = 1.5\n";
    let weft = "count = { tex = 36 }\ndensity_g_per_cm3 = 1.3\nbundles = 3\n";
    let folder = folder(&woven_and_again(warp, weft));
    let dir = folder.path();
    succeed(dir, &["weave", "woven.toml", "-o", "curves.toml"]);
    let [first, second] = ["woven.toml", "again.toml"].map(|name| json(&succeed(dir, &["weave", name, "--json"])));
    for key in ["mass_g_per_m2", "thickness_um", "openness", "overlap"] {
        let [a, b] = [&first, &second].map(|said| said["measures"][key].as_f64().unwrap());
        assert!((a - b).abs() < 1e-6 * a.abs().max(1.0), "{key}: {a} {b}");
    }
    for kind in 0..2 {
        for key in ["crimp", "width_um", "height_um", "strand_radius_um", "strands"] {
            let [a, b] = [&first, &second].map(|said| said["measures"]["yarns"][kind][key].as_f64().unwrap());
            assert!((a - b).abs() < 1e-6 * a.abs().max(1.0), "{kind} {key}: {a} {b}");
        }
    }
    // 20 ends of 20 tex and 16 picks of 36 tex a cm, longer by their crimp.
    let crimp = [0, 1].map(|kind| first["measures"]["yarns"][kind]["crimp"].as_f64().unwrap());
    let mass = 2.0 * 20.0 * (1.0 + crimp[0]) + 1.6 * 36.0 * (1.0 + crimp[1]);
    let got = second["measures"]["mass_g_per_m2"].as_f64().unwrap();
    // Bundles that move past each other are a little longer than their yarn.
    assert!((got / mass - 1.0).abs() < 0.01, "{got} g/m2, {mass} is right");
    assert_eq!(second["notes"], serde_json::json!([]));
    // Other programs' files tell warp and weft by their directions.
    for name in ["curves.tg3", "curves.bcc"] {
        succeed(dir, &["weave", "woven.toml", "-o", name]);
        let cell = match name {
            "curves.bcc" => format!("\"{name}\"\ncell_um = {}", first["cell_um"]),
            _ => format!("\"{name}\""),
        };
        let text = std::fs::read_to_string(dir.join("again.toml")).unwrap().replace("\"curves.toml\"", &cell);
        std::fs::write(dir.join("other.toml"), text).unwrap();
        let other = json(&succeed(dir, &["weave", "other.toml", "--json"]));
        for key in ["mass_g_per_m2", "thickness_um", "openness"] {
            let [a, b] = [&first, &other].map(|said| said["measures"][key].as_f64().unwrap());
            assert!((a - b).abs() < 2e-3 * a.abs().max(1.0), "{name}, {key}: {a} {b}");
        }
    }
    // The kinds of the spec are those of the file.
    std::fs::write(dir.join("knit.toml"), JERSEY).unwrap();
    succeed(dir, &["weave", "knit.toml", "-o", "curves.toml"]);
    refused(dir, &["weave", "again.toml"], &["curves.toml", "one kind", "give [yarn]"]);
}

/// A cloth is made of curves of two yarns.
#[test]
#[ignore = "slow: 10 s: a cloth of curves of two yarns"]
fn curves_of_two_yarns_make_a_cloth() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/cloths/plies");
    let yarn = |tex: f64| {
        format!("model = \"ply.pwm\"\ncount = {{ dtex = {tex} }}\ndensity_g_per_cm3 = 1.38\npacking = 0.65\n")
    };
    let folder = folder(&woven_and_again(&yarn(11.904), &yarn(11.904)));
    let dir = folder.path();
    std::fs::copy(shipped.join("polyester_bundle.pwm"), dir.join("ply.pwm")).unwrap();
    succeed(dir, &["weave", "woven.toml", "-o", "curves.toml"]);
    succeed(dir, &["weave", "again.toml", "-o", "again.pwc"]);
    let info = json(&succeed(dir, &["info", "again.pwc", "--json"]));
    assert_eq!(info["plies"].as_array().unwrap().len(), 2, "{info}");
}

/// A cloth that does not come to rest is told of, with its forces and their limit; `--strict` refuses it.
#[test]
fn a_cloth_that_does_not_come_to_rest_is_told_of() {
    // A rib of stiff yarn in loops that are too long for their stitches.
    let stiff = JERSEY.replace("\"jersey\"\nwales", "\"rib\"\nwales").replace("2.7", "4.5");
    let stiff = stiff.replace("{ ne = 30 }", "{ tex = 12 }\nstiffness = 20.0");
    let folder = folder(&[("stiff.toml", stiff), ("plain.toml", plain(20.0))]);
    let dir = folder.path();
    let output = run(dir, &["weave", "stiff.toml", "--json", "-o", "stiff.tg3"]);
    let (said, warned) = (json(&text(&output.stdout)), text(&output.stderr));
    let force = said["relaxed"]["force"].as_f64().unwrap();
    assert!(output.status.success() && force > 0.05, "{said}");
    assert_eq!((&said["relaxed"]["at_rest"], &said["relaxed"]["force_limit"]), (&false.into(), &0.05.into()));
    let line = warned.lines().find(|line| line.starts_with("warning: ")).unwrap_or_else(|| panic!("{warned}"));
    for words in [&format!("{force:.2} of the tension")[..], "0.05 is the limit", "wider spacings or stitches"] {
        assert!(line.contains(words), "{line}: {words}");
    }
    assert!(dir.join("stiff.tg3").exists());
    let strict = run(dir, &["weave", "stiff.toml", "--strict", "-o", "strict.tg3"]);
    assert_eq!(strict.status.code(), Some(1), "{}", text(&strict.stderr));
    assert!(text(&strict.stderr).contains("warning: ") && !dir.join("strict.tg3").exists());
    let at_rest = json(&succeed(dir, &["weave", "plain.toml", "--strict", "--json"]));
    assert_eq!(at_rest["relaxed"]["at_rest"], true);
}

/// Straight yarns have no crimp and no bends, whatever the rounding.
#[test]
fn straight_yarns_are_said_to_be_straight() {
    let straight = plain(20.0).replace("\"plain\"\n[warp]", "\"layers\"\n[warp]");
    let folder = folder(&[("layers.toml", straight)]);
    let text = succeed(folder.path(), &["weave", "layers.toml"]);
    assert!(text.contains("crimp 0.0 %") && text.contains("um high, straight\n") && !text.contains("-0.0"), "{text}");
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
