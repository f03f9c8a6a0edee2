//! Guarantees of loading: every model that loads gives finite, non-negative light, and no more than the
//! incident light; invalid directions give none.

use crate::no_direction::{NONE, dark};
use crate::small_cloth::{RED_BLUE, cloth};
use crate::synthetic::{Sizes, model};
use plywave::Document;
use plywave::cloth::ClothOptions;
use plywave::gap::{Aperture, Gap};
use plywave::ply::{Layer, LayerFactors, PlyData};
use plywave::spec::GaussianBeam;
use plywave::{Bsdf, ClothQuery, PlyModel, PlyQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::path::{Path, PathBuf};

const SMALL: Sizes = Sizes { theta: 3, h: 5, refl: 1, high: 2, paths: 3 };

fn files(folder: &str, extension: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    entries.filter(|p| p.extension().is_some_and(|e| e == extension)).collect()
}

/// A model with the forward share `share` of its energy, and these reflectance and transmittance of diffuse
/// light.
fn layered(share: f64, back: f64, through: f64) -> PlyData {
    let mut data = model(3, SMALL);
    let (m, h, j) = (data.theta_i.len(), data.h_um.len(), data.path_um.len());
    let mut forward = Vec::new();
    for row in 0..2 * m - 1 {
        for column in 0..2 * h - 1 {
            let half = |axis: &[f64], i: usize| 0.5 * (axis[i / 2] + axis[i.div_ceil(2)]);
            let energies = data.energies.at(half(&data.theta_i, row), half(&data.h_um, column));
            forward.push(share * energies.refl);
            forward.extend(energies.high.iter().map(|e| share * e));
        }
    }
    let mut diffuse = vec![0.0; 2 * (1 + j)];
    (diffuse[0], diffuse[1 + j]) = (back, through);
    data.layers = Some(LayerFactors { forward, diffuse });
    data
}

#[test]
fn models_that_ship_load() {
    let models = files("fabrics/models", "pwm");
    assert!(models.len() > 3);
    for path in models {
        let layered = PlyModel::load(&path).unwrap().data().layers.is_some();
        println!("{}: layers {layered}", path.display());
    }
}

/// A file without nodes that has layer tensors: sizes are checked before `2 M - 1` is computed from them.
#[test]
fn no_nodes_are_refused_before_any_arithmetic() {
    let good = model(1, SMALL).to_bytes().unwrap();
    let n = u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    let header: serde_json::Value = serde_json::from_slice(&good[8..8 + n]).unwrap();
    for (m, h) in [(0, 0), (0, 5), (3, 0)] {
        let mut empty = serde_json::json!({ "__metadata__": header["__metadata__"] });
        let mut at = 0;
        let shapes: [(&str, &str, Vec<usize>); 18] = [
            ("theta_i", "F64", vec![m]),
            ("h_um", "F64", vec![h]),
            ("sigma_per_um", "F64", vec![1]),
            ("path_um", "F64", vec![1]),
            ("miss_theta_i", "F64", vec![m]),
            ("miss_h_um", "F64", vec![h]),
            ("miss", "F32", vec![m, h]),
            ("share_theta_i", "F64", vec![m]),
            ("share_h_um", "F64", vec![h]),
            ("share_refl", "F32", vec![m, h]),
            ("share_high", "F32", vec![m, h, 1]),
            ("refl", "F32", vec![m, h, 1, 6]),
            ("high", "F32", vec![m / 2, h / 2, 2, 2, 1, 6]),
            ("high_path", "F32", vec![m / 2, h / 2, 2, 2, 1, 1]),
            ("error_refl", "F64", vec![m, h]),
            ("error_high", "F64", vec![m, h, 1]),
            ("layer_forward", "F64", vec![0, 0, 2]),
            ("layer_diffuse", "F64", vec![2, 2]),
        ];
        for (name, dtype, shape) in shapes {
            let bytes = shape.iter().product::<usize>() * if dtype == "F32" { 4 } else { 8 };
            empty[name] = serde_json::json!({ "dtype": dtype, "shape": shape, "data_offsets": [at, at + bytes] });
            at += bytes;
        }
        let text = empty.to_string();
        let bytes = [&(text.len() as u64).to_le_bytes(), text.as_bytes(), &vec![0; at]].concat();
        let error = PlyModel::from_bytes(&bytes, "empty").map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("0 values: expected an odd number"), "{error}");
    }
}

#[test]
fn layer_factors_are_held_to_the_energies() {
    PlyModel::from_data(layered(1.0, 0.4, 0.6)).unwrap();
    let says = |data: PlyData, what: &str| {
        let error = PlyModel::from_data(data).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(what) && error.lines().count() == 1, "{error:?} does not say {what:?}");
    };
    let mut more = layered(1.0, 0.4, 0.6);
    let node = more.node_energies().swap_remove(7);
    let high: f64 = node.high.iter().sum();
    let (columns, size) = (2 * more.h_um.len() - 1, 1 + more.path_um.len());
    // The node (1, 2).
    let at = (2 * columns + 4) * size;
    more.layers.as_mut().unwrap().forward[at + 1..at + size].fill((high + 0.06) / 3.0);
    says(more, "layer_forward of f_high at row 2, column 4");
    let mut more = layered(0.5, 0.4, 0.6);
    more.layers.as_mut().unwrap().forward[at] = node.refl + 0.06;
    says(more, "layer_forward of f_refl at row 2, column 4");
    says(layered(0.5, 0.8, 0.6), "sum of layer_diffuse");
    let mut dense = layered(0.5, 0.4, 0.6);
    dense.theta_i.iter_mut().for_each(|t| *t *= 1e-300);
    says(dense, "theta_i[1]");
}

/// f, density and albedo of two layers are valid over any that load, and over any layer of a host.
#[test]
fn two_layers_of_any_model_give_no_negative_light() {
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    // The tolerance allows the last: slightly more light goes forward than the total.
    let mut beyond = layered(1.0, 0.45, 0.6);
    beyond.layers.as_mut().unwrap().forward.iter_mut().for_each(|f| *f = (*f + 0.012).min(1.0));
    let mut doubles = 0;
    for data in [layered(0.5, 0.4, 0.6), layered(0.0, 1.0, 0.0), layered(1.0, 0.0, 1.0), layered(1.0, 1.0, 0.0), beyond]
    {
        let ply = PlyModel::from_data(data).unwrap();
        for i in 0..400 {
            let (theta_i, h_um) = (1.5 * (2.0 * rng.random::<f32>() - 1.0), 140.0 * (2.0 * rng.random::<f32>() - 1.0));
            let sigma = [0.0, 0.01];
            let made_up = Layer {
                reflected: [-0.5; 2],
                transmitted: [f32::NAN; 2],
                reflected_diffuse: [1e30; 2],
                transmitted_diffuse: [1.0; 2],
            };
            let below = if i % 4 == 0 { made_up } else { ply.layer(theta_i, sigma).unwrap() };
            for v in [below.reflected, below.transmitted, below.reflected_diffuse, below.transmitted_diffuse] {
                assert!(i % 4 == 0 || v.iter().all(|v| (0.0..=1.0).contains(v)), "{below:?}");
            }
            let at = ply.at(&PlyQuery { below: Some(below), ..PlyQuery::new(theta_i, h_um, sigma, [0.5, 0.6]) });
            doubles += u32::from(at.is_double());
            let w: [f32; 3] = rng.random::<[f32; 3]>().map(|x| 2.0 * x - 1.0);
            let length = w.iter().map(|x| x * x).sum::<f32>().sqrt();
            let (f, pdf) = at.eval_pdf(w.map(|x| x / length));
            assert!(f.iter().chain([&pdf]).all(|f| f.is_finite() && *f >= 0.0), "{theta_i} {h_um}: {f:?} {pdf}");
            assert!(at.albedo().iter().all(|a| (0.0..=1.0501).contains(a)), "{theta_i} {h_um}: {:?}", at.albedo());
        }
    }
    assert!(doubles > 1000, "{doubles}");
}

#[test]
fn what_is_no_direction_gives_no_light() {
    let two = layered(0.5, 0.4, 0.6);
    let ply = PlyModel::from_data(two).unwrap();
    let below = ply.layer(0.3, [0.01]).unwrap();
    let beam = GaussianBeam { w0_um: 10.0, lambda_um: 0.5, d_cut_um: 20.0 };
    let gap = Gap::new(&Aperture::centered(10.0, 4.0).unwrap(), &beam);
    let cloth = cloth(&RED_BLUE, &ClothOptions::default());
    for w in NONE {
        dark(&ply.at(&PlyQuery::new(0.0, 0.0, [0.01], [0.5])), w, "ply");
        dark(&ply.at(&PlyQuery { below: Some(below), ..PlyQuery::new(0.3, 5.0, [0.01], [0.5]) }), w, "two layers");
        dark(&gap.at([0.0, 0.6, 0.8], [0.5, 0.6]), w, "gap");
        let at = gap.at(w, [0.5, 0.6]);
        dark(&at, [0.0, 0.6, 0.8], "gap lit from nowhere");
        assert_eq!(at.albedo(), [0.0; 2]);
        for i in 0..200 {
            let at = [17.3 * i as f32, 29.1 * i as f32];
            dark(&cloth.at(&ClothQuery::rgb(at, [0.0, 0.6, 0.8])), w, "cloth");
        }
    }
}
