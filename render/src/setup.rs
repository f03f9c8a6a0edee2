//! Predefined scenes for a cloth: mesh, lamps, sky, props and camera.

use crate::{Camera, Environment, Light, Mesh, Prop, Scene, Shape};
use glam::Vec3;

/// Albedos of the floor under a cloth and of the wall around a window.
const FLOOR: f32 = 0.7;
const WALL: f32 = 0.75;

/// A predefined scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Setup {
    /// A flat sheet lit from the viewer's side by a small lamp.
    Front,
    /// A flat sheet between the viewer and a lamp.
    Back,
    /// A sheet that has fallen over a ball on a light floor, under a large lamp from the left, a lamp from
    /// behind and a dim sky.
    Drape,
    /// A curtain in folds before a bright window.
    Curtain,
    /// Three folded sheets on each other, lit as [`Setup::Drape`].
    Folded,
    /// A sheet drawn around a ball, from near, lit as [`Setup::Drape`].
    Ball,
    /// A sheet with parallel folds, under a lamp and a dim sky.
    Folds,
    /// A few yarns seen from above, lit from the side by a lamp of half a degree.
    Swatch,
    /// A flat sheet seen from ten degrees above its plane, against the light, under a dim sky.
    Grazing,
    /// A flat sheet under equal light from everywhere: white stays white.
    Furnace,
}

impl Setup {
    /// Default width of the cloth [mm].
    pub fn size_mm(self) -> f32 {
        match self {
            Setup::Front | Setup::Back | Setup::Furnace => 30.0,
            Setup::Drape => 400.0,
            Setup::Curtain => 800.0,
            Setup::Folded => 500.0,
            Setup::Ball => 250.0,
            Setup::Grazing => 200.0,
            Setup::Folds => 90.0,
            Setup::Swatch => 3.0,
        }
    }

    /// The camera for a sheet `size_mm` wide.
    pub fn camera(self, size_mm: f32) -> Camera {
        let looks = |from: [f32; 3], to: [f32; 3], up: Vec3, fov_rad: f32| {
            let [from, to] = [from, to].map(|p| Vec3::from(p) * size_mm);
            Camera::new(from, to, up, fov_rad)
        };
        match self {
            // The far edge of the sheet lies just outside the picture.
            Setup::Front => looks([0.0, -1.5, 2.0], [0.0; 3], Vec3::Y, 0.27),
            Setup::Back => looks([0.0, 0.0, 2.5], [0.0; 3], Vec3::Y, 0.36),
            Setup::Drape => looks([0.35, -2.3, 1.0], [0.0, -0.02, -0.065], Vec3::Z, 0.255),
            Setup::Curtain => looks([0.02, -2.2, -0.05], [0.03, 0.0, -0.06], Vec3::Z, 0.31),
            Setup::Folded => looks([1.15, -1.0, 0.65], [0.0, 0.0, 0.03], Vec3::Z, 0.225),
            Setup::Ball => looks([0.25, -2.0, 0.65], [0.0, 0.0, -0.01], Vec3::Z, 0.265),
            Setup::Folds => looks([0.0, -1.2, 1.8], [0.0; 3], Vec3::Y, 0.42),
            Setup::Swatch => looks([0.0, 0.0, 3.0], [0.0; 3], Vec3::Y, 0.33),
            Setup::Grazing => looks([0.0, -2.0, 0.36], [0.0; 3], Vec3::Z, 0.26),
            Setup::Furnace => looks([0.0, -1.0, 2.0], [0.0; 3], Vec3::Y, 0.36),
        }
    }

    /// Scene and camera for a sheet `size_mm` wide. `mesh` replaces the setup's mesh, `sky` its environment.
    /// Lamps are scaled so that a white diffuse sheet facing one has a value of about 1.
    pub fn scene(self, size_mm: f32, mesh: Option<Mesh>, sky: Option<Environment>) -> (Scene, Camera) {
        let s = size_mm;
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z) * s;
        // A lamp that produces the irradiance pi at the sheet's center.
        let lamp_of = |place: Vec3, side: f32, share: f32| {
            let solid_angle = side * side * s * s / place.length_squared();
            Light::facing(place, Vec3::ZERO, side * s, share * std::f32::consts::PI / solid_angle)
        };
        let lamp = |place: Vec3, side: f32| lamp_of(place, side, 1.0);
        // A large lamp from the left before the cloth, and one behind it on the right, which draws its rim.
        let studio = |size: f32| {
            let (key, rim) = (at(-1.5, -0.7, 1.5) * size, at(1.2, 1.5, 1.1) * size);
            vec![lamp_of(key, 0.9 * size, 1.0), lamp_of(rim, 0.6 * size, 0.7)]
        };
        let white_room = || Environment::constant(0.16);
        let dark = || Environment::constant(0.0);
        let dim = || Environment::constant(0.12);
        // A mesh from the caller replaces the setup's own, which is then not built.
        let own = mesh.is_none();
        let (made, lights, own_sky) = match self {
            // The mirror direction of the lamp lies outside the picture: yarns shine where they tilt towards
            // it and show their color elsewhere.
            Setup::Front => (own.then(|| Mesh::flat(s)), vec![lamp(at(-1.2, 0.9, 3.2), 0.25)], dark()),
            Setup::Back => (own.then(|| Mesh::flat(s)), vec![lamp(at(0.0, 0.0, -3.0), 0.3)], dark()),
            Setup::Drape => (own.then(|| Mesh::drape(s)), studio(1.0), white_room()),
            Setup::Folded => (own.then(|| Mesh::stack(s)), studio(0.7), white_room()),
            Setup::Ball => (own.then(|| Mesh::wrapped(s)), studio(1.0), white_room()),
            Setup::Curtain => {
                let window = Light::facing(at(0.06, 0.3, 0.05), at(0.06, 0.0, 0.05), 0.66 * s, 4.0);
                (own.then(|| Mesh::curtain(s)), vec![window, lamp_of(at(-1.6, -2.0, 1.2), 0.7, 0.25)], dim())
            }
            Setup::Folds => (own.then(|| Mesh::folded(s)), vec![lamp(at(1.8, 1.0, 1.6), 0.4)], dim()),
            Setup::Swatch => (
                own.then(|| Mesh::flat(s * 3.0)),
                // A small lamp makes speckle visible.
                vec![lamp(at(1.5, 2.0, 2.4), 0.03)],
                dark(),
            ),
            Setup::Grazing => (own.then(|| Mesh::flat(s)), vec![lamp(at(-0.3, 2.6, 0.9), 0.3)], dim()),
            Setup::Furnace => (own.then(|| Mesh::flat(s)), Vec::new(), Environment::constant(1.0)),
        };
        let mut scene = Scene::new(mesh.or(made).unwrap_or_default(), lights, sky.unwrap_or(own_sky));
        if own {
            scene.props = self.props(s);
        }
        (scene, self.camera(s))
    }

    /// Props beside the setup's own sheet, `s` wide [mm].
    fn props(self, s: f32) -> Vec<Prop> {
        let floor = |height: f32| Prop { shape: Shape::Floor { height_mm: height * s }, albedo: FLOOR };
        let ball = |radius: f32| Prop { shape: Shape::Ball { center: Vec3::ZERO, radius_mm: radius * s }, albedo: 0.5 };
        let block = |low: [f32; 3], high: [f32; 3]| {
            let [low, high] = [low, high].map(|p| Vec3::from(p) * s);
            Prop { shape: Shape::Box { low, high }, albedo: WALL }
        };
        match self {
            Setup::Drape => {
                // The ball stands on a post.
                let post = block([-0.06, -0.06, Mesh::FLOOR], [0.06, 0.06, -0.5 * Mesh::BALL]);
                vec![floor(Mesh::FLOOR), ball(Mesh::BALL), post]
            }
            Setup::Ball => vec![floor(Mesh::WRAPPED_FLOOR), ball(Mesh::WRAPPED)],
            Setup::Folded => vec![floor(0.0)],
            Setup::Curtain => {
                // A wall with an opening, a cross in it, and a sill.
                let (left, right, low, high) = (-0.25, 0.37, -0.26, 0.36);
                let (front, back, far) = (0.2, 0.27, 3.0);
                vec![
                    block([-far, front, -far], [left, back, far]),
                    block([right, front, -far], [far, back, far]),
                    block([left, front, -far], [right, back, low]),
                    block([left, front, high], [right, back, far]),
                    block([0.055, front + 0.03, low], [0.065, back, high]),
                    block([left, front + 0.03, 0.095], [right, back, 0.105]),
                    block([left - 0.03, front - 0.04, low - 0.012], [right + 0.03, back, low]),
                ]
            }
            _ => Vec::new(),
        }
    }
}
