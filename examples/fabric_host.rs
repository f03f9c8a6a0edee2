//! A woven fabric in a path tracer: built in memory from bytes, shaded at a point with its own color, turned,
//! and sampled.
//!
//! ```sh
//! cargo run --release -p plywave --example fabric_host -- [FABRIC.toml]
//! ```
//!
//! Without an argument it takes `fabrics/polyester_satin.toml`.

use plywave::fabric::FabricOptions;
use plywave::{Bsdf, BsdfSample, FabricModel, FabricQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const SAMPLES: u32 = 20_000;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> plywave::Result<()> {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("fabrics/polyester_satin.toml");
    let path = std::env::args_os().nth(1).map_or(shipped, PathBuf::from);
    let fabric = FabricModel::load(&path, &FabricOptions::default())?;
    let [width, height] = fabric.fabric().repeat_um();
    println!("{}: one repeat is {width:.0} x {height:.0} um", path.file_name().unwrap_or_default().to_string_lossy());

    // A hit of a camera ray: position in the plane of the cloth [um], direction towards the camera in the
    // surface's frame (x along the weft, y along the warp, z the normal). `rgb` is for hosts that render in
    // linear sRGB, `FabricQuery::new` for wavelengths.
    let query = FabricQuery::rgb([1200.0, 340.0], [0.0, 0.6, 0.8]);
    let light = [0.3, 0.0, 0.954];
    let at = fabric.at(&query);
    println!("in a gap: {}, over a second layer: {}", at.is_gap(), at.is_double());
    println!("f                {}  the cosine at the surface included", rgb(at.eval(light)));

    // The same point of a print: a texture's color in place of the yarn's. Convert a texture once, not at
    // every hit.
    let print = [Some(fabric.sigma_of_reflectance([0.6, 0.5, 0.1])); 2];
    println!("printed          {}", rgb(fabric.at(&FabricQuery { sigma_per_um: print, ..query }).eval(light)));
    // The pattern turned by 45 degrees, as on a sleeve cut on the bias.
    let bias = FabricQuery { turn_rad: std::f32::consts::FRAC_PI_4, ..query };
    println!("cut on the bias  {}", rgb(fabric.at(&bias).eval(light)));

    // One bounce of a path tracer, many times over random points: light reflected, transmitted, and straight
    // through gaps.
    let mut rng = Pcg32::seed_from_u64(1);
    let (mut back, mut through, mut straight) = ([0.0f32; 3], [0.0f32; 3], [0.0f32; 3]);
    for _ in 0..SAMPLES {
        let position_um = [rng.random::<f32>() * width as f32, rng.random::<f32>() * height as f32];
        let at = fabric.at(&FabricQuery { position_um, ..query });
        let (sum, weight) = match at.sample([rng.random(), rng.random(), rng.random()]) {
            BsdfSample::Scattered(s) if s.w[2] > 0.0 => (&mut back, s.weight),
            BsdfSample::Scattered(s) => (&mut through, s.weight),
            BsdfSample::Straight { weight, .. } => (&mut straight, weight),
            BsdfSample::Absorbed => continue,
        };
        sum.iter_mut().zip(weight).for_each(|(s, w)| *s += w / SAMPLES as f32);
    }
    println!("reflected        {}", rgb(back));
    println!("transmitted      {}", rgb(through));
    println!("straight through {}", rgb(straight));
    Ok(())
}

fn rgb(v: [f32; 3]) -> String {
    format!("{:.4} {:.4} {:.4}", v[0], v[1], v[2])
}
