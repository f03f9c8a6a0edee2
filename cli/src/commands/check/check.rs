//! `plywave check` of a model: furnace, density and weights of the sampler, chi-square of the samples, stored
//! values, and the fit error of every slice. A yarn is also compared with the traced yarn
//! (`check_traced.rs`), a cloth with its twin (`check_cloth.rs`).

use crate::args::{CheckArgs, Cli};
use crate::commands::Yarn;
use crate::commands::check::check_traced;
use crate::failure::{Failure, Outcome};
use crate::progress::Bar;
use crate::report::{Spread, number};
use crate::threads::on_threads;
use crate::{kinds, output};
use plywave::Document;
use plywave_check::{
    CheckOptions, FURNACE_TOLERANCE, KEPT_TOLERANCE, LAYER_TOLERANCE, PartReport, REFERENCE_TOLERANCE,
    SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE, check_layers, check_model, check_whole,
};
use plywave_pipeline::FitQuality;
use plywave_tables::table::Table;
use rand::{RngExt, SeedableRng};
use std::path::PathBuf;

/// One check: the measured value and its limit.
#[derive(serde::Serialize)]
struct Line {
    check: &'static str,
    value: f64,
    allowed: f64,
    passed: bool,
    /// Meaning of the number.
    #[serde(skip)]
    meaning: &'static str,
}

impl Line {
    fn at_most(check: &'static str, meaning: &'static str, value: f64, allowed: f64) -> Self {
        Line { check, value, allowed, passed: value <= allowed, meaning }
    }
}

/// Fit error of one slice.
#[derive(serde::Serialize)]
struct Slice {
    theta_i_deg: f64,
    h_rel: f64,
    error_refl: Option<f64>,
    error_high: Vec<Option<f64>>,
}

/// Tolerance between the model's energies and the table's; the spectra of path lengths are fitted, so they
/// differ.
const ENERGY_TOLERANCE: f64 = 1e-3;

/// Number of checked parts of a model: its lobes, the whole ply, the ply over a second layer.
const PARTS: u64 = 3;
/// Names of the lines for the whole ply, edge light included.
const WHOLE: [&str; 5] = ["whole_furnace", "whole_weight", "whole_sampled", "whole_chi_square", "whole_kept"];
/// Names of the lines for a ply over a second layer. Weight and chi-square check its sampler; the sampled
/// energy would repeat the furnace's error.
const LAYERS: [&str; 5] = ["layers_furnace", "layers_weight", "", "layers_chi_square", "layers_kept"];

/// The lines of a part of the model.
fn part_lines(lines: &mut Vec<Line>, names: [&'static str; 5], part: &PartReport, furnace: f64) {
    let s = &part.scatter;
    lines.push(Line::at_most(names[0], "|integral of eval - albedo|, all terms", s.furnace_error, furnace));
    lines.push(Line::at_most(names[1], "|weight pdf - eval|, relative", s.weight_error, WEIGHT_TOLERANCE));
    if !names[2].is_empty() {
        let meaning = "sampled - exact energy, standard errors";
        lines.push(Line::at_most(names[2], meaning, s.sampled_furnace_se, SAMPLED_TOLERANCE_SE));
    }
    lines.push(Line {
        check: names[3],
        value: s.chi2_p,
        allowed: part.chi2_threshold,
        passed: s.chi2_p >= part.chi2_threshold,
        meaning: "least p-value, must be above: 1 % chance of a false alarm, all chi-square tests together",
    });
    lines.push(Line::at_most(names[4], "|all light - 1| at sigma = 0", part.kept_error, KEPT_TOLERANCE));
}

/// Refuses files with which this kind of input cannot be compared.
fn refuse(flags: &[(&str, &Option<PathBuf>)], fix: &str) -> Outcome {
    for (flag, path) in flags {
        if let Some(path) = path {
            return Err(Failure::input("command line", flag, path.display(), fix));
        }
    }
    Ok(())
}

/// Runs the command.
pub fn run(cli: &Cli, args: &CheckArgs) -> Outcome {
    if let Some((flag, value)) = [("--max-error-refl", args.max_error_refl), ("--max-error-high", args.max_error_high)]
        .into_iter()
        .find(|(_, v)| !(0.0..).contains(v))
    {
        return Err(Failure::input("command line", flag, value, "must be 0 or more"));
    }
    if matches!(kinds::kind_of(&args.model), Some(kinds::InputKind::Cloth | kinds::InputKind::ClothFile)) {
        refuse(&[("--traced", &args.traced)], "a cloth is compared with its twin: give --twin FILE")?;
        return crate::commands::check::check_cloth::run(cli, args);
    }
    if kinds::kind_of(&args.model) == Some(kinds::InputKind::Filament) {
        let none = [("--table", &args.table), ("--traced", &args.traced), ("--twin", &args.twin)];
        refuse(&none, "an analytic fiber has none: leave it out")?;
        return crate::commands::check::check_filament::run(cli, args);
    }
    refuse(&[("--twin", &args.twin)], "a model is compared with a traced yarn: give --traced TABLE")?;
    let model = match kinds::kind_of(&args.model) {
        // A family is represented by the model of its own spec.
        Some(kinds::InputKind::Family) => crate::commands::make::family::own_model(&args.model)?,
        _ => cli.library()?.load(&args.model)?,
    };
    let data = model.data();
    let yarn = Yarn::from_spec(&args.model, &data.spec_text, &data.h_um)?;
    let mut same_run = false;
    // The table is loaded first, so that errors in it are reported before the long check.
    let table = args.table.as_ref().map(|path| Table::load(path).map(|t| (path.as_path(), t))).transpose()?;
    let given = args.traced.as_ref().map(|path| Table::load(path).map(|t| (path.as_path(), t))).transpose()?;
    // A traced table of --table also serves as --traced. If its incidences differ from the model's, it has no
    // other use.
    let traced = table.as_ref().filter(|(_, t)| t.traced);
    let only_traced = given.is_none()
        && traced.is_some_and(|(_, t)| {
            (&t.theta_i, &t.h_um, &t.sigma_per_um) != (&data.theta_i, &data.h_um, &data.sigma_per_um)
        });
    let held = match table.as_ref().filter(|_| !only_traced) {
        None => None,
        Some((path, table)) => {
            same_run = plywave_fit::has_energies_of(data, table);
            let errors = on_threads(cli, || plywave_fit::errors(data, table))?
                .map_err(|e| Failure::Input(format!("{}: {e}", path.display())))?;
            Some(errors)
        }
    };
    let traced = match given.as_ref().or(traced) {
        None => None,
        Some((path, of_yarn)) => {
            let made = table.as_ref().filter(|(_, t)| !t.traced).map(|(path, t)| (*path, t));
            Some(check_traced::measure(cli, (&args.model, data, &yarn), (path, of_yarn), made)?)
        }
    };
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(args.seed);
    let options = CheckOptions { incidences: args.incidences as usize, ..CheckOptions::default() };
    let bar = Bar::new("check", "parts", cli.quiet);
    bar.begin("check", PARTS);
    let report = check_model(&model, &options, &mut || rng.random());
    bar.advance(1);
    let mut lines = vec![
        Line::at_most("furnace", "|integral of eval - albedo|", report.furnace_error(), FURNACE_TOLERANCE),
        Line::at_most("pdf_integral", "|integral of pdf - chance to hit|", report.pdf_error(), FURNACE_TOLERANCE),
        Line::at_most("weight_times_pdf", "|weight pdf - eval|, relative", report.weight_error(), WEIGHT_TOLERANCE),
        Line::at_most(
            "sampled_furnace",
            "sampled - exact energy, standard errors",
            report.sampled_furnace_se(),
            SAMPLED_TOLERANCE_SE,
        ),
        Line {
            check: "chi_square",
            value: report.chi2_p(),
            allowed: report.chi2_threshold,
            passed: report.chi2_p() >= report.chi2_threshold,
            meaning: "least p-value, must be above: 1 % chance of a false alarm, all chi-square tests together",
        },
        Line::at_most(
            "stored_values",
            "|eval - stored|, relative",
            report.reference_error.into(),
            REFERENCE_TOLERANCE.into(),
        ),
    ];
    if let Some(whole) = check_whole(&model, &options, &mut || rng.random()) {
        part_lines(&mut lines, WHOLE, &whole, FURNACE_TOLERANCE);
    }
    bar.advance(1);
    if let Some(layers) = check_layers(&model, &options, &mut || rng.random()) {
        part_lines(&mut lines, LAYERS, &layers, LAYER_TOLERANCE);
    }
    bar.finish();
    // Without a table, the errors that the fit stored are used.
    let mut rms = None;
    let (error_refl, error_high) = match held {
        None => (data.error_refl.clone(), data.error_high.clone()),
        Some(errors) => {
            let worst = |v: &[f64]| Spread::from_values(v.iter().map(|v| v.abs())).max;
            let energy = worst(&errors.energy_refl).max(worst(&errors.energy_high));
            // A table with another seed has other noise in its energies, so only the table of the fit must
            // match the model's energies exactly.
            if same_run {
                lines.push(Line::at_most("energy", "|energy of the model - of the table|", energy, ENERGY_TOLERANCE));
            }
            rms = Some((errors.rms_refl, errors.rms_high));
            (errors.refl, errors.high)
        }
    };
    let (columns, sigmas) = (data.h_um.len(), data.sigma_per_um.len());
    // If noise hides every slice, no error is known and the check fails.
    let quality = FitQuality::of_errors(data, &error_refl, &error_high);
    let meaning = "largest relative L2 of a slice, noise removed; scaled down where little of the beam hits fibers";
    lines.push(Line::at_most("fit_error_refl", meaning, quality.refl, args.max_error_refl));
    // An absorbing slice may have a large relative error of little light, so errors are weighted by the
    // slice's light.
    let meaning = "the same, as a share of the slice's light at sigma = 0";
    lines.push(Line::at_most("fit_error_high", meaning, quality.high, args.max_error_high));
    for (check, value, allowed, meaning) in traced.iter().flat_map(check_traced::TracedCheck::lines) {
        lines.push(Line::at_most(check, meaning, value, allowed));
    }
    // Errors that are not positive are hidden by noise.
    let known = |v: f64| (v.is_finite() && v > 0.0).then_some(v);
    let slices: Vec<Slice> = (0..error_refl.len())
        .map(|node| Slice {
            theta_i_deg: data.theta_i[node / columns].to_degrees(),
            h_rel: data.h_um[node % columns] / yarn.radius_um,
            error_refl: known(error_refl[node]),
            error_high: error_high[node * sigmas..(node + 1) * sigmas].iter().map(|v| known(*v)).collect(),
        })
        .collect();
    let passed = lines.iter().all(|l| l.passed);
    let printed = if cli.json {
        output::print_json(&serde_json::json!({
            "model": args.model.display().to_string(),
            "incidences": report.incidences.len(),
            "samples_per_incidence": options.samples,
            "seed": args.seed,
            "checks": lines,
            "sigma_per_um": data.sigma_per_um,
            "rms_error_refl": rms.as_ref().and_then(|r| known(r.0)),
            "rms_error_high": rms.as_ref().map(|r| r.1.iter().map(|v| known(*v)).collect::<Vec<_>>()),
            "slices": slices,
            "traced": traced.as_ref().map(check_traced::TracedCheck::json),
            "passed": passed,
        }))
    } else {
        output::print(|out| {
            let width = lines.iter().map(|l| l.check.len()).fold(17, usize::max);
            for line in lines.iter().filter(|l| !cli.quiet || !l.passed) {
                let verdict = if line.passed { "pass" } else { "FAIL" };
                writeln!(
                    out,
                    "{verdict}  {:<width$} {:>12}  allowed {:<9}  {}",
                    line.check,
                    number(line.value),
                    number(line.allowed),
                    line.meaning
                )?;
            }
            if let Some((refl, high)) = rms.as_ref().filter(|_| !cli.quiet) {
                write!(out, "fit error rms, noise removed: f_refl {refl:.4}; f_high, blocks")?;
                data.sigma_per_um.iter().zip(high).try_for_each(|(s, e)| write!(out, ", {e:.4} at sigma {s}"))?;
                writeln!(out)?;
            }
            if !cli.quiet {
                writeln!(
                    out,
                    "fit error per slice, f_refl / f_high at sigma = 0 [%], noise removed; - where noise hides it"
                )?;
                write!(out, "  theta_i \\ h/R")?;
                slices[..columns].iter().try_for_each(|s| write!(out, " {:>11.2}", s.h_rel))?;
                writeln!(out)?;
                for row in slices.chunks(columns) {
                    write!(out, "  {:>9.1} deg", row[0].theta_i_deg)?;
                    let percent = |v: Option<f64>| v.map_or("-".into(), |v| format!("{:.1}", 100.0 * v));
                    for s in row {
                        write!(out, " {:>11}", format!("{}/{}", percent(s.error_refl), percent(s.error_high[0])))?;
                    }
                    writeln!(out)?;
                }
            }
            match traced.as_ref().filter(|_| !cli.quiet) {
                Some(traced) => traced.write(out),
                None => Ok(()),
            }
        })
    };
    // A closed standard output does not turn a failure into a success.
    if passed { printed } else { Err(Failure::NotHeld) }
}
