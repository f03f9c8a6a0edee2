//! Plies of clear fibers (eta 1.55) of 15 um at 0.4 um, each 0.2 um from a neighbor, every second one an
//! ellipse of 7.5 x 6 um turned at random: 13 beams (w0 10 um, h across the ply) in both polarizations at a
//! far-field error of 1e-3, by the compressed solver.
//!
//! ```text
//! cargo bench -p plywave-wave --bench ply_wave -- [fibers ..] [circles] [merged] [theta=DEG] [tolerance=T] [truth=T]
//! ```
//!
//! With `merged` the coupled system is solved by merging groups of fibers, and the reference is the system
//! solved whole at the tolerance `truth`. Errors are the largest relative L2 difference over azimuths, beams
//! and polarizations from the reference (omitted for 0), which is the multipole series if all fibers are
//! circles. Seconds are of the clock and of all threads together; the peak is the process' own so far, beside
//! the solver's estimate.

use plywave_wave::{
    BeamSource, Body, C64, CompressedSolver, MultipoleSolver, Polarization, Scattered, Shape, Source, Wave, WaveSolver,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::time::Instant;

const GAP_UM: f64 = 0.2;
const SEMI_AXES_UM: [f64; 2] = [7.5, 6.0];

fn axes(body: &Body) -> (f64, f64) {
    match body.shape {
        Shape::Circle { radius_um } => (radius_um, radius_um),
        Shape::Ellipse { a_um, b_um } => (a_um, b_um),
        _ => unreachable!("plies are of circles and ellipses"),
    }
}

/// A point at the distance `grow` from the outline along its normal.
fn outline(body: &Body, t: f64, grow: f64) -> C64 {
    let (a, b) = axes(body);
    let (sin, cos) = t.sin_cos();
    let normal = C64::new(b * cos, a * sin);
    let local = C64::new(a * cos, b * sin) + normal / normal.norm() * grow;
    C64::new(body.center_um[0], body.center_um[1]) + local * C64::from_polar(1.0, body.rotation_rad)
}

fn encloses(body: &Body, z: C64) -> bool {
    let (a, b) = axes(body);
    let local = (z - C64::new(body.center_um[0], body.center_um[1])) * C64::from_polar(1.0, -body.rotation_rad);
    (local.re / a).powi(2) + (local.im / b).powi(2) < 1.0
}

/// Fibers moved from the sites of a hexagonal lattice towards its middle until they are as close as the gap
/// allows.
fn ply(count: usize, circles: bool) -> Vec<Body> {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let mut sites: Vec<C64> = (-10..=10)
        .flat_map(|i| (-10..=10).map(move |j| C64::new(i as f64 + 0.5 * j as f64, 0.75f64.sqrt() * j as f64)))
        .collect();
    // The small term orders sites at equal distance.
    let rank = |z: &C64| z.norm() + 1e-6 * z.arg();
    sites.sort_by(|x, y| rank(x).total_cmp(&rank(y)));
    let [a_um, b_um] = SEMI_AXES_UM;
    let mut all: Vec<Body> = Vec::new();
    for (index, site) in sites.into_iter().take(count).enumerate() {
        let shape =
            if circles || index % 2 == 0 { Shape::Circle { radius_um: a_um } } else { Shape::Ellipse { a_um, b_um } };
        let rotation_rad = rng.random::<f64>() * TAU;
        let mut new = Body { shape, center_um: [0.0; 2], rotation_rad, eta: 1.55, kappa: 0.0, lumen: None };
        let far = site * (3.0 * (2.0 * a_um + GAP_UM));
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            new.center_um = [far.re * middle, far.im * middle];
            let hits = all.iter().any(|other| {
                let apart = [0, 1].map(|k| other.center_um[k] - new.center_um[k]);
                let apart = apart[0].hypot(apart[1]);
                // Concentric fibers enclose each other without crossing outlines.
                apart < 2.0 * SEMI_AXES_UM[1]
                    || apart < 2.0 * (a_um + GAP_UM)
                        && (0..720).map(|k| k as f64 * TAU / 720.0).any(|t| {
                            encloses(&new, outline(other, t, GAP_UM)) || encloses(other, outline(&new, t, GAP_UM))
                        })
            });
            if hits { low = middle } else { high = middle }
        }
        new.center_um = [far.re * high, far.im * high];
        all.push(new);
    }
    all
}

fn beams(bodies: &[Body]) -> Vec<Source> {
    let width = bodies.iter().map(|b| b.center_um[0].abs() + SEMI_AXES_UM[0]).fold(0.0, f64::max);
    [Polarization::Tm, Polarization::Te]
        .into_iter()
        .flat_map(|pol| {
            (-6..=6).map(move |j| {
                let beam = BeamSource { w0_um: 10.0, h_um: width * f64::from(j) / 6.0 };
                Source { phi_i: FRAC_PI_2, pol, beam: Some(beam) }
            })
        })
        .collect()
}

/// Largest relative L2 difference of far fields.
fn error(got: &[Scattered], want: &[Scattered]) -> f64 {
    let apart = |(g, w): (&Scattered, &Scattered)| {
        let pairs = || g.f_u.iter().zip(&w.f_u).chain(g.f_phi.iter().zip(&w.f_phi));
        let off: f64 = pairs().map(|(a, b)| (a - b).norm_sqr()).sum();
        (off / pairs().map(|(_, b)| b.norm_sqr()).sum::<f64>()).sqrt()
    };
    got.iter().zip(want).map(apart).fold(0.0, f64::max)
}

/// Seconds of all threads since the start, by the scheduler's clock ticks of 10 ms.
fn running() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<f64> =
        stat.rsplit(") ").next().unwrap_or("").split(' ').map(|f| f.parse().unwrap_or(0.0)).collect();
    if fields.len() > 12 { 0.01 * (fields[11] + fields[12]) } else { f64::NAN }
}

fn peak_gib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("");
    line.trim().trim_end_matches(" kB").trim().parse::<f64>().map_or(f64::NAN, |kib| kib / f64::from(1 << 20))
}

fn main() {
    // `cargo test --benches` only checks that it starts.
    if std::env::args().any(|a| a == "--test") {
        return;
    }
    let (mut counts, mut thetas, mut tolerance, mut truth) = (Vec::new(), Vec::new(), 1e-3, 1e-5);
    let (mut circles, mut merged) = (false, false);
    for argument in std::env::args().skip(1).filter(|a| a != "--bench") {
        match argument.split_once('=') {
            Some(("theta", v)) => thetas.push(v.parse::<f64>().expect("degrees")),
            Some(("tolerance", v)) => tolerance = v.parse().expect("a number"),
            Some(("truth", v)) => truth = v.parse().expect("a number"),
            _ if argument == "circles" => circles = true,
            _ if argument == "merged" => merged = true,
            _ => counts.push(argument.parse::<usize>().expect("a number of fibers, theta=, tolerance= or truth=")),
        }
    }
    if counts.is_empty() {
        counts = vec![7, 19, 37, 50];
    }
    if thetas.is_empty() {
        thetas = vec![0.0, 30.0];
    }
    println!("tolerance {tolerance:e}, {} threads", rayon::current_num_threads());
    println!(
        "fibers  theta  unknowns  prepare s  scatter s  all threads s  peak GiB  planned  residual  ledger   error"
    );
    for &count in &counts {
        let bodies = ply(count, circles);
        let sources = beams(&bodies);
        for &theta in &thetas {
            let wave = Wave { lambda_um: 0.4, theta_i: theta.to_radians() };
            let (begun, ran) = (Instant::now(), running());
            let prepare = if merged { CompressedSolver::hierarchical } else { CompressedSolver::new };
            let solver = prepare(&bodies, &wave, tolerance).expect("a sound ply");
            let prepared = begun.elapsed().as_secs_f64();
            let got = solver.scatter(&sources, 1440).expect("a solve");
            let scattered = begun.elapsed().as_secs_f64() - prepared;
            let (all, stats, peak) = (running() - ran, solver.stats(), peak_gib());
            drop(solver);
            let defect =
                got.iter().map(|s| (s.c_sca_um + s.c_abs_um - s.c_ext_um).abs() / s.c_ext_um.abs()).fold(0.0, f64::max);
            let err = if truth > 0.0 {
                let finer: Box<dyn WaveSolver> = if circles {
                    Box::new(MultipoleSolver::new(&bodies, &wave, truth).expect("a sound ply"))
                } else {
                    Box::new(CompressedSolver::new(&bodies, &wave, truth).expect("a sound ply"))
                };
                format!("{:.1e}", error(&got, &finer.scatter(&sources, 1440).expect("a solve")))
            } else {
                "-".into()
            };
            println!(
                "{count:6} {theta:6} {:9} {prepared:10.1} {scattered:10.1} {all:14.1} {peak:9.2} {:8.2} {:9.1e} {defect:7.1e} {err}",
                stats.unknowns,
                stats.peak_bytes as f64 / f64::from(1 << 30),
                stats.residual
            );
        }
    }
}
