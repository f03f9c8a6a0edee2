//! `eval_pdf` shares work between `eval` and `pdf`, and so does `sample`: here each is compared with the two
//! that it replaces, in every case of a cloth (one layer, two layers, gaps), with speckle and
//! without, and for the whole ply, with slits and without.

use crate::small_cloth::{CELL_UM, LAME, RED_BLUE, cloth};
use plywave::cloth::{ClothData, ClothOptions};
use plywave::frame::direction;
use plywave::gap::{SLIT_SHARE, Slit};
use plywave::ply::{PlyData, PlyPlace};
use plywave::spec::GaussianBeam;
use plywave::speckle::NoiseSpectrum;
use plywave::{Bsdf, BsdfSample, ClothQuery, PlyModel, PlyQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::Arc;

const LAMBDA: [f32; 4] = [0.41, 0.5, 0.6, 0.72];

fn anywhere(rng: &mut Pcg64Mcg) -> [f32; 3] {
    direction((2.0 * rng.random::<f32>() - 1.0).asin(), std::f32::consts::TAU * rng.random::<f32>())
}

fn spectrum() -> NoiseSpectrum {
    NoiseSpectrum {
        seed: 7,
        spectrum: [[0.2, 0.1, 0.1, 0.1, 0.1], [0.0, 0.1, 0.1, 0.1, 0.2]].concat(),
        step_um: [0.1, 0.2],
        share: [0.4, 1.0],
        w0_um: 1.0,
        lambda_um: 0.4,
        fade: [[1.0, -0.2]; 2],
        contrast: [1.0; 2],
    }
}

fn with_noise(model: &PlyModel) -> PlyModel {
    PlyModel::from_data(PlyData { noise: Some(spectrum()), ..model.data().clone() }).unwrap()
}

fn place(ply: usize) -> Option<PlyPlace> {
    Some(PlyPlace::new(ply as u32, 0.1 * ply as f32, 3.0 * ply as f32))
}

fn near(got: f32, want: f32, peak: f32) -> bool {
    (got - want).abs() <= 3e-6 * peak + 1e-5 * want.abs()
}

/// At `wo` and at a sample.
fn check(s: &impl Bsdf<4>, wo: [f32; 3], u: [f32; 3]) {
    let (f, pdf) = s.eval_pdf(wo);
    let (want, want_pdf) = (s.eval(wo), s.pdf(wo));
    let peak = want.iter().fold(0.0, |a: f32, b| a.max(*b));
    assert!(f.iter().zip(&want).all(|(f, want)| near(*f, *want, peak)), "f at {wo:?}: {f:?}, alone {want:?}");
    assert!(near(pdf, want_pdf, want_pdf), "pdf at {wo:?}: {pdf}, alone {want_pdf}");
    let BsdfSample::Scattered(sample) = s.sample(u) else { return };
    let (f, pdf) = s.eval_pdf(sample.w);
    // The direction goes through two frames and back, which narrow lobes notice.
    assert!((sample.pdf / pdf - 1.0).abs() < 2e-3, "pdf of a sample: {}, at its direction {pdf}", sample.pdf);
    for k in 0..4 {
        let got = sample.weight[k] * sample.pdf;
        assert!((got - f[k]).abs() <= 2e-3 * f[k] + 1e-6, "sample {k}: {got}, at its direction {}", f[k]);
    }
}

/// Numbers of gaps, of double layers and of points that have a part of the mean over the cell.
fn check_cloth(data: &ClothData, options: &ClothOptions, rng: &mut Pcg64Mcg) -> [u32; 3] {
    let cloth = cloth(data, options);
    let mut cases = [0; 3];
    for i in 0..1500 {
        let [x, y, z] = anywhere(rng);
        let point = rng.random::<[f32; 2]>().map(|u| 1e4 * u);
        let footprint_um = if options.far { [0.75 * CELL_UM, 1e4][i % 2] } else { 0.0 };
        let at = cloth.at(&ClothQuery { footprint_um, ..ClothQuery::new(point, [x, y, z.abs()], LAMBDA) });
        let is = [at.is_gap(), at.is_double(), at.far_share() > 0.0];
        (0..3).for_each(|case| cases[case] += u32::from(is[case]));
        check(&at, anywhere(rng), rng.random());
    }
    cases
}

#[test]
fn cloths_answer_together_what_they_answer_alone() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut noisy = RED_BLUE.clone();
    noisy.models.iter_mut().for_each(|m| *m = Arc::new(with_noise(m)));
    for (data, noise) in [(&*RED_BLUE, false), (&noisy, true)] {
        let cases = check_cloth(data, &ClothOptions { noise, ..ClothOptions::default() }, &mut rng);
        assert!(cases[0] > 50 && cases[1] > 100, "gaps, double layers: {cases:?}");
    }
}

#[test]
#[ignore = "slow: 20 s: the mean over a cell answers together what it answers alone"]
fn the_mean_over_a_cell_answers_together_what_it_answers_alone() {
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    let cases = check_cloth(&LAME, &ClothOptions { far: true, ..ClothOptions::default() }, &mut rng);
    assert!(cases[2] > 1000, "{cases:?}");
}

#[test]
fn whole_plies_answer_together_what_they_answer_alone() {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let path = format!("{}/fabrics/models/polyester.pwm", env!("CARGO_MANIFEST_DIR"));
    let smooth = PlyModel::load(path).unwrap();
    let noisy = with_noise(&smooth);
    let slit = Slit::new(2.0, SLIT_SHARE, &GaussianBeam { w0_um: 10.0, lambda_um: 0.55, d_cut_um: 20.0 }).unwrap();
    for i in 0..3000 {
        let theta_i = 2.8 * (rng.random::<f32>() - 0.5);
        let h_um = 150.0 * (rng.random::<f32>() - 0.5);
        let sigma_per_um = rng.random::<[f32; 4]>().map(|s| 0.05 * s);
        let model = if i % 2 == 0 { &smooth } else { &noisy };
        let s = model.at(&PlyQuery {
            slit: (i % 3 == 0).then_some(&slit),
            place: place(i),
            cached: i % 7 != 0,
            ..PlyQuery::new(theta_i, h_um, sigma_per_um, LAMBDA)
        });
        let forward = direction(-theta_i + 0.01 * rng.random::<f32>(), 1.5 * std::f32::consts::PI);
        check(&s, if i % 5 == 0 { forward } else { anywhere(&mut rng) }, rng.random());
    }
}

/// Cached lobes are multiplied out, uncached ones are summed: both agree, for models of both sizes with
/// cached lobes, and for one without.
#[test]
fn cached_plies_answer_what_uncached_ones_do() {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let load =
        |name: &str| PlyModel::load(format!("{}/fabrics/models/{name}.pwm", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let (few, many) = (load("polyester_3ply"), load("silk"));
    let large = PlyModel::from_data(crate::synthetic::model(
        9,
        crate::synthetic::Sizes { high: 13, ..crate::synthetic::STANDARD },
    ))
    .unwrap();
    let models = [with_noise(&few), few, with_noise(&many), many, large];
    let slit = Slit::new(2.0, SLIT_SHARE, &GaussianBeam { w0_um: 10.0, lambda_um: 0.55, d_cut_um: 20.0 }).unwrap();
    let (mut missed, mut sampled) = (0, 0);
    for i in 0..7500 {
        let model = &models[i % 5];
        let theta_i = 2.8 * (rng.random::<f32>() - 0.5);
        let h_um = 2.2 * model.data().h_um[0] as f32 * (rng.random::<f32>() - 0.5);
        let sigma_per_um = rng.random::<[f32; 4]>().map(|s| if i % 7 == 0 { 0.0 } else { 0.1 * s * s });
        let query = PlyQuery {
            slit: (i % 11 == 0).then_some(&slit),
            place: place(i),
            edge: i % 13 != 0,
            ..PlyQuery::new(theta_i, h_um, sigma_per_um, LAMBDA)
        };
        let (cached, uncached) = (model.at(&query), model.at(&PlyQuery { cached: false, ..query }));
        let forward = direction(-theta_i + 0.01 * rng.random::<f32>(), 1.5 * std::f32::consts::PI);
        let wo = if i % 3 == 0 { forward } else { anywhere(&mut rng) };
        let (got, want) = (cached.eval(wo), uncached.eval(wo));
        let peak = want.iter().fold(0.0, |a: f32, b| a.max(*b));
        assert!(got.iter().zip(&want).all(|(got, want)| near(*got, *want, peak)), "f: {got:?}, uncached {want:?}");
        let (got, want) = (cached.pdf(wo), uncached.pdf(wo));
        assert!(near(got, want, want), "pdf: {got}, uncached {want}");
        let (got, want) = (cached.albedo(), uncached.albedo());
        assert!(
            got.iter().zip(&want).all(|(got, want)| near(*got, *want, *want)),
            "albedo: {got:?}, uncached {want:?}"
        );
        assert!(near(cached.outcomes().scattered, uncached.outcomes().scattered, 1.0));
        missed += u32::from(uncached.r_d() == 1.0);
        check(&cached, wo, rng.random());
        let u = rng.random();
        match (cached.sample(u), uncached.sample(u)) {
            (BsdfSample::Scattered(got), BsdfSample::Scattered(want)) => {
                sampled += 1;
                let apart = (0..3).map(|c| (got.w[c] - want.w[c]).abs()).fold(0.0, f32::max);
                assert!(apart < 1e-4, "sample {u:?}: {:?}, uncached {:?}", got.w, want.w);
            }
            (BsdfSample::Straight { weight: got, .. }, BsdfSample::Straight { weight: want, .. }) => {
                assert!((0..4).all(|k| near(got[k], want[k], 1.0)), "{got:?} {want:?}");
            }
            (BsdfSample::Absorbed, BsdfSample::Absorbed) => (),
            (got, want) => panic!("sample {u:?}: {got:?}, uncached {want:?}"),
        }
    }
    assert!(missed > 100 && sampled > 5000, "{missed} missed, {sampled} sampled");
}
