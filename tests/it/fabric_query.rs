//! Overrides at a point of a fabric: color, turn of the pattern, models; stripes of several models in a
//! family; all from memory. Each is compared with a fabric that has the value everywhere.

use plywave::fabric::{FabricOptions, FabricSpec, GapLight, YarnSet};
use plywave::frame::direction;
use plywave::io::MemoryAssets;
use plywave::ply::PlyData;
use plywave::{Bsdf, BsdfSample, FabricModel, FabricQuery, PlyModel};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;

const LAMBDA: [f32; 3] = [0.45, 0.55, 0.65];

/// The shipped polyester model, and one whose fibers absorb as if three times as thick.
fn models() -> [PlyModel; 2] {
    let path = format!("{}/fabrics/models/polyester.pwm", env!("CARGO_MANIFEST_DIR"));
    let light = PlyModel::load(path).unwrap();
    let path_um = light.data().path_um.iter().map(|p| 3.0 * p).collect();
    let dark = PlyModel::from_data(PlyData { path_um, ..light.data().clone() }).unwrap();
    [light, dark]
}

fn fabric(warp: &str, options: &FabricOptions) -> FabricModel {
    let [light, dark] = models();
    let mut assets = MemoryAssets::new();
    assets.insert("light.pwm", light.data().to_bytes().unwrap());
    assets.insert("dark.pwm", dark.data().to_bytes().unwrap());
    let yarn = "spacing_um = 190.0\ncrimp = 0.3\nsigma_per_um = 0.004\n";
    let text = format!(
        "name = \"memory\"\n[weave]\nkind = \"plain\"\n[warp]\n{warp}\n{yarn}[weft]\nmodel = \"light.pwm\"\n{yarn}"
    );
    let loaded = FabricSpec::load_from(&text, "memory", &assets).unwrap();
    FabricModel::new(loaded, options).unwrap()
}

/// Point, viewer, light, random numbers.
type Query = ([f32; 2], [f32; 3], [f32; 3], [f32; 3]);

fn queries(count: usize) -> Vec<Query> {
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    (0..count)
        .map(|_| {
            let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * (u - 0.5));
            let wo = direction((0.2 + 0.8 * rng.random::<f32>()).asin(), TAU * rng.random::<f32>());
            let wi = direction((2.0 * rng.random::<f32>() - 1.0).asin(), TAU * rng.random::<f32>());
            (point, wo, wi, rng.random())
        })
        .collect()
}

/// Each yarn alone, without inter-yarn scattering.
const ALONE: FabricOptions = FabricOptions { layers: false, shadowing: false, ..FabricOptions::SMOOTH };

/// Each yarn of a striped family shades as in a fabric of its model alone; stripes repeat, negative yarns
/// too.
#[test]
#[ignore = "slow: 5 s: stripes have the model of their yarn"]
fn stripes_have_the_model_of_their_yarn() {
    let options = ALONE;
    let striped = fabric("models = { A = \"light.pwm\", B = \"dark.pwm\" }\nthreads = \"AAB\"", &options);
    let whole = [fabric("model = \"light.pwm\"", &options), fabric("model = \"dark.pwm\"", &options)];
    assert_eq!(striped.repeat_of_stripes(YarnSet::Warp), 3);
    let (mut seen, mut other_rims) = ([0u32; 2], 0u32);
    for (point, wo, wi, _) in queries(3000) {
        let query = FabricQuery::new(point, wo, LAMBDA);
        let got = striped.at(&query);
        if got.is_double() || got.is_gap() {
            continue; // Warp and weft both have a part there.
        }
        let plywave::fabric::Hit::Ply(hit) = striped.fabric().at(point[0], point[1], wo) else { continue };
        if hit.family == YarnSet::Weft {
            continue;
        }
        let dark = usize::from(hit.yarn.rem_euclid(3) == 2);
        seen[dark] += 1;
        // A line that also passes the rim of another yarn includes part of its light.
        other_rims += u32::from(got.eval(wi) != whole[dark].at(&query).eval(wi));
    }
    assert!(10 * other_rims < seen[0] + seen[1], "{other_rims} of {seen:?}");
    assert!(seen.iter().all(|n| *n > 20), "{seen:?}");
}

/// A point's own color and models are those of a fabric that has them everywhere.
#[test]
fn points_have_their_own_color_and_models() {
    let plain = fabric("model = \"light.pwm\"", &FabricOptions::default());
    let dyed = fabric("model = \"light.pwm\"", &FabricOptions { sigma_per_um: Some(0.02), ..Default::default() });
    let replaced = fabric("model = \"dark.pwm\"", &ALONE);
    let dark = replaced.model_of(YarnSet::Warp, 0);
    let alone = fabric("model = \"light.pwm\"", &ALONE);
    let mut differ = 0;
    for (point, wo, wi, u) in queries(1500) {
        let query = FabricQuery::new(point, wo, LAMBDA);
        let own = plain.at(&FabricQuery { sigma_per_um: [Some([0.02; 3]); 2], ..query });
        assert_eq!(own.eval(wi), dyed.at(&query).eval(wi));
        assert_eq!(own.sample(u), dyed.at(&query).sample(u));
        let own = alone.at(&FabricQuery { models: [Some(dark), None], ..query });
        assert_eq!(own.eval(wi), replaced.at(&query).eval(wi));
        differ += u32::from(own.eval(wi) != alone.at(&query).eval(wi));
    }
    assert!(differ > 300, "{differ} points have warp yarns");
}

/// A turned pattern seen from a turned direction equals the pattern: f, density, samples, in all cases of the
/// beam.
#[test]
#[ignore = "slow: 5 s: turned patterns turn the light"]
fn turned_patterns_turn_the_light() {
    for gaps in [GapLight::Diffracted, GapLight::Straight] {
        let cloth = fabric("model = \"light.pwm\"", &FabricOptions { gaps, ..Default::default() });
        let (s, c) = 0.7f32.sin_cos();
        let turned = |w: [f32; 3]| [c * w[0] - s * w[1], s * w[0] + c * w[1], w[2]];
        let near = |a: f32, b: f32| (a - b).abs() <= 2e-3 * b.abs() + 2e-4;
        let (mut cases, mut straight, mut off) = ([0; 3], 0, 0);
        for (point, wo, wi, u) in queries(2000) {
            let at = cloth.at(&FabricQuery::new(point, wo, LAMBDA));
            let [x, y, _] = turned([point[0], point[1], 0.0]);
            let query = FabricQuery { turn_rad: 0.7, ..FabricQuery::new([x, y], turned(wo), LAMBDA) };
            let there = cloth.at(&query);
            let case =
                |at: &plywave::fabric::FabricBsdf<'_, 3>| if at.is_gap() { 0 } else { 1 + usize::from(at.is_double()) };
            if case(&at) != case(&there) {
                // Rounding decides at an edge.
                off += 1;
                continue;
            }
            cases[case(&at)] += 1;
            let ((f, pdf), (g, density)) = (at.eval_pdf(wi), there.eval_pdf(turned(wi)));
            off += u32::from(!(near(density, pdf) && (0..3).all(|k| near(g[k], f[k]))));
            match (at.sample(u), there.sample(u)) {
                (BsdfSample::Scattered(a), BsdfSample::Scattered(b)) => {
                    let want = turned(a.w);
                    off += u32::from((0..3).any(|k| (b.w[k] - want[k]).abs() > 2e-3));
                }
                (BsdfSample::Straight { weight, probability }, BsdfSample::Straight { weight: w, probability: p }) => {
                    straight += 1;
                    assert!(near(probability, p) && near(weight[0], w[0]));
                }
                _ => off += 1,
            }
        }
        assert!(cases.iter().all(|n| *n > 50) && off < 30, "{cases:?}, {off} off");
        assert_eq!(straight > 0, gaps == GapLight::Straight);
    }
}

/// The models of a fabric, in single lines, can be saved and read: hosts on other machines get them so.
#[test]
fn models_in_lines_are_models() {
    let folder = format!("{}/fabrics/models", env!("CARGO_MANIFEST_DIR"));
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "pwm") {
            continue;
        }
        let lines = PlyModel::load(&path).unwrap().of_lines().unwrap();
        let bytes = lines.data().to_bytes().unwrap_or_else(|e| panic!("{e}"));
        PlyModel::from_bytes(&bytes, "lines").unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        count += 1;
    }
    assert!(count > 9, "{count} models");
}
