//! ci: build only
//!
//! A cloth in a path tracer: read from its file, shaded at a point with its own color, turned, and sampled.
//!
//! ```sh
//! plywave weave fabrics/cloths/jersey.toml -o jersey.pwc
//! cargo run --release -p plywave --example cloth_host -- jersey.pwc
//! ```
//!
//! Without an argument it prints these lines.

use plywave::Document;
use plywave::cloth::{ClothData, ClothOptions};
use plywave::{Bsdf, BsdfSample, ClothModel, ClothQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use std::ffi::OsString;
use std::process::ExitCode;

const SAMPLES: u32 = 20_000;

fn main() -> ExitCode {
    let Some(path) = std::env::args_os().nth(1) else {
        println!("Give a cloth file. To make one:\n    plywave weave fabrics/cloths/jersey.toml -o jersey.pwc");
        return ExitCode::SUCCESS;
    };
    match run(path) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run(path: OsString) -> plywave::Result<()> {
    let data = ClothData::load(path)?;
    let options = ClothOptions { far: data.has_far(), ..ClothOptions::default() };
    let cloth = ClothModel::from_data(data, &options)?;
    let [a, b] = cloth.cell_um();
    println!("one cell is spanned by {:.0}, {:.0} and {:.0}, {:.0} um", a[0], a[1], b[0], b[1]);

    // A hit of a camera ray: position in the plane of the cloth [um], direction towards the camera in the
    // surface's frame (x along the weft or the courses, y along the warp or the wales, z the normal). `rgb`
    // is for hosts that render in linear sRGB, `ClothQuery::new` for wavelengths.
    let query = ClothQuery::rgb([1200.0, 340.0], [0.0, 0.6, 0.8]);
    let light = [0.3, 0.0, 0.954];
    let at = cloth.at(&query);
    println!("in a gap: {}, over yarns of another kind: {}", at.is_gap(), at.is_double());
    println!("f                {}  the cosine at the surface included", rgb(at.eval(light)));

    // The same point of a print: a texture's color in place of the yarn's. Convert a texture once, not at
    // every hit.
    let print = [Some(cloth.sigma_of_reflectance([0.6, 0.5, 0.1])); 2];
    println!("printed          {}", rgb(cloth.at(&ClothQuery { sigma_per_um: print, ..query }).eval(light)));
    // The pattern turned by 45 degrees, as on a sleeve cut on the bias.
    let bias = ClothQuery { turn_rad: std::f32::consts::FRAC_PI_4, ..query };
    println!("cut on the bias  {}", rgb(cloth.at(&bias).eval(light)));
    // Far away, where a pixel covers many yarns: the mean over the cell, if the file has it.
    let pixel = cloth.at(&ClothQuery { footprint_um: 1e5, ..query });
    println!("from afar        {}  of it the mean: {}", rgb(pixel.eval(light)), pixel.far_share());

    // One bounce of a path tracer, many times over random points: light reflected, transmitted, and straight
    // through gaps.
    let mut rng = Pcg32::seed_from_u64(1);
    let (mut back, mut through, mut straight) = ([0.0f32; 3], [0.0f32; 3], [0.0f32; 3]);
    for _ in 0..SAMPLES {
        let [s, t]: [f64; 2] = rng.random();
        let position_um = [0, 1].map(|k| (s * a[k] + t * b[k]) as f32);
        let at = cloth.at(&ClothQuery { position_um, ..query });
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
