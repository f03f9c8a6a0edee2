//! The walk of one path through a ply: rough dielectric scattering at every fiber wall until the path escapes
//! (Yu 2025, 4.4).

use crate::rays::dielectric::{RoughDielectric, Scattered};
use crate::rays::surface::{FiberSurface, Surfaces, Wall, basis};
use crate::rays::tracer::{Medium, Trace, Tracer, WALL_OFFSET_UM};
use nalgebra::Vector3;
use rand::Rng;

/// The end of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathEnd {
    /// It hit no fiber (f_miss).
    Miss,
    /// It left after reflections only (f_refl).
    Reflected {
        /// Direction of propagation.
        dir: Vector3<f32>,
        /// A point on its last line [um].
        pos: Vector3<f32>,
        /// Wall interactions.
        interactions: u32,
    },
    /// It was in a fiber's material, or an opaque fiber reflected it (f_high).
    High {
        /// Direction of propagation.
        dir: Vector3<f32>,
        /// A point on its last line [um].
        pos: Vector3<f32>,
        /// Length in the material, as it counts for absorption [um]. In a core and in a blend's second fibers
        /// it is multiplied by their share of the dye; for an opaque fiber it is the length that its
        /// reflections stand for (`plywave::optics::reflections`).
        length_um: f32,
        /// Wall interactions.
        interactions: u32,
    },
    /// It was stopped at the interaction limit or lost by the tracer; counted, never added elsewhere.
    Killed,
}

/// Number of wall interactions after which a path is killed. Smooth fibers guide light over many
/// interactions; paths in rough ones stay far below the limit.
pub const MAX_INTERACTIONS: u32 = 10_000;
/// Number of scattering events in fibers after which a path is killed. A fiber 300 transport lengths wide
/// takes 1e5 of them from wall to wall.
const MAX_FLIGHTS: u32 = 10_000_000;

/// Traces one path from `pos` [um] outside the ply in unit direction `dir`.
pub fn trace_path<T: Tracer + ?Sized, R: Rng>(
    tracer: &T,
    surface: &RoughDielectric,
    pos: Vector3<f32>,
    dir: Vector3<f32>,
    rng: &mut R,
) -> PathEnd {
    let surface = FiberSurface::dielectric(*surface);
    walk(|pos, dir, medium| tracer.trace(pos, dir, medium), |_| &surface, pos, dir, rng, |_, _, _| ())
}

/// Traces one path among fibers of both kinds of a blend.
pub fn trace_path_among<T: Tracer + ?Sized, R: Rng>(
    tracer: &T,
    surfaces: &Surfaces,
    pos: Vector3<f32>,
    dir: Vector3<f32>,
    rng: &mut R,
) -> PathEnd {
    let surface = |fiber| if surfaces.is_blend() { surfaces.of(tracer.is_second(fiber)) } else { surfaces.of(false) };
    walk(|pos, dir, medium| tracer.trace(pos, dir, medium), surface, pos, dir, rng, |_, _, _| ())
}

/// Walks a path. `trace` finds the next wall as a [`Tracer`] does and `surface` gives a fiber's surface.
/// `on_hit` is called at every wall that the path hits with its fiber, the length since the last wall that
/// counts for absorption (0 in air), and the position, which it may move to an equivalent one.
#[inline(always)]
pub(crate) fn walk<'s, R: Rng>(
    trace: impl Fn(Vector3<f32>, Vector3<f32>, Medium) -> Trace,
    surface: impl Fn(u32) -> &'s FiberSurface,
    pos: Vector3<f32>,
    dir: Vector3<f32>,
    rng: &mut R,
    on_hit: impl FnMut(u32, f32, &mut Vector3<f32>),
) -> PathEnd {
    walk_by(trace, surface, pos, dir, rng, |at, rng| at.wall.scatter(at.local, at.outside, rng), on_hit)
}

/// A ray that hits a wall.
pub(crate) struct AtWall<'s> {
    pub fiber: u32,
    pub wall: &'s Wall,
    /// Whether the wall is that of a core.
    pub lumen: bool,
    /// Position of the hit [um].
    pub pos: Vector3<f32>,
    /// Axes of the local frame; the last one is the normal.
    pub axes: [Vector3<f32>; 3],
    /// Direction of the ray in the local frame.
    pub local: Vector3<f32>,
    /// Whether the ray comes from outside the material.
    pub outside: bool,
    /// Length since the last wall that counts for absorption [um].
    pub inside_um: f32,
}

/// Walks a path like [`walk`]. The closure `scatter` handles the scattering at walls; it returns the result
/// of [`Wall::scatter`].
#[inline(always)]
pub(crate) fn walk_by<'s, R: Rng>(
    trace: impl Fn(Vector3<f32>, Vector3<f32>, Medium) -> Trace,
    surface: impl Fn(u32) -> &'s FiberSurface,
    mut pos: Vector3<f32>,
    mut dir: Vector3<f32>,
    rng: &mut R,
    mut scatter: impl FnMut(&AtWall<'s>, &mut R) -> (Scattered, f32),
    mut on_hit: impl FnMut(u32, f32, &mut Vector3<f32>),
) -> PathEnd {
    let mut medium = Medium::Air;
    let mut interactions = 0;
    let mut length_um = 0.0f32;
    let mut entered = false;
    // Length of the flights since the last wall, and their number.
    let (mut flown_um, mut flights) = (0.0f32, 0u32);
    loop {
        let hit = match trace(pos, dir, medium) {
            Trace::Hit(hit) => hit,
            Trace::Escaped => break,
            Trace::Lost => return PathEnd::Killed,
        };
        if let Medium::Fiber(fiber) = medium
            && let Some(scattering) = &surface(fiber).scattering
        {
            let flight_um = scattering.flight_um(rng);
            if flight_um < hit.t_um {
                flights += 1;
                if flights > MAX_FLIGHTS {
                    return PathEnd::Killed;
                }
                pos += dir * flight_um;
                flown_um += flight_um;
                dir = scattering.deflect(dir, rng);
                continue;
            }
        }
        interactions += 1;
        if interactions > MAX_INTERACTIONS {
            return PathEnd::Killed;
        }
        let outside = !matches!(medium, Medium::Fiber(_));
        let fiber = surface(hit.fiber);
        let mut inside_um = match medium {
            Medium::Air => 0.0,
            Medium::Fiber(_) => fiber.absorbs * (flown_um + hit.t_um),
            Medium::Lumen(_) => fiber.core_absorbs * hit.t_um,
        };
        flown_um = 0.0;
        let n = hit.normal;
        let (t, b) = basis(n);
        // At a corner sharper than the geometry resolves, the normal can face away from a ray that passes the
        // wall. The ray then counts as grazing, from the side of its medium.
        let z = dir.dot(&n).abs().max(1e-6);
        let local = Vector3::new(dir.dot(&t), dir.dot(&b), if outside { -z } else { z });
        let wall = if hit.lumen { &fiber.inner } else { &fiber.outer };
        let at = AtWall {
            fiber: hit.fiber,
            wall,
            lumen: hit.lumen,
            pos: pos + dir * hit.t_um,
            axes: [t, b, n],
            local,
            outside,
            inside_um,
        };
        let (s, reflections_um) = scatter(&at, rng);
        if matches!(wall, Wall::Opaque(_)) {
            inside_um += reflections_um;
            entered = true;
        }
        if s.order == 0 {
            return PathEnd::Killed;
        }
        length_um += inside_um;
        pos += dir * hit.t_um;
        on_hit(hit.fiber, inside_um, &mut pos);
        dir = (t * s.dir.x + b * s.dir.y + n * s.dir.z).normalize();
        if s.outside {
            medium = hit.air_side();
            pos += n * WALL_OFFSET_UM;
        } else {
            medium = Medium::Fiber(hit.fiber);
            entered = true;
            pos -= n * WALL_OFFSET_UM;
        }
    }
    if interactions == 0 {
        PathEnd::Miss
    } else if entered {
        PathEnd::High { dir, pos, length_um, interactions }
    } else {
        PathEnd::Reflected { dir, pos, interactions }
    }
}
