//! Speed of the wave solvers at stated errors: one slice is one wavelength (0.4 um) and one latitude, both
//! polarizations, 360 azimuths out.
//! One thread. Errors are the largest difference of the far field from that of a much finer solve, over its
//! largest value. `cargo bench -p plywave-wave --bench wave`.

use plywave_wave::{
    Body, MieSolver, MultipoleSolver, NystromSolver, Polarization, Scattered, Shape, Source, Wave, WaveSolver,
};
use std::f64::consts::TAU;
use std::time::Instant;

/// Seconds this thread has run, if the system reports it, so that other work on the machine does not count.
fn running() -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    stat.split_whitespace().next().and_then(|s| s.parse::<f64>().ok()).map_or(f64::NAN, |ns| ns * 1e-9)
}

fn slice(bodies: &[Body], wave: &Wave, sources: &[Source], tolerance: f64) -> (Vec<Scattered>, usize, [f64; 3]) {
    let (begun, ran) = (Instant::now(), running());
    let solver = NystromSolver::new(bodies, wave, tolerance).expect("a sound scene");
    let prepared = begun.elapsed().as_secs_f64();
    let scattered = solver.scatter(sources, 360).expect("a solve");
    (scattered, solver.stats().unknowns, [begun.elapsed().as_secs_f64(), prepared, running() - ran])
}

fn error(got: &[Scattered], want: &[Scattered]) -> f64 {
    let fields = |s: &Scattered| s.f_u.iter().chain(&s.f_phi).copied().collect::<Vec<_>>();
    let size = want.iter().flat_map(fields).map(|c| c.norm()).fold(0.0, f64::max);
    let apart = |(a, b): (&Scattered, &Scattered)| {
        fields(a).into_iter().zip(fields(b)).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    got.iter().zip(want).map(apart).fold(0.0, f64::max) / size
}

fn main() {
    // `cargo test --benches` only checks that it starts.
    if std::env::args().any(|a| a == "--test") {
        return;
    }
    let corner = |j: i32| {
        let a = TAU * f64::from(j) / 3.0;
        [5.0 * a.cos(), 5.0 * a.sin()]
    };
    let triangle = Shape::Polygon { points_um: vec![corner(0), corner(1), corner(2)], rounding_um: 0.5 };
    let shapes = [
        ("ellipse 1.6 x 1 um", Shape::Ellipse { a_um: 1.6, b_um: 1.0 }, 90, 0.03, 9),
        ("triangle of circumradius 5, rounding 0.5 um", triangle, 360, 1.0, 3),
        ("ellipse 16 x 10 um", Shape::Ellipse { a_um: 16.0, b_um: 10.0 }, 90, 3.0, 2),
    ];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    pool.install(|| {
        for (name, shape, azimuths, target, repeats) in shapes {
            let bodies = [Body { shape, center_um: [0.0; 2], rotation_rad: 0.0, eta: 1.55, kappa: 0.0, lumen: None }];
            let sources: Vec<Source> = (0..azimuths)
                .flat_map(|j| {
                    let phi_i = TAU * f64::from(j) / f64::from(azimuths);
                    [Polarization::Tm, Polarization::Te].map(|pol| Source { phi_i, pol, beam: None })
                })
                .collect();
            for theta_deg in [0.0, 30.0_f64] {
                let wave = Wave { lambda_um: 0.4, theta_i: theta_deg.to_radians() };
                let truth = slice(&bodies, &wave, &sources, 1e-10).0;
                for tolerance in [1e-3, 1e-6] {
                    let runs: Vec<_> = (0..repeats).map(|_| slice(&bodies, &wave, &sources, tolerance)).collect();
                    let least = |k: usize| runs.iter().map(|r| r.2[k]).fold(f64::MAX, f64::min);
                    println!(
                        "{name}, theta_i {theta_deg}, {azimuths} phi_i: error {:.1e}, {:.4} s by the clock ({:.4} s before the sources), {:.4} s of one core, largest block {}; target {target} s at 1e-6",
                        error(&runs[0].0, &truth),
                        least(0),
                        least(1),
                        least(2),
                        runs[0].1
                    );
                }
            }
        }
        series();
    });
}

/// A slice of one round fiber by Mie's series, and of several by multipoles, against the same series at a
/// much smaller tolerance.
fn series() {
    let fiber = |center_um| Body {
        shape: Shape::Circle { radius_um: 7.5 },
        center_um,
        rotation_rad: 0.0,
        eta: 1.55,
        kappa: 0.0,
        lumen: None,
    };
    let sources: Vec<Source> = (0..90)
        .flat_map(|j| {
            let phi_i = TAU * f64::from(j) / 90.0;
            [Polarization::Tm, Polarization::Te].map(|pol| Source { phi_i, pol, beam: None })
        })
        .collect();
    for theta_deg in [0.0, 30.0_f64] {
        let wave = Wave { lambda_um: 0.4, theta_i: theta_deg.to_radians() };
        let one = fiber([0.0; 2]);
        let mie = |tolerance: f64| {
            let start = Instant::now();
            let fields =
                MieSolver::new(&one, &wave, tolerance).and_then(|s| s.scatter(&sources, 360)).expect("a series");
            (fields, start.elapsed().as_secs_f64())
        };
        let (truth, (got, seconds)) = (mie(1e-13).0, mie(1e-9));
        println!(
            "circle of radius 7.5 um by Mie, theta_i {theta_deg}, 90 phi_i: error {:.1e}, {seconds:.4} s",
            error(&got, &truth)
        );
        for count in [2, 7, 19] {
            let bodies: Vec<Body> = hexagon(count, 15.2).into_iter().map(fiber).collect();
            let multipole = |tolerance: f64| {
                let start = Instant::now();
                let fields = MultipoleSolver::new(&bodies, &wave, tolerance)
                    .and_then(|s| s.scatter(&sources, 360))
                    .expect("a series");
                (fields, start.elapsed().as_secs_f64())
            };
            let (truth, (got, seconds)) = (multipole(1e-10).0, multipole(1e-6));
            println!(
                "{count} circles of radius 7.5 um, gaps 0.2 um, by multipoles, theta_i {theta_deg}, 90 phi_i: error {:.1e}, {seconds:.3} s",
                error(&got, &truth)
            );
        }
    }
}

/// The sites of a hexagonal lattice nearest to the origin [um].
fn hexagon(count: usize, spacing_um: f64) -> Vec<[f64; 2]> {
    let mut sites: Vec<[f64; 2]> = (-3..=3)
        .flat_map(|i| (-3..=3).map(move |j| [f64::from(i) + 0.5 * f64::from(j), 0.75f64.sqrt() * f64::from(j)]))
        .collect();
    sites.sort_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])));
    sites.into_iter().take(count).map(|s| s.map(|v| spacing_um * v)).collect()
}
