//! `plywave wave scatter` end to end, held to what follows from the conventions alone: dipoles in closed
//! form, phases of shifted fibers, symmetries, reciprocity, the widths from the printed fields. No number
//! here comes from a solver.
//!
//! A dipole p per length at the origin, driven at k_z, radiates `(i/4) k_0^2 (p - s (s . p))` in the units of
//! F; s is the outgoing direction. A cylinder thin against the wavelength has p = A (eps - 1) E_z along the
//! axis and p = A alpha E across, with area A and the alpha of its outline in a static field.

use crate::common::{json, names, plywave, refused, run, succeed, text};
use std::f64::consts::PI;
use std::path::Path;

type C64 = num_complex::Complex64;

const I: C64 = C64::new(0.0, 1.0);

/// Methods that serve one circle, several, and any outlines.
const ONE: &[&str] = &["auto", "mie", "multipole", "nystrom", "compressed"];
const CIRCLES: &[&str] = &["auto", "multipole", "nystrom", "compressed"];
const ANY: &[&str] = &["auto", "nystrom", "compressed"];

/// What is asked: near rounding of closed series and analytic outlines, less where arcs and edges take many
/// nodes and where fibers are compressed.
fn tolerance(method: &str, shape: &str) -> f64 {
    match (method, shape) {
        ("compressed", _) => 1e-6,
        (_, TRIANGLE) => 1e-8,
        _ => 1e-9,
    }
}

/// The keys that choose a method.
fn by(method: &str, shape: &str) -> String {
    format!("method = \"{method}\"\ntolerance = {}\n", tolerance(method, shape))
}

/// One case of the output.
#[derive(Clone, Debug)]
struct Case {
    lambda: f64,
    theta: f64,
    phi: f64,
    tm: bool,
    co: Vec<C64>,
    cross: Vec<C64>,
    sca: f64,
    abs: f64,
    ext: f64,
}

impl Case {
    fn k0(&self) -> f64 {
        2.0 * PI / self.lambda
    }

    fn k_rho(&self) -> f64 {
        self.k0() * self.theta.cos()
    }

    /// Outgoing azimuths, [rad].
    fn azimuths(&self) -> impl Iterator<Item = f64> + use<> {
        let n = self.co.len();
        (0..n).map(move |j| 2.0 * PI * j as f64 / n as f64)
    }

    /// F_u and F_phi at outgoing azimuth j.
    fn field(&self, j: usize) -> [C64; 2] {
        if self.tm { [self.co[j], self.cross[j]] } else { [self.cross[j], self.co[j]] }
    }

    fn greatest(&self) -> f64 {
        self.co.iter().chain(&self.cross).map(|f| f.norm()).fold(0.0, f64::max)
    }

    /// Greatest distance of the field from `want(j, phi)` = [F_u, F_phi], relative to the greatest field.
    fn error(&self, want: impl Fn(usize, f64) -> [C64; 2]) -> f64 {
        let scale = self.greatest();
        assert!(scale > 0.0);
        self.azimuths()
            .enumerate()
            .flat_map(|(j, phi)| {
                let (got, want) = (self.field(j), want(j, phi));
                [(got[0] - want[0]).norm() / scale, (got[1] - want[1]).norm() / scale]
            })
            .fold(0.0, f64::max)
    }
}

/// Runs a scene; gives its cases.
fn scatter(scene: &str) -> Vec<Case> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let said = succeed(folder.path(), &["wave", "scatter", "scene.toml", "-o", "out.json", "--quiet"]);
    assert!(said.is_empty(), "{said}");
    assert_eq!(names(folder.path()), ["out.json", "scene.toml"]);
    cases(&json(&std::fs::read_to_string(folder.path().join("out.json")).unwrap()))
}

fn cases(out: &serde_json::Value) -> Vec<Case> {
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let list = |v: &serde_json::Value| -> Vec<C64> {
        v.as_array().unwrap().iter().map(|z| C64::new(number(&z[0]), number(&z[1]))).collect()
    };
    let stats = &out["stats"];
    assert!(stats["method"].is_string() && stats["unknowns"].is_u64() && stats["peak_bytes"].is_u64(), "{stats}");
    assert!(number(&stats["residual"]) >= 0.0 && number(&stats["seconds"]) >= 0.0, "{stats}");
    let case = |c: &serde_json::Value| Case {
        lambda: number(&c["lambda_um"]),
        theta: number(&c["theta_i_deg"]).to_radians(),
        phi: number(&c["phi_i_deg"]).to_radians(),
        tm: match c["pol"].as_str() {
            Some("TM") => true,
            Some("TE") => false,
            other => panic!("{other:?}"),
        },
        co: list(&c["F_co"]),
        cross: list(&c["F_cross"]),
        sca: number(&c["C_sca_um"]),
        abs: number(&c["C_abs_um"]),
        ext: number(&c["C_ext_um"]),
    };
    out["cases"].as_array().unwrap().iter().map(case).collect()
}

/// The incident electric field at the origin.
fn incident(case: &Case) -> [f64; 3] {
    let ((st, ct), (sp, cp)) = (case.theta.sin_cos(), case.phi.sin_cos());
    if case.tm { [-st * cp, -st * sp, ct] } else { [-sp, cp, 0.0] }
}

/// [F_u, F_phi] of a dipole per length, p over the vacuum permittivity.
fn dipole(case: &Case, phi: f64, p: [C64; 3]) -> [C64; 2] {
    let ((st, ct), (s, c)) = (case.theta.sin_cos(), phi.sin_cos());
    let scale = 0.25 * I * case.k0().powi(2);
    let along_rho = p[0] * c + p[1] * s;
    [scale * (p[2] * ct + along_rho * st), scale * (p[1] * c - p[0] * s)]
}

const THIN: &str = "lambda_um = [1.0]\ntheta_i_deg = [0, 35, -60]\nphi_i_deg = [0, 70, 200]\nn_phi_out = 24\n";

/// Round, hollow and filled, clear and lossy, by every method: the leading order in k a, with its phase, in
/// both polarizations at any incidence.
#[test]
fn thin_fibers_radiate_as_dipoles() {
    // k a = 0.003; the neglected terms are of relative order (k a)^2 ln(k a), times a few for the index.
    let a = 0.003 / (2.0 * PI);
    let area = PI * a * a;
    let eps = C64::new(1.5, 0.2).powi(2);
    let solid = format!("{THIN}[[fiber]]\nshape = \"circle\"\nradius_um = {a}\neta = 1.5\nkappa = 0.2\n");
    let hollow = format!("{solid}[fiber.lumen]\nshape = \"circle\"\nradius_um = {}\neta = 1.2\n", 0.6 * a);
    // A coated cylinder in a static field is a solid one of this permittivity.
    let (core, share) = (C64::new(1.44, 0.0), 0.36);
    let mixed = eps * ((core + eps) + share * (core - eps)) / ((core + eps) - share * (core - eps));
    let axial = (1.0 - share) * eps + share * core;
    for method in ONE {
        for (scene, across, along) in [(&solid, eps, eps), (&hollow, mixed, axial)] {
            let cases = scatter(&format!("{}{scene}", by(method, CIRCLE)));
            assert_eq!(cases.len(), 18);
            for case in cases {
                let e = incident(&case);
                let alpha = 2.0 * (across - 1.0) / (across + 1.0);
                let p = [area * alpha * e[0], area * alpha * e[1], area * (along - 1.0) * e[2]];
                let error = case.error(|_, phi| dipole(&case, phi, p));
                assert!(error < 3e-4, "{method}, theta {}, phi {}, tm {}: {error:e}", case.theta, case.phi, case.tm);
                // Such a fiber absorbs k_0 Im(eps) |E|^2 over its area, which is -(k_0 / |E|^2) Im(p* . E).
                let lost: f64 = (0..3).map(|j| case.k0() * p[j].im * e[j]).sum();
                assert!((case.abs - lost).abs() < 1e-3 * lost, "{method}: C_abs {} against {lost}", case.abs);
            }
        }
    }
}

/// An ellipse has two polarizabilities, along its own axes: the turn of its frame shows.
#[test]
fn thin_turned_ellipses_radiate_as_dipoles() {
    let (a, b) = (0.004 / (2.0 * PI), 0.0015 / (2.0 * PI));
    let area = PI * a * b;
    let eps = C64::new(1.7, 0.1).powi(2);
    let scene = format!(
        "{THIN}[[fiber]]\nshape = \"ellipse\"\na_um = {a}\nb_um = {b}\nrotation_deg = 25\neta = 1.7\nkappa = 0.1\n"
    );
    let alpha = |depolarization: f64| (eps - 1.0) / (1.0 + depolarization * (eps - 1.0));
    let (alpha_a, alpha_b) = (alpha(b / (a + b)), alpha(a / (a + b)));
    let (sin, cos) = 25.0_f64.to_radians().sin_cos();
    for method in ANY {
        for case in scatter(&format!("{}{scene}", by(method, ELLIPSE))) {
            let e = incident(&case);
            let (along_a, along_b) = (e[0] * cos + e[1] * sin, e[1] * cos - e[0] * sin);
            let (pa, pb) = (area * alpha_a * along_a, area * alpha_b * along_b);
            let p = [pa * cos - pb * sin, pa * sin + pb * cos, area * (eps - 1.0) * e[2]];
            let error = case.error(|_, phi| dipole(&case, phi, p));
            assert!(error < 3e-4, "{method}, theta {}, phi {}, tm {}: {error:e}", case.theta, case.phi, case.tm);
        }
    }
}

const CIRCLE: &str = "shape = \"circle\"\nradius_um = 0.9\neta = 1.5\nkappa = 0.02\n";
const ELLIPSE: &str = "shape = \"ellipse\"\na_um = 1.1\nb_um = 0.7\nrotation_deg = 20\neta = 1.4\n";
const TRIANGLE: &str =
    "shape = \"polygon\"\npoints_um = [[-0.9, -0.5], [1.0, -0.6], [0.1, 1.1]]\nrounding_um = 0.3\neta = 1.6\n";
const LOBES: &str = "shape = \"fourier\"\ncoeffs = [[1, 0.8, 0], [-2, 0.1, 0.05], [4, 0, -0.04]]\neta = 1.5\n";

/// Every method with the outlines it serves.
fn pairs() -> impl Iterator<Item = (&'static str, &'static str)> {
    let any = [ELLIPSE, TRIANGLE, LOBES].into_iter().flat_map(|shape| ANY.iter().map(move |m| (*m, shape)));
    ONE.iter().map(|m| (*m, CIRCLE)).chain(any)
}

/// A fiber moved by c scatters the same field times exp(i (k_i - k_s) . c).
#[test]
fn moved_fibers_shift_the_phase() {
    let head = "lambda_um = [0.6]\ntheta_i_deg = [0, 40]\nphi_i_deg = [10, 130]\nn_phi_out = 36\n";
    let (x, y) = (2.3, -1.7);
    for (method, shape) in pairs() {
        let tol = tolerance(method, shape);
        let scene = format!("{head}{}[[fiber]]\n{shape}", by(method, shape));
        let home = scatter(&scene);
        let away = scatter(&format!("{scene}center_um = [{x}, {y}]\n"));
        for (home, away) in home.iter().zip(&away) {
            let k = home.k_rho();
            // k_i runs along -omega_i, k_s along the outgoing azimuth.
            let phase = |phi: f64| {
                let (ki, ks) = ([-k * home.phi.cos(), -k * home.phi.sin()], [k * phi.cos(), k * phi.sin()]);
                C64::cis((ki[0] - ks[0]) * x + (ki[1] - ks[1]) * y)
            };
            let error = away.error(|j, phi| home.field(j).map(|f| f * phase(phi)));
            assert!(error < 10.0 * tol, "{method}, theta {}, tm {}: {error:e}", home.theta, home.tm);
            for (a, b) in [(home.sca, away.sca), (home.abs, away.abs), (home.ext, away.ext)] {
                assert!((a - b).abs() < 10.0 * tol * home.ext, "{method}: widths {a} and {b}");
            }
        }
    }
}

/// A fiber turned with the light turns its field. Within the plane of incidence a circle keeps the
/// polarization, and at theta_i = 0 any fiber does so everywhere.
#[test]
fn turned_scenes_turn_the_field() {
    let head = |phi: f64| format!("lambda_um = [0.6]\ntheta_i_deg = [0, 40]\nphi_i_deg = [{phi}]\nn_phi_out = 36\n");
    for (method, shape) in pairs() {
        let tol = tolerance(method, shape);
        let plain = shape.replace("rotation_deg = 20\n", "");
        let scene = |phi: f64, turn: f64| {
            format!("{}{}[[fiber]]\n{plain}rotation_deg = {turn}\n", head(phi), by(method, shape))
        };
        // Seven steps of the outgoing azimuth.
        let (home, turned) = (scatter(&scene(20.0, 15.0)), scatter(&scene(90.0, 85.0)));
        for (home, turned) in home.iter().zip(&turned) {
            let error = turned.error(|j, _| home.field((j + 36 - 7) % 36));
            assert!(error < 10.0 * tol, "{method}, theta {}, tm {}: {error:e}", home.theta, home.tm);
            let scale = 10.0 * tol * home.greatest();
            if home.theta == 0.0 {
                assert!(home.cross.iter().all(|f| f.norm() < scale), "{method}");
            } else {
                assert!(home.cross.iter().any(|f| f.norm() > 0.01 * home.greatest()), "{method}: oblique light turns");
            }
            if shape.contains("circle") {
                for j in [2, 20] {
                    assert!(home.cross[j].norm() < scale, "{method}, j {j}: {}", home.cross[j]);
                }
            }
        }
    }
}

/// Light sent back along its way finds the same amplitude: from (theta, phi_i) to phi_o as from (-theta,
/// phi_o) to phi_i, co and cross.
#[test]
#[ignore = "slow: 5 s: ways can be reversed"]
fn ways_can_be_reversed() {
    let step = 15.0;
    let phis: Vec<String> = (0..24).map(|j| format!("{}", step * f64::from(j))).collect();
    let head =
        format!("lambda_um = [0.7]\ntheta_i_deg = [25, -25]\nphi_i_deg = [{}]\nn_phi_out = 24\n", phis.join(","));
    for (method, shape) in pairs().filter(|(_, shape)| *shape == TRIANGLE || *shape == LOBES) {
        let tol = tolerance(method, shape);
        let scene = format!(
            "{head}{by}[[fiber]]\n{shape}[[fiber]]\nshape = \"circle\"\nradius_um = 0.4\ncenter_um = [1.9, 0.6]\neta = 1.5\n",
            by = by(method, shape)
        );
        let cases = scatter(&scene);
        assert_eq!(cases.len(), 96);
        // Cases by theta, phi, polarization.
        let at = |back: bool, phi: usize, tm: bool| &cases[48 * usize::from(back) + 2 * phi + usize::from(!tm)];
        for i in 0..24 {
            for o in 0..24 {
                let scale = 10.0 * tol * at(false, i, true).greatest();
                for tm in [true, false] {
                    let (there, back) = (at(false, i, tm).co[o], at(true, o, tm).co[i]);
                    assert!((there - back).norm() < scale, "{method}, co, tm {tm}, {i} to {o}: {there} and {back}");
                    let (there, back) = (at(false, i, tm).cross[o], at(true, o, !tm).cross[i]);
                    assert!((there - back).norm() < scale, "{method}, cross, tm {tm}, {i} to {o}: {there} and {back}");
                }
            }
        }
    }
}

/// Thin fibers far apart scatter as if alone, each with its own phase.
#[test]
fn thin_fibers_add_up() {
    let a = 0.02 / (2.0 * PI);
    let places = [[0.0, 0.0], [7.3, 1.1], [-2.0, 9.4]];
    let eps = 1.5f64.powi(2);
    let fibers: String = places
        .iter()
        .map(|[x, y]| format!("[[fiber]]\nshape = \"circle\"\nradius_um = {a}\neta = 1.5\ncenter_um = [{x}, {y}]\n"))
        .collect();
    for method in CIRCLES {
        for case in scatter(&format!("{}{THIN}{fibers}", by(method, CIRCLE))) {
            let e = incident(&case);
            let (area, alpha, k) = (PI * a * a, 2.0 * (eps - 1.0) / (eps + 1.0), case.k_rho());
            let p = [area * alpha * e[0], area * alpha * e[1], area * (eps - 1.0) * e[2]].map(C64::from);
            let error = case.error(|_, phi| {
                let phases = places
                    .iter()
                    .map(|[x, y]| C64::cis(-k * (x * (case.phi.cos() + phi.cos()) + y * (case.phi.sin() + phi.sin()))));
                let phases: C64 = phases.sum();
                dipole(&case, phi, p).map(|f| f * phases)
            });
            // Light from one fiber to the next is weaker by about (k a)^2 pi (eps - 1) / 4 = 4e-4.
            assert!(error < 3e-3, "{method}, theta {}, phi {}, tm {}: {error:e}", case.theta, case.phi, case.tm);
        }
    }
}

/// The widths are those of the printed field: C_sca its integral, C_ext its forward value along the incident
/// polarization.
#[test]
fn widths_are_those_of_the_field() {
    let head = "lambda_um = [0.5]\ntheta_i_deg = [0, 50]\nphi_i_deg = [0, 90]\nn_phi_out = 360\n";
    for (method, shape) in pairs() {
        let tol = tolerance(method, shape);
        for case in scatter(&format!("{head}{}[[fiber]]\n{shape}", by(method, shape))) {
            let square: f64 = case.co.iter().chain(&case.cross).map(|f| f.norm_sqr()).sum();
            let sca = 2.0 / (PI * case.k0()) * square * 2.0 * PI / 360.0;
            assert!((case.sca - sca).abs() < 1e-9 * sca, "{method}: C_sca {} against {sca}", case.sca);
            let forward = (case.phi.to_degrees().round() as usize + 180) % 360;
            // phi points along -e_TE in the forward direction.
            let sign = if case.tm { -1.0 } else { 1.0 };
            let ext = sign * 4.0 / case.k0() * case.co[forward].re;
            assert!((case.ext - ext).abs() < 1e-9 * ext, "{method}: C_ext {} against {ext}", case.ext);
            let off = case.ext - case.sca - case.abs;
            assert!(off.abs() < 10.0 * tol * case.ext, "{method}: {off:e} of {}", case.ext);
            let lossy = shape.contains("kappa");
            assert!(
                if lossy { case.abs > 0.01 * case.ext } else { case.abs.abs() < 10.0 * tol * case.ext },
                "{method}"
            );
        }
    }
}

/// A thin fiber feels the beam at its place: amplitude exp(-s^2 / w0^2), s along (sin phi_i, -cos phi_i),
/// which is x for light from +y.
#[test]
fn beams_have_their_offset() {
    let a = 0.003 / (2.0 * PI);
    let (w0, x, y) = (40.0, 11.0, -6.0);
    let fiber = format!("[[fiber]]\nshape = \"circle\"\nradius_um = {a}\neta = 1.5\ncenter_um = [{x}, {y}]\n");
    let head = "lambda_um = [1.0]\ntheta_i_deg = [0, 30]\nphi_i_deg = [90, 20]\nn_phi_out = 24\n";
    let offsets = [-30.0, 0.0, 20.0];
    for method in ONE {
        let by = by(method, CIRCLE);
        let plane = scatter(&format!("{by}{head}{fiber}"));
        let beams = scatter(&format!("{by}{head}[beam]\nw0_um = {w0}\nh_um = [-30, 0, 20]\n{fiber}"));
        assert_eq!(beams.len(), 3 * plane.len());
        for (i, beam) in beams.iter().enumerate() {
            // Cases by theta, phi, h, polarization.
            let plane = &plane[2 * (i / 6) + i % 2];
            let h = offsets[i / 2 % 3];
            let s = x * beam.phi.sin() - y * beam.phi.cos();
            let amplitude = (-((s - h) / w0).powi(2)).exp();
            let error = beam.error(|j, _| plane.field(j).map(|f| f * amplitude));
            // The waist's curvature over the depth of 12 um: 2 z / (k w0^2).
            assert!(error < 0.02, "{method}, h {h}, phi {}, tm {}: {error}", beam.phi, beam.tm);
            assert!((beam.sca / plane.sca - amplitude.powi(2)).abs() < 0.02, "{method}");
        }
    }
}

/// A hollow circle, alone and beside another: what several methods serve, they serve alike.
#[test]
fn methods_agree() {
    let head = "lambda_um = [0.5]\ntheta_i_deg = [0, 35]\nphi_i_deg = [30]\nn_phi_out = 90\n";
    let hollow = "[[fiber]]\nshape = \"circle\"\nradius_um = 1.2\neta = 1.5\nkappa = 0.01\ncenter_um = [0.3, -0.1]\n[fiber.lumen]\nshape = \"circle\"\nradius_um = 0.5\n";
    let pair = format!("{hollow}[[fiber]]\nshape = \"circle\"\nradius_um = 0.8\neta = 1.4\ncenter_um = [2.5, 0.2]\n");
    for (fibers, methods) in [(hollow, &ONE[1..]), (&pair, &CIRCLES[1..])] {
        let all: Vec<Vec<Case>> =
            methods.iter().map(|m| scatter(&format!("{}{head}{fibers}", by(m, CIRCLE)))).collect();
        for (method, cases) in methods.iter().zip(&all).skip(1) {
            for (case, truth) in cases.iter().zip(&all[0]) {
                let error = case.error(|j, _| truth.field(j));
                let most = 10.0 * tolerance(method, CIRCLE);
                assert!(error < most, "{method} against {}: {error:e}", methods[0]);
            }
        }
    }
}

/// The scenes that come with the program run; results do not depend on threads; lists make cases in order.
#[test]
fn scenes_run_alike_on_any_threads() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/scenes");
    let folder = tempfile::tempdir().unwrap();
    let mut seen = 0;
    for name in names(&scenes) {
        let scene = scenes.join(&name);
        let outs: Vec<Vec<Case>> = ["1", "2", "3"]
            .iter()
            .map(|threads| {
                let said = succeed(
                    folder.path(),
                    &["wave", "scatter", scene.to_str().unwrap(), "-o", "out.json", "--threads", threads, "--json"],
                );
                let said = json(&said);
                assert!(said["stats"]["method"].is_string() && said["ledger_max"].as_f64().unwrap() < 1e-3, "{said}");
                cases(&json(&std::fs::read_to_string(folder.path().join("out.json")).unwrap()))
            })
            .collect();
        for other in &outs[1..] {
            assert_eq!(format!("{:?}", outs[0]), format!("{other:?}"), "{name}");
        }
        let keys: Vec<(f64, f64, f64)> = outs[0].iter().map(|c| (c.lambda, c.theta, c.phi)).collect();
        assert!(keys.is_sorted(), "{name}");
        assert!(outs[0].iter().enumerate().all(|(i, c)| c.tm == (i % 2 == 0)), "{name}");
        seen += 1;
    }
    assert!(seen >= 2);
}

const GOOD: &str = "lambda_um = [0.5]\nphi_i_deg = [90]\nn_phi_out = 36\n\n[[fiber]]\nshape = \"ellipse\"\na_um = 1.0\nb_um = 0.8\neta = 1.5\n";

/// Bad scenes: one line, exit code 2, nothing written.
#[test]
fn bad_scenes_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let refuse = |scene: &str, words: &[&str]| {
        std::fs::write(dir.join("bad.toml"), scene).unwrap();
        refused(dir, &["wave", "scatter", "bad.toml", "-o", "out.json"], &[&["bad.toml"][..], words].concat());
    };
    let more = |fiber: &str| format!("{GOOD}\n[[fiber]]\n{fiber}\neta = 1.5\n");
    refuse(&more("shape = \"circle\"\nradius_um = 1\ncenter_um = [1.9, 0]"), &["fiber[0]", "fiber[1]", "overlap"]);
    refuse(&more("shape = \"circle\"\nradius_um = 9"), &["fiber[0]", "fiber[1]", "overlap"]);
    let loops = "shape = \"fourier\"\ncoeffs = [[1, 1, 0], [2, 1, 0]]\ncenter_um = [9, 0]";
    refuse(&more(loops), &["fiber[1]", "crosses itself"]);
    let bow = "shape = \"polygon\"\npoints_um = [[9, 0], [13, 4], [13, 0], [9, 4]]\nrounding_um = 0.1";
    refuse(&more(bow), &["fiber[1]", "crosses itself"]);
    refuse(&format!("{GOOD}kappa = -0.1\n"), &["fiber[0].kappa", "-0.1"]);
    refuse(&format!("{GOOD}[fiber.lumen]\nshape = \"circle\"\nradius_um = 0.9\n"), &["fiber[0].lumen", "overlap"]);
    refuse(
        &format!("{GOOD}[fiber.lumen]\nshape = \"circle\"\nradius_um = 0.1\ncenter_um = [3, 0]\n"),
        &["fiber[0].lumen", "outside"],
    );
    refuse(&format!("tolerance = 1e-20\n{GOOD}"), &["tolerance", "1e-20", "1e-13"]);
    refuse(&GOOD.replace("1.0", "nan"), &["fiber[0].a_um", "nan"]);
    refuse(&GOOD.replace("\na_um", "\na_mm"), &["fiber[0].a_mm", "a_um"]);
    refuse(&GOOD.replace("lambda_um = [0.5]", "lambda_um = [0.5"), &["line"]);
    refuse(&GOOD.replace("[0.5]", "[0.0]"), &["lambda_um[0]"]);
    refuse(&format!("theta_i_deg = [90]\n{GOOD}"), &["theta_i_deg[0]", "90"]);
    refuse(&format!("method = \"mie\"\n{GOOD}"), &["method = \"mie\""]);
    refuse(&format!("method = \"multipole\"\n{GOOD}"), &["method = \"multipole\""]);
    refuse("\u{0}\u{1}", &[]);
    // A fiber of 2 mm at 0.1 um: the matrix alone has some TiB.
    let huge = GOOD.replace("1.0", "2000.0").replace("0.8", "1800.0").replace("[0.5]", "[0.1]");
    for method in ANY {
        refuse(&format!("method = \"{method}\"\n{huge}"), &["unknowns", "GiB"]);
    }
    std::fs::write(dir.join("bad.toml"), [0xff, 0xfe, 0x00]).unwrap();
    refused(dir, &["wave", "scatter", "bad.toml", "-o", "out.json"], &["bad.toml", "UTF-8"]);
    refused(dir, &["wave", "scatter", "none.toml", "-o", "out.json"], &["none.toml", "no such file"]);
    refused(dir, &["wave", "scatter", ".", "-o", "out.json"], &["."]);
    refused(dir, &["wave", "scatter", "bad.toml", "--best"], &["--best", "plywave wave scatter --help"]);
    refused(dir, &["wave"], &["plywave wave --help"]);
    std::fs::write(dir.join("bad.toml"), GOOD).unwrap();
    refused(dir, &["wave", "scatter", "bad.toml", "-o", "bad.toml"], &["bad.toml", "input"]);
    refused(dir, &["wave", "scatter", "bad.toml", "-o", "none/out.json"], &["none"]);
}

/// Ctrl-C ends a long run at once, with nothing written.
#[test]
#[cfg(unix)]
fn interrupts_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let phis = (0..3600).map(|i| format!("{}", 0.1 * f64::from(i))).collect::<Vec<_>>().join(",");
    let scene = GOOD.replace("1.0", "60.0").replace("0.8", "50.0").replace("[90]", &format!("[{phis}]"));
    std::fs::write(dir.join("long.toml"), scene).unwrap();
    let child = plywave(dir, &["wave", "scatter", "long.toml", "-o", "out.json"])
        .stderr(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(700));
    assert!(std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    assert_eq!(names(dir), ["long.toml"]);
    assert_eq!(run(dir, &["wave", "scatter"]).status.code(), Some(2));
}
