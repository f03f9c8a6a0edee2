//! Two straight layers of touching plies, one ply per yarn: reflectance and transmittance by path tracing of
//! the explicit fibers.
//!
//!     cargo run --release -p plywave-studies --bin twin_layers -- [PATHS] [POINTS] [untwisted]

use plywave::fabric::{Draft, Fabric, YarnShape};
use plywave::spec::{Handedness, POLYESTER};
use plywave_sim::Run;
use plywave_sim::twin::{TwinCloth, TwinJob, TwinMesh, TwinOptions, direction};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let number = |at: usize, default: u32| std::env::args().nth(at).and_then(|v| v.parse().ok()).unwrap_or(default);
    let shape = YarnShape {
        plies: 1,
        ply_radius_um: 50.0,
        ply_pitch_um: None,
        handedness: Handedness::Z,
        spacing_um: 100.0,
        crimp: 0.5,
        d_cut_um: 0.0,
    };
    let fabric = Fabric::new(Draft::layers(), [shape; 2])?;
    let untwisted = std::env::args().nth(3).is_some_and(|v| v == "untwisted");
    let yarn = if untwisted { POLYESTER.replace("fiber_pitch_um", "# fiber_pitch_um") } else { POLYESTER.into() };
    let cloth = TwinCloth::new("layers", fabric, vec![yarn], [vec![0], vec![0]])?;
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
    let twin = plywave_sim::runs::run(&job, Run::plain())?;
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
