//! Cloths: made of cloth specs, kept for the next time, described.

use super::{on_threads, runs};
use crate::args::Cli;
use crate::failure::Outcome;
use crate::kinds::{self, Kind};
use crate::progress::{self, PipelineBar};
use crate::{output, report};
use plywave::PlyModel;
use plywave::cloth::{ClothData, ClothModel, ClothOptions};
use plywave_pipeline::{ClothRecipe, Progress, ReadyCloth, Run, digest_of_file};
use plywave_sim::cloth::MadeCloth;
use std::path::Path;
use std::sync::Arc;

/// Reads a cloth spec.
pub fn recipe(file: &Path) -> Outcome<ClothRecipe> {
    ClothRecipe::load(file).map_err(runs::pipeline_failure)
}

/// Runs `work`, which tells its steps, on the number of threads that --threads gives.
fn told<T: Send>(cli: &Cli, work: impl FnOnce(&Run<'_>) -> Result<T, plywave_pipeline::Error> + Send) -> Outcome<T> {
    progress::install_stop();
    let bar = PipelineBar::new(cli.quiet);
    let tell = |progress: Progress| bar.update(progress);
    on_threads(cli, || work(&Run { progress: Some(&tell), ..Run::plain() }))?.map_err(runs::pipeline_failure)
}

/// Makes the curves of a cloth and says what there is to say of them.
pub fn curves(cli: &Cli, recipe: &ClothRecipe) -> Outcome<MadeCloth> {
    let made = told(cli, |run| recipe.curves(run))?;
    if !cli.quiet {
        let unrest = made.unrest();
        let word = |note: &String| if Some(note) == unrest.as_ref() { "warning" } else { "note" };
        made.notes.iter().for_each(|note| eprintln!("{}: {note}", word(note)));
    }
    Ok(made)
}

/// What shading needs of a cloth whose curves are made.
pub fn make(cli: &Cli, recipe: &ClothRecipe, curves: &MadeCloth, models: &[Arc<PlyModel>]) -> Outcome<ClothData> {
    told(cli, |run| recipe.make(curves, models, true, run))
}

/// The cloth of a cloth file, or of a spec, which may be made and is then kept.
pub fn ready(cli: &Cli, file: &Path) -> Outcome<ReadyCloth> {
    if kinds::kind_of(file) == Some(Kind::ClothFile) {
        let digest = digest_of_file(file)?;
        return Ok(ReadyCloth { data: ClothData::load(file)?, digest, notes: Vec::new() });
    }
    let (recipe, library) = (recipe(file)?, cli.library()?);
    told(cli, |run| recipe.ready(&library, run))
}

/// `plywave info` of a cloth file.
pub fn info(cli: &Cli, file: &Path, bytes: u64, data: ClothData) -> Outcome {
    let points = data.curves.curves.iter().map(|c| c.control_um.len()).sum::<usize>();
    let models = data.ply_names();
    let (name, version, cell) = (data.name.clone(), data.program_version.clone(), data.curves.cell_um);
    let (curves, has_far, spec) = (data.curves.curves.len(), data.has_far(), data.spec_text.clone());
    let model = ClothModel::from_data(data, &ClothOptions { far: true, ..ClothOptions::default() })?;
    let half = model.lines().half_thickness_um();
    if cli.json {
        return output::print_json(&serde_json::json!({
            "file": file.display().to_string(), "kind": "cloth", "bytes": bytes, "name": name,
            "program_version": version, "cell_um": cell, "curves": curves, "points": points,
            "half_thickness_um": half, "plies": models, "far": has_far,
            "memory_bytes": model.memory_bytes(), "spec": spec,
        }));
    }
    output::print(|out| {
        writeln!(out, "{}: cloth, {}", file.display(), report::bytes(bytes))?;
        writeln!(out, "  cloth        {name}, plies of {}", models.join(" and "))?;
        let [a, b] = cell;
        writeln!(out, "  cell         ({:.1}, {:.1}) x ({:.1}, {:.1}) um", a[0], a[1], b[0], b[1])?;
        writeln!(out, "  curves       {curves} of {points} points, within {:.0} um of the middle", half)?;
        writeln!(out, "  mean         {}", if has_far { "of the cell is in it" } else { "of the cell is not in it" })?;
        writeln!(out, "  memory       {}", report::bytes(model.memory_bytes() as u64))
    })
}
