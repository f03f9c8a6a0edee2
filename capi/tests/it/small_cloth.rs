//! Cloths of straight rules, made in a moment. The benchmark has them too.

use plywave::PlyModel;
use plywave::cloth::{ClothCurves, ClothData, ClothYarn, Lattice, PlyCurve};
use plywave_sim::cloth::{Effort, precompute};
use plywave_textile::ClothSpec;
use std::sync::Arc;

const FABRICS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics");
/// Radius of the plies, and distance of the yarns [um].
const RADIUS_UM: f64 = 50.0;
const SPACING_UM: f64 = 150.0;

/// Plain weave of polyester plies, or a sheet of one kind of yarn: the weft of it.
pub(crate) fn cloth(kinds: u32) -> ClothData {
    let cell_um = [[2.0 * SPACING_UM, 0.0], [0.0, 2.0 * SPACING_UM]];
    let lattice = Lattice::new(cell_um).expect("a cell");
    let mut curves = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
    for kind in 0..kinds {
        let is_warp = kinds == 2 && kind == 0;
        let (period, step) = if is_warp { ([0, 1], [2, 0]) } else { ([1, 0], [0, 2]) };
        for number in 0..2 {
            let index = curves.yarns.len() as u32;
            curves.yarns.push(ClothYarn { kind, number, step, period });
            let sign = if is_warp == (number == 0) { 1.0 } else { -1.0 };
            let points: Vec<[f64; 3]> = (0..12)
                .map(|i| {
                    let t = f64::from(i) / 12.0;
                    let along = 2.0 * SPACING_UM * t;
                    let across = (f64::from(number) + 0.5) * SPACING_UM;
                    let z = sign * (RADIUS_UM + 2.0) * (std::f64::consts::TAU * (t - 0.25)).cos();
                    if is_warp { [across, along, z] } else { [along, across, z] }
                })
                .collect();
            curves.curves.push(PlyCurve::through(index, RADIUS_UM, period, &points, &lattice));
        }
    }
    let red = "model = \"polyester\"\nfiber = \"polyester\"\ncount = \"10 tex\"\npacking = 0.6\nbundles = 1\n\
               color = [0.7, 0.1, 0.1]\n";
    let text = match kinds {
        1 => format!("name = \"sheet\"\n[curves]\nfile = \"sheet.toml\"\n[yarn]\n{red}"),
        _ => format!(
            "name = \"plain\"\n[weave]\nkind = \"plain\"\nends_per_cm = 66\npicks_per_cm = 66\n[warp]\n{red}\
             [weft]\nas = \"warp\"\ncolor = [0.1, 0.2, 0.6]\n"
        ),
    };
    let spec = ClothSpec::parse(&text, "small.toml").expect("a good spec");
    let model = Arc::new(PlyModel::load(format!("{FABRICS}/models/polyester.pwm")).expect("a model that ships"));
    precompute(
        &spec,
        &text,
        &curves,
        &vec![model; kinds as usize],
        if kinds == 2 { Effort::Full } else { Effort::Near },
        &|_| true,
    )
    .expect("a cloth")
}
