//! Tests of speckle noise.
//! 1. References: independently drawn fields of known contrast and covariance are recovered; the statistics
//!    of N over directions, wavelengths and places match closed forms.
//! 2. Requirements of renderers: mean 1, memory effect, no seams, no grid, no panics, footprints.
//! 3. Files.

use plywave::frame::direction;
use plywave::gap::Slit;
use plywave::ply::{FibersAround, PlyPlace};
use plywave::spec::GaussianBeam;
use plywave::speckle::{NoiseField, NoiseSpectrum, SpecklePatterns, SpecklePolarization, SpeckleSide};
use plywave::{Bsdf, PlyModel, PlyQuery};
use plywave_fit::speckle::{
    FieldModel, NoiseContrast, NoiseOptions, PatternCovariance, compare_lines, intensity_covariance, noise_spectrum,
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

/// Noise of half developed reflection and of fully developed high-order light, fitted once.
fn spectrum() -> &'static NoiseSpectrum {
    static SPECTRUM: OnceLock<NoiseSpectrum> = OnceLock::new();
    SPECTRUM.get_or_init(|| noise_spectrum(&patterns([0.4, 1.0]), &options(), "planted").unwrap().0)
}

fn around() -> FibersAround {
    FibersAround { count: 9.0, ring_um: 20.0 }
}

fn field() -> NoiseField {
    spectrum().field(around())
}

fn options() -> NoiseOptions {
    NoiseOptions::default()
}

/// A place on ply i.
fn place(i: u64) -> PlyPlace {
    PlyPlace::new(i as u32, 0.3, 17.0)
}

/// N of f_refl and f_high at one wavelength.
fn both(field: &NoiseField, place: &PlyPlace, h_um: f32, wo: [f32; 3], lambda_um: f64) -> [f64; 2] {
    let (refl, high) = field.factors(place, h_um, 0.0, wo, [lambda_um as f32]);
    [refl[0], high[0]].map(f64::from)
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
    assert!(plywave_fit::speckle::check_savable(&empty(0.1), &NoiseOptions { w0_um: 999.0, ..wide }, "").is_ok());
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

/// The mean over places is 1 within 0.005 in any direction, at any wavelength and footprint, on the seams
/// too; the contrast is that of the share, and less by the footprint.
#[test]
fn mean_over_places_is_one() {
    let (field, spectrum) = (field(), spectrum());
    let count = 400_000u32;
    for (sin_theta, phi, footprint_um) in [
        (0.0, 1.5 * PI, 0.0),
        (0.0, 0.5 * PI, 0.0),
        (0.7, 0.5 * PI + 0.02, 0.0),
        (-0.4, 2.0, 0.0),
        (0.99, 0.3, 0.0),
        (0.9999, 0.5 * PI + 0.05, 0.0),
        (0.3, 5.9, 5.0),
        (0.3, 5.9, 30.0),
    ] {
        let wo = at(sin_theta, phi);
        let (mut sums, mut squares) = ([[0.0f64; 2]; 2], [[0.0f64; 2]; 2]);
        for i in 0..count {
            let azimuth = 0.618_034 * i as f32 % TAU as f32;
            let place = PlyPlace { footprint_um, ..PlyPlace::new(i, azimuth, 3.7 * i as f32 % 1000.0) };
            let (refl, high) = field.factors(&place, (i % 30) as f32 - 15.0, 0.3, wo, [0.4, 0.7]);
            for (kind, n) in [refl, high].into_iter().enumerate() {
                for k in 0..2 {
                    sums[kind][k] += f64::from(n[k]);
                    squares[kind][k] += (f64::from(n[k]) - 1.0).powi(2);
                }
            }
        }
        for kind in 0..2 {
            for k in 0..2 {
                let n = f64::from(count);
                let (mean, variance) = (sums[kind][k] / n, squares[kind][k] / n);
                let case = format!("{kind} {k} at {sin_theta} {phi} {footprint_um}");
                assert!((mean - 1.0).abs() < 0.005, "{case}: mean {mean} +- {}", (variance / n).sqrt());
                let b = spectrum.share[kind];
                let want = b * (2.0 - b);
                if footprint_um > 0.0 {
                    assert!(variance < 0.97 * want, "{case}: variance {variance} of {want}");
                } else {
                    // The fourth moment of an exponential variable is 9; sources repeat 512 sizes.
                    let limit = 5.0 * (8.0 / n).sqrt() * want + 0.01 * want;
                    assert!((variance - want).abs() < limit, "{case}: variance {variance}, want {want} +- {limit}");
                }
            }
        }
    }
}

/// The mean over places of the product of N - 1 of two looks, each at a place, an offset, a direction and a
/// wavelength that are drawn together, and its standard error.
type Looked = (PlyPlace, f32, [f32; 3], f64);

fn product(field: &NoiseField, kind: usize, draw: &mut dyn FnMut() -> [Looked; 2]) -> (f64, f64) {
    let (mut sum, mut square, n) = (0.0, 0.0, 40_000);
    for _ in 0..n {
        let [a, b] = draw().map(|(place, h_um, wo, lambda)| both(field, &place, h_um, wo, lambda)[kind] - 1.0);
        sum += a * b;
        square += (a * b).powi(2);
    }
    let n = f64::from(n);
    (sum / n, (square / n - (sum / n).powi(2)).sqrt() / n.sqrt())
}

/// The contrast is that of the patterns and of the model; the covariances along the azimuth, along the ply's
/// frequency and over the wavelength are the closed forms.
#[test]
fn covariances_over_directions_and_wavelengths_are_the_models() {
    let (noise, kinds) = noise_spectrum(&patterns([0.4, 1.0]), &options(), "planted").unwrap();
    let field = noise.field(around());
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for (k, kind) in kinds.iter().enumerate() {
        let variance = kind.measured.variance().min(1.0);
        let mut hold = |case: String, want: f64, b: &mut dyn FnMut(f64, f64) -> ([f32; 3], f64), lambda: f64| {
            let (got, se) = product(&field, k, &mut || {
                let place = place(rng.random());
                // Near the equator arcs are azimuths.
                let (v, phi) = (0.04 * (rng.random::<f64>() - 0.5), 2.2 + 1.2 * rng.random::<f64>());
                let (wo, other) = b(v, phi);
                [(place, 3.0, at(v, phi), lambda), (place, 3.0, wo, other)]
            });
            // The sources of a place stand for all to some hundredths.
            let limit = 5.0 * se + 0.03 * variance;
            assert!((got - want).abs() < limit, "{k} {lambda} {case}: {got}, want {want} +- {limit}");
        };
        for lambda in [0.4f64, 0.6] {
            hold("itself".into(), variance, &mut |v, phi| (at(v, phi), lambda), lambda);
            let stretch = 0.4 / lambda;
            for lag in [0.01, 0.02, 0.035, 0.06] {
                let want = kind.model.covariance(lag * stretch);
                hold(format!("azimuth {lag}"), want, &mut |v, phi| (at(v, phi + lag), lambda), lambda);
                // exp(-(k w0 q)^2 / 8) of the beam's waist.
                let q = 0.5 * lag;
                let mu = (-(TAU / lambda * options().w0_um * q).powi(2) / 8.0).exp();
                let want = intensity_covariance(kind.model.share, mu);
                hold(format!("along {q}"), want, &mut |v, phi| (at(v + q, phi), lambda), lambda);
            }
        }
        // Over the wavelength, phases differ by the angle to where all are the same.
        for (other, phi) in [(0.402, 2.2f64), (0.41, 2.2), (0.42, 1.8), (0.43, 2.2)] {
            let from = if k == 0 { phi - 0.5 * PI } else { phi - 1.5 * PI };
            let mu = noise.correlation(k, from * (1.0 - 0.4 / other), 0.4);
            let want = intensity_covariance(noise.share[k], mu);
            let (got, se) = product(&field, k, &mut || {
                let place = place(rng.random());
                [(place, 3.0, at(0.0, phi), 0.4), (place, 3.0, at(0.0, phi), other)]
            });
            let limit = 5.0 * se + 0.03 * variance;
            assert!((got - want).abs() < limit, "{k} {other} at {phi}: {got}, want {want} +- {limit}");
        }
    }
}

/// Correlation of the field at two rows, the mean over where the first lies, by the blend's definition.
fn across(rows: f64) -> [f64; 2] {
    let angle = |t: f64| {
        let t = (2.0 * t - 0.5).clamp(0.0, 1.0);
        0.5 * PI * t * t * (3.0 - 2.0 * t)
    };
    let n = 2000;
    let mut sums = [0.0; 2];
    for i in 0..n {
        let p = (f64::from(i) + 0.5) / f64::from(n);
        let q = p + rows;
        let rho = match q.floor() as i32 {
            0 => (angle(q) - angle(p)).cos(),
            1 => angle(p).sin() * angle(q - 1.0).cos(),
            _ => 0.0,
        };
        sums = [sums[0] + rho / f64::from(n), sums[1] + rho * rho / f64::from(n)];
    }
    sums
}

/// Along the fiber the covariance falls as the beam's, `|rho|^2 = exp(-(d / w0)^2)`, and from fiber to fiber
/// as the blend's; in directions of the grid of places that are turned by 37 degrees it is the product.
#[test]
fn covariances_over_places_are_the_beams_on_any_grid() {
    let (field, spectrum) = (field(), spectrum());
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    // A step of one row of offsets at the middle of the ply.
    let row_um = TAU as f32 / 9.0 * 20.0;
    for kind in 0..2 {
        let b = spectrum.share[kind];
        for turn_deg in [0.0f64, 37.0, 90.0] {
            let (sin, cos) = turn_deg.to_radians().sin_cos();
            for step in [0.0, 0.25, 0.5, 0.8, 1.2, 2.5] {
                let (along, rows) = (step * cos, step * sin);
                let e = (-0.5 * along * along).exp();
                let [rho, rho2] = across(rows);
                let want = 2.0 * b * (1.0 - b) * e * rho + b * b * e * e * rho2;
                let wo = at(0.3, 2.5);
                let (got, se) = product(&field, kind, &mut || {
                    // About the middle of the ply, where rows are even: the azimuth takes the step.
                    let azimuth = TAU as f32 * rng.random::<f32>();
                    let from = PlyPlace::new(rng.random::<u32>() % 100, azimuth, 1e4 * rng.random::<f32>());
                    let to = PlyPlace {
                        azimuth: azimuth + rows as f32 * row_um / 20.0,
                        along_um: from.along_um + (spectrum.w0_um * along) as f32,
                        ..from
                    };
                    [(from, 2.0, wo, 0.55), (to, 2.0, wo, 0.55)]
                });
                // The window is within 0.006 of the Gaussian.
                let limit = 5.0 * se + 0.006 * b + 0.01 * b * (2.0 - b);
                let case = format!("{kind}, {step} at {turn_deg}");
                assert!((got - want).abs() < limit, "{case}: {got}, want {want} +- {limit}");
            }
        }
    }
}

/// N over a square grid of places on the ply, and over the same grid turned by 37 degrees: the same mean,
/// contrast and covariance of neighbors.
#[test]
fn a_turned_grid_of_places_has_the_same_statistics() {
    let field = field();
    let (side, step_um) = (250, 1.5);
    let statistics = |turn: f64, ply: u32| -> [f64; 6] {
        let (sin, cos) = turn.sin_cos();
        let mut n = [vec![], vec![]];
        for i in 0..side {
            for j in 0..side {
                let (x, y) = (step_um * f64::from(i), step_um * f64::from(j));
                let (along, round) = (cos * x - sin * y, sin * x + cos * y);
                let place = PlyPlace::new(ply, (round / 20.0) as f32, along as f32);
                let v = both(&field, &place, 0.0, at(0.2, 4.0), 0.55);
                (0..2).for_each(|k| n[k].push(v[k]));
            }
        }
        let at = |k: usize, d: usize| {
            let count = n[k].len() - d;
            (0..count).map(|i| (n[k][i] - 1.0) * (n[k][i + d] - 1.0)).sum::<f64>() / count as f64
        };
        let mean = |k: usize| n[k].iter().sum::<f64>() / n[k].len() as f64;
        // Neighbors along both axes of the grid, together.
        let near = |k: usize| 0.5 * (at(k, 1) + at(k, side as usize));
        [mean(0), at(0, 0), near(0), mean(1), at(1, 0), near(1)]
    };
    // Each grid holds some hundred grains: over 60 plies their statistics are known to some hundredths.
    let over = |turn: f64| {
        let all: Vec<[f64; 6]> = (0..60).map(|ply| statistics(turn, ply)).collect();
        let n = all.len() as f64;
        let mean: [f64; 6] = std::array::from_fn(|k| all.iter().map(|s| s[k]).sum::<f64>() / n);
        let se: [f64; 6] =
            std::array::from_fn(|k| (all.iter().map(|s| (s[k] - mean[k]).powi(2)).sum::<f64>() / n / (n - 1.0)).sqrt());
        (mean, se)
    };
    let ((even, even_se), (turned, turned_se)) = (over(0.0), over(37f64.to_radians()));
    for k in 0..6 {
        let limit = 5.0 * even_se[k].hypot(turned_se[k]);
        assert!((even[k] - turned[k]).abs() < limit, "{k}: {} {} +- {limit}", even[k], turned[k]);
        assert!(limit < 0.2, "{k}: known to {limit}");
    }
}

/// No step of place, as small as it may be, changes N by more than its share: at the cells along a fiber,
/// where fibers meet, and where the ply closes around.
#[test]
fn patterns_change_smoothly_with_the_place() {
    let field = field();
    let mut rng = Pcg64Mcg::seed_from_u64(9);
    let mut worst = [0.0f64; 3];
    for i in 0..60_000u64 {
        let mut from = PlyPlace::new(i as u32 / 100, TAU as f32 * rng.random::<f32>(), 1e3 * rng.random::<f32>());
        let h_um = 30.0 * rng.random::<f32>() - 15.0;
        // A third of them about the start of all azimuths.
        if i % 3 == 0 {
            from.azimuth = (h_um / 20.0).asin() + 1e-3 * (rng.random::<f32>() - 0.5);
        }
        let (wo, lambda) = (at(1.8 * rng.random::<f64>() - 0.9, TAU * rng.random::<f64>()), 0.45);
        let here = both(&field, &from, h_um, wo, lambda);
        // A thousandth of the waist, of the ring and of a turn.
        let moved = [
            both(&field, &PlyPlace { along_um: from.along_um + 0.01, ..from }, h_um, wo, lambda),
            both(&field, &from, h_um + 0.02, wo, lambda),
            both(&field, &PlyPlace { azimuth: from.azimuth + 0.006, ..from }, h_um, wo, lambda),
        ];
        for (worst, moved) in worst.iter_mut().zip(moved) {
            (0..2).for_each(|k| *worst = worst.max((moved[k] - here[k]).abs() / (1.0 + here[k])));
        }
    }
    // |g| grows by its deviation over a waist, or over the turn of the blend, 9 rows of 3/4 pi a turn; N by
    // twice that of its root; some deviations of it in so many draws.
    println!("{worst:?}");
    assert!(worst[0] < 0.02 && worst[1] < 0.05 && worst[2] < 0.15, "{worst:?}");
}

/// Over a square of places as wide as a footprint the mean of N varies as N of that footprint does, where
/// it is much smaller and much larger than the grains and between.
#[test]
fn footprints_leave_what_their_mean_does() {
    let field = field();
    let wo = at(0.2, 4.0);
    for diameter_um in [3.0f32, 12.0, 40.0] {
        let (mut of_mean, mut of_footprint, plies) = ([0.0; 2], [0.0; 2], 3000);
        for ply in 0..plies {
            let middle = PlyPlace::new(ply, 2.0, 300.0);
            let mut mean = [0.0; 2];
            let side = 12;
            for i in 0..side {
                for j in 0..side {
                    let off = |i: i32| diameter_um * ((i as f32 + 0.5) / side as f32 - 0.5);
                    let place = PlyPlace { along_um: middle.along_um + off(i), ..middle };
                    let n = both(&field, &place, off(j).clamp(-19.0, 19.0), wo, 0.5);
                    (0..2).for_each(|k| mean[k] += n[k] / f64::from(side * side));
                }
            }
            let footprint = PlyPlace { footprint_um: diameter_um, ..middle };
            let n = both(&field, &footprint, 0.0, wo, 0.5);
            for k in 0..2 {
                of_mean[k] += (mean[k] - 1.0).powi(2) / f64::from(plies);
                of_footprint[k] += (n[k] - 1.0).powi(2) / f64::from(plies);
            }
        }
        for k in 0..2 {
            let ratio = (of_footprint[k] / of_mean[k]).sqrt();
            println!("{diameter_um} um, {k}: {:.3} of the mean, {ratio:.3} of it", of_mean[k].sqrt());
            assert!((ratio - 1.0).abs() < 0.25, "{diameter_um} um, {k}: contrast {ratio} of that of the mean");
        }
    }
    // Far away there is none.
    let far = PlyPlace { footprint_um: 1e5, ..place(1) };
    assert_eq!(field.factors(&far, 0.0, 0.0, wo, [0.5]), ([1.0], [1.0]));
}

/// Correlation of patterns, of which the values of each place lie one after the other, about the mean of the
/// place.
fn pattern_correlation(x: &[f64], y: &[f64], of_place: usize) -> f64 {
    let about_mean = |x: &[f64]| -> Vec<f64> {
        let mean = |chunk: &[f64]| chunk.iter().sum::<f64>() / chunk.len() as f64;
        x.chunks(of_place).flat_map(|chunk| chunk.iter().map(|v| v - mean(chunk)).collect::<Vec<_>>()).collect()
    };
    correlation(&about_mean(x), &about_mean(y))
}

/// Reflection moves with the light: at theta_i + d the pattern is at the sin theta_o that keeps q_z.
/// High-order light does not move.
#[test]
fn reflection_remembers_and_high_order_light_does_not() {
    let field = field();
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    for (theta, d) in [(0.0f64, 15f64.to_radians()), (-0.4, 0.1), (0.6, -0.3)] {
        let shift = (theta + d).sin() - theta.sin();
        let (mut before, mut moved, mut stayed) = ([vec![], vec![]], [vec![], vec![]], [vec![], vec![]]);
        for i in 0..20_000 {
            let (v, phi) = (1.2 * (rng.random::<f64>() - 0.5), TAU * rng.random::<f64>());
            let look = |theta: f64, wo| {
                let (refl, high) = field.factors(&place(i / 200), 3.0, theta as f32, wo, [0.55]);
                [refl[0], high[0]].map(f64::from)
            };
            let looks = [look(theta, at(v, phi)), look(theta + d, at(v - shift, phi)), look(theta + d, at(v, phi))];
            for k in 0..2 {
                before[k].push(looks[0][k]);
                moved[k].push(looks[1][k]);
                stayed[k].push(looks[2][k]);
            }
        }
        let (refl, high) = [0, 1].map(|k| pattern_correlation(&before[k], &moved[k], 200)).into();
        assert!(refl > 0.95 && high.abs() < 0.1, "moved {theta} {d}: {refl} {high}");
        let (refl, high) = [0, 1].map(|k| pattern_correlation(&before[k], &stayed[k], 200)).into();
        assert!(refl.abs() < 0.1 && high > 0.999, "stayed {theta} {d}: {refl} {high}");
    }
}

/// No seam, and of high-order light no pole: N changes over 1e-4 rad by no more there than elsewhere.
/// Reflection has its pole on the ply's axis, where there is hardly any light.
#[test]
fn patterns_are_continuous_everywhere() {
    let field = field();
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
        let (refl_a, high_a) = field.factors(&place(i), 3.0, 0.2, a, [0.4, 0.55]);
        let (refl_b, high_b) = field.factors(&place(i), 3.0, 0.2, b, [0.4, 0.55]);
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

/// Plies, fibers and kinds of light have patterns of their own.
#[test]
fn plies_fibers_and_kinds_are_independent() {
    let field = field();
    let wo = at(0.1, 4.0);
    let of = |i: u64| both(&field, &place(i), 3.0, wo, 0.4);
    let here: Vec<[f64; 2]> = (0..20_000).map(of).collect();
    // Two fibers on, two waists and a half on, and another ply.
    let others: [Vec<[f64; 2]>; 3] = [(0..20_000)
        .map(|i| both(&field, &PlyPlace { azimuth: 0.3 + 2.0 * TAU as f32 / 9.0, ..place(i) }, 3.0, wo, 0.4))]
    .map(Iterator::collect)
    .into_iter()
    .chain([(0..20_000).map(|i| both(&field, &PlyPlace { along_um: 58.0, ..place(i) }, 3.0, wo, 0.4)).collect()])
    .chain([(1..20_001).map(of).collect()])
    .collect::<Vec<_>>()
    .try_into()
    .unwrap();
    let [refl, high] = [0, 1].map(|k: usize| here.iter().map(|n| n[k]).collect::<Vec<_>>());
    assert!(correlation(&refl, &high).abs() < 0.04, "kinds: {}", correlation(&refl, &high));
    for (i, other) in others.iter().enumerate() {
        for k in 0..2 {
            let other: Vec<f64> = other.iter().map(|n| n[k]).collect();
            let got = correlation([&refl, &high][k], &other);
            assert!(got.abs() < 0.04, "{i}, kind {k}: {got}");
        }
    }
    // Around the ply it is the same again.
    for i in 0..100 {
        let around = PlyPlace { azimuth: 0.3 + TAU as f32, ..place(i) };
        let [a, b] = [place(i), around].map(|place| both(&field, &place, 3.0, wo, 0.4));
        assert!((0..2).all(|k| (a[k] - b[k]).abs() < 1e-3), "{a:?} {b:?}");
    }
}

/// Any input gives a number.
#[test]
fn any_numbers_come_in() {
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, 1e30, -1e30, 1e-40, 1.0, -1.0, 0.55];
    let one = FibersAround { count: 1.0, ring_um: 1.0 };
    for field in [field(), spectrum().field(one)] {
        for (i, &a) in odd.iter().enumerate() {
            for &b in &odd {
                for &c in &odd {
                    let place = PlyPlace { ply: i as u32, azimuth: a, along_um: b, footprint_um: c };
                    let (refl, high) = field.factors(&place, c, c, [a, b, c], [b, a, c, 0.5]);
                    let (more, most) = field.factors(&place, a, a, [0.0, 0.6, 0.8], [a, b, c]);
                    for v in refl.into_iter().chain(high).chain(more).chain(most) {
                        assert!((0.0..1e3).contains(&v), "{a} {b} {c}: {v}");
                    }
                }
            }
        }
        assert_eq!(field.factors(&place(1), 0.0, 0.0, [f32::NAN; 3], [0.5]), ([1.0], [1.0]));
        assert_eq!(field.factors(&place(1), 0.0, 0.0, [0.0, 1.0, 0.0], []), ([], []));
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
