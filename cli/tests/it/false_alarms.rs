//! `plywave check` promises that a correct model fails its chi-square tests with a chance of 1 %, all of them
//! together: is that the chance?
//!
//! Measured on the polyester that ships, 126 seeds of the command's own sizes: where each of the three lines
//! had 1 % of its own, 6 seeds failed (lines 1, 1 and 4); with one threshold for all 116 tests none does.
//! Single p-values are uniform: of 11 337, 0.996, 1.08 and 1.4 times the expected number lie below 0.1, 0.01
//! and 0.001.
//! (A tenth of the incidences lie beyond the rim, where next to all light misses and there is nothing to
//! test.)
//!
//! Over many seeds, the least of a seed's p-values, corrected for their number, is a uniform number where
//! each p-value is one (Kolmogorov and Smirnov's test of that, whose limit at n seeds is 1.95 / sqrt(n) for
//! one false alarm in 1000), and some 1 % of the seeds fail.

use plywave::PlyModel;
use plywave_check::{CheckOptions, check_layers, check_model, check_whole};
use rand::{RngExt, SeedableRng};
use std::path::Path;

/// Runs the checks for `seeds` seeds; gives the number of seeds that fail and the least p-values, corrected.
fn alarms(seeds: u64, options: &CheckOptions) -> (usize, Vec<f64>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/models/polyester.pwm");
    let model = PlyModel::load(path).unwrap();
    let least = options.chi2_threshold(&model);
    let tests = ((1.0 - options.significance).ln() / (1.0 - least).ln()).round();
    assert_eq!(tests as usize, options.incidences + 16, "a model with edge lobes and layer factors");
    let of_seed = |seed: u64| {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let report = check_model(&model, options, &mut || rng.random());
        let whole = check_whole(&model, options, &mut || rng.random()).unwrap();
        let layers = check_layers(&model, options, &mut || rng.random()).unwrap();
        let thresholds = [report.chi2_threshold, whole.chi2_threshold, layers.chi2_threshold];
        assert_eq!(thresholds, [least; 3], "one threshold for all tests");
        let p = [report.chi2_p(), whole.scatter.chi2_p, layers.scatter.chi2_p];
        let se = [report.sampled_furnace_se(), whole.scatter.sampled_furnace_se, layers.scatter.sampled_furnace_se];
        println!("{seed}: least p {p:?}, sampled furnace {se:?} standard errors");
        p.into_iter().fold(1.0, f64::min)
    };
    // Seeds beside each other, the least p-values in their order.
    let mut all = vec![0.0; seeds as usize];
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let share = all.len().div_ceil(cores);
    std::thread::scope(|scope| {
        for (k, part) in all.chunks_mut(share).enumerate() {
            let of_seed = &of_seed;
            scope.spawn(move || part.iter_mut().enumerate().for_each(|(i, p)| *p = of_seed((k * share + i) as u64)));
        }
    });
    let failed = all.iter().filter(|p| **p < least).count();
    (failed, all.into_iter().map(|p| 1.0 - (1.0 - p).powf(tests)).collect())
}

/// Largest distance of the numbers' distribution from the uniform one.
fn distance(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    let n = numbers.len() as f64;
    let at = |(k, u): (usize, &f64)| ((k as f64 + 1.0) / n - u).max(u - k as f64 / n);
    numbers.iter().enumerate().map(at).fold(0.0, f64::max)
}

fn hold(seeds: u64, options: &CheckOptions) {
    let (failed, corrected) = alarms(seeds, options);
    let (d, limit) = (distance(corrected), 1.95 / (seeds as f64).sqrt());
    println!("{failed} of {seeds} seeds fail, distance from uniform {d:.3}, at most {limit:.3}");
    assert!(d < limit, "distance {d}, limit {limit}");
    // Mean and five standard errors of a count at 1 %.
    let mean = options.significance * seeds as f64;
    assert!((failed as f64) <= mean + 5.0 * mean.sqrt(), "{failed} of {seeds} fail");
}

#[test]
#[ignore = "slow: 15 s: few incidences fail as seldom as promised"]
fn few_incidences_fail_as_seldom_as_promised() {
    hold(24, &CheckOptions { incidences: 4, samples: 5000, ..CheckOptions::default() });
}

/// 200 seeds: `cargo test --release -p plywave-cli --test it false_alarms:: -- --ignored --nocapture`.
#[test]
#[ignore = "slow: 300 s: checks fail as seldom as promised, 200 seeds"]
fn checks_fail_as_seldom_as_promised() {
    hold(200, &CheckOptions { incidences: 24, ..CheckOptions::default() });
}
