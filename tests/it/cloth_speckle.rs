//! Speckle of cloths: in the mean the light is that of the smooth cloth, patterns go on along yarns from cell
//! to cell, and neither the direction of a grid of places nor its cells show.

use crate::small_cloth::{ALONE, CELL_UM, RED_BLUE, SPACING_UM, cloth};
use plywave::cloth::{ClothModel, ClothOptions};
use plywave::ply::PlyData;
use plywave::{Bsdf, ClothQuery, PlyModel};
use std::sync::{Arc, LazyLock};

/// A cloth with strong speckle, each yarn alone, and the same without.
static PAIR: LazyLock<[ClothModel; 2]> = LazyLock::new(|| {
    let mut data = RED_BLUE.clone();
    for model in &mut data.models {
        let of: &PlyData = model.data();
        let noise = of.noise.clone().map(|noise| plywave::speckle::NoiseSpectrum { share: [0.5, 1.0], ..noise });
        *model = Arc::new(PlyModel::from_data(PlyData { noise, ..of.clone() }).unwrap());
    }
    [true, false].map(|noise| cloth(&data, &ClothOptions { noise, ..ALONE }))
});

/// Light with speckle and without, of a pattern that is turned.
fn both(at: [f32; 2], wi: [f32; 3], footprint_um: f32, turn_rad: f32) -> [f64; 2] {
    let query = ClothQuery {
        sigma_per_um: [Some([0.002]); 2],
        footprint_um,
        turn_rad,
        ..ClothQuery::new(at, [0.28, 0.0, 0.96], [0.55])
    };
    PAIR.each_ref().map(|of| f64::from(of.at(&query).eval(wi)[0]))
}

const LIGHTS: [[f32; 3]; 3] = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.36, 0.48, -0.8]];

/// For each light the mean over many yarns is that of the smooth cloth within 0.5 %, and speckle vanishes as
/// the footprint grows.
#[test]
fn the_mean_light_is_that_of_the_smooth_cloth() {
    const N: usize = 60_000;
    let mut contrasts = Vec::new();
    for footprint_um in [0.0, 10.0, 60.0, 2000.0] {
        for wi in LIGHTS {
            let (mut sums, mut square) = ([0.0; 2], 0.0);
            for k in 0..N {
                let side = 5000.0 * SPACING_UM;
                let at = [0.898_653_712_6, 0.807_578_495_2].map(|s: f64| (side * (0.5 + k as f64 * s).fract()) as f32);
                let [with, without] = both(at, wi, footprint_um, 0.0);
                sums = [sums[0] + with, sums[1] + without];
                square += (with - without).powi(2);
            }
            let (off, se) = (sums[0] / sums[1] - 1.0, square.sqrt() / sums[1]);
            println!("{footprint_um} {wi:?}: {off:.5} +- {se:.5}");
            assert!(off.abs() < 0.005 + 4.0 * se && se < 0.01, "{footprint_um} {wi:?}: {off} +- {se}");
            contrasts.push(se);
        }
    }
    for k in 0..3 {
        assert!(contrasts[3 + k] < 0.9 * contrasts[k] && contrasts[6 + k] < 0.5 * contrasts[k], "{contrasts:?}");
        assert!(contrasts[9 + k] < 0.03 * contrasts[k], "{contrasts:?}");
    }
}

/// Along lines over several cells, speckle changes by little from step to step wherever the light without it
/// does, at the borders of cells too.
#[test]
fn patterns_go_on_from_cell_to_cell() {
    let (mut steps, mut borders, mut worst) = (0, 0, 0.0f64);
    let step_um = 0.05;
    for across_um in [0.5 * SPACING_UM as f32, 0.5 * SPACING_UM as f32 + 21.0] {
        for axis in 0..2 {
            for cell in 1..12 {
                let mut last = [0.0; 2];
                // A hundred steps about each border.
                for i in -50..50 {
                    let along_um = CELL_UM * cell as f32 + step_um * (i as f32 + 0.5);
                    let at = if axis == 0 { [along_um, across_um] } else { [across_um, along_um] };
                    let [with, without] = both(at, LIGHTS[1], 0.0, 0.0);
                    let now = [with / without, without];
                    if i > -50 && without > 0.0 && (now[1] / last[1] - 1.0).abs() < 0.01 {
                        steps += 1;
                        borders += u32::from(i == 0);
                        worst = worst.max((now[0] - last[0]).abs() / (1.0 + now[0]));
                    }
                    last = now;
                }
            }
        }
    }
    println!("{steps} steps, {borders} borders, {worst:.4}");
    assert!(steps > 2000 && borders > 20, "{steps} steps, {borders} borders");
    // A two hundredth of the waist.
    assert!(worst < 0.05, "{worst}");
}

/// Over a grid of places that is turned by 37 degrees, the contrast is that of the grid along the yarns.
/// (From place to place the tangent of a bent yarn turns away from the light, along the yarn alone: neighbors
/// are compared on a straight ply, in the tests of the fit.)
#[test]
fn a_turned_grid_has_the_same_contrast() {
    let (side, step_um, blocks) = (160, 1.1, 16);
    let over = |turn_rad: f32| -> [f64; 2] {
        let variance = |block: i32| {
            let (mut sum, mut count) = (0.0, 0.0);
            for i in 0..side {
                for j in 0..side {
                    let at = [i as f32 + 4e3 * block as f32, j as f32 + 900.0 * block as f32].map(|x| step_um * x);
                    let [with, without] = both(at, LIGHTS[0], 0.0, turn_rad);
                    if without > 0.0 {
                        (sum, count) = (sum + (with / without - 1.0).powi(2), count + 1.0);
                    }
                }
            }
            sum / count
        };
        let all: Vec<f64> = (0..blocks).map(variance).collect();
        let n = all.len() as f64;
        let mean = all.iter().sum::<f64>() / n;
        let square: f64 = all.iter().map(|v| (v - mean).powi(2)).sum();
        [mean, (square / n / (n - 1.0)).sqrt()]
    };
    let (even, turned) = (over(0.0), over(37f32.to_radians()));
    println!("{even:?} {turned:?}");
    let limit = 5.0 * even[1].hypot(turned[1]);
    assert!((even[0] - turned[0]).abs() < limit && limit < 0.25, "{even:?} {turned:?}");
}
