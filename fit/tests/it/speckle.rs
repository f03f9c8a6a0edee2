//! Tests of noise tiles.
//! 1. References: independently drawn fields of known contrast and covariance are recovered; the tiles'
//!    statistics match the closed form.
//! 2. Requirements of renderers: mean 1, memory effect, no seams, no panics.
//! 3. Files.

use plywave::frame::direction;
use plywave::gap::Slit;
use plywave::spec::GaussianBeam;
use plywave::speckle::{Instance, Noise, NoiseSpectrum, NoiseTiles, SpecklePatterns, SpecklePolarization, SpeckleSide};
use plywave::{Bsdf, PlyModel, PlyQuery};
use plywave_fit::speckle::{
    FieldModel, NoiseContrast, NoiseOptions, PatternCovariance, compare_lines, intensity_covariance, noise_tiles,
};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};
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
fn patterns(shares: [f64; 2]) -> SpecklePatterns {
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

/// Tiles of half developed reflection and of fully developed high-order light, synthesized once.
fn tiles() -> &'static NoiseTiles {
    static TILES: OnceLock<NoiseTiles> = OnceLock::new();
    TILES.get_or_init(|| spectrum().tiles())
}

/// Spectrum of these tiles.
fn spectrum() -> NoiseSpectrum {
    noise_tiles(&patterns([0.4, 1.0]), &options(), "planted").unwrap().0
}

fn options() -> NoiseOptions {
    NoiseOptions { tiles: 2, rows: 256, columns: 512, ..NoiseOptions::default() }
}

fn instance(i: u64) -> Instance {
    Instance::from_hash(i)
}

/// A direction at v = sin theta_o and azimuth phi_o.
fn at(sin_theta: f64, phi: f64) -> [f32; 3] {
    direction(sin_theta.clamp(-1.0, 1.0).asin() as f32, phi as f32)
}

fn correlation(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let sum = |f: &dyn Fn(f64, f64) -> f64| x.iter().zip(y).map(|(x, y)| f(x - mx, y - my)).sum::<f64>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

/// Noise that cannot be saved is refused before the work: the patterns here have no light.
#[test]
#[ignore = "slow: 5 s: what cannot be saved is refused before the work"]
fn what_cannot_be_saved_is_refused_before_the_work() {
    let empty =
        |lambda_um: f64| SpecklePatterns { lambda_um: vec![lambda_um], patterns: Vec::new(), ..patterns([0.4, 1.0]) };
    let refuse = |lambda_um: f64, options: NoiseOptions, words: &[&str]| {
        let message = noise_tiles(&empty(lambda_um), &options, "x.pws").unwrap_err().to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    };
    // Waves for which a tile is too coarse or too fine, with the accepted waists.
    let wide = NoiseOptions { w0_um: 1e4, ..options() };
    refuse(0.1, wide.clone(), &["x.pws", "w0_um = 10000", "waist 0.001 to 6625.259"]);
    assert!(plywave_fit::speckle::check_savable(&empty(0.1), &NoiseOptions { w0_um: 6600.0, ..wide }, "").is_ok());
    refuse(1e3, NoiseOptions { w0_um: 0.5, ..options() }, &["w0_um = 0.5", "waist 6.6"]);
    refuse(200.0, options(), &["noise_lambda_um", "200"]);
    refuse(0.4, NoiseOptions { rows: 300, ..options() }, &["noise_sizes", "powers of two"]);
    refuse(0.4, NoiseOptions { tiles: 256, rows: 4096, ..options() }, &["noise_sizes", "values at most"]);
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

/// Patterns without dark fibers, or of one instance, are refused; the tiles depend on the seed alone.
#[test]
fn patterns_are_checked_and_seeds_count() {
    let mut p = patterns([0.4, 1.0]);
    p.kappa.truncate(1);
    let error = noise_tiles(&p, &options(), "x.pws").unwrap_err().to_string();
    assert!(error.contains("x.pws: kappa") && error.contains("--kappa"), "{error}");
    let small = NoiseOptions { tiles: 1, rows: 16, columns: 16, ..options() };
    let p = patterns([0.4, 1.0]);
    let made = |options: &NoiseOptions| noise_tiles(&p, options, "x").unwrap().0;
    assert_eq!(made(&small), made(&small));
    assert_ne!(made(&small).tiles().tiles, made(&NoiseOptions { seed: 2, ..small.clone() }).tiles().tiles);
    // Light that does not vary has tiles of 1.
    let mut flat = p.clone();
    flat.patterns.fill(1.0);
    assert!(made_of(&flat, &small).tiles().tile(1, 0).iter().all(|v| *v == 1.0));
}

fn made_of(p: &SpecklePatterns, options: &NoiseOptions) -> NoiseSpectrum {
    noise_tiles(p, options, "x").unwrap().0
}

/// The mean over instances is 1 within 0.005 in any direction and at any wavelength, on the seams too.
#[test]
fn mean_over_instances_is_one() {
    let tiles = tiles();
    let count = 400_000u64;
    for (sin_theta, phi) in
        [(0.0, 1.5 * PI), (0.0, 0.5 * PI), (0.7, 0.5 * PI + 0.02), (-0.4, 2.0), (0.99, 0.3), (0.3, 5.9)]
    {
        let wo = at(sin_theta, phi);
        let mut sums = [[0.0f64; 2]; 2];
        let mut squares = [0.0f64; 2];
        for i in 0..count {
            let (refl, high) = tiles.factors(instance(i), 0.3, wo, [0.4, 0.7]);
            for k in 0..2 {
                sums[0][k] += f64::from(refl[k]);
                sums[1][k] += f64::from(high[k]);
            }
            squares[0] += f64::from(refl[0]).powi(2);
            squares[1] += f64::from(high[0]).powi(2);
        }
        for (kind, sums) in sums.iter().enumerate() {
            let n = count as f64;
            let se = ((squares[kind] / n - (sums[0] / n).powi(2)) / n).sqrt();
            for sum in sums {
                assert!((sum / n - 1.0).abs() < 0.005, "{kind} at {sin_theta} {phi}: {} +- {se}", sum / n);
            }
        }
    }
}

/// By lookups, the contrast is that of the tiles' report and of the model; the covariances along the azimuth
/// and along the ply are the closed forms, at two wavelengths.
#[test]
fn looked_up_statistics_are_the_models() {
    // Large tiles: their own statistics are those of so many grains.
    let (noise, kinds) = noise_tiles(&patterns([0.4, 1.0]), &NoiseOptions::default(), "planted").unwrap();
    let tiles = noise.tiles();
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for lambda in [0.4f64, 0.6] {
        for (k, kind) in kinds.iter().enumerate() {
            let pairs = |dphi: f64, dv: f64, rng: &mut Pcg64Mcg| -> f64 {
                let n = 40_000u64;
                let mut sum = 0.0;
                for _ in 0..n {
                    let i = instance(rng.random());
                    // Near the equator arcs are azimuths.
                    let (v, phi) = (0.04 * (rng.random::<f64>() - 0.5), 2.2 + 1.2 * rng.random::<f64>());
                    let look = |wo| {
                        let (refl, high) = tiles.factors(i, 0.0, wo, [lambda as f32]);
                        f64::from(if k == 0 { refl[0] } else { high[0] })
                    };
                    sum += (look(at(v, phi)) - 1.0) * (look(at(v + dv, phi + dphi)) - 1.0);
                }
                sum / n as f64
            };
            let variance = pairs(0.0, 0.0, &mut rng);
            let claimed = kind.contrast.powi(2);
            assert!((variance / claimed - 1.0).abs() < 0.05, "{k} {lambda}: variance {variance} claimed {claimed}");
            assert!((variance.sqrt() / kind.measured.contrast() - 1.0).abs() < 0.05, "{k}: {variance}");
            let stretch = 0.4 / lambda;
            for lag in [0.01, 0.02, 0.035, 0.06] {
                let want = kind.model.covariance(lag * stretch);
                let got = pairs(lag, 0.0, &mut rng);
                assert!((got - want).abs() < 0.06 * variance, "{k} {lambda} azimuth {lag}: {got} {want} of {variance}");
                // exp(-(k w0 q)^2 / 8) of the beam's waist.
                let q = 0.5 * lag;
                let mu = (-(TAU / lambda * options().w0_um * q).powi(2) / 8.0).exp();
                let want = intensity_covariance(kind.model.share, mu);
                let got = pairs(0.0, q, &mut rng);
                assert!((got - want).abs() < 0.06 * variance, "{k} {lambda} along {q}: {got} {want} of {variance}");
            }
        }
    }
}

/// Reflection moves with the light: at theta_i + d the pattern is at the sin theta_o that keeps q_z.
/// High-order light does not move.
#[test]
fn reflection_remembers_and_high_order_light_does_not() {
    let tiles = tiles();
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    for (theta, d) in [(0.0f64, 15f64.to_radians()), (-0.4, 0.1), (0.6, -0.3)] {
        let shift = (theta + d).sin() - theta.sin();
        let (mut before, mut moved, mut stayed) = ([vec![], vec![]], [vec![], vec![]], [vec![], vec![]]);
        for _ in 0..4000 {
            let (v, phi) = (1.2 * (rng.random::<f64>() - 0.5), TAU * rng.random::<f64>());
            let look = |theta: f64, wo| {
                let (refl, high) = tiles.factors(instance(9), theta as f32, wo, [0.55]);
                [refl[0], high[0]].map(f64::from)
            };
            let looks = [look(theta, at(v, phi)), look(theta + d, at(v - shift, phi)), look(theta + d, at(v, phi))];
            for k in 0..2 {
                before[k].push(looks[0][k]);
                moved[k].push(looks[1][k]);
                stayed[k].push(looks[2][k]);
            }
        }
        let (refl, high) = (correlation(&before[0], &moved[0]), correlation(&before[1], &moved[1]));
        assert!(refl > 0.95 && high.abs() < 0.1, "moved {theta} {d}: {refl} {high}");
        let (refl, high) = (correlation(&before[0], &stayed[0]), correlation(&before[1], &stayed[1]));
        assert!(refl.abs() < 0.1 && high > 0.999, "stayed {theta} {d}: {refl} {high}");
    }
}

/// No seam, and of high-order light no pole: N changes over 1e-4 rad by no more there than elsewhere.
/// Reflection has its pole on the ply's axis, where there is hardly any light.
#[test]
fn patterns_are_continuous_everywhere() {
    let tiles = tiles();
    let mut rng = Pcg64Mcg::seed_from_u64(6);
    let mut worst = [0.0f32; 2];
    for i in 0..20_000 {
        let tilt = 1e-4 * (rng.random::<f64>() - 0.5);
        // Half of them across the seams or about the pole.
        let (a, b) = match i % 4 {
            0 => (at(0.8 * (rng.random::<f64>() - 0.5), 0.5 * PI - tilt), [0.0; 3]),
            1 => (at(0.8 * (rng.random::<f64>() - 0.5), 1.5 * PI - tilt), [0.0; 3]),
            2 => (at(1.0 - 1e-9, TAU * rng.random::<f64>()), [0.0; 3]),
            _ => (at(2.0 * rng.random::<f64>() - 1.0, TAU * rng.random::<f64>()), [0.0; 3]),
        };
        // A direction 1e-4 away.
        let b = if b == [0.0; 3] {
            let d: [f32; 3] = std::array::from_fn(|_| 1e-4 * (rng.random::<f32>() - 0.5));
            let v: [f32; 3] = std::array::from_fn(|k| a[k] + d[k]);
            let norm = v.iter().map(|v| v * v).sum::<f32>().sqrt();
            v.map(|v| v / norm)
        } else {
            b
        };
        let (refl_a, high_a) = tiles.factors(instance(i), 0.2, a, [0.4, 0.55]);
        let (refl_b, high_b) = tiles.factors(instance(i), 0.2, b, [0.4, 0.55]);
        for k in 0..2 {
            if a[2].abs() < 0.99 {
                worst[0] = worst[0].max((refl_a[k] - refl_b[k]).abs());
            }
            worst[1] = worst[1].max((high_a[k] - high_b[k]).abs());
        }
    }
    // Grains are 0.01 rad and wider and reach N = 10 or so.
    assert!(worst[0] < 0.1 && worst[1] < 0.25, "{worst:?}");
}

/// Points of one grain have the same instance, others do not; a ply has many.
#[test]
fn instances_are_told_by_ply_and_grain() {
    let of = |ply: u32, along: f32, h: f32| format!("{:?}", Instance::new(ply, [along, h], 20.0));
    // Rows of 20 um across, about h = 0; along each, a grain begins every 20 um, in other rows elsewhere.
    let mut first = std::collections::HashSet::new();
    for row in -4..=4 {
        let h = 20.0 * row as f32;
        let begins: Vec<f32> =
            (1..4000).map(|k| 0.1 * k as f32).filter(|x| of(3, *x, h) != of(3, x - 0.1, h)).collect();
        assert!((19..=20).contains(&begins.len()), "{begins:?}");
        assert!(begins.windows(2).all(|w| (w[1] - w[0] - 20.0).abs() < 0.15), "{begins:?}");
        first.insert((10.0 * begins[0]) as i32);
        assert_eq!(of(3, 41.0, h - 9.9), of(3, 41.0, h + 9.9));
        assert_ne!(of(3, 41.0, h), of(3, 41.0, h + 10.1));
        assert_ne!(of(3, 41.0, h), of(4, 41.0, h));
        assert_ne!(of(3, 41.0, h), of(3, -41.0, h));
    }
    assert!(first.len() > 6, "{first:?}");
    let many: std::collections::HashSet<String> =
        (0..100_000).map(|p| of(1, 20.0 * (p / 10) as f32, 20.0 * (p % 10) as f32)).collect();
    assert_eq!(many.len(), 100_000);
    assert_eq!(Instance::new(1, [5.0, 3.0], 0.0), Instance::new(1, [f32::NAN; 2], f32::NAN));
    let tiles = tiles();
    let look = |i: u64, wo| f64::from(tiles.factors(instance(i), 0.0, wo, [0.4]).1[0]);
    let (a, b): (Vec<f64>, Vec<f64>) = (0..20_000).map(|i| (look(i, at(0.1, 4.0)), look(i, at(0.1, 4.6)))).unzip();
    assert!(correlation(&a, &b).abs() < 0.05, "{}", correlation(&a, &b));
    // Both kinds of an instance are independent.
    let both: (Vec<f64>, Vec<f64>) = (0..20_000)
        .map(|i| {
            let (refl, high) = tiles.factors(instance(i), 0.0, at(0.1, 4.0), [0.4]);
            (f64::from(refl[0]), f64::from(high[0]))
        })
        .unzip();
    assert!(correlation(&both.0, &both.1).abs() < 0.05);
}

/// Any input gives a number.
#[test]
fn any_numbers_come_in() {
    let tiles = tiles();
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, 1e30, -1e30, 1e-40, 1.0, -1.0, 0.55];
    for (i, &a) in odd.iter().enumerate() {
        for &b in &odd {
            for &c in &odd {
                let (refl, high) = tiles.factors(Instance::new(i as u32, [a, c], b), c, [a, b, c], [b, a, c, 0.5]);
                let (more, most) = tiles.factors(Instance::from_hash(u64::MAX), a, [0.0, 0.6, 0.8], [a, b, c]);
                for v in refl.into_iter().chain(high).chain(more).chain(most) {
                    assert!((0.0..1e3).contains(&v), "{a} {b} {c}: {v}");
                }
            }
        }
    }
    assert_eq!(tiles.factors(instance(1), 0.0, [f32::NAN; 3], [0.5]), ([1.0], [1.0]));
    assert_eq!(tiles.factors(instance(1), 0.0, [0.0, 1.0, 0.0], []), ([], []));
}

/// A model keeps its noise in its file, in 20 kB at the standard sizes, and synthesizes the tiles from it;
/// tiles of earlier files stay the same; a model without noise reports none; broken noise is refused.
#[test]
#[ignore = "slow: 5 s: models keep their noise"]
fn models_keep_their_noise() {
    let bare = crate::synthetic::model(1, crate::synthetic::STANDARD);
    let with = |noise: Noise| plywave::ply::PlyData { noise: Some(noise), ..bare.clone() };
    let smooth = bare.to_bytes().unwrap().len();
    for noise in [Noise::from(spectrum()), tiles().clone().into()] {
        let data = with(noise.clone());
        let bytes = data.to_bytes().unwrap();
        let back = PlyModel::from_bytes(&bytes, "m.pwm").unwrap();
        assert_eq!(back.data().noise, Some(noise));
        assert_eq!(back.noise(), Some(tiles()));
        assert_eq!(back.clone().noise(), Some(tiles()));
        assert!(back.require_noise("m.pwm").is_ok());
        assert_eq!(back.data().to_bytes().unwrap(), bytes);
    }
    let standard = noise_tiles(&patterns([0.4, 1.0]), &NoiseOptions::default(), "planted").unwrap().0;
    let bytes = with(standard.clone().into()).to_bytes().unwrap();
    assert!(bytes.len() < smooth + 20_000, "{} {smooth}", bytes.len());
    let none = PlyModel::from_data(bare.clone()).unwrap();
    let error = none.require_noise("m.pwm").unwrap_err().to_string();
    assert!(error.contains("m.pwm: noise_spectrum") && error.contains("plywave noise"), "{error}");
    let spoils: [fn(&mut NoiseTiles); 6] = [
        |t| t.sizes[1] = 100,
        |t| t.tiles.truncate(9),
        |t| t.tiles[..9000].fill(255),
        |t| t.code[0] = f32::NAN,
        |t| t.step[1][0] = 0.0,
        |t| t.lambda_um = f64::INFINITY,
    ];
    for spoil in spoils {
        let mut noise = tiles().clone();
        spoil(&mut noise);
        assert!(PlyModel::from_data(with(noise.into())).is_err());
    }
    type Spoil = fn(&mut NoiseSpectrum);
    let spoils: [(&str, Spoil); 14] = [
        ("noise_sizes", |s| s.sizes[1] = 100),
        ("noise_sizes", |s| s.sizes[0] = 0),
        ("noise_sizes", |s| s.sizes[0] = 1 << 20),
        ("noise_sizes", |s| s.sizes = [1, 8192, 8192]),
        ("noise_sizes", |s| s.sizes = [usize::MAX; 3]),
        ("noise_spectrum", |s| s.sizes[2] = 256),
        ("noise_spectrum", |s| s.spectrum.truncate(9)),
        ("noise_spectrum", |s| s.spectrum[3] = f32::NAN),
        ("noise_spectrum", |s| s.spectrum[3] = -1e-3),
        ("noise_spectrum", |s| s.spectrum.fill(0.0)),
        ("noise_share", |s| s.share[1] = 1.1),
        ("noise_w0_um", |s| s.w0_um = 0.0),
        ("noise_step", |s| s.step[1][0] = 0.0),
        ("noise_lambda_um", |s| s.lambda_um = f64::INFINITY),
    ];
    for (key, spoil) in spoils {
        let mut noise = spectrum();
        spoil(&mut noise);
        let error = PlyModel::from_data(with(noise.into())).unwrap_err().to_string();
        assert!(error.contains(key), "{key}: {error}");
    }
}

/// The mean of eval over instances is the smooth eval; no instance, or a model without tiles, is the smooth
/// eval itself.
#[test]
fn eval_of_instances_averages_to_the_smooth_model() {
    let bare = crate::synthetic::model(1, crate::synthetic::STANDARD);
    let smooth = PlyModel::from_data(bare.clone()).unwrap();
    let model = PlyModel::from_data(plywave::ply::PlyData { noise: Some(tiles().clone().into()), ..bare }).unwrap();
    let (sigma, lambda) = ([0.0, 0.01], [0.45, 0.65]);
    for (theta_i, h, wo) in [(0.2, 5.0, at(0.1, 2.0)), (-0.5, -20.0, at(0.4, 4.9))] {
        let smooth_query = PlyQuery::new(theta_i, h, sigma, lambda);
        let want = smooth.at(&smooth_query).eval(wo);
        assert_eq!(model.at(&smooth_query).eval(wo), want);
        assert_eq!(smooth.at(&PlyQuery { instance: Some(instance(1)), ..smooth_query }).eval(wo), want);
        let n = 100_000;
        let mut sums = [0.0f64; 2];
        for i in 0..n {
            let f = model.at(&PlyQuery { instance: Some(instance(i)), ..smooth_query }).eval(wo);
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
    let model = PlyModel::from_data(plywave::ply::PlyData { noise: Some(tiles().clone().into()), ..bare }).unwrap();
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
        let f = model.at(&PlyQuery { instance: Some(instance(i)), ..smooth }).eval(forward);
        (0..2).for_each(|k| sums[k] += f64::from(f[k]));
    }
    for k in 0..2 {
        let mean = sums[k] / n as f64;
        assert!((mean / f64::from(want[k]) - 1.0).abs() < 0.02, "{mean} {}", want[k]);
    }
}
