//! `plywave swatch`: what it refuses, and the fit of pictures whose cloth is known.

use crate::common::{json, names, refused, succeed};
use plywave::cloth::{ClothModel, ClothOptions};
use plywave_pipeline::swatch::{Shot, SwatchGeometry, blur, encode};
use plywave_pipeline::{ClothRecipe, Run, model_library};
use std::path::Path;

/// Writes a gray picture of columns and rows with dots.
fn picture(path: &Path, [width, height]: [u32; 2]) {
    let dots = image::RgbImage::from_fn(width, height, |x, y| image::Rgb([if (x + y) % 5 == 0 { 90 } else { 60 }; 3]));
    dots.save(path).unwrap();
}

#[test]
fn bad_pictures_and_words_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    picture(&dir.join("r.png"), [96, 96]);
    picture(&dir.join("t.png"), [96, 64]);
    std::fs::write(dir.join("text.png"), "no picture").unwrap();
    std::fs::write(dir.join("lamp.toml"), "back_lamp_mm = [0, 0, 90]\n").unwrap();
    let fit = |more: &[&'static str]| [&["swatch", "r.png"], more].concat();
    for (args, words) in [
        (fit(&["t.png", "-o", "c.toml"]), &["96 x 96 and 96 x 64 pixels", "give two pictures of one size"][..]),
        (fit(&["none.png", "-o", "c.toml"]), &["none.png", "no such file"]),
        (fit(&["text.png", "-o", "c.toml"]), &["text.png", "no PNG file"]),
        (fit(&["r.png", "-o", "c.png"]), &["-o", ".toml"]),
        (fit(&["r.png", "-o", "r.toml"]), &["r.png", "input"]),
        (fit(&["r.png", "-o", "c.toml", "--weave", "tweed"]), &["--weave", "tweed"]),
        (fit(&["r.png", "-o", "c.toml", "--fiber", "gold"]), &["gold", "metal"]),
        (fit(&["r.png", "-o", "c.toml", "--g-per-m2", "9999"]), &["--g-per-m2", "5 to 2000 g/m2"]),
        (fit(&["r.png", "-o", "c.toml", "--geometry", "lamp.toml"]), &["lamp.toml", "back_lamp_mm", "below"]),
    ] {
        refused(dir, &args, words);
    }
    assert_eq!(names(dir), ["lamp.toml", "r.png", "t.png", "text.png"]);
}

#[test]
#[ignore = "slow: 100 s: pictures of percale are fitted, with bars that hold its numbers"]
fn pictures_of_percale_give_its_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let percale = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/cloths/percale.toml");
    let color = [0.6f64, 0.4, 0.3];
    let text =
        std::fs::read_to_string(percale).unwrap().replace("color = [0.90, 0.90, 0.88]", "color = [0.6, 0.4, 0.3]");
    let recipe = ClothRecipe::parse("percale.toml", text, dir).unwrap();
    let run = Run::plain();
    let plies = recipe.plies(&model_library()).unwrap().build(&run).unwrap();
    let curves = recipe.curves(&run).unwrap();
    let cloth =
        ClothModel::from_data(recipe.make(&curves, &plies.models, false, &run).unwrap(), &ClothOptions::default());
    let cloth = cloth.unwrap();
    // From near, so that the yarns are seen.
    let near = "camera_mm = 30\nfront_lamp_mm = [0, 30, 30]\nback_lamp_mm = [0, 0, -35]\nlamp_radius_mm = 0.6\n";
    std::fs::write(dir.join("near.toml"), near).unwrap();
    let geometry = SwatchGeometry::parse(near, "near.toml").unwrap();
    let size = [320, 320];
    for (is_back, name) in [(false, "r.png"), (true, "t.png")] {
        let part = [0, 0, size[0], size[1]];
        let shot = Shot { cloth: &cloth, turn_rad: 0.0, geometry: &geometry, size, part, samples: 16, seed: 1 };
        let light = blur(size, &shot.render(is_back), 0.5);
        let mut all: Vec<f32> = light.iter().map(|rgb| rgb[0]).collect();
        all.sort_by(f32::total_cmp);
        let exposure = 0.2 / all[all.len() / 2];
        let bytes: Vec<u8> = light.iter().flat_map(|rgb| rgb.map(|v| encode(exposure * v))).collect();
        image::RgbImage::from_raw(size[0] as u32, size[1] as u32, bytes).unwrap().save(dir.join(name)).unwrap();
    }
    let mass = curves.measures.mass_g_per_m2.to_string();
    let fit =
        ["swatch", "r.png", "t.png", "-o", "c.toml", "--geometry", "near.toml", "--fiber", "cotton", "--json", "-q"];
    let told = json(&succeed(dir, &[&fit[..], &["--g-per-m2", &mass]].concat()));
    assert_eq!(names(dir), ["c.json", "c.png", "c.toml", "near.toml", "r.png", "t.png"]);
    assert_eq!(told["fit"]["weaves"][0]["weave"], "plain", "{told}");
    let number = |name: &str| {
        let list = told["fit"]["numbers"].as_array().unwrap();
        let found = list.iter().find(|n| n["name"] == name).unwrap();
        ["value", "sd"].map(|key| found[key].as_f64().unwrap())
    };
    // A plain weave of one yarn is the same turned by a quarter.
    let is_across = told["fit"]["is_across"].as_bool().unwrap();
    let setts = if is_across { [39.0, 43.0] } else { [43.0, 39.0] };
    let wanted = [
        ("ends_per_cm", setts[0]),
        ("picks_per_cm", setts[1]),
        ("count_tex", recipe.spec.yarns()[0].tex()),
        ("color_red", color[0]),
        ("color_green", color[1]),
        ("color_blue", color[2]),
    ];
    for (name, truth) in wanted {
        let [value, sd] = number(name);
        assert!((value - truth).abs() < 3.0 * sd && sd < 0.25 * truth, "{name}: {value} +- {sd} for {truth}");
    }
    // The spec is one that the program reads.
    succeed(dir, &["weave", "c.toml"]);
}
