//! Energies of a model at incidences between its nodes, compared with rays and paths at exactly those
//! incidences, without histogram or spline. Both use the same instances of the ply.
//!
//! Reference: lines drawn from the beam's profile about h, turned at random, traced by
//! [`plywave_sim::trace_path`].

use nalgebra::Vector3;
use plywave::ply::PlyData;
use plywave::spec::{Packing, YarnSpec};
use plywave_fit::{FitOptions, fit};
use plywave_runs::Run;
use plywave_sim::{
    Medium, PathEnd, PlySection, RoughDielectric, ScrewTracer, SimOptions, Trace, Tracer, simulate, trace_path,
};
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

const SEED: u64 = 5;
const INSTANCES: u32 = 6;

fn options(spec: &YarnSpec) -> SimOptions {
    SimOptions {
        seed: SEED,
        instances: INSTANCES,
        shards: 6,
        paths_per_theta: 150_000,
        theta_o_bins: 8,
        phi_o_bins: 16,
        ..SimOptions::preview().overridden_by(&spec.simulation)
    }
}

/// A line of the beam at (theta_i, h) in the frame of a randomly turned and shifted ply: its entry into the
/// ply's bounding cylinder, and its direction.
fn line<R: Rng>(
    spec: &YarnSpec,
    bound: f64,
    theta_i: f64,
    h: f64,
    rng: &mut R,
) -> Option<(Vector3<f32>, Vector3<f32>)> {
    let beam = spec.beam.beam();
    let mut normal = || rng.sample::<f64, _>(StandardNormal);
    let x = h + 0.5 * beam.w0_um * normal();
    let spread = 0.5 * beam.lambda_um / (std::f64::consts::PI * beam.w0_um);
    let (a, b) = (spread * normal(), spread * normal());
    let (sin, cos) = theta_i.sin_cos();
    let d = Vector3::new(a, -cos - b * sin, -sin + b * cos).normalize();
    // |(x, 0) + s (d.x, d.y)| = bound, the nearer root.
    let (p, q) = (d.x * d.x + d.y * d.y, x * d.x);
    let root = q * q - p * (x * x - bound * bound);
    if root <= 0.0 {
        return None;
    }
    let s = (-q - root.sqrt()) / p;
    let at = Vector3::new(x + s * d.x, s * d.y, 800.0 * rng.random::<f64>());
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    let turn = |v: Vector3<f64>| Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z).cast::<f32>();
    Some((turn(at), turn(d)))
}

/// Shares of light that hits nothing, that is only reflected, and that is otherwise scattered at sigma = 0
/// and 0.01, each with its standard error.
fn traced(
    spec: &YarnSpec,
    tracers: &[ScrewTracer],
    theta_i: f64,
    h: f64,
    rays: usize,
    paths: usize,
) -> [(f64, f64); 4] {
    let mut rng = Pcg64Mcg::seed_from_u64((1e6 * theta_i.abs() + 1e3 * (h + 100.0)) as u64);
    let surface = RoughDielectric { eta: spec.fiber.eta as f32, alpha: spec.fiber.alpha_fiber as f32 };
    let (mut missed, mut sums, mut squares) = (0.0, [0.0f64; 4], [0.0f64; 4]);
    for i in 0..rays.max(paths) {
        let tracer = &tracers[i % tracers.len()];
        let line = line(spec, f64::from(tracer.bound_radius_um()), theta_i, h, &mut rng);
        if i < rays {
            let hit = line.is_some_and(|(at, dir)| matches!(tracer.trace(at, dir, Medium::Air), Trace::Hit(_)));
            missed += f64::from(u8::from(!hit));
        }
        if i < paths {
            let weights = match line.map(|(at, dir)| trace_path(tracer, &surface, at, dir, &mut rng)) {
                Some(PathEnd::Reflected { .. }) => [1.0, 0.0, 0.0],
                Some(PathEnd::High { length_um, .. }) => [0.0, 1.0, (-0.01 * f64::from(length_um)).exp()],
                _ => [0.0; 3],
            };
            for (c, w) in weights.into_iter().enumerate() {
                sums[1 + c] += w;
                squares[1 + c] += w * w;
            }
        }
    }
    std::array::from_fn(|c| match c {
        0 => {
            let p = missed / rays as f64;
            (p, (p * (1.0 - p) / rays as f64).sqrt())
        }
        c => {
            let (n, mean) = (paths as f64, sums[c] / paths as f64);
            (mean, ((squares[c] / n - mean * mean).max(0.0) / n).sqrt())
        }
    })
}

fn energies(model: &PlyData, theta_i: f64, h: f64) -> [f64; 4] {
    let e = model.energies.at(theta_i, h);
    [e.r_d, e.refl, e.high.iter().sum(), e.high_at(0.01, &model.path_um)]
}

/// r_d to 0.002 and the rest to 0.002 and the noise of both, between the nodes of lobes and of energies, in
/// both packings. The ridge of light that runs along the fibers of the rim is among the incidences: theta_i =
/// 1.24 at h = 44.
fn energies_hold_between_the_nodes(packing: Packing) {
    let mut spec = YarnSpec::polyester().unwrap();
    spec.ply.packing = packing;
    spec.absorption.sigma_per_um = vec![0.0, 0.003, 0.01, 0.05];
    let table = simulate(&spec, plywave::spec::POLYESTER, &options(&spec), Run::plain()).unwrap();
    let model = fit(&table, &FitOptions::preview(), &|_| {}).unwrap();
    let tracers: Vec<ScrewTracer> = (0..INSTANCES)
        .map(|i| PlySection::generate(&spec, (SEED << 32) + u64::from(i)).unwrap())
        .map(|section| ScrewTracer::new(&section).unwrap())
        .collect();
    for (theta_i, h) in [
        (0.0, -52.3),
        (0.11, 49.6),
        (0.33, -45.1),
        (0.61, 55.9),
        (0.95, 38.4),
        (1.19, -41.7),
        (1.24, 44.0),
        (1.27, 41.2),
        (1.35, 47.5),
        (-1.24, -44.0),
        (1.38, 8.0),
    ] {
        let want = traced(&spec, &tracers, theta_i, h, 400_000, 40_000);
        let got = energies(&model, theta_i, h);
        // The shares' own noise: some 10 000 of a latitude's paths serve a beam.
        let own = |p: f64| (p * (1.0 - p) / 1e4).sqrt();
        for (c, name) in ["r_d", "f_refl", "f_high", "f_high at 0.01"].into_iter().enumerate() {
            let (value, se) = want[c];
            let noise = if c == 0 { 4.0 * se } else { 4.0 * se.hypot(own(value)) };
            let off = (got[c] - value).abs();
            println!("{packing:?} ({theta_i}, {h}) {name}: {:.4}, traced {value:.4} +- {se:.4}", got[c]);
            assert!(off < 0.002 + noise, "({theta_i}, {h}) {name}: {}, traced {value} +- {se}", got[c]);
        }
        assert!((got[0] + got[1] + got[2] - 1.0).abs() < 1e-9);
    }
}

#[test]
#[ignore = "slow: 15 s: energies of falling fibers hold between the nodes"]
fn energies_of_falling_fibers_hold_between_the_nodes() {
    energies_hold_between_the_nodes(Packing::Falling);
}

#[test]
#[ignore = "slow: 15 s: energies of lined fibers hold between the nodes"]
fn energies_of_lined_fibers_hold_between_the_nodes() {
    energies_hold_between_the_nodes(Packing::Lined);
}

/// The fine grids at the nodes of the slices agree with the slices' own weighted sums: two estimators with
/// separate paths and rays.
#[test]
#[ignore = "slow: 10 s: fine energies are those of the slices"]
fn fine_energies_are_those_of_the_slices() {
    let mut spec = YarnSpec::polyester().unwrap();
    spec.absorption.sigma_per_um = vec![0.0, 0.02];
    let table = simulate(&spec, plywave::spec::POLYESTER, &options(&spec), Run::plain()).unwrap();
    let fine = table.fine_energies();
    assert!(fine.miss_h_um.len() >= 49 && fine.share_h_um.len() > table.h_um.len());
    assert!(fine.miss_se.iter().all(|s| *s < 0.02) && fine.miss_se.iter().any(|s| *s > 1e-4));
    let columns = table.h_um.len();
    for node in 0..table.r_d.len() {
        let (theta_i, h) = (table.theta_i[node / columns], table.h_um[node % columns]);
        let at = fine.at_node(theta_i, h);
        for (name, got, want) in [
            ("r_d", at.r_d, table.r_d[node]),
            ("f_refl", at.refl, table.energy_refl[node]),
            ("f_high", at.high[0], table.energy_high[2 * node]),
            ("f_high at 0.02", at.high[1], table.energy_high[2 * node + 1]),
        ] {
            let se = (want * (1.0 - want) / 1e4).max(0.0).sqrt() + 2e-5;
            assert!((got - want).abs() < 5.0 * se, "{name} at ({theta_i}, {h}): {got}, slices {want}, se {se}");
        }
    }
}
