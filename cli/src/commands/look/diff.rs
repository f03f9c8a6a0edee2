//! `plywave diff`: two models of the same nodes compared slice by slice; of other nodes: `diff_models.rs`;
//! tables: `diff_tables.rs`.

use crate::args::{Cli, DiffArgs};
use crate::commands::Yarn;
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::output;
use crate::report::{Spread, number};
use crate::threads::on_threads;
use plywave_fit::{DiffTolerance, LobeDrift};
use std::path::Path;

/// Drift of lobes, for the report.
#[derive(serde::Serialize)]
struct Drift {
    axis_deg: f64,
    ln_mu: f64,
    energy_share: f64,
}

impl From<LobeDrift> for Drift {
    fn from(d: LobeDrift) -> Self {
        Drift { axis_deg: d.axis_rad.to_degrees(), ln_mu: d.ln_mu, energy_share: d.share }
    }
}

/// A slice that differs most in its component.
#[derive(serde::Serialize)]
struct Worst {
    theta_i_deg: f64,
    h_rel: f64,
    sigma_per_um: Option<f64>,
    relative_l2: f64,
}

/// Runs the command.
pub fn run(cli: &Cli, args: &DiffArgs) -> Outcome {
    let usual = DiffTolerance::default();
    let tolerance = DiffTolerance {
        l2: args.tol.unwrap_or(usual.l2),
        energy: args.tol_energy.unwrap_or(usual.energy),
        drift_rad: args.tol_drift.map_or(usual.drift_rad, f64::to_radians),
    };
    for (flag, value) in
        [("--tol", tolerance.l2), ("--tol-energy", tolerance.energy), ("--tol-drift", tolerance.drift_rad)]
    {
        if !(0.0..).contains(&value) {
            return Err(Failure::input("command line", flag, value, "must be 0 or more"));
        }
    }
    if kinds::kind_of(&args.a) == Some(InputKind::Table) {
        return crate::commands::look::diff_tables::run(cli, args, &tolerance);
    }
    if args.max_h_rel.is_some() {
        return Err(Failure::Input("command line: --max-h-rel is for tables; leave it out".into()));
    }
    let library = cli.library()?;
    let load = |path: &Path| library.load(path).map(|model| model.data().clone());
    let (a, b) = (load(&args.a)?, load(&args.b)?);
    if !crate::commands::look::diff_models::same_axes(&a, &b) {
        return crate::commands::look::diff_models::run(cli, args, [&a, &b], &tolerance);
    }
    let yarn = Yarn::from_spec(&args.a, &a.spec_text, &a.h_um)?;
    let report = on_threads(cli, || plywave_fit::diff(&a, &b, &tolerance))?
        .map_err(|e| Failure::Input(format!("{}: {e}", args.b.display())))?;
    let (columns, sigmas) = (a.h_um.len(), a.sigma_per_um.len());
    let worst = |values: &[f64], stride: usize| {
        (0..values.len()).max_by(|x, y| values[*x].total_cmp(&values[*y])).map(|i| Worst {
            theta_i_deg: a.theta_i[i / stride / columns].to_degrees(),
            h_rel: a.h_um[i / stride % columns] / yarn.radius_um,
            sigma_per_um: (stride > 1).then(|| a.sigma_per_um[i % stride]),
            relative_l2: values[i],
        })
    };
    let (refl, high) = (worst(&report.refl, 1), worst(&report.high, sigmas));
    let printed = if cli.json {
        let rows = |v: &[f64], n: usize| v.chunks(n.max(1)).map(<[f64]>::to_vec).collect::<Vec<_>>();
        output::print_json(&serde_json::json!({
            "a": args.a.display().to_string(),
            "b": args.b.display().to_string(),
            "theta_i_deg": a.theta_i.iter().map(|t| t.to_degrees()).collect::<Vec<_>>(),
            "h_rel": a.h_um.iter().map(|h| h / yarn.radius_um).collect::<Vec<_>>(),
            "sigma_per_um": a.sigma_per_um,
            "refl_relative_l2": rows(&report.refl, columns),
            "high_relative_l2": report.high.chunks(columns * sigmas).map(|r| rows(r, sigmas)).collect::<Vec<_>>(),
            "refl_between_relative_l2": rows(&report.refl_between, columns - 1),
            "high_between_relative_l2": rows(&report.high_between, columns - 1),
            "worst_refl": refl,
            "worst_high": high,
            "worst_relative_l2": report.worst,
            "energy": report.energy,
            "drift_refl": report.drift_refl.map(Drift::from),
            "drift_high": report.drift_high.map(Drift::from),
            "tolerance_relative_l2": tolerance.l2,
            "tolerance_energy": tolerance.energy,
            "tolerance_drift_deg": args.tol_drift,
            "equal": report.equal,
        }))
    } else if !cli.quiet || !report.equal {
        output::print(|out| {
            for (name, values, worst) in [("f_refl", &report.refl, &refl), ("f_high", &report.high, &high)] {
                let spread = Spread::from_values(values.iter().copied());
                write!(out, "{name}  relative L2 rms {}, largest {}", number(spread.rms), number(spread.max))?;
                match worst {
                    Some(w) if w.relative_l2 > 0.0 => {
                        let sigma = w.sigma_per_um.map_or(String::new(), |s| format!(", sigma {}", number(s)));
                        writeln!(out, " at theta_i {:.1} deg, h {:.2} R{sigma}", w.theta_i_deg, w.h_rel)?;
                    }
                    _ => writeln!(out)?,
                }
            }
            let between = Spread::from_values(report.refl_between.iter().chain(&report.high_between).copied()).max;
            writeln!(out, "between the nodes largest {}", number(between))?;
            writeln!(out, "energy  largest difference {} of the beam's power", number(report.energy))?;
            for (name, drift) in [("f_refl", report.drift_refl), ("f_high", report.drift_high)] {
                match drift.map(Drift::from) {
                    Some(d) => writeln!(
                        out,
                        "lobes of {name}  axes turned by up to {:.2} deg, ln mu moved by {:.3}, share of energy by {:.3}",
                        d.axis_deg, d.ln_mu, d.energy_share
                    )?,
                    None => writeln!(out, "lobes of {name}  differ in number")?,
                }
            }
            let verdict = if report.equal { "within" } else { "BEYOND" };
            let drift = args.tol_drift.map_or("any".into(), |d| format!("{} deg", number(d)));
            writeln!(
                out,
                "{verdict} the tolerance: relative L2 {}, energy {}, turn of lobes {drift}",
                number(tolerance.l2),
                number(tolerance.energy)
            )
        })
    } else {
        Ok(())
    };
    // A reader that went away does not turn a difference into a success.
    if report.equal { printed } else { Err(Failure::NotHeld) }
}
