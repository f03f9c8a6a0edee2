//! The whole ply model. Chain of trust: `tests/it/model.rs` compares the core's terms with their reference;
//! here the edge lobe is compared with `asg::Lobe`, and the checks of every `Bsdf` test the consistency of
//! energy, density and samples.

use crate::synthetic::{STANDARD, Sizes, model};
use plywave::Document;
use plywave::bsdf::Outcomes;
use plywave::frame::direction;
use plywave::gap::Slit;
use plywave::ply::asg::Lobe;
use plywave::ply::{EdgeLobes, PlyData, beam_mu};
use plywave::spec::GaussianBeam;
use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use plywave_check::check_bsdf;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const LAMBDA: [f32; 4] = [0.41, 0.5, 0.6, 0.72];
const RADIUS: f64 = 110.0;
const BEAM: GaussianBeam = GaussianBeam { w0_um: 5.0, lambda_um: 0.55, d_cut_um: 10.0 };

/// Edge lobes like those of a beam of waist 5 um: across the ply wider the more of the beam is cut.
fn edge_lobes() -> EdgeLobes {
    let lambda_um: Vec<f64> = (0..5).map(|i| 0.4 + 0.08 * f64::from(i)).collect();
    let inside_um: Vec<f64> = (0..9).map(|i| -20.0 + 5.0 * f64::from(i)).collect();
    let ln_mu = lambda_um
        .iter()
        .flat_map(|l| {
            inside_um.iter().flat_map(move |e| [beam_mu(5.0, *l).ln() - 0.15 * (e + 20.0), beam_mu(5.0, *l).ln()])
        })
        .collect();
    EdgeLobes { radius_um: RADIUS, lambda_um, inside_um, ln_mu }
}

fn planted(seed: u64, sizes: Sizes) -> PlyData {
    PlyData { edge: Some(edge_lobes()), ..model(seed, sizes) }
}

fn anywhere(rng: &mut Pcg64Mcg) -> [f32; 3] {
    direction((2.0 * rng.random::<f32>() - 1.0).asin(), std::f32::consts::TAU * rng.random::<f32>())
}

#[test]
fn edge_term_is_its_lobe_and_the_rest_is_the_core() {
    let lobes = edge_lobes();
    let m = PlyModel::from_data(planted(1, STANDARD)).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    for _ in 0..300 {
        let (theta_i, h) = (2.8 * (rng.random::<f32>() - 0.5), 300.0 * (rng.random::<f32>() - 0.5));
        let sigma = [0.0, 0.002, 0.02 * rng.random::<f32>(), 0.3];
        let r_d = f64::from(m.at(&PlyQuery::lobes(theta_i, h, [0.0])).r_d());
        let wanted: [Lobe; 4] = LAMBDA.map(|l| Lobe { energy: r_d, ..lobes.lobe(theta_i.into(), h.into(), l.into()) });
        for _ in 0..20 {
            // Near the forward direction, where the lobe is.
            let d: [f32; 2] = [0.2 * (rng.random::<f32>() - 0.5), 0.1 * (rng.random::<f32>() - 0.5)];
            let wo = direction((d[1] - theta_i).clamp(-1.57, 1.57), 1.5 * std::f32::consts::PI + d[0]);
            let t = m.at(&PlyQuery::new(theta_i, h, sigma, LAMBDA)).terms(wo);
            let core = m.at(&PlyQuery { cached: false, ..PlyQuery::lobes(theta_i, h, sigma) }).terms(wo);
            let (refl, high) = (core.refl, core.high);
            let peak = high.iter().fold(refl, |a, b| a.max(*b));
            assert!((t.refl - refl).abs() <= 1e-5 * peak);
            for k in 0..4 {
                assert!((t.high[k] - high[k]).abs() <= 1e-5 * peak, "{} {}", t.high[k], high[k]);
                let (got, want) = (f64::from(t.edge[k]), wanted[k].eval(wo.map(f64::from)));
                let top = wanted[k].eval([0.0, -f64::from(theta_i).cos(), -f64::from(theta_i).sin()]);
                assert!((got - want).abs() <= 3e-4 * top, "edge at {theta_i} {h}: got {got}, want {want}, peak {top}");
            }
        }
    }
}

/// Center, both rims, partial hits from outside, beams that miss, grazing light.
#[test]
fn every_check_of_a_bsdf_passes() {
    let m = PlyModel::from_data(planted(3, STANDARD)).unwrap();
    let small = PlyModel::from_data(planted(4, Sizes { theta: 5, h: 3, refl: 11, high: 13, paths: 3 })).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let sd = 1.0 / (2.0 * beam_mu(5.0, 0.41)).sqrt();
    for (model, theta_i, h) in [
        (&m, 0.0, 0.0),
        (&m, 0.3, 100.0),
        (&m, -0.8, -112.0),
        (&m, 1.2, 125.0),
        (&m, 0.5, 135.0),
        (&small, -0.4, 118.0),
        (&m, -0.2, -400.0),
    ] {
        let s = model.at(&PlyQuery::new(theta_i, h, [0.0, 0.003, 0.02, 0.1], LAMBDA));
        let albedo = s.albedo();
        assert!((albedo[0] - 1.0).abs() < 1e-4, "energy at sigma = 0, theta_i {theta_i}, h {h}: {albedo:?}");
        assert_eq!((s.outcomes(), s.straight()), (Outcomes::SCATTERED, [0.0; 4]));
        let r = check_bsdf(&s, [sd, sd / f64::from(theta_i.cos())], 20_000, &mut || rng.random());
        println!("{theta_i} {h}: {r:?}");
        assert!(r.furnace_error < 1e-3 && r.pdf_error < 1e-3, "{theta_i} {h}: {r:?}");
        assert!(r.weight_error < 1e-4 && r.sampled_furnace_se < 5.0 && r.chi2_p > 1e-3, "{theta_i} {h}: {r:?}");
    }
}

#[test]
fn without_edge_lobes_missed_light_goes_on() {
    let m = PlyModel::from_data(model(6, STANDARD)).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    let mut straight = 0;
    for _ in 0..200 {
        let (theta_i, h_um) = (2.8 * (rng.random::<f32>() - 0.5), 280.0 * (rng.random::<f32>() - 0.5));
        let sigma_per_um = [0.0, 0.01];
        let core = m.at(&PlyQuery::lobes(theta_i, h_um, sigma_per_um));
        let whole = m.at(&PlyQuery::new(theta_i, h_um, sigma_per_um, [0.5, 0.6]));
        let (u, wo) = (rng.random(), anywhere(&mut rng));
        let near = |a: f32, b: f32| (a - b).abs() <= 1e-5 * a.abs().max(1.0);
        assert!(near(core.eval(wo)[1], whole.eval(wo)[1]) && near(core.pdf(wo), whole.pdf(wo)));
        assert_eq!((core.albedo(), core.outcomes()), (whole.albedo(), whole.outcomes()));
        assert_eq!(core.straight(), [whole.r_d(); 2]);
        match (core.sample(u), whole.sample(u)) {
            (BsdfSample::Scattered(a), BsdfSample::Scattered(b)) => assert_eq!(a.w, b.w),
            (BsdfSample::Straight { weight, probability }, other) => {
                assert_eq!(BsdfSample::Straight { weight, probability }, other);
                assert!(weight.iter().all(|w| near(w * probability, core.r_d())));
                straight += 1;
            }
            (a, b) => panic!("{a:?} {b:?}"),
        }
    }
    assert!(straight > 5, "{straight} went straight on");
}

#[test]
fn file_keeps_edge_lobes_and_refuses_bad_ones() {
    let data = planted(8, STANDARD);
    let read = PlyData::from_bytes(&data.to_bytes().unwrap(), "m").unwrap();
    let (got, want) = (read.edge.unwrap(), edge_lobes());
    assert_eq!((got.radius_um, &got.lambda_um, &got.inside_um), (want.radius_um, &want.lambda_um, &want.inside_um));
    assert!(got.ln_mu.iter().zip(&want.ln_mu).all(|(a, b)| (a - b).abs() < 1e-6));
    type Spoil = (&'static str, fn(&mut EdgeLobes));
    let bad: [Spoil; 6] = [
        ("edge_radius_um", |e| e.radius_um = f64::NAN),
        ("edge_lambda_um", |e| e.lambda_um[2] += 0.01),
        ("edge_lambda_um", |e| e.lambda_um.truncate(1)),
        ("edge_inside_um", |e| e.inside_um.reverse()),
        ("edge_ln_mu", |e| e.ln_mu[5] = 40.0),
        ("edge_ln_mu", |e| e.ln_mu.truncate(7)),
    ];
    for (key, spoil) in bad {
        let mut edge = edge_lobes();
        spoil(&mut edge);
        let error = PlyModel::from_data(PlyData { edge: Some(edge), ..data.clone() }).unwrap_err().to_string();
        assert!(error.contains(key) && !error.contains('\n'), "{error}");
    }
}

#[test]
fn any_input_gives_finite_numbers() {
    let m = PlyModel::from_data(planted(9, STANDARD)).unwrap();
    let odd = [0.0, -1.0, 1.0, 0.3, 50.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, f32::MIN_POSITIVE];
    let mut rng = Pcg64Mcg::seed_from_u64(10);
    let mut any = || odd[rng.random_range(0..odd.len())];
    let slit = Slit::new(2.0, 0.25, &BEAM).unwrap();
    for i in 0..5000 {
        let query = PlyQuery::new(any(), any(), [any(), any()], [any(), any()]);
        let below = m.layer(any(), [any(), any()]);
        let s = m.at(&PlyQuery {
            slit: if i % 2 == 0 { Some(&slit) } else { None },
            below: if i % 3 == 0 { below } else { None },
            cached: i % 5 != 0,
            edge: i % 7 != 0,
            ..query
        });
        let wo = [any(), any(), any()];
        let numbers = s.eval(wo).into_iter().chain(s.albedo()).chain([s.pdf(wo), s.outcomes().scattered]);
        numbers.for_each(|v| assert!(v.is_finite() && v >= 0.0, "{v}: {query:?} {wo:?}"));
        let sample = s.sample([any(), any(), any()]);
        let numbers: Vec<f32> = match sample {
            BsdfSample::Scattered(x) => x.w.into_iter().chain(x.weight).chain([x.pdf]).collect(),
            BsdfSample::Straight { weight, probability } => weight.into_iter().chain([probability]).collect(),
            BsdfSample::Absorbed => Vec::new(),
        };
        assert!(numbers.iter().all(|v| v.is_finite()), "{sample:?} {query:?}");
    }
}

/// A slit moves light without loss, at any absorption; it removes light from f_high alone.
#[test]
fn slits_keep_the_energy() {
    let m = PlyModel::from_data(planted(11, STANDARD)).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(12);
    for (width, share, theta_i, h_um) in [(1.0, 0.25, 0.0, 10.0), (4.0, 1.0, 0.6, -60.0), (2.0, 0.25, -1.1, 112.0)] {
        let slit = Slit::new(width, share, &BEAM).unwrap();
        let query = PlyQuery::new(theta_i, h_um, [0.0, 0.03], [0.45, 0.65]);
        let (without, with) = (m.at(&query), m.at(&PlyQuery { slit: Some(&slit), ..query }));
        assert_eq!(with.albedo(), without.albedo());
        let r = check_bsdf(&with, [0.008, 0.012], 20_000, &mut || rng.random());
        println!("slit {width} share {share} at {theta_i} {h_um}: {r:?}");
        assert!(r.furnace_error < 1e-3 && r.pdf_error < 1e-3, "{r:?}");
        assert!(r.weight_error < 1e-4 && r.sampled_furnace_se < 5.0 && r.chi2_p > 1e-3, "{r:?}");
        for _ in 0..200 {
            let wo = anywhere(&mut rng);
            let (a, b) = (with.terms(wo), without.terms(wo));
            assert!((a.refl - b.refl).abs() <= 1e-5 * b.refl && a.edge == b.edge);
            assert!((0..2).all(|k| a.high[k] <= b.high[k] * (1.0 + 1e-5)), "{a:?} {b:?}");
        }
        let forward = [0.0, -theta_i.cos(), -theta_i.sin()];
        assert!(with.terms(forward).slit[0] > 0.0);
    }
    for (width, share, key) in
        [(0.0, 0.2, "width_um"), (6.0, 0.2, "width_um"), (1.0, 1.2, "share"), (1.0, f32::NAN, "share")]
    {
        assert!(Slit::new(width, share, &BEAM).unwrap_err().to_string().contains(key));
    }
}
