//! Inputs from the field, as other programs and other people write them, each with its right value:
//! `tests/data/field/CASE`, a test a case.
//! The values are closed forms, series of Bessel functions or counts by hand; none comes from the program.
//! Siblings of the cases stand beside the code that reads them.

use crate::common::{STRANDS, json, refused, run, succeed, text, write_cloth};
use exr::prelude::{ReadChannels, ReadLayers};
use std::path::Path;

/// A copy of a case's folder.
fn case(name: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/field").join(name);
    for entry in std::fs::read_dir(&from).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    folder
}

/// A channel of an EXR, row by row, and its width.
fn channel(file: &Path, name: &str) -> (usize, Vec<f32>) {
    let image = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let layer = image.all_attributes().from_file(file).unwrap().layer_data;
    let channel = layer.channel_data.list.iter().find(|c| c.name.to_string() == name);
    let channel = channel.unwrap_or_else(|| panic!("no channel {name} in {}", file.display()));
    (layer.size.x(), channel.sample_data.values_as_f32().collect())
}

/// Mean of a channel.
fn mean(file: &Path, name: &str) -> f64 {
    let (_, values) = channel(file, name);
    values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64
}

/// Renders an open cloth, flat and from the front; gives what was said beside the picture `o.exr`.
fn render_cloth(folder: &Path, more: &[&str]) -> String {
    if !folder.join("cloth.pwc").exists() {
        write_cloth(folder);
    }
    let front =
        ["render", "cloth.pwc", "--sigma", "0", "--smooth", "--setup", "front", "--size-mm", "20", "-o", "o.exr"];
    let output = run(folder, &[&front[..], more].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stderr) + &text(&output.stdout)
}

/// Share of the picture that a mesh covers.
fn covered(folder: &Path, mesh: &str) -> f64 {
    render_cloth(folder, &["--width", "64", "--height", "64", "--samples", "4", "--mesh", mesh]);
    let (_, depth) = channel(&folder.join("o.exr"), "depth.Z");
    depth.iter().filter(|d| **d > 0.0).count() as f64 / depth.len() as f64
}

/// Renders `scene.toml` of strands; gives what was said beside the picture `o.exr`.
fn render_strands(folder: &Path, size: &str, samples: &str) -> String {
    let args = ["render", "scene.toml", "--width", size, "--height", size, "--samples", samples, "-o", "o.exr"];
    let output = run(folder, &args);
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stderr) + &text(&output.stdout)
}

/// Columns of the picture in which strands are seen.
fn columns_with_strands(folder: &Path) -> Vec<usize> {
    let (width, depth) = channel(&folder.join("o.exr"), "depth.Z");
    (0..width).filter(|x| depth.iter().skip(*x).step_by(width).any(|d| *d > 0.0)).collect()
}

#[test]
#[ignore = "slow: 5 s: obj concave"]
fn obj_concave() {
    let folder = case("obj_concave");
    for mesh in ["l_shape.obj", "l_shape_turned.obj"] {
        let got = covered(folder.path(), mesh);
        assert!((got - 0.75).abs() < 0.02, "{mesh} covers {got} of the picture, 0.75 is right");
    }
}

#[test]
fn obj_far_origin() {
    let folder = case("obj_far_origin");
    let got = covered(folder.path(), "survey.obj");
    assert!(got > 0.99, "covers {got}");
}

#[test]
#[ignore = "slow: 5 s: obj latin1 and continued lines"]
fn obj_latin1_and_continued_lines() {
    for (name, mesh) in [("obj_latin1", "latin1.obj"), ("obj_line_continuation", "cont.obj")] {
        let folder = case(name);
        let got = covered(folder.path(), mesh);
        assert!(got > 0.99, "{mesh} covers {got}");
    }
}

#[test]
#[ignore = "slow: 5 s: obj seam normals"]
fn obj_seam_normals() {
    let folder = case("obj_seam_normals");
    let of = |mesh: &str| {
        render_cloth(folder.path(), &["--width", "128", "--height", "128", "--samples", "8", "--mesh", mesh]);
        let (width, normals) = channel(&folder.path().join("o.exr"), "normal.X");
        normals[64 * width..65 * width].to_vec()
    };
    let (seam, turned) = (of("tube.obj"), of("tube_turned.obj"));
    for (got, want) in seam.iter().zip(&turned) {
        assert!((got - want).abs() < 2e-3, "normal.X {got} at the seam, {want} without one");
    }
    let jump = seam.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d < 0.9).fold(0.0f32, f32::max);
    assert!(jump < 0.1, "normals jump by {jump}");
}

#[test]
#[ignore = "slow: 15 s: sky radiance"]
fn sky_radiance() {
    let folder = case("sky_radiance");
    write_cloth(folder.path());
    for (sky, radiance) in [("grey01.exr", 0.1), ("grey10.exr", 10.0)] {
        let size = ["--width", "16", "--height", "16", "--samples", "64", "--quiet", "-o", "o.exr"];
        let scene = ["render", "cloth.pwc", "--sigma", "0", "--smooth", "--setup", "furnace", "--sky", sky];
        succeed(folder.path(), &[&scene[..], &size].concat());
        for name in ["R", "G", "B"] {
            let got = mean(&folder.path().join("o.exr"), name) / radiance;
            assert!((got - 1.0).abs() < 0.01, "{sky}: {name} is {got} of the sky's radiance");
        }
    }
}

#[test]
#[ignore = "slow: 5 s: sky files"]
fn sky_files() {
    let folder = case("sky_files");
    let small = |sky: &'static str| ["--width", "16", "--height", "16", "--samples", "1", "--sky", sky];
    let said = render_cloth(folder.path(), &small("negative.exr"));
    assert!(said.contains("note") && said.contains("-0.0001"), "{said}");
    render_cloth(folder.path(), &small("layer.exr"));
}

#[test]
fn sky_primaries() {
    let folder = case("sky_primaries");
    // A strand behind the camera: the picture is of the sky alone.
    let scene = STRANDS.replace("to_mm = [0.0, 0.0, 1.0]", "to_mm = [0.0, -60.0, 40.0]");
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    for (sky, want) in [("xyz_grey.exr", [0.5; 3]), ("primaries.hdr", [0.8525, 0.0, 0.0])] {
        let size = ["--width", "32", "--height", "32", "--samples", "64", "-o", "o.exr"];
        let said = succeed(folder.path(), &[&["render", "scene.toml", "--sky", sky], &size[..]].concat());
        assert!(said.contains("converted from its own primaries"), "{said}");
        for (name, want) in ["R", "G", "B"].into_iter().zip(want) {
            let got = mean(&folder.path().join("o.exr"), name);
            assert!((got - want).abs() < 0.01, "{sky}: {name} is {got}, {want} is right");
        }
    }
}

#[test]
fn exr_display_window() {
    let folder = case("exr_display_window");
    let small = ["--width", "8", "--height", "8", "--samples", "1"];
    let args = [&["render", "scene.toml", "--sky", "sky.exr"], &small[..]].concat();
    refused(folder.path(), &args, &["sky.exr", "8355810 x 16", "twice as wide as high"]);
}

#[test]
fn hair_three_columns() {
    let folder = case("hair_three_columns");
    let dir = folder.path();
    let said = render_strands(dir, "64", "16");
    assert!(said.contains("2 strands"), "{said}");
    // 64 pixels are 21.4 mm at the strands: one at x = 0, 1.8 pixels wide, and one 6 pixels beside it.
    let columns = columns_with_strands(dir);
    let near = |at: f64| columns.iter().filter(|x| (**x as f64 + 0.5 - at).abs() < 2.0).count();
    assert!(near(32.0) >= 2 && near(37.97) >= 2 && near(32.0) + near(37.97) == columns.len(), "{columns:?}");
    let scene = std::fs::read_to_string(dir.join("scene.toml")).unwrap();
    std::fs::write(dir.join("scene.toml"), scene.replace("radius_um = 300\n", "")).unwrap();
    refused(dir, &["render", "scene.toml"], &["strands.txt", "line 1", "strands.radius_um"]);
    // The same strands as lines of an OBJ.
    let text = std::fs::read_to_string(dir.join("strands.txt")).unwrap();
    let points: Vec<&str> = text.lines().filter(|line| !line.is_empty()).collect();
    let vertices: String = points.iter().map(|point| format!("v {point}\n")).collect();
    let lines = "l 1 2 3 4 5 6 7\nl 8 9 10 11 12 13 14\n";
    std::fs::write(dir.join("strands.obj"), format!("{vertices}{lines}")).unwrap();
    std::fs::write(dir.join("scene.toml"), scene.replace("strands.txt", "strands.obj")).unwrap();
    let said = render_strands(dir, "64", "16");
    assert!(said.contains("2 strands") && columns_with_strands(dir) == columns, "{said}");
}

/// C_sca and C_ext of TM and TE, as `wave scatter` prints them.
fn widths(folder: &Path, scene: &str) -> [[f64; 2]; 2] {
    succeed(folder, &["wave", "scatter", scene, "-o", "o.json", "--quiet"]);
    let out = json(&std::fs::read_to_string(folder.join("o.json")).unwrap());
    let cases = out["cases"].as_array().unwrap();
    ["TM", "TE"].map(|polarization| {
        let of = cases.iter().find(|c| c["pol"] == polarization).unwrap();
        ["C_sca_um", "C_ext_um"].map(|key| of[key].as_f64().unwrap_or_else(|| panic!("{key} in {of}")))
    })
}

/// Widths within a share of the right ones.
fn expect_widths(folder: &Path, scene: &str, want: [[f64; 2]; 2], tolerance: f64) {
    let got = widths(folder, scene);
    for (got, want) in got.iter().flatten().zip(want.iter().flatten()) {
        assert!((got - want).abs() < tolerance * want, "{scene}: {got} um, {want} is right");
    }
}

#[test]
fn wave_absorbing() {
    let folder = case("wave_absorbing");
    let dir = folder.path();
    // The series of Bessel functions, by mpmath: three decimals stand in the case.
    let (k05, k1) = ([[11.931, 20.549], [10.783, 20.707]], [[13.174, 20.534], [11.593, 20.870]]);
    expect_widths(dir, "mie.toml", k05, 5e-5);
    expect_widths(dir, "nystrom.toml", k05, 5e-5);
    // Its tolerance is 0.1.
    expect_widths(dir, "nystrom_k1.toml", k1, 1e-3);
}

#[test]
fn wave_index_matched() {
    let folder = case("wave_index_matched");
    for width in widths(folder.path(), "matched.toml").iter().flatten() {
        assert!(width.abs() < 1e-12, "{width} um");
    }
}

#[test]
fn filament_eta_101() {
    let folder = case("filament_eta_101");
    succeed(folder.path(), &["check", "low.toml"]);
}

#[test]
fn pbrt_transform() {
    let folder = case("pbrt_transform");
    render_strands(folder.path(), "64", "4");
    // 40 mm away and 30 degrees wide: 64 pixels are 21.4 mm at x = 0. The strand at 8 mm stands 24 pixels
    // from that at 0.
    let columns = columns_with_strands(folder.path());
    assert!(columns.iter().any(|x| (31..=32).contains(x)), "{columns:?}");
    assert!(columns.iter().any(|x| (54..=57).contains(x)), "{columns:?}");
    assert!(!columns.iter().any(|x| (37..50).contains(x)), "{columns:?}");
}

#[test]
fn pbrt_one_line() {
    let folder = case("pbrt_one_line");
    render_strands(folder.path(), "32", "4");
    assert!(!columns_with_strands(folder.path()).is_empty());
}

#[test]
fn pbrt_many_curves() {
    let folder = case("pbrt_many_curves");
    let curves = |count: usize| {
        let mut text = String::new();
        for k in 0..count {
            let (x, y) = ((k % 200) as f64 * 0.3 - 30.0, (k / 200) as f64 * 0.3 - 30.0);
            let points = [0, 2, 4, 6].map(|z| format!("{x:.6} {y:.6} {z} ")).concat();
            let shape = "Shape \"curve\" \"string type\" [ \"cylinder\" ] \"point3 P\"";
            text += &format!("{shape} [ {points}] \"float width0\" [ 0.1 ] \"float width1\" [ 0.05 ]\n");
        }
        std::fs::write(folder.path().join("many.pbrt"), text).unwrap();
        let begun = std::time::Instant::now();
        render_strands(folder.path(), "2", "1");
        begun.elapsed().as_secs_f64()
    };
    let (few, many) = (curves(10_000), curves(80_000));
    assert!(many < 16.0 * few.max(0.1), "10 000 curves take {few} s, 80 000 {many} s");
}

#[test]
fn hair_zero_tip_and_one_point() {
    for (name, words) in [("hair_zero_tip", "radius"), ("hair_one_point", "point")] {
        let folder = case(name);
        let said = render_strands(folder.path(), "32", "4");
        assert!(said.contains("note") && said.contains(words), "{name}: {said}");
        assert!(!columns_with_strands(folder.path()).is_empty());
    }
}

/// What `weave` says of a case: its JSON.
fn weave(name: &str) -> serde_json::Value {
    let folder = case(name);
    json(&succeed(folder.path(), &["weave", "cloth.toml", "--json"]))
}

/// The notes that name all of `words`.
fn notes_with(said: &serde_json::Value, words: &[&str]) -> usize {
    let notes = said["notes"].as_array().unwrap();
    notes.iter().filter(|n| words.iter().all(|w| n.as_str().unwrap().contains(w))).count()
}

#[test]
#[ignore = "slow: 85 s: drafts of other programs"]
fn drafts_of_other_programs() {
    for (name, words) in [
        ("wif_contents_lies", &["LIFTPLAN"][..]),
        ("wif_liftplan_and_tieup", &["LIFTPLAN", "TIEUP"]),
        ("wif_shafts_undeclared", &["18"]),
        ("wif_spare_colors", &["WARP COLORS"]),
        ("wif_two_cloths", &["2 cloths"]),
        ("wif_unthreaded_end", &["end"]),
    ] {
        let said = weave(name);
        assert_eq!(notes_with(&said, words), 1, "{name}: {}", said["notes"]);
    }
    // Color 0 stands for none, and a byte order mark tells the encoding: nothing is assumed.
    for name in ["wif_color_zero", "wif_utf16"] {
        let said = weave(name);
        assert_eq!(notes_with(&said, &["draft.wif"]), 0, "{name}: {}", said["notes"]);
    }
}

/// A number of what `weave` measures.
fn measure(said: &serde_json::Value, key: &str) -> f64 {
    said["measures"][key].as_f64().unwrap_or_else(|| panic!("{key} in {said}"))
}

/// A cell and measures within `off` of the right ones: sides and thickness in um, share that is covered.
fn expect_cloth(said: &serde_json::Value, [side, thickness, cover]: [f64; 3], off: f64) {
    for (vector, axis) in [(0, 0), (1, 1)] {
        let got = said["cell_um"][vector][axis].as_f64().unwrap();
        assert!((got - side).abs() < 1e-6 * side, "cell {got} um, {side} is right");
    }
    let [got_thickness, got_cover] = [measure(said, "thickness_um"), 1.0 - measure(said, "openness")];
    assert!((got_thickness - thickness).abs() < off * thickness, "{got_thickness} um thick, {thickness} is right");
    assert!((got_cover - cover).abs() < off, "cover {got_cover}, {cover} is right");
}

/// Round yarns of 100 um at 400 um, which cover 1 - 0.75^2.
const ROUND: [f64; 3] = [800.0, 200.0, 0.4375];

#[test]
fn tg3_scale() {
    let folder = case("tg3_scale");
    let dir = folder.path();
    let said = json(&succeed(dir, &["weave", "cloth.toml", "--json"]));
    expect_cloth(&said, ROUND, 2e-3);
    let width = said["measures"]["yarns"][0]["width_um"].as_f64().unwrap();
    assert!((width - 100.0).abs() < 0.1, "{width} um wide");
    // The spec takes precedence: half as large, and a quarter of the fibers.
    let (spec, model) =
        ["cloth.toml", "meters.tg3"].map(|name| std::fs::read_to_string(dir.join(name)).unwrap()).into();
    let half = spec.replace("[yarn]", "um_per_unit = 5e5\n[yarn]").replace("7 tex", "1.75 tex");
    std::fs::write(dir.join("own.toml"), half).unwrap();
    let own = json(&succeed(dir, &["weave", "own.toml", "--json"]));
    assert_eq!(own["cell_um"][0][0].as_f64().unwrap(), 400.0);
    std::fs::write(dir.join("meters.tg3"), model.replace("\"m\"", "\"ell\"")).unwrap();
    refused(dir, &["weave", "cloth.toml"], &["meters.tg3", "GeometryScale", "ell", "curves.um_per_unit"]);
    succeed(dir, &["weave", "own.toml"]);
}

#[test]
fn tg3_few_nodes() {
    let said = weave("tg3_few_nodes");
    expect_cloth(&said, ROUND, 5e-3);
}

#[test]
fn tg3_flat_sections() {
    let said = weave("tg3_flat_sections");
    // Yarns of 180 x 40 um at 220 um, whose axes lie 50 um apart.
    expect_cloth(&said, [440.0, 90.0, 1.0 - (0.04f64 / 0.22).powi(2)], 5e-3);
    let yarn = &said["measures"]["yarns"][0];
    for (key, want) in [("width_um", 180.0), ("height_um", 40.0)] {
        let got = yarn[key].as_f64().unwrap();
        assert!((got - want).abs() < 0.01 * want, "{key} {got}, {want} is right");
    }
    assert!(measure(&said, "overlap") < 0.05 && notes_with(&said, &["180 x 40 um", "side by side"]) == 1, "{said}");
    // The mass is that of the count: 2 + 2 yarns of 7 tex in 440 x 440 um, longer by their crimp.
    let crimp = yarn["crimp"].as_f64().unwrap();
    let mass = 4.0 * 7.0 * 1e-3 * (1.0 + crimp) / 440e-6;
    assert!((measure(&said, "mass_g_per_m2") / mass - 1.0).abs() < 2e-3, "{said}, {mass} is right");
    // A count that contradicts the section: fibers of 4605 um2 fill 0.6 of 7675 um2, the section has 5655.
    assert_eq!(notes_with(&said, &["7.0 tex", "R 49.4 um", "R 42.4 um", "5.2 tex"]), 1, "{}", said["notes"]);
}

#[test]
fn tg3_count_and_section() {
    let folder = case("tg3_count_and_section");
    let dir = folder.path();
    refused(dir, &["weave", "cloth.toml"], &["yarn.count", "100.0 tex", "R 186.8 um", "R 50.0 um", "7.2 tex"]);
    let spec = std::fs::read_to_string(dir.join("cloth.toml")).unwrap();
    // Fibers that fit, packed more densely, and those that go with the section.
    for (tex, notes) in [("10.0", 1), ("7.2", 0)] {
        std::fs::write(dir.join("cloth.toml"), spec.replace("100 tex", &format!("{tex} tex"))).unwrap();
        let said = json(&succeed(dir, &["weave", "cloth.toml", "--json"]));
        assert_eq!(notes_with(&said, &["packing = 0.84"]), notes, "{tex}: {}", said["notes"]);
        expect_cloth(&said, ROUND, 2e-3);
    }
    let said = succeed(dir, &["weave", "cloth.toml"]);
    assert!(said.contains("7.2 tex, one ply of R 50.0 um"), "{said}");
}

/// Curves that pass through each other are refused by the names of their yarns.
#[test]
fn tg3_yarns_through_each_other() {
    let folder = case("tg3_few_nodes");
    let dir = folder.path();
    let model = std::fs::read_to_string(dir.join("three_nodes.tg3")).unwrap();
    // Yarns 20 um thicker than the distance of their axes.
    let thick = model.replace("Width=\"0.1\" Height=\"0.1\"", "Width=\"0.12\" Height=\"0.12\"");
    std::fs::write(dir.join("three_nodes.tg3"), thick).unwrap();
    refused(dir, &["weave", "cloth.toml"], &["curves.file", "% of R", "yarn 1 and yarn", "relax = true"]);
}

#[test]
fn wif_bits() {
    let said = weave("wif_bits");
    assert_eq!(notes_with(&said, &["[LIFTPLAN]", "1 = 1100 is taken for 1,2"]), 1, "{}", said["notes"]);
}
