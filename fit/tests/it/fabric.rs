//! A fabric as a scattering function, on shipped models: energy of clear fibers at random points and
//! directions, eval against weight and pdf, chi-square, and continuity at the border of the draft's repeat.

use plywave::check::check_bsdf;
use plywave::fabric::{
    Draft, Fabric, FabricBsdf, FabricModel, FabricOptions, FabricSpec, GapLight, LoadedFabric, YarnSet, YarnShape,
};
use plywave::frame::direction;
use plywave::spec::{Handedness, YarnSpec};
use plywave::{Bsdf, BsdfSample, FabricQuery, PlyModel};
use plywave_fit::{EdgeOptions, fit_edge, layer_factors};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;
use std::sync::{Arc, OnceLock};

/// The shipped polyester, with edge lobes and layer factors.
fn model() -> Arc<PlyModel> {
    static MODEL: OnceLock<Arc<PlyModel>> = OnceLock::new();
    let made = || {
        let path = format!("{}/../fabrics/models/polyester.pwm", env!("CARGO_MANIFEST_DIR"));
        let mut data = PlyModel::load(path).unwrap().data().clone();
        let spec = YarnSpec::parse(&data.spec_text, "spec").unwrap();
        data.edge = Some(fit_edge(&spec, &EdgeOptions::default()).lobes);
        data.layers = Some(layer_factors(&data));
        Arc::new(PlyModel::from_data(data).unwrap())
    };
    MODEL.get_or_init(made).clone()
}

const SPEC: &str = r#"
name = "test"
[weave]
kind = "plain"
[warp]
model = "polyester.pwm"
spacing_um = 120.0
[weft]
model = "polyester.pwm"
spacing_um = 120.0
"#;

/// A fabric of this draft, spacing and number of plies, with clear fibers by default.
fn fabric(draft: Draft, spacing_um: f64, plies: u32, options: &FabricOptions) -> FabricModel {
    let shape = YarnShape {
        plies,
        ply_radius_um: 50.0,
        ply_pitch_um: (plies > 1).then_some(2500.0),
        handedness: Handedness::S,
        spacing_um,
        crimp: 0.4,
        d_cut_um: 20.0,
    };
    let loaded = LoadedFabric {
        spec: FabricSpec::parse(SPEC, "spec").unwrap(),
        fabric: Fabric::new(draft, [shape, shape]).unwrap(),
        models: vec![model()],
        model_paths: Vec::new(),
        threads: [vec![0], vec![0]],
        wif_notes: Vec::new(),
    };
    FabricModel::new(loaded, options).unwrap()
}

fn viewer(rng: &mut Pcg64Mcg) -> [f32; 3] {
    // Within 70 degrees of the normal, from both sides.
    let z = 0.35 + 0.65 * rng.random::<f32>();
    let w = direction(z.asin(), TAU * rng.random::<f32>());
    if rng.random::<bool>() { w } else { [w[0], w[1], -w[2]] }
}

#[test]
#[ignore = "slow: 25 s: clear fabrics lose no light"]
fn clear_fabrics_lose_no_light() {
    let satin = Draft::satin(8, 3).unwrap();
    for (name, f) in [
        ("closed satin", fabric(satin, 102.0, 1, &FabricOptions::default())),
        ("open plain", fabric(Draft::plain(), 180.0, 1, &FabricOptions::default())),
        ("plain of three plies", fabric(Draft::plain(), 260.0, 3, &FabricOptions::default())),
    ] {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let (mut gaps, mut doubles) = (0, 0);
        let (mut albedo, mut sampled, mut squares) = (0.0f64, 0.0f64, 0.0f64);
        let n = 10_000;
        for _ in 0..n {
            let [x, y] = [0, 1].map(|_| 2000.0 * rng.random::<f32>());
            let at: FabricBsdf<'_, 4> = f.at(&FabricQuery::new([x, y], viewer(&mut rng), [0.4, 0.5, 0.6, 0.7]));
            gaps += i32::from(at.is_gap());
            doubles += i32::from(at.is_double());
            let all = f64::from(at.albedo()[1]);
            assert!((all - 1.0).abs() < 3e-3, "{name}: albedo {all}");
            albedo += all;
            let weight = at.sample(rng.random()).direction().map_or(0.0, |s| {
                let f = at.eval(s.w);
                let error = (s.weight[1] * s.pdf - f[1]).abs().max((s.pdf - at.pdf(s.w)).abs());
                assert!(error <= 1e-4 * (1.0 + s.pdf), "{name}: weight {s:?}, eval {f:?}");
                f64::from(s.weight[1])
            });
            sampled += weight;
            squares += weight * weight;
        }
        let (mean, n) = (sampled / f64::from(n), f64::from(n));
        let se = ((squares / n - mean * mean) / n).sqrt();
        println!(
            "{name}: gaps {gaps}, two layers {doubles} of {n}; albedo {:.5}, sampled {mean:.4} +- {se:.4}",
            albedo / n
        );
        assert!((mean - 1.0).abs() < 0.01 + 3.0 * se, "{name}: sampled energy {mean} +- {se}");
        match name {
            "open plain" => assert!(gaps > 500 && doubles > 500),
            "closed satin" => assert!(doubles > 8000),
            _ => {}
        }
    }
}

#[test]
#[ignore = "slow: 15 s: every case of the beam is a scattering function"]
fn every_case_of_the_beam_is_a_scattering_function() {
    let f = fabric(Draft::plain(), 150.0, 1, &FabricOptions { sigma_per_um: Some(0.002), ..FabricOptions::default() });
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let (mut checked, mut least, mut furnace) = ([0; 3], 1.0f64, [0.0f64; 3]);
    while checked.iter().sum::<i32>() < 18 {
        let [x, y] = [0, 1].map(|_| 300.0 * rng.random::<f32>());
        let at: FabricBsdf<'_, 4> = f.at(&FabricQuery::new([x, y], viewer(&mut rng), [0.4, 0.5, 0.6, 0.7]));
        let case = if at.is_gap() { 0 } else { 1 + usize::from(at.is_double()) };
        if checked[case] >= 6 {
            continue;
        }
        checked[case] += 1;
        // Panels of the integrals: with two thirds of the width the p-values are the same to 0.02.
        let r = check_bsdf(&at, [0.009, 0.018], 20_000, &mut || rng.random());
        least = least.min(r.chi2_p);
        furnace[case] = furnace[case].max(r.furnace_error);
        assert!(r.weight_error < 1e-3, "case {case}: {r:?}");
    }
    println!("gap, one layer, two: {checked:?}; least p-value {least:.4}, furnace within {furnace:.4?}");
    assert!(least > 0.01 / 18.0, "least p-value {least}");
    // For light that other yarns stop, a point's albedo uses the mean over positions.
    assert!(furnace.iter().all(|f| *f < 0.13), "furnace {furnace:?}");
}

/// The mean over small areas on both sides of the repeat's border is that over areas one repeat on.
#[test]
#[ignore = "slow: 5 s: repeats have no seam"]
fn repeats_have_no_seam() {
    let f = fabric(Draft::twill(2, 1).unwrap(), 110.0, 1, &FabricOptions::default());
    let [width, _] = f.fabric().repeat_um().map(|r| r as f32);
    let w = direction(1.2, 0.3);
    let wo = direction(0.7, 2.0);
    for k in 0..200 {
        let y = 7.3 * k as f32;
        // Single precision resolves positions to 1e-4 um here.
        let at = |x: f32| -> [f32; 4] { f.at(&FabricQuery::new([x, y], w, [0.4, 0.5, 0.6, 0.7])).eval(wo) };
        let (a, b) = (at(13.0), at(13.0 + width));
        assert!((a[0] - b[0]).abs() <= 2e-3 * (1.0 + a[0]), "y {y}: {a:?} {b:?}");
    }
}

#[test]
#[ignore = "slow: 5 s: straight gaps let the light go on"]
fn straight_gaps_let_the_light_go_on() {
    let options = FabricOptions { gaps: GapLight::Straight, ..FabricOptions::default() };
    let f = fabric(Draft::plain(), 260.0, 1, &options);
    let at: FabricBsdf<'_, 4> = f.at(&FabricQuery::new([0.0, 0.0], [0.0, 0.0, 1.0], [0.4, 0.5, 0.6, 0.7]));
    let (straight, outcomes) = (at.straight(), at.outcomes());
    assert!(at.is_gap() && outcomes.straight > 0.99 && straight[0] > 0.99, "{outcomes:?} {straight:?}");
    let BsdfSample::Straight { weight, probability } = at.sample([0.5; 3]) else { panic!("{:?}", at.sample([0.5; 3])) };
    assert!((0..4).all(|k| (weight[k] * probability - straight[k]).abs() < 1e-6), "{weight:?} {probability}");
    let diffracted = fabric(Draft::plain(), 260.0, 1, &FabricOptions::default());
    let at: FabricBsdf<'_, 4> = diffracted.at(&FabricQuery::new([0.0, 0.0], [0.0, 0.0, 1.0], [0.4, 0.5, 0.6, 0.7]));
    assert!(at.outcomes().scattered > 1.0 - 1e-6 && at.sample([0.5; 3]).direction().is_some_and(|s| s.w[2] < -0.9));
    assert!(at.eval([f32::NAN; 3]).iter().all(|v| v.is_finite()));
    assert_eq!(diffracted.sigma(YarnSet::Warp, -3, [0.5]), [0.0]);
}
