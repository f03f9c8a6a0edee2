//! `plywave noise`: compares the statistics of speckle patterns with those of synthesized noise, and writes a
//! model with noise (Yu 2025, 6.2).

use crate::args::{Cli, NoiseArgs, NoiseContrastArg, PolarizationArg};
use crate::commands::wave::compare::within;
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::report::{self, number};
use plywave::Document;
use plywave::ply::PlyData;
use plywave::spec::YarnSpec;
use plywave_tables::speckle::{SpecklePatterns, SpecklePolarization};
use plywave_wave::noise::{
    KIND_NAMES, LineComparison, NoiseContrast, NoiseKind, NoiseOptions, compare_lines, noise_spectrum,
};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Number of synthesized patterns for the statistics.
pub const LINES: usize = 4000;
/// Lags up to which covariances are compared [rad]: the grains and some fringes, and all measured lags.
const LAGS_RAD: [f64; 2] = [5.0 * std::f64::consts::PI / 180.0, std::f64::consts::PI / 6.0];

/// One kind at one wavelength, simulated and synthesized.
#[derive(serde::Serialize)]
struct Line {
    kind: &'static str,
    lambda_um: f64,
    contrast_simulated: f64,
    contrast_simulated_se: f64,
    contrast_synthesized: f64,
    /// Largest difference of the covariances relative to the simulated one at lag 0, up to lags of 5 and 30
    /// degrees.
    covariance_distance: [f64; 2],
    /// Accuracy of the simulated covariance by the same measure: half the distance between those of the even
    /// and the odd patterns.
    covariance_floor: [f64; 2],
}

/// The field of one kind.
#[derive(serde::Serialize)]
struct Field {
    kind: &'static str,
    contrast_simulated: f64,
    contrast: f64,
    half_width_deg: f64,
    fluctuating_share: f64,
    fade: [f64; 2],
}

/// Runs the command.
pub fn run(cli: &Cli, args: &NoiseArgs) -> Outcome {
    let path = args.model.as_ref().map(|model| {
        let stem = model.file_stem().unwrap_or_default().to_string_lossy();
        args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{stem}-noise.pwm")))
    });
    if let (Some(path), Some(model)) = (&path, &args.model) {
        output::check_writable(path, &[&args.patterns, model])?;
    }
    let patterns = SpecklePatterns::load(&args.patterns)?;
    let options = options(args, &patterns)?;
    let data = match &args.model {
        Some(model) => Some((model, same_fiber(args, &patterns, cli.library()?.load(model)?.data().clone(), model)?)),
        None => None,
    };
    let file = args.patterns.display().to_string();
    let start = Instant::now();
    let (noise, kinds) = noise_spectrum(&patterns, &options, &file)?;
    let time = start.elapsed();
    let lines: Vec<Line> = compare_lines(&patterns, &options, LINES, &file)?.iter().map(line).collect();
    let kinds: Vec<Field> = kinds.iter().zip(KIND_NAMES).map(field_of).collect();
    let mut bytes = 0;
    if let (Some((_, data)), Some(path)) = (data, &path) {
        PlyData { noise: Some(noise), ..data }.save(path)?;
        bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    }
    if cli.json {
        return output::print_json(&serde_json::json!({
            "model": path.map(|p| p.display().to_string()), "bytes": bytes, "fit_s": time.as_secs_f64(), "seed": args.seed,
            "fields": kinds, "lines": lines,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        if let Some(path) = &path {
            writeln!(out, "{}: {}, noise fitted in {}", path.display(), report::bytes(bytes), report::duration(time))?;
        }
        writeln!(out, "  fields  contrast simulated, of the field   half width   fluctuating share")?;
        for k in &kinds {
            writeln!(
                out,
                "  {:<6}  {:>18.4}   {:>12.4}   {:>6.2} deg   {:>17.4}",
                k.kind, k.contrast_simulated, k.contrast, k.half_width_deg, k.fluctuating_share
            )?;
        }
        writeln!(
            out,
            "  lines  lambda  contrast simulated, synthesized   distance of covariances to 5 and 30 degrees   of it noise of the simulated"
        )?;
        for l in &lines {
            writeln!(
                out,
                "  {:<5}  {:<6}  {:>8.4} +- {:.4}   {:>8.4}        {:>6.3}  {:>6.3}                          {:>6.3}  {:>6.3}",
                l.kind,
                number(l.lambda_um),
                l.contrast_simulated,
                l.contrast_simulated_se,
                l.contrast_synthesized,
                l.covariance_distance[0],
                l.covariance_distance[1],
                l.covariance_floor[0],
                l.covariance_floor[1]
            )?;
        }
        Ok(())
    })
}

fn line(c: &LineComparison) -> Line {
    let contrast = c.simulated.contrast();
    Line {
        kind: c.kind,
        lambda_um: c.lambda_um,
        contrast_simulated: contrast,
        // Standard error of the square root of C(0).
        contrast_simulated_se: if contrast > 0.0 { 0.5 * c.simulated.errors[0] / contrast } else { 0.0 },
        contrast_synthesized: c.synthesized.contrast(),
        covariance_distance: LAGS_RAD.map(|lag| c.simulated.distance(&c.synthesized, lag)),
        covariance_floor: LAGS_RAD.map(|lag| 0.5 * c.halves[0].distance(&c.halves[1], lag)),
    }
}

fn field_of((k, kind): (&NoiseKind, &'static str)) -> Field {
    Field {
        kind,
        contrast_simulated: k.measured.contrast(),
        contrast: k.model.covariance(0.0).sqrt(),
        half_width_deg: k.model.half_width_rad(LAGS_RAD[1]).to_degrees(),
        fluctuating_share: k.model.share,
        fade: k.model.fade,
    }
}

fn options(args: &NoiseArgs, patterns: &SpecklePatterns) -> Outcome<NoiseOptions> {
    let w0_um = match args.w0 {
        Some(w0) => w0,
        None => spec_of(&args.patterns, patterns)?.beam.w0_um,
    };
    within("--w0", &[w0_um], (0.5, 1e4), " um")?;
    Ok(NoiseOptions {
        seed: args.seed,
        w0_um,
        polarization: match args.polarization {
            PolarizationArg::Unpolarized => SpecklePolarization::Unpolarized,
            PolarizationArg::Tm => SpecklePolarization::Tm,
            PolarizationArg::Te => SpecklePolarization::Te,
        },
        fibers: args.fibers,
        contrast: match args.contrast {
            NoiseContrastArg::Measured => NoiseContrast::Measured,
            NoiseContrastArg::Full => NoiseContrast::Developed,
        },
    })
}

/// The spec in a file of patterns.
pub fn spec_of(file: &Path, patterns: &SpecklePatterns) -> Outcome<YarnSpec> {
    Ok(YarnSpec::parse(&patterns.spec_text, &format!("{} (its spec)", file.display()))?)
}

/// The model; refused if its fiber is not that of the patterns.
fn same_fiber(args: &NoiseArgs, patterns: &SpecklePatterns, data: PlyData, model: &Path) -> Outcome<PlyData> {
    let theirs = spec_of(&args.patterns, patterns)?.fiber;
    let ours = YarnSpec::parse(&data.spec_text, &format!("{} (its spec)", model.display()))?.fiber;
    // Roughness has no effect on the wave optics here, so it is not compared.
    let ours = plywave::spec::FiberSpec { alpha_fiber: theirs.alpha_fiber, ..ours };
    if ours == theirs {
        return Ok(data);
    }
    let hint = format!("is not the fiber of {}; make patterns from the model's spec", model.display());
    Err(Failure::input(args.patterns.display(), "[fiber]", format!("{:?}", theirs.shape), &hint))
}
