//! Tests of the solver that merges groups of bodies: against the system solved whole, the multipole series,
//! reciprocity, power balance, and how groups grow.

use crate::boundary::kernel::{Medium, MediumKernel};
use crate::many::basis::{Basis, STRIP};
use crate::many::hierarchy::{Hierarchy, Leaf};
use crate::many::interpolate::Interpolation;
use crate::many::skeleton::{Exterior, Site};
use crate::scene::curve::CurvePoint;
use crate::*;
use std::f64::consts::TAU;

fn body(shape: Shape, center_um: [f64; 2], rotation_rad: f64, kappa: f64) -> Body {
    Body { shape, center_um, rotation_rad, eta: 1.55, kappa, lumen: None }
}

/// The first `count` sites of a hexagonal lattice, row by row.
fn lattice(count: usize, apart_um: f64) -> Vec<[f64; 2]> {
    let wide = (count as f64).sqrt().ceil() as usize;
    (0..count)
        .map(|k| {
            let (i, j) = (k % wide, k / wide);
            [apart_um * (i as f64 + 0.5 * (j % 2) as f64), apart_um * 0.75f64.sqrt() * j as f64]
        })
        .collect()
}

/// Alternating circles and ellipses of 1 um, 0.1 um or more apart; every third one absorbs, one is hollow and
/// one is far from the others.
fn mixed(count: usize) -> Vec<Body> {
    let mut all: Vec<Body> = lattice(count, 2.1)
        .into_iter()
        .enumerate()
        .map(|(k, center)| {
            let shape =
                if k % 2 == 0 { Shape::Circle { radius_um: 1.0 } } else { Shape::Ellipse { a_um: 1.0, b_um: 0.7 } };
            body(shape, center, k as f64, if k % 3 == 0 { 0.01 } else { 0.0 })
        })
        .collect();
    let mut lumen = body(Shape::Circle { radius_um: 0.4 }, all[4].center_um, 0.0, 0.0);
    lumen.eta = 1.0;
    all[4].lumen = Some(Box::new(lumen));
    all.push(body(Shape::Ellipse { a_um: 1.3, b_um: 0.5 }, [-9.0, 14.0], 0.3, 0.0));
    all
}

fn sources() -> Vec<Source> {
    let mut all = Vec::new();
    for pol in [Polarization::Tm, Polarization::Te] {
        all.push(Source { phi_i: 0.7, pol, beam: None });
        all.push(Source { phi_i: 1.6, pol, beam: Some(BeamSource { w0_um: 2.0, h_um: -3.0 }) });
    }
    all
}

/// Maximum relative L2 difference over the sources.
fn difference(got: &[Scattered], want: &[Scattered]) -> f64 {
    let apart = |(g, w): (&Scattered, &Scattered)| {
        let pairs = || g.f_u.iter().zip(&w.f_u).chain(g.f_phi.iter().zip(&w.f_phi));
        let off: f64 = pairs().map(|(a, b)| (a - b).norm_sqr()).sum();
        (off / pairs().map(|(_, b)| b.norm_sqr()).sum::<f64>()).sqrt()
    };
    got.iter().zip(want).map(apart).fold(0.0, f64::max)
}

fn unbalance(s: &Scattered) -> f64 {
    (s.c_sca_um + s.c_abs_um - s.c_ext_um).abs() / s.c_ext_um
}

/// Fourteen bodies, normal and oblique: the fields of the system solved whole at a much smaller tolerance,
/// and powers that add up.
#[test]
#[ignore = "slow: 25 s: merged groups match the whole system"]
fn merged_groups_match_the_whole_system() {
    let bodies = mixed(13);
    for theta_i in [0.0, 0.5] {
        let wave = Wave { lambda_um: 0.5, theta_i };
        let truth = CompressedSolver::new(&bodies, &wave, 2e-7).unwrap().scatter(&sources(), 360).unwrap();
        for tolerance in [1e-3, 1e-4, 1e-5, 2e-6] {
            let solver = CompressedSolver::hierarchical(&bodies, &wave, tolerance).unwrap();
            let got = solver.scatter(&sources(), 360).unwrap();
            let err = difference(&got, &truth);
            let defect = got.iter().map(unbalance).fold(0.0, f64::max);
            let residual = solver.stats().residual;
            println!(
                "theta {theta_i} tol {tolerance:e}: err {err:.2e}, unbalance {defect:.2e}, residual {residual:.2e}"
            );
            assert!(err < tolerance, "theta {theta_i}: err {err:e}, asked {tolerance:e}");
            assert!(defect < tolerance, "theta {theta_i}: unbalance {defect:e}, asked {tolerance:e}");
            // Groups are far finer than requested, down to rounding, as larger scenes lose accuracy.
            assert!(residual > 0.0 && residual < (1e-5 * tolerance).max(3e-10), "residual {residual:e}");
        }
    }
}

/// Thirty clear circles match the multipole series, an independent reference.
#[test]
#[ignore = "slow: 30 s: circles match the multipole series"]
fn circles_match_the_multipole_series() {
    let bodies: Vec<Body> =
        lattice(30, 2.06).into_iter().map(|center| body(Shape::Circle { radius_um: 1.0 }, center, 0.0, 0.0)).collect();
    let wave = Wave { lambda_um: 0.4, theta_i: 0.0 };
    let truth = MultipoleSolver::new(&bodies, &wave, 1e-7).unwrap().scatter(&sources(), 720).unwrap();
    for tolerance in [1e-3, 1e-5] {
        let got = CompressedSolver::hierarchical(&bodies, &wave, tolerance).unwrap().scatter(&sources(), 720).unwrap();
        let err = difference(&got, &truth);
        let defect = got.iter().map(unbalance).fold(0.0, f64::max);
        println!("tol {tolerance:e}: err {err:.2e}, unbalance {defect:.2e}");
        assert!(err < tolerance, "err {err:e}, asked {tolerance:e}");
        assert!(defect < tolerance, "unbalance {defect:e}");
    }
}

/// Light from a to b is as strong as light from b to a, amplitudes and phases.
#[test]
fn light_goes_both_ways() {
    let wave = Wave { lambda_um: 0.5, theta_i: 0.0 };
    let solver = CompressedSolver::hierarchical(&mixed(12), &wave, 1e-4).unwrap();
    let n = 72;
    let (a, b) = (5, 31);
    for pol in [Polarization::Tm, Polarization::Te] {
        let from = |j: usize| Source { phi_i: TAU * j as f64 / n as f64, pol, beam: None };
        let got = solver.scatter(&[from(a), from(b)], n).unwrap();
        let field = |s: &Scattered, j: usize| if pol == Polarization::Tm { s.f_u[j] } else { s.f_phi[j] };
        let (ab, ba) = (field(&got[0], b), field(&got[1], a));
        let size = (0..n).map(|j| field(&got[0], j).norm()).fold(0.0, f64::max);
        assert!(ab.norm() > 0.01 * size, "no light to compare: {ab} of {size}");
        assert!((ab - ba).norm() < 1e-4 * size, "{pol:?}: {ab} and {ba} of {size}");
    }
}

/// The same scene solved twice gives the same bits. Two bodies make the smallest tree.
#[test]
fn solves_are_deterministic() {
    let wave = Wave { lambda_um: 0.5, theta_i: 0.3 };
    for count in [1, 6] {
        let bodies = &mixed(6)[..count + 1];
        let run = || CompressedSolver::hierarchical(bodies, &wave, 1e-3).unwrap().scatter(&sources(), 30).unwrap();
        assert_eq!(run(), run());
    }
}

/// One body, none, and too many.
#[test]
fn odd_scenes() {
    let wave = Wave { lambda_um: 0.5, theta_i: 0.0 };
    let one = body(Shape::Circle { radius_um: 0.5 }, [0.0, 0.0], 0.0, 0.0);
    let alone = |make: fn(&[Body], &Wave, f64) -> Result<CompressedSolver, WaveError>| {
        make(std::slice::from_ref(&one), &wave, 1e-4).unwrap().scatter(&sources(), 30).unwrap()
    };
    assert_eq!(alone(CompressedSolver::hierarchical), alone(CompressedSolver::new));
    assert!(matches!(CompressedSolver::hierarchical(&[], &wave, 1e-4), Err(WaveError::Invalid { .. })));
    assert!(matches!(
        CompressedSolver::hierarchical(std::slice::from_ref(&one), &wave, 1e-9),
        Err(WaveError::Unreachable { .. })
    ));
    // Bodies whose own responses are a thousand times the memory of any machine.
    let large = |x: f64| body(Shape::Circle { radius_um: 2e4 }, [x, 0.0], 0.0, 0.0);
    let refused = CompressedSolver::hierarchical(&[large(-3e4), large(3e4)], &wave, 1e-3);
    assert!(matches!(refused, Err(WaveError::TooLarge { .. })));
}

/// A group's sites are those of its rim: four times the bodies, twice the sites and little more. Memory
/// follows.
#[test]
#[ignore = "slow: 5 s: groups grow as their rim"]
fn groups_grow_as_their_rim() {
    let k_rho = TAU / 0.5;
    let sizes = |count: usize| {
        let centers = lattice(count, 2.1);
        let sites: Vec<Vec<Site>> = centers
            .iter()
            .map(|c| {
                (0..48)
                    .map(|j| {
                        let (sin, cos) = (TAU * f64::from(j) / 48.0).sin_cos();
                        let point =
                            CurvePoint { at: [c[0] + cos, c[1] + sin], normal: [cos, sin], speed: 1.0, curvature: 1.0 };
                        Site { point, scale: (TAU / 48.0).sqrt() }
                    })
                    .collect()
            })
            .collect();
        let leaves: Vec<Leaf<'_>> =
            centers.iter().zip(&sites).map(|(c, sites)| Leaf { sites, center: *c, radius: 1.0 }).collect();
        let kernel = MediumKernel::new(Medium { kappa: C64::new(k_rho, 0.0), eps: C64::ONE }, 200.0);
        let tree = Hierarchy::plan(&leaves, Exterior { kernel: &kernel, k_rho }, 1e-5);
        (tree.largest(), tree.bytes(1))
    };
    let ([few, few_border], few_bytes) = sizes(64);
    let ([many, many_border], many_bytes) = sizes(256);
    let [few_bytes, many_bytes] = [few_bytes, many_bytes].map(|b| b.plan + b.part + b.work);
    println!("64: {few}, {few_border}, {few_bytes:e}; 256: {many}, {many_border}, {many_bytes:e}");
    assert!((many as f64) < 2.3 * few as f64, "{many} sites after {few}");
    assert!((many_border as f64) < 2.3 * few_border as f64, "{many_border} at borders after {few_border}");
    assert!(many_bytes < 6.0 * few_bytes, "{many_bytes:e} bytes after {few_bytes:e}");
    // And no fewer than the waves that fit around half of the square, so that the fields at the tests are
    // complete.
    assert!(many as f64 > k_rho * 48.0 * 2.1 * 0.93 / std::f64::consts::PI, "{many} sites");
}

/// X a, a X^T and X^T v against sums over the entries of X, for two fields.
#[test]
fn bases_are_their_matrices() {
    // Rounded to the steps of stored coefficients.
    let steps = |x: f64| (x * 2f64.powi(30)).round() * 0.5f64.powi(30);
    let value = |k: usize| C64::new(steps((k as f64 * 1.7).sin()), steps((k as f64 * 0.9).cos()));
    // Three of seven sites are retained; the basis has the last five.
    let all = Interpolation {
        retained: vec![1, 3, 6],
        dropped: vec![0, 2, 4, 5],
        coefficients: (0..12).map(value).collect(),
    };
    let (first, m, n, fields, wide) = (2, 5, 3, 2, 4);
    let basis = Basis::from_interpolation(&all, first, m);
    let entry = |i: usize, j: usize| match all.retained.iter().position(|&k| k == first + j) {
        Some(k) => f64::from(u8::from(k == i)).into(),
        None => all.coefficients[all.dropped.iter().position(|&d| d == first + j).unwrap() * n + i],
    };
    let a: Vec<C64> = (0..fields * m * wide).map(|k| value(k + 20)).collect();
    let v: Vec<C64> = (0..fields * n * wide).map(|k| value(k + 90)).collect();
    let mut left = vec![C64::ZERO; fields * n * wide];
    basis.left(&mut left, &a, wide, fields);
    let mut right = vec![C64::ZERO; wide * fields * n];
    basis.right(&mut right, &a, wide);
    let mut spread = vec![C64::ZERO; fields * m * wide];
    basis.spread(&mut spread, &v, wide, fields);
    for column in 0..wide {
        for field in 0..fields {
            for i in 0..n {
                let want: C64 = (0..m).map(|j| entry(i, j) * a[(column * fields + field) * m + j]).sum();
                assert!((left[(column * fields + field) * n + i] - want).norm() < 1e-13);
                let want: C64 = (0..m).map(|j| entry(i, j) * a[(field * m + j) * wide + column]).sum();
                assert!((right[(field * n + i) * wide + column] - want).norm() < 1e-13);
            }
            for j in 0..m {
                let want: C64 = (0..n).map(|i| entry(i, j) * v[(column * fields + field) * n + i]).sum();
                assert!((spread[(column * fields + field) * m + j] - want).norm() < 1e-13);
            }
        }
    }
    assert!(basis.bytes() > 0);
}

/// X a Y^T and Z X a Y^T against sums over the entries: two fields, and one with more sites than are taken at
/// a time.
#[test]
fn products_from_both_sides_are_their_sums() {
    let value = |k: usize| C64::new((k as f64 * 1.7).sin(), (k as f64 * 0.9).cos());
    // Retained sites are equidistant among all sites.
    let interpolation = |inputs: usize, outputs: usize, seed: usize| {
        let retained: Vec<usize> = (0..outputs).map(|i| i * inputs / outputs).collect();
        let dropped: Vec<usize> = (0..inputs).filter(|j| retained.binary_search(j).is_err()).collect();
        let coefficients = (0..outputs * dropped.len()).map(|k| 0.1 * value(k + seed)).collect();
        Interpolation { retained, dropped, coefficients }
    };
    let entry = |x: &Interpolation, i: usize, j: usize| match x.retained.binary_search(&j) {
        Ok(k) => f64::from(u8::from(k == i)).into(),
        Err(_) => x.coefficients[x.dropped.binary_search(&j).unwrap() * x.retained.len() + i],
    };
    for (fields, inputs, [nx, ny, nz]) in [(2, 9, [5, 4, 3]), (1, STRIP + 560, [530, STRIP + 20, 7])] {
        let [x, y, z] = [(inputs, nx, 3), (inputs, ny, 50), (nx, nz, 90)].map(|(m, n, s)| interpolation(m, n, s));
        let basis = |x: &Interpolation, m: usize| Basis::from_interpolation(x, 0, m);
        let (bx, by, bz) = (basis(&x, inputs), basis(&y, inputs), basis(&z, nx));
        let m = fields * inputs;
        let a: Vec<C64> = (0..m * m).map(|k| value(3 * k + 20)).collect();
        let mut both = vec![C64::ZERO; fields * nx * fields * ny];
        bx.around(&mut both, &a, &by, None, fields);
        let mut sent = vec![C64::ZERO; fields * nz * fields * ny];
        bx.around(&mut sent, &a, &by, Some(&bz), fields);
        for row in 0..fields {
            for column in 0..fields {
                for sample in 0..12 {
                    // From first to last, over the edges of strips.
                    let j = sample * (ny - 1) / 11;
                    let own = |i: usize| both[(column * ny + j) * fields * nx + row * nx + i];
                    let i = (sample * 5) % nx;
                    let column_of = |l: usize| &a[(column * inputs + l) * m + row * inputs..][..inputs];
                    let want: C64 = (0..inputs)
                        .map(|l| {
                            let sum: C64 = column_of(l).iter().enumerate().map(|(k, a)| entry(&x, i, k) * a).sum();
                            sum * entry(&y, j, l)
                        })
                        .sum();
                    assert!((own(i) - want).norm() < 1e-9, "{} for {want}", own(i));
                    let i = sample % nz;
                    let want: C64 = (0..nx).map(|k| entry(&z, i, k) * own(k)).sum();
                    let got = sent[(column * ny + j) * fields * nz + row * nz + i];
                    assert!((got - want).norm() < 1e-9, "{got} for {want}, through Z");
                }
            }
        }
    }
}
