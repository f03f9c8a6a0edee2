//! Scenes of strands: rendered, resumed, refused in one line.

use crate::common::{folder, refused, succeed};

const SCENE: &str = r#"
name = "few"
sky = 0.5

[strands]
make = { kind = "fur", count = 200, size_mm = 10.0, length_mm = 5.0 }
radius_um = 60.0
segments = 8

[fiber]
model = { kind = "dielectric" }
sigma_per_um = [[0.4, 0.01], [0.7, 0.002]]

[camera]
from_mm = [0.0, -30.0, 20.0]
to_mm = [0.0, 0.0, 1.0]
fov_deg = 25.0

[[lamps]]
from_mm = [20.0, -20.0, 40.0]
size_mm = 10.0
radiance = 10.0
"#;

const SMALL: &[&str] = &["--width", "24", "--height", "24", "--quiet", "-o", "few.png"];

#[test]
#[ignore = "slow: 20 s: strands are rendered and gone on with"]
fn strands_are_rendered_and_gone_on_with() {
    let folder = folder();
    let dir = folder.path();
    std::fs::write(dir.join("few.toml"), SCENE).unwrap();
    let shot = |more: &[&str]| succeed(dir, &[&["render", "few.toml"], SMALL, more].concat());
    shot(&["--samples", "6"]);
    let whole = std::fs::read(dir.join("few.exr")).unwrap();
    shot(&["--samples", "3", "--keep-sums"]);
    assert_ne!(std::fs::read(dir.join("few.exr")).unwrap(), whole);
    shot(&["--samples", "6", "--resume"]);
    assert!(std::fs::read(dir.join("few.exr")).unwrap() == whole, "gone on with, the picture is another");
    // By dual scattering.
    shot(&["--samples", "6", "--integrator", "dual"]);
    let dual = std::fs::read(dir.join("few.exr")).unwrap();
    assert_ne!(dual, whole);
    shot(&["--samples", "3", "--integrator", "dual", "--keep-sums"]);
    refused(dir, &[&["render", "few.toml", "--samples", "6", "--resume"], SMALL].concat(), &["--integrator"]);
    shot(&["--samples", "6", "--integrator", "dual", "--resume"]);
    assert!(std::fs::read(dir.join("few.exr")).unwrap() == dual, "gone on with, the picture is another");
    // Curves of a file, linear.
    std::fs::write(dir.join("curves.txt"), "0 0 0 .1\n0 0 5 .1\n\n1 0 0 .1\n1 1 5 .1\n").unwrap();
    let of_file = "file = \"curves.txt\"\nbasis = \"linear\"\nshape = \"band\"";
    let scene = SCENE.replace("make = { kind = \"fur\", count = 200, size_mm = 10.0, length_mm = 5.0 }", of_file);
    std::fs::write(dir.join("few.toml"), scene.replace("radius_um = 60.0\nsegments = 8", "")).unwrap();
    shot(&["--samples", "2"]);
    assert_ne!(std::fs::read(dir.join("few.exr")).unwrap(), whole);
}

/// Few scatterings leave out light, which is told; the sums of what they leave out go on with the picture's.
#[test]
fn a_cut_of_paths_is_told() {
    let folder = folder();
    let dir = folder.path();
    std::fs::write(dir.join("few.toml"), SCENE.replace("count = 200", "count = 6000")).unwrap();
    let shot = |more: &[&str]| succeed(dir, &[&["render", "few.toml"], SMALL, more].concat());
    let told = |more: &[&str]| -> serde_json::Value {
        let args: Vec<&str> = SMALL.iter().filter(|a| **a != "--quiet").copied().chain(["--json"]).collect();
        serde_json::from_str(&succeed(dir, &[&["render", "few.toml"], &args[..], more].concat())).unwrap()
    };
    let notes = |of: &serde_json::Value| of["notes"].to_string();
    let cut = told(&["--samples", "8", "--depth", "2"]);
    let share = cut["cut_share"].as_f64().unwrap();
    assert!(share > 0.05 && share < 0.9, "{share}");
    assert!(notes(&cut).contains("paths end after 2 scatterings (--depth), which leaves out some"), "{cut}");
    let whole = std::fs::read(dir.join("few.exr")).unwrap();
    let name = b"plywave.cut_share";
    assert!(whole.windows(name.len()).any(|w| w == name));
    shot(&["--samples", "4", "--depth", "2", "--keep-sums"]);
    let again = told(&["--samples", "8", "--depth", "2", "--resume"]);
    assert_eq!(again["cut_share"], cut["cut_share"]);
    assert!(std::fs::read(dir.join("few.exr")).unwrap() == whole, "gone on with, the picture is another");
    let all = told(&["--samples", "8"]);
    assert!(!notes(&all).contains("--depth") && all["cut_share"].as_f64().unwrap() < 1e-3, "{all}");
    refused(dir, &["render", "few.toml", "--depth", "65537"], &["--depth", "65537"]);
}

/// What a file's reader leaves out is told; included files are inputs: not written over, and of one render.
#[test]
fn what_is_taken_otherwise_is_told() {
    let folder = folder();
    let dir = folder.path();
    let curve = "Shape \"curve\" \"point3 P\" [ 0 0 0  0 0 1  0 0 2  0 0 3 ] \"float width0\" 1 \"float width1\" 0\n";
    std::fs::write(dir.join("main.pbrt"), format!("Shape \"sphere\" Include \"more.pbrt\" Scale 1 2 1 {curve}"))
        .unwrap();
    std::fs::write(dir.join("more.pbrt"), curve).unwrap();
    let made =
        "make = { kind = \"fur\", count = 200, size_mm = 10.0, length_mm = 5.0 }\nradius_um = 60.0\nsegments = 8";
    std::fs::write(dir.join("few.toml"), SCENE.replace(made, "file = \"main.pbrt\"")).unwrap();
    let args = ["render", "few.toml", "--width", "8", "--height", "8", "--samples", "2", "-o", "few.png"];
    let out = succeed(dir, &args);
    for words in [
        "2 strands of 2 segments",
        "note         points with a radius of 0, or below 0.00001 mm, which they take: 2",
        "note         curves scaled differently by direction, taken as round, of the same section's area: 1",
        "note         shapes that are no curves, passed over (1 sphere): 1",
    ] {
        assert!(out.contains(words), "no {words:?} in {out}");
    }
    succeed(dir, &[&args[..], &["--keep-sums", "--quiet"]].concat());
    std::fs::rename(dir.join("more.pbrt"), dir.join("more.png")).unwrap();
    std::fs::write(dir.join("main.pbrt"), "Include \"more.png\"").unwrap();
    refused(dir, &["render", "few.toml", "-o", "more.png"], &["more.png", "an input"]);
    std::fs::copy(dir.join("more.png"), dir.join("again.pbrt")).unwrap();
    std::fs::write(dir.join("main.pbrt"), format!("Shape \"sphere\" Include \"more.pbrt\" Scale 1 2 1 {curve}"))
        .unwrap();
    std::fs::write(dir.join("more.pbrt"), curve.replace("width0\" 1", "width0\" 2")).unwrap();
    refused(dir, &[&args[..], &["--resume"]].concat(), &["few.sums", "not the same included file"]);
    std::fs::write(dir.join("main.pbrt"), "Include \"gone.pbrt\"").unwrap();
    refused(dir, &[&args[..], &["--fresh"]].concat(), &["main.pbrt: line 1: Include \"gone.pbrt\""]);
    assert!(dir.join("few.sums").exists(), "a render that did not begin has deleted sums");
}

#[test]
fn bad_scenes_are_refused_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    let million: String = (0..1_000_000).map(|k| format!("{k} 0 0 1\n")).collect();
    let mut hair = b"HAIR".to_vec();
    hair.extend([2u32, 4, 2, 1].into_iter().flat_map(u32::to_le_bytes));
    hair.resize(150, 0);
    for (name, bytes) in [("million.txt", million.as_bytes()), ("cut.hair", &hair), ("nan.txt", b"0 0 nan 1\n1 1 1 1")]
    {
        std::fs::write(dir.join(name), bytes).unwrap();
    }
    std::fs::write(dir.join("zero.txt"), "0 0 0 0\n1 1 1 0").unwrap();
    let made =
        "make = { kind = \"fur\", count = 200, size_mm = 10.0, length_mm = 5.0 }\nradius_um = 60.0\nsegments = 8";
    let of = |file: &str| format!("file = \"{file}\"\nbasis = \"linear\"");
    let (none, cut, nan, zero, many) =
        (of("none.txt"), of("cut.hair"), of("nan.txt"), of("zero.txt"), of("million.txt"));
    let edits: &[(&str, &str, &[&str])] = &[
        (made, &none, &["none.txt", "o such file"]),
        (made, &cut, &["cut.hair", "cut off"]),
        (made, &nan, &["nan.txt", "NaN"]),
        (made, &zero, &["zero.txt", "left out: 1", "radius_um"]),
        (made, &many, &["million.txt", "more than 65536"]),
        (made, "", &["neither file nor make"]),
        ("radius_um = 60.0", "", &["strands.radius_um"]),
        ("radius_um = 60.0", "radius_um = 0.0", &["strands.radius_um", "0.0"]),
        ("count = 200", "count = 0", &["strands.make.count"]),
        ("kind = \"fur\"", "kind = \"beard\"", &["beard", "\"wisp\""]),
        ("{ kind = \"dielectric\" }", "{ kind = \"dielectric\", eta = 0.9 }", &["fiber.model.eta", "0.9"]),
        ("{ kind = \"dielectric\" }", "{ kind = \"table\", file = \"none.pwf\" }", &["none.pwf"]),
        ("[[0.4, 0.01], [0.7, 0.002]]", "-1", &["fiber.sigma_per_um", "-1"]),
        ("[[0.4, 0.01], [0.7, 0.002]]", "[[0.7, 0.01], [0.4, 0.002]]", &["ascending"]),
        ("size_mm = 10.0\nradiance", "size_mm = nan\nradiance", &["size_mm", "nan"]),
        ("to_mm = [0.0, 0.0, 1.0]", "to_mm = [0.0, -30.0, 20.0]", &["camera.to_mm"]),
        ("fov_deg = 25.0", "fov = 25.0", &["fov_deg"]),
    ];
    for (from, to, words) in edits {
        assert!(SCENE.contains(from), "{from}");
        std::fs::write(dir.join("bad.toml"), SCENE.replace(from, to)).unwrap();
        refused(dir, &[&["render", "bad.toml"], SMALL].concat(), words);
    }
    std::fs::write(dir.join("bad.toml"), SCENE).unwrap();
    refused(dir, &[&["render", "bad.toml", "--setup", "front"], SMALL].concat(), &["--setup", "cloths"]);
    refused(dir, &["build", "bad.toml"], &["bad.toml"]);
}
