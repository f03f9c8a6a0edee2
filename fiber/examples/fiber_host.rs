//! A single fiber in a renderer: intersect its width, evaluate it at several wavelengths, sample it.
//!
//! ```sh
//! cargo run --release -p plywave --example fiber_host -- [FIBER.pwf]
//! ```
//!
//! `plywave wave tabulate SPEC.toml` writes a fiber file. Without an argument the example uses a synthetic
//! one: a lossless round fiber with a forward peak.

use plywave::frame::direction;
use plywave::{Bsdf, BsdfSample};
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_fiber::{FiberSource, FiberTable, OutlineSymmetry, TabulatedFiber};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use std::f64::consts::{FRAC_PI_2, TAU};
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
    let fiber = match std::env::args_os().nth(1) {
        Some(path) => FiberModel::load(path)?,
        None => TabulatedFiber::from_table(made_up())?.into(),
    };

    // A hit of a ray with the cylinder of the fiber's largest width: the direction that light comes from, in
    // the fiber's frame (z along it), and the ray's distance from the center line.
    println!("cylinder to intersect: {:.3} um wide", fiber.max_width_um());
    let (omega_i, offset_um) = (direction(0.4, 1.1), 0.45 * fiber.max_width_um());
    let at = fiber.at(&FiberQuery::new(omega_i, [0.65, 0.55, 0.45]));
    // The fiber receives light over a width that depends on wavelength and direction (Xia 2020, 6); beyond it
    // the ray passes.
    println!("width   {} um, hit {:?}", rgb(at.width_um()), at.hit(offset_um));
    let forward = direction(-0.4, 1.1 + std::f32::consts::PI);
    let (f, pdf) = at.eval_pdf(forward);
    println!("f       {} 1/sr towards exact forward, pdf {pdf:.4}", rgb(f));
    println!("albedo  {}", rgb(at.albedo()));

    let mut rng = Pcg32::seed_from_u64(1);
    let mut sum = [0.0f32; 3];
    for _ in 0..SAMPLES {
        // A hit fiber never lets light pass: light that is not scattered is absorbed.
        if let BsdfSample::Scattered(light) = at.sample([rng.random(), rng.random(), rng.random()]) {
            sum.iter_mut().zip(light.weight).for_each(|(s, w)| *s += w / SAMPLES as f32);
        }
    }
    println!("        {} mean of {SAMPLES} sampled weights", rgb(sum));
    Ok(())
}

fn rgb(v: [f32; 3]) -> String {
    format!("{:.4} {:.4} {:.4}", v[0], v[1], v[2])
}

/// A table of one azimuthal function, a forward peak that narrows towards blue.
fn made_up() -> FiberTable {
    let (lambdas, latitudes, cells) = (5, 8, 360);
    let mut azimuthal = Vec::new();
    for slice in 0..lambdas * latitudes {
        let width = 0.15 + 0.05 * (slice / latitudes) as f64;
        let peak = |j: usize| 0.02 + (-((TAU * j as f64 / cells as f64 - 0.5 * TAU) / width).powi(2)).exp();
        let sum = (0..cells).map(peak).sum::<f64>() * TAU / cells as f64;
        azimuthal.extend((0..cells).map(|j| (peak(j) / sum) as f32));
    }
    FiberTable {
        spec_text: "name = \"made up\"\n".into(),
        program_version: env!("CARGO_PKG_VERSION").into(),
        preset: "made up".into(),
        seed: 0,
        source: FiberSource::Wave,
        symmetry: OutlineSymmetry::CIRCLE,
        beta_m: 0.1,
        lambda_um: (0..lambdas).map(|l| 0.4 + 0.075 * l as f64).collect(),
        theta_i: (0..latitudes).map(|m| FRAC_PI_2 * (m as f64 + 0.5) / latitudes as f64).collect(),
        phi_i: OutlineSymmetry::CIRCLE.phi_i(1),
        width_um: vec![15.0],
        c_x_um: (0..lambdas * latitudes).map(|s| 17.0 + 0.3 * (s / latitudes) as f64).collect(),
        c_abs_um: vec![0.0; lambdas * latitudes],
        azimuthal,
    }
}
