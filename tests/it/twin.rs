//! Comparison of a cloth model with a twin, and the twin's file. Here the twin is sampled from the model
//! itself, so the distance must be zero.

use crate::small_cloth::{CELL_UM, RED_BLUE, cloth};
use plywave::Document;
use plywave::cloth::{ClothModel, ClothOptions, GapLight};
use plywave::{Bsdf, BsdfSample, ClothQuery};
use plywave_tables::twin::{CLASSES, ClothTwin, ComparisonOptions, SphereBins, compare};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

fn model() -> ClothModel {
    cloth(&RED_BLUE, &ClothOptions { gaps: GapLight::Straight, ..ClothOptions::default() })
}

/// A twin of light of two absorptions from the model's sampler, summed as a twin's paths are.
fn drawn(cloth: &ClothModel, views: &[[f64; 3]], paths: usize) -> ClothTwin {
    let bins = SphereBins::STANDARD;
    let n = bins.len();
    let (v, k) = (views.len(), 2);
    let sigma = [0.0f32, 0.01];
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    let mut twin = ClothTwin {
        spec_text: "{}".into(),
        program_version: "0".into(),
        name: "small".into(),
        seed: 1,
        repeat_um: [f64::from(CELL_UM); 2],
        repeats: [3, 3],
        views: views.concat(),
        sigma_per_um: sigma.iter().flat_map(|s| [f64::from(*s); 2]).collect(),
        bins,
        paths: vec![paths as u64; v],
        straight: vec![0.0; v],
        killed: vec![0.0; v],
        interactions: vec![1.0; v],
        reflected: vec![0.0; v * k],
        transmitted: vec![0.0; v * k],
        reflected_se: vec![0.0; v * k],
        transmitted_se: vec![0.0; v * k],
        by_yarns: vec![0.0; v * k * 2 * CLASSES],
        by_plies: vec![0.0; v * k * 2 * CLASSES],
        density: vec![0.0; v * k * n],
        variance: vec![0.0; v * k * n],
        image: vec![0.5; v * k],
        image_size: [1, 1],
    };
    for (view, wo) in views.iter().enumerate() {
        let wo = wo.map(|x| x as f32);
        let mut sums = vec![[0.0f64; 2]; k * n];
        for _ in 0..paths {
            let at = rng.random::<[f32; 2]>().map(|u| CELL_UM * u);
            let query = ClothQuery { sigma_per_um: [Some(sigma); 2], ..ClothQuery::new(at, wo, [0.55; 2]) };
            match cloth.at(&query).sample(std::array::from_fn(|_| rng.random())) {
                BsdfSample::Scattered(s) => {
                    for (i, w) in s.weight.iter().enumerate() {
                        let sum = &mut sums[i * n + bins.bin(s.w)];
                        sum[0] += f64::from(*w);
                        sum[1] += f64::from(w * w);
                    }
                }
                BsdfSample::Straight { weight, .. } => twin.straight[view] += f64::from(weight[0]) / paths as f64,
                BsdfSample::Absorbed => {}
            }
        }
        for (i, [sum, squares]) in sums.into_iter().enumerate() {
            let (mean, omega) = (sum / paths as f64, bins.solid_angle());
            let up = bins.is_up(i % n) == (wo[2] > 0.0);
            let half = if up { &mut twin.reflected } else { &mut twin.transmitted };
            half[view * k + i / n] += mean;
            twin.density[view * k * n + i] = (mean / omega) as f32;
            let variance = (squares / paths as f64 - mean * mean) / paths as f64;
            twin.variance[view * k * n + i] = (variance / omega / omega) as f32;
        }
    }
    twin
}

#[test]
#[ignore = "slow: 55 s: a model is at no distance from itself"]
fn a_model_is_at_no_distance_from_itself() {
    let cloth = model();
    let views = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.48, -0.877_268_487_978_452_4]];
    let twin = drawn(&cloth, &views, 150_000);
    let options = ComparisonOptions { places: 4096, directions: 2 };
    let compared = |twin: &ClothTwin| -> Vec<_> {
        (0..twin.view_count()).flat_map(|view| compare(&cloth, twin, view, &options)).collect()
    };
    let all = compared(&twin);
    assert_eq!(all.len(), 6);
    for c in &all {
        println!("{c:?}");
        assert_eq!(c.twin, twin.light(c.view, c.sigma));
        // The sampler's noise, and that of the mean over places.
        assert!((c.model.reflected - c.twin.reflected).abs() < 0.006, "{c:?}");
        assert!((c.model.transmitted - c.twin.transmitted).abs() < 0.006, "{c:?}");
        assert!((c.model.straight - c.twin.straight).abs() < 0.006, "{c:?}");
        assert!(c.upper < 0.05 && c.lower < 0.08, "{c:?}");
    }
    // Without a tenth of its light the model's error is a tenth, which noise does not hide.
    let mut brighter = twin.clone();
    brighter.density.iter_mut().for_each(|d| *d /= 0.9);
    brighter.variance.iter_mut().for_each(|v| *v /= 0.81);
    for c in compared(&brighter) {
        assert!((c.upper - 0.1).abs() < 0.03, "{c:?}");
    }
}

#[test]
fn twins_are_written_and_read() {
    let cloth = model();
    let mut twin = drawn(&cloth, &[[0.0, 0.0, 1.0]], 500);
    // So few samples may add up to more than 1.
    twin.reflected.iter_mut().chain(&mut twin.transmitted).for_each(|energy| *energy *= 0.8);
    let bytes = twin.to_bytes().unwrap();
    assert_eq!(ClothTwin::from_bytes(&bytes, "small.pwx").unwrap(), twin);
    let refused = |change: &dyn Fn(&mut ClothTwin)| {
        let mut bad = twin.clone();
        change(&mut bad);
        bad.to_bytes().unwrap_err().to_string()
    };
    assert!(refused(&|t| t.reflected[0] = 0.9).contains("expected at most 1"));
    assert!(refused(&|t| t.views[0] = 0.5).contains("expected a unit vector"));
    assert!(refused(&|t| t.density[3] = f32::NAN).contains("density[3]"));
    assert!(refused(&|t| t.image.truncate(1)).contains("image"));
    assert!(refused(&|t| t.bins.rows = 23).contains("even number"));
    let table = ClothTwin::from_bytes(include_bytes!("../../fabrics/models/polyester.pwm"), "polyester.pwm");
    assert!(table.unwrap_err().to_string().contains("plywave twin"));
}
