//! A pinhole camera and its rays.

use glam::Vec3;

/// Position and view of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position of the camera [mm].
    pub from: Vec3,
    /// Point at the center of the picture [mm].
    pub to: Vec3,
    /// Direction that points up in the picture.
    pub up: Vec3,
    /// Vertical field of view [rad].
    pub fov_rad: f32,
}

/// A pinhole camera.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    view: View,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
}

impl Camera {
    /// A camera at `from` that looks at `to` [mm], with `up` upwards in the picture and the vertical field of
    /// view `fov_rad` [rad].
    pub fn new(from: Vec3, to: Vec3, up: Vec3, fov_rad: f32) -> Camera {
        let forward = (to - from).normalize();
        let right = forward.cross(up).normalize_or(forward.any_orthonormal_vector());
        let half = (0.5 * fov_rad).tan();
        let view = View { from, to, up, fov_rad };
        Camera { view, forward, right: right * half, up: right.cross(forward) * half }
    }

    /// Position and view.
    pub fn view(&self) -> View {
        self.view
    }

    /// Width of a pixel [um] on the plane through the target point that faces the camera, for a picture
    /// `height` pixels high.
    pub fn pixel_um(&self, height: u32) -> f32 {
        1000.0 * self.pixel_width(height) * self.view.from.distance(self.view.to)
    }

    /// Depth along the camera's axis [mm] of the point at distance `t` along a ray in unit `direction`.
    pub(crate) fn depth(&self, direction: Vec3, t: f32) -> f32 {
        t * direction.dot(self.forward)
    }

    /// Width of a pixel at unit distance along the axis, for a picture `height` pixels high.
    pub(crate) fn pixel_width(&self, height: u32) -> f32 {
        2.0 * self.up.length() / height.max(1) as f32
    }

    /// Origin and unit direction of the ray through the point (x, y) of a picture of `width` by `height`
    /// pixels, y down.
    pub fn ray(&self, x: f32, y: f32, width: u32, height: u32) -> (Vec3, Vec3) {
        let size = height as f32;
        let (a, b) = ((2.0 * x - width as f32) / size, (size - 2.0 * y) / size);
        (self.view.from, (self.forward + self.right * a + self.up * b).normalize())
    }
}
