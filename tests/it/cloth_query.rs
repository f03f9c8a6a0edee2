//! Overrides at a point of a cloth: color, turn of the pattern, models. Each is compared with a cloth that
//! has the value everywhere. Then periodicity.

use crate::small_cloth::{ALONE, CELL_UM, RED_BLUE, cloth, with_keys};
use plywave::Document;
use plywave::cloth::{ClothBsdf, ClothOptions, GapLight};
use plywave::frame::direction;
use plywave::ply::PlyData;
use plywave::{Bsdf, BsdfSample, ClothQuery, PlyModel};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;
use std::sync::Arc;

const LAMBDA: [f32; 3] = [0.45, 0.55, 0.65];

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

/// A point's own color and models are those of a cloth that has them everywhere.
#[test]
fn points_have_their_own_color_and_models() {
    let plain = cloth(&RED_BLUE, &ClothOptions::default());
    let dyed = cloth(&RED_BLUE, &ClothOptions { sigma_per_um: Some(0.02), ..Default::default() });
    let warp = cloth(&with_keys(&RED_BLUE, ["sigma_per_um = 0.02", "color = [0.1, 0.2, 0.6]"]), &ALONE);
    // A warp whose fibers absorb as if three times as thick.
    let light = plain.model_of(0).unwrap();
    let path_um = light.data().path_um.iter().map(|p| 3.0 * p).collect();
    let thick = PlyModel::from_data(PlyData { path_um, ..light.data().clone() }).unwrap();
    let mut data = RED_BLUE.clone();
    data.models[0] = Arc::new(thick.of_lines().unwrap());
    let replaced = cloth(&data, &ALONE);
    let thick = replaced.model_of(0).unwrap();
    let alone = cloth(&RED_BLUE, &ALONE);
    let mut differ = [0; 2];
    for (point, wo, wi, u) in queries(1500) {
        let query = ClothQuery::new(point, wo, LAMBDA);
        let own = plain.at(&ClothQuery { sigma_per_um: [Some([0.02; 3]); 2], ..query });
        assert_eq!(own.eval(wi), dyed.at(&query).eval(wi));
        assert_eq!(own.sample(u), dyed.at(&query).sample(u));
        let own = alone.at(&ClothQuery { sigma_per_um: [Some([0.02; 3]), None], ..query });
        assert_eq!(own.eval(wi), warp.at(&query).eval(wi));
        differ[0] += u32::from(own.eval(wi) != alone.at(&query).eval(wi));
        let own = alone.at(&ClothQuery { models: [Some(thick), None], ..query });
        assert_eq!(own.eval(wi), replaced.at(&query).eval(wi));
        differ[1] += u32::from(own.eval(wi) != alone.at(&query).eval(wi));
    }
    assert!(differ.iter().all(|n| *n > 300), "{differ:?} points have warp yarns");
}

/// A turned pattern seen from a turned direction equals the pattern: f, density, samples, in all cases of the
/// beam.
#[test]
fn turned_patterns_turn_the_light() {
    for gaps in [GapLight::Diffracted, GapLight::Straight] {
        let cloth = cloth(&RED_BLUE, &ClothOptions { gaps, ..Default::default() });
        let (s, c) = 0.7f32.sin_cos();
        let turned = |w: [f32; 3]| [c * w[0] - s * w[1], s * w[0] + c * w[1], w[2]];
        let near = |a: f32, b: f32| (a - b).abs() <= 2e-3 * b.abs() + 2e-4;
        let (mut cases, mut straight, mut off) = ([0; 3], 0, 0);
        for (point, wo, wi, u) in queries(2000) {
            let at = cloth.at(&ClothQuery::new(point, wo, LAMBDA));
            let [x, y, _] = turned([point[0], point[1], 0.0]);
            let query = ClothQuery { turn_rad: 0.7, ..ClothQuery::new([x, y], turned(wo), LAMBDA) };
            let there = cloth.at(&query);
            let case = |at: &ClothBsdf<'_, 3>| if at.is_gap() { 0 } else { 1 + usize::from(at.is_double()) };
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
        println!("{gaps:?}: gaps, one layer, two: {cases:?}; {straight} straight, {off} off");
        assert!(cases.iter().all(|n| *n > 50) && off < 30, "{cases:?}, {off} off");
        assert_eq!(straight > 0, gaps == GapLight::Straight);
    }
}

/// A cell further the light is the same, but for the fibers that each yarn has of its own.
#[test]
fn cells_have_no_seam() {
    let cloth = cloth(&RED_BLUE, &ClothOptions { relief: false, ..ClothOptions::SMOOTH });
    let (mut off, mut differ) = (0, 0);
    for (k, ([x, y], wo, wi, _)) in queries(2000).into_iter().enumerate() {
        // Across the borders of the cell at the origin.
        let point = [x.rem_euclid(CELL_UM), 0.01 * y];
        let at = |[i, j]: [f32; 2]| {
            let point = [point[0] + i * CELL_UM, point[1] + j * CELL_UM];
            cloth.at(&ClothQuery::new(point, wo, LAMBDA)).eval_pdf(wi)
        };
        let (f, pdf) = at([0.0; 2]);
        let (g, density) = at([[1.0, 0.0], [0.0, 1.0], [-3.0, 2.0], [-1.0, -1.0]][k % 4]);
        // Single precision resolves positions to 1e-4 um here.
        let near = |a: f32, b: f32| (a - b).abs() <= 2e-3 * (1.0 + a.max(b));
        off += u32::from(!(near(pdf, density) && (0..3).all(|i| near(f[i], g[i]))));
        differ += u32::from(!near(f[0], f[2]));
    }
    println!("{off} of 2000 points differ a cell on");
    assert!(off < 10 && differ > 500, "{off} of 2000 points differ a cell on, {differ} have a color");
}

/// The models of a cloth, in single lines, can be saved and read: hosts on other machines get them so.
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
