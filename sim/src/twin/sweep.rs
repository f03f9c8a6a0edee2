//! Quads of a cloth's fibers: every outline swept along its winding in its ply, along the helix of the ply
//! and the center line of the yarn.
//!
//! Tubes are open: they begin and end a little beyond the domain, where rays move to the other side. Vertices
//! have the normals of the swept surface. A polygon within an outline has less area than the outline; its
//! points are moved out so that the areas agree.

use super::cloth::TwinCloth;
use super::domain::{Domain, MAX_QUADS, PlyOf, estimate, plies_of};
use super::options::TwinMesh;
use super::strand::{Helix, Strand, V3, Winding};
use crate::error::SimError;
use crate::geometry::fiber_section::FiberSection;
use crate::geometry::outline::{Outline, edges};
use crate::geometry::section::PlySection;
use crate::simulate::stream;
use nalgebra::{Rotation2, Vector2};
use plywave::fabric::YarnSet;
use plywave::math::vec3::{cross, dot, unit};
use rand::RngExt;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Length by which tubes extend beyond the ends of the domain, beside that of leaning sections [um].
const MARGIN_UM: f64 = 5.0;
/// Points on an outline from which those of a ring are chosen.
const FINE: usize = 512;

/// Yarn, ply and spec of a fiber.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadOfFiber {
    /// Yarn set of its yarn.
    pub family: YarnSet,
    /// Index of its yarn in the domain.
    pub yarn: u32,
    /// Index of its ply among all of the domain.
    pub ply: u32,
    /// Index of its spec.
    pub spec: u32,
    /// Whether it is of the second kind of the spec's blend.
    pub second: bool,
    /// Position of its yarn's axis across, from the middle of the domain [um].
    pub(super) across: f32,
}

/// Quads of the fibers of a cloth, two triangles each. Positions are relative to the middle of the domain.
#[derive(Default)]
pub(super) struct ClothMesh {
    pub vertices: Vec<[f32; 3]>,
    /// Unit normals, out of the material.
    pub normals: Vec<[f32; 3]>,
    /// Vertices a and b of a ring, c and d above them: triangles a, b, d and a, d, c.
    pub quads: Vec<[u32; 4]>,
    /// `[quad]`: `2 fiber` for the outer wall, `2 fiber + 1` for the lumen's.
    pub wall: Vec<u32>,
    /// `[fiber]`.
    pub fibers: Vec<ThreadOfFiber>,
}

/// Points of a ring in the ply's section, with outward normals.
type Ring = Vec<(Vector2<f64>, Vector2<f64>)>;

impl ClothMesh {
    /// The mesh of the domain.
    ///
    /// # Errors
    /// [`SimError::CannotPack`] and the like, [`SimError::TwinTooLarge`].
    pub fn new(cloth: &TwinCloth, domain: &Domain, options: &TwinMesh, seed: u64) -> Result<ClothMesh, SimError> {
        let plies = plies_of(cloth, domain);
        let quads = estimate(cloth, domain, options);
        if quads > MAX_QUADS {
            let repeats = domain.repeats.iter().map(|n| u64::from(*n)).product();
            return Err(SimError::TwinTooLarge { repeats, triangles: 2.0 * quads, allowed: 2.0 * MAX_QUADS });
        }
        let parts = plies
            .par_iter()
            .enumerate()
            .map(|(i, ply)| sweep_ply(cloth, domain, options, *ply, seed, i as u64))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(ClothMesh::joined(parts))
    }

    /// One mesh of several.
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

/// Positions of the rings along the yarn over one domain, closer where the frame turns faster, with a margin
/// of `margin_um` or more beyond both ends, and the number of rings in the domain.
fn ring_places(
    strand: &Strand<'_>,
    helix: &Helix,
    winding: &Winding,
    margin_um: f64,
    options: &TwinMesh,
) -> (Vec<f64>, usize) {
    let cells = (strand.length_um / 1.0).ceil().max(8.0) as usize;
    let step = strand.length_um / cells as f64;
    let mut sum = vec![0.0];
    for i in 0..cells {
        let at = step * (i as f64 + 0.5);
        let turn = strand.bend(at) + (winding.twist() * strand.speed(at)).abs() + helix.rate().abs();
        let rings = (turn / options.turn_rad.max(1e-3)).max(1.0 / options.step_um.max(0.1));
        sum.push(sum[i] + step * rings);
    }
    let count = sum[cells].ceil().max(3.0) as usize;
    let scale = sum[cells] / count as f64;
    let mut cell = 0;
    let inner: Vec<f64> = (0..count)
        .map(|k| {
            let want = k as f64 * scale;
            while cell + 1 < cells && sum[cell + 1] <= want {
                cell += 1;
            }
            step * (cell as f64 + (want - sum[cell]) / (sum[cell + 1] - sum[cell]))
        })
        .collect();
    let periodic = |k: isize| {
        let turns = k.div_euclid(count as isize);
        inner[k.rem_euclid(count as isize) as usize] + strand.length_um * turns as f64
    };
    let before = (1..).find(|k| periodic(-k) <= -margin_um).unwrap_or(1);
    let after = (1..).find(|k| periodic(count as isize + k) >= strand.length_um + margin_um).unwrap_or(1);
    ((-before..=count as isize + after).map(periodic).collect(), count)
}

/// Number of points around an outline: more if its normal turns back and forth, fewer around a lumen, which
/// is small.
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

/// Points of a ring about an outline, relative to the fiber's center, by arc length and turn of the normal in
/// equal parts. Their polygon has the outline's area; where the outline turns by `turn` from ring to ring,
/// the chords between lie within by a share of `turn^2 / 12` on average, which is added.
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
    // To first order, moving a polygon out by d adds d times its perimeter.
    let out = (outline.area() - area) / perimeter.max(f64::MIN_POSITIVE);
    points.iter_mut().for_each(|p| p.position_um += p.normal * out);
    let scale = match outline {
        // Rings of circles are not turned.
        Outline::Circle { .. } => 1.0,
        Outline::Polyline(_) => 1.0 + turn * turn / 12.0,
    };
    let angle = Rotation2::new(fiber.angle_rad);
    points.iter().map(|p| (angle * p.position_um * scale, angle * p.normal)).collect()
}

fn sweep_ply(
    cloth: &TwinCloth,
    domain: &Domain,
    options: &TwinMesh,
    at: PlyOf,
    seed: u64,
    number: u64,
) -> Result<ClothMesh, SimError> {
    let PlyOf { family, yarn, ply, spec } = at;
    let length = domain.along_um(family);
    let mut rng = stream(seed, [u64::MAX, number]);
    let section = PlySection::generate(&cloth.yarns[spec], rng.random())?;
    let begin: f64 = TAU * rng.random::<f64>();
    let strand = Strand::new(&cloth.fabric, family, yarn as i32, length);
    let helix = Helix::new(cloth.fabric.shape(family), length);
    let winding = Winding::new(&strand, &helix, section.twist_per_um);
    let middle = [0.5 * domain.size_um[0], 0.5 * domain.size_um[1], 0.0];
    let phase = cloth.fabric.ply_turns(family, yarn as i32, 0.0) + f64::from(ply) / f64::from(helix.plies.max(1));
    // Per ring: the ply's center in the straight yarn, its frame, the angle of its fibers, and the length
    // along the axis.
    struct Frame {
        center: V3,
        radial: V3,
        tangential: V3,
        angle: Rotation2<f64>,
        /// Turn of the rotation-minimizing frame.
        least: Rotation2<f64>,
        along: f64,
    }
    // Sections stand at right angles to the center line and to the plies: they lean out of the plane of the
    // border.
    let shape = cloth.fabric.shape(family);
    let lean = |slope: f64| slope / slope.hypot(1.0);
    let margin_um = 0.5 * shape.width_um() * strand.steepest()
        + shape.ply_radius_um * lean(helix.circle_um * helix.rate().abs())
        + MARGIN_UM;
    let (places, count) = ring_places(&strand, &helix, &winding, margin_um, options);
    let turn = winding.twist().abs() * winding.total() / count as f64;
    let frames: Vec<Frame> = places
        .into_iter()
        .map(|along| {
            let arc = strand.arc(along);
            let (sin, cos) = (TAU * phase + helix.rate() * along).sin_cos();
            let d = helix.circle_um;
            let lean = d * helix.rate();
            let tangent = unit([-lean * sin, lean * cos, strand.speed(along)]);
            let radial = [cos, sin, 0.0];
            Frame {
                center: [d * cos, d * sin, arc],
                radial,
                tangential: cross(tangent, radial),
                angle: Rotation2::new(begin + winding.angle(along, arc)),
                least: Rotation2::new(winding.back(along)),
                along,
            }
        })
        .collect();
    let straight = helix.circle_um == 0.0;
    let across = match family {
        YarnSet::Warp => cloth.fabric.center_line(family, yarn as i32, 0.0).point_um[0] - middle[0],
        YarnSet::Weft => cloth.fabric.center_line(family, yarn as i32, 0.0).point_um[1] - middle[1],
    };
    let mut mesh = ClothMesh::default();
    for (fiber, id) in section.fibers.iter().zip(0..) {
        let (ply, spec, across) = (number as u32, spec as u32, across as f32);
        mesh.fibers.push(ThreadOfFiber { family, yarn, ply, spec, second: fiber.second, across });
        for (outline, lumen) in std::iter::once((&fiber.outer, 0)).chain(fiber.lumen.as_ref().map(|l| (l, 1))) {
            let ring = ring(fiber, outline, lumen == 1, turn, options);
            let is_round = matches!(outline, Outline::Circle { .. });
            let n = ring.len();
            let (mut points, mut around) = (Vec::with_capacity(n * frames.len()), Vec::with_capacity(n * frames.len()));
            for frame in &frames {
                let here = strand.place(frame.along);
                let middle = frame.angle * fiber.center_um;
                let own = if is_round { frame.least } else { frame.angle };
                for (p, normal) in &ring {
                    let (q, m) = (middle + own * p, own * normal);
                    let in_yarn = |x: f64, y: f64| -> V3 {
                        std::array::from_fn(|k| x * frame.radial[k] + y * frame.tangential[k])
                    };
                    let (offset, step) = (in_yarn(q.x, q.y), in_yarn(-m.y, m.x));
                    let [c, up, s] = std::array::from_fn(|k| frame.center[k] + offset[k]);
                    let place = if straight { here } else { strand.place_near(s, frame.along) };
                    points.push(place.image(c, up));
                    around.push(place.step(step, up));
                }
            }
            let first = mesh.vertices.len();
            let side = if lumen == 1 { -1.0 } else { 1.0 };
            for k in 0..frames.len() {
                let (before, after) = (k.saturating_sub(1), (k + 1).min(frames.len() - 1));
                for i in 0..n {
                    let along: V3 = std::array::from_fn(|x| points[after * n + i][x] - points[before * n + i][x]);
                    let normal = unit(cross(around[k * n + i], along));
                    mesh.vertices.push(std::array::from_fn(|x| (points[k * n + i][x] - middle[x]) as f32));
                    mesh.normals.push(normal.map(|v| (side * v) as f32));
                    debug_assert!((dot(normal, normal) - 1.0).abs() < 1e-6);
                }
            }
            for k in 0..frames.len() - 1 {
                for i in 0..n {
                    let (a, b) = (k * n + i, k * n + (i + 1) % n);
                    let (c, d) = (a + n, b + n);
                    // The material lies outside of the lumen's ring, so its triangles turn the other way.
                    let (a, b, c, d) = if lumen == 1 { (b, a, d, c) } else { (a, b, c, d) };
                    mesh.quads.push([a, b, c, d].map(|v| (first + v) as u32));
                    mesh.wall.push(2 * id + lumen);
                }
            }
        }
    }
    Ok(mesh)
}
