//! `plywave plot`: PNG and SVG by the ending of the output, the same in both, names of any script, and which
//! files are no figures' sources.

use crate::common::{TINY, build, folder, json, names, refused, succeed};
use std::path::Path;

const NAME: &str = "Żółw & <Ångström> Μετάξι шёлк 絹";
const SVG: &str = "http://www.w3.org/2000/svg";

fn all<'a>(document: &'a roxmltree::Document<'_>, name: &'static str) -> Vec<roxmltree::Node<'a, 'a>> {
    document.descendants().filter(|n| n.has_tag_name((SVG, name))).collect()
}

/// Builds a model and a table of a yarn named [`NAME`].
fn named(dir: &Path) {
    std::fs::write(dir.join("tiny.toml"), TINY.replace("\"tiny\"", &format!("\"{NAME}\""))).unwrap();
    build(dir);
}

/// One figure as both: an XML document of the PNG's size that names the yarn, has its maps as images, and a
/// heading inside the page.
#[test]
#[ignore = "slow: 10 s: both formats show one figure"]
fn both_formats_show_one_figure() {
    let folder = folder();
    let dir = folder.path();
    named(dir);
    let figures: &[&[&str]] = &[
        &["tiny.pwm", "--table", "tiny.pwt"],
        &["tiny.pwm", "--part", "energy"],
        &["tiny.toml"],
        &["tiny.toml", "--part", "edge"],
    ];
    for figure in figures {
        let plot = |output: &str| json(&succeed(dir, &[&["plot"], *figure, &["-o", output, "--json"]].concat()));
        let (png, svg) = (plot("a.png"), plot("a.SVG"));
        assert_eq!((&png["png"], &svg["svg"]), (&"a.png".into(), &"a.SVG".into()));
        let source = std::fs::read_to_string(dir.join("a.SVG")).unwrap();
        let document = roxmltree::Document::parse(&source).unwrap_or_else(|e| panic!("{figure:?}: {e}"));
        let image = image::open(dir.join("a.png")).unwrap().to_rgb8();
        let root = document.root_element();
        for (key, size) in [("width", image.width()), ("height", image.height())] {
            assert_eq!(root.attribute(key), Some(size.to_string().as_str()), "{figure:?}");
            assert_eq!((&png[key], &svg[key]), (&size.into(), &size.into()), "{figure:?}");
        }
        let titles = all(&document, "title");
        assert!(titles[0].text().is_some_and(|t| t.starts_with(NAME)), "{figure:?}: {:?}", titles[0].text());
        let texts: Vec<&str> = document.descendants().filter_map(|n| n.attribute("aria-label")).collect();
        assert!(texts.iter().any(|t| t.starts_with(NAME)), "{figure:?}: {texts:?}");
        let outlined = |n: &roxmltree::Node<'_, '_>| n.attribute("d").is_some_and(|d| d.starts_with('M'));
        assert!(all(&document, "path").iter().all(outlined) && all(&document, "text").is_empty(), "{figure:?}");
        let maps = all(&document, "image");
        let is_png = |href: &str| href.starts_with("data:image/png;base64,");
        assert!(maps.iter().all(|n| n.attribute("href").is_some_and(is_png)));
        // Three columns of f_refl and f_high in nine rows at most, and their bars; two exposures of four
        // gaps; no maps elsewhere.
        match figure {
            [_, "--table", _] => assert!(maps.len() >= 10, "{figure:?}: {}", maps.len()),
            ["tiny.toml"] => assert_eq!(maps.len(), 8),
            _ => assert!(maps.is_empty(), "{figure:?}"),
        }
        // The name's letters are ink: the heading reaches as far as its text, which here is half a page or
        // less.
        let heading = image.enumerate_pixels().filter(|(_, y, p)| *y < 44 && p.0[0] < 128);
        let end = heading.map(|(x, _, _)| x).max().unwrap_or(0);
        assert!(end > 28 + 9 * NAME.chars().count() as u32 && end < image.width() - 28, "{figure:?}: {end}");
    }
}

/// The same words twice are the same figure, also of text: nothing depends on the machine's fonts or on the
/// order of a table.
#[test]
#[ignore = "slow: 5 s: figures are reproducible"]
fn figures_are_reproducible() {
    let folder = folder();
    let dir = folder.path();
    named(dir);
    for ending in ["png", "svg"] {
        let [a, b] = ["a", "b"].map(|name| {
            let output = format!("{name}.{ending}");
            succeed(dir, &["plot", "tiny.pwt", "-o", &output, "--quiet"]);
            std::fs::read(dir.join(output)).unwrap()
        });
        assert!(a == b, "{ending}");
    }
}

#[test]
fn endings_and_sources_are_refused_in_one_line() {
    let folder = folder();
    let dir = folder.path();
    build(dir);
    for output in ["a.jpg", "a.pdf", "a", "a.png.gz"] {
        refused(dir, &["plot", "tiny.pwm", "-o", output], &[output, "-o", ".png or .svg"]);
    }
    std::fs::write(dir.join("scene.toml"), "lambda_um = [0.5]\n[[fiber]]\nshape = \"circle\"\n").unwrap();
    std::fs::write(dir.join("noise.bin"), (0..200u8).map(|i| i.wrapping_mul(37)).collect::<Vec<_>>()).unwrap();
    std::fs::write(dir.join("empty.pwm"), []).unwrap();
    image::RgbImage::new(9, 9).save(dir.join("picture.png")).unwrap();
    for (file, what) in [("scene.toml", "a scene"), ("picture.png", "a picture"), ("noise.bin", "no file of plywave's")]
    {
        refused(dir, &["plot", file, "-o", "a.svg"], &[file, what, ".pwm", ".pwt", "a yarn spec (TOML)"]);
    }
    refused(dir, &["plot", "empty.pwm", "-o", "a.svg"], &["empty.pwm", "give a table or model"]);
    refused(dir, &["plot", "none.pwm"], &["none.pwm", "no such file"]);
    std::fs::write(dir.join("bad.toml"), TINY.replace("eta = 1.58", "eta = 0")).unwrap();
    refused(dir, &["plot", "bad.toml"], &["bad.toml", "eta"]);
    assert!(!names(dir).contains(&"a.svg".to_string()));
}

#[test]
fn counts_of_one_are_singular() {
    let folder = folder();
    let dir = folder.path();
    let lone = TINY.replace("fibers = 12", "fibers = 1").replace("radius_um = 40.0", "radius_um = 20.0");
    std::fs::write(dir.join("tiny.toml"), lone).unwrap();
    build(dir);
    succeed(dir, &["plot", "tiny.pwm", "--part", "energy", "-o", "a.svg", "--quiet"]);
    let source = std::fs::read_to_string(dir.join("a.svg")).unwrap();
    assert!(source.contains("1 fiber, circle") && !source.contains("1 fibers"));
    assert!(!succeed(dir, &["info", "tiny.pwm"]).contains("1 fibers"));
}
