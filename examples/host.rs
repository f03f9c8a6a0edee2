//! A host renderer's side of plywave: load a ply model, evaluate it, sample it.
//!
//! ```sh
//! cargo run --release -p plywave --example host -- [MODEL.pwm]
//! ```
//!
//! Without an argument it takes `fabrics/models/polyester.pwm`; where that file is absent, a made-up model of two lobes.

use plywave::{PlyData, PlyModel, PlySample, Queries, Scatter, WholePly, direction};
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
    let path = std::env::args_os().nth(1).map(PathBuf::from).or(shipped.is_file().then_some(shipped));
    let model = match &path {
        Some(path) => PlyModel::load(path)?,
        None => PlyModel::from_data(two_lobes())?,
    };
    let name = path.as_deref().and_then(Path::file_name).map_or("made-up model".into(), |n| n.to_string_lossy());
    println!("{name}: {} + {} lobes", model.data().lobes_refl, model.data().lobes_high);

    // Incidence in the ply frame: latitude [rad], offset of the beam's center [um].
    let reach_um = model.data().h_um[model.data().h_um.len() - 1] as f32;
    let (theta_i, h_um) = (30f32.to_radians(), 0.2 * reach_um);
    // Absorption of the fibers [1/um], here one coefficient for each of R, G, B: the color is the host's, not the model's.
    let sigma = [0.001, 0.004, 0.010];

    // f [1/sr] is an energy density: the BSDF with the cosine of the outgoing direction in it.
    let wo = direction((-30f32).to_radians(), 270f32.to_radians());
    let f = model.eval(theta_i, h_um, sigma, wo);
    println!("f       {}  towards exact forward", rgb(f));

    // Where the light can go: scattered, by color; past the fibers; the rest is absorbed.
    let (albedo, r_d) = (model.albedo(theta_i, h_um, sigma), model.r_d(theta_i, h_um));
    println!("albedo  {}  missed {r_d:.4}", rgb(albedo));

    // A host's Monte Carlo estimate of the albedo: the mean weight f / pdf. Random numbers are the host's.
    let mut rng = Pcg32::seed_from_u64(1);
    let mut sum = [0.0f32; 3];
    for _ in 0..SAMPLES {
        let u = [rng.random(), rng.random(), rng.random()];
        // None is light that missed the ply: it goes straight on.
        if let Some(PlySample { weight, .. }) = model.sample(theta_i, h_um, sigma, u) {
            sum.iter_mut().zip(weight).for_each(|(s, w)| *s += w);
        }
    }
    println!("        {}  mean of {SAMPLES} sampled weights", rgb(sum.map(|s| s / SAMPLES as f32)));

    // Many queries at once: arrays of equal length, here an arc of directions about the ply at one incidence.
    let phis: Vec<f32> = (0..8).map(|j| std::f32::consts::TAU * j as f32 / 8.0).collect();
    let arc: Vec<[f32; 3]> = phis.iter().map(|&phi| direction(-theta_i, phi)).collect();
    let axis = |k: usize| arc.iter().map(|w| w[k]).collect::<Vec<f32>>();
    let (x, y, z) = (axis(0), axis(1), axis(2));
    let queries = Queries {
        theta_i: &[theta_i; 8],
        h_um: &[h_um; 8],
        sigma_per_um: &[sigma; 8],
        wo: [x.as_slice(), y.as_slice(), z.as_slice()],
    };
    let mut values = [[0.0f32; 3]; 8];
    model.eval_batch(&queries, &mut values);
    for (phi, f) in phis.iter().zip(values) {
        println!("phi_o {:>3.0}  {}", phi.to_degrees(), rgb(f));
    }

    // A path tracer asks several things at one point: the whole ply, with the light diffracted at its edge, interpolated once for all of them.
    let lambda_um = [0.61, 0.55, 0.465];
    let ply = WholePly { model: &model, theta_i, h_um, sigma_per_um: sigma, lambda_um, slit: None, instance: None };
    let ply = ply.prepare();
    let (f, pdf) = ply.eval_pdf(direction(0.2, 1.0));
    println!("light   {}  density {pdf:.4}", rgb(f));
    if let Some(PlySample { wo, weight, .. }) = ply.sample([0.6, 0.3, 0.7]) {
        println!("sample  {}  towards {}", rgb(weight), rgb(wo));
    }
    Ok(())
}

fn rgb(v: [f32; 3]) -> String {
    format!("{:.4} {:.4} {:.4}", v[0], v[1], v[2])
}

/// One lobe of each kind, the same at every incidence: light from +y back to +y, and a broad one onwards.
fn two_lobes() -> PlyData {
    let nodes = 3 * 3;
    // theta_z, phi_z, phi_xy [rad], ln mu1, ln mu2, energy.
    let back = [0.0, std::f64::consts::FRAC_PI_2, 0.0, 1.0, 3.0, 0.1];
    let forward = [0.0, 1.5 * std::f64::consts::PI, 0.0, 0.0, 1.0, 0.8];
    PlyData {
        spec_text: "name = \"two lobes\"\n".into(),
        program_version: env!("CARGO_PKG_VERSION").into(),
        preset: "made up".into(),
        seed: 0,
        theta_i: vec![0.0, 0.7, 1.4],
        h_um: vec![-70.0, 0.0, 70.0],
        sigma_per_um: vec![0.0, 0.01],
        path_um: vec![20.0, 100.0],
        lobes_refl: 1,
        lobes_high: 1,
        r_d: vec![0.1; nodes],
        energy_refl: vec![0.1; nodes],
        energy_high: [0.5, 0.3].repeat(nodes),
        refl: back.repeat(nodes),
        high: forward.repeat(4),
        high_path: [0.6, 0.4].repeat(4),
        error_refl: vec![0.0; nodes],
        error_high: vec![0.0; 2 * nodes],
        layers: None,
        edge: None,
        noise: None,
    }
}
