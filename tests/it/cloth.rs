//! The cloth model compared with path tracing of explicit fibers, and its energy by view and by light
//! direction.

use plywave::fabric::FabricOptions;
use plywave::twin::{ClothTwin, ComparisonOptions, Light, compare};
use plywave::{Bsdf, BsdfSample, FabricModel, FabricQuery};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::sync::{Arc, Mutex, OnceLock};

fn folder() -> String {
    format!("{}/fabrics", env!("CARGO_MANIFEST_DIR"))
}

/// Loads each fabric once, in parallel with others.
fn fabric(name: &'static str) -> Arc<FabricModel> {
    type Once = Arc<OnceLock<Arc<FabricModel>>>;
    static LOADED: Mutex<BTreeMap<&str, Once>> = Mutex::new(BTreeMap::new());
    let once = LOADED.lock().unwrap().entry(name).or_default().clone();
    let load = || Arc::new(FabricModel::load(format!("{}/{name}.toml", folder()), &FabricOptions::RAYS).unwrap());
    once.get_or_init(load).clone()
}

/// Limits of the errors of a cloth against its twin: R and T up to 60 degrees, twice that beyond; L2 of the
/// upper half up to 60 degrees and beyond; L2 of the lower half up to 60 degrees where more than 0.05 is
/// transmitted. The targets are 0.015, 0.12 and 0.2; the limits are measured errors, rounded up. Inter-yarn
/// scattering uses random paths, which changes single figures by some 0.003. With models of whole yarns in
/// place of one ply's, the errors of R and T of muslin, denim and worsted are 0.015, 0.036 and 0.026, those
/// of their lower half 0.16, 0.40 and 0.24.
struct Limits {
    name: &'static str,
    light: f64,
    upper: [f64; 2],
    lower: f64,
}

/// Gold, alpaca and glass are held-out cloths.
const LIMITS: [Limits; 9] = [
    Limits { name: "polyester_layers", light: 0.016, upper: [0.09, 0.10], lower: 0.08 },
    Limits { name: "polyester_satin", light: 0.018, upper: [0.11, 0.08], lower: 0.10 },
    Limits { name: "silk_organza", light: 0.024, upper: [0.08, 0.13], lower: 0.11 },
    Limits { name: "cotton_plain", light: 0.014, upper: [0.08, 0.10], lower: 0.10 },
    Limits { name: "cotton_twill", light: 0.0155, upper: [0.10, 0.07], lower: 0.18 },
    Limits { name: "wool_plain", light: 0.0115, upper: [0.08, 0.10], lower: 0.19 },
    Limits { name: "gold_satin", light: 0.030, upper: [0.11, 0.08], lower: 0.22 },
    Limits { name: "alpaca_plain", light: 0.023, upper: [0.115, 0.12], lower: 0.20 },
    Limits { name: "glass_plain", light: 0.041, upper: [0.31, 0.25], lower: 0.42 },
];

/// The shipped cloths are near their shipped twins, `plywave twin fabrics/NAME.toml --paths 120000`: explicit
/// fibers, eight views, three absorptions. The cloth uses ray optics alone, as twins have no diffraction.
fn cloths_are_near_their_twins(name: &'static str) {
    let limits = LIMITS.iter().find(|limits| limits.name == name).unwrap();
    let fabric = fabric(limits.name);
    let twin = ClothTwin::load(format!("{}/twins/{}.pwx", folder(), limits.name)).unwrap();
    // Light up to 60 degrees and beyond, L2 of the upper half alike, of the lower one.
    let (mut light, mut upper, mut lower) = ([0.0f64; 2], [0.0f64; 2], 0.0f64);
    for c in compare(&*fabric, &twin, &ComparisonOptions::default()) {
        let steep = usize::from(twin.view(c.view)[2].abs() < 0.45);
        let passed = |l: &Light| l.transmitted + l.straight;
        let off = (c.model.reflected - c.twin.reflected).abs().max((passed(&c.model) - passed(&c.twin)).abs());
        light[steep] = light[steep].max(off);
        upper[steep] = upper[steep].max(c.upper);
        if c.twin.transmitted > 0.05 && steep == 0 {
            lower = lower.max(c.lower);
        }
    }
    println!("{}: |R|, |T| {light:.3?}, L2 upper {upper:.3?}, lower {lower:.3}", limits.name);
    assert!(light[0] < limits.light && light[1] < 2.0 * limits.light, "{}: {light:?}", limits.name);
    assert!(upper[0] < limits.upper[0] && upper[1] < limits.upper[1], "{}: {upper:?}", limits.name);
    assert!(lower < limits.lower, "{}: {lower}", limits.name);
}

mod cloths_are_near_their_twins {
    use super::cloths_are_near_their_twins as of;
    #[test]
    #[ignore = "slow: 15 s: cloths are near their twins, polyester layers"]
    fn polyester_layers() {
        of("polyester_layers");
    }
    #[test]
    #[ignore = "slow: 25 s: cloths are near their twins, polyester satin"]
    fn polyester_satin() {
        of("polyester_satin");
    }
    #[test]
    #[ignore = "slow: 25 s: cloths are near their twins, silk organza"]
    fn silk_organza() {
        of("silk_organza");
    }
    #[test]
    #[ignore = "slow: 35 s: cloths are near their twins, cotton plain"]
    fn cotton_plain() {
        of("cotton_plain");
    }
    #[test]
    #[ignore = "slow: 50 s: cloths are near their twins, cotton twill"]
    fn cotton_twill() {
        of("cotton_twill");
    }
    #[test]
    #[ignore = "slow: 35 s: cloths are near their twins, wool plain"]
    fn wool_plain() {
        of("wool_plain");
    }
    #[test]
    #[ignore = "slow: 90 s: cloths are near their twins, gold satin"]
    fn gold_satin() {
        of("gold_satin");
    }
    #[test]
    #[ignore = "slow: 30 s: cloths are near their twins, alpaca plain"]
    fn alpaca_plain() {
        of("alpaca_plain");
    }
    #[test]
    #[ignore = "slow: 30 s: cloths are near their twins, glass plain"]
    fn glass_plain() {
        of("glass_plain");
    }
}

/// Positions on a clear cloth, for means.
fn places(fabric: &FabricModel, n: usize) -> impl Iterator<Item = [f32; 2]> {
    let [w, h] = fabric.fabric().repeat_um().map(|r| r * (1.0 + (4000.0 / r).floor()));
    (0..n).map(move |k| {
        let even = |step: f64| (0.5 + k as f64 * step).fract();
        [(w * even(0.898_653_712_6)) as f32, (h * even(0.807_578_495_2)) as f32]
    })
}

fn direction(z: f64, turn: f64) -> [f32; 3] {
    let r = (1.0 - z * z).sqrt();
    [(r * (TAU * turn).cos()) as f32, (r * (TAU * turn).sin()) as f32, z as f32]
}

fn eval(fabric: &FabricModel, at: [f32; 2], wo: [f32; 3], wi: [f32; 3]) -> f64 {
    f64::from(
        fabric.at(&FabricQuery { sigma_per_um: [Some([0.0]); 2], ..FabricQuery::new(at, wo, [0.55]) }).eval(wi)[0],
    )
}

/// A clear cloth conserves energy, from each view and from each light direction, with rays going straight
/// through gaps: diffracted light of grazing views comes from single directions. The target is 0.02 at every
/// cosine.
fn clear_cloths_conserve_energy_both_ways(cloth: &'static str) {
    const N: usize = 60_000;
    for (name, z, by_view_most, by_light_most) in [
        ("polyester_layers", 1.0, 0.02, 0.02),
        ("polyester_layers", 0.8, 0.02, 0.02),
        ("polyester_layers", 0.5, 0.02, 0.02),
        ("polyester_layers", 0.3, 0.02, 0.02),
        ("polyester_layers", 0.15, 0.02, 0.03),
        ("polyester_layers", 0.05, 0.02, 0.02),
        ("polyester_satin", 1.0, 0.02, 0.02),
        ("polyester_satin", 0.5, 0.02, 0.025),
        ("polyester_satin", 0.15, 0.02, 0.03),
        ("polyester_satin", 0.05, 0.02, 0.04),
        ("silk_organza", 1.0, 0.02, 0.025),
        ("silk_organza", 0.5, 0.02, 0.02),
        ("silk_organza", 0.2, 0.02, 0.02),
        ("silk_organza", 0.05, 0.02, 0.04),
        ("cotton_plain", 0.8, 0.02, 0.02),
        ("cotton_plain", 0.3, 0.02, 0.02),
    ] {
        if name != cloth {
            continue;
        }
        let fabric = fabric(name);
        let (mut by_view, mut by_light, mut straight) = (0.0, 0.0, [0.0; 2]);
        for (k, at) in places(&fabric, N).enumerate() {
            let even = |step: f64| (0.5 + k as f64 * step).fract();
            // The other direction, by cosine: half of them on either side.
            let other = even(0.725_731_409_9) * 2.0 - 1.0;
            let other = direction(other.abs().sqrt().max(1e-3).copysign(other), even(0.652_178_999_0));
            let one = direction(z, even(0.586_080_078_4));
            let cos = f64::from(other[2].abs());
            by_view += 2.0 * PI / cos * eval(&fabric, at, one, other) / N as f64;
            by_light += 2.0 * PI / z * eval(&fabric, at, other, one) / N as f64;
            // Straight light is that of the line itself, from either end.
            let query = FabricQuery { sigma_per_um: [Some([0.0]); 2], ..FabricQuery::new(at, one, [0.55]) };
            straight.iter_mut().for_each(|s| *s += f64::from(fabric.at(&query).straight()[0]) / N as f64);
        }
        let [view, light] = [by_view + straight[0], by_light + straight[1]];
        println!("{name}, cosine {z}: {view:.3} by view, {light:.3} by light, of it straight {:.3}", straight[0]);
        assert!((view - 1.0).abs() < by_view_most, "{name}, cosine {z}: {view} by view");
        assert!((light - 1.0).abs() < by_light_most, "{name}, cosine {z}: {light} by light");
    }
}

mod clear_cloths_conserve_energy_both_ways {
    use super::clear_cloths_conserve_energy_both_ways as of;
    #[test]
    fn polyester_layers() {
        of("polyester_layers");
    }
    #[test]
    #[ignore = "slow: 15 s: clear cloths conserve energy both ways, polyester satin"]
    fn polyester_satin() {
        of("polyester_satin");
    }
    #[test]
    #[ignore = "slow: 10 s: clear cloths conserve energy both ways, silk organza"]
    fn silk_organza() {
        of("silk_organza");
    }
    #[test]
    #[ignore = "slow: 15 s: clear cloths conserve energy both ways, cotton plain"]
    fn cotton_plain() {
        of("cotton_plain");
    }
}

/// The mean over a repeat is the same with view and light swapped.
#[test]
fn layers_are_reciprocal() {
    let fabric = fabric("polyester_layers");
    let pairs = [(1.0, 0.5), (0.8, 0.3), (0.7, 0.7), (0.5, -0.6), (0.9, -0.4), (-0.8, -0.5f64)];
    let mut off = 0.0f64;
    for (i, (a, b)) in pairs.into_iter().enumerate() {
        // Cones of some degrees, so that single lobes of the fit do not count.
        let (mut forth, mut back) = (0.0, 0.0);
        for (k, at) in places(&fabric, 20_000).enumerate() {
            let even = |step: f64| (0.5 + k as f64 * step).fract();
            let near = |z: f64, turn: f64, u: f64, v: f64| {
                direction((z + 0.16 * (u - 0.5)).clamp(-1.0, 1.0), turn + 0.1 * (v - 0.5))
            };
            let one = near(a, 0.1, even(0.725_731_409_9), even(0.652_178_999_0));
            let two = near(b, 0.1 + 0.23 * i as f64, even(0.586_080_078_4), even(0.526_680_036_1));
            forth += eval(&fabric, at, one, two) / f64::from(two[2].abs());
            back += eval(&fabric, at, two, one) / f64::from(one[2].abs());
        }
        println!("{a} to {b}: {:.3}", forth / back);
        off = off.max((forth / back - 1.0).abs());
    }
    assert!(off < 0.05, "{off}");
}

/// Sampling covers all light of eval: no sample has a large weight, whatever the position and view, and the
/// energy by samples is that by even directions.
fn samples_cover_what_eval_holds(name: &'static str) {
    const N: usize = 200_000;
    let path = format!("{}/{name}.toml", folder());
    let fabric = FabricModel::load(path, &FabricOptions::SMOOTH).unwrap();
    let (mut most, mut by_samples, mut by_directions, mut squares) = (0.0f32, 0.0f64, 0.0f64, 0.0f64);
    for (k, at) in places(&fabric, N).enumerate() {
        let even = |step: f64| (0.5 + k as f64 * step).fract();
        // All views, half of them from the back; every fourth grazes.
        let z = if k % 4 == 0 { 0.2 * even(0.725_731_409_9) + 1e-3 } else { even(0.725_731_409_9).sqrt() };
        let wo = direction(if k % 2 == 0 { z } else { -z }, even(0.652_178_999_0));
        let at = fabric.at(&FabricQuery::new(at, wo, [0.45, 0.55, 0.65]));
        let u = [0.586_080_078_4, 0.526_680_036_1, 0.473_300_2].map(|step| even(step) as f32);
        if let Some(sample) = at.sample(u).direction() {
            most = sample.weight.iter().fold(most, |m, w| m.max(*w));
            by_samples += f64::from(sample.weight[1]) / N as f64;
        }
        let other = direction(2.0 * even(0.425_344_1) - 1.0, even(0.382_233_9));
        let f = 4.0 * PI * f64::from(at.eval(other)[1]);
        by_directions += f / N as f64;
        squares += f * f / N as f64;
    }
    let se = (squares / N as f64).sqrt();
    println!(
        "{name}: largest weight {most:.2}; energy {by_samples:.4}, by even directions {by_directions:.4} +- {se:.4}"
    );
    assert!(most < 6.0, "{name}: {most}");
    assert!((by_samples - by_directions).abs() < 4.0 * se + 0.003, "{name}: {by_samples} {by_directions}");
}

mod samples_cover_what_eval_holds {
    use super::samples_cover_what_eval_holds as of;
    #[test]
    #[ignore = "slow: 10 s: samples cover what eval holds, polyester layers"]
    fn polyester_layers() {
        of("polyester_layers");
    }
    #[test]
    #[ignore = "slow: 10 s: samples cover what eval holds, polyester satin"]
    fn polyester_satin() {
        of("polyester_satin");
    }
    #[test]
    #[ignore = "slow: 10 s: samples cover what eval holds, silk organza"]
    fn silk_organza() {
        of("silk_organza");
    }
    #[test]
    #[ignore = "slow: 15 s: samples cover what eval holds, cotton plain"]
    fn cotton_plain() {
        of("cotton_plain");
    }
    #[test]
    #[ignore = "slow: 15 s: samples cover what eval holds, cotton twill"]
    fn cotton_twill() {
        of("cotton_twill");
    }
    #[test]
    #[ignore = "slow: 10 s: samples cover what eval holds, wool plain"]
    fn wool_plain() {
        of("wool_plain");
    }
}

/// Limits of the largest weight of gray samples, of the mean over channels of dyed ones, and of the largest
/// variance over the square of the mean, at one position and view, clear, light and with the spec's colors.
/// The limits of cloths of several plies are measured values, rounded up; those of dyed layers, satin and
/// organza are half way between measured values and those of probabilities by the light that leaves the
/// cloth.
struct Weights {
    name: &'static str,
    most: f64,
    variance: [f64; 3],
}

const WEIGHTS: [Weights; 6] = [
    Weights { name: "polyester_layers", most: 2.5, variance: [0.225, 0.478, 0.58] },
    Weights { name: "polyester_satin", most: 2.5, variance: [0.208, 0.37, 0.295] },
    Weights { name: "silk_organza", most: 2.5, variance: [0.16, 0.182, 0.183] },
    Weights { name: "cotton_plain", most: 2.5, variance: [0.18, 0.225, 0.21] },
    Weights { name: "cotton_twill", most: 3.0, variance: [0.21, 0.38, 0.865] },
    Weights { name: "wool_plain", most: 2.5, variance: [0.174, 0.23, 0.0325] },
];

/// Weights of a cloth's samples at even positions, tilts up to 85 degrees from both sides: the largest, and
/// the variance within a position and view over the square of the mean.
fn weights<const N: usize>(fabric: &FabricModel, sigma_per_um: Option<[f32; N]>, lambda_um: [f32; N]) -> (f64, f64) {
    const PLACES: usize = 12_000;
    const EACH: usize = 4;
    let (mut most, mut sum, mut within) = (0.0f64, 0.0, 0.0);
    for (k, at) in places(fabric, PLACES).enumerate() {
        let even = |step: f64| (0.5 + k as f64 * step).fract();
        let z = [0.0f64, 30.0, 60.0, 75.0, 85.0][k % 5].to_radians().cos();
        let wo = direction(if k % 2 == 0 { z } else { -z }, even(0.652_178_999_0));
        let query = FabricQuery { sigma_per_um: [sigma_per_um; 2], ..FabricQuery::new(at, wo, lambda_um) };
        let at = fabric.at(&query);
        let (mut here, mut squares) = (0.0, 0.0);
        for n in 0..EACH {
            let even = |step: f64| (0.5 + (EACH * k + n) as f64 * step).fract() as f32;
            let weight = match at.sample([even(0.586_080_078_4), even(0.526_680_036_1), even(0.473_300_2)]) {
                BsdfSample::Scattered(sample) => sample.weight,
                BsdfSample::Straight { weight, .. } => weight,
                BsdfSample::Absorbed => [0.0; N],
            };
            let weight = weight.iter().map(|w| f64::from(*w)).sum::<f64>() / N as f64;
            most = most.max(weight);
            here += weight / EACH as f64;
            squares += weight * weight / EACH as f64;
        }
        sum += here / PLACES as f64;
        within += (squares - here * here) * (EACH as f64 / (EACH as f64 - 1.0)) / PLACES as f64;
    }
    (most, within / (sum * sum))
}

/// No sample of a cloth has a large weight, and samples of a position differ little, as many scatterings in
/// folds multiply weights.
fn weights_of_samples_are_small(name: &'static str) {
    let limits = WEIGHTS.iter().find(|limits| limits.name == name).unwrap();
    let fabric = fabric(limits.name);
    let found = [
        weights(&fabric, Some([0.0]), [0.55]),
        weights(&fabric, Some([0.003]), [0.55]),
        weights::<3>(&fabric, None, [0.65, 0.55, 0.45]),
    ];
    println!("{}: largest weight and variance {found:.4?}", limits.name);
    for ((most, variance), least) in found.into_iter().zip(limits.variance) {
        assert!(most < limits.most, "{}: {most}", limits.name);
        assert!(variance < least, "{}: {variance}", limits.name);
    }
}

mod weights_of_samples_are_small {
    use super::weights_of_samples_are_small as of;
    #[test]
    fn polyester_layers() {
        of("polyester_layers");
    }
    #[test]
    #[ignore = "slow: 5 s: weights of samples are small, polyester satin"]
    fn polyester_satin() {
        of("polyester_satin");
    }
    #[test]
    #[ignore = "slow: 5 s: weights of samples are small, silk organza"]
    fn silk_organza() {
        of("silk_organza");
    }
    #[test]
    #[ignore = "slow: 5 s: weights of samples are small, cotton plain"]
    fn cotton_plain() {
        of("cotton_plain");
    }
    #[test]
    #[ignore = "slow: 10 s: weights of samples are small, cotton twill"]
    fn cotton_twill() {
        of("cotton_twill");
    }
    #[test]
    #[ignore = "slow: 5 s: weights of samples are small, wool plain"]
    fn wool_plain() {
        of("wool_plain");
    }
}
