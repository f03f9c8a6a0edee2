//! Time of the objective for one slice and of a block fit, with its error.
//! `cargo bench -p plywave-fit --bench fit`

#[path = "../tests/it/planted/mod.rs"]
mod planted;

use criterion::{Criterion, criterion_group, criterion_main};
use planted::Planted;
use plywave_fit::{FitOptions, Scratch, SphereGrid, fit_block};
use plywave_tables::table::OutgoingGrid;
use std::hint::black_box;

fn plan() -> Planted {
    Planted {
        rows: 3,
        columns: 3,
        grid: OutgoingGrid { theta_o: 90, phi_o: 180 },
        sigma_per_um: vec![0.0],
        paths: 2e6,
        seed: 1,
        turn: 0.0,
    }
}

fn objective(c: &mut Criterion) {
    let sphere = SphereGrid::new(plan().grid);
    let params: Vec<f64> = planted::high_at(0.4, 20.0, 0.0).iter().flat_map(|l| l.to_params()).collect();
    let mut scratch = Scratch::default();
    let target = sphere.mixture(&params, 1.1, &mut scratch);
    let mut gradient = vec![0.0; params.len()];
    c.bench_function("objective and gradient, 90 x 180 bins, 8 lobes", |b| {
        b.iter(|| sphere.cost_gradient(&target, black_box(&params), 1.0, &mut gradient, &mut scratch))
    });
    c.bench_function("mixture, 90 x 180 bins, 8 lobes", |b| {
        b.iter(|| sphere.mixture(black_box(&params), 1.0, &mut scratch))
    });
}

fn block(c: &mut Criterion) {
    let table = planted::table(&plan());
    let mut group = c.benchmark_group("block of 9 slices, 90 x 180 bins, 8 lobes");
    group.sample_size(10);
    for (name, options) in [("preview", FitOptions::preview()), ("standard", FitOptions::standard())] {
        let fit = fit_block(&table, (0, 0), 8, &options.block).expect("a planted table");
        println!("{name}: rms error with noise {:.4}, {} evaluations", (fit.cost / 9.0).sqrt(), fit.evaluations);
        group.bench_function(name, |b| b.iter(|| fit_block(&table, (0, 0), 8, &options.block)));
    }
}

criterion_group!(benches, objective, block);
criterion_main!(benches);
