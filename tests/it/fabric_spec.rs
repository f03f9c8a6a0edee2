//! Fabric specs and WIF files: valid ones load, invalid ones are refused in one line that names section, key
//! and hint, and none panics.

use plywave::fabric::{Draft, Fabric, FabricSpec, LoadedFabric, MAX_THREADS, Wif, YarnColor, YarnSet, YarnShape};
use plywave::io::{Folder, MemoryAssets};
use plywave::{Error, PlyModel};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

const NAMES: [&str; 5] = ["polyester_satin", "cotton_twill", "silk_organza", "wool_plain", "cotton_plain"];

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fabrics/{name}.toml"))
}

fn satin() -> String {
    std::fs::read_to_string(shipped("polyester_satin")).unwrap()
}

fn satin_with(old: &str, new: &str) -> String {
    let text = satin();
    assert!(text.contains(old), "{old}");
    text.replacen(old, new, 1)
}

/// The satin's yarns in another weave.
fn woven(weave: &str) -> String {
    satin_with("kind = \"satin\"\nn = 5\nstep = 2\n", weave)
}

fn one_line<T>(result: &plywave::Result<T>) -> String {
    let message = result.as_ref().err().map(ToString::to_string).unwrap_or_default();
    assert!(!message.contains(['\n', '\r']), "{message:?}");
    message
}

#[test]
fn fabrics_that_ship_load() {
    for name in NAMES {
        let loaded = FabricSpec::load(shipped(name)).unwrap_or_else(|e| panic!("{e}"));
        loaded.spec.check("again").unwrap();
        for family in YarnSet::EACH {
            let shape = loaded.fabric.shape(family);
            assert!(shape.spacing_um >= shape.width_um(), "{name}: {shape:?}");
            // The model has offsets to R + d_cut: plies are those of the model.
            let last = *loaded.model_of(family, 0).data().h_um.last().unwrap();
            assert!((shape.ply_radius_um + shape.d_cut_um - last).abs() < 1e-6, "{name}: {shape:?} {last}");
            assert!(matches!(loaded.fabric.color(family, -3), YarnColor::Srgb(_)), "{name}");
        }
        assert_eq!(loaded.notes(), Vec::<String>::new(), "{name}: its models are of its plies, with edge and layers");
        assert_eq!(FabricSpec::parse(&toml::to_string(&loaded.spec).unwrap(), "again").unwrap(), loaded.spec);
    }
    let twill = FabricSpec::load(shipped("cotton_twill")).unwrap();
    assert_eq!(twill.fabric.draft(), &Draft::twill(3, 1).unwrap());
    let plain = FabricSpec::load(shipped("cotton_plain")).unwrap();
    assert!(plain.models.len() == 1, "one model is read once");
}

#[test]
fn refusals_name_key_value_and_mend() {
    let warp = |new: &str| satin_with("spacing_um = 102.0", new);
    let cases = [
        (warp("spacing_um = -1"), "warp.spacing_um = -1: use a number from 0.01"),
        (warp("spacing_mm = 0.1"), "warp.spacing_mm = 0.1: unknown unit: use spacing_um"),
        (warp(""), "warp.spacing_um = (absent): this key must be given"),
        (warp("spacing_um = 102.0\nwidth = 3"), "warp.width = 3: unknown key: use one of model, plies"),
        (satin_with("plies = 1", "plies = 8"), "warp.plies = 8: use an integer from 1 to 7"),
        (satin_with("plies = 1", "handedness = \"X\""), "warp.handedness = \"X\": use one of \"Z\", \"S\""),
        (satin_with("crimp = 0.95", "crimp = 1.5"), "warp.crimp = 1.5: use a number from 0 to 1"),
        (satin_with("crimp = 0.95", "crimp = 0.99"), "weft.crimp = 0.05: crimps add up to 1.040; use 1 or less"),
        (satin_with("[0.50, 0.06, 0.12]", "[0.5, 0.06]"), "warp.srgb = [0.5, 0.06]: use three numbers"),
        (satin_with("[0.50, 0.06, 0.12]", "[255, 6, 12]"), "warp.srgb = [255, 6, 12]: use three numbers from 0 to 1"),
        (
            satin_with("srgb = [0.50", "sigma_per_um = 0.1\nsrgb = [0.50"),
            "warp.sigma_per_um = 0.1: give either srgb or",
        ),
        (satin_with("model = \"models/polyester.pwm\"", "model = \"\""), "warp.model = \"\": use a text in quotes"),
        (satin_with("name = ", "fiber = {}\nname = "), "fiber = {}: this is a key of a yarn spec"),
        (satin_with("[weft]", "[woof]"), "woof = {"),
        (
            woven("kind = \"velvet\""),
            "weave.kind = \"velvet\": use one of \"plain\", \"twill\", \"satin\", \"basket\", \"layers\", \"draft\", \"wif\"",
        ),
        (woven(""), "weave.kind = (absent): use one of"),
        (woven("kind = \"plain\"\nn = 2"), "weave.n = 2: unknown key: this kind has none"),
        (woven("kind = \"twill\"\nup = 3"), "weave.down = (absent)"),
        (woven("kind = \"twill\"\nup = 0\ndown = 1"), "weave.up = 0: use an integer from 1 to 2048"),
        (
            woven("kind = \"satin\"\nn = 8\nstep = 2"),
            "weave.step = 2: step and n = 8 must have no common factor; use one of 3, 5",
        ),
        (woven("kind = \"satin\"\nn = 6\nstep = 2"), "weave.step = 2: no satin has 6 ends"),
        (woven("kind = \"satin\"\nn = 5\nstep = 4"), "weave.step = 4: step and n = 5"),
        (woven("kind = \"satin\"\nn = 4\nstep = 2"), "weave.n = 4: use an integer from 5 to 4096"),
        (woven("kind = \"basket\"\nn = 4000"), "weave.n = 4000: use an integer from 1 to 2048"),
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
        let message = one_line(&FabricSpec::parse(&text, "cloth.toml"));
        assert!(message.starts_with("cloth.toml: ") && message.contains(expected), "got {message}\nwant {expected}");
    }
    let wide = format!("kind = \"draft\"\nrows = [\"{}\"]", "X".repeat(MAX_THREADS + 1));
    let message = one_line(&FabricSpec::parse(&woven(&wide), "cloth.toml"));
    assert!(message.contains("1 to 4096; the first has 4097"), "{message}");
}

/// A folder with the satin's text changed, beside a WIF and a model.
fn load_with(text: &str, wif: Option<&str>) -> plywave::Result<Fabric> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("models")).unwrap();
    std::fs::copy(
        shipped("polyester_satin").with_file_name("models/polyester.pwm"),
        folder.path().join("models/polyester.pwm"),
    )
    .unwrap();
    if let Some(wif) = wif {
        std::fs::write(folder.path().join("cloth.wif"), wif).unwrap();
    }
    let path = folder.path().join("cloth.toml");
    std::fs::write(&path, text).unwrap();
    FabricSpec::load(&path).map(|loaded| loaded.fabric)
}

#[test]
fn what_files_say_is_held_together() {
    for (text, expected) in [
        (satin_with("spacing_um = 102.0", "spacing_um = 99.0"), "warp.spacing_um = 99: the yarn is 100.00 um wide"),
        (satin_with("plies = 1", "plies = 3"), "warp.spacing_um = 102: the yarn is 215.47 um wide"),
        (
            satin_with("plies = 1", "plies = 1\nply_radius_um = 60"),
            "models/polyester.pwm is of plies of radius 50 um; leave this key out",
        ),
        (
            satin_with("spacing_um = 102.0", "spacing_um = 400\nply_pitch_um = 150").replacen(
                "plies = 1",
                "plies = 2",
                1,
            ),
            "warp.ply_pitch_um = 150: plies of this pitch would intersect; use more than 200 um",
        ),
        (woven("kind = \"wif\"\nfile = \"none.wif\""), "none.wif"),
    ] {
        let message = one_line(&load_with(&text, None));
        assert!(message.contains(expected), "got {message}\nwant {expected}");
    }
    assert!(load_with(&satin_with("models/polyester.pwm", "models/none.pwm"), None).is_err());
    assert!(load_with(&satin_with("plies = 1", "plies = 1\nply_radius_um = 50.0"), None).is_ok());
    let wif = woven("kind = \"wif\"\nfile = \"cloth.wif\"").replace("srgb = [0.50, 0.06, 0.12]", "");
    let fabric = load_with(&wif, Some(TWILL)).unwrap();
    assert_eq!(fabric.color(YarnSet::Warp, 4), YarnColor::Srgb([1.0, 0.0, 0.0]));
    assert_eq!(fabric.color(YarnSet::Weft, -1), YarnColor::Srgb([0.0, 0.0, 1.0]));
    // A color of the spec takes precedence over those of the file.
    let dyed = wif.replacen("[warp]", "[warp]\nsigma_per_um = 0.5", 1);
    assert_eq!(load_with(&dyed, Some(TWILL)).unwrap().color(YarnSet::Warp, 7), YarnColor::Sigma(0.5));
}

/// Plies of the model, of the fabric, and the notes.
#[test]
fn yarns_have_the_plies_of_their_models() {
    let folder = tempfile::tempdir().unwrap();
    let mut data =
        PlyModel::load(shipped("polyester_satin").with_file_name("models/polyester.pwm")).unwrap().data().clone();
    data.save(folder.path().join("one.pwm")).unwrap();
    data.spec_text.push_str("\n[yarn]\nplies = 3\nply_pitch_um = 2000.0\n");
    data.save(folder.path().join("three.pwm")).unwrap();
    let load = |model: &str, plies: u32| {
        let text = satin().replace("models/polyester.pwm", model);
        let yarns = format!("plies = {plies}\nply_pitch_um = 2000.0");
        let text = text.replace("plies = 1", &yarns).replace("spacing_um = 102.0", "spacing_um = 300.0");
        let path = folder.path().join("cloth.toml");
        std::fs::write(&path, text.replace("spacing_um = 200.0", "spacing_um = 300.0")).unwrap();
        FabricSpec::load(&path)
    };
    let said = |model, plies| load(model, plies).unwrap().notes().join("; ");
    for plies in [1, 2, 4] {
        let message = one_line(&load("three.pwm", plies));
        let (value, hint) = (format!("cloth.toml: warp.plies = {plies}: "), "is of a yarn of 3 plies; use plies = 3");
        assert!(message.contains(&value) && message.contains(hint), "{message}");
    }
    // A model of one ply serves yarns of any number of plies, without a note.
    assert_eq!(said("three.pwm", 3), "");
    assert_eq!(said("one.pwm", 1), "");
    assert_eq!(said("one.pwm", 2), "");
    // A flat ply lies on one of its sides, unlike a model of plies in all orientations.
    data.spec_text = plywave::spec::POLYESTER.replace("radius_um = 50.0", "radii_um = [50.0, 40.0]");
    data.save(folder.path().join("flat.pwm")).unwrap();
    let message = one_line(&load("flat.pwm", 1));
    assert!(
        message.contains("warp.model = ") && message.contains("flat.pwm is of elliptical plies, 50 x 40 um"),
        "{message}"
    );
}

fn polyester() -> Vec<u8> {
    std::fs::read(shipped("polyester_satin").with_file_name("models/polyester.pwm")).unwrap()
}

/// Hosts without a file system get the same fabric from bytes, and from already loaded models.
#[test]
fn fabrics_are_built_in_memory() {
    let text = woven("kind = \"wif\"\nfile = \"cloth.wif\"\n");
    let assets = MemoryAssets::new().with("models/polyester.pwm", polyester()).with("cloth.wif", TWILL.as_bytes());
    let loaded = FabricSpec::load_from(&text, "cloth.toml", &assets).unwrap();
    assert_eq!((loaded.models.len(), &loaded.threads), (1, &[vec![0], vec![0]]));
    assert_eq!(loaded.fabric.draft(), load_with(&text, Some(TWILL)).unwrap().draft());
    let wif = || Some(Wif::parse(TWILL.as_bytes(), "t.wif").unwrap());
    let model = || vec![loaded.models[0].clone()];
    let again = LoadedFabric::new(loaded.spec.clone(), wif(), [model(), model()]).unwrap();
    assert_eq!((again.models.len(), again.fabric.draft()), (1, loaded.fabric.draft()));
    assert_eq!(again.fabric.color(YarnSet::Weft, 3), loaded.fabric.color(YarnSet::Weft, 3));
    for (result, expected) in [
        (LoadedFabric::new(loaded.spec.clone(), None, [model(), model()]), "weave.kind = no draft"),
        (LoadedFabric::new(loaded.spec.clone(), wif(), [model(), vec![]]), "weft.models = 0 models: hand in 1"),
        (FabricSpec::load_from(&satin(), "cloth.toml", &MemoryAssets::new()), "no such asset in memory"),
    ] {
        let message = one_line(&result);
        assert!(message.contains(expected), "got {message}\nwant {expected}");
    }
}

/// Names refer to files in the spec's folder only, unless the host allows others.
#[test]
fn specs_read_their_own_folder_only() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("inner")).unwrap();
    std::fs::write(folder.path().join("polyester.pwm"), polyester()).unwrap();
    let path = folder.path().join("inner/cloth.toml");
    let absolute = folder.path().join("polyester.pwm").display().to_string();
    for name in ["../polyester.pwm", &absolute] {
        let text = satin_with("models/polyester.pwm", name).replace("models/polyester.pwm", name);
        std::fs::write(&path, &text).unwrap();
        let message = one_line(&FabricSpec::load(&path));
        assert!(message.contains("leads out of the folder"), "{message}");
        let anywhere = Folder::of_file(&path).anywhere();
        assert_eq!(FabricSpec::load_from(&text, "cloth.toml", &anywhere).unwrap().models.len(), 1);
    }
}

#[test]
fn stripes_give_each_yarn_its_model() {
    let one = PlyModel::from_bytes(&polyester(), "one").unwrap().data().clone();
    let with_spec = |old: &str, new: &str| {
        let mut data = one.clone();
        assert!(data.spec_text.contains(old), "{old}");
        data.spec_text = data.spec_text.replacen(old, new, 1);
        data.to_bytes().unwrap()
    };
    let assets = MemoryAssets::new()
        .with("one.pwm", one.to_bytes().unwrap())
        .with("like.pwm", with_spec("name = ", "name = \"another\" # "))
        .with("thin.pwm", with_spec("radius_um = 50", "radius_um = 49"))
        .with("beam.pwm", with_spec("[ply]", "[beam]\nw0_um = 9.0\n[ply]"));
    let (warp, weft) = ("model = \"models/polyester.pwm\"", "model = \"one.pwm\"");
    let striped = |models: &str| {
        let text = satin().replacen(warp, models, 1).replace("models/polyester.pwm", "one.pwm");
        FabricSpec::load_from(&text, "cloth.toml", &assets)
    };
    let loaded = striped("models = { A = \"one.pwm\", C = \"like.pwm\" }\nthreads = \"AAC\"").unwrap();
    assert_eq!((loaded.models.len(), &loaded.threads), (2, &[vec![0, 0, 1], vec![0]]));
    let index = |yarn| loaded.model_index(YarnSet::Warp, yarn);
    assert_eq!([-4, -1, 0, 1, 2, 3, 5, i32::MIN].map(index), [1, 1, 0, 0, 1, 0, 1, 0]);
    assert!((i32::MIN..i32::MIN + 9).all(|yarn| loaded.model_index(YarnSet::Weft, yarn) == 0));
    assert_eq!(FabricSpec::parse(&toml::to_string(&loaded.spec).unwrap(), "again").unwrap(), loaded.spec);
    for (models, expected) in [
        ("", "warp.model = (absent): give model, or models and threads"),
        ("models = { A = \"one.pwm\" }", "warp.threads = (absent): say which yarn has which model, such as \"AA\""),
        ("threads = \"AB\"", "warp.model = (absent)"),
        (&format!("{weft}\nthreads = \"AB\""), "warp.threads = AB: give models"),
        (&format!("{weft}\nmodels = {{ A = \"one.pwm\" }}"), "warp.model = one.pwm: give either model or models"),
        ("models = { A = \"one.pwm\" }\nthreads = \"AB\"", "warp.threads = AB: use 1 to 4096 of the letters A"),
        ("models = { A = \"one.pwm\", B = \"x.pwm\" }\nthreads = \"A\"", "warp.models.B = x.pwm: no yarn"),
        ("models = { a = \"one.pwm\" }\nthreads = \"a\"", "use a table of texts by capital letters"),
        (
            "models = { A = \"one.pwm\", B = \"thin.pwm\" }\nthreads = \"AB\"",
            "plies of radius 49 and 50 um in one family",
        ),
        ("models = { A = \"one.pwm\", B = \"beam.pwm\" }\nthreads = \"AB\"", "beams of w0 9 and 10 um"),
    ] {
        let message = one_line(&striped(models));
        assert!(message.contains(expected), "got {message}\nwant {expected}");
    }
}

/// A 2/2 twill of four ends and eight picks; ends 1 and 2 red, the others white, picks blue.
const TWILL: &str = "\u{feff}; a comment\r\n[WIF]\r\nVersion=1.1\r\nDate=April 20, 1997\r\nDevelopers=none\r\n\r\n\
[Contents]\r\nWEAVING=yes\r\nWARP=true\r\nWEFT=1\r\nTHREADING=on\r\nTIEUP=true\r\nTREADLING=true\r\nCOLOR TABLE=true\r\n\
[COLOR PALETTE]\r\nRange=0,999\r\n[COLOR TABLE]\r\n1=999,0,0\r\n2=999, 999, 999\r\n3=0,0,999\r\n\
[WEAVING]\r\nShafts=4\r\nTreadles=5\r\nRising Shed=true\r\n[WARP]\r\nThreads=4\r\nColor=2\r\n[WEFT]\r\nThreads=8\r\nColor=3 ; blue\r\n\
[WARP COLORS]\r\n1=1\r\n2=1,7,7\r\n[THREADING]\r\n1=1\r\n2=2\r\n3=3\r\n4=4\r\n\
[TIEUP]\r\n1=1,2\r\n2=2,3\r\n3=3,4\r\n4=1,4\r\n5=0\r\n[TREADLING]\r\n1=1\r\n2=2\r\n3=3\r\n4=4\r\n5=1\r\n6=2\r\n7=3,5\r\n8=4\r\n\
[NOTES]\r\n1=what = ever\r\n";

fn drawn(draft: &Draft) -> Vec<String> {
    let row = |pick: usize| (0..draft.ends()).map(|end| if draft.up(pick, end) { 'X' } else { '.' }).collect();
    (0..draft.picks()).map(row).collect()
}

#[test]
fn wifs_are_read() {
    let wif = Wif::parse(TWILL.as_bytes(), "t.wif").unwrap();
    let four = ["XX..", ".XX.", "..XX", "X..X"];
    assert_eq!(drawn(&wif.draft), [four, four].concat());
    let [red, white, blue] = [[1.0, 0.0, 0.0], [1.0; 3], [0.0, 0.0, 1.0]];
    assert_eq!((wif.warp_srgb, wif.weft_srgb), (vec![red, red, white, white], vec![blue; 8]));

    // A sinking shed lowers the tied shafts.
    let sinking = Wif::parse(TWILL.replace("Shed=true", "Shed=no").as_bytes(), "t.wif").unwrap();
    assert_eq!(drawn(&sinking.draft)[..4], ["..XX", "X..X", "XX..", ".XX."]);
    // A lift plan counts before treadles; several shafts to an end, several treadles to a pick.
    let plan =
        TWILL.replace("[NOTES]", "[LIFTPLAN]\r\n1=1,2,3\r\n2=4\r\n3=2\r\n4=1\r\n5=2\r\n6=3\r\n7=4\r\n8=4\r\n[NOTES]");
    assert_eq!(drawn(&Wif::parse(plan.as_bytes(), "t.wif").unwrap().draft)[..3], ["XXX.", "...X", ".X.."]);
    let two = TWILL
        .replace("\r\n2=2\r\n3=3\r\n4=4\r\n[TIEUP]", "\r\n2=2,3\r\n3=3\r\n4=4\r\n[TIEUP]")
        .replace("TREADLING]\r\n1=1", "TREADLING]\r\n1=1,3,5");
    let loose = Wif::parse(two.as_bytes(), "t.wif").unwrap();
    assert_eq!(
        (loose.draft.picks(), loose.notes[0].to_string().as_str()),
        (7, "pick 1 left out, loose below all ends")
    );
    let two = two.replace("1=1,3,5", "1=1,5");
    assert_eq!(drawn(&Wif::parse(two.as_bytes(), "t.wif").unwrap().draft)[..4], ["XX..", ".XX.", ".XXX", "X..X"]);
    // No colors, and bytes of another alphabet in a comment.
    let mut plain: Vec<u8> = TWILL.replace("[COLOR TABLE]", "[OTHER]").into_bytes();
    plain.extend_from_slice(b"; \xe9t\xe9\r\n");
    assert!(Wif::parse(&plain, "t.wif").is_ok_and(|w| w.warp_srgb.is_empty() && w.weft_srgb.is_empty()));
}

#[test]
fn wifs_are_refused_by_section_and_key() {
    let cut = |from: &str, to: &str| {
        let (a, b) = (TWILL.find(from).unwrap(), TWILL.find(to).unwrap());
        format!("{}{}", &TWILL[..a], &TWILL[b..])
    };
    let with = |old: &str, new: &str| {
        assert!(TWILL.contains(old), "{old}");
        TWILL.replacen(old, new, 1)
    };
    for (text, expected) in [
        (cut("[WIF]", "[Contents]"), "no section [WIF]"),
        (String::new(), "no section [WIF]"),
        (cut("[THREADING]", "[TIEUP]"), "[THREADING] 1 = (absent): the section [THREADING] is missing"),
        (with("Shafts=4", "Shafts=99999"), "[WEAVING] Shafts = 99999: use a whole number from 1 to 4096"),
        (with("Shed=true", "Shed=perhaps"), "[WEAVING] Rising Shed = perhaps: use true or false"),
        (
            with("[WARP]\r\nThreads=4", "[WARP]\r\nThreads=18446744073709551615"),
            "[WARP] Threads = 18446744073709551615: use a whole number from 1 to 4096",
        ),
        (
            with("2=2\r\n3=3\r\n4=4\r\n[TIEUP]", "2=-2\r\n3=3\r\n4=4\r\n[TIEUP]"),
            "[THREADING] 2 = -2: use whole numbers",
        ),
        (with("4=1,4\r\n5=0", "4=1,9999\r\n5=0"), "[TIEUP] 4 = 1,9999: use numbers from 1 to 4096"),
        (
            cut("[TIEUP]", "[NOTES]"),
            "[TREADLING] 1 = (absent): the section [TREADLING] is missing; give either [LIFTPLAN]",
        ),
        (with("1=999,0,0", "1=999,0"), "[COLOR TABLE] 1 = 999,0: use three whole numbers"),
        (with("2=1,7,7", "2=red"), "[WARP COLORS] 2 = red: use whole numbers"),
        (with("Color=2\r\n", "Color=white\r\n"), "[WARP] Color = white: use the number of a color"),
    ] {
        let result = Wif::parse(text.as_bytes(), "t.wif");
        let message = one_line(&result);
        assert!(message.starts_with("t.wif: ") && message.contains(expected), "got {message}\nwant {expected}");
        assert!(matches!(result, Err(Error::Invalid { .. } | Error::Format { .. })));
    }
}

#[test]
fn shapes_of_a_host_are_checked() {
    let good = YarnShape {
        plies: 2,
        ply_radius_um: 50.0,
        ply_pitch_um: Some(800.0),
        handedness: plywave::spec::Handedness::Z,
        spacing_um: 200.0,
        crimp: 0.5,
        d_cut_um: 20.0,
    };
    let of = |shape: YarnShape| one_line(&Fabric::new(Draft::plain(), [good, shape]));
    assert_eq!(of(good), "");
    for (shape, expected) in [
        (YarnShape { spacing_um: 199.0, ..good }, "weft.spacing_um = 199"),
        (YarnShape { spacing_um: f64::NAN, ..good }, "weft.spacing_um = NaN"),
        (YarnShape { ply_radius_um: f64::INFINITY, ..good }, "weft.ply_radius_um = inf"),
        (YarnShape { plies: 0, ..good }, "weft.plies = 0"),
        (YarnShape { plies: u32::MAX, ..good }, "weft.plies = 4294967295"),
        (YarnShape { crimp: f64::NAN, ..good }, "weft.crimp = NaN"),
        (YarnShape { d_cut_um: -1.0, ..good }, "weft.d_cut_um = -1"),
        (YarnShape { ply_pitch_um: Some(0.0), ..good }, "weft.ply_pitch_um = 0"),
    ] {
        assert!(of(shape).contains(expected), "{expected}: {}", of(shape));
    }
    let floats = Draft::from_fn(2, 2, |_, end| end == 0).unwrap();
    assert!(one_line(&Fabric::new(floats, [good, good])).contains("draft = warp 1 lies above all others"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_wifs_are_read_or_refused(at in 0.0..1.0f64, cut in 0usize..40, new in prop::collection::vec(any::<u8>(), 0..8), digits in "[0-9,=\\[\\]\n]{0,9}", which in any::<bool>()) {
        let bytes = TWILL.as_bytes();
        let start = (at * bytes.len() as f64) as usize;
        let end = (start + cut).min(bytes.len());
        let new = if which { new } else { digits.into_bytes() };
        let damaged = [&bytes[..start], &new[..], &bytes[end..]].concat();
        let result = Wif::parse(&damaged, "t.wif");
        one_line(&result);
        if let Ok(wif) = result {
            prop_assert!(wif.draft.unbound().is_none());
        }
    }

    #[test]
    fn any_bytes_are_a_wif_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        one_line(&Wif::parse(&bytes, "t.wif"));
        one_line(&Wif::parse(&[b"[WIF]\n[WARP]\nThreads=3\n[WEFT]\nThreads=3\n[WEAVING]\nShafts=3\n[THREADING]\n", &bytes[..]].concat(), "t.wif"));
    }

    #[test]
    fn mutated_specs_are_parsed_or_refused(at in 0.0..1.0f64, cut in 0usize..12, new in "[-0-9a-zX_.=\\[\\]{}\"\n, ]{0,8}") {
        let text = satin();
        let start = text.floor_char_boundary((at * text.len() as f64) as usize);
        let end = text.floor_char_boundary((start + cut).min(text.len()));
        let result = FabricSpec::parse(&format!("{}{new}{}", &text[..start], &text[end..]), "cloth.toml");
        one_line(&result);
        if let Ok(spec) = result {
            spec.check("accepted").unwrap();
        }
    }
}
