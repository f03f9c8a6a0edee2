//! `plywave twin`, and `plywave check` of a cloth against it: what is written, what is said, what is
//! refused.

use crate::common::{json, refused, run, succeed, text};
use std::path::Path;

/// Two straight layers of the polyester that ships.
fn cloth(folder: &Path, per_cm: u32) {
    let spec = format!(
        "name = \"layers\"\n[weave]\nkind = \"layers\"\nends_per_cm = {per_cm}\npicks_per_cm = {per_cm}\n\
         [warp]\nmodel = \"polyester.pwm\"\nfiber = \"polyester\"\ncount = \"6.503 tex\"\npacking = 0.6\n\
         sigma_per_um = 0.01\n[weft]\nas = \"warp\"\n"
    );
    std::fs::write(folder.join("layers.toml"), spec).unwrap();
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/models/polyester.pwm");
    std::fs::copy(model, folder.path().join("polyester.pwm")).unwrap();
    cloth(folder.path(), 90);
    folder
}

const SMALL: &[&str] =
    &["twin", "layers.toml", "--paths", "640", "--views", "0,60:0,150:90", "--repeats", "7,7", "--points", "12"];

#[test]
#[ignore = "slow: 25 s: a twin is traced told and compared"]
fn a_twin_is_traced_told_and_compared() {
    let folder = folder();
    let at = folder.path();
    let told = json(&succeed(at, &[SMALL, &["--json"]].concat()));
    assert_eq!(told["views"].as_array().unwrap().len(), 3);
    assert!(told["triangles"].as_f64().unwrap() > 1e5 && told["pitches"].as_array().unwrap().len() == 2);
    let view = &told["views"][2];
    assert_eq!(
        [view["tilt_deg"].as_f64().unwrap().round(), view["azimuth_deg"].as_f64().unwrap().round()],
        [150.0, 90.0]
    );
    let light = |k: usize, key: &str| view["light"][k][key].as_f64().unwrap();
    let straight = view["straight"].as_f64().unwrap() + view["killed"].as_f64().unwrap();
    assert!((light(0, "reflected") + light(0, "transmitted") + straight - 1.0).abs() < 1e-9);
    assert!(light(2, "reflected") < light(1, "reflected"));
    assert!(std::fs::metadata(at.join("layers.pwx")).unwrap().len() < 1_000_000);
    assert_eq!(json(&succeed(at, &["info", "layers.pwx", "--json"]))["views"], told["views"]);
    assert!(succeed(at, &["info", "layers.pwx"]).contains("twin of a cloth"));

    // The noise of so few paths decides whether the model passes; it is told either way.
    let output = run(at, &["check", "layers.toml", "--twin", "layers.pwx", "--json"]);
    let report = json(&text(&output.stdout));
    let passed = report["passed"].as_bool().unwrap();
    assert_eq!(output.status.code(), Some(i32::from(!passed)), "{}", text(&output.stderr));
    let views = report["views"].as_array().unwrap();
    assert_eq!(views.len(), 9);
    for (i, line) in views.iter().enumerate() {
        assert_eq!(line["twin"]["straight"], told["views"][i / 3]["straight"]);
        let model: f64 =
            ["reflected", "transmitted", "straight"].iter().map(|k| line["model"][k].as_f64().unwrap()).sum();
        assert!(model > 0.1 && model < 1.2, "{line}");
    }
    let lines = text(&run(at, &["check", "layers.toml", "--twin", "layers.pwx"]).stdout);
    assert!(lines.contains("L2 upper") && lines.lines().count() == 12, "{lines}");
}

#[test]
#[ignore = "slow: 5 s: shares make the same file"]
fn shares_make_the_same_file() {
    let folder = folder();
    let at = folder.path();
    succeed(at, &[SMALL, &["-o", "whole.pwx", "--quiet"]].concat());
    let plan = json(&succeed(at, &[SMALL, &["--plan", "--json"]].concat()));
    assert_eq!((plan["kind"].as_str(), plan["shards"].as_u64()), (Some("twin"), Some(96)));
    for part in ["1/2", "2/2"] {
        succeed(at, &[SMALL, &["--shards", part, "--quiet", "-o", &part[..1]]].concat());
    }
    succeed(at, &["merge", "1", "2", "-o", "merged.pwx", "--quiet"]);
    let read = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(read("whole.pwx") == read("merged.pwx"));
}

#[test]
#[ignore = "slow: 6 s: what cannot be traced is refused in one line"]
fn what_cannot_be_is_refused_in_one_line() {
    let folder = folder();
    let at = folder.path();
    refused(at, &["twin", "polyester.pwm"], &["polyester.pwm", "expected a cloth spec"]);
    refused(at, &["twin", "layers.toml", "--views", "90"], &["--views", "not 90"]);
    refused(at, &["twin", "layers.toml", "--sigma", "-1"], &["--sigma"]);
    refused(at, &["twin", "layers.toml", "--repeats", "0,1"], &["--repeats"]);
    refused(at, &["check", "layers.toml"], &["--twin", "plywave twin"]);
    refused(
        at,
        &["check", "layers.toml", "--twin", "polyester.pwm"],
        &["polyester.pwm", "expected the twin of a cloth"],
    );
    succeed(at, &["twin", "layers.toml", "--paths", "32", "--views", "0", "--repeats", "7,7", "--quiet"]);
    cloth(at, 80);
    let args = ["check", "layers.toml", "--twin", "layers.pwx", "--quiet"];
    refused(at, &args, &["layers.toml", "cell_um", "plywave twin"]);
}
