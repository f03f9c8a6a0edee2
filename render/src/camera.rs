//! A pinhole camera.

use glam::Vec3;

/// A pinhole camera.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    origin: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
}

impl Camera {
    /// Looks from `origin` to `target` [mm] with `up` above; `fov_rad` is the angle across the picture's height.
    pub fn new(origin: Vec3, target: Vec3, up: Vec3, fov_rad: f32) -> Camera {
        let forward = (target - origin).normalize();
        let right = forward.cross(up).normalize_or(forward.any_orthonormal_vector());
        let half = (0.5 * fov_rad).tan();
        Camera { origin, forward, right: right * half, up: right.cross(forward) * half }
    }

    /// Depth of a point `t` along a ray in unit `direction`: its distance along the camera's axis [mm].
    pub(crate) fn depth(&self, direction: Vec3, t: f32) -> f32 {
        t * direction.dot(self.forward)
    }

    /// Width of a pixel at unit distance along the axis, of a picture `height` pixels high.
    pub(crate) fn pixel_width(&self, height: u32) -> f32 {
        2.0 * self.up.length() / height.max(1) as f32
    }

    /// Origin and unit direction of the ray through (x, y) of a picture `width` by `height` pixels, y down.
    pub fn ray(&self, x: f32, y: f32, width: u32, height: u32) -> (Vec3, Vec3) {
        let size = height as f32;
        let (a, b) = ((2.0 * x - width as f32) / size, (size - 2.0 * y) / size);
        (self.origin, (self.forward + self.right * a + self.up * b).normalize())
    }
}
