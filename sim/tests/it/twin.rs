//! The twin of a cloth. `sim/src/twin/tests.rs` compares its fibers with those of a single ply; here: energy,
//! reciprocity, the mesh's resolution, refusals, and the same bits however a run is cut.

use plywave::Document;
use plywave::cloth::{ClothCurves, ClothYarn, Lattice, PlyCurve};
use plywave::spec::POLYESTER;
use plywave_runs::{Parts, Run, run_part};
use plywave_sim::cloth::measure;
use plywave_sim::twin::{TwinCurves, TwinJob, TwinMesh, TwinOptions, direction, twin};
use plywave_sim::{MAX_INTERACTIONS, SimError};
use plywave_tables::twin::{CLASSES, ClothTwin, SphereBins};
use std::f64::consts::{PI, TAU};

/// Straight yarns along y above straight yarns along x, or a plain weave of both.
#[derive(Clone, Copy)]
struct Yarns {
    /// Periods of the yarns along y, and of those along x [um].
    period_um: [f64; 2],
    /// Yarns along y in the period of those along x, and the other way round.
    count: u32,
    /// Plies of a yarn: left-handed, one turn a period.
    plies: u32,
    radius_um: f64,
    /// Radius of the circle of the plies' axes [um].
    circle_um: f64,
    /// Amplitude of the waves of a plain weave, of an even count [um]; 0 for straight yarns.
    wave_um: f64,
}

impl Yarns {
    /// Touching single plies, in two layers.
    const LAYERS: Yarns =
        Yarns { period_um: [800.0; 2], count: 8, plies: 1, radius_um: 50.0, circle_um: 0.0, wave_um: 0.0 };
    /// Thin yarns of two twisted plies, which almost touch at the crossings.
    const PLAIN: Yarns =
        Yarns { period_um: [540.0, 560.0], count: 2, plies: 2, radius_um: 27.0, circle_um: 27.2, wave_um: 54.5 };

    /// The cell of the two periods.
    fn cell(&self) -> [[f64; 2]; 2] {
        [[self.period_um[1], 0.0], [0.0, self.period_um[0]]]
    }

    /// A point of a ply's axis at the fraction `t` of the period.
    fn point(&self, kind: usize, yarn: u32, ply: u32, t: f64) -> [f64; 3] {
        let (along, length, count) = (1 - kind, self.period_um[kind], f64::from(self.count));
        let spacing = self.period_um[1 - kind] / count;
        let side = [1.0, -1.0][kind];
        let (height, slope) = if self.wave_um > 0.0 {
            let wave = PI * count / length;
            let (sin, cos) = (wave * (t * length - 30.0)).sin_cos();
            let up = if yarn.is_multiple_of(2) { side * self.wave_um } else { -side * self.wave_um };
            (up * cos, -up * wave * sin)
        } else {
            (side * (self.circle_um + self.radius_um), 0.0)
        };
        // Plies lie about the yarn in the plane at right angles to it.
        let (sin, cos) = (TAU * (f64::from(ply) / f64::from(self.plies) - t)).sin_cos();
        let normal = self.circle_um * sin / slope.hypot(1.0);
        // Across is to the left of the way.
        let left = [-1.0, 1.0][kind];
        let mut p = [0.0; 3];
        p[along] = t * length - slope * normal;
        p[kind] = 30.0 + spacing * f64::from(yarn) + left * self.circle_um * cos;
        p[2] = height + normal;
        p
    }

    /// The curves in a cell of the lattice of both periods.
    fn curves(&self, cell_um: [[f64; 2]; 2]) -> ClothCurves {
        let lattice = Lattice::new(cell_um).unwrap();
        let mut cloth = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
        for kind in 0..2 {
            let mut way = [0.0; 2];
            way[1 - kind] = self.period_um[kind];
            let period = lattice.fractions(way[0], way[1]).map(|f| f.round() as i32);
            for yarn in 0..self.count {
                let index = cloth.yarns.len() as u32;
                cloth.yarns.push(ClothYarn { kind: kind as u32, number: yarn as i32, step: [1, 1], period });
                for ply in 0..self.plies {
                    let point = |i: u32| self.point(kind, yarn, ply, f64::from(i) / 64.0);
                    let points: Vec<[f64; 3]> = (0..64).map(point).collect();
                    cloth.curves.push(PlyCurve::through(index, self.radius_um, period, &points, &lattice));
                }
            }
        }
        cloth
    }

    /// The cloth of these curves.
    fn cloth(&self, name: &str, curves: ClothCurves) -> TwinCurves {
        let thin = POLYESTER
            .replace("fibers = 30", "fibers = 7")
            .replace("radius_um = 50.0", "radius_um = 27.0")
            .replace("fiber_pitch_um = 800.0", "fiber_pitch_um = 500.0");
        let spec = if self.radius_um == 27.0 { thin } else { POLYESTER.to_string() };
        TwinCurves::new(name, curves, vec![spec; 2]).unwrap()
    }
}

/// Two straight layers of touching plies, few of them.
fn layers() -> TwinCurves {
    Yarns::LAYERS.cloth("layers", Yarns::LAYERS.curves(Yarns::LAYERS.cell()))
}

/// A plain weave of thin yarns of two twisted plies.
fn plain() -> TwinCurves {
    Yarns::PLAIN.cloth("plain", Yarns::PLAIN.curves(Yarns::PLAIN.cell()))
}

fn options(views: Vec<[f64; 3]>, paths: u64) -> TwinOptions {
    TwinOptions { views, paths, shards: 8, image: 8, ..TwinOptions::default() }
}

fn trace(cloth: &TwinCurves, options: &TwinOptions) -> ClothTwin {
    twin(cloth, options, Run::plain()).unwrap()
}

/// At sigma = 0 every path that is not stopped leaves with its full weight, and hardly any is stopped; sums
/// by bins, by yarns and by plies are the same light.
#[test]
#[ignore = "slow: 7 s: all light comes out"]
fn all_light_comes_out() {
    for (cloth, views) in [
        (layers(), vec![direction(0.0, 0.0), direction(1.2, 0.4)]),
        (plain(), vec![direction(0.6, 2.0), direction(2.5, -1.0)]),
    ] {
        let lattice = Lattice::new(cloth.curves.cell_um).unwrap();
        let overlap = measure(&cloth.curves, &lattice, &[]).unwrap().overlap;
        assert!(overlap < 0.01, "{}: plies overlap by {overlap} of their radius", cloth.name);
        let twin = trace(&cloth, &options(views, 16_000));
        for view in 0..2 {
            let light = twin.light(view, 0);
            let sum = light.reflected + light.transmitted + light.straight + twin.killed[view];
            assert!((sum - 1.0).abs() < 1e-9, "{}: {sum}", cloth.name);
            // One path may be trapped by a smooth ring of reflections; ten would be a leak.
            assert!(twin.killed[view] <= 6e-4, "{}: {} stopped", cloth.name, twin.killed[view]);
            assert!(twin.interactions[view] > 3.0 && twin.interactions[view] < f64::from(MAX_INTERACTIONS));
            let mut before = f64::INFINITY;
            for sigma in 0..3 {
                let light = twin.light(view, sigma);
                let from_face = twin.view(view)[2] > 0.0;
                let (density, _) = twin.distribution(view, sigma);
                let half = |same: bool| -> f64 {
                    let bins = (0..twin.bins.len()).filter(|b| (twin.bins.is_up(*b) == from_face) == same);
                    bins.map(|b| f64::from(density[b])).sum::<f64>() * twin.bins.solid_angle()
                };
                assert!((half(true) - light.reflected).abs() < 1e-5);
                assert!((half(false) - light.transmitted).abs() < 1e-5);
                for classes in [&twin.by_yarns, &twin.by_plies] {
                    let all = &classes[(view * 3 + sigma) * 2 * CLASSES..][..2 * CLASSES];
                    assert!((all[..CLASSES].iter().sum::<f64>() - light.reflected).abs() < 1e-9);
                    assert!((all[CLASSES..].iter().sum::<f64>() - light.transmitted).abs() < 1e-9);
                }
                assert!(light.reflected + light.transmitted < before);
                before = light.reflected + light.transmitted;
            }
        }
        if cloth.name == "plain" {
            // Light that hit one yarn may have hit both of its plies.
            let one = |classes: &[f64]| classes[0] + classes[CLASSES];
            assert!(one(&twin.by_yarns) > one(&twin.by_plies) + 0.01);
        }
    }
}

/// Power from a range of directions A into a range B equals that from B into A:
/// `integral over A and B of BSDF cos_a cos_b`. Each range is filled with views; no bin is small, so that the
/// two agree within their standard errors.
#[test]
#[ignore = "slow: 20 s: light is reciprocal"]
fn light_is_reciprocal() {
    let bins = SphereBins { rows: 4, columns: 6 };
    let side = 4;
    // Above: steep along x, grazing along y. Below: steep.
    let ranges = [18, 14, 7];
    let inside = |k: usize| (k as f64 + 0.5) / f64::from(side as u32);
    for cloth in [layers(), plain()] {
        let views: Vec<[f64; 3]> = ranges
            .iter()
            .flat_map(|range| (0..side * side).map(move |i| (range, i)))
            .map(|(range, i)| {
                let w = bins.direction(*range, inside(i / side), inside(i % side)).map(f64::from);
                let norm = w.iter().map(|x| x * x).sum::<f64>().sqrt();
                w.map(|x| x / norm)
            })
            .collect();
        let twin = trace(&cloth, &TwinOptions { bins, ..options(views, 2400) });
        for sigma in [0, 2] {
            // Flux from one range into another, and its variance.
            let flux = |from: usize, to: usize| {
                let mut sum = [0.0; 2];
                for i in 0..side * side {
                    let view = from * side * side + i;
                    let (density, variance) = twin.distribution(view, sigma);
                    let cos = twin.view(view)[2].abs();
                    sum[0] += cos * f64::from(density[ranges[to]]);
                    sum[1] += cos * cos * f64::from(variance[ranges[to]]);
                }
                sum
            };
            // Hardly any light comes through where it is absorbed.
            let pairs = if sigma == 0 { &[(0, 1), (0, 2), (1, 2)][..] } else { &[(0, 1)] };
            for &(a, b) in pairs {
                let ([ab, var_ab], [ba, var_ba]) = (flux(a, b), flux(b, a));
                let se = (var_ab + var_ba).sqrt();
                assert!(se < 0.2 * ab, "{}: {ab} +- {se} tells nothing", cloth.name);
                let what = format!("{}, sigma {sigma}, {} and {}", cloth.name, ranges[a], ranges[b]);
                assert!((ab - ba).abs() < 5.0 * se, "{what}: {ab} there, {ba} back, standard error {se}");
            }
        }
    }
}

/// Twice as fine a mesh gives the same light.
#[test]
#[ignore = "slow: 35 s: the mesh is fine enough"]
fn the_mesh_is_fine_enough() {
    let (cloth, views) = (plain(), vec![direction(0.0, 0.0), direction(1.0, 0.7)]);
    let standard = options(views, 40_000);
    let fine = TwinMesh { outline_points: 48, turn_rad: 0.1, step_um: 10.0 };
    let (a, b) = (trace(&cloth, &standard), trace(&cloth, &TwinOptions { mesh: fine, ..standard }));
    for view in 0..2 {
        for sigma in 0..3 {
            let (x, y) = (a.light(view, sigma), b.light(view, sigma));
            let ([rx, tx], [ry, ty]) = (a.standard_errors(view, sigma), b.standard_errors(view, sigma));
            for (got, want, se) in
                [(x.reflected, y.reflected, rx.hypot(ry)), (x.transmitted, y.transmitted, tx.hypot(ty))]
            {
                // The measured error of 24 points about a circle is 0.002 of the light.
                assert!((got - want).abs() < 4.0 * se + 0.003, "view {view}, sigma {sigma}: {got} against {want}");
            }
            assert!((x.straight - y.straight).abs() < 0.012, "{} against {}", x.straight, y.straight);
        }
    }
}

/// The same bits on any number of threads, and from separately run parts; the cloth is rebuilt from its text.
#[test]
#[ignore = "slow: 5 s: bits do not depend on how the run is cut"]
fn bits_do_not_depend_on_how_the_run_is_cut() {
    let cloth = plain();
    let options =
        TwinOptions { repeats: Some([2, 2]), ..options(vec![direction(0.3, 0.0), direction(2.0, 1.0)], 1000) };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| trace(&cloth, &options))
    };
    let whole = on(1);
    assert_eq!(whole, on(3));
    assert_eq!(ClothTwin::from_bytes(&whole.to_bytes().unwrap(), "twin").unwrap(), whole);
    let folder = tempfile::tempdir().unwrap();
    let job = TwinJob::new(TwinCurves::parse(cloth.text()).unwrap().unwrap(), &options).unwrap();
    let paths: Vec<_> = (1..=3).map(|k| folder.path().join(format!("{k}.pwp"))).collect();
    for (k, path) in paths.iter().enumerate() {
        run_part(&job, (k + 1, 3), path, Run::plain()).unwrap();
    }
    let parts = Parts::open(&paths).unwrap();
    let rebuilt = TwinJob::from_description(parts.description()).unwrap();
    assert_eq!(parts.merge(&rebuilt).unwrap(), whole);
}

/// Curves out of range are refused, and domains of more repeats than can be traced, both quickly.
#[test]
fn impossible_cloth_is_refused() {
    let mut broken = Yarns::PLAIN.curves(Yarns::PLAIN.cell());
    broken.curves[0].control_um[3][2] = f64::NAN;
    let text = TwinCurves::new("cloth", broken, vec![POLYESTER.into(); 2]).unwrap_err().to_string();
    assert!(text.contains("curve[0].control_um") && !text.contains('\n'), "{text}");
    let long = TwinOptions { repeats: Some([1 << 20, 1]), ..TwinOptions::default() };
    let refused = TwinJob::new(plain(), &long).err();
    assert!(matches!(refused, Some(SimError::Option { name: "repeats", .. })), "{refused:?}");
}

/// Fibers close over the domain: the turns along a ply change by half a turn or less, and pitches that a
/// domain holds nearly whole by less than a tenth.
#[test]
fn domains_close() {
    let domain = |cloth: TwinCurves, repeats| {
        TwinJob::new(cloth, &TwinOptions { repeats, ..TwinOptions::default() }).unwrap().domain().clone()
    };
    for cloth in [plain(), layers()] {
        let domain = domain(cloth.clone(), None);
        assert_eq!(domain.pitches.len(), 2, "{domain:?}");
        let lattice = Lattice::new(cloth.curves.cell_um).unwrap();
        for (kind, pitch) in domain.pitches.iter().enumerate() {
            let of_kind = |curve: &&PlyCurve| cloth.curves.yarns[curve.yarn as usize].kind as usize == kind;
            let curve = cloth.curves.curves.iter().find(of_kind).unwrap();
            let length = curve.length_um(&lattice) * f64::from(domain.repeats[1 - kind]);
            // Chords from ring to ring are a little shorter than the curve.
            let change = (length / pitch.spec_um - length / pitch.used_um).abs();
            assert!(change < 0.505, "{pitch:?}: {change} turns");
            if cloth.name == "layers" {
                assert!((pitch.spec_um / pitch.used_um - 1.0).abs() <= 0.1, "{pitch:?}");
            }
        }
        assert!(domain.yarns.iter().all(|n| *n >= 4));
    }
    let given = domain(plain(), Some([1, 3]));
    assert_eq!((given.repeats, given.yarns), ([1, 3], [2, 6]));
    assert_eq!(given.size_um, [560.0, 1620.0]);
    // Fibers of straight plies make whole turns over their sides of the domain.
    let given = domain(layers(), Some([3, 2]));
    for (pitch, side) in given.pitches.iter().zip([given.size_um[1], given.size_um[0]]) {
        let turns = side / pitch.used_um;
        assert!((turns - turns.round()).abs() < 1e-9 && turns > 0.5, "{turns} turns");
    }
}

/// The cloth turned by a quarter: x becomes y.
fn turned(curves: &ClothCurves) -> ClothCurves {
    let mut turned = curves.clone();
    turned.cell_um = curves.cell_um.map(|[x, y]| [-y, x]);
    for point in turned.curves.iter_mut().flat_map(|curve| &mut curve.control_um) {
        (point[0], point[1]) = (-point[1], point[0]);
    }
    turned
}

/// The same yarns scatter the same light in a rectangular cell and in a sheared one, within the standard
/// errors, and nearly the same when the cloth turns under the light, as other packings then lie elsewhere.
#[test]
#[ignore = "slow: 60 s: light does not depend on the cell or the axes"]
fn light_does_not_depend_on_the_cell_or_the_axes() {
    let views = vec![direction(0.0, 0.0), direction(0.9, 0.7), direction(1.2, 1.6), direction(2.5, -1.0)];
    let one = Yarns { period_um: [100.0; 2], count: 1, ..Yarns::LAYERS };
    let plied = Yarns { period_um: [500.0; 2], count: 4, wave_um: 0.0, ..Yarns::PLAIN };
    for (name, yarns, side) in [("layers", one, 8), ("plied", plied, 3), ("plain", Yarns::PLAIN, 3)] {
        let [[x, _], [_, y]] = yarns.cell();
        let curves = yarns.curves(yarns.cell());
        let sheared = yarns.cloth(name, yarns.curves([[x, 3.0 * y], [0.0, y]]));
        let turned = yarns.cloth(name, turned(&curves));
        let options = TwinOptions { repeats: Some([side; 2]), ..options(views.clone(), 40_000) };
        let views = views.iter().map(|[x, y, z]| [-y, *x, *z]).collect();
        let a = trace(&yarns.cloth(name, curves), &options);
        let b = trace(&sheared, &options);
        let c = trace(&turned, &TwinOptions { views, ..options.clone() });
        assert_eq!(a.repeat_um, b.repeat_um);
        for view in 0..a.view_count() {
            for twin in [&a, &b, &c] {
                let sum = twin.light(view, 0);
                let all = sum.reflected + sum.transmitted + sum.straight + twin.killed[view];
                assert!((all - 1.0).abs() < 1e-9 && twin.killed[view] < 6e-4, "{name}: {all} {}", twin.killed[view]);
            }
            for sigma in 0..3 {
                let [one, other, third] = [&a, &b, &c].map(|twin| twin.light(view, sigma));
                println!("{name}, view {view}, sigma {sigma}: {one:.4?} {other:.4?} {third:.4?}");
                let ([ra, ta], [rb, tb]) = (a.standard_errors(view, sigma), b.standard_errors(view, sigma));
                let straight = (2.0 * one.straight * (1.0 - one.straight) / a.paths[view] as f64).sqrt();
                for (one, other, third, se) in [
                    (one.reflected, other.reflected, third.reflected, ra.hypot(rb)),
                    (one.transmitted, other.transmitted, third.transmitted, ta.hypot(tb)),
                    (one.straight, other.straight, third.straight, straight),
                ] {
                    let what = format!("{name}: view {view}, sigma {sigma}: {one}, {other}, {third}");
                    assert!((one - other).abs() <= 4.0 * se, "{what}, standard error {se}");
                    // Packings differ, and each yarn has one.
                    assert!((one - third).abs() < 0.012, "{what}");
                }
            }
        }
    }
}

#[test]
fn curves_without_their_plies_are_refused() {
    let yarns = Yarns { period_um: [100.0; 2], count: 1, ..Yarns::LAYERS };
    let cloth = yarns.curves(yarns.cell());
    let refused =
        |curves: &ClothCurves, specs: Vec<String>| TwinCurves::new("x", curves.clone(), specs).unwrap_err().to_string();
    let spec = POLYESTER.to_string();
    let message = refused(&cloth, vec![spec.clone()]);
    assert!(message.contains("give a spec for kind 1"), "{message}");
    let thin = spec.replace("radius_um = 50.0", "radius_um = 48.0").replace("fibers = 30", "fibers = 20");
    let message = refused(&cloth, vec![spec.clone(), thin]);
    assert!(message.contains("radii of 48 and 48 um"), "{message}");
    let mut skew = cloth.clone();
    skew.cell_um = [[100.0, 0.0], [100.0 / PI, 100.0]];
    let message = refused(&skew, vec![spec.clone(), spec.clone()]);
    assert!(message.contains("make a rectangle"), "{message}");
    // Its text says all that it needs.
    let whole = TwinCurves::new("x", cloth, vec![spec.clone(), spec]).unwrap();
    let again = TwinCurves::parse(whole.text()).unwrap().unwrap();
    assert_eq!(again.text(), whole.text());
    assert!(TwinCurves::parse("{}").is_none());
}
