//! How reciprocal the models that ship are. Light of a beam anywhere across the ply, `cos theta_i` times the integral of f over h, is the same with the two directions swapped: the tracer's is
//! (`sim/tests/fiber_truths.rs`), and so a model is off by what its fit and its interpolation are off by. The measure is the rms of the difference over the rms of the light, directions over the
//! whole sphere, sigma = 0.

use plywave::frame::direction;
use plywave::ply::reference::Mixture;
use plywave::{PlyModel, PlyQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::{FRAC_PI_2, TAU};

/// Pairs of directions.
const PAIRS: usize = 3000;
/// Offsets of the beam in each cell of the model's nodes.
const PARTS: usize = 2;

/// Light of f_refl and f_high from a latitude into a latitude at a turn of the azimuth, times the cosine of the first.
fn light(model: &PlyModel, theta_i: f32, theta_o: f32, turn: f32) -> [f64; 2] {
    let h_um = &model.data().h_um;
    let count = (h_um.len() - 1) * PARTS;
    let (first, last) = (h_um[0], h_um[h_um.len() - 1]);
    let wo = direction(theta_o, FRAC_PI_2 + turn);
    let mut sum = [0.0; 2];
    for i in 0..=count {
        let h = first + (last - first) * i as f64 / count as f64;
        let terms = model.at(&PlyQuery::lobes(theta_i, h as f32, [0.0])).terms(wo);
        let weight = if i == 0 || i == count { 0.5 } else { 1.0 };
        sum[0] += weight * f64::from(terms.refl);
        sum[1] += weight * f64::from(terms.high[0]);
    }
    sum.map(|s| s * f64::from(theta_i.cos()) / count as f64)
}

/// The measure of f_refl and of f_high, at latitudes between the nodes or at the nodes alone.
fn off(model: &PlyModel, is_at_nodes: bool) -> [f64; 2] {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let nodes = &model.data().theta_i;
    let last = nodes[nodes.len() - 1] as f32;
    let mut latitude = |rng: &mut Pcg64Mcg| {
        let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
        // Even over the sphere.
        let theta = sign * (rng.random::<f32>() * last.sin()).asin();
        match is_at_nodes {
            false => theta,
            true => sign * nodes[(f64::from(theta.abs()) / nodes[1]).round() as usize] as f32,
        }
    };
    let (mut difference, mut all) = ([0.0; 2], [0.0; 2]);
    for _ in 0..PAIRS {
        let (a, b, turn) = (latitude(&mut rng), latitude(&mut rng), TAU * rng.random::<f32>());
        let (there, back) = (light(model, a, b, turn), light(model, b, a, -turn));
        for k in 0..2 {
            difference[k] += (there[k] - back[k]).powi(2);
            all[k] += 0.5 * (there[k].powi(2) + back[k].powi(2));
        }
    }
    [0, 1].map(|k| if all[k] > 0.0 { (difference[k] / all[k]).sqrt() } else { 0.0 })
}

fn shipped(name: &str) -> PlyModel {
    PlyModel::load(format!("{}/fabrics/models/{name}.pwm", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

#[test]
fn models_that_ship_are_reciprocal() {
    for name in ["alpaca", "cotton", "glass", "gold", "polyester", "silk", "viscose", "wool"] {
        let model = shipped(name);
        let [refl, high] = off(&model, false);
        let at_nodes = off(&model, true);
        println!("{name}: f_refl {refl:.3}, f_high {high:.3}; at the nodes {:.3}, {:.3}", at_nodes[0], at_nodes[1]);
    }
}

/// The runtime evaluates what the model says: glass, whose cones are the sharpest lobes of those that ship, as the f64 reference has it.
#[test]
fn glass_is_evaluated_as_its_model_says() {
    let model = shipped("glass");
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let (mut difference, mut all) = (0.0f64, 0.0f64);
    for _ in 0..300 {
        let (theta_i, h) = (2.8 * (rng.random::<f32>() - 0.5), 90.0 * (rng.random::<f32>() - 0.5));
        let at = model.at(&PlyQuery::lobes(theta_i, h, [0.0]));
        let reference = Mixture::new(model.data(), theta_i.into(), h.into(), &[0.0]).unwrap();
        for _ in 0..10 {
            // About the cone, where the light is.
            let wo =
                direction((0.1 * (rng.random::<f32>() - 0.5) - theta_i).clamp(-1.5, 1.5), TAU * rng.random::<f32>());
            let (got, want) = (f64::from(at.terms(wo).refl), reference.eval_split(wo.map(f64::from)).0);
            difference += (got - want).powi(2);
            all += want.powi(2);
        }
    }
    let rms = (difference / all).sqrt();
    println!("f_refl of glass against the reference: {rms:.1e}");
    assert!(rms < 1e-3, "{rms}");
}
