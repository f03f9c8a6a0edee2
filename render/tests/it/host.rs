//! Tests of the host with surfaces of known light: a white diffuse sheet in a white room, a half transparent
//! one, light sources.

use plywave::bsdf::{DirectionSample, Outcomes};
use plywave::{Bsdf, BsdfSample};
use plywave_render::{
    Environment, Exit, ExplicitFibers, Facts, Film, FilmView, Lamps, MAX_SCATTERINGS, Mesh, MeshNotes, PathNumbers,
    RenderOptions, Scene, Setup, Surface, WAVELENGTHS, render, render_matter,
};
use rand::RngExt;
use std::f32::consts::{PI, TAU};
use std::sync::atomic::AtomicBool;

/// Surface that reflects a share `up` of the light and transmits `down`, both diffuse.
#[derive(Clone, Copy)]
struct Diffuse {
    up: f32,
    down: f32,
}

/// A [`Diffuse`] sheet seen from one side.
struct At(Diffuse, f32);

impl At {
    fn share(&self, z: f32) -> f32 {
        if z * self.1 > 0.0 { self.0.up } else { self.0.down }
    }
}

impl Bsdf<4> for At {
    fn eval(&self, wo: [f32; 3]) -> [f32; 4] {
        [self.share(wo[2]) * wo[2].abs() / PI; 4]
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        self.eval(wo)[0] / (self.0.up + self.0.down)
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<4> {
        let all = self.0.up + self.0.down;
        let (r, phi) = (u[1].sqrt(), TAU * u[2]);
        let z = (1.0 - r * r).max(0.0).sqrt() * if u[0] * all < self.0.up { self.1 } else { -self.1 };
        let w = [r * phi.cos(), r * phi.sin(), z];
        BsdfSample::Scattered(DirectionSample { w, weight: [all; 4], pdf: self.pdf(w) })
    }

    fn albedo(&self) -> [f32; 4] {
        [self.0.up + self.0.down; 4]
    }

    fn outcomes(&self) -> Outcomes {
        Outcomes::SCATTERED
    }
}

impl Surface for Diffuse {
    type At<'a> = At;

    fn at(&self, _: [f32; 2], _: f32, wo: [f32; 3], _: [f32; 4]) -> At {
        At(*self, wo[2].signum())
    }
}

fn facts() -> Facts {
    Facts {
        software: "plywave 0".into(),
        cloth: "Leinen, gr\u{fc}n".into(),
        spec: "linen.toml".into(),
        digest: "sha256:00".into(),
        scene: "drape".into(),
        seed: 3,
        samples: 7,
        exposure: 0.5,
        cut_share: 0.01,
    }
}

/// Mean Y of the picture's middle, and the number of samples that went into it.
fn middle(setup: Setup, surface: &Diffuse, samples: u32) -> f32 {
    let (scene, camera) = setup.scene(20.0, None, None);
    let mut film = Film::new(24, 24).unwrap();
    let options = RenderOptions { samples, depth: 8, seed: 1 };
    render(&scene, &camera, surface, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
    let of = |k: u32| film.xyz(FilmView::Light, 8 + k % 8, 8 + k / 8)[1];
    (0..64).map(of).sum::<f32>() / 64.0
}

#[test]
fn a_white_sheet_in_a_white_room_is_white() {
    for (up, down) in [(1.0, 0.0), (0.3, 0.7)] {
        let y = middle(Setup::Furnace, &Diffuse { up, down }, 64);
        assert!((y - 1.0).abs() < 0.01, "up {up}, down {down}: {y}");
    }
    // The noise comes from the drawn wavelengths: some 0.1 per sample, over 64 pixels with 512 samples.
    let y = middle(Setup::Furnace, &Diffuse { up: 0.3, down: 0.2 }, 512);
    assert!((y - 0.5).abs() < 0.003, "{y}");
}

#[test]
fn lamps_give_the_light_they_are_scaled_to() {
    // The lamp's irradiance at the middle is pi times the cosine: radiance of a white sheet is the cosine.
    let cosine = 3.2 / 1.2f32.hypot(0.9).hypot(3.2);
    let y = middle(Setup::Front, &Diffuse { up: 1.0, down: 0.0 }, 64);
    assert!((y / cosine - 1.0).abs() < 0.03, "front: {y}, cosine {cosine}");
    let y = middle(Setup::Back, &Diffuse { up: 0.0, down: 1.0 }, 64);
    assert!((y - 1.0).abs() < 0.03, "back: {y}");
    assert!(middle(Setup::Back, &Diffuse { up: 1.0, down: 0.0 }, 16) < 1e-6);
}

#[test]
fn renders_go_on_to_the_same_picture() {
    let surface = Diffuse { up: 0.5, down: 0.4 };
    let (scene, camera) = Setup::Drape.scene(20.0, None, None);
    let whole = |first: u32, last: u32, film: Film| {
        let mut film = film;
        for samples in [first, last] {
            let options = RenderOptions { samples, depth: 4, seed: 3 };
            render(&scene, &camera, &surface, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
        }
        film
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sums");
    let part = whole(1, 3, Film::new(20, 12).unwrap());
    let of = |mesh: &str| [("spec".to_string(), "a".to_string()), ("mesh".to_string(), mesh.to_string())];
    std::fs::write(&path, part.sums(&of("b")).unwrap()).unwrap();
    let refused = Film::resume(&path, &of("c"), 20, 12).unwrap_err().to_string();
    assert!(refused.contains("not the same mesh"), "{refused}");
    assert!(Film::resume(&path, &of("b")[..1], 20, 12).is_err());
    assert!(Film::resume(&path, &of("b"), 12, 20).is_err());
    let back = Film::resume(&path, &of("b"), 20, 12).unwrap();
    assert_eq!(back, part);
    let (a, b) = (whole(7, 7, back), whole(7, 7, Film::new(20, 12).unwrap()));
    for y in 0..12 {
        for x in 0..20 {
            let (a, b) = (a.xyz(FilmView::Light, x, y), b.xyz(FilmView::Light, x, y));
            assert!((0..3).all(|k| (a[k] - b[k]).abs() <= 1e-5 * (1.0 + b[k])), "{a:?} {b:?}");
        }
    }
    let exr = folder.path().join("a.exr");
    std::fs::write(&exr, a.exr(&facts()).unwrap()).unwrap();
    let env = plywave_render::Environment::load(&exr, None);
    assert!(env.is_ok(), "{:?}", env.err());
    assert_eq!(a.image(FilmView::Albedo, 0.0).dimensions(), (20, 12));
}

#[test]
fn parts_add_up_to_the_picture() {
    let surface = Diffuse { up: 0.6, down: 0.2 };
    let (scene, camera) = Setup::Swatch.scene(3.0, None, None);
    let options = RenderOptions { samples: 3, depth: 8, seed: 1 };
    let stop = AtomicBool::new(false);
    let pixels = |mut film: Film| {
        render(&scene, &camera, &surface, &mut film, &options, &stop, &mut |_| Ok(())).unwrap();
        let at = |y: u32| (0..film.width()).map(move |x| (x, y));
        (0..film.height()).flat_map(at).map(|(x, y)| film.linear(FilmView::Light, x, y)).collect::<Vec<_>>()
    };
    // No whole number of tiles.
    let (width, height, parts) = (75, 50, 3);
    let whole = pixels(Film::new(width, height).unwrap());
    let mut sum = vec![[0.0; 3]; whole.len()];
    for part in 0..parts {
        let mut seen = 0;
        for (sum, pixel) in sum.iter_mut().zip(pixels(Film::new_part(width, height, part, parts).unwrap())) {
            seen += usize::from(pixel != [0.0; 3]);
            *sum = [0, 1, 2].map(|c| sum[c] + pixel[c]);
        }
        assert!((1..whole.len() / 2).contains(&seen), "part {part} has {seen} pixels");
    }
    assert!(whole.iter().any(|pixel| pixel[1] > 0.0));
    assert_eq!(sum, whole);
}

#[test]
fn stopped_renders_say_so() {
    let (scene, camera) = Setup::Folds.scene(20.0, None, None);
    let mut film = Film::new(8, 8).unwrap();
    let options = RenderOptions { samples: 4, depth: 4, seed: 3 };
    let surface = Diffuse { up: 0.5, down: 0.4 };
    let stopped = render(&scene, &camera, &surface, &mut film, &options, &AtomicBool::new(true), &mut |_| Ok(()));
    assert!(stopped.is_err() && film.samples() == 0);
}

/// A flat sheet at z = 0, seen from above at distance 2.5 sizes.
fn sheet(samples: u32, surface: &Diffuse) -> Film {
    let (scene, camera) = Setup::Back.scene(20.0, None, None);
    let mut film = Film::new(16, 16).unwrap();
    let options = RenderOptions { samples, depth: 4, seed: 5 };
    render(&scene, &camera, surface, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
    film
}

#[test]
fn first_hits_have_their_normal_depth_and_albedo() {
    let film = sheet(4, &Diffuse { up: 0.2, down: 0.4 });
    for (x, y) in [(8, 8), (3, 12), (15, 0)] {
        assert_eq!(film.normal(x, y), [0.0, 0.0, 1.0]);
        // Depth counts along the axis: the same all over the sheet.
        assert!((film.depth(x, y) - 50.0).abs() < 1e-3, "{}", film.depth(x, y));
        let y = film.xyz(FilmView::Albedo, x, y)[1];
        assert!((y - 0.6).abs() < 0.1, "{y}");
    }
    // Folds have normals to both sides, all toward the camera; beside the cloth there is none.
    let (mut scene, camera) = Setup::Drape.scene(20.0, None, None);
    scene.props.clear();
    let mut film = Film::new(32, 32).unwrap();
    let options = RenderOptions { samples: 2, depth: 2, seed: 5 };
    let surface = Diffuse { up: 0.2, down: 0.4 };
    render(&scene, &camera, &surface, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
    let toward = [0.0, -2.3, 1.29f32].map(|v| v / 2.3f32.hypot(1.29));
    let mut beside = 0;
    for k in 0..32 * 32 {
        let (n, depth) = (film.normal(k % 32, k / 32), film.depth(k % 32, k / 32));
        let length = n.iter().map(|v| v * v).sum::<f32>();
        match depth > 0.0 {
            true => assert!((length - 1.0).abs() < 1e-5 && (0..3).map(|i| n[i] * toward[i]).sum::<f32>() > -0.3),
            false => beside += u32::from(length == 0.0),
        }
    }
    assert!(beside > 20, "{beside}");
}

/// A sheet of which light leaves upwards with a random share of it.
struct Flickering;

impl ExplicitFibers for Flickering {
    fn follow(
        &self,
        _: [f32; 2],
        w: [f32; 3],
        _: [f32; WAVELENGTHS],
        rng: &mut PathNumbers,
        _: &mut Lamps<'_>,
    ) -> Option<Exit> {
        let weight = [rng.random::<f32>().powi(3); WAVELENGTHS];
        Some(Exit { offset_um: [0.0; 3], w: [w[0], w[1], w[2].abs()], weight, was_drawn: false })
    }
}

/// Mean over pixels of the variance that films tell, and of that of pixels rendered again with other seeds.
fn variances(film_of: impl Fn(u64, &mut Film)) -> [f64; 2] {
    let (mut told, mut seen) = (0.0f64, 0.0f64);
    let seeds = 24;
    let films: Vec<Film> = (0..seeds)
        .map(|seed| {
            let mut film = Film::new(12, 12).unwrap();
            film_of(seed, &mut film);
            film
        })
        .collect();
    for k in 0..144 {
        let green: Vec<f64> = films.iter().map(|f| f.linear(FilmView::Light, k % 12, k / 12)[1].into()).collect();
        let mean = green.iter().sum::<f64>() / seeds as f64;
        seen += green.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (seeds - 1) as f64;
        told += films.iter().map(|f| f64::from(f.variance(k % 12, k / 12).unwrap()[1])).sum::<f64>() / seeds as f64;
    }
    [told, seen]
}

/// Of 144 * 23 degrees of freedom: 2.5 % standard error, of variances whose own samples have heavy tails.
/// Evenly spread numbers have less variance than told, at thirteen samples by a factor of two to four.
#[test]
fn variance_is_that_of_the_mean_or_above() {
    let surface = Diffuse { up: 0.0, down: 0.5 };
    let (scene, camera) = Setup::Back.scene(20.0, None, None);
    let of = |seed| RenderOptions { samples: 13, depth: 3, seed };
    let stop = AtomicBool::new(false);
    let [told, seen] =
        variances(|seed, film| render(&scene, &camera, &surface, film, &of(seed), &stop, &mut |_| Ok(())).unwrap());
    assert!((1.5..5.0).contains(&(told / seen)), "{told} {seen}");
    let (scene, camera) = Setup::Front.scene(20.0, None, Some(Environment::constant(1.0)));
    let [told, seen] = variances(|seed, film| {
        render_matter(&scene, &camera, &Flickering, film, &of(seed), &stop, &mut |_| Ok(())).unwrap();
    });
    assert!((told / seen - 1.0).abs() < 0.1, "{told} {seen}");
    assert!(sheet(1, &surface).variance(3, 3).is_none());
}

/// Attributes of an EXR's first header, read by hand: name, type, bytes.
fn attributes(exr: &[u8]) -> Vec<(String, String, Vec<u8>)> {
    assert_eq!(exr[..4], [0x76, 0x2f, 0x31, 0x01], "magic number");
    let mut at = 8;
    let word = |at: &mut usize| {
        let end = exr[*at..].iter().position(|b| *b == 0).unwrap();
        let text = exr[*at..*at + end].iter().map(|b| char::from(*b)).collect::<String>();
        *at += end + 1;
        text
    };
    let mut list = Vec::new();
    while exr[at] != 0 {
        let (name, kind) = (word(&mut at), word(&mut at));
        let size = u32::from_le_bytes(exr[at..at + 4].try_into().unwrap()) as usize;
        list.push((name, kind, exr[at + 4..at + 4 + size].to_vec()));
        at += 4 + size;
    }
    list
}

#[test]
fn exr_files_tell_what_they_are_of() {
    let film = sheet(4, &Diffuse { up: 0.2, down: 0.4 });
    let bytes = film.exr(&facts()).unwrap();
    let list = attributes(&bytes);
    assert!(list.is_sorted_by(|a, b| a.0 < b.0), "the same bytes in every run");
    let of = |name: &str| &list.iter().find(|a| a.0 == name).unwrap_or_else(|| panic!("no {name}")).2;
    let latin = |bytes: &[u8]| bytes.iter().map(|b| char::from(*b)).collect::<String>();
    for (name, want) in [
        ("software", "plywave 0"),
        ("plywave.cloth", "Leinen, gr\u{fc}n"),
        ("plywave.digest", "sha256:00"),
        ("plywave.seed", "3"),
        ("plywave.samples", "7"),
    ] {
        assert_eq!(latin(of(name)), want);
    }
    let numbers: Vec<f32> = of("chromaticities").as_chunks().0.iter().map(|c| f32::from_le_bytes(*c)).collect();
    assert_eq!(numbers, [0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290]);
    let channels = latin(of("channels"));
    let names: Vec<&str> = channels.split('\0').filter(|w| w.chars().all(|c| c.is_ascii_graphic())).collect();
    for name in ["R", "albedo.G", "normal.X", "depth.Z", "variance.B"] {
        assert!(names.contains(&name), "{name} of {names:?}");
    }
    // The layers have the film's values.
    let image = exr::prelude::read_all_flat_layers_from_file;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.exr"), &bytes).unwrap();
    let image = image(folder.path().join("a.exr")).unwrap();
    let value = |name: &str| {
        let list = &image.layer_data[0].channel_data.list;
        list.iter().find(|c| c.name.to_string() == name).unwrap().sample_data.value_by_flat_index(5 * 16 + 9).to_f32()
    };
    assert_eq!(value("depth.Z"), film.depth(9, 5));
    assert_eq!(value("normal.Z"), 1.0);
    assert_eq!(value("B"), film.linear(FilmView::Light, 9, 5)[2]);
    assert_eq!(value("variance.G"), film.variance(9, 5).unwrap()[1]);
    assert_eq!(value("albedo.R"), film.linear(FilmView::Albedo, 9, 5)[0]);
}

#[test]
fn png_files_tell_what_they_are_of() {
    let film = sheet(1, &Diffuse { up: 0.2, down: 0.4 });
    let image = film.image(FilmView::Light, 0.0);
    let bytes = plywave_render::png(&image, &facts().entries()).unwrap();
    // Chunks by hand: length, type, data, checksum.
    let (mut at, mut texts) = (8, Vec::new());
    while at < bytes.len() {
        let size = u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        if &bytes[at + 4..at + 8] == b"iTXt" {
            let text = String::from_utf8(bytes[at + 8..at + 8 + size].to_vec()).unwrap();
            let parts: Vec<String> = text.split('\0').map(str::to_string).collect();
            texts.push((parts[0].clone(), parts.last().unwrap().clone()));
        }
        at += size + 12;
    }
    for (name, value) in facts().entries() {
        assert!(texts.contains(&(name.to_string(), value.clone())), "{name} = {value} in {texts:?}");
    }
    assert_eq!(image::load_from_memory(&bytes).unwrap().to_rgb8(), image);
}

#[test]
fn skies_are_refused_by_their_header() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    let good = sheet(1, &Diffuse { up: 0.2, down: 0.4 }).exr(&facts()).unwrap();
    // The data window of 16 x 16 becomes one of some 10^5 x 10^5 texels.
    let mut huge = good.clone();
    let mark = b"dataWindow\0box2i\0";
    let at = huge.windows(mark.len()).position(|w| w == mark).unwrap() + mark.len() + 4 + 8;
    for (size, words) in [(119_999i32, "texels"), (9_999, "cut off")] {
        huge[at..at + 4].copy_from_slice(&size.to_le_bytes());
        huge[at + 4..at + 8].copy_from_slice(&size.to_le_bytes());
        std::fs::write(&path, &huge).unwrap();
        let error = plywave_render::Environment::load(&path, None).unwrap_err().to_string();
        assert!(error.contains("sky.exr") && error.contains(words), "{error}");
    }
    assert!(plywave_render::Environment::load(folder.path(), None).is_err());
}

#[test]
fn films_too_large_for_memory_are_refused() {
    let error = Film::new(u32::MAX, u32::MAX).unwrap_err().to_string();
    assert!(error.contains("GiB of memory"), "{error}");
}

/// A mesh of `tests/data/field` in a scene, 20 mm wide, and its notes.
fn field(name: &str) -> (Scene, MeshNotes) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/field").join(name);
    let (mesh, notes) = Mesh::obj(&path, 1e5, 20.0).unwrap();
    (Scene::new(mesh, Vec::new(), Environment::constant(1.0)), notes)
}

/// Meshes from the field, seen along -z: the share of the square that they cover, and no omitted face.
#[test]
fn meshes_of_the_field_are_whole() {
    for (name, want) in [
        ("obj_concave/l_shape.obj", 0.75),
        ("obj_concave/l_shape_turned.obj", 0.75),
        ("obj_far_origin/survey.obj", 1.0),
        ("obj_latin1/latin1.obj", 1.0),
        ("obj_line_continuation/cont.obj", 1.0),
    ] {
        let (scene, notes) = field(name);
        assert_eq!(
            notes,
            MeshNotes { mm_per_unit: notes.mm_per_unit, middle: notes.middle, ..MeshNotes::default() },
            "{name}"
        );
        // Centers of 64 x 64 pixels, none of which is on an edge.
        let at = |k: i32| (k as f32 - 31.5) / 32.0 * 10.0;
        let met = (0..64 * 64)
            .filter(|k| scene.meet([at(k % 64), at(k / 64), 50.0].into(), [0.0, 0.0, -1.0].into()).is_some());
        assert_eq!(met.count() as f32 / 4096.0, want, "{name}");
    }
}

/// A tube of 16 sides with a visible uv seam, and the same with the seam behind: its normals at the corners
/// are radii, and so are interpolated ones.
#[test]
fn normals_go_on_over_a_seam() {
    for name in ["tube.obj", "tube_turned.obj"] {
        let (scene, _) = field(&format!("obj_seam_normals/{name}"));
        for k in -190..=190 {
            let (x, y) = (0.05 * k as f32 + 0.01, 0.1 * (k % 60) as f32);
            let point = scene.meet([x, y, 50.0].into(), [0.0, 0.0, -1.0].into()).unwrap();
            let (normal, p) = (point.frame.axes[2], point.position);
            let radius = p.x.hypot(p.z);
            let want = [p.x / radius, 0.0, p.z / radius];
            assert!((0..3).all(|c| (normal[c] - want[c]).abs() < 1e-4), "{name} at {x}: {normal}, not {want:?}");
        }
    }
}

/// Folds of a white sheet in a white room lack the light that a cut omits, which the film reports; with the
/// largest number of scatterings nothing is missing.
#[test]
fn cuts_tell_what_they_leave_out() {
    let (mut scene, camera) = Setup::Folds.scene(20.0, None, Some(Environment::constant(1.0)));
    scene.lights.clear();
    for depth in [1, 2, MAX_SCATTERINGS] {
        let mut film = Film::new(32, 32).unwrap();
        let options = RenderOptions { samples: 64, depth, seed: 1 };
        let white = Diffuse { up: 1.0, down: 0.0 };
        render(&scene, &camera, &white, &mut film, &options, &AtomicBool::new(false), &mut |_| Ok(())).unwrap();
        let sum = |view| (0..32 * 32).map(|k| film.xyz(view, k % 32, k / 32)[1]).map(f64::from).sum::<f64>();
        let lacks = (32.0 * 32.0 - sum(FilmView::Light)) / sum(FilmView::Albedo);
        println!("{depth} scatterings lack {lacks:.4}, told {:.4}", film.cut_share());
        assert!((film.cut_share() - lacks).abs() < 0.01, "{depth}: {} of {lacks}", film.cut_share());
    }
}
