//! Tests of the twin. Reference implementations: the simulation of a single ply, which shares only the packed
//! section with the twin, and brute-force shadows of hairs.

use super::curves::TwinCurves;
use super::job::{TwinJob, twin};
use super::options::{TwinMesh, TwinOptions};
use super::sweep::ThreadOfFiber;
use super::tracer::{ClothTracer, LightsOfFibers};
use crate::geometry::section::PlySection;
use crate::rays::dielectric::RoughDielectric;
use crate::rays::path::{PathEnd, trace_path, walk};
use crate::rays::screw::ScrewTracer;
use crate::rays::tracer::{Medium, Trace};
use crate::seeds::stream;
use nalgebra::{Rotation3, Vector3};
use plywave::cloth::{ClothCurves, ClothYarn, Lattice, PlyCurve};
use plywave::spec::{POLYESTER, YarnSpec};
use plywave_runs::{Description, Run, RunError};
use plywave_textile::Hairs;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// One straight ply along y, in the middle of a cell that is 4000 um wide.
fn lone_ply() -> TwinCurves {
    let cell_um = [[4000.0, 0.0], [0.0, 100.0]];
    let points: Vec<[f64; 3]> = (0..4).map(|i| [2000.0, 25.0 * f64::from(i), 0.0]).collect();
    let curve = PlyCurve::through(0, 50.0, [0, 1], &points, &Lattice::new(cell_um).unwrap());
    let yarn = ClothYarn { kind: 0, number: 0, step: [1, 0], period: [0, 1] };
    let curves = ClothCurves { cell_um, yarns: vec![yarn], curves: vec![curve] };
    TwinCurves::new("ply", curves, vec![POLYESTER.into()]).unwrap()
}

/// Sums over paths of light that hits a ply, with squares for standard errors. The values are: missed,
/// reflected without entering a fiber, outgoing light up and down at sigma 0 and then at 0.01 / um, and the
/// component of the outgoing direction along the ply.
#[derive(Default)]
struct Tally {
    sums: [f64; 7],
    squares: [f64; 7],
    paths: f64,
}

impl Tally {
    fn add(&mut self, end: PathEnd, up: Vector3<f32>, along: Vector3<f32>) {
        let mut values = [0.0; 7];
        let mut out = |dir: Vector3<f32>, length: f32| {
            let half = usize::from(dir.dot(&up) < 0.0);
            values[2 + half] = 1.0;
            values[4 + half] = f64::from(-0.01 * length).exp();
            values[6] = f64::from(dir.dot(&along));
        };
        match end {
            PathEnd::Miss => values[0] = 1.0,
            PathEnd::Reflected { dir, .. } => {
                out(dir, 0.0);
                values[1] = 1.0;
            }
            PathEnd::High { dir, length_um, .. } => out(dir, length_um),
            PathEnd::Killed => {}
        }
        for k in 0..7 {
            self.sums[k] += values[k];
            self.squares[k] += values[k] * values[k];
        }
        self.paths += 1.0;
    }

    fn mean(&self, k: usize) -> (f64, f64) {
        let mean = self.sums[k] / self.paths;
        (mean, (self.squares[k] / self.paths - mean * mean) / self.paths)
    }
}

/// A single straight ply of the twin, lit uniformly over its width, agrees with the screw march of the same
/// section. The two geometries have the same physics and differ by the triangles alone.
#[test]
#[ignore = "slow: 10 s: a lone ply scatters as in its own simulation"]
fn a_lone_ply_scatters_as_in_its_own_simulation() {
    let cloth = lone_ply();
    let domain = cloth.domain(Some([1, 8]), &TwinMesh::default());
    assert_eq!((domain.size_um, domain.yarns), ([4000.0, 800.0], [1, 0]));
    let mesh = TwinMesh { outline_points: 64, turn_rad: 0.05, ..TwinMesh::default() };
    let tracer = ClothTracer::new(&cloth, &domain, &mesh, 7).unwrap();
    let spec = YarnSpec::parse(POLYESTER, "polyester.toml").unwrap();
    let section = PlySection::generate(&spec, stream(7, [u64::MAX, 0]).random()).unwrap();
    let screw = ScrewTracer::new(&section).unwrap();
    let surface = RoughDielectric { eta: spec.fiber.eta as f32, alpha: spec.fiber.alpha_fiber as f32 };
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let paths = 60_000;
    for theta in [0.0f32, -0.7] {
        let (mut twin, mut ply) = (Tally::default(), Tally::default());
        for _ in 0..paths {
            let (x, along, turn): (f32, f32, f32) = (100.0 * rng.random::<f32>() - 50.0, rng.random(), rng.random());
            // The ply's axis is the middle of the domain; -x is across, z is up and y is along the ply.
            let dir = Vector3::new(0.0, -theta.sin(), -theta.cos());
            let pos = Vector3::new(x, 800.0 * (along - 0.5), 0.0) - dir * 60.0 / theta.cos();
            let end =
                walk(|p, d, m| tracer.trace(p, d, m), |fiber| tracer.surface(fiber), pos, dir, &mut rng, |_, _, _| ());
            twin.add(end, Vector3::z(), Vector3::y());
            let spin = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f32::consts::TAU * turn);
            let dir = Vector3::new(0.0, -theta.cos(), -theta.sin());
            let pos = Vector3::new(x, 0.0, 0.0) - dir * 60.0 / theta.cos();
            let end = trace_path(&screw, &surface, spin * pos, spin * dir, &mut rng);
            ply.add(end, spin * Vector3::y(), Vector3::z());
        }
        let names = ["missed", "reflected only", "up", "down", "up, absorbed", "down, absorbed", "along"];
        for (k, name) in names.into_iter().enumerate() {
            let ((a, va), (b, vb)) = (twin.mean(k), ply.mean(k));
            let tolerance = 5.0 * (va + vb).sqrt();
            assert!(
                (a - b).abs() < tolerance,
                "theta {theta}, {name}: twin {a:.5}, ply {b:.5}, tolerance {tolerance:.5}"
            );
        }
    }
}

/// A uniform light from all directions, sampled uniformly.
#[derive(Default)]
struct AllRound {
    light: f64,
}

impl LightsOfFibers<Pcg64Mcg> for AllRound {
    fn passes(&mut self, _: &ThreadOfFiber, _: f32) {}

    fn draw(&mut self, _: [f32; 3], rng: &mut Pcg64Mcg) -> Option<[f32; 3]> {
        let (z, turn) = (2.0 * rng.random::<f32>() - 1.0, std::f32::consts::TAU * rng.random::<f32>());
        let across = (1.0 - z * z).sqrt();
        Some([across * turn.cos(), across * turn.sin(), z])
    }

    fn reached(&mut self, _: &ThreadOfFiber, _: [f32; 3], density: f32, _: f32) {
        self.light += f64::from(density) * 4.0 * std::f64::consts::PI;
    }
}

/// Next event estimation of a uniform light agrees with the share of paths that leave from rough walls.
#[test]
fn drawn_light_is_that_of_paths() {
    let cloth = lone_ply();
    let tracer = ClothTracer::of_cloth(&cloth, Some([1, 1]), &TwinMesh::default(), 7).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(9);
    let [a, b] = tracer.size_um();
    for w in [[0.0f32, 0.0, -1.0], [0.6, 0.48, 0.64]] {
        let paths = 40_000;
        let (mut escaped, mut light, mut squares) = (0.0, 0.0, 0.0);
        for _ in 0..paths {
            let at = [0.5 * a + 160.0 * (rng.random::<f32>() - 0.5), b * rng.random::<f32>()];
            let mut lamp = AllRound::default();
            let end = tracer.follow(at, w, &mut rng, &mut lamp);
            escaped += f64::from(end.is_some_and(|end| end.is_rough) as u8);
            light += lamp.light;
            squares += lamp.light * lamp.light;
        }
        let n = f64::from(paths);
        let se = ((squares / n - (light / n).powi(2)) / n).sqrt();
        let [escaped, light] = [escaped / n, light / n];
        assert!(escaped > 0.1 && se < 0.05, "{escaped} {se}");
        assert!((light - escaped).abs() < 4.0 * se + 0.005, "{w:?}: {light}, walls sent out {escaped}, se {se}");
    }
}

/// The lone ply with long hairs, some of them loops. Many of the hairs leave the domain.
fn hairy_ply() -> TwinCurves {
    let hairs = Hairs { per_mm: 60.0, length_mm: 0.5, curl_mm: 0.4, rise: 0.5, loops: 0.2 };
    lone_ply().with_hairs(vec![Some(hairs)])
}

/// Lines along the normal hit the hairs beside the ply if and only if they lie in the hairs' shadows on the
/// plane, which are computed by brute force. Hairs that leave the domain on one side re-enter on the opposite
/// one.
#[test]
fn lines_hit_hairs_where_they_are() {
    let (cloth, repeats) = (hairy_ply(), [1, 4]);
    let tracer = ClothTracer::of_cloth(&cloth, Some(repeats), &TwinMesh::default(), 5).unwrap();
    let hairs = cloth.all_hairs(repeats, 5);
    let [w, h] = tracer.size_um().map(f64::from);
    assert_eq!([w, h], [4000.0, 400.0]);
    let outside = |p: &[f64; 3]| p[1].rem_euclid(h) != p[1];
    assert!(hairs.iter().filter(|hair| hair.points_um.iter().any(outside)).count() > 5, "few cross a side");
    // Depth of a point of the plane within the shadow of a hair [um], negative outside; NaN next to nothing
    // but the flat end of a hair.
    let depth = |x: f64, y: f64| {
        let (mut max, mut at_end) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        for hair in &hairs {
            let last = hair.points_um.len() - 2;
            for (i, piece) in hair.points_um.windows(2).enumerate() {
                // The nearest image; pieces are shorter than the domain.
                let fold = |d: f64, size: f64| d - size * (d / size).round();
                let (px, py) = (fold(piece[0][0] - x, w), fold(piece[0][1] - y, h));
                let (dx, dy) = (piece[1][0] - piece[0][0], piece[1][1] - piece[0][1]);
                let t = -(px * dx + py * dy) / (dx * dx + dy * dy).max(1e-12);
                let is_beyond = (i == 0 && t < 0.0) || (i == last && t > 1.0);
                let t = t.clamp(0.0, 1.0);
                let within = hair.radius_um - (px + t * dx).hypot(py + t * dy);
                let to = if is_beyond { &mut at_end } else { &mut max };
                *to = to.max(within);
            }
        }
        if max < 0.0 && at_end > -2.0 { f64::NAN } else { max }
    };
    let [_, high] = tracer.heights_um();
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let (mut shaded, mut lit) = (0, 0);
    for _ in 0..20_000 {
        let (x, y) = (2000.0 + 1200.0 * (rng.random::<f64>() - 0.5), h * rng.random::<f64>());
        let within = depth(x, y);
        // Only lines beside the ply count, away from the rims of tubes, which are polygons with flat ends and
        // mitered bends.
        if (x - 2000.0).abs() < 65.0 || within.is_nan() || within.abs() < 2.0 {
            continue;
        }
        let pos = Vector3::new((x - 0.5 * w) as f32, (y - 0.5 * h) as f32, high);
        let hit = matches!(tracer.trace(pos, -Vector3::z(), Medium::Air), Trace::Hit(_));
        assert_eq!(hit, within > 0.0, "at {x:.1} {y:.1}, {within:.2} um within");
        *(if hit { &mut shaded } else { &mut lit }) += 1;
    }
    println!("{} hairs; {shaded} lines hit one, {lit} none", hairs.len());
    assert!(shaded > 300 && lit > 300, "{shaded} {lit}");
}

/// Clear fibers with hairs conserve energy, and hairs scatter light that would have missed the ply.
#[test]
fn hairs_keep_all_light() {
    let options = TwinOptions {
        views: vec![[0.0, 0.0, 1.0], [0.6, 0.48, 0.64]],
        sigma_per_um: vec![[0.0; 2]],
        paths: 20_000,
        shards: 4,
        image: 4,
        repeats: Some([1, 4]),
        ..TwinOptions::default()
    };
    let [bare, hairy] = [lone_ply(), hairy_ply()].map(|cloth| twin(&cloth, &options, Run::plain()).unwrap());
    for view in 0..2 {
        let [bare, light] = [&bare, &hairy].map(|twin| twin.light(view, 0));
        let sum = light.reflected + light.transmitted + light.straight;
        println!("view {view}: {light:?}, sum {sum:.5}, without hairs {bare:?}");
        assert!((sum - 1.0).abs() < 0.01, "{sum}");
        assert!(light.straight < bare.straight - 0.02, "{light:?} {bare:?}");
    }
}

/// Hairs are part of a cloth's text and of its comparison with a twin. Their absence leaves the text
/// unchanged.
#[test]
fn hairs_are_in_the_text() {
    let (bare, hairy) = (lone_ply(), hairy_ply());
    assert!(!bare.text().contains("hairs"));
    assert_eq!(bare.text(), lone_ply().with_hairs(vec![None]).text());
    let again = TwinCurves::parse(hairy.text()).unwrap().unwrap();
    assert_eq!(again.text(), hairy.text());
    let specs = [POLYESTER.to_string()];
    assert_eq!(hairy.difference(&bare.curves, &specs, &[None]), Some("hairs"));
    assert_eq!(bare.difference(&hairy.curves, &specs, &[]), None);
}

#[test]
fn text_of_another_kind_is_refused_in_one_line() {
    let cloth = lone_ply();
    let job = |text: &str| TwinJob::from_description(&Description::new("twin", &TwinOptions::default(), text));
    assert!(job(cloth.text()).is_ok());
    for text in ["{}", "name = \"x\"\n", ""] {
        let error = job(text).err().unwrap();
        assert!(matches!(error, RunError::Merge { .. }), "{error:?}");
        let message = error.to_string();
        assert!(message.contains("the text of the cloth") && !message.contains('\n'), "{message}");
    }
}
