//! Dual scattering compared with path tracing: strands along a ray are counted as by single hits; single
//! scattering equals path tracing; error of the estimate of the rest in layers and fur, and its cost, in one
//! run.
//!
//! `cargo test --release -p plywave-render --test it strand_dual:: -- --nocapture --test-threads 1` prints
//! all of it, the times of one render at a time.

use glam::{DVec3, Vec3};
use plywave_fiber::FiberModel;
use plywave_fiber::dual_scattering::DualOptions;
use plywave_fiber::{KhungurnFiber, KhungurnParameters};
use plywave_render::{
    Basis, Camera, Environment, Film, FilmView, GeneratedStrands, Light, Prop, RenderError, RenderOptions, Shape,
    StrandDual, StrandDualOptions, StrandFiber, StrandHit, StrandScene, StrandShape, StrandTree, Strands, make,
    render_strands, render_strands_dual,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

const RADIUS_UM: f32 = 40.0;

/// Gray fibers of Khungurn's model that transmit the share `tt`.
fn fiber(tt: f32) -> StrandFiber {
    let parameters = KhungurnParameters { c_tt: tt.into(), radius_um: RADIUS_UM, ..KhungurnParameters::default() };
    let model: FiberModel = KhungurnFiber::new(parameters).unwrap().into();
    StrandFiber::new(model)
}

fn scene(what: &GeneratedStrands, tt: f32, sky: f32) -> StrandScene {
    let strands = make(what, 0.001 * RADIUS_UM, 16, 3).unwrap();
    let lamp = Light::facing(Vec3::new(30.0, -25.0, 50.0), Vec3::ZERO, 12.0, 12.0);
    StrandScene::new(strands, StrandShape::Tube, fiber(tt), vec![lamp], Environment::constant(sky))
}

fn by_paths(scene: &StrandScene, camera: &Camera, size: u32, samples: u32, depth: u32) -> (Film, Duration) {
    let mut film = Film::new(size, size).unwrap();
    let options = RenderOptions { samples, depth, seed: 5 };
    let begun = Instant::now();
    render_strands(scene, camera, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
    (film, begun.elapsed())
}

fn prepared(scene: &StrandScene) -> StrandDual<'_> {
    StrandDual::new(scene, &StrandDualOptions::default()).unwrap()
}

fn by_dual(dual: &StrandDual<'_>, camera: &Camera, size: u32, samples: u32) -> (Film, Duration) {
    let mut film = Film::new(size, size).unwrap();
    let shot = RenderOptions { samples, depth: 64, seed: 6 };
    let begun = Instant::now();
    render_strands_dual(dual, camera, &mut film, &shot, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
    (film, begun.elapsed())
}

/// Means of Y over `blocks` x `blocks` parts of a film.
fn blocks(film: &Film, blocks: u32) -> Vec<f64> {
    let side = film.width() / blocks;
    (0..blocks * blocks)
        .map(|b| {
            let (x0, y0) = (b % blocks * side, b / blocks * side);
            let sum = (0..side * side).map(|k| film.xyz(FilmView::Light, x0 + k % side, y0 + k / side)[1]);
            sum.map(f64::from).sum::<f64>() / f64::from(side * side)
        })
        .collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn unit(rng: &mut Pcg64Mcg) -> DVec3 {
    let z = 2.0 * rng.random::<f64>() - 1.0;
    let (s, c) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * c, r * s, z)
}

/// One after the other, each hit passed as a path does.
fn one_by_one(tree: &StrandTree, o: DVec3, w: DVec3, before: f64) -> Vec<StrandHit> {
    let (mut after, mut skips, mut hits) = (0.0, Vec::new(), Vec::new());
    while let Some(hit) = tree.first(o, w, after, before, &skips) {
        after = hit.t;
        let mut skip = hit.leave(w);
        skip.until += hit.t;
        skips.push(skip);
        hits.push(hit);
    }
    hits
}

#[test]
fn strands_are_counted_as_they_are_met() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let bent = GeneratedStrands::Ball { count: 300, ball_mm: 3.0, length_mm: 9.0, curl_mm: 2.0 };
    let fur = GeneratedStrands::Fur { count: 2000, size_mm: 8.0, length_mm: 5.0 };
    let layer = GeneratedStrands::Layer { count: 40, layers: 6, spacing_mm: 0.1, length_mm: 8.0 };
    for (what, shape) in
        [(bent, StrandShape::Tube), (fur, StrandShape::Tube), (layer, StrandShape::Tube), (fur, StrandShape::Band)]
    {
        let tree = StrandTree::new(make(&what, 0.05, 12, 3).unwrap(), shape);
        let (mut rays, mut strands, mut other) = (0, 0, 0);
        let mut found = Vec::new();
        for _ in 0..4000 {
            let (a, b) = (unit(&mut rng) * 9.0, unit(&mut rng) * (4.0 * rng.random::<f64>()));
            let w = (b - a).normalize();
            let before = if rng.random::<bool>() { f64::INFINITY } else { 9.0 };
            let want = one_by_one(&tree, a, w, before);
            tree.each(a, w, 0.0, before, &[], &mut found);
            assert!(found.windows(2).all(|pair| pair[0].t <= pair[1].t), "not in order");
            let same = want.len() == found.len()
                && want.iter().zip(&found).all(|(a, b)| a.strand == b.strand && (a.t - b.t).abs() < 1e-9);
            rays += 1;
            strands += want.len();
            other += usize::from(!same);
        }
        println!("{what:?} {shape:?}: {:.2} strands a ray, {other} of {rays} rays differ", strands as f64 / 4000.0);
        assert!(strands > 4000 && other == 0, "{what:?} {shape:?}: {other} of {rays} rays differ");
    }
}

/// A single strand, with nothing before or behind it, scatters as in path tracing.
#[test]
#[ignore = "slow: 10 s: one strand is that of path tracing"]
fn one_strand_is_that_of_path_tracing() {
    let points: Vec<[f32; 4]> = (0..6).map(|k| [10.0 * k as f32 - 25.0, 0.0, 0.0, 3.0]).collect();
    let lamp = Light::facing(Vec3::new(20.0, 30.0, 40.0), Vec3::ZERO, 25.0, 2.0);
    let mut strands = Strands::new(Basis::BSpline);
    strands.push(&points, "thick", "strand 1").unwrap();
    let scene = StrandScene::new(strands, StrandShape::Tube, fiber(0.8), vec![lamp], Environment::constant(0.4));
    let camera = Camera::new(Vec3::new(0.3, -0.2, 30.0), Vec3::ZERO, Vec3::Y, 0.1);
    let (path, _) = by_paths(&scene, &camera, 16, 4096, 1);
    let (dual, _) = by_dual(&prepared(&scene), &camera, 16, 4096);
    let (want, got) = (mean(&blocks(&path, 1)), mean(&blocks(&dual, 1)));
    println!("one strand: paths {want:.5}, dual {got:.5}");
    // The two are 0.04 % apart; with light drawn from sources alone, whose noise is greater, they were 0.5 %
    // apart.
    assert!((got / want - 1.0).abs() < 0.005, "{got} {want}");
}

/// Error of the estimate, and its cost: its light minus that of path tracing, as a share of the latter. Seeds
/// are fixed, so the same work gives the same numbers. The limit is twice the difference of two strategies
/// for the same estimate, 0.03 (sources alone; sources and lobes). A better estimate fails too:
/// docs/explain/dual_scattering.md has these numbers.
fn is_off_by(name: &str, what: GeneratedStrands, color: &str, tt: f32, told: [f64; 3]) {
    const LIMIT: f64 = 0.06;
    let camera = Camera::new(Vec3::new(4.0, -22.0, 20.0), Vec3::new(0.0, 0.0, 0.5), Vec3::Z, 0.25);
    let scene = scene(&what, tt, 0.1);
    let zinke = StrandDualOptions { dual: DualOptions::default(), behind: false };
    let [zinke, counted] = [zinke, StrandDualOptions::default()].map(|of| StrandDual::new(&scene, &of).unwrap());
    let kinds = [("d 0.7", zinke), ("d 1", counted.with_behind(false)), ("d 1, behind counted", counted)];
    let (path, path_time) = by_paths(&scene, &camera, 32, 64, 200);
    let want = blocks(&path, 8);
    for ((kind, dual), told) in kinds.iter().zip(told) {
        let (film, dual_time) = by_dual(dual, &camera, 32, 64);
        let got = blocks(&film, 8);
        let off: Vec<f64> = want.iter().zip(&got).map(|(w, g)| (g - w).powi(2)).collect();
        let (all, rms) = (mean(&got) / mean(&want) - 1.0, mean(&off).sqrt() / mean(&want));
        println!(
            "{name}, {color}, {kind}: light {:+.0} %, blocks {:.0} %; {:.2} times as fast a sample ({:.2} s for {:.2} s)",
            100.0 * all,
            100.0 * rms,
            path_time.as_secs_f64() / dual_time.as_secs_f64(),
            dual_time.as_secs_f64(),
            path_time.as_secs_f64(),
        );
        assert!((all - told).abs() < LIMIT, "{name}, {color}, {kind}: off by {all:+.3}, told {told:+.3}");
    }
}

/// A test for each color of each, which run in parallel.
mod dual_scattering_is_off_from_path_tracing_by_what_is_told {
    use super::{GeneratedStrands, is_off_by};

    const FUR: GeneratedStrands = GeneratedStrands::Fur { count: 9000, size_mm: 10.0, length_mm: 5.0 };
    const LAYERS: GeneratedStrands =
        GeneratedStrands::Layer { count: 100, layers: 12, spacing_mm: 0.11, length_mm: 30.0 };

    #[test]
    #[ignore = "slow: 25 s: dual scattering is off from path tracing by what the page says, light fur"]
    fn light_fur() {
        is_off_by("fur", FUR, "light", 0.98, [-0.51, -0.26, -0.35]);
    }

    #[test]
    #[ignore = "slow: 25 s: dual scattering is off from path tracing by what the page says, brown fur"]
    fn brown_fur() {
        is_off_by("fur", FUR, "brown", 0.8, [-0.14, 0.20, 0.15]);
    }

    #[test]
    #[ignore = "slow: 25 s: dual scattering is off from path tracing by what the page says, dark fur"]
    fn dark_fur() {
        is_off_by("fur", FUR, "dark", 0.3, [-0.04, 0.08, 0.07]);
    }

    #[test]
    #[ignore = "slow: 25 s: dual scattering is off from path tracing by what the page says, light layers"]
    fn light_layers() {
        is_off_by("layers", LAYERS, "light", 0.98, [-0.26, 0.0, -0.14]);
    }

    #[test]
    #[ignore = "slow: 25 s: dual scattering is off from path tracing by what the page says, brown layers"]
    fn brown_layers() {
        is_off_by("layers", LAYERS, "brown", 0.8, [-0.10, 0.07, 0.06]);
    }

    #[test]
    #[ignore = "slow: 25 s: dual scattering is off from path tracing by what the page says, dark layers"]
    fn dark_layers() {
        is_off_by("layers", LAYERS, "dark", 0.3, [-0.02, -0.01, -0.01]);
    }
}

/// A matte floor under fur is lit through it, and the fur from the floor.
#[test]
#[ignore = "slow: 10 s: floors are lit through strands"]
fn floors_are_lit_through_strands() {
    let mut scene = scene(&GeneratedStrands::Fur { count: 3000, size_mm: 10.0, length_mm: 4.0 }, 0.8, 0.2);
    scene.props.push(Prop { shape: Shape::Floor { height_mm: 0.0 }, albedo: 0.6 });
    let camera = Camera::new(Vec3::new(4.0, -12.0, 30.0), Vec3::ZERO, Vec3::Z, 0.25);
    let (path, _) = by_paths(&scene, &camera, 32, 64, 200);
    let (dual, _) = by_dual(&prepared(&scene), &camera, 32, 64);
    scene.props[0].albedo = 0.0;
    let (black, _) = by_dual(&prepared(&scene), &camera, 32, 64);
    let [want, got, black] = [&path, &dual, &black].map(|film| mean(&blocks(film, 1)));
    println!("fur on a floor: paths {want:.4}, dual {got:.4}, dual over a black floor {black:.4}");
    // Measured: 7 % more light than by paths, where brown fur alone has 15 %; without the floor's light 0.53
    // of it.
    assert!((got / want - 1.07).abs() < 0.08 && (black / got - 0.53).abs() < 0.08, "{want} {got} {black}");
}

#[test]
fn scenes_without_strands_and_bad_options_are_refused() {
    let camera_scene =
        |strands| StrandScene::new(strands, StrandShape::Tube, fiber(0.8), Vec::new(), Environment::constant(1.0));
    let none = camera_scene(Strands::new(Basis::Linear));
    let refused = |scene: &StrandScene, options: &StrandDualOptions| match StrandDual::new(scene, options) {
        Err(RenderError::Strands { what, .. }) => what,
        other => panic!("{:?}", other.err()),
    };
    assert!(refused(&none, &StrandDualOptions::default()).contains("no strands"));
    let some = scene(&GeneratedStrands::Single { length_mm: 3.0 }, 0.8, 1.0);
    let bad = DualOptions { forward_density: 1.5, ..DualOptions::default() };
    let what = refused(&some, &StrandDualOptions { dual: bad, behind: false });
    assert!(what.contains("forward_density"), "{what}");
}
