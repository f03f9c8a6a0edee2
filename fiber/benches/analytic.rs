//! Analytic fibers at four wavelengths, random directions, offsets and absorptions: the query, eval and
//! sample at a query, and all from one call; and the formula of pbrt-v4's hair for comparison. Ratios within
//! one run are more reliable than times.

use crate::hair::Hair;
use criterion::Criterion;
use plywave::Bsdf;
use plywave::frame::direction;
use plywave::optics::Metal;
use plywave_fiber::{
    DielectricFiber, DielectricParameters, KajiyaKayFiber, KajiyaKayParameters, Mirror, OpaqueFiber, OpaqueParameters,
    RoughDielectricFiber, RoughDielectricParameters,
};
use plywave_fiber::{FiberModel, FiberQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::hint::black_box;

const QUERIES: usize = 256;

pub fn analytic(c: &mut Criterion) {
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    let anywhere = |rng: &mut Pcg64Mcg| {
        direction((1.9 * rng.random::<f32>() - 0.95).asin(), std::f32::consts::TAU * rng.random::<f32>())
    };
    let queries: Vec<(FiberQuery<4>, [f32; 3], [f32; 3])> = (0..QUERIES)
        .map(|_| {
            let query = FiberQuery {
                h_rel: Some(1.98 * rng.random::<f32>() - 0.99),
                sigma_per_um: [0.0, 0.002, 0.01, 0.03].map(|s: f32| s * rng.random::<f32>()),
                ..FiberQuery::new(anywhere(&mut rng), [0.45, 0.53, 0.6, 0.65])
            };
            (query, anywhere(&mut rng), rng.random())
        })
        .collect();
    let hair = Hair::new(1.55, 0.3, 0.3, 0.035);
    let mut i = 0;
    c.bench_function("analytic, pbrt-v4's hair formula, near, from one call", |b| {
        b.iter(|| {
            i = (i + 1) % QUERIES;
            let (query, w, _) = &queries[i];
            let sigma = query.sigma_per_um.map(|s| 40.0 * s);
            black_box(hair.at(query.h_rel.unwrap_or(0.0), sigma).f(query.omega_i, *w))
        })
    });
    let plastic = OpaqueParameters { mirror: Mirror::Dielectric(1.5), diffuse: 0.6, ..Default::default() };
    let matte = OpaqueParameters { mirror: Mirror::None, diffuse: 0.6, ..Default::default() };
    let gold = OpaqueParameters { mirror: Mirror::Metal(Metal::Gold), ..Default::default() };
    let marschner = RoughDielectricParameters::marschner(1.55, 40.0, [-0.1, 0.05, 0.15], [0.1, 0.1, 0.2]);
    let smooth = |beta_n: f32| {
        let p =
            DielectricParameters { beta_n, shift: [-0.05, 0.03, 0.08], beta_m: [0.1, 0.1, 0.2], ..Default::default() };
        DielectricFiber::new(p).expect("valid").into()
    };
    let rough = |p: RoughDielectricParameters| RoughDielectricFiber::new(p).expect("valid").into();
    let oval = RoughDielectricParameters { eccentricity: 0.9, ..Default::default() };
    let opaque = |p: OpaqueParameters| OpaqueFiber::new(p).expect("valid").into();
    let models: [(&str, FiberModel, bool); 9] = [
        ("rough dielectric", rough(RoughDielectricParameters::default()), true),
        ("rough dielectric of an oval", rough(oval), true),
        ("smooth dielectric", smooth(0.1), true),
        ("smooth dielectric with caustics, 5 orders", smooth(0.001), false),
        ("Marschner with caustics", rough(marschner), false),
        ("matte", opaque(matte), true),
        ("plastic", opaque(plastic), true),
        ("gold", opaque(gold), true),
        ("Kajiya-Kay", KajiyaKayFiber::new(KajiyaKayParameters::default()).expect("valid").into(), false),
    ];
    for (name, model, has_near) in &models {
        for near in [true, false] {
            if near && !has_near {
                continue;
            }
            let view = if near { "near" } else { "far" };
            let queries: Vec<_> = queries
                .iter()
                .map(|(q, w, u)| (FiberQuery { h_rel: if near { q.h_rel } else { None }, ..*q }, *w, *u))
                .collect();
            let prepared: Vec<_> = queries.iter().map(|(q, ..)| model.at(q)).collect();
            let mut i = 0;
            c.bench_function(&format!("analytic, {name}, {view}, query"), |b| {
                b.iter(|| {
                    i = (i + 1) % QUERIES;
                    black_box(model.at(&queries[i].0))
                })
            });
            c.bench_function(&format!("analytic, {name}, {view}, eval"), |b| {
                b.iter(|| {
                    i = (i + 1) % QUERIES;
                    black_box(prepared[i].eval(queries[i].1))
                })
            });
            c.bench_function(&format!("analytic, {name}, {view}, sample"), |b| {
                b.iter(|| {
                    i = (i + 1) % QUERIES;
                    black_box(prepared[i].sample(queries[i].2))
                })
            });
            c.bench_function(&format!("analytic, {name}, {view}, eval from one call"), |b| {
                b.iter(|| {
                    i = (i + 1) % QUERIES;
                    let (query, w, _) = &queries[i];
                    black_box(model.at(query).eval(*w))
                })
            });
        }
    }
}
