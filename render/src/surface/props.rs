//! Matte props beside the sheet: a floor, a ball under a drape, the frame of a window.

use glam::Vec3;
use plywave::bsdf::{DirectionSample, Outcomes};
use plywave::{Bsdf, BsdfSample};
use std::f32::consts::{PI, TAU};

/// Shape of a prop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// The plane z = `height_mm`, visible from above.
    Floor {
        /// Height [mm].
        height_mm: f32,
    },
    /// A ball, visible from outside.
    Ball {
        /// Center [mm].
        center: Vec3,
        /// Radius [mm].
        radius_mm: f32,
    },
    /// A box along the axes, visible from outside.
    Box {
        /// Corner with the smallest coordinates [mm].
        low: Vec3,
        /// Corner with the largest coordinates [mm].
        high: Vec3,
    },
}

/// A diffuse object with the same albedo at every wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prop {
    /// Shape and position.
    pub shape: Shape,
    /// Reflected fraction of the light, 0 to 1.
    pub albedo: f32,
}

impl Prop {
    /// Distance [mm] along a ray to the outer side, if the ray hits it.
    pub(crate) fn hit(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        match self.shape {
            Shape::Floor { height_mm } => {
                let t = (height_mm - origin.z) / direction.z;
                (direction.z < 0.0 && t > 0.0).then_some(t)
            }
            Shape::Ball { center, radius_mm } => {
                // Positions are relative to the point of the ray nearest to the center, which avoids
                // differences of large numbers.
                let to = center - origin;
                let along = to.dot(direction);
                let off = (to - direction * along).length_squared();
                let discriminant = radius_mm * radius_mm - off;
                let t = along - discriminant.max(0.0).sqrt();
                (discriminant > 0.0 && t > 0.0).then_some(t)
            }
            Shape::Box { low, high } => {
                let (a, b) = ((low - origin) / direction, (high - origin) / direction);
                let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
                (enter < leave && enter > 0.0).then_some(enter)
            }
        }
    }

    /// Unit normal at a point of the surface.
    pub(crate) fn normal(&self, position: Vec3) -> Vec3 {
        match self.shape {
            Shape::Floor { .. } => Vec3::Z,
            Shape::Ball { center, .. } => (position - center).normalize_or(Vec3::Z),
            Shape::Box { low, high } => {
                // The face is that along whose axis the point lies furthest out.
                let out = (position - 0.5 * (low + high)) / (high - low).max(Vec3::splat(1e-6));
                let most = out.abs().max_element();
                Vec3::select(out.abs().cmpge(Vec3::splat(most)), out.signum(), Vec3::ZERO).normalize_or(Vec3::Z)
            }
        }
    }
}

/// Lambertian reflection about z with this albedo.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Matte(pub f32);

impl<const N: usize> Bsdf<N> for Matte {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        [self.0 * w[2].max(0.0) / PI; N]
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        w[2].max(0.0) / PI
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        let (sin, cos) = (TAU * u[0]).sin_cos();
        let r = u[1].sqrt();
        let w = [r * cos, r * sin, (1.0 - u[1]).max(0.0).sqrt()];
        BsdfSample::Scattered(DirectionSample { w, weight: [self.0; N], pdf: (w[2] / PI).max(1e-12) })
    }

    fn albedo(&self) -> [f32; N] {
        [self.0; N]
    }

    fn outcomes(&self) -> Outcomes {
        Outcomes::SCATTERED
    }
}
