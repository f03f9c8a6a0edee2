//! Models of cones. Chain of trust: `cone::ConeLobe` is tested against brute-force integrals in its own file;
//! the reference implementation sums such lobes in f64. Here the kernels are compared with it; then furnace,
//! sampling, files, slits, mirrored incidences.

use crate::synthetic::{STANDARD, Sizes, cone_model, model};
use plywave::Document;
use plywave::frame::direction;
use plywave::gap::{SLIT_SHARE, Slit};
use plywave::ply::{LobeKind, PlyData, Queries};
use plywave::spec::GaussianBeam;
use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use plywave_check::reference::Mixture;
use plywave_check::{CheckOptions, check_model};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// More lobes and path lengths than the fast kernels hold.
const LARGE: Sizes = Sizes { theta: 5, h: 9, refl: 5, high: 13, paths: 11 };

fn incidence(rng: &mut Pcg64Mcg) -> (f32, f32) {
    (3.0 * (rng.random::<f32>() - 0.5), 260.0 * (rng.random::<f32>() - 0.5))
}

/// Near the cone of an incidence, where the light is, half of the time.
fn toward(rng: &mut Pcg64Mcg, theta_i: f32) -> [f32; 3] {
    let theta = if rng.random::<bool>() {
        0.3 * (rng.random::<f32>() - 0.5) - theta_i
    } else {
        3.1 * (rng.random::<f32>() - 0.5)
    };
    direction(theta, std::f32::consts::TAU * rng.random::<f32>())
}

#[test]
fn kernels_match_the_reference_implementation() {
    for (seed, sizes, sharp) in [(1, STANDARD, 0.0), (2, LARGE, 2.0), (3, STANDARD, 5.0)] {
        let data = cone_model(seed, sizes, sharp);
        let m = PlyModel::from_data(data.clone()).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        for _ in 0..300 {
            let (theta_i, h) = incidence(&mut rng);
            let sigma = [0.0, 0.002, 0.02 * rng.random::<f32>(), 0.3];
            let reference = Mixture::new(&data, theta_i.into(), h.into(), &sigma.map(f64::from)).unwrap();
            let query = PlyQuery::lobes(theta_i, h, sigma);
            let ways = [m.at(&query), m.at(&PlyQuery { cached: false, ..query })];
            let (mut peak, mut error, mut pdf_peak, mut pdf_error) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
            for _ in 0..60 {
                let wo = toward(&mut rng, theta_i);
                let (want_refl, want_high) = reference.eval_split(wo.map(f64::from));
                let want_pdf = reference.pdf(wo.map(f64::from));
                pdf_peak = pdf_peak.max(want_pdf);
                for at in &ways {
                    let (terms, both) = (at.terms(wo), at.eval(wo));
                    error = error.max((f64::from(terms.refl) - want_refl).abs());
                    for k in 0..4 {
                        peak = peak.max(want_refl + want_high[k]);
                        error = error.max((f64::from(both[k]) - want_refl - want_high[k]).abs());
                    }
                    pdf_error = pdf_error.max((f64::from(at.pdf(wo)) - want_pdf).abs());
                    pdf_error = pdf_error.max((f64::from(at.eval_pdf(wo).1) - want_pdf).abs());
                }
            }
            // A ring 0.001 rad wide magnifies the f32 rounding of a latitude near the pole.
            assert!(error <= 1e-3 * peak, "eval at {theta_i} {h}: error {error}, peak {peak}");
            assert!(pdf_error <= 1e-3 * pdf_peak, "pdf at {theta_i} {h}: error {pdf_error}, peak {pdf_peak}");
        }
    }
}

#[test]
fn furnace_sampling_and_chi_square() {
    for (seed, sizes, sharp, incidences) in [(4, STANDARD, 0.0, 40), (5, LARGE, 1.0, 8), (6, STANDARD, 3.0, 10)] {
        let m = PlyModel::from_data(cone_model(seed, sizes, sharp)).unwrap();
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

/// Half way between nodes a narrow ring has the physical position, which interpolated latitudes of round
/// lobes miss near the pole.
#[test]
fn rings_between_nodes_stay_on_the_cone() {
    let mut data = cone_model(7, STANDARD, 20.0);
    for p in data.refl.chunks_exact_mut(6).chain(data.high.chunks_exact_mut(6)) {
        (p[0], p[2], p[4]) = (0.0, 0.0, 13.0);
    }
    let m = PlyModel::from_data(data).unwrap();
    for theta_i in [0.0f32, 0.09, -0.26, 0.8, -1.3, 1.39, 1.5] {
        let at = m.at(&PlyQuery::lobes(theta_i, 11.0, [0.0]));
        let on = at.eval(direction(-theta_i, 1.0))[0];
        let off = at.eval(direction(-theta_i + 0.01, 1.0))[0].max(at.eval(direction(-theta_i - 0.01, 1.0))[0]);
        assert!(on > 1.0 && off < 1e-3 * on, "{theta_i}: {on} on the cone, {off} beside it");
    }
}

#[test]
fn batches_equal_single_calls_and_what_is_no_direction_is_dark() {
    let m = PlyModel::from_data(cone_model(8, STANDARD, 2.0)).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(8);
    let n = 100;
    let (theta_i, h_um): (Vec<f32>, Vec<f32>) = (0..n).map(|_| incidence(&mut rng)).unzip();
    let sigma: Vec<[f32; 3]> = (0..n).map(|_| rng.random::<[f32; 3]>()).collect();
    let wo: Vec<[f32; 3]> = theta_i.iter().map(|t| toward(&mut rng, *t)).collect();
    let [x, y, z] = [0, 1, 2].map(|c| wo.iter().map(|w| w[c]).collect::<Vec<f32>>());
    let mut f = vec![[9.0; 3]; n];
    let one = [vec![theta_i[0]; n], vec![h_um[0]; n]];
    for (theta_i, h_um) in [(&theta_i, &h_um), (&one[0], &one[1])] {
        m.eval_batch(&Queries { theta_i, h_um, sigma_per_um: &sigma, wo: [&x, &y, &z[..n - 1]] }, &mut f);
        for i in 0..n - 1 {
            let query = PlyQuery { cached: false, ..PlyQuery::lobes(theta_i[i], h_um[i], sigma[i]) };
            assert_eq!(f[i], m.at(&query).eval(wo[i]));
        }
        assert_eq!(f[n - 1], [0.0; 3]);
    }
    for at in [PlyQuery::lobes(0.3, 5.0, [0.0]), PlyQuery { cached: false, ..PlyQuery::lobes(0.3, 5.0, [0.0]) }] {
        for wo in [[f32::NAN; 3], [f32::INFINITY; 3], [9.0, 0.0, 0.0], [0.0; 3], [1e30; 3]] {
            assert_eq!(m.at(&at).eval_pdf(wo), ([0.0], 0.0), "{wo:?}");
        }
        for wo in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]] {
            let (f, pdf) = m.at(&at).eval_pdf(wo);
            assert!(f[0].is_finite() && f[0] >= 0.0 && pdf.is_finite() && pdf >= 0.0, "{wo:?}");
        }
        for u in [[0.0; 3], [1.0; 3], [f32::NAN; 3], [0.3, 0.0, 1.0]] {
            if let BsdfSample::Scattered(s) = m.at(&at).sample(u) {
                assert!(s.w.iter().all(|x| x.is_finite()) && s.pdf > 0.0, "{s:?}");
            }
        }
    }
}

/// Light of a slit leaves the lobes and returns in its own term: all terms together keep the energy.
#[test]
fn slits_take_from_cones_what_they_diffract() {
    let m = PlyModel::from_data(cone_model(9, STANDARD, 0.0)).unwrap();
    let slit = Slit::new(1.5, SLIT_SHARE, &GaussianBeam { w0_um: 10.0, lambda_um: 0.55, d_cut_um: 20.0 }).unwrap();
    let (theta_i, h) = (0.2, 7.0);
    let query = PlyQuery { slit: Some(&slit), edge: false, ..PlyQuery::new(theta_i, h, [0.0], [0.55]) };
    let (with, without) = (m.at(&query), m.at(&PlyQuery { slit: None, ..query }));
    let (mut sum, mut plain, mut taken, mut pdf) = (0.0, 0.0, 0.0, 0.0);
    let (rows, columns) = (600, 600);
    for i in 0..rows {
        let s = -1.0 + 2.0 * (i as f64 + 0.5) / f64::from(rows);
        for j in 0..columns {
            let phi = std::f64::consts::TAU * (f64::from(j) + 0.5) / f64::from(columns);
            let wo = direction(s.asin() as f32, phi as f32);
            let terms = with.terms(wo);
            sum += f64::from(terms.refl + terms.high[0] + terms.slit[0]);
            taken += f64::from(terms.slit[0]);
            pdf += f64::from(terms.pdf);
            plain += f64::from(without.eval(wo)[0]);
        }
    }
    let area = 2.0 * std::f64::consts::TAU / f64::from(rows * columns);
    let [sum, plain, taken, pdf] = [sum, plain, taken, pdf].map(|v| v * area);
    assert!((sum - plain).abs() < 2e-3, "{sum} with the slit, {plain} without");
    assert!(taken > 0.005, "the slit takes {taken}");
    let chance = f64::from(without.outcomes().scattered);
    assert!((pdf - chance).abs() < 5e-3, "density {pdf}, chance {chance}");
}

#[test]
fn files_of_cones_load_again_and_bad_ones_are_refused() {
    let data = cone_model(10, STANDARD, 2.0);
    let bytes = data.to_bytes().unwrap();
    let back = PlyData::from_bytes(&bytes, "cones").unwrap();
    assert_eq!(back.family, LobeKind::Cone);
    assert_eq!(back.to_bytes().unwrap(), bytes);
    let m = PlyModel::from_bytes(&bytes, "cones").unwrap();
    assert!(!m.reference_values().is_empty() && m.reference_error() < 1e-5);
    // Round lobes stay under their old names, so that earlier readers load them and refuse cones by the name
    // of the tensor.
    let round = model(10, STANDARD).to_bytes().unwrap();
    let has = |bytes: &[u8], name: &str| String::from_utf8_lossy(&bytes[..20_000]).contains(&format!("\"{name}\""));
    assert!(has(&bytes, "cone_refl") && has(&bytes, "cone_high") && !has(&bytes, "refl") && !has(&bytes, "high"));
    assert!(has(&round, "refl") && has(&round, "high") && !has(&round, "cone_refl"));
    assert_eq!(PlyData::from_bytes(&round, "round").unwrap().family, LobeKind::Round);
    for (p, value, key) in [
        (0, 41.0, "offset"),
        (2, -50.0, "slope"),
        (4, 13.2, "ln_mu2"),
        (3, -9.0, "ln_mu1"),
        (1, 200.0, "phi_z"),
        (5, -0.1, "energy"),
    ] {
        let mut bad = data.clone();
        bad.high[6 + p] = value;
        let error = bad.to_bytes().unwrap_err().to_string();
        assert!(error.contains("cone_high lobe 1") && error.contains(key), "{error}");
    }
    // One name of a pair alone, and both pairs.
    let swap = |bytes: &[u8], from: &str, to: &str| {
        let n = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let head =
            String::from_utf8(bytes[8..8 + n].to_vec()).unwrap().replace(&format!("\"{from}\""), &format!("\"{to}\""));
        [&(head.len() as u64).to_le_bytes(), head.as_bytes(), &bytes[8 + n..]].concat()
    };
    for bad in [swap(&bytes, "cone_refl", "refl"), swap(&bytes, "cone_refl", "cone"), swap(&round, "high", "cone_high")]
    {
        let error = PlyData::from_bytes(&bad, "bad.pwm").unwrap_err().to_string();
        assert!(error.starts_with("bad.pwm") && !error.contains('\n'), "{error}");
    }
}
