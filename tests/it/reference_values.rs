//! Reference values of the shipped models: a reader with other rounding reproduces them.

use plywave::ply::LobeKind;
use plywave::{Bsdf, PlyModel, PlyQuery};
use plywave_check::reference::Mixture;
use std::path::PathBuf;

fn models() -> Vec<(String, PlyModel)> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "pwm"));
    paths.sort();
    assert!(paths.len() >= 10, "{paths:?}");
    paths.iter().map(|p| (p.display().to_string(), PlyModel::load(p).unwrap())).collect()
}

#[test]
fn queries_lie_inside_cells() {
    for (name, model) in models() {
        assert_eq!(model.reference_values().len(), 12, "{name}");
        assert!(model.reference_error() < 1e-5, "{name}: {}", model.reference_error());
        let d = model.data();
        for r in model.reference_values() {
            for (x, axis) in [(r.theta_i.abs(), &d.theta_i), (r.h_um, &d.h_um)] {
                let step = axis[1] - axis[0];
                let nearest = axis.iter().map(|node| (f64::from(x) - node).abs() / step).fold(f64::INFINITY, f64::min);
                assert!(nearest > 0.1 && f64::from(x) < *axis.last().unwrap(), "{name}: {x}: {nearest} of a cell");
            }
        }
    }
}

/// Queries changed by a relative 1e-5, as by other arithmetic, have the same values. Differences are relative
/// to the greatest value of the query, as a direction without scattered light has no relative accuracy; for
/// cones they are relative to the greatest value of all queries, as light on the flank of a cone, some mrad
/// wide near the axis, changes relatively more than the angle.
#[test]
fn answers_do_not_hang_on_the_last_digits() {
    let mut worst = 0.0f32;
    for (name, model) in models() {
        let greatest = model.reference_values().iter().flat_map(|r| r.value).fold(1e-6, f32::max);
        for r in model.reference_values() {
            let peak = match model.data().family {
                LobeKind::Round => r.value.iter().copied().fold(1e-6, f32::max),
                LobeKind::Cone => greatest,
            };
            for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0), (0.0, 1.0), (1.0, 0.0)] {
                let (theta_i, h_um) = (r.theta_i * (1.0 + 1e-5 * a), r.h_um * (1.0 + 1e-5 * b));
                assert!(theta_i != r.theta_i || h_um != r.h_um);
                let got = model.at(&PlyQuery::lobes(theta_i, h_um, r.sigma_per_um)).eval(r.wo);
                for (got, want) in got.iter().zip(r.value) {
                    let error = (got - want).abs() / peak;
                    worst = worst.max(error);
                    assert!(error < 1e-3, "{name}: {r:?} at {theta_i}, {h_um}: {got}, error {error}");
                }
            }
        }
    }
    println!("greatest change {worst:.1e}");
}

/// Values in f64, directly from docs/reference/format/models.md.
#[test]
fn a_reader_in_double_precision_agrees() {
    let mut worst = 0.0f64;
    for (name, model) in models() {
        let peak = model.reference_values().iter().flat_map(|r| r.value).fold(0.0f32, f32::max);
        for r in model.reference_values() {
            let sigma = r.sigma_per_um.map(f64::from);
            let reader = Mixture::new(model.data(), r.theta_i.into(), r.h_um.into(), &sigma).unwrap();
            let (refl, high) = reader.eval_split(r.wo.map(f64::from));
            for (high, want) in high.iter().zip(r.value) {
                let error = (refl + high - f64::from(want)).abs() / f64::from(peak);
                worst = worst.max(error);
                assert!(error < 2e-4, "{name}: {r:?}: {}, error {error}", refl + high);
            }
        }
    }
    println!("greatest difference {worst:.1e} of the greatest value");
}
