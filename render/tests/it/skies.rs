//! Skies from files: OpenEXR by layers, luminance and one channel, in half and float; Radiance in its three
//! codings; other primaries; windows and sizes; invalid radiances; files that are not skies.

use exr::meta::attribute::Chromaticities;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
    SmallVec, Text, Vec2, WritableImage, f16,
};
use plywave_render::Environment;
use std::path::{Path, PathBuf};

fn field(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/field").join(name)
}

/// A part of an EXR of 4 x 2 pixels: its name, its channels; of each a value for every pixel.
type Part<'a> = (&'a str, &'a [(&'a str, FlatSamples)]);

fn floats(values: [f32; 8]) -> FlatSamples {
    FlatSamples::F32(values.to_vec())
}

fn halves(values: [f32; 8]) -> FlatSamples {
    FlatSamples::F16(values.map(f16::from_f32).to_vec())
}

fn same(value: f32) -> FlatSamples {
    floats([value; 8])
}

fn exr(path: &Path, parts: &[Part<'_>]) {
    exr_with(path, parts, None);
}

/// Chromaticities of red, green, blue and white: of ACES AP1, and of CIE XYZ.
const AP1: [[f32; 2]; 4] = [[0.713, 0.293], [0.165, 0.830], [0.128, 0.044], [0.32168, 0.33767]];
const XYZ: [[f32; 2]; 4] = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0 / 3.0, 1.0 / 3.0]];

fn exr_with(path: &Path, parts: &[Part<'_>], primaries: Option<[[f32; 2]; 4]>) {
    let layer = |(name, channels): &Part<'_>| {
        let list: SmallVec<[AnyChannel<FlatSamples>; 4]> =
            channels.iter().map(|(name, samples)| AnyChannel::new(Text::new_or_panic(name), samples.clone())).collect();
        let attributes = if name.is_empty() { LayerAttributes::default() } else { LayerAttributes::named(*name) };
        Layer::new(Vec2(4, 2), attributes, Encoding::UNCOMPRESSED, AnyChannels::sort(list))
    };
    let layers: Vec<_> = parts.iter().map(layer).collect();
    let mut attributes = ImageAttributes::new(IntegerBounds::new(Vec2(0, 0), Vec2(4, 2)));
    attributes.chromaticities = primaries.map(|list| {
        let [red, green, blue, white] = list.map(|[x, y]| Vec2(x, y));
        Chromaticities { red, green, blue, white }
    });
    Image::from_layers(attributes, layers).write().to_file(path).unwrap();
}

/// A sky of 4 x 2 texels of one color.
fn even(srgb: [f32; 3]) -> Environment {
    Environment::picture(4, vec![srgb; 8]).unwrap()
}

fn loaded(path: &Path, layer: Option<&str>) -> (Environment, String) {
    let (sky, notes) = Environment::load(path, layer).unwrap_or_else(|e| panic!("{e}"));
    (sky, notes.join("\n"))
}

fn refused(path: &Path, layer: Option<&str>, words: &[&str]) {
    let error = Environment::load(path, layer).expect_err("a refusal").to_string();
    assert_eq!(error.lines().count(), 1, "{error}");
    for word in words.iter().copied().chain(path.file_name().and_then(|n| n.to_str())) {
        assert!(error.contains(word), "no {word:?} in {error}");
    }
}

#[test]
fn colors_are_found_in_any_layer() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    let (sky, notes) = loaded(&field("sky_files/layer.exr"), None);
    assert!(!sky.is_dark() && notes.is_empty(), "{notes}");
    let rgb = |prefix: &str, v: f32| {
        ["B", "G", "R"].map(|c| (format!("{prefix}{c}"), same(v * [1.0, 2.0, 3.0]["RGB".find(c).unwrap()])))
    };
    let want = |v: f32| even([v, 2.0 * v, 3.0 * v]);
    let write = |parts: &[(&str, Vec<(String, FlatSamples)>)]| {
        let parts: Vec<(&str, Vec<(&str, FlatSamples)>)> =
            parts.iter().map(|(n, list)| (*n, list.iter().map(|(c, s)| (c.as_str(), s.clone())).collect())).collect();
        let parts: Vec<Part<'_>> = parts.iter().map(|(n, list)| (*n, list.as_slice())).collect();
        exr(&path, &parts);
    };
    // Blender's layers: the whole of the light, though it is not the first.
    let layers = || [rgb("View.Combined.", 1.0), rgb("View.AO.", 2.0), rgb("View.Env.", 3.0)].concat();
    write(&[("", layers())]);
    let (sky, notes) = loaded(&path, None);
    assert_eq!(sky, want(1.0));
    assert!(notes.contains("View.Combined") && notes.contains("View.AO, View.Env"), "{notes}");
    assert_eq!(loaded(&path, Some("view.env")).0, want(3.0));
    refused(&path, Some("Sky"), &["no layer Sky", "View.AO, View.Combined, View.Env"]);
    // Without a name before named ones, whatever their order; colors in small letters; a depth beside.
    let mut list = [rgb("a.", 2.0), rgb("", 1.0)].concat();
    list.push(("Z".into(), same(1e10)));
    write(&[("", list)]);
    assert_eq!(loaded(&path, None).0, want(1.0));
    let small = rgb("sky.", 1.0).map(|(name, samples)| (name.to_lowercase(), samples));
    write(&[("", small.to_vec())]);
    assert_eq!(loaded(&path, None), (want(1.0), String::new()));
    // Parts with channels of the same names.
    write(&[("left", rgb("", 1.0).to_vec()), ("right", rgb("", 2.0).to_vec())]);
    assert!(loaded(&path, None).1.contains("right"));
    assert_eq!(loaded(&path, Some("right")).0, want(2.0));
    // None that is a color.
    exr(&path, &[("", &[("normal.X", same(0.0)), ("normal.Y", same(0.0)), ("normal.Z", same(1.0)), ("A", same(1.0))])]);
    refused(&path, None, &["A, normal.X, normal.Y, normal.Z", "R, G and B"]);
    exr(&path, &[("", &[("a.depth", same(1.0)), ("b.mask", same(1.0))])]);
    refused(&path, None, &["a.depth, b.mask", "--sky-layer"]);
    assert_eq!(loaded(&path, Some("a.depth")).0, even([1.0; 3]));
}

#[test]
fn luminance_is_gray_and_chroma_has_its_color() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    for samples in [floats([0.5; 8]), halves([0.5; 8]), FlatSamples::U32(vec![2; 8])] {
        let want = if matches!(samples, FlatSamples::U32(_)) { 2.0 } else { 0.5 };
        for (name, note) in [("Y", ""), ("sky.Y", ""), ("V", "its one channel, V, is taken as gray")] {
            exr(&path, &[("", &[("A", same(1.0)), (name, samples.clone())])]);
            assert_eq!(loaded(&path, None), (even([want; 3]), note.to_string()), "{name}");
        }
    }
    exr(&path, &[("", &[("BY", same(0.25)), ("RY", same(-0.5)), ("Y", same(0.5))])]);
    let green = (0.5f32 - 0.2126 * 0.25 - 0.0722 * 0.625) / 0.7152;
    assert_eq!(loaded(&path, None), (even([0.25, green, 0.625]), String::new()));
    // OpenEXR's own files of chroma have it at half the resolution, which is not read.
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(3).position(|w| w == b"RY\0").unwrap() + 3 + 8;
    bytes[at] = 2;
    bytes[at + 4] = 2;
    std::fs::write(&path, bytes).unwrap();
    refused(&path, None, &["RY"]);
}

#[test]
fn values_that_are_no_radiances_are_mended_and_told() {
    let (sky, notes) = loaded(&field("sky_files/negative.exr"), None);
    assert!(!sky.is_dark());
    assert_eq!(notes, "R of pixel (10, 5) is -0.0001, taken as 0");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    let one = [1.0f32; 8];
    let with = |place: usize, v: f32| {
        let mut values = one;
        values[place] = v;
        values
    };
    let sky = |place: usize, channel: usize, v: f32| {
        let mut texels = vec![[1.0; 3]; 8];
        texels[place][channel] = v;
        Environment::picture(4, texels).unwrap()
    };
    for (bad, told, mended) in [
        (-1e-4, "-0.0001", 0.0),
        (f32::NAN, "NaN", 0.0),
        (f32::INFINITY, "inf", 0.0),
        (f32::NEG_INFINITY, "-inf", 0.0),
        (3e38, "3e38", 1e12),
    ] {
        exr(&path, &[("", &[("sky.B", floats(one)), ("sky.G", floats(with(6, bad))), ("sky.R", floats(one))])]);
        let (got, notes) = loaded(&path, None);
        assert_eq!(got, sky(6, 1, mended), "{bad}");
        for word in ["sky.G of pixel (2, 1)", "taken as"] {
            assert!(notes.contains(word), "{notes}");
        }
        assert!(bad > 1e37 || notes.contains(told), "{notes}");
    }
    // Values too bright for a half float become the largest one.
    exr(&path, &[("", &[("B", halves(one)), ("G", halves(one)), ("R", halves(with(3, f32::INFINITY)))])]);
    let (got, notes) = loaded(&path, None);
    assert_eq!(got, sky(3, 0, 65504.0));
    assert!(notes.contains("R of pixel (3, 0) is inf, taken as 65504"), "{notes}");
    // Several: how many and the first.
    let bad = [1.0, 1.0, -2.0, 1.0, f32::NAN, 1.0, 1.0, -1.0];
    exr(&path, &[("", &[("B", floats(one)), ("G", floats(one)), ("R", floats(bad))])]);
    let notes = loaded(&path, None).1;
    assert!(notes.contains("3 values") && notes.contains("R of pixel (2, 0)") && notes.contains("-2"), "{notes}");
    // A gray picture has each value once.
    exr(&path, &[("", &[("Y", floats(bad))])]);
    assert!(loaded(&path, None).1.contains("3 values"));
    exr(&path, &[("", &[("Y", same(-1.0))])]);
    let (dark, notes) = loaded(&path, None);
    assert!(dark.is_dark() && notes.contains("8 values") && notes.contains("no light"), "{notes}");
}

#[test]
fn windows_place_the_data() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    // Data of 4 x 2 pixels in a picture of 6 x 3 that starts elsewhere.
    let channels = AnyChannels::sort(SmallVec::from_vec(vec![AnyChannel::new(Text::new_or_panic("Y"), same(1.0))]));
    let attributes = LayerAttributes { layer_position: Vec2(11, -4), ..LayerAttributes::default() };
    let layer = Layer::new(Vec2(4, 2), attributes, Encoding::UNCOMPRESSED, channels);
    let window = ImageAttributes::new(IntegerBounds::new(Vec2(10, -5), Vec2(6, 3)));
    Image::from_layers(window, vec![layer]).write().to_file(&path).unwrap();
    let (sky, notes) = loaded(&path, None);
    let lit = |k: usize| (1..5).contains(&(k % 6)) && k >= 6;
    let texels = (0..18).map(|k| if lit(k) { [1.0; 3] } else { [0.0; 3] }).collect();
    assert_eq!(sky, Environment::picture(6, texels).unwrap());
    assert!(notes.contains("10 of 6 x 3 texels"), "{notes}");
}

/// Radiances of the first texel in the three bands; of a gray, they are its value.
fn bands(sky: &Environment) -> [f32; 3] {
    let text = format!("{sky:?}");
    let first = text.split("texels: [[").nth(1).and_then(|rest| rest.split(']').next()).unwrap();
    let numbers: Vec<f32> = first.split(", ").map(|v| v.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

#[test]
fn other_primaries_are_converted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    const CONVERTED: &str = "its colors are converted from its own primaries to those of sRGB";
    // Half of the first column of the published matrix from AP1 to sRGB, before it is cut at 0.
    let (_, notes) = loaded(&field("sky_primaries/primaries.hdr"), None);
    assert!(notes.starts_with(CONVERTED) && notes.contains("(0, 0), is (0.8525, -0.0651, -0.0120)"), "{notes}");
    let (gray, notes) = loaded(&field("sky_primaries/xyz_grey.exr"), None);
    assert_eq!(notes, CONVERTED);
    // Its numbers have three digits.
    let numbers = bands(&gray);
    assert!(numbers.iter().all(|v| (v - 0.5).abs() < 1.5e-3), "{numbers:?}");
    // One color in both kinds of files.
    let texel = [128u8, 64, 32, 128];
    let line = "PRIMARIES= 0.713 0.293 0.165 0.830 0.128 0.044 0.32168 0.33767\n";
    let hdr = folder.path().join("sky.hdr");
    std::fs::write(&hdr, radiance(line, &vec![[texel; 8].concat(); 4])).unwrap();
    let rgb = [("B", same(0.125)), ("G", same(0.25)), ("R", same(0.5))];
    exr_with(&path, &[("", &rgb)], Some(AP1));
    let published = [
        1.70505 * 0.5 - 0.62179 * 0.25 - 0.08326 * 0.125,
        -0.13026 * 0.5 + 1.14080 * 0.25 - 0.01055 * 0.125,
        -0.02400 * 0.5 - 0.12897 * 0.25 + 1.15297 * 0.125,
    ];
    let want = bands(&even(published));
    for got in [&hdr, &path].map(|file| bands(&loaded(file, None).0)) {
        assert!(got.iter().zip(&want).all(|(a, b)| (a - b).abs() < 2e-4), "{got:?}, want {want:?}");
    }
    // Luminance and chroma by the luminance of these primaries: of XYZ it is the green alone.
    let (y, ry, by) = (0.5f32, -0.5, 0.25);
    exr_with(&path, &[("", &[("BY", same(by)), ("RY", same(ry)), ("Y", same(y))])], Some(XYZ));
    let chroma = loaded(&path, None).0;
    let rgb = [("B", same((1.0 + by) * y)), ("G", same(y)), ("R", same((1.0 + ry) * y))];
    exr_with(&path, &[("", &rgb)], Some(XYZ));
    assert!(chroma == loaded(&path, None).0);
    // Grays have no primaries; those of sRGB need no conversion.
    exr_with(&path, &[("", &[("Y", same(0.5))])], Some(XYZ));
    assert_eq!(loaded(&path, None), (even([0.5; 3]), String::new()));
    // A value below 0 of narrow primaries may be a color of sRGB; what is no number is replaced before.
    let narrow = [[0.55, 0.35], [0.30, 0.50], [0.18, 0.12], [0.3127, 0.3290]];
    exr_with(&path, &[("", &[("B", same(-0.01)), ("G", same(0.2)), ("R", same(0.2))])], Some(narrow));
    assert_eq!(loaded(&path, None).1, CONVERTED);
    exr_with(&path, &[("", &[("B", same(f32::NAN)), ("G", same(0.2)), ("R", same(0.2))])], Some(XYZ));
    assert!(loaded(&path, None).1.contains("8 values are no radiances"));
    // Primaries that are none.
    exr_with(&path, &[("", &rgb)], Some([[0.3, 0.3]; 4]));
    refused(&path, None, &["make no colors"]);
    let plain = vec![[texel; 8].concat(); 4];
    for bad in ["PRIMARIES=0.64 0.33\n", "PRIMARIES=none\n"] {
        std::fs::write(&hdr, radiance(bad, &plain)).unwrap();
        refused(&hdr, None, &["PRIMARIES=", "eight numbers"]);
    }
    std::fs::write(&hdr, radiance("PRIMARIES=0 0 0 0 0 0 0 0\n", &plain)).unwrap();
    refused(&hdr, None, &["make no colors"]);
}

/// An EXR with gray data of a size at a place, in a display window.
fn windows(path: &Path, data: [usize; 2], at: [i32; 2], display: [usize; 2], encoding: Encoding) {
    let samples = FlatSamples::F32(vec![1.0; data[0] * data[1]]);
    let channels = AnyChannels::sort(SmallVec::from_vec(vec![AnyChannel::new(Text::new_or_panic("Y"), samples)]));
    let attributes = LayerAttributes { layer_position: Vec2(at[0], at[1]), ..LayerAttributes::default() };
    let layer = Layer::new(Vec2(data[0], data[1]), attributes, encoding, channels);
    let window = ImageAttributes::new(IntegerBounds::new(Vec2(0, 0), Vec2(display[0], display[1])));
    Image::from_layers(window, vec![layer]).write().to_file(path).unwrap();
}

#[test]
fn windows_that_the_data_do_not_fill_are_refused() {
    let whole = "twice as wide as high";
    refused(&field("exr_display_window/sky.exr"), None, &["8355810 x 16", whole]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    for (data, display, word) in [
        ([32, 16], [16384, 8192], "a display window of 16384 x 8192 texels for data of 32 x 16"),
        ([2000, 1000], [2, 1], "a display window of 2 x 1 texels for data of 2000 x 1000"),
        ([32, 16], [16, 64], whole),
        ([32, 16], [400, 32], whole),
    ] {
        windows(&path, data, [0, 0], display, Encoding::SMALL_LOSSLESS);
        refused(&path, None, &[word]);
    }
    // A lamp of a few degrees in a dark sky, and data all around the display window, in tiles too.
    let tiles = Encoding { blocks: exr::prelude::Blocks::Tiles(Vec2(7, 5)), ..Encoding::SMALL_LOSSLESS };
    for encoding in [Encoding::UNCOMPRESSED, Encoding::SMALL_LOSSLESS, Encoding::FAST_LOSSLESS, tiles] {
        windows(&path, [10, 10], [300, 100], [1024, 512], encoding);
        let (sky, notes) = loaded(&path, None);
        let lit = |k: usize| (300..310).contains(&(k % 1024)) && (100..110).contains(&(k / 1024));
        let texels = (0..1024 * 512).map(|k| if lit(k) { [1.0; 3] } else { [0.0; 3] }).collect();
        assert!(sky == Environment::picture(1024, texels).unwrap() && notes.contains("outside its data window"));
        windows(&path, [20, 12], [-4, -3], [8, 4], encoding);
        assert!(loaded(&path, None) == (Environment::picture(8, vec![[1.0; 3]; 32]).unwrap(), String::new()));
    }
    // A file that ends early, at every place.
    let bytes = std::fs::read(&path).unwrap();
    for cut in 0..bytes.len() {
        std::fs::write(&path, &bytes[..cut]).unwrap();
        refused(&path, None, &[]);
    }
}

/// Bytes of a Radiance picture of 8 x 4 texels: header lines, and rows by their four bytes a texel.
fn radiance(header: &str, rows: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = format!("#?RADIANCE\n{header}FORMAT=32-bit_rle_rgbe\n\n-Y {} +X 8\n", rows.len()).into_bytes();
    rows.iter().for_each(|row| bytes.extend(row));
    bytes
}

#[test]
fn radiance_pictures_are_read_in_their_three_codings() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.hdr");
    // (0.5, 1, 1.5) eight times: mantissas 64, 128, 192 over 256, times 2.
    let texel = [64u8, 128, 192, 129];
    let want = Environment::picture(8, vec![[0.5, 1.0, 1.5]; 32]).unwrap();
    let plain = [texel; 8].concat();
    // The texel once, and a run of seven more.
    let old = [&texel[..], &[1, 1, 1, 7]].concat();
    // For each component a run of five, and three literal values.
    let new: Vec<u8> =
        [vec![2, 2, 0, 8], texel.iter().flat_map(|b| [133, *b, 3, *b, *b, *b]).collect::<Vec<u8>>()].concat();
    for row in [plain.clone(), old, new.clone()] {
        std::fs::write(&path, radiance("", &vec![row; 4])).unwrap();
        assert_eq!(loaded(&path, None), (want.clone(), String::new()));
    }
    // Factors of the radiances in the header; comments; the other signature.
    let rows = vec![new.clone(); 4];
    std::fs::write(&path, radiance("# of a sky\nEXPOSURE=2\nEXPOSURE=0.25\nCOLORCORR=1 2 0.5\n", &rows)).unwrap();
    assert_eq!(loaded(&path, None).0, Environment::picture(8, vec![[1.0, 1.0, 6.0]; 32]).unwrap());
    let other = [b"#?RGBE", &radiance("", &rows)[10..]].concat();
    std::fs::write(&path, other).unwrap();
    assert_eq!(loaded(&path, None).0, want);
    // A value of 0 has no exponent.
    std::fs::write(&path, radiance("", &vec![[[0, 0, 0, 0]; 8].concat(); 4])).unwrap();
    assert!(loaded(&path, None).1.contains("black"));
    // Files that end early, huge sizes, other orders.
    let whole = radiance("", &rows);
    for cut in [2, 15, 40, whole.len() - 60, whole.len() - 1] {
        std::fs::write(&path, &whole[..cut]).unwrap();
        refused(&path, None, &[]);
    }
    let sized = |line: &str| String::from_utf8_lossy(&radiance("", &[])).replace("-Y 0 +X 8", line).into_bytes();
    for (line, word) in [
        ("-Y 100000 +X 200000", "texels"),
        ("-Y 4000 +X 8000", "cut off"),
        ("-Y 0 +X 8", "0"),
        ("+Y 4 +X 8", "+Y"),
        ("-Y 4 +X 33000000", "twice as wide"),
        ("-Y 5000 +X 8", "twice as wide"),
    ] {
        std::fs::write(&path, sized(line)).unwrap();
        refused(&path, None, &[word]);
    }
    std::fs::write(&path, radiance("EXPOSURE=0\n", &rows)).unwrap();
    refused(&path, None, &["EXPOSURE"]);
    std::fs::write(&path, radiance("", &rows)).unwrap();
    refused(&path, Some("sky"), &["no layers"]);
}

#[test]
fn other_shapes_are_told_and_other_files_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.hdr");
    std::fs::write(&path, radiance("", &vec![[[64u8, 64, 64, 129]; 8].concat(); 8])).unwrap();
    let notes = loaded(&path, None).1;
    assert!(notes.contains("8 x 8") && notes.contains("twice"), "{notes}");
    for bytes in
        [&b"\x89PNG\r\n\x1a\n0000"[..], b"", b"\x76\x2f", b"P6 1 1 255 000", b"\x76\x2f\x31\x01\x02\x00\x00\x00"]
    {
        std::fs::write(&path, bytes).unwrap();
        refused(&path, None, &[]);
    }
    refused(&folder.path().join("none.exr"), None, &[]);
}
