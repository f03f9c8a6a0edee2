//! A file of the wrong kind, or none, is told at once and in one line, by every command and flag that takes a
//! file: what it is, and what was expected.

use crate::common::{TINY, refused};
use std::path::Path;

/// Each kind of file: its name, what it is in words, and what is in it. Of containers the header alone, which
/// is all that is looked at.
fn kinds() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let container = |format: &str, version: u64| {
        let document = serde_json::json!({ "format": format, "version": version }).to_string();
        let header = serde_json::json!({ "__metadata__": { "plywave": document } }).to_string();
        [&(header.len() as u64).to_le_bytes()[..], header.as_bytes()].concat()
    };
    let text = |text: &str| text.as_bytes().to_vec();
    vec![
        ("k.pwt", "a table (.pwt)", container("plywave-table", 1)),
        ("k.pwm", "a ply model (.pwm)", container("plywave-ply", 3)),
        ("k.pwf", "a fiber table (.pwf)", container("plywave-fiber", 1)),
        ("k.pws", "speckle patterns (.pws)", container("plywave-speckle", 1)),
        ("k.pwx", "the twin of a cloth (.pwx)", container("plywave-twin", 1)),
        ("k.pwfam", "a family of plies (.pwfam)", container("plywave-family", 1)),
        ("k.pwp", "a part of a run (.pwp)", container("plywave-part", 1)),
        ("yarn.toml", "a yarn spec (TOML)", text(TINY)),
        (
            "cloth.toml",
            "a cloth spec (TOML)",
            text("name = \"f\"\n[weave]\nkind = \"plain\"\n[warp]\nmodel = \"silk\"\n"),
        ),
        ("k.pwc", "a cloth (.pwc)", container("plywave-cloth", 3)),
        ("filament.toml", "an analytic fiber (TOML)", text("[filament]\nkind = \"dielectric\"\n")),
        ("scene.toml", "a scene for waves (TOML)", text("lambda_um = 0.5\n[[fiber]]\neta = 1.5\n")),
        ("strands.toml", "a scene of strands (TOML)", text("[strands]\nmake = { kind = \"ball\" }\n[fiber]\n")),
        ("library.toml", "a library of the farm (TOML)", text("name = \"l\"\n[[yarn]]\nspec = \"yarn.toml\"\n")),
        ("k.png", "a picture", b"\x89PNG\r\n\x1a\n and so on".to_vec()),
        ("k.obj", "a mesh (OBJ)", text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")),
        ("k.wif", "a weaver's file (WIF)", text("[WIF]\nVersion=1.1\n")),
        ("k.hair", "strands (.hair)", b"HAIR\x01\0\0\0".to_vec()),
    ]
}

/// Every place of a file on the command line, `FILE` for it, and the kinds that it takes.
fn places() -> Vec<(&'static str, Vec<&'static str>)> {
    const AT: &str = "--theta-i 0 --h-rel 0";
    let leak = |text: String| -> &'static str { Box::leak(text.into_boxed_str()) };
    vec![
        ("simulate FILE", vec!["yarn.toml"]),
        ("fit FILE", vec!["k.pwt"]),
        ("fit k.pwt --spec FILE", vec!["yarn.toml"]),
        ("build FILE", vec!["yarn.toml"]),
        ("build yarn.toml --speckle FILE", vec!["k.pws"]),
        ("family FILE", vec!["yarn.toml", "k.pwfam"]),
        // A spec is refused too, for the flag.
        ("family FILE --param eta=1.5", vec!["k.pwfam", "yarn.toml"]),
        ("info FILE", vec!["k.pwm", "yarn.toml", "k.pwt", "k.pwf", "k.pws", "k.pwx", "k.pwfam", "k.pwc"]),
        (leak(format!("eval FILE --theta-o 0 --phi-o 0 {AT}")), vec!["k.pwm"]),
        (leak(format!("sample FILE {AT}")), vec!["k.pwm"]),
        ("check FILE", vec!["k.pwm", "k.pwfam", "cloth.toml", "k.pwc", "filament.toml"]),
        ("check k.pwm --table FILE", vec!["k.pwt"]),
        ("check k.pwm --traced FILE", vec!["k.pwt"]),
        ("check cloth.toml --twin FILE", vec!["k.pwx"]),
        ("diff FILE k.pwm", vec!["k.pwm", "k.pwt"]),
        ("diff k.pwm FILE", vec!["k.pwm"]),
        ("diff k.pwt FILE", vec!["k.pwt"]),
        ("plot FILE -o out.png", vec!["k.pwm", "k.pwt", "k.pwf", "k.pws", "yarn.toml", "cloth.toml", "k.pwc"]),
        ("plot k.pwm --table FILE -o out.png", vec!["k.pwt"]),
        ("plot k.pwt --model FILE -o out.png", vec!["k.pwm"]),
        ("compare FILE", vec!["yarn.toml"]),
        ("render FILE -o out.png", vec!["cloth.toml", "k.pwc", "strands.toml"]),
        ("render cloth.toml --mesh FILE -o out.png", vec!["k.obj"]),
        ("render cloth.toml --sky FILE -o out.png", vec!["k.png"]),
        ("merge FILE -o out.pwt", vec!["k.pwp"]),
        ("noise FILE", vec!["k.pws"]),
        ("noise k.pws -m FILE", vec!["k.pwm"]),
        ("color FILE --srgb 1,0,0", vec!["k.pwm", "cloth.toml", "k.pwc"]),
        ("farm FILE", vec!["library.toml"]),
        ("twin FILE", vec!["cloth.toml"]),
        ("weave FILE", vec!["cloth.toml"]),
        ("wave scatter FILE", vec!["scene.toml"]),
        ("wave speckle FILE", vec!["yarn.toml"]),
        ("wave tabulate FILE", vec!["yarn.toml", "scene.toml"]),
    ]
}

fn refused_at(dir: &Path, place: &str, file: &str, words: &[&str]) {
    let args: Vec<&str> = place.split(' ').map(|word| if word == "FILE" { file } else { word }).collect();
    refused(dir, &args, words);
}

#[test]
fn every_command_names_the_wrong_kind_and_the_right_one() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let kinds = kinds();
    for (file, _, bytes) in &kinds {
        std::fs::write(dir.join(file), bytes).unwrap();
    }
    std::fs::write(dir.join("notes.txt"), "nothing of plywave's\n").unwrap();
    std::fs::write(dir.join("noise.bin"), [0u8, 1, 2, 0xfe, 0xff].repeat(40)).unwrap();
    for (place, wanted) in places() {
        let words_of = |name: &str| kinds.iter().find(|(file, ..)| *file == name).map(|k| k.1).unwrap();
        let expected = format!("expected {}", words_of(wanted[0]));
        for (file, words, _) in kinds.iter().filter(|(file, ..)| !wanted.contains(file)) {
            let mut all = vec![*file, *words];
            // The one flag that narrows what a command takes.
            let narrowed = place.contains("--param");
            all.extend(if narrowed { vec!["expected a family"] } else { wanted.iter().map(|w| words_of(w)).collect() });
            all.push(&expected);
            refused_at(dir, place, file, &all);
        }
        // What is not there: which kind it should be.
        refused_at(dir, place, "none.toml", &["none.toml", "no such file", &expected]);
        // What is of no kind: its name and no panic. Of two files the other, which is a header alone, may be
        // told first.
        let is_one = !["k.pw", "cloth.toml", "yarn.toml"].iter().any(|other| place.contains(other));
        refused_at(dir, place, "noise.bin", if is_one { &["noise.bin"] } else { &[] });
        if wanted.iter().all(|w| w.starts_with("k.") && *w != "k.obj") {
            refused_at(dir, place, "notes.txt", &["notes.txt", "a text that is no file of plywave's", &expected]);
        }
    }
    refused(
        dir,
        &["family", "none.pwfam", "--param", "eta=1.5"],
        &["none.pwfam", "a family of plies", "plywave family SPEC"],
    );
    refused(dir, &["fit", "none.pwt"], &["none.pwt: no such file", "expected a table", "plywave simulate SPEC"]);
    refused(dir, &["build", "noise.bin"], &["noise.bin: neither text", "expected a yarn spec"]);
}
