//! Time of the runtime on one core: eval of all terms, single and in batches, sample + pdf, loading; the slow f64 twin beside them.
//!
//! `cargo bench -p plywave --bench runtime`. The planted model has 3 reflection lobes, 8 high-order lobes, 8 path lengths;
//! incidences, absorptions and directions are random, so that hardly two queries share a block. `sample` gives direction, weight
//! and pdf. Times of a batch are of all its queries; the throughput is of one.

#[path = "../tests/synthetic/mod.rs"]
mod synthetic;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use plywave::{PlyModel, Queries, direction};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::hint::black_box;
use synthetic::{STANDARD, Sizes, model};

const QUERIES: usize = 4096;

/// theta_i, h, sigma, wo, u.
type Query = (f32, f32, [f32; 4], [f32; 3], [f32; 3]);

fn queries() -> Vec<Query> {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    (0..QUERIES)
        .map(|_| {
            let theta_i = 2.8 * (rng.random::<f32>() - 0.5);
            let h = 260.0 * (rng.random::<f32>() - 0.5);
            let sigma = rng.random::<[f32; 4]>().map(|s| 0.05 * s);
            let wo = direction((2.0 * rng.random::<f32>() - 1.0).asin(), std::f32::consts::TAU * rng.random::<f32>());
            (theta_i, h, sigma, wo, rng.random())
        })
        .collect()
}

fn runtime(c: &mut Criterion) {
    let data = model(1, Sizes { refl: 3, ..STANDARD });
    let m = PlyModel::from_data(data.clone()).expect("the planted model is valid");
    let q = queries();
    let mut i = 0;
    let mut next = || {
        i = (i + 1) % QUERIES;
        q[i]
    };
    c.bench_function("eval N=4", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            black_box(m.eval(theta_i, h, sigma, wo))
        })
    });
    c.bench_function("eval N=1", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            black_box(m.eval(theta_i, h, [sigma[0]], wo))
        })
    });
    c.bench_function("eval N=3", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            black_box(m.eval(theta_i, h, [sigma[0], sigma[1], sigma[2]], wo))
        })
    });
    c.bench_function("sample N=4", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, _, u) = next();
            black_box(m.sample(theta_i, h, sigma, u))
        })
    });
    c.bench_function("pdf N=4", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            black_box(m.pdf(theta_i, h, sigma, wo))
        })
    });
    c.bench_function("albedo N=4", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, _, _) = next();
            black_box(m.albedo(theta_i, h, sigma))
        })
    });
    c.bench_function("eval N=4, f64 twin", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            let twin = plywave::reference::Mixture::new(&data, theta_i.into(), h.into(), &sigma.map(f64::from));
            black_box(twin.map(|t| t.eval_split(wo.map(f64::from))))
        })
    });

    let mut group = c.benchmark_group("batch");
    group.throughput(Throughput::Elements(QUERIES as u64));
    let wo: Vec<[f32; 3]> = q.iter().map(|q| q.3).collect();
    let (mut f, mut pdf) = (vec![[0.0; 4]; QUERIES], vec![0.0; QUERIES]);
    let (theta_i, h_um): (Vec<f32>, Vec<f32>) = q.iter().map(|q| (q.0, q.1)).unzip();
    let sigma_per_um: Vec<[f32; 4]> = q.iter().map(|q| q.2).collect();
    let [x, y, z] = [0, 1, 2].map(|c| wo.iter().map(|w| w[c]).collect::<Vec<f32>>());
    let queries = Queries { theta_i: &theta_i, h_um: &h_um, sigma_per_um: &sigma_per_um, wo: [&x, &y, &z] };
    group.bench_function("eval N=4", |b| b.iter(|| m.eval_batch(&queries, &mut f)));
    let (theta_i, h_um) = (vec![0.5; QUERIES], vec![20.0; QUERIES]);
    let sigma_per_um = vec![[0.0, 0.01, 0.02, 0.05]; QUERIES];
    let queries = Queries { theta_i: &theta_i, h_um: &h_um, sigma_per_um: &sigma_per_um, wo: [&x, &y, &z] };
    group.bench_function("eval N=4, one incidence", |b| b.iter(|| m.eval_batch(&queries, &mut f)));
    group.bench_function("eval + pdf N=4, one incidence", |b| {
        b.iter(|| m.eval_directions(0.5, 20.0, [0.0, 0.01, 0.02, 0.05], &wo, &mut f, &mut pdf))
    });
    group.finish();

    let bytes = data.to_bytes().expect("the planted model is valid");
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("model.ply");
    data.save(&path).expect("the planted model is valid");
    println!("model file: {} bytes", bytes.len());
    c.bench_function("load", |b| b.iter(|| black_box(PlyModel::load(&path).expect("just written"))));
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30).warm_up_time(std::time::Duration::from_millis(500)).measurement_time(std::time::Duration::from_secs(2));
    targets = runtime
}
criterion_main!(benches);
