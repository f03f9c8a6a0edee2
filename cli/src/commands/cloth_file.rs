//! Cloth files (`.pwc`): made of cloth specs, kept for the next time, described.

use super::{cloth_spec, on_threads};
use crate::args::Cli;
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, Kind};
use crate::rendering::{digest_of_bytes, digest_of_file};
use crate::{output, progress, report};
use plywave::PlyModel;
use plywave::cloth::{ClothData, ClothModel, ClothSpec, YarnOfCloth};
use plywave::fabric::{FabricOptions, WeaveSpec};
use plywave_sim::cloth::MadeCloth;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// The models of a cloth's plies, by kind of yarn. A yarn spec that is named stands for the model beside it,
/// of the same name with `.pwm`.
pub fn models(cli: &Cli, file: &Path, spec: &ClothSpec) -> Outcome<Vec<Arc<PlyModel>>> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let of = |(kind, yarn): (usize, &YarnOfCloth)| {
        let key = format!("{}.model", cloth_spec::kind_name(spec, kind as u32));
        let Some(model) = &yarn.model else {
            let hint = "name the model of its plies";
            return Err(Failure::input(file.display(), &key, "(absent)", hint));
        };
        let mut path = folder.join(model);
        if path.extension().is_some_and(|e| e == "toml") {
            let named = path.display().to_string();
            path.set_extension("pwm");
            if !path.exists() {
                let hint = format!("build its model first: `plywave build {named} -o {}`", path.display());
                return Err(Failure::input(file.display(), &key, model, &hint));
            }
        }
        let path = if path.exists() { path } else { model.into() };
        Ok(Arc::new(cli.library()?.load(&path)?))
    };
    spec.yarns().into_iter().enumerate().map(of).collect()
}

/// What shading needs of a cloth whose curves are made.
pub fn make(
    cli: &Cli,
    file: &Path,
    spec: &ClothSpec,
    made: &MadeCloth,
    models: &[Arc<PlyModel>],
) -> Outcome<ClothData> {
    let (text, _) = cloth_spec::read(file)?;
    let begun = Instant::now();
    let stopped = || progress::STOP.load(Ordering::SeqCst);
    let told = |what: &str| {
        if stopped() {
            return Err(plywave::Error::Format { file: "cloth".into(), what: "stopped".into(), hint: String::new() });
        }
        if !cli.quiet {
            eprintln!("cloth: {what}, {:.1} s", begun.elapsed().as_secs_f64());
        }
        Ok(())
    };
    let data = on_threads(cli, || ClothData::make(&text, &spec.name, &made.curves, models, true, told))?;
    if stopped() {
        return Err(Failure::Interrupted("stopped".into()));
    }
    if matches!(spec.weave, Some(WeaveSpec::Wif { .. })) && !cli.quiet {
        eprintln!("note: colors of the WIF are not used; give srgb of warp and weft");
    }
    Ok(data?)
}

/// Folder in which cloths are kept: that of the variable PLYWAVE_CACHE, or the user's for such files.
fn cache() -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    of("PLYWAVE_CACHE").or_else(|| {
        let user = of("XDG_CACHE_HOME").or_else(|| of("LOCALAPPDATA")).or_else(|| Some(of("HOME")?.join(".cache")))?;
        Some(user.join("plywave"))
    })
}

/// The cloth of a file, or of a spec, whose cloth is looked up by the contents of spec and models among those
/// that are kept, or made and kept; with a digest of what it was made of.
pub fn ready(cli: &Cli, file: &Path, notes: &mut Vec<String>) -> Outcome<(ClothData, String)> {
    if kinds::kind_of(file) == Some(Kind::ClothFile) {
        return Ok((ClothData::load(file)?, digest_of_file(file)?));
    }
    let (text, spec) = cloth_spec::read(file)?;
    let models = models(cli, file, &spec)?;
    let mut of = format!("{}\n{text}\n", env!("CARGO_PKG_VERSION"));
    for model in &models {
        of += &digest_of_bytes(&model.data().to_bytes()?);
    }
    for named in cloth_spec::files_of(&spec) {
        let path = file.parent().unwrap_or(Path::new("")).join(named);
        of += &digest_of_file(&path)?;
    }
    let of = digest_of_bytes(of.as_bytes());
    let kept = cache().map(|folder| folder.join(format!("{}.pwc", &of[..24])));
    if let Some(path) = kept.as_ref().filter(|path| path.exists()) {
        // One that was damaged is made again.
        if let Ok(data) = ClothData::load(path) {
            return Ok((data, of));
        }
    }
    let (spec, made) = cloth_spec::make(cli, file)?;
    let data = make(cli, file, &spec, &made, &models)?;
    let Some(path) = kept else {
        notes.push("the cloth is not kept: there is no cache folder; PLYWAVE_CACHE names one".into());
        return Ok((data, of));
    };
    let saved = path.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(|e| e.to_string());
    match saved.and_then(|()| data.save(&path).map_err(|e| e.to_string())) {
        Ok(()) => notes.push(format!("the cloth was made and is kept in {}", path.display())),
        Err(e) => notes.push(format!("the cloth was made and could not be kept: {e}")),
    }
    Ok((data, of))
}

/// `plywave info` of a cloth file.
pub fn info(cli: &Cli, file: &Path, bytes: u64, data: ClothData) -> Outcome {
    let points = data.curves.curves.iter().map(|c| c.control_um.len()).sum::<usize>();
    let models: Vec<String> = data.models.iter().map(|m| cloth_spec::spec_name(m)).collect();
    let (name, version, cell) = (data.name.clone(), data.program_version.clone(), data.curves.cell_um);
    let (curves, has_far, spec) = (data.curves.curves.len(), data.has_far(), data.spec_text.clone());
    let model = ClothModel::from_data(data, &FabricOptions { far: true, ..FabricOptions::default() })?;
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
