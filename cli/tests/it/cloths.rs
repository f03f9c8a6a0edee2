//! Cloths that ship as scattering functions and as pictures, and the models that ship.
//!
//! 1. Light: clear cloths in a white room are white, through the renderer. 2. eval, sample and pdf agree at
//!    random points; chi-square.
//! 3. The mean over speckle is the smooth picture. 4. No line shows where the cell repeats, nor where blocks
//!    of the fit meet.

use glam::Vec3;
use plywave::cloth::{ClothData, ClothOptions};
use plywave::frame::direction;
use plywave::spec::YarnSpec;
use plywave::{Bsdf, ClothModel, ClothQuery, PlyModel, PlyQuery};
use plywave_check::check_bsdf;
use plywave_pipeline::{ClothRecipe, Run as Making, model_library};
use plywave_render::{Camera, Environment, Film, FilmView, Light, Mesh, RenderOptions, Scene, Setup, render};
use plywave_runs::Run;
use plywave_wave::noise::NoiseOptions;
use plywave_wave::{SpeckleOptions, speckle};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::f32::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, OnceLock};

/// Cloths whose p-values are looked at together: those of the tests below.
const CLOTHS: usize = 3;
const YARNS: [&str; 8] =
    ["polyester", "cotton", "cotton_2ply", "cotton_3ply", "cotton_4ply", "silk", "wool", "wool_2ply"];
const LAMBDA: [f32; 4] = [0.42, 0.52, 0.6, 0.68];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics")
}

/// Models that ship.
fn models() -> &'static [Arc<PlyModel>] {
    static MODELS: OnceLock<Vec<Arc<PlyModel>>> = OnceLock::new();
    let load = |yarn: &&str| Arc::new(PlyModel::load(folder().join(format!("models/{yarn}.pwm"))).unwrap());
    MODELS.get_or_init(|| YARNS.iter().map(load).collect())
}

/// A cloth that ships, made once, without the mean over the cell.
fn woven(name: &'static str) -> Arc<ClothData> {
    type Once = Arc<OnceLock<Arc<ClothData>>>;
    static WOVEN: Mutex<BTreeMap<&str, Once>> = Mutex::new(BTreeMap::new());
    let once = WOVEN.lock().unwrap().entry(name).or_default().clone();
    let make = || {
        let recipe = ClothRecipe::load(folder().join(format!("cloths/{name}.toml"))).unwrap();
        let models = recipe.plies(&model_library()).unwrap().build(&Making::plain()).unwrap().models;
        let curves = recipe.curves(&Making::plain()).unwrap();
        Arc::new(recipe.make(&curves, &models, false, &Making::plain()).unwrap())
    };
    once.get_or_init(make).clone()
}

pub fn cloth(name: &'static str, options: &ClothOptions) -> ClothModel {
    ClothModel::from_data((*woven(name)).clone(), options).unwrap()
}

fn rendered(scene: &Scene, camera: &Camera, cloth: &ClothModel, side: u32, options: &RenderOptions) -> Film {
    let mut film = Film::new(side, side).unwrap();
    render(scene, camera, cloth, &mut film, options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
    film
}

/// Mean and standard error of independent numbers.
fn mean(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// Y of the pixels of a film.
fn luminances(film: &Film) -> Vec<f64> {
    let at = |k: u32| f64::from(film.xyz(FilmView::Light, k % film.width(), k / film.width())[1]);
    (0..film.width() * film.height()).map(at).collect()
}

fn clear_in_a_white_room(name: &'static str) {
    let cloth = cloth(name, &ClothOptions { sigma_per_um: Some(0.0), ..ClothOptions::default() });
    // Far from the sheet, so that all of the picture is cloth: from the face, from the face at 70 degrees,
    // from the back; then folds, where light goes from cloth to cloth.
    let s = 30.0f32;
    let seen = |x: f32, z: f32| Camera::new(Vec3::new(x, 0.0, z) * (4.0 * s), Vec3::ZERO, Vec3::Y, 0.06);
    let views = [("face", seen(0.3, 0.95)), ("oblique", seen(0.94, 0.34)), ("back", seen(0.5, -0.87))];
    for (view, camera) in &views {
        let (scene, _) = Setup::Furnace.scene(s, None, None);
        let options = RenderOptions { samples: 256, depth: 64, seed: 1 };
        let (y, se) = mean(&luminances(&rendered(&scene, camera, &cloth, 32, &options)));
        println!("{name}, {view}: {y:.4} +- {se:.4}");
        assert!(se < 0.002 && (y - 1.0).abs() < 0.01, "{name}, {view}: {y} +- {se}");
    }
    let (scene, camera) = Setup::Furnace.scene(s, Some(Mesh::folded(s)), None);
    let options = RenderOptions { samples: 128, depth: 256, seed: 2 };
    let film = rendered(&scene, &camera, &cloth, 32, &options);
    // The sheet does not fill the picture, and the room is white as well.
    let (y, se) = mean(&luminances(&film));
    println!("{name}, folds: {y:.4} +- {se:.4}");
    assert!(se < 0.002 && (y - 1.0).abs() < 0.01, "{name}, folds: {y} +- {se}");
}

mod clear_cloths_in_a_white_room_are_white {
    use super::clear_in_a_white_room;

    #[test]
    #[ignore = "slow: 20 s: a clear cloth in a white room is white, jersey"]
    fn jersey() {
        clear_in_a_white_room("jersey");
    }

    #[test]
    #[ignore = "slow: 20 s: a clear cloth in a white room is white, organza"]
    fn organza() {
        clear_in_a_white_room("organza");
    }

    #[test]
    #[ignore = "slow: 30 s: a clear cloth in a white room is white, satin"]
    fn satin() {
        clear_in_a_white_room("satin");
    }
}

/// Directions within 70 degrees of the normal, from both sides.
fn viewer(rng: &mut Pcg64Mcg) -> [f32; 3] {
    let z = 0.35 + 0.65 * rng.random::<f32>();
    let w = direction(z.asin(), TAU * rng.random::<f32>());
    if rng.random::<bool>() { w } else { [w[0], w[1], -w[2]] }
}

fn eval_sample_and_pdf_agree(name: &'static str) {
    const POINTS: usize = 10_000;
    const TESTED: usize = 10;
    let mut least = 1.0f64;
    let f = cloth(name, &ClothOptions::default());
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    let mut draw = || {
        let [u, v]: [f32; 2] = rng.random();
        (5e4 * u, 5e4 * v, viewer(&mut rng), rng.random::<[f32; 3]>())
    };
    let (mut worst, mut off) = (0.0f32, Vec::new());
    for _ in 0..POINTS {
        let (x, y, w, u) = draw();
        let at = f.at(&ClothQuery::new([x, y], w, LAMBDA));
        let albedo = at.albedo();
        let weight = at.sample(u).direction().map_or([0.0; 4], |s| {
            let (f, pdf) = (at.eval(s.w), at.pdf(s.w));
            for k in 0..4 {
                worst = worst.max((s.weight[k] * s.pdf - f[k]).abs() / (f[k] + 1e-3));
            }
            worst = worst.max((s.pdf - pdf).abs() / (pdf + 1e-3));
            s.weight
        });
        off.push([0, 1, 2, 3].map(|k| f64::from(weight[k] - albedo[k])));
    }
    assert!(worst < 2e-3, "{name}: weight times pdf against eval: {worst}");
    for k in 0..4 {
        let (bias, se) = mean(&off.iter().map(|o| o[k]).collect::<Vec<_>>());
        println!("{name}, {} um: sampled energy less albedo {bias:.4} +- {se:.4}; weight, eval {worst:.1e}", LAMBDA[k]);
        // Apertures of a few um keep less than all by the Kirchhoff integral; albedo counts all.
        assert!(bias.abs() < 0.005 + 4.0 * se && se < 0.02, "{name}: sampled energy less albedo {bias} +- {se}");
    }
    for _ in 0..TESTED {
        let (x, y, w, _) = draw();
        let at = f.at(&ClothQuery::new([x, y], w, LAMBDA));
        // Panels of the integrals: by two thirds of the width the p-values are the same to 0.02.
        let r = check_bsdf(&at, [0.009, 0.018], 20_000, &mut || draw().3[0]);
        assert!(r.weight_error < 1e-3, "{name} at {x}, {y}, {w:?}: {r:?}");
        least = least.min(r.chi2_p);
    }
    let tests = (CLOTHS * TESTED) as f64;
    println!("{name}: least p-value of {tests}: {least:.5}");
    assert!(least > 0.01 / tests, "{name}: least p-value {least}");
}

mod eval_sample_and_pdf_agree_at_random_points {
    use super::eval_sample_and_pdf_agree;

    #[test]
    #[ignore = "slow: 15 s: eval sample and pdf agree, jersey"]
    fn jersey() {
        eval_sample_and_pdf_agree("jersey");
    }

    #[test]
    #[ignore = "slow: 15 s: eval sample and pdf agree, organza"]
    fn organza() {
        eval_sample_and_pdf_agree("organza");
    }

    #[test]
    #[ignore = "slow: 30 s: eval sample and pdf agree, satin"]
    fn satin() {
        eval_sample_and_pdf_agree("satin");
    }
}

#[test]
#[ignore = "slow: 20 s: the mean over speckle is the smooth picture"]
fn the_mean_over_speckle_is_the_smooth_picture() {
    const INSTANCES: usize = 64;
    const SIDE: u32 = 12;
    let jersey = woven("jersey");
    let mut data = jersey.models[0].data().clone();
    let spec = YarnSpec::parse(&data.spec_text, "spec").unwrap();
    let options = SpeckleOptions { instances: 8, lambda_um: vec![0.4, 0.55, 0.7], ..SpeckleOptions::default() };
    let patterns = speckle(&spec, &data.spec_text, &options, Run::plain()).unwrap();
    let options = NoiseOptions { w0_um: spec.beam.w0_um, ..NoiseOptions::default() };
    data.noise = Some(plywave_wave::noise::noise_spectrum(&patterns, &options, "patterns").unwrap().0);
    let model = Arc::new(PlyModel::from_data(data).unwrap());
    let of = |noise: bool| {
        let mut data = (*jersey).clone();
        data.models = vec![model.clone()];
        // Other cells have other fibers too.
        ClothModel::from_data(data, &ClothOptions { noise, relief: false, ..ClothOptions::default() }).unwrap()
    };
    let (smooth, noised) = (of(false), of(true));
    // A few yarns lit by a small lamp from the front. Other cells have other speckle and
    // nothing else: the same samples of a pixel see the same plies.
    let [[width, _], [_, height]] = smooth.cell_um();
    let repeat = [width, height].map(|r| r as f32);
    let film = |cloth: &ClothModel, instance: usize| {
        let mut mesh = Mesh::flat(1.0);
        for uv in &mut mesh.uv_um {
            *uv = [uv[0] + repeat[0] * (3 * instance) as f32, uv[1] + repeat[1] * (2 * instance) as f32];
        }
        let lamp = Light::facing(Vec3::new(0.3, 1.0, 2.0), Vec3::ZERO, 0.05, 1000.0);
        let scene = Scene::new(mesh, vec![lamp], Environment::constant(0.0));
        let camera = Camera::new(Vec3::new(0.0, -0.6, 2.0), Vec3::ZERO, Vec3::Y, 0.2);
        luminances(&rendered(&scene, &camera, cloth, SIDE, &RenderOptions { samples: 24, depth: 2, seed: 1 }))
    };
    let want = film(&smooth, 0);
    let shifted = film(&smooth, 5);
    let scale = want.iter().sum::<f64>() / want.len() as f64;
    // Single precision of the coordinates moves a few samples over an edge.
    let drift = want.iter().zip(&shifted).map(|(a, b)| (a - b).abs()).sum::<f64>() / (want.len() as f64 * scale);
    assert!(drift < 2e-3, "other repeats look other by {drift}");
    let films: Vec<Vec<f64>> = (0..INSTANCES).map(|k| film(&noised, k)).collect();
    // Of the whole picture.
    let of_all: Vec<f64> = films.iter().map(|f| f.iter().sum::<f64>() / (f.len() as f64 * scale) - 1.0).collect();
    let (bias, se) = mean(&of_all);
    // Of each pixel, in its standard errors.
    let z: Vec<f64> = (0..want.len())
        .map(|p| {
            let (m, se) = mean(&films.iter().map(|f| f[p]).collect::<Vec<_>>());
            (m - want[p]) / (se + 1e-6 * scale)
        })
        .collect();
    let spread = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
    let worst = z.iter().fold(0.0f64, |w, z| w.max(z.abs()));
    // No light is seen in gaps.
    let lit: Vec<usize> = (0..want.len()).filter(|p| want[*p] > 0.0).collect();
    let contrast = lit
        .iter()
        .map(|&p| {
            let (m, se) = mean(&films.iter().map(|f| f[p]).collect::<Vec<_>>());
            se * (INSTANCES as f64).sqrt() / m
        })
        .sum::<f64>()
        / lit.len() as f64;
    println!(
        "picture {bias:+.4} +- {se:.4}; pixels: rms {spread:.2} standard errors, worst {worst:.1}; contrast {contrast:.3}"
    );
    assert!(bias.abs() < 4.0 * se + 1e-3 && se < 0.02, "picture: {bias} +- {se}");
    assert!(spread < 1.4 && worst < 6.0, "pixels: rms {spread} standard errors, worst {worst}");
    assert!(contrast > 0.02, "the noise does not show: {contrast}");
}

/// A step over the border of a cell is as one anywhere: the light at a point moved by vectors of the cell is
/// that at the point, to single precision of its place.
#[test]
fn cells_show_no_line() {
    // Each yarn has fibers of its own.
    let f = cloth("jersey", &ClothOptions { relief: false, ..ClothOptions::SMOOTH });
    let cell = f.cell_um();
    let lights: Vec<[f32; 3]> = (0..6).map(|k| direction(0.5 + 0.15 * k as f32, 1.1 * k as f32)).collect();
    let w = direction(1.25, 0.4);
    let seen = |[x, y]: [f64; 2]| -> f64 {
        let at = f.at(&ClothQuery::new([x as f32, y as f32], w, LAMBDA));
        lights.iter().map(|l| f64::from(at.eval(*l)[1])).sum()
    };
    let (mut off, mut level) = (0.0f64, 0.0f64);
    for k in 0..2000 {
        let even = |step: f64| (0.5 + f64::from(k) * step).fract();
        // About the borders, and everywhere.
        let place = [even(0.754_877_67), even(0.569_840_29)].map(|u| if k % 2 == 0 { u } else { 0.01 * (u - 0.5) });
        let at = |i: f64, j: f64| [0, 1].map(|axis| (place[0] + i) * cell[0][axis] + (place[1] + j) * cell[1][axis]);
        let here = seen(at(0.0, 0.0));
        for (i, j) in [(1.0, 0.0), (0.0, 1.0), (-3.0, 2.0)] {
            off += (seen(at(i, j)) - here).abs() / 6000.0;
        }
        level += here / 2000.0;
    }
    println!("moved by cells the light differs by {:.2e} of itself", off / level);
    assert!(off < 2e-3 * level, "{off} of {level}");
}

#[test]
fn blocks_of_the_fit_show_no_line() {
    for (yarn, model) in YARNS.iter().zip(models()) {
        let d = model.data();
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let (last_theta, last_h) = (*d.theta_i.last().unwrap() as f32, *d.h_um.last().unwrap() as f32);
        let (rows, columns) = (d.theta_i.len(), d.h_um.len());
        let cell = [last_theta / (rows - 1) as f32, 2.0 * last_h / (columns - 1) as f32];
        // A lamp of 6 degrees, as the eye or a pixel never sees one direction alone.
        let lamp = |w: [f32; 3]| -> Vec<[f32; 3]> {
            (0..12)
                .map(|k| {
                    let (r, a) = (0.05 * ((k as f32 + 0.5) / 12.0).sqrt(), 2.4 * k as f32);
                    let v = [w[0] + r * a.cos(), w[1] + r * a.sin(), w[2] + r * (a + 1.0).cos()];
                    let n = v.iter().map(|v| v * v).sum::<f32>().sqrt();
                    v.map(|v| v / n)
                })
                .collect()
        };
        let seen = |theta: f32, h: f32, lamp: &[[f32; 3]]| -> f64 {
            let f = |l: &[f32; 3]| f64::from(model.at(&PlyQuery::lobes(theta, h, [0.003])).eval(*l)[0]);
            lamp.iter().map(f).sum::<f64>() / lamp.len() as f64
        };
        // Steps over the borders of blocks (every second node), and beside them. Over a step near 0 only what
        // is not continuous is left; over half a cell, 3 um across the ply, it stands beside what differs
        // from there to there anyway.
        for (share, what) in [(1.0 / 64.0, "least"), (0.5, "pixel")] {
            let (mut border, mut away, mut level) = ([0.0f64; 2], [0.0f64; 2], 0.0f64);
            let n = 2000;
            for _ in 0..n {
                let lamp = lamp(direction(0.4 * TAU * (rng.random::<f32>() - 0.5), 0.5 * TAU * rng.random::<f32>()));
                let mut node =
                    |count: usize| 2.0 * (1 + (rng.random::<f32>() * (count / 2 - 1) as f32) as usize) as f32;
                let at = [node(rows) * cell[0], node(columns) * cell[1] - last_h];
                let any = [rng.random::<f32>() * last_theta, (rng.random::<f32>() - 0.5) * 1.4 * last_h];
                let over = |axis: usize, place: f32| {
                    let mut ends = [any; 2];
                    ends[0][axis] = place - 0.5 * share * cell[axis];
                    ends[1][axis] = place + 0.5 * share * cell[axis];
                    (seen(ends[1][0], ends[1][1], &lamp) - seen(ends[0][0], ends[0][1], &lamp)).powi(2)
                };
                for axis in 0..2 {
                    border[axis] += over(axis, at[axis]);
                    // Next to the border on both sides: a line is a step that stands out from those beside
                    // it. Farther off, one would compare the rim, where light falls off steeply whether a
                    // border lies there or not.
                    let half = 0.5 * cell[axis];
                    away[axis] += 0.5 * (over(axis, at[axis] - half) + over(axis, at[axis] + half));
                }
                level += seen(any[0], any[1], &lamp).powi(2);
            }
            for (axis, name) in ["theta_i", "h"].into_iter().enumerate() {
                let [b, a] = [border[axis], away[axis]].map(|x| (x / level).sqrt());
                println!(
                    "{yarn}, {name}, {what} step: {b:.4} of the light over borders of blocks, {a:.4} away from them"
                );
                // The piecewise fit is not continuous (Yu 2025, 5.2): neighbors differ by the error of the
                // fit, stored as 4 % rms.
                match what {
                    "least" => assert!(b < 0.06, "{yarn}, {name}: jump of {b} of the light"),
                    _ => assert!(b < 1.3 * a, "{yarn}, {name}: {b} over borders, {a} away from them"),
                }
            }
        }
    }
}
