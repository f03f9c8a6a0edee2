//! Exports beside each other: names by format, files of another origin, several files of one report.

use crate::common::{folder, json, names, refused, succeed, write_cloth};

/// A report of one direction.
const QUICK: [&str; 4] = ["--views", "0", "--samples", "256"];

#[test]
#[ignore = "slow: 15 s: exports of one cloth beside each other"]
fn formats_share_no_file_and_replace_none_of_another_origin() {
    let folder = folder();
    let dir = folder.path();
    write_cloth(dir);
    let report = [&["export", "cloth.pwc", "--to", "report"][..], &QUICK].concat();
    let tree = ["export", "cloth.pwc", "--to", "tensortree", "--squares", "8"];
    // Names by format, and the same export once more.
    for _ in 0..2 {
        succeed(dir, &report);
        succeed(dir, &tree);
    }
    let found = names(dir);
    assert!(
        ["cloth_report.md", "cloth_tensortree.xml"].iter().all(|name| found.contains(&name.to_string())),
        "{found:?}"
    );
    // What another format, a user or another command has written stays.
    std::fs::copy(dir.join("cloth_tensortree.xml"), dir.join("a.xml")).unwrap();
    std::fs::write(dir.join("b.md"), "# mine").unwrap();
    let klems = ["export", "cloth.pwc", "--to", "klems", "-o", "a.xml"];
    refused(dir, &klems, &["a.xml", "not of an earlier export to klems", "--force"]);
    refused(dir, &[&report[..], &["-o", "b.md"]].concat(), &["b.md", "not of an earlier export to report", "--force"]);
    std::fs::create_dir(dir.join("o_usd_maps")).unwrap();
    std::fs::write(dir.join("o_usd_maps/normal.png"), "mine").unwrap();
    refused(dir, &["export", "cloth.pwc", "--to", "usd", "-o", "o.usda"], &["o_usd_maps/normal.png", "--force"]);
    assert_eq!(std::fs::read_to_string(dir.join("b.md")).unwrap(), "# mine");
    succeed(dir, &[&report[..], &["-o", "b.md", "--force"]].concat());
    assert!(std::fs::read_to_string(dir.join("b.md")).unwrap().contains("Numbers of EN 14501"));
}

#[test]
fn reports_are_written_in_several_formats_at_once() {
    let folder = folder();
    let dir = folder.path();
    write_cloth(dir);
    let report = [&["export", "cloth.pwc", "--to", "report"][..], &QUICK].concat();
    let all = ["-o", "a.html", "-o", "a.json", "-o", "b.csv", "--json"];
    let told = json(&succeed(dir, &[&report[..], &all].concat()));
    let files: Vec<&str> = told["files"].as_array().unwrap().iter().map(|f| f["file"].as_str().unwrap()).collect();
    assert_eq!(files, ["a.html", "a.json", "b.csv"]);
    // One computation: the numbers are the same in all.
    let page = std::fs::read_to_string(dir.join("a.html")).unwrap();
    let numbers = json(&std::fs::read_to_string(dir.join("a.json")).unwrap());
    let row = &numbers["rows"][0]["reflected"];
    let [value, se] = ["value", "se"].map(|name| row[name].as_f64().unwrap());
    assert!(page.contains(&format!("{value:.4} +- {se:.4}")), "{page}");
    let csv = std::fs::read_to_string(dir.join("b.csv")).unwrap();
    assert!(csv.contains(&format!("face,0,0,{value:.6},{se:.6}")), "{csv}");

    refused(dir, &[&report[..], &["-o", "a.html", "-o", "a.html"]].concat(), &["-o", "a.html", "twice"]);
    refused(dir, &[&report[..], &["-o", "a.html", "-o", "a.xml"]].concat(), &["a.xml", ".html"]);
    let two = ["export", "cloth.pwc", "--to", "klems", "-o", "a.xml", "-o", "b.xml"];
    refused(dir, &two, &["b.xml", "only a report"]);
}

/// What a number or a note of the program means stands beside it.
#[test]
fn what_is_printed_explains_itself() {
    let folder = folder();
    let dir = folder.path();
    write_cloth(dir);
    let out = succeed(dir, &["export", "cloth.pwc", "--to", "tensortree", "--squares", "8"]);
    assert!(out.contains("asymmetry") && out.contains("how far apart both directions were"), "{out}");
    assert!(out.contains("emissivity front") && out.contains("[thermal]"), "{out}");
}
