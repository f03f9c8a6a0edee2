//! Yarns of metal in a cloth have their own color, by wavelength and in RGB; dyes replace it.

use crate::small_cloth::{self, CELL_UM, cloth, gilded};
use plywave::cloth::{Channels, ClothModel, ClothOptions, ColorOf, Values, YarnColor};
use plywave::color::spectrum_lambda_um;
use plywave::spec::YarnSpec;
use plywave::{Bsdf, ClothQuery};

fn gold() -> YarnSpec {
    plywave_textile::load_yarn_file(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/gold.toml")).unwrap().0
}

/// Absorptions [1/um] of the yarn of a number of warp or weft, at the wavelengths of its dye's spectrum.
fn sigma(cloth: &ClothModel, kind: usize, yarn: usize) -> Vec<f32> {
    let tensors = cloth.tensors();
    let of = |name: &str| &tensors.iter().find(|tensor| tensor.name == name).unwrap().values;
    let Values::U32(dyes) = of(["dyes_0", "dyes_1"][kind]) else { panic!("dyes are indices") };
    let Values::F32(spectra) = of("dye_spectrum") else { panic!("spectra are reals") };
    spectra[81 * dyes[yarn % dyes.len()] as usize..][..81].to_vec()
}

/// A warp of polyester and a weft of gold with more keys.
fn with_keys(yarns: [&str; 2]) -> ClothModel {
    cloth(&small_cloth::with_keys(&gilded(), yarns), &ClothOptions::SMOOTH)
}

#[test]
fn metals_have_their_own_color_where_nothing_else_is_said() {
    let gold = gold();
    let own: Vec<f32> = (0..81).map(|k| gold.own_sigma_per_um(spectrum_lambda_um(k)) as f32).collect();
    let near = |got: Vec<f32>| got.iter().zip(&own).all(|(a, b)| (a / b - 1.0).abs() < 0.02);
    let lame = cloth(&gilded(), &ClothOptions::SMOOTH);
    assert!(near(sigma(&lame, 1, 0)) && near(sigma(&lame, 1, 1)), "{:?}", sigma(&lame, 1, 0));
    assert_eq!(sigma(&lame, 0, 0), [0.0; 81]);
    // A given color takes precedence, and so does one absorption for all.
    let dyed = with_keys(["", "sigma_per_um = 0.02"]);
    assert_eq!(sigma(&dyed, 1, 0), [0.02; 81]);
    let dyed = with_keys(["sigma_per_um = 0.02", ""]);
    assert!(near(sigma(&dyed, 1, 0)));
    assert_eq!(sigma(&dyed, 0, 0), [0.02; 81]);
    let white = cloth(&gilded(), &ClothOptions { sigma_per_um: Some(0.0), ..ClothOptions::SMOOTH });
    assert_eq!(sigma(&white, 1, 0), [0.0; 81]);
    let again = dyed.with_colors([YarnColor::Sigma(0.01), YarnColor::Undyed], ColorOf::EvenSky);
    assert!(near(sigma(&again, 1, 0)));
    assert_eq!(sigma(&again, 0, 0), [0.01; 81]);
    // Stripes of the other kind leave it its color.
    let mut striped = gilded();
    striped.looks[0].colors = [[0.5, 0.1, 0.1], [0.1, 0.1, 0.5]].map(YarnColor::Srgb).to_vec();
    let striped = cloth(&striped, &ClothOptions::SMOOTH);
    assert!(near(sigma(&striped, 1, 1)) && sigma(&striped, 0, 0) != sigma(&striped, 0, 1));
    // What is seen is seen with these absorptions.
    let lambda = [0.45, 0.5, 0.55, 0.65];
    let own = lambda.map(|l| gold.own_sigma_per_um(f64::from(l)) as f32);
    for i in 0..400 {
        let place = [0.37 + 480.0 * (0.618_034 * i as f32).fract(), 480.0 * (0.754_877 * i as f32).fract()];
        let query = ClothQuery::new(place, [0.3, 0.2, 0.932_737_9], lambda);
        let given = ClothQuery { sigma_per_um: [None, Some(own)], ..query };
        let w = [0.36, 0.48, 0.8];
        let (f, g) = (lame.at(&query).eval(w), lame.at(&given).eval(w));
        assert!((0..4).all(|k| (f[k] - g[k]).abs() <= 0.02 * g[k]), "{f:?} {g:?}");
    }
}

/// In RGB gold is yellow: its red, green and blue are in the order of Fresnel's reflectances, and the white
/// furnace of one absorption stays gray.
#[test]
fn gold_is_yellow_in_rgb() {
    let mean = |options: &ClothOptions| {
        let cloth = cloth(&gilded(), options);
        let mut light = [0.0f32; 3];
        for i in 0..400 {
            let place = [0.618_034, 0.754_877].map(|step: f32| 0.37 + CELL_UM * (step * i as f32).fract());
            let query = ClothQuery::rgb(place, [0.3, 0.2, 0.932_737_9]);
            assert_eq!(query.channels, Channels::LinearSrgb);
            let albedo = cloth.at(&query).albedo();
            assert!(albedo.iter().all(|a| a.is_finite()));
            (0..3).for_each(|k| light[k] += albedo[k] / 400.0);
        }
        light
    };
    let [r, g, b] = mean(&ClothOptions::SMOOTH);
    println!("albedo {r:.3} {g:.3} {b:.3}");
    assert!(r > g + 0.02 && g > b + 0.05, "{r} {g} {b}");
    let [r, g, b] = mean(&ClothOptions { sigma_per_um: Some(0.01), ..ClothOptions::SMOOTH });
    assert!((r - g).abs() < 1e-4 && (g - b).abs() < 1e-4, "{r} {g} {b}");
}
