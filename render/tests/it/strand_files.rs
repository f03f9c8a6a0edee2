//! Files of strands are read correctly or refused in one line; procedural strands are in their places.

use glam::DVec3;
use plywave_render::{
    Basis, GeneratedStrands, MIN_RADIUS_MM, StrandFile, StrandNotes, StrandShape, StrandTree, Strands, make,
    mitsuba_text,
};
use proptest::prelude::*;

const AS_IS: StrandFile = StrandFile { basis: Basis::Linear, mm_per_unit: 1.0, radius_mm: None, whole: false };

fn read(bytes: &[u8], how: &StrandFile) -> Result<Strands, String> {
    read_with_notes(bytes, how).map(|(strands, _)| strands)
}

fn read_with_notes(bytes: &[u8], how: &StrandFile) -> Result<(Strands, StrandNotes), String> {
    Strands::from_bytes(bytes, "it", how).map_err(|e| e.to_string())
}

/// A file from the field.
fn field(name: &str) -> Vec<u8> {
    std::fs::read(format!("{}/../tests/data/field/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

const SPLINE: StrandFile = StrandFile { basis: Basis::BSpline, whole: true, ..AS_IS };

/// A `.hair` file of these strands, with flags for the given arrays.
fn hair(strands: &[&[[f32; 4]]], thickness: Option<f32>, default_segments: Option<u32>) -> Vec<u8> {
    let total: usize = strands.iter().map(|s| s.len()).sum();
    let flags = u32::from(default_segments.is_none()) | 2 | if thickness.is_none() { 4 } else { 0 };
    let mut bytes = b"HAIR".to_vec();
    for word in
        [strands.len() as u32, total as u32, flags, default_segments.unwrap_or(0), thickness.unwrap_or(0.0).to_bits()]
    {
        bytes.extend(word.to_le_bytes());
    }
    bytes.resize(128, 0);
    if default_segments.is_none() {
        bytes.extend(strands.iter().flat_map(|s| (s.len() as u16 - 1).to_le_bytes()));
    }
    bytes.extend(strands.iter().flat_map(|s| s.iter()).flat_map(|p| p[..3].to_vec()).flat_map(f32::to_le_bytes));
    if thickness.is_none() {
        bytes.extend(strands.iter().flat_map(|s| s.iter()).flat_map(|p| p[3].to_le_bytes()));
    }
    bytes
}

const A: &[[f32; 4]] = &[[0.0, 0.0, 0.0, 0.2], [1.0, 0.0, 0.0, 0.1], [2.0, 1.0, 0.0, 0.1]];
const B: &[[f32; 4]] = &[[5.0, 0.0, 0.0, 0.2], [5.0, 0.0, 3.0, 0.4], [5.0, 1.0, 3.0, 0.4]];

#[test]
fn hair_files_hold_points_and_diameters() {
    let strands = read(&hair(&[A, B, &B[..2]], None, None), &AS_IS).unwrap();
    let curves: Vec<_> = strands.curves().collect();
    assert_eq!((strands.len(), strands.segments()), (3, 5));
    assert_eq!(curves[0][1], [1.0, 0.0, 0.0, 0.05]);
    assert_eq!(curves[2], [[5.0, 0.0, 0.0, 0.1], [5.0, 0.0, 3.0, 0.2]]);
    // One thickness and one number of segments for all; other units; another radius.
    let how = StrandFile { mm_per_unit: 10.0, ..AS_IS };
    let strands = read(&hair(&[A, B], Some(0.02), Some(2)), &how).unwrap();
    assert_eq!(strands.points()[5], [50.0, 10.0, 30.0, 10.0 * (0.5 * 0.02)]);
    let how = StrandFile { radius_mm: Some(0.04), ..how };
    assert!(read(&hair(&[A, B], Some(0.02), Some(2)), &how).unwrap().points().iter().all(|p| p[3] == 0.04));
    // A spline that goes from end to end: the curve begins and ends at the outermost points.
    let strands = read(&hair(&[A], None, None), &SPLINE).unwrap();
    for (got, end) in ends(strands.points()).into_iter().zip([A[0], A[2]]) {
        for c in 0..4 {
            let want = if c == 3 { 0.5 * end[3] } else { end[c] };
            assert!((got[c] - want).abs() < 1e-6, "{got:?} {end:?}");
        }
    }
}

/// First and last point of a B-spline.
fn ends(p: &[[f32; 4]]) -> [[f32; 4]; 2] {
    [0, p.len() - 3].map(|k| std::array::from_fn(|c| (p[k][c] + 4.0 * p[k + 1][c] + p[k + 2][c]) / 6.0))
}

/// Strands of one point are omitted and tips without width get the least radius, both counted; all else is as
/// in the file.
#[test]
fn bald_roots_and_pointed_tips_are_read() {
    for how in [AS_IS, SPLINE] {
        let (strands, notes) = read_with_notes(&field("hair_one_point/roots.hair"), &how).unwrap();
        assert_eq!((strands.len(), &notes), (3, &StrandNotes { single_points: 1, ..StrandNotes::default() }));
        let x: Vec<f32> = strands.curves().map(|p| p[1][0]).collect();
        // The second of four has a single point.
        assert_eq!(x, [0.0, 2.0, 3.0]);
        let (strands, notes) = read_with_notes(&field("hair_zero_tip/tips.hair"), &how).unwrap();
        assert_eq!((strands.len(), &notes), (5, &StrandNotes { thin_points: 5, ..StrandNotes::default() }));
        assert!((strands.mean_radius_mm() - 0.25).abs() < 1e-5, "{}", strands.mean_radius_mm());
        for curve in strands.curves() {
            let [root, tip] = if how == SPLINE { ends(curve) } else { [curve[0], curve[5]] };
            assert!((root[3] - 0.5).abs() < 1e-6 && (tip[3] - MIN_RADIUS_MM).abs() < 1e-7, "{root:?} {tip:?}");
            assert!((root[2], tip[2]) == (0.0, 10.0), "{root:?} {tip:?}");
        }
        // A ray along the tip hits a pointed end, not a blunt one.
        let tree = StrandTree::new(strands, StrandShape::Tube);
        for (z, radius) in [(9.0, 0.05), (9.8, 0.01), (9.98, 0.001)] {
            let down = DVec3::new(0.0, -5.0, z);
            let hit = tree.first(down, DVec3::Y, 0.0, 1e9, &[]).expect("met");
            assert!((hit.radius_mm - radius).abs() < 0.06 * radius + 1e-4, "{} at {z}, not {radius}", hit.radius_mm);
        }
    }
    // The same in text; a strand of one point and one without width are omitted, and the rest stays.
    let text = b"0 0 0 .1\n0 0 1 0.05\n0 0 2 0\n\n5 5 5 1\n\n1 0 0 0\n1 0 1 0\n\n2 0 0 1e-9\n2 0 1 .1";
    let (strands, notes) = read_with_notes(text, &AS_IS).unwrap();
    let want = StrandNotes { single_points: 1, without_width: 1, thin_points: 2, ..StrandNotes::default() };
    assert_eq!((strands.len(), &notes), (2, &want));
    assert_eq!(notes.lines().len(), 3);
    assert_eq!(strands.curves().map(|c| c[c.len() - 1][3]).collect::<Vec<_>>(), [MIN_RADIUS_MM, 0.1]);
    // With a radius for all, a file's widths do not count.
    let how = StrandFile { radius_mm: Some(0.04), ..AS_IS };
    let (strands, notes) = read_with_notes(&hair(&[A, B], Some(0.0), Some(2)), &how).unwrap();
    assert_eq!((strands.len(), notes), (2, StrandNotes::default()));
}

#[test]
fn pbrt_text_of_the_field() {
    let moved = read(&field("pbrt_transform/moved.pbrt"), &AS_IS).unwrap();
    let got: Vec<_> = moved.curves().map(ends).collect();
    let close = |a: [[f32; 4]; 2], b: [[f32; 4]; 2]| (0..8).all(|k| (a[k / 4][k % 4] - b[k / 4][k % 4]).abs() < 1e-5);
    assert!(close(got[0], [[8.0, 0.0, 0.0, 0.25], [8.0, 0.0, 3.0, 0.025]]), "{got:?}");
    assert!(close(got[1], [[0.0, 0.0, 0.0, 0.5], [0.0, 0.0, 6.0, 0.05]]), "{got:?}");
    let one = read(&field("pbrt_one_line/one_line.pbrt"), &AS_IS).unwrap();
    assert!(close(one.curves().map(ends).next().unwrap(), got[1]) && one.len() == 1);
}

#[test]
fn mitsuba_text_comes_back() {
    let strands = read(b"0 0 0 .1\n1 0 0 0.1\r\n\n\n5 5 5 1e-2\n6 5 5 2e-2\n 7 5 5 3e-2", &AS_IS).unwrap();
    assert_eq!((strands.len(), strands.segments()), (2, 3));
    assert_eq!(read(mitsuba_text(&strands).as_bytes(), &AS_IS).unwrap(), strands);
}

/// Points of three columns take the scene's radius, and without one the refusal names the key.
#[test]
fn three_columns_take_the_radius_of_the_scene() {
    let how = StrandFile { radius_mm: Some(0.3), ..AS_IS };
    let strands = read(&field("hair_three_columns/strands.txt"), &how).unwrap();
    let want = |x: f32| (0..7).map(|z| [x, 0.0, z as f32, 0.3]).collect::<Vec<_>>();
    assert_eq!(strands.curves().map(<[_]>::to_vec).collect::<Vec<_>>(), [want(0.0), want(2.0)]);
    // Beside lines of four columns.
    let strands = read(b"0 0 0\n0 0 1 5\n", &how).unwrap();
    assert_eq!(strands.points(), [[0.0, 0.0, 0.0, 0.3], [0.0, 0.0, 1.0, 0.3]]);
    for (text, words) in [
        (&field("hair_three_columns/strands.txt")[..], ["line 1", "without a radius", "strands.radius_um"]),
        (b"0 0 0 1\n0 0 1\n", ["line 2", "without a radius", "strands.radius_um"]),
    ] {
        let error = read(text, &AS_IS).unwrap_err();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
    assert!(read(b"0 0\n", &how).unwrap_err().contains("without z"));
}

#[test]
fn lines_of_obj_files_are_strands() {
    let how = StrandFile { radius_mm: Some(0.3), mm_per_unit: 10.0, ..AS_IS };
    let vertices = "# hair\no Shape\nv 0 0 0\nv 0 0 1\nv 0 0 2 1\nv 5 0 0\nv 5 0 3\nv 7 0 3 1 0 0\nvt 0 0\n";
    // A polyline, edges of which one continues the other, one that does not; faces are no strands.
    let elements = "l 1 2 \\\n3\nf 1 2 4\nl 4/1 5/1\nl 5 6\nl -6 -5\n";
    let curves = |text: &str| {
        let strands = read(text.as_bytes(), &how).unwrap_or_else(|e| panic!("{e}"));
        let points = |curve: &[[f32; 4]]| curve.iter().map(|p| [p[0], p[2], p[3]]).collect::<Vec<_>>();
        strands.curves().map(points).collect::<Vec<_>>()
    };
    let want = [
        vec![[0.0, 0.0, 0.3], [0.0, 10.0, 0.3], [0.0, 20.0, 0.3]],
        vec![[50.0, 0.0, 0.3], [50.0, 30.0, 0.3], [70.0, 30.0, 0.3]],
        vec![[0.0, 0.0, 0.3], [0.0, 10.0, 0.3]],
    ];
    assert_eq!(curves(&format!("{vertices}{elements}")), want);
    assert_eq!(curves(&format!("{vertices}{elements}").replace('\n', "\r\n")), want);
    // A spline goes from end to end of them.
    let spline = StrandFile { basis: Basis::BSpline, whole: true, ..how };
    let strands = read(format!("{vertices}l 1 2 3\n").as_bytes(), &spline).unwrap();
    assert_eq!(ends(strands.points()).map(|p| (10.0 * p[2]).round()), [0.0, 200.0]);
    for (elements, how, words) in [
        ("l 1 2\n", AS_IS, ["line 10", "strands.radius_um"]),
        ("l 1 99\n", how, ["line 10", "a line names vertex 99, and there are 6"]),
        ("l 1 x\n", how, ["line 10", "not a corner of a line: x"]),
        ("f 1 2 3\n", how, ["no strands", "lines (l) of an OBJ"]),
        ("l 1\n", how, ["no strands", "single point"]),
    ] {
        let error = read(format!("{vertices}{elements}").as_bytes(), &how).unwrap_err();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

/// Points of a Bezier curve lie on the converted curve.
#[test]
fn pbrt_curves_are_the_same_curves() {
    let text = r#"
        # A curve with a comment [
        AttributeBegin
        Material "hair"
        Shape "curve" "string type" [ "cylinder" ] "point3 P" [ 0 0 0  1 2 0  2 -1 1  3 0 0  4 1 -1  5 3 0  6 0 0 ]
            "float width0" 0.2 "float width1" [ 0.1 ]
        Shape "sphere" "float radius" 1
        Shape "curve" "integer degree" [2] "string basis" "bspline" "point3 P" [ 0 9 0 1 9 0 2 10 0 3 10 1 ] "float width" [0.1]
        Shape "curve" "string basis" ["bspline"] "point P" [ 0 20 0 1 20 0 2 20 0 3 20 0 4 20 0 ] "float width0" [0.3] "float width1" [ 0.1 ]
        AttributeEnd"#;
    let strands = read(text.as_bytes(), &AS_IS).unwrap();
    assert_eq!((strands.len(), strands.segments(), strands.basis()), (3, 2 + 2 + 2, Basis::BSpline));
    let tree = StrandTree::new(strands, StrandShape::Tube);
    let b = [
        [0.0, 0.0, 0.0],
        [1.0, 2.0, 0.0],
        [2.0, -1.0, 1.0],
        [3.0, 0.0, 0.0f64],
        [4.0, 1.0, -1.0],
        [5.0, 3.0, 0.0],
        [6.0, 0.0, 0.0],
    ];
    for piece in 0..2 {
        for k in 0..=10 {
            let t = f64::from(k) / 10.0;
            let w = [(1.0 - t).powi(3), 3.0 * t * (1.0 - t).powi(2), 3.0 * t * t * (1.0 - t), t.powi(3)];
            let at: [f64; 3] = std::array::from_fn(|c| (0..4).map(|i| w[i] * b[3 * piece + i][c]).sum());
            let hit =
                tree.first(DVec3::new(at[0], at[1], 100.0), DVec3::NEG_Z, 0.0, 1e9, &[]).expect("the curve is met");
            let radius = 0.1 - 0.05 * (piece as f64 + t) / 2.0;
            assert!((hit.radius_mm - radius).abs() < 0.02, "{} {radius}", hit.radius_mm);
            assert!(hit.h_rel.abs() < 0.05 && hit.strand == 0, "{hit:?}");
        }
    }
    // Width of the straight one, from 0.3 to 0.1.
    for (x, want) in [(1.001, 0.15), (2.0, 0.1), (2.999, 0.05)] {
        let hit = tree.first(DVec3::new(x, 20.0, 100.0), DVec3::NEG_Z, 0.0, 1e9, &[]).expect("met");
        assert!((hit.radius_mm - want).abs() < 1e-3, "{} {want}", hit.radius_mm);
    }
}

#[test]
fn bad_files_are_refused_in_one_line() {
    let whole = hair(&[A, B], None, None);
    let zero = hair(&[A], Some(0.0), None);
    let with = |point: usize, width: f32| {
        let (mut bytes, at) = (whole.clone(), 128 + 4 + 6 * 12 + 4 * point);
        bytes[at..at + 4].copy_from_slice(&width.to_le_bytes());
        bytes
    };
    let many = hair(&[A], Some(0.1), Some(1_000_000));
    let mut nan = whole.clone();
    nan[132..136].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut huge = whole.clone();
    huge[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    let million: String = (0..1_000_000).map(|k| format!("{k} 0 0 1\n")).collect();
    let pbrt_million = format!("Shape \"curve\" \"point3 P\" [ {} ]", "0 1 2 ".repeat(1_000_000));
    for (bytes, words) in [
        (&b""[..], "no strands"),
        (b"HAIR", "cut off"),
        (&whole[..whole.len() - 1], "cut off"),
        (&whole[..140], "cut off"),
        (&nan, "strand 1: point 1 has the coordinate NaN"),
        (&with(5, f32::NAN), "strand 2: point 3 has the radius NaN mm"),
        (&with(3, -1.0), "strand 2: point 1 has the radius -0.5 mm"),
        (b"\x1f\x8b\x08", "packed by gzip"),
        (&hair(&[&A[..1], &B[..1]], None, None), "no strands: strands of a single point, left out: 2"),
        (&hair(&[], Some(0.1), None), "no strands"),
        (&huge, "cut off"),
        (&zero, "all along, left out: 1; radius_um sets the radius of all"),
        (&many, "at most 65536"),
        (&hair(&[A, B], Some(0.1), Some(3)), "counts do not agree"),
        (&hair(&[A, B], Some(0.1), Some(1)), "counts do not agree"),
        (million.as_bytes(), "more than 65536 points"),
        (pbrt_million.as_bytes(), "at most 65536"),
        (b"0 0 0 1\n0 0 nan 1", "point 2 has the coordinate NaN"),
        (b"0 0 0 1\n0 0 x 1", "line 2: \"x\" is no number"),
        (b"0 0 0 1\n0 0 1", "line 2: without a radius"),
        (b"0 0 0 1\n0 0 1 1 1", "after the radius"),
        (b"0 0 0 0\n0 0 1 0", "strands with a radius below 0.00001 mm all along"),
        (b"0 0 0 -1\n0 0 1 1", "radius -1 mm"),
        (b"0 0 0 1", "strands of a single point, left out: 1"),
        (b"1e30 0 0 1\n0 0 1 1", "coordinate"),
        (b"\xff\xfe", "neither .hair nor text"),
        (b"Shape \"curve\" \"point3 P\" [ 0 0 0 1", "no closing bracket"),
        (b"Shape \"curve\" \"point3 P\" [ 0 0 0 1 ]", "three a point"),
        (b"Shape \"curve\" \"point3 P\" [ 0 0 0 1 0 0 ]", "2 points"),
        (b"Shape \"curve\" \"point3 P\" [ 0 0 0 1 0 x ]", "is no number"),
        (b"Shape \"curve\" \"string basis\" [ \"nurbs\" ]", "unknown basis"),
        (b"Shape \"curve\" \"integer degree\" 9", "degree 9"),
        (b"Shape \"curve\" \"point3 P\" [0 0 0 1 0 0 2 0 0 3 0 0] \"float width\" 0", "all along, left out: 1"),
        (b"Shape \"sphere\"", "no strands"),
    ] {
        let error = read(bytes, &AS_IS).expect_err(words);
        assert!(error.contains(words) && error.starts_with("it: ") && error.lines().count() == 1, "{words:?}: {error}");
    }
}

#[test]
fn made_strands_are_where_they_should_be() {
    for (what, size, strands) in [
        (GeneratedStrands::Single { length_mm: 4.0 }, [4.0, 0.0, 0.0], 1),
        (GeneratedStrands::Layer { count: 10, layers: 3, spacing_mm: 0.2, length_mm: 4.0 }, [4.0, 1.9, 0.4], 30),
        (GeneratedStrands::Ball { count: 500, ball_mm: 10.0, length_mm: 6.0, curl_mm: 0.5 }, [32.0, 32.0, 32.0], 500),
        (GeneratedStrands::Wisp { count: 300, width_mm: 3.0, length_mm: 60.0 }, [25.0, 20.0, 60.0], 300),
        (GeneratedStrands::Fur { count: 800, size_mm: 20.0, length_mm: 6.0 }, [26.0, 26.0, 6.6], 800),
        (GeneratedStrands::Loop { count: 40, loops: 3, width_mm: 2.0, yarn_mm: 0.25 }, [8.0, 3.7, 1.5], 40),
    ] {
        let made = make(&what, 0.03, 24, 7).unwrap();
        assert_eq!((made.len(), made.segments()), (strands, 24 * strands), "{what:?}");
        assert_eq!(made, make(&what, 0.03, 24, 7).unwrap());
        let [low, high] = made.bounds();
        for k in 0..3 {
            // Control points lie a segment beyond the ends.
            let extent = high[k] - low[k];
            assert!(
                extent < 1.15 * size[k] + 0.2 && extent >= 0.4 * size[k],
                "{what:?}: {extent} along {k}, not {}",
                size[k]
            );
        }
    }
    let what = GeneratedStrands::Fur { count: u32::MAX, size_mm: 1.0, length_mm: 1.0 };
    assert!(make(&what, 0.03, 1000, 7).unwrap_err().to_string().contains("at most"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]
    /// Any file gives strands or an error of one line, without a panic or exhausted memory.
    #[test]
    fn damaged_files(at in 0usize..260, byte in any::<u8>(), length in 0usize..260, text in "[0-9 .eE\\-\n\"\\[\\]aShpecurv]{0,200}") {
        let mut bytes = hair(&[A, B], None, None);
        let n = bytes.len();
        bytes[at % n] = byte;
        bytes.truncate(length.max(4).min(n));
        for bytes in [&bytes[..], text.as_bytes(), format!("Shape \"curve\" {text}").as_bytes()] {
            if let Err(error) = read(bytes, &AS_IS) {
                prop_assert!(error.lines().count() == 1, "{}", error);
            }
        }
    }
}
