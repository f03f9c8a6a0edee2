//! Light among strands: white rooms stay white, single scattering is the model's albedo, a lamp's light is
//! its integral, effective widths cast shadows of their width, and the picture does not depend on the form of
//! the tree.

use glam::{DVec3, Vec3};
use plywave::Bsdf;
use plywave_fiber::{DielectricFiber, DielectricParameters, FiberSource, FiberTable, OutlineSymmetry, TabulatedFiber};
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_render::{
    Basis, Camera, Environment, Film, FilmView, GeneratedStrands, Light, MAX_SCATTERINGS, RenderOptions, StrandFiber,
    StrandScene, StrandShape, StrandTree, Strands, make, render_strands,
};
use rand::{RngExt, SeedableRng};
use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;

const RADIUS_UM: f32 = 40.0;

fn dielectric() -> FiberModel {
    let parameters = DielectricParameters { radius_um: RADIUS_UM, ..DielectricParameters::default() };
    DielectricFiber::new(parameters).unwrap().into()
}

/// A table that receives light over the given multiples of its geometric width, from 0.38 to 0.78 um, and
/// scatters the share `albedo` evenly.
fn table(widths: &[f64], albedo: f64) -> FiberModel {
    let l = widths.len();
    let geometric = 2.0 * f64::from(RADIUS_UM);
    let table = FiberTable {
        spec_text: String::new(),
        program_version: "0".into(),
        preset: "test".into(),
        seed: 0,
        source: FiberSource::Wave,
        symmetry: OutlineSymmetry::CIRCLE,
        beta_m: 0.2,
        lambda_um: (0..l).map(|k| 0.38 + 0.4 * k as f64 / (l - 1).max(1) as f64).collect(),
        theta_i: FiberTable::theta_nodes(2),
        phi_i: vec![0.0],
        width_um: vec![geometric],
        c_x_um: widths.iter().flat_map(|w| [w * geometric; 2]).collect(),
        c_abs_um: widths.iter().flat_map(|w| [(1.0 - albedo) * w * geometric; 2]).collect(),
        azimuthal: vec![(albedo / TAU) as f32; l * 2 * 4],
    };
    TabulatedFiber::from_table(table).unwrap().into()
}

fn picture(scene: &StrandScene, camera: &Camera, size: u32, samples: u32, depth: u32) -> Film {
    let mut film = Film::new(size, size).unwrap();
    let options = RenderOptions { samples, depth, seed: 5 };
    render_strands(scene, camera, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
    film
}

/// Mean Y of a film.
fn mean(film: &Film, view: FilmView) -> f64 {
    let n = film.width() * film.height();
    (0..n).map(|k| f64::from(film.xyz(view, k % film.width(), k / film.width())[1])).sum::<f64>() / f64::from(n)
}

/// Mean of red, green, blue of a film, linear.
fn rgb(film: &Film) -> [f64; 3] {
    let n = film.width() * film.height();
    let mut sum = [0.0; 3];
    for k in 0..n {
        let c = film.linear(FilmView::Light, k % film.width(), k / film.width());
        (0..3).for_each(|i| sum[i] += f64::from(c[i]) / f64::from(n));
    }
    sum
}

fn above() -> Camera {
    Camera::new(Vec3::new(0.3, -0.2, 30.0), Vec3::ZERO, Vec3::Y, 0.1)
}

/// A white room stays white among non-absorbing fibers, with either kind of offset.
#[test]
#[ignore = "slow: 8 s: white rooms stay white"]
fn white_rooms_stay_white() {
    let fur = GeneratedStrands::Fur { count: 6000, size_mm: 8.0, length_mm: 5.0 };
    let layer = GeneratedStrands::Layer { count: 40, layers: 6, spacing_mm: 0.1, length_mm: 20.0 };
    for (what, model, near, shape) in [
        (fur, dielectric(), false, StrandShape::Tube),
        (fur, dielectric(), true, StrandShape::Band),
        (layer, dielectric(), true, StrandShape::Tube),
        (layer, table(&[1.0, 2.5, 1.5], 1.0), false, StrandShape::Tube),
        (layer, table(&[0.7, 0.9], 1.0), false, StrandShape::Band),
    ] {
        let strands = make(&what, 0.001 * RADIUS_UM, 16, 3).unwrap();
        let fiber = StrandFiber { near, ..StrandFiber::new(model) };
        let scene = StrandScene::new(strands, shape, fiber, Vec::new(), Environment::constant(1.0));
        let samples = if what == fur { 48 } else { 400 };
        let got = mean(&picture(&scene, &above(), 20, samples, 100_000), FilmView::Light);
        println!("{what:?} {shape:?} near {near}: {got:.4}");
        assert!((got - 1.0).abs() < 0.01, "{what:?} {shape:?} near {near}: {got}");
    }
}

/// In a white room non-absorbing fibers lack the light that a cut omits, which the film reports; with the
/// largest number of scatterings nothing is missing. Among dyed fibers the film reports the light that the
/// whole picture has more.
#[test]
#[ignore = "slow: 5 s: cuts tell what they leave out"]
fn cuts_tell_what_they_leave_out() {
    let fur = GeneratedStrands::Fur { count: 2000, size_mm: 5.0, length_mm: 4.0 };
    let room = |sigma: f32| {
        let strands = make(&fur, 0.001 * RADIUS_UM, 16, 3).unwrap();
        let fiber = StrandFiber { model: dielectric(), sigma: vec![[0.5, sigma]], near: false };
        StrandScene::new(strands, StrandShape::Tube, fiber, Vec::new(), Environment::constant(1.0))
    };
    let clear = room(0.0);
    for depth in [2, 8, MAX_SCATTERINGS] {
        let film = picture(&clear, &above(), 16, 64, depth);
        // The share of samples that hit a strand, whose albedo is 1.
        let hit = mean(&film, FilmView::Albedo);
        let (lacks, told) = ((1.0 - mean(&film, FilmView::Light)) / hit, film.cut_share());
        println!("{depth} scatterings lack {lacks:.4}, told {told:.4}");
        assert!((told - lacks).abs() < 0.012, "{depth}: {told} of {lacks}");
        assert!(depth < MAX_SCATTERINGS || told < 1e-3, "{told}");
    }
    // Dyed fibers: the difference to the whole picture, of four seeds.
    let dyed = room(0.004);
    let off = [1, 2, 3, 4].map(|seed| {
        let shot = |depth| {
            let mut film = Film::new(16, 16).unwrap();
            let options = RenderOptions { samples: 48, depth, seed };
            render_strands(&dyed, &above(), &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
            film
        };
        let (cut, whole) = (shot(4), shot(MAX_SCATTERINGS));
        let lacks = 1.0 - mean(&cut, FilmView::Light) / mean(&whole, FilmView::Light);
        println!("4 scatterings lack {lacks:.4}, told {:.4}", cut.cut_share());
        assert!(lacks > 0.1);
        cut.cut_share() - lacks
    });
    let average = off.iter().sum::<f64>() / 4.0;
    let deviation = (off.iter().map(|v| (v - average).powi(2)).sum::<f64>() / 12.0).sqrt();
    assert!(average.abs() < 5.0 * deviation && deviation < 0.02, "{average} of {deviation}");
}

/// A furnace of an assembly with growing numbers of scatterings (Xia 2020, Fig. 8): with hits within C_e, all
/// light is there in the end and never more. With hits within C_g and the light scaled by C_e / C_g per
/// scattering, it grows beyond the room's.
#[test]
#[ignore = "slow: 20 s: assemblies vanish in a white room by effective widths alone"]
fn assemblies_vanish_in_a_white_room_by_effective_widths_alone() {
    /// C_e / C_g, as of circles of some 10 um.
    const WIDER: f64 = 2.0;
    const MAX: u32 = 12;
    let what = GeneratedStrands::Ball { count: 400, ball_mm: 1.0, length_mm: 6.0, curl_mm: 1.5 };
    let camera = Camera::new(Vec3::new(0.0, -40.0, 0.0), Vec3::ZERO, Vec3::Z, 0.1);
    let upto = |width: f64, depth: u32| {
        let strands = make(&what, 0.001 * RADIUS_UM, 16, 3).unwrap();
        let fiber = StrandFiber::new(table(&[width], 1.0));
        let scene = StrandScene::new(strands, StrandShape::Tube, fiber, Vec::new(), Environment::constant(1.0));
        mean(&picture(&scene, &camera, 16, 64, depth), FilmView::Light)
    };
    // Light that arrives after at most d scatterings.
    let adjusted: Vec<f64> = (0..=MAX).map(|d| upto(WIDER, d)).collect();
    let narrow: Vec<f64> = (0..=MAX).map(|d| upto(1.0, d)).collect();
    // Light of n scatterings is WIDER^n times as much where each gives that.
    let mut naive = vec![narrow[0]];
    for n in 1..=MAX as usize {
        naive.push(naive[n - 1] + WIDER.powi(n as i32) * (narrow[n] - narrow[n - 1]));
    }
    for d in [0, 1, 2, 4, 8, 12] {
        println!("up to {d} scatterings: by C_e {:.3}, C_g {:.3}, C_e on C_g {:.3}", adjusted[d], narrow[d], naive[d]);
    }
    let [all, alone] = [upto(WIDER, 100_000), upto(1.0, 100_000)];
    println!("all: by C_e {all:.4}, C_g {alone:.4}");
    assert!((all - 1.0).abs() < 0.01 && (alone - 1.0).abs() < 0.01, "{all} {alone}");
    assert!(adjusted.windows(2).all(|w| w[1] > w[0] - 0.005) && adjusted.iter().all(|a| *a < 1.01), "{adjusted:?}");
    assert!(naive[MAX as usize] > 1.5, "{naive:?}");
}

/// One strand that fills the picture.
fn thick(fiber: StrandFiber, lights: Vec<Light>, environment: Environment) -> StrandScene {
    let points: Vec<[f32; 4]> = (0..6).map(|k| [10.0 * k as f32 - 25.0, 0.0, 0.0, 3.0]).collect();
    let mut strands = Strands::new(Basis::BSpline);
    strands.push(&points, "thick", "strand 1").unwrap();
    StrandScene::new(strands, StrandShape::Tube, fiber, lights, environment)
}

/// Single scattering in a white room is the albedo.
#[test]
fn one_scattering_gives_the_albedo() {
    // The strand is 75 times as thick as the model, and so are the paths in it.
    let sigma = vec![[0.4, 0.0003], [0.55, 0.0001], [0.7, 0.00002]];
    for near in [false, true] {
        let fiber = StrandFiber { model: dielectric(), sigma: sigma.clone(), near };
        let film = picture(&thick(fiber, Vec::new(), Environment::constant(1.0)), &above(), 24, 128, 1);
        let (light, albedo) = (mean(&film, FilmView::Light), mean(&film, FilmView::Albedo));
        println!("near {near}: {light:.4} of albedo {albedo:.4}");
        assert!(albedo < 0.9 && (light / albedo - 1.0).abs() < 0.01, "near {near}: {light} {albedo}");
    }
}

/// A lamp on one strand gives the quadrature of f over the lamp.
#[test]
fn a_lamp_gives_the_integral_over_it() {
    let lamp = Light::facing(Vec3::new(20.0, 30.0, 40.0), Vec3::ZERO, 25.0, 2.0);
    let model = dielectric();
    let scene = thick(StrandFiber::new(model.clone()), vec![lamp], Environment::constant(0.0));
    // One pixel's worth of rays onto nearly one place.
    let camera = Camera::new(Vec3::new(0.0, 0.0, 3000.0), Vec3::ZERO, Vec3::Y, 1e-6);
    let got = mean(&picture(&scene, &camera, 8, 2000, 1), FilmView::Light);
    // Axis along x; frame by the reference z: x' = z, y' = x cross z = -y.
    let local = |v: DVec3| [v.z as f32, -v.y as f32, v.x as f32];
    let at = model.at(&FiberQuery::new(local(DVec3::Z), [0.55f32]));
    let place = DVec3::new(0.0, 0.0, 3.0);
    let (edges, corner) = (lamp.edges.map(|e| e.as_dvec3()), lamp.corner.as_dvec3());
    let normal = edges[0].cross(edges[1]);
    let n = 400;
    let mut want = 0.0;
    for i in 0..n * n {
        let (u, v) = (((i % n) as f64 + 0.5) / n as f64, ((i / n) as f64 + 0.5) / n as f64);
        let to = corner + edges[0] * u + edges[1] * v - place;
        let solid = -normal.dot(to) / to.length().powi(3) / (n * n) as f64;
        want += 2.0 * solid * f64::from(at.eval(local(to.normalize()))[0]);
    }
    println!("lamp: {got:.5}, by quadrature {want:.5}");
    assert!((got / want - 1.0).abs() < 0.02, "{got} {want}");
}

/// Black fibers side by side transmit the light beyond their effective width, by wavelength: to the camera,
/// and to a matte floor from a lamp.
#[test]
#[ignore = "slow: 10 s: effective widths cast their shadow"]
fn effective_widths_cast_their_shadow() {
    // Nearly no scattering; a distance of five geometric widths.
    let spacing = 5.0 * 2.0 * 0.001 * RADIUS_UM;
    let layer = GeneratedStrands::Layer { count: 30, layers: 1, spacing_mm: spacing, length_mm: 30.0 };
    for widths in [[1.0, 1.0, 1.0], [3.0, 3.0, 3.0], [1.0, 2.0, 3.0], [0.5, 0.5, 0.5]] {
        let strands = make(&layer, 0.001 * RADIUS_UM, 4, 1).unwrap();
        let fiber = || StrandFiber::new(table(&widths, 0.0));
        let bright = |strands: Strands, fiber| {
            StrandScene::new(strands, StrandShape::Band, fiber, Vec::new(), Environment::constant(1.0))
        };
        // Ten distances across, seen from straight above.
        let camera =
            Camera::new(Vec3::new(0.0, 0.0, 1000.0), Vec3::ZERO, Vec3::Y, 2.0 * (5.0 * spacing / 1000.0).atan());
        let got = rgb(&picture(&bright(strands, fiber()), &camera, 200, 64, 4));
        // The light that passes at a wavelength, as a color computed as the film's.
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        let mut want = [0.0; 3];
        let n = 200_000;
        for _ in 0..n {
            let lambda = 0.38 + 0.4 * rng.random::<f64>();
            let x = (lambda - 0.38) / 0.4 * 2.0;
            let k = (x as usize).min(1);
            let width = widths[k] + (widths[k + 1] - widths[k]) * (x - k as f64);
            let matching = plywave::color::d65_xyz_density(lambda);
            let rgb = plywave::color::linear_srgb_of_xyz(matching.map(|m| 0.4 * m * (1.0 - width / 5.0)));
            (0..3).for_each(|c| want[c] += rgb[c] / f64::from(n));
        }
        println!("{widths:?}: {got:.3?}, expected {want:.3?}");
        for c in 0..3 {
            assert!((got[c] - want[c]).abs() < 0.012, "{widths:?}: {got:?} {want:?}");
        }
    }
}

/// A dyed wisp under lamp and sky: the same picture, bit by bit, by trees of two forms; darker than a clear
/// one.
#[test]
fn the_tree_is_not_in_the_picture() {
    let lamp = Light::facing(Vec3::new(30.0, -40.0, 20.0), Vec3::ZERO, 15.0, 8.0);
    let camera = Camera::new(Vec3::new(0.0, -60.0, -10.0), Vec3::new(0.0, 0.0, -15.0), Vec3::Z, 0.6);
    let strands =
        make(&GeneratedStrands::Wisp { count: 400, width_mm: 3.0, length_mm: 30.0 }, 0.001 * RADIUS_UM, 24, 3).unwrap();
    let of = |sigma: f32, medians: bool| {
        let fiber = StrandFiber { model: dielectric(), sigma: vec![[0.5, sigma]], near: false };
        let tree = if medians { StrandTree::by_medians } else { StrandTree::new };
        let scene =
            StrandScene::over(tree(strands.clone(), StrandShape::Tube), fiber, vec![lamp], Environment::constant(0.01));
        picture(&scene, &camera, 32, 8, 64)
    };
    let (dyed, again, clear) = (of(0.02, false), of(0.02, true), of(0.0, false));
    assert!(dyed == again, "the pictures differ");
    let (dark, bright) = (mean(&dyed, FilmView::Light), mean(&clear, FilmView::Light));
    println!("dyed {dark:.4}, clear {bright:.4}");
    assert!(dark > 0.2 * bright && dark < 0.85 * bright, "{dark} {bright}");
}
