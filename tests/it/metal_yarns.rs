//! Yarns of metal in a fabric have their own color, by wavelength and in RGB; the models here are polyester's
//! lobes under the spec of gold: colors depend only on the spec and on the fall of the cloth's brightness
//! with absorption.

use plywave::fabric::{Channels, ColorOf, FabricOptions, FabricSpec, LoadedFabric, YarnColor, YarnSet};
use plywave::spec::YarnSpec;
use plywave::{Bsdf, FabricModel, FabricQuery, PlyModel};
use std::sync::Arc;

fn gold() -> (YarnSpec, String) {
    YarnSpec::load(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/gold.toml")).unwrap()
}

fn polyester() -> PlyModel {
    PlyModel::load(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/polyester.pwm")).unwrap()
}

fn metal() -> PlyModel {
    let mut data = polyester().data().clone();
    data.spec_text = gold().1;
    PlyModel::from_data(data).unwrap()
}

/// A plain cloth of a warp of gold and a weft of stripes, two of gold and one of polyester.
fn cloth(color: &str, options: &FabricOptions) -> FabricModel {
    let text = format!(
        "name = \"lame\"\n[weave]\nkind = \"plain\"\n[warp]\nmodel = \"gold\"\nspacing_um = 240.0\n{color}\n\
         [weft]\nmodels = {{ G = \"gold\", P = \"polyester\" }}\nthreads = \"GGP\"\nspacing_um = 240.0\n"
    );
    let spec = FabricSpec::parse(&text, "lame").unwrap();
    let (gold, polyester) = (Arc::new(metal()), Arc::new(polyester()));
    let loaded = LoadedFabric::new(spec, None, [vec![gold.clone()], vec![gold, polyester]]).unwrap();
    FabricModel::new(loaded, options).unwrap()
}

const LAMBDA: [f32; 4] = [0.45, 0.5, 0.55, 0.65];

#[test]
#[ignore = "slow: 5 s: metals have their own color where nothing else is said"]
fn metals_have_their_own_color_where_nothing_else_is_said() {
    let own = LAMBDA.map(|l| gold().0.own_sigma_per_um(f64::from(l)) as f32);
    let near = |got: [f32; 4]| got.iter().zip(own).all(|(a, b)| (a / b - 1.0).abs() < 0.02);
    let cloth = cloth("", &FabricOptions::SMOOTH);
    for yarn in [-7, 0, 1, 2, 3, 4, 5, 6] {
        assert!(near(cloth.sigma(YarnSet::Warp, yarn, LAMBDA)), "{:?}", cloth.sigma(YarnSet::Warp, yarn, LAMBDA));
        let weft = cloth.sigma(YarnSet::Weft, yarn, LAMBDA);
        // Every third is polyester, clear, whatever the draft's repeat of two.
        assert!(if yarn.rem_euclid(3) == 2 { weft == [0.0; 4] } else { near(weft) }, "{yarn}: {weft:?}");
    }
    // A given color takes precedence, and so does one absorption for all.
    let dyed = self::cloth("sigma_per_um = 0.02", &FabricOptions::SMOOTH);
    assert_eq!(dyed.sigma(YarnSet::Warp, 0, LAMBDA), [0.02; 4]);
    assert!(near(dyed.sigma(YarnSet::Weft, 0, LAMBDA)));
    let white = self::cloth("", &FabricOptions { sigma_per_um: Some(0.0), ..FabricOptions::SMOOTH });
    assert_eq!(white.sigma(YarnSet::Weft, 0, LAMBDA), [0.0; 4]);
    let again = dyed.with_colors([YarnColor::Undyed, YarnColor::Sigma(0.01)], ColorOf::EvenSky);
    assert!(near(again.sigma(YarnSet::Warp, 0, LAMBDA)));
    assert_eq!(again.sigma(YarnSet::Weft, 0, LAMBDA), [0.01; 4]);
}

/// In RGB gold is yellow: its red, green and blue are in the order of Fresnel's reflectances, and the white
/// furnace of one absorption stays gray.
#[test]
fn gold_is_yellow_in_rgb() {
    let cloth = cloth("", &FabricOptions::SMOOTH);
    let (mut light, mut count) = ([0.0f32; 3], 0);
    for i in 0..400 {
        let place = [(0.37 + 480.0 * (0.618_034 * i as f32).fract()), 480.0 * (0.754_877 * i as f32).fract()];
        let query = FabricQuery::rgb(place, [0.3, 0.2, 0.932_737_9]);
        assert_eq!(query.channels, Channels::LinearSrgb);
        let at = cloth.at(&query);
        let albedo = at.albedo();
        assert!(albedo.iter().all(|a| a.is_finite()));
        (0..3).for_each(|k| light[k] += albedo[k]);
        count += 1;
    }
    let [r, g, b] = light.map(|l| l / count as f32);
    println!("albedo {r:.3} {g:.3} {b:.3}");
    assert!(r > g + 0.02 && g > b + 0.05, "{r} {g} {b}");
}
