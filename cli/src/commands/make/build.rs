//! `plywave build`: simulates and fits a model in one command.

use crate::args::{BuildArgs, Cli};
use crate::commands::make::{fit, simulate};
use crate::commands::runs::{self, pipeline_failure};
use crate::failure::{Failure, Outcome};
use crate::progress::{self, PipelineBar};
use crate::threads::on_threads;
use crate::{output, report};
use plywave::Document;
use plywave_pipeline::{FitQuality, Run, Speckle, build};
use plywave_tables::speckle::SpecklePatterns;

/// Runs the command. The shards stay until the model is written, so that a run that was stopped while fitting
/// can resume.
pub fn run(cli: &Cli, args: &BuildArgs) -> Outcome {
    let mut recipe = simulate::recipe(args.spec.as_deref(), &args.run)?;
    let spec_path = args.spec.clone().unwrap_or_else(|| "polyester.toml".into());
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&spec_path, "pwm"));
    output::check_writable(&path, &[&spec_path])?;
    let table_path = args.keep_table.then(|| path.with_extension("pwt"));
    if let Some(table_path) = &table_path {
        if *table_path == path {
            let hint = "is where --keep-table puts the table; name the model NAME.pwm";
            return Err(Failure::input("command line", "-o", path.display(), hint));
        }
        output::check_writable(table_path, &[&spec_path])?;
    }
    recipe.speckle = match &args.speckle {
        Some(file) => Speckle::Patterns(Box::new(SpecklePatterns::load(file)?), file.display().to_string()),
        None if args.smooth => Speckle::None,
        None => Speckle::Usual,
    };
    let resume = &args.run.resume;
    let resumed = resume.resume && runs::parts_of(&path).exists();
    let parts = runs::open_parts(&path, resume)?;
    let speckle_parts = match recipe.solved_speckle() {
        Some(_) => Some(runs::open_parts(&path.with_extension("pws"), resume)?),
        None => None,
    };
    progress::install_stop();
    let bar = PipelineBar::new(cli.quiet);
    let tell = |progress| bar.update(progress);
    let run = Run {
        parts: Some(&parts),
        speckle_parts: speckle_parts.as_ref(),
        stop: Some(&progress::STOP),
        progress: Some(&tell),
    };
    let built = on_threads(cli, || build(&recipe, &run));
    bar.finish();
    [Some(&parts), speckle_parts.as_ref()].into_iter().flatten().for_each(|parts| runs::tell_notes(cli, parts));
    let built = built?.map_err(pipeline_failure)?;
    let mut files = Vec::new();
    if let Some(table_path) = &table_path {
        files.push((table_path, built.table.to_bytes()?));
    }
    files.push((&path, built.model.to_bytes()?));
    output::write_set(&files)?;
    parts.remove();
    if let Some(parts) = speckle_parts {
        parts.remove();
    }

    let (data, times) = (&built.model, built.times);
    let simulated = simulate::Summary::new(&built.table, times.simulate, resumed);
    let fitted = fit::Summary::new(data, times.fit);
    let (quality, allowed) =
        (FitQuality::from_data(data), FitQuality { refl: args.max_error_refl, high: args.max_error_high });
    let good = quality.is_within(&allowed);
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    if cli.json {
        let mut object = serde_json::json!({
            "model": path.display().to_string(),
            "table": table_path.as_ref().map(|p| p.display().to_string()),
            "bytes": bytes,
            "name": recipe.spec.name,
            "preset": data.preset,
            "seed": data.seed,
            "good_fit": good,
        });
        simulate::merge(&mut object, &simulated);
        simulate::merge(&mut object, &fitted);
        output::print_json(&object)?;
    } else if !cli.quiet {
        output::print(|out| {
            let name = &recipe.spec.name;
            writeln!(out, "{}: {}, {name} at {} quality", path.display(), report::bytes(bytes), data.preset)?;
            simulate::write_summary(out, &simulated)?;
            fit::write_summary(out, &fitted, times.fit)?;
            writeln!(out, "look at it with: plywave plot {}", path.display())
        })?;
    }
    if good {
        return Ok(());
    }
    // Quiet runs print this on stderr too, because the exit code alone does not give the reason.
    eprintln!(
        "{}: bad fit: the largest errors are f_refl {:.2} (allowed {}), f_high {:.2} (allowed {}); the model is kept; try more lobes ([simulation] lobes_refl, lobes_high) or a better --preset",
        path.display(),
        quality.refl,
        report::number(allowed.refl),
        quality.high,
        report::number(allowed.high)
    );
    Err(Failure::NotHeld)
}
