//! Cost of a call through the C interface over that of Rust's, for single calls and batches, of plies and
//! cloths.
//!
//! `cargo bench -p plywave-capi --bench calls`. The two take turns in one run, 40 times; each line has the
//! least times of both [ns a query], their ratio, and the median over the turns of the ratio of each turn,
//! which the machine's other work disturbs least. Functions of C are called through pointers that the
//! compiler cannot see through.

#![allow(clippy::undocumented_unsafe_blocks)] // Of all blocks: live pointers of the lengths that the calls ask for.

use plywave::Document;
use plywave::cloth::ClothOptions;
use plywave::ply::Queries;
use plywave::{Bsdf, ClothModel, ClothQuery, PlyModel, PlyQuery};
use plywave_capi::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ffi::CString;
use std::hint::black_box;
use std::mem::MaybeUninit;
use std::ptr::null_mut;
use std::time::Instant;

#[path = "../tests/it/small_cloth.rs"]
mod small_cloth;

const FABRICS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics");
const TURNS: usize = 40;
const QUERIES: usize = 2048;
const RGB: [f32; 3] = plywave::color::RGB_LAMBDA_UM;

/// Both ways in turn, each for all queries.
fn measure(name: &str, mut rust: impl FnMut(), mut c: impl FnMut()) {
    // About 2 ms a turn.
    let start = Instant::now();
    rust();
    let repeats = (2e-3 / start.elapsed().as_secs_f64()).ceil().clamp(1.0, 1e3) as usize;
    let time = |f: &mut dyn FnMut()| {
        let start = Instant::now();
        (0..repeats).for_each(|_| f());
        start.elapsed().as_secs_f64() * 1e9 / (repeats * QUERIES) as f64
    };
    c();
    let turns: Vec<[f64; 2]> = (0..TURNS)
        .map(|turn| {
            // Neither is always the first.
            if turn % 2 == 0 {
                let a = time(&mut rust);
                [a, time(&mut c)]
            } else {
                let b = time(&mut c);
                [time(&mut rust), b]
            }
        })
        .collect();
    let least = |k: usize| turns.iter().map(|t| t[k]).fold(f64::INFINITY, f64::min);
    let mut ratios: Vec<f64> = turns.iter().map(|t| t[1] / t[0]).collect();
    ratios.sort_by(f64::total_cmp);
    let (rust, c) = (least(0), least(1));
    println!("{name:<42} Rust {rust:8.1} ns  C {c:8.1} ns  ratio {:5.3}  median {:5.3}", c / rust, ratios[TURNS / 2]);
}

/// Counts a value as used.
fn keep<T>(value: T) {
    black_box(value);
}

fn direction(rng: &mut Pcg64Mcg) -> [f32; 3] {
    plywave::frame::direction((2.0 * rng.random::<f32>() - 1.0).asin(), std::f32::consts::TAU * rng.random::<f32>())
}

fn zeroed<T>() -> T {
    // SAFETY: only for the C structs of numbers and pointers, of which all zeros are a value.
    unsafe { MaybeUninit::zeroed().assume_init() }
}

fn plies() {
    let path = format!("{FABRICS}/models/polyester.pwm");
    let model = PlyModel::load(&path).expect("a model that ships");
    let mut ply = null_mut();
    let path = CString::new(path).expect("no 0");
    assert_eq!(unsafe { plywave_ply_load(path.as_ptr(), &mut ply, null_mut()) }, PlywaveStatus::Ok);
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let queries: Vec<PlyQuery<'_, 3>> = (0..QUERIES)
        .map(|_| {
            let (theta_i, h) = (2.8 * (rng.random::<f32>() - 0.5), 120.0 * (rng.random::<f32>() - 0.5));
            PlyQuery::new(theta_i, h, rng.random::<[f32; 3]>().map(|s| 0.05 * s), RGB)
        })
        .collect();
    let c_queries: Vec<PlywavePlyQuery> = queries
        .iter()
        .map(|q| {
            let [a, b, c] = q.sigma_per_um;
            PlywavePlyQuery { theta_i: q.theta_i, h_um: q.h_um, count: 3, sigma_per_um: [a, b, c, 0.0], ..zeroed() }
        })
        .collect();
    let w: Vec<[f32; 3]> = (0..QUERIES).map(|_| direction(&mut rng)).collect();
    let u: Vec<[f32; 3]> = (0..QUERIES).map(|_| rng.random()).collect();

    let at = model.at(&queries[0]);
    let mut bsdf: PlywaveBsdf = zeroed();
    assert_eq!(unsafe { plywave_ply_at(ply, &c_queries[0], &mut bsdf, null_mut()) }, PlywaveStatus::Ok);
    let (eval, eval_pdf) = (black_box(plywave_bsdf_eval), black_box(plywave_bsdf_eval_pdf));
    let (pdf, sample) = (black_box(plywave_bsdf_pdf), black_box(plywave_bsdf_sample));
    let prepare = black_box(plywave_ply_at);
    measure(
        "ply, prepared: eval",
        || w.iter().for_each(|w| keep(at.eval(*w))),
        || {
            w.iter().for_each(|w| {
                let mut f = [0.0f32; 3];
                let status = unsafe { eval(&bsdf, w.as_ptr(), f.as_mut_ptr(), null_mut()) };
                black_box((f, status));
            })
        },
    );
    measure(
        "ply, prepared: eval and pdf",
        || w.iter().for_each(|w| keep(at.eval_pdf(*w))),
        || {
            w.iter().for_each(|w| {
                let (mut f, mut p) = ([0.0f32; 3], 0.0);
                let status = unsafe { eval_pdf(&bsdf, w.as_ptr(), f.as_mut_ptr(), &mut p, null_mut()) };
                black_box((f, p, status));
            })
        },
    );
    measure(
        "ply, prepared: pdf",
        || w.iter().for_each(|w| keep(at.pdf(*w))),
        || {
            w.iter().for_each(|w| {
                let mut p = 0.0;
                let status = unsafe { pdf(&bsdf, w.as_ptr(), &mut p, null_mut()) };
                black_box((p, status));
            })
        },
    );
    measure(
        "ply, prepared: sample",
        || u.iter().for_each(|u| keep(at.sample(*u))),
        || {
            u.iter().for_each(|u| {
                let mut s = MaybeUninit::uninit();
                let status = unsafe { sample(&bsdf, u.as_ptr(), s.as_mut_ptr(), null_mut()) };
                black_box((&s, status));
            })
        },
    );
    measure(
        "ply: prepare, eval and pdf, sample",
        || {
            for i in 0..QUERIES {
                let at = model.at(&queries[i]);
                black_box((at.eval_pdf(w[i]), at.sample(u[i])));
            }
        },
        || {
            let mut bsdf = MaybeUninit::uninit();
            for i in 0..QUERIES {
                let (mut f, mut p, mut s) = ([0.0f32; 3], 0.0, MaybeUninit::uninit());
                unsafe {
                    let bsdf = bsdf.as_mut_ptr();
                    black_box(prepare(ply, &c_queries[i], bsdf, null_mut()));
                    black_box(eval_pdf(bsdf, w[i].as_ptr(), f.as_mut_ptr(), &mut p, null_mut()));
                    black_box(sample(bsdf, u[i].as_ptr(), s.as_mut_ptr(), null_mut()));
                }
                black_box((f, p, &s));
            }
        },
    );
    let (mut f, mut p) = (vec![[0.0f32; 3]; QUERIES], vec![0.0f32; QUERIES]);
    let (mut cf, mut cp) = (f.clone(), p.clone());
    let (w_at, f_at, p_at) = (w.as_ptr().cast(), cf.as_mut_ptr().cast(), cp.as_mut_ptr());
    measure(
        "ply: batch of directions",
        || at.eval_batch(&w, &mut f, &mut p),
        || keep(unsafe { plywave_bsdf_eval_batch(&bsdf, QUERIES, w_at, f_at, p_at, null_mut()) }),
    );
    measure(
        "ply: batch of queries, all terms",
        || {
            for i in 0..QUERIES {
                (f[i], p[i]) = model.at(&PlyQuery { cached: false, ..queries[i] }).eval_pdf(w[i]);
            }
        },
        || {
            let queries = c_queries.as_ptr();
            black_box(unsafe { plywave_ply_eval_batch(ply, QUERIES, queries, w_at, f_at, p_at, null_mut()) });
        },
    );
    let (theta_i, h_um): (Vec<f32>, Vec<f32>) = queries.iter().map(|q| (q.theta_i, q.h_um)).unzip();
    let sigma_per_um: Vec<[f32; 3]> = queries.iter().map(|q| q.sigma_per_um).collect();
    let [x, y, z] = [0, 1, 2].map(|k| w.iter().map(|w| w[k]).collect::<Vec<f32>>());
    let arrays = Queries { theta_i: &theta_i, h_um: &h_um, sigma_per_um: &sigma_per_um, wo: [&x, &y, &z] };
    measure(
        "ply: batch of queries as arrays, lobes",
        || model.eval_batch(&arrays, &mut f),
        || {
            let (t, h, s) = (theta_i.as_ptr(), h_um.as_ptr(), sigma_per_um.as_ptr().cast());
            let [x, y, z] = [x.as_ptr(), y.as_ptr(), z.as_ptr()];
            black_box(unsafe { plywave_ply_lobes_batch(ply, QUERIES, 3, t, h, s, x, y, z, f_at, null_mut()) });
        },
    );
    unsafe { plywave_ply_free(ply) };
}

fn cloths() {
    let bytes = small_cloth::cloth(2).to_bytes().expect("a valid cloth");
    let cloth = ClothModel::from_bytes(&bytes, "plain", &ClothOptions::default()).expect("a cloth");
    let mut c_cloth = null_mut();
    let options = PlywaveClothOptions { no_far: 1, ..zeroed() };
    let loaded = unsafe {
        plywave_cloth_from_memory(bytes.as_ptr(), bytes.len(), c"plain".as_ptr(), &options, &mut c_cloth, null_mut())
    };
    assert_eq!(loaded, PlywaveStatus::Ok);
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let queries: Vec<ClothQuery<'_, 3>> = (0..QUERIES)
        .map(|_| {
            let mut wo = direction(&mut rng);
            wo[2] = wo[2].abs();
            ClothQuery::rgb(rng.random::<[f32; 2]>().map(|r| 3e4 * r), wo)
        })
        .collect();
    let c_queries: Vec<PlywaveClothQuery> = queries
        .iter()
        .map(|q| PlywaveClothQuery { position_um: q.position_um, wo: q.wo, count: 3, channels: 1, ..zeroed() })
        .collect();
    let w: Vec<[f32; 3]> = (0..QUERIES).map(|_| direction(&mut rng)).collect();
    let u: Vec<[f32; 3]> = (0..QUERIES).map(|_| rng.random()).collect();
    let at = cloth.at(&queries[0]);
    let mut bsdf: PlywaveBsdf = zeroed();
    assert_eq!(unsafe { plywave_cloth_at(c_cloth, &c_queries[0], &mut bsdf, null_mut()) }, PlywaveStatus::Ok);
    let (prepare, eval_pdf) = (black_box(plywave_cloth_at), black_box(plywave_bsdf_eval_pdf));
    let sample = black_box(plywave_bsdf_sample);
    measure(
        "cloth: prepare",
        || queries.iter().for_each(|q| keep(&cloth.at(q))),
        || {
            let mut bsdf = MaybeUninit::uninit();
            c_queries.iter().for_each(|q| {
                black_box(unsafe { prepare(c_cloth, q, bsdf.as_mut_ptr(), null_mut()) });
                black_box(&bsdf);
            })
        },
    );
    measure(
        "cloth, prepared: eval and pdf",
        || w.iter().for_each(|w| keep(at.eval_pdf(*w))),
        || {
            w.iter().for_each(|w| {
                let (mut f, mut p) = ([0.0f32; 3], 0.0);
                let status = unsafe { eval_pdf(&bsdf, w.as_ptr(), f.as_mut_ptr(), &mut p, null_mut()) };
                black_box((f, p, status));
            })
        },
    );
    measure(
        "cloth, prepared: sample",
        || u.iter().for_each(|u| keep(at.sample(*u))),
        || {
            u.iter().for_each(|u| {
                let mut s = MaybeUninit::uninit();
                let status = unsafe { sample(&bsdf, u.as_ptr(), s.as_mut_ptr(), null_mut()) };
                black_box((&s, status));
            })
        },
    );
    measure(
        "cloth: prepare, eval and pdf, sample",
        || {
            for i in 0..QUERIES {
                let at = cloth.at(&queries[i]);
                black_box((at.eval_pdf(w[i]), at.sample(u[i])));
            }
        },
        || {
            let mut bsdf = MaybeUninit::uninit();
            for i in 0..QUERIES {
                let (mut f, mut p, mut s) = ([0.0f32; 3], 0.0, MaybeUninit::uninit());
                unsafe {
                    let bsdf = bsdf.as_mut_ptr();
                    black_box(prepare(c_cloth, &c_queries[i], bsdf, null_mut()));
                    black_box(eval_pdf(bsdf, w[i].as_ptr(), f.as_mut_ptr(), &mut p, null_mut()));
                    black_box(sample(bsdf, u[i].as_ptr(), s.as_mut_ptr(), null_mut()));
                }
                black_box((f, p, &s));
            }
        },
    );
    let (mut f, mut p) = (vec![[0.0f32; 3]; QUERIES], vec![0.0f32; QUERIES]);
    let (mut cf, mut cp) = (f.clone(), p.clone());
    let (w_at, f_at, p_at) = (w.as_ptr().cast(), cf.as_mut_ptr().cast(), cp.as_mut_ptr());
    measure(
        "cloth: batch of directions",
        || at.eval_batch(&w, &mut f, &mut p),
        || keep(unsafe { plywave_bsdf_eval_batch(&bsdf, QUERIES, w_at, f_at, p_at, null_mut()) }),
    );
    measure(
        "cloth: batch of queries",
        || {
            for i in 0..QUERIES {
                (f[i], p[i]) = cloth.at(&queries[i]).eval_pdf(w[i]);
            }
        },
        || {
            let queries = c_queries.as_ptr();
            black_box(unsafe { plywave_cloth_eval_batch(c_cloth, QUERIES, queries, w_at, f_at, p_at, null_mut()) });
        },
    );
    unsafe { plywave_cloth_free(c_cloth) };
}

fn main() {
    plies();
    cloths();
}
