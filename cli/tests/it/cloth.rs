//! `plywave weave`, `plot` and `twin` of cloth specs.

use crate::common::{json, refused, succeed};
use plywave::io::Document;
use std::path::Path;

const JERSEY: &str = "name = \"jersey\"\n[knit]\nkind = \"jersey\"\nwales_per_cm = 14\ncourses_per_cm = 20\n\
    loop_mm = 2.7\n[yarn]\nfiber = \"cotton\"\ncount = \"Ne 30\"\npacking = 0.6\n";
/// A round yarn of 20 tex.
const ROUND: &str = "fiber = \"flax\"\ncount = \"20 tex\"\npacking = 0.6\nbundles = 1\n";

fn plain(per_cm: f64) -> String {
    format!(
        "name = \"plain\"\n[weave]\nkind = \"plain\"\nends_per_cm = {per_cm}\npicks_per_cm = {per_cm}\n\
         [warp]\n{ROUND}[weft]\nas = \"warp\"\n"
    )
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
    let again = format!("name = \"again\"\n[curves]\nfile = \"curves.toml\"\n[yarn]\n{ROUND}");
    std::fs::write(dir.join("again.toml"), again).unwrap();
    refused(dir, &["weave", "again.toml"], &["curves.toml", "two kinds", "[warp] and [weft]"]);
    succeed(dir, &["plot", "plain.toml", "-o", "plain.png"]);
    assert!(image::open(dir.join("plain.png")).unwrap().width() > 900);
}

/// A woven cloth of two yarns, and a spec of its curves with the same yarns.
fn woven_and_again(warp: &str, weft: &str) -> [(&'static str, String); 2] {
    let text = |head: &str| format!("name = \"two\"\n{head}\n[warp]\n{warp}[weft]\n{weft}");
    [
        ("woven.toml", text("[weave]\nkind = \"twill 2/1 S\"\nends_per_cm = 20\npicks_per_cm = 16")),
        ("again.toml", text("[curves]\nfile = \"curves.toml\"")),
    ]
}

/// Curves of two yarns come back with both of them: the same mass, cover, thickness and sizes of yarns.
#[test]
fn curves_of_two_yarns_come_back() {
    let weft = "fiber = { like = \"cotton\", density_g_per_cm3 = 1.3 }\ncount = \"36 tex\"\npacking = 0.6\nbundles = 3\n\
                twist = \"none\"\n";
    let folder = folder(&woven_and_again(ROUND, weft));
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
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/models");
    let yarn = "model = \"ply.pwm\"\nfiber = \"polyester\"\ncount = \"11.904 dtex\"\npacking = 0.65\n";
    let folder = folder(&woven_and_again(yarn, yarn));
    let dir = folder.path();
    std::fs::copy(shipped.join("polyester_bundle.pwm"), dir.join("ply.pwm")).unwrap();
    succeed(dir, &["weave", "woven.toml", "-o", "curves.toml"]);
    succeed(dir, &["weave", "again.toml", "-o", "again.pwc"]);
    let info = json(&succeed(dir, &["info", "again.pwc", "--json"]));
    assert_eq!(info["plies"].as_array().unwrap().len(), 2, "{info}");
}

/// Whether a cloth came to rest is told, with its forces and their limit; `--strict` lets one pass that did.
#[test]
fn a_cloth_at_rest_passes_the_strict() {
    let folder = folder(&[("plain.toml", plain(20.0))]);
    let said = json(&succeed(folder.path(), &["weave", "plain.toml", "--strict", "--json", "-o", "plain.tg3"]));
    assert_eq!((&said["relaxed"]["at_rest"], &said["relaxed"]["force_limit"]), (&true.into(), &0.05.into()));
    assert!(said["relaxed"]["force"].as_f64().unwrap() <= 1e-5 && folder.path().join("plain.tg3").exists());
}

/// Straight yarns have no crimp and no bends, whatever the rounding.
#[test]
fn straight_yarns_are_said_to_be_straight() {
    let straight = plain(20.0).replace("kind = \"plain\"", "kind = \"layers\"");
    let folder = folder(&[("layers.toml", straight)]);
    let text = succeed(folder.path(), &["weave", "layers.toml"]);
    assert!(text.contains("crimp 0.0 %") && text.contains("um high, straight\n") && !text.contains("-0.0"), "{text}");
}

/// What cannot be made is refused in one line.
#[test]
fn bad_cloths_are_refused_in_one_line() {
    let knit = JERSEY.replace("\"jersey\"\nwales", "\"chart\"\nchart = [\"KM\", \"KT\"]\nwales");
    let folder = folder(&[
        ("plain.toml", plain(20.0)),
        ("close.toml", plain(60.0)),
        ("runs.toml", knit),
        ("units.toml", plain(20.0).replace("20 tex", "20 tex 30 Ne")),
        ("old.toml", plain(20.0).replace("\"20 tex\"", "{ tex = 20 }")),
        ("many.toml", plain(4.0).replace("20 tex", "200 tex")),
        ("absent.toml", plain(20.0).replace("fiber", "model = \"ply.toml\"\nfiber")),
        ("skew.toml", format!("name = \"x\"\n[curves]\nfile = \"none.tg3\"\n[yarn]\n{ROUND}")),
    ]);
    let dir = folder.path();
    refused(dir, &["weave", "close.toml"], &["too thick", "ends and", "picks a cm go"]);
    refused(dir, &["weave", "runs.toml"], &["knit.chart", "the knit runs", "course 1, wale 2"]);
    refused(dir, &["weave", "units.toml"], &["warp.count = \"20 tex 30 Ne\"", "two units"]);
    refused(dir, &["weave", "old.toml"], &["warp.count", "count = \"20 tex\""]);
    refused(dir, &["weave", "skew.toml"], &["none.tg3"]);
    refused(dir, &["weave", "plain.toml", "-o", "curves.obj"], &["curves.obj", ".toml, .bcc or .tg3"]);
    // Plies that no model can be built of, and a yarn spec that is not there.
    for (spec, words) in [
        ("many.toml", ["many.toml: warp.fibers = 618", "200 fibers at most"]),
        ("absent.toml", ["warp.model = ply.toml", "no such file; leave the key out for the yarn's own ply"]),
    ] {
        refused(dir, &["twin", spec, "--paths", "10"], &words);
        refused(dir, &["render", spec], &words);
        refused(dir, &["weave", spec, "-o", "plain.pwc"], &words);
    }
    assert!(!dir.join("curves.obj").exists() && !dir.join("plain.pwc").exists());
}

/// The twin of a cloth traces the fibers of its curves.
#[test]
fn twins_of_cloths_are_traced() {
    // The spec of the warp's plies is written out, that of the weft's follows from the yarn.
    let yarn = "fiber = \"polyester bright\"\ncount = \"11.904 dtex\"\npacking = 0.65\n";
    let spec = format!(
        "name = \"voile\"\n[weave]\nkind = \"plain\"\nends_per_cm = 150\npicks_per_cm = 150\n\
         [warp]\nmodel = \"ply.toml\"\n{yarn}[weft]\n{yarn}"
    );
    let folder = folder(&[("voile.toml", spec), ("ply.toml", format!("name = \"ply\"\n[yarn]\n{yarn}"))]);
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
    let folder = folder(&[("jersey.toml", of("jersey.toml"))]);
    let dir = folder.path();
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

/// A ply without a model at hand is built once for a cloth whose warp and weft share it, kept, and found for
/// another cloth of the same yarn; a cloth that cannot be woven is refused before anything is built.
#[test]
#[ignore = "slow: 22 s: missing plies are built, kept and shared"]
fn missing_plies_are_built_kept_and_shared() {
    let folder = folder(&[]);
    let dir = folder.path();
    let cloth = |name: &str, per_cm: u32| {
        let text = format!(
            "name = \"{name}\"\n[weave]\nkind = \"plain\"\nends_per_cm = {per_cm}\npicks_per_cm = 20\n[warp]\n\
             fiber = \"polyester 40 um\"\ncount = \"5.2 tex\"\ntwist = \"none\"\n[weft]\nas = \"warp\"\n"
        );
        std::fs::write(dir.join(format!("{name}.toml")), text).unwrap();
    };
    let weave = |name: &str| with_cache(dir, &["weave", &format!("{name}.toml"), "-o", &format!("{name}.pwc")]);
    let kept = || std::fs::read_dir(dir.join("kept/plies")).map_or(0, |files| files.count());
    cloth("dense", 400);
    let (good, said) = weave("dense");
    assert!(!good && said.contains("dense.toml: weave.ends_per_cm = 400"), "{said}");
    assert_eq!(kept(), 0);

    cloth("first", 20);
    let (good, said) = weave("first");
    assert!(good, "{said}");
    assert_eq!(said.matches("its model was built in ").count(), 1, "{said}");
    assert_eq!(kept(), 1);

    cloth("second", 18);
    let (good, said) = weave("second");
    assert!(good, "{said}");
    for kind in ["warp", "weft"] {
        assert!(said.contains(&format!("note: {kind}: its model of preview quality in the cache")), "{said}");
    }
    assert_eq!(kept(), 1);
    let models = ["first", "second"].map(|name| {
        let cloth = plywave::cloth::ClothData::load(dir.join(format!("{name}.pwc"))).unwrap();
        cloth.models.iter().map(|model| model.data().to_bytes().unwrap()).collect::<Vec<_>>()
    });
    assert!(models[0] == models[1] && models[0][0] == models[0][1]);
}
