//! The tabulated fiber. Chain of trust: M_0 is tested against the printed formula and its integrals in its
//! own file; the interpolation is compared with an f64 reference written from
//! `docs/reference/format/models.md`; furnace, sampling and chi-square use the same checks as the ply model;
//! invalid files are refused in one line.

use plywave::Document;
use plywave::frame::direction;
use plywave::io::{FileKind, file_kind};
use plywave::{Bsdf, BsdfSample};
use plywave_check::{FURNACE_TOLERANCE, SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE, check_bsdf};
use plywave_fiber::FiberQuery;
use plywave_fiber::{FiberSource, FiberTable, OutlineSymmetry, TabulatedFiber};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A synthetic table: random azimuthal functions with a forward peak, and varying widths and absorption.
fn table(seed: u64, symmetry: OutlineSymmetry, [l, t, p, d]: [usize; 4], absorbing: bool) -> FiberTable {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let slices = l * t * p;
    let width_um: Vec<f64> = (0..p).map(|_| 1.0 + rng.random::<f64>()).collect();
    let c_x_um: Vec<f64> = (0..slices).map(|s| width_um[s % p] * (0.5 + 7.0 * rng.random::<f64>())).collect();
    let absorbed: Vec<f64> = (0..slices).map(|_| if absorbing { 0.9 * rng.random::<f64>() } else { 0.0 }).collect();
    let mut azimuthal = Vec::new();
    for slice in 0..slices {
        let peak = 30.0 * rng.random::<f64>();
        let values: Vec<f64> = (0..d)
            .map(|j| {
                let forward = peak * (-0.5 * ((TAU * j as f64 / d as f64 - PI) / 0.1).powi(2)).exp();
                // Intervals without any light are part of the test.
                let dark = j % 40 > 30;
                if dark { 0.0 } else { rng.random::<f64>() + forward }
            })
            .collect();
        let sum = values.iter().sum::<f64>() * TAU / d as f64;
        azimuthal.extend(values.iter().map(|v| (v * (1.0 - absorbed[slice]) / sum) as f32));
    }
    let step = 0.4 / l as f64;
    FiberTable {
        spec_text: "made up".into(),
        program_version: "0".into(),
        preset: "test".into(),
        seed,
        source: FiberSource::Wave,
        symmetry,
        beta_m: 0.15,
        lambda_um: (0..l).map(|k| 0.38 + (k as f64 + 0.5) * step).collect(),
        theta_i: FiberTable::theta_nodes(t),
        phi_i: symmetry.phi_i(p),
        width_um,
        c_abs_um: c_x_um.iter().zip(&absorbed).map(|(c, a)| c * a).collect(),
        c_x_um,
        azimuthal,
    }
}

const ELLIPSE: OutlineSymmetry = OutlineSymmetry { folds: 2, mirror_rad: Some(0.0) };
const KIDNEY: OutlineSymmetry = OutlineSymmetry { folds: 1, mirror_rad: Some(FRAC_PI_2) };
const SWIRL: OutlineSymmetry = OutlineSymmetry { folds: 3, mirror_rad: None };

fn tables(absorbing: bool) -> Vec<FiberTable> {
    vec![
        table(1, OutlineSymmetry::CIRCLE, [3, 6, 1, 100], absorbing),
        table(2, ELLIPSE, [4, 5, 7, 90], absorbing),
        table(3, KIDNEY, [1, 4, 9, 37], absorbing),
        table(4, SWIRL, [2, 3, 5, 120], absorbing),
        table(5, OutlineSymmetry::NONE, [2, 2, 12, 16], absorbing),
        table(6, OutlineSymmetry::CIRCLE, [1, 1, 1, 2], absorbing),
    ]
}

fn anywhere(rng: &mut Pcg64Mcg) -> [f32; 3] {
    direction((2.0 * rng.random::<f32>() - 1.0).asin(), std::f32::consts::TAU * rng.random::<f32>())
}

/// Nodes and weights on an axis, from the format's text.
fn nodes(at: f64, count: usize) -> [(usize, f64); 2] {
    let at = at.clamp(0.0, (count - 1) as f64);
    let first = at.floor() as usize;
    [(first, 1.0 - (at - first as f64)), ((first + 1).min(count - 1), at - first as f64)]
}

/// Brute-force reference in f64: (width, albedo, f / M_0).
fn twin(t: &FiberTable, lambda: f64, theta: f64, phi_i: f64, phi_o: f64) -> (f64, f64, f64) {
    let (nl, nt, np, d) = (t.lambda_um.len(), t.theta_i.len(), t.phi_i.len(), t.phi_r_count());
    let step = if nl > 1 { t.lambda_um[1] - t.lambda_um[0] } else { 1.0 };
    let (mut relative, mut flip) = (phi_o - phi_i, false);
    let azimuths: [(usize, f64); 2] = match (t.symmetry.folds, t.symmetry.mirror_rad) {
        (0, _) => [(0, 1.0), (0, 0.0)],
        (n, Some(mirror)) => {
            let turn = TAU / f64::from(n);
            let mut x = (phi_i - mirror).rem_euclid(turn);
            if x > turn / 2.0 {
                (x, flip) = (turn - x, true);
            }
            nodes(x / (turn / 2.0) * (np - 1) as f64, np)
        }
        (n, None) => {
            let at = phi_i.rem_euclid(TAU / f64::from(n)) / (TAU / f64::from(n)) * np as f64;
            let (k, f) = (at.floor() as usize % np, at.fract());
            [(k, 1.0 - f), ((k + 1) % np, f)]
        }
    };
    if flip {
        relative = -relative;
    }
    let at = relative.rem_euclid(TAU) / TAU * d as f64;
    let (j, f) = (at.floor() as usize % d, at.fract());
    let (mut width, mut power, mut scattered) = (0.0, 0.0, 0.0);
    for (a, wa) in nodes((lambda - t.lambda_um[0]) / step, nl) {
        for (b, wb) in nodes(theta.abs() / FRAC_PI_2 * nt as f64 - 0.5, nt) {
            for (c, wc) in azimuths {
                let s = (a * nt + b) * np + c;
                let share = wa * wb * wc * t.c_x_um[s].min(6.0 * t.width_um[c]);
                width += share;
                let n = |j: usize| f64::from(t.azimuthal[s * d + j % d]);
                power += share * ((1.0 - f) * n(j) + f * n(j + 1));
                scattered += share * t.slice_albedo(s);
            }
        }
    }
    (width, scattered / width, power / width)
}

#[test]
fn interpolation_matches_its_reference() {
    for t in tables(true) {
        let fiber = TabulatedFiber::from_table(t.clone()).unwrap();
        let round = TabulatedFiber::from_table(FiberTable {
            symmetry: OutlineSymmetry::CIRCLE,
            phi_i: vec![0.0],
            lambda_um: vec![0.5],
            theta_i: FiberTable::theta_nodes(1),
            width_um: vec![1.0],
            c_x_um: vec![1.0],
            c_abs_um: vec![0.0],
            azimuthal: vec![1.0 / std::f32::consts::TAU; 2],
            ..t.clone()
        })
        .unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(9);
        for _ in 0..2000 {
            let lambda = 0.36 + 0.46 * rng.random::<f64>();
            let (theta, phi_i) = ((2.0 * rng.random::<f64>() - 1.0) * 1.57, TAU * (rng.random::<f64>() * 3.0 - 1.0));
            let (theta_o, phi_o) = (-theta + 0.1 * (rng.random::<f64>() - 0.5), TAU * rng.random::<f64>());
            let theta_o = theta_o.clamp(-1.57, 1.57);
            let (wi, wo) = (direction(theta as f32, phi_i as f32), direction(theta_o as f32, phi_o as f32));
            let (width, albedo, n) = twin(&t, lambda, theta, phi_i, phi_o);
            let at = format!("{:?} lambda {lambda}, theta {theta}, phi {phi_i} to {phi_o}", t.symmetry);
            let query = FiberQuery::new(wi, [lambda as f32]);
            let bsdf = fiber.at(&query);
            let got = f64::from(bsdf.width_um()[0]);
            assert!((got / width - 1.0).abs() < 1e-4, "{at}: width {got}, want {width}");
            let got = f64::from(bsdf.albedo()[0]);
            assert!((got - albedo).abs() < 1e-4, "{at}: albedo {got}, want {albedo}");
            // The uniform fiber has M_0 / (2 pi).
            let m0 = f64::from(round.at(&FiberQuery::new(wi, [0.5])).eval(wo)[0]) * TAU;
            let got = f64::from(bsdf.eval(wo)[0]) / m0;
            // An azimuth in f32 is known to 1e-6 of a turn, the random function jumps from node to node.
            assert!((got - n).abs() < 2e-3, "{at}: N {got}, want {n}");
            let pdf = f64::from(bsdf.pdf(wo)) / m0 * albedo;
            assert!((pdf - n).abs() < 2e-3, "{at}: pdf {pdf}, want {n}");
        }
    }
}

#[test]
#[ignore = "slow: 5 s: furnace, samples and chi-square of fibers"]
fn furnace_sampling_and_chi_square() {
    let mut rng = Pcg64Mcg::seed_from_u64(21);
    let threshold = threshold_of(0.01, 6 * 2 * 2 * 4);
    let mut least = 1.0f64;
    for absorbing in [false, true] {
        for t in tables(absorbing) {
            for beta_m in [0.05, 0.4] {
                let fiber = TabulatedFiber::from_table(t.clone()).unwrap().with_beta_m(beta_m);
                for theta in [0.0, 0.9, -1.3, 1.57] {
                    let wi = direction(theta, std::f32::consts::TAU * rng.random::<f32>());
                    let lambda = 0.36 + 0.44 * rng.random::<f32>();
                    let at = fiber.at(&FiberQuery::new(wi, [lambda]));
                    // Kinks stand at the nodes: panels of a sixth of their distance.
                    let sd = [f64::from(beta_m), TAU / t.phi_r_count() as f64 / 9.0];
                    let r = check_bsdf(&at, sd, 20_000, &mut || rng.random());
                    let what = format!("{:?} beta {beta_m} theta {theta}: {r:?}", t.symmetry);
                    assert!(r.furnace_error < FURNACE_TOLERANCE && r.pdf_error < FURNACE_TOLERANCE, "{what}");
                    assert!(r.weight_error < WEIGHT_TOLERANCE, "{what}");
                    assert!(r.sampled_furnace_se < SAMPLED_TOLERANCE_SE, "{what}");
                    assert!(r.chi2_p > threshold, "{what}, threshold {threshold}");
                    let [albedo] = at.albedo();
                    if absorbing {
                        assert!(albedo < 0.999, "{what}");
                    } else {
                        assert!((albedo - 1.0).abs() < 1e-5, "{what}: a lossless fiber scatters {albedo}");
                    }
                    least = least.min(r.chi2_p);
                }
            }
        }
    }
    println!("least p {least}, threshold {threshold}");
}

fn threshold_of(significance: f64, tests: usize) -> f64 {
    plywave_check::chi2::threshold(significance, tests)
}

/// Light from a mirrored or turned direction scatters into mirrored or turned ones; -theta_i is theta_i seen
/// from the other end.
#[test]
fn symmetry_of_the_outline_holds() {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    for t in tables(true) {
        let fiber = TabulatedFiber::from_table(t.clone()).unwrap();
        for _ in 0..500 {
            let (wi, wo) = (anywhere(&mut rng), anywhere(&mut rng));
            let [want] = fiber.at(&FiberQuery::new(wi, [0.5])).eval(wo);
            let same = |wi, wo, what: &str| {
                let [got] = fiber.at(&FiberQuery::new(wi, [0.5])).eval(wo);
                assert!((got - want).abs() < 1e-3 * (1.0 + want), "{:?} {what}: {got}, want {want}", t.symmetry);
            };
            let other_end = |w: [f32; 3]| [w[0], w[1], -w[2]];
            same(other_end(wi), other_end(wo), "other end");
            let turn = if t.symmetry.folds == 0 { 1.234 } else { std::f32::consts::TAU / t.symmetry.folds as f32 };
            let (s, c) = turn.sin_cos();
            let turned = |w: [f32; 3]| [c * w[0] - s * w[1], s * w[0] + c * w[1], w[2]];
            same(turned(wi), turned(wo), "turned");
            if let Some(mirror) = t.symmetry.mirror_rad {
                let (s, c) = (2.0 * mirror as f32).sin_cos();
                let mirrored = |w: [f32; 3]| [c * w[0] + s * w[1], s * w[0] - c * w[1], w[2]];
                same(mirrored(wi), mirrored(wo), "mirrored");
            }
        }
    }
}

#[test]
fn widths_limit_hits() {
    let mut rng = Pcg64Mcg::seed_from_u64(6);
    let mut clamped = 0;
    for t in tables(false) {
        let fiber = TabulatedFiber::from_table(t.clone()).unwrap();
        clamped += usize::from(fiber.clamped_share() > 0.0);
        let most = t.c_x_um.iter().zip(t.width_um.iter().cycle()).map(|(c, w)| c.min(6.0 * w)).fold(0.0, f64::max);
        assert!((f64::from(fiber.max_width_um()) / most - 1.0).abs() < 1e-6);
        for _ in 0..200 {
            let (wi, lambda) = (anywhere(&mut rng), 0.3 + rng.random::<f32>());
            let at = fiber.at(&FiberQuery::new(wi, [lambda]));
            let [width] = at.width_um();
            assert!(width > 0.0 && width <= fiber.max_width_um() * 1.000_01, "{width} of {}", fiber.max_width_um());
            assert!(at.hit(0.4999 * width)[0] && at.hit(-0.4999 * width)[0]);
            assert!(!at.hit(0.5001 * width)[0] && !at.hit(f32::NAN)[0]);
        }
    }
    assert!(clamped >= 3, "the made-up widths go beyond six times the geometric ones");
}

#[test]
fn any_input_gives_finite_numbers() {
    let odd = [0.0, -0.0, 1.0, -1.0, 1e-30, 1e30, f32::MAX, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.999_999_94];
    for t in tables(true) {
        for beta in [0.0, 1e-3, f32::INFINITY] {
            let fiber = TabulatedFiber::from_table(t.clone()).unwrap().with_beta_m(beta);
            for a in odd {
                for b in odd {
                    for lambda in [0.5, a] {
                        let (wi, wo) = ([a, b, 0.3], [0.1, a, b]);
                        let at = fiber.at(&FiberQuery::new(wi, [lambda]));
                        let f = [at.eval(wo)[0], at.pdf(wo), at.albedo()[0]];
                        assert!(f.iter().all(|f| f.is_finite() && *f >= 0.0), "{wi:?} {wo:?}: {f:?}");
                        assert!(at.width_um()[0] >= 0.0);
                        if let Some(s) = at.sample([a, b, 0.5]).direction() {
                            assert!(s.pdf >= 0.0 && s.weight[0].is_finite(), "{s:?}");
                        }
                    }
                }
            }
            // Along the fiber there is no azimuth: the sampler and the density agree on one.
            let at = fiber.at(&FiberQuery::new([0.0, 0.0, 1.0], [0.5]));
            let BsdfSample::Scattered(s) = at.sample([0.3, 0.5, 0.2]) else { panic!("light is scattered") };
            let pdf = at.pdf(s.w);
            assert!(s.w.iter().all(|v| v.is_finite()) && pdf == s.pdf, "{s:?} {pdf}");
        }
    }
}

#[test]
fn files_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    for t in tables(true) {
        let path = dir.path().join("f.pwf");
        t.save(&path).unwrap();
        assert_eq!(file_kind(&path).unwrap(), FileKind::Fiber);
        assert_eq!(FiberTable::load(&path).unwrap(), t);
        assert_eq!(TabulatedFiber::load(&path).unwrap().table(), &t);
        assert_eq!(t.to_bytes().unwrap(), std::fs::read(&path).unwrap());
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "a temporary file was left");
}

#[test]
fn tables_that_break_a_rule_are_refused() {
    let good = table(2, ELLIPSE, [4, 5, 7, 90], true);
    good.to_bytes().unwrap();
    type Change = fn(&mut FiberTable);
    let changes: &[(&str, Change)] = &[
        ("azimuthal[0]", |t| t.azimuthal[0] = -1.0),
        ("azimuthal[3]", |t| t.azimuthal[3] = f32::NAN),
        ("azimuthal[0, 0, 0]", |t| t.azimuthal[5] += 10.0),
        ("azimuthal[3, 4, 6]", |t| t.c_abs_um[139] += 2.0),
        ("azimuthal[0, 1, 2]", |t| {
            let c = t.c_x_um[9];
            t.azimuthal[9 * 90..10 * 90].iter_mut().for_each(|v| *v = 1.1 / std::f32::consts::TAU);
            t.c_abs_um[9] = -0.1 * c;
        }),
        ("azimuthal", |t| {
            t.azimuthal.pop();
        }),
        ("azimuthal", |t| t.azimuthal.clear()),
        ("c_x_um[2]", |t| t.c_x_um[2] = 0.0),
        ("c_x_um", |t| {
            t.c_x_um.pop();
        }),
        ("c_abs_um[2]", |t| t.c_abs_um[2] = f64::INFINITY),
        ("width_um[1]", |t| t.width_um[1] = f64::NAN),
        ("width_um", |t| {
            t.width_um.pop();
        }),
        ("lambda_um[2]", |t| t.lambda_um[2] = 0.1),
        ("lambda_um[2]", |t| t.lambda_um[2] += 0.01),
        ("lambda_um", |t| t.lambda_um.clear()),
        ("theta_i[1]", |t| t.theta_i[1] += 1e-6),
        ("phi_i[1]", |t| t.phi_i[1] = f64::NAN),
        ("phi_i[1]", |t| t.symmetry.folds = 3),
        ("phi_i", |t| t.symmetry.folds = 0),
        ("symmetry.folds", |t| t.symmetry.folds = 100_000),
        ("symmetry.mirror_rad", |t| t.symmetry.mirror_rad = Some(-4.0)),
        ("beta_m_rad", |t| t.beta_m = 0.0),
        ("beta_m_rad", |t| t.beta_m = f64::NAN),
    ];
    for (key, change) in changes {
        let mut t = good.clone();
        change(&mut t);
        let error = t.to_bytes().map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(key) && error.lines().count() == 1, "{key}: {error}");
        assert!(TabulatedFiber::from_table(t).is_err());
    }
}

fn good_bytes() -> &'static [u8] {
    static BYTES: std::sync::OnceLock<Vec<u8>> = std::sync::OnceLock::new();
    BYTES.get_or_init(|| table(3, KIDNEY, [2, 2, 3, 8], true).to_bytes().unwrap())
}

proptest! {
    /// Any changed file loads to a table that can be evaluated, or fails with one line.
    #[test]
    fn damaged_files_never_panic(at in 0usize..4000, value: u8, cut in 0usize..5000) {
        let mut bytes = good_bytes().to_vec();
        let n = bytes.len();
        bytes[at % n] = value;
        bytes.truncate(n.min(cut.max(n / 2)));
        match TabulatedFiber::from_bytes(&bytes, "some.pwf") {
            Ok(fiber) => {
                let [f] = fiber.at(&FiberQuery::new([0.6, 0.0, 0.8], [0.5])).eval([0.0, 1.0, 0.0]);
                prop_assert!(f.is_finite() && f >= 0.0);
            }
            Err(error) => {
                let error = error.to_string();
                prop_assert!(error.starts_with("some.pwf: ") && error.lines().count() == 1, "{}", error);
            }
        }
    }
}
