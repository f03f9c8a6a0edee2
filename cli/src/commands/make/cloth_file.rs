//! Cloths of cloth specs: computes, caches and describes them.

use crate::args::Cli;
use crate::commands::runs;
use crate::failure::Outcome;
use crate::kinds::{self, InputKind};
use crate::progress::{self, PipelineBar};
use crate::threads::on_threads;
use crate::{output, report};
use plywave::Document;
use plywave::PlyModel;
use plywave::cloth::{ClothData, ClothModel, ClothOptions};
use plywave::ply::PlyData;
use plywave::spec::YarnSpec;
use plywave_pipeline::{ClothPlies, ClothRecipe, PrecomputedCloth, Progress, Run, digest_of_bytes};
use plywave_sim::cloth::MadeCloth;
use std::path::Path;
use std::sync::Arc;

/// Reads a cloth spec.
pub fn recipe(file: &Path) -> Outcome<ClothRecipe> {
    ClothRecipe::load(file).map_err(runs::pipeline_failure)
}

/// Runs `work`, which tells its steps, on the number of threads that --threads gives.
pub fn with_progress<T: Send>(
    cli: &Cli,
    work: impl FnOnce(&Run<'_>) -> Result<T, plywave_pipeline::Error> + Send,
) -> Outcome<T> {
    progress::install_stop();
    let bar = PipelineBar::new(cli.quiet);
    let tell = |progress: Progress| bar.update(progress);
    on_threads(cli, || work(&Run { progress: Some(&tell), ..Run::plain() }))?.map_err(runs::pipeline_failure)
}

/// Makes the curves of a cloth and says what there is to say of them.
pub fn curves(cli: &Cli, recipe: &ClothRecipe) -> Outcome<MadeCloth> {
    let made = with_progress(cli, |run| recipe.curves(run))?;
    if !cli.quiet {
        let unrest = made.unrest();
        let word = |note: &String| if Some(note) == unrest.as_ref() { "warning" } else { "note" };
        made.notes.iter().for_each(|note| eprintln!("{}: {note}", word(note)));
    }
    Ok(made)
}

/// The models of a cloth's plies; missing ones are built.
pub fn models(cli: &Cli, plies: ClothPlies) -> Outcome<Vec<Arc<PlyModel>>> {
    let plies = with_progress(cli, |run| plies.build(run))?;
    if !cli.quiet {
        plies.notes.iter().for_each(|note| eprintln!("note: {note}"));
    }
    Ok(plies.models)
}

/// Precomputes the shading data of a cloth with these curves.
pub fn make(cli: &Cli, recipe: &ClothRecipe, curves: &MadeCloth, models: &[Arc<PlyModel>]) -> Outcome<ClothData> {
    with_progress(cli, |run| recipe.make(curves, models, true, run))
}

/// The cloth of a cloth file, or of a spec, whose cloth is precomputed and cached if necessary.
pub fn precomputed(cli: &Cli, file: &Path) -> Outcome<PrecomputedCloth> {
    if kinds::kind_of(file) == Some(InputKind::ClothFile) {
        let bytes = plywave::io::read_file(file, ClothData::KIND.most_bytes())?;
        let data = ClothData::from_bytes(&bytes, &file.display().to_string())?;
        return Ok(PrecomputedCloth { data, digest: digest_of_bytes(&bytes), notes: Vec::new() });
    }
    let (recipe, library) = (recipe(file)?, cli.library()?);
    with_progress(cli, |run| recipe.precomputed(&library, run))
}

/// What a ply's model is made of, with the digest of its spec.
fn made_of(data: &PlyData) -> serde_json::Value {
    let name = YarnSpec::parse(&data.spec_text, "model").map_or_else(|_| "a ply".into(), |spec| spec.name);
    serde_json::json!({
        "name": name, "preset": data.preset, "seed": data.seed, "program_version": data.program_version,
        "spec": digest_of_bytes(data.spec_text.as_bytes())[..12],
    })
}

/// `plywave info` of a cloth file.
pub fn info(cli: &Cli, file: &Path, bytes: u64, data: ClothData) -> Outcome {
    let points = data.curves.curves.iter().map(|c| c.control_um.len()).sum::<usize>();
    let models = data.ply_names();
    // What the plies' models are made of: each holds its spec, and the same program makes it again.
    let made_of: Vec<_> = data.models.iter().map(|model| made_of(model.data())).collect();
    let (name, version, cell) = (data.name.clone(), data.program_version.clone(), data.curves.cell_um);
    let (curves, has_far, spec) = (data.curves.curves.len(), data.has_far(), data.spec_text.clone());
    let model = ClothModel::from_data(data, &ClothOptions { far: true, ..ClothOptions::default() })?;
    let half = model.lines().half_thickness_um();
    if cli.json {
        return output::print_json(&serde_json::json!({
            "file": file.display().to_string(), "kind": "cloth", "bytes": bytes, "name": name,
            "program_version": version, "cell_um": cell, "curves": curves, "points": points,
            "half_thickness_um": half, "plies": models, "models": made_of, "far": has_far,
            "memory_bytes": model.memory_bytes(), "spec": spec,
        }));
    }
    output::print(|out| {
        writeln!(out, "{}: cloth, {}", file.display(), report::bytes(bytes))?;
        writeln!(out, "  cloth        {name}, plies of {}", models.join(" and "))?;
        for model in &made_of {
            let of = |key: &str| model[key].as_str().unwrap_or("?").to_string();
            let [name, preset, version, spec] = ["name", "preset", "program_version", "spec"].map(of);
            writeln!(out, "  model        {name}: {preset}, seed {}, plywave {version}, spec {spec}", model["seed"])?;
        }
        let [a, b] = cell;
        writeln!(out, "  cell         ({:.1}, {:.1}) x ({:.1}, {:.1}) um", a[0], a[1], b[0], b[1])?;
        writeln!(out, "  curves       {curves} of {points} points, within {:.0} um of the middle", half)?;
        writeln!(out, "  mean         {}", if has_far { "of the cell is in it" } else { "of the cell is not in it" })?;
        writeln!(out, "  memory       {}", report::bytes(model.memory_bytes() as u64))
    })
}
