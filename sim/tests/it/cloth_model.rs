//! The cloth of curves as a surface: energy, reciprocity, samples, its file, and the mean over the cell.

use plywave::Document;
use plywave::bsdf::{Bsdf, BsdfSample};
use plywave::cloth::{ClothData, ClothModel, ClothOptions, ColorOf, GapLight, YarnColor};
use plywave::math::hash::SplitMix64;
use plywave::{ClothQuery, PlyModel};
use plywave_runs::Run;
use plywave_sim::cloth::{Effort, make_cloth, precompute};
use plywave_sim::twin::{TwinCurves, TwinOptions, direction as twin_direction, twin};
use plywave_tables::twin::{ComparisonOptions, compare};
use plywave_textile::ClothSpec;
use std::f32::consts::TAU;
use std::sync::{Arc, LazyLock};

pub fn made(name: &str, plies: &[&str], has_far: bool) -> ClothData {
    let folder = format!("{}/../fabrics", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(format!("{folder}/cloths/{name}.toml")).unwrap();
    let spec = ClothSpec::parse(&text, name).unwrap();
    let made =
        make_cloth(&spec, name, &mut |file| panic!("{file} is not to be read"), Effort::Full, &|_| true).unwrap();
    let models: Vec<Arc<PlyModel>> =
        plies.iter().map(|ply| Arc::new(PlyModel::load(format!("{folder}/models/{ply}.pwm")).unwrap())).collect();
    let effort = if has_far { Effort::Full } else { Effort::Near };
    precompute(&spec, &text, &made.curves, &models, effort, &|_| true).unwrap()
}

/// A knit, a woven cloth of plied yarns, and one under hairs.
pub static JERSEY: LazyLock<ClothData> = LazyLock::new(|| made("jersey", &["cotton_single"], true));
pub static ORGANZA: LazyLock<ClothData> = LazyLock::new(|| made("organza", &["silk_single"; 2], false));
pub static FLANNEL: LazyLock<ClothData> = LazyLock::new(|| made("flannel", &["cotton_single"; 2], true));

/// An even sequence.
pub fn even(k: usize, step: f64) -> f32 {
    (0.5 + k as f64 * step).fract() as f32
}

pub fn direction(z: f32, turn: f32) -> [f32; 3] {
    let (sin, cos) = (TAU * turn).sin_cos();
    let across = (1.0 - z * z).max(0.0).sqrt();
    [across * cos, across * sin, z]
}

/// Of the sphere.
pub fn any(k: usize) -> [f32; 3] {
    direction(2.0 * even(k, 0.754_877_666) - 1.0, even(k, 0.569_840_291))
}

pub fn place(k: usize) -> [f32; 2] {
    [9e3 * even(k, 0.819_172_513), 9e3 * even(k, 0.671_043_606)]
}

fn query<const N: usize>(at: [f32; 2], wo: [f32; 3], sigma: [f32; N]) -> ClothQuery<'static, N> {
    ClothQuery { sigma_per_um: [Some(sigma); 2], ..ClothQuery::new(at, wo, [0.55; N]) }
}

/// Clear fibers neither lose nor make light, by the direction of the viewer and by that of the light, which
/// the model's sums over plies do not know of.
#[test]
fn clear_cloths_conserve_energy() {
    const PLACES: usize = 400;
    const DIRECTIONS: usize = 256;
    const VIEWS: usize = 1 << 15;
    for (name, data) in [("jersey", &*JERSEY), ("organza", &*ORGANZA), ("flannel", &*FLANNEL)] {
        let cloth = ClothModel::from_data(data.clone(), &ClothOptions::RAYS).unwrap();
        for z in [0.95f32, 0.6, -0.6, 0.3, 0.15, 0.05, -0.05] {
            let (mut by_view, mut by_light) = (0.0f64, 0.0f64);
            for k in 0..PLACES {
                let at = cloth.at(&query(place(k), direction(z, even(k, 0.618_034)), [0.0]));
                let straight = f64::from(at.straight()[0]);
                by_view += straight / PLACES as f64;
                by_light += straight / PLACES as f64;
                let weight = f64::from(2.0 * TAU) / (DIRECTIONS * PLACES) as f64;
                (0..DIRECTIONS).for_each(|i| by_view += weight * f64::from(at.eval(any(i + 31 * k))[0]));
            }
            for k in 0..VIEWS {
                // Light from w to viewers on both sides, weighted by their cosine: f holds that at the light.
                let w = direction(z, even(k, 0.618_034));
                let up = even(k, 0.754_877_666).sqrt().max(1e-3);
                let b = direction(if k % 2 == 0 { up } else { -up }, even(k, 0.569_840_291));
                let f = f64::from(cloth.at(&query(place(k), b, [0.0])).eval(w)[0]);
                by_light += f64::from(TAU) * f / f64::from(z.abs()) / VIEWS as f64;
            }
            println!("{name}, cosine {z}: energy by view {by_view:.4}, by light {by_light:.4}");
            assert!((by_view - 1.0).abs() < 0.04, "{name}, cosine {z}: {by_view} by view");
            assert!((by_light - 1.0).abs() < 0.03, "{name}, cosine {z}: {by_light} by light");
        }
    }
}

/// Samples have the density that is told, weights are f over it, and their mean is the integral of f; of
/// light without the narrow peaks that gaps diffract (`cloth_gaps.rs`).
#[test]
fn samples_follow_their_density() {
    for data in [&*JERSEY, &*ORGANZA, &*FLANNEL] {
        let options = ClothOptions { gaps: GapLight::Straight, ..ClothOptions::default() };
        let cloth = ClothModel::from_data(data.clone(), &options).unwrap();
        for k in 0..24 {
            let wo = direction([0.9, 0.5, 0.1, -0.7][k % 4], even(k, 0.3));
            let at = cloth.at(&query(place(k), wo, [0.0, 0.004, 0.02]));
            let outcomes = at.outcomes();
            const SAMPLES: usize = 4096;
            let (mut inside, mut weights) = (0usize, [0.0f64; 3]);
            // How many samples go up, by count and by the integral of the density; the integral of f.
            let (mut up, mut all) = (0.0f64, [0.0f64; 3]);
            for i in 0..SAMPLES {
                let u = [0.819_172_513, 0.671_043_606, 0.549_700_478].map(|step| even(i, step));
                if let BsdfSample::Scattered(s) = at.sample(u) {
                    let (f, pdf) = at.eval_pdf(s.w);
                    assert!((pdf / s.pdf - 1.0).abs() < 2e-3, "{pdf} {}", s.pdf);
                    for n in 0..3 {
                        assert!((f[n] / pdf - s.weight[n]).abs() <= 3e-3 * s.weight[n].max(1e-3), "{f:?} {pdf}");
                        weights[n] += f64::from(s.weight[n]) / SAMPLES as f64;
                    }
                    inside += usize::from(s.w[2] > 0.0);
                }
                let w = any(i);
                let (f, pdf) = at.eval_pdf(w);
                let per = f64::from(2.0 * TAU) / SAMPLES as f64;
                up += if w[2] > 0.0 { f64::from(pdf) * per } else { 0.0 };
                (0..3).for_each(|n| all[n] += f64::from(f[n]) * per);
            }
            assert!((outcomes.scattered + outcomes.straight + outcomes.absorbed - 1.0).abs() < 1e-4);
            let drawn = inside as f64 / SAMPLES as f64;
            assert!((drawn - up).abs() < 0.04 * (0.2 + up), "{k}: {drawn} drawn up, {up} by the density");
            for (weight, all) in weights.iter().zip(all) {
                assert!((weight - all).abs() < 0.04 * (0.2 + all), "{k}: weights {weights:?}, integral {all:?}");
            }
        }
    }
}

/// A file gives the same cloth, bit by bit; the file of a damaged or foreign one is refused in one line.
#[test]
fn files_hold_the_cloth() {
    let bytes = JERSEY.to_bytes().unwrap();
    assert!(bytes.len() < 8 << 20, "{} bytes", bytes.len());
    let read = ClothData::from_bytes(&bytes, "jersey.pwc").unwrap();
    assert_eq!(read.to_bytes().unwrap(), bytes);
    let options = ClothOptions { far: true, ..ClothOptions::default() };
    let [a, b] = [JERSEY.clone(), read].map(|data| ClothModel::from_data(data, &options).unwrap());
    for k in 0..200 {
        let at = ClothQuery { footprint_um: [0.0, 600.0, 3000.0][k % 3], ..ClothQuery::rgb(place(k), any(k)) };
        assert_eq!(a.at(&at).eval_pdf(any(k + 7)), b.at(&at).eval_pdf(any(k + 7)));
    }
    for cut in [0, 7, 100, 5000, bytes.len() - 1] {
        let message = ClothData::from_bytes(&bytes[..cut], "cut.pwc").unwrap_err().to_string();
        assert!(message.contains("cut.pwc") && message.lines().count() == 1, "{message}");
    }
    let newer = bytes.windows(10).position(|w| w == b"version\\\":").unwrap();
    let mut other = bytes.clone();
    other[newer + 10] = b'9';
    let message = ClothData::from_bytes(&other, "newer.pwc").unwrap_err().to_string();
    assert!(message.contains("version") && message.lines().count() == 1, "{message}");
    for k in 0..64 {
        // A flipped byte is refused or shades.
        let mut other = bytes.clone();
        let at = (other.len() - 1) * k / 63;
        other[at] ^= 0x55;
        if let Ok(data) = ClothData::from_bytes(&other, "flipped.pwc")
            && let Ok(cloth) = ClothModel::from_data(data, &options)
        {
            let _ = cloth.at(&ClothQuery::rgb(place(k), any(k))).eval(any(k + 3));
        }
    }
}

/// The mean over the cell is that of many places.
#[test]
fn the_mean_is_that_of_places() {
    let options = ClothOptions { far: true, ..ClothOptions::RAYS };
    const PLACES: usize = 1500;
    let views = [direction(0.9, 0.1), direction(0.6, 0.33), direction(-0.5, 0.7), direction(0.25, 0.02)];
    let cloths = [&*JERSEY, &*FLANNEL].map(|data| ClothModel::from_data(data.clone(), &options).unwrap());
    for (cloth, (i, wo)) in cloths.iter().flat_map(|cloth| views.iter().enumerate().map(move |view| (cloth, view))) {
        let far = cloth.at(&ClothQuery { footprint_um: 1e4, ..query([0.0; 2], *wo, [0.0, 0.005]) });
        assert!(far.far_share() == 1.0);
        let lights: Vec<[f32; 3]> = (0..48).map(|k| any(k + 48 * i)).collect();
        let mut means = vec![[0.0f64; 2]; lights.len()];
        for k in 0..PLACES {
            let at = cloth.at(&query(place(k), *wo, [0.0, 0.005]));
            for (mean, w) in means.iter_mut().zip(&lights) {
                let f = at.eval(*w);
                (0..2).for_each(|n| mean[n] += f64::from(f[n]) / PLACES as f64);
            }
        }
        let (mut off, mut all) = (0.0, 0.0);
        for (mean, w) in means.iter().zip(&lights) {
            let f = far.eval(*w);
            for n in 0..2 {
                off += (f64::from(f[n]) - mean[n]).powi(2);
                all += mean[n].powi(2);
            }
        }
        let off = (off / all).sqrt();
        println!("view {wo:?}: {off:.3}");
        assert!(off < 0.08, "view {wo:?}: {off}");
    }
}

/// A draft reflects and transmits as the cloth does, but for chance.
#[test]
#[ignore = "slow: 8 s: drafts are near the cloth"]
fn drafts_are_near_the_cloth() {
    for (cloth, name) in [(&*JERSEY, "jersey"), (&*ORGANZA, "organza")] {
        let spec = ClothSpec::parse(&cloth.spec_text, name).unwrap();
        let no_file = &mut |file: &str| panic!("{file} is not to be read");
        let made = make_cloth(&spec, name, no_file, Effort::Draft, &|_| true).unwrap();
        let ready = precompute(&spec, &cloth.spec_text, &made.curves, &cloth.models, Effort::Draft, &|_| true);
        let draft = ready.unwrap();
        assert!(draft.far.is_none());
        let mean = |data: &ClothData, wo: [f32; 3]| {
            let model = ClothModel::from_data(data.clone(), &ClothOptions::RAYS).unwrap();
            (0..4000).map(|k| model.at(&query(place(k), wo, [0.003])).albedo()[0]).sum::<f32>() / 4000.0
        };
        for z in [1.0f32, 0.5, 0.1, -0.7] {
            let [of_draft, of_cloth] = [&draft, cloth].map(|data| mean(data, direction(z, 0.1)));
            println!("{name}, cosine {z}: {of_draft:.4} of {of_cloth:.4}");
            assert!((of_draft - of_cloth).abs() < 0.02, "{name}, {z}: {of_draft}, {of_cloth}");
        }
    }
}

/// Reflected and transmitted light of a cloth with an absorption, as a mean over even samples of places and
/// directions; straight light counts as transmitted.
fn reflected_and_passed(data: &ClothData, wo: [f32; 3], sigma: f32) -> [f64; 2] {
    const SAMPLES: usize = 400_000;
    let model = ClothModel::from_data(data.clone(), &ClothOptions::RAYS).unwrap();
    let (mut sums, mut rng) = ([0.0; 2], SplitMix64(7));
    for _ in 0..SAMPLES {
        // Places of the whole repeat, whatever its size.
        let [x, y, u @ ..]: [f32; 5] = std::array::from_fn(|_| rng.next_f64() as f32);
        let at = [6e4 * x, 6e4 * y];
        match model.at(&query(at, wo, [sigma])).sample(u) {
            BsdfSample::Scattered(s) => sums[usize::from(s.w[2] * wo[2] < 0.0)] += f64::from(s.weight[0]),
            BsdfSample::Straight { weight, .. } => sums[1] += f64::from(weight[0]),
            BsdfSample::Absorbed => {}
        }
    }
    sums.map(|sum| sum / SAMPLES as f64)
}

/// A large draft comes from tiles, and its places share tables of shadows: a twill of 40 x 40 threads with
/// one flaw reflects and transmits as the twill of four does, from its file, too.
#[test]
#[ignore = "slow: 20 s: a twill from tiles is the twill"]
fn a_twill_from_tiles_is_the_twill() {
    let path = format!("{}/../fabrics/models/cotton_single.pwm", env!("CARGO_MANIFEST_DIR"));
    let model = Arc::new(PlyModel::load(path).unwrap());
    let models = [Arc::clone(&model), model];
    let made = |rows: usize, flaw: bool| {
        let up = |pick: usize, end: usize| (pick + 4 * rows - end) % 4 < 2;
        let row = |pick: usize| -> String {
            let is_up = |end: usize| up(pick, end) != (flaw && pick == 7 && end == 9);
            (0..rows).map(|end| if is_up(end) { 'X' } else { '.' }).collect()
        };
        let rows: Vec<String> = (0..rows).rev().map(|pick| format!("\"{}\"", row(pick))).collect();
        let text = format!(
            "name = \"twill\"\n[weave]\nkind = \"draft\"\nrows = [{}]\nends_per_cm = 46\npicks_per_cm = 38\n\
             [warp]\nfiber = \"cotton\"\ncount = \"Ne 30\"\nbundles = 1\ntwist = \"Z 750/m\"\n[weft]\nas = \"warp\"\n",
            rows.join(", ")
        );
        let spec = ClothSpec::parse(&text, "twill").unwrap();
        let no_file = &mut |file: &str| panic!("{file} is not to be read");
        let made = make_cloth(&spec, "twill", no_file, Effort::Full, &|_| true).unwrap();
        precompute(&spec, &text, &made.curves, &models, Effort::Near, &|_| true).unwrap()
    };
    let (small, large) = (made(4, false), made(40, true));
    assert!(small.shadows.tables().is_empty() && large.curves.curves.len() == 80);
    let tables = large.shadows.tables();
    let count = tables.iter().max().unwrap() + 1;
    println!("{count} tables of {} places", tables.len());
    assert!(tables.len() > 5000 && 2 * (count as usize) < tables.len());
    let read = ClothData::from_bytes(&large.to_bytes().unwrap(), "twill.pwc").unwrap();
    assert!(read.shadows.tables() == tables && read.shadows.free() == large.shadows.free());
    for (z, turn) in [(1.0, 0.1), (0.7, 0.0), (0.5, 0.25), (-0.6, 0.4)] {
        for sigma in [0.0, 0.01] {
            let wo = direction(z, turn);
            let [a, b] = [&small, &read].map(|data| reflected_and_passed(data, wo, sigma));
            println!("{z} {turn}, sigma {sigma}: R {:.4} {:.4}, T {:.4} {:.4}", a[0], b[0], a[1], b[1]);
            assert!((0..2).all(|k| (a[k] - b[k]).abs() < 0.005), "{z} {turn}: {a:?} {b:?}");
        }
    }
}

/// No query fails: places and directions that are none, absorptions out of range.
#[test]
fn any_query_is_answered() {
    let cloth =
        ClothModel::from_data(ORGANZA.clone(), &ClothOptions { noise: true, ..ClothOptions::default() }).unwrap();
    let odd = [0.0f32, -0.0, 1e-30, 1.0, 1e9, 1e38, f32::INFINITY, f32::NAN];
    for (i, x) in odd.iter().enumerate() {
        for (j, z) in odd.iter().enumerate() {
            let wo = [odd[(i + j) % 8], *x, *z];
            let at = cloth.at(&query([*x, 40.0 * *z], wo, [*x, 0.01, *z]));
            let (f, pdf) = at.eval_pdf(any(i + 8 * j));
            assert!(
                f.iter().all(|f| f.is_finite() && *f >= 0.0) && pdf.is_finite() && pdf >= 0.0,
                "{wo:?}: {f:?} {pdf}"
            );
            let _ = at.sample([*x, *z, 0.3]);
        }
    }
}

/// Models of other plies, and too few of them, are refused.
#[test]
fn foreign_models_are_refused() {
    let cotton = JERSEY.models.clone();
    let (text, curves) = (&ORGANZA.spec_text, &ORGANZA.curves);
    let spec = ClothSpec::parse(text, "organza").unwrap();
    let make = |models: &[Arc<PlyModel>]| {
        precompute(&spec, text, curves, models, Effort::Near, &|_| true).unwrap_err().to_string()
    };
    let message = make(&cotton);
    assert!(message.contains("1 models") && message.lines().count() == 1, "{message}");
    let message = make(&[cotton[0].clone(), cotton[0].clone()]);
    assert!(message.contains("ply.radius_um") && message.contains("29.2") && message.lines().count() == 1, "{message}");
}

/// Other colors are those of a file with them; absorptions invert the brightness; what is not there is told.
#[test]
fn colors_are_changed_without_tracing() {
    let cloth = ClothModel::from_data(JERSEY.clone(), &ClothOptions::default()).unwrap();
    let srgb = [0.2f32, 0.5, 0.3];
    let mut green = JERSEY.clone();
    assert_eq!(green.looks[0].colors, [YarnColor::Srgb([0.75, 0.75, 0.72])]);
    green.looks[0].colors = vec![YarnColor::Srgb(srgb)];
    let green = ClothModel::from_data(green, &ClothOptions::default()).unwrap();
    let same = cloth.with_colors([YarnColor::Srgb(srgb), YarnColor::Undyed], ColorOf::EvenSky);
    for k in 0..50 {
        let at = ClothQuery::rgb(place(k), any(k));
        assert_eq!(same.at(&at).eval(any(k + 7)), green.at(&at).eval(any(k + 7)));
    }
    let reach = same.colors();
    assert_eq!((reach.len(), reach[0].asked, same.color_of()), (1, srgb, ColorOf::EvenSky));
    assert!(reach[0].delta_e < 1.0, "{reach:?}");
    for r in [0.2f32, 0.5, 0.8] {
        let [sigma] = cloth.sigma_of_reflectance([r]);
        assert!((cloth.color_curve().albedo(f64::from(sigma)) - f64::from(r)).abs() < 1e-3, "{r}: {sigma}");
    }
    // Light meets more fibers in a pile than in a sheet: the same color takes less absorption.
    let folded = cloth.with_colors([YarnColor::Srgb(srgb); 2], ColorOf::Folded);
    assert_eq!(folded.color_of(), ColorOf::Folded);
    assert!(folded.sigma_of_reflectance([0.5])[0] < 0.8 * cloth.sigma_of_reflectance([0.5])[0]);
    let back = folded.with_colors([YarnColor::Srgb(srgb); 2], ColorOf::EvenSky);
    assert_eq!(back.sigma_of_reflectance([0.5]), cloth.sigma_of_reflectance([0.5]));

    assert_eq!((cloth.kinds(), cloth.model_of(1).is_some(), cloth.has_far()), (1, false, false));
    let far = ClothOptions { far: true, ..ClothOptions::default() };
    assert!(ClothModel::from_data(JERSEY.clone(), &far).unwrap().has_far() && JERSEY.notes(&far).is_empty());
    assert!(ORGANZA.notes(&far)[0].contains("footprints count as points"));
}

/// A cloth under hairs reflects and lets through what its explicit fibers and hairs do, clear and dyed; its
/// file has the layer.
#[test]
#[ignore = "slow: 32 s: hairs shade as explicit ones"]
fn hairs_shade_as_explicit_ones() {
    let data = ClothData::from_bytes(&FLANNEL.to_bytes().unwrap(), "flannel.pwc").unwrap();
    assert!(data.hairs.is_some() && JERSEY.hairs.is_none());
    let cloth = ClothModel::from_data(data, &ClothOptions::RAYS).unwrap();
    let spec = ClothSpec::parse(&FLANNEL.spec_text, "flannel").unwrap();
    let specs = FLANNEL.models.iter().map(|model| model.data().spec_text.clone()).collect();
    let curves = TwinCurves::new("flannel", FLANNEL.curves.clone(), specs).unwrap().with_hairs(spec.hairs());
    let tilts: [(f64, f64); 4] = [(0.0, 0.0), (45.0, 45.0), (75.0, 0.0), (120.0, 60.0)];
    let views = tilts.iter().map(|(tilt, turn)| twin_direction(tilt.to_radians(), turn.to_radians())).collect();
    let options =
        TwinOptions { views, paths: 10_000, sigma_per_um: vec![[0.0; 2], [0.003; 2]], ..TwinOptions::default() };
    let twin = twin(&curves, &options, Run::plain()).unwrap();
    for (view, tilt) in tilts.iter().enumerate() {
        for compared in compare(&cloth, &twin, view, &ComparisonOptions { places: 4096, directions: 1 }) {
            let [a, b] = [&compared.twin, &compared.model];
            println!(
                "{tilt:?}, sigma {}: R {:.4} / {:.4}, T {:.4} / {:.4}, straight {:.4} / {:.4}, L2 {:.3}, {:.3}",
                compared.sigma,
                a.reflected,
                b.reflected,
                a.transmitted,
                b.transmitted,
                a.straight,
                b.straight,
                compared.upper,
                compared.lower
            );
            assert!((a.reflected - b.reflected).abs() < 0.025, "{tilt:?}: R");
            let [a, b] = [a, b].map(|light| light.transmitted + light.straight);
            assert!((a - b).abs() < 0.025, "{tilt:?}: T");
            assert!(compared.upper < 0.2, "{tilt:?}: L2 {}", compared.upper);
        }
    }
}
