//! pbrt's text against closed forms: position and radius of a curve by transforms, blocks, objects and
//! included files, and notes on ignored input.

use plywave_render::{Basis, MIN_RADIUS_MM, StrandFile, StrandNotes, Strands};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const AS_IS: StrandFile = StrandFile { basis: Basis::Linear, mm_per_unit: 1.0, radius_mm: None, whole: false };

fn read(text: &str) -> Result<(Strands, StrandNotes), String> {
    Strands::from_bytes(text.as_bytes(), "it", &AS_IS).map_err(|e| e.to_string())
}

/// First and last point of each curve, x, y, z, radius.
fn ends(strands: &Strands) -> Vec<[[f64; 4]; 2]> {
    let knot = |p: &[[f32; 4]]| {
        std::array::from_fn(|k| (f64::from(p[0][k]) + 4.0 * f64::from(p[1][k]) + f64::from(p[2][k])) / 6.0)
    };
    strands.curves().map(|p| [knot(p), knot(&p[p.len() - 3..])]).collect()
}

/// The curve from (1, 2, 3) to (1, 2, 9), of radius 0.5 to 0.05, after `before`.
fn line(before: &str) -> String {
    format!(
        "{before} Shape \"curve\" \"point3 P\" [ 1 2 3  1 2 5  1 2 7  1 2 9 ] \"float width0\" 1 \"float width1\" 0.1\n"
    )
}

fn assert_ends(text: &str, want: &[[[f64; 4]; 2]]) -> StrandNotes {
    let (strands, notes) = read(text).unwrap_or_else(|e| panic!("{text}: {e}"));
    let got = ends(&strands);
    assert_eq!(got.len(), want.len(), "{text}: {got:?}");
    for (got, want) in got.iter().flatten().flatten().zip(want.iter().flatten().flatten()) {
        assert!((got - want).abs() < 2e-6 * (1.0 + want.abs()), "{text}: {got} for {want}");
    }
    notes
}

const PLAIN: [[f64; 4]; 2] = [[1.0, 2.0, 3.0, 0.5], [1.0, 2.0, 9.0, 0.05]];

#[test]
fn transforms_move_and_scale() {
    for (before, want) in [
        ("", PLAIN),
        ("Translate 8 0 -1", [[9.0, 2.0, 2.0, 0.5], [9.0, 2.0, 8.0, 0.05]]),
        ("Translate 8 0 0 Scale 0.5 0.5 0.5", [[8.5, 1.0, 1.5, 0.25], [8.5, 1.0, 4.5, 0.025]]),
        ("Scale .5 5e-1 +0.5 Translate 8 0 0", [[4.5, 1.0, 1.5, 0.25], [4.5, 1.0, 4.5, 0.025]]),
        // About z by 90 degrees x goes to y; about an axis of any length.
        ("Rotate 90 0 0 7", [[-2.0, 1.0, 3.0, 0.5], [-2.0, 1.0, 9.0, 0.05]]),
        ("Rotate -90 1 0 0", [[1.0, 3.0, -2.0, 0.5], [1.0, 9.0, -2.0, 0.05]]),
        // A mirror.
        ("Scale -2 2 2", [[-2.0, 4.0, 6.0, 1.0], [-2.0, 4.0, 18.0, 0.1]]),
        // Columns one after the other: x to y, y to z, z to x, then (10, 20, 30).
        ("Transform [0 1 0 0  0 0 1 0  1 0 0 0  10 20 30 1]", [[13.0, 21.0, 32.0, 0.5], [19.0, 21.0, 32.0, 0.05]]),
        (
            "Translate 1 1 1 ConcatTransform [2 0 0 0 0 2 0 0 0 0 2 0 1 0 0 1]",
            [[4.0, 5.0, 7.0, 1.0], [4.0, 5.0, 19.0, 0.1]],
        ),
        ("Translate 1 1 1 Transform [2 0 0 0 0 2 0 0 0 0 2 0 1 0 0 1]", [[3.0, 4.0, 6.0, 1.0], [3.0, 4.0, 18.0, 0.1]]),
        ("Scale 9 9 9 Identity", PLAIN),
        // From (0, 0, -5) along +z with y up, pbrt's camera space keeps x, y and z.
        ("LookAt 0 0 -5  0 0 0  0 1 0", [[1.0, 2.0, 8.0, 0.5], [1.0, 2.0, 14.0, 0.05]]),
        // Along +x with z up: depth is x, up is z, and the right, of a left-handed space, is y.
        ("LookAt 0 0 0  1 0 0  0 0 1", [[2.0, 3.0, 1.0, 0.5], [2.0, 9.0, 1.0, 0.05]]),
        (
            "Translate 5 0 0 CoordinateSystem \"here\" Scale 9 9 9 CoordSysTransform \"here\"",
            [[6.0, 2.0, 3.0, 0.5], [6.0, 2.0, 9.0, 0.05]],
        ),
        // The camera's space is the inverse of the transforms before it; the world resets them.
        ("Translate 0 0 -4 Camera \"perspective\" \"float fov\" [ 30 ] WorldBegin", PLAIN),
        (
            "Translate 0 0 -4 Camera \"perspective\" WorldBegin CoordSysTransform \"camera\"",
            [[1.0, 2.0, 7.0, 0.5], [1.0, 2.0, 13.0, 0.05]],
        ),
        ("AttributeBegin Translate 8 0 0 TransformBegin Scale 3 3 3 TransformEnd AttributeEnd", PLAIN),
        (
            "Translate 1 0 0 AttributeBegin Translate 7 0 0 AttributeEnd ReverseOrientation",
            [[2.0, 2.0, 3.0, 0.5], [2.0, 2.0, 9.0, 0.05]],
        ),
    ] {
        let notes = assert_ends(&line(before), &[want]);
        assert_eq!(notes, StrandNotes::default(), "{before}");
    }
}

#[test]
fn statements_stand_anywhere_on_a_line() {
    let one = line("").replace('\n', " ");
    let text = format!(
        "\u{feff}# hair\r\nAttributeBegin{one}AttributeEnd{one}#{one}\n\tTranslate 1 0 0{one}Shape\n\"curve\"\n{}",
        &one[14..]
    );
    let moved = [[2.0, 2.0, 3.0, 0.5], [2.0, 2.0, 9.0, 0.05]];
    assert_ends(&text, &[PLAIN, PLAIN, moved, moved]);
    // Statements without geometry, of pbrt-v2 to -v4, with words of geometry in their strings.
    let passed = "Option \"disablepixeljitter\" true Film \"rgb\" \"string filename\" [ \"Shape Translate 1 2 3\" ] \"integer x\" 3\nMakeNamedMaterial \"hair\" \"string type\" \"hair\" \"rgb color\" [ .1 .2 .3 ]\nSurfaceIntegrator \"path\"\nMediumInterface \"a\" \"b\" MediumInterface \"\"\nTexture \"t\" \"spectrum\" \"imagemap\" \"bool invert\" true\nLightSource \"distant\" \"point3 from\" [ 1 2 3 ]\nTransformTimes 0 1\nColorSpace \"aces2065-1\"\nWorldBegin Attribute \"light\" \"float scale\" 2\n";
    let notes = assert_ends(&line(passed), &[PLAIN]);
    assert_eq!(notes, StrandNotes::default());
}

/// Curves of every basis and degree that are the same parabola, of widths by either name, in either order,
/// and as attributes of all.
#[test]
fn curves_are_given_in_many_ways() {
    let parabola = [[0.0, 0.0, 0.0, 0.3], [2.0, 0.0, 0.0, 0.1]];
    for given in [
        "Shape \"curve\" \"point3 P\" [ 0 0 0  0.66666666 1.3333333 0  1.3333333 1.3333333 0  2 0 0 ] \"float width0\" .6 \"float width1\" .2",
        "Shape \"curve\" \"integer degree\" 2 \"point P\" [ 0 0 0  1 2 0  2 0 0 ] \"float width0\" [.6] \"float width\" .2",
        "Shape \"curve\" \"integer degree\" 2 \"string basis\" \"bspline\" \"float width\" .2 \"float width0\" .6 \"point3 P\" [ -1 -2 0  1 2 0  3 -2 0 ]",
        "Shape \"curve\" \"string basis\" \"bspline\" \"point3 P\" [ -2 -6.6666667 0  0 1.3333333 0  2 1.3333333 0  4 -6.6666667 0 ] \"float width0\" .6 \"float width1\" .2",
        "Attribute \"shape\" \"float width0\" .6 \"float width\" 9 \"integer degree\" 2 Shape \"curve\" \"point3 P\" [ 0 0 0  1 2 0  2 0 0 ] \"float width\" .2",
    ] {
        let notes = assert_ends(given, &[parabola]);
        assert_eq!(notes, StrandNotes::default(), "{given}");
    }
    let ribbon = line("").replace("\"curve\"", "\"curve\" \"string type\" \"ribbon\" \"normal N\" [ 1 0 0  0 1 0 ]");
    let others =
        "Shape \"sphere\" \"float radius\" 2 Shape \"plymesh\" \"string filename\" \"x.ply\" Shape \"sphere\"\n";
    let notes = assert_ends(&format!("{others}{ribbon}"), &[PLAIN]);
    assert_eq!((notes.ribbons, notes.other_shapes["sphere"], notes.other_shapes["plymesh"]), (1, 2, 1));
    assert_eq!(notes.lines().len(), 2, "{:?}", notes.lines());
}

/// A taper to 0 ends in the least radius, exactly linear before it, however many segments there are.
#[test]
fn tips_of_no_width_take_the_least_radius() {
    let least = f64::from(MIN_RADIUS_MM);
    for segments in [1, 3] {
        let points: String = (0..=3 * segments).map(|k| format!("0 0 {} ", 2 * k)).collect();
        let text = format!("Shape \"curve\" \"point3 P\" [ {points} ] \"float width0\" 1 \"float width1\" 0");
        let (strands, notes) = read(&text).unwrap();
        assert_eq!((notes.thin_points, strands.len()), (1, 1));
        for (s, [from, to]) in ends(&strands).into_iter().enumerate() {
            let radius = |knot: usize| (0.5 * (1.0 - knot as f64 / segments as f64)).max(least);
            assert!((from[3] - radius(s)).abs() < 1e-7 && (to[3] - radius(s + 1)).abs() < 1e-7, "{from:?} {to:?}");
        }
    }
    let error = read("Shape \"curve\" \"point3 P\" [0 0 0 1 0 0 2 0 0 3 0 0] \"float width\" 0").unwrap_err();
    assert!(error.contains("left out: 1; radius_um"), "{error}");
    let both = format!("{} Shape \"curve\" \"point3 P\" [0 0 0 1 0 0 2 0 0 3 0 0] \"float width\" 0", line(""));
    assert_eq!(assert_ends(&both, &[PLAIN]).without_width, 1);
}

/// Sections keep the area that the transform gives them: along the curve nothing, across it the root.
#[test]
fn uneven_scales_keep_the_area_of_the_section() {
    for (before, want) in [
        ("Scale 1 1 3", [[1.0, 2.0, 9.0, 0.5], [1.0, 2.0, 27.0, 0.05]]),
        ("Scale 4 1 1", [[4.0, 2.0, 3.0, 1.0], [4.0, 2.0, 9.0, 0.1]]),
        ("Scale 4 9 1", [[4.0, 18.0, 3.0, 3.0], [4.0, 18.0, 9.0, 0.3]]),
        // A shear along the curve leaves its section's area across z, which now stands obliquely: 1 / sqrt(2)
        // of it across the curve.
        (
            "ConcatTransform [1 0 0 0  0 1 0 0  1 0 1 0  0 0 0 1]",
            [[4.0, 2.0, 3.0, 0.5 * 0.5f64.powf(0.25)], [10.0, 2.0, 9.0, 0.05 * 0.5f64.powf(0.25)]],
        ),
    ] {
        let notes = assert_ends(&line(before), &[want]);
        assert_eq!(notes.stretched, 1, "{before}");
    }
    // In two steps as in one.
    let object =
        format!("ObjectBegin \"a\" {} ObjectEnd Rotate 90 0 1 0 Scale 4 1 1 ObjectInstance \"a\"", line("Scale 1 9 1"));
    let (inner, outer) = ("Scale 1 9 1", "Rotate 90 0 1 0 Scale 4 1 1");
    let want = ends(&read(&line(&format!("{outer} {inner}"))).unwrap().0);
    assert_eq!(assert_ends(&object, &want).stretched, 1);
}

#[test]
fn objects_are_put_where_their_instances_are() {
    let object = format!(
        "ObjectInstance \"late\" AttributeBegin Translate 0 0 100 ObjectBegin \"a\" {} ObjectEnd AttributeEnd
         Scale 2 2 2 ObjectInstance \"a\" Translate 10 0 0 ObjectInstance \"a\" ObjectBegin \"late\" {} ObjectEnd",
        line("Translate 1 0 0"),
        line("Identity"),
    );
    // The object's own transform holds the one that it was defined under.
    let a = |x: f64| [[x, 4.0, 206.0, 1.0], [x, 4.0, 218.0, 0.1]];
    assert_ends(&object, &[PLAIN, a(4.0), a(24.0)]);
    // An object without instances is invisible; nested objects.
    let nested = format!(
        "ObjectBegin \"a\" {} ObjectEnd ObjectBegin \"b\" Translate 0 1 0 ObjectInstance \"a\" ObjectInstance \"a\" ObjectEnd
         Rotate 90 0 0 1 ObjectInstance \"b\"",
        line("")
    );
    let want = [[-3.0, 1.0, 3.0, 0.5], [-3.0, 1.0, 9.0, 0.05]];
    assert_ends(&nested, &[want, want]);
    let error = read(&format!("ObjectBegin \"a\" {} ObjectEnd", line(""))).unwrap_err();
    assert!(error.contains("no strands"), "{error}");
}

#[test]
fn motion_and_open_blocks_are_told() {
    let notes = assert_ends(&line("ActiveTransform EndTime Translate 5 0 0 ActiveTransform All"), &[PLAIN]);
    assert_eq!(notes.moving, 1);
    let shifted = [[6.0, 2.0, 3.0, 0.5], [6.0, 2.0, 9.0, 0.05]];
    let text = format!("{}{}", line("AttributeBegin ActiveTransform StartTime Translate 5 0 0"), line("AttributeEnd"));
    assert_eq!(assert_ends(&text, &[shifted, PLAIN]).moving, 1);
    assert_eq!(assert_ends(&line("AttributeBegin"), &[PLAIN]).open_blocks, 1);
}

fn write(folder: &Path, files: &[(&str, &[u8])]) -> PathBuf {
    for (name, bytes) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    folder.join("main.pbrt")
}

#[test]
fn included_files_are_read_in_place() {
    let folder = tempfile::tempdir().unwrap();
    let (one, shift) = (line(""), "Translate 1 0 0\n");
    let path = write(
        folder.path(),
        &[
            ("main.pbrt", b"Include \"sub/shift.pbrt\" Include \"sub/deep.pbrt\" AttributeBegin Include \"open.pbrt\" Include \"sub/one.pbrt\"\n"),
            ("sub/shift.pbrt", shift.as_bytes()),
            // By the folder of the first file, and beside the file that names it.
            ("sub/deep.pbrt", b"Import \"sub/shift.pbrt\" Include \"one.pbrt\" Include \"../open.pbrt\" AttributeEnd"),
            ("sub/one.pbrt", one.as_bytes()),
            ("open.pbrt", b"Scale 2 2 2 AttributeBegin"),
        ],
    );
    let (strands, notes) = Strands::load(&path, &AS_IS).unwrap();
    // Include shifts what follows, Import does not; a block may end in another file.
    let want = [[[2.0, 2.0, 3.0, 0.5], [2.0, 2.0, 9.0, 0.05]], [[9.0 - 4.0, 8.0, 12.0, 2.0], [5.0, 8.0, 36.0, 0.2]]];
    for (got, want) in ends(&strands).iter().flatten().flatten().zip(want.iter().flatten().flatten()) {
        assert!((got - want).abs() < 1e-5, "{:?} for {want:?}", ends(&strands));
    }
    assert_eq!((strands.len(), notes.included.len(), notes.open_blocks), (2, 4, 2));

    for (main, words) in [
        (&b"Include \"none.pbrt\""[..], "main.pbrt: line 1: Include \"none.pbrt\""),
        (b"\n\nInclude \"../x.pbrt\"", "line 3: Include \"../x.pbrt\""),
        (b"Include \"sub/../../x.pbrt\"", "leads out of the folder"),
        (b"Include \"/etc/passwd\"", "leads out of the folder"),
        (b"Include \"main.pbrt\"", "includes itself"),
        (b"Include \"round.pbrt\"", "round2.pbrt: line 2: Include \"round.pbrt\": the file includes itself"),
        (b"Include \"packed.pbrt\"", "packed by gzip"),
        (b"Include \"bad.pbrt\"", "bad.pbrt: line 2: \"x\" is no number; \"Scale\" takes 3 numbers"),
        (b"Import \"ends.pbrt\"", "ends a block"),
        (b"Include sub", "takes a text in quotes"),
    ] {
        let path = write(
            folder.path(),
            &[
                ("main.pbrt", main),
                ("round.pbrt", b"Include \"round2.pbrt\""),
                ("round2.pbrt", b"\nInclude \"round.pbrt\""),
                ("packed.pbrt", b"\x1f\x8b\x08"),
                ("bad.pbrt", b"\nScale 1 1 x"),
                ("ends.pbrt", b"AttributeEnd"),
            ],
        );
        let main = if main.starts_with(b"Import") { b"AttributeBegin Import \"ends.pbrt\"" } else { main };
        std::fs::write(&path, main).unwrap();
        let error = Strands::load(&path, &AS_IS).unwrap_err().to_string();
        assert!(error.contains(words) && error.lines().count() == 1, "{words}: {error}");
    }
    // Without a folder.
    assert!(read("Include \"main.pbrt\"").unwrap_err().contains("without a folder"));
}

#[test]
fn bad_statements_are_refused_by_line() {
    let deep = "AttributeBegin ".repeat(10_001);
    for (text, words) in [
        ("Translate 8 0\nShape \"curve\"", "line 1: \"Shape\" is no number; \"Translate\" takes 3 numbers"),
        ("\nTranslate 8 0", "line 2: \"Translate\" takes 3 numbers"),
        ("Scale 1 1 1e999", "is no number"),
        ("Scale 1 nan 1", "is no number"),
        ("Transform [ 1 0 0 0 ]", "takes 16 numbers"),
        ("Transform [ 1 0 0 1  0 1 0 0  0 0 1 0  0 0 0 1 ]", "perspective"),
        ("Rotate 10 0 0 0", "axis of length 0"),
        ("LookAt 0 0 0 0 0 1 0 0 1", "up direction"),
        ("Translate 1 1 1 Tranlate 1 1 1", "unknown statement \"Tranlate\""),
        ("CoordSysTransform \"there\"", "no coordinate system \"there\""),
        ("ActiveTransform Shutter", "StartTime"),
        ("\n\nAttributeEnd", "line 3: AttributeEnd without its beginning"),
        ("AttributeBegin ObjectEnd", "ObjectEnd without its beginning"),
        ("ObjectBegin \"a\" AttributeEnd", "AttributeEnd without its beginning"),
        ("ObjectBegin \"a\" ObjectBegin \"b\"", "within an object"),
        ("ObjectBegin \"a\" ObjectEnd ObjectBegin \"a\"", "defined twice"),
        ("\nObjectInstance \"b\"", "line 2: ObjectInstance \"b\": no object"),
        ("ObjectBegin \"a\" ObjectInstance \"a\" ObjectEnd ObjectInstance \"a\"", "within itself"),
        ("Shape \"curve", "no closing quote"),
        ("Shape \"curve\" \"float width\" \"a\n\"", "no closing quote"),
        ("Shape \"curve\" \"float width\" -1", "\"width\" = -1; use 0 or more"),
        ("Shape \"curve\" \"float width\" [ ]", "\"width\" has no value"),
        ("Shape \"curve\" \"string type\" \"tube\"", "unknown type"),
        ("Shape \"sphere\" \"float radius\" [ 1", "\"[\" without \"]\""),
        (&line("Scale 0 1 1"), "determinant 0"),
        (&line("Translate 1e9 0 0"), "coordinate of 1000000001 mm"),
        (&deep, "more than 10000 blocks"),
        ("3 4 5", "line 1: without a radius"),
        ("hair {}", "line 1: \"hair\" is no number"),
    ] {
        let error = read(text).expect_err(text);
        assert!(error.contains(words) && error.starts_with("it: ") && error.lines().count() == 1, "{words:?}: {error}");
    }
}

/// Nested objects with more strands than fit in memory are soon refused in one line.
#[test]
fn objects_do_not_grow_without_end() {
    let mut text = "ObjectBegin \"0\" ObjectEnd\n".to_string();
    for k in 1..60 {
        text += &format!("ObjectBegin \"{k}\" ObjectInstance \"{0}\" ObjectInstance \"{0}\" ObjectEnd\n", k - 1);
    }
    text += "ObjectInstance \"59\"\n";
    let error = read(&text).unwrap_err();
    assert!(error.contains("instances"), "{error}");
}

/// A hundred thousand curves are read in a time that only a linear reader achieves.
#[test]
fn many_curves_are_read_in_linear_time() {
    let text: String = (0..100_000)
        .map(|k| {
            let (x, y) = (f64::from(k % 317) * 0.1, f64::from(k / 317) * 0.1);
            format!("Shape \"curve\" \"string type\" [ \"cylinder\" ] \"point3 P\" [ {x} {y} 0  {x} {y} 2  {x} {y} 4  {x} {y} 6 ] \"float width0\" [ 0.1 ] \"float width1\" [ 0.05 ]\n")
        })
        .collect();
    let begun = Instant::now();
    let (strands, _) = read(&text).unwrap();
    println!("{:?}", begun.elapsed());
    assert_eq!((strands.len(), strands.segments()), (100_000, 100_000));
    assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", begun.elapsed());
}
