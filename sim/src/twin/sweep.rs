//! Triangles of a cloth's fibers: rings of points on the outlines, and quads between rings.
//!
//! Vertices have the normals of the swept surface. The polygon of points on an outline has less area than the
//! outline; its points are moved outwards so that the areas agree.

use super::options::TwinMesh;
use crate::geometry::fiber_section::FiberSection;
use crate::geometry::outline::{Outline, edges};
use nalgebra::{Rotation2, Vector2};
use plywave_textile::YarnSet;
use std::f64::consts::TAU;

/// Number of points on an outline from which those of a ring are chosen.
const FINE: usize = 512;

/// Yarn, ply and spec of a fiber.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadOfFiber {
    /// Yarn set of its yarn: warp for kind 0, weft for all other kinds.
    pub family: YarnSet,
    /// Number of its yarn in the domain.
    pub yarn: u32,
    /// Number of its yarn in the sequence of colors, like in the curves.
    pub number: i32,
    /// Number of its ply in the domain.
    pub ply: u32,
    /// Index of its spec.
    pub spec: u32,
    /// Whether it is the second fiber of the spec's blend.
    pub second: bool,
}

/// Quads of the fibers of a cloth, two triangles each. Positions are relative to the middle of the domain
/// [um].
#[derive(Default)]
pub(super) struct ClothMesh {
    pub vertices: Vec<[f32; 3]>,
    /// Unit normals that point out of the material.
    pub normals: Vec<[f32; 3]>,
    /// Vertices a and b of a ring, and c and d of the next ring. The triangles are a, b, d and a, d, c.
    pub quads: Vec<[u32; 4]>,
    /// `[quad]`: `2 fiber` for the outer wall, `2 fiber + 1` for the wall of the lumen.
    pub wall: Vec<u32>,
    /// `[fiber]`: its yarn, ply and spec.
    pub fibers: Vec<ThreadOfFiber>,
}

/// Points of a ring in the ply's section, with outward normals.
type Ring = Vec<(Vector2<f64>, Vector2<f64>)>;

impl ClothMesh {
    /// Joins several meshes into one.
    pub fn joined(parts: Vec<ClothMesh>) -> ClothMesh {
        let mut mesh = ClothMesh::default();
        let total: usize = parts.iter().map(|p| p.quads.len()).sum();
        mesh.quads.reserve_exact(total);
        mesh.wall.reserve_exact(total);
        let total: usize = parts.iter().map(|p| p.vertices.len()).sum();
        mesh.vertices.reserve_exact(total);
        mesh.normals.reserve_exact(total);
        for part in parts {
            let (first, fiber) = (mesh.vertices.len() as u32, mesh.fibers.len() as u32);
            mesh.quads.extend(part.quads.iter().map(|q| q.map(|v| first + v)));
            mesh.wall.extend(part.wall.iter().map(|w| 2 * fiber + w));
            mesh.vertices.extend(part.vertices);
            mesh.normals.extend(part.normals);
            mesh.fibers.extend(part.fibers);
        }
        mesh
    }
}

/// Number of points around an outline. Outlines whose normal turns back and forth have more points, and
/// lumens, which are small, have fewer.
fn points_of(outline: &Outline, is_lumen: bool, options: &TwinMesh) -> usize {
    let n = f64::from(options.outline_points.max(8)) * if is_lumen { 2.0 / 3.0 } else { 1.0 };
    let turns = match outline {
        Outline::Circle { .. } => 1.0,
        Outline::Polyline(points) => {
            let sides: Vec<Vector2<f64>> = edges(points).map(|(a, b)| b - a).collect();
            edges(&sides).map(|(a, b)| a.perp(&b).atan2(a.dot(&b)).abs()).sum::<f64>() / TAU
        }
    };
    (n * turns.clamp(1.0, 4.0)).ceil() as usize
}

/// Points of a ring around an outline [um], relative to the fiber's center. They are spaced by arc length and
/// by the rotation of the normal in equal parts. Their polygon has the outline's area. If the outline rotates
/// by `turn` from ring to ring, the chords between rings lie inside of the surface by a share of
/// `turn^2 / 12` on average; the ring is scaled up to compensate.
pub(super) fn ring(fiber: &FiberSection, outline: &Outline, is_lumen: bool, turn: f64, options: &TwinMesh) -> Ring {
    let n = points_of(outline, is_lumen, options);
    let mut points = match outline {
        Outline::Circle { .. } => outline.points(n),
        Outline::Polyline(_) => {
            let fine = outline.points(FINE);
            let next = |i: usize| &fine[(i + 1) % FINE];
            let length: f64 = (0..FINE).map(|i| (next(i).position_um - fine[i].position_um).norm()).sum();
            let turn = |i: usize| fine[i].normal.angle(&next(i).normal);
            let turns: f64 = (0..FINE).map(turn).sum();
            let mut sum = 0.0;
            let mut chosen = Vec::with_capacity(n);
            for (i, point) in fine.iter().enumerate() {
                if sum * n as f64 >= chosen.len() as f64 - 1e-9 && chosen.len() < n {
                    chosen.push(*point);
                }
                sum += 0.5 * (next(i).position_um - point.position_um).norm() / length
                    + 0.5 * turn(i) / turns.max(f64::MIN_POSITIVE);
            }
            chosen
        }
    };
    let corners: Vec<Vector2<f64>> = points.iter().map(|p| p.position_um).collect();
    let area = 0.5 * edges(&corners).map(|(a, b)| a.perp(&b)).sum::<f64>();
    let perimeter = edges(&corners).map(|(a, b)| (b - a).norm()).sum::<f64>();
    // To first order, an offset of d adds d times the perimeter to the area of a polygon.
    let out = (outline.area() - area) / perimeter.max(f64::MIN_POSITIVE);
    points.iter_mut().for_each(|p| p.position_um += p.normal * out);
    let scale = match outline {
        // Rings of circles do not rotate.
        Outline::Circle { .. } => 1.0,
        Outline::Polyline(_) => 1.0 + turn * turn / 12.0,
    };
    let angle = Rotation2::new(fiber.angle_rad);
    points.iter().map(|p| (angle * p.position_um * scale, angle * p.normal)).collect()
}
