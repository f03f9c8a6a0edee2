//! Time of lines through cloths and of `ClothModel` on one core, in shipped cloths: a satin of flat yarns,
//! a jersey, an organza of plied yarns with gaps, a flannel with hairs. Random points and directions of the
//! upper half space; then four wavelengths and light from all directions: a query finds its plies,
//! evaluates, samples, computes the density. Last, queries of the mean over the cell.
//!
//! `cargo bench -p plywave --bench cloth`. Beside each name is the share of lines that meet no ply. Lines
//! that begin with "memory" show bytes, and the times of making a cloth and of making it ready for shading.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use plywave::Document;
use plywave::cloth::{ClothBsdf, ClothData, ClothModel, ClothOptions, LineHits, UvMap};
use plywave::{Bsdf, ClothQuery, PlyModel};
use plywave_sim::cloth::{Effort, make_cloth, precompute};
use plywave_textile::ClothSpec;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

const QUERIES: usize = 4096;
/// Cloths that ship, with the models of their plies.
const PLIES: [(&str, &str); 4] = [
    ("satin", "polyester_bundle"),
    ("jersey", "cotton_single"),
    ("organza", "silk_single"),
    ("flannel", "cotton_single"),
];
const LAMBDA_UM: [f32; 4] = [0.45, 0.52, 0.59, 0.66];

/// A cloth that ships, with the model of its plies, which are alike.
fn made(name: &str, ply: &str, has_far: bool) -> ClothData {
    let folder = format!("{}/fabrics", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(format!("{folder}/cloths/{name}.toml")).expect("a cloth that ships");
    let spec = ClothSpec::parse(&text, name).expect("a good spec");
    let no_file = |file: &str| -> plywave::Result<Vec<u8>> { panic!("{file} is not to be read") };
    let made = make_cloth(&spec, name, &mut |file| no_file(file), Effort::Full, &|_| true).expect("a cloth");
    let model = Arc::new(PlyModel::load(format!("{folder}/models/{ply}.pwm")).expect("a model that ships"));
    let models = vec![model; spec.yarns().len()];
    let effort = if has_far { Effort::Full } else { Effort::Near };
    precompute(&spec, &text, &made.curves, &models, effort, &|_| true).expect("a cloth")
}

/// A direction by two numbers in [0, 1).
fn direction(u: [f32; 2]) -> [f32; 3] {
    let (s, c) = (std::f32::consts::TAU * u[1]).sin_cos();
    let z = 2.0 * u[0] - 1.0;
    let r = (1.0 - z * z).max(0.0).sqrt();
    [r * c, r * s, z]
}

/// Point, viewer, light, random numbers.
type Query = ([f32; 2], [f32; 3], [f32; 3], [f32; 3]);

fn queries() -> Vec<Query> {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let map = UvMap::new([1e5; 2], 0.3);
    (0..QUERIES)
        .map(|_| {
            let [x, y, z] = direction(rng.random());
            (map.point_um(rng.random()), [x, y, z.abs()], direction(rng.random()), rng.random())
        })
        .collect()
}

fn cloth(c: &mut Criterion) {
    let queries = queries();
    println!("memory: cloth, bytes of the file, ready for shading, made in, made ready in");
    for (name, ply) in PLIES {
        let begun = Instant::now();
        let data = made(name, ply, false);
        let making = begun.elapsed();
        let bytes = data.to_bytes().expect("a good cloth").len();
        let begun = Instant::now();
        let cloth = ClothModel::from_data(data, &ClothOptions::default()).expect("a good cloth");
        let ready = begun.elapsed();
        let memory = cloth.memory_bytes();
        println!("memory: {name}, {bytes} bytes, {memory} bytes, {making:.1?}, {ready:.1?}");
        let at = |i: usize| cloth.at(&ClothQuery::new(queries[i].0, queries[i].1, LAMBDA_UM));
        let gaps = (0..QUERIES).filter(|i| at(*i).is_gap()).count();
        let mut group = c.benchmark_group(format!("{name}, {:.0} % gaps", 100.0 * gaps as f64 / QUERIES as f64));
        let mut i = 0;
        let mut next = || {
            i = (i + 1) % QUERIES;
            i
        };
        let lines = cloth.lines();
        let mut hits = LineHits::default();
        group.bench_function("line", |b| {
            b.iter(|| {
                let ([x, y], w, ..) = queries[next()];
                let way = (lines.half_thickness_um() + 1.0) / w[2].max(1e-4);
                lines.hits([x + way * w[0], y + way * w[1], way * w[2]], w.map(|v| -v), &mut hits);
                black_box(hits.as_slice().len())
            })
        });
        group.bench_function("at", |b| b.iter(|| black_box(at(next()))));
        group.bench_function("at, eval", |b| {
            b.iter(|| {
                let i = next();
                black_box(at(i).eval(queries[i].2))
            })
        });
        group.bench_function("at, sample", |b| {
            b.iter(|| {
                let i = next();
                black_box(at(i).sample(queries[i].3))
            })
        });
        group.bench_function("at, eval, sample, pdf", |b| {
            b.iter(|| {
                let i = next();
                let at = at(i);
                black_box((at.eval(queries[i].2), at.sample(queries[i].3), at.pdf(queries[i].2)))
            })
        });
        group.bench_function("at, eval with pdf, sample", |b| {
            b.iter(|| {
                let i = next();
                let at = at(i);
                black_box((at.eval_pdf(queries[i].2), at.sample(queries[i].3)))
            })
        });
        group.bench_function("16 directions with pdf at a place", |b| {
            let lights = |at: &mut ClothBsdf<'_, 4>| {
                for query in &queries[..16] {
                    black_box(at.eval_pdf(query.2));
                }
            };
            b.iter_batched_ref(|| at(next()), lights, BatchSize::SmallInput)
        });
        group.finish();
    }
}

/// The mean over the cell, of pixels that cover many yarns.
fn far(c: &mut Criterion) {
    let queries = queries();
    let options = ClothOptions { far: true, ..ClothOptions::default() };
    let cloth = ClothModel::from_data(made("jersey", "cotton_single", true), &options).expect("a good cloth");
    let mut i = 0;
    c.bench_function("jersey from afar: at, eval with pdf, sample", |b| {
        b.iter(|| {
            i = (i + 1) % QUERIES;
            let (point, wo, w, u) = queries[i];
            let at = cloth.at(&ClothQuery { footprint_um: 1e5, ..ClothQuery::new(point, wo, LAMBDA_UM) });
            black_box((at.eval_pdf(w), at.sample(u)))
        })
    });
}

criterion_group!(benches, cloth, far);
criterion_main!(benches);
