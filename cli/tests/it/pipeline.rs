//! The whole path on a tiny ply: build, then every command that reads what it made.

use crate::common::{ANY_FIT, build, folder, json, names, plywave, run, succeed, text};
use std::io::Read;
use std::process::Stdio;

#[test]
fn build_makes_what_every_command_reads() {
    let folder = folder();
    let dir = folder.path();
    // Nodes enough for what a ply sends on to a second layer.
    let spec = crate::common::TINY.replace("h_nodes = 5", "h_nodes = 9");
    std::fs::write(dir.join("tiny.toml"), &spec).unwrap();
    let built = ["build", "tiny.toml", "--preset", "preview", "--keep-table", "--json"];
    let built = json(&succeed(dir, &[&built[..], ANY_FIT].concat()));
    assert_eq!(names(dir), ["tiny.pwm", "tiny.pwt", "tiny.toml"]);
    assert_eq!(built["bytes"], std::fs::metadata(dir.join("tiny.pwm")).unwrap().len());
    let balance = built["energy_balance_max_standard_errors"].as_f64().unwrap();
    assert!(balance > 0.0 && balance < 5.0, "energy is out of balance by {balance} standard errors");

    // The table says what the spec asked for, and its energies add up.
    let table = json(&succeed(dir, &["info", "tiny.pwt", "--json"]));
    assert_eq!(table["kind"], "table");
    assert_eq!(table["name"], "tiny");
    assert_eq!(table["spec"].as_str().unwrap(), spec);
    assert_eq!((table["theta_o_bins"].as_u64(), table["phi_o_bins"].as_u64()), (Some(12), Some(24)));
    assert_eq!(table["ply_radius_um"], 40.0);
    let at = |v: &serde_json::Value, i: usize, j: usize| v[i][j].as_f64().unwrap();
    for i in 0..3 {
        for j in 0..9 {
            let e = &table["energies"];
            let sum = at(&e["r_d"], i, j) + at(&e["energy_refl"], i, j) + e["energy_high"][i][j][0].as_f64().unwrap();
            assert!((sum - 1.0).abs() < 0.05, "({i}, {j}): {sum}");
        }
    }
    // The model's energies are those of the table's fine grids, which have rays of their own: as far from the
    // slices' as the noise of few paths is.
    let model = json(&succeed(dir, &["info", "tiny.pwm", "--json"]));
    assert_eq!(model["kind"], "model");
    for (i, j) in (0..3).flat_map(|i| (0..9).map(move |j| (i, j))) {
        let [a, b] = [&model, &table].map(|of| at(&of["energies"]["energy_refl"], i, j));
        assert!((a - b).abs() < 0.03, "({i}, {j}): {a}, table {b}");
    }
    assert_eq!((model["lobes_refl"].as_u64(), model["lobes_high"].as_u64()), (Some(1), Some(2)));
    for file in ["tiny.pwt", "tiny.pwm"] {
        let told = succeed(dir, &["info", file]);
        assert!(told.contains("12 fibers") && told.contains("seed 1"), "{told}");
    }

    // fit of the kept table gives the same model.
    succeed(dir, &["fit", "tiny.pwt", "-o", "again.pwm", "--quiet"]);
    assert_eq!(std::fs::read(dir.join("again.pwm")).unwrap(), std::fs::read(dir.join("tiny.pwm")).unwrap());
    assert_eq!(run(dir, &["diff", "tiny.pwm", "again.pwm"]).status.code(), Some(0));

    // check passes what does not depend on the quality of the fit, and fails where the fit is held to more
    // than it can.
    let lax = ["--max-error-refl", "9", "--max-error-high", "9", "--incidences", "12"];
    let checked = json(&succeed(dir, &[&["check", "tiny.pwm", "--table", "tiny.pwt", "--json"][..], &lax].concat()));
    assert_eq!(checked["passed"], true);
    assert_eq!(checked["slices"].as_array().unwrap().len(), 27);
    let strict = run(dir, &["check", "tiny.pwm", "--max-error-high", "0", "--incidences", "2"]);
    assert_eq!(strict.status.code(), Some(1));
    assert!(text(&strict.stdout).contains("FAIL  fit_error_high"), "{}", text(&strict.stdout));
}

/// A fit beyond what `check` allows: said on stderr, the model kept, exit code 1.
#[test]
#[ignore = "slow: 5 s: bad fits are told"]
fn bad_fits_are_told() {
    let folder = folder();
    let dir = folder.path();
    let output = run(dir, &["build", "tiny.toml", "--preset", "preview", "--quiet"]);
    let err = text(&output.stderr);
    assert_eq!((output.status.code(), err.lines().count()), (Some(1), 1), "{err}");
    for word in ["tiny.pwm", "bad fit", "f_refl", "f_high", "allowed 0.15", "lobes_high"] {
        assert!(err.contains(word), "no {word} in {err}");
    }
    assert_eq!(names(dir), ["tiny.pwm", "tiny.toml"]);
    // The same by the check of the model.
    let checked = json(&text(&run(dir, &["check", "tiny.pwm", "--json", "--incidences", "2"]).stdout));
    assert_eq!(checked["passed"], false);
}

#[test]
#[ignore = "slow: 5 s: diff tells two seeds apart"]
fn diff_tells_two_seeds_apart() {
    let folder = folder();
    let dir = folder.path();
    build(dir);
    let two = ["build", "tiny.toml", "--preset", "preview", "--seed", "2", "-o", "two.pwm", "--quiet"];
    succeed(dir, &[&two[..], ANY_FIT].concat());
    let same = json(&succeed(dir, &["diff", "tiny.pwm", "tiny.pwm", "--tol", "0", "--tol-energy", "0", "--json"]));
    assert_eq!((same["equal"].as_bool(), same["worst_relative_l2"].as_f64()), (Some(true), Some(0.0)));
    let other = run(dir, &["diff", "tiny.pwm", "two.pwm", "--tol", "1e-9", "--json"]);
    assert_eq!(other.status.code(), Some(1));
    let other = json(&text(&other.stdout));
    assert!(other["worst_relative_l2"].as_f64().unwrap() > 1e-3, "{other}");
}

#[test]
#[ignore = "slow: 5 s: eval and sample agree with each other"]
fn eval_and_sample_agree_with_each_other() {
    let folder = folder();
    let dir = folder.path();
    build(dir);
    let at = ["--theta-i", "25", "--h-rel", "-0.3", "--sigma", "0", "0.01"];
    let drawn = json(&succeed(dir, &[&["sample", "tiny.pwm", "-n", "50", "--json"][..], &at].concat()));
    let samples = drawn["samples"].as_array().unwrap();
    assert_eq!(samples.len() as u64 + drawn["missed"].as_u64().unwrap(), 50);
    for sample in samples.iter().take(5) {
        let number = |key: &str| sample[key].as_f64().unwrap();
        let (theta, phi) = (number("theta_o_deg").to_string(), number("phi_o_deg").to_string());
        let args = [&["eval", "tiny.pwm", "--json", "--theta-o", &theta, "--phi-o", &phi][..], &at].concat();
        let value = json(&succeed(dir, &args));
        let close = |a: f64, b: f64, what: &str| assert!((a - b).abs() <= 2e-3 * (a.abs() + 1e-3), "{what}: {a} {b}");
        close(value["pdf_per_sr"].as_f64().unwrap(), number("pdf_per_sr"), "pdf");
        for k in 0..2 {
            let f = value["f_per_sr"][k].as_f64().unwrap();
            close(f, sample["weight"][k].as_f64().unwrap() * number("pdf_per_sr"), "f = weight pdf");
            let (refl, high) = (value["refl_per_sr"].as_f64().unwrap(), value["high_per_sr"][k].as_f64().unwrap());
            close(f, refl + high, "f = f_refl + f_high");
        }
    }
    // CSV has a line a hit and the same numbers.
    let csv = succeed(dir, &[&["sample", "tiny.pwm", "-n", "50"][..], &at].concat());
    assert_eq!(csv.lines().count(), samples.len() + 1);
    assert_eq!(csv.lines().next(), Some("theta_o_deg,phi_o_deg,pdf_per_sr,weight_0,weight_1"));
    let first: f64 = csv.lines().nth(1).unwrap().split(',').next().unwrap().parse().unwrap();
    assert!((first - samples[0]["theta_o_deg"].as_f64().unwrap()).abs() < 1e-3);
}

#[test]
#[ignore = "slow: 5 s: plots are whole png files"]
fn plots_are_whole_png_files() {
    let folder = folder();
    let dir = folder.path();
    build(dir);
    let runs: &[&[&str]] = &[
        &["plot", "tiny.pwt", "-o", "a.png"],
        &["plot", "tiny.toml", "-o", "a.png", "--gap", "3,20,1,0", "--tilt", "30"],
        &["plot", "tiny.toml", "-o", "a.png", "--part", "edge"],
        &["plot", "tiny.pwm", "-o", "a.png", "--part", "energy"],
        &["plot", "tiny.pwm", "--table", "tiny.pwt", "-o", "a.png"],
        &["plot", "tiny.pwt", "--model", "tiny.pwm", "-o", "a.png", "--part", "errors"],
        &[
            "plot",
            "tiny.pwm",
            "--theta-i",
            "30",
            "--h-rel",
            "0.5",
            "--sigma",
            "0",
            "0.01",
            "-o",
            "a.png",
            "--part",
            "maps",
        ],
    ];
    for args in runs {
        let told = json(&succeed(dir, &[args, &["--json"][..]].concat()));
        let bytes = std::fs::read(dir.join("a.png")).unwrap();
        let image = image::load_from_memory(&bytes).unwrap_or_else(|e| panic!("{args:?}: {e}")).to_rgb8();
        assert_eq!(
            (told["width"].as_u64(), told["height"].as_u64()),
            (Some(image.width().into()), Some(image.height().into()))
        );
        let inked = image.pixels().filter(|p| p.0 != [255, 255, 255]).count();
        assert!(inked * 20 > (image.width() * image.height()) as usize, "{args:?}: an empty page");
        std::fs::remove_file(dir.join("a.png")).unwrap();
    }
}

#[test]
#[ignore = "slow: 5 s: quiet is quiet and help is help"]
fn quiet_is_quiet_and_help_is_help() {
    let folder = folder();
    let dir = folder.path();
    let output = run(dir, &[&["build", "tiny.toml", "--preset", "preview", "--quiet"][..], ANY_FIT].concat());
    assert!(output.status.success() && output.stdout.is_empty() && output.stderr.is_empty());
    let help = succeed(dir, &["--help"]);
    for command in ["simulate", "fit", "build", "info", "eval", "sample", "check", "diff", "plot"] {
        assert!(help.contains(command), "no {command} in {help}");
        let told = succeed(dir, &[command, "--help"]);
        assert!(told.contains("Usage: plywave") && told.contains("--json") && told.contains("--quiet"), "{told}");
    }
    assert!(succeed(dir, &["eval", "--help"]).contains("[degrees]"));
    assert_eq!(succeed(dir, &["--version"]), format!("plywave {}\n", env!("CARGO_PKG_VERSION")));
}

#[test]
#[ignore = "slow: 5 s: a reader that goes away is no error"]
fn a_reader_that_goes_away_is_no_error() {
    let folder = folder();
    let dir = folder.path();
    build(dir);
    let mut child = plywave(dir, &["sample", "tiny.pwm", "--theta-i", "0", "--h-rel", "0", "-n", "1000000"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = [0u8; 100];
    child.stdout.take().unwrap().read_exact(&mut first).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", output.status);
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
}
