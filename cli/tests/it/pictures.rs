//! `plywave render` and its files: what `-o` makes, that no input is written over, that a render goes on only
//! from sums of the same inputs, and what is told.

use crate::common::{ANY_FIT, json, names, refused, run, succeed, text, write_cloth};
use plywave::Document;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

fn fabrics() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics")
}

/// A folder with a plain cotton cloth, its spec and model, a mesh and a sky.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    write_cloth(dir);
    std::fs::write(dir.join("sheet.obj"), SHEET).unwrap();
    static SKY: OnceLock<Vec<u8>> = OnceLock::new();
    let sky = SKY.get_or_init(|| {
        succeed(dir, &[&["render", "cloth.pwc", "-o", "sky.exr", "--smooth"], SMALL].concat());
        assert_eq!(names(dir), ["cloth.pwc", "cloth.toml", "models", "sheet.obj", "sky.exr"], "an EXR alone");
        std::fs::read(dir.join("sky.exr")).unwrap()
    });
    std::fs::write(dir.join("sky.exr"), sky).unwrap();
    folder
}

const SHEET: &str = "v 0 0 0\nv 30 0 0\nv 30 20 0\nv 0 20 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\nf 1/1 2/2 3/3 4/4\nf 1/1 1/2 2/3\n";
const SMALL: &[&str] = &["--width", "12", "--height", "8", "--samples", "2", "--quiet"];

fn starts_with(path: &Path, magic: &[u8]) -> bool {
    std::fs::read(path).unwrap().starts_with(magic)
}

const EXR: &[u8] = &[0x76, 0x2f, 0x31, 0x01];
const PNG: &[u8] = b"\x89PNG";

#[test]
#[ignore = "slow: 5 s: the ending decides"]
fn the_ending_decides() {
    let folder = folder();
    let dir = folder.path();
    assert!(starts_with(&dir.join("sky.exr"), EXR));
    succeed(dir, &[&["render", "cloth.pwc", "-o", "b.PNG", "--smooth"], SMALL].concat());
    assert!(starts_with(&dir.join("b.PNG"), PNG) && starts_with(&dir.join("b.exr"), EXR));
    succeed(dir, &[&["render", "cloth.pwc", "-o", "c.png", "--no-exr", "--smooth"], SMALL].concat());
    assert!(starts_with(&dir.join("c.png"), PNG) && !dir.join("c.exr").exists());
    // The same bits in whichever file.
    assert!(std::fs::read(dir.join("sky.exr")).unwrap() == std::fs::read(dir.join("b.exr")).unwrap());
    for name in ["x.jpg", "x.tiff", "x"] {
        refused(dir, &[&["render", "cloth.pwc", "-o", name], SMALL].concat(), &[name, "-o", ".png", ".exr"]);
    }
    // What the header tells: the name of the file and the digest of all inputs.
    let exr = String::from_utf8_lossy(&std::fs::read(dir.join("b.exr")).unwrap()).into_owned();
    let png = String::from_utf8_lossy(&std::fs::read(dir.join("b.PNG")).unwrap()).into_owned();
    for word in ["cloth.pwc", "sha256:", env!("CARGO_PKG_VERSION")] {
        assert!(exr.contains(word) && png.contains(word), "{word}");
    }
}

#[test]
#[ignore = "slow: 5 s: inputs are not written over"]
fn inputs_are_not_written_over() {
    let folder = folder();
    let dir = folder.path();
    std::fs::copy(dir.join("sky.exr"), dir.join("studio.exr")).unwrap();
    std::fs::copy(dir.join("sheet.obj"), dir.join("mesh.exr")).unwrap();
    std::fs::hard_link(dir.join("models/cotton.pwm"), dir.join("twin.png")).unwrap();
    std::fs::copy(dir.join("cloth.pwc"), dir.join("cloth.exr")).unwrap();
    std::fs::copy(dir.join("sky.exr"), dir.join("kept.sums")).unwrap();
    let before: Vec<Vec<u8>> = names(dir).iter().filter_map(|n| std::fs::read(dir.join(n)).ok()).collect();
    for (more, word) in [
        // The sky beside the picture, or the picture itself.
        (&["-o", "studio.png", "--sky", "studio.exr"][..], "studio.exr"),
        (&["-o", "studio.exr", "--sky", "studio.exr"], "studio.exr"),
        (&["-o", "mesh.png", "--mesh", "mesh.exr"], "mesh.exr"),
        (&["-o", "kept.png", "--sky", "kept.sums"], "kept.sums"),
    ] {
        refused(dir, &[&["render", "cloth.pwc"], more, SMALL].concat(), &[word, "an input of this command"]);
    }
    // A model that the spec names, by another name of the file.
    let over = ["render", "cloth.toml", "-o", "twin.png", "--no-exr"];
    refused(dir, &over, &["twin.png", "an input of this command"]);
    refused(dir, &[&["render", "cloth.exr", "-o", "cloth.png"], SMALL].concat(), &["cloth.exr", "input"]);
    let after: Vec<Vec<u8>> = names(dir).iter().filter_map(|n| std::fs::read(dir.join(n)).ok()).collect();
    assert_eq!(before, after);
    refused(dir, &["weave", "cloth.toml", "-o", "cloth.toml"], &["cloth.toml", "an input of this command"]);
}

#[test]
#[ignore = "slow: 10 s: sums of other inputs are refused"]
fn sums_of_other_inputs_are_refused() {
    let folder = folder();
    let dir = folder.path();
    let more = ["--mesh", "sheet.obj", "--sky", "sky.exr", "--width", "10", "--height", "6", "--quiet", "-o", "a.exr"];
    let with = |extra: &[&'static str]| [&["render", "cloth.pwc"][..], &more, extra].concat();
    succeed(dir, &with(&["--samples", "2", "--keep-sums"]));
    let again = with(&["--samples", "4", "--keep-sums", "--resume"]);
    for (flag, value) in [("--cloth-mm", "50"), ("--seed", "9"), ("--size-mm", "7"), ("--sigma", "0"), ("--depth", "3")]
    {
        refused(dir, &[&again[..], &[flag, value]].concat(), &["a.sums", flag, "--resume"]);
    }
    let mut cloth = plywave::cloth::ClothData::load(dir.join("cloth.pwc")).unwrap();
    cloth.name += " of another name";
    let other_cloth = cloth.to_bytes().unwrap();
    let edit = |file: &str, name: &str| {
        let path = dir.join(file);
        let bytes = std::fs::read(&path).unwrap();
        let other = match file {
            "cloth.pwc" => other_cloth.clone(),
            "sky.exr" => std::fs::read(dir.join("sky2.exr")).unwrap(),
            "sheet.obj" => [&bytes[..], b"# changed\n"].concat(),
            _ => unreachable!(),
        };
        std::fs::write(&path, other).unwrap();
        refused(dir, &again, &["a.sums", &format!("not the same {name}")]);
        std::fs::write(&path, bytes).unwrap();
    };
    succeed(dir, &[&["render", "cloth.pwc", "-o", "sky2.exr", "--smooth", "--seed", "5"], SMALL].concat());
    edit("cloth.pwc", "cloth");
    edit("sheet.obj", "mesh");
    edit("sky.exr", "sky");
    // Sums that are damaged, or not finite.
    let sums = std::fs::read(dir.join("a.sums")).unwrap();
    let mut nan = sums.clone();
    let end = nan.len();
    nan[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    for bad in [&sums[..sums.len() / 2], &nan[..], b""] {
        std::fs::write(dir.join("a.sums"), bad).unwrap();
        refused(dir, &again, &["a.sums", "--resume"]);
    }
    std::fs::write(dir.join("a.sums"), &sums).unwrap();
    succeed(dir, &again);
}

#[test]
#[ignore = "slow: 5 s: meshes tell what was done to them"]
fn meshes_tell_what_was_done_to_them() {
    let folder = folder();
    let dir = folder.path();
    let args = ["render", "cloth.pwc", "--mesh", "sheet.obj", "-o", "a.png", "--json", "--width", "8", "--height", "8"];
    let said = json(&succeed(dir, &[&args[..], &["--samples", "1", "--size-mm", "60"]].concat()));
    let notes = said["notes"].to_string();
    for words in [
        "1 unit is 2 mm",
        "left out 1 face equal to another",
        "left out 1 face without area in single precision: face 3 (line 11)",
    ] {
        assert!(notes.contains(words), "{words} in {notes}");
    }
    let heap = SHEET.to_string() + &"f 1/1 2/2 3/3 4/4\n".repeat(200_000);
    std::fs::write(dir.join("heap.obj"), heap).unwrap();
    let args = ["render", "cloth.pwc", "--mesh", "heap.obj", "-o", "a.png", "--json"];
    let said = json(&succeed(dir, &[&args[..], &["--width", "8", "--height", "8", "--samples", "1"]].concat()));
    assert!(
        said["notes"].to_string().contains("left out 200001 faces equal to another: the first is face 2 (line 10)"),
        "{said}"
    );
    std::fs::write(dir.join("bad.obj"), "v 0 0 0\nv 1 2\n").unwrap();
    refused(dir, &[&["render", "cloth.pwc", "--mesh", "bad.obj", "-o", "a.png"], SMALL].concat(), &["bad.obj: line 2"]);
}

/// Models that ship have speckle; a render with speckle names each model without it once.
#[test]
#[ignore = "slow: 5 s: models without speckle are told"]
fn models_without_speckle_are_told() {
    let folder = folder();
    let dir = folder.path();
    let said = |more: &[&str]| {
        let told = succeed(dir, &[&["render", "cloth.pwc", "-o", "a.png", "--json"], &SMALL[..6], more].concat());
        json(&told)["notes"].to_string().matches("no speckle noise").count()
    };
    assert_eq!(said(&[]), 0);
    let mut cloth = plywave::cloth::ClothData::load(dir.join("cloth.pwc")).unwrap();
    for model in &mut cloth.models {
        let mut data = model.data().clone();
        assert!(data.noise.take().is_some());
        *model = std::sync::Arc::new(plywave::PlyModel::from_data(data).unwrap());
    }
    cloth.save(dir.join("cloth.pwc")).unwrap();
    assert_eq!((said(&[]), said(&["--smooth"])), (1, 0));
}

/// Slits by a flag are those of the spec's keys; they change the picture, and what cannot be is refused.
#[test]
#[ignore = "slow: 10 s: slits come by flag or spec"]
fn slits_come_by_flag_or_spec() {
    let folder = folder();
    let dir = folder.path();
    let mut cloth = plywave::cloth::ClothData::load(dir.join("cloth.pwc")).unwrap();
    for look in &mut cloth.looks {
        look.slits = Some(plywave::cloth::Slits::of_width(2.0));
    }
    cloth.save(dir.join("slits.pwc")).unwrap();
    let picture = |cloth: &str, more: &[&str]| {
        let back = ["--setup", "back", "--size-mm", "3", "--smooth", "-o", "a.png", "--no-exr"];
        succeed(dir, &[&["render", cloth][..], &back, SMALL, more].concat());
        image::open(dir.join("a.png")).unwrap().to_rgb8().into_raw()
    };
    let (plain, slits) = (picture("cloth.pwc", &[]), picture("slits.pwc", &[]));
    assert!(plain != slits);
    assert!(slits == picture("cloth.pwc", &["--slit-um", "2"]));
    assert!(plain == picture("slits.pwc", &["--without", "slits"]));
    refused(dir, &["render", "cloth.pwc", "--slit-um", "0"], &["--slit-um = 0"]);
    refused(dir, &["render", "cloth.pwc", "--slit-um", "nan"], &["--slit-um"]);
    refused(dir, &["render", "cloth.pwc", "--slit-um", "2", "--slit-share", "1.5"], &["--slit-share = 1.5"]);
    refused(dir, &["render", "cloth.pwc", "--slit-um", "2", "--without", "slits"], &["--slit-um = 2", "--without"]);
}

#[test]
#[ignore = "slow: 5 s: colors out of reach are told in the same words"]
fn colors_out_of_reach_are_told_in_the_same_words() {
    let folder = folder();
    let dir = folder.path();
    let mut cloth = plywave::cloth::ClothData::load(dir.join("cloth.pwc")).unwrap();
    for look in &mut cloth.looks {
        look.colors = vec![plywave::cloth::YarnColor::Srgb([0.5, 0.02, 0.08])];
    }
    cloth.save(dir.join("red.pwc")).unwrap();
    let said = json(&succeed(dir, &[&["render", "red.pwc", "-o", "a.png", "--json"][..], &SMALL[..6]].concat()));
    let notes: Vec<&str> = said["notes"].as_array().unwrap().iter().filter_map(|n| n.as_str()).collect();
    let told: Vec<&str> = notes.iter().filter_map(|n| n.split_once("out of reach: ").map(|n| n.1)).collect();
    assert!(!told.is_empty(), "{notes:?}");
    let color = succeed(dir, &["color", "red.pwc", "--srgb", "0.5,0.02,0.08"]);
    for note in told {
        assert!(color.contains(note), "{note:?} not in {color}");
    }
}

#[test]
fn wrong_kinds_of_files_are_named() {
    let folder = folder();
    let dir = folder.path();
    std::fs::copy(fabrics().join("cotton.toml"), dir.join("yarn.toml")).unwrap();
    let at = ["--theta-i", "0", "--h-rel", "0"];
    let eval = |file: &'static str| [&["eval", file, "--theta-o", "0", "--phi-o", "0"][..], &at].concat();
    let render = |file: &'static str| [&["render", file, "-o", "a.png"], SMALL].concat();
    let model = "models/cotton.pwm";
    for (args, words) in [
        (render(model), ["a ply model", "expected a cloth spec"]),
        (render("yarn.toml"), ["a yarn spec", "expected a cloth spec"]),
        (render("sky.exr"), ["a picture", "expected a cloth spec"]),
        (vec!["weave", "yarn.toml"], ["a yarn spec", "expected a cloth spec"]),
        (vec!["info", "cloth.toml"], ["a cloth spec", "`render`"]),
        (eval("cloth.toml"), ["a cloth spec", "expected a ply model"]),
        (eval("yarn.toml"), ["a yarn spec", "plywave build"]),
        (vec!["check", "sheet.obj"], ["a mesh", "expected a ply model"]),
        (vec!["check", model, "--table", model], ["a ply model", "expected a table"]),
        (vec!["diff", "yarn.toml", model], ["a yarn spec", "expected a ply model"]),
        (vec!["diff", model, "cloth.toml"], ["a cloth spec", "expected a ply model"]),
        (vec!["color", "yarn.toml", "--srgb", "1,0,0"], ["a yarn spec", "expected a ply model"]),
    ] {
        refused(dir, &args, &words);
    }
    // Values below 0 are values, not flags.
    for flag in ["--sigma", "--size-mm"] {
        refused(dir, &[&render("cloth.pwc")[..], &[flag, "-1"]].concat(), &[flag, "-1", "must be from"]);
    }
    refused(dir, &[&eval(model)[..], &["--sigma", "-1"]].concat(), &["--sigma = -1", "0 or more"]);
    refused(dir, &[&render("cloth.pwc")[..], &["--depth", "-3"]].concat(), &["-3", "--depth"]);
    refused(dir, &["diff", model, model, "--tol-energy", "-1"], &["--tol-energy = -1", "0 or more"]);
    refused(dir, &[], &["no command given", "expected one of", "simulate", "render"]);
    refused(dir, &["wave"], &["no command given", "scatter"]);
    refused(dir, &["weeve"], &["weeve", "'weave'"]);
    refused(dir, &["qqqq"], &["qqqq", "expected one of", "simulate"]);
    assert!(succeed(dir, &["help", "eval"]).contains("--theta-i"));
}

#[test]
#[ignore = "slow: 15 s: models of other nodes are compared"]
fn models_of_other_nodes_are_compared() {
    let folder = folder();
    let dir = folder.path();
    let tiny = crate::common::TINY;
    for (name, from, to) in
        [("a", "", ""), ("b", "[0.0, 0.01, 0.1]", "[0.0, 0.02, 0.05, 0.1]"), ("c", "h_nodes = 5", "h_nodes = 7")]
    {
        std::fs::write(
            dir.join(format!("{name}.toml")),
            if from.is_empty() { tiny.to_string() } else { tiny.replacen(from, to, 1) },
        )
        .unwrap();
        let spec = format!("{name}.toml");
        succeed(dir, &[&["build", &spec, "--preset", "preview", "--quiet"], ANY_FIT].concat());
    }
    let diff = |args: &[&str]| run(dir, &[&["diff"], args].concat());
    let energy = |a: &str, b: &str| {
        let output = diff(&[a, b, "--json"]);
        assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
        let said = json(&text(&output.stdout));
        assert_eq!(said["compared"], "common incidences");
        assert_eq!(said["slices"].as_array().map(Vec::len), Some(63));
        said["energy"].as_f64().unwrap()
    };
    // The same paths at other absorptions; the same yarn at other offsets; another yarn.
    let (near, nodes, far) = (energy("a.pwm", "b.pwm"), energy("a.pwm", "c.pwm"), energy("a.pwm", "models/cotton.pwm"));
    // Energies have grids of their own: nodes of the lobes do not change them.
    assert!(near < 0.1 && nodes < 0.01 && near < 0.5 * far, "{near} {nodes} {far}");
    let output = diff(&["a.pwm", "c.pwm", "--tol", "3", "--tol-energy", "1"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stdout));
    assert!(text(&output.stdout).contains("other nodes"));
    refused(dir, &["diff", "a.pwm", "b.pwm", "--tol-drift", "1"], &["--tol-drift", "leave it out"]);
}

/// One of a thing is no plural.
#[test]
#[ignore = "slow: 5 s: one fiber is one fiber"]
fn one_fiber_is_one_fiber() {
    let folder = folder();
    let dir = folder.path();
    let one = crate::common::TINY.replace("fibers = 12", "fibers = 1").replace("radius_um = 40.0", "radius_um = 8.0");
    std::fs::write(dir.join("one.toml"), one).unwrap();
    succeed(dir, &[&["build", "one.toml", "--preset", "preview", "--quiet"], ANY_FIT].concat());
    let said = succeed(dir, &["info", "one.pwm"]);
    assert!(said.contains(" 1 fiber, "), "{said}");
    let said = succeed(dir, &["render", "cloth.pwc", "-o", "a.png", "--samples", "1", "--width", "4", "--height", "4"]);
    assert!(said.contains("1 sample a pixel"), "{said}");
}

/// In an address space of 3 GiB a film of 45 is refused before the work.
#[cfg(target_os = "linux")]
#[test]
fn what_memory_does_not_hold_is_refused() {
    let folder = folder();
    let dir = folder.path();
    let limited = |args: &str| {
        let script = format!("ulimit -v 3000000; exec {} {args}", env!("CARGO_BIN_EXE_plywave"));
        std::process::Command::new("sh").current_dir(dir).args(["-c", &script]).output().unwrap()
    };
    let output = limited("render cloth.pwc -o a.png --width 16384 --height 16384 --threads 2");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("16384 x 16384 pixels needs") && said.lines().count() == 1, "{said}");
    // A sky of some hundred bytes that claims 60000 x 60000 texels.
    let mut sky = std::fs::read(dir.join("sky.exr")).unwrap();
    let mark = b"dataWindow\0box2i\0";
    let at = sky.windows(mark.len()).position(|w| w == mark).unwrap() + mark.len() + 12;
    sky[at..at + 8].copy_from_slice(&[59_999i32.to_le_bytes(), 59_999i32.to_le_bytes()].concat());
    std::fs::write(dir.join("huge.exr"), sky).unwrap();
    let output = limited("render cloth.pwc -o a.png --sky huge.exr --threads 2");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("huge.exr: 60000 x 60000 texels") && said.lines().count() == 1, "{said}");
    assert!(!dir.join("a.png").exists() && !dir.join("a.exr").exists());
}

/// The camera's flags in place of the scene's own camera: the same numbers give the same picture, a cloth
/// fills more of it from nearer, and nonsense is refused.
#[test]
#[ignore = "slow: 15 s: cameras look where they are told"]
fn cameras_look_where_they_are_told() {
    let folder = folder();
    let dir = folder.path();
    let hits = |depth: &[f32]| depth.iter().filter(|d| **d > 0.0).count();
    let covered = |more: &[&str]| {
        let args = ["render", "cloth.pwc", "--smooth", "-o", "a.exr", "--width", "24", "--height", "24", "--quiet"];
        succeed(dir, &[&args[..], &["--samples", "2"], more].concat());
        let read = exr::prelude::read_first_flat_layer_from_file(dir.join("a.exr")).unwrap();
        let depth = read.layer_data.channel_data.list.iter().find(|c| c.name.eq("depth.Z")).unwrap();
        let depth: Vec<f32> = depth.sample_data.values_as_f32().collect();
        (hits(&depth), depth)
    };
    // A sheet of 30 mm from above.
    let (_, own) = covered(&["--setup", "back"]);
    assert_eq!(covered(&["--setup", "back", "--camera", "0,0,75", "--look", "0,0,0", "--up", "0,1,0"]).1, own);
    let above = ["--setup", "back", "--camera", "0,0,100", "--fov", "20"];
    let (count, depth) = covered(&above);
    // 30 mm of the 35.3 mm that 20 degrees take in at 100 mm.
    let share = count as f64 / 576.0;
    assert!((share - (30.0f64 / 35.27).powi(2)).abs() < 0.06, "{share}");
    assert!(depth.iter().filter(|d| **d > 0.0).all(|d| (d - 100.0).abs() < 1e-3));
    assert_eq!(covered(&["--setup", "back", "--camera", "0,0,100", "--fov", "5"]).0, 576);
    // From below, from the side along which the scene's own up points, and at a point beside the sheet.
    assert_eq!(covered(&["--camera", "0,0,-40"]).0, 576);
    assert!(covered(&["--camera", "0,-60,1", "--fov", "60"]).0 < 100);
    assert_eq!(covered(&["--look", "500,0,0"]).0, 0);
    for (flags, words) in [
        (&["--camera", "0,0"][..], &["--camera", "three numbers"][..]),
        (&["--camera", "0,nan,1"], &["--camera", "three numbers"]),
        (&["--camera", "1,2,3,4"], &["--camera", "three numbers"]),
        (&["--camera", "0,0,0"], &["--camera = 0,0,0", "looks at"]),
        (&["--camera", "5,5,5", "--look", "5,5,5"], &["--camera = 5,5,5"]),
        (&["--camera", "0,0,1e9"], &["--camera = 0,0,1000000000", "1000000 mm"]),
        (&["--look", "-1e9,0,0"], &["--look = -1000000000,0,0"]),
        (&["--camera", "0,0,9", "--up", "0,0,-2"], &["--up = 0,0,-2", "along the view"]),
        (&["--up", "0,0,0"], &["--up = 0,0,0"]),
        (&["--fov", "0"], &["--fov = 0"]),
        (&["--fov", "180"], &["--fov = 180", "170"]),
        (&["--fov", "-20"], &["--fov = -20"]),
    ] {
        refused(dir, &[&["render", "cloth.pwc", "-o", "b.exr"], flags].concat(), words);
    }
}

fn field(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/field").join(name).display().to_string()
}

/// A white cloth in an even surrounding is as bright as it; what was mended in a sky is told, and one without
/// colors refused.
#[test]
#[ignore = "slow: 10 s: skies light by their radiance"]
fn skies_light_by_their_radiance() {
    let folder = folder();
    let dir = folder.path();
    let seen = |sky: &str| {
        let args = ["render", "cloth.pwc", "--sigma", "0", "--smooth", "--setup", "furnace", "--samples", "64"];
        let size = ["--width", "16", "--height", "16", "-o", "a.exr", "--json", "--sky", sky];
        let said = json(&succeed(dir, &[&args[..], &size].concat()));
        let read = exr::prelude::read_first_flat_layer_from_file(dir.join("a.exr")).unwrap();
        let green = read.layer_data.channel_data.list.iter().find(|c| c.name.eq("G")).unwrap();
        let mean = green.sample_data.values_as_f32().map(f64::from).sum::<f64>() / 256.0;
        (mean, said["notes"].to_string())
    };
    for (file, want) in [("grey01.exr", 0.1), ("grey10.exr", 10.0)] {
        let (got, _) = seen(&field(&format!("sky_radiance/{file}")));
        assert!((got / want - 1.0).abs() < 0.02, "{file}: {got}");
    }
    let (_, notes) = seen(&field("sky_files/negative.exr"));
    assert!(notes.contains("negative.exr: R of pixel (10, 5) is -0.0001, taken as 0"), "{notes}");
    assert!(seen(&field("sky_files/layer.exr")).0 > 0.0);
    std::fs::write(dir.join("sky.png"), PNG).unwrap();
    let base = ["render", "cloth.pwc", "-o", "b.exr"];
    refused(dir, &[&base[..], &["--sky", "sky.png"]].concat(), &["sky.png", "OpenEXR nor Radiance"]);
    let layer = field("sky_files/layer.exr");
    refused(dir, &[&base[..], &["--sky", &layer, "--sky-layer", "Sun"]].concat(), &["Sun", "ViewLayer.Combined"]);
    refused(dir, &[&base[..], &["--sky-layer", "Sun"]].concat(), &["--sky"]);
}
