//! The host itself, with surfaces whose light is known: a white diffuse sheet in a white room, a half transparent one, light sources.

use plywave::{Bsdf, BsdfSample, DirectionSample, Outcomes};
use plywave_render::{Film, FilmView, RenderOptions, Setup, Surface, render};
use std::f32::consts::{PI, TAU};
use std::sync::atomic::AtomicBool;

/// Reflects a share `up` of the light and lets `down` through, both diffuse.
#[derive(Clone, Copy)]
struct Diffuse {
    up: f32,
    down: f32,
}

/// Of a [`Diffuse`] sheet seen from one side.
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

    fn at(&self, _: [f32; 2], wo: [f32; 3], _: [f32; 4]) -> At {
        At(*self, wo[2].signum())
    }
}

/// Mean Y of the picture's middle, and the number of samples that went into it.
fn middle(setup: Setup, surface: &Diffuse, samples: u32) -> f32 {
    let (scene, camera) = setup.scene(20.0, None, None);
    let mut film = Film::new(24, 24);
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
    // The wavelengths drawn make the noise: some 0.1 a sample, of 64 pixels with 512 samples.
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
    let part = whole(1, 3, Film::new(20, 12));
    part.save(&path, "drape").unwrap();
    assert!(Film::resume(&path, "other").is_err());
    let back = Film::resume(&path, "drape").unwrap();
    assert_eq!(back, part);
    let (a, b) = (whole(7, 7, back), whole(7, 7, Film::new(20, 12)));
    for y in 0..12 {
        for x in 0..20 {
            let (a, b) = (a.xyz(FilmView::Light, x, y), b.xyz(FilmView::Light, x, y));
            assert!((0..3).all(|k| (a[k] - b[k]).abs() <= 1e-5 * (1.0 + b[k])), "{a:?} {b:?}");
        }
    }
    let exr = folder.path().join("a.exr");
    a.write_exr(&exr).unwrap();
    let env = plywave_render::Environment::load(&exr, 1.0);
    assert!(env.is_ok(), "{:?}", env.err());
    assert_eq!(a.image(FilmView::Albedo, 0.0).dimensions(), (20, 12));
}

#[test]
fn stopped_renders_say_so() {
    let (scene, camera) = Setup::Folds.scene(20.0, None, None);
    let mut film = Film::new(8, 8);
    let options = RenderOptions { samples: 4, depth: 4, seed: 3 };
    let surface = Diffuse { up: 0.5, down: 0.4 };
    let stopped = render(&scene, &camera, &surface, &mut film, &options, &AtomicBool::new(true), &mut |_| Ok(()));
    assert!(stopped.is_err() && film.samples() == 0);
}
