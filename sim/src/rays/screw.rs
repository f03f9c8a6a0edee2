//! The screw march. A rigid screw sweep is a 2D picture, `inside(x, y, z) = inside2D(Rot(-twist z)(x, y))`,
//! so a ray is marched through signed distances of the cross section in the frame that turns with the fibers.
//!
//! In that frame a ray `p + s d` moves as `q(s) = Rot(-twist d_z s)(q0 + s d_xy)`, at a speed of at most
//! `|d_xy| + |twist d_z| |q|`. Nothing can be hit within the distance to the nearest wall, and so within
//! `r + distance` of the axis, which bounds a safe step. Close to a wall the step is Newton's: along a line
//! the distance to a convex outline is a convex function, so that Newton never passes it from the outside. If
//! an outline is dented or the twist bends the line, a step can pass the wall; the sign of the distance then
//! shows it, and the march steps back.
//!
//! The distance to the nearest fiber comes from one grid over the ply. Near the walls its cells name the
//! fibers whose exact distance is tested: circles in closed form, other outlines by their own grid of
//! distance and gradient.

use crate::geometry::outline::Outline;
use crate::geometry::section::PlySection;
use crate::rays::tracer::{Hit, Medium, Trace, Tracer};
use nalgebra::{Vector2, Vector3};

type V2 = Vector2<f32>;

/// A wall counts as hit when it is closer than this [um]; smaller than the offset that paths start with.
const HIT_UM: f32 = 2e-4;
/// Maximum number of steps of a march.
const MAX_STEPS: u32 = 20_000;
/// Minimum step along dented walls and walls hit from inside, as motion in the turning frame [um].
const MIN_STEP_UM: f32 = 0.2;
/// Distance from a dented wall, or one hit from inside, within which Newton's step is taken, up to four safe
/// steps long [um]. The step may pass the wall, which the march detects. To pass out and in again undetected
/// it would need a dent thinner than its overshoot.
const NEWTON_WITHIN_UM: f32 = 1.0;
/// Number of fibers that one cell of the ply's grid names.
const NEAR: usize = 4;
/// Marks an unused slot in a cell.
const NONE: u8 = u8::MAX;
/// Minimum length [um] around a cell within which it must name every fiber.
const MIN_FREE_UM: f32 = 0.2;

/// Signed distance and its gradient, negative inside, of one outline in the ply's frame.
enum ScrewWall {
    Circle { center: V2, radius: f32 },
    Grid(DistanceGrid),
}

impl ScrewWall {
    fn new(outline: &Outline, center: Vector2<f64>, angle: f64) -> ScrewWall {
        match outline {
            Outline::Circle { radius_um } => ScrewWall::Circle { center: center.cast(), radius: *radius_um as f32 },
            Outline::Polyline(points) => {
                let turn = nalgebra::Rotation2::new(angle);
                ScrewWall::Grid(DistanceGrid::new(&points.iter().map(|p| center + turn * p).collect::<Vec<_>>()))
            }
        }
    }

    /// Signed distance, gradient, and whether the outline is convex and the distance exact (not a lower
    /// bound).
    #[inline(always)]
    fn distance(&self, q: V2) -> (f32, V2, bool) {
        match self {
            ScrewWall::Circle { center, radius } => {
                let v = q - center;
                let r = v.norm().max(1e-12);
                (r - radius, v / r, true)
            }
            ScrewWall::Grid(grid) => grid.distance(q),
        }
    }
}

/// Distance and gradient of a polyline on a square grid, bilinear between the nodes. The gradient is stored,
/// not differenced: its error is of second order in cell size times curvature.
struct DistanceGrid {
    origin: V2,
    inv_cell: f32,
    n: usize,
    nodes: Vec<[f32; 3]>,
    convex: bool,
}

/// Bounds of the number of cells across an outline's grid. With 48 cells on a fiber of 15 um the bilinear
/// error of the distance is 2 nm; more cells only cost cache.
const CELLS: (usize, usize) = (48, 96);
/// Nodes along the side of a block of nodes that share their near edges.
const BLOCK: usize = 8;

impl DistanceGrid {
    fn new(points: &[Vector2<f64>]) -> DistanceGrid {
        let m = points.len();
        let convex = (0..m).all(|i| {
            let (a, b, c) = (points[i], points[(i + 1) % m], points[(i + 2) % m]);
            // Dents of less than a milliradian count as rounding errors.
            (b - a).perp(&(c - b)) >= -1e-3 * (b - a).norm() * (c - b).norm()
        });
        let (mut lo, mut hi) = (points[0], points[0]);
        for p in points {
            (lo, hi) = (lo.inf(p), hi.sup(p));
        }
        let size = (hi - lo).max();
        // A corner of curvature kappa needs cells of half its radius.
        let cells = ((1.24 * size * 2.0 * max_curvature(points)) as usize).clamp(CELLS.0, CELLS.1);
        let cell = 1.24 * size / cells as f64;
        let origin = (lo + hi) * 0.5 - Vector2::repeat(0.5 * cell * cells as f64);
        let n = cells + 1;
        let mut nodes = vec![[0.0f32; 3]; n * n];
        // An edge can be the nearest one to a node of the block only if it is at most a diagonal farther from
        // the block's center than the nearest edge.
        let radius = std::f64::consts::FRAC_1_SQRT_2 * cell * (BLOCK - 1) as f64;
        let mut distance = vec![0.0; m];
        let mut near = Vec::new();
        for (j0, i0) in (0..n).step_by(BLOCK).flat_map(|j| (0..n).step_by(BLOCK).map(move |i| (j, i))) {
            let at = |i: usize, j: usize| origin + Vector2::new(i as f64, j as f64) * cell;
            let middle = at(i0, j0) + Vector2::repeat(0.5 * cell * (BLOCK - 1) as f64);
            for (k, d) in distance.iter_mut().enumerate() {
                *d = (nearest_on_edge(points, k, middle).0 - middle).norm();
            }
            let reach = distance.iter().fold(f64::INFINITY, |a, &b| a.min(b)) + 2.0 * radius;
            near.clear();
            near.extend((0..m).filter(|&k| distance[k] <= reach));
            for j in j0..(j0 + BLOCK).min(n) {
                for i in i0..(i0 + BLOCK).min(n) {
                    let (d, g) = signed_distance(points, &near, at(i, j));
                    nodes[j * n + i] = [d as f32, g.x as f32, g.y as f32];
                }
            }
        }
        DistanceGrid { origin: origin.cast(), inv_cell: (1.0 / cell) as f32, n, nodes, convex }
    }

    /// Length s at which the line q + s v, which starts inside the outline, lies outside of it, in the middle
    /// of the grid's margin. A slightly bent path then stays on the grid.
    #[inline(always)]
    fn leave(&self, q: V2, v: V2) -> f32 {
        let size = (self.n - 1) as f32 / self.inv_cell;
        let axis = |q: f32, v: f32, lo: f32| {
            let end = lo + if v > 0.0 { 0.95 * size } else { 0.05 * size };
            if v.abs() < 1e-9 { f32::INFINITY } else { (end - q) / v }
        };
        axis(q.x, v.x, self.origin.x).min(axis(q.y, v.y, self.origin.y))
    }

    #[inline(always)]
    fn distance(&self, q: V2) -> (f32, V2, bool) {
        let f = (q - self.origin) * self.inv_cell;
        let top = (self.n - 1) as f32 - 1e-3;
        let c = V2::new(f.x.clamp(0.0, top), f.y.clamp(0.0, top));
        let (i, j) = (c.x as usize, c.y as usize);
        let (u, v) = (c.x - i as f32, c.y - j as f32);
        let at = j * self.n + i;
        let (a, b) = (&self.nodes[at..at + 2], &self.nodes[at + self.n..at + self.n + 2]);
        let mix = |k: usize| {
            let lo = a[0][k] + u * (a[1][k] - a[0][k]);
            let hi = b[0][k] + u * (b[1][k] - b[0][k]);
            lo + v * (hi - lo)
        };
        let g = V2::new(mix(1), mix(2));
        let g = g / g.norm().max(1e-6);
        // Outside of the grid, the distance from its border is a lower bound of the additional distance.
        let beyond = (f - c).norm();
        let d = mix(0);
        if beyond > 2e-3 {
            let out = beyond / self.inv_cell;
            (d.max(0.0).hypot(out), g, false)
        } else {
            (d, g, self.convex)
        }
    }
}

/// Maximum curvature of a polyline that samples a smooth outline, from the turn at each point.
fn max_curvature(points: &[Vector2<f64>]) -> f64 {
    let m = points.len();
    (0..m)
        .map(|i| {
            let (a, b) = (points[(i + 1) % m] - points[i], points[(i + 2) % m] - points[(i + 1) % m]);
            a.angle(&b) * 2.0 / (a.norm() + b.norm())
        })
        .fold(0.0, f64::max)
}

/// The point of edge `k` (from point k to the next) nearest to `q`, and its position along the edge in [0,
/// 1].
fn nearest_on_edge(points: &[Vector2<f64>], k: usize, q: Vector2<f64>) -> (Vector2<f64>, f64) {
    let (a, b) = (points[k], points[(k + 1) % points.len()]);
    let e = b - a;
    let t = ((q - a).dot(&e) / e.norm_squared()).clamp(0.0, 1.0);
    (a + e * t, t)
}

/// Signed distance (negative inside) to a counterclockwise polyline and its gradient, from the candidate
/// edges `near`. At a vertex the side is that of the mean of both edges' normals.
fn signed_distance(points: &[Vector2<f64>], near: &[usize], q: Vector2<f64>) -> (f64, Vector2<f64>) {
    let m = points.len();
    let (mut best, mut place) = (f64::INFINITY, (0, 0.0, points[0]));
    for &k in near {
        let (p, t) = nearest_on_edge(points, k, q);
        let d2 = (q - p).norm_squared();
        if d2 < best {
            (best, place) = (d2, (k, t, p));
        }
    }
    let normal = |k: usize| {
        let e = points[(k + 1) % m] - points[k];
        Vector2::new(e.y, -e.x).normalize()
    };
    let (k, t, p) = place;
    let n = if t <= 0.0 {
        normal(k) + normal((k + m - 1) % m)
    } else if t >= 1.0 {
        normal(k) + normal((k + 1) % m)
    } else {
        normal(k)
    };
    let sign = if (q - p).dot(&n) < 0.0 { -1.0 } else { 1.0 };
    let d = best.sqrt();
    // On the line itself the offset has no direction, so the normal is used.
    let g = if d > 1e-9 { (q - p) * (sign / d) } else { n.normalize() };
    (sign * d, g)
}

/// A cell of the ply's grid: the nearest fibers, and a distance from any of its points within which no other
/// fiber lies.
#[derive(Clone, Copy)]
struct Cell {
    free: f32,
    near: [u8; NEAR],
}

/// Screw march through one ply instance.
pub struct ScrewTracer {
    outer: Vec<ScrewWall>,
    lumen: Vec<Option<ScrewWall>>,
    second: Vec<bool>,
    bound: f32,
    twist: f32,
    cells: Vec<Cell>,
    n: usize,
    inv_cell: f32,
}

impl ScrewTracer {
    /// Builds the distance grids of a cross section. Returns `None` if, even on the finest grid, more fibers
    /// lie near one cell than it can name; the mesh tracer handles that section.
    pub fn new(section: &PlySection) -> Option<ScrewTracer> {
        if section.fibers.len() >= NONE as usize {
            return None;
        }
        let outer: Vec<ScrewWall> =
            section.fibers.iter().map(|f| ScrewWall::new(&f.outer, f.center_um, f.angle_rad)).collect();
        let lumen = section
            .fibers
            .iter()
            .map(|f| f.lumen.as_ref().map(|l| ScrewWall::new(l, f.center_um, f.angle_rad)))
            .collect();
        let mut tracer = ScrewTracer {
            outer,
            lumen,
            second: section.fibers.iter().map(|f| f.second).collect(),
            bound: section.bound_radius_um as f32 * 1.0001 + 0.01,
            twist: section.twist_per_um as f32,
            cells: Vec::new(),
            n: 0,
            inv_cell: 0.0,
        };
        [128, 256, 512, 1024].into_iter().any(|n| tracer.fill_cells(n)).then_some(tracer)
    }

    /// Fills an n x n grid; false if a cell that contains air cannot name enough fibers.
    fn fill_cells(&mut self, n: usize) -> bool {
        let cell = 2.0 * self.bound / n as f32;
        let half_diagonal = std::f32::consts::FRAC_1_SQRT_2 * cell;
        self.n = n;
        self.inv_cell = 1.0 / cell;
        self.cells.clear();
        let mut distances: Vec<(f32, u8)> = Vec::new();
        for j in 0..n {
            for i in 0..n {
                let q = V2::new((i as f32 + 0.5) * cell - self.bound, (j as f32 + 0.5) * cell - self.bound);
                distances.clear();
                distances.extend(self.outer.iter().enumerate().map(|(f, wall)| (wall.distance(q).0, f as u8)));
                distances.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
                let free = distances.get(NEAR).map_or(4.0 * self.bound, |d| d.0) - half_diagonal;
                if free < MIN_FREE_UM && distances[0].0 > -half_diagonal {
                    return false;
                }
                let near = std::array::from_fn(|k| distances.get(k).map_or(NONE, |d| d.1));
                self.cells.push(Cell { free, near });
            }
        }
        true
    }

    #[inline(always)]
    fn cell(&self, q: V2) -> &Cell {
        let at = |x: f32| (((x + self.bound) * self.inv_cell) as usize).min(self.n - 1);
        &self.cells[at(q.y) * self.n + at(q.x)]
    }
}

/// A ray in the turning frame, from the point where it starts.
struct TurningRay {
    q0: V2,
    d: V2,
    /// Rotation of the ray in the frame per length, -twist d_z [rad/um].
    rate: f32,
    d_norm: f32,
}

impl TurningRay {
    /// Position and velocity at `s`.
    #[inline(always)]
    fn at(&self, s: f32) -> (V2, V2) {
        let p = self.q0 + self.d * s;
        let a = self.rate * s;
        let (sin, cos) = if a.abs() < 0.4 {
            let a2 = a * a;
            (a * (1.0 - a2 * (1.0 / 6.0 - a2 / 120.0)), 1.0 - a2 * (0.5 - a2 * (1.0 / 24.0 - a2 / 720.0)))
        } else {
            a.sin_cos()
        };
        let turn = |v: V2| V2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y);
        let q = turn(p);
        (q, turn(self.d) + V2::new(-q.y, q.x) * self.rate)
    }

    /// Bound of the path's acceleration in the frame, within `bound` of the axis.
    #[inline(always)]
    fn bend(&self, bound: f32) -> f32 {
        self.rate.abs() * (2.0 * self.d_norm + self.rate.abs() * bound)
    }

    /// A length within which the ray moves by less than `distance` in the frame.
    #[inline(always)]
    fn safe_step(&self, r: f32, distance: f32) -> f32 {
        distance / (self.d_norm + self.rate.abs() * (r + distance) + 1e-12)
    }
}

/// Length within which the distance to a convex outline stays positive, for a distance `d` > 0 that changes
/// by `slope` per length and a path's acceleration of at most `bend`: the zero of d + slope s - bend s^2 / 2.
#[inline(always)]
fn convex_step(d: f32, slope: f32, bend: f32) -> f32 {
    let root = (slope * slope + 2.0 * bend * d).sqrt();
    if slope < 0.0 { 2.0 * d / (root - slope) } else { (slope + root) / bend.max(1e-20) }
}

/// Step towards a wall that is dented, or hit from inside, at a distance `d` > 0 that changes by `slope`.
#[inline(always)]
fn careful_step(d: f32, slope: f32, safe: f32, min_step: f32) -> f32 {
    let step = if slope < 0.0 && d < NEWTON_WITHIN_UM { (d / -slope).clamp(safe, 4.0 * safe) } else { safe };
    step.max(min_step)
}

/// A wall hit by the march: length, position and gradient in the turning frame.
struct WallHit {
    s: f32,
    q: V2,
    n: V2,
}

/// The march exceeded its step limit.
struct GivenUp;

/// Length at which the ray passes a wall between `good` (before it) and `bad` (behind it), by Newton's method
/// safeguarded by bisection; `side` is -1 for a wall hit from inside.
fn crossing(ray: &TurningRay, wall: &ScrewWall, side: f32, mut good: f32, mut bad: f32) -> WallHit {
    let mut s = bad;
    loop {
        let (q, v) = ray.at(s);
        let (d, n, _) = wall.distance(q);
        let (d, slope) = (side * d, side * v.dot(&n));
        if d.abs() < HIT_UM || bad - good < 1e-5 * (1.0 + bad) {
            return WallHit { s, q, n };
        }
        if d > 0.0 {
            good = s
        } else {
            bad = s
        }
        let newton = s - d / slope;
        s = if newton > good && newton < bad { newton } else { 0.5 * (good + bad) };
    }
}

impl ScrewTracer {
    /// Marches between the fibers; `None` if the ray leaves the ply.
    fn march_air(&self, ray: &TurningRay) -> Result<Option<(WallHit, u32)>, GivenUp> {
        let (mut s, mut before) = (0.0f32, 0.0f32);
        let bend = ray.bend(self.bound);
        for _ in 0..MAX_STEPS {
            let (q, v) = ray.at(s);
            let r = q.norm();
            if r > self.bound && (ray.q0 + ray.d * s).dot(&ray.d) >= 0.0 {
                return Ok(None);
            }
            let cell = self.cell(q);
            let mut step = ray.safe_step(r, cell.free);
            let min_step = MIN_STEP_UM / (v.norm() + 1e-6);
            for &f in &cell.near {
                if f == NONE {
                    break;
                }
                let wall = &self.outer[f as usize];
                let (d, n, convex) = wall.distance(q);
                let slope = v.dot(&n);
                if d < HIT_UM {
                    if slope < 0.0 && d > -HIT_UM {
                        return Ok(Some((WallHit { s, q, n }, f as u32)));
                    }
                    if d <= -HIT_UM && s > before {
                        return Ok(Some((crossing(ray, wall, 1.0, before, s), f as u32)));
                    }
                    // The ray leaves the wall, or grazes past it.
                    step = step.min(min_step);
                } else if convex {
                    step = step.min(convex_step(d, slope, bend));
                } else {
                    step = step.min(careful_step(d, slope, ray.safe_step(r, d), min_step));
                }
            }
            before = s;
            s += step;
        }
        Err(GivenUp)
    }

    /// Marches within a fiber or its lumen to the next wall; true if that is the wall of the lumen.
    fn march_inside(&self, ray: &TurningRay, fiber: u32, in_lumen: bool) -> Result<(WallHit, bool), GivenUp> {
        let outer = &self.outer[fiber as usize];
        let lumen = self.lumen[fiber as usize].as_ref();
        let bend = ray.bend(self.bound);
        let quick = match lumen {
            None => leave_convex(ray, outer).map(|hit| (hit, false)),
            Some(core) if in_lumen => leave_convex(ray, core).map(|hit| (hit, true)),
            Some(core) => leave_ring(ray, outer, core, bend),
        };
        if let Some(found) = quick {
            return Ok(found);
        }
        let (mut s, mut before) = (0.0f32, 0.0f32);
        for _ in 0..MAX_STEPS {
            let (q, v) = ray.at(s);
            let r = q.norm();
            let mut step = f32::INFINITY;
            let min_step = MIN_STEP_UM / (v.norm() + 1e-6);
            for (wall, is_lumen) in [(Some(outer), false), (lumen, true)] {
                let Some(wall) = wall else { continue };
                if in_lumen && !is_lumen {
                    continue;
                }
                // The distance is positive in the medium, which lies outside the lumen's wall in the material
                // and inside the wall otherwise.
                let side = if is_lumen && !in_lumen { 1.0 } else { -1.0 };
                let (d, n, convex) = wall.distance(q);
                let (d, slope) = (side * d, side * v.dot(&n));
                if d < HIT_UM {
                    if slope < 0.0 && d > -HIT_UM {
                        return Ok((WallHit { s, q, n }, is_lumen));
                    }
                    if d <= -HIT_UM && s > before {
                        return Ok((crossing(ray, wall, side, before, s), is_lumen));
                    }
                    step = step.min(min_step);
                } else if convex && side > 0.0 {
                    step = step.min(convex_step(d, slope, bend));
                } else {
                    step = step.min(careful_step(d, slope, ray.safe_step(r, d), min_step));
                }
            }
            before = s;
            s += step;
        }
        Err(GivenUp)
    }
}

/// The point where a ray leaves a convex outline, by Newton's method from outside. Along a straight line the
/// distance is a convex function, so that Newton's method converges to its larger root. Returns `None` if the
/// outline is dented or the twist bends the ray too much; the ray is then marched.
#[inline(always)]
fn leave_convex(ray: &TurningRay, wall: &ScrewWall) -> Option<WallHit> {
    let (q, v) = ray.at(0.0);
    // A point on the ray's tangent that is never inside.
    let s = match wall {
        ScrewWall::Circle { center, radius } => {
            let (from, a) = (q - center, v.norm_squared().max(1e-12));
            let (b, depth) = (from.dot(&v), radius * radius - from.norm_squared());
            // Near the wall, where a ray starts that does not scatter, a root is spared.
            if depth < 0.05 * radius { -2.0 * b / a } else { ((b * b + a * depth).sqrt() - b) / a }
        }
        ScrewWall::Grid(grid) if grid.convex => grid.leave(q, v),
        ScrewWall::Grid(_) => return None,
    };
    leave_from(ray, wall, s)
}

/// The point where a ray leaves a convex outline, by Newton's method from `s` at or beyond the exit.
#[inline(always)]
fn leave_from(ray: &TurningRay, wall: &ScrewWall, mut s: f32) -> Option<WallHit> {
    if !(s > 0.0 && ray.rate.abs() * s < 0.3) {
        return None;
    }
    for _ in 0..16 {
        let (q, v) = ray.at(s);
        let (d, n, trusted) = wall.distance(q);
        let slope = v.dot(&n);
        if !trusted {
            s *= 0.85;
            continue;
        }
        if slope <= 0.0 {
            return None;
        }
        if d.abs() < HIT_UM {
            return Some(WallHit { s, q, n });
        }
        s -= d / slope;
        if s <= 0.0 {
            return None;
        }
    }
    None
}

/// Number of steps towards a core after which the ray is marched.
const CORE_STEPS: u32 = 32;

/// The next wall of a ray in the material between two circles; true if it is the inner one. The exit from the
/// outer circle is found as for a solid fiber. The ray misses the inner circle if its tangent stays farther
/// away than the twist can bend the ray. Otherwise it advances by steps that cannot pass a convex wall.
/// Returns `None` for other outlines and undecided cases.
#[inline(always)]
fn leave_ring(ray: &TurningRay, outer: &ScrewWall, core: &ScrewWall, bend: f32) -> Option<(WallHit, bool)> {
    let (ScrewWall::Circle { center, radius }, ScrewWall::Circle { center: within, radius: inner }) = (outer, core)
    else {
        return None;
    };
    let (q, v) = ray.at(0.0);
    let a = v.norm_squared().max(1e-12);
    let (from, b) = (q - center, (q - center).dot(&v));
    let disc = b * b - a * (from.norm_squared() - radius * radius);
    let hit = leave_from(ray, outer, (disc.max(0.0).sqrt() - b) / a)?;
    let to = within - q;
    let nearest = (to - v * (to.dot(&v) / a).clamp(0.0, hit.s)).norm();
    if nearest - 0.5 * bend * hit.s * hit.s > *inner {
        return Some((hit, false));
    }
    let mut s = 0.0;
    for _ in 0..CORE_STEPS {
        let (q, v) = ray.at(s);
        let (d, n, _) = core.distance(q);
        let slope = v.dot(&n);
        if d < HIT_UM {
            return (slope < 0.0 && d > -HIT_UM).then_some((WallHit { s, q, n }, true));
        }
        s += convex_step(d, slope, bend);
        if s >= hit.s {
            return Some((hit, false));
        }
    }
    None
}

impl Tracer for ScrewTracer {
    fn bound_radius_um(&self) -> f32 {
        self.bound
    }

    fn period_um(&self) -> f32 {
        if self.twist == 0.0 { 1.0 } else { std::f32::consts::TAU / self.twist.abs() }
    }

    fn is_second(&self, fiber: u32) -> bool {
        self.second[fiber as usize]
    }

    fn trace(&self, pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium) -> Trace {
        let (sin, cos) = (-self.twist * pos.z).sin_cos();
        let turn = |x: f32, y: f32| V2::new(cos * x - sin * y, sin * x + cos * y);
        let d = turn(dir.x, dir.y);
        let ray = TurningRay { q0: turn(pos.x, pos.y), d, rate: -self.twist * dir.z, d_norm: d.norm() };
        let found = match medium {
            Medium::Air => match self.march_air(&ray) {
                Ok(None) => return Trace::Escaped,
                Ok(Some((hit, fiber))) => Ok((hit, fiber, false)),
                Err(GivenUp) => Err(GivenUp),
            },
            Medium::Fiber(f) => self.march_inside(&ray, f, false).map(|(hit, lumen)| (hit, f, lumen)),
            Medium::Lumen(f) => self.march_inside(&ray, f, true).map(|(hit, lumen)| (hit, f, lumen)),
        };
        let Ok((WallHit { s, q, n }, fiber, lumen)) = found else { return Trace::Lost };
        // The normal points into the air, out of the fiber or into the lumen.
        let n = if lumen { -n } else { n };
        // The gradient of sdf2D(Rot(-twist z)(x, y)) in the turning frame is (n, twist (q.y n.x - q.x n.y));
        // it is rotated back by the angle at the hit.
        let (sin, cos) = (self.twist * (pos.z + s * dir.z)).sin_cos();
        let normal = Vector3::new(cos * n.x - sin * n.y, sin * n.x + cos * n.y, self.twist * (q.y * n.x - q.x * n.y))
            .normalize();
        Trace::Hit(Hit { t_um: s, normal, fiber, lumen })
    }
}
