//! Regression test of fitted lobes: the current fit of a stored small table against its stored model.
//!
//! To renew the files, on purpose and with a line in CHANGELOG.md, run
//! `plywave simulate tests/data/small.toml --preset preview -o tests/data/small.pwt` and
//! `plywave fit tests/data/small.pwt -o tests/data/small.pwm`.

use plywave::Document;
use plywave::ply::PlyData;
use plywave::spec::YarnSpec;
use plywave_fit::{DiffTolerance, FitOptions, diff, errors, fit};
use plywave_runs::Run;
use plywave_sim::{SimOptions, simulate};
use plywave_tables::table::Table;

fn data(name: &str) -> String {
    format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn todays_fit_is_the_stored_one() {
    let table = Table::load(data("small.pwt")).unwrap();
    let stored = PlyData::load(data("small.pwm")).unwrap();
    let today = fit(&table, &FitOptions::preview(), &|_| {}).unwrap();
    let report = diff(&stored, &today, &DiffTolerance::default()).unwrap();
    assert!(report.equal, "worst slice {}, energy {}: {:?}", report.worst, report.energy, report.drift_high);
    // And a different model is detected.
    let mut moved = today.clone();
    moved.high.iter_mut().step_by(6).for_each(|theta_z| *theta_z += 0.1);
    assert!(!diff(&stored, &moved, &DiffTolerance::default()).unwrap().equal);
}

/// The stored model fits a current simulation of the same spec, with other paths and instances, as well as
/// its own table: the simulator has not drifted.
#[test]
#[ignore = "slow: 15 s: todays simulation is the stored one"]
fn todays_simulation_is_the_stored_one() {
    let (spec, text) = YarnSpec::load(data("small.toml")).unwrap();
    let options = SimOptions { seed: 77, ..SimOptions::preview().overridden_by(&spec.simulation) };
    let table = simulate(&spec, &text, &options, Run::plain()).unwrap();
    let stored = PlyData::load(data("small.pwm")).unwrap();
    let e = errors(&stored, &table).unwrap();
    let rms = |v: &[f64]| {
        let known: Vec<f64> = v.iter().copied().filter(|v| v.is_finite()).collect();
        (known.iter().map(|v| v * v).sum::<f64>() / known.len() as f64).sqrt()
    };
    let (refl, high) = (rms(&e.refl), rms(&e.high.iter().copied().step_by(3).collect::<Vec<_>>()));
    assert!(refl < 0.2 && high < 0.12, "f_refl {refl}, f_high {high}");
    for (i, (a, b)) in table.energy_refl.iter().zip(stored.node_energies()).enumerate() {
        let b = b.refl;
        assert!((a - b).abs() < 0.02, "energy_refl {i}: {a} against {b}");
    }
}
