//! Predefined scenes for a cloth: mesh, lamps, sky, props and camera.

use crate::{Camera, Environment, Light, Mesh, Prop, Scene, Shape};
use glam::Vec3;

/// A predefined scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Setup {
    /// A flat sheet lit from the viewer's side by a small lamp.
    Front,
    /// A flat sheet between the viewer and a lamp.
    Back,
    /// A sheet that has fallen over a ball on the floor, under a large lamp and a dim sky.
    Drape,
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
            Setup::Drape => looks([0.35, -2.3, 1.25], [0.0, 0.0, -0.04], Vec3::Z, 0.31),
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
        let lamp = |place: Vec3, side: f32| {
            let solid_angle = side * side * s * s / place.length_squared();
            Light::facing(place, Vec3::ZERO, side * s, std::f32::consts::PI / solid_angle)
        };
        let dark = || Environment::constant(0.0);
        let dim = || Environment::constant(0.12);
        // A mesh from the caller replaces the setup's own, which is then not built.
        let own = mesh.is_none();
        let (made, lights, own_sky) = match self {
            // The mirror direction of the lamp lies outside the picture: yarns shine where they tilt towards
            // it and show their color elsewhere.
            Setup::Front => (own.then(|| Mesh::flat(s)), vec![lamp(at(-1.2, 0.9, 3.2), 0.25)], dark()),
            Setup::Back => (own.then(|| Mesh::flat(s)), vec![lamp(at(0.0, 0.0, -3.0), 0.3)], dark()),
            Setup::Drape => (own.then(|| Mesh::drape(s)), vec![lamp(at(-1.5, -0.9, 1.7), 1.0)], dim()),
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
        if own && self == Setup::Drape {
            scene.props = vec![
                Prop { shape: Shape::Floor { height_mm: Mesh::FLOOR * s }, albedo: 0.35 },
                Prop { shape: Shape::Ball { center: Vec3::ZERO, radius_mm: Mesh::BALL * s }, albedo: 0.5 },
            ];
        }
        (scene, self.camera(s))
    }
}
