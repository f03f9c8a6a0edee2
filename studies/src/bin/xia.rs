//! Numbers of Xia et al. 2020: light received by a fiber relative to its width (Table 1), fringes behind a
//! fiber (Fig. 11-12), pairs of fibers (Fig. 18); and maps of scattering over phi_i and phi_r in color (Fig.
//! 6 and the last row of Fig. 4).
//!
//! `cargo run --release -p plywave-studies --bin xia` prints the numbers of circles; `-- ellipses` prints
//! those of ellipses, which take minutes; `-- maps FOLDER` writes the maps as PNG.

use plywave::Bsdf;
use plywave::frame::direction;
use plywave_fiber::{DielectricFiber, DielectricParameters};
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_wave::special::bessel01;
use plywave_wave::{
    Absorption, Body, C64, MieSolver, MultipoleSolver, NystromSolver, Polarization, Scattered, Shape, SingleFiber,
    Source, Wave, WaveError, WaveSolver,
};
use rayon::prelude::*;
use std::error::Error;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;
use std::time::Instant;

/// Index of the clear fibers; the paper does not give its own.
const ETA: f64 = 1.55;

fn body(shape: Shape, eta: f64) -> Body {
    Body { shape, center_um: [0.0; 2], rotation_rad: 0.0, eta, kappa: 0.0, lumen: None }
}

fn circle(radius_um: f64) -> Body {
    body(Shape::Circle { radius_um }, ETA)
}

fn solver(body: &Body, wave: &Wave, tolerance: f64) -> Result<Box<dyn WaveSolver>, WaveError> {
    Ok(match body.shape {
        Shape::Circle { .. } => Box::new(MieSolver::new(body, wave, tolerance)?),
        _ => Box::new(NystromSolver::new(std::slice::from_ref(body), wave, tolerance)?),
    })
}

/// Both polarizations of a plane wave from `phi_i`.
fn lights(phi_i: f64) -> [Source; 2] {
    [Polarization::Tm, Polarization::Te].map(|pol| Source { phi_i, pol, beam: None })
}

/// Scattered width per azimuth [um/rad] of unpolarized light, from the far fields of both polarizations.
fn intensity(wave: &Wave, both: &[Scattered]) -> Vec<f64> {
    let scale = 2.0 / (PI * wave.k0()) / wave.theta_i.cos() / both.len() as f64;
    let at = |j: usize| both.iter().map(|s| s.f_u[j].norm_sqr() + s.f_phi[j].norm_sqr()).sum::<f64>();
    (0..both[0].f_u.len()).map(|j| scale * at(j)).collect()
}

/// Extinction of unpolarized light over the irradiance on the fiber's axis and over the geometric width.
fn ratio(body: &Body, wave: &Wave, phi_i: &[f64], tolerance: f64) -> Result<f64, WaveError> {
    let fiber = SingleFiber::of_body(body);
    let sources: Vec<Source> = phi_i.iter().flat_map(|phi| lights(*phi)).collect();
    // The extinction comes from the forward amplitude, whatever the requested azimuths.
    let scattered = solver(body, wave, tolerance)?.scatter(&sources, 8)?;
    let mut most = 0.0f64;
    for (both, phi) in scattered.chunks(2).zip(phi_i) {
        let [from, to] = fiber.shadow_um(*phi)?;
        let c = both.iter().map(|s| s.c_ext_um).sum::<f64>() / 2.0 / wave.theta_i.cos();
        most = most.max(c / (to - from));
    }
    Ok(most)
}

/// Greatest ratios up to each of the latitudes, whose wavelengths are even from 0.4 to 0.7 um.
fn greatest(
    body: &Body,
    lambdas: usize,
    latitudes: &[f64],
    phi_i: &[f64],
    tolerance: f64,
) -> Result<Vec<(f64, f64)>, WaveError> {
    let lambda = |l: usize| 0.4 + 0.3 * (l as f64 + 0.5) / lambdas as f64;
    latitudes
        .par_iter()
        .map(|theta_i| {
            let mut most = (0.0, 0.0);
            for l in 0..lambdas {
                let wave = Wave { lambda_um: lambda(l), theta_i: *theta_i };
                let r = ratio(body, &wave, phi_i, tolerance)?;
                if r > most.0 {
                    most = (r, wave.lambda_um);
                }
            }
            Ok(most)
        })
        .collect()
}

fn report(name: &str, paper: &str, latitudes: &[f64], found: &[(f64, f64)]) {
    let most_to = |limit: f64| {
        let within = latitudes.iter().zip(found).filter(|(theta, _)| theta.to_degrees() <= limit);
        within.fold(
            (0.0, 0.0, 0.0),
            |best, (theta, (r, l))| if *r > best.0 { (*r, *l, theta.to_degrees()) } else { best },
        )
    };
    let (r, l, theta) = most_to(90.0);
    print!("  {name:<22} paper {paper:<12} here {r:6.2} at {l:.3} um, {theta:.2} degrees;");
    for limit in [0.5, 60.0, 80.0, 85.0, 88.0] {
        print!(" to {limit}: {:.2}", most_to(limit).0);
    }
    println!();
}

/// Centers of equal parts of 0 to 90 degrees.
fn latitudes(count: usize) -> Vec<f64> {
    (0..count).map(|m| FRAC_PI_2 * (m as f64 + 0.5) / count as f64).collect()
}

fn table_1() -> Result<(), WaveError> {
    println!("Table 1: greatest C_e / C_g over wavelength, latitude and azimuth, eta {ETA}");
    let latitudes = latitudes(100);
    for (radius, lambdas, paper) in [(1.0, 50, "6.0 clamped"), (10.0, 100, "3.0"), (100.0, 500, "2.2")] {
        let begun = Instant::now();
        let found = greatest(&circle(radius), lambdas, &latitudes, &[0.0], 1e-8)?;
        report(&format!("circle {radius} um"), paper, &latitudes, &found);
        println!("  {:22} {lambdas} wavelengths, 100 latitudes in {:.1} s", "", begun.elapsed().as_secs_f64());
    }
    Ok(())
}

fn ellipses() -> Result<(), WaveError> {
    println!("Table 1: greatest C_e / C_g of ellipses, eta {ETA}");
    let phi: Vec<f64> = (0..10).map(|k| FRAC_PI_2 * f64::from(k) / 9.0).collect();
    for (a, lambdas, count, paper) in [(1.6, 12, 50, "6.0 clamped"), (16.0, 2, 12, "2.5"), (19.0, 2, 12, "2.5")] {
        let begun = Instant::now();
        let b = if a > 2.0 { 10.0 } else { 1.0 };
        let latitudes = latitudes(count);
        let found = greatest(&body(Shape::Ellipse { a_um: a, b_um: b }, ETA), lambdas, &latitudes, &phi, 1e-4)?;
        report(&format!("ellipse {a} x {b} um"), paper, &latitudes, &found);
        let seconds = begun.elapsed().as_secs_f64();
        println!("  {:22} {lambdas} wavelengths, {count} latitudes, 10 azimuths in {seconds:.1} s", "");
    }
    Ok(())
}

/// Angles [rad] of the minima of a pattern over the angle from the forward direction, up to `most`.
fn minima(pattern: &[f64], step: f64, most: f64) -> Vec<f64> {
    let mut found = Vec::new();
    for j in 1..pattern.len() - 1 {
        let [a, b, c] = [pattern[j - 1], pattern[j], pattern[j + 1]];
        if b < a && b <= c && (j as f64) * step <= most {
            // By the parabola through the three.
            let bend = a - 2.0 * b + c;
            found.push((j as f64 + if bend > 0.0 { 0.5 * (a - c) / bend } else { 0.0 }) * step);
        }
    }
    found
}

fn fringes() -> Result<(), Box<dyn Error>> {
    const LAMBDA_UM: f64 = 0.65;
    const FAR_CM: f64 = 65.0;
    println!(
        "Fringes, 0.65 um, 65 cm: the paper's first minima lie 2.8 to 3.4 cm out, from which D = lambda L / y is 13.8 um; 13.1 um by microscope"
    );
    let n = 36_000;
    let pattern = |diameter: f64, eta: f64, kappa: f64| -> Result<Vec<f64>, WaveError> {
        let wave = Wave { lambda_um: LAMBDA_UM, theta_i: 0.0 };
        let fiber = Body { kappa, ..body(Shape::Circle { radius_um: 0.5 * diameter }, eta) };
        let both = MieSolver::new(&fiber, &wave, 1e-8)?.scatter(&lights(0.0), n)?;
        let all = intensity(&wave, &both);
        // From the forward direction, half a turn from where the light comes from.
        Ok((0..n / 4).map(|j| all[n / 2 + j]).collect())
    };
    let y = |angle: f64| FAR_CM * angle.tan();
    let step = TAU / n as f64;
    for (name, eta, kappa) in
        [("clear, 1.55", 1.55, 0.0), ("polyester, 1.60", 1.60, 0.0), ("black, 1.55 + 0.1 i", 1.55, 0.1)]
    {
        let mut told = Vec::new();
        let mut off = Vec::new();
        for diameter in [10.0, 12.0, 13.1, 13.8, 15.0, 18.0] {
            let first = minima(&pattern(diameter, eta, kappa)?, step, 0.2);
            let Some(first) = first.first().map(|angle| y(*angle)) else { continue };
            let by_rule = LAMBDA_UM * FAR_CM / first;
            told.push(format!("{diameter} um: {first:.2} cm, D {by_rule:.1} um"));
            off.push(by_rule / diameter - 1.0);
        }
        let mean = off.iter().sum::<f64>() / off.len().max(1) as f64;
        let most = off.iter().fold(0.0f64, |most, v| most.max(v.abs()));
        println!("  {name}: {}", told.join("; "));
        println!("    the rule is off by {:+.1} % in the mean, {:.1} % at most", 100.0 * mean, 100.0 * most);
    }
    // A band of the same width, whose minimum is the rule's by definition, and rays.
    let band = minima(
        &(0..n / 4).map(|j| sinc(13.8 / LAMBDA_UM * (j as f64 * step).sin()).powi(2)).collect::<Vec<_>>(),
        step,
        0.2,
    );
    println!("  an opaque band of 13.8 um: {:.2} cm", band.first().map_or(f64::NAN, |a| y(*a)));
    let parameters =
        DielectricParameters { eta: ETA as f32, radius_um: 6.9, beta_n: 0.001, ..DielectricParameters::default() };
    let rays: FiberModel = DielectricFiber::new(parameters)?.into();
    let at = rays.at(&FiberQuery::new([1.0, 0.0, 0.0], [LAMBDA_UM as f32]));
    let rays: Vec<f64> =
        (0..n / 4).map(|j| f64::from(at.eval(direction(0.0, (PI + j as f64 * step) as f32))[0])).collect();
    let falls = rays[..n / 36].windows(2).filter(|w| w[1] > w[0] * (1.0 + 1e-4)).count();
    println!(
        "  rays, 13.8 um: {falls} of {} steps within 10 degrees rise; from 1 to {:.3} at 3 degrees",
        n / 36 - 1,
        rays[n / 120] / rays[0]
    );
    Ok(())
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

/// Azimuths and turns of the pairs.
const TURNS: usize = 10_000;

fn pairs() -> Result<(), WaveError> {
    let wave = Wave { lambda_um: 0.55, theta_i: 0.0 };
    let n = 2000;
    println!(
        "Pairs of circles of 1 um, eta {ETA}, 0.55 um, over {TURNS} turns, beside two fibers that do not know of each other (Fig. 18)"
    );
    let alone = intensity(&wave, &MieSolver::new(&circle(1.0), &wave, 1e-9)?.scatter(&lights(0.0), n)?);
    for distance in [4.0, 16.0, 2000.0] {
        let begun = Instant::now();
        let at = |x: f64| Body { center_um: [x, 0.0], ..circle(1.0) };
        let pair = MultipoleSolver::new(&[at(-0.5 * distance), at(0.5 * distance)], &wave, 1e-6)?;
        // Turns by steps of the grid, so that relative azimuths stay on it; within a step, the turns of later
        // rounds.
        let mut sum = vec![0.0; n];
        let order: Vec<usize> = (0..TURNS).collect();
        for chunk in order.chunks(100) {
            let phi = |k: usize| TAU * (k as f64 * 0.618_033_988_749_895).fract();
            let sources: Vec<Source> = chunk.iter().flat_map(|k| lights(snapped(phi(*k), n))).collect();
            for (both, k) in pair.scatter(&sources, n)?.chunks(2).zip(chunk) {
                let turn = (phi(*k) / TAU * n as f64).round() as usize % n;
                let found = intensity(&wave, both);
                (0..n).for_each(|j| sum[j] += found[(j + turn) % n] / TURNS as f64);
            }
        }
        // Only directions more than 2 degrees off forward, as in the paper.
        let off: Vec<usize> = (0..n).filter(|j| (*j as f64 - n as f64 / 2.0).abs() * 360.0 / n as f64 > 2.0).collect();
        let rms = |f: &dyn Fn(usize) -> f64| (off.iter().map(|j| f(*j).powi(2)).sum::<f64>() / off.len() as f64).sqrt();
        let independent = |j: usize| 2.0 * alone[j];
        let size = rms(&|j| independent(j));
        // Without scattering between the two: the mean of the phases over the turns.
        let phases = |j: usize| {
            let delta = TAU * j as f64 / n as f64 - PI;
            independent(j)
                * (1.0 + bessel01(C64::new(2.0 * wave.k0() * distance * (0.5 * delta).sin().abs(), 0.0))[0].re)
        };
        let smooth = |f: &dyn Fn(usize) -> f64, j: usize| {
            let half = n / 72;
            (0..=2 * half).map(|k| f((j + n + k - half) % n)).sum::<f64>() / (2 * half + 1) as f64
        };
        let total: f64 = sum.iter().sum::<f64>() / (2.0 * alone.iter().sum::<f64>());
        println!(
            "  {distance:6} um: rms difference {:.1} % (smoothed over 10 degrees {:.1} %), of the phases' own mean {:.1} %; straight ahead {:.2} times; all light {:.4} times; {:.1} s",
            100.0 * rms(&|j| sum[j] - independent(j)) / size,
            100.0 * rms(&|j| smooth(&|j| sum[j], j) - smooth(&independent, j)) / size,
            100.0 * rms(&|j| sum[j] - phases(j)) / size,
            sum[n / 2] / independent(n / 2),
            total,
            begun.elapsed().as_secs_f64()
        );
    }
    Ok(())
}

fn snapped(phi: f64, n: usize) -> f64 {
    (phi / TAU * n as f64).round() * TAU / n as f64
}

/// The map of a fiber: scattered width per azimuth over the geometric width, `[phi_i][phi_r]`, as linear sRGB
/// of D65.
fn map(fiber: &SingleFiber, lambdas: usize, size: usize) -> Result<Vec<[f64; 3]>, WaveError> {
    let mut xyz = vec![[0.0; 3]; size * size];
    for l in 0..lambdas {
        let lambda_um = 0.4 + 0.3 * (l as f64 + 0.5) / lambdas as f64;
        let wave = Wave { lambda_um, theta_i: 0.0 };
        let solver = solver(&fiber.at(lambda_um), &wave, 1e-3)?;
        // Azimuths finer than the map's are averaged.
        let fine = 4;
        let weight = plywave::color::d65_xyz_density(lambda_um).map(|w| w * 0.3 / lambdas as f64);
        let phis: Vec<f64> = (0..size).map(|i| TAU * i as f64 / size as f64).collect();
        for (i, phi) in phis.iter().enumerate() {
            let both = solver.scatter(&lights(*phi), fine * size)?;
            let [from, to] = fiber.shadow_um(*phi)?;
            let found = intensity(&wave, &both);
            for j in 0..size {
                let mean =
                    (0..fine).map(|k| found[(fine * j + k + fine * size - fine / 2) % (fine * size)]).sum::<f64>()
                        / fine as f64;
                for c in 0..3 {
                    xyz[i * size + j][c] += weight[c] * mean / (to - from);
                }
            }
        }
    }
    Ok(xyz.into_iter().map(plywave::color::linear_srgb_of_xyz).collect())
}

fn maps(folder: &Path) -> Result<(), Box<dyn Error>> {
    let of = |body: Body| SingleFiber::of_body(&body);
    let (silk, _) = plywave_textile::load_yarn_file("fabrics/silk.toml")?;
    let list = [
        ("circle_1", of(circle(1.0)), 60),
        ("circle_10", of(circle(10.0)), 120),
        ("ellipse_1", of(body(Shape::Ellipse { a_um: 1.6, b_um: 1.0 }, ETA)), 60),
        ("silk", SingleFiber::of_spec(&silk.fiber, Absorption::Kappa(0.0)), 40),
    ];
    std::fs::create_dir_all(folder)?;
    for (name, fiber, lambdas) in list {
        let begun = Instant::now();
        let size = 360;
        let colors = map(&fiber, lambdas, size)?;
        // White is the value that five of a hundred pixels exceed.
        let mut light: Vec<f64> = colors.iter().map(|c| c[1]).collect();
        light.sort_by(f64::total_cmp);
        let white = light[light.len() * 95 / 100];
        let mut bytes = Vec::with_capacity(3 * size * size);
        for y in 0..size {
            for x in 0..size {
                // phi_i to the right, phi_r upward, both from 0 to 360 degrees.
                let color = colors[x * size + (size - 1 - y)];
                bytes.extend(color.map(|c| {
                    let c = (c / white).max(0.0).sqrt();
                    (255.0 * plywave::color::srgb_encode(c.min(1.0))).round() as u8
                }));
            }
        }
        let file = std::fs::File::create(folder.join(format!("xia_{name}.png")))?;
        let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), size as u32, size as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(&bytes)?;
        let mean = colors.iter().fold([0.0; 3], |sum, c| [sum[0] + c[0], sum[1] + c[1], sum[2] + c[2]]);
        let chroma = colors.iter().map(|c| {
            let (low, high) = (c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2]));
            if high > 0.0 { (high - low) / high } else { 0.0 }
        });
        println!(
            "xia_{name}.png: {lambdas} wavelengths, mean saturation {:.3}, all light {:.2?}, {:.1} s",
            chroma.sum::<f64>() / colors.len() as f64,
            mean.map(|m| m / mean[1]),
            begun.elapsed().as_secs_f64()
        );
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match args.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        [] => {
            fringes()?;
            pairs()?;
            table_1()?;
        }
        ["ellipses"] => ellipses()?,
        ["maps", folder] => maps(Path::new(folder))?,
        _ => return Err("use no argument, `ellipses`, or `maps FOLDER`".into()),
    }
    Ok(())
}
