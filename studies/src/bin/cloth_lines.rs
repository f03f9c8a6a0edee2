//! Time of a line through a cloth of curves, by cosine, and how many plies it hits.
//!
//! `cargo run --release -p plywave-studies --bin cloth_lines -- fabrics/cloths/*.toml`

use plywave::cloth::{ClothLines, LineHits};
use plywave_sim::cloth::{Effort, make_cloth};
use plywave_textile::ClothSpec;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;
use std::time::Instant;

const LINES: usize = 200_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for file in std::env::args().skip(1) {
        let spec = ClothSpec::parse(&std::fs::read_to_string(&file)?, &file)?;
        let mut read = |name: &str| {
            let hint = "curves and drafts in files are not read here".into();
            Err(plywave::Error::Format { file: name.into(), what: "it is not read".into(), hint })
        };
        let made = make_cloth(&spec, &file, &mut read, Effort::Full, &|_| true)?;
        let begun = Instant::now();
        let lines = ClothLines::new(&made.curves)?;
        let ready = begun.elapsed();
        println!("{}: {} KiB, ready in {:.1} ms", spec.name, lines.memory_bytes() >> 10, 1e3 * ready.as_secs_f64());
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let mut hits = LineHits::default();
        for z in [1.0f32, 0.7, 0.4, 0.2, 0.05] {
            let all: Vec<[f32; 4]> = (0..4096).map(|_| std::array::from_fn(|_| rng.random::<f32>())).collect();
            let (mut count, begun) = (0, Instant::now());
            for [x, y, turn, _] in all.iter().cycle().take(LINES) {
                let (sin, cos) = (TAU * turn).sin_cos();
                let across = (1.0 - z * z).sqrt();
                let from = [1e4 * x, 1e4 * y, lines.half_thickness_um()];
                lines.hits(from, [across * cos, across * sin, -z], &mut hits);
                count += hits.as_slice().len();
            }
            let ns = 1e9 * begun.elapsed().as_secs_f64() / LINES as f64;
            println!("  cosine {z}: {ns:.0} ns, {:.2} plies", count as f64 / LINES as f64);
        }
    }
    Ok(())
}
