//! Tests of boundary integrals on absorbing and metallic bodies. References first: the series of one circle
//! and of two; then properties of any solution (power balance, independence of resolution). Metals have
//! measured indices (Johnson and Christy 1972).

use crate::boundary::extinction::Probes;
use crate::scene::curve::CurvePoint;
use crate::*;
use plywave::optics::Metal;
use plywave_runs::Run;
use std::f64::consts::TAU;

fn body(shape: Shape, index: [f64; 2]) -> Body {
    Body { shape, center_um: [0.0; 2], rotation_rad: 0.0, eta: index[0], kappa: index[1], lumen: None }
}

fn circle(radius_um: f64, index: [f64; 2]) -> Body {
    body(Shape::Circle { radius_um }, index)
}

fn metal(metal: Metal, lambda_um: f64) -> [f64; 2] {
    metal.index(lambda_um as f32).map(f64::from)
}

fn both() -> Vec<Source> {
    [Polarization::Tm, Polarization::Te].map(|pol| Source { phi_i: 0.3, pol, beam: None }).to_vec()
}

/// Maximum difference of far fields relative to the largest value, and of widths relative to C_ext.
fn errors(got: &[Scattered], want: &[Scattered]) -> [f64; 2] {
    let (mut field, mut width) = (0.0, 0.0);
    for (got, want) in got.iter().zip(want) {
        let far = |a: &[C64], b: &[C64]| a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        let size = want.f_u.iter().chain(&want.f_phi).map(|c| c.norm()).fold(0.0, f64::max);
        field = f64::max(field, far(&got.f_u, &want.f_u).max(far(&got.f_phi, &want.f_phi)) / size);
        let widths = |s: &Scattered| [s.c_sca_um, s.c_abs_um, s.c_ext_um];
        for (got, want_width) in widths(got).into_iter().zip(widths(want)) {
            width = f64::max(width, (got - want_width).abs() / want.c_ext_um);
        }
    }
    assert!(got.iter().all(|s| (s.c_sca_um + s.c_abs_um).is_finite()));
    [field, width]
}

fn unbalance(all: &[Scattered]) -> f64 {
    all.iter().map(|s| (s.c_ext_um - s.c_sca_um - s.c_abs_um).abs() / s.c_ext_um).fold(0.0, f64::max)
}

fn nystrom(bodies: &[Body], wave: &Wave, tolerance: f64) -> Vec<Scattered> {
    NystromSolver::new(bodies, wave, tolerance).unwrap().scatter(&both(), 90).unwrap()
}

/// Far fields and widths of a circle against the series.
fn check_circle(radius_um: f64, index: [f64; 2], wave: &Wave, tolerance: f64) {
    let body = circle(radius_um, index);
    let want = MieSolver::new(&body, wave, 1e-11).unwrap().scatter(&both(), 90).unwrap();
    let got = nystrom(&[body], wave, tolerance);
    let [field, width] = errors(&got, &want);
    println!("radius {radius_um}, index {index:?}, {wave:?}, {tolerance:e}: F {field:.1e}, C {width:.1e}");
    assert!(field < tolerance && width < tolerance, "{radius_um}, {index:?}, {wave:?}: F {field:e}, C {width:e}");
}

/// Circles from clear to opaque, of low to high indices, at normal and oblique incidence.
#[test]
fn absorbing_circles_match_the_series() {
    for eta in [0.1, 0.7, 1.5, 2.5] {
        for kappa in [0.01, 0.1, 0.5, 1.0, 2.0, 5.0] {
            for theta_i in [0.0, 0.7] {
                check_circle(1.0, [eta, kappa], &Wave { lambda_um: 0.5, theta_i }, 1e-6);
            }
            check_circle(5.0, [eta, kappa], &Wave { lambda_um: 0.55, theta_i: 0.0 }, 1e-6);
        }
    }
}

/// The grid of docs/howto/wave.md: 96 circles.
#[test]
#[ignore = "slow: 30 s: widths and far fields of 96 absorbing circles within 1e-6 of the series"]
fn grid_of_absorbing_circles_matches_the_series() {
    for eta in [0.1, 0.7, 1.5, 2.5] {
        for kappa in [0.01, 0.1, 0.5, 1.0, 2.0, 5.0] {
            for theta_i in [0.0, 40f64.to_radians()] {
                for radius_um in [0.5, 5.0] {
                    check_circle(radius_um, [eta, kappa], &Wave { lambda_um: 0.5, theta_i }, 1e-6);
                }
            }
        }
    }
}

/// Opaque circles keep every tolerance, down to skin depths of a thousandth of the radius.
#[test]
fn opaque_circles_keep_any_tolerance() {
    for index in [[1.5, 0.4], metal(Metal::Gold, 0.5), metal(Metal::Silver, 0.6), [0.1, 1.0], [1.0, 20.0], [3.0, 100.0]]
    {
        for tolerance in [1e-1, 1e-3, 1e-6, 1e-9] {
            check_circle(1.5, index, &Wave { lambda_um: 0.5, theta_i: -0.5 }, tolerance);
        }
    }
}

/// Gold, silver and black circles of 20 um: 314 waves around the wall.
#[test]
#[ignore = "slow: 5 s: thick opaque circles match the series"]
fn thick_opaque_circles_match_the_series() {
    for lambda_um in [0.4, 0.55, 0.7] {
        for index in [metal(Metal::Gold, lambda_um), metal(Metal::Silver, lambda_um), [1.5, 0.5], [1.5, 5.0]] {
            check_circle(20.0, index, &Wave { lambda_um, theta_i: 0.0 }, 1e-6);
        }
    }
}

/// Ellipses: powers computed in three ways add up, and a much finer solution agrees.
#[test]
fn metal_ellipses_balance_and_converge() {
    for lambda_um in [0.4, 0.55, 0.7] {
        for index in [metal(Metal::Gold, lambda_um), metal(Metal::Silver, lambda_um), [1.6, 0.7]] {
            for (a_um, b_um, theta_i) in [(2.0, 1.5, 0.0), (2.0, 0.5, 0.4)] {
                let bodies = [body(Shape::Ellipse { a_um, b_um }, index)];
                let wave = Wave { lambda_um, theta_i };
                let (got, want) = (nystrom(&bodies, &wave, 1e-6), nystrom(&bodies, &wave, 1e-9));
                let [field, width] = errors(&got, &want);
                let (off, fine) = (unbalance(&got), unbalance(&want));
                println!("{index:?}, {a_um} x {b_um}, {wave:?}: F {field:.1e}, C {width:.1e}, {off:.1e}, {fine:.1e}");
                assert!(field < 1e-6 && width < 1e-6, "{index:?}, {a_um} x {b_um}: F {field:e}, C {width:e}");
                assert!(off < 1e-6 && fine < 1e-9, "{index:?}, {a_um} x {b_um}: powers {off:e}, {fine:e}");
            }
        }
    }
}

/// A coat of metal around glass and glass around a metal core, against the series; a carbon triangle by its
/// powers.
#[test]
fn coats_cores_and_corners() {
    for lambda_um in [0.45, 0.65] {
        let gold = metal(Metal::Gold, lambda_um);
        for (index, lumen) in [(gold, [1.5, 0.0]), ([1.5, 0.01], gold)] {
            for inner_um in [0.6, 0.95] {
                let mut tube = circle(1.0, index);
                tube.lumen = Some(Box::new(circle(inner_um, lumen)));
                let wave = Wave { lambda_um, theta_i: 0.3 };
                let want = MieSolver::new(&tube, &wave, 1e-11).unwrap().scatter(&both(), 90).unwrap();
                let [field, width] = errors(&nystrom(&[tube], &wave, 1e-6), &want);
                println!("{index:?} around {lumen:?} of {inner_um}, {wave:?}: F {field:.1e}, C {width:.1e}");
                assert!(field < 1e-6 && width < 1e-6, "{index:?} around {lumen:?} of {inner_um}: {field:e}, {width:e}");
            }
        }
    }
    let points_um = vec![[-1.0, -0.6], [1.0, -0.7], [0.2, 0.9]];
    let carbon = [body(Shape::Polygon { points_um, rounding_um: 0.3 }, [1.8, 0.6])];
    let wave = Wave { lambda_um: 0.55, theta_i: 0.0 };
    let (got, want) = (nystrom(&carbon, &wave, 1e-5), nystrom(&carbon, &wave, 1e-7));
    let [field, width] = errors(&got, &want);
    println!("carbon triangle: F {field:.1e}, C {width:.1e}, powers {:.1e}", unbalance(&got));
    assert!(field < 1e-5 && width < 1e-5 && unbalance(&got) < 1e-5);
}

/// Two almost touching circles, solved whole and compressed, against coupled series.
#[test]
fn close_opaque_circles_match_the_series() {
    let wave = Wave { lambda_um: 0.55, theta_i: 0.0 };
    for (index, gap) in [([1.5, 0.5], 0.05), (metal(Metal::Gold, 0.55), 0.1), (metal(Metal::Silver, 0.55), 0.2)] {
        let mut bodies = [circle(1.0, index), circle(0.8, index)];
        bodies[0].center_um[0] = -1.0 - gap;
        bodies[1].center_um[0] = 0.8;
        let want = MultipoleSolver::new(&bodies, &wave, 1e-9).unwrap().scatter(&both(), 90).unwrap();
        let compressed = CompressedSolver::new(&bodies, &wave, 1e-6).unwrap().scatter(&both(), 90).unwrap();
        for (name, got) in [("nystrom", nystrom(&bodies, &wave, 1e-6)), ("compressed", compressed)] {
            let [field, width] = errors(&got, &want);
            println!("{name}, {index:?}, gap {gap}: F {field:.1e}, C {width:.1e}");
            assert!(field < 1e-6 && width < 1e-6, "{name}, {index:?}, gap {gap}: F {field:e}, C {width:e}");
        }
    }
}

fn report(text: &str) -> Report {
    scatter(&Scene::parse(text).unwrap(), text, Run::plain()).unwrap()
}

/// The scenes of `tests/data/field/wave_absorbing`: widths of the series (mpmath, 1e-14), within each
/// tolerance.
#[test]
fn field_absorbing() {
    let half = include_str!("../../../../tests/data/field/wave_absorbing/nystrom.toml");
    let whole = include_str!("../../../../tests/data/field/wave_absorbing/nystrom_k1.toml");
    let mie = include_str!("../../../../tests/data/field/wave_absorbing/mie.toml");
    let want = |kappa_1: bool| {
        if kappa_1 { [[13.174, 20.534], [11.593, 20.870]] } else { [[11.931, 20.549], [10.783, 20.707]] }
    };
    for (text, kappa_1) in [(half, false), (whole, true), (mie, false)] {
        for tolerance in [0.1, 1e-2, 1e-3, 1e-5] {
            let lines: Vec<String> = text
                .lines()
                .map(|l| if l.starts_with("tolerance") { format!("tolerance = {tolerance}") } else { l.into() })
                .collect();
            let cases = report(&(lines.join("\n") + "\n")).cases;
            for (case, [sca, ext]) in cases.iter().zip(want(kappa_1)) {
                // Allow for the printed digits.
                let allowed = f64::max(tolerance, 5e-5);
                assert!((case.c_sca_um / sca - 1.0).abs() < allowed, "{tolerance}: {} {sca}", case.c_sca_um);
                assert!((case.c_ext_um / ext - 1.0).abs() < allowed, "{tolerance}: {} {ext}", case.c_ext_um);
                let off = case.c_ext_um - case.c_sca_um - case.c_abs_um;
                assert!(off.abs() <= tolerance * case.c_ext_um);
            }
        }
    }
}

/// The scene of `tests/data/field/wave_index_matched`, by every method and tolerance, and almost matched
/// bodies: no scattering is not an error.
#[test]
fn field_index_matched() {
    let text = include_str!("../../../../tests/data/field/wave_index_matched/matched.toml");
    for method in ["auto", "nystrom", "compressed", "hierarchical"] {
        for tolerance in ["0.1", "1e-5", "1e-6"] {
            // Compressed fields of almost matched bodies have the error of the compression, which is refused.
            let etas: &[&str] =
                if matches!(method, "auto" | "nystrom") { &["1.0", "1.0000000000001"] } else { &["1.0"] };
            for eta in etas {
                let scene = text
                    .replace("\"auto\"", &format!("\"{method}\""))
                    .replace("tolerance = 1e-5", &format!("tolerance = {tolerance}"))
                    .replace("eta = 1.0", &format!("eta = {eta}"));
                for case in report(&scene).cases {
                    let largest = case.f_co.iter().chain(&case.f_cross).map(|f| f.norm()).fold(0.0, f64::max);
                    let widths = [case.c_sca_um, case.c_abs_um, case.c_ext_um];
                    assert!(largest < 1e-6 && widths.iter().all(|c| c.abs() < 1e-6), "{method}: {largest} {widths:?}");
                    if *eta == "1.0" {
                        assert!(largest < 1e-12 && widths.iter().all(|c| c.abs() < 1e-12), "{largest} {widths:?}");
                    }
                }
            }
        }
    }
}

/// Fields of zero, and fields of another body, are refused at every tolerance, however well their powers add
/// up.
#[test]
fn wrong_fields_do_not_pass() {
    let wave = Wave { lambda_um: 0.5, theta_i: 0.4 };
    let n = 240;
    let nodes: Vec<CurvePoint> = (0..n)
        .map(|j| {
            let (sin, cos) = (TAU * j as f64 / n as f64).sin_cos();
            CurvePoint { at: [2.0 * cos, 2.0 * sin], normal: [cos, sin], speed: 2.0, curvature: 0.5 }
        })
        .collect();
    let weights = vec![2.0 * TAU / n as f64; n];
    let source = both()[0];
    let light = (source.pol, source.plane_waves(&wave, 2.0).unwrap());
    // Fields of an index-matched body: the incident fields.
    let matched: Vec<C64> =
        nodes.iter().flat_map(|p| crate::boundary::incident::incident(&wave, light.0, &light.1, p)).collect();
    let scaled = |factor: f64| -> Vec<C64> { matched.iter().map(|v| v * factor).collect() };
    for tolerance in [1e-1, 1e-6] {
        let probes = Probes::new(&wave, &[(&nodes, &weights)], tolerance);
        let check = |fields: &[C64]| probes.check(&nodes, &weights, fields, n, std::iter::once(&light));
        assert!(check(&matched).is_ok());
        for wrong in [scaled(0.0), scaled(0.4), scaled(-1.0), scaled(f64::NAN), scaled(1e9)] {
            assert!(matches!(check(&wrong), Err(WaveError::Uncancelled { .. })), "{tolerance}");
        }
    }
}
