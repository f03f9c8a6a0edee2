//! Triangle mesh of a ply: every outline swept along its helix (Yu 2025, 4.1, Fig. 5b).
//!
//! The section turns rigidly with height, so the sweep is a screw. Each fiber is one closed surface of its
//! own: outer wall, lumen wall if it is hollow, and two caps. Vertices are shared within a fiber; every edge
//! belongs to two triangles of opposite direction.

use crate::geometry::fiber_section::FiberSection;
use crate::geometry::section::PlySection;
use nalgebra::{Rotation2, Vector2};
use std::io::{self, Write};

/// Maximum number of vertices of a mesh; steps are lengthened to respect it.
const MAX_VERTICES: usize = 1 << 28;

/// Triangles of a ply. Normals, by the right-hand rule, point out of the fibers' material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Positions [um]; the ply's axis is z.
    pub vertices: Vec<[f32; 3]>,
    /// Three vertices each.
    pub triangles: Vec<[u32; 3]>,
    /// `[triangle]`: `2 fiber` for the outer wall and the caps, `2 fiber + 1` for the lumen wall.
    pub wall: Vec<u32>,
}

impl TriMesh {
    /// Sweeps `section` from `z0_um` to `z1_um` with `outline_points` (8 or more) around each wall and layers
    /// at most `step_um` apart. Empty unless `z1_um > z0_um`. Outlines become inscribed polygons with a
    /// relative loss of a circle's area of `6.6 / points^2`.
    pub fn sweep(section: &PlySection, z0_um: f64, z1_um: f64, outline_points: usize, step_um: f64) -> TriMesh {
        let mut mesh = TriMesh::default();
        let length = z1_um - z0_um;
        if !(length > 0.0 && length.is_finite()) {
            return mesh;
        }
        let n = outline_points.clamp(8, 1 << 16);
        let rings: usize = section.fibers.iter().map(|f| 1 + usize::from(f.lumen.is_some())).sum();
        let max_steps = (MAX_VERTICES / (n * rings.max(1))).max(2) - 1;
        let steps = if step_um > 0.0 { (length / step_um).ceil() as usize } else { 1 }.clamp(1, max_steps);
        for (fiber, id) in section.fibers.iter().zip(0..) {
            mesh.push_fiber(fiber, 2 * id, n, steps, |k| {
                let z = z0_um + length * k as f64 / steps as f64;
                (z, section.turn(z))
            });
        }
        mesh
    }

    fn push_fiber(
        &mut self,
        fiber: &FiberSection,
        wall: u32,
        n: usize,
        steps: usize,
        layer: impl Fn(usize) -> (f64, f64),
    ) {
        let ring = |outline: &crate::Outline| -> Vec<Vector2<f64>> {
            outline.points(n).iter().map(|p| fiber.to_ply(p.position_um)).collect()
        };
        let outer = ring(&fiber.outer);
        let lumen = fiber.lumen.as_ref().map(ring);
        let cap = match &lumen {
            None => triangulate(&outer, (0..n).collect()),
            Some(lumen) => triangulate_annulus(&outer, lumen),
        };
        let loops: Vec<&Vec<Vector2<f64>>> = std::iter::once(&outer).chain(&lumen).collect();
        let first = self.vertices.len();
        let per_layer = n * loops.len();
        for k in 0..=steps {
            let (z, angle) = layer(k);
            let turn = Rotation2::new(angle);
            for p in loops.iter().flat_map(|ring| ring.iter()) {
                let q = turn * p;
                self.vertices.push([q.x as f32, q.y as f32, z as f32]);
            }
        }
        let mut push = |a: usize, b: usize, c: usize, wall: u32| {
            self.triangles.push([a, b, c].map(|v| (first + v) as u32));
            self.wall.push(wall);
        };
        for (l, _) in loops.iter().enumerate() {
            let wall = wall + l as u32;
            for k in 0..steps {
                for i in 0..n {
                    let low = k * per_layer + l * n;
                    let (a, b) = (low + i, low + (i + 1) % n);
                    let (c, d) = (a + per_layer, b + per_layer);
                    // The material lies outside of the lumen's ring, so its triangles have the opposite
                    // orientation.
                    let (a, b, c, d) = if l == 0 { (a, b, c, d) } else { (b, a, d, c) };
                    push(a, b, d, wall);
                    push(a, d, c, wall);
                }
            }
        }
        let top = steps * per_layer;
        for [a, b, c] in cap {
            push(top + a, top + b, top + c, wall);
            push(c, b, a, wall);
        }
    }

    /// Volume within the triangles, by the divergence theorem [um^3].
    pub fn volume(&self) -> f64 {
        let at = |v: u32| self.vertices[v as usize].map(f64::from);
        let six: f64 = self
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(at);
                a[0] * (b[1] * c[2] - b[2] * c[1])
                    + a[1] * (b[2] * c[0] - b[0] * c[2])
                    + a[2] * (b[0] * c[1] - b[1] * c[0])
            })
            .sum();
        six / 6.0
    }

    /// Writes the mesh as Wavefront OBJ, one group per wall, for viewers.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write_obj(&self, out: &mut impl Write) -> io::Result<()> {
        for [x, y, z] in &self.vertices {
            writeln!(out, "v {x} {y} {z}")?;
        }
        let mut group = None;
        for ([a, b, c], &wall) in self.triangles.iter().zip(&self.wall) {
            if group.replace(wall) != Some(wall) {
                writeln!(out, "g wall{wall}")?;
            }
            writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1)?;
        }
        Ok(())
    }
}

/// Triangles between two counterclockwise rings of `n` points, the second within the first; its vertices
/// count from `n`.
fn triangulate_annulus(outer: &[Vector2<f64>], lumen: &[Vector2<f64>]) -> Vec<[usize; 3]> {
    let n = outer.len();
    // A bridge that crosses neither ring joins both into one polygon. The shortest bridge crosses none.
    let mut bridge = (0, 0);
    let mut min = f64::INFINITY;
    for (i, p) in outer.iter().enumerate() {
        for (j, q) in lumen.iter().enumerate() {
            if (p - q).norm_squared() < min {
                min = (p - q).norm_squared();
                bridge = (i, j);
            }
        }
    }
    let (i, j) = bridge;
    let around_outer = (0..=n).map(|k| (i + k) % n);
    let around_lumen = (0..=lumen.len()).map(|k| n + (j + lumen.len() - k) % lumen.len());
    let points: Vec<_> = outer.iter().chain(lumen).copied().collect();
    triangulate(&points, around_outer.chain(around_lumen).collect())
}

/// Triangles of the counterclockwise polygon of `corners`, by ear clipping. A corner may occur twice, at the
/// ends of a bridge.
fn triangulate(points: &[Vector2<f64>], mut corners: Vec<usize>) -> Vec<[usize; 3]> {
    let mut triangles = Vec::with_capacity(corners.len());
    let mut at = 0;
    let mut refused = 0;
    // Minimum height over the base of the ears to cut. Slivers are cut last, since they may flip in f32.
    let mut height = 0.1;
    while corners.len() > 3 {
        let n = corners.len();
        let ear = [corners[at % n], corners[(at + 1) % n], corners[(at + 2) % n]];
        // Once only collinear points (up to rounding) remain, any corner is cut, so that the surface stays
        // closed.
        if height < 1e-13 || is_ear(points, &corners, ear, height) {
            triangles.push(ear);
            corners.remove((at + 1) % n);
            refused = 0;
            // The next corner is skipped, so that triangles do not all fan out from one corner.
            at = (at + 1) % (n - 1);
        } else {
            refused += 1;
            at = (at + 1) % n;
        }
        if refused > n {
            (refused, height) = (0, 0.2 * height);
        }
    }
    triangles.push([corners[0], corners[1], corners[2]]);
    triangles
}

fn is_ear(points: &[Vector2<f64>], corners: &[usize], ear: [usize; 3], height: f64) -> bool {
    let [a, b, c] = ear.map(|v| points[v]);
    let side = |p: Vector2<f64>, q: Vector2<f64>, r: Vector2<f64>| (q - p).perp(&(r - p));
    if side(a, b, c) <= height * (c - a).norm_squared() {
        return false;
    }
    corners.iter().filter(|v| !ear.contains(v)).all(|&v| {
        let p = points[v];
        side(a, b, p) < 0.0 || side(b, c, p) < 0.0 || side(c, a, p) < 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::outline::{edges, segments_cross};

    fn area(points: &[Vector2<f64>], triangles: &[[usize; 3]]) -> f64 {
        let one = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|v| points[v]);
            0.5 * (b - a).perp(&(c - a))
        };
        assert!(triangles.iter().all(|t| one(t) > 0.0), "a triangle of a cap is turned over");
        triangles.iter().map(one).sum()
    }

    /// No triangle is flipped and the areas sum to the polygon's, so the triangles do not overlap.
    #[test]
    fn caps_cover_a_comb_exactly() {
        let mut comb: Vec<_> = (0..6)
            .flat_map(|i| {
                let x = f64::from(i);
                [Vector2::new(x, 0.1), Vector2::new(x + 0.5, 5.0)]
            })
            .collect();
        comb.reverse();
        comb.extend([Vector2::new(-1.0, -1.0), Vector2::new(7.0, -1.0)]);
        assert!(
            edges(&comb)
                .all(|(p, q)| edges(&comb).all(|(r, s)| p == r || p == s || q == r || !segments_cross(p, q, r, s)))
        );
        let want: f64 = edges(&comb).map(|(a, b)| 0.5 * a.perp(&b)).sum();
        let got = area(&comb, &triangulate(&comb, (0..comb.len()).collect()));
        assert!((got - want).abs() < 1e-12, "got {got}, want {want}");
    }

    #[test]
    fn caps_cover_an_annulus_exactly() {
        let ring = |n: usize, radius: f64, shift: f64| -> Vec<Vector2<f64>> {
            (0..n)
                .map(|i| {
                    let (s, c) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
                    Vector2::new(radius * c + shift, 0.6 * radius * s)
                })
                .collect()
        };
        let (outer, lumen) = (ring(24, 8.0, 0.0), ring(24, 3.0, 4.0));
        let points: Vec<_> = outer.iter().chain(&lumen).copied().collect();
        let sum = |ring: &[Vector2<f64>]| edges(ring).map(|(a, b)| 0.5 * a.perp(&b)).sum::<f64>();
        let triangles = triangulate_annulus(&outer, &lumen);
        assert_eq!(triangles.len(), 48);
        let (got, want) = (area(&points, &triangles), sum(&outer) - sum(&lumen));
        assert!((got - want).abs() < 1e-12 * want, "got {got}, want {want}");
    }
}
