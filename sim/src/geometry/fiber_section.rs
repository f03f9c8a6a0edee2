//! One fiber in the plane of the ply's cross section: its outline, position and rotation, and its exact
//! distance from another fiber.

use crate::geometry::outline::{Outline, Runs, edges, segments_cross};
use nalgebra::{Rotation2, Vector2};

/// One fiber in the cross section plane z = 0 of the ply.
#[derive(Clone, Debug, PartialEq)]
pub struct FiberSection {
    /// Center in the ply's frame [um].
    pub center_um: Vector2<f64>,
    /// Rotation of the outline [rad]; a point p of it lies at `center + Rot(angle) p`.
    pub angle_rad: f64,
    /// Outer wall, its centroid at the origin.
    pub outer: Outline,
    /// Wall of the hollow core, strictly within the outer one and in the same frame.
    pub lumen: Option<Outline>,
    /// Whether the fiber is the second one of a blend.
    pub second: bool,
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

    /// Minimum distance between the outer walls of two fibers [um]. If they overlap, it is minus the depth of
    /// the deepest vertex. The result is exact for the stored outlines.
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

/// Distance of two closed polylines; minus the depth of the deepest vertex if they overlap.
fn polyline_distance(a: &[Vector2<f64>], b: &[Vector2<f64>]) -> f64 {
    let (runs_a, runs_b) = (Runs::new(a), Runs::new(b));
    let min = b.iter().fold(f64::INFINITY, |min, &p| runs_a.distance(p, min));
    let min = a.iter().fold(min, |min, &p| runs_b.distance(p, min));
    let longest = |points: &[Vector2<f64>]| edges(points).map(|(p, q)| (q - p).norm()).fold(0.0, f64::max);
    let touching = min <= longest(a).max(longest(b));
    let (wall_a, wall_b) = (Outline::Polyline(a.to_vec()), Outline::Polyline(b.to_vec()));
    let overlap = wall_b.contains(a[0])
        || wall_a.contains(b[0])
        || (touching && edges(a).any(|(p, q)| edges(b).any(|(r, s)| segments_cross(p, q, r, s))));
    if !overlap {
        return min;
    }
    let deepest =
        |points: &[Vector2<f64>], wall: &Outline| points.iter().map(|&p| wall.signed_distance(p)).fold(0.0, f64::min);
    deepest(a, &wall_b).min(deepest(b, &wall_a)).min(-f64::MIN_POSITIVE)
}
