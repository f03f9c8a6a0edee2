//! Bad input: one line on stderr that names file, key and hint, exit code 2, nothing written.

use crate::common::{STRANDS, TINY, build, folder, refused, write_cloth};

#[test]
fn specs_are_refused_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    refused(dir, &["build", "none.toml"], &["none.toml", "no such file"]);
    refused(dir, &["simulate", "."], &["."]);
    let edits: &[(&str, &str, &[&str])] = &[
        ("fibers = 12", "fibres = 12", &["fibres"]),
        ("fibers = 12", "fibers = -3", &["fibers", "-3"]),
        ("fibers = 12", "fibers = 200", &["200"]),
        ("radius_um = 7.5", "radius_um = -7.5", &["radius_um", "-7.5"]),
        ("radius_um = 7.5", "radius_mm = 0.0075", &["radius_mm"]),
        ("radius_um = 7.5", "radius_um = \"7.5 um\"", &["radius_um"]),
        ("radius_um = 7.5", "radius_um = nan", &["radius_um", "nan"]),
        ("\"circle\"", "\"banana\"", &["banana"]),
        ("eta = 1.58", "", &["eta"]),
        ("eta = 1.58", "eta = 0.9", &["fiber.eta", "0.9", "kappa"]),
        ("eta = 1.58", "eta = 0.4\nkappa = -2.4", &["fiber.kappa", "-2.4"]),
        ("eta = 1.58", "eta = 0.4\nkappa = nan", &["fiber.kappa", "nan"]),
        ("eta = 1.58", "metal = \"unobtainium\"", &["fiber.metal", "unobtainium", "gold"]),
        ("eta = 1.58", "eta = 1.58\nmetal = \"gold\"", &["fiber.eta", "either"]),
        ("eta = 1.58", "metal = \"gold\"\ndispersion_um2 = 0.01", &["fiber.dispersion_um2"]),
        ("eta = 1.58", "eta = 1.58\ndispersion_um2 = -0.01", &["fiber.dispersion_um2", "-0.01"]),
        ("\"circle\", radius_um = 7.5", "\"hollow_circle\", radius_um = 7.5", &["fiber.shape.lumen"]),
        (
            "\"circle\", radius_um = 7.5",
            "\"hollow_circle\", radius_um = 7.5, lumen = 1.2",
            &["fiber.shape.lumen", "1.2"],
        ),
        (
            "\"circle\", radius_um = 7.5",
            "\"hollow_circle\", radius_um = 7.5, lumen = -0.1",
            &["fiber.shape.lumen", "-0.1"],
        ),
        (
            "\"circle\", radius_um = 7.5",
            "\"hollow_circle\", radius_um = 7.5, lumen = 0.5, lumen_eta = 0.5",
            &["fiber.shape.lumen_eta", "0.5"],
        ),
        ("[ply]", "[blend]\nshare = 1.5\n[ply]", &["blend.share", "1.5"]),
        ("[ply]", "[blend]\nshare = [0.7, 0.6]\n[ply]", &["blend.share"]),
        ("[ply]", "[blend]\nshare = 0.5\n[ply]", &["blend.fiber"]),
        (
            "[ply]",
            "[blend]\nshare = 0.5\n[blend.fiber]\nshape = { kind = \"circle\", radius_um = 7.5 }\nmetal = \"gold\"\nalpha_fiber = 0.2\n[ply]",
            &["blend.fiber.metal", "opaque"],
        ),
        ("h_nodes = 5", "h_nodes = 4", &["h_nodes", "4"]),
        ("paths_per_theta = 6000", "paths_per_theta = 0", &["paths_per_theta", "0"]),
        ("[0.0, 0.01, 0.1]", "[0.1, 0.01]", &["sigma_per_um"]),
        ("name = \"tiny\"", "name = ", &["line"]),
    ];
    for (from, to, words) in edits {
        assert!(TINY.contains(from), "{from}");
        std::fs::write(dir.join("bad.toml"), TINY.replace(from, to)).unwrap();
        for command in ["build", "simulate"] {
            let mut all = vec!["bad.toml"];
            all.extend(*words);
            refused(dir, &[command, "bad.toml", "--preset", "preview"], &all);
        }
    }
    std::fs::write(dir.join("bad.toml"), [0xff, 0xfe, 0x00, 0x41]).unwrap();
    refused(dir, &["build", "bad.toml"], &["bad.toml"]);
}

#[test]
fn files_are_refused_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    build(dir);
    let (model, table) = (std::fs::read(dir.join("tiny.pwm")).unwrap(), std::fs::read(dir.join("tiny.pwt")).unwrap());
    let all_of = |file: &str, words: &[&str]| {
        let mut all = vec![file];
        all.extend(words);
        for args in [&["info", file][..], &["plot", file, "-o", "out.png"]] {
            refused(dir, args, &all);
        }
        if file.ends_with("pwm") {
            let at = ["--theta-i", "0", "--h-rel", "0"];
            refused(dir, &[&["eval", file, "--theta-o", "0", "--phi-o", "0"][..], &at].concat(), &all);
            refused(dir, &[&["sample", file][..], &at].concat(), &all);
            refused(dir, &["check", file], &all);
            refused(dir, &["diff", file, "tiny.pwm"], &all);
            refused(dir, &["diff", "tiny.pwm", file], &all);
        } else {
            refused(dir, &["fit", file, "-o", "out.pwm"], &all);
            refused(dir, &["check", "tiny.pwm", "--table", file], &all);
        }
    };
    for (file, good) in [("bad.pwm", &model), ("bad.pwt", &table)] {
        let write = |bytes: &[u8], words: &[&str]| {
            std::fs::write(dir.join(file), bytes).unwrap();
            all_of(file, words);
        };
        write(&[], &[]);
        write(&good[..5], &[]);
        write(&good[..good.len() / 2], &[]);
        write(&good[..good.len() - 1], &[]);
        write(b"\x89PNG\r\n\x1a\n and so on, which is no table of anything", &[]);
        write(&[0xff; 64], &[]);
        // A header of 2^60 bytes.
        write(&[&(1u64 << 60).to_le_bytes()[..], &good[8..]].concat(), &[]);
        // Not a number, in the last array.
        let mut bytes = good.clone();
        let end = bytes.len();
        bytes[end - 8..].fill(0xff);
        write(&bytes, &[]);
        let swap = |from: &str, to: &str| {
            let at = good.windows(from.len()).position(|w| w == from.as_bytes()).unwrap_or_else(|| panic!("no {from}"));
            let mut bytes = good.clone();
            bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
            bytes
        };
        write(&swap("\"shape\":[3,5]", "\"shape\":[5,3]"), &[]);
        let version = if file.ends_with("pwm") { 3 } else { 1 };
        write(&swap(&format!("\\\"version\\\":{version}"), "\\\"version\\\":9"), &["version"]);
        write(&swap("\\\"format\\\":\\\"plywave", "\\\"format\\\":\\\"plyweve"), &[]);
        std::fs::remove_file(dir.join(file)).unwrap();
    }
    refused(dir, &["info", "none.pwm"], &["none.pwm", "no such file"]);
    refused(dir, &["fit", "tiny.pwm", "-o", "x.pwm"], &["tiny.pwm"]);
    refused(dir, &["check", "tiny.pwt"], &["tiny.pwt"]);
    refused(dir, &["check", "tiny.pwm", "--table", "tiny.pwm"], &["tiny.pwm"]);
    refused(dir, &["plot", "tiny.pwt", "--table", "tiny.pwt"], &["--table", "--model"]);
    refused(dir, &["plot", "tiny.pwm", "--model", "tiny.pwm"], &["--model", "--table"]);
}

#[test]
fn values_are_refused_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    build(dir);
    let eval = |theta_i: &str, h: &str, sigma: &str, theta_o: &str, phi_o: &str, words: &[&str]| {
        let args = [
            "eval",
            "tiny.pwm",
            "--theta-i",
            theta_i,
            "--h-rel",
            h,
            "--sigma",
            sigma,
            "--theta-o",
            theta_o,
            "--phi-o",
            phi_o,
        ];
        refused(dir, &args, words);
    };
    eval("91", "0", "0", "0", "0", &["--theta-i", "91", "-90 to 90"]);
    eval("nan", "0", "0", "0", "0", &["--theta-i"]);
    eval("0", "1.6", "0", "0", "0", &["--h-rel", "1.6", "1.5"]);
    eval("0", "inf", "0", "0", "0", &["--h-rel"]);
    eval("0", "0", "-1", "0", "0", &["-1"]);
    eval("0", "0", "nan", "0", "0", &["--sigma"]);
    eval("0", "0", "0", "-90.5", "0", &["--theta-o"]);
    eval("0", "0", "0", "0", "inf", &["--phi-o"]);
    eval("x", "0", "0", "0", "0", &["--theta-i", "x"]);
    let at = ["--theta-i", "0", "--h-rel", "0"];
    refused(dir, &[&["sample", "tiny.pwm", "-n", "0"][..], &at].concat(), &["0"]);
    refused(dir, &[&["sample", "tiny.pwm", "--sigma", "0", "1", "2", "3", "4"][..], &at].concat(), &["4"]);
    refused(dir, &["diff", "tiny.pwm", "tiny.pwm", "--tol", "-1"], &["-1"]);
    refused(dir, &["plot", "tiny.pwm", "--theta-i", "-10"], &["--theta-i", "mirror"]);
    refused(dir, &["plot", "tiny.pwm", "--h-rel", "7"], &["--h-rel"]);
    refused(dir, &["plot", "tiny.pwm", "--gap", "3,5"], &["--gap", "spec"]);
    refused(dir, &["plot", "tiny.toml", "--gap=-3,5"], &["--gap", "above 0"]);
    refused(dir, &["plot", "tiny.toml", "--gap", "3,5,1"], &["--gap", "center"]);
    refused(dir, &["plot", "tiny.toml", "--tilt", "95"], &["--tilt", "80"]);
    refused(dir, &["build", "tiny.toml", "--threads", "0"], &["--threads"]);
    refused(dir, &["build", "tiny.toml", "--preset", "best"], &["best", "preview"]);
    refused(dir, &["buidl"], &["buidl"]);
    refused(dir, &[], &["--help"]);
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let folder = folder();
    let dir = folder.path();
    build(dir);
    // At reference quality the work itself would take hours.
    let long = ["--preset", "reference", "--paths", "1000000000"];
    for output in ["none/x.pwm", ".", "tiny.toml/x.pwm"] {
        refused(dir, &[&["build", "tiny.toml", "-o", output][..], &long].concat(), &["-o"]);
        refused(dir, &[&["simulate", "tiny.toml", "-o", output][..], &long].concat(), &["-o"]);
        refused(dir, &["fit", "tiny.pwt", "-o", output], &["-o"]);
        refused(dir, &["plot", "tiny.pwm", "-o", output], &["-o"]);
    }
    refused(dir, &[&["build", "tiny.toml", "-o", "x.pwt", "--keep-table"][..], &long].concat(), &["--keep-table"]);
    // A folder of something else where the shards would go is left alone.
    std::fs::create_dir(dir.join("x.pwm.parts")).unwrap();
    std::fs::write(dir.join("x.pwm.parts/diary.txt"), "dear diary").unwrap();
    refused(dir, &[&["build", "tiny.toml", "-o", "x.pwm"][..], &long].concat(), &["x.pwm.parts"]);
    assert!(dir.join("x.pwm.parts/diary.txt").exists());
}

/// Pipes, which nobody writes to, and links to devices without end are refused at once, whatever names them.
#[cfg(unix)]
#[test]
fn endless_inputs_are_refused_at_once() {
    use std::os::unix::fs::symlink;
    let folder = folder();
    let dir = folder.path();
    write_cloth(dir);
    assert!(std::process::Command::new("mkfifo").arg(dir.join("pipe")).status().unwrap().success());
    symlink("pipe", dir.join("linked_pipe")).unwrap();
    symlink("/dev/zero", dir.join("zero")).unwrap();
    std::fs::write(dir.join("few.toml"), STRANDS).unwrap();
    let of_file =
        STRANDS.replace("make = { kind = \"fur\", count = 20, size_mm = 10.0, length_mm = 5.0 }", "file = \"zero\"");
    std::fs::write(dir.join("of_file.toml"), of_file.replace("segments = 8\n", "")).unwrap();
    let begun = std::time::Instant::now();
    let not_regular = "not a regular file";
    for input in ["pipe", "linked_pipe", "zero", "."] {
        for command in [
            &["render", input, "-o", "a.png"][..],
            &["render", "few.toml", "-o", "a.png", "--sky", input],
            &["build", input],
            &["plot", input],
            &["info", input],
            &["fit", input],
            &["weave", input],
            &["color", input, "--srgb", "0.5,0.5,0.5"],
            &["wave", "scatter", input],
            &["wave", "tabulate", input],
        ] {
            refused(dir, command, &[input, not_regular]);
        }
    }
    refused(dir, &["render", "of_file.toml", "-o", "a.png"], &["zero", not_regular]);
    refused(dir, &["render", "cloth.pwc", "-o", "a.png", "--mesh", "linked_pipe"], &["linked_pipe", not_regular]);
    assert!(begun.elapsed().as_secs() < 60, "{:?}", begun.elapsed());
}

/// A cloth whose model is a link to a place that its spec may not name.
#[cfg(unix)]
#[test]
fn links_out_of_a_spec_s_folder_are_refused() {
    let folder = folder();
    let dir = folder.path();
    let inner = dir.join("inner");
    std::fs::create_dir(&inner).unwrap();
    write_cloth(&inner);
    std::fs::rename(inner.join("models/cotton.pwm"), dir.join("cotton.pwm")).unwrap();
    std::os::unix::fs::symlink("../../cotton.pwm", inner.join("models/cotton.pwm")).unwrap();
    for command in [&["weave", "inner/cloth.toml", "-o", "a.pwc"][..], &["render", "inner/cloth.toml", "-o", "a.png"]] {
        refused(dir, command, &["cotton.pwm", "leads out of the folder"]);
    }
}

#[test]
fn exports_are_refused_before_the_cloth_is_made() {
    let folder = folder();
    let dir = folder.path();
    let cloth = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics/cloths/organza.toml");
    refused(dir, &["export", "tiny.toml", "--to", "klems"], &["tiny.toml", "a yarn spec", "a cloth spec"]);
    refused(dir, &["export", cloth, "--to", "fbx"], &["fbx", "klems"]);
    refused(dir, &["export", cloth, "--to", "klems", "-o", "a.bsdf"], &["a.bsdf", "-o", ".bsdf", ".xml"]);
    refused(dir, &["export", cloth, "--to", "rgl", "-o", "a"], &["no ending", ".bsdf"]);
    refused(dir, &["export", cloth, "--to", "usd", "-o", "none/a.usda"], &["none/a.usda", "make it first"]);
    refused(dir, &["export", cloth, "--to", "klems", "--views", "30"], &["--views", "report", "leave it out"]);
    refused(dir, &["export", cloth, "--to", "report", "--spectral"], &["--spectral", "rgl"]);
    refused(dir, &["export", cloth, "--to", "report", "--sigma", "-1"], &["--sigma", "-1", "1/um"]);
    refused(dir, &["export", cloth, "--to", "tensortree", "--squares", "12"], &["--squares", "12", "8, 16 or 32"]);
    refused(dir, &["export", cloth, "--to", "openpbr", "--cloth-mm", "0"], &["--cloth-mm", "0.001"]);
    assert_eq!(crate::common::names(dir), ["tiny.toml"]);
}
