//! Relief: fibers show on plies, in the mean the light is that of smooth tubes, and a footprint blurs them.

use crate::small_cloth::{RED_BLUE, SPACING_UM, cloth};
use plywave::cloth::{ClothModel, ClothOptions, GapLight};
use plywave::{Bsdf, ClothQuery};

const LIGHTS: [[f32; 3]; 4] = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -0.8, 0.6], [0.36, 0.48, -0.8]];

/// Light of a view at one place and footprint.
fn light(of: &ClothModel, at: [f32; 2], wo: [f32; 3], footprint_um: f32) -> [f64; 4] {
    let query = ClothQuery { sigma_per_um: [Some([0.002]); 2], footprint_um, ..ClothQuery::new(at, wo, [0.55]) };
    let place = of.at(&query);
    LIGHTS.map(|wi| f64::from(place.eval(wi)[0]))
}

fn pair() -> [ClothModel; 2] {
    let options = ClothOptions { gaps: GapLight::Straight, ..ClothOptions::SMOOTH };
    [options, ClothOptions { relief: false, ..options }].map(|options| cloth(&RED_BLUE, &options))
}

/// For each view and light the mean over many yarns is that of smooth plies within 0.5 %, at points and at
/// footprints.
#[test]
fn the_mean_light_is_that_of_smooth_plies() {
    const N: usize = 100_000;
    let [rough, smooth] = pair();
    for (wo, footprint_um) in [
        ([0.0, 0.0, 1.0], 0.0),
        ([0.8, 0.0, 0.6], 2.0),
        ([0.0, 0.96, 0.28], 0.0),
        ([0.6, 0.64, 0.48], 12.0),
        ([-0.95, 0.309, 0.05], 0.0),
    ] {
        let mut sums = [[0.0; 4]; 2];
        let mut squares = [0.0; 4];
        for k in 0..N {
            let side = 5000.0 * SPACING_UM;
            let at = [0.898_653_712_6, 0.807_578_495_2].map(|s: f64| (side * (0.5 + k as f64 * s).fract()) as f32);
            let both = [&rough, &smooth].map(|of| light(of, at, wo, footprint_um));
            for i in 0..4 {
                sums[0][i] += both[0][i];
                sums[1][i] += both[1][i];
                squares[i] += (both[0][i] - both[1][i]).powi(2);
            }
        }
        for i in 0..4 {
            let off = sums[0][i] / sums[1][i] - 1.0;
            let se = squares[i].sqrt() / sums[1][i];
            println!("{wo:?} {footprint_um} {:?}: {off:.5} +- {se:.5}", LIGHTS[i]);
            assert!(off.abs() < 0.005 + 2.0 * se, "{wo:?} {footprint_um} {:?}: {off} +- {se}", LIGHTS[i]);
            assert!(se < 0.002, "{se}");
        }
    }
}

/// Fibers show at a point, less so in a footprint as wide as a fiber, and hardly in one of several plies.
#[test]
fn a_footprint_blurs_fibers() {
    let [rough, smooth] = pair();
    let wo = [0.28, 0.0, 0.96];
    let contrasts = [0.0, 10.0, 100.0].map(|footprint_um| {
        let (mut squares, mut sum, n) = (0.0, 0.0, 4000);
        for k in 0..n {
            let at = [0.137, 0.251].map(|s| s * SPACING_UM as f32 * k as f32);
            let [a, b] = [&rough, &smooth].map(|of| light(of, at, wo, footprint_um)[1]);
            squares += (a - b).powi(2);
            sum += b;
        }
        (squares * f64::from(n)).sqrt() / sum
    });
    println!("{contrasts:?}");
    assert!(contrasts[0] > 0.3 && contrasts[1] < 0.8 * contrasts[0] && contrasts[2] < 0.1, "{contrasts:?}");
}

/// Footprints and places that are no numbers, or large ones.
#[test]
fn any_footprint_gives_numbers() {
    let [rough, _] = pair();
    for footprint_um in [f32::NAN, f32::INFINITY, -1.0, 1e30] {
        for at in [[0.0, 0.0], [1e9, -1e9], [f32::NAN, 0.0]] {
            let light = light(&rough, at, [0.0, 0.6, 0.8], footprint_um);
            assert!(light.iter().all(|v| v.is_finite() && *v >= 0.0), "{footprint_um} {at:?}: {light:?}");
        }
    }
}
