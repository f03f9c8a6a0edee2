//! Cloth specs: those that ship are read, invalid ones are refused in one line that names
//! section, key and hint, and none panics.

use plywave::cloth::YarnColor;
use plywave_textile::{ClothSpec, Draft, MAX_THREADS, NamedWeave, WeaveSpec};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/cloths")
}

fn satin() -> String {
    std::fs::read_to_string(folder().join("satin.toml")).unwrap()
}

fn satin_with(old: &str, new: &str) -> String {
    let text = satin();
    assert!(text.contains(old), "{old}");
    text.replacen(old, new, 1)
}

/// The satin's yarns in another weave.
fn woven(weave: &str) -> String {
    satin_with("kind = \"satin 5/2\"\n", &format!("{weave}\n"))
}

fn one_line<T>(result: &plywave::Result<T>) -> String {
    let message = result.as_ref().err().map(ToString::to_string).unwrap_or_default();
    assert!(!message.contains(['\n', '\r']), "{message:?}");
    message
}

#[test]
fn cloths_that_ship_are_read() {
    let mut count = 0;
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "toml") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let spec = ClothSpec::parse(&text, "shipped").unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        // The order of keys and tables does not matter.
        let sorted = toml::to_string(&text.parse::<toml::Table>().unwrap()).unwrap();
        assert_eq!(ClothSpec::parse(&sorted, "again").unwrap(), spec);
        assert_eq!(spec.yarns().len(), if spec.weave.is_some() { 2 } else { 1 });
        for yarn in spec.yarns() {
            let ships = |model: &String| {
                folder().join(model).exists() || folder().join(format!("../models/{model}.pwm")).exists()
            };
            assert!(yarn.model.as_ref().is_none_or(ships), "{}: {:?}", path.display(), yarn.model);
        }
        count += 1;
    }
    assert!(count > 6, "{count} cloths");
    assert_eq!(ClothSpec::parse(&satin(), "satin").unwrap().draft(), Draft::satin(5, 2));
}

#[test]
fn refusals_name_key_value_and_mend() {
    let cases = [
        (satin_with("ends_per_cm = ", "ends_per_cm = -"), "weave.ends_per_cm = -"),
        (satin_with("ends_per_cm = ", "ends_per_mm = "), "weave.ends_per_mm = "),
        (satin_with("[warp]", "[warp]\nwidth = 3"), "warp.width = 3: unknown key: use one of as, fiber, count"),
        (satin_with("[warp]", "[warp]\ntwist = \"X 300/m\""), "warp.twist = \"X 300/m\": "),
        (satin_with("[warp]", "[warp]\ntwist = \"300/m\""), "warp.twist = \"300/m\": begin with the direction, Z or S"),
        (satin_with("[warp]", "[warp]\nfinish = \"mercerised\""), "\"mercerised\" is no finish; use one of carded"),
        (satin_with("[warp]", "[warp]\nplies = 8"), "warp.plies = 8: use an integer from 1 to 7"),
        (satin_with("[warp]", "[warp]\nmodel = \"\""), "warp.model = \"\""),
        (satin_with("name = ", "fiber = {}\nname = "), "fiber = {}: this is a key of a ply spec"),
        (satin_with("name = ", "color_of = \"red\"\nname = "), "color_of = \"red\": use one of \"even_sky\""),
        (satin_with("[weft]", "[woof]"), "woof = {"),
        (satin_with("as = \"warp\"", "as = \"wefts\""), "weft.as = \"wefts\": name the other yarn, \"warp\""),
        (
            woven("kind = \"velvet\""),
            "weave.kind = \"velvet\": \"velvet\" is no weave; use plain, twill, satin, sateen, herringbone, chevron, hopsack, oxford, rib, birdseye, \
             houndstooth, layers, draft or wif",
        ),
        (woven(""), "weave.kind = (absent): give the name of a weave, or a picture"),
        (woven("kind = 5"), "weave.kind = 5: use the name of a weave in quotes"),
        (woven("kind = \"plain\"\nn = 2"), "weave.n = 2: unknown key: use one of kind, rows, file"),
        (woven("kind = \"plain\"\nrows = [\"X\"]"), "weave.rows = [\"X\"]: leave it out, or use kind = \"draft\""),
        (woven("kind = \"draft\""), "weave.rows = (absent): this key must be given"),
        (woven("kind = \"wif\""), "weave.file = (absent): this key must be given"),
        (woven("kind = \"twill\""), "weave.kind = \"twill\": write picks over and under, as twill 2/2"),
        (woven("kind = \"twil 2/2\""), "weave.kind = \"twil 2/2\": \"twil\" is no weave; did you mean twill?"),
        (woven("kind = \"twill 0/1\""), "weave.kind = \"twill 0/1\": use counts of 1 or more"),
        (
            woven("kind = \"satin 8/2\""),
            "weave.kind = \"satin 8/2\": step and ends of satin 8/2 must have no common factor; use a step of 3, 5",
        ),
        (woven("kind = \"satin 6/2\""), "weave.kind = \"satin 6/2\": no satin has 6 ends"),
        (woven("kind = \"hopsack 4000/4000\""), "weave.kind = \"hopsack 4000/4000\": use counts of 1 or more"),
        (woven("kind = \"draft\"\nrows = []"), "weave.rows = 0 rows: use 1 to 4096 rows"),
        (woven("kind = \"draft\"\nrows = [\"X.\", \".X.\"]"), "weave.rows[1] = 3 characters: use rows of one length"),
        (woven("kind = \"draft\"\nrows = [\"X.\", \".x\"]"), "weave.rows[1] = .x: use X where"),
        (
            woven("kind = \"draft\"\nrows = [\"X.\", \"..\"]"),
            "weave.rows = row 2, whose weft lies above all others: bind every yarn",
        ),
        (
            woven("kind = \"draft\"\nrows = [\"XX.\", \"X.X\"]"),
            "weave.rows = column 1, whose warp lies above all others",
        ),
        ("name = \"a\"\n[weave\n".into(), "line 2: "),
        (String::new(), "name = (absent)"),
    ];
    for (text, expected) in cases {
        let message = one_line(&ClothSpec::parse(&text, "cloth.toml"));
        assert!(message.starts_with("cloth.toml: ") && message.contains(expected), "got {message}\nwant {expected}");
    }
    let wide = format!("kind = \"draft\"\nrows = [\"{}\"]", "X".repeat(MAX_THREADS + 1));
    let message = one_line(&ClothSpec::parse(&woven(&wide), "cloth.toml"));
    assert!(message.contains("1 to 4096; the first has 4097"), "{message}");
}

/// Keys of colors, slits and unevenness that contradict each other, or are out of range.
#[test]
fn colors_slits_and_unevenness_are_held_together() {
    let spec = |warp: &str| {
        format!(
            "name = \"small\"\n[weave]\nkind = \"plain\"\nends_per_cm = 52\npicks_per_cm = 52\n\
             [warp]\nfiber = \"polyester\"\ncount = \"10 tex\"\n{warp}\n[weft]\nfiber = \"polyester\"\ncount = \"10 tex\"\n"
        )
    };
    for (warp, expected) in [
        ("color = [0.5, 0.06]", "warp.color = [0.5, 0.06]: use three numbers"),
        (
            "color = [256, 6, 12]",
            "warp.color = [256, 6, 12]: use three numbers from 0 to 1, or three whole numbers up to 255",
        ),
        ("color = [1.5, 0.5, 0.5]", "warp.color = [1.5, 0.5, 0.5]: use three numbers"),
        ("color = \"red\"", "or \"#rrggbb\" or \"#rgb\""),
        ("color = [0.5, 0.1, 0.1]\nsigma_per_um = 0.1", "warp.sigma_per_um = 0.1: give either color or"),
        ("stripes = [{ count = 0, color = [1, 0, 0] }]", "warp.stripes = "),
        ("stripes = [{ count = 5000, color = [1, 0, 0] }]", "4096 yarns at most"),
        ("stripes = [{ count = 1, color = [1, 0, 2.5] }]", "use stripes such as"),
        (
            "stripes = [{ count = 1, color = [1, 0, 0] }]\nsigma_per_um = 0.1",
            "count = 1 }]: give either sigma_per_um or stripes",
        ),
        ("slit_share = 0.2", "warp.slit_share = 0.2: give slit_um"),
        ("uneven_mm = 5.0", "warp.uneven_mm = 5"),
        ("count_cv = 0.9", "warp.count_cv = 0.9: use a number from 0 to 0.5"),
        ("spacing_cv = -0.1", "warp.spacing_cv = -0.1: use a number from 0 to 0.15"),
    ] {
        let message = one_line(&ClothSpec::parse(&spec(warp), "cloth.toml"));
        assert!(message.starts_with("cloth.toml: ") && message.contains(expected), "got {message}\nwant {expected}");
    }
    // The forms of one color: in a spec, its color is the same.
    let red = [200.0, 30.0, 40.0].map(|v: f64| v / 255.0);
    for form in ["[200, 30, 40]", "\"#c81e28\"", "\"200, 30, 40\""] {
        let parsed = ClothSpec::parse(&spec(&format!("color = {form}")), "red").unwrap();
        assert_eq!(parsed.yarns()[0].color, YarnColor::Srgb(red.map(|v| v as f32)), "{form}");
        let stripe = format!("stripes = [{{ count = 1, color = {form} }}]");
        assert_eq!(ClothSpec::parse(&spec(&stripe), "red").unwrap().yarns()[0].stripes[0].color, red);
    }
    let striped = spec("stripes = [{ count = 2, color = [1, 0, 0] }, { count = 1, color = [0, 0, 1] }]");
    let spec = ClothSpec::parse(&striped, "striped").unwrap();
    assert_eq!(spec.yarns()[0].stripes.iter().map(|stripe| stripe.count).collect::<Vec<_>>(), [2, 1]);
    assert!(matches!(spec.weave, Some(WeaveSpec::Named(NamedWeave::Plain))));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn mutated_specs_are_parsed_or_refused(at in 0.0..1.0f64, cut in 0usize..12, new in "[-0-9a-zX_.=\\[\\]{}\"\n, ]{0,8}") {
        let text = satin();
        let start = text.floor_char_boundary((at * text.len() as f64) as usize);
        let end = text.floor_char_boundary((start + cut).min(text.len()));
        let result = ClothSpec::parse(&format!("{}{new}{}", &text[..start], &text[end..]), "cloth.toml");
        one_line(&result);
        if let Ok(spec) = result {
            for yarn in spec.yarns() {
                prop_assert!(yarn.strand_radius_um() > 0.0 && yarn.radius_um().is_finite());
            }
        }
    }
}
