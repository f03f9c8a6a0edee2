//! Fits of planted tables recover the density, on the nodes and between them.
//!
//! Reference: lobes that drift smoothly over the incidences (tests/planted), with the noise of a known number
//! of paths.

use crate::planted::Planted;
use plywave::Document;
use plywave::PlyQuery;
use plywave::ply::PlyData;
use plywave::ply::asg::{Lobe, PARAMS};
use plywave_fit::{
    BlockEffort, DiffTolerance, FitOptions, GridCell, Part, ScaledLobes, Scratch, SphereGrid, canonicalize, diff,
    errors, fit, fit_single_slices, high_lobes, locate, refl_lobes,
};
use plywave_tables::table::{OutgoingGrid, Table};
use std::sync::OnceLock;

/// One fit of the default plan, shared by the tests.
fn fitted() -> &'static (Table, PlyData) {
    static FIT: OnceLock<(Table, PlyData)> = OnceLock::new();
    FIT.get_or_init(|| {
        let table = crate::planted::table(&Planted::default());
        let model = fit(&table, &FitOptions::standard(), &|_| {}).expect("a planted table");
        (table, model)
    })
}

fn worst(values: &[f64]) -> f64 {
    assert!(values.iter().any(|v| v.is_finite()));
    values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max)
}

fn rms(values: &[f64]) -> f64 {
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    (finite.iter().map(|v| v * v).sum::<f64>() / finite.len() as f64).sqrt()
}

/// Relative L2 distance of the model's lobes from the reference scaled to the same energy, for the shape
/// alone.
fn shape_error(got: &ScaledLobes, want: &[Lobe]) -> f64 {
    let sphere = SphereGrid::new(OutgoingGrid { theta_o: 45, phi_o: 90 });
    let energy: f64 = want.iter().map(|l| l.energy).sum();
    let params: Vec<f64> = want.iter().flat_map(|l| l.to_params()).collect();
    let mut scratch = Scratch::default();
    let want = sphere.mixture(&params, got.energy / energy, &mut scratch);
    let got = sphere.mixture(&got.params, got.gain(), &mut scratch);
    (sphere.distance2(&got, &want) / sphere.inner(&want, &want)).sqrt()
}

#[test]
fn planted_lobes_come_back_on_an_independent_table() {
    let (_, model) = fitted();
    let other = crate::planted::table(&Planted { seed: 2, ..Planted::default() });
    let e = errors(model, &other).unwrap();
    println!("refl worst {:.4} rms {:.4}", worst(&e.refl), rms(&e.refl));
    let sigmas = model.sigma_per_um.len();
    for k in 0..sigmas {
        let of_k: Vec<f64> = e.block.iter().skip(k).step_by(sigmas).copied().collect();
        println!("block at sigma {}: {of_k:.4?}", model.sigma_per_um[k]);
        assert!(worst(&of_k) < 0.06, "sigma {}: blocks {of_k:?}", model.sigma_per_um[k]);
    }
    assert!(worst(&e.refl) < 0.04, "refl {:?}", e.refl);
    assert!(worst(&e.energy_high) < 2e-3 && worst(&e.energy_refl) < 2e-3, "energies within the noise of two tables");
}

#[test]
fn energies_of_the_table_are_the_model_s() {
    let (table, model) = fitted();
    assert!(plywave_fit::has_energies_of(model, table));
    for (node, e) in model.node_energies().iter().enumerate() {
        // A table without energies of its own: bilinear between its few nodes, whose kinks splines round off.
        assert!(
            (e.refl - table.energy_refl[node]).abs() < 1e-2,
            "f_refl at node {node}: {} {}",
            e.refl,
            table.energy_refl[node]
        );
        assert!((e.r_d - table.r_d[node]).abs() < 2e-2, "r_d at node {node}: {}", e.r_d);
    }
    let e = errors(model, table).unwrap();
    for (k, d) in e.energy_high.iter().enumerate() {
        let top = table.energy_high[k / model.sigma_per_um.len() * model.sigma_per_um.len()];
        assert!(d.abs() < 2e-2 * top, "{k}: {d} of {top}");
        assert!(k % model.sigma_per_um.len() != 0 || d.abs() < 2e-2, "sigma = 0: {d}");
    }
    for node in 0..table.energy_refl.len() {
        let size = model.lobes_refl * PARAMS;
        let sum: f64 = model.refl[node * size..(node + 1) * size].chunks_exact(PARAMS).map(|p| p[5]).sum();
        assert!((sum - 1.0).abs() < 1e-12, "shares add up to {sum}");
    }
    assert!(model.high_path.iter().all(|p| *p >= 0.0));
    for spectrum in model.high_path.chunks_exact(model.path_um.len()) {
        assert!((spectrum.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn between_the_nodes_the_model_follows_the_truth() {
    let (_, model) = fitted();
    let (rows, columns) = (model.theta_i.len(), model.h_um.len());
    let (mut refl, mut high, mut dark) = (vec![], vec![], vec![]);
    for m in 0..rows - 1 {
        for n in 0..columns - 1 {
            let at = GridCell { m, s: 0.5, n, t: 0.5 };
            let theta = 0.5 * (model.theta_i[m] + model.theta_i[m + 1]);
            let h = 0.5 * (model.h_um[n] + model.h_um[n + 1]);
            refl.push(shape_error(&refl_lobes(model, at), &crate::planted::refl_lobes(theta, h)));
            high.push(shape_error(&high_lobes(model, at, 0.0), &crate::planted::high_at(theta, h, 0.0)));
            // Between the simulated absorptions, too.
            dark.push(shape_error(&high_lobes(model, at, 0.02), &crate::planted::high_at(theta, h, 0.02)));
        }
    }
    println!(
        "between nodes: refl {:.3} rms {:.3}, high {:.3} rms {:.3}, dark {:.3} rms {:.3}",
        worst(&refl),
        rms(&refl),
        worst(&high),
        rms(&high),
        worst(&dark),
        rms(&dark)
    );
    println!("{refl:.3?}\n{high:.3?}");
    assert!(rms(&refl) < 0.06 && worst(&refl) < 0.12, "refl {refl:?}");
    assert!(rms(&high) < 0.06 && worst(&high) < 0.12, "high {high:?}");
    assert!(rms(&dark) < 0.07 && worst(&dark) < 0.14, "dark {dark:?}");
}

#[test]
#[ignore = "slow: 5 s: absorption is monotone at every sigma"]
fn absorption_is_monotone_at_every_sigma() {
    let (_, model) = fitted();
    let at = GridCell { m: 1, s: 0.3, n: 2, t: 0.8 };
    let mut last = high_lobes(model, at, 0.0);
    for i in 1..200 {
        let next = high_lobes(model, at, 0.002 * i as f64);
        assert!(next.energy <= last.energy);
        for (a, b) in next.params.chunks_exact(PARAMS).zip(last.params.chunks_exact(PARAMS)) {
            assert!(a[5] <= b[5] + 1e-15);
        }
        last = next;
    }
}

#[test]
#[ignore = "slow: 15 s: threads do not change the result"]
fn threads_do_not_change_the_result() {
    let plan = Planted { rows: 3, columns: 5, paths: 1e5, sigma_per_um: vec![0.0, 0.01], ..Planted::default() };
    let table = crate::planted::table(&plan);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit(&table, &FitOptions::preview(), &|_| {}).unwrap())
    };
    assert!(run(1) == run(3), "one and three threads differ");
}

#[test]
fn diff_sees_a_moved_lobe_and_nothing_else() {
    let (_, model) = fitted();
    let tolerance = DiffTolerance::default();
    let same = diff(model, model, &tolerance).unwrap();
    assert_eq!((same.worst, same.energy, same.equal), (0.0, 0.0, true));
    assert_eq!(same.drift_high.unwrap().axis_rad, 0.0);

    // The same lobes in another order and representation.
    let mut turned = model.clone();
    let (lobes, paths) = (model.lobes_high, model.path_um.len());
    for set in 0..turned.high.len() / (lobes * PARAMS) {
        let lobe = &mut turned.high[set * lobes * PARAMS..][..PARAMS];
        lobe.swap(3, 4);
        lobe[2] += 2.5 * std::f64::consts::PI;
        lobe[1] -= std::f64::consts::TAU;
        for k in 0..PARAMS {
            turned.high.swap(set * lobes * PARAMS + k, (set * lobes + 3) * PARAMS + k);
        }
        for j in 0..paths {
            turned.high_path.swap(set * lobes * paths + j, (set * lobes + 3) * paths + j);
        }
    }
    let report = diff(model, &turned, &tolerance).unwrap();
    assert!(report.equal && report.worst < 1e-4, "worst {}", report.worst);
    assert!(report.drift_high.unwrap().axis_rad < 1e-9);
    let mut back = turned.clone();
    canonicalize(&mut back);
    for (a, b) in back.high.iter().zip(&model.high) {
        assert!((a - b).abs() < 1e-12, "canonical form comes back: {a} {b}");
    }
    assert!(back.high_path == model.high_path);

    let mut moved = model.clone();
    moved.high[1] += 0.1;
    let report = diff(model, &moved, &tolerance).unwrap();
    assert!(!report.equal && report.worst > 0.02, "worst {}", report.worst);
    assert!((report.drift_high.unwrap().axis_rad - 0.1 * moved.high[0].cos()).abs() < 0.01);
    assert_eq!(worst(&report.refl), 0.0);
    let mut brighter = model.clone();
    // Node 2 of the slices: their steps are cut in four.
    brighter.energies.share_refl[8] += 0.02;
    let report = diff(model, &brighter, &tolerance).unwrap();
    let want = brighter.node_energies()[2].refl - model.node_energies()[2].refl;
    assert!(want > 1e-3 && !report.equal && (report.energy - want).abs() < 1e-12, "{}, want {want}", report.energy);
    let mut other = model.clone();
    other.h_um.pop();
    assert!(diff(model, &other, &tolerance).is_err());
}

#[test]
fn single_slices_reach_the_floor() {
    let plan = Planted {
        rows: 3,
        columns: 3,
        grid: OutgoingGrid { theta_o: 90, phi_o: 180 },
        sigma_per_um: vec![0.0],
        ..Planted::default()
    };
    let (a, b) = (crate::planted::table(&plan), crate::planted::table(&Planted { seed: 9, ..plan.clone() }));
    let effort = BlockEffort { starts: 3, ..FitOptions::standard().block };
    let got = fit_single_slices(&a, &b, Part::High, &[(0, 1), (1, 1), (2, 2)], 8, &effort).unwrap();
    println!("single slices, squared {got:.6?}");
    assert!(worst(&got) < 0.03f64.powi(2), "{got:?}");
}

#[test]
fn bad_tables_are_refused_by_name() {
    let good = crate::planted::table(&Planted {
        rows: 3,
        columns: 3,
        sigma_per_um: vec![0.0],
        paths: 1e4,
        ..Planted::default()
    });
    let refuse = |change: &dyn Fn(&mut Table), word: &str| {
        let mut table = good.clone();
        change(&mut table);
        let message = fit(&table, &FitOptions::preview(), &|_| {}).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    refuse(&|t| t.theta_i.push(1.5), "theta_i");
    refuse(&|t| t.refl[7] = f32::NAN, "refl");
    refuse(&|t| t.noise_high.clear(), "noise_high");
    refuse(&|t| t.sigma_per_um[0] = 0.1, "sigma_per_um");
    refuse(&|t| t.grid.theta_o = 0, "grid");
    let none = FitOptions { lobes_high: 0, ..FitOptions::preview() };
    assert!(fit(&good, &none, &|_| {}).unwrap_err().to_string().contains("lobes_high"));
}

/// A model that cannot be saved is refused before the fit.
#[test]
fn what_cannot_be_saved_is_refused_before_the_work() {
    let plan = Planted { rows: 3, columns: 3, sigma_per_um: vec![0.0, 0.01], paths: 1e4, ..Planted::default() };
    let good = crate::planted::table(&plan);
    let refuse = |change: &dyn Fn(&mut Table, &mut FitOptions), words: &[&str]| {
        let (mut table, mut options) = (good.clone(), FitOptions::preview());
        change(&mut table, &mut options);
        let message = fit(&table, &options, &|_| panic!("works on what cannot be saved")).unwrap_err().to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
        assert!(message.contains("could not be saved") && message.lines().count() == 1, "{message}");
    };
    refuse(&|_, o| o.lobes_high = 17, &["lobes_high = 17", "1 to 16"]);
    refuse(&|t, _| t.h_um = vec![-1e-7, 0.0, 1e-7], &["h_um[1]", "steps", "simulation"]);
    refuse(&|t, _| t.theta_i = vec![0.0, 1e-9, 2e-9], &["theta_i[1]", "steps", "simulation"]);
    refuse(&|t, _| t.theta_i = vec![0.0, 1.0, 2.0], &["theta_i[2]", "simulation"]);
    refuse(&|t, _| t.r_d[4] = 0.9, &["r_d + energy_refl + energy_high", "at most"]);

    // Absorption so small that it would need paths of kilometers.
    let mut faint = good.clone();
    faint.sigma_per_um[1] = 1e-12;
    let model = fit(&faint, &FitOptions::preview(), &|_| {}).unwrap();
    assert!(model.to_bytes().is_ok_and(|bytes| plywave::PlyModel::from_bytes(&bytes, "faint").is_ok()));
}

#[test]
#[ignore = "slow: 5 s: dark and empty slices are no trouble"]
fn dark_and_empty_slices_are_no_trouble() {
    let mut table = crate::planted::table(&Planted { rows: 3, columns: 3, paths: 1e4, ..Planted::default() });
    let (bins, sigmas) = (table.grid.len(), table.sigma_per_um.len());
    for node in [0, 3, 6] {
        table.refl[node * bins..(node + 1) * bins].fill(0.0);
        table.high[node * sigmas * bins..(node + 1) * sigmas * bins].fill(0.0);
        table.energy_refl[node] = 0.0;
        table.energy_high[node * sigmas..(node + 1) * sigmas].fill(0.0);
    }
    let model = fit(&table, &FitOptions::preview(), &|_| {}).unwrap();
    let all =
        [&model.refl, &model.high, &model.high_path, &model.energies.share_high, &model.error_refl, &model.error_high];
    assert!(all.iter().all(|v| v.iter().all(|x| x.is_finite())));
    let at = GridCell { m: 0, s: 0.0, n: 0, t: 0.0 };
    // A jump from 0 to 0.9 within a node: the spline is bounded and smooth, not exact.
    assert!(high_lobes(&model, at, 0.0).energy < 0.03);

    table.refl.fill(0.0);
    table.high.fill(0.0);
    table.energy_refl.fill(0.0);
    table.energy_high.fill(0.0);
    let model = fit(&table, &FitOptions::preview(), &|_| {}).unwrap();
    assert!(model.high.iter().chain(&model.refl).chain(&model.high_path).all(|x| x.is_finite()));
}

#[test]
fn the_runtime_evaluates_what_the_fit_measured() {
    let (_, model) = fitted();
    let bytes = model.to_bytes().expect("a valid model");
    let runtime = plywave::PlyModel::from_bytes(&bytes, "fitted").expect("the loader takes it");
    let (sphere, mut scratch) = (SphereGrid::new(OutgoingGrid { theta_o: 45, phi_o: 90 }), Scratch::default());
    for (theta_i, h) in [(0.0, 0.0), (0.4, -25.0), (0.83, 41.0), (1.1, -58.0), (0.05, 59.0)] {
        let at = locate(model, theta_i, h);
        let (refl, high) = (refl_lobes(model, at), high_lobes(model, at, 0.007));
        let want_refl = sphere.unpad(&sphere.mixture(&refl.params, refl.gain(), &mut scratch));
        let want_high = sphere.unpad(&sphere.mixture(&high.params, high.gain(), &mut scratch));
        let (top_refl, top_high) =
            (want_refl.iter().copied().fold(0.0, f32::max), want_high.iter().copied().fold(0.0, f32::max));
        for bin in (0..want_refl.len()).step_by(37) {
            let (theta, phi) = (sphere.grid().theta(bin / 90), sphere.grid().phi(bin % 90));
            let wo = plywave::frame::direction(theta as f32, phi as f32);
            let got = runtime.at(&PlyQuery::lobes(theta_i as f32, h as f32, [0.007])).terms(wo);
            let (got_refl, [got_high]) = (got.refl, got.high);
            assert!(
                (got_refl - want_refl[bin]).abs() < 1e-3 * top_refl,
                "refl: got {got_refl}, want {}",
                want_refl[bin]
            );
            assert!(
                (got_high - want_high[bin]).abs() < 1e-3 * top_high,
                "high: got {got_high}, want {}",
                want_high[bin]
            );
        }
    }
}
