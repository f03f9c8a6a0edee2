//! plywave in a host renderer: load a ply model, evaluate it, sample it.
//!
//! ```sh
//! cargo run --release -p plywave --example host -- [MODEL.pwm]
//! ```
//!
//! Without an argument it takes `fabrics/models/polyester.pwm`, a shipped model.

use plywave::color::RGB_LAMBDA_UM;
use plywave::frame::direction;
use plywave::ply::Queries;
use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Samples of the estimate at the end.
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
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("fabrics/models/polyester.pwm");
    let path = std::env::args_os().nth(1).map_or(shipped, PathBuf::from);
    let model = PlyModel::load(&path)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    println!("{name}: {} + {} lobes", model.data().lobes_refl, model.data().lobes_high);

    // A query: incidence in the ply frame, latitude [rad] and offset of the beam's center [um]; absorption of
    // the fibers [1/um], here one coefficient for each of R, G, B: the color is the host's, not the model's;
    // the wavelengths that represent R, G, B at the ply's edge [um].
    let reach_um = model.data().h_um[model.data().h_um.len() - 1] as f32;
    let (theta_i, h_um, sigma) = (30f32.to_radians(), 0.4 * reach_um, [0.001, 0.004, 0.010]);
    let ply = model.at(&PlyQuery::new(theta_i, h_um, sigma, RGB_LAMBDA_UM));

    // f [1/sr] is an energy density: the BSDF with the cosine of the outgoing direction in it.
    let forward = direction((-30f32).to_radians(), 270f32.to_radians());
    let (f, pdf) = ply.eval_pdf(forward);
    println!("f        {}  towards exact forward, pdf {pdf:.4}", rgb(f));
    let terms = ply.terms(forward);
    println!("  f_refl {:.4}", terms.refl);
    println!("  f_high {}", rgb(terms.high));
    println!("  f_edge {}", rgb(terms.edge));

    // Distribution of the light: scattered, by color; past the fibers without diffraction; the rest is
    // absorbed.
    println!("albedo   {}  straight on {}", rgb(ply.albedo()), rgb(ply.straight()));

    // A host's Monte Carlo estimate of the albedo: the mean weight f / pdf. Random numbers are the host's.
    let mut rng = Pcg32::seed_from_u64(1);
    let mut sum = [0.0f32; 3];
    for _ in 0..SAMPLES {
        match ply.sample([rng.random(), rng.random(), rng.random()]) {
            BsdfSample::Scattered(light) => sum.iter_mut().zip(light.weight).for_each(|(s, w)| *s += w),
            // The next ray continues in the same direction, times the weight. Not here: this ply's edge
            // diffracts all light that misses.
            BsdfSample::Straight { .. } => (),
            BsdfSample::Absorbed => (),
        }
    }
    println!("         {}  mean of {SAMPLES} sampled weights", rgb(sum.map(|s| s / SAMPLES as f32)));

    // Many queries at once: arrays of equal length, here an arc of directions about the ply at one incidence.
    let phis: Vec<f32> = (0..8).map(|j| std::f32::consts::TAU * j as f32 / 8.0).collect();
    let arc: Vec<[f32; 3]> = phis.iter().map(|&phi| direction(-theta_i, phi)).collect();
    let axis = |k: usize| arc.iter().map(|w| w[k]).collect::<Vec<f32>>();
    let (x, y, z) = (axis(0), axis(1), axis(2));
    let queries = Queries { theta_i: &[theta_i; 8], h_um: &[h_um; 8], sigma_per_um: &[sigma; 8], wo: [&x, &y, &z] };
    let mut values = [[0.0f32; 3]; 8];
    model.eval_batch(&queries, &mut values);
    for (phi, f) in phis.iter().zip(values) {
        println!("phi_o {:>3.0}  {}", phi.to_degrees(), rgb(f));
    }
    Ok(())
}

fn rgb(v: [f32; 3]) -> String {
    format!("{:.4} {:.4} {:.4}", v[0], v[1], v[2])
}
