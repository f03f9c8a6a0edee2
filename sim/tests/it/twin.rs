//! The twin of a cloth. `sim/src/twin/tests.rs` compares its fibers with those of a single ply; here: energy,
//! reciprocity, the mesh's resolution, refusals, and the same bits however a run is cut.

use plywave::cloth::{ClothCurves, ClothYarn, Lattice, PlyCurve};
use plywave::fabric::{Draft, Fabric, YarnShape};
use plywave::spec::{Handedness, POLYESTER};
use plywave::twin::{CLASSES, ClothTwin, SphereBins};
use plywave_sim::runs::{Output, Parts, Run, run_part};
use plywave_sim::twin::{Domain, TwinCloth, TwinCurves, TwinJob, TwinMesh, TwinOptions, direction, twin};
use plywave_sim::{MAX_INTERACTIONS, SimError};
use std::f64::consts::{PI, TAU};

fn shape(plies: u32, radius_um: f64, spacing_um: f64, crimp: f64) -> YarnShape {
    YarnShape {
        plies,
        ply_radius_um: radius_um,
        ply_pitch_um: (plies > 1).then_some(500.0),
        handedness: Handedness::S,
        spacing_um,
        crimp,
        d_cut_um: 0.0,
    }
}

/// Two straight layers of touching plies, few of them.
fn layers() -> TwinCloth {
    let fabric = Fabric::new(Draft::layers(), [shape(1, 50.0, 100.0, 0.5); 2]).unwrap();
    TwinCloth::new("layers", fabric, vec![POLYESTER.into()], [vec![0], vec![0]]).unwrap()
}

/// A plain weave of thin yarns of two twisted plies, touching at the crossings.
fn plain() -> TwinCloth {
    let yarn = POLYESTER
        .replace("fibers = 30", "fibers = 7")
        .replace("radius_um = 50.0", "radius_um = 27.0")
        .replace("fiber_pitch_um = 800.0", "fiber_pitch_um = 500.0");
    let fabric = Fabric::new(Draft::plain(), [shape(2, 27.0, 280.0, 0.4), shape(2, 27.0, 270.0, 0.6)]).unwrap();
    TwinCloth::new("plain", fabric, vec![yarn], [vec![0], vec![0]]).unwrap()
}

fn options(views: Vec<[f64; 3]>, paths: u64) -> TwinOptions {
    TwinOptions { views, paths, shards: 8, image: 8, ..TwinOptions::default() }
}

fn trace(cloth: &TwinCloth, options: &TwinOptions) -> ClothTwin {
    twin(cloth, options, Run::plain()).unwrap()
}

/// At sigma = 0 every path that is not stopped leaves with its full weight, and hardly any is stopped; sums
/// by bins, by yarns and by plies are the same light.
#[test]
fn all_light_comes_out() {
    for (cloth, views) in [
        (layers(), vec![direction(0.0, 0.0), direction(1.2, 0.4)]),
        (plain(), vec![direction(0.6, 2.0), direction(2.5, -1.0)]),
    ] {
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
    let job = TwinJob::new(TwinCloth::parse(cloth.text()).unwrap(), &options).unwrap();
    let paths: Vec<_> = (1..=3).map(|k| folder.path().join(format!("{k}.pwp"))).collect();
    for (k, path) in paths.iter().enumerate() {
        run_part(&job, (k + 1, 3), path, Run::plain()).unwrap();
    }
    let Output::Twin(merged) = Parts::open(&paths).unwrap().output().unwrap() else { panic!("not a twin") };
    assert_eq!(*merged, whole);
}

/// Yarns that intersect are named, with the depth; yarns that bend into themselves too.
#[test]
fn impossible_cloth_is_refused() {
    let refuse = |draft, shapes: [YarnShape; 2]| {
        let fabric = Fabric::new(draft, shapes).unwrap();
        TwinCloth::new("cloth", fabric, vec![POLYESTER.into()], [vec![0], vec![0]]).unwrap_err()
    };
    let error = refuse(Draft::layers(), [shape(1, 50.0, 200.0, 0.3), shape(1, 50.0, 200.0, 0.5)]);
    assert!(matches!(error, SimError::YarnsIntersect { .. }));
    let text = error.to_string();
    assert!(text.contains("warp yarn 0 and weft yarn 0") && text.contains("intersect by 20.0 um"), "{text}");
    assert!(!text.contains('\n') && text.contains("use larger crimps"), "{text}");
    // A straight weft and a warp that goes around it on the shortest path.
    let error = refuse(Draft::plain(), [shape(1, 50.0, 300.0, 1.0), shape(1, 50.0, 150.0, 0.0)]);
    assert!(error.to_string().contains("intersect"), "{error}");
    let parsed = TwinCloth::parse("{}").unwrap_err().to_string();
    assert!(parsed.contains("the text of the cloth"), "{parsed}");
    // A domain of more repeats than can be traced is refused quickly.
    let long = TwinOptions { repeats: Some([1 << 20, 1]), ..TwinOptions::default() };
    let refused = TwinJob::new(plain(), &long).err();
    assert!(matches!(refused, Some(SimError::Option { name: "repeats", .. })), "{refused:?}");
}

/// Pitches close over the domain, and change by less than a tenth.
#[test]
fn domains_close() {
    let cloth = plain();
    let domain = Domain::new(&cloth, None, &TwinMesh::default());
    assert_eq!(domain.pitches.len(), 4, "{domain:?}");
    for pitch in &domain.pitches {
        assert!((pitch.spec_um / pitch.used_um - 1.0).abs() <= 0.1, "{pitch:?}");
        if pitch.of_plies {
            let turns = domain.along_um(pitch.family) / pitch.used_um;
            assert!((turns - turns.round()).abs() < 1e-9 && turns > 0.5, "{turns} turns");
        }
    }
    assert!(domain.yarns.iter().all(|n| *n >= 4));
    let given = Domain::new(&cloth, Some([1, 3]), &TwinMesh::default());
    assert_eq!((given.repeats, given.yarns), ([1, 3], [2, 6]));
    assert_eq!(given.size_um, [560.0, 1620.0]);
}

/// Straight yarns along y above straight yarns along x, `yarns` of each in a cell of these vectors. They have
/// `strands` on helices of this circle, one turn a period.
fn curves(
    cell_um: [[f64; 2]; 2],
    (period, yarns): (f64, u32),
    radius_um: f64,
    circle_um: f64,
    strands: u32,
) -> ClothCurves {
    let lattice = Lattice::new(cell_um).unwrap();
    let mut cloth = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
    for (kind, along) in [1, 0].into_iter().enumerate() {
        let f = lattice.fractions(if along == 0 { period } else { 0.0 }, if along == 1 { period } else { 0.0 });
        let shift = f.map(|f| f.round() as i32);
        for yarn in 0..yarns {
            let index = cloth.yarns.len() as u32;
            cloth.yarns.push(ClothYarn { kind: kind as u32, number: yarn as i32, step: [1, 1], period: shift });
            for strand in 0..strands {
                let points: Vec<[f64; 3]> = (0..64)
                    .map(|i| {
                        let t = f64::from(i) / 64.0;
                        let angle = TAU * (f64::from(strand) / f64::from(strands) - t);
                        let mut p = [0.0; 3];
                        p[along] = t * period;
                        // Left-handed, as the plies of `shape`: across is to the left of the way.
                        let left = if along == 1 { -1.0 } else { 1.0 };
                        p[1 - along] =
                            30.0 + period * f64::from(yarn) / f64::from(yarns) + left * circle_um * angle.cos();
                        p[2] = [1.0, -1.0][kind] * (circle_um + radius_um) + circle_um * angle.sin();
                        p
                    })
                    .collect();
                cloth.curves.push(PlyCurve::through(index, radius_um, shift, &points, &lattice));
            }
        }
    }
    cloth
}

/// Fibers along curves scatter as those of the same yarns in a fabric: of one ply in two layers, also in a
/// sheared cell, and of two twisted plies.
#[test]
#[ignore = "slow: 40 s: curves scatter as the yarns of a fabric"]
fn curves_scatter_as_the_yarns_of_a_fabric() {
    let views = vec![direction(0.0, 0.0), direction(0.9, 0.7), direction(1.2, 1.6), direction(2.5, -1.0)];
    let two = POLYESTER
        .replace("fibers = 30", "fibers = 7")
        .replace("radius_um = 50.0", "radius_um = 27.0")
        .replace("fiber_pitch_um = 800.0", "fiber_pitch_um = 500.0");
    let circle = plywave::spec::ply_circle_um(2, 27.0, Some(500.0)).unwrap();
    let fabric = Fabric::new(Draft::layers(), [shape(2, 27.0, 125.0, 0.5), shape(2, 27.0, 125.0, 0.5)]).unwrap();
    let plied = TwinCloth::new("plied", fabric, vec![two.clone()], [vec![0], vec![0]]).unwrap();
    let square = |spacing: f64| [[spacing, 0.0], [0.0, spacing]];
    for (name, fabric, curves, spec) in [
        ("layers", layers(), curves(square(100.0), (100.0, 1), 50.0, 0.0, 1), POLYESTER.to_string()),
        ("sheared", layers(), curves([[100.0, 300.0], [0.0, 100.0]], (100.0, 1), 50.0, 0.0, 1), POLYESTER.to_string()),
        ("plied", plied, curves(square(500.0), (500.0, 4), 27.0, circle, 2), two),
    ] {
        let of_curves = TwinCurves::new(name, curves, vec![spec.clone(), spec]).unwrap();
        let options = TwinOptions { repeats: Some([4, 4]), ..options(views.clone(), 40_000) };
        let [a, b] =
            [twin(&fabric, &options, Run::plain()).unwrap(), twin(&of_curves, &options, Run::plain()).unwrap()];
        for view in 0..views.len() {
            let sum = b.light(view, 0);
            let all = sum.reflected + sum.transmitted + sum.straight + b.killed[view];
            println!("{name}: stopped {} {}", a.killed[view], b.killed[view]);
            assert!((all - 1.0).abs() < 1e-9 && b.killed[view] < 6e-4, "{name}: {all} {}", b.killed[view]);
            for sigma in 0..3 {
                let (one, other) = (a.light(view, sigma), b.light(view, sigma));
                let off = [
                    one.reflected - other.reflected,
                    one.transmitted - other.transmitted,
                    one.straight - other.straight,
                ];
                println!("{name}, view {view}, sigma {sigma}: {one:.4?} {other:.4?}");
                // Packings differ, and each yarn has one.
                assert!(off.iter().all(|off| off.abs() < 0.012), "{name}: view {view}, sigma {sigma}: {off:?}");
            }
        }
    }
}

#[test]
fn curves_without_their_plies_are_refused() {
    let cloth = curves([[100.0, 0.0], [0.0, 100.0]], (100.0, 1), 50.0, 0.0, 1);
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
    assert!(TwinCurves::parse(layers().text()).is_none());
}
