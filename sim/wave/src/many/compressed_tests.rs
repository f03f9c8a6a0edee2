//! Tests of the compressed solver against the plain boundary integral solver on whole scenes.

use crate::*;
use std::f64::consts::PI;

fn body(shape: Shape, center_um: [f64; 2], rotation_rad: f64, eta: f64, kappa: f64) -> Body {
    Body { shape, center_um, rotation_rad, eta, kappa, lumen: None }
}

fn sources() -> Vec<Source> {
    let mut all = Vec::new();
    for pol in [Polarization::Tm, Polarization::Te] {
        all.push(Source { phi_i: 0.7, pol, beam: None });
        all.push(Source { phi_i: 1.6, pol, beam: Some(BeamSource { w0_um: 2.0, h_um: 0.5 }) });
    }
    all
}

/// Maximum relative L2 difference over the sources.
fn difference(got: &[Scattered], want: &[Scattered]) -> f64 {
    got.iter()
        .zip(want)
        .map(|(g, w)| {
            let sum = |f: &dyn Fn(C64, C64) -> f64| -> f64 {
                g.f_u.iter().zip(&w.f_u).chain(g.f_phi.iter().zip(&w.f_phi)).map(|(a, b)| f(*a, *b)).sum()
            };
            (sum(&|a, b| (a - b).norm_sqr()) / sum(&|_, b| b.norm_sqr())).sqrt()
        })
        .fold(0.0, f64::max)
}

fn unbalance(s: &Scattered) -> f64 {
    (s.c_sca_um + s.c_abs_um - s.c_ext_um).abs() / s.c_ext_um
}

/// Five bodies: ellipses whose circumscribed circles overlap, a hollow one, an absorbing one, a small one;
/// gaps from 0.03 to 0.1 um.
fn crowd() -> Vec<Body> {
    let mut hollow = body(Shape::Circle { radius_um: 1.0 }, [0.0, 0.0], 0.0, 1.55, 0.0);
    hollow.lumen = Some(Box::new(body(Shape::Ellipse { a_um: 0.5, b_um: 0.3 }, [0.15, 0.1], 0.4, 1.0, 0.0)));
    vec![
        hollow,
        body(Shape::Ellipse { a_um: 1.2, b_um: 0.6 }, [1.7, 0.0], 1.57, 1.55, 0.0),
        body(Shape::Ellipse { a_um: 1.2, b_um: 0.6 }, [0.1, 1.7], 0.05, 1.55, 0.0),
        body(Shape::Ellipse { a_um: 1.0, b_um: 0.75 }, [-2.05, 0.15], 0.3, 1.5, 0.02),
        body(Shape::Circle { radius_um: 0.15 }, [1.15, 1.0], 0.0, 1.33, 0.0),
    ]
}

/// Far fields and ledgers at three tolerances, normal and oblique, plane waves and beams.
#[test]
#[ignore = "slow: 10 s: crowds match the plain solver"]
fn crowds_match_the_plain_solver() {
    for theta_i in [0.0, 0.5] {
        let wave = Wave { lambda_um: 0.4, theta_i };
        let sources = sources();
        let truth = NystromSolver::new(&crowd(), &wave, 1e-8).unwrap().scatter(&sources, 180).unwrap();
        for tolerance in [1e-3, 1e-4, 1e-6] {
            let solver = CompressedSolver::new(&crowd(), &wave, tolerance).unwrap();
            let got = solver.scatter(&sources, 180).unwrap();
            let err = difference(&got, &truth);
            let defect = got.iter().map(unbalance).fold(0.0, f64::max);
            println!("theta {theta_i} tol {tolerance:e}: err {err:.2e}, unbalance {defect:.2e}, {:?}", solver.ranks());
            assert!(err < tolerance, "theta {theta_i}: err {err:e}, asked {tolerance:e}");
            assert!(defect < tolerance, "theta {theta_i}: unbalance {defect:e}, asked {tolerance:e}");
            assert!(solver.stats().residual < 0.1 * tolerance);
        }
        // Absorption is a small part: the plain solver's own.
        let solver = CompressedSolver::new(&crowd(), &wave, 1e-4).unwrap();
        for (got, want) in solver.scatter(&sources, 0).unwrap().iter().zip(&truth) {
            assert!((got.c_abs_um - want.c_abs_um).abs() < 1e-4 * want.c_ext_um, "{got:?}, want {want:?}");
            assert!(want.c_abs_um > 1e-2 * want.c_ext_um);
        }
    }
}

/// Walls 0.05 um apart, a node spacing and less.
#[test]
fn close_walls_are_refined() {
    let lobes = vec![(1, C64::new(1.0, 0.0)), (-2, C64::new(0.12, 0.0))];
    let bodies = vec![
        body(Shape::Circle { radius_um: 1.5 }, [0.0, 0.0], 0.0, 1.55, 0.0),
        body(Shape::Ellipse { a_um: 1.5, b_um: 0.8 }, [0.0, 2.35], 0.0, 1.5, 0.0),
        body(Shape::Fourier { coeffs: lobes }, [2.67, 0.0], PI, 1.6, 0.01),
    ];
    for theta_i in [0.0, -0.4] {
        let wave = Wave { lambda_um: 0.6, theta_i };
        let truth = NystromSolver::new(&bodies, &wave, 1e-7).unwrap().scatter(&sources(), 90).unwrap();
        for tolerance in [1e-3, 1e-5] {
            let solver = CompressedSolver::new(&bodies, &wave, tolerance).unwrap();
            let err = difference(&solver.scatter(&sources(), 90).unwrap(), &truth);
            println!("theta {theta_i} tol {tolerance:e}: err {err:.2e}, {:?}", solver.ranks());
            assert!(err < tolerance, "theta {theta_i}: err {err:e}, asked {tolerance:e}");
        }
    }
}

/// Circles match the multipole series, an independent reference.
#[test]
#[ignore = "slow: 5 s: circles match the multipole series"]
fn circles_match_the_multipole_series() {
    let bodies: Vec<Body> = [[0.0, 0.0], [3.1, 0.0], [1.5, 2.75], [-2.4, 0.9]]
        .into_iter()
        .zip([1.5, 1.5, 1.5, 1.0])
        .map(|(center_um, radius_um)| body(Shape::Circle { radius_um }, center_um, 0.0, 1.55, 0.005))
        .collect();
    for theta_i in [0.0, 0.6] {
        let wave = Wave { lambda_um: 0.4, theta_i };
        let truth = MultipoleSolver::new(&bodies, &wave, 1e-8).unwrap().scatter(&sources(), 90).unwrap();
        for tolerance in [1e-3, 1e-6] {
            let got = CompressedSolver::new(&bodies, &wave, tolerance).unwrap().scatter(&sources(), 90).unwrap();
            let err = difference(&got, &truth);
            println!("theta {theta_i} tol {tolerance:e}: err {err:.2e}");
            assert!(err < tolerance, "theta {theta_i}: err {err:e}, asked {tolerance:e}");
        }
    }
}

/// A single body uses its skeleton alone.
#[test]
fn single_bodies_match_the_plain_solver() {
    let mut hollow = body(Shape::Ellipse { a_um: 1.0, b_um: 0.8 }, [0.4, -0.3], 0.2, 1.55, 0.01);
    hollow.lumen = Some(Box::new(body(Shape::Circle { radius_um: 0.4 }, [0.3, -0.3], 0.0, 1.0, 0.0)));
    for theta_i in [0.0, 0.9] {
        let wave = Wave { lambda_um: 0.5, theta_i };
        let one = std::slice::from_ref(&hollow);
        let truth = NystromSolver::new(one, &wave, 1e-8).unwrap().scatter(&sources(), 60).unwrap();
        let got = CompressedSolver::new(one, &wave, 1e-6).unwrap().scatter(&sources(), 60).unwrap();
        let err = difference(&got, &truth);
        assert!(err < 1e-6, "theta {theta_i}: err {err:e}");
    }
}

/// Equal bodies are found equal wherever they lie, lumens included, and only those.
#[test]
fn equal_bodies_share_their_equations() {
    let mut first = body(Shape::Ellipse { a_um: 0.6, b_um: 0.4 }, [0.0, 0.0], 0.0, 1.5, 0.0);
    first.lumen = Some(Box::new(body(Shape::Circle { radius_um: 0.2 }, [0.2, 0.0], 0.0, 1.0, 0.0)));
    // Turned by 90 degrees about the origin and moved, with its lumen.
    let mut second = body(Shape::Ellipse { a_um: 0.6, b_um: 0.4 }, [1.5, 0.3], 0.5 * PI, 1.5, 0.0);
    second.lumen = Some(Box::new(body(Shape::Circle { radius_um: 0.2 }, [1.5, 0.5], 0.5 * PI, 1.0, 0.0)));
    let mut third = second.clone();
    third.center_um = [0.3, 1.6];
    let bodies = [first, second, third];
    let wave = Wave { lambda_um: 0.5, theta_i: 0.2 };
    let solver = CompressedSolver::new(&bodies[..2], &wave, 1e-5).unwrap();
    assert_eq!(solver.systems(), 1);
    let truth = NystromSolver::new(&bodies[..2], &wave, 1e-7).unwrap().scatter(&sources(), 60).unwrap();
    let err = difference(&solver.scatter(&sources(), 60).unwrap(), &truth);
    assert!(err < 1e-5, "err {err:e}");
    // The third one's lumen lies elsewhere: outside of it, in fact.
    assert!(matches!(CompressedSolver::new(&bodies, &wave, 1e-5), Err(WaveError::Overlap { .. })));
}

#[test]
fn bad_input_is_refused() {
    let wave = Wave { lambda_um: 0.5, theta_i: 0.0 };
    let one = body(Shape::Circle { radius_um: 0.5 }, [0.0, 0.0], 0.0, 1.5, 0.0);
    let mut other = one.clone();
    other.center_um = [0.9, 0.0];
    assert!(matches!(CompressedSolver::new(&[one.clone(), other], &wave, 1e-5), Err(WaveError::Overlap { .. })));
    assert!(matches!(CompressedSolver::new(&[], &wave, 1e-5), Err(WaveError::Invalid { .. })));
    assert!(matches!(
        CompressedSolver::new(std::slice::from_ref(&one), &wave, 1e-9),
        Err(WaveError::Unreachable { .. })
    ));
    assert!(matches!(
        CompressedSolver::new(std::slice::from_ref(&one), &wave, f64::NAN),
        Err(WaveError::Invalid { .. })
    ));
    // A thousand times as many waves as fit in any machine, refused before any work.
    let large = |x: f64| body(Shape::Circle { radius_um: 2e4 }, [x, 0.0], 0.0, 1.5, 0.0);
    let refused = CompressedSolver::new(&[large(-3e4), large(3e4)], &wave, 1e-3);
    assert!(matches!(refused, Err(WaveError::TooLarge { .. })));
}

/// The same scene solved twice gives the same bits.
#[test]
fn solves_are_deterministic() {
    let wave = Wave { lambda_um: 0.5, theta_i: 0.3 };
    let run = || CompressedSolver::new(&crowd(), &wave, 1e-3).unwrap().scatter(&sources(), 30).unwrap();
    assert_eq!(run(), run());
}
