//! `plywave family`: builds the family of a spec with ranges, and extracts models from a family.

use crate::args::{Cli, FamilyArgs};
use crate::commands::make::simulate;
use crate::commands::runs::pipeline_failure;
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::output;
use crate::progress::{self, PipelineBar};
use crate::report::{self, number};
use crate::threads::on_threads;
use crate::yarn_words::yarn_line;
use plywave::Document;
use plywave::PlyModel;
use plywave::ply::{FamilyAxis, FamilyParam, PlyFamily};
use plywave_pipeline::{FamilyFolder, FamilyOptions, Run, Speckle, build_family, check_family_spec};
use std::path::{Path, PathBuf};

/// Runs the command.
pub fn run(cli: &Cli, args: &FamilyArgs) -> Outcome {
    match kinds::kind_of(&args.input) {
        Some(InputKind::Family) => extract(cli, args),
        // The loader reports the kind of the file.
        None if !args.param.is_empty() => extract(cli, args),
        _ => make(cli, args),
    }
}

/// The axes in words.
fn axes_line(axes: &[FamilyAxis]) -> String {
    let of = |axis: &FamilyAxis| {
        let values: Vec<String> = axis.values.iter().map(|v| number((v * 1e4).round() / 1e4)).collect();
        format!("{} {}", axis.param.name(), values.join(", "))
    };
    axes.iter().map(of).collect::<Vec<_>>().join("; ")
}

fn extract(cli: &Cli, args: &FamilyArgs) -> Outcome {
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.input, "pwm"));
    output::check_writable(&path, &[&args.input])?;
    let family = PlyFamily::load(&args.input)?;
    let mut params = family.params();
    for (key, value) in &args.param {
        if let Some(param) = FamilyParam::of_name(key) {
            params.set(param, *value);
        }
    }
    let data = family.data_at(&params)?;
    data.save(&path)?;
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    if cli.json {
        return output::print_json(&serde_json::json!({
            "model": path.display().to_string(), "bytes": bytes, "family": args.input.display().to_string(),
            "fiber_pitch_um": params.fiber_pitch_um, "alpha_fiber": params.alpha_fiber, "eta": params.eta,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        let at: Vec<String> =
            family.data().axes.iter().map(|a| format!("{} {}", a.param.name(), number(params.get(a.param)))).collect();
        writeln!(out, "{}: {}, {}", path.display(), report::bytes(bytes), at.join(", "))
    })
}

/// The folder of a family's tables, beside the family.
fn folder_of(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".nodes");
    path.with_file_name(name)
}

fn make(cli: &Cli, args: &FamilyArgs) -> Outcome {
    if let Some((key, _)) = args.param.first() {
        let hint = "takes a model out of a family; make the family first, without --param";
        return Err(Failure::input("command line", "--param", key, hint));
    }
    let mut recipe = simulate::recipe(Some(&args.input), &args.run)?;
    recipe.speckle = Speckle::None;
    check_family_spec(&recipe.spec, &recipe.file).map_err(pipeline_failure)?;
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.input, "pwfam"));
    output::check_writable(&path, &[&args.input])?;
    let folder = folder_of(&path);
    let refuse = |e: std::io::Error| Failure::Input(format!("{}: {e}; check the folder", folder.display()));
    if folder.exists() {
        if args.run.resume.fresh {
            clear(&folder);
        } else if !args.run.resume.resume {
            let hint = "tables of an earlier run; go on with --resume, or delete them with --fresh";
            return Err(Failure::input(folder.display(), "folder", "there", hint));
        }
    }
    std::fs::create_dir_all(&folder).map_err(refuse)?;
    let options = FamilyOptions {
        first_nodes: args.nodes as usize,
        most_nodes: args.most_nodes.max(args.nodes) as usize,
        ..FamilyOptions::default()
    };
    progress::install_stop();
    let bar = PipelineBar::new(cli.quiet);
    let tell = |progress| bar.update(progress);
    let run = Run { stop: Some(&progress::STOP), progress: Some(&tell), ..Run::plain() };
    let built = on_threads(cli, || build_family(&recipe, &options, Some(FamilyFolder { path: &folder }), &run));
    let time = bar.finish();
    let data = built?.map_err(pipeline_failure)?;
    data.save(&path)?;
    clear(&folder);
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    if cli.json {
        return output::print_json(&serde_json::json!({
            "family": path.display().to_string(), "bytes": bytes, "nodes": data.nodes.len(),
            "axes": data.axes.iter().map(|a| serde_json::json!({ "param": a.param.name(), "values": a.values })).collect::<Vec<_>>(),
            "preset": data.preset, "seed": data.seed, "seconds": time.as_secs_f64(),
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(
            out,
            "{}: {}, {} nodes in {}",
            path.display(),
            report::bytes(bytes),
            data.nodes.len(),
            report::duration(time)
        )?;
        writeln!(out, "  axes         {}", axes_line(&data.axes))?;
        writeln!(out, "take a model out of it with: plywave family {} --param KEY=VALUE -o MODEL.pwm", path.display())
    })
}

/// Deletes the tables and parts in a family's folder, and the folder if it is then empty.
fn clear(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        match path.extension().and_then(|e| e.to_str()) {
            Some("pwt") => {
                let _ = std::fs::remove_file(&path);
            }
            Some("parts") => {
                if let Ok(parts) = plywave_runs::PartsFolder::open(&path, plywave_runs::Found::Replace) {
                    parts.remove();
                }
            }
            _ => {}
        }
    }
    let _ = std::fs::remove_dir(folder);
}

/// The model of the family's own spec, for commands that show a single model.
pub fn own_model(path: &Path) -> Outcome<PlyModel> {
    let family = PlyFamily::load(path)?;
    Ok(family.at(&family.params())?)
}

/// `plywave info` of a family.
pub fn info(cli: &Cli, file: &Path, bytes: u64, family: &PlyFamily) -> Outcome {
    let d = family.data();
    let spec = family.spec_at(&family.params());
    let first = &d.nodes[0];
    let sigmas = first.sigma_per_um.len().max(1);
    let rms = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, n) = values.fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
        (sum / n.max(1) as f64).sqrt()
    };
    let errors: Vec<[f64; 2]> = d
        .nodes
        .iter()
        .map(|n| [rms(&mut n.error_refl.iter().copied()), rms(&mut n.error_high.iter().step_by(sigmas).copied())])
        .collect();
    if cli.json {
        return output::print_json(&serde_json::json!({
            "file": file.display().to_string(), "kind": "family", "bytes": bytes, "name": spec.name,
            "program_version": d.program_version, "preset": d.preset, "seed": d.seed,
            "axes": d.axes.iter().map(|a| serde_json::json!({ "param": a.param.name(), "values": a.values })).collect::<Vec<_>>(),
            "nodes": d.nodes.len(), "lobes_refl": first.lobes_refl, "lobes_high": first.lobes_high,
            "theta_i_deg": first.theta_i.iter().map(|v| v.to_degrees()).collect::<Vec<_>>(), "h_um": first.h_um,
            "sigma_per_um": first.sigma_per_um, "path_um": first.path_um,
            "fit_error_refl": errors.iter().map(|e| e[0]).collect::<Vec<_>>(),
            "fit_error_high": errors.iter().map(|e| e[1]).collect::<Vec<_>>(),
            "spec": d.spec_text,
        }));
    }
    output::print(|out| {
        let clean = crate::failure::one_line;
        writeln!(out, "{}: family of {}, {}", file.display(), clean(&spec.name), report::bytes(bytes))?;
        let version = clean(&d.program_version);
        writeln!(out, "  written by   plywave {version}, preset {}, seed {}", clean(&d.preset), d.seed)?;
        writeln!(out, "  yarn         {}", yarn_line(&spec))?;
        writeln!(out, "  axes         {}", axes_line(&d.axes))?;
        writeln!(
            out,
            "  nodes        {}, each of {} theta_i and {} h, {} lobes of f_refl and {} of f_high",
            d.nodes.len(),
            first.theta_i.len(),
            first.h_um.len(),
            first.lobes_refl,
            first.lobes_high
        )?;
        let worst = |k: usize| match errors.iter().map(|e| e[k]).fold(0.0, f64::max) {
            0.0 => "none known".to_owned(),
            worst => format!("{worst:.3}"),
        };
        writeln!(
            out,
            "  fit error    f_refl {}, f_high {}: rms over the slices of a node, the worst node",
            worst(0),
            worst(1)
        )
    })
}
