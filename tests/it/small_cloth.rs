//! A small plain weave of models that ship, made without the simulator: curves through points, open enough to
//! have gaps.
#![allow(dead_code)]

use plywave::PlyModel;
use plywave::cloth::{ClothCurves, ClothData, ClothModel, ClothOptions, ClothYarn, Lattice, PlyCurve};
use plywave_sim::cloth::{Effort, precompute};
use plywave_textile::ClothSpec;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::{Arc, LazyLock};

/// Radius of the plies [um].
const RADIUS_UM: f64 = 50.0;
/// Distance from yarn to yarn [um].
pub const SPACING_UM: f64 = 190.0;
/// Side of the square cell [um].
pub const CELL_UM: f32 = 2.0 * SPACING_UM as f32;
/// Each yarn alone, without inter-yarn scattering, smooth, so that each point keeps all light.
pub const ALONE: ClothOptions = ClothOptions { layers: false, shadowing: false, relief: false, ..ClothOptions::SMOOTH };

pub fn model(name: &str) -> Arc<PlyModel> {
    let bytes: &[u8] = match name {
        "gold" => include_bytes!("../../fabrics/models/gold.pwm"),
        _ => include_bytes!("../../fabrics/models/polyester.pwm"),
    };
    Arc::new(PlyModel::from_bytes(bytes, name).unwrap())
}

/// Spec of a plain weave, with more keys of warp and weft.
pub fn spec([warp, weft]: [&str; 2]) -> String {
    let yarn = "fiber = \"polyester\"\ncount = \"10 tex\"\npacking = 0.6\nbundles = 1\n";
    let weave = "name = \"small\"\n[weave]\nkind = \"plain\"\nends_per_cm = 52\npicks_per_cm = 52\n";
    format!("{weave}[warp]\n{yarn}{warp}\n[weft]\n{yarn}{weft}\n")
}

fn parsed(text: &str) -> ClothSpec {
    ClothSpec::parse(text, "small.toml").unwrap()
}

/// A plain weave of plies whose axes are cosines: two ends, two picks.
fn plain(spacing_um: f64) -> ClothCurves {
    let cell_um = [[2.0 * spacing_um, 0.0], [0.0, 2.0 * spacing_um]];
    let lattice = Lattice::new(cell_um).unwrap();
    let mut curves = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
    for (kind, number) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let (period, step) = if kind == 0 { ([0, 1], [2, 0]) } else { ([1, 0], [0, 2]) };
        // Plies that cross are 4 um apart; end 0 lies above pick 0.
        let height_um = RADIUS_UM + 2.0;
        let sign = if (kind == 0) == (number == 0) { 1.0 } else { -1.0 };
        let across = (f64::from(number) + 0.5) * spacing_um;
        let point = |i: u32| {
            let along = 2.0 * spacing_um * f64::from(i) / 16.0;
            let z = sign * height_um * (TAU * f64::from(i) / 16.0 - FRAC_PI_2).cos();
            if kind == 0 { [across, along, z] } else { [along, across, z] }
        };
        let points: Vec<[f64; 3]> = (0..16).map(point).collect();
        let index = curves.yarns.len() as u32;
        curves.yarns.push(ClothYarn { kind, number, step, period });
        curves.curves.push(PlyCurve::through(index, RADIUS_UM, period, &points, &lattice));
    }
    curves
}

/// A plain weave of a warp and a weft of these models, of plies of 50 um.
pub fn woven(models: [Arc<PlyModel>; 2], yarns: [&str; 2], spacing_um: f64, has_far: bool) -> ClothData {
    let effort = if has_far { Effort::Full } else { Effort::Near };
    let text = spec(yarns);
    precompute(&parsed(&text), &text, &plain(spacing_um), &models, effort, &|_| true).unwrap()
}

/// A warp of polyester and a weft of gold, undyed, with the mean over the cell, which takes a while.
pub static LAME: LazyLock<ClothData> =
    LazyLock::new(|| woven(["polyester", "gold"].map(model), [""; 2], SPACING_UM, true));
/// Polyester alone, red and blue, without the mean.
pub static RED_BLUE: LazyLock<ClothData> = LazyLock::new(|| {
    let colors = ["color = [0.5, 0.06, 0.12]", "color = [0.1, 0.2, 0.6]"];
    woven(["polyester"; 2].map(model), colors, SPACING_UM, false)
});

/// [`RED_BLUE`] with a weft of gold, undyed. What is found of a cloth once is that of polyester: for colors.
pub fn gilded() -> ClothData {
    let mut data = with_keys(&RED_BLUE, [""; 2]);
    data.models[1] = Arc::new(model("gold").of_lines().unwrap());
    data
}

pub fn cloth(data: &ClothData, options: &ClothOptions) -> ClothModel {
    ClothModel::from_data(data.clone(), options).unwrap()
}

/// The same cloth with more keys of warp and weft.
pub fn with_keys(data: &ClothData, yarns: [&str; 2]) -> ClothData {
    let text = spec(yarns);
    let spec = parsed(&text);
    ClothData { spec_text: text, color_of: spec.color_of, looks: spec.looks(), ..data.clone() }
}
