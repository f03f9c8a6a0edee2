//! Tracer of rays among the fibers of an infinite periodic cloth. The quads of the domain are in one BVH per
//! family (warp, weft), and rays that leave the domain re-enter on the opposite side. A ray within a fiber
//! searches one family only.
//!
//! A position may lie anywhere in the plane; it is folded into the domain for the search. The domain has all
//! pieces of tubes that reach into it. They extend a little beyond its sides, so that a ray up to the side
//! cannot hit an open end.

use super::curves::TwinCurves;
use super::domain::Domain;
use super::options::TwinMesh;
use super::sweep::{ClothMesh, ThreadOfFiber};
use crate::error::SimError;
use crate::rays::path::{PathEnd, walk_by};
use crate::rays::surface::{FiberSurface, Surfaces};
use crate::rays::tracer::{Hit, Medium, Trace, WALL_OFFSET_UM};
use glam::Vec3A;
use nalgebra::Vector3;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use plywave_textile::YarnSet;
use rand::Rng;
use std::cell::Cell;
use std::time::Duration;

/// Maximum number of re-entries before a ray counts as lost.
const MAX_WRAPS: u32 = 10_000;
/// Minimum |z| of a direction that is followed.
const MIN_RISE: f32 = 1e-5;
/// Tolerance for rounding: a wall within this distance beyond a side still counts [um].
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
        // The BVH needs at least one box, also for a family without yarns.
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

/// Light that has left the cloth, at the end of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftFibers {
    /// A point of its last line outside of all fibers, relative to the point of incidence [um].
    pub offset_um: [f32; 3],
    /// Unit direction of propagation.
    pub w: [f32; 3],
    /// Whether the last interaction was at a rough wall, where the light from [`LightsOfFibers::draw`] has
    /// already been counted by next event estimation.
    pub is_rough: bool,
}

/// Lights for next event estimation along a path among fibers, and a record of its absorbing lengths.
pub trait LightsOfFibers<R> {
    /// Reports a length in a fiber that counts for absorption [um]; it may be 0.
    fn passes(&mut self, thread: &ThreadOfFiber, inside_um: f32);

    /// Draws a unit direction to a light, from a point given relative to the point of incidence [um].
    fn draw(&mut self, place_um: [f32; 3], rng: &mut R) -> Option<[f32; 3]>;

    /// Reports that the path scatters towards the light drawn last with this density [1/sr], unoccluded. It
    /// leaves by `left_um`, a point outside of all fibers, after the absorbing length `length_um` in the
    /// fiber.
    fn reached(&mut self, thread: &ThreadOfFiber, left_um: [f32; 3], density: f32, length_um: f32);
}

/// The walls of all fibers of a domain.
pub struct ClothTracer {
    /// Walls of the warp and of the weft.
    walls: [Walls; 2],
    vertices: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    fibers: Vec<ThreadOfFiber>,
    surfaces: Vec<Surfaces>,
    size: [f32; 2],
    /// Minimum and maximum height of all fibers [um].
    low: f32,
    high: f32,
}

impl ClothTracer {
    /// Packs and sweeps the fibers of a domain and builds their BVHs.
    ///
    /// # Errors
    /// The errors of packing, such as [`SimError::CannotPack`], and [`SimError::TwinTooLarge`].
    pub fn new(cloth: &TwinCurves, domain: &Domain, mesh: &TwinMesh, seed: u64) -> Result<ClothTracer, SimError> {
        let ClothMesh { vertices, normals, quads, wall, fibers } = cloth.mesh(domain, mesh, seed)?;
        let heights = || vertices.iter().map(|v| v[2]);
        let (low, high) = (heights().fold(0.0, f32::min) - 0.01, heights().fold(0.0, f32::max) + 0.01);
        // The warp's quads come first. The BVHs are built one after the other, since construction takes
        // several times the memory of the result.
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

    /// Tracer of so many repeats of a cloth; `None` stands for the default of
    /// [`repeats`](super::TwinOptions::repeats).
    ///
    /// # Errors
    /// The errors of [`ClothTracer::new`].
    pub fn of_cloth(
        cloth: &TwinCurves,
        repeats: Option<[u32; 2]>,
        mesh: &TwinMesh,
        seed: u64,
    ) -> Result<ClothTracer, SimError> {
        ClothTracer::new(cloth, &cloth.domain(repeats, mesh), mesh, seed)
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        2 * self.walls.iter().map(|w| w.quads.len()).sum::<usize>()
    }

    /// Number of fibers.
    pub fn fibers(&self) -> usize {
        self.fibers.len()
    }

    /// Memory of triangles, normals and BVHs [bytes].
    pub fn memory_bytes(&self) -> usize {
        self.walls.iter().map(Walls::memory_bytes).sum::<usize>()
            + size_of_val(self.vertices.as_slice())
            + size_of_val(self.normals.as_slice())
    }

    /// Minimum and maximum height of all fibers [um].
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

    /// Nearest wall along the ray from `pos` [um] in unit direction `dir`, within `medium`.
    pub fn trace(&self, pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium) -> Trace {
        // Adding 0 turns -0 into 0, as in the tracer of a ply.
        let d = Vec3A::new(dir.x, dir.y, dir.z) + Vec3A::ZERO;
        // The only family that is searched for a ray within a fiber.
        let own = match medium {
            Medium::Air => None,
            Medium::Fiber(f) | Medium::Lumen(f) => Some(self.thread(f).family as usize),
        };
        let beyond = || if own.is_none() { Trace::Escaped } else { Trace::Lost };
        // A ray that enters the material runs against the normal.
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
            let mut max_t = (step + BEYOND_UM).min(exit - done + 1.0).max(0.0);
            let mut nearest = None;
            for (k, walls) in self.walls.iter().enumerate() {
                if own.is_some_and(|family| family != k) || walls.quads.is_empty() {
                    continue;
                }
                let ray = Ray::new(origin, d, 0.0, max_t);
                let mut hit = RayHit::none();
                walls.bvh.ray_traverse(ray, &mut hit, |ray, i| {
                    let (of, lumen) = (walls.wall[i] >> 1, walls.wall[i] & 1 == 1);
                    // Only the walls of the medium count, hit from the medium's side.
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
                    max_t = hit.t;
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
            // A ray that enters the material runs against the normal.
            if (n.dot(ray.direction) < 0.0) == into {
                let t = tri.intersect(ray);
                if t < best.0 {
                    best = (t, corners);
                }
            }
        }
        best
    }

    /// Traces light that comes along the line in unit direction `w` through a point of the cloth's middle
    /// plane [um], in the coordinates of the curves, until it leaves the cloth. Returns `None` if the path is
    /// killed. `lights` receives the absorbing lengths and the light of next event estimation.
    pub fn follow<R: Rng>(
        &self,
        at_um: [f32; 2],
        w: [f32; 3],
        rng: &mut R,
        lights: &mut impl LightsOfFibers<R>,
    ) -> Option<LeftFibers> {
        let [a, b] = self.size;
        let from = self.folded(Vector3::new(at_um[0] - 0.5 * a, at_um[1] - 0.5 * b, 0.0));
        let dir = Vector3::from(w);
        // Point of a line at the height of the highest or of the lowest fibers.
        let beyond = |pos: Vector3<f32>, dir: Vector3<f32>, is_up: bool| {
            let height = if is_up { self.high } else { self.low };
            (dir.z.abs() > MIN_RISE).then(|| pos + dir * ((height - pos.z) / dir.z))
        };
        // Sum of the translations by which positions were folded; both closures below use it.
        let moved = Cell::new(Vector3::<f32>::zeros());
        let mut was_rough = false;
        let mut samples = Vec::new();
        let end = walk_by(
            |pos, dir, medium| self.trace(pos, dir, medium),
            |fiber| self.surface(fiber),
            beyond(from, dir, dir.z < 0.0)?,
            dir,
            rng,
            |at, rng| {
                let thread = self.thread(at.fiber);
                if at.inside_um > 0.0 {
                    lights.passes(thread, at.inside_um);
                }
                was_rough = !at.lumen && at.wall.is_rough();
                let place = at.pos + moved.get();
                let light = was_rough.then(|| lights.draw((place - from).into(), rng)).flatten();
                let light = light.map(Vector3::from).filter(|light| light.dot(&at.axes[2]) > 0.0);
                let exit = light.and_then(|light| beyond(place, light, light.z > 0.0));
                let (Some(light), Some(exit)) = (light, exit) else {
                    let (scattered, length_um) = at.wall.scatter(at.local, at.outside, rng);
                    lights.passes(thread, length_um);
                    return (scattered, length_um);
                };
                samples.clear();
                let local = Vector3::from(at.axes.map(|axis| axis.dot(&light)));
                let (scattered, length_um) =
                    at.wall.scatter_toward(at.local, at.outside, rng, local, |density, length_um| {
                        if density > 0.0 {
                            samples.push((density, length_um));
                        }
                    });
                let start = at.pos + at.axes[2] * WALL_OFFSET_UM;
                if !samples.is_empty() && matches!(self.trace(start, light, Medium::Air), Trace::Escaped) {
                    for (density, length_um) in &samples {
                        lights.reached(thread, (exit - from).into(), *density, *length_um);
                    }
                }
                lights.passes(thread, length_um);
                (scattered, length_um)
            },
            |_, _, pos| {
                let folded = self.folded(*pos);
                moved.set(moved.get() + *pos - folded);
                *pos = folded;
            },
        );
        let (pos, dir) = match end {
            PathEnd::Miss => (from, dir),
            PathEnd::Reflected { dir, pos, .. } | PathEnd::High { dir, pos, .. } => (pos + moved.get(), dir),
            PathEnd::Killed => return None,
        };
        let offset = beyond(pos, dir, dir.z > 0.0)? - from;
        Some(LeftFibers { offset_um: offset.into(), w: dir.into(), is_rough: was_rough })
    }

    /// A position folded into the domain, which preserves precision.
    pub fn folded(&self, pos: Vector3<f32>) -> Vector3<f32> {
        let fold = |x: f32, size: f32| x - size * (x / size).round();
        Vector3::new(fold(pos.x, self.size[0]), fold(pos.y, self.size[1]), pos.z)
    }

    /// Interpolated normal at a point of a triangle.
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
