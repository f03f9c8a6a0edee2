//! `plywave render --fibers`: the picture of a cloth's own fibers.

use crate::common::{folder, refused, succeed, write_cloth};
use std::path::Path;

/// Mean of a picture by linear channel, of exposure -2.
fn mean(png: &Path) -> [f64; 3] {
    let image = image::open(png).unwrap().to_rgb8();
    let count = f64::from(image.width() * image.height());
    let mut sum = [0.0; 3];
    for pixel in image.pixels() {
        (0..3).for_each(|k| sum[k] += 4.0 * plywave::color::srgb_decode(f64::from(pixel[k]) / 255.0) / count);
    }
    sum
}

/// Fibers that absorb nothing are white in a white room, whatever is behind, and keep their seed's picture.
#[test]
#[ignore = "slow: 10 s: clear fibers are white in a white room"]
fn clear_fibers_are_white_in_a_white_room() {
    let dir = folder();
    write_cloth(dir.path());
    let render = |name: &str, threads: &str| {
        let args = ["render", "cloth.toml", "--fibers", "--setup", "furnace", "--sigma", "0", "--size-mm", "0.5"];
        let size = ["--width", "8", "--height", "8", "--samples", "32", "--exposure", "-2", "--no-exr", "-o", name];
        succeed(dir.path(), &[&args[..], &size, &["--threads", threads]].concat());
        std::fs::read(dir.path().join(name)).unwrap()
    };
    assert!(render("a.png", "1") == render("b.png", "2"), "another picture on two threads");
    // The illuminant's noise, and paths that are lost.
    for channel in mean(&dir.path().join("a.png")) {
        assert!((channel - 1.0).abs() < 0.05, "{channel}");
    }
}

#[test]
fn what_fibers_have_not_is_refused() {
    let dir = folder();
    write_cloth(dir.path());
    for flag in [&["--straight-gaps"][..], &["--slit-um", "1"], &["--without", "edges"]] {
        let args = [&["render", "cloth.toml", "--fibers"], flag].concat();
        refused(dir.path(), &args, &["--fibers", flag[0]]);
    }
    refused(dir.path(), &["render", "cloth.toml", "--lamp-scale", "0"], &["--lamp-scale", "0.001"]);
}

/// The model of an organza and its fibers reflect the same of a lamp, and send the same through, by pictures.
#[test]
#[ignore = "slow: 60 s: the picture of a cloth's model has the light of that of its fibers"]
fn pictures_of_model_and_fibers_have_the_same_light() {
    let dir = folder();
    let organza = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics/cloths/organza.toml");
    for setup in ["front", "back"] {
        let means = [&[][..], &["--fibers"]].map(|flags| {
            let args = ["render", organza, "--setup", setup, "--size-mm", "3", "--fov", "12", "--lamp-scale", "4"];
            let size = ["--width", "64", "--height", "64", "--samples", "128", "--exposure", "-2", "--sigma", "0.01"];
            succeed(dir.path(), &[&args[..], &size, &["--smooth", "--no-exr", "-o", "a.png"], flags].concat());
            mean(&dir.path().join("a.png"))
        });
        println!("{setup}: model {:.4?}, fibers {:.4?}", means[0], means[1]);
        for k in 0..3 {
            assert!((means[0][k] / means[1][k] - 1.0).abs() < 0.04, "{setup}: {means:?}");
        }
    }
}
