//! Tests of the boundary integral solver. References first: the series of layered circular cylinders,
//! implemented here independently; then sources inside and outside of non-circular outlines with known
//! densities; then properties of any solution (ledger, reciprocity, convergence); then reference
//! implementations.

use crate::boundary::entries::COMPONENTS;
use crate::boundary::system::BoundarySystem;
use crate::scene::curve::Resolution;
use crate::*;
use complex_bessel::{Scaling, besselj_seq, hankel1_seq};
use std::f64::consts::PI;

/// `(J_m, J_m', H_m, H_m')` for m = 0..=n.
fn bessel(z: C64, n: usize) -> Vec<[C64; 4]> {
    let j = besselj_seq(0.0, z, n + 2, Scaling::Unscaled).unwrap().values;
    let h = hankel1_seq(0.0, z, n + 2, Scaling::Unscaled).unwrap().values;
    let slope = |v: &[C64], m: usize| if m == 0 { -v[1] } else { v[m - 1] - v[m] * (m as f64 / z) };
    (0..=n).map(|m| [j[m], slope(&j, m), h[m], slope(&h, m)]).collect()
}

/// Gaussian elimination with pivots.
fn solve_small(mut a: Vec<Vec<C64>>, mut b: Vec<C64>) -> Vec<C64> {
    let n = b.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].norm().total_cmp(&a[j][k].norm())).unwrap();
        a.swap(k, pivot);
        b.swap(k, pivot);
        for i in k + 1..n {
            let f = a[i][k] / a[k][k];
            for j in k..n {
                let v = a[k][j];
                a[i][j] -= f * v;
            }
            let v = b[k];
            b[i] -= f * v;
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            let v = b[j];
            b[k] -= a[k][j] * v;
        }
        b[k] /= a[k][k];
    }
    b
}

/// Far field of concentric circles by series: `walls` are (radius, index inside), outermost first.
fn layered(wave: &Wave, walls: &[(f64, C64)], source: &Source, n_phi: usize) -> (Vec<C64>, Vec<C64>) {
    let (k0, kz) = (wave.k0(), wave.kz());
    let media: Vec<(C64, C64)> = std::iter::once((C64::new(wave.k_rho(), 0.0), C64::ONE))
        .chain(walls.iter().map(|(_, index)| (wave.k_rho_in(*index), index * index)))
        .collect();
    let orders = (wave.k_rho() * walls[0].0 * 1.0 + 40.0 + 4.0 * (wave.k_rho() * walls[0].0).cbrt()) as i32;
    let (e0, h0) = source.axial(wave);
    let (mut f_u, mut f_phi) = (vec![C64::ZERO; n_phi], vec![C64::ZERO; n_phi]);
    let tables: Vec<[Vec<[C64; 4]>; 2]> = walls
        .iter()
        .enumerate()
        .map(|(w, (radius, _))| [0, 1].map(|side| bessel(media[w + side].0 * radius, orders as usize)))
        .collect();
    for n in -orders..=orders {
        let m = n.unsigned_abs() as usize;
        let flip = if n < 0 && n % 2 != 0 { -1.0 } else { 1.0 };
        // Unknowns: (e, h) of H outside; (J, H) x (e, h) in layers; (e, h) of J in the core.
        let count = 4 * walls.len();
        let mut a = vec![vec![C64::ZERO; count]; count];
        let mut b = vec![C64::ZERO; count];
        let incident = (-C64::I).powi(n);
        for (w, (radius, _)) in walls.iter().enumerate() {
            for side in 0..2 {
                let (kappa, eps) = media[w + side];
                let values = tables[w][side][m].map(|v| v * flip);
                let along = C64::new(0.0, n as f64 / radius);
                // e, P, h, Q of a unit wave of e or h.
                let fields = |v: C64, d: C64, is_e: bool| {
                    let d = d * kappa;
                    let k2 = kappa * kappa;
                    if is_e {
                        [v, k0 * eps * d / k2, C64::ZERO, -kz * along * v / k2]
                    } else {
                        [C64::ZERO, kz * along * v / k2, v, k0 * d / k2]
                    }
                };
                let sign = if side == 0 { 1.0 } else { -1.0 };
                let medium = w + side;
                let (j, dj, h, dh) = (values[0], values[1], values[2], values[3]);
                // Waves are scaled to one on one of their walls, or high orders overflow.
                let scale_j = if medium == 0 { C64::ONE } else { 1.0 / (tables[medium - 1][1][m][0] * flip) };
                let scale_h = if medium < walls.len() { 1.0 / (tables[medium][0][m][2] * flip) } else { C64::ONE };
                for is_e in [true, false] {
                    let of_field = usize::from(!is_e);
                    let base = if medium == 0 { 0 } else { 4 * medium - 2 };
                    let mut put = |column: usize, f: [C64; 4]| {
                        for (row, v) in f.into_iter().enumerate() {
                            a[4 * w + row][column] += v * sign;
                        }
                    };
                    if medium == 0 {
                        put(of_field, fields(h * scale_h, dh * scale_h, is_e));
                        let amplitude = incident * if is_e { e0 } else { h0 };
                        for (row, v) in fields(j, dj, is_e).into_iter().enumerate() {
                            b[4 * w + row] -= v * amplitude;
                        }
                    } else if medium < walls.len() {
                        put(base + of_field, fields(j * scale_j, dj * scale_j, is_e));
                        put(base + 2 + of_field, fields(h * scale_h, dh * scale_h, is_e));
                    } else {
                        put(base + of_field, fields(j * scale_j, dj * scale_j, is_e));
                    }
                }
            }
        }
        let x = solve_small(a, b);
        let scale_h = 1.0 / (tables[0][0][m][2] * flip);
        for (j, (u, p)) in f_u.iter_mut().zip(&mut f_phi).enumerate() {
            let phi = 2.0 * PI * j as f64 / n_phi as f64 - source.phi_i;
            let wave_n = (-C64::I).powi(n) * C64::from_polar(1.0, n as f64 * phi) * scale_h / wave.theta_i.cos();
            *u += x[0] * wave_n;
            *p += x[1] * wave_n;
        }
    }
    (f_u, f_phi)
}

fn body(shape: Shape, center_um: [f64; 2], eta: f64, kappa: f64) -> Body {
    Body { shape, center_um, rotation_rad: 0.0, eta, kappa, lumen: None }
}

fn circle(radius_um: f64, center_um: [f64; 2], eta: f64, kappa: f64) -> Body {
    body(Shape::Circle { radius_um }, center_um, eta, kappa)
}

fn both(phi_i: f64) -> Vec<Source> {
    [Polarization::Tm, Polarization::Te].map(|pol| Source { phi_i, pol, beam: None }).to_vec()
}

/// Maximum difference relative to the largest value, both components together.
fn difference(got: &Scattered, want_u: &[C64], want_phi: &[C64]) -> f64 {
    // A sum keeps NaN, unlike f64::max.
    assert!(got.f_u.iter().chain(&got.f_phi).chain(want_u).chain(want_phi).sum::<C64>().is_finite());
    let far = |a: &[C64], b: &[C64]| a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    let size = want_u.iter().chain(want_phi).map(|c| c.norm()).fold(0.0, f64::max);
    far(&got.f_u, want_u).max(far(&got.f_phi, want_phi)) / size
}

fn unbalance(s: &Scattered) -> f64 {
    (s.c_sca_um + s.c_abs_um - s.c_ext_um).abs() / s.c_ext_um
}

/// Far field and ledger against the series: clear, absorbing, strongly absorbing and hollow, normal and
/// oblique, at three tolerances.
#[test]
fn circles_match_the_series() {
    let air = C64::ONE;
    let cases: [(&str, Vec<(f64, C64)>); 5] = [
        ("clear", vec![(1.0, C64::new(1.55, 0.0))]),
        ("tinted", vec![(1.0, C64::new(1.55, 0.01))]),
        ("black", vec![(1.5, C64::new(1.5, 0.4))]),
        ("hollow", vec![(1.2, C64::new(1.55, 0.0)), (0.6, air)]),
        ("tinted, hollow", vec![(1.2, C64::new(1.55, 0.02)), (0.8, air), (0.3, C64::new(1.4, 0.0))]),
    ];
    for theta_i in [0.0, 0.5, -1.2] {
        for (name, walls) in &cases {
            let wave = Wave { lambda_um: 0.5, theta_i };
            let mut bodies: Option<Box<Body>> = None;
            for (radius, index) in walls.iter().rev() {
                let mut b = circle(*radius, [0.0, 0.0], index.re, index.im);
                b.lumen = bodies.take();
                bodies = Some(Box::new(b));
            }
            let bodies = vec![*bodies.unwrap()];
            for tolerance in [1e-3, 1e-6, 1e-11] {
                let solver = NystromSolver::new(&bodies, &wave, tolerance).unwrap();
                let got = solver.scatter(&both(0.7), 90).unwrap();
                for (s, source) in got.iter().zip(both(0.7)) {
                    let (u, phi) = layered(&wave, walls, &source, 90);
                    let err = difference(s, &u, &phi);
                    println!(
                        "{name} theta {theta_i} tol {tolerance:e} {:?}: err {err:.2e} unbalance {:.2e} abs {:.3e} unknowns {}",
                        source.pol,
                        unbalance(s),
                        s.c_abs_um,
                        solver.stats().unknowns
                    );
                    assert!(
                        err < tolerance,
                        "{name}, theta {theta_i}, {:?}: err {err:e}, asked {tolerance:e}",
                        source.pol
                    );
                    assert!(unbalance(s) < 10.0 * tolerance, "{name}: {s:?}");
                }
            }
        }
    }
}

/// Fields `(e, P, h, Q)` at a point, made of an incident wave with gradient: `(value, d_x, d_y)` of e and of
/// h in a medium.
fn wall_fields(wave: &Wave, eps: C64, kappa: C64, e: [C64; 3], h: [C64; 3], normal: [f64; 2]) -> [C64; 4] {
    let [nx, ny] = normal;
    let n = |v: &[C64; 3]| v[1] * nx + v[2] * ny;
    let t = |v: &[C64; 3]| v[2] * nx - v[1] * ny;
    let k2 = kappa * kappa;
    [e[0], (wave.k0() * eps * n(&e) + wave.kz() * t(&h)) / k2, h[0], (wave.k0() * n(&h) - wave.kz() * t(&e)) / k2]
}

/// `H0(kappa |x - y|)` and its gradient.
fn point_source(kappa: C64, x: [f64; 2], y: [f64; 2]) -> [C64; 3] {
    let d = [x[0] - y[0], x[1] - y[1]];
    let r = d[0].hypot(d[1]);
    let h = hankel1_seq(0.0, kappa * r, 2, Scaling::Unscaled).unwrap().values;
    [h[0], -kappa * h[1] * d[0] / r, -kappa * h[1] * d[1] / r]
}

fn assorted() -> Vec<Body> {
    let mut hollow = body(Shape::Ellipse { a_um: 1.3, b_um: 0.8 }, [0.0, 0.0], 1.55, 0.01);
    hollow.rotation_rad = 0.3;
    let mut lumen = body(Shape::Ellipse { a_um: 0.5, b_um: 0.3 }, [0.2, 0.1], 1.0, 0.0);
    lumen.rotation_rad = 1.0;
    hollow.lumen = Some(Box::new(lumen));
    let coeffs =
        vec![(1, C64::new(0.8, 0.0)), (-1, C64::new(0.1, 0.1)), (-2, C64::new(0.08, 0.0)), (3, C64::new(0.0, 0.03))];
    let bean = body(Shape::Fourier { coeffs }, [2.4, 0.3], 1.4, 0.0);
    let points_um = vec![[-1.0, -0.6], [1.0, -0.7], [0.2, 0.9]];
    let triangle = body(Shape::Polygon { points_um, rounding_um: 0.3 }, [0.6, -2.2], 1.6, 0.0);
    vec![hollow, bean, triangle]
}

/// Green's representations, summed plainly at points away from the walls with the solved densities, vanish on
/// the wrong side of every medium: with the incident field of a point source this is the extinction theorem,
/// which only the exact densities fulfill. The sums share no kernel with the solver.
fn extinction_error(bodies: &[Body], wave: &Wave, tolerance: f64) -> f64 {
    let system = BoundarySystem::new(bodies, wave, tolerance).unwrap();
    let nodes = system.nodes();
    let sources = [[3.5, 2.5], [-2.5, 1.0]];
    let k_out = C64::new(wave.k_rho(), 0.0);
    let incident = |x: [f64; 2]| (point_source(k_out, x, sources[0]), point_source(k_out, x, sources[1]));
    let mut fields = vec![C64::ZERO; COMPONENTS * nodes.len()];
    for (out, p) in fields.chunks_mut(COMPONENTS).zip(&nodes[..system.outer_nodes()]) {
        let (e, h) = incident(p.at);
        out.copy_from_slice(&wall_fields(wave, C64::ONE, k_out, e, h, p.normal));
    }
    let parts: Vec<&[usize]> = system.parts().collect();
    for (part, components) in parts.iter().enumerate() {
        let c = components.len();
        let mut rhs: Vec<C64> = fields.chunks(COMPONENTS).flat_map(|n| components.iter().map(|&k| n[k])).collect();
        assert!(system.solve(part, &mut rhs, 1) < 1e-10);
        for (node, values) in fields.chunks_mut(COMPONENTS).zip(rhs.chunks(c)) {
            for (&k, v) in components.iter().zip(values) {
                node[k] = *v;
            }
        }
    }
    // Tangential derivatives by trigonometric differentiation, wall by wall.
    let mut derivative = vec![[C64::ZERO; 2]; nodes.len()];
    for wall in system.walls() {
        let n = wall.curve.nodes.len();
        for i in 0..n {
            for j in (0..n).filter(|&j| j != i) {
                let half = 0.5 * wall.curve.step() * (i as f64 - j as f64);
                let d = (if (i + j) % 2 == 0 { 0.5 } else { -0.5 }) / half.tan() / nodes[wall.first + i].speed;
                for (k, c) in [0, 2].into_iter().enumerate() {
                    derivative[wall.first + i][k] += fields[COMPONENTS * (wall.first + j) + c] * d;
                }
            }
        }
    }
    let mut worst: f64 = 0.0;
    for (index, medium) in system.media().iter().enumerate() {
        // Middles of bodies and points outside, all of them away from walls; those in this medium itself are
        // omitted below.
        let probes = [[-0.75, -0.3], [0.2, 0.1], [2.4, 0.3], [0.6, -2.2], [-3.0, -2.0], [4.0, -1.5]];
        let home = [1, 2, 3, if bodies.len() > 2 { 4 } else { 0 }, 0, 0];
        for (x, _) in probes.iter().zip(home).filter(|(_, home)| *home != index) {
            let mut sums = [C64::ZERO; 2];
            for wall in system.walls().iter().filter(|w| w.outside == index || w.inside == index) {
                let sign = if wall.outside == index { 1.0 } else { -1.0 };
                for j in 0..wall.curve.nodes.len() {
                    let p = &wall.curve.nodes[j];
                    let u = &fields[COMPONENTS * (wall.first + j)..][..COMPONENTS];
                    let [de, dh] = derivative[wall.first + j];
                    let k2 = medium.kappa * medium.kappa;
                    let normal_e = (k2 * u[1] - wave.kz() * dh) / (wave.k0() * medium.eps);
                    let normal_h = (k2 * u[3] + wave.kz() * de) / wave.k0();
                    let [g, gx, gy] = point_source(medium.kappa, p.at, *x).map(|v| v * C64::I * 0.25);
                    let dg = gx * p.normal[0] + gy * p.normal[1];
                    let w = sign * p.speed * wall.curve.step();
                    sums[0] += (dg * u[0] - g * normal_e) * w;
                    sums[1] += (dg * u[2] - g * normal_h) * w;
                }
            }
            if index == 0 {
                let (e, h) = incident(*x);
                sums[0] += e[0];
                sums[1] += h[0];
            }
            worst = worst.max(sums[0].norm()).max(sums[1].norm());
        }
    }
    worst
}

/// Densities obey the extinction theorem for an ellipse with a lumen, a bean and a triangle together. Fields
/// are of size 0.1 to 1.
#[test]
#[ignore = "slow: 5 s: densities obey the extinction theorem"]
fn densities_obey_the_extinction_theorem() {
    for theta_i in [0.0, 0.6] {
        let wave = Wave { lambda_um: 0.6, theta_i };
        for (tolerance, smooth, all) in [(1e-3, 1e-3, 1e-3), (1e-6, 1e-6, 1e-6), (1e-9, 1e-9, 1e-8)] {
            let bodies = assorted();
            let two = extinction_error(&bodies[..2], &wave, tolerance);
            let three = extinction_error(&bodies, &wave, tolerance);
            println!("theta {theta_i}, tolerance {tolerance:e}: smooth {two:.2e}, with triangle {three:.2e}");
            assert!(two < smooth, "smooth outlines, theta {theta_i}, tolerance {tolerance:e}: {two:e}");
            assert!(three < all, "with a triangle, theta {theta_i}, tolerance {tolerance:e}: {three:e}");
        }
    }
}

/// Power balance and reciprocity with absorption and several bodies.
#[test]
fn ledger_and_reciprocity() {
    let bodies = assorted();
    let tolerance = 1e-6;
    for theta_i in [0.0, 0.6] {
        let wave = Wave { lambda_um: 0.6, theta_i };
        let solver = NystromSolver::new(&bodies, &wave, tolerance).unwrap();
        let n = 36;
        let azimuths: Vec<f64> = (0..n).map(|j| 2.0 * PI * j as f64 / n as f64).collect();
        let sources: Vec<Source> = azimuths.iter().flat_map(|&phi| both(phi)).collect();
        let got = solver.scatter(&sources, n).unwrap();
        let size = got.iter().flat_map(|s| s.f_u.iter().chain(&s.f_phi)).map(|c| c.norm()).fold(0.0, f64::max);
        for (s, source) in got.iter().zip(&sources) {
            assert!(unbalance(s) < 10.0 * tolerance, "{source:?}: {}", unbalance(s));
            assert!(s.c_abs_um > 0.01, "the hollow fiber absorbs");
        }
        // Turned by pi about z and reversed: amplitude(i -> o) = amplitude(o -> i). e_TM is u and e_TE is phi
        // of the opposite azimuth up to sign.
        let mut worst: f64 = 0.0;
        for i in 0..n {
            for o in 0..n {
                let f = |i: usize, o: usize, p: usize, q: usize| {
                    let s = &got[2 * i + p];
                    if q == 0 { s.f_u[o] } else { s.f_phi[o] }
                };
                for (p, q) in [(0, 0), (0, 1), (1, 1)] {
                    let there = f(i, o, p, q);
                    let back = f(o, i, q, p);
                    worst = worst.max((there - back).norm().min((there + back).norm()));
                }
            }
        }
        println!("theta {theta_i}: reciprocity {:.2e}", worst / size);
        assert!(worst / size < 10.0 * tolerance, "theta {theta_i}: {:e}", worst / size);
    }
}

/// Blocks by symmetry agree with the whole system.
#[test]
fn symmetry_changes_nothing() {
    let corner = |j: i32| [1.5 * (2.0 * PI * j as f64 / 3.0).cos(), 1.5 * (2.0 * PI * j as f64 / 3.0).sin()];
    let mut tube = body(Shape::Ellipse { a_um: 1.6, b_um: 1.0 }, [0.4, -0.3], 1.55, 0.02);
    tube.rotation_rad = 0.5;
    let mut lumen = body(Shape::Ellipse { a_um: 0.9, b_um: 0.7 }, [0.4, -0.3], 1.0, 0.0);
    lumen.rotation_rad = 0.5;
    tube.lumen = Some(Box::new(lumen));
    let polygon = Shape::Polygon { points_um: vec![corner(0), corner(1), corner(2)], rounding_um: 0.4 };
    let kite = Shape::Polygon { points_um: vec![[1.5, 0.0], [-0.6, 0.9], [-0.6, -0.9]], rounding_um: 0.3 };
    let shapes = [(tube, 4), (body(polygon, [1.0, 1.0], 1.5, 0.0), 3), (body(kite, [0.0, 0.0], 1.5, 0.0), 2)];
    for (body, order) in shapes {
        for theta_i in [0.0, 0.5] {
            let wave = Wave { lambda_um: 0.6, theta_i };
            let bodies = std::slice::from_ref(&body);
            let fast = NystromSolver::new(bodies, &wave, 1e-6).unwrap();
            let slow = BoundarySystem::build(bodies, &wave, 1e-6, &Resolution::for_tolerance(1e-6), false).unwrap();
            let slow = NystromSolver::with_system(slow, &wave, 1e-6);
            assert_eq!(fast.stats().unknowns * order, slow.stats().unknowns, "order of the group");
            let a = fast.scatter(&both(0.9), 60).unwrap();
            let b = slow.scatter(&both(0.9), 60).unwrap();
            for (a, b) in a.iter().zip(&b) {
                let err = difference(a, &b.f_u, &b.f_phi);
                assert!(err < 1e-11, "{:?}, theta {theta_i}: {err:e}", body.shape);
                assert!((a.c_abs_um - b.c_abs_um).abs() < 1e-11);
            }
        }
    }
}

/// The two systems of normal incidence are the limit of the oblique one.
#[test]
fn oblique_tends_to_normal() {
    let bodies = assorted();
    let at = |theta_i: f64| {
        let wave = Wave { lambda_um: 0.6, theta_i };
        NystromSolver::new(&bodies, &wave, 1e-6).unwrap().scatter(&both(0.4), 24).unwrap()
    };
    let (normal, oblique) = (at(0.0), at(1e-9));
    for (a, b) in normal.iter().zip(&oblique) {
        let err = difference(b, &a.f_u, &a.f_phi);
        assert!(err < 1e-7, "err {err:e}");
    }
}

/// Outlines much smaller than the wavelength get their nodes from their shape: thin ones are as exact as
/// round ones.
#[test]
fn thin_outlines_are_resolved() {
    let bean = |size: f64| {
        let coeffs = [(1, C64::new(1.0, 0.0)), (-1, C64::new(0.5, 0.0)), (-2, C64::new(0.1, 0.05))];
        Shape::Fourier { coeffs: coeffs.map(|(k, c)| (k, c * size)).to_vec() }
    };
    let ellipse = |a_um: f64, b_um: f64| Shape::Ellipse { a_um, b_um };
    for shape in [ellipse(0.00064, 0.00024), ellipse(0.0064, 0.00064), ellipse(0.5, 0.05), bean(0.001), bean(0.3)] {
        let bodies = [body(shape.clone(), [0.0, 0.0], 1.6, 0.0)];
        let wave = Wave { lambda_um: 1.0, theta_i: 0.7 };
        let run =
            |tolerance: f64| NystromSolver::new(&bodies, &wave, tolerance).unwrap().scatter(&both(0.3), 36).unwrap();
        let truth = run(1e-10);
        for tolerance in [1e-3, 1e-6] {
            for (got, want) in run(tolerance).iter().zip(&truth) {
                let err = difference(got, &want.f_u, &want.f_phi);
                assert!(err < tolerance, "{shape:?}, tolerance {tolerance:e}: err {err:e}");
            }
        }
    }
}

/// Ellipses at gaps of 0.2 and 0.05 um, absorbing and clear: results agree with those of a much finer
/// tolerance.
#[test]
fn close_fibers_converge() {
    for gap in [0.2, 0.05] {
        let mut left = body(Shape::Ellipse { a_um: 1.5, b_um: 1.1 }, [-1.5 - 0.5 * gap, 0.0], 1.55, 0.0);
        let right = body(Shape::Ellipse { a_um: 1.0, b_um: 1.3 }, [1.0 + 0.5 * gap, 0.1], 1.5, 0.01);
        left.lumen = Some(Box::new(body(Shape::Circle { radius_um: 0.5 }, [-1.0 + 0.25 - 0.5 * gap, 0.0], 1.0, 0.0)));
        let bodies = [left, right];
        for theta_i in [0.0, 0.5] {
            let wave = Wave { lambda_um: 0.5, theta_i };
            let run = |tolerance: f64| {
                NystromSolver::new(&bodies, &wave, tolerance).unwrap().scatter(&both(1.1), 90).unwrap()
            };
            let truth = run(1e-11);
            for tolerance in [1e-3, 1e-6, 1e-8] {
                let err = run(tolerance)
                    .iter()
                    .zip(&truth)
                    .map(|(got, want)| difference(got, &want.f_u, &want.f_phi))
                    .fold(0.0, f64::max);
                println!("gap {gap}, theta {theta_i}, tolerance {tolerance:e}: err {err:.2e}");
                assert!(err < tolerance, "gap {gap}, theta {theta_i}, tolerance {tolerance:e}: {err:e}");
            }
        }
    }
}

/// Sources that the body's symmetry maps to each other are solved once: each must equal its separate
/// solution, wherever the body is.
#[test]
fn mapped_sources_are_themselves() {
    let corner = |j: i32| [1.5 * (2.0 * PI * j as f64 / 3.0).cos(), 1.5 * (2.0 * PI * j as f64 / 3.0).sin()];
    let triangle = Shape::Polygon { points_um: vec![corner(0), corner(1), corner(2)], rounding_um: 0.4 };
    let kite = Shape::Polygon { points_um: vec![[1.5, 0.0], [-0.6, 0.9], [-0.6, -0.9]], rounding_um: 0.3 };
    for shape in [Shape::Ellipse { a_um: 1.6, b_um: 1.0 }, triangle, kite, Shape::Circle { radius_um: 1.0 }] {
        for (rotation_rad, center_um) in [(0.0, [0.0, 0.0]), (2.0 * PI / 36.0, [0.8, -0.5])] {
            let mut fiber = body(shape.clone(), center_um, 1.55, 0.01);
            fiber.rotation_rad = rotation_rad;
            let wave = Wave { lambda_um: 0.6, theta_i: 0.4 };
            let solver = NystromSolver::new(&[fiber], &wave, 1e-9).unwrap();
            let beam = BeamSource { w0_um: 2.0, h_um: 0.4 };
            let mut sources: Vec<Source> = (0..36).flat_map(|j| both(2.0 * PI * j as f64 / 36.0)).collect();
            sources.push(Source { phi_i: 0.0, pol: Polarization::Te, beam: Some(beam) });
            sources.push(Source { phi_i: PI, pol: Polarization::Te, beam: Some(beam) });
            let together = solver.scatter(&sources, 40).unwrap();
            for (got, source) in together.iter().zip(&sources) {
                let alone = &solver.scatter(&[*source], 40).unwrap()[0];
                let err = difference(got, &alone.f_u, &alone.f_phi);
                assert!(err < 1e-11, "{shape:?}, {source:?}: {err:e}");
                assert!((got.c_abs_um - alone.c_abs_um).abs() < 1e-11 * alone.c_ext_um);
                assert!((got.c_ext_um - alone.c_ext_um).abs() < 1e-11 * alone.c_ext_um);
            }
        }
    }
}

/// Observed convergence. On smooth outlines errors fall faster than any power of the node number, to 1e-10 of
/// the series at 6 nodes per wavelength; on a rounded polygon with joints graded to order 5 they fall with a
/// power of at least 4.5.
#[test]
#[ignore = "slow: 5 s: errors fall as nodes are added"]
fn errors_fall_as_nodes_are_added() {
    let error = |bodies: &[Body], wave: &Wave, resolution: &Resolution, truth: &dyn Fn(&Source) -> [Vec<C64>; 2]| {
        let system = BoundarySystem::build(bodies, wave, 1e-12, resolution, true).unwrap();
        let got = NystromSolver::with_system(system, wave, 1e-12).unchecked().scatter(&both(0.3), 90).unwrap();
        let errors = got.iter().zip(both(0.3)).map(|(got, source)| {
            let [u, phi] = truth(&source);
            difference(got, &u, &phi)
        });
        errors.fold(0.0, f64::max)
    };
    let plain = |per_wavelength: f64| Resolution {
        per_wavelength_ellipse: per_wavelength,
        per_wavelength,
        transition: 0.0,
        logarithm: 0.0,
        ..Resolution::for_tolerance(1e-6)
    };
    for (radius, theta_i) in [(2.0, 0.0), (2.0, 0.5), (7.5, 0.5)] {
        let wave = Wave { lambda_um: 0.4, theta_i };
        let bodies = [circle(radius, [0.0, 0.0], 1.55, 0.0)];
        // The series of its module, which has more orders than the one above.
        let mie = MieSolver::new(&bodies[0], &wave, 1e-12).unwrap();
        let truth = |source: &Source| {
            let s = mie.scatter(&[*source], 90).unwrap().swap_remove(0);
            [s.f_u, s.f_phi]
        };
        let errors = [2.8, 3.1, 3.4, 6.0].map(|p| error(&bodies, &wave, &plain(p), &truth));
        println!("circle {radius}, theta {theta_i}: {errors:?}");
        assert!(errors[1] < 0.5 * errors[0] && errors[2] < 1e-3 * errors[0], "{errors:?}");
        assert!(errors[3] < 1e-10, "{errors:?}");
    }
    let shape = Shape::Polygon { points_um: vec![[-0.9, -0.5], [1.0, -0.6], [0.1, 1.1]], rounding_um: 0.3 };
    let bodies = [body(shape, [0.0, 0.0], 1.6, 0.0)];
    let wave = Wave { lambda_um: 0.5, theta_i: 0.7 };
    let fine = Resolution { grading: 7, fade_nodes: 30.0, ..plain(24.0) };
    let system = BoundarySystem::build(&bodies, &wave, 1e-12, &fine, true).unwrap();
    let fine = NystromSolver::with_system(system, &wave, 1e-12).scatter(&both(0.3), 90).unwrap();
    let truth = |source: &Source| {
        let s = &fine[usize::from(source.pol == Polarization::Te)];
        [s.f_u.clone(), s.f_phi.clone()]
    };
    let steps = [12.5, 16.0, 20.0];
    // One grading over whole pieces at all three, so that only the node number changes.
    let errors = steps.map(|p| error(&bodies, &wave, &Resolution { grading: 5, fade_nodes: 30.0, ..plain(p) }, &truth));
    let orders = [0, 1].map(|k| (errors[k] / errors[k + 1]).ln() / (steps[k + 1] / steps[k]).ln());
    println!("polygon: {errors:?}, orders {orders:.1?}");
    assert!(orders[0] > 4.5 && orders[1] > 4.5, "{errors:?}: orders {orders:?}");
}
