//! Two straight layers of touching plies, one ply per yarn: reflectance and transmittance by path tracing of
//! the explicit fibers.
//!
//!     cargo run --release -p plywave-studies --bin twin_layers -- [PATHS] [POINTS] [untwisted]

use plywave::cloth::{ClothCurves, ClothYarn, Lattice, PlyCurve};
use plywave::spec::POLYESTER;
use plywave_runs::Run;
use plywave_sim::twin::{TwinCurves, TwinJob, TwinMesh, TwinOptions, direction};
use std::time::Instant;

/// Radius of the plies [um].
const RADIUS_UM: f64 = 50.0;

/// A ply along y above a ply along x, in a cell as wide as a ply.
fn layers() -> Result<ClothCurves, Box<dyn std::error::Error>> {
    let side = 2.0 * RADIUS_UM;
    let cell_um = [[side, 0.0], [0.0, side]];
    let lattice = Lattice::new(cell_um).ok_or("no cell")?;
    let mut curves = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
    for (kind, period, step) in [(0, [0, 1], [1, 0]), (1, [1, 0], [0, 1])] {
        let point = |i: u32| {
            let (across, along) = (RADIUS_UM, side * f64::from(i) / 4.0);
            if kind == 0 { [across, along, RADIUS_UM] } else { [along, across, -RADIUS_UM] }
        };
        let points: Vec<[f64; 3]> = (0..4).map(point).collect();
        curves.yarns.push(ClothYarn { kind, number: 0, step, period });
        curves.curves.push(PlyCurve::through(kind, RADIUS_UM, period, &points, &lattice));
    }
    Ok(curves)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let number = |at: usize, default: u32| std::env::args().nth(at).and_then(|v| v.parse().ok()).unwrap_or(default);
    let untwisted = std::env::args().nth(3).is_some_and(|v| v == "untwisted");
    let yarn = if untwisted { POLYESTER.replace("fiber_pitch_um", "# fiber_pitch_um") } else { POLYESTER.into() };
    let cloth = TwinCurves::new("layers", layers()?, vec![yarn; 2])?;
    let points = number(2, 24);
    let mesh = TwinMesh { outline_points: points, turn_rad: 0.2 * 24.0 / f64::from(points), ..TwinMesh::default() };
    let options = TwinOptions {
        views: [0.0f64, 60.0].map(|tilt| direction(tilt.to_radians(), 0.0)).to_vec(),
        paths: number(1, 100_000).into(),
        mesh,
        ..TwinOptions::default()
    };
    let job = TwinJob::new(cloth, &options)?;
    println!("{:?}", job.domain());
    let begun = Instant::now();
    println!("{:?} in {:?}", job.size()?, begun.elapsed());
    let begun = Instant::now();
    let twin = plywave_runs::run(&job, Run::plain())?;
    println!("{:?}", begun.elapsed());
    for view in 0..twin.view_count() {
        println!(
            "view {:?}: straight {:.4}, killed {:.1e}, walls {:.1}",
            twin.view(view),
            twin.straight[view],
            twin.killed[view],
            twin.interactions[view]
        );
        for sigma in 0..twin.sigma_count() {
            let (light, se) = (twin.light(view, sigma), twin.standard_errors(view, sigma));
            println!(
                "  sigma {:?}: R {:.4} +- {:.4}, T {:.4} +- {:.4}, sum {:.4}",
                twin.sigma(sigma),
                light.reflected,
                se[0],
                light.transmitted,
                se[1],
                light.reflected + light.transmitted + light.straight
            );
        }
    }
    Ok(())
}
