//! Skies from files: OpenEXR by layers, luminance and one channel, in half and float; Radiance in its three
//! codings; invalid radiances; files that are not skies.

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
    let layer = |(name, channels): &Part<'_>| {
        let list: SmallVec<[AnyChannel<FlatSamples>; 4]> =
            channels.iter().map(|(name, samples)| AnyChannel::new(Text::new_or_panic(name), samples.clone())).collect();
        let attributes = if name.is_empty() { LayerAttributes::default() } else { LayerAttributes::named(*name) };
        Layer::new(Vec2(4, 2), attributes, Encoding::UNCOMPRESSED, AnyChannels::sort(list))
    };
    let layers: Vec<_> = parts.iter().map(layer).collect();
    let attributes = ImageAttributes::new(IntegerBounds::new(Vec2(0, 0), Vec2(4, 2)));
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
    for (line, word) in
        [("-Y 100000 +X 200000", "texels"), ("-Y 4000 +X 8000", "cut off"), ("-Y 0 +X 8", "0"), ("+Y 4 +X 8", "+Y")]
    {
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
