//! Detects the kind of a file from its first bytes and checks it against the kinds that a command takes; the
//! error names the found and the expected kind.

use crate::failure::{Failure, Outcome};
use plywave::io::{FileKind, ModelLibrary};
use plywave_pipeline::{ShippedKind, ShippedSpec};
use std::io::Read;
use std::path::Path;

/// Kinds of files that the commands read and write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputKind {
    /// Simulated scattering.
    Table,
    /// A fitted model.
    Model,
    /// A fiber's scattering.
    Fiber,
    /// Speckle patterns.
    Speckle,
    /// The twin of a cloth.
    Twin,
    /// A family of plies.
    Family,
    /// A yarn spec.
    Yarn,
    /// A cloth spec, in textile units.
    Cloth,
    /// A cloth, ready for shading.
    ClothFile,
    /// An analytic fiber.
    Filament,
    /// A scene of the wave simulator.
    WaveScene,
    /// A scene of strands.
    StrandScene,
    /// A picture.
    Picture,
    /// A mesh.
    Mesh,
    /// Parts of a run.
    Part,
    /// A library of the farm.
    Library,
    /// A weaver's file.
    Wif,
    /// Strands of hair.
    Hair,
}

impl InputKind {
    /// Name of the kind, with its article.
    fn words(self) -> &'static str {
        match self {
            InputKind::Table => "a table (.pwt)",
            InputKind::Model => "a ply model (.pwm)",
            InputKind::Fiber => "a fiber table (.pwf)",
            InputKind::Speckle => "speckle patterns (.pws)",
            InputKind::Twin => "the twin of a cloth (.pwx)",
            InputKind::Family => "a family of plies (.pwfam)",
            InputKind::Yarn => "a yarn spec (TOML)",
            InputKind::Cloth => "a cloth spec (TOML)",
            InputKind::ClothFile => "a cloth (.pwc)",
            InputKind::Filament => "an analytic fiber (TOML)",
            InputKind::WaveScene => "a scene for waves (TOML)",
            InputKind::StrandScene => "a scene of strands (TOML)",
            InputKind::Picture => "a picture",
            InputKind::Mesh => "a mesh (OBJ)",
            InputKind::Part => "a part of a run (.pwp)",
            InputKind::Library => "a library of the farm (TOML)",
            InputKind::Wif => "a weaver's file (WIF)",
            InputKind::Hair => "strands (.hair)",
        }
    }

    /// Whether files of this kind are text.
    fn is_text(self) -> bool {
        use InputKind::{Cloth, Filament, Library, Mesh, StrandScene, WaveScene, Wif, Yarn};
        matches!(self, Yarn | Cloth | Filament | WaveScene | StrandScene | Library | Wif | Mesh)
    }

    /// The command that makes files of this kind.
    fn made_by(self) -> Option<&'static str> {
        match self {
            InputKind::Table => Some("plywave simulate SPEC"),
            InputKind::Model => Some("plywave build SPEC"),
            InputKind::Fiber => Some("plywave wave tabulate SPEC"),
            InputKind::Speckle => Some("plywave wave speckle SPEC"),
            InputKind::Twin => Some("plywave twin CLOTH"),
            InputKind::Family => Some("plywave family SPEC"),
            InputKind::ClothFile => Some("plywave weave SPEC -o CLOTH.pwc"),
            InputKind::Part => Some("plywave simulate SPEC --shards I/N"),
            _ => None,
        }
    }

    /// Hint: the command that makes the wanted kind from this one, or a command that takes this one.
    fn hint(self, wanted: InputKind) -> &'static str {
        match (self, wanted) {
            (InputKind::Yarn, InputKind::Model) => "`plywave build SPEC` makes a model of it",
            (InputKind::Yarn, InputKind::Table) => "`plywave simulate SPEC` makes a table of it",
            (InputKind::Family, InputKind::Model) => {
                "`plywave family FAMILY --param KEY=VALUE` takes a model out of it"
            }
            (InputKind::Table, InputKind::Model) => "`plywave fit TABLE` makes a model of it",
            (InputKind::Model, InputKind::Cloth) => {
                "write a cloth spec that names it, as `plywave new jersey` writes one"
            }
            (InputKind::Yarn, InputKind::Cloth) => "build its model and write a cloth spec that names it",
            (InputKind::Cloth, InputKind::Twin) => "`plywave twin SPEC` makes one of it",
            (InputKind::Cloth, _) => "`plywave weave`, `plot`, `render`, `export` and `twin` take it",
            (InputKind::ClothFile, _) => "`plywave render`, `plot`, `export` and `info` take it",
            (InputKind::Yarn, _) => "`plywave build` takes it",
            (InputKind::Model, _) => "`plywave info` tells what it holds",
            (InputKind::Table, _) => "`plywave fit` takes it",
            (InputKind::Fiber | InputKind::Speckle | InputKind::Twin | InputKind::Family, _) => {
                "`plywave info` tells what it holds"
            }
            (InputKind::StrandScene, _) => "`plywave render` takes it",
            (InputKind::Filament, _) => "`plywave check` takes it",
            (InputKind::WaveScene, _) => "`plywave wave scatter` takes it",
            (InputKind::Part, _) => "`plywave merge` joins parts",
            (InputKind::Library, _) => "`plywave farm` takes it",
            (InputKind::Wif, _) => "name it in a cloth spec: [weave] kind = \"wif\"",
            (InputKind::Hair, _) => "name it in a scene of strands: [strands] file",
            (InputKind::Picture, _) => "`plywave render --sky` takes an EXR",
            (InputKind::Mesh, _) => "`plywave render CLOTH --mesh` takes it",
        }
    }
}

/// Number of bytes of a file that are examined.
const HEAD: u64 = 64 << 10;

/// The first bytes of a regular file; empty if it cannot be read.
fn head_of(path: &Path) -> Option<Vec<u8>> {
    let mut head = Vec::new();
    plywave::io::open_file(path, u64::MAX).ok()?.take(HEAD).read_to_end(&mut head).ok()?;
    Some(head)
}

/// Whether a file is text, possibly in another encoding: it has no 0 byte and few bytes outside UTF-8.
fn is_text(path: &Path) -> Option<bool> {
    let head = head_of(path)?;
    let foreign = String::from_utf8_lossy(&head).matches(char::REPLACEMENT_CHARACTER).count();
    Some(!head.contains(&0) && 10 * foreign <= head.len())
}

/// Kind of a file, as far as its first bytes tell.
pub fn kind_of(path: &Path) -> Option<InputKind> {
    if let Ok(kind) = plywave::io::file_kind(path) {
        return Some(match kind {
            FileKind::Table => InputKind::Table,
            FileKind::Model => InputKind::Model,
            FileKind::Fiber => InputKind::Fiber,
            FileKind::Speckle => InputKind::Speckle,
            FileKind::Twin => InputKind::Twin,
            FileKind::Family => InputKind::Family,
            FileKind::Cloth => InputKind::ClothFile,
        });
    }
    let head = head_of(path)?;
    const PICTURES: [&[u8]; 5] = [b"\x89PNG", &[0x76, 0x2f, 0x31, 0x01], &[0xff, 0xd8, 0xff], b"#?", b"<svg"];
    if PICTURES.iter().any(|magic| head.starts_with(magic)) {
        return Some(InputKind::Picture);
    }
    if head.starts_with(b"HAIR") {
        return Some(InputKind::Hair);
    }
    // A container has a JSON header after the header's length.
    if head.get(8) == Some(&b'{') {
        let named = |format: &[u8]| head.windows(format.len()).any(|w| w == format);
        return named(b"plywave-part").then_some(InputKind::Part);
    }
    let text = String::from_utf8_lossy(&head);
    let has = |starts: &[&str]| text.lines().any(|l| starts.iter().any(|s| l.trim_start().starts_with(s)));
    if head.contains(&0) {
        None
    } else if has(&["[WIF]", "[wif]", "[Wif]"]) {
        Some(InputKind::Wif)
    } else if has(&["[strands", "strands."]) {
        Some(InputKind::StrandScene)
    } else if has(&["[knit", "[curves", "[weave", "weave.", "[warp", "[weft"]) {
        Some(InputKind::Cloth)
    } else if has(&["[filament"]) {
        Some(InputKind::Filament)
    } else if has(&["[[yarn", "[[family", "[[fiber", "[[speckle", "[[twin", "[[compare"])
        && has(&["spec =", "spec=", "cloth =", "cloth="])
    {
        Some(InputKind::Library)
    } else if has(&["[[fiber"]) {
        Some(InputKind::WaveScene)
    } else if has(&["[fiber", "[ply", "[absorption"]) || has(&["[yarn"]) && has(&["fiber =", "fiber=", "[yarn.fiber"]) {
        Some(InputKind::Yarn)
    } else if has(&["v "]) && has(&["f "]) {
        Some(InputKind::Mesh)
    } else {
        None
    }
}

/// Whether a path is the name of a library model and not a file.
pub fn is_named(path: &Path) -> bool {
    path.to_str().is_some_and(ModelLibrary::is_name) && !path.exists()
}

/// A list of kinds in words: "a table (.pwt) or a yarn spec (TOML)".
fn listed(kinds: &[InputKind]) -> String {
    let names: Vec<&str> = kinds.iter().map(|k| k.words()).collect();
    match names.split_last() {
        Some((last, [])) => (*last).to_string(),
        Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
        None => String::new(),
    }
}

/// Hint with the `plywave new` command for a shipped spec with this file name and one of the wanted kinds.
fn shipped(path: &Path, wanted: &[InputKind]) -> Option<String> {
    let file = path.file_name()?.to_str()?;
    let is_wanted = |spec: &&ShippedSpec| match spec.kind {
        ShippedKind::Cloth => wanted.contains(&InputKind::Cloth),
        ShippedKind::Yarn | ShippedKind::Family => wanted.contains(&InputKind::Yarn),
    };
    let all = ShippedSpec::all();
    let spec = all.iter().filter(is_wanted).find(|spec| spec.file() == file)?;
    let has_cloth = all.iter().any(|other| other.kind == ShippedKind::Cloth && other.name() == spec.name());
    let flag = if has_cloth && spec.kind != ShippedKind::Cloth { " --yarn" } else { "" };
    Some(format!("{}{flag}", spec.name()))
}

/// Refuses a file that does not exist or whose kind is known and not wanted. Files of unknown kind are passed
/// to the loader.
pub fn require(path: &Path, wanted: &[InputKind]) -> Outcome {
    if wanted.contains(&InputKind::Model) && is_named(path) {
        return Ok(());
    }
    let refuse = |what: &str, hint: &str| {
        Err(Failure::Input(format!("{}: {what}, expected {}; {hint}", path.display(), listed(wanted))))
    };
    match std::fs::metadata(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let made = match (shipped(path, wanted), wanted) {
                (Some(name), _) => Some(format!("`plywave new {name}` writes the one that ships, or check the path")),
                (None, [kind]) => kind.made_by().map(|command| format!("`{command}` makes one, or check the path")),
                _ => None,
            };
            return refuse("no such file", &made.unwrap_or_else(|| "check the path".into()));
        }
        // The loader reports paths that are not files or cannot be examined.
        Ok(about) if about.is_file() => {}
        _ => return Ok(()),
    }
    match kind_of(path) {
        Some(kind) if wanted.contains(&kind) => Ok(()),
        Some(kind) => refuse(kind.words(), kind.hint(wanted.first().copied().unwrap_or(kind))),
        // The loader reports a container with a damaged header.
        None => match (is_text(path), wanted.iter().all(|k| k.made_by().is_none())) {
            (Some(false), true) => refuse("neither text in UTF-8 nor a file of plywave's", "check the path"),
            (Some(false), false) if head_of(path).is_some_and(|head| head.get(8) != Some(&b'{')) => {
                refuse("no file of plywave's", "check the path")
            }
            (Some(true), _) if !wanted.iter().any(|k| k.is_text()) => {
                refuse("a text that is no file of plywave's", "check the path")
            }
            _ => Ok(()),
        },
    }
}

/// Error for a file that another file refers to: that it does not exist or has another kind, if that is the
/// cause, else `error`.
pub fn explain(path: &Path, wanted: &[InputKind], error: impl Into<Failure>) -> Failure {
    require(path, wanted).err().unwrap_or_else(|| error.into())
}
