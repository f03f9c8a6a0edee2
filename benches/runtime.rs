//! Time of the runtime on one core: eval of all terms, single and in batches, sample + pdf, loading; the f64
//! brute-force reference for comparison; the whole model with its edge light, and weave gaps.
//!
//! `cargo bench -p plywave --bench runtime`. The synthetic model has 3 reflection lobes, 8 high-order lobes,
//! 8 path lengths; incidences, absorptions and directions are random, so that queries rarely share a block.
//! `sample` returns direction, weight and pdf. Times of a batch are of all its queries; the throughput is per
//! query.

use plywave::Document;
#[path = "../tests/it/synthetic/mod.rs"]
mod synthetic;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use plywave::frame::direction;
use plywave::gap::{Aperture, Gap, SLIT_SHARE, Slit};
use plywave::ply::{FibersAround, PlyData, PlyPlace, Queries};
use plywave::spec::GaussianBeam;
use plywave::speckle::NoiseSpectrum;
use plywave::{Bsdf, PlyModel, PlyQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::hint::black_box;
use synthetic::{STANDARD, Sizes, model};

const QUERIES: usize = 4096;

/// theta_i, h, sigma, wo, u.
type Query = (f32, f32, [f32; 4], [f32; 3], [f32; 3]);

/// f_refl + f_high, interpolated at every call.
fn uncached<const N: usize>(theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> PlyQuery<'static, N> {
    PlyQuery { cached: false, ..PlyQuery::lobes(theta_i, h_um, sigma_per_um) }
}

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

/// Noise of both kinds; its numbers do not affect the time.
fn spectrum() -> NoiseSpectrum {
    NoiseSpectrum {
        seed: 2,
        spectrum: vec![1.0 / 199.0; 200],
        step_um: [0.1; 2],
        share: [0.3, 1.0],
        w0_um: 10.0,
        lambda_um: 0.4,
        fade: [[1.0, 0.0]; 2],
        contrast: [1.0; 2],
    }
}

/// A place on ply i.
fn place(i: usize) -> Option<PlyPlace> {
    Some(PlyPlace::new(i as u32, 0.01 * i as f32, 3.0 * i as f32))
}

/// Factors of one place after another, as a host needs them, and what speckle adds to an eval.
fn noise(c: &mut Criterion) {
    let field = spectrum().field(FibersAround { count: 9.0, ring_um: 20.0 });
    let q = queries();
    let lambda = [0.45, 0.52, 0.59, 0.66];
    let mut i = 0;
    let mut next = || {
        i = (i + 1) % QUERIES;
        (i, q[i])
    };
    c.bench_function("noise tables made of their spectrum", |b| {
        b.iter(|| black_box(spectrum().field(FibersAround { count: 9.0, ring_um: 20.0 })))
    });
    c.bench_function("noise factors N=4, new places", |b| {
        b.iter(|| {
            let (i, (theta_i, h, _, wo, _)) = next();
            black_box(place(i).map(|place| field.factors(&place, 0.1 * h, theta_i, wo, lambda)))
        })
    });
    c.bench_function("noise factors N=1, new places", |b| {
        b.iter(|| {
            let (i, (theta_i, h, _, wo, _)) = next();
            black_box(place(i).map(|place| field.factors(&place, 0.1 * h, theta_i, wo, [0.55])))
        })
    });
    let data = PlyData { noise: Some(spectrum()), ..model(1, Sizes { refl: 3, ..STANDARD }) };
    let m = PlyModel::from_data(data).expect("the planted model is valid");
    c.bench_function("eval of a place N=4", |b| {
        b.iter(|| {
            let (i, (theta_i, h, sigma, wo, _)) = next();
            let place = place(i);
            black_box(
                m.at(&PlyQuery { place, relief: false, cached: false, ..PlyQuery::new(theta_i, h, sigma, lambda) })
                    .eval(wo),
            )
        })
    });
    c.bench_function("eval of all terms, smooth, N=4", |b| {
        b.iter(|| {
            let (_, (theta_i, h, sigma, wo, _)) = next();
            black_box(m.at(&PlyQuery { cached: false, ..PlyQuery::new(theta_i, h, sigma, lambda) }).eval(wo))
        })
    });
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
            black_box(m.at(&uncached(theta_i, h, sigma)).eval(wo))
        })
    });
    c.bench_function("eval N=1", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            black_box(m.at(&uncached(theta_i, h, [sigma[0]])).eval(wo))
        })
    });
    c.bench_function("eval N=3", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            black_box(m.at(&uncached(theta_i, h, [sigma[0], sigma[1], sigma[2]])).eval(wo))
        })
    });
    c.bench_function("sample N=4", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, _, u) = next();
            black_box(m.at(&uncached(theta_i, h, sigma)).sample(u))
        })
    });
    c.bench_function("pdf N=4", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            black_box(m.at(&uncached(theta_i, h, sigma)).pdf(wo))
        })
    });
    c.bench_function("albedo N=4", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, _, _) = next();
            black_box(m.at(&uncached(theta_i, h, sigma)).albedo())
        })
    });
    c.bench_function("eval N=4, f64 reference", |b| {
        b.iter(|| {
            let (theta_i, h, sigma, wo, _) = next();
            let reference =
                plywave_check::reference::Mixture::new(&data, theta_i.into(), h.into(), &sigma.map(f64::from));
            black_box(reference.map(|t| t.eval_split(wo.map(f64::from))))
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
        b.iter(|| m.at(&uncached(0.5, 20.0, [0.0, 0.01, 0.02, 0.05])).eval_batch(&wo, &mut f, &mut pdf))
    });
    group.finish();

    whole(c, &q);

    let bytes = data.to_bytes().expect("the planted model is valid");
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("model.ply");
    data.save(&path).expect("the planted model is valid");
    println!("model file: {} bytes", bytes.len());
    c.bench_function("load", |b| b.iter(|| black_box(PlyModel::load(&path).expect("just written"))));
    let shipped = format!("{}/fabrics/models/polyester_3ply.pwm", env!("CARGO_MANIFEST_DIR"));
    c.bench_function("load, a model that ships", |b| {
        b.iter(|| black_box(PlyModel::load(&shipped).expect("a model that ships")))
    });
}

/// The whole model, for comparison with its core (`eval N=4` above): random directions, and directions about
/// the forward one with the edge light; gaps of random apertures.
fn whole(c: &mut Criterion, q: &[Query]) {
    let beam = GaussianBeam { w0_um: 10.0, lambda_um: 0.55, d_cut_um: 20.0 };
    let edge = plywave_fit::fit_edge_lobes(&beam, 110.0, &plywave_fit::EdgeOptions::default()).lobes;
    let m = PlyModel::from_data(PlyData { edge: Some(edge), ..model(1, Sizes { refl: 3, ..STANDARD }) })
        .expect("the planted model is valid");
    let lambda_um = [0.45, 0.52, 0.6, 0.68];
    let slit = Slit::new(2.0, SLIT_SHARE, &beam).expect("a valid slit");
    let at = |q: &Query| PlyQuery { cached: false, ..PlyQuery::new(q.0, q.1, q.2, lambda_um) };
    let forward: Vec<[f32; 3]> = q
        .iter()
        .map(|q| direction(-q.0 + 0.02 * (q.4[0] - 0.5), 1.5 * std::f32::consts::PI + 0.04 * (q.4[1] - 0.5)))
        .collect();
    let mut i = 0;
    let mut next = || {
        i = (i + 1) % q.len();
        i
    };
    let mut group = c.benchmark_group("whole");
    group.bench_function("eval N=4", |b| {
        b.iter(|| {
            let i = next();
            black_box(m.at(&at(&q[i])).eval(q[i].3))
        })
    });
    group.bench_function("eval N=4, forward", |b| {
        b.iter(|| {
            let i = next();
            black_box(m.at(&at(&q[i])).eval(forward[i]))
        })
    });
    let noisy = PlyModel::from_data(PlyData { noise: Some(spectrum()), ..m.data().clone() }).expect("a valid model");
    for (name, places) in [("new places", true), ("one place", false)] {
        group.bench_function(format!("eval N=4, noise, {name}"), |b| {
            b.iter(|| {
                let i = next();
                let place = place(if places { i } else { 0 });
                black_box(noisy.at(&PlyQuery { place, relief: false, ..at(&q[i]) }).eval(q[i].3))
            })
        });
    }
    group.bench_function("prepare N=4, noise", |b| {
        b.iter(|| {
            let i = next();
            black_box(noisy.at(&PlyQuery { place: place(i), relief: false, cached: true, ..at(&q[i]) }))
        })
    });
    // Many incidences that hit, so that the processor cannot learn the directions of one; as many as fit the
    // near caches.
    let prepared: Vec<_> = (0..q.len())
        .filter(|i| noisy.at(&PlyQuery::lobes(q[*i].0, q[*i].1, [0.0])).r_d() < 1.0)
        .take(16)
        .map(|i| {
            let smooth = PlyQuery { cached: true, ..at(&q[i]) };
            let speckled = PlyQuery { place: place(i), relief: false, ..smooth };
            (noisy.at(&speckled), noisy.at(&smooth))
        })
        .collect();
    for (name, noise) in [("smooth", false), ("noise", true)] {
        let of = |i: usize| {
            let (with, without) = &prepared[i % prepared.len()];
            if noise { with } else { without }
        };
        group.bench_function(format!("prepared eval N=4, {name}"), |b| {
            b.iter(|| {
                let i = next();
                black_box(of(i).eval(q[i].3))
            })
        });
        group.bench_function(format!("prepared sample N=4, {name}"), |b| {
            b.iter(|| {
                let i = next();
                black_box(of(i).sample(q[i].4))
            })
        });
        group.bench_function(format!("prepared pdf N=4, {name}"), |b| {
            b.iter(|| {
                let i = next();
                black_box(of(i).pdf(q[i].3))
            })
        });
    }
    group.bench_function("eval N=4, slit", |b| {
        b.iter(|| {
            let i = next();
            black_box(m.at(&PlyQuery { slit: Some(&slit), ..at(&q[i]) }).eval(q[i].3))
        })
    });
    group.bench_function("sample N=4", |b| {
        b.iter(|| {
            let i = next();
            black_box(m.at(&at(&q[i])).sample(q[i].4))
        })
    });
    group.bench_function("pdf N=4", |b| {
        b.iter(|| {
            let i = next();
            black_box(m.at(&at(&q[i])).pdf(q[i].3))
        })
    });
    group.finish();

    let gap = Gap::new(&Aperture { x_um: [-5.0, 9.0], y_um: [-20.0, 3.0] }, &beam);
    let incidence = gap.at([0.3, -0.2, 0.93], lambda_um);
    let mut group = c.benchmark_group("gap");
    group.bench_function("new", |b| {
        b.iter(|| {
            let u = q[next()].4;
            black_box(Gap::new(&Aperture { x_um: [-20.0 * u[0], 20.0 * u[1]], y_um: [-20.0 * u[2], 5.0] }, &beam))
        })
    });
    group.bench_function("at N=4", |b| {
        b.iter(|| {
            let u = q[next()].4;
            black_box(gap.at([0.5 * u[0], 0.5 * u[1], 0.7], lambda_um))
        })
    });
    group.bench_function("eval N=4", |b| b.iter(|| black_box(incidence.eval(q[next()].3))));
    group.bench_function("pdf N=4", |b| b.iter(|| black_box(incidence.pdf(q[next()].3))));
    group.bench_function("sample N=4", |b| b.iter(|| black_box(incidence.sample(q[next()].4))));
    group.bench_function("albedo N=4", |b| b.iter(|| black_box(incidence.albedo())));
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30).warm_up_time(std::time::Duration::from_millis(500)).measurement_time(std::time::Duration::from_secs(2));
    targets = runtime, noise
}
criterion_main!(benches);
