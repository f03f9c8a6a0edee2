//! Every lamp and sky against a closed form: light on a diffuse sheet by its irradiance (of rectangles,
//! Lambert's formula for polygons; of a sky's texel, the integral of the cosine), light in a narrow lobe by
//! its radiance, a cloth by comparison of strategies. Each by directions drawn from the lights, by
//! scattering, and by both, within five standard errors computed from the picture's own pixels.

use crate::small_cloth;
use glam::{DVec3, Vec3};
use plywave::bsdf::{DirectionSample, Outcomes};
use plywave::cloth::ClothOptions;
use plywave::{Bsdf, BsdfSample};
use plywave_fiber::{DielectricFiber, DielectricParameters};
use plywave_render::{
    Basis, Camera, Environment, Film, FilmView, Light, LightSampling, Mesh, Prop, RenderOptions, Scene, Shape,
    StrandFiber, StrandScene, StrandShape, Strands, Surface, render, render_strands,
};
use std::f64::consts::{PI, TAU};
use std::sync::atomic::AtomicBool;

const WAYS: [LightSampling; 3] = [LightSampling::Both, LightSampling::Sources, LightSampling::Scattering];
const RADIANCES: [f32; 3] = [0.01, 1.0, 100.0];
/// Pixels along a side of a picture, all of the same point.
const SIDE: u32 = 24;

/// A sheet without color.
#[derive(Clone, Copy)]
enum Sheet {
    /// Reflects a share `up` of the light and transmits `down`, both by Lambert's law.
    Diffuse { up: f32, down: f32 },
    /// Reflects a share of the light evenly into a cone about the mirror's direction, whose half-angle has
    /// this cosine.
    Cone { albedo: f32, cos: f32 },
    /// Lets a share `open` of the light pass, evenly into a cone about the straight direction whose
    /// half-angle has this cosine, and reflects the rest by Lambert's law.
    Screen { open: f32, cos: f32 },
}

struct At(Sheet, [f32; 3]);

impl At {
    /// For light from `w`: the scattered light times the cosine, and the density.
    fn value(&self, w: [f32; 3]) -> (f32, f32) {
        let wo = self.1;
        match self.0 {
            Sheet::Diffuse { up, down } => {
                let share = if w[2] * wo[2] > 0.0 { up } else { down };
                let f = share * w[2].abs() / PI as f32;
                (f, f / (up + down))
            }
            Sheet::Cone { albedo, cos } => {
                let along = -w[0] * wo[0] - w[1] * wo[1] + w[2] * wo[2];
                let pdf = if along > cos { 1.0 / (TAU as f32 * (1.0 - cos)) } else { 0.0 };
                (albedo * pdf, pdf)
            }
            Sheet::Screen { open, cos } => {
                let along = -w[0] * wo[0] - w[1] * wo[1] - w[2] * wo[2];
                let passing = if along > cos { 1.0 / (TAU as f32 * (1.0 - cos)) } else { 0.0 };
                let reflected = if w[2] * wo[2] > 0.0 { w[2].abs() / PI as f32 } else { 0.0 };
                let f = open * passing + (1.0 - open) * reflected;
                (f, f)
            }
        }
    }
}

impl Bsdf<4> for At {
    fn eval(&self, w: [f32; 3]) -> [f32; 4] {
        [self.value(w).0; 4]
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.value(w).1
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<4> {
        let wo = self.1;
        let (sin_phi, cos_phi) = (TAU as f32 * u[2]).sin_cos();
        let (w, weight) = match self.0 {
            Sheet::Diffuse { up, down } => {
                let r = u[1].sqrt();
                let side = if u[0] * (up + down) < up { wo[2].signum() } else { -wo[2].signum() };
                ([r * cos_phi, r * sin_phi, (1.0 - u[1]).sqrt() * side], up + down)
            }
            Sheet::Cone { albedo, cos } => {
                let z = 1.0 - u[0] * (1.0 - cos);
                let r = (1.0 - z * z).max(0.0).sqrt();
                let mirror = Vec3::new(-wo[0], -wo[1], wo[2]);
                let (x, y) = mirror.any_orthonormal_pair();
                ((x * (r * cos_phi) + y * (r * sin_phi) + mirror * z).to_array(), albedo)
            }
            Sheet::Screen { open, cos } if u[0] < open => {
                let z = 1.0 - u[1] * (1.0 - cos);
                let r = (1.0 - z * z).max(0.0).sqrt();
                let straight = -Vec3::from(wo);
                let (x, y) = straight.any_orthonormal_pair();
                ((x * (r * cos_phi) + y * (r * sin_phi) + straight * z).to_array(), 1.0)
            }
            Sheet::Screen { .. } => {
                let r = u[1].sqrt();
                ([r * cos_phi, r * sin_phi, (1.0 - u[1]).sqrt() * wo[2].signum()], 1.0)
            }
        };
        BsdfSample::Scattered(DirectionSample { w, weight: [weight; 4], pdf: self.pdf(w).max(1e-12) })
    }

    fn albedo(&self) -> [f32; 4] {
        match self.0 {
            Sheet::Diffuse { up, down } => [up + down; 4],
            Sheet::Cone { albedo, .. } => [albedo; 4],
            Sheet::Screen { .. } => [1.0; 4],
        }
    }

    fn outcomes(&self) -> Outcomes {
        Outcomes::SCATTERED
    }
}

impl Surface for Sheet {
    type At<'a> = At;

    fn at(&self, _: [f32; 2], _: f32, wo: [f32; 3], _: [f32; 4]) -> At {
        At(*self, wo)
    }
}

const GRAY: Sheet = Sheet::Diffuse { up: 0.5, down: 0.3 };
/// A cone of 0.2 rad.
const CONE: Sheet = Sheet::Cone { albedo: 0.8, cos: 0.980_067 };

/// Mean and standard error of linear sRGB over a picture's pixels.
fn statistics(film: &Film) -> [(f64, f64); 3] {
    let n = film.width() * film.height();
    std::array::from_fn(|c| {
        let of = |k: u32| f64::from(film.linear(FilmView::Light, k % film.width(), k / film.width())[c]);
        let mean = (0..n).map(of).sum::<f64>() / f64::from(n);
        let variance = (0..n).map(|k| (of(k) - mean).powi(2)).sum::<f64>() / f64::from(n - 1);
        (mean, (variance / f64::from(n)).sqrt())
    })
}

/// Cameras straight above the sheet's middle, and at 45 degrees; so narrow that all pixels see the same.
fn cameras() -> [Camera; 2] {
    [Vec3::new(0.0, 0.0, 10.0), Vec3::new(-10.0, 0.0, 10.0)].map(|from| Camera::new(from, Vec3::ZERO, Vec3::Y, 1e-4))
}

fn seen(scene: &Scene, camera: &Camera, surface: &impl Surface, samples: u32) -> [(f64, f64); 3] {
    let mut film = Film::new(SIDE, SIDE).unwrap();
    let options = RenderOptions { samples, depth: 3, seed: 7 };
    render(scene, camera, surface, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
    statistics(&film)
}

fn assert_seen(what: &str, got: [(f64, f64); 3], want: [f64; 3]) {
    let largest = want.into_iter().fold(0.0, f64::max);
    for (c, ((mean, se), want)) in got.into_iter().zip(want).enumerate() {
        assert!((mean - want).abs() <= 5.0 * se, "{what}, channel {c}: {mean}, want {want}, standard error {se}");
        // More noise would hide errors.
        assert!(se < 0.05 * largest, "{what}, channel {c}: standard error {se} of {largest}");
    }
}

fn scene(lights: &[Light], sky: &Environment, way: LightSampling) -> Scene {
    let mut scene = Scene::new(Mesh::flat(20.0), lights.to_vec(), sky.clone());
    scene.sampling = way;
    scene
}

/// Irradiance from above and from below of a texel of a sky of `width` by `height` texels, of radiance 1.
fn of_texel(row: usize, width: usize, height: usize) -> [f64; 2] {
    let [a, b] = [row, row + 1].map(|k| PI * k as f64 / height as f64);
    let squared = |theta: f64| theta.sin().powi(2);
    let half = TAU / width as f64 / 2.0;
    let above = half * (squared(b.min(PI / 2.0)) - squared(a.min(PI / 2.0)));
    [above, half * (squared(a.max(PI / 2.0)) - squared(b.max(PI / 2.0)))]
}

/// Irradiance of a rectangle of radiance 1 on a sheet at the origin that faces z (Lambert 1760): the polygon
/// lies above the sheet and shines on it.
fn of_rectangle(light: &Light) -> f64 {
    let [e, f] = light.edges;
    let corners = [light.corner, light.corner + e, light.corner + e + f, light.corner + f];
    let corners = corners.map(|c| c.as_dvec3().normalize());
    let mut sum = 0.0;
    for k in 0..4 {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        let across = a.cross(b);
        sum += 0.5 * across.length().atan2(a.dot(b)) * across.normalize().dot(DVec3::Z);
    }
    sum.abs()
}

#[test]
fn skies_of_one_radiance_light_a_sheet_by_it() {
    for radiance in RADIANCES {
        let l = f64::from(radiance);
        for way in WAYS {
            for (k, camera) in cameras().iter().enumerate() {
                let what = |of: &str| format!("{of} of {radiance}, {way:?}, camera {k}");
                let scene = |sky| scene(&[], &sky, way);
                let sky = scene(Environment::constant(radiance));
                assert_seen(&what("sky, diffuse"), seen(&sky, camera, &GRAY, 16), [0.8 * l; 3]);
                // One in a hundred directions of a whole sky is in the cone.
                let samples = if way == LightSampling::Sources { 128 } else { 16 };
                assert_seen(&what("sky, cone"), seen(&sky, camera, &CONE, samples), [0.8 * l; 3]);
                let above = scene(Environment::above(radiance));
                assert_seen(&what("sky above, diffuse"), seen(&above, camera, &GRAY, 16), [0.5 * l; 3]);
                assert_seen(&what("sky above, cone"), seen(&above, camera, &CONE, samples), [0.8 * l; 3]);
            }
        }
    }
}

/// All of a sky's power in one texel: at the pole, beside it, about and across the horizon, below it, and in
/// pictures of few texels.
#[test]
#[ignore = "slow: 5 s: suns light a sheet by their texel"]
fn suns_light_a_sheet_by_their_texel() {
    let [down, _] = cameras();
    for (width, height, row) in [
        (8, 4, 0),
        (8, 4, 1),
        (8, 4, 2),
        (9, 5, 2),
        (32, 16, 3),
        (1, 1, 0),
        (2, 1, 0),
        (1, 2, 1),
        (64, 32, 15),
        (512, 256, 0),
        (2048, 1024, 0),
        (2048, 1024, 300),
        (2048, 1024, 600),
    ] {
        let [up, under] = of_texel(row, width, height);
        for radiance in RADIANCES {
            let mut texels = vec![[0.0; 3]; width * height];
            texels[row * width + width / 3] = [radiance; 3];
            let sky = Environment::picture(width, texels).unwrap();
            let want = f64::from(radiance) / PI * (0.5 * up + 0.3 * under);
            for way in WAYS {
                // By scattering alone a small sun is hit too rarely.
                if way == LightSampling::Scattering && up + under < 0.03 * PI {
                    continue;
                }
                let samples = if way == LightSampling::Scattering { 64 } else { 16 };
                let got = seen(&scene(&[], &sky, way), &down, &GRAY, samples);
                assert_seen(&format!("{width} x {height}, row {row}, {radiance}, {way:?}"), got, [want; 3]);
            }
        }
    }
}

/// A lobe that the edge of a sky's lit texel cuts in half, and one that lies within it.
#[test]
fn narrow_lobes_see_the_texels_that_they_meet() {
    let [_, beside] = cameras();
    for (lit, share) in [(vec![1], 0.5), (vec![2], 0.5), (vec![1, 2], 1.0)] {
        for radiance in RADIANCES {
            let mut texels = vec![[0.0; 3]; 8];
            lit.iter().for_each(|k| texels[*k] = [radiance; 3]);
            let sky = Environment::picture(4, texels).unwrap();
            for way in WAYS {
                let got = seen(&scene(&[], &sky, way), &beside, &CONE, 32);
                let want = [0.8 * share * f64::from(radiance); 3];
                assert_seen(&format!("texels {lit:?} of {radiance}, {way:?}"), got, want);
            }
        }
    }
}

#[test]
fn colors_of_skies_are_those_of_what_they_light() {
    let [down, _] = cameras();
    for (srgb, samples) in [([1.0, 0.0, 0.0], 12), ([0.0, 1.0, 0.0], 12), ([0.0, 0.0, 1.0], 32), ([0.02, 0.5, 3.0], 32)]
    {
        for radiance in RADIANCES {
            // From everywhere, and from one texel beside gray ones.
            let color = srgb.map(|v| v * radiance);
            let even = Environment::picture(1, vec![color]).unwrap();
            let mut texels = vec![[0.1 * radiance; 3]; 32];
            texels[3] = color;
            let one = Environment::picture(8, texels).unwrap();
            let part = of_texel(0, 8, 4)[0] / PI;
            for way in WAYS {
                let what = |of: &str| format!("{of} of {color:?}, {way:?}");
                let got = seen(&scene(&[], &even, way), &down, &GRAY, samples);
                assert_seen(&what("sky"), got, color.map(|v| 0.8 * f64::from(v)));
                let got = seen(&scene(&[], &one, way), &down, &GRAY, samples);
                let gray = 0.1 * f64::from(radiance);
                let want = color.map(|v| 0.8 * gray + 0.5 * part * (f64::from(v) - gray));
                assert_seen(&what("texel"), got, want);
            }
        }
    }
}

/// Rectangles large and small, near and far, straight above and aslant.
fn rectangles() -> [Light; 7] {
    let facing = |x: f32, y: f32, z: f32, size: f32| Light::facing(Vec3::new(x, y, z), Vec3::ZERO, size, 1.0);
    let flat = |z: f32, x: f32, y: f32| Light {
        corner: Vec3::new(-0.3 * x, -0.6 * y, z),
        edges: [Vec3::new(0.0, y, 0.0), Vec3::new(x, 0.0, 0.0)],
        radiance: 1.0,
    };
    [
        facing(0.0, 0.0, 1.0, 2.0),
        facing(3.0, 1.0, 4.0, 2.0),
        facing(30.0, -20.0, 9.0, 5.0),
        facing(0.3, 0.0, 0.4, 0.01),
        facing(4000.0, 1000.0, 9000.0, 30.0),
        flat(1.0, 12.0, 7.0),
        flat(500.0, 2000.0, 10.0),
    ]
}

#[test]
fn rectangles_light_a_sheet_by_their_irradiance() {
    // The camera looks from behind the lamps.
    let [down, _] = cameras();
    for (k, light) in rectangles().into_iter().enumerate() {
        let irradiance = of_rectangle(&light);
        for radiance in RADIANCES {
            let light = Light { radiance, ..light };
            for way in WAYS {
                if way == LightSampling::Scattering && irradiance < 0.02 * PI {
                    continue;
                }
                let samples = if way == LightSampling::Scattering { 64 } else { 32 };
                let got = seen(&scene(&[light], &Environment::constant(0.0), way), &down, &GRAY, samples);
                let want = 0.5 * irradiance / PI * f64::from(radiance);
                assert_seen(&format!("rectangle {k} of {radiance}, {way:?}"), got, [want; 3]);
            }
        }
    }
}

/// A lamp occludes lamps and sky behind it and is invisible from behind, with all strategies alike.
#[test]
fn lamps_and_a_sky_add_up() {
    let [_, beside] = cameras();
    let large = Light::facing(Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, 4.0, 2.0);
    let small = Light::facing(Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO, 1.0, 0.5);
    let apart = Light::facing(Vec3::new(0.0, 6.0, 4.0), Vec3::ZERO, 2.0, 30.0);
    let away = Light::facing(Vec3::new(2.0, -2.0, 2.0), Vec3::new(4.0, -4.0, 4.0), 2.0, 50.0);
    let [f, g, h] = [&large, &small, &apart].map(of_rectangle);
    for radiance in RADIANCES {
        let l = f64::from(radiance);
        let up = l * (PI - f - h) + 2.0 * (f - g) + 0.5 * g + 30.0 * h;
        let want = [(0.5 * up + 0.3 * PI * l) / PI; 3];
        for way in WAYS {
            let lights = [large, away, small, apart];
            let got = seen(&scene(&lights, &Environment::constant(radiance), way), &beside, &GRAY, 64);
            assert_seen(&format!("four lamps, sky of {radiance}, {way:?}"), got, want);
        }
    }
}

/// A cloth is white under an even sky, and its light is linear in the sky's; under lamps and suns all
/// strategies agree.
#[test]
fn cloths_are_lit_in_proportion_and_alike_in_all_ways() {
    // By rays: diffracted light has lobes so narrow that directions drawn from a whole sky miss them.
    let options = ClothOptions { sigma_per_um: Some(0.0), noise: false, ..ClothOptions::RAYS };
    let cloth = small_cloth::cloth(&small_cloth::RED_BLUE, &options);
    let camera = Camera::new(Vec3::new(-6.0, 3.0, 10.0), Vec3::ZERO, Vec3::Y, 0.2);
    let shown = |lights: &[Light], sky: &Environment, way, samples| {
        let mut film = Film::new(SIDE, SIDE).unwrap();
        let options = RenderOptions { samples, depth: 8, seed: 9 };
        let scene = scene(lights, sky, way);
        render(&scene, &camera, &cloth, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
        film
    };
    let one = shown(&[], &Environment::constant(1.0), LightSampling::Both, 4);
    for way in WAYS {
        let [_, (y, se), _] = statistics(&shown(&[], &Environment::constant(1.0), way, 16));
        // As white as the model's energies add up.
        assert!((y - 1.0).abs() < 0.01 + 5.0 * se, "{way:?}: {y}, standard error {se}");
    }
    for radiance in [0.01f32, 100.0] {
        let other = shown(&[], &Environment::constant(radiance), LightSampling::Both, 4);
        for k in 0..SIDE * SIDE {
            let of = |film: &Film| film.xyz(FilmView::Light, k % SIDE, k / SIDE)[1];
            assert!((of(&other) - radiance * of(&one)).abs() < 1e-4 * radiance, "pixel {k} under {radiance}");
        }
    }
    let mut sum = [0.0; 3];
    for c in 0..3 {
        let srgb: [f32; 3] = std::array::from_fn(|k| f32::from(k == c));
        let film = shown(&[], &Environment::picture(1, vec![srgb]).unwrap(), LightSampling::Both, 4);
        statistics(&film).into_iter().enumerate().for_each(|(k, (mean, _))| sum[k] += mean);
    }
    for (c, (mean, _)) in statistics(&one).into_iter().enumerate() {
        assert!((sum[c] / mean - 1.0).abs() < 1e-4, "channel {c}: {} of the colors' {mean}", sum[c]);
    }
    let mut texels = vec![[0.0; 3]; 32];
    texels[3] = [1.0; 3];
    let sun = Environment::picture(8, texels).unwrap();
    let lamp = Light::facing(Vec3::new(8.0, 4.0, 12.0), Vec3::ZERO, 8.0, 1.0);
    for (what, lights, sky) in [("sun", vec![], sun), ("lamp", vec![lamp], Environment::constant(0.1))] {
        let [a, b, c] = WAYS.map(|way| statistics(&shown(&lights, &sky, way, 48))[1]);
        for ((y, se), way) in [(b, "sources"), (c, "scattering")] {
            let spread = se.hypot(a.1);
            assert!((y - a.0).abs() < 5.0 * spread, "{what}: by {way} {y}, by both {}, standard error {spread}", a.0);
            assert!(spread < 0.06 * a.0, "{what}: standard error {spread} of {}", a.0);
        }
    }
}

/// Strands use the same lamps and skies: a floor beside them is lit by its irradiance, and a fiber alike with
/// all strategies.
#[test]
#[ignore = "slow: 5 s: strands and floors beside them are lit the same way"]
fn strands_and_floors_beside_them_are_lit_the_same_way() {
    let [down, _] = cameras();
    let shown = |strand_mm: f32, floor_mm: f32, lights: &[Light], sky: &Environment, way, samples| {
        let mut strands = Strands::new(Basis::Linear);
        let ends = [[-40.0, 0.0, strand_mm, 0.04], [40.0, 0.0, strand_mm, 0.04]];
        strands.push(&ends, "strand", "1").unwrap();
        let model = DielectricFiber::new(DielectricParameters { radius_um: 40.0, ..Default::default() }).unwrap();
        let fiber = StrandFiber::new(model.into());
        let mut scene = StrandScene::new(strands, StrandShape::Tube, fiber, lights.to_vec(), sky.clone());
        scene.props = vec![Prop { shape: Shape::Floor { height_mm: floor_mm }, albedo: 0.5 }];
        scene.sampling = way;
        let mut film = Film::new(SIDE, SIDE).unwrap();
        let options = RenderOptions { samples, depth: 64, seed: 7 };
        render_strands(&scene, &down, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
        statistics(&film)
    };
    let lamp = Light::facing(Vec3::new(1.0, 2.0, 4.0), Vec3::ZERO, 3.0, 2.0);
    let mut texels = vec![[0.0; 3]; 32];
    texels[3] = [0.4, 2.0, 9.0];
    let sun = Environment::picture(8, texels).unwrap();
    for (what, lights, sky) in [
        ("sky", vec![], Environment::constant(1.0)),
        ("sun", vec![], sun),
        ("lamp and sky", vec![lamp], Environment::constant(0.1)),
    ] {
        let irradiance: [f64; 3] = match what {
            "sky" => [PI; 3],
            "sun" => [0.4, 2.0, 9.0].map(|v| v * of_texel(0, 8, 4)[0]),
            _ => [2.0 * of_rectangle(&lamp) + 0.1 * (PI - of_rectangle(&lamp)); 3],
        };
        for way in WAYS {
            // The strand is hidden below the floor.
            let got = shown(-1.0, 0.0, &lights, &sky, way, 32);
            assert_seen(&format!("floor under {what}, {way:?}"), got, irradiance.map(|e| 0.5 * e / PI));
        }
        let [a, b, c] = WAYS.map(|way| shown(0.0, -3.0, &lights, &sky, way, 40)[1]);
        for ((y, se), way) in [(b, "sources"), (c, "scattering")] {
            let spread = se.hypot(a.1);
            assert!((y - a.0).abs() < 5.0 * spread, "{what}: by {way} {y}, by both {}, standard error {spread}", a.0);
            assert!(spread < 0.1 * a.0, "{what}: standard error {spread} of {}", a.0);
        }
    }
}

/// Three screens over a floor.
fn screens(lights: &[Light], sky: &Environment, floor: f32, way: LightSampling) -> Scene {
    let mut mesh = Mesh::default();
    for height in [0.0, 2.0, 4.5] {
        let mut sheet = Mesh::flat(400.0);
        sheet.positions.iter_mut().for_each(|p| p.z += height);
        mesh.append(sheet);
    }
    let mut scene = Scene::new(mesh, lights.to_vec(), sky.clone());
    scene.sampling = way;
    scene.props = vec![Prop { shape: Shape::Floor { height_mm: -3.0 }, albedo: floor }];
    scene
}

/// Light that comes through one, two and three screens is the same whether chains follow it from the floor
/// or scattering alone is sampled: that of a small lamp, with and without limits of scatterings, and of an
/// uneven sky. Chains have less noise.
#[test]
fn light_through_screens_does_not_depend_on_how_it_is_found() {
    let screen = Sheet::Screen { open: 0.45, cos: 0.9995 };
    let lamp = Light::facing(Vec3::new(4.0, 2.0, 30.0), Vec3::ZERO, 6.0, 20.0);
    let texels = (0..32).map(|k| [if k == 3 { 40.0 } else { 0.2 + 0.01 * k as f32 }; 3]).collect();
    let sky = Environment::picture(8, texels).unwrap();
    let camera = Camera::new(Vec3::new(-6.0, 0.0, 12.0), Vec3::ZERO, Vec3::Y, 1e-4);
    let seen = |scene: &Scene, samples: u32, depth: u32| {
        let mut film = Film::new(SIDE, SIDE).unwrap();
        let options = RenderOptions { samples, depth, seed: 11 };
        render(scene, &camera, &screen, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
        statistics(&film)[1]
    };
    let dark = Environment::constant(0.0);
    for (what, lights, sky) in [("lamp", &[lamp][..], &dark), ("sky", &[], &sky), ("both", &[lamp], &sky)] {
        for depth in [2, 3, 5, 1000] {
            let of = |way: LightSampling| screens(lights, sky, 0.8, way);
            let (got, se) = seen(&of(LightSampling::Both), 128, depth);
            let (want, want_se) = seen(&of(LightSampling::Scattering), 256, depth);
            let error = se.hypot(want_se);
            assert!((got - want).abs() < 5.0 * error, "{what}, depth {depth}: {got}, want {want}, error {error}");
            // Half as many samples.
            assert!(se < want_se, "{what}, depth {depth}: standard error {se}, by scattering {want_se}");
        }
    }
}

/// Screens and a floor that absorb nothing, under an even sky.
#[test]
fn white_screens_in_a_white_room_are_white() {
    let screen = Sheet::Screen { open: 0.45, cos: 0.9995 };
    let far = Light::facing(Vec3::new(0.0, 0.0, 3000.0), Vec3::ZERO, 800.0, 1.0);
    for lights in [&[][..], &[far]] {
        let scene = screens(lights, &Environment::constant(1.0), 1.0, LightSampling::Both);
        let camera = Camera::new(Vec3::new(-6.0, 0.0, 12.0), Vec3::ZERO, Vec3::Y, 1e-4);
        let mut film = Film::new(SIDE, SIDE).unwrap();
        let options = RenderOptions { samples: 64, depth: 4096, seed: 2 };
        render(&scene, &camera, &screen, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
        let (mean, se) = statistics(&film)[1];
        assert!((mean - 1.0).abs() < 5.0 * se.max(1e-4), "{mean}, standard error {se}");
    }
}
