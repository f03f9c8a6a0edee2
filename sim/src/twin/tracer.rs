//! Tracer of rays among the fibers of an infinite periodic cloth: the quads of the domain in a BVH per
//! family, with rays that re-enter at the other side. A ray within a fiber searches one family only.
//!
//! A position may lie anywhere in the plane; it is moved into the domain for the search. The domain has all
//! pieces of tubes that reach into it, and they extend a little beyond, so that a ray followed up to the
//! border hits no end.

use super::curves::TwinCurves;
use super::domain::Domain;
use super::options::TwinMesh;
use super::sweep::{ClothMesh, ThreadOfFiber};
use crate::error::SimError;
use crate::rays::surface::{FiberSurface, Surfaces};
use crate::rays::tracer::{Hit, Medium, Trace};
use glam::Vec3A;
use nalgebra::Vector3;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use plywave::cloth::YarnSet;
use std::time::Duration;

/// Largest number of re-entries before a ray counts as lost.
const MAX_WRAPS: u32 = 10_000;
/// Length beyond a border within which a wall still counts [um], for rounding.
const BEYOND_UM: f32 = 1e-3;

/// The quads of one family, in the order of the leaves of their BVH.
struct Walls {
    bvh: CwBvh,
    quads: Vec<[u32; 4]>,
    wall: Vec<u32>,
}

impl Walls {
    fn new(vertices: &[[f32; 3]], quads: &[[u32; 4]], wall: &[u32]) -> Walls {
        let corner = |v: u32| Vec3A::from_array(vertices[v as usize]);
        let boxes: Vec<Aabb> = quads.iter().map(|q| Aabb::from_points(&q.map(corner))).collect();
        // A family without yarns has no walls; the BVH must have one.
        let boxes = if boxes.is_empty() { vec![Aabb::from_point(Vec3A::ZERO)] } else { boxes };
        let mut bvh = build_cwbvh(&boxes, BvhBuildParams::fast_build(), &mut Duration::default());
        drop(boxes);
        let order = std::mem::take(&mut bvh.primitive_indices);
        let in_order = |i: &u32| (*i as usize) < quads.len();
        Walls {
            bvh,
            quads: order.iter().filter(|i| in_order(i)).map(|i| quads[*i as usize]).collect(),
            wall: order.iter().filter(|i| in_order(i)).map(|i| wall[*i as usize]).collect(),
        }
    }

    fn memory_bytes(&self) -> usize {
        size_of_val(self.bvh.nodes.as_slice()) + size_of_val(self.quads.as_slice()) + size_of_val(self.wall.as_slice())
    }
}

/// The walls of all fibers of a domain.
pub struct ClothTracer {
    /// Walls of warp and weft.
    walls: [Walls; 2],
    vertices: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    fibers: Vec<ThreadOfFiber>,
    surfaces: Vec<Surfaces>,
    size: [f32; 2],
    /// All fibers lie between these heights [um].
    low: f32,
    high: f32,
}

impl ClothTracer {
    /// Packs, sweeps and sorts the fibers of a domain.
    ///
    /// # Errors
    /// [`SimError::CannotPack`] and the like, [`SimError::TwinTooLarge`].
    pub fn new(cloth: &TwinCurves, domain: &Domain, mesh: &TwinMesh, seed: u64) -> Result<ClothTracer, SimError> {
        let ClothMesh { vertices, normals, quads, wall, fibers } = cloth.mesh(domain, mesh, seed)?;
        let heights = || vertices.iter().map(|v| v[2]);
        let (low, high) = (heights().fold(0.0, f32::min) - 0.01, heights().fold(0.0, f32::max) + 0.01);
        // The warp's quads come first. Families are built one after the other: building takes several times
        // the memory of the result.
        let first = wall.partition_point(|w| fibers[*w as usize >> 1].family == YarnSet::Warp);
        let walls =
            [0..first, first..quads.len()].map(|range| Walls::new(&vertices, &quads[range.clone()], &wall[range]));
        Ok(ClothTracer {
            walls,
            vertices,
            normals,
            fibers,
            surfaces: cloth.yarns.iter().map(Surfaces::of_spec).collect(),
            size: domain.size_um.map(|s| s as f32),
            low,
            high,
        })
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        2 * self.walls.iter().map(|w| w.quads.len()).sum::<usize>()
    }

    /// Number of fibers.
    pub fn fibers(&self) -> usize {
        self.fibers.len()
    }

    /// Bytes of triangles, normals and BVH.
    pub fn memory_bytes(&self) -> usize {
        self.walls.iter().map(Walls::memory_bytes).sum::<usize>()
            + size_of_val(self.vertices.as_slice())
            + size_of_val(self.normals.as_slice())
    }

    /// Heights between which all fibers lie [um].
    pub fn heights_um(&self) -> [f32; 2] {
        [self.low, self.high]
    }

    /// Size of the domain along x and y [um]; its middle is the origin.
    pub fn size_um(&self) -> [f32; 2] {
        self.size
    }

    /// Yarn, ply and spec of a fiber.
    pub fn thread(&self, fiber: u32) -> &ThreadOfFiber {
        &self.fibers[fiber as usize]
    }

    /// The walls of a fiber.
    pub fn surface(&self, fiber: u32) -> &FiberSurface {
        let of = self.thread(fiber);
        self.surfaces[of.spec as usize].of(of.second)
    }

    /// The next wall along the ray from `pos` [um] in unit direction `dir`, within `medium`.
    pub fn trace(&self, pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium) -> Trace {
        // Adding 0 turns -0 into 0, as in the tracer of a ply.
        let d = Vec3A::new(dir.x, dir.y, dir.z) + Vec3A::ZERO;
        // Within a fiber, its family.
        let own = match medium {
            Medium::Air => None,
            Medium::Fiber(f) | Medium::Lumen(f) => Some(self.thread(f).family as usize),
        };
        let beyond = || if own.is_none() { Trace::Escaped } else { Trace::Lost };
        // A ray into the material goes against the normal.
        let into = !matches!(medium, Medium::Fiber(_));
        let folded = self.folded(pos);
        let mut at = [folded.x, folded.y];
        // Beyond this length the ray has left the cloth.
        let exit = match dir.z {
            z if z > 0.0 => (self.high - pos.z) / z,
            z if z < 0.0 => (self.low - pos.z) / z,
            _ => f32::INFINITY,
        };
        let mut done = 0.0f32;
        for _ in 0..MAX_WRAPS {
            if done > exit {
                return beyond();
            }
            let mut to_border = [f32::INFINITY; 2];
            for k in 0..2 {
                if d[k].abs() > 1e-9 {
                    to_border[k] = ((0.5 * self.size[k] - at[k] * d[k].signum()) / d[k].abs()).max(0.0);
                }
            }
            let step = to_border[0].min(to_border[1]);
            let origin = Vec3A::new(at[0], at[1], pos.z + dir.z * done);
            let mut most = (step + BEYOND_UM).min(exit - done + 1.0).max(0.0);
            let mut nearest = None;
            for (k, walls) in self.walls.iter().enumerate() {
                if own.is_some_and(|family| family != k) || walls.quads.is_empty() {
                    continue;
                }
                let ray = Ray::new(origin, d, 0.0, most);
                let mut hit = RayHit::none();
                walls.bvh.ray_traverse(ray, &mut hit, |ray, i| {
                    let (of, lumen) = (walls.wall[i] >> 1, walls.wall[i] & 1 == 1);
                    // Only the walls of the medium count, from the medium's side.
                    let wanted = match medium {
                        Medium::Air => !lumen,
                        Medium::Fiber(f) => of == f,
                        Medium::Lumen(f) => of == f && lumen,
                    };
                    if wanted { self.intersect(walls.quads[i], ray, into).0 } else { f32::INFINITY }
                });
                if hit.t < f32::INFINITY {
                    let i = hit.primitive_id as usize;
                    let (_, corners) = self.intersect(walls.quads[i], &ray, into);
                    nearest = Some((hit.t, walls.wall[i], corners));
                    most = hit.t;
                }
            }
            if let Some((t, wall, corners)) = nearest {
                return Trace::Hit(Hit {
                    t_um: done + t,
                    normal: self.normal(corners, origin + d * t),
                    fiber: wall >> 1,
                    lumen: wall & 1 == 1,
                });
            }
            if step == f32::INFINITY {
                return beyond();
            }
            for k in 0..2 {
                at[k] += d[k] * step;
                if to_border[k] <= step {
                    at[k] = -0.5 * self.size[k] * d[k].signum();
                }
            }
            done += step;
        }
        Trace::Lost
    }

    #[inline(always)]
    fn triangle(&self, corners: [u32; 3]) -> Triangle {
        let [v0, v1, v2] = corners.map(|v| Vec3A::from_array(self.vertices[v as usize]));
        Triangle { v0, v1, v2 }
    }

    /// Distance along the ray to a quad, hit from the side that leads into its material or out of it, and the
    /// corners of the triangle hit.
    #[inline(always)]
    fn intersect(&self, [a, b, c, d]: [u32; 4], ray: &Ray, into: bool) -> (f32, [u32; 3]) {
        let mut best = (f32::INFINITY, [a, b, d]);
        for corners in [[a, b, d], [a, d, c]] {
            let tri = self.triangle(corners);
            let n = (tri.v1 - tri.v0).cross(tri.v2 - tri.v0);
            // A ray into the material goes against the normal.
            if (n.dot(ray.direction) < 0.0) == into {
                let t = tri.intersect(ray);
                if t < best.0 {
                    best = (t, corners);
                }
            }
        }
        best
    }

    /// A position moved into the domain, for full precision.
    pub fn folded(&self, pos: Vector3<f32>) -> Vector3<f32> {
        let fold = |x: f32, size: f32| x - size * (x / size).round();
        Vector3::new(fold(pos.x, self.size[0]), fold(pos.y, self.size[1]), pos.z)
    }

    /// The smooth normal at a point of a triangle.
    fn normal(&self, corners: [u32; 3], p: Vec3A) -> Vector3<f32> {
        let Triangle { v0, v1, v2 } = self.triangle(corners);
        let (e1, e2) = (v1 - v0, v2 - v0);
        let n = e1.cross(e2);
        let scale = 1.0 / n.dot(n).max(f32::MIN_POSITIVE);
        let v = (p - v0).cross(e2).dot(n) * scale;
        let w = e1.cross(p - v0).dot(n) * scale;
        let [a, b, c] = corners.map(|k| Vec3A::from_array(self.normals[k as usize]));
        let smooth = (a * (1.0 - v - w) + b * v + c * w).normalize_or(n.normalize_or_zero());
        Vector3::new(smooth.x, smooth.y, smooth.z)
    }
}
