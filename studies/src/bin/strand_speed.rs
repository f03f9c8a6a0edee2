//! Times of strands: the BVH over 10 000 B-spline strands of 100 segments, and its rays on one thread, near
//! and far, as tubes and bands.
//!
//! `cargo run --release -p plywave-studies --bin strand_speed [curves.txt [count [rays]]]`; with a path,
//! the strands are written there as Mitsuba's curve text, and the rays from all sides and those of a camera
//! beside it as `sides.f32` and `camera.f32` (six 32-bit floats a ray), to be traced by others:
//! `scripts/embree_strands.sh`.

use glam::DVec3;
use plywave_render::{GeneratedStrands, StrandShape, StrandTree, make, mitsuba_text};
use rand::{RngExt, SeedableRng};
use std::f64::consts::TAU;
use std::time::Instant;

fn unit(rng: &mut rand_pcg::Pcg64Mcg) -> DVec3 {
    let z = 2.0 * rng.random::<f64>() - 1.0;
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

/// Processor time of this thread [s] on Linux, without the work of others.
fn clock(begun: Instant) -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok())
        .map_or(begun.elapsed().as_secs_f64(), |ns| 1e-9 * ns)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let all = Instant::now();
    let count = std::env::args().nth(2).map_or(Ok(10_000), |text| text.parse())?;
    let side = std::env::args().nth(3).map_or(Ok(1_000_000), |text| text.parse::<u64>())?.isqrt().max(1);
    let what = GeneratedStrands::Ball { count, ball_mm: 30.0, length_mm: 26.0, curl_mm: 2.5 };
    let strands = make(&what, 0.045, 100, 1)?;
    println!("{} strands, {} segments", strands.len(), strands.segments());
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
    let rays = |distance: f64, rng: &mut rand_pcg::Pcg64Mcg| -> Vec<(DVec3, DVec3)> {
        (0..side * side)
            .map(|_| {
                // Through the ball from all sides: between two points around it.
                let (a, b) = (unit(rng) * 60.0, unit(rng) * (50.0 * rng.random::<f64>().cbrt()));
                let w = (b - a).normalize();
                let (o, w) = ((a - w * distance).as_vec3().as_dvec3(), w.as_vec3().as_dvec3());
                (o, w.normalize())
            })
            .collect()
    };
    let near = rays(0.0, &mut rng);
    let far = rays(1000.0, &mut rng);
    // Neighbors in a square picture.
    let camera: Vec<(DVec3, DVec3)> = (0..side * side)
        .map(|k| {
            let place = |k: u64| 2.0 * k as f64 / side as f64 - 1.0;
            let (x, y) = (place(k % side), place(k / side));
            let o = DVec3::new(0.0, -260.0, 0.0);
            (o, (DVec3::new(58.0 * x, 0.0, 58.0 * y) - o).as_vec3().as_dvec3().normalize())
        })
        .collect();
    if let Some(path) = std::env::args().nth(1) {
        std::fs::write(&path, mitsuba_text(&strands))?;
        for (name, rays) in [("sides.f32", &near), ("camera.f32", &camera)] {
            let numbers = rays.iter().flat_map(|(o, w)| [o.x, o.y, o.z, w.x, w.y, w.z]);
            let bytes: Vec<u8> = numbers.flat_map(|v| (v as f32).to_le_bytes()).collect();
            std::fs::write(std::path::Path::new(&path).with_file_name(name), bytes)?;
        }
    }
    for shape in [StrandShape::Tube, StrandShape::Band] {
        let (start, begun) = (Instant::now(), clock(all));
        let tree = StrandTree::new(strands.clone(), shape);
        println!(
            "{shape:?}: BVH in {:.2} s of one thread, {:.2} s by the clock, {:.1} MB",
            clock(all) - begun,
            start.elapsed().as_secs_f64(),
            tree.memory_bytes() as f64 / 1e6
        );
        for (name, rays) in [("from all sides", &near), ("the same, 1 m farther off", &far), ("of a camera", &camera)] {
            // The best of three runs, as others use the machine too.
            let (mut best, mut hits) = (f64::INFINITY, 0);
            for _ in 0..3 {
                let begun = clock(all);
                hits = rays.iter().filter(|(o, w)| tree.first(*o, *w, 0.0, f64::INFINITY, &[]).is_some()).count();
                best = best.min(clock(all) - begun);
            }
            println!("  rays {name}: {:.2} M/s, {hits} hits", rays.len() as f64 / best / 1e6);
            let (mut nodes, mut bundles, mut segments) = (0, 0, 0);
            for cost in rays.iter().step_by(10).map(|(o, w)| tree.cost(*o, *w)) {
                nodes += cost.nodes;
                bundles += cost.bundles;
                segments += cost.segments;
            }
            let mean = |n: u64| n as f64 / (rays.len() as f64 / 10.0);
            let (nodes, bundles, segments) = (mean(nodes), mean(bundles), mean(segments));
            println!(
                "    a ray: {nodes:.1} nodes of eight boxes, {bundles:.1} bundles of eight capsules, {segments:.1} segments"
            );
        }
    }
    Ok(())
}
