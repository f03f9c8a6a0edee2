//! `plywave noise` and `plywave color`: from fibers to a model with noise, told and drawn; bad input refused
//! in one line.

use crate::common::{ANY_FIT, TINY, run, succeed, text};
use std::path::Path;

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).expect("JSON")
}

fn refused(dir: &Path, args: &[&str], words: &[&str]) {
    let output = run(dir, args);
    let err = text(&output.stderr);
    assert_eq!((output.status.code(), err.lines().count()), (Some(2), 1), "{args:?}: {err}");
    for word in words {
        assert!(err.contains(word), "{args:?}: {err} has no {word}");
    }
}

/// The whole path: fibers, a model, its noise, pictures; contrast and covariance of what is synthesized are
/// those of the fibers. Then colors.
#[test]
#[ignore = "slow: 10 s: fibers give a model noise"]
fn fibers_give_a_model_noise() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    // Nodes enough for what a ply sends on to a second layer.
    let jittered = TINY.replace("[fiber]", "[fiber]\nsize_jitter = 0.05").replace("h_nodes = 5", "h_nodes = 9");
    std::fs::write(dir.join("tiny.toml"), &jittered).unwrap();
    std::fs::write(dir.join("other.toml"), jittered.replace("radius_um = 7.5", "radius_um = 5.0")).unwrap();
    let speckle = ["wave", "speckle", "--instances", "40", "--lambda", "0.5,0.6", "--quiet"];
    succeed(dir, &[&speckle[..], &["tiny.toml"]].concat());
    succeed(dir, &[&["build", "tiny.toml", "--preset", "preview", "--quiet"], ANY_FIT].concat());

    let told = succeed(dir, &["noise", "tiny.pws", "-m", "tiny.pwm"]);
    assert!(told.contains("tiny-noise.pwm") && told.contains("contrast"), "{told}");
    let again = json(&succeed(dir, &["noise", "tiny.pws", "-m", "tiny.pwm", "-o", "again.pwm", "--json"]));
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert_eq!(read("again.pwm"), read("tiny-noise.pwm"));
    let bare = read("tiny.pwm").len() as u64;
    assert!(again["bytes"].as_u64().unwrap() < bare + 10_000, "{again} of {bare}");
    // Two kinds at two wavelengths; the high-order light of 40 round fibers to what 40 instances give.
    let lines = again["lines"].as_array().unwrap();
    assert_eq!(lines.len(), 4);
    for line in lines.iter().filter(|l| l["kind"] == "high") {
        let [a, b] = ["contrast_simulated", "contrast_synthesized"].map(|k| line[k].as_f64().unwrap());
        assert!(a > 0.2 && (b / a - 1.0).abs() < 0.05, "{line}");
        assert!(line["covariance_distance"][0].as_f64().unwrap() < 0.1, "{line}");
    }
    let contrast = again["fields"][1]["contrast"].as_f64().unwrap();
    assert!((contrast / again["fields"][1]["contrast_simulated"].as_f64().unwrap() - 1.0).abs() < 0.05);

    succeed(dir, &["plot", "tiny-noise.pwm", "--part", "noise", "--quiet"]);
    succeed(dir, &["plot", "tiny.pws", "--quiet"]);
    assert!(read("tiny-noise.png").starts_with(b"\x89PNG") && read("tiny.png").starts_with(b"\x89PNG"));
    succeed(dir, &["check", "tiny-noise.pwm", "--max-error-refl", "9", "--max-error-high", "9"]);

    refused(dir, &["plot", "tiny.pwm", "--part", "noise"], &["tiny.pwm", "noise_spectrum", "plywave noise"]);
    refused(dir, &["noise", "tiny.pws", "-m", "tiny.pwm", "--w0", "0"], &["--w0"]);
    refused(dir, &["noise", "tiny.pws", "-m", "tiny.pwm", "-o", "tiny.pwm"], &["tiny.pwm"]);
    refused(dir, &["noise", "tiny.pwm", "-m", "tiny.pwm"], &["tiny.pwm", "speckle patterns"]);
    succeed(dir, &["wave", "speckle", "other.toml", "--instances", "2", "--lambda", "0.6", "--quiet"]);
    refused(dir, &["noise", "other.pws", "-m", "tiny.pwm"], &["other.pws", "[fiber]", "tiny.pwm"]);
    succeed(
        dir,
        &[
            "wave",
            "speckle",
            "tiny.toml",
            "-o",
            "clear.pws",
            "--instances",
            "2",
            "--lambda",
            "0.6",
            "--kappa",
            "0",
            "--quiet",
        ],
    );
    refused(dir, &["noise", "clear.pws"], &["clear.pws", "kappa", "--kappa"]);

    let color = json(&succeed(dir, &["color", "tiny.pwm", "--srgb", "0.8,0.65,0.6", "--json"]));
    assert!(color["delta_e"].as_f64().unwrap() < 0.1 && color["clamped_to_dark"] == 0, "{color}");
    let sigma: Vec<f64> = color["sigma_per_um"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    // A red yarn absorbs more blue light than red light.
    assert!(sigma.len() == 81 && sigma[10] > sigma[60] && sigma[60] >= 0.0, "{sigma:?}");
    let white = json(&succeed(dir, &["color", "tiny.pwm", "--reflectance", "1", "--json"]));
    let range = white["albedo_range"][1].as_f64().unwrap();
    assert!((range - 1.0).abs() < 0.02 && white["sigma_per_um"][5].as_f64().unwrap() < 1e-3, "{white}");
    let black = succeed(dir, &["color", "tiny.pwm", "--reflectance", "0", "--theta-i", "30"]);
    assert!(black.contains("81 of 81 wavelengths are darker"), "{black}");
    refused(dir, &["color", "tiny.pwm", "--srgb", "0.5,0.5"], &["--srgb", "three"]);
    refused(dir, &["color", "tiny.pwm", "--srgb", "0.5,0.5,1.5"], &["--srgb", "1.5", "0 to 1"]);
    refused(dir, &["color", "tiny.pwm", "--reflectance", "-0.1"], &["--reflectance"]);
    refused(dir, &["color", "tiny.pwm"], &["--srgb"]);
}
