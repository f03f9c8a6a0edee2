//! `plywave export`: writes a cloth for other programs.

use crate::args::{Cli, ExportArgs};
use crate::commands::look::color;
use crate::commands::make::cloth_file;
use crate::commands::runs;
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::progress::{self, Bar, STOP};
use crate::threads::on_threads;
use crate::{output, report};
use plywave::cloth::{ClothModel, ClothOptions};
use plywave_pipeline::exports::{BeyondVisible, ExportOptions, Format, View, export};
use plywave_pipeline::{PrecomputedCloth, Progress, Run};
use std::path::{Path, PathBuf};

/// Runs the command.
pub fn run(cli: &Cli, args: &ExportArgs) -> Outcome {
    let format = Format::from(args.to);
    let options = options(args, format)?;
    let paths = match args.output.is_empty() {
        true => vec![default_output(&args.cloth, format)],
        false => args.output.clone(),
    };
    check_names(format, &paths)?;
    let is_spec = kinds::kind_of(&args.cloth) == Some(InputKind::Cloth);
    let named = if is_spec { cloth_file::recipe(&args.cloth)?.inputs() } else { Vec::new() };
    let inputs: Vec<&Path> =
        std::iter::once(args.cloth.as_path()).chain(named.iter().map(|(_, p)| p.as_path())).collect();
    paths.iter().try_for_each(|path| output::check_writable(path, &inputs))?;
    if !args.force {
        format.check_outputs(&paths).map_err(runs::pipeline_failure)?;
    }
    let PrecomputedCloth { data, mut notes, .. } = cloth_file::precomputed(cli, &args.cloth)?;
    if args.sigma.is_none() {
        notes.extend(color::cloth_notes(&ClothModel::from_data(data.clone(), &ClothOptions::RAYS)?));
    }
    progress::install_stop();
    let bar = Bar::new("export", "directions", cli.quiet);
    let tell = |Progress { done, total, .. }: Progress| bar.update("export", done, total);
    let run = Run { progress: Some(&tell), stop: Some(&STOP), ..Run::plain() };
    let exported =
        on_threads(cli, || export(&data, format, &paths, &options, &run))?.map_err(runs::pipeline_failure)?;
    let time = bar.finish();
    let written = progress::stoppable(|| exported.save()).map_err(runs::pipeline_failure)?;
    notes.extend(exported.notes.iter().cloned());
    let sizes: Vec<u64> = written.iter().map(|p| std::fs::metadata(p).map_or(0, |m| m.len())).collect();
    if cli.json {
        let facts: serde_json::Map<String, serde_json::Value> =
            exported.facts.iter().map(|(name, value)| ((*name).to_string(), (*value).into())).collect();
        let files: Vec<serde_json::Value> = written
            .iter()
            .zip(&sizes)
            .map(|(path, bytes)| serde_json::json!({ "file": path.display().to_string(), "bytes": bytes }))
            .collect();
        return output::print_json(&serde_json::json!({
            "cloth": data.name, "format": format.name(), "files": files, "facts": facts,
            "seconds": time.as_secs_f64(), "notes": notes,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        for (path, bytes) in written.iter().zip(&sizes) {
            writeln!(out, "{}: {}", path.display(), report::bytes(*bytes))?;
        }
        writeln!(out, "  time         {}", report::duration(time))?;
        for (name, value) in &exported.facts {
            writeln!(out, "  {:<44} {value:.4}", name.replace('_', " "))?;
        }
        notes.iter().try_for_each(|note| writeln!(out, "  note         {note}"))
    })
}

/// Default output without `-o`: a name that no other format uses.
fn default_output(cloth: &Path, format: Format) -> PathBuf {
    let mut stem = cloth.file_stem().unwrap_or("out".as_ref()).to_os_string();
    stem.push(format!("_{}.{}", format.name(), format.endings()[0]));
    stem.into()
}

/// Refuses file names that do not fit the format, before any work: several files for formats other than a
/// report, the same file twice, a wrong ending.
fn check_names(format: Format, paths: &[PathBuf]) -> Outcome {
    if let ([_, second, ..], true) = (paths, format != Format::Report) {
        let hint = "only a report is written to several files; export once for each file";
        return Err(Failure::input("command line", "-o", second.display(), hint));
    }
    for (k, path) in paths.iter().enumerate() {
        check_ending(format, path)?;
        if paths[..k].contains(path) {
            return Err(Failure::input("command line", "-o", path.display(), "is given twice; name each file once"));
        }
    }
    Ok(())
}

/// Refuses a file whose ending is not one of the format's.
fn check_ending(format: Format, path: &Path) -> Outcome {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if format.endings().contains(&ending.as_str()) {
        return Ok(());
    }
    let endings: Vec<String> = format.endings().iter().map(|e| format!(".{e}")).collect();
    let value = if ending.is_empty() { "no ending".into() } else { format!(".{ending}") };
    Err(Failure::input(path.display(), "-o", value, &format!("name a file {}", endings.join(", "))))
}

/// Options from the flags; refuses flags that the format does not use.
fn options(args: &ExportArgs, format: Format) -> Outcome<ExportOptions> {
    let only = |flag: &str, is_given: bool, formats: &[Format]| match is_given && !formats.contains(&format) {
        true => {
            let names: Vec<&str> = formats.iter().map(|f| f.name()).collect();
            let hint = format!("is for --to {}; leave it out", names.join(", "));
            Err(Failure::input("command line", flag, "(given)", &hint))
        }
        false => Ok(()),
    };
    let solar = [Format::Report, Format::Klems, Format::TensorTree];
    only("--views", !args.views.is_empty(), &[Format::Report])?;
    only("--samples", args.samples.is_some(), &[Format::Report])?;
    only("--squares", args.squares.is_some(), &[Format::TensorTree])?;
    only("--spectral", args.spectral, &[Format::Rgl])?;
    let scaled = [Format::OpenPbr, Format::Blender, Format::Mitsuba];
    let materials = [Format::OpenPbr, Format::Gltf, Format::Usd, Format::Blender, Format::Mitsuba];
    only("--pixels", args.pixels.is_some(), &materials)?;
    only("--cloth-mm", args.cloth_mm.is_some(), &scaled)?;
    only("--sigma-uv", args.sigma_uv.is_some(), &solar)?;
    only("--sigma-ir", args.sigma_ir.is_some(), &solar)?;
    for (flag, value) in [("--sigma", args.sigma), ("--sigma-uv", args.sigma_uv), ("--sigma-ir", args.sigma_ir)] {
        if let Some(v) = value.filter(|v| !(0.0..=1e6).contains(v)) {
            return Err(Failure::input("command line", flag, v, "must be from 0 to 1000000, in 1/um"));
        }
    }
    if let Some(n) = args.squares.filter(|n| ![8, 16, 32].contains(n)) {
        return Err(Failure::input("command line", "--squares", n, "must be 8, 16 or 32"));
    }
    if let Some(mm) = args.cloth_mm.filter(|mm| !(1e-3..=1e6).contains(mm)) {
        return Err(Failure::input("command line", "--cloth-mm", mm, "must be from 0.001 to 1000000"));
    }
    let usual = ExportOptions::default();
    let view = |[tilt, azimuth]: &[f64; 2]| View {
        tilt_rad: if *tilt > 90.0 { 180.0 - tilt } else { *tilt }.to_radians(),
        azimuth_rad: azimuth.to_radians(),
        is_face: *tilt < 90.0,
    };
    Ok(ExportOptions {
        sigma_per_um: args.sigma,
        beyond: BeyondVisible { uv_per_um: args.sigma_uv, ir_per_um: args.sigma_ir },
        samples: args.samples.map_or(usual.samples, |n| n as usize),
        seed: args.seed,
        views: args.views.iter().map(view).collect(),
        squares: args.squares.unwrap_or(usual.squares),
        is_spectral: args.spectral,
        pixels: args.pixels.map_or(usual.pixels, |n| n as usize),
        mm_per_uv: args.cloth_mm.unwrap_or(usual.mm_per_uv),
    })
}
