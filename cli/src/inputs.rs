//! The kinds of files that each command takes, checked before any work.

use crate::args::{Command, WaveCommand};
use crate::failure::Outcome;
use crate::kinds::{InputKind, kind_of, require};
use std::path::{Path, PathBuf};

/// Refuses inputs of a command that do not exist or have another kind than the command takes.
pub fn check_inputs(command: &Command) -> Outcome {
    use InputKind::{
        Cloth, ClothFile, Family, Fiber, Filament, Library, Mesh, Model, Part, Picture, Speckle, StrandScene, Table,
        Twin, WaveScene, Yarn,
    };
    let one = |path: &Path, wanted: &[InputKind]| require(path, wanted);
    let maybe =
        |path: &Option<PathBuf>, wanted: &[InputKind]| path.as_deref().map_or(Ok(()), |path| require(path, wanted));
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
        Command::Completions(_) | Command::Man(_) | Command::New(_) | Command::Swatch(_) => Ok(()),
    }
}
