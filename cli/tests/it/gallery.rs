//! `plywave gallery`: two small pictures end to end, taken up again, and what is refused.

use crate::common::{json, names, plywave, refused, succeed, text};
use std::path::Path;

/// A folder with a copy of the fabrics that ship.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics");
    for part in ["", "models"] {
        std::fs::create_dir_all(folder.path().join("fabrics").join(part)).unwrap();
        for entry in std::fs::read_dir(from.join(part)).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                std::fs::copy(&path, folder.path().join("fabrics").join(part).join(path.file_name().unwrap())).unwrap();
            }
        }
    }
    folder
}

#[test]
fn pictures_are_made_and_taken_up() {
    let folder = folder();
    let dir = folder.path();
    // An open satin takes a third of the time to load, and each of the six pictures loads it: less light goes
    // from yarn to yarn.
    let spec = dir.join("fabrics/polyester_satin.toml");
    let dense = std::fs::read_to_string(&spec).unwrap();
    let open =
        dense.replace("spacing_um = 102.0", "spacing_um = 400.0").replace("spacing_um = 250.0", "spacing_um = 400.0");
    assert_eq!(open.matches("spacing_um = 400.0").count(), 2);
    std::fs::write(&spec, open).unwrap();
    let gallery = ["gallery", "-o", "out", "--quick", "--only", "polyester_satin_front,absorption", "--json"];
    let said = json(&succeed(dir, &gallery));
    assert_eq!((&said["rendered"], &said["skipped"]), (&2.into(), &0.into()));
    let files = ["absorption.png", "fabrics", "gallery.json", "gallery.md", "page", "polyester_satin_front.png"];
    assert_eq!(names(&dir.join("out")), files);
    let strip = image::open(dir.join("out/absorption.png")).unwrap().to_rgb8();
    assert!(strip.width() > 4 * strip.height(), "{:?}", strip.dimensions());
    // Fibers that absorb more are darker.
    let panel = strip.height() - 28;
    let light = |k: u32| -> f64 {
        let x0 = k * (panel + 6);
        let sum: f64 = (0..panel * panel).map(|i| f64::from(strip.get_pixel(x0 + i % panel, i / panel).0[1])).sum();
        sum / f64::from(panel * panel)
    };
    let lights: Vec<f64> = (0..5).map(light).collect();
    assert!(lights.windows(2).all(|w| w[1] < w[0]), "{lights:?}");
    let page = std::fs::read_to_string(dir.join("out/gallery.md")).unwrap();
    assert!(
        page.contains("page/absorption.jpg") && page.contains("plywave render fabrics/polyester_satin.toml --setup")
    );
    // The command on the page renders the same picture.
    let line = page.lines().find(|l| l.contains("--setup front")).unwrap();
    let words: Vec<&str> = line.split(' ').skip(1).collect();
    let before = std::fs::read(dir.join("out/polyester_satin_front.png")).unwrap();
    let out = dir.join("out");
    succeed(&out, &words);
    let pixels = |bytes: &[u8]| image::load_from_memory(bytes).unwrap().to_rgb8().into_raw();
    assert_eq!(pixels(&std::fs::read(out.join("polyester_satin_front.png")).unwrap()), pixels(&before));
    // Again: all is there; a picture that is gone is made anew, and nothing else.
    let again = [&gallery[..], &["--resume"]].concat();
    let said = json(&succeed(dir, &again));
    assert_eq!((&said["rendered"], &said["skipped"]), (&0.into(), &2.into()));
    std::fs::remove_file(out.join("polyester_satin_front.png")).unwrap();
    let said = json(&succeed(dir, &again));
    assert_eq!((&said["rendered"], &said["skipped"]), (&1.into(), &1.into()));
    // Another fabric under the same name is rendered anew.
    let other = std::fs::read_to_string(&spec).unwrap().replace("[0.50, 0.06, 0.12]", "[0.1, 0.2, 0.5]");
    std::fs::write(&spec, other).unwrap();
    let front = ["gallery", "-o", "out", "--quick", "--only", "polyester_satin_front", "--resume", "--json"];
    let said = json(&succeed(dir, &front));
    assert_eq!((&said["rendered"], &said["skipped"]), (&1.into(), &0.into()));
    // Pictures that were not asked for stay in the index.
    assert_eq!(said["index"]["pictures"].as_array().map(Vec::len), Some(2));
}

#[test]
fn bad_input_is_told_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    refused(dir, &["gallery", "--only", "velvet"], &["--only = velvet", "polyester_satin_front", "absorption"]);
    refused(dir, &["gallery", "--fabrics", "none"], &["--fabrics = none"]);
    std::fs::create_dir(dir.join("full")).unwrap();
    std::fs::write(dir.join("full/mine.txt"), "").unwrap();
    refused(dir, &["gallery", "-o", "full"], &["full: -o = a folder without gallery.json"]);
    std::fs::remove_file(dir.join("fabrics/wool_plain.toml")).unwrap();
    refused(dir, &["gallery", "-o", "out"], &["wool_plain.toml: no such file", "--fabrics"]);
    let output = plywave(dir, &["gallery", "--threads", "0"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
}
