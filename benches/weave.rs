//! Time of `Fabric::at` on one core: closed and open, one ply and several, twisted or not; random points and
//! directions of the upper half space. Then of `FabricModel` in three shipped fabrics, with four wavelengths
//! and light from all directions: a query finds its ply, then evaluates, samples, computes the density.
//!
//! `cargo bench -p plywave --bench weave`. The share of gaps is beside each name: a gap queries all four
//! yarns around it. Lines that begin with "memory" show bytes and loading times of drafts up to the largest.

use criterion::{Criterion, criterion_group, criterion_main};
use plywave::fabric::{Draft, Fabric, FabricModel, FabricOptions, FabricSpec, Hit, UvMap, YarnShape};
use plywave::io::Folder;
use plywave::spec::Handedness;
use plywave::{Bsdf, FabricQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::hint::black_box;

const QUERIES: usize = 4096;

fn yarn(plies: u32, spacing_um: f64, ply_pitch_um: Option<f64>) -> YarnShape {
    YarnShape {
        plies,
        ply_radius_um: 50.0,
        ply_pitch_um,
        handedness: Handedness::S,
        spacing_um,
        crimp: 0.3,
        d_cut_um: 20.0,
    }
}

fn weave(c: &mut Criterion) {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let queries: Vec<([f32; 2], [f32; 3])> = (0..QUERIES)
        .map(|_| {
            let (s, c) = (std::f32::consts::TAU * rng.random::<f32>()).sin_cos();
            let z: f32 = rng.random();
            let r = (1.0 - z * z).sqrt();
            (rng.random::<[f32; 2]>().map(|u| 1e5 * u), [r * c, r * s, z])
        })
        .collect();
    let large = Draft::from_fn(4096, 4096, |p, e| (p * 7919 + e * 104_729) % 97 < 41).expect("4096 is allowed");
    let satin = Draft::satin(5, 2).expect("a satin");
    for (name, draft, shape) in [
        ("satin, one ply", satin, yarn(1, 102.0, None)),
        ("4096 x 4096, one ply", large, yarn(1, 102.0, None)),
        ("open plain, one ply", Draft::plain(), yarn(1, 300.0, None)),
        ("plain, 2 plies", Draft::plain(), yarn(2, 205.0, Some(1000.0))),
        ("plain, 3 plies", Draft::plain(), yarn(3, 220.0, Some(1000.0))),
        ("plain, 3 parallel plies", Draft::plain(), yarn(3, 220.0, None)),
        ("plain, 7 plies", Draft::plain(), yarn(7, 340.0, Some(2000.0))),
    ] {
        let fabric = Fabric::new(draft, [shape, shape]).expect("a sound fabric");
        let gaps = queries.iter().filter(|([x, y], w)| matches!(fabric.at(*x, *y, *w), Hit::Gap(_))).count();
        let mut i = 0;
        c.bench_function(&format!("at: {name}, {:.0} % gaps", 100.0 * gaps as f64 / QUERIES as f64), |b| {
            b.iter(|| {
                i = (i + 1) % QUERIES;
                let ([x, y], w) = queries[i];
                black_box(fabric.at(x, y, w))
            })
        });
    }
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

fn fabric(c: &mut Criterion) {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let map = UvMap::new([1e5; 2], 0.3);
    let queries: Vec<Query> = (0..QUERIES)
        .map(|_| {
            let [x, y, z] = direction(rng.random());
            (map.point_um(rng.random()), [x, y, z.abs()], direction(rng.random()), rng.random())
        })
        .collect();
    let lambda_um = [0.45, 0.52, 0.59, 0.66];
    let mut group = c.benchmark_group("fabric");
    for name in ["polyester_satin", "cotton_plain", "silk_organza"] {
        let path = format!("{}/fabrics/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let bsdf = FabricModel::load(path, &FabricOptions::default()).expect("a fabric that ships");
        let at = |i: usize| bsdf.at(&FabricQuery::new(queries[i].0, queries[i].1, lambda_um));
        let mut i = 0;
        let mut next = || {
            i = (i + 1) % QUERIES;
            i
        };
        group.bench_function(format!("{name}: at"), |b| b.iter(|| black_box(at(next()))));
        group.bench_function(format!("{name}: at, eval"), |b| {
            b.iter(|| {
                let i = next();
                black_box(at(i).eval(queries[i].2))
            })
        });
        group.bench_function(format!("{name}: at, sample"), |b| {
            b.iter(|| {
                let i = next();
                black_box(at(i).sample(queries[i].3))
            })
        });
        group.bench_function(format!("{name}: at, eval, sample, pdf"), |b| {
            b.iter(|| {
                let i = next();
                let at = at(i);
                black_box((at.eval(queries[i].2), at.sample(queries[i].3), at.pdf(queries[i].2)))
            })
        });
        group.bench_function(format!("{name}: at, eval with pdf, sample"), |b| {
            b.iter(|| {
                let i = next();
                let at = at(i);
                black_box((at.eval_pdf(queries[i].2), at.sample(queries[i].3)))
            })
        });
    }
    group.finish();
}

/// Bytes and loading time of fabrics of large drafts, all yarns of one color, models apart: rows of text in a
/// fabric spec.
fn memory(_: &mut Criterion) {
    let models = format!("{}/fabrics/models/polyester.pwm", env!("CARGO_MANIFEST_DIR"));
    println!("memory: threads, spec's text, draft and colors, ready for shading, read in, made ready in");
    for threads in [5usize, 64, 512, 4096] {
        let rows = (0..threads).map(|pick| {
            let row: String =
                (0..threads).map(|end| if (pick * 2 + end).is_multiple_of(5) { '.' } else { 'X' }).collect();
            format!("\"{row}\",")
        });
        let yarn = format!("model = {models:?}\nspacing_um = 110.0\ncrimp = 0.3\nsrgb = [0.5, 0.1, 0.1]\n");
        let rows: String = rows.collect();
        let text =
            format!("name = \"large\"\n[weave]\nkind = \"draft\"\nrows = [{rows}]\n[warp]\n{yarn}[weft]\n{yarn}");
        let begun = std::time::Instant::now();
        let loaded = FabricSpec::load_from(&text, "large.toml", &Folder::new("").anywhere()).expect("a sound fabric");
        let read = begun.elapsed();
        let fabric = FabricModel::new(loaded, &FabricOptions::default()).expect("a sound fabric");
        println!(
            "memory: {threads} x {threads}, {} bytes, {} bytes, {} bytes, {:.1} ms, {:.1} ms",
            text.len(),
            fabric.fabric().memory_bytes(),
            fabric.memory_bytes(),
            1e3 * read.as_secs_f64(),
            1e3 * (begun.elapsed() - read).as_secs_f64()
        );
    }
}

criterion_group!(benches, weave, fabric, memory);
criterion_main!(benches);
