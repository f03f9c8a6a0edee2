//! Cloth specs: read, with what they name, and made into curves.

use super::runs;
use crate::args::Cli;
use crate::failure::{Failure, Outcome};
use crate::progress;
use plywave::PlyModel;
use plywave::cloth::{ClothSpec, YarnOfCloth};
use plywave::fabric::WeaveSpec;
use plywave_sim::cloth::{MadeCloth, make_cloth};
use std::path::Path;
use std::sync::atomic::Ordering;

/// Largest cloth spec, and largest file that it names [bytes].
const MAX_SPEC_BYTES: u64 = 1 << 20;
const MAX_BYTES: u64 = 256 << 20;

/// The text of a spec, and what it says.
pub fn read(file: &Path) -> Outcome<(String, ClothSpec)> {
    let text = plywave::io::read_text(file, MAX_SPEC_BYTES)?;
    let spec = ClothSpec::parse(&text, &file.display().to_string())?;
    Ok((text, spec))
}

/// Texts of the specs of a cloth's plies, by kind of yarn: of yarn specs that it names, or in its models.
pub fn ply_specs(cli: &Cli, file: &Path, spec: &ClothSpec) -> Outcome<Vec<String>> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let of = |(kind, yarn): (usize, &YarnOfCloth)| {
        let key = format!("{}.model", kind_name(spec, kind as u32));
        let Some(model) = &yarn.model else {
            let hint = "name the model of its plies, or their yarn spec (.toml)";
            return Err(Failure::input(file.display(), &key, "(absent)", hint));
        };
        let path = folder.join(model);
        if path.extension().is_some_and(|e| e == "toml") {
            return Ok(plywave::io::read_text(&path, MAX_SPEC_BYTES)?);
        }
        let path = if path.exists() { path } else { model.into() };
        Ok(cli.library()?.load(&path)?.data().spec_text.clone())
    };
    spec.yarns().into_iter().enumerate().map(of).collect()
}

/// Name of the ply in a model.
pub fn spec_name(model: &PlyModel) -> String {
    plywave::spec::YarnSpec::parse(&model.data().spec_text, "model").map_or_else(|_| "a ply".into(), |spec| spec.name)
}

/// Files that a spec names besides its models.
pub fn files_of(spec: &ClothSpec) -> Vec<String> {
    let wif = spec.weave.iter().filter_map(|weave| match weave {
        WeaveSpec::Wif { file } => Some(file.clone()),
        _ => None,
    });
    wif.chain(spec.curves.iter().map(|curves| curves.file.clone())).collect()
}

/// Reads a spec and makes its curves.
pub fn make(cli: &Cli, file: &Path) -> Outcome<(ClothSpec, MadeCloth)> {
    let (_, spec) = read(file)?;
    let name = file.display().to_string();
    progress::install_stop();
    let folder = file.parent().unwrap_or(Path::new(""));
    let mut read = |named: &str| plywave::io::read_file(folder.join(named), MAX_BYTES);
    let go_on = || !progress::STOP.load(Ordering::SeqCst);
    let made = progress::stoppable(|| make_cloth(&spec, &name, &mut read, &go_on));
    let made = made.map_err(|e| match e {
        plywave_sim::SimError::Stopped => Failure::Interrupted(e.to_string()),
        other => runs::failure(other, file),
    })?;
    if !cli.quiet {
        made.notes.iter().for_each(|note| eprintln!("note: {note}"));
    }
    Ok((spec, made))
}

/// What a kind of yarn is called.
pub fn kind_name(spec: &ClothSpec, kind: u32) -> &'static str {
    match (spec.weave.is_some(), kind) {
        (true, 0) => "warp",
        (true, _) => "weft",
        _ => "yarn",
    }
}
