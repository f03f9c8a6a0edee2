//! The cross section of a ply: fibers placed without overlap in the plane z = 0 (Yu 2025, 4.1, Fig. 5a).
//!
//! Along z the whole section turns rigidly about the axis, so fibers that are apart at z = 0 are apart everywhere.

use crate::error::SimError;
use crate::outline::{Outline, Runs, edges, segments_cross};
use crate::{packing, shape};
use nalgebra::{Rotation2, Vector2};
use plywave::{Handedness, YarnSpec};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// One fiber in the cross section plane z = 0 of the ply.
#[derive(Clone, Debug, PartialEq)]
pub struct FiberSection {
    /// Center in the ply's frame [um].
    pub center_um: Vector2<f64>,
    /// Turn of the outline: a point p of it lies at `center + Rot(angle) p` [rad].
    pub angle_rad: f64,
    /// Outer wall, its centroid at the origin.
    pub outer: Outline,
    /// Wall of the hollow core, strictly within the outer one and in the same frame.
    pub lumen: Option<Outline>,
}

impl FiberSection {
    /// A point of the fiber's frame in the ply's frame [um].
    pub fn to_ply(&self, p: Vector2<f64>) -> Vector2<f64> {
        self.center_um + Rotation2::new(self.angle_rad) * p
    }

    /// A point of the ply's frame in the fiber's frame [um].
    pub fn to_fiber(&self, p: Vector2<f64>) -> Vector2<f64> {
        Rotation2::new(-self.angle_rad) * (p - self.center_um)
    }

    /// Area of the material, without the lumen [um^2].
    pub fn material_area(&self) -> f64 {
        self.outer.area() - self.lumen.as_ref().map_or(0.0, Outline::area)
    }

    /// Least distance between the outer walls of two fibers [um]; negative, by the depth of the deepest vertex, when they overlap.
    /// Exact for the outlines as held.
    pub fn min_distance(&self, other: &FiberSection) -> f64 {
        let apart = (self.center_um - other.center_um).norm();
        match (&self.outer, &other.outer) {
            (Outline::Circle { radius_um: a }, Outline::Circle { radius_um: b }) => apart - a - b,
            (Outline::Circle { radius_um }, Outline::Polyline(_)) => {
                other.outer.signed_distance(other.to_fiber(self.center_um)) - radius_um
            }
            (Outline::Polyline(_), Outline::Circle { .. }) => other.min_distance(self),
            (Outline::Polyline(a), Outline::Polyline(b)) => {
                let a: Vec<_> = a.iter().map(|&p| self.to_ply(p)).collect();
                let b: Vec<_> = b.iter().map(|&p| other.to_ply(p)).collect();
                polyline_distance(&a, &b)
            }
        }
    }
}

/// Distance of two closed polylines, negative by the deepest vertex when they overlap.
fn polyline_distance(a: &[Vector2<f64>], b: &[Vector2<f64>]) -> f64 {
    let (runs_a, runs_b) = (Runs::new(a), Runs::new(b));
    let least = b.iter().fold(f64::INFINITY, |least, &p| runs_a.distance(p, least));
    let least = a.iter().fold(least, |least, &p| runs_b.distance(p, least));
    let longest = |points: &[Vector2<f64>]| edges(points).map(|(p, q)| (q - p).norm()).fold(0.0, f64::max);
    let touching = least <= longest(a).max(longest(b));
    let (wall_a, wall_b) = (Outline::Polyline(a.to_vec()), Outline::Polyline(b.to_vec()));
    let overlap = wall_b.contains(a[0])
        || wall_a.contains(b[0])
        || (touching && edges(a).any(|(p, q)| edges(b).any(|(r, s)| segments_cross(p, q, r, s))));
    if !overlap {
        return least;
    }
    let deepest =
        |points: &[Vector2<f64>], wall: &Outline| points.iter().map(|&p| wall.signed_distance(p)).fold(0.0, f64::min);
    deepest(a, &wall_b).min(deepest(b, &wall_a)).min(-f64::MIN_POSITIVE)
}

/// The cross section of a ply at z = 0; at height z it is turned by `z * twist_per_um` about the axis.
#[derive(Clone, Debug, PartialEq)]
pub struct PlySection {
    /// The fibers.
    pub fibers: Vec<FiberSection>,
    /// Radius of the smallest circle about the axis that holds all fibers [um].
    pub bound_radius_um: f64,
    /// Turn per length, `2 pi / pitch` [rad/um]: positive for Z twist, negative for S, 0 for parallel fibers.
    pub twist_per_um: f64,
}

impl PlySection {
    /// Draw the fibers of `spec` and pack them. The same seed gives the same section.
    ///
    /// # Errors
    /// [`SimError::CannotPack`] when the fibers do not fit within the ply, [`SimError::BadOutline`] for a shape that cannot be built.
    pub fn generate(spec: &YarnSpec, seed: u64) -> Result<PlySection, SimError> {
        let mut rng = Pcg64Mcg::new(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835 ^ u128::from(seed) << 1);
        let mut fibers = Vec::new();
        for _ in 0..spec.ply.fibers {
            fibers.push(shape::draw(&spec.fiber, &mut rng)?);
        }
        packing::pack(&mut fibers, &spec.fiber, &spec.ply, &mut rng)?;
        let bound_radius_um = fibers.iter().map(reach).fold(0.0, f64::max);
        let sign = if spec.ply.handedness == Handedness::Z { 1.0 } else { -1.0 };
        let twist_per_um = spec.ply.fiber_pitch_um.map_or(0.0, |pitch| sign * TAU / pitch);
        Ok(PlySection { fibers, bound_radius_um, twist_per_um })
    }

    /// Turn of the section at height `z_um` [rad].
    pub fn turn(&self, z_um: f64) -> f64 {
        z_um * self.twist_per_um
    }

    /// Least gap between any two fibers [um], infinite for fewer than two. Exact for the outlines as held.
    pub fn min_gap_um(&self) -> f64 {
        let mut least = f64::INFINITY;
        for (i, a) in self.fibers.iter().enumerate() {
            for b in &self.fibers[i + 1..] {
                let bounds = a.outer.bounding_radius() + b.outer.bounding_radius();
                if (a.center_um - b.center_um).norm() - bounds < least {
                    least = least.min(a.min_distance(b));
                }
            }
        }
        least
    }
}

/// Largest distance of a fiber's points from the axis [um].
fn reach(fiber: &FiberSection) -> f64 {
    match &fiber.outer {
        Outline::Circle { radius_um } => fiber.center_um.norm() + radius_um,
        Outline::Polyline(points) => points.iter().map(|&p| fiber.to_ply(p).norm()).fold(0.0, f64::max),
    }
}
