//! `plywave swatch`: from two photographs to a cloth spec with error bars.

use crate::args::{Cli, SwatchArgs};
use crate::commands::make::cloth_file::with_progress;
use crate::failure::{Failure, Outcome};
use crate::{output, progress};
use plywave_pipeline::swatch::{
    Photo, SwatchFigures, SwatchFit, SwatchGeometry, SwatchInputs, SwatchWords, fit_swatch,
};
use std::path::Path;

/// Runs the command.
pub fn run(cli: &Cli, args: &SwatchArgs) -> Outcome {
    let output = &args.output;
    if output.extension().is_none_or(|e| e != "toml") {
        return Err(Failure::input(
            output.display(),
            "-o",
            "its ending",
            "a cloth spec is written as .toml; name it so",
        ));
    }
    let [report, picture] = ["json", "png"].map(|ending| output.with_extension(ending));
    let inputs = [&args.front, &args.back];
    for path in [output, &report, &picture] {
        output::check_writable(path, &inputs.map(|p| p.as_path()))?;
    }
    let words = SwatchWords {
        fiber: args.fiber.as_deref(),
        weave: args.weave.as_deref(),
        g_per_m2: args.g_per_m2,
        ends_per_cm: args.ends_per_cm,
        picks_per_cm: args.picks_per_cm,
        count: args.count.as_deref(),
    };
    let flag = |key: &str| format!("--{}", key.replace('_', "-"));
    let known = words.known("command line", &flag).map_err(crate::commands::runs::pipeline_failure)?;
    let geometry = match &args.geometry {
        None => SwatchGeometry::default(),
        Some(path) => SwatchGeometry::load(path)?,
    };
    let inputs = SwatchInputs { photos: [Photo::load(&args.front)?, Photo::load(&args.back)?], geometry, known };
    let begun = std::time::Instant::now();
    let fit = with_progress(cli, |run| fit_swatch(&inputs, run))?;
    let seconds = begun.elapsed().as_secs_f64();
    let json = serde_json::to_string_pretty(&fit).unwrap_or_default() + "\n";
    progress::stoppable(|| -> Outcome {
        output::write_set(&[
            (output.as_path(), fit.spec.as_bytes()),
            (&report, json.as_bytes()),
            (&picture, &fit.picture),
        ])
    })?;
    if cli.json {
        return output::print_json(&serde_json::json!({
            "output": output.display().to_string(), "report": report.display().to_string(),
            "picture": picture.display().to_string(), "seconds": seconds, "fit": fit,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    fit.notes.iter().for_each(|note| eprintln!("note: {note}"));
    tell(&fit, output, seconds)
}

fn tell(fit: &SwatchFit, path: &Path, seconds: f64) -> Outcome {
    output::print(|out| {
        for weave in fit.weaves.iter().take(4) {
            let way = if weave.is_across { "across" } else { "up" };
            let [ends, picks] = weave.per_cm;
            writeln!(out, "  {:<18} {:.2}, {ends:.1} x {picks:.1} per cm, warp {way}", weave.weave, weave.probability)?;
        }
        for n in &fit.numbers {
            // As many digits as the bar has.
            let places = (1.0 - n.sd.max(1e-8).log10().floor()).clamp(0.0, 6.0) as usize;
            writeln!(out, "  {:<18} {:>10.places$} +- {:<10.places$} ({})", n.name, n.value, n.sd, n.from)?;
        }
        for SwatchFigures { light, correlation, photo_width_mm, fit_width_mm, photo_contrast, fit_contrast } in
            &fit.figures
        {
            let width = |w: Option<f64>| w.map_or("> all".into(), |w| format!("{w:.1}"));
            writeln!(
                out,
                "  {light}: correlation {:.3} across, {:.3} down; width {} across, {} down for {}, {} mm; contrast {:.3?} for {:.3?}",
                correlation[0],
                correlation[1],
                width(fit_width_mm[0]),
                width(fit_width_mm[1]),
                width(photo_width_mm[0]),
                width(photo_width_mm[1]),
                fit_contrast,
                photo_contrast
            )?;
        }
        writeln!(out, "{}: left {:.1} % of the blocks, {seconds:.0} s", path.display(), 100.0 * fit.rms)
    })
}
