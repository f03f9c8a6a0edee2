//! Running the binary, and a small yarn for it.
#![allow(dead_code)]

use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;

/// A ply small enough to be simulated and fitted in a moment.
pub const TINY: &str = include_str!("../../../../tests/data/tiny.toml");

/// A few strands in the light of a lamp: a scene that is loaded in no time.
pub const STRANDS: &str = r#"
name = "few"
sky = 0.5

[strands]
make = { kind = "fur", count = 20, size_mm = 10.0, length_mm = 5.0 }
radius_um = 60.0
segments = 8

[fiber]
model = { kind = "dielectric" }

[camera]
from_mm = [0.0, -30.0, 20.0]
to_mm = [0.0, 0.0, 1.0]
fov_deg = 25.0

[[lamps]]
from_mm = [20.0, -20.0, 40.0]
size_mm = 10.0
radiance = 10.0
"#;

/// A cloth that is made in seconds: an open plain weave of one of the models that ship.
pub const CLOTH: &str = r#"name = "open cotton"

[weave]
kind = "plain"
ends_per_cm = 20
picks_per_cm = 20

[warp]
model = "models/cotton.pwm"
fiber = "cotton"
count = "5.27 tex"
packing = 0.5
color = [0.88, 0.88, 0.86]

[weft]
as = "warp"
"#;

/// Writes [`CLOTH`] as `cloth.toml`, its model and another beside it, and the cloth itself, woven once, as
/// `cloth.pwc`.
pub fn write_cloth(dir: &Path) {
    static WOVEN: OnceLock<Vec<u8>> = OnceLock::new();
    std::fs::create_dir(dir.join("models")).unwrap();
    for model in ["cotton.pwm", "polyester.pwm"] {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/models").join(model);
        std::fs::copy(shipped, dir.join("models").join(model)).unwrap();
    }
    std::fs::write(dir.join("cloth.toml"), CLOTH).unwrap();
    let woven = WOVEN.get_or_init(|| {
        succeed(dir, &["weave", "cloth.toml", "-o", "cloth.pwc", "-q"]);
        std::fs::read(dir.join("cloth.pwc")).unwrap()
    });
    std::fs::write(dir.join("cloth.pwc"), woven).unwrap();
}

/// Flags of `build` under which any fit is good: the lobes of [`TINY`] are few.
pub const ANY_FIT: &[&str] = &["--max-error-refl", "9", "--max-error-high", "9"];

/// The program, to be run in `folder`.
pub fn plywave(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plywave"));
    // Cloths that commands make are kept apart from those of who runs the tests.
    command.current_dir(folder).args(args).env("PLYWAVE_CACHE", concat!(env!("CARGO_TARGET_TMPDIR"), "/cloths"));
    command
}

/// Runs the program to its end.
pub fn run(folder: &Path, args: &[&str]) -> Output {
    plywave(folder, args).output().expect("the program starts")
}

/// Runs the program and expects success; gives what it printed.
pub fn succeed(folder: &Path, args: &[&str]) -> String {
    let output = run(folder, args);
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{args:?}: {}\n{out}{err}", output.status);
    out
}

/// Bytes as text.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Names in a folder, sorted.
pub fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .expect("the folder is there")
        .map(|e| e.expect("its entries can be read").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// A folder with `tiny.toml` in it.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("tiny.toml"), TINY).expect("it can be written");
    folder
}

/// Builds `tiny.pwm` and `tiny.pwt` in the folder.
pub fn build(folder: &Path) {
    succeed(folder, &[&["build", "tiny.toml", "--preset", "preview", "--keep-table", "--quiet"], ANY_FIT].concat());
}

/// Parses what a command printed with `--json`.
pub fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

/// Runs the program and expects a refusal whose line holds all of `words`.
pub fn refused(folder: &Path, args: &[&str], words: &[&str]) {
    let before = names(folder);
    let output = run(folder, args);
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(2), "{args:?}: {out}{err}");
    assert!(out.is_empty(), "{args:?} printed {out}");
    assert!(
        err.starts_with("error: ") && err.ends_with('\n') && err.lines().count() == 1,
        "{args:?}: not one line: {err}"
    );
    for word in words {
        assert!(err.contains(word), "{args:?}: no {word:?} in {err}");
    }
    assert_eq!(names(folder), before, "{args:?} wrote something");
}
