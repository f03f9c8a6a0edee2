//! Fiber tables from end to end. Chain of trust: the series of circles are compared with published digits in
//! their own file, and the tabulation with a synthetic solver in its own. Here the loaded fiber of a real
//! solver passes the furnace, reproduces the wave simulation's net effect on a beam when rendered as rays
//! (Xia 2020, 7.2 and Fig. 10), and large fibers agree with rays on average (Xia 2020, Fig. 4).

use plywave::Bsdf;
use plywave::Document;
use plywave::frame::direction;
use plywave::spec::{FiberSpec, Shape, YarnSpec};
use plywave_check::{FURNACE_TOLERANCE, SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE, check_bsdf};
use plywave_fiber::FiberQuery;
use plywave_fiber::{FiberTable, TabulatedFiber};
use plywave_runs::Run;
use plywave_wave::{
    Absorption, BeamSource, Body, MieSolver, NystromSolver, Polarization, SingleFiber, Solver, Source, TabulateOptions,
    Wave, WaveSolver, tabulate, tabulate_rays,
};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

fn fiber(shape: Shape, eta: f64, sigma: f64) -> SingleFiber {
    let spec = FiberSpec { shape, eta, alpha_fiber: 0.0, ..YarnSpec::polyester().unwrap().fiber };
    SingleFiber::of_spec(&spec, Absorption::Sigma(sigma))
}

fn circle(radius_um: f64, eta: f64, sigma: f64) -> SingleFiber {
    fiber(Shape::Circle { radius_um }, eta, sigma)
}

fn options() -> TabulateOptions {
    TabulateOptions { lambdas: 3, thetas: 6, relative: 360, tolerance: 1e-6, ..TabulateOptions::preview() }
}

fn table(fiber: &SingleFiber, options: &TabulateOptions) -> FiberTable {
    tabulate(fiber, "spec", options, Run::plain()).unwrap()
}

#[test]
fn furnace_of_clear_and_dark_fibers() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for (sigma, clear) in [(0.0, true), (0.3, false)] {
        let t = table(&circle(1.0, 1.55, sigma), &options());
        assert!(t.ledger_error() < 1e-6, "{}", t.ledger_error());
        let loaded = TabulatedFiber::from_bytes(&t.to_bytes().unwrap(), "fiber").unwrap();
        for theta in [0.0, 0.6, -1.2, 1.5] {
            let wi = direction(theta, 6.0 * rng.random::<f32>());
            let sd = [t.beta_m, TAU / t.phi_r_count() as f64 / 9.0];
            let r = check_bsdf(&loaded.at(&FiberQuery::new(wi, [0.5])), sd, 20_000, &mut || rng.random());
            let [albedo] = loaded.at(&FiberQuery::new(wi, [0.5])).albedo();
            let what = format!("sigma {sigma}, theta {theta}: albedo {albedo}, {r:?}");
            assert!(r.furnace_error < FURNACE_TOLERANCE && r.pdf_error < FURNACE_TOLERANCE, "{what}");
            assert!(r.weight_error < WEIGHT_TOLERANCE && r.sampled_furnace_se < SAMPLED_TOLERANCE_SE, "{what}");
            assert!(r.chi2_p > 1e-4, "{what}");
            assert_eq!((albedo - 1.0).abs() < 1e-5, clear, "{what}");
        }
    }
}

/// Straight fibers scatter light from theta_i and -theta_i alike: only |theta_i| need be tabulated.
#[test]
fn sign_of_the_latitude_changes_nothing() {
    let bodies = [
        circle(1.3, 1.55, 0.1).at(0.5),
        fiber(Shape::Ellipse { a_um: 0.8, b_um: 0.5 }, 1.55, 0.1).at(0.5),
        fiber(Shape::Trilobal { radius_um: 0.6, depth: 0.2 }, 1.55, 0.0).at(0.5),
    ];
    let sources: Vec<Source> = [Polarization::Tm, Polarization::Te]
        .into_iter()
        .flat_map(|pol| [0.0, 0.7, 2.0].map(|phi_i| Source { phi_i, pol, beam: None }))
        .collect();
    let at = |body: &Body, theta_i: f64| {
        let wave = Wave { lambda_um: 0.5, theta_i };
        let solver: Solver = match body.shape {
            plywave_wave::Shape::Circle { .. } => Box::new(MieSolver::new(body, &wave, 1e-9).unwrap()),
            _ => Box::new(NystromSolver::new(std::slice::from_ref(body), &wave, 1e-8).unwrap()),
        };
        solver.scatter(&sources, 90).unwrap()
    };
    for (body, theta_i) in bodies.iter().flat_map(|body| [0.2, 0.9, 1.4].map(|theta_i| (body, theta_i))) {
        for (a, b) in at(body, theta_i).iter().zip(&at(body, -theta_i)) {
            assert!(
                (a.c_ext_um / b.c_ext_um - 1.0).abs() < 1e-8 && (a.c_abs_um - b.c_abs_um).abs() < 1e-8 * a.c_ext_um
            );
            let peak = a.f_u.iter().chain(&a.f_phi).map(|f| f.norm_sqr()).fold(0.0, f64::max);
            for j in 0..90 {
                let (x, y) = (a.f_u[j].norm_sqr(), b.f_u[j].norm_sqr());
                let (z, w) = (a.f_phi[j].norm_sqr(), b.f_phi[j].norm_sqr());
                assert!((x - y).abs() < 1e-8 * peak && (z - w).abs() < 1e-8 * peak, "theta_i {theta_i}, {j}");
            }
        }
    }
}

/// An ellipse's table agrees with the solver at azimuths between its nodes in all quadrants, and the gain of
/// interpolating at equal phi_r - phi_i over interpolating at equal phi_r.
#[test]
fn ellipses_are_known_at_every_azimuth() {
    let fiber = fiber(Shape::Ellipse { a_um: 1.6, b_um: 1.0 }, 1.55, 0.0);
    let sizes = TabulateOptions { lambda_um: [0.4999, 0.5001], lambdas: 1, thetas: 3, ..options() };
    let wave = Wave { lambda_um: 0.5, theta_i: FiberTable::theta_nodes(3)[0] };
    let solver = NystromSolver::new(&[fiber.at(0.5)], &wave, 1e-8).unwrap();
    let n = 360;
    // N over phi_r by the solver, and C_x.
    let exact = |phi_i: f64| -> (Vec<f64>, f64) {
        let sources = [Polarization::Tm, Polarization::Te].map(|pol| Source { phi_i, pol, beam: None });
        let fields = solver.scatter(&sources, n).unwrap();
        let c_ext = 0.5 * (fields[0].c_ext_um + fields[1].c_ext_um);
        let at = |j: usize| fields.iter().map(|f| f.f_u[j].norm_sqr() + f.f_phi[j].norm_sqr()).sum::<f64>();
        ((0..n).map(|j| 0.5 * at(j) * 2.0 / (PI * wave.k0()) / c_ext).collect(), c_ext / wave.theta_i.cos())
    };
    let l2 = |a: &[f64], b: &[f64]| {
        let d: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
        (d / b.iter().map(|y| y * y).sum::<f64>()).sqrt()
    };
    for (azimuths, allowed, allowed_width) in [(360, 0.02, 0.005), (90, 0.08, 0.05)] {
        let t = table(&fiber, &TabulateOptions { azimuths, ..sizes.clone() });
        let step = t.phi_i[1] - t.phi_i[0];
        let loaded = TabulatedFiber::from_table(t).unwrap();
        let (mut worst, mut worst_equal) = (0.0f64, 0.0f64);
        for quarter in 0..4 {
            for node in [3.5, 9.5, 14.5] {
                let phi_i = 0.5 * PI * f64::from(quarter) + node * step;
                let (want, c_x) = exact(phi_i);
                let wi = direction(wave.theta_i as f32, phi_i as f32);
                let at = loaded.at(&FiberQuery::new(wi, [0.5]));
                let width = f64::from(at.width_um()[0]);
                assert!((width / c_x - 1.0).abs() < allowed_width, "phi_i {phi_i}: width {width}, want {c_x}");
                let f: Vec<f64> = (0..n)
                    .map(|j| direction(-wave.theta_i as f32, (TAU * j as f64 / n as f64) as f32))
                    .map(|wo| f64::from(at.eval(wo)[0]))
                    .collect();
                // M_0 at its peak drops out: N integrates to 1.
                let sum = f.iter().sum::<f64>() * TAU / n as f64;
                let got: Vec<f64> = f.iter().map(|f| f / sum).collect();
                worst = worst.max(l2(&got, &want));
                let (below, above) = (exact(phi_i - 0.5 * step).0, exact(phi_i + 0.5 * step).0);
                let equal: Vec<f64> = below.iter().zip(&above).map(|(a, b)| 0.5 * (a + b)).collect();
                worst_equal = worst_equal.max(l2(&equal, &want));
            }
        }
        println!(
            "phi_i every {:.1} degrees: relative L2 {worst:.4} midway between nodes; {worst_equal:.4} at equal phi_r",
            step.to_degrees()
        );
        // Measured 0.0106 against 0.0109 at 1 degree, 0.056 against 0.151 at 4.1.
        assert!(worst < allowed, "{worst}");
        assert!(worst < worst_equal, "{worst}, {worst_equal} at equal phi_r");
    }
}

/// Net effect of the fiber on a beam from azimuth `phi_i`, per azimuth bin [um], by wave optics: the
/// intensity of the whole field minus that of the beam alone, unpolarized.
///
/// Far from its waist the beam `integral a(q) exp(i (q s + sqrt(k^2 - q^2) l)) dq`, k the transverse
/// wavenumber, is by stationary phase `sqrt(2/(pi k rho)) exp(i (k rho - pi/4)) pi k cos(psi) a(k sin psi)`
/// at the angle psi from its axis; TE has the sign of h.
fn net_by_waves(solver: &dyn WaveSolver, wave: &Wave, phi_i: f64, beam: BeamSource, bins: usize) -> Vec<f64> {
    const FINE: usize = 16;
    let n = bins * FINE;
    let k = wave.k_rho();
    let mut net = vec![0.0; bins];
    for (pol, sign) in [(Polarization::Tm, 1.0), (Polarization::Te, -1.0)] {
        let field = &solver.scatter(&[Source { phi_i, pol, beam: Some(beam) }], n).unwrap()[0];
        for j in 0..n {
            // s runs along (sin phi_i, -cos phi_i), to the left of the light's direction as seen from +z.
            let psi = TAU * j as f64 / n as f64 - (phi_i + PI);
            let (sin, cos) = psi.sin_cos();
            let q = k * sin;
            let spectrum = beam.w0_um / (2.0 * PI.sqrt()) * (-(0.5 * beam.w0_um * q).powi(2)).exp();
            let own = if cos > 0.0 { sign * PI * k * cos * spectrum } else { 0.0 };
            let (co, cross) = match pol {
                Polarization::Tm => (field.f_u[j], field.f_phi[j]),
                Polarization::Te => (field.f_phi[j], field.f_u[j]),
            };
            let change = (co + own).norm_sqr() - own * own + cross.norm_sqr();
            // Bins are centered at their azimuths.
            net[((j + FINE / 2) / FINE) % bins] += 0.5 * 2.0 / (PI * wave.k0()) * change * TAU / n as f64;
        }
    }
    net
}

/// The same by rays: positions and directions from the beam's intensity; the table scatters those that hit
/// the effective width.
fn net_by_rays(
    fiber: &TabulatedFiber,
    wave: &Wave,
    phi_i: f64,
    w0_um: f64,
    bins: usize,
    rays: u64,
    rng: &mut Pcg64Mcg,
) -> Vec<f64> {
    // exp(-2 s^2 / w0^2) over places and exp(-w0^2 q^2 / 2) over transverse wavenumbers.
    let (place_sd, angle_sd) = (0.5 * w0_um, 1.0 / (w0_um * wave.k_rho()));
    let power = w0_um * (0.5 * PI).sqrt() * wave.theta_i.cos();
    let mut net = vec![0.0; bins];
    let bin = |phi: f64| (phi / TAU * bins as f64).round().rem_euclid(bins as f64) as usize % bins;
    for _ in 0..rays {
        let s = place_sd * rng.sample::<f64, _>(StandardNormal);
        let psi = angle_sd * rng.sample::<f64, _>(StandardNormal);
        let wi = direction(wave.theta_i as f32, (phi_i + psi) as f32);
        let lambda = wave.lambda_um as f32;
        let at = fiber.at(&FiberQuery::new(wi, [lambda]));
        if at.hit((s * psi.cos()) as f32)[0] {
            net[bin(phi_i + psi + PI)] -= power / rays as f64;
            if let Some(out) = at.sample([rng.random(), rng.random(), rng.random()]).direction() {
                let phi = f64::from(out.w[1]).atan2(f64::from(out.w[0]));
                net[bin(phi)] += f64::from(out.weight[0]) * power / rays as f64;
            }
        }
    }
    net
}

/// Two net effects compared.
struct Nets {
    /// Relative L2 difference beyond 3 divergences of the beam.
    l2: f64,
    /// Net power within them, by waves and by rays [um].
    lost: [f64; 2],
}

fn compare_nets(waves: &[f64], rays: &[f64], phi_i: f64, divergence: f64) -> Nets {
    let bins = waves.len();
    let near = |j: usize| {
        let psi = (TAU * j as f64 / bins as f64 - phi_i).rem_euclid(TAU) - PI;
        psi.abs() < 3.0 * divergence
    };
    let (mut difference, mut whole, mut lost) = (0.0, 0.0, [0.0; 2]);
    for j in 0..bins {
        if near(j) {
            lost[0] += waves[j];
            lost[1] += rays[j];
        } else {
            difference += (waves[j] - rays[j]).powi(2);
            whole += waves[j].powi(2);
        }
    }
    Nets { l2: (difference / whole).sqrt(), lost }
}

/// Xia 2020, Fig. 10: a beam ten times as wide as the fiber's radius; and a wider one, which leaves less of
/// the difference.
#[test]
#[ignore = "slow: 6 s: a rendered beam shows the net effect of the waves"]
fn rendered_beam_shows_the_net_effect_of_the_waves() {
    let mut rng = Pcg64Mcg::seed_from_u64(10);
    let bins = 180;
    let cases = [(1.0, 0.0, 10.0, 4_000_000), (1.0, 0.0, 40.0, 16_000_000), (0.5, 0.5, 10.0, 4_000_000)];
    for (radius_um, sigma, waists, rays) in cases {
        let fiber = circle(radius_um, 1.55, sigma);
        // One band so narrow that it is one wavelength, latitudes whose centers are 15, 45 and 75 degrees.
        let options = TabulateOptions {
            lambda_um: [0.4999, 0.5001],
            lambdas: 1,
            thetas: 3,
            relative: 720,
            ..TabulateOptions::preview()
        };
        let t = table(&fiber, &options);
        let loaded = TabulatedFiber::from_table(t.clone()).unwrap();
        for (m, &theta_i) in t.theta_i[..2].iter().enumerate() {
            let wave = Wave { lambda_um: 0.5, theta_i };
            let beam = BeamSource { w0_um: waists * radius_um, h_um: 0.0 };
            let phi_i = 0.5 * PI;
            let solver = MieSolver::new(&fiber.at(0.5), &wave, 1e-9).unwrap();
            let by_waves = net_by_waves(&solver, &wave, phi_i, beam, bins);
            let by_rays = net_by_rays(&loaded, &wave, phi_i, beam.w0_um, bins, rays, &mut rng);
            let divergence = 2.0 / (beam.w0_um * wave.k_rho());
            let net = compare_nets(&by_waves, &by_rays, phi_i, divergence);
            let sums: [f64; 2] = [by_waves.iter().sum(), by_rays.iter().sum()];
            let (c_x, cos) = (t.c_x_um[m], theta_i.cos());
            // At the edges of the effective width the beam is weaker than the even light of the table, by the
            // mean of 1 - exp(-2 s^2 / w0^2) over it, and the pattern depends on the light's position. The
            // noise of the rays comes on top.
            let edge = (c_x / beam.w0_um).powi(2) / 6.0;
            println!(
                "radius {radius_um} um, sigma {sigma}, w0 {waists} radii, theta_i {:.0}: relative L2 beyond the beam {:.4}; lost near the beam {:.4} um by waves, {:.4} um by rays; C_x {c_x:.4} um, edge {edge:.4}",
                theta_i.to_degrees(),
                net.l2,
                net.lost[0],
                net.lost[1]
            );
            assert!(net.l2 < edge + 0.02, "relative L2 beyond the beam {}", net.l2);
            assert!((net.lost[1] / net.lost[0] - 1.0).abs() < edge + 0.02, "lost near the beam: {:?}", net.lost);
            // A clear fiber only moves light; a dark one also absorbs.
            for sum in sums {
                let absorbed = t.c_abs_um[m] * cos;
                assert!((sum + absorbed).abs() < (edge + 0.01) * c_x * cos, "{sum} of {absorbed} absorbed");
            }
        }
    }
}

/// A circular convolution with a Gaussian.
fn blurred(values: &[f64], sd: f64) -> Vec<f64> {
    let n = values.len();
    let kernel: Vec<f64> = (0..n)
        .map(|j| {
            let x = TAU * j.min(n - j) as f64 / n as f64;
            (-0.5 * (x / sd).powi(2)).exp()
        })
        .collect();
    let sum: f64 = kernel.iter().sum();
    (0..n).map(|i| (0..n).map(|j| kernel[(n + i - j) % n] * values[j]).sum::<f64>() / sum).collect()
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let cov = |u: &[f64], mu: f64, v: &[f64], mv: f64| u.iter().zip(v).map(|(x, y)| (x - mu) * (y - mv)).sum::<f64>();
    cov(a, ma, b, mb) / (cov(a, ma, a, ma) * cov(b, mb, b, mb)).sqrt()
}

/// Waves agree with rays for a large smooth fiber: differential widths N C_e away from the forward peak,
/// which rays lack, over a band of wavelengths.
#[test]
#[ignore = "slow: 5 s: large fibers agree with rays"]
fn large_fibers_agree_with_rays() {
    let fiber = circle(10.0, 1.55, 0.0);
    let options = TabulateOptions {
        lambda_um: [0.4, 0.44],
        lambdas: 1,
        thetas: 3,
        turns: 0.25,
        most_samples: 20,
        rays: 2_000_000,
        ..options()
    };
    let waves = table(&fiber, &options);
    let rays = tabulate_rays(&fiber, "spec", &options, Run::plain()).unwrap();
    let d = waves.phi_r_count();
    assert_eq!(rays.phi_r_count(), d);
    for m in 0..2 {
        let width = |t: &FiberTable| -> Vec<f64> {
            t.azimuthal[m * d..(m + 1) * d].iter().map(|n| f64::from(*n) * t.c_x_um[m]).collect()
        };
        let (a, b) = (width(&waves), width(&rays));
        let (wide_a, wide_b) = (blurred(&a, 0.05), blurred(&b, 0.05));
        // Beyond 30 degrees from the forward direction.
        let (x, y): (Vec<f64>, Vec<f64>) = (0..d)
            .filter(|j| (*j as f64 / d as f64 - 0.5).abs() > 30.0 / 360.0)
            .map(|j| (wide_a[j], wide_b[j]))
            .unzip();
        let r = correlation(&x, &y);
        let l2 =
            (x.iter().zip(&y).map(|(p, q)| (p - q).powi(2)).sum::<f64>() / y.iter().map(|q| q * q).sum::<f64>()).sqrt();
        // Light that goes back: relative azimuths within 90 degrees of the incidence.
        let back =
            |v: &[f64]| (0..d).filter(|j| 4 * j < d || 4 * j > 3 * d).map(|j| v[j]).sum::<f64>() * TAU / d as f64;
        let ratio = back(&a) / back(&b);
        println!(
            "theta_i {:.0}: C_x over the width {:.4}; beyond 30 degrees correlation {r:.4}, relative L2 {l2:.4}; power back over that of rays {ratio:.4}",
            waves.theta_i[m].to_degrees(),
            waves.c_x_um[m] / waves.width_um[0]
        );
        // Measured 0.9986, 0.053, 1.08 at 15 degrees and 0.994, 0.10, 1.20 at 45: the excess of waves over
        // twice the width runs around the fiber (k R cos theta_i is 106 to 145) and leaves in all directions,
        // partly backwards.
        assert!(r > 0.99 && l2 < 0.15 && (1.0..1.3).contains(&ratio), "{r} {l2} {ratio}");
        assert!((2.0..2.1).contains(&(waves.c_x_um[m] / waves.width_um[0])));
        assert!((rays.c_x_um[m] / 20.0 - 1.0).abs() < 1e-12);
    }
}
