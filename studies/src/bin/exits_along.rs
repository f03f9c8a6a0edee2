//! Axial spread of light in a ply: quantiles of the distance, in units of the ply's radius R, from the point
//! where a line is nearest to the ply's axis to the last point at which its light hits a fiber, along the
//! axis and towards the light's side. Clear fibers and, by weight, fibers of 0.003 per um; without light that
//! was reflected only once.
//!
//! `cargo run --release -p plywave-studies --bin exits_along -- [paths a latitude] [fabrics/NAME.toml ..]`

use nalgebra::Vector3;
use plywave_sim::{PathEnd, PlySection, ScrewTracer, Surfaces, Tracer, trace_path_among};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;

const QUANTILES: [f32; 9] = [0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.97];
const SECTORS: [&str; 3] = ["back", "aside", "through"];
const INSTANCES: u64 = 6;
const SIGMA_PER_UM: f32 = 0.003;

/// Position along the axis at which the path's light leaves, over R; sector of the azimuth; length in the
/// fibers [um].
type Exit = (f32, usize, f32);

/// A path of light from +y at this latitude, at a random offset across a randomly turned ply.
fn exit(tracer: &ScrewTracer, surfaces: &Surfaces, radius: f32, theta_i: f32, rng: &mut Pcg64Mcg) -> Option<Exit> {
    let x = radius * (2.0 * rng.random::<f32>() - 1.0);
    let (sin, cos) = (TAU * rng.random::<f32>()).sin_cos();
    let turn = |v: Vector3<f32>, sin: f32| Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z);
    let nearest = tracer.period_um() * rng.random::<f32>();
    let bound = 1.02 * tracer.bound_radius_um();
    let y = (bound * bound - x * x).max(0.0).sqrt();
    let from = Vector3::new(x, y, nearest + y * theta_i.tan());
    let d = Vector3::new(0.0, -theta_i.cos(), -theta_i.sin());
    let PathEnd::High { dir, pos, length_um, .. } =
        trace_path_among(tracer, surfaces, turn(from, sin), turn(d, sin), rng)
    else {
        return None;
    };
    let dir = turn(dir, -sin);
    let y = dir.y / dir.x.hypot(dir.y).max(1e-6);
    let sector = if y > 0.5 { 0 } else { 1 + usize::from(y < -0.5) };
    Some(((pos.z - nearest) / radius, sector, length_um))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let paths: usize = args.next().map_or(Ok(4000), |n| n.parse())?;
    let mut yarns: Vec<String> = args.collect();
    if yarns.is_empty() {
        let folder = format!("{}/../fabrics", env!("CARGO_MANIFEST_DIR"));
        yarns = ["polyester", "silk", "cotton", "wool"].map(|name| format!("{folder}/{name}.toml")).to_vec();
    }
    println!("latitude [degrees], absorption [1/um], sector: places along the ply over R at the shares {QUANTILES:?}");
    for path in yarns {
        let (spec, _) = plywave_textile::load_yarn_file(&path)?;
        let surfaces = Surfaces::of_spec(&spec);
        let sections = (0..INSTANCES).map(|seed| PlySection::generate(&spec, seed)).collect::<Result<Vec<_>, _>>()?;
        let tracers: Vec<ScrewTracer> =
            sections.iter().map(ScrewTracer::new).collect::<Option<_>>().ok_or("a ply without fibers")?;
        println!("{}", spec.name);
        for degrees in [0.0f32, 20.0, 40.0, 60.0] {
            let mut rng = Pcg64Mcg::seed_from_u64(5);
            let radius = spec.ply.radius_um.map_or(tracers[0].bound_radius_um(), |r| r as f32);
            let mut exits: Vec<Exit> = (0..paths)
                .filter_map(|i| exit(&tracers[i % tracers.len()], &surfaces, radius, degrees.to_radians(), &mut rng))
                .collect();
            exits.sort_by(|a, b| a.0.total_cmp(&b.0));
            for sigma in [0.0, SIGMA_PER_UM] {
                for (sector, name) in SECTORS.iter().enumerate() {
                    let of: Vec<(f32, f32)> =
                        exits.iter().filter(|e| e.1 == sector).map(|e| (e.0, (-sigma * e.2).exp())).collect();
                    let all: f32 = of.iter().map(|e| e.1).sum();
                    let places = QUANTILES.map(|share| {
                        let mut sum = 0.0;
                        let found = of.iter().find(|e| {
                            sum += e.1;
                            sum >= share * all
                        });
                        found.map_or(f32::NAN, |e| e.0)
                    });
                    println!("  {degrees:4} {sigma:5} {name:8} {places:6.2?}");
                }
            }
        }
    }
    Ok(())
}
