//! What a file is, by its first bytes, and which kinds each command takes: one given the wrong kind says
//! which it is and which it needs.

use crate::args::{Command, WaveCommand};
use crate::failure::{Failure, Outcome};
use plywave::io::{FileKind, ModelLibrary};
use plywave_pipeline::{ShippedKind, ShippedSpec};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Kinds of files that the commands read and write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
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

impl Kind {
    /// In words, with its article.
    fn words(self) -> &'static str {
        match self {
            Kind::Table => "a table (.pwt)",
            Kind::Model => "a ply model (.pwm)",
            Kind::Fiber => "a fiber table (.pwf)",
            Kind::Speckle => "speckle patterns (.pws)",
            Kind::Twin => "the twin of a cloth (.pwx)",
            Kind::Family => "a family of plies (.pwfam)",
            Kind::Yarn => "a yarn spec (TOML)",
            Kind::Cloth => "a cloth spec (TOML)",
            Kind::ClothFile => "a cloth (.pwc)",
            Kind::Filament => "an analytic fiber (TOML)",
            Kind::WaveScene => "a scene for waves (TOML)",
            Kind::StrandScene => "a scene of strands (TOML)",
            Kind::Picture => "a picture",
            Kind::Mesh => "a mesh (OBJ)",
            Kind::Part => "a part of a run (.pwp)",
            Kind::Library => "a library of the farm (TOML)",
            Kind::Wif => "a weaver's file (WIF)",
            Kind::Hair => "strands (.hair)",
        }
    }

    /// Whether its files are text.
    fn is_text(self) -> bool {
        use Kind::{Cloth, Filament, Library, Mesh, StrandScene, WaveScene, Wif, Yarn};
        matches!(self, Yarn | Cloth | Filament | WaveScene | StrandScene | Library | Wif | Mesh)
    }

    /// The command that makes such a file.
    fn made_by(self) -> Option<&'static str> {
        match self {
            Kind::Table => Some("plywave simulate SPEC"),
            Kind::Model => Some("plywave build SPEC"),
            Kind::Fiber => Some("plywave wave tabulate SPEC"),
            Kind::Speckle => Some("plywave wave speckle SPEC"),
            Kind::Twin => Some("plywave twin CLOTH"),
            Kind::Family => Some("plywave family SPEC"),
            Kind::ClothFile => Some("plywave weave SPEC -o CLOTH.pwc"),
            Kind::Part => Some("plywave simulate SPEC --shards I/N"),
            _ => None,
        }
    }

    /// Which command makes the wanted kind of this one, or what takes this one.
    fn hint(self, wanted: Kind) -> &'static str {
        match (self, wanted) {
            (Kind::Yarn, Kind::Model) => "`plywave build SPEC` makes a model of it",
            (Kind::Yarn, Kind::Table) => "`plywave simulate SPEC` makes a table of it",
            (Kind::Family, Kind::Model) => "`plywave family FAMILY --param KEY=VALUE` takes a model out of it",
            (Kind::Table, Kind::Model) => "`plywave fit TABLE` makes a model of it",
            (Kind::Model, Kind::Cloth) => "write a cloth spec that names it, as `plywave new jersey` writes one",
            (Kind::Yarn, Kind::Cloth) => "build its model and write a cloth spec that names it",
            (Kind::Cloth, Kind::Twin) => "`plywave twin SPEC` makes one of it",
            (Kind::Cloth, _) => "`plywave weave`, `plot`, `render`, `export` and `twin` take it",
            (Kind::ClothFile, _) => "`plywave render`, `plot`, `export` and `info` take it",
            (Kind::Yarn, _) => "`plywave build` takes it",
            (Kind::Model, _) => "`plywave info` tells what it holds",
            (Kind::Table, _) => "`plywave fit` takes it",
            (Kind::Fiber | Kind::Speckle | Kind::Twin | Kind::Family, _) => "`plywave info` tells what it holds",
            (Kind::StrandScene, _) => "`plywave render` takes it",
            (Kind::Filament, _) => "`plywave check` takes it",
            (Kind::WaveScene, _) => "`plywave wave scatter` takes it",
            (Kind::Part, _) => "`plywave merge` joins parts",
            (Kind::Library, _) => "`plywave farm` takes it",
            (Kind::Wif, _) => "name it in a cloth spec: [weave] kind = \"wif\"",
            (Kind::Hair, _) => "name it in a scene of strands: [strands] file",
            (Kind::Picture, _) => "`plywave render --sky` takes an EXR",
            (Kind::Mesh, _) => "`plywave render CLOTH --mesh` takes it",
        }
    }
}

/// Most bytes of a file that are looked at.
const HEAD: u64 = 64 << 10;

/// The first bytes of a regular file; none of one that cannot be read.
fn head_of(path: &Path) -> Option<Vec<u8>> {
    let mut head = Vec::new();
    plywave::io::open_file(path, u64::MAX).ok()?.take(HEAD).read_to_end(&mut head).ok()?;
    Some(head)
}

/// Whether a file is text, or would be in another encoding: no byte is 0, and few are foreign to UTF-8.
fn is_text(path: &Path) -> Option<bool> {
    let head = head_of(path)?;
    let foreign = String::from_utf8_lossy(&head).matches(char::REPLACEMENT_CHARACTER).count();
    Some(!head.contains(&0) && 10 * foreign <= head.len())
}

/// What a file is, as far as its first bytes tell.
pub fn kind_of(path: &Path) -> Option<Kind> {
    if let Ok(kind) = plywave::io::file_kind(path) {
        return Some(match kind {
            FileKind::Table => Kind::Table,
            FileKind::Model => Kind::Model,
            FileKind::Fiber => Kind::Fiber,
            FileKind::Speckle => Kind::Speckle,
            FileKind::Twin => Kind::Twin,
            FileKind::Family => Kind::Family,
            FileKind::Cloth => Kind::ClothFile,
        });
    }
    let head = head_of(path)?;
    const PICTURES: [&[u8]; 5] = [b"\x89PNG", &[0x76, 0x2f, 0x31, 0x01], &[0xff, 0xd8, 0xff], b"#?", b"<svg"];
    if PICTURES.iter().any(|magic| head.starts_with(magic)) {
        return Some(Kind::Picture);
    }
    if head.starts_with(b"HAIR") {
        return Some(Kind::Hair);
    }
    // The header of a container, in JSON after its length.
    if head.get(8) == Some(&b'{') {
        let named = |format: &[u8]| head.windows(format.len()).any(|w| w == format);
        return named(b"plywave-part").then_some(Kind::Part);
    }
    let text = String::from_utf8_lossy(&head);
    let has = |starts: &[&str]| text.lines().any(|l| starts.iter().any(|s| l.trim_start().starts_with(s)));
    if head.contains(&0) {
        None
    } else if has(&["[WIF]", "[wif]", "[Wif]"]) {
        Some(Kind::Wif)
    } else if has(&["[strands", "strands."]) {
        Some(Kind::StrandScene)
    } else if has(&["[knit", "[curves", "[weave", "weave.", "[warp", "[weft"]) {
        Some(Kind::Cloth)
    } else if has(&["[filament"]) {
        Some(Kind::Filament)
    } else if has(&["[[yarn", "[[family", "[[fiber", "[[speckle", "[[twin", "[[compare"])
        && has(&["spec =", "spec=", "cloth =", "cloth="])
    {
        Some(Kind::Library)
    } else if has(&["[[fiber"]) {
        Some(Kind::WaveScene)
    } else if has(&["[fiber", "[ply", "[absorption"]) {
        Some(Kind::Yarn)
    } else if has(&["v "]) && has(&["f "]) {
        Some(Kind::Mesh)
    } else {
        None
    }
}

/// Whether a path is the name of a model and no file.
pub fn is_named(path: &Path) -> bool {
    path.to_str().is_some_and(ModelLibrary::is_name) && !path.exists()
}

/// Kinds in words: "a table (.pwt) or a yarn spec (TOML)".
fn listed(kinds: &[Kind]) -> String {
    let names: Vec<&str> = kinds.iter().map(|k| k.words()).collect();
    match names.split_last() {
        Some((last, [])) => (*last).to_string(),
        Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
        None => String::new(),
    }
}

/// Words of `plywave new` for a spec that ships under the name of this file, of one of the wanted kinds.
fn shipped(path: &Path, wanted: &[Kind]) -> Option<String> {
    let file = path.file_name()?.to_str()?;
    let is_wanted = |spec: &&ShippedSpec| match spec.kind {
        ShippedKind::Cloth => wanted.contains(&Kind::Cloth),
        ShippedKind::Yarn | ShippedKind::Family => wanted.contains(&Kind::Yarn),
    };
    let all = ShippedSpec::all();
    let spec = all.iter().filter(is_wanted).find(|spec| spec.file() == file)?;
    let has_cloth = all.iter().any(|other| other.kind == ShippedKind::Cloth && other.name() == spec.name());
    let flag = if has_cloth && spec.kind != ShippedKind::Cloth { " --yarn" } else { "" };
    Some(format!("{}{flag}", spec.name()))
}

/// Refuses a file that is not there, and one that is known to be of none of the kinds that a command takes.
/// What cannot be told by its first bytes is left to the loader.
fn require(path: &Path, wanted: &[Kind]) -> Outcome {
    if wanted.contains(&Kind::Model) && is_named(path) {
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
        // What is no file, or cannot be asked about, is for the loader.
        Ok(about) if about.is_file() => {}
        _ => return Ok(()),
    }
    match kind_of(path) {
        Some(kind) if wanted.contains(&kind) => Ok(()),
        Some(kind) => refuse(kind.words(), kind.hint(wanted.first().copied().unwrap_or(kind))),
        // A container whose header is damaged is for its loader.
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

/// The error of loading a file that another one names; that it is not there, or of another kind than wanted,
/// where that is why.
pub fn explain(path: &Path, wanted: &[Kind], error: impl Into<Failure>) -> Failure {
    require(path, wanted).err().unwrap_or_else(|| error.into())
}

/// Refuses the inputs of a command that are not there or of another kind than it takes, before any work.
pub fn check_inputs(command: &Command) -> Outcome {
    use Kind::{
        Cloth, ClothFile, Family, Fiber, Filament, Library, Mesh, Model, Part, Picture, Speckle, StrandScene, Table,
        Twin, WaveScene, Yarn,
    };
    let one = |path: &Path, wanted: &[Kind]| require(path, wanted);
    let maybe = |path: &Option<PathBuf>, wanted: &[Kind]| path.as_deref().map_or(Ok(()), |path| require(path, wanted));
    match command {
        Command::Simulate(args) => one(&args.spec, &[Yarn]),
        Command::Fit(args) => {
            one(&args.table, &[Table])?;
            maybe(&args.spec, &[Yarn])
        }
        Command::Build(args) => {
            maybe(&args.spec, &[Yarn])?;
            maybe(&args.speckle, &[Speckle])
        }
        Command::Family(args) => match args.param.is_empty() || kind_of(&args.input) == Some(Yarn) {
            true => one(&args.input, &[Yarn, Family]),
            false => one(&args.input, &[Family]),
        },
        Command::Info(args) => one(&args.file, &[Model, Yarn, Table, Fiber, Speckle, Twin, Family, ClothFile]),
        Command::Eval(args) => one(&args.model, &[Model]),
        Command::Sample(args) => one(&args.model, &[Model]),
        Command::Check(args) => {
            one(&args.model, &[Model, Family, Cloth, ClothFile, Filament])?;
            match kind_of(&args.model) {
                Some(Cloth | ClothFile) => maybe(&args.twin, &[Twin]),
                // Neither goes with it, wherever it leads.
                Some(Filament) => Ok(()),
                _ => maybe(&args.table, &[Table]).and_then(|()| maybe(&args.traced, &[Table])),
            }
        }
        Command::Diff(args) => {
            one(&args.a, &[Model, Table])?;
            one(&args.b, if kind_of(&args.a) == Some(Table) { &[Table] } else { &[Model] })
        }
        Command::Plot(args) => {
            one(&args.file, &[Model, Table, Fiber, Speckle, Yarn, Cloth, ClothFile])?;
            maybe(&args.table, &[Table])?;
            maybe(&args.model, &[Model])
        }
        Command::Compare(args) => one(&args.spec, &[Yarn]),
        Command::Render(args) => {
            one(&args.cloth, &[Cloth, ClothFile, StrandScene])?;
            maybe(&args.mesh, &[Mesh])?;
            maybe(&args.sky, &[Picture])
        }
        Command::Export(args) => one(&args.cloth, &[Cloth, ClothFile]),
        Command::Merge(args) => args.parts.iter().try_for_each(|part| one(part, &[Part])),
        Command::Noise(args) => {
            one(&args.patterns, &[Speckle])?;
            maybe(&args.model, &[Model])
        }
        Command::Color(args) => one(&args.model, &[Model, Cloth, ClothFile]),
        Command::Farm(args) => one(&args.library, &[Library]),
        Command::Twin(args) => one(&args.spec, &[Cloth]),
        Command::View(args) => maybe(&args.file, &[Model, Cloth, ClothFile]),
        Command::Weave(args) => one(&args.cloth, &[Cloth]),
        Command::Hairs(args) => {
            one(&args.cloth, &[Cloth, ClothFile])?;
            maybe(&args.mesh, &[Mesh])
        }
        Command::Wave(wave) => match &wave.command {
            WaveCommand::Scatter(args) => one(&args.scene, &[WaveScene]),
            WaveCommand::Speckle(args) => one(&args.spec, &[Yarn]),
            WaveCommand::Tabulate(args) => one(&args.spec, &[Yarn, WaveScene]),
        },
        Command::Completions(_) | Command::Man(_) | Command::New(_) => Ok(()),
    }
}
