//! Computes normals for triangles without normals, from the positions of their corners.
//!
//! A corner's normal is the mean of the faces around its position, weighted by their angles there (Thuermer
//! and Wuethrich 1998), so that it does not depend on the triangulation of polygons. Only faces that share
//! edges count, each oriented like its neighbor across the edge, so that patches of opposite winding join
//! without a crease.

use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Smooth normals at the corners of triangles.
pub(crate) struct Smooth {
    sides: Vec<u32>,
    normals: HashMap<[u32; 2], Vec3>,
}

impl Smooth {
    /// Computes the normals of triangles over `points`.
    pub fn new(triangles: &[[u32; 3]], points: &[DVec3]) -> Smooth {
        let mut pieces = Pieces::new(triangles.len());
        let mut edges: HashMap<[u32; 2], (u32, bool)> = HashMap::new();
        for (t, corners) in (0..).zip(triangles) {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                let (other, way) = *edges.entry([a.min(b), a.max(b)]).or_insert((t, a < b));
                // Neighbors with the same winding traverse their shared edge in opposite directions.
                if other != t {
                    pieces.join(t, other, way == (a < b));
                }
            }
        }
        let sides: Vec<u32> = (0..triangles.len() as u32)
            .map(|t| {
                let (piece, turned) = pieces.find(t);
                2 * piece + u32::from(turned)
            })
            .collect();
        let mut sums: HashMap<[u32; 2], DVec3> = HashMap::new();
        for (corners, side) in triangles.iter().zip(&sides) {
            let p = corners.map(|i| points[i as usize]);
            let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
            let normal = if side % 2 == 1 { -normal } else { normal };
            for k in 0..3 {
                let angle = (p[(k + 1) % 3] - p[k]).angle_between(p[(k + 2) % 3] - p[k]);
                *sums.entry([corners[k], side / 2]).or_default() += normal * angle;
            }
        }
        let normals = sums.into_iter().map(|(at, sum)| (at, sum.normalize_or_zero().as_vec3())).collect();
        Smooth { sides, normals }
    }

    /// Index of the side of its patch on which a triangle's normals lie: corners with the same position and
    /// side share a normal.
    pub fn side(&self, triangle: usize) -> u32 {
        self.sides[triangle]
    }

    /// Unit normal at a position for a side; zero if the faces around it cancel.
    pub fn normal(&self, place: u32, side: u32) -> Vec3 {
        let normal = self.normals.get(&[place, side / 2]).copied().unwrap_or_default();
        if side % 2 == 1 { -normal } else { normal }
    }
}

/// Connected patches of triangles, each triangle with the winding of the patch's first triangle or the
/// opposite one: a disjoint-set forest with parity.
struct Pieces {
    parents: Vec<u32>,
    /// Whether the winding of each triangle is opposite to its parent's.
    turned: Vec<bool>,
}

impl Pieces {
    fn new(count: usize) -> Pieces {
        Pieces { parents: (0..count as u32).collect(), turned: vec![false; count] }
    }

    /// The patch of a triangle, and whether its winding is opposite to the patch's.
    fn find(&mut self, triangle: u32) -> (u32, bool) {
        let (mut at, mut turned) = (triangle as usize, false);
        while self.parents[at] as usize != at {
            // Path halving shortens later lookups.
            let parent = self.parents[at] as usize;
            self.turned[at] ^= self.turned[parent];
            self.parents[at] = self.parents[parent];
            turned ^= self.turned[at];
            at = self.parents[at] as usize;
        }
        (at as u32, turned)
    }

    /// Joins two triangles of opposite (`unlike`) or equal winding. A one-sided band retains a seam
    /// somewhere.
    fn join(&mut self, a: u32, b: u32, unlike: bool) {
        let ((a, a_turned), (b, b_turned)) = (self.find(a), self.find(b));
        if a != b {
            let (low, high) = (a.min(b), a.max(b));
            self.parents[high as usize] = low;
            self.turned[high as usize] = a_turned ^ b_turned ^ unlike;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A tube of `n` sides about the z axis.
    fn tube(n: u32) -> (Vec<[u32; 3]>, Vec<DVec3>) {
        let points = (0..2 * n)
            .map(|k| {
                let (y, x) = (TAU * f64::from(k % n) / f64::from(n)).sin_cos();
                DVec3::new(x, y, f64::from(k / n))
            })
            .collect();
        let side = |k: u32| {
            let next = (k + 1) % n;
            [[k, next, next + n], [k, next + n, k + n]]
        };
        ((0..n).flat_map(side).collect(), points)
    }

    fn radial(p: DVec3) -> Vec3 {
        DVec3::new(p.x, p.y, 0.0).as_vec3()
    }

    #[test]
    fn a_tube_s_normals_are_its_radii_whichever_way_its_faces_are_wound() {
        let (triangles, points) = tube(12);
        for turned in [vec![], vec![3], (0..12).collect(), vec![0, 5, 6, 7, 20, 23]] {
            let mut triangles = triangles.clone();
            turned.iter().for_each(|t: &usize| triangles[*t].swap(1, 2));
            let smooth = Smooth::new(&triangles, &points);
            for (t, corners) in triangles.iter().enumerate() {
                let sign = if turned.contains(&t) { -1.0 } else { 1.0 };
                for &k in corners {
                    let normal = sign * smooth.normal(k, smooth.side(t));
                    assert!((normal - radial(points[k as usize])).length() < 1e-6, "{turned:?}: {t} {k} {normal}");
                }
            }
        }
    }

    #[test]
    fn pieces_that_share_a_point_alone_keep_their_normals() {
        let points =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]].map(DVec3::from);
        let smooth = Smooth::new(&[[0, 1, 2], [0, 3, 4]], &points);
        assert_eq!((smooth.normal(0, smooth.side(0)), smooth.normal(0, smooth.side(1))), (Vec3::Z, Vec3::X));
    }

    /// A one-sided band has no consistent winding, but all its corners have normals.
    #[test]
    fn bands_with_one_side_have_normals() {
        let n = 24;
        let points: Vec<DVec3> = (0..2 * n)
            .map(|k| {
                let a = TAU * f64::from(k / 2) / f64::from(n);
                let w = f64::from(k % 2) - 0.5;
                let r = 2.0 + w * (0.5 * a).cos();
                DVec3::new(r * a.cos(), r * a.sin(), w * (0.5 * a).sin())
            })
            .collect();
        let m = 2 * n as u32;
        let side = |k: u32| {
            let (a, b) = (2 * k, 2 * k + 1);
            // After one turn of the band the edges are swapped.
            let (c, d) = if k + 1 == m / 2 { (1, 0) } else { (a + 2, b + 2) };
            [[a, b, d], [a, d, c]]
        };
        let triangles: Vec<[u32; 3]> = (0..m / 2).flat_map(side).collect();
        let smooth = Smooth::new(&triangles, &points);
        for (t, corners) in triangles.iter().enumerate() {
            assert!(corners.iter().all(|k| (smooth.normal(*k, smooth.side(t)).length() - 1.0).abs() < 1e-5));
        }
    }
}
