//! The runtime's evaluator. Chain of trust: `asg::Lobe` is tested against brute-force integrals in its own file; the slow twin
//! `plywave::reference` uses it in f64 and is the truth for the fast kernels here; the furnace, sampling and symmetry
//! tests then need no twin.

mod synthetic;

use plywave::{PlyModel, direction, reference::Mixture};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use synthetic::{STANDARD, Sizes, model};

const LARGE: Sizes = Sizes { theta: 3, h: 5, refl: 11, high: 21, paths: 13 };
const SMALL: Sizes = Sizes { theta: 5, h: 3, refl: 1, high: 3, paths: 1 };

fn incidence(rng: &mut Pcg64Mcg) -> (f32, f32) {
    (3.0 * (rng.random::<f32>() - 0.5), 260.0 * (rng.random::<f32>() - 0.5))
}

fn anywhere(rng: &mut Pcg64Mcg) -> [f32; 3] {
    direction((2.0 * rng.random::<f32>() - 1.0).asin(), 6.2831853 * rng.random::<f32>())
}

#[test]
fn kernels_match_the_slow_twin() {
    for (seed, sizes) in [(1, STANDARD), (2, LARGE), (3, SMALL)] {
        let data = model(seed, sizes);
        let m = PlyModel::from_data(data.clone()).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        for _ in 0..300 {
            let (theta_i, h) = incidence(&mut rng);
            let sigma = [0.0, 0.002, 0.02 * rng.random::<f32>(), 0.3];
            let twin = Mixture::new(&data, theta_i.into(), h.into(), &sigma.map(f64::from)).unwrap();
            let (mut peak, mut error, mut pdf_peak, mut pdf_error) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
            for _ in 0..60 {
                let wo = anywhere(&mut rng);
                let (refl, high) = m.eval_split(theta_i, h, sigma, wo);
                let both = m.eval(theta_i, h, sigma, wo);
                let (want_refl, want_high) = twin.eval_split(wo.map(f64::from));
                for k in 0..4 {
                    let want = want_refl + want_high[k];
                    peak = peak.max(want);
                    error = error.max((f64::from(both[k]) - want).abs());
                    error = error.max((f64::from(refl[k]) - want_refl).abs());
                    error = error.max((f64::from(high[k]) - want_high[k]).abs());
                }
                let want = twin.pdf(wo.map(f64::from));
                pdf_peak = pdf_peak.max(want);
                pdf_error = pdf_error.max((f64::from(m.pdf(theta_i, h, sigma, wo)) - want).abs());
            }
            assert!(error <= 1e-4 * peak, "eval at {theta_i} {h}: error {error}, peak {peak}");
            assert!(pdf_error <= 1e-4 * pdf_peak, "pdf at {theta_i} {h}: error {pdf_error}, peak {pdf_peak}");
        }
    }
}
