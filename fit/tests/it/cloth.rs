//! A cloth as a scattering function, of a model with fitted edges and layer factors: energy of clear fibers
//! at random points and directions, eval against weight and pdf, chi-square, and light straight through gaps.

use crate::small_cloth::{CELL_UM, SPACING_UM, cloth, model, woven};
use plywave::cloth::{ClothBsdf, ClothData, ClothOptions, GapLight};
use plywave::frame::direction;
use plywave::spec::YarnSpec;
use plywave::{Bsdf, BsdfSample, ClothQuery, PlyModel};
use plywave_check::check_bsdf;
use plywave_fit::{EdgeOptions, fit_edge, layer_factors};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;
use std::sync::{Arc, LazyLock};

/// Of the shipped polyester, with edge lobes and layer factors, clear.
static OPEN: LazyLock<ClothData> = LazyLock::new(|| {
    let mut data = model("polyester").data().clone();
    let spec = YarnSpec::parse(&data.spec_text, "spec").unwrap();
    data.edge = Some(fit_edge(&spec, &EdgeOptions::default()).lobes);
    data.layers = Some(layer_factors(&data));
    let fitted = Arc::new(PlyModel::from_data(data).unwrap());
    woven([fitted.clone(), fitted], [""; 2], SPACING_UM, false)
});

const LAMBDA: [f32; 4] = [0.4, 0.5, 0.6, 0.7];

fn viewer(rng: &mut Pcg64Mcg) -> [f32; 3] {
    // Within 70 degrees of the normal, from both sides.
    let z = 0.35 + 0.65 * rng.random::<f32>();
    let w = direction(z.asin(), TAU * rng.random::<f32>());
    if rng.random::<bool>() { w } else { [w[0], w[1], -w[2]] }
}

fn place(rng: &mut Pcg64Mcg) -> [f32; 2] {
    rng.random::<[f32; 2]>().map(|u| CELL_UM * u)
}

#[test]
#[ignore = "slow: 25 s: clear cloths lose no light"]
fn clear_cloths_lose_no_light() {
    let cloth = cloth(&OPEN, &ClothOptions::default());
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let (mut gaps, mut doubles, mut worst) = (0, 0, 0.0f64);
    let (mut albedo, mut sampled, mut squares) = (0.0f64, 0.0f64, 0.0f64);
    let n = 10_000;
    for _ in 0..n {
        let at = cloth.at(&ClothQuery::new(place(&mut rng), viewer(&mut rng), LAMBDA));
        gaps += i32::from(at.is_gap());
        doubles += i32::from(at.is_double());
        let all = f64::from(at.albedo()[1]);
        worst = worst.max((all - 1.0).abs());
        albedo += all;
        let weight = at.sample(rng.random()).direction().map_or(0.0, |s| {
            let f = at.eval(s.w);
            let error = (s.weight[1] * s.pdf - f[1]).abs().max((s.pdf - at.pdf(s.w)).abs());
            assert!(error <= 1e-4 * (1.0 + s.pdf), "weight {s:?}, eval {f:?}");
            f64::from(s.weight[1])
        });
        sampled += weight;
        squares += weight * weight;
    }
    let (mean, albedo, n) = (sampled / f64::from(n), albedo / f64::from(n), f64::from(n));
    let se = ((squares / n - mean * mean) / n).sqrt();
    println!(
        "gaps {gaps}, two layers {doubles} of {n}; albedo {albedo:.5}, off by {worst:.5}, sampled {mean:.4} +- {se:.4}"
    );
    assert!(worst < 3e-3, "albedo off by {worst}");
    assert!((mean - 1.0).abs() < 0.01 + 3.0 * se, "sampled energy {mean} +- {se}");
    assert!(gaps > 500 && doubles > 500, "gaps {gaps}, two layers {doubles}");
}

#[test]
#[ignore = "slow: 30 s: every case of the beam is a scattering function"]
fn every_case_of_the_beam_is_a_scattering_function() {
    let options = ClothOptions { sigma_per_um: Some(0.002), ..ClothOptions::default() };
    let (relief, plain) = (cloth(&OPEN, &options), cloth(&OPEN, &ClothOptions { relief: false, ..options }));
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let (mut checked, mut least, mut furnace) = ([0; 3], 1.0f64, [0.0f64; 3]);
    while checked.iter().sum::<i32>() < 18 {
        let query = ClothQuery::new(place(&mut rng), viewer(&mut rng), LAMBDA);
        let at: ClothBsdf<'_, 4> = plain.at(&query);
        let case = if at.is_gap() { 0 } else { 1 + usize::from(at.is_double()) };
        if checked[case] >= 6 {
            continue;
        }
        checked[case] += 1;
        for (at, has_relief) in [(at, false), (relief.at(&query), true)] {
            // Panels of the integrals: with two thirds of the width the p-values are the same to 0.02.
            let r = check_bsdf(&at, [0.009, 0.018], 20_000, &mut || rng.random());
            least = least.min(r.chi2_p);
            assert!(r.weight_error < 1e-3, "case {case}, relief {has_relief}: {r:?}");
            // Relief keeps the energy of a ply, not that of each of its points.
            if !has_relief {
                furnace[case] = furnace[case].max(r.furnace_error);
            }
        }
    }
    println!("gap, one layer, two: {checked:?}; least p-value {least:.4}, furnace within {furnace:.4?}");
    assert!(least > 0.01 / 36.0, "least p-value {least}");
    // For light that other yarns stop, a point's albedo uses the mean over positions.
    assert!(furnace.iter().all(|f| *f < 0.17), "furnace {furnace:?}");
}

#[test]
#[ignore = "slow: 15 s: straight gaps let the light go on"]
fn straight_gaps_let_the_light_go_on() {
    let straight = cloth(&OPEN, &ClothOptions { gaps: GapLight::Straight, ..ClothOptions::default() });
    // A corner of the cell, between four yarns.
    let query = ClothQuery::new([0.0, 0.0], [0.0, 0.0, 1.0], LAMBDA);
    let at = straight.at(&query);
    let (straight, outcomes) = (at.straight(), at.outcomes());
    assert!(at.is_gap() && outcomes.straight > 0.99 && straight[0] > 0.99, "{outcomes:?} {straight:?}");
    let BsdfSample::Straight { weight, probability } = at.sample([0.5; 3]) else { panic!("{:?}", at.sample([0.5; 3])) };
    assert!((0..4).all(|k| (weight[k] * probability - straight[k]).abs() < 1e-6), "{weight:?} {probability}");
    let diffracted = cloth(&OPEN, &ClothOptions::default());
    let at = diffracted.at(&query);
    assert!(at.outcomes().scattered > 1.0 - 1e-6 && at.sample([0.5; 3]).direction().is_some_and(|s| s.w[2] < -0.9));
    assert!(at.eval([f32::NAN; 3]).iter().all(|v| v.is_finite()));
}
