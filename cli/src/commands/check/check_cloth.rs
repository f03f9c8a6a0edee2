//! `plywave check CLOTH --twin`: compares a cloth model with path tracing of its explicit fibers, direction
//! by direction.

use crate::args::{CheckArgs, Cli};
use crate::commands::make::twin::{angles, sigma_text};
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::progress::Bar;
use crate::threads::on_threads;
use plywave::Document;
use plywave::cloth::{ClothModel, ClothOptions};
use plywave_pipeline::PrecomputedCloth;
use plywave_sim::twin::TwinCurves;
use plywave_tables::twin::{ClothTwin, Comparison, ComparisonOptions, compare};
use plywave_textile::ClothSpec;
use rayon::prelude::*;
use std::path::Path;

/// Tolerances for reflected and for all transmitted light, up to a tilt of 60 degrees and beyond.
const LIGHT_TOLERANCE: [f64; 2] = [0.015, 0.03];
/// Tolerance for the half of the sphere on the side of the light, relative L2.
const UPPER_TOLERANCE: f64 = 0.12;
/// Tolerance for the other half, if more than [`MIN_TRANSMITTED`] of the light goes there.
const LOWER_TOLERANCE: f64 = 0.20;
const MIN_TRANSMITTED: f64 = 0.05;

/// Whether a comparison passes, in the order reflected, transmitted, upper, lower.
fn verdicts(twin: &ClothTwin, c: &Comparison) -> [bool; 4] {
    let [tilt, _] = angles(twin.view(c.view));
    let tilt = tilt.min(180.0 - tilt);
    let tolerance = LIGHT_TOLERANCE[usize::from(tilt > 60.5)];
    let all = |light: &plywave_tables::twin::Light| light.transmitted + light.straight;
    [
        (c.model.reflected - c.twin.reflected).abs() <= tolerance,
        (all(&c.model) - all(&c.twin)).abs() <= tolerance,
        c.upper <= UPPER_TOLERANCE,
        c.twin.transmitted <= MIN_TRANSMITTED || c.lower <= LOWER_TOLERANCE,
    ]
}

/// Runs the command.
pub fn run(cli: &Cli, args: &CheckArgs) -> Outcome {
    let Some(path) = &args.twin else {
        let hint = "a cloth is checked against its twin: give --twin FILE, which `plywave twin` writes";
        return Err(Failure::input("command line", "--twin", "(absent)", hint));
    };
    let twin = ClothTwin::load(path)?;
    let traced = TwinCurves::parse(&twin.spec_text).transpose().map_err(|e| crate::commands::runs::failure(e, path))?;
    let PrecomputedCloth { data, notes, .. } = crate::commands::make::cloth_file::precomputed(cli, &args.model)?;
    if !cli.quiet {
        notes.iter().for_each(|note| eprintln!("note: {note}"));
    }
    let plies = data.models.iter().map(|m| m.data().spec_text.clone()).collect::<Vec<_>>();
    let hairs = ClothSpec::parse(&data.spec_text, &args.model.display().to_string())?.hairs();
    if let Some(what) = match &traced {
        None => Some("curves"),
        Some(traced) => traced.difference(&data.curves, &plies, &hairs),
    } {
        let hint = format!("{} is of another cloth; trace it again with `plywave twin`", path.display());
        return Err(Failure::input(args.model.display(), what, "not the twin's", &hint));
    }
    held(cli, args, (path, &twin), &ClothModel::from_data(data, &ClothOptions::RAYS)?)
}

/// Compares a cloth with its twin.
fn held(cli: &Cli, args: &CheckArgs, (path, twin): (&Path, &ClothTwin), cloth: &ClothModel) -> Outcome {
    let bar = Bar::new("compare", "views", cli.quiet);
    bar.begin("compare", twin.view_count() as u64);
    let of_view = |view| {
        let compared = compare(cloth, twin, view, &ComparisonOptions::default());
        bar.advance(1);
        compared
    };
    let all = on_threads(cli, || (0..twin.view_count()).into_par_iter().map(of_view).collect::<Vec<_>>().concat())?;
    bar.finish();
    let passed = all.iter().all(|c| verdicts(twin, c).iter().all(|v| *v));
    let printed = if cli.json {
        let views: Vec<serde_json::Value> = all
            .iter()
            .map(|c| {
                let ([tilt, azimuth], pass) = (angles(twin.view(c.view)), verdicts(twin, c));
                serde_json::json!({
                    "tilt_deg": tilt, "azimuth_deg": azimuth, "sigma_per_um": twin.sigma(c.sigma),
                    "twin": c.twin, "twin_se": twin.standard_errors(c.view, c.sigma), "model": c.model,
                    "upper": c.upper, "lower": c.lower.is_finite().then_some(c.lower),
                    "passed": pass.iter().all(|v| *v),
                })
            })
            .collect();
        output::print_json(&serde_json::json!({
            "cloth": args.model.display().to_string(), "twin": path.display().to_string(), "views": views, "passed": passed,
        }))
    } else {
        output::print(|out| {
            writeln!(out, "{} beside {}, twin / model; * beyond the limit", args.model.display(), path.display())?;
            writeln!(
                out,
                "  {:>5} {:>7} {:>11}  {:>15}  {:>15}  {:>15}  {:>8} {:>8}",
                "tilt", "azimuth", "sigma", "reflected", "transmitted", "straight", "L2 upper", "L2 lower"
            )?;
            for c in &all {
                let [tilt, azimuth] = angles(twin.view(c.view));
                let pass = verdicts(twin, c);
                if cli.quiet && pass.iter().all(|v| *v) {
                    continue;
                }
                let mark = |k: usize| if pass[k] { ' ' } else { '*' };
                writeln!(
                    out,
                    "  {tilt:>5.1} {azimuth:>7.1} {:>11}  {:.4} / {:.4}{} {:.4} / {:.4}{}  {:.4} / {:.4}  {:>7.3}{} {:>7.3}{}",
                    sigma_text(twin.sigma(c.sigma)),
                    c.twin.reflected,
                    c.model.reflected,
                    mark(0),
                    c.twin.transmitted,
                    c.model.transmitted,
                    mark(1),
                    c.twin.straight,
                    c.model.straight,
                    c.upper,
                    mark(2),
                    c.lower,
                    mark(3)
                )?;
            }
            writeln!(
                out,
                "allowed: reflected and transmitted + straight {} to 60 degrees, {} beyond; upper {UPPER_TOLERANCE}; lower {LOWER_TOLERANCE} where more than {MIN_TRANSMITTED} is transmitted",
                LIGHT_TOLERANCE[0], LIGHT_TOLERANCE[1]
            )
        })
    };
    if passed { printed } else { Err(Failure::NotHeld) }
}
