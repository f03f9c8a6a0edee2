//! Statistics of speckle noise over directions, wavelengths and places beside closed forms, and what
//! renderers ask of it: mean 1, memory effect, no seams, no grid, no panics, footprints.

use crate::speckle::{around, at, both, correlation, field, options, patterns, place, spectrum};
use plywave::ply::{FibersAround, PlyPlace};
use plywave::speckle::NoiseField;
use plywave_wave::noise::{intensity_covariance, noise_spectrum};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

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
