//! Radial density of packed plies, probability to hit a fiber, and time per ply:
//! `cargo run --release -p plywave-studies --bin packing -- fabrics/[!C]*.toml`.
//!

use plywave::spec::Packing;
use plywave_sim::PlySection;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for file in std::env::args().skip(1) {
        for packing in [Packing::Falling, Packing::Lined] {
            let (mut spec, _) = plywave_textile::load_yarn_file(&file)?;
            spec.ply.packing = packing;
            let radius = spec.ply_radii_um()[0];
            let started = Instant::now();
            let plies = (0..40).map(|seed| PlySection::generate(&spec, seed)).collect::<Result<Vec<_>, _>>()?;
            let seconds = started.elapsed().as_secs_f64() / plies.len() as f64;
            let h: Vec<f64> = [0.0, 0.5, 0.7, 0.8, 0.9, 0.95].iter().map(|h| h * radius).collect();
            let mut met = vec![0.0; h.len()];
            for ply in &plies {
                met.iter_mut().zip(ply.chance_to_meet(&h, 180)).for_each(|(sum, m)| *sum += m / plies.len() as f64);
            }
            println!(
                "{file}, {packing:?}: {seconds:.3} s a ply; meets a fiber at h/R 0, 0.5, 0.7, 0.8, 0.9, 0.95: {met:.3?}"
            );
            let rings = 10;
            let mut filled = vec![[0usize; 2]; rings];
            for ply in &plies {
                for k in 0..4000 {
                    let (r, t) = (((f64::from(k) + 0.5) / 4000.0).sqrt(), 2.399_963 * f64::from(k));
                    let p = nalgebra::Vector2::new(r * t.cos(), r * t.sin()) * radius;
                    let hit = ply.fibers.iter().any(|f| {
                        (p - f.center_um).norm() < f.outer.bounding_radius() && f.outer.contains(f.to_fiber(p))
                    });
                    let ring = &mut filled[((r * rings as f64) as usize).min(rings - 1)];
                    *ring = [ring[0] + usize::from(hit), ring[1] + 1];
                }
            }
            let density: Vec<f64> = filled.iter().map(|[a, b]| *a as f64 / *b as f64).collect();
            println!("  filled in rings of R/10: {density:.3?}, in all {:.3}", spec.packing_fraction());
        }
    }
    Ok(())
}
