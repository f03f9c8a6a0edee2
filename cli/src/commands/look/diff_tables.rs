//! `plywave diff` of two tables: noise-corrected distances of their slices and differences of their energies,
//! by incidence.

use crate::args::{Cli, DiffArgs};
use crate::commands::Yarn;
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::report::number;
use crate::threads::on_threads;
use plywave::Document;
use plywave_fit::{DiffTolerance, TableDistance, table_distance};
use plywave_tables::table::Table;
use std::io::Write;

/// Compares two tables; `a` is the first.
pub fn run(cli: &Cli, args: &DiffArgs, tolerance: &DiffTolerance) -> Outcome {
    if args.tol_drift.is_some() {
        return Err(Failure::Input("command line: --tol-drift is for models; leave it out".into()));
    }
    let max = args.max_h_rel.unwrap_or(f64::INFINITY);
    if !(0.0..).contains(&max) {
        return Err(Failure::input("command line", "--max-h-rel", max, "must be 0 or more"));
    }
    let (a, b) = (Table::load(&args.a)?, Table::load(&args.b)?);
    let radius_um = Yarn::from_spec(&args.a, &a.spec_text, &a.h_um)?.radius_um;
    let d = on_threads(cli, || table_distance(&a, &b))?
        .map_err(|e| Failure::Input(format!("{}: {e}", args.b.display())))?;
    let (columns, sigmas) = (d.h_um.len(), d.sigma_per_um.len());
    let counts = |i: &usize| (d.h_um[i % columns] / radius_um).abs() <= max;
    let incidences: Vec<usize> = (0..d.refl2.len()).filter(counts).collect();
    if incidences.is_empty() {
        return Err(Failure::input("command line", "--max-h-rel", max, "leaves no offset; use a larger one"));
    }
    let high = |i: usize, k: usize| root(d.high2[i * sigmas + k]);
    let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    // If noise hides every slice, no distance is known and the comparison fails.
    let known = |values: &mut dyn Iterator<Item = Option<f64>>| values.flatten().reduce(f64::max).unwrap_or(f64::NAN);
    let refl = known(&mut incidences.iter().map(|&i| root(d.refl2[i])));
    let worst_high: Vec<f64> = (0..sigmas).map(|k| known(&mut incidences.iter().map(|&i| high(i, k)))).collect();
    let energy_high: Vec<f64> =
        (0..sigmas).map(|k| largest(&mut incidences.iter().map(|&i| d.energy_high[i * sigmas + k].abs()))).collect();
    let energy_refl = largest(&mut incidences.iter().map(|&i| d.energy_refl[i].abs()));
    let r_d = largest(&mut incidences.iter().map(|&i| d.r_d[i].abs()));
    let energy = largest(&mut energy_high.iter().copied().chain([energy_refl, r_d]));
    let equal = refl <= tolerance.l2 && worst_high.iter().all(|w| *w <= tolerance.l2) && energy <= tolerance.energy;
    let printed = if cli.json {
        let slices = rows_json(&d, &incidences, radius_um);
        output::print_json(&serde_json::json!({
            "a": args.a.display().to_string(),
            "b": args.b.display().to_string(),
            "plies": [a.plies, b.plies],
            "sigma_per_um": d.sigma_per_um,
            "slices": slices,
            "worst_refl": root(refl * refl),
            "worst_high": worst_high.iter().map(|w| root(w * w)).collect::<Vec<_>>(),
            "energy": energy,
            "tolerance_relative_l2": tolerance.l2,
            "tolerance_energy": tolerance.energy,
            "equal": equal,
        }))
    } else if !cli.quiet || !equal {
        output::print(|out| {
            write_rows(out, &d, &incidences, radius_um)?;
            write!(out, "  largest        {refl:>8.3}")?;
            worst_high.iter().try_for_each(|w| write!(out, " {w:>8.3}"))?;
            writeln!(out, "   {energy:.4}")?;
            let verdict = if equal { "within" } else { "BEYOND" };
            writeln!(
                out,
                "{verdict} the tolerance: relative L2 {}, energy {}",
                number(tolerance.l2),
                number(tolerance.energy)
            )
        })
    } else {
        Ok(())
    };
    // A closed standard output does not turn a difference into a success.
    if equal { printed } else { Err(Failure::NotHeld) }
}

/// Square root of a squared distance; `None` if noise hides it.
pub fn root(squared: f64) -> Option<f64> {
    (!squared.is_nan()).then(|| squared.max(0.0).sqrt())
}

/// The distances at `incidences`, one object each.
pub fn rows_json(d: &TableDistance, incidences: &[usize], radius_um: f64) -> Vec<serde_json::Value> {
    let (columns, sigmas) = (d.h_um.len(), d.sigma_per_um.len());
    let row = |i: usize| {
        serde_json::json!({
            "theta_i_deg": d.theta_i[i / columns].to_degrees(),
            "h_rel": d.h_um[i % columns] / radius_um,
            "refl_relative_l2": root(d.refl2[i]),
            "high_relative_l2": d.high2[i * sigmas..(i + 1) * sigmas].iter().map(|v| root(*v)).collect::<Vec<_>>(),
            "energy_refl": d.energy_refl[i],
            "energy_high": d.energy_high[i * sigmas..(i + 1) * sigmas],
            "r_d": d.r_d[i],
        })
    };
    incidences.iter().map(|&i| row(i)).collect()
}

/// The distances at `incidences`, one line each, under a head.
pub fn write_rows(out: &mut dyn Write, d: &TableDistance, incidences: &[usize], radius_um: f64) -> std::io::Result<()> {
    let (columns, sigmas) = (d.h_um.len(), d.sigma_per_um.len());
    writeln!(out, "relative L2 of f_refl, then of f_high at each sigma, noise removed; - where noise hides it")?;
    write!(out, "  theta_i    h/R     refl")?;
    d.sigma_per_um.iter().try_for_each(|s| write!(out, " {:>8}", number(*s)))?;
    writeln!(out, "   differences of energy and of r_d")?;
    for &i in incidences {
        let figure = |v: f64| root(v).map_or("-".into(), |v| format!("{v:.3}"));
        let (theta, h) = (d.theta_i[i / columns].to_degrees(), d.h_um[i % columns] / radius_um);
        write!(out, "  {theta:>7.1} {h:>6.2} {:>8}", figure(d.refl2[i]))?;
        d.high2[i * sigmas..(i + 1) * sigmas].iter().try_for_each(|v| write!(out, " {:>8}", figure(*v)))?;
        write!(out, "   {:+.4}", d.energy_refl[i])?;
        d.energy_high[i * sigmas..(i + 1) * sigmas].iter().try_for_each(|e| write!(out, " {e:+.4}"))?;
        writeln!(out, "  {:+.4}", d.r_d[i])?;
    }
    Ok(())
}
