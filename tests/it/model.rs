//! The runtime's evaluator. Chain of trust: `asg::Lobe` is tested against brute-force integrals in its own
//! file; the reference implementation `plywave_check::reference` uses it in f64 and tests the fast kernels
//! here; the furnace, sampling and symmetry tests then need no reference.

use crate::synthetic::{STANDARD, Sizes, model};
use plywave::frame::{direction, mirror_incidence};
use plywave::ply::Queries;
use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use plywave_check::reference::Mixture;
use plywave_check::{CheckOptions, check_incidence, check_model};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const LARGE: Sizes = Sizes { theta: 3, h: 5, refl: 11, high: 13, paths: 13 };
/// Between the two sizes that the fast kernels are compiled for.
const MORE: Sizes = Sizes { refl: 3, high: 11, ..STANDARD };
const SMALL: Sizes = Sizes { theta: 5, h: 3, refl: 1, high: 3, paths: 1 };

fn incidence(rng: &mut Pcg64Mcg) -> (f32, f32) {
    (3.0 * (rng.random::<f32>() - 0.5), 260.0 * (rng.random::<f32>() - 0.5))
}

fn anywhere(rng: &mut Pcg64Mcg) -> [f32; 3] {
    direction((2.0 * rng.random::<f32>() - 1.0).asin(), std::f32::consts::TAU * rng.random::<f32>())
}

#[test]
fn kernels_match_the_reference_implementation() {
    for (seed, sizes) in [(1, STANDARD), (2, LARGE), (3, SMALL), (1, MORE)] {
        let data = model(seed, sizes);
        let m = PlyModel::from_data(data.clone()).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        for _ in 0..300 {
            let (theta_i, h) = incidence(&mut rng);
            let sigma = [0.0, 0.002, 0.02 * rng.random::<f32>(), 0.3];
            let reference = Mixture::new(&data, theta_i.into(), h.into(), &sigma.map(f64::from)).unwrap();
            let (mut peak, mut error, mut pdf_peak, mut pdf_error) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
            let query = PlyQuery::lobes(theta_i, h, sigma);
            let ways = [m.at(&query), m.at(&PlyQuery { cached: false, ..query })];
            for _ in 0..60 {
                let wo = anywhere(&mut rng);
                let (want_refl, want_high) = reference.eval_split(wo.map(f64::from));
                for at in &ways {
                    let (terms, both) = (at.terms(wo), at.eval(wo));
                    error = error.max((f64::from(terms.refl) - want_refl).abs());
                    for k in 0..4 {
                        let want = want_refl + want_high[k];
                        peak = peak.max(want);
                        error = error.max((f64::from(both[k]) - want).abs());
                        error = error.max((f64::from(terms.high[k]) - want_high[k]).abs());
                    }
                }
                let want = reference.pdf(wo.map(f64::from));
                pdf_peak = pdf_peak.max(want);
                for at in &ways {
                    pdf_error = pdf_error.max((f64::from(at.pdf(wo)) - want).abs());
                }
            }
            assert!(error <= 1e-4 * peak, "eval at {theta_i} {h}: error {error}, peak {peak}");
            assert!(pdf_error <= 1e-4 * pdf_peak, "pdf at {theta_i} {h}: error {pdf_error}, peak {pdf_peak}");
        }
    }
}

#[test]
fn furnace_sampling_and_chi_square() {
    for (seed, sizes, incidences) in [(4, STANDARD, 40), (5, LARGE, 6), (6, SMALL, 6), (8, MORE, 20)] {
        let m = PlyModel::from_data(model(seed, sizes)).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let options = CheckOptions { incidences, ..CheckOptions::default() };
        let report = check_model(&m, &options, &mut || rng.random());
        let numbers = (
            report.furnace_error(),
            report.pdf_error(),
            report.weight_error(),
            report.sampled_furnace_se(),
            report.chi2_p(),
            report.chi2_threshold,
        );
        println!("furnace, pdf, weight, sampled [se], least p, threshold: {numbers:?}");
        assert!(report.passed(), "furnace, pdf, weight, sampled [se], least p, threshold: {numbers:?}");
    }
}

#[test]
fn batches_and_directions_equal_single_calls() {
    for (seed, sizes) in [(7, STANDARD), (8, LARGE)] {
        let m = PlyModel::from_data(model(seed, sizes)).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let n = 200;
        let q: Vec<(f32, f32)> = (0..n).map(|_| incidence(&mut rng)).collect();
        let (theta_i, h_um): (Vec<f32>, Vec<f32>) = q.into_iter().unzip();
        let sigma: Vec<[f32; 3]> = (0..n).map(|_| rng.random::<[f32; 3]>()).collect();
        let wo: Vec<[f32; 3]> = (0..n).map(|_| anywhere(&mut rng)).collect();
        let [x, y, z] = [0, 1, 2].map(|c| wo.iter().map(|w| w[c]).collect::<Vec<f32>>());
        let queries = Queries { theta_i: &theta_i, h_um: &h_um, sigma_per_um: &sigma, wo: [&x, &y, &z[..n - 1]] };
        let mut f = vec![[9.0; 3]; n];
        m.eval_batch(&queries, &mut f);
        for i in 0..n - 1 {
            let query = PlyQuery { cached: false, ..PlyQuery::lobes(theta_i[i], h_um[i], sigma[i]) };
            assert_eq!(f[i], m.at(&query).eval(wo[i]));
        }
        assert_eq!(f[n - 1], [0.0; 3]);
        let (theta_one, h_one, sigma_one) = (vec![-0.4; n], vec![11.0; n], vec![sigma[0]; n]);
        let one = Queries { theta_i: &theta_one, h_um: &h_one, sigma_per_um: &sigma_one, wo: [&x, &y, &z[..n - 1]] };
        m.eval_batch(&one, &mut f);
        for i in 0..n - 1 {
            assert_eq!(f[i], m.at(&PlyQuery { cached: false, ..PlyQuery::lobes(-0.4, 11.0, sigma[0]) }).eval(wo[i]));
        }
        assert_eq!(f[n - 1], [0.0; 3]);
        let mut pdf = vec![9.0; n];
        let at = m.at(&PlyQuery::lobes(0.4, 11.0, sigma[0]));
        at.eval_batch(&wo, &mut f, &mut pdf);
        for i in 0..n {
            let want = at.eval(wo[i]);
            for k in 0..3 {
                assert!((f[i][k] - want[k]).abs() <= 1e-6 * want[k].abs().max(1e-3), "{:?} {want:?}", f[i]);
            }
            let want = at.pdf(wo[i]);
            assert!((pdf[i] - want).abs() <= 1e-6 * want.max(1e-3), "pdf {} {want}", pdf[i]);
        }
    }
}

#[test]
fn albedo_falls_with_absorption_and_is_exact_at_nodes() {
    let data = model(9, STANDARD);
    let m = PlyModel::from_data(data.clone()).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(9);
    for _ in 0..500 {
        let (theta_i, h) = incidence(&mut rng);
        let sigma: [f32; 11] = std::array::from_fn(|i| 1e-4 * 2f32.powi(i as i32));
        let a = m.at(&PlyQuery::lobes(theta_i, h, sigma)).albedo();
        assert!(a.windows(2).all(|w| w[1] < w[0]), "{a:?}");
    }
    let nodes = data.node_energies();
    for i in 0..data.theta_i.len() {
        for j in 0..data.h_um.len() {
            let (t, h, at) = (data.theta_i[i] as f32, data.h_um[j] as f32, i * data.h_um.len() + j);
            let want = nodes[at].refl + nodes[at].high.iter().sum::<f64>();
            let [got] = m.at(&PlyQuery::lobes(t, h, [0.0])).albedo();
            assert!((f64::from(got) - want).abs() < 1e-5, "albedo at node {i} {j}: got {got}, want {want}");
            assert!((f64::from(m.at(&PlyQuery::lobes(t, h, [0.0])).r_d()) - nodes[at].r_d).abs() < 1e-5);
        }
    }
}

#[test]
fn eval_falls_with_absorption_where_the_lobes_carry_the_spectrum() {
    // At the corners of blocks the lobes' spectra add up to the simulated one, so the scale does not depend
    // on sigma.
    let m = PlyModel::from_data(model(10, STANDARD)).unwrap();
    let (theta, h) = (m.data().theta_i.clone(), m.data().h_um.clone());
    let mut rng = Pcg64Mcg::seed_from_u64(10);
    for i in (0..theta.len()).step_by(2) {
        for j in (0..h.len()).step_by(2) {
            let wo = anywhere(&mut rng);
            let f = m
                .at(&PlyQuery::lobes(theta[i] as f32, h[j] as f32, [0.0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3]))
                .eval(wo);
            assert!(f.windows(2).all(|w| w[1] <= w[0] * (1.0 + 1e-5)), "{f:?}");
        }
    }
}

#[test]
fn mirrored_incidence_mirrors_the_light() {
    let m = PlyModel::from_data(model(11, STANDARD)).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    for _ in 0..500 {
        let (theta_i, h) = incidence(&mut rng);
        let (sigma, wo) = ([0.0, 0.01, 0.1], anywhere(&mut rng));
        let back = mirror_incidence(wo);
        let there = m.at(&PlyQuery::lobes(theta_i, h, sigma));
        let back_there = m.at(&PlyQuery::lobes(-theta_i, -h, sigma));
        assert_eq!(there.eval(wo), back_there.eval(back));
        assert_eq!(there.pdf(wo), back_there.pdf(back));
        assert_eq!(there.albedo(), back_there.albedo());
        let u = rng.random();
        let (a, b) = (there.sample(u), back_there.sample(u));
        assert_eq!(a.direction().map(|s| mirror_incidence(s.w)), b.direction().map(|s| s.w));
    }
}

#[test]
fn lobes_without_energy_still_give_the_simulated_energy() {
    let mut data = model(12, STANDARD);
    data.refl.chunks_exact_mut(6).chain(data.high.chunks_exact_mut(6)).for_each(|p| p[5] = 0.0);
    for p in data.high_path.chunks_exact_mut(8) {
        p.copy_from_slice(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    }
    let m = PlyModel::from_data(data).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(12);
    for sigma in [0.0, 0.1, 10.0] {
        let r = check_incidence(&m, 0.3, 21.0, [sigma; 4], 2000, &mut || rng.random());
        assert!(r.furnace_error < 1e-3 && r.pdf_error < 1e-3 && r.chi2_p > 1e-4, "{r:?}");
    }
}

#[test]
fn any_input_gives_finite_numbers() {
    let odd = [0.0, -0.0, 1.0, -1.0, 1e-30, 1e30, f32::MAX, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    for (seed, sizes) in [(13, STANDARD), (14, LARGE)] {
        let m = PlyModel::from_data(model(seed, sizes)).unwrap();
        for theta_i in odd {
            for h in odd {
                for s in odd {
                    let sigma = [s, 0.01];
                    let query = PlyQuery::lobes(theta_i, h, sigma);
                    for at in [m.at(&query), m.at(&PlyQuery { cached: false, ..query })] {
                        assert!(at.albedo().iter().all(|a| (0.0..=1.06).contains(a)));
                        assert!((0.0..=1.0).contains(&at.r_d()));
                        for c in odd {
                            for wo in [[c, 0.0, 0.0], [0.0, c, 1.0], [0.6, 0.8, c]] {
                                let (f, pdf) = (at.eval(wo), at.pdf(wo));
                                assert!(f.iter().chain([&pdf]).all(|f| f.is_finite() && *f >= 0.0), "{f:?} {pdf}");
                            }
                            match at.sample([0.3 * s, c, c]) {
                                BsdfSample::Scattered(s) => {
                                    let n = s.w.iter().map(|v| v * v).sum::<f32>();
                                    assert!((n - 1.0).abs() < 1e-4 && s.pdf > 0.0 && s.pdf.is_finite(), "{s:?}");
                                    assert!(s.weight.iter().all(|w| w.is_finite() && *w >= 0.0), "{s:?}");
                                }
                                BsdfSample::Straight { weight, probability } => {
                                    assert!((0.0..=1.0).contains(&probability), "{probability}");
                                    assert!(weight.iter().all(|w| (0.0..=1.06).contains(w)), "{weight:?}");
                                }
                                BsdfSample::Absorbed => (),
                            }
                        }
                    }
                }
            }
        }
        let beyond = m.at(&PlyQuery::lobes(0.1, 131.0, [0.0]));
        assert_eq!(beyond.eval([0.0, 1.0, 0.0]), [0.0]);
        assert_eq!((beyond.r_d(), beyond.albedo(), beyond.straight()), (1.0, [0.0], [1.0]));
        assert_eq!(beyond.sample([0.0; 3]), BsdfSample::Straight { weight: [1.0], probability: 1.0 });
    }
}
