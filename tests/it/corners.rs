//! Every model that loads is evaluated in bounded time. Each tensor of a small model is set in turn to the
//! ends of the range that loads, found by bisection of the loader, and the code of `plywave check`, `eval`,
//! `sample`, `info` and `plot` runs on the result. At the ends of a bandwidth the integrals over the sphere
//! are accurate too: the check's nodes follow the lobe (`conformance/src/nodes.rs` compares them with closed
//! forms).

use plywave::Document;
use plywave::frame::direction;
use plywave::ply::{PlyData, PlyPlace};
use plywave::{Bsdf, PlyModel, PlyQuery};
use plywave_check::{CheckOptions, FURNACE_TOLERANCE, check_incidence, check_layers, check_model, check_whole};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::time::{Duration, Instant};

/// Longest time for one model: a hundred times that of any, for busy machines.
const LIMIT: Duration = Duration::from_secs(20);

/// A model's file, whose tensors are changed in place.
struct File {
    bytes: Vec<u8>,
    tensors: Vec<Tensor>,
}

#[derive(Clone)]
struct Tensor {
    name: String,
    at: usize,
    /// Bytes of a number, 4 or 8.
    size: usize,
    count: usize,
}

/// Choice of the changed numbers of a tensor.
#[derive(Clone, Copy, Debug)]
enum Change {
    /// One takes a value.
    One(usize),
    /// Every `stride`-th from `first` on takes a value.
    Each { first: usize, stride: usize },
    /// All are multiplied.
    Scale,
}

impl File {
    fn load(name: &str) -> File {
        let bytes = std::fs::read(format!("{}/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap();
        let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let document: serde_json::Value = serde_json::from_slice(&bytes[8..8 + header]).unwrap();
        let tensors = document
            .as_object()
            .unwrap()
            .iter()
            .filter(|(_, t)| t["dtype"].as_str().is_some_and(|d| d.starts_with('F')));
        let tensors = tensors
            .map(|(name, t)| {
                let [from, to] = [0, 1].map(|k| t["data_offsets"][k].as_u64().unwrap() as usize);
                let size = if t["dtype"] == "F32" { 4 } else { 8 };
                Tensor { name: name.clone(), at: 8 + header + from, size, count: (to - from) / size }
            })
            .collect();
        File { bytes, tensors }
    }

    fn tensor(&self, name: &str) -> &Tensor {
        self.tensors.iter().find(|t| t.name == name).unwrap_or_else(|| panic!("no {name}"))
    }

    fn value(&self, t: &Tensor, i: usize) -> f64 {
        let bytes = &self.bytes[t.at + i * t.size..][..t.size];
        match t.size {
            4 => f32::from_le_bytes(bytes.try_into().unwrap()).into(),
            _ => f64::from_le_bytes(bytes.try_into().unwrap()),
        }
    }

    fn with(&self, t: &Tensor, change: Change, value: f64) -> Vec<u8> {
        let mut bytes = self.bytes.clone();
        let mut put = |i: usize, value: f64| {
            let to = &mut bytes[t.at + i * t.size..][..t.size];
            match t.size {
                4 => to.copy_from_slice(&(value as f32).to_le_bytes()),
                _ => to.copy_from_slice(&value.to_le_bytes()),
            }
        };
        match change {
            Change::One(i) => put(i, value),
            Change::Each { first, stride } => (first..t.count).step_by(stride).for_each(|i| put(i, value)),
            Change::Scale => (0..t.count).for_each(|i| put(i, value * self.value(t, i))),
        }
        bytes
    }

    /// The files at the lower and upper end of a change, by `signs`: the farthest values that load.
    fn ends(&self, t: &Tensor, change: Change, signs: &[f64]) -> Vec<(f64, Vec<u8>)> {
        let start = match change {
            Change::One(i) | Change::Each { first: i, .. } => self.value(t, i),
            Change::Scale => 1.0,
        };
        let mut ends = Vec::new();
        for &sign in signs {
            let at = |exponent: f64| match change {
                Change::Scale => (sign * 10f64.powf(exponent)).exp(),
                _ => start + sign * 10f64.powf(exponent),
            };
            let loads = |exponent: f64| PlyData::from_bytes(&self.with(t, change, at(exponent)), "corner").is_ok();
            let (mut low, mut high) = (-9.0, 12.0);
            if loads(high) {
                low = high;
            } else if !loads(low) {
                continue;
            }
            while high - low > 1e-3 {
                let middle = 0.5 * (low + high);
                if loads(middle) { low = middle } else { high = middle }
            }
            ends.push((at(low), self.with(t, change, at(low))));
        }
        ends
    }
}

/// Runs the code of the commands on a model; returns the time and whether its integrals are accurate.
fn run(bytes: &[u8]) -> (Duration, bool) {
    let begun = Instant::now();
    let model = PlyModel::from_bytes(bytes, "corner").unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let options = CheckOptions { incidences: 3, samples: 300, ..CheckOptions::default() };
    let lobes = check_model(&model, &options, &mut || rng.random());
    let whole = check_whole(&model, &options, &mut || rng.random());
    let layers = check_layers(&model, &options, &mut || rng.random());
    let d = model.data();
    let last = [&d.theta_i, &d.h_um, &d.sigma_per_um].map(|axis| axis[axis.len() - 1] as f32);
    for (t, h) in [(0.0, 0.0), (-0.7, 0.6), (1.0, -1.0)] {
        let query = PlyQuery::new(t * last[0], h * last[1], [0.0, 0.1 * last[2], last[2]], [0.4, 0.55, 0.7]);
        let spotted = PlyQuery { place: Some(PlyPlace::new(3, h, 100.0)), ..query };
        for at in [model.at(&query), model.at(&spotted)] {
            for i in 0..16 {
                let wo = direction(0.19 * i as f32 - 1.5, 0.4 * i as f32);
                assert!(at.eval(wo).iter().chain([&at.pdf(wo)]).all(|v| v.is_finite()), "eval at {wo:?}");
                at.sample([rng.random(), rng.random(), rng.random()]);
            }
        }
    }
    let nodes = d.node_energies();
    assert!(
        nodes.iter().all(|e| e.r_d.is_finite() && d.sigma_per_um.iter().all(|s| e.high_at(*s, &d.path_um).is_finite()))
    );
    // The integral of f follows the lobes at any bandwidths. The density has a wedge about the axis of a lobe
    // that is as wide as the sphere one way and sharp the other, finer than the lobe: its integral is known
    // to a few thousandths there.
    let whole = whole.map(|w| w.scatter);
    let furnace = lobes.furnace_error().max(whole.map_or(0.0, |w| w.furnace_error));
    let density = lobes.pdf_error().max(whole.map_or(0.0, |w| w.pdf_error));
    println!("  furnace {furnace:.1e}, density {density:.1e}");
    let held = furnace <= FURNACE_TOLERANCE && density <= 10.0 * FURNACE_TOLERANCE;
    // Other tests compare layers with their limits; here they need only a finite result.
    assert!(layers.is_none_or(|l| l.scatter.furnace_error.is_finite()));
    (begun.elapsed(), held)
}

/// Runs the ends of a change.
fn corner(file: &File, name: &str, change: Change, signs: &[f64], is_held: bool) {
    let tensor = file.tensor(name);
    for (value, bytes) in file.ends(tensor, change, signs) {
        let (time, held) = run(&bytes);
        println!("{name} {change:?} {value:.6e}: {time:.2?}{}", if held { "" } else { ", integrals off" });
        assert!(time < LIMIT, "{name} {change:?} = {value}: {time:?}");
        assert!(held || !is_held, "{name} {change:?} = {value}: the integrals are off");
    }
}

/// Sharp edge lobes, across and along the ply and one alone, are checked in bounded time, and so are sharp
/// lobes of f_high.
#[test]
fn bandwidths_at_their_ends_are_resolved() {
    let file = File::load("tests/data/small.pwm");
    for side in [0, 1] {
        corner(&file, "edge_ln_mu", Change::Each { first: side, stride: 2 }, &[1.0], true);
    }
    corner(&file, "edge_ln_mu", Change::One(280), &[1.0], true);
    corner(&file, "high", Change::Each { first: 3, stride: 6 }, &[1.0], true);
}

#[test]
#[ignore = "slow: 300 s: every tensor of the file"]
fn every_tensor_at_its_ends_is_answered_in_time() {
    let small = File::load("tests/data/small.pwm");
    // Tensors that the small model lacks.
    let whole = File::load("fabrics/models/polyester.pwm");
    for file in [&small, &whole] {
        for tensor in &file.tensors {
            if std::ptr::eq(file, &whole) && small.tensors.iter().any(|t| t.name == tensor.name) {
                continue;
            }
            let mut changes = vec![Change::Scale, Change::Each { first: 0, stride: 1 }];
            changes.extend([0, tensor.count / 2, tensor.count - 1].map(Change::One));
            if tensor.name == "edge_ln_mu" {
                changes.extend([0, 1].map(|first| Change::Each { first, stride: 2 }));
            }
            if ["refl", "high"].contains(&tensor.name.as_str()) {
                changes.extend((0..6).map(|first| Change::Each { first, stride: 6 }));
            }
            // The integrals follow the bandwidths.
            let is_held = |change: &Change| {
                let sides = matches!(change, Change::Each { first: 3 | 4, .. });
                tensor.name == "edge_ln_mu" || (sides && ["refl", "high"].contains(&tensor.name.as_str()))
            };
            for change in changes {
                corner(file, &tensor.name, change, &[-1.0, 1.0], is_held(&change));
            }
        }
    }
}

/// The end of a bandwidth is resolved at one incidence too, where the edge is cut.
#[test]
fn the_sharpest_lobes_are_checked_at_grazing_light() {
    let file = File::load("tests/data/small.pwm");
    let high = file.tensor("high");
    let bytes = file.with(high, Change::Each { first: 3, stride: 6 }, 20_000f64.ln());
    let model = PlyModel::from_bytes(&bytes, "sharp").unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    for theta_i in [-1.5, 1.2] {
        let r = check_incidence(&model, theta_i, 9.0, [0.0, 0.01, 0.1, 1.0], 4000, &mut || rng.random());
        assert!(r.furnace_error < FURNACE_TOLERANCE && r.pdf_error < FURNACE_TOLERANCE && r.chi2_p > 1e-4, "{r:?}");
    }
}
