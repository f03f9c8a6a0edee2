//! Uneven yarns: a large cloth has the mean light of the even one, and looks like it nowhere.

use crate::small_cloth::{RED_BLUE, SPACING_UM, cloth, with_keys};
use plywave::cloth::{ClothModel, ClothOptions, GapLight};
use plywave::{Bsdf, ClothQuery};

const KEYS: [&str; 2] = ["count_cv = 0.25\nuneven_mm = 3.0", "count_cv = 0.15\nspacing_cv = 0.05\nuneven_mm = 8.0"];
/// Side of the cloth [um].
const SIDE_UM: f64 = 2e5;

/// Light of a view at one place, and what goes straight on.
fn light(of: &ClothModel, at: [f32; 2], wo: [f32; 3], lights: &[[f32; 3]]) -> (f64, f64) {
    let query = ClothQuery { sigma_per_um: [Some([0.0]); 2], ..ClothQuery::new(at, wo, [0.55]) };
    let place = of.at(&query);
    let sum: f64 = lights.iter().map(|wi| f64::from(place.eval(*wi)[0])).sum();
    (sum, f64::from(place.straight()[0]))
}

/// Means over places of a piece that is large beside `uneven_mm`, for views along and across the yarns and
/// lights on both sides.
#[test]
fn the_mean_light_is_that_of_even_yarns() {
    const N: usize = 150_000;
    let options = ClothOptions { gaps: GapLight::Straight, ..ClothOptions::SMOOTH };
    let [even, uneven] = [with_keys(&RED_BLUE, [""; 2]), with_keys(&RED_BLUE, KEYS)].map(|of| cloth(&of, &options));
    let lights = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -0.8, 0.6], [0.3, 0.4, -0.866]].map(|w: [f32; 3]| {
        let n = w.iter().map(|x| x * x).sum::<f32>().sqrt();
        w.map(|x| x / n)
    });
    for wo in [[0.0, 0.0, 1.0], [0.8, 0.0, 0.6], [0.0, 0.96, 0.28]] {
        let mut sums = [(0.0, 0.0); 2];
        let mut alike = 0;
        for k in 0..N {
            let at = [0.898_653_712_6, 0.807_578_495_2].map(|s: f64| (SIDE_UM * (0.5 + k as f64 * s).fract()) as f32);
            let both = [&even, &uneven].map(|of| light(of, at, wo, &lights));
            for (sum, (scattered, straight)) in sums.iter_mut().zip(both) {
                *sum = (sum.0 + scattered, sum.1 + straight);
            }
            alike += usize::from(both[0] == both[1] && both[0].0 > 0.0);
        }
        let [(even, open), (uneven, other)] = sums;
        let off = (uneven / even - 1.0, (other - open) / N as f64);
        println!("{wo:?}: light off by {:.5}, straight {:.4} by {:.5}", off.0, open / N as f64, off.1);
        assert!(off.0.abs() < 0.005 && off.1.abs() < 0.002, "{off:?}");
        assert!(alike < N / 100, "{alike} of {N} places alike");
    }
}

/// Without the option, an uneven cloth is the even one; far from each other, repeats differ.
#[test]
fn the_option_makes_yarns_even() {
    let uneven = with_keys(&RED_BLUE, KEYS);
    let even = cloth(&uneven, &ClothOptions { uneven: false, ..ClothOptions::SMOOTH });
    let [plain, uneven] = [with_keys(&RED_BLUE, [""; 2]), uneven].map(|of| cloth(&of, &ClothOptions::SMOOTH));
    let (wo, lights) = ([0.6, 0.0, 0.8], [[0.0, 0.6, 0.8], [0.0, 0.6, -0.8]]);
    let mut apart = 0;
    for k in 0..400 {
        let at = [0.13, 0.29].map(|s| s * 1000.0 * k as f32);
        assert_eq!(light(&even, at, wo, &lights), light(&plain, at, wo, &lights));
        let next = [at[0] + 40.0 * SPACING_UM as f32, at[1]];
        apart += usize::from(light(&uneven, at, wo, &lights) != light(&uneven, next, wo, &lights));
    }
    assert!(apart > 300, "{apart}");
}

/// Uneven yarns of a kind that run along several directions.
#[test]
fn yarns_of_several_directions_are_refused() {
    let mut data = with_keys(&RED_BLUE, KEYS);
    data.curves.yarns[2].kind = 0;
    for uneven in [true, false] {
        let options = ClothOptions { uneven, ..ClothOptions::SMOOTH };
        let message = ClothModel::from_data(data.clone(), &options).expect_err("refused").to_string();
        assert!(message.contains("warp.count_cv = 0.25: its yarns run along several directions"), "{message}");
    }
}
