//! Triangles in an obvhs BVH: the general tracer, for any sweep.
//!
//! The mesh covers one period of the screw and a margin beyond both ends; a ray that reaches the end of the
//! period continues at the other end, so that no path hits an end cap.

use crate::geometry::mesh::TriMesh;
use crate::geometry::section::PlySection;
use crate::rays::tracer::{Hit, Medium, Trace, Tracer};
use glam::Vec3A;
use nalgebra::Vector3;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use std::time::Duration;

/// Resolution of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshResolution {
    /// Points around an outline.
    pub outline_points: usize,
    /// Length of a ring of triangles along z [um].
    pub step_um: f64,
}

impl Default for MeshResolution {
    /// 96 facets: a circle's normal turns by 3.75 degrees per facet and differs from the smooth normal by 1.1
    /// degrees rms, small against the 11 degrees of alpha 0.2.
    fn default() -> Self {
        MeshResolution { outline_points: 96, step_um: 8.0 }
    }
}

/// Mesh length of a ply without twist [um]; the value is arbitrary.
const STRAIGHT_PERIOD_UM: f64 = 100.0;
/// Number of wraps along z after which a ray counts as lost.
const MAX_WRAPS: u32 = 10_000;

/// BVH tracer of one ply instance.
pub struct MeshTracer {
    bvh: CwBvh,
    triangles: Vec<Triangle>,
    wall: Vec<u32>,
    second: Vec<bool>,
    bound: f32,
    period: f32,
}

impl MeshTracer {
    /// Meshes a cross section and builds its BVH.
    pub fn new(section: &PlySection, resolution: MeshResolution) -> MeshTracer {
        let period = if section.twist_per_um == 0.0 {
            STRAIGHT_PERIOD_UM
        } else {
            std::f64::consts::TAU / section.twist_per_um.abs()
        };
        let margin = 4.0 * resolution.step_um;
        let mesh = TriMesh::sweep(
            section,
            -0.5 * period - margin,
            0.5 * period + margin,
            resolution.outline_points,
            resolution.step_um,
        );
        let v = |i: u32| Vec3A::from_array(mesh.vertices[i as usize]);
        let triangles: Vec<Triangle> =
            mesh.triangles.iter().map(|t| Triangle { v0: v(t[0]), v1: v(t[1]), v2: v(t[2]) }).collect();
        let bvh = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        // Triangles in the order of the BVH's leaves save an indirection at every test.
        let order = &bvh.primitive_indices;
        let wall = order.iter().map(|&i| mesh.wall[i as usize]).collect();
        let triangles = order.iter().map(|&i| triangles[i as usize]).collect();
        MeshTracer {
            bvh,
            triangles,
            wall,
            second: section.fibers.iter().map(|f| f.second).collect(),
            bound: section.bound_radius_um as f32 * 1.0001 + 0.01,
            period: period as f32,
        }
    }
}

impl Tracer for MeshTracer {
    fn bound_radius_um(&self) -> f32 {
        self.bound
    }

    fn period_um(&self) -> f32 {
        self.period
    }

    fn is_second(&self, fiber: u32) -> bool {
        self.second[fiber as usize]
    }

    fn trace(&self, pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium) -> Trace {
        let half = 0.5 * self.period;
        // Adding 0 turns -0 into 0: the BVH takes a ray's octant once from the sign of its inverse and once
        // from its own sign.
        let d = Vec3A::new(dir.x, dir.y, dir.z) + Vec3A::ZERO;
        let mut z = pos.z - self.period * (pos.z / self.period).round();
        let mut done = 0.0f32;
        // Beyond this length the ray has left the bounding cylinder.
        let exit = {
            let (a, b) = (dir.x * dir.x + dir.y * dir.y, pos.x * dir.x + pos.y * dir.y);
            let c = pos.x * pos.x + pos.y * pos.y - self.bound * self.bound;
            let disc = b * b - a * c;
            if disc <= 0.0 {
                // A ray parallel to the axis that starts inside never leaves; its wraps are counted.
                if a < 1e-12 && c < 0.0 { f32::INFINITY } else { 0.0 }
            } else {
                (-b + disc.sqrt()) / a.max(1e-20)
            }
        };
        for _ in 0..MAX_WRAPS {
            if done > exit {
                return if medium == Medium::Air { Trace::Escaped } else { Trace::Lost };
            }
            let to_end = if dir.z.abs() < 1e-9 { f32::INFINITY } else { (half - z * dir.z.signum()) / dir.z.abs() };
            let origin = Vec3A::new(pos.x + dir.x * done, pos.y + dir.y * done, z);
            let ray = Ray::new(origin, d, 0.0, to_end.min(exit - done + 1.0).max(0.0));
            let mut hit = RayHit::none();
            self.bvh.ray_traverse(ray, &mut hit, |ray, i| {
                let (fiber, lumen) = (self.wall[i] >> 1, self.wall[i] & 1 == 1);
                // A ray that enters the material runs against the normal. Only the walls of the medium count,
                // hit from the medium's side.
                let (wanted, into) = match medium {
                    Medium::Air => (!lumen, true),
                    Medium::Fiber(f) => (fiber == f, false),
                    Medium::Lumen(f) => (fiber == f && lumen, true),
                };
                if !wanted {
                    return f32::INFINITY;
                }
                let tri = &self.triangles[i];
                let n = (tri.v1 - tri.v0).cross(tri.v2 - tri.v0);
                if (n.dot(ray.direction) < 0.0) != into {
                    return f32::INFINITY;
                }
                tri.intersect(ray)
            });
            if hit.t < f32::INFINITY {
                let i = hit.primitive_id as usize;
                let tri = &self.triangles[i];
                let n = (tri.v1 - tri.v0).cross(tri.v2 - tri.v0).normalize();
                return Trace::Hit(Hit {
                    t_um: done + hit.t,
                    normal: Vector3::new(n.x, n.y, n.z),
                    fiber: self.wall[i] >> 1,
                    lumen: self.wall[i] & 1 == 1,
                });
            }
            if to_end == f32::INFINITY {
                return if medium == Medium::Air { Trace::Escaped } else { Trace::Lost };
            }
            done += to_end;
            z = -half * dir.z.signum();
        }
        Trace::Lost
    }
}
