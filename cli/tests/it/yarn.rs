//! Yarns of several plies on the command line: spec, table of one ply, table of the yarn, model; the traced
//! yarn and the distance to it.

use crate::common::{TINY, folder, json, names, refused, run, succeed, text};

#[test]
#[ignore = "slow: 35 s: a yarn is built from one ply and compared with the traced yarn"]
fn a_yarn_is_built_from_one_ply_and_compared_with_the_traced_yarn() {
    let folder = folder();
    let dir = folder.path();
    std::fs::write(dir.join("yarn.toml"), format!("{TINY}\n[yarn]\nplies = 3\n")).unwrap();
    succeed(dir, &["simulate", "yarn.toml", "--preset", "preview", "-o", "one.pwt", "--quiet"]);
    let one = json(&succeed(dir, &["info", "one.pwt", "--json"]));
    assert_eq!((one["plies"].as_u64(), one["exit_positions"].as_bool()), (Some(1), Some(true)));

    // The fit makes the yarn's table first; that table, fitted, gives the same model.
    let fitted = json(&succeed(dir, &["fit", "one.pwt", "-o", "yarn.pwm", "--yarn-table", "yarn.pwt", "--json"]));
    assert_eq!(fitted["plies"], 3);
    let yarn = json(&succeed(dir, &["info", "yarn.pwt", "--json"]));
    assert_eq!((yarn["plies"].as_u64(), yarn["exit_positions"].as_bool()), (Some(3), Some(true)));
    succeed(dir, &["fit", "yarn.pwt", "-o", "again.pwm", "--quiet"]);
    assert_eq!(std::fs::read(dir.join("again.pwm")).unwrap(), std::fs::read(dir.join("yarn.pwm")).unwrap());
    let build = ["build", "yarn.toml", "--preset", "preview", "-o", "built.pwm", "--quiet"];
    succeed(dir, &[&build, crate::common::ANY_FIT].concat());
    assert_eq!(std::fs::read(dir.join("built.pwm")).unwrap(), std::fs::read(dir.join("yarn.pwm")).unwrap());
    // A table of such plies that was simulated for another yarn serves as well.
    succeed(dir, &["simulate", "tiny.toml", "--preset", "preview", "--quiet"]);
    succeed(dir, &["fit", "tiny.pwt", "--spec", "yarn.toml", "-o", "again.pwm", "--quiet"]);
    assert_eq!(std::fs::read(dir.join("again.pwm")).unwrap(), std::fs::read(dir.join("yarn.pwm")).unwrap());
    let spec = std::fs::read_to_string(dir.join("yarn.toml")).unwrap();
    std::fs::write(dir.join("other.toml"), spec.replace("eta = 1.58", "eta = 1.5")).unwrap();
    refused(dir, &["fit", "tiny.pwt", "--spec", "other.toml"], &["other.toml: [fiber]", "not that of tiny.pwt"]);
    refused(dir, &["fit", "yarn.pwt", "--spec", "yarn.toml"], &["yarn.pwt: plies = 3", "one ply"]);
    refused(dir, &["fit", "tiny.pwt", "--spec", "absent.toml"], &["absent.toml"]);
    let told = succeed(dir, &["info", "yarn.pwt"]);
    assert!(told.contains("the yarn of 3 plies") && told.contains("yarn of 3 parallel plies"), "{told}");

    // Light at sigma = 0 is kept, and another ply takes light from what went forward.
    let energies = |info: &serde_json::Value, m: usize, n: usize| {
        let e = &info["energies"];
        [&e["r_d"][m][n], &e["energy_refl"][m][n], &e["energy_high"][m][n][0]].map(|v| v.as_f64().unwrap())
    };
    for m in 0..3 {
        for n in 0..5 {
            let (a, b): (f64, f64) = (energies(&one, m, n).iter().sum(), energies(&yarn, m, n).iter().sum());
            assert!((b - 1.0).abs() < 0.02 + 2.0 * (a - 1.0).abs(), "({m}, {n}): {b}, the ply's {a}");
        }
    }

    // The traced yarn: another table of three plies; few paths, so the distance is bounded loosely here.
    let traced = json(&succeed(
        dir,
        &[
            "simulate",
            "yarn.toml",
            "--plies",
            "traced",
            "-o",
            "traced.pwt",
            "--json",
            "--seed",
            "2",
            "--preset",
            "preview",
        ],
    ));
    assert_eq!(traced["plies"], 3);
    // Few paths: the bounds are loose.
    let lax = ["--tol", "9", "--tol-energy", "0.1", "--max-h-rel", "0.95", "--json"];
    let compared = run(dir, &[&["diff", "yarn.pwt", "traced.pwt"][..], &lax].concat());
    let d = json(&text(&compared.stdout));
    assert_eq!((compared.status.code(), d["equal"].as_bool()), (Some(0), Some(true)));
    assert!(d["worst_high"][0].as_f64().unwrap() < 0.5, "{d}");
    assert!(d["energy"].as_f64().unwrap() < 0.05 && d["plies"][1] == 3, "{d}");
    assert_eq!(d["slices"].as_array().unwrap().len(), 9);
    let strict = run(dir, &["diff", "one.pwt", "traced.pwt", "--tol-energy", "1e-9"]);
    assert_eq!(strict.status.code(), Some(1));
    // The model, and the table that it was fitted to, are compared with the traced yarn at every incidence up
    // to 40 degrees.
    let checked = run(
        dir,
        &["check", "yarn.pwm", "--table", "yarn.pwt", "--traced", "traced.pwt", "--incidences", "3", "--json"],
    );
    let c = json(&text(&checked.stdout));
    let value = |name: &str| {
        let lines = c["checks"].as_array().unwrap();
        lines.iter().find(|l| l["check"] == name).unwrap_or_else(|| panic!("{name}"))["value"].as_f64().unwrap()
    };
    for (k, name) in [(0, "table_traced_sigma_0"), (1, "table_traced_sigma_0.01")] {
        let high = |part: &str, i: usize| c["traced"][part]["slices"][i]["high_relative_l2"][k].as_f64();
        let largest = |part| (0..6).filter_map(|i| high(part, i)).fold(0.0, f64::max);
        assert!((value(name) - largest("table")).abs() < 1e-12 && largest("table") < 0.8);
        assert!((value(&name.replace("table_traced", "traced_high")) - largest("model")).abs() < 1e-12);
    }
    let [table_off, model_off] = ["table_traced_energy", "traced_energy"].map(value);
    // Between five nodes the model's energies round off what the table's slices have.
    assert!(table_off < 0.05 && (model_off - table_off).abs() < 5e-3, "{table_off} {model_off}");
    // A traced table is found out: the same figures by --table alone, whose errors are the model's fit errors
    // against it.
    let told =
        json(&text(&run(dir, &["check", "yarn.pwm", "--table", "traced.pwt", "--incidences", "3", "--json"]).stdout));
    assert_eq!(told["traced"]["model"], c["traced"]["model"]);
    let told = text(&run(dir, &["check", "yarn.pwm", "--traced", "traced.pwt", "--incidences", "3"]).stdout);
    assert!(told.contains("model against the traced yarn") && told.contains("traced_high_sigma_0.01"), "{told}");
    refused(dir, &["check", "yarn.pwm", "--traced", "yarn.pwt"], &["yarn.pwt: traced = false: must be true"]);
    let of = |name: &str, from: &str, to: &str| {
        let spec = format!("{TINY}\n[yarn]\nplies = 3\n").replace(from, to);
        std::fs::write(dir.join(name).with_extension("toml"), spec).unwrap();
        let traced = ["simulate", &format!("{name}.toml"), "--plies", "traced", "--preset", "preview", "--quiet"];
        succeed(dir, &traced);
    };
    of("gray", "[0.0, 0.01, 0.1]", "[0.0, 0.1]");
    refused(dir, &["check", "yarn.pwm", "--traced", "gray.pwt"], &["gray.pwt: sigma_per_um = [0, 0.1]: needs 0.01"]);
    of("two", "plies = 3", "plies = 2");
    refused(dir, &["check", "yarn.pwm", "--traced", "two.pwt"], &["two.pwt: yarn = ", "another yarn"]);
    of("coarse", "phi_o_bins = 24", "phi_o_bins = 12");
    let both = ["check", "yarn.pwm", "--table", "yarn.pwt", "--traced", "coarse.pwt"];
    refused(dir, &both, &["coarse.pwt: axis theta_o, phi_o differs"]);
    // The model of a yarn is fitted as it is, never once more.
    succeed(dir, &["fit", "traced.pwt", "-o", "traced.pwm", "--quiet"]);
    assert!(names(dir).iter().all(|n| !n.ends_with(".parts")));
}

#[test]
fn what_makes_no_yarn_is_refused() {
    let folder = folder();
    let dir = folder.path();
    refused(
        dir,
        &["simulate", "tiny.toml", "--plies", "traced"],
        &["tiny.toml: yarn.plies = 1: --plies traced needs 2"],
    );
    std::fs::write(dir.join("bad.toml"), format!("{TINY}\n[yarn]\nplies = 4\nply_pitch_um = 100\n")).unwrap();
    refused(
        dir,
        &["simulate", "bad.toml"],
        &["bad.toml: yarn.ply_pitch_um = 100: 4 plies of radius 40 um intersect", "use 32"],
    );
    succeed(dir, &["simulate", "tiny.toml", "--quiet", "--preset", "preview"]);
    refused(dir, &["fit", "tiny.pwt", "--yarn-table", "yarn.pwt"], &["tiny.pwt: plies = 1: there is no yarn to make"]);
    refused(dir, &["diff", "tiny.pwt", "tiny.pwt", "--tol-drift", "1"], &["--tol-drift is for models"]);
    refused(dir, &["diff", "tiny.pwt", "tiny.toml"], &["tiny.toml"]);
    refused(dir, &["diff", "tiny.pwt", "tiny.pwt", "--max-h-rel", "-1"], &["--max-h-rel"]);
}
