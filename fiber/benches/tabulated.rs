//! Tabulated fibers: eval, sample with weight and pdf, pdf, and the width, each from one call and at a
//! prepared incidence. The table is synthetic, of the size of Xia's (50 wavelengths, 100 latitudes, 23
//! azimuths of an ellipse, 360 of the scattered light); wavelengths and directions are random, so that
//! queries rarely share a slice.

use criterion::Criterion;
use plywave::Bsdf;
use plywave::frame::direction;
use plywave_fiber::FiberQuery;
use plywave_fiber::{FiberSource, FiberTable, OutlineSymmetry, TabulatedFiber};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::hint::black_box;

const QUERIES: usize = 4096;

/// lambda, wi, wo, u.
type Query = (f32, [f32; 3], [f32; 3], [f32; 3]);

/// A table whose slices are smooth peaks about forward, each a little different.
fn planted() -> FiberTable {
    let (lambdas, latitudes, azimuths, cells) = (50, 100, 23, 360);
    let symmetry = OutlineSymmetry { folds: 2, mirror_rad: Some(0.0) };
    let slices = lambdas * latitudes * azimuths;
    let mut azimuthal = Vec::with_capacity(slices * cells);
    for s in 0..slices {
        let width = 0.1 + 0.4 * (0.5 + 0.5 * (s as f64 * 0.37).sin());
        let at = |j: usize| {
            let d = TAU * (j as f64 / cells as f64 - 0.5);
            0.02 + (-(d / width).powi(2)).exp()
        };
        let sum: f64 = (0..cells).map(at).sum::<f64>() * TAU / cells as f64;
        azimuthal.extend((0..cells).map(|j| (at(j) / sum) as f32));
    }
    FiberTable {
        spec_text: "name = \"planted\"\n".into(),
        program_version: "0.1.0".into(),
        preset: "bench".into(),
        seed: 0,
        source: FiberSource::Wave,
        symmetry,
        beta_m: 0.1,
        lambda_um: (0..lambdas).map(|l| 0.4 + 0.3 * l as f64 / (lambdas - 1) as f64).collect(),
        theta_i: (0..latitudes).map(|m| FRAC_PI_2 * (m as f64 + 0.5) / latitudes as f64).collect(),
        phi_i: symmetry.phi_i(azimuths),
        width_um: vec![3.0; azimuths],
        c_x_um: (0..slices).map(|s| 5.0 + (s as f64 * 0.11).sin()).collect(),
        c_abs_um: vec![0.0; slices],
        azimuthal,
    }
}

pub fn tabulated(c: &mut Criterion) {
    let fiber = TabulatedFiber::from_table(planted()).expect("the planted table is valid");
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let anywhere = |rng: &mut Pcg64Mcg| {
        direction((2.0 * rng.random::<f32>() - 1.0).asin(), std::f32::consts::TAU * rng.random::<f32>())
    };
    let queries: Vec<Query> = (0..QUERIES)
        .map(|_| (0.4 + 0.3 * rng.random::<f32>(), anywhere(&mut rng), anywhere(&mut rng), rng.random()))
        .collect();
    let mut i = 0;
    let mut next = || {
        i = (i + 1) % QUERIES;
        queries[i]
    };
    c.bench_function("tabulated, eval", |b| {
        b.iter(|| {
            let (lambda, wi, wo, _) = next();
            black_box(fiber.at(&FiberQuery::new(wi, [lambda])).eval(wo))
        })
    });
    c.bench_function("tabulated, sample", |b| {
        b.iter(|| {
            let (lambda, wi, _, u) = next();
            black_box(fiber.at(&FiberQuery::new(wi, [lambda])).sample(u))
        })
    });
    c.bench_function("tabulated, pdf", |b| {
        b.iter(|| {
            let (lambda, wi, wo, _) = next();
            black_box(fiber.at(&FiberQuery::new(wi, [lambda])).pdf(wo))
        })
    });
    c.bench_function("tabulated, width", |b| {
        b.iter(|| {
            let (lambda, wi, _, _) = next();
            black_box(fiber.at(&FiberQuery::new(wi, [lambda])).width_um())
        })
    });
    let (lambda, wi, ..) = queries[0];
    let at = fiber.at(&FiberQuery::new(wi, [lambda]));
    c.bench_function("tabulated, eval, incidence looked up once", |b| {
        b.iter(|| {
            let (_, _, wo, _) = next();
            black_box(at.eval(wo))
        })
    });
    c.bench_function("tabulated, sample, incidence looked up once", |b| {
        b.iter(|| {
            let (_, _, _, u) = next();
            black_box(at.sample(u))
        })
    });
}
