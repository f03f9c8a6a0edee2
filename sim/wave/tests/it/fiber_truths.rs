//! Opaque, hollow and blended fibers compared with references that share no code with the tracers: Fresnel's
//! formula integrated, a walk through straight circles by quadratic equations in double precision, the sum of
//! single fibers in a dilute ply, and reciprocity.

use nalgebra::{Complex, Vector2, Vector3};
use plywave::optics::{Metal, OpaqueIndex, Reflections};
use plywave::spec::{POLYESTER, YarnSpec};
use plywave_sim::*;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

fn yarn(fiber: &str, more: &str) -> YarnSpec {
    let start = POLYESTER.find("[fiber]").unwrap();
    let end = POLYESTER.find("[ply]").unwrap();
    let text = format!("{}[fiber]\n{fiber}\n{}\n{more}\n", &POLYESTER[..start], &POLYESTER[end..]);
    YarnSpec::parse(&text, "yarn").unwrap_or_else(|e| panic!("{e}"))
}

/// Unpolarized reflectance at the wall of a material of complex index `eta - j kappa`, `eta` relative to
/// where the light is (Born and Wolf, 14.2).
fn reflectance(cos: f64, index: Complex<f64>) -> f64 {
    let m2 = index * index;
    let q = (m2 - (1.0 - cos * cos)).sqrt();
    let s = (Complex::from(cos) - q) / (Complex::from(cos) + q);
    let p = (m2 * cos - q) / (m2 * cos + q);
    0.5 * (s.norm_sqr() + p.norm_sqr())
}

fn complex(index: [f32; 2]) -> Complex<f64> {
    Complex::new(f64::from(index[0]), -f64::from(index[1]))
}

/// A round fiber of the walk by quadratic equations.
struct Round {
    center: Vector2<f64>,
    radius: f64,
    core: f64,
    eta: f64,
    core_eta: f64,
    /// Index of an opaque fiber.
    index: Option<Complex<f64>>,
    absorbs: f64,
    core_absorbs: f64,
}

/// Distances along a ray at which it is on a circle.
fn crossings(q: Vector2<f64>, d: Vector2<f64>, radius: f64) -> Option<[f64; 2]> {
    let (a, b) = (d.norm_squared(), q.dot(&d));
    let disc = b * b - a * (q.norm_squared() - radius * radius);
    (disc > 0.0).then(|| [(-b - disc.sqrt()) / a, (-b + disc.sqrt()) / a])
}

/// Outgoing light: direction, absorbing length, weight by opaque walls. None for light that hits nothing.
fn walk_by_quadratics<R: Rng>(
    fibers: &[Round],
    mut pos: Vector3<f64>,
    mut dir: Vector3<f64>,
    rng: &mut R,
) -> Option<(Vector3<f64>, f64, f64)> {
    const OFF: f64 = 1e-7;
    let (mut length, mut weight, mut met) = (0.0, 1.0, false);
    // The fiber that the light is in, and whether in its core.
    let mut within: Option<(usize, bool)> = None;
    loop {
        let d = dir.xy();
        let next = match within {
            None => (0..fibers.len())
                .filter_map(|f| {
                    let t = crossings(pos.xy() - fibers[f].center, d, fibers[f].radius)?[0];
                    (t > OFF).then_some((t, f, false))
                })
                .min_by(|a, b| a.0.total_cmp(&b.0)),
            Some((f, true)) => crossings(pos.xy() - fibers[f].center, d, fibers[f].core).map(|t| (t[1], f, true)),
            Some((f, false)) => {
                let q = pos.xy() - fibers[f].center;
                let out = crossings(q, d, fibers[f].radius).map(|t| (t[1], f, false));
                let core = crossings(q, d, fibers[f].core).filter(|t| t[0] > OFF).map(|t| (t[0], f, true));
                core.or(out)
            }
        };
        let Some((t, f, inner)) = next else { return met.then_some((dir, length, weight)) };
        met = true;
        let fiber = &fibers[f];
        length += t * match within {
            None => 0.0,
            Some((_, true)) => fiber.core_absorbs,
            Some((_, false)) => fiber.absorbs,
        };
        pos += dir * t;
        let out = (pos.xy() - fiber.center).normalize();
        let mut n = Vector3::new(out.x, out.y, 0.0);
        if dir.dot(&n) > 0.0 {
            n = -n;
        }
        let cos = -dir.dot(&n);
        if let (None, Some(index)) = (within, fiber.index) {
            weight *= reflectance(cos, index);
            dir += n * (2.0 * cos);
            continue;
        }
        // Relative index of the other side, and where the light is beyond the wall.
        let (ratio, beyond) = match (within, inner) {
            (None, _) => (fiber.eta, Some((f, false))),
            (Some((_, true)), _) => (fiber.eta / fiber.core_eta, Some((f, false))),
            (Some((_, false)), true) => (fiber.core_eta / fiber.eta, Some((f, true))),
            (Some((_, false)), false) => (1.0 / fiber.eta, None),
        };
        let sin2 = (1.0 - cos * cos) / (ratio * ratio);
        if sin2 >= 1.0 || rng.random::<f64>() < reflectance(cos, Complex::from(ratio)) {
            dir += n * (2.0 * cos);
        } else {
            dir = dir / ratio + n * (cos / ratio - (1.0 - sin2).sqrt());
            within = beyond;
        }
        dir.normalize_mut();
    }
}

/// The circles of a section, of the kinds of its spec. Opaque ones have the index of the wavelength.
fn rounds(section: &PlySection, spec: &YarnSpec, lambda_um: f64) -> Vec<Round> {
    let of = |f: &FiberSection| {
        let blend = spec.blend.as_ref().filter(|_| f.second);
        let kind = blend.map_or(&spec.fiber, |b| &b.fiber);
        let dye = blend.map_or(1.0, |b| b.dye);
        let radius = |outline: &Outline| match outline {
            Outline::Circle { radius_um } => *radius_um,
            Outline::Polyline(_) => panic!("not a circle"),
        };
        let [core_eta, core_dye] = kind.shape.core();
        Round {
            center: f.center_um,
            radius: radius(&f.outer),
            core: f.lumen.as_ref().map_or(0.0, radius),
            eta: kind.eta_at(lambda_um),
            core_eta,
            index: kind.is_opaque().then(|| Complex::new(kind.eta_at(lambda_um), -kind.kappa_at(lambda_um))),
            absorbs: dye,
            core_absorbs: dye * core_dye,
        }
    };
    section.fibers.iter().map(of).collect()
}

/// A line of light, even over all directions, towards a cylinder: its start and its direction. Latitudes
/// follow cos^2, since the cylinder's projected area is smaller for steep light.
fn even_line<R: Rng>(bound: f64, rng: &mut R) -> (Vector3<f64>, Vector3<f64>) {
    let (sin, cos) = loop {
        let sin: f64 = 2.0 * rng.random::<f64>() - 1.0;
        let cos = (1.0 - sin * sin).sqrt();
        if rng.random::<f64>() < cos {
            break (sin, cos);
        }
    };
    let x = bound * (2.0 * rng.random::<f64>() - 1.0);
    let up = (bound * bound - x * x).max(0.0).sqrt();
    let (s, c) = (TAU * rng.random::<f64>()).sin_cos();
    let turn = |x: f64, y: f64, z: f64| Vector3::new(c * x - s * y, s * x + c * y, z);
    (turn(x, up, 1000.0 * rng.random::<f64>()), turn(0.0, -cos, sin))
}

/// Direction and length of a tracer's walk; none for light that misses.
fn outcome(end: PathEnd) -> Option<(Vector3<f64>, f64)> {
    match end {
        PathEnd::Reflected { dir, .. } => Some((dir.cast(), 0.0)),
        PathEnd::High { dir, length_um, .. } => Some((dir.cast(), f64::from(length_um))),
        PathEnd::Miss => None,
        PathEnd::Killed => panic!("a path was killed"),
    }
}

/// Sums of weights and of their squares, with the standard error of the mean over n.
#[derive(Clone, Copy, Default)]
struct Tally([f64; 2]);

impl Tally {
    fn add(&mut self, w: f64) {
        self.0[0] += w;
        self.0[1] += w * w;
    }

    fn mean(&self, n: f64) -> f64 {
        self.0[0] / n
    }

    fn variance(&self, n: f64) -> f64 {
        (self.0[1] / n - self.mean(n).powi(2)).max(0.0) / n
    }
}

/// The albedo of a smooth wire under light across it is the mean of Fresnel's reflectance over the offset.
/// Under even light it is that over the hemisphere, for each metal at each wavelength, with one length for
/// all.
#[test]
fn wires_keep_what_fresnel_says() {
    let wire = PlySection {
        fibers: vec![FiberSection {
            center_um: Vector2::zeros(),
            angle_rad: 0.0,
            outer: Outline::Circle { radius_um: 8.0 },
            lumen: None,
            second: false,
        }],
        bound_radius_um: 8.0,
        twist_per_um: 0.0,
    };
    let tracer = ScrewTracer::new(&wire).unwrap();
    let spec = yarn("shape = { kind = \"circle\", radius_um = 8.0 }\nmetal = \"gold\"\nalpha_fiber = 0.0", "");
    let surfaces = |index| {
        let outer = Wall::Opaque(RoughConductor { alpha: 0.0, reflections: Reflections::new(index) });
        Surfaces::alike(FiberSurface { outer, ..FiberSurface::new(&spec.fiber, 0.55, 1.0) })
    };
    let n = 20_000;
    for index in [[0.43f32, 2.455], [1.44, 1.85], [2.5, 3.0], [0.13, 3.99]] {
        let walls = surfaces(OpaqueIndex::Fixed(index));
        let sigma = Reflections::new(OpaqueIndex::Fixed(index)).sigma_per_um(0.55);
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let (mut got, mut want) = (0.0, 0.0);
        for i in 0..n {
            // Evenly spread, so that both are the same sum.
            let h = (2.0 * f64::from(i) + 1.0) / f64::from(n) - 1.0;
            let pos = Vector3::new(8.0 * h, 20.0, 0.0).cast();
            let end = trace_path_among(&tracer, &walls, pos, -Vector3::y(), &mut rng);
            got += outcome(end).map_or(0.0, |(_, length)| (-sigma * length).exp()) / f64::from(n);
            want += reflectance((1.0 - h * h).sqrt(), complex(index)) / f64::from(n);
        }
        println!("index {index:?}, lit across: {got:.5}, Fresnel {want:.5}");
        assert!((got - want).abs() < 3e-4, "{index:?}: {got}, want {want}");
    }
    for metal in [Metal::Gold, Metal::Silver, Metal::Aluminium, Metal::Copper] {
        let (walls, of) = (surfaces(OpaqueIndex::Metal(metal)), Reflections::new(OpaqueIndex::Metal(metal)));
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let lengths: Vec<f64> = (0..40_000)
            .filter_map(|_| {
                let (pos, dir) = even_line(8.0, &mut rng);
                outcome(trace_path_among(&tracer, &walls, pos.cast(), dir.cast(), &mut rng)).map(|o| o.1)
            })
            .collect();
        let n = lengths.len() as f64;
        for lambda_um in [0.42, 0.48, 0.52, 0.58, 0.66] {
            let (index, sigma) = (complex(metal.index(lambda_um as f32)), of.sigma_per_um(lambda_um));
            let mut kept = Tally::default();
            lengths.iter().for_each(|l| kept.add((-sigma * l).exp()));
            let want = (0..2000).map(|i| reflectance(((f64::from(i) + 0.5) / 2000.0).sqrt(), index)).sum::<f64>() / 2e3;
            let (got, se) = (kept.mean(n), kept.variance(n).sqrt());
            assert!((got - want).abs() < 5.0 * se + 1e-4, "{metal:?} at {lambda_um}: {got}, want {want}, se {se}");
        }
    }
}

/// Plies of smooth straight circles by the tracer and by quadratic equations: energies at three absorptions,
/// and the light by its turn in azimuth. Silver at one wavelength, hollow fibers, a cuticle about a darker
/// cortex of lower index, a blend of these with full ones.
#[test]
fn straight_plies_are_those_of_quadratic_equations() {
    let circle = |index: &str| format!("shape = {{ kind = \"circle\", radius_um = 7.0 }}\n{index}\nalpha_fiber = 0.0");
    let hollow = |core: &str| {
        format!(
            "shape = {{ kind = \"hollow_circle\", radius_um = 7.5, {core} }}\nsize_jitter = 0.1\nshape_jitter = 0.1\neta = 1.55\nalpha_fiber = 0.0"
        )
    };
    let cuticle = hollow("lumen = 0.8, lumen_eta = 1.4, lumen_dye = 3.0");
    let blend = format!("[blend]\nshare = 0.5\ndye = 0.3\n[blend.fiber]\n{}", circle("eta = 1.35"));
    for (what, spec) in [
        ("silver", yarn(&circle("eta = 0.135\nkappa = 3.988"), "")),
        ("hollow", yarn(&hollow("lumen = 0.5"), "")),
        ("thin wall", yarn(&hollow("lumen = 0.85"), "")),
        ("cuticle", yarn(&cuticle, "")),
        ("blend", yarn(&cuticle, &blend)),
    ] {
        let section = PlySection { twist_per_um: 0.0, ..PlySection::generate(&spec, 2).unwrap() };
        let (tracer, surfaces) = (ScrewTracer::new(&section).unwrap(), Surfaces::of_spec(&spec));
        let circles = rounds(&section, &spec, spec.beam.lambda_um);
        let own = spec.own_sigma_per_um(0.55);
        let sigmas = if spec.fiber.is_opaque() { vec![own] } else { vec![0.0, 0.003, 0.03] };
        let bound = f64::from(tracer.bound_radius_um());
        let n = 30_000;
        const BINS: usize = 12;
        let bin = |a: Vector3<f64>, b: Vector3<f64>| {
            let turn = (b.y.atan2(b.x) - a.y.atan2(a.x)).rem_euclid(TAU);
            ((turn / TAU * BINS as f64) as usize).min(BINS - 1)
        };
        // [sigma][bin]: excess of the tracer; the last bin is of all light, line for line.
        let mut more = vec![[Tally::default(); BINS + 1]; sigmas.len()];
        let mut totals = vec![[0.0; 2]; sigmas.len()];
        let mut killed = 0;
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        for _ in 0..n {
            // Light in steeper fibers is reflected so often that paths end at the limit of interactions.
            let (pos, dir) = loop {
                let (pos, dir) = even_line(bound, &mut rng);
                if dir.z.abs() < 0.95 {
                    break (pos, dir);
                }
            };
            let end = trace_path_among(&tracer, &surfaces, pos.cast(), dir.cast(), &mut rng);
            if matches!(end, PathEnd::Killed) {
                killed += 1;
                continue;
            }
            let traced = outcome(end)
                .map(|(out, length)| (out, sigmas.iter().map(|s| (-s * length).exp()).collect::<Vec<f64>>()));
            let truth = walk_by_quadratics(&circles, pos, dir, &mut rng).map(|(out, length, weight)| {
                let kept = |s: &f64| if own > 0.0 { weight } else { (-s * length).exp() };
                (out, sigmas.iter().map(kept).collect::<Vec<f64>>())
            });
            for k in 0..sigmas.len() {
                let kept = [&traced, &truth].map(|of| of.as_ref().map_or(0.0, |(_, kept)| kept[k]));
                more[k][BINS].add(kept[0] - kept[1]);
                for (walk, of) in [&traced, &truth].into_iter().enumerate() {
                    totals[k][walk] += kept[walk] / f64::from(n);
                    if let Some((out, _)) = of {
                        more[k][bin(dir, *out)].add([1.0, -1.0][walk] * kept[walk]);
                    }
                }
            }
        }
        // The offset from a wall, 1e-3 um, adds up where light skims a smooth core: some ends up held by
        // total reflection. Roughness frees it.
        println!("{what}: {killed} of {n} paths were killed");
        assert!(f64::from(killed) < 3e-4 * f64::from(n), "{what}: {killed} of {n} paths were killed");
        for (k, sigma) in sigmas.iter().enumerate() {
            println!("{what}, sigma {sigma:.5}: {:.4}, by quadratics {:.4}", totals[k][0], totals[k][1]);
            for (b, more) in more[k].iter().enumerate() {
                let (off, se) = (more.mean(f64::from(n)), more.0[1].sqrt() / f64::from(n));
                assert!(
                    off.abs() < 5.0 * se + 1e-5,
                    "{what}, sigma {sigma}, bin {b}: off by {off}, standard error {se}"
                );
            }
        }
    }
}

/// Fibers a hundred times their width apart scatter independently: the energy of a blend is the mean of its
/// two kinds, weighted by the light that hits them.
#[test]
fn dilute_blends_are_the_mixture_of_their_parts() {
    let first = "shape = { kind = \"hollow_circle\", radius_um = 7.5, lumen = 0.5 }\neta = 1.6\nalpha_fiber = 0.2";
    let second = "shape = { kind = \"circle\", radius_um = 5.0 }\neta = 1.4\nalpha_fiber = 0.1";
    let blend = format!("[blend]\nshare = 0.4\ndye = 0.25\n[blend.fiber]\n{second}");
    let both = yarn(first, &blend);
    let fiber = |at: Vector2<f64>, second: bool| FiberSection {
        center_um: at,
        angle_rad: 0.0,
        outer: Outline::Circle { radius_um: if second { 5.0 } else { 7.5 } },
        lumen: (!second).then_some(Outline::Circle { radius_um: 3.75 }),
        second,
    };
    let kept = |fibers: Vec<FiberSection>, spec: &YarnSpec, aims: &[Vector2<f64>], seed| {
        let bound_radius_um = fibers.iter().map(|f| f.center_um.norm() + 7.5).fold(0.0, f64::max);
        let tracer = ScrewTracer::new(&PlySection { fibers, bound_radius_um, twist_per_um: 0.0 }).unwrap();
        let surfaces = Surfaces::of_spec(spec);
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let (mut sums, mut met) = ([Tally::default(); 3], 0.0);
        for k in 0..60_000 {
            // Towards each fiber alike, as wide as the widest: misses count for none.
            let (pos, dir) = even_line(7.6, &mut rng);
            let at = aims[k % aims.len()];
            let pos = pos + Vector3::new(at.x, at.y, 0.0) - dir * 20.0;
            let Some((_, length)) = outcome(trace_path_among(&tracer, &surfaces, pos.cast(), dir.cast(), &mut rng))
            else {
                continue;
            };
            met += 1.0;
            sums.iter_mut().zip([0.003, 0.02, 0.1]).for_each(|(sum, sigma)| sum.add((-sigma * length).exp()));
        }
        sums.map(|sum| (sum.mean(met), sum.variance(met)))
    };
    let places: Vec<Vector2<f64>> = (0..5)
        .map(|i| {
            let (sin, cos) = (TAU * f64::from(i) / 5.0).sin_cos();
            900.0 * Vector2::new(cos, sin)
        })
        .collect();
    let fibers = places.iter().zip(0..).map(|(at, i)| fiber(*at, i >= 3)).collect();
    let mixed = kept(fibers, &both, &places, 1);
    let origin = [Vector2::zeros()];
    let a = kept(vec![fiber(origin[0], false)], &both, &origin, 2);
    let b = kept(vec![fiber(origin[0], true)], &both, &origin, 3);
    // Three of 15 um, two of 10 um.
    let share = 3.0 * 7.5 / (3.0 * 7.5 + 2.0 * 5.0);
    for k in 0..3 {
        let want = share * a[k].0 + (1.0 - share) * b[k].0;
        let se = (mixed[k].1 + a[k].1 + b[k].1).sqrt();
        println!("{:.4} of a blend, {want:.4} of its parts ({:.4}, {:.4})", mixed[k].0, a[k].0, b[k].0);
        // A thousandth of the light hits a second fiber.
        assert!((mixed[k].0 - want).abs() < 5.0 * se + 2e-3, "{:?}, want {want}, standard error {se}", mixed[k]);
        assert!((a[k].0 - b[k].0).abs() > 20.0 * se);
    }
}

/// A ply turned end over end is the same ply, and every path is reversible: light that is even over all
/// directions goes as often from latitude a to b as from b to a, at every turn in azimuth, absorption
/// included.
#[test]
fn plies_of_every_kind_are_reciprocal() {
    let circle = "shape = { kind = \"circle\", radius_um = 7.5 }\nalpha_fiber = 0.3\n";
    let hollow = "shape = { kind = \"hollow_circle\", radius_um = 7.5, lumen = 0.6, lumen_eta = 1.2, lumen_dye = 0.5 }\neta = 1.6\nalpha_fiber = 0.2\n";
    let blend = format!("[blend]\nshare = 0.5\ndye = 2.0\n[blend.fiber]\n{circle}eta = 1.4");
    for (what, mut spec) in
        [("copper", yarn(&format!("{circle}metal = \"copper\""), "")), ("blend", yarn(hollow, &blend))]
    {
        spec.ply.fiber_pitch_um = Some(300.0);
        let section = PlySection::generate(&spec, 6).unwrap();
        let (tracer, surfaces) = (ScrewTracer::new(&section).unwrap(), Surfaces::of_spec(&spec));
        let sigma = if spec.fiber.is_opaque() { spec.own_sigma_per_um(0.5) } else { 0.01 };
        const N: usize = 5;
        let latitude = |d: Vector3<f64>| (((d.z + 1.0) / 2.0 * N as f64) as usize).min(N - 1);
        let mut flux = [[[Tally::default(); 6]; N]; N];
        let mut rng = Pcg64Mcg::seed_from_u64(4);
        let n = 150_000;
        for _ in 0..n {
            let (pos, dir) = even_line(f64::from(tracer.bound_radius_um()), &mut rng);
            let Some((out, length)) = outcome(trace_path_among(&tracer, &surfaces, pos.cast(), dir.cast(), &mut rng))
            else {
                continue;
            };
            let turn = (out.y.atan2(out.x) - dir.y.atan2(dir.x)).rem_euclid(TAU);
            flux[latitude(dir)][latitude(out)][((turn / (PI / 3.0)) as usize).min(5)].add((-sigma * length).exp());
        }
        let (mut worst, mut twisted) = (0.0f64, 0.0f64);
        for a in 0..N {
            for b in 0..a {
                for t in 0..6 {
                    let [there, back] = [flux[a][b][t], flux[b][a][t]];
                    let se = (there.0[1] + back.0[1]).sqrt().max(3.0);
                    worst = worst.max((there.0[0] - back.0[0]).abs() / se);
                    // The opposite turn differs, so the test is sensitive to the twist.
                    let other = flux[b][a][5 - t];
                    twisted = twisted.max((there.0[0] - other.0[0]).abs() / (there.0[1] + other.0[1]).sqrt().max(3.0));
                }
            }
        }
        println!("{what}: {worst:.2} standard errors at most; against the mirror image {twisted:.1}");
        // 60 pairs.
        assert!(worst < 4.5, "{what}: {worst}");
    }
}
