//! Fibers beyond the solid dielectric: opaque ones, hollow circles, blends, dispersion. References:
//! conservation of power, mirrors, straight lines through two circles; a march in small steps, triangles, and
//! fibers whose exact result follows from those of one kind.

use nalgebra::{Vector2, Vector3};
use plywave::optics::{Metal, OpaqueIndex, Reflections};
use plywave::spec::{FiberSpec, POLYESTER, YarnSpec};
use plywave_runs::Run;
use plywave_sim::*;
use plywave_tables::table::Table;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::time::Instant;

fn yarn(fiber: &str, more: &str) -> YarnSpec {
    let start = POLYESTER.find("[fiber]").unwrap();
    let end = POLYESTER.find("[ply]").unwrap();
    let text = format!("{}[fiber]\n{fiber}\n{}\n{more}\n", &POLYESTER[..start], &POLYESTER[end..]);
    YarnSpec::parse(&text, "yarn").unwrap_or_else(|e| panic!("{e}"))
}

const CIRCLE: &str = "shape = { kind = \"circle\", radius_um = 7.5 }\nsize_jitter = 0.03\nalpha_fiber = 0.2\n";
const DIELECTRIC: &str = "eta = 1.6";

fn hollow(lumen: f64, more: &str, index: &str) -> YarnSpec {
    let shape = format!("shape = {{ kind = \"hollow_circle\", radius_um = 7.5, lumen = {lumen}{more} }}");
    yarn(&format!("{shape}\nsize_jitter = 0.03\nalpha_fiber = 0.2\n{index}"), "")
}

fn small(paths_per_theta: u64, tracer: TracerKind) -> SimOptions {
    SimOptions {
        paths_per_theta,
        instances: 4,
        shards: 4,
        theta_i_nodes: 3,
        theta_i_max_rad: 1.2,
        h_nodes: 9,
        theta_o_bins: 12,
        phi_o_bins: 24,
        tracer,
        ..SimOptions::preview()
    }
}

fn table(spec: &YarnSpec, paths: u64) -> Table {
    let text = toml::to_string(spec).unwrap();
    simulate(spec, &text, &small(paths, TracerKind::Auto), Run::plain()).unwrap()
}

/// r_d + f_refl + f_high = 1 at sigma = 0, nothing killed.
fn assert_lossless(t: &Table, what: &str) {
    let ks = t.sigma_per_um.len();
    for i in 0..t.r_d.len() {
        let (sum, se) = (t.r_d[i] + t.energy_refl[i] + t.energy_high[i * ks], t.energy_se[i]);
        assert!((sum - 1.0).abs() < 5.0 * se + 1e-9, "{what}, incidence {i}: {sum}, standard error {se}");
        assert_eq!(t.energy_killed[i], 0.0, "{what}, incidence {i}");
    }
}

/// Mean of an energy over the beams that hit the ply.
fn mean_high(t: &Table, sigma: usize) -> f64 {
    let ks = t.sigma_per_um.len();
    let met: f64 = t.r_d.iter().map(|r| 1.0 - r).sum();
    t.energy_high.iter().skip(sigma).step_by(ks).sum::<f64>() / met
}

fn mean_refl(t: &Table) -> f64 {
    t.energy_refl.iter().sum::<f64>() / t.r_d.iter().map(|r| 1.0 - r).sum::<f64>()
}

#[test]
fn plies_of_every_kind_conserve_power() {
    let blend = "[blend]\nshare = 0.4\n[blend.fiber]\nshape = { kind = \"ellipse\", a_um = 8.0, b_um = 6.0 }\neta = 1.5\nalpha_fiber = 0.1";
    for (what, spec) in [
        ("gold", yarn(&format!("{CIRCLE}metal = \"gold\""), "")),
        ("hollow", hollow(0.5, "", DIELECTRIC)),
        ("filled", hollow(0.8, ", lumen_eta = 1.4, lumen_dye = 2.0", DIELECTRIC)),
        ("blend", yarn(&format!("{CIRCLE}{DIELECTRIC}"), blend)),
    ] {
        let t = table(&spec, 6_000);
        assert_lossless(&t, what);
        let ks = t.sigma_per_um.len();
        for high in t.energy_high.chunks_exact(ks) {
            assert!(high.windows(2).all(|w| w[1] <= w[0]), "{what}: {high:?}");
        }
        if what == "gold" {
            assert!(t.energy_refl.iter().all(|e| *e == 0.0), "all light of a metal is weighted by its reflections");
        }
    }
}

/// The color of a metal by one length for all wavelengths is compared with the exact one: the same paths,
/// each facet by Fresnel's reflectance of the wavelength. The same seed gives the same paths, so the
/// difference has no noise. The limit is 0.012 of the light that leaves a ply of gold, silver, aluminum or
/// copper.
#[test]
fn colors_of_metals_by_length_are_those_by_facets() {
    let lambdas = [0.42, 0.45, 0.48, 0.50, 0.52, 0.55, 0.58, 0.62, 0.66, 0.70];
    let spec = yarn(&format!("{CIRCLE}metal = \"gold\""), "");
    let section = PlySection::generate(&spec, 3).unwrap();
    let tracer = ScrewTracer::new(&section).unwrap();
    let bound = tracer.bound_radius_um();
    let lengths = |index: OpaqueIndex, paths: u64| -> Vec<f32> {
        let mut fiber = FiberSurface::new(&spec.fiber, 0.55, 1.0);
        fiber.outer = Wall::Opaque(RoughConductor { alpha: 0.2, reflections: Reflections::new(index) });
        let surfaces = Surfaces::alike(fiber);
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        (0..paths)
            .filter_map(|_| {
                let x = bound * (2.0 * rng.random::<f32>() - 1.0);
                let z = spec.ply.fiber_pitch_um.unwrap() as f32 * rng.random::<f32>();
                let dir = Vector3::new(0.0, -1.0, -1.5 * rng.random::<f32>()).normalize();
                match trace_path_among(&tracer, &surfaces, Vector3::new(x, bound, z), dir, &mut rng) {
                    PathEnd::High { length_um, .. } => Some(length_um),
                    _ => None,
                }
            })
            .collect()
    };
    let kept = |lengths: &[f32], sigma: f64| {
        lengths.iter().map(|l| (-sigma * f64::from(*l)).exp()).sum::<f64>() / lengths.len() as f64
    };
    for metal in [Metal::Gold, Metal::Silver, Metal::Aluminium, Metal::Copper] {
        let common = lengths(OpaqueIndex::Metal(metal), 8_000);
        let of = Reflections::new(OpaqueIndex::Metal(metal));
        let mut worst = 0.0f64;
        for lambda_um in lambdas {
            let index = OpaqueIndex::Fixed(metal.index(lambda_um as f32));
            let exact = lengths(index, 8_000);
            assert_eq!(exact.len(), common.len(), "the same paths");
            let got = kept(&common, of.sigma_per_um(lambda_um));
            let want = kept(&exact, Reflections::new(index).sigma_per_um(lambda_um));
            println!("{metal:?} at {lambda_um} um: {got:.4} by length, {want:.4} by facets");
            worst = worst.max((got - want).abs());
        }
        println!("{metal:?}: off by {worst:.4} at most");
        assert!(worst < 0.002, "{metal:?}: off by {worst}");
    }
}

/// Two straight circles, and a twisted ply's: the tracer's hits within a ring and within its core agree with
/// a march in steps of a thousandth of a micrometer.
#[test]
fn rings_are_left_where_a_fine_march_leaves_them() {
    for pitch_um in [None, Some(300.0)] {
        let mut spec = hollow(0.55, "", DIELECTRIC);
        spec.ply.fiber_pitch_um = pitch_um;
        spec.ply.fibers = 12;
        let section = PlySection::generate(&spec, 4).unwrap();
        let tracer = ScrewTracer::new(&section).unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(8);
        let (mut walls, mut worst) = ([0; 3], 0.0f64);
        for k in 0..1500 {
            let f = k % section.fibers.len();
            let fiber = &section.fibers[f];
            let (Outline::Circle { radius_um }, Some(Outline::Circle { radius_um: core })) =
                (&fiber.outer, &fiber.lumen)
            else {
                panic!("not a hollow circle")
            };
            // Grazing starts from either wall among them.
            let within = k % 3 == 0;
            let r = if within {
                core * (1.0 - 1e-4 - rng.random::<f64>().powi(4))
            } else {
                core + 1e-3 + (radius_um - core - 2e-3) * rng.random::<f64>().powi(3)
            };
            let (s, c) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
            let z = 1000.0 * rng.random::<f64>();
            let q = fiber.center_um + Vector2::new(c, s) * r.abs();
            let p = nalgebra::Rotation2::new(section.turn(z)) * q;
            let up = 1.6 * rng.random::<f64>() - 0.8;
            let (s, c) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
            let dir = Vector3::new(c, s, up / (1.0 - up * up).sqrt()).normalize();
            let place = |t: f64| {
                let p = Vector3::new(p.x, p.y, z) + dir * t;
                fiber.to_fiber(nalgebra::Rotation2::new(-section.turn(p.z)) * Vector2::new(p.x, p.y)).norm()
            };
            let medium = if within { Medium::Lumen(f as u32) } else { Medium::Fiber(f as u32) };
            let Trace::Hit(hit) = tracer.trace(Vector3::new(p.x, p.y, z).cast(), dir.cast(), medium) else {
                panic!("lost in fiber {f} at {r}")
            };
            let mut t = 0.0;
            let step = 1e-3;
            let lumen = loop {
                t += step;
                let r = place(t);
                if r < *core && !within || r > *core && within {
                    break true;
                }
                if r > *radius_um {
                    break false;
                }
            };
            assert_eq!(hit.fiber, f as u32);
            let got = f64::from(hit.t_um);
            let off = (got - t).abs();
            // A line that almost touches a core may count either way: the wall is then 2e-4 um away.
            let touching = place(got) - core;
            if hit.lumen != lumen || off > 0.05 {
                assert!(
                    touching.abs() < 1e-3 || off < 0.2 && (place(got) - radius_um).abs() < 1e-3,
                    "{off} {touching}"
                );
                continue;
            }
            worst = worst.max((place(got) - if lumen { core } else { radius_um }).abs());
            walls[if within { 2 } else { usize::from(lumen) }] += 1;
        }
        assert!(worst < 1e-3, "pitch {pitch_um:?}: {worst} um off a wall");
        assert!(walls.iter().all(|n| *n > 200), "{walls:?}");
        assert!(walls.iter().sum::<usize>() > 1480, "{walls:?}");
    }
}

/// A core of the fiber's own material changes nothing; with a core without dye, the lengths are those in the
/// ring.
#[test]
#[ignore = "slow: 5 s: a core of the same material is no core"]
fn a_core_of_the_same_material_is_no_core() {
    let solid = table(&yarn(&format!("{CIRCLE}{DIELECTRIC}"), ""), 20_000);
    let filled = table(&hollow(0.6, ", lumen_eta = 1.6, lumen_dye = 1.0", DIELECTRIC), 20_000);
    let bare = table(&hollow(0.6, ", lumen_eta = 1.6", DIELECTRIC), 20_000);
    let ks = solid.sigma_per_um.len();
    // A core takes random numbers: the sections are others of the same yarn, and their spread counts.
    for k in 0..ks {
        let (a, b) = (mean_high(&solid, k), mean_high(&filled, k));
        assert!((a - b).abs() < 0.01, "sigma {}: {a} solid, {b} filled", solid.sigma_per_um[k]);
    }
    assert!((mean_refl(&solid) - mean_refl(&filled)).abs() < 0.005);
    assert!(mean_high(&bare, ks - 1) > mean_high(&filled, ks - 1) + 0.02);
}

/// The screw march and triangles give the same light for a ply of hollow circles.
#[test]
#[ignore = "slow: 10 s: hollow circles by march and by triangles"]
fn hollow_circles_by_march_and_by_triangles() {
    let spec = hollow(0.5, "", DIELECTRIC);
    let text = toml::to_string(&spec).unwrap();
    let run = |tracer| simulate(&spec, &text, &small(12_000, tracer), Run::plain()).unwrap();
    let (screw, mesh) = (run(TracerKind::Screw), run(TracerKind::Mesh));
    for k in 0..screw.sigma_per_um.len() {
        let (a, b) = (mean_high(&screw, k), mean_high(&mesh, k));
        assert!((a - b).abs() < 0.006, "sigma {}: march {a}, triangles {b}", screw.sigma_per_um[k]);
    }
    assert!((mean_refl(&screw) - mean_refl(&mesh)).abs() < 0.003);
}

/// Time of this thread on its core [s], whatever else runs; elapsed time if the system does not report it.
fn seconds() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let on_core = told.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    on_core.map_or_else(|| START.elapsed().as_secs_f64(), |nanoseconds| 1e-9 * nanoseconds)
}

/// Tracing a ply of hollow circles takes no more than twice the time of full ones, path for path, for cores
/// up to half the radius, and wall for wall at most a third more. The least of several runs of each, in turn,
/// on one thread.
#[test]
fn hollow_circles_trace_at_half_the_speed_of_full_ones_or_better() {
    let full = yarn(&format!("{CIRCLE}{DIELECTRIC}"), "");
    let time = |spec: &YarnSpec, tracer: &ScrewTracer, walls: &mut u64| {
        let surfaces = Surfaces::of_spec(spec);
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let bound = tracer.bound_radius_um();
        let start = seconds();
        for _ in 0..6_000 {
            let x = bound * (2.0 * rng.random::<f32>() - 1.0);
            let pos = Vector3::new(x, (bound * bound - x * x).max(0.0).sqrt(), 800.0 * rng.random::<f32>());
            if let PathEnd::High { interactions, .. } =
                trace_path_among(tracer, &surfaces, pos, -Vector3::y(), &mut rng)
            {
                *walls += u64::from(interactions);
            }
        }
        seconds() - start
    };
    let tracer = |spec: &YarnSpec| ScrewTracer::new(&PlySection::generate(spec, 1).unwrap()).unwrap();
    let solid = tracer(&full);
    for lumen in [0.25, 0.5, 0.75] {
        let spec = hollow(lumen, "", DIELECTRIC);
        let ring = tracer(&spec);
        let (mut best, mut walls) = ([f64::INFINITY; 2], [0; 2]);
        for _ in 0..7 {
            best[0] = best[0].min(time(&full, &solid, &mut walls[0]));
            best[1] = best[1].min(time(&spec, &ring, &mut walls[1]));
        }
        let [a, b] = walls.map(|w| w as f64 / 42_000.0);
        let ratio = best[0] / best[1];
        println!("core {lumen}: {ratio:.2} of a full circle's paths a second; {b:.2} walls a path, full {a:.2}");
        assert!(ratio * b / a > 0.75, "core {lumen}: {:.2} of a full circle's walls a second", ratio * b / a);
        // A thin ring's paths hit 1.8 times as many walls: 0.49 to 0.54 beside other work.
        assert!(lumen > 0.6 || ratio > 0.5, "core {lumen}: {ratio}");
    }
}

/// The second fibers have the share of the spec, each its own shape, and not first or last in the packing.
#[test]
fn blends_have_their_share() {
    let ellipse = "[blend]\nshare = 0.3\n[blend.fiber]\nshape = { kind = \"ellipse\", a_um = 9.0, b_um = 5.0 }\nangle_jitter_rad = 0.1\neta = 1.5\nalpha_fiber = 0.1";
    let spec = yarn(&format!("{CIRCLE}{DIELECTRIC}"), ellipse);
    let (mut count, mut places, sections) = (0usize, 0usize, 16u32);
    for seed in 0..sections {
        let section = PlySection::generate(&spec, u64::from(seed)).unwrap();
        let second = section.fibers.iter().filter(|f| f.second).count();
        // 9 of 30, never another number.
        assert_eq!(second, 9, "seed {seed}");
        count += second;
        places += section.fibers.iter().zip(0..).filter(|(f, _)| f.second).map(|(_, i)| i).sum::<usize>();
        for f in &section.fibers {
            assert_eq!(f.second, matches!(f.outer, Outline::Polyline(_)));
            let turn = (f.angle_rad + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
            assert!(!f.second || turn.abs() < 0.5, "turned by {turn}");
        }
        assert!(section.min_gap_um() >= spec.ply.min_gap_um);
    }
    // Mean place 14.5 of 0 to 29, standard error 8.7/sqrt(144) = 0.72.
    let mean = places as f64 / count as f64;
    assert!((mean - 14.5).abs() < 3.6, "{mean}");
    let odd = yarn(&format!("{CIRCLE}{DIELECTRIC}"), &ellipse.replace("0.3", "0.35"));
    let seconds: Vec<usize> = (0..100)
        .map(|seed| {
            // 10.5 of 30: 10 or 11.
            let section = PlySection::generate(&YarnSpec { ply: loose(&odd), ..odd.clone() }, seed).unwrap();
            section.fibers.iter().filter(|f| f.second).count()
        })
        .collect();
    let mean = seconds.iter().sum::<usize>() as f64 / 100.0;
    assert!(seconds.iter().all(|n| [10, 11].contains(n)) && (mean - 10.5).abs() < 0.25, "{mean}");
}

/// A ply with room, quick to pack.
fn loose(spec: &YarnSpec) -> plywave::spec::PlySpec {
    plywave::spec::PlySpec { radius_um: Some(90.0), packing: plywave::spec::Packing::Lined, ..spec.ply.clone() }
}

/// The walls of each kind are those of its spec: the same path through the same fiber as one of the first and
/// of the second kind, whose lengths differ by the dye alone.
#[test]
fn the_dye_of_second_fibers_scales_their_lengths() {
    let tracer = |second: bool| {
        let fiber = FiberSection {
            center_um: Vector2::zeros(),
            angle_rad: 0.0,
            outer: Outline::Circle { radius_um: 8.0 },
            lumen: None,
            second,
        };
        ScrewTracer::new(&PlySection { fibers: vec![fiber], bound_radius_um: 8.0, twist_per_um: 0.0 }).unwrap()
    };
    let tracers = [tracer(false), tracer(true)];
    let blend = "[blend]\nshare = 0.5\ndye = 0.25\n[blend.fiber]\nshape = { kind = \"circle\", radius_um = 8.0 }\neta = 1.6\nalpha_fiber = 0.2";
    let same = Surfaces::of_spec(&yarn(&format!("{CIRCLE}{DIELECTRIC}"), blend));
    let other = Surfaces::of_spec(&yarn(&format!("{CIRCLE}{DIELECTRIC}"), &blend.replace("eta = 1.6", "eta = 1.3")));
    let (mut seen, mut differ) = (0, 0);
    for k in 0..400 {
        let x = 16.0 * (k as f32 / 400.0 - 0.5);
        let walk = |surfaces: &Surfaces, second: usize| {
            let mut rng = Pcg64Mcg::seed_from_u64(k);
            match trace_path_among(&tracers[second], surfaces, Vector3::new(x, 20.0, 0.0), -Vector3::y(), &mut rng) {
                PathEnd::High { dir, length_um, .. } => Some((dir, length_um)),
                _ => None,
            }
        };
        let (first, second) = (walk(&same, 0), walk(&same, 1));
        assert_eq!(first.map(|f| f.0), second.map(|s| s.0), "x = {x}");
        // The first fiber does not depend on the second's material; light in the second refracts by its own
        // index.
        assert_eq!(walk(&other, 0), first);
        let (Some(first), Some(second)) = (first, second) else { continue };
        assert!((0.25 * first.1 - second.1).abs() < 1e-5 * first.1, "{first:?} {second:?}");
        differ += usize::from(walk(&other, 1) != Some(second));
        seen += 1;
    }
    assert!(seen > 200 && differ == seen, "{differ} of {seen}");
}

/// Dispersion: a table is that of the index at its beam's wavelength, bit for bit; the error of one index
/// over a spectrum is printed and compared with a limit.
#[test]
#[ignore = "slow: 15 s: a table has the index of its wavelength"]
fn a_table_has_the_index_of_its_wavelength() {
    let with = |index: &str, lambda_um: f64| {
        let mut spec = yarn(&format!("{CIRCLE}{index}"), "");
        spec.beam.lambda_um = lambda_um;
        table(&spec, 30_000)
    };
    // An Abbe number of 0.6/(1.91 B) = 32: strong for a polymer.
    let index = "eta = 1.6\ndispersion_um2 = 0.0097";
    let eta = |lambda_um| {
        let fiber: FiberSpec = yarn(&format!("{CIRCLE}{index}"), "").fiber;
        fiber.eta_at(lambda_um)
    };
    let (blue, green, red) = (with(index, 0.45), with(index, 0.55), with(index, 0.65));
    let plain = with(&format!("eta = {:?}", eta(0.45)), 0.45);
    assert_eq!((&blue.high, &blue.refl, &blue.r_d), (&plain.high, &plain.refl, &plain.r_d));
    let ks = green.sigma_per_um.len();
    for (name, t, lambda_um) in [("blue", &blue, 0.45), ("red", &red, 0.65)] {
        let shift = mean_refl(t) - mean_refl(&green);
        let dark = mean_high(t, ks - 1) - mean_high(&green, ks - 1);
        println!(
            "{name}: eta {:.4} for {:.4}, f_refl {shift:+.5}, f_high of black fibers {dark:+.5}",
            eta(lambda_um),
            eta(0.55)
        );
        assert!(shift.abs() < 0.006 && dark.abs() < 0.006, "{name}: {shift} {dark}");
    }
    // Blue is reflected more.
    assert!(mean_refl(&blue) > mean_refl(&red));
}
