//! `plywave diff` of two models with different incidences, offsets or absorptions: both are evaluated at
//! incidences that both contain.

use crate::args::{Cli, DiffArgs};
use crate::commands::Yarn;
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::report::number;
use crate::threads::on_threads;
use plywave::ply::PlyData;
use plywave_fit::{
    DiffTolerance, GridCell, ScaledLobes, Scratch, SphereGrid, energies, energy_high, high_lobes, locate, refl_lobes,
};
use plywave_tables::table::OutgoingGrid;

/// Common incidences: latitudes from 0 on, offsets from rim to rim.
const NODES: [usize; 2] = [7, 9];
/// Bins of the comparison: 4 degrees.
const GRID: OutgoingGrid = OutgoingGrid { theta_o: 45, phi_o: 90 };
/// Slices dimmer than this fraction of the brightest one are compared relative to that fraction of it.
const FLOOR: f64 = 1e-3;

/// Whether two models have the same axes, so that they can be compared node by node.
pub fn same_axes(a: &PlyData, b: &PlyData) -> bool {
    let same = |x: &[f64], y: &[f64]| {
        x.len() == y.len() && x.iter().zip(y).all(|(x, y)| (x - y).abs() <= 1e-9 * (1.0 + x.abs()))
    };
    same(&a.theta_i, &b.theta_i) && same(&a.h_um, &b.h_um) && same(&a.sigma_per_um, &b.sigma_per_um)
}

/// One common incidence.
#[derive(serde::Serialize)]
struct Row {
    theta_i_deg: f64,
    h_rel: f64,
    refl_relative_l2: f64,
    /// Relative L2 distance of f_high at each absorption.
    high_relative_l2: Vec<f64>,
    /// Largest difference of r_d, of the energy of f_refl and of those of f_high.
    energy: f64,
}

/// `n` numbers in equal steps.
fn steps(from: f64, to: f64, n: usize) -> Vec<f64> {
    (0..n).map(|k| from + (to - from) * k as f64 / (n - 1) as f64).collect()
}

/// Absorptions of either model within the range of both.
fn absorptions(a: &PlyData, b: &PlyData) -> Vec<f64> {
    let last = |d: &PlyData| d.sigma_per_um.last().copied().unwrap_or(0.0);
    let max = last(a).min(last(b));
    let mut all: Vec<f64> = a.sigma_per_um.iter().chain(&b.sigma_per_um).copied().filter(|s| *s <= max).collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|x, y| (*x - *y).abs() <= 1e-9 * (1.0 + y.abs()));
    all
}

/// Relative L2 distances of the slices at `places`, one position per model.
fn distances(places: &[[GridCell; 2]], lobes: &dyn Fn(usize, GridCell) -> ScaledLobes) -> Vec<f64> {
    let sphere = SphereGrid::new(GRID);
    let mut scratch = Scratch::default();
    let found: Vec<[f64; 2]> = places
        .iter()
        .map(|place| {
            let [x, y] = [0, 1].map(|k| lobes(k, place[k]));
            let (x, y) = (
                sphere.mixture_of(x.lobes, &x.params, x.gain(), &mut scratch),
                sphere.mixture_of(y.lobes, &y.params, y.gain(), &mut scratch),
            );
            [sphere.distance2(&x, &y).sqrt(), sphere.inner(&x, &x).max(sphere.inner(&y, &y)).sqrt()]
        })
        .collect();
    let top = found.iter().map(|f| f[1]).fold(0.0, f64::max);
    let relative = |[distance, norm]: [f64; 2]| {
        let scale = norm.max(FLOOR * top);
        if scale > 0.0 { distance / scale } else { 0.0 }
    };
    found.into_iter().map(relative).collect()
}

/// Runs the command for models whose axes differ.
pub fn run(cli: &Cli, args: &DiffArgs, [a, b]: [&PlyData; 2], tolerance: &DiffTolerance) -> Outcome {
    if args.tol_drift.is_some() {
        let hint = "lobes of models with different incidences or absorptions have no pairs; leave it out";
        return Err(Failure::Input(format!("command line: --tol-drift: {hint}")));
    }
    let both = [a, b];
    let radii = [
        Yarn::from_spec(&args.a, &a.spec_text, &a.h_um)?.radius_um,
        Yarn::from_spec(&args.b, &b.spec_text, &b.h_um)?.radius_um,
    ];
    let last = |v: &[f64]| v.last().copied().unwrap_or(0.0);
    let theta = last(&a.theta_i).min(last(&b.theta_i));
    let reach = (last(&a.h_um) / radii[0]).min(last(&b.h_um) / radii[1]);
    let incidences: Vec<(f64, f64)> = steps(0.0, theta, NODES[0])
        .into_iter()
        .flat_map(|t| steps(-reach, reach, NODES[1]).into_iter().map(move |h| (t, h)))
        .collect();
    let places: Vec<[GridCell; 2]> =
        incidences.iter().map(|(t, h)| [0, 1].map(|k| locate(both[k], *t, h * radii[k]))).collect();
    let sigma = absorptions(a, b);
    let (refl, high) = on_threads(cli, || {
        let refl = distances(&places, &|k, at| refl_lobes(both[k], at));
        let high: Vec<Vec<f64>> =
            sigma.iter().map(|s| distances(&places, &|k, at| high_lobes(both[k], at, *s))).collect();
        (refl, high)
    })?;
    let difference = |of: &dyn Fn(usize, GridCell) -> f64, at: &[GridCell; 2]| (of(0, at[0]) - of(1, at[1])).abs();
    let rows: Vec<Row> = (0..places.len())
        .map(|i| {
            let at = &places[i];
            let scattered = sigma.iter().map(|s| difference(&|k: usize, place| energy_high(both[k], place, *s), at));
            let stored = [
                difference(&|k: usize, place| energies(both[k], place).r_d, at),
                difference(&|k: usize, place| energies(both[k], place).refl, at),
            ];
            Row {
                theta_i_deg: incidences[i].0.to_degrees(),
                h_rel: incidences[i].1,
                refl_relative_l2: refl[i],
                high_relative_l2: high.iter().map(|h| h[i]).collect(),
                energy: scattered.chain(stored).fold(0.0, f64::max),
            }
        })
        .collect();
    let largest =
        |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |a: f64, v| if v.is_nan() { v } else { a.max(v) });
    let worst_refl = largest(&mut refl.iter().copied());
    let worst_high: Vec<f64> = high.iter().map(|h| largest(&mut h.iter().copied())).collect();
    let energy = largest(&mut rows.iter().map(|r| r.energy));
    let equal =
        worst_refl <= tolerance.l2 && worst_high.iter().all(|w| *w <= tolerance.l2) && energy <= tolerance.energy;
    let printed = if cli.json {
        output::print_json(&serde_json::json!({
            "a": args.a.display().to_string(), "b": args.b.display().to_string(), "compared": "common incidences",
            "sigma_per_um": sigma, "slices": rows, "worst_refl": worst_refl, "worst_high": worst_high, "energy": energy,
            "tolerance_relative_l2": tolerance.l2, "tolerance_energy": tolerance.energy, "equal": equal,
        }))
    } else if !cli.quiet || !equal {
        output::print(|out| {
            writeln!(
                out,
                "the models have other nodes: both are evaluated at {} common incidences, theta_i to {:.1} degrees, |h/R| to {}",
                rows.len(),
                theta.to_degrees(),
                number(reach)
            )?;
            writeln!(out, "f_refl  relative L2 largest {}", number(worst_refl))?;
            for (s, w) in sigma.iter().zip(&worst_high) {
                writeln!(out, "f_high  relative L2 largest {} at sigma {}", number(*w), number(*s))?;
            }
            writeln!(out, "energy  largest difference {} of the beam's power", number(energy))?;
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
