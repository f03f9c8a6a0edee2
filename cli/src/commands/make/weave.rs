//! `plywave weave`: makes the curves or the cloth of a spec and reports its textile measures.

use crate::args::{Cli, Preset, WeaveArgs};
use crate::commands::make::cloth_file;
use crate::commands::runs::pipeline_failure;
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::plot::{self, Format};
use crate::{output, progress, report};
use plywave::Document;
use plywave::cloth::ClothData;
use plywave_pipeline::ClothRecipe;
use plywave_sim::cloth::{CurveFormat, MAX_FORCE, MadeCloth, YarnMeasures, measure, write_curves};
use plywave_textile::{ClothSpec, Derived, YarnOfCloth};
use std::path::Path;
use std::time::{Duration, Instant};

/// Runs the command.
pub fn run(cli: &Cli, args: &WeaveArgs) -> Outcome {
    let is_cloth = args.output.as_ref().is_some_and(|path| path.extension().is_some_and(|e| e == "pwc"));
    let format = match &args.output {
        None => None,
        Some(path) if is_cloth => {
            output::check_writable(path, &[&args.cloth])?;
            None
        }
        Some(path) => {
            output::check_writable(path, &[&args.cloth])?;
            let format = CurveFormat::of(path);
            let hint = "a cloth is written as .pwc, its curves as .toml, .bcc or .tg3; name the file so";
            Some(format.ok_or_else(|| Failure::input(path.display(), "-o", "its ending", hint))?)
        }
    };
    let mut recipe = cloth_file::recipe(&args.cloth)?;
    recipe.quality = args.preset.map(Preset::quality);
    recipe.is_draft = args.draft;
    // What is quick to refuse comes first, models that may take minutes last.
    let plies = match is_cloth {
        true => Some(recipe.plies(&cli.library()?).map_err(pipeline_failure)?),
        false => None,
    };
    let begun = Instant::now();
    let made = cloth_file::curves(cli, &recipe)?;
    let time = begun.elapsed();
    if args.strict && made.unrest().is_some() {
        tell(cli, None, &recipe, &made, time)?;
        return Err(Failure::NotHeld);
    }
    if let (Some(path), Some(plies)) = (&args.output, plies) {
        let models = cloth_file::models(cli, plies)?;
        let bytes = cloth_file::make(cli, &recipe, &made, &models)?.to_bytes()?;
        progress::stoppable(|| output::write_whole(path, &bytes))?;
    }
    if let (Some(path), Some(format)) = (&args.output, format) {
        progress::stoppable(|| output::write_whole(path, &write_curves(&made.curves, &recipe.spec.name, format)))?;
    }
    tell(cli, args.output.as_deref(), &recipe, &made, time)
}

/// `plywave plot` of a cloth spec: sections through it.
pub fn plot(cli: &Cli, file: &Path, output: &Path, format: Format) -> Outcome {
    let (name, curves, m) = if kinds::kind_of(file) == Some(InputKind::ClothFile) {
        let data = ClothData::load(file)?;
        let spec = ClothSpec::parse(&data.spec_text, &file.display().to_string())?;
        let lattice = data.curves.lattice("cloth")?;
        let measures = measure(&data.curves, &lattice, &spec.yarns())?;
        (spec.name, data.curves, measures)
    } else {
        let recipe = cloth_file::recipe(file)?;
        let made = cloth_file::curves(cli, &recipe)?;
        (recipe.spec.name, made.curves, made.measures)
    };
    let particulars =
        format!("{:.0} um thick, {:.1} % open, {:.0} g/m2", m.thickness_um, 100.0 * m.openness, m.mass_g_per_m2);
    let figure = plot::cloth::sections(&name, &particulars, &curves)?;
    let bytes = format.encode(&figure, output)?;
    progress::stoppable(|| output::write_whole(output, &bytes))?;
    if cli.quiet {
        return Ok(());
    }
    let (width, height) = figure.size();
    output::print(|out| {
        writeln!(out, "{}: {width} x {height}, {}", output.display(), report::bytes(bytes.len() as u64))
    })
}

fn tell(cli: &Cli, path: Option<&Path>, recipe: &ClothRecipe, made: &MadeCloth, time: Duration) -> Outcome {
    let (spec, m) = (&recipe.spec, &made.measures);
    if cli.json {
        return output::print_json(&serde_json::json!({
            "cloth": spec.name,
            "output": path.map(|p| p.display().to_string()),
            "curves": made.curves.curves.len(),
            "points": made.curves.curves.iter().map(|c| c.control_um.len()).sum::<usize>(),
            "cell_um": made.curves.cell_um,
            "measures": m,
            "derived": spec.yarns().iter().enumerate().map(|(kind, yarn)| {
                let of = yarn.derived.iter().map(|d| (d.key.to_string(), serde_json::json!({ "value": d.value, "from": d.from })));
                (recipe.kind_name(kind).to_string(), of.collect::<serde_json::Value>())
            }).collect::<serde_json::Value>(),
            "relaxed": made.relaxed.map(|r| serde_json::json!({
                "nodes": r.nodes, "steps": r.steps, "force": r.force, "force_limit": MAX_FORCE,
                "at_rest": made.unrest().is_none(), "overlap": r.overlap,
            })),
            "seconds": time.as_secs_f64(),
            "notes": made.notes,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}", spec.name)?;
        let [a, b] = made.curves.cell_um;
        let (curves, yarns) = (made.curves.curves.len(), made.curves.yarns.len());
        writeln!(
            out,
            "  cell         ({:.1}, {:.1}) x ({:.1}, {:.1}) um, {} of {}",
            a[0],
            a[1],
            b[0],
            b[1],
            report::counted(curves as u64, "curve", "curves"),
            report::counted(yarns as u64, "yarn", "yarns")
        )?;
        for measures in &m.yarns {
            let of = spec.yarns();
            let Some(yarn) = of.get(measures.kind as usize) else { continue };
            write_yarn(out, recipe.kind_name(measures.kind as usize), yarn, measures, spec)?;
            for Derived { key, value, from } in &yarn.derived {
                writeln!(out, "    {key:<12} {value} ({from})")?;
            }
        }
        writeln!(out, "  thickness    {:.0} um", m.thickness_um)?;
        writeln!(out, "  cover        {:.2} % covered, {:.2} % open", 100.0 * (1.0 - m.openness), 100.0 * m.openness)?;
        writeln!(out, "  mass         {:.1} g/m2", m.mass_g_per_m2)?;
        match &made.relaxed {
            None => {
                writeln!(out, "  curves       as they came; largest overlap {:.2} % of a radius", 100.0 * m.overlap)?
            }
            Some(r) => writeln!(
                out,
                "  relaxed      {:.1} s: {} steps, unbalanced forces {:.1e} of the tension, largest overlap {:.2} % of a radius",
                time.as_secs_f64(),
                r.steps,
                r.force,
                100.0 * m.overlap
            )?,
        }
        match path {
            None => Ok(()),
            Some(path) => {
                let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
                writeln!(out, "{}: {}", path.display(), report::bytes(bytes))
            }
        }
    })
}

fn write_yarn(
    out: &mut dyn std::io::Write,
    name: &str,
    yarn: &YarnOfCloth,
    measures: &YarnMeasures,
    spec: &ClothSpec,
) -> std::io::Result<()> {
    // Curves from a file may have more strands than the spec states.
    let strands = match (measures.strands, yarn.plies) {
        (1, _) => "one ply".to_string(),
        (strands, 2..) if strands == yarn.strands() => format!("{strands} plies"),
        (strands, _) => format!("{strands} bundles"),
    };
    let bends = match measures.least_bend {
        bend if bend.is_finite() => format!("bends of {bend:.1} R at least"),
        _ => "straight".into(),
    };
    let along = match spec.knit.is_some() {
        true => format!("{:.3} mm a cell", 1e-3 * measures.length_um),
        false => format!("crimp {:.1} %", 100.0 * measures.crimp),
    };
    writeln!(
        out,
        "  {name:<12} {:.1} tex, {strands} of R {:.1} um; {along}, {:.0} um wide, {:.0} um high, {bends}",
        yarn.tex(),
        measures.strand_radius_um,
        measures.width_um,
        measures.height_um
    )
}
