//! What a file is, by its first bytes, so that a command given the wrong kind of file says which it is and which it needs.

use crate::args::Cli;
use crate::failure::{Failure, Outcome, one_line};
use plywave::PlyModel;
use plywave::fabric::{FabricSpec, LoadedFabric};
use plywave::io::FileKind;
use plywave::table::Table;
use plywave::twin::ClothTwin;
use std::io::Read;
use std::path::Path;

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
    YarnSpec,
    /// A fabric spec.
    FabricSpec,
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
            Kind::YarnSpec => "a yarn spec (TOML)",
            Kind::FabricSpec => "a fabric spec (TOML)",
            Kind::Filament => "an analytic fiber (TOML)",
            Kind::WaveScene => "a scene for waves (TOML)",
            Kind::StrandScene => "a scene of strands (TOML)",
            Kind::Picture => "a picture",
            Kind::Mesh => "a mesh (OBJ)",
        }
    }

    /// Which command makes the wanted kind of this one, or what takes this one.
    fn hint(self, wanted: Kind) -> &'static str {
        match (self, wanted) {
            (Kind::YarnSpec, Kind::Model) => "`plywave build SPEC` makes a model of it",
            (Kind::YarnSpec, Kind::Table) => "`plywave simulate SPEC` makes a table of it",
            (Kind::Family, Kind::Model) => "`plywave family FAMILY --param KEY=VALUE` takes a model out of it",
            (Kind::Table, Kind::Model) => "`plywave fit TABLE` makes a model of it",
            (Kind::Model, Kind::FabricSpec) => "write a fabric spec that names it, as fabrics/cotton_plain.toml",
            (Kind::YarnSpec, Kind::FabricSpec) => "build its model and write a fabric spec that names it",
            (Kind::FabricSpec, Kind::Twin) => "`plywave twin SPEC` makes one of it",
            (Kind::FabricSpec, _) => "`plywave render` and `plywave weave` take it",
            (Kind::YarnSpec, _) => "`plywave build` takes it",
            (Kind::Model, _) => "`plywave info` tells what it holds",
            (Kind::Table, _) => "`plywave fit` takes it",
            (Kind::Fiber | Kind::Speckle | Kind::Twin | Kind::Family, _) => "`plywave info` tells what it holds",
            (Kind::StrandScene, _) => "`plywave render` takes it",
            (Kind::Filament, _) => "`plywave check` takes it",
            (Kind::WaveScene, _) => "`plywave wave scatter` takes it",
            (Kind::Picture | Kind::Mesh, _) => "check the path",
        }
    }
}

/// Most bytes of a file that are looked at.
const HEAD: u64 = 64 << 10;

/// The first bytes of a regular file; none of one that cannot be read.
pub fn head(path: &Path) -> Option<Vec<u8>> {
    let mut head = Vec::new();
    plywave::io::open_file(path, u64::MAX).ok()?.take(HEAD).read_to_end(&mut head).ok()?;
    Some(head)
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
        });
    }
    let head = head(path)?;
    if [&b"\x89PNG"[..], &[0x76, 0x2f, 0x31, 0x01], &[0xff, 0xd8, 0xff]].iter().any(|m| head.starts_with(m)) {
        return Some(Kind::Picture);
    }
    let text = std::str::from_utf8(&head).ok()?;
    let has = |starts: &[&str]| text.lines().any(|l| starts.iter().any(|s| l.trim_start().starts_with(s)));
    if has(&["[strands", "strands."]) {
        Some(Kind::StrandScene)
    } else if has(&["[weave", "weave.", "[warp", "[weft"]) {
        Some(Kind::FabricSpec)
    } else if has(&["[filament"]) {
        Some(Kind::Filament)
    } else if has(&["[[fiber"]) {
        Some(Kind::WaveScene)
    } else if has(&["[fiber", "[ply", "[absorption"]) {
        Some(Kind::YarnSpec)
    } else if has(&["v "]) && has(&["f "]) {
        Some(Kind::Mesh)
    } else {
        None
    }
}

/// Says that `path` is of another kind than `wanted`, where that is why `error` came up.
pub fn explain(path: &Path, wanted: &[Kind], error: impl Into<Failure>) -> Failure {
    match kind_of(path) {
        Some(kind) if !wanted.contains(&kind) => {
            let names: Vec<&str> = wanted.iter().map(|k| k.words()).collect();
            let names = match names.split_last() {
                Some((last, [])) => (*last).to_string(),
                Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
                None => String::new(),
            };
            let hint = kind.hint(wanted.first().copied().unwrap_or(kind));
            Failure::Input(format!("{}: {}, expected {names}; {hint}", path.display(), kind.words()))
        }
        _ => error.into(),
    }
}

/// Loads a model; another kind of file is named.
pub fn load_model(path: &Path) -> Outcome<PlyModel> {
    PlyModel::load(path).map_err(|e| explain(path, &[Kind::Model], e))
}

/// Loads a table; another kind of file is named.
pub fn load_table(path: &Path) -> Outcome<Table> {
    Table::load(path).map_err(|e| explain(path, &[Kind::Table], e))
}

/// Loads the twin of a cloth; another kind of file is named.
pub fn load_twin(path: &Path) -> Outcome<ClothTwin> {
    ClothTwin::load(path).map_err(|e| explain(path, &[Kind::Twin], e))
}

/// Loads a fabric spec and its models; another kind of file is named.
pub fn load_fabric(path: &Path) -> Outcome<LoadedFabric> {
    FabricSpec::load(path).map_err(|e| explain(path, &[Kind::FabricSpec], e))
}

/// Says what there is to know of a fabric, for commands whose answer has no place for it.
pub fn tell_fabric_notes(cli: &Cli, fabric: &LoadedFabric) {
    if !cli.quiet {
        fabric.notes().iter().for_each(|note| eprintln!("note: {}", one_line(note)));
    }
}
