//! `plywave hairs`: the file that it writes, of a sheet and on a mesh.

use crate::common::{CLOTH, folder, json, refused, succeed, write_cloth};
use std::path::Path;

/// The cloth of the tests with hairs on its weft.
fn write_hairy(dir: &Path) {
    write_cloth(dir);
    let hairs = "\n[weft.hairs]\nper_mm = 20\nlength_mm = 0.3\nloops = 0.2\n";
    std::fs::write(dir.join("hairy.toml"), format!("{CLOTH}{hairs}")).unwrap();
}

/// The points of the curves of a file.
fn curves(file: &Path) -> Vec<Vec<[f32; 4]>> {
    let text = std::fs::read_to_string(file).unwrap();
    let point = |line: &str| -> [f32; 4] {
        let numbers: Vec<f32> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        numbers.try_into().unwrap()
    };
    text.split("\n\n").filter(|curve| !curve.is_empty()).map(|curve| curve.lines().map(point).collect()).collect()
}

/// A sheet has the hairs of the spec: 20 to the millimeter of weft, which is 20 to the centimeter.
#[test]
fn sheets_have_the_hairs_of_the_spec() {
    let dir = folder();
    write_hairy(dir.path());
    let run = |size: &[&str], name: &str| {
        let args = ["hairs", "hairy.toml", "--json", "-q", "-o", name, "--size-mm"];
        json(&succeed(dir.path(), &[&args[..], size].concat()))
    };
    let wide = run(&["6", "4"], "wide.txt");
    let all = curves(&dir.path().join("wide.txt"));
    // Crimp makes the yarn a few percent longer.
    let want = 20.0 * 2.0 * 6.0 * 4.0;
    let got = all.len() as f64;
    println!("{got} hairs, {want} without crimp; {wide}");
    assert!(got > want - 5.0 * f64::sqrt(want) && got < 1.1 * want + 5.0 * f64::sqrt(want), "{got} {want}");
    assert_eq!(wide["hairs"].as_u64().unwrap() as usize, all.len());
    assert!((wide["mean_length_mm"].as_f64().unwrap() - 0.3).abs() < 0.05);
    for curve in &all {
        // The second point is the root: the first leads the spline to it.
        let [x, y, ..] = curve[1];
        assert!(x.abs() <= 3.0 && y.abs() <= 2.0, "{x} {y}");
        assert!(curve.iter().all(|p| p[3] > 0.002 && p[3] < 0.02 && p[2].abs() < 4.0));
    }
    // A smaller sheet from the same corner has the same hairs.
    run(&["3", "2"], "small.txt");
    let small = curves(&dir.path().join("small.txt"));
    let is_in = |p: &[f32; 4]| p[0] < -1e-4 && p[1] < -1e-4;
    let near = |a: &[f32; 4], b: &[f32; 4]| (a[0] + 1.5 - b[0] - 3.0).abs() + (a[1] + 1.0 - b[1] - 2.0).abs() < 1e-4;
    let inside: Vec<_> = all.iter().filter(|curve| is_in(&curve[1])).collect();
    assert!(inside.len() > 100 && inside.len().abs_diff(small.len()) < 3);
    assert!(inside.iter().all(|a| small.iter().any(|b| near(&b[1], &a[1]))));
}

/// A flat mesh has the hairs of the sheet, in its own units; one that is turned has them turned.
#[test]
fn meshes_have_the_hairs_of_their_cloth() {
    let dir = folder();
    write_hairy(dir.path());
    let uv = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";
    let flat = "v 7 0 0\nv 9 0 0\nv 9 2 0\nv 7 2 0\n";
    let upright = "v 7 0 0\nv 9 0 0\nv 9 0 2\nv 7 0 2\n";
    for (name, text) in [("flat", flat), ("upright", upright)] {
        std::fs::write(dir.path().join(format!("{name}.obj")), format!("{text}{uv}")).unwrap();
        let (obj, txt) = (format!("{name}.obj"), format!("{name}.txt"));
        succeed(dir.path(), &["hairs", "hairy.toml", &obj, "--um-per-uv", "4000", "-o", &txt, "-q"]);
    }
    succeed(dir.path(), &["hairs", "hairy.toml", "--size-mm", "4", "-o", "sheet.txt", "-q"]);
    let [sheet, flat, upright] =
        ["sheet", "flat", "upright"].map(|name| curves(&dir.path().join(format!("{name}.txt"))));
    assert!(sheet.len() > 200 && sheet.len() == flat.len() && sheet.len() == upright.len());
    for ((a, b), c) in sheet.iter().zip(&flat).zip(&upright) {
        for ((a, b), c) in a.iter().zip(b).zip(c) {
            // 2 units are 4 mm of cloth.
            let want = [7.0 + 0.5 * (a[0] + 2.0), 0.5 * (a[1] + 2.0), 0.5 * a[2], 0.5 * a[3]];
            assert!((0..4).all(|k| (want[k] - b[k]).abs() < 1e-4), "{want:?} {b:?}");
            // The normal of the upright one is -y.
            let want = [want[0], -want[2], want[1], want[3]];
            assert!((0..4).all(|k| (want[k] - c[k]).abs() < 1e-4), "{want:?} {c:?}");
        }
    }
}

#[test]
fn what_has_no_hairs_is_refused() {
    let dir = folder();
    write_hairy(dir.path());
    refused(dir.path(), &["hairs", "cloth.toml"], &["hairs = (absent)", "[warp.hairs]"]);
    refused(dir.path(), &["hairs", "hairy.toml", "--size-mm", "0"], &["--size-mm"]);
    refused(dir.path(), &["hairs", "hairy.toml", "--size-mm", "9000"], &["--size-mm", "hairs"]);
    refused(dir.path(), &["hairs", "hairy.toml", "--um-per-uv", "10"], &["<MESH>"]);
    let text = std::fs::read_to_string(dir.path().join("hairy.toml")).unwrap();
    for (from, to, want) in [
        ("per_mm = 20", "per_mm = -1", "weft.hairs.per_mm"),
        ("length_mm = 0.3", "", "weft.hairs.length_mm"),
        ("loops = 0.2", "loops = 1.5", "weft.hairs.loops"),
        ("loops = 0.2", "rise = 1.0", "weft.hairs.rise"),
        ("loops = 0.2", "stiffness = 1.0", "weft.hairs.stiffness"),
    ] {
        std::fs::write(dir.path().join("bad.toml"), text.replace(from, to)).unwrap();
        refused(dir.path(), &["hairs", "bad.toml"], &[want]);
    }
}
