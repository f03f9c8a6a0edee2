//! Tests of the fit of speckle noise: independently drawn fields of known contrast and covariance are
//! recovered, and models keep and evaluate what was fitted. `speckle_field` has the statistics of the
//! noise itself.

use plywave::Document;
use plywave::frame::direction;
use plywave::gap::Slit;
use plywave::ply::{FibersAround, PlyPlace};
use plywave::spec::GaussianBeam;
use plywave::speckle::{NoiseField, NoiseSpectrum};
use plywave::{Bsdf, PlyModel, PlyQuery};
use plywave_tables::speckle::{SpecklePatterns, SpecklePolarization, SpeckleSide};
use plywave_wave::noise::{
    FieldModel, NoiseContrast, NoiseOptions, PatternCovariance, compare_lines, intensity_covariance, noise_spectrum,
};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;
use std::sync::OnceLock;

const AZIMUTHS: usize = 720;
/// Half range of source positions over the wavelength: k a.
const REACH: f64 = 30.0;

/// Patterns of plane waves of random phase from positions drawn within [-REACH, REACH] (a picture of a
/// fiber's light), plus a constant phasor; the former have the share b of the power. Their correlation is the
/// mean of cos(m d) over the harmonics m drawn, sin(REACH d) / (REACH d) nearly.
fn planted(share: f64, instances: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let m = REACH as i32;
    let waves = (2 * m + 1) as f64;
    (0..instances)
        .map(|_| {
            let waves: Vec<[f64; 2]> = (-m..=m)
                .map(|_| {
                    let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
                    [draw(), draw()].map(|v| v * (0.5 * share / waves).sqrt())
                })
                .collect();
            (0..AZIMUTHS)
                .map(|j| {
                    let phi = TAU * j as f64 / AZIMUTHS as f64;
                    let (mut re, mut im) = ((1.0 - share).sqrt(), 0.0);
                    for (k, [a, b]) in (-m..=m).zip(&waves) {
                        let (sin, cos) = (f64::from(k) * phi).sin_cos();
                        re += a * cos - b * sin;
                        im += a * sin + b * cos;
                    }
                    // A smooth mean that the statistics must divide out.
                    (re * re + im * im) * (1.5 + phi.cos())
                })
                .collect()
        })
        .collect()
}

fn planted_correlation(lag: f64) -> f64 {
    let m = REACH as i32;
    (-m..=m).map(|k| (f64::from(k) * lag).cos()).sum::<f64>() / f64::from(2 * m + 1)
}

/// A file of planted patterns, high-order light of the share `shares[1]` over dark fibers of `shares[0]`.
pub fn patterns(shares: [f64; 2]) -> SpecklePatterns {
    let n = 60;
    let refl = planted(shares[0], n, 1);
    let high = planted(shares[1], n, 2);
    let mut flat = Vec::new();
    for dark in [false, true] {
        for _ in 0..2 {
            for i in 0..n {
                flat.extend((0..AZIMUTHS).map(|j| (refl[i][j] + if dark { 0.0 } else { high[i][j] }) as f32));
            }
        }
    }
    SpecklePatterns {
        spec_text: String::new(),
        program_version: "0".into(),
        seed: 1,
        theta_i: 0.0,
        w0_um: 100.0,
        kappa: vec![0.0, 0.05],
        lambda_um: vec![0.4],
        instances: n,
        azimuths: AZIMUTHS,
        patterns: flat,
        c_sca_um: vec![20.0; 4 * n],
        c_abs_um: vec![10.0; 4 * n],
    }
}

/// Noise of half developed reflection and of fully developed high-order light, fitted once.
pub fn spectrum() -> &'static NoiseSpectrum {
    static SPECTRUM: OnceLock<NoiseSpectrum> = OnceLock::new();
    SPECTRUM.get_or_init(|| noise_spectrum(&patterns([0.4, 1.0]), &options(), "planted").unwrap().0)
}

pub fn around() -> FibersAround {
    FibersAround { count: 9.0, ring_um: 20.0 }
}

pub fn field() -> NoiseField {
    spectrum().field(around())
}

pub fn options() -> NoiseOptions {
    NoiseOptions::default()
}

/// A place on ply i.
pub fn place(i: u64) -> PlyPlace {
    PlyPlace::new(i as u32, 0.3, 17.0)
}

/// N of f_refl and f_high at one wavelength.
pub fn both(field: &NoiseField, place: &PlyPlace, h_um: f32, wo: [f32; 3], lambda_um: f64) -> [f64; 2] {
    let (refl, high) = field.factors(place, h_um, 0.0, wo, [lambda_um as f32]);
    [refl[0], high[0]].map(f64::from)
}

/// A direction at v = sin theta_o and azimuth phi_o.
pub fn at(sin_theta: f64, phi: f64) -> [f32; 3] {
    direction(sin_theta.clamp(-1.0, 1.0).asin() as f32, phi as f32)
}

pub fn correlation(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let sum = |f: &dyn Fn(f64, f64) -> f64| x.iter().zip(y).map(|(x, y)| f(x - mx, y - my)).sum::<f64>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

/// Noise that cannot be saved is refused before the work: the patterns here have no light.
#[test]
fn what_cannot_be_saved_is_refused_before_the_work() {
    let empty =
        |lambda_um: f64| SpecklePatterns { lambda_um: vec![lambda_um], patterns: Vec::new(), ..patterns([0.4, 1.0]) };
    let refuse = |lambda_um: f64, options: NoiseOptions, words: &[&str]| {
        let message = noise_spectrum(&empty(lambda_um), &options, "x.pws").unwrap_err().to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    };
    let wide = NoiseOptions { w0_um: 1e4, ..options() };
    refuse(0.1, wide.clone(), &["x.pws", "noise_w0_um", "10000"]);
    assert!(plywave_wave::noise::check_savable(&empty(0.1), &NoiseOptions { w0_um: 999.0, ..wide }, "").is_ok());
    refuse(200.0, options(), &["noise_lambda_um", "200"]);
}

/// Share and covariance of planted fields are recovered, partly and fully developed.
#[test]
fn planted_fields_come_back() {
    for share in [0.05, 0.4, 1.0] {
        let measured = PatternCovariance::from_patterns(&planted(share, 400, 7), SpeckleSide::All);
        let model = FieldModel::from_covariance(&measured, NoiseContrast::Measured, AZIMUTHS);
        let want = (intensity_covariance(share, 1.0)).sqrt();
        assert!((measured.contrast() / want - 1.0).abs() < 0.05, "{share}: {} {want}", measured.contrast());
        let top = intensity_covariance(share, 1.0);
        for lag in 0..60 {
            let lag = TAU * f64::from(lag) / AZIMUTHS as f64;
            let want = intensity_covariance(share, planted_correlation(lag));
            let got = model.covariance(lag);
            assert!((got - want).abs() < 0.08 * top, "{share} {lag}: {got} {want} of {top}");
        }
        // The field's spectrum is within the drawn harmonics, except for the noise of 400 instances; at share
        // 1 C = mu^2 is flat at 0.
        let beyond: f64 = model.spectrum[REACH as usize + 3..].iter().sum::<f64>() * 2.0;
        assert!(beyond < if share < 1.0 { 0.08 } else { 0.25 }, "{share}: {beyond} beyond the reach");
        assert!(model.spectrum.iter().all(|v| *v >= 0.0));
    }
    // The paper's form of a fully developed speckle is the same field.
    let measured = PatternCovariance::from_patterns(&planted(1.0, 400, 7), SpeckleSide::All);
    let paper = FieldModel::from_covariance(&measured, NoiseContrast::Developed, AZIMUTHS);
    assert_eq!(paper.share, 1.0);
    for lag in 0..8 {
        let lag = TAU * f64::from(lag) / AZIMUTHS as f64;
        assert!((paper.covariance(lag) - planted_correlation(lag).powi(2)).abs() < 0.08);
    }
}

/// Synthesized patterns have the contrast and the covariance of their source.
#[test]
fn lines_have_contrast_and_covariance() {
    let rows = compare_lines(&patterns([0.4, 0.6]), &options(), 1500, "planted").unwrap();
    assert_eq!(rows.len(), 2);
    for row in rows {
        let ratio = row.synthesized.contrast() / row.simulated.contrast();
        assert!((ratio - 1.0).abs() < 0.05, "{}: contrast {ratio}", row.kind);
        let distance = row.simulated.distance(&row.synthesized, 0.1);
        assert!(distance < 0.05, "{}: covariance {distance}", row.kind);
        // The error of 60 patterns is some hundredths, and their covariance lies between those of its halves.
        let floor = 0.5 * row.halves[0].distance(&row.halves[1], 0.1);
        assert!(floor > 1e-3 && floor < 0.2, "{}: {floor}", row.kind);
        let middle = 0.5 * (row.halves[0].variance() + row.halves[1].variance());
        assert!((middle / row.simulated.variance() - 1.0).abs() < 0.1, "{}: {middle}", row.kind);
    }
}

/// Patterns without dark fibers, or of one instance, are refused; the noise depends on the seed alone.
#[test]
fn patterns_are_checked_and_seeds_count() {
    let mut p = patterns([0.4, 1.0]);
    p.kappa.truncate(1);
    let error = noise_spectrum(&p, &options(), "x.pws").unwrap_err().to_string();
    assert!(error.contains("x.pws: kappa") && error.contains("--kappa"), "{error}");
    let p = patterns([0.4, 1.0]);
    let made = |options: &NoiseOptions| noise_spectrum(&p, options, "x").unwrap().0;
    assert_eq!(made(&options()), made(&options()));
    let other = made(&NoiseOptions { seed: 2, ..options() });
    let [a, b] = [&made(&options()), &other].map(|s| both(&s.field(around()), &place(1), 0.0, at(0.1, 2.0), 0.4));
    assert!(a[0] != b[0] && a[1] != b[1], "{a:?} {b:?}");
    // Light that does not vary has N = 1.
    let mut flat = p.clone();
    flat.patterns.fill(1.0);
    let flat = noise_spectrum(&flat, &options(), "x").unwrap().0.field(around());
    for i in 0..100 {
        assert_eq!(both(&flat, &place(i), 3.0, at(0.1, 0.06 * i as f64), 0.5), [1.0; 2]);
    }
}

/// A model keeps its noise in its file, in 5 kB; a model without noise reports none; broken noise is refused.
#[test]
fn models_keep_their_noise() {
    let bare = crate::synthetic::model(1, crate::synthetic::STANDARD);
    let with = |noise: NoiseSpectrum| plywave::ply::PlyData { noise: Some(noise), ..bare.clone() };
    let smooth = bare.to_bytes().unwrap().len();
    let bytes = with(spectrum().clone()).to_bytes().unwrap();
    let back = PlyModel::from_bytes(&bytes, "m.pwm").unwrap();
    assert_eq!(back.data().noise.as_ref(), Some(spectrum()));
    let around = back.noise().unwrap().around();
    assert_eq!(back.noise(), Some(&spectrum().field(around)));
    assert_eq!(back.require_noise("m.pwm").unwrap().contrast(), spectrum().contrast);
    assert_eq!(back.data().to_bytes().unwrap(), bytes);
    assert!(bytes.len() < smooth + 5_000, "{} {smooth}", bytes.len());
    let none = PlyModel::from_data(bare.clone()).unwrap();
    let error = none.require_noise("m.pwm").unwrap_err().to_string();
    assert!(error.contains("m.pwm: noise_spectrum") && error.contains("plywave noise"), "{error}");
    type Spoil = fn(&mut NoiseSpectrum);
    let spoils: [(&str, Spoil); 12] = [
        ("noise_spectrum", |s| s.spectrum.truncate(9)),
        ("noise_spectrum", |s| s.spectrum.clear()),
        ("noise_spectrum", |s| s.spectrum = vec![0.0; 1 << 20]),
        ("noise_spectrum", |s| s.spectrum[3] = f32::NAN),
        ("noise_spectrum", |s| s.spectrum[3] = -1e-3),
        ("noise_spectrum", |s| s.spectrum.fill(0.0)),
        ("noise_share", |s| s.share[1] = 1.1),
        ("noise_w0_um", |s| s.w0_um = 0.0),
        ("noise_w0_um", |s| s.w0_um = 1e5),
        ("noise_step_um", |s| s.step_um[1] = 0.0),
        ("noise_step_um", |s| s.step_um[1] = 30.0),
        ("noise_lambda_um", |s| s.lambda_um = f64::INFINITY),
    ];
    for (key, spoil) in spoils {
        let mut noise = spectrum().clone();
        spoil(&mut noise);
        let error = PlyModel::from_data(with(noise)).unwrap_err().to_string();
        assert!(error.contains(key), "{key}: {error}");
    }
}

/// The mean of eval over places is the smooth eval; no place, no wish for it, or a model without noise, is
/// the smooth eval itself.
#[test]
fn eval_over_places_averages_to_the_smooth_model() {
    let bare = crate::synthetic::model(1, crate::synthetic::STANDARD);
    let smooth = PlyModel::from_data(bare.clone()).unwrap();
    let model = PlyModel::from_data(plywave::ply::PlyData { noise: Some(spectrum().clone()), ..bare }).unwrap();
    let (sigma, lambda) = ([0.0, 0.01], [0.45, 0.65]);
    for (theta_i, h, wo) in [(0.2, 5.0, at(0.1, 2.0)), (-0.5, -20.0, at(0.4, 4.9))] {
        let smooth_query = PlyQuery::new(theta_i, h, sigma, lambda);
        let want = smooth.at(&smooth_query).eval(wo);
        assert_eq!(model.at(&smooth_query).eval(wo), want);
        assert_eq!(smooth.at(&PlyQuery { place: Some(place(1)), ..smooth_query }).eval(wo), want);
        let without = PlyQuery { place: Some(place(1)), speckle: false, ..smooth_query };
        assert_eq!(model.at(&without).eval(wo), want);
        let n = 100_000;
        let mut sums = [0.0f64; 2];
        for i in 0..n {
            let f = model.at(&PlyQuery { place: Some(place(i)), ..smooth_query }).eval(wo);
            (0..2).for_each(|k| sums[k] += f64::from(f[k]));
        }
        for k in 0..2 {
            let mean = sums[k] / n as f64;
            assert!((mean / f64::from(want[k]) - 1.0).abs() < 0.02, "{mean} {}", want[k]);
        }
    }
    assert_eq!(NoiseOptions::default().polarization, SpecklePolarization::Unpolarized);
}

/// Light of slits keeps its position and energy beside speckle.
#[test]
fn slits_stay_under_noise() {
    let bare = crate::synthetic::model(1, crate::synthetic::STANDARD);
    let model = PlyModel::from_data(plywave::ply::PlyData { noise: Some(spectrum().clone()), ..bare }).unwrap();
    let slit = Slit::new(2.0, 1.0, &GaussianBeam { w0_um: 5.0, lambda_um: 0.55, d_cut_um: 10.0 }).unwrap();
    let (theta_i, h_um, lambda_um) = (0.2f32, 5.0, [0.45, 0.65]);
    let smooth = PlyQuery { slit: Some(&slit), ..PlyQuery::new(theta_i, h_um, [0.0, 0.01], lambda_um) };
    let forward = [0.0, -theta_i.cos(), -theta_i.sin()];
    let without = model.at(&PlyQuery { slit: None, ..smooth }).eval(forward);
    let want = model.at(&smooth).eval(forward);
    assert!(want[0] > 1.2 * without[0], "the slit must show: {want:?} {without:?}");
    let n = 100_000;
    let mut sums = [0.0f64; 2];
    for i in 0..n {
        let f = model.at(&PlyQuery { place: Some(place(i)), ..smooth }).eval(forward);
        (0..2).for_each(|k| sums[k] += f64::from(f[k]));
    }
    for k in 0..2 {
        let mean = sums[k] / n as f64;
        assert!((mean / f64::from(want[k]) - 1.0).abs() < 0.02, "{mean} {}", want[k]);
    }
}
