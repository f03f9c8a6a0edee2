//! Hairs on the curves of a cloth: ends and loops of fibers that stand out of its yarns.
//!
//! Roots are a Poisson process along a yarn, with [`Hairs::per_mm`] to a millimeter. A root lies on the
//! surface of a ply, at any angle about it where no other ply covers it, and leaves along the fibers there,
//! tilted outwards by the angle of [`Hairs::rise`]. Lengths are exponential, as yarn testers find them
//! (Barella and Manich, "The hair-length distribution of yarns", Journal of the Textile Institute 84, 1993).
//! An end is a helix of random curvature and torsion; a loop is a cubic of the drawn length between two
//! roots. Where a hair would run into a ply, it is pushed out to the surface and lies on it; one that does
//! not find its way gets another root, and is cut only if none of many roots will do.
//!
//! A hair depends on the seed, its yarn and the cell alone. Left out: hairs do not meet hairs, and the fibers
//! that stand out are not missing in their plies.

use crate::error::SimError;
use plywave::cloth::{Buckets, ClothCurves, ClothYarn, CurvePoint, Hairs, Lattice, PlyCurve};
use plywave::math::hash::{GAMMA, SplitMix64, mix64};
use plywave::math::vec3::{cross, dot, sub, unit};
use plywave::spec::YarnSpec;
use std::f64::consts::{PI, TAU};

type V3 = [f64; 3];

/// Most means that a length has: the exponential distribution is cut off there, which takes 0.3 % of the
/// length.
const MAX_MEANS: f64 = 8.0;
/// Least and most pieces of a hair, their length where it does not bend much [um], and their largest turn.
const PIECES: [f64; 2] = [7.0, 63.0];
const PIECE_UM: f64 = 50.0;
const PIECE_TURN: f64 = 0.4;
/// Roots that are tried for a hair.
const TRIES: usize = 24;
/// Pushes of a point out of plies, which may lead from one into another.
const PUSHES: usize = 4;
/// Least sine at the roots of a loop: a flatter one has no room for its length.
const MIN_LOOP_RISE: f64 = 0.2;
/// Distance of the roots of a loop over its length, least and range: chosen, no source has it.
const LOOP_CHORD: [f64; 2] = [0.2, 0.6];
/// Longest step along the axis of a ply in the search for plies near a point [um], and over the radius.
const AXIS_STEP_UM: f64 = 25.0;
const AXIS_STEP: f64 = 0.5;

/// The hairs of a kind of yarn, with the fibers that they are of.
#[derive(Clone, Debug, PartialEq)]
pub struct HairKind {
    hairs: Hairs,
    /// Radii of round fibers with the area of the yarn's, and the share of the second.
    radii_um: [f64; 2],
    second_share: f64,
    /// Turn of the fibers about the axis of their ply [rad/um].
    twist_per_um: f64,
}

impl HairKind {
    /// Hairs of a yarn of such plies.
    pub fn new(hairs: Hairs, ply: &YarnSpec) -> HairKind {
        let radius = |area: f64| (area / PI).sqrt();
        let first = ply.fiber.shape.area_um2();
        let second = ply.blend.as_ref().map_or(first, |blend| blend.fiber.shape.area_um2());
        HairKind {
            hairs,
            radii_um: [radius(first), radius(second)],
            second_share: ply.blend.as_ref().map_or(0.0, |blend| blend.share),
            twist_per_um: ply.ply.twist_per_um(),
        }
    }
}

/// A hair.
#[derive(Clone, Debug, PartialEq)]
pub struct Hair {
    /// Index of the curve that its root lies on.
    pub curve: u32,
    /// Whether its fiber is of the second kind of a blend.
    pub second: bool,
    /// Radius of its fiber [um].
    pub radius_um: f64,
    /// Whether it is a loop: its last point is a root too.
    pub is_loop: bool,
    /// Whether it is shorter than was drawn, since plies leave it no way.
    pub is_cut: bool,
    /// Points from the root on [um].
    pub points_um: Vec<[f64; 3]>,
}

impl Hair {
    /// Length of its pieces [um].
    pub fn length_um(&self) -> f64 {
        self.points_um.windows(2).map(|p| length(sub(p[1], p[0]))).sum()
    }
}

/// Where the hairs of a yarn have their roots.
struct Roots {
    /// Curves of the yarn, each with the length up to its end over that of all.
    curves: Vec<(usize, f64)>,
    /// Mean number of hairs a cell.
    mean: f64,
    /// Least and largest x and y of its curves [um].
    bounds: [[f64; 2]; 2],
}

/// What hairs of a cloth grow from.
pub struct HairRoots<'a> {
    curves: &'a ClothCurves,
    lattice: Lattice,
    kinds: Vec<Option<HairKind>>,
    yarns: Vec<Option<Roots>>,
    plies: Plies,
}

impl<'a> HairRoots<'a> {
    /// The roots of a cloth, of hairs by kind of yarn.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] for a cell of parallel vectors.
    pub fn new(curves: &'a ClothCurves, kinds: Vec<Option<HairKind>>) -> Result<HairRoots<'a>, SimError> {
        let lattice = curves.lattice("cloth")?;
        let lengths: Vec<f64> = curves.curves.iter().map(|curve| curve.length_um(&lattice)).collect();
        let of_yarn = |(index, yarn): (usize, &ClothYarn)| {
            let kind = kinds.get(yarn.kind as usize)?.as_ref()?;
            let own = || curves.curves.iter().enumerate().filter(|(_, curve)| curve.yarn as usize == index);
            let whole: f64 = own().map(|(i, _)| lengths[i]).sum();
            let strands: usize = own().map(|(_, curve)| curve.turns(yarn)).sum();
            let mut sum = 0.0;
            let shares = own().map(|(i, _)| {
                sum += lengths[i];
                (i, sum / whole)
            });
            let shares = shares.collect();
            let points = || own().flat_map(|(_, curve)| &curve.control_um);
            let reach = own().map(|(_, curve)| curve.radius_um).fold(0.0, f64::max);
            let bounds = [0, 1].map(|k| {
                // A period depends on points of those before and after it.
                let beyond = |curve: &PlyCurve| {
                    let (by, c) = (lattice.vector(curve.shift)[k], &curve.control_um);
                    [c[c.len() - 1][k] - by, c[0][k] + by, c[1][k] + by]
                };
                let all = points().map(|p| p[k]).chain(own().flat_map(|(_, curve)| beyond(curve)));
                let (low, high) = all.fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)));
                [low - reach, high + reach]
            });
            let mean = 1e-3 * kind.hairs.per_mm * whole / strands.max(1) as f64;
            Some(Roots { curves: shares, mean, bounds })
        };
        let yarns = curves.yarns.iter().enumerate().map(of_yarn).collect();
        let most = kinds.iter().flatten().flat_map(|kind| kind.radii_um).fold(0.0, f64::max);
        Ok(HairRoots { curves, lattice, kinds, yarns, plies: Plies::new(curves, &lattice, most) })
    }

    /// Mean number of hairs on an area of the cloth [um2].
    pub fn mean_count(&self, area_um2: f64) -> f64 {
        self.yarns.iter().flatten().map(|roots| roots.mean).sum::<f64>() * area_um2 / self.lattice.area_um2()
    }

    /// The yarns in cells whose hairs have roots in a rectangle, from its least to its largest corner [um],
    /// and some that have none there.
    pub fn pieces(&self, [low, high]: [[f64; 2]; 2]) -> Vec<(usize, [i32; 2])> {
        let mut all = Vec::new();
        for (yarn, roots) in self.yarns.iter().enumerate() {
            let Some(Roots { bounds: [x, y], .. }) = roots else { continue };
            // Vectors by which the yarn's box is moved to meet the rectangle.
            let (from, to) = ([low[0] - x[1], low[1] - y[1]], [high[0] - x[0], high[1] - y[0]]);
            let corners = [[from[0], from[1]], [to[0], from[1]], [from[0], to[1]], [to[0], to[1]]];
            let range = |k: usize| {
                let at = corners.map(|c| self.lattice.fractions(c[0], c[1])[k]);
                let (a, b) = at.into_iter().fold((f64::MAX, f64::MIN), |(a, b), f| (a.min(f), b.max(f)));
                a.floor() as i32..=b.ceil() as i32
            };
            for i in range(0) {
                for j in range(1) {
                    let v = self.lattice.vector([i, j]);
                    if (0..2).all(|k| (from[k]..=to[k]).contains(&v[k])) {
                        all.push((yarn, [i, j]));
                    }
                }
            }
        }
        all
    }

    /// Least and largest corner of the plies of a yarn in a cell [um].
    pub fn bounds_um(&self, yarn: usize, cell: [i32; 2]) -> Option<[[f64; 2]; 2]> {
        let Roots { bounds: [x, y], .. } = self.yarns.get(yarn)?.as_ref()?;
        let v = self.lattice.vector(cell);
        Some([[x[0] + v[0], y[0] + v[1]], [x[1] + v[0], y[1] + v[1]]])
    }

    /// The hairs of one period of a yarn's curves, in a cell.
    pub fn grow(&self, yarn: usize, cell: [i32; 2], seed: u64) -> Vec<Hair> {
        let Some(roots) = self.yarns.get(yarn).and_then(Option::as_ref) else { return Vec::new() };
        let Some(kind) = &self.kinds[self.curves.yarns[yarn].kind as usize] else { return Vec::new() };
        let own = [yarn as u64, cell[0] as u64, cell[1] as u64];
        let stream = own.iter().fold(mix64(seed ^ GAMMA), |hash, v| mix64(hash ^ v.wrapping_mul(GAMMA)));
        let mut draw = Draw(SplitMix64(stream));
        let mut hairs = Vec::new();
        let mut sum = draw.exponential();
        while sum < roots.mean {
            sum += draw.exponential();
            // Each hair has numbers of its own, however many the one before took.
            let mut own = Draw(SplitMix64(draw.0.next_u64()));
            hairs.extend(self.hair(roots, kind, cell, &mut own));
        }
        hairs
    }

    /// One hair; `None` if no root has room for it.
    fn hair(&self, roots: &Roots, kind: &HairKind, cell: [i32; 2], draw: &mut Draw) -> Option<Hair> {
        let Hairs { length_mm, curl_mm, rise, loops, .. } = kind.hairs;
        let whole = 1.0 - (-MAX_MEANS).exp();
        let length_um = -1e3 * length_mm * (1.0 - whole * draw.unit()).ln();
        let is_loop = draw.unit() < loops;
        let second = draw.unit() < kind.second_share;
        let radius_um = kind.radii_um[usize::from(second)];
        let mut best: Option<Hair> = None;
        for _ in 0..TRIES {
            let at = draw.unit();
            let (curve, _) = *roots.curves.iter().find(|(_, end)| at < *end).or(roots.curves.last())?;
            let root = Root {
                curve,
                parameter: draw.unit() * self.curves.curves[curve].control_um.len() as f64,
                angle: TAU * draw.unit(),
                way: if draw.unit() < 0.5 { -1.0 } else { 1.0 },
                // The mean of u^k is 1 / (k + 1).
                sine: draw.unit().powf(1.0 / rise - 1.0),
                side: if draw.unit() < 0.5 { -1.0 } else { 1.0 },
                chord: LOOP_CHORD[0] + LOOP_CHORD[1] * draw.unit(),
                bend_per_um: [draw.normal(), draw.normal()].map(|n| n / (2f64.sqrt() * 1e3 * curl_mm)),
                turn_per_um: draw.normal() / (1e3 * curl_mm),
            };
            let seat = self.seat(&root, kind, 0.0, cell);
            // The middle of the fiber beside its root, on the ply.
            let beside = along(seat.point, radius_um, seat.normal);
            if self.plies.deepest(beside, radius_um).is_some_and(|(depth, _)| depth > 0.5 * radius_um) {
                continue;
            }
            let (points_um, is_cut) = match is_loop {
                true => self.bow(&root, &seat, kind, cell, length_um, radius_um),
                false => self.end(&root, &seat, length_um, radius_um),
            };
            let hair = Hair { curve: curve as u32, second, radius_um, is_loop, is_cut, points_um };
            if !is_cut {
                return Some(hair);
            }
            let is_longer = |hair: &Hair| best.as_ref().is_none_or(|best| hair.length_um() > best.length_um());
            if !is_loop && hair.points_um.len() > 2 && is_longer(&hair) {
                best = Some(hair);
            }
        }
        best
    }

    /// The place of a root, or of one a way along the ply from it [um].
    fn seat(&self, root: &Root, kind: &HairKind, way_um: f64, cell: [i32; 2]) -> Seat {
        let curve = &self.curves.curves[root.curve];
        let at = |u: f64| -> CurvePoint { curve.at(&self.lattice, u) };
        let speed = length(at(root.parameter).d_um).max(1e-9);
        let place = at(root.parameter + way_um / speed);
        let tangent = unit(place.d_um);
        let across = unit(cross(if tangent[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] }, tangent));
        let up = cross(tangent, across);
        let (sin, cos) = (root.angle + kind.twist_per_um * way_um).sin_cos();
        let normal: V3 = std::array::from_fn(|k| cos * across[k] + sin * up[k]);
        let around = cross(tangent, normal);
        let wind = kind.twist_per_um * curve.radius_um;
        let fiber = unit(std::array::from_fn(|k| tangent[k] + wind * around[k]));
        let v = self.lattice.vector(cell);
        let axis = [place.point_um[0] + v[0], place.point_um[1] + v[1], place.point_um[2]];
        Seat { point: along(axis, curve.radius_um, normal), normal, fiber }
    }

    /// A hair with a free end, and whether it was cut.
    fn end(&self, root: &Root, seat: &Seat, length_um: f64, radius_um: f64) -> (Vec<V3>, bool) {
        let cosine = root.way * (1.0 - root.sine * root.sine).max(0.0).sqrt();
        let mut way = unit(std::array::from_fn(|k| root.sine * seat.normal[k] + cosine * seat.fiber[k]));
        let mut side = unit(cross(seat.normal, seat.fiber));
        let bend = root.bend_per_um[0].hypot(root.bend_per_um[1]);
        let count = pieces(length_um, bend);
        let step = length_um / count as f64;
        let mut points = vec![seat.point];
        let mut at = seat.point;
        for _ in 0..count {
            let other = cross(way, side);
            let [a, b] = root.bend_per_um.map(|bend| bend * step);
            let aim = unit(std::array::from_fn(|k| way[k] + a * side[k] + b * other[k]));
            let Some(next) = self.free(at, along(at, step, aim), Some(step), radius_um) else {
                return (points, true);
            };
            let turned = unit(sub(next, at));
            // It lies down on a ply, but does not turn back at one.
            if dot(turned, way) < 0.0 {
                return (points, true);
            }
            way = turned;
            at = next;
            points.push(at);
            let flat = unit(along(side, -dot(side, way), way));
            let (sin, cos) = (root.turn_per_um * step).sin_cos();
            let other = cross(way, flat);
            side = std::array::from_fn(|k| cos * flat[k] + sin * other[k]);
        }
        (points, false)
    }

    /// A loop: the cubic between two roots that leans to a side and has the length, and whether plies are in
    /// its way.
    fn bow(
        &self,
        root: &Root,
        seat: &Seat,
        kind: &HairKind,
        cell: [i32; 2],
        length_um: f64,
        radius_um: f64,
    ) -> (Vec<V3>, bool) {
        let far = self.seat(root, kind, root.way * root.chord * length_um, cell);
        let sine = root.sine.max(MIN_LOOP_RISE);
        let cosine = root.side * (1.0 - sine * sine).sqrt();
        let out = |seat: &Seat| -> V3 {
            let across = cross(seat.fiber, seat.normal);
            std::array::from_fn(|k| sine * seat.normal[k] + cosine * across[k])
        };
        let (first, last) = (out(seat), out(&far));
        let count = pieces(length_um, 0.0).max(11);
        let points = |reach: f64| -> Vec<V3> {
            let (b, c) = (along(seat.point, reach, first), along(far.point, reach, last));
            let place = |i: usize| {
                let t = i as f64 / count as f64;
                let u = 1.0 - t;
                let w = [u * u * u, 3.0 * u * u * t, 3.0 * u * t * t, t * t * t];
                std::array::from_fn(|k| w[0] * seat.point[k] + w[1] * b[k] + w[2] * c[k] + w[3] * far.point[k])
            };
            (0..=count).map(place).collect()
        };
        let long = |points: &[V3]| points.windows(2).map(|p| length(sub(p[1], p[0]))).sum::<f64>();
        let (mut low, mut high) = (0.0, 3.0 * length_um);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            *(if long(&points(middle)) < length_um { &mut low } else { &mut high }) = middle;
        }
        let mut curve = points(0.5 * (low + high));
        for i in 1..count {
            let Some(free) = self.free(curve[i - 1], curve[i], None, radius_um) else { return (curve, true) };
            curve[i] = free;
        }
        (curve, false)
    }

    /// A point pushed out of all plies, a step from `from` where one is given; `None` if it stays within one.
    fn free(&self, from: V3, mut at: V3, step: Option<f64>, radius_um: f64) -> Option<V3> {
        for _ in 0..PUSHES {
            let Some((depth, out)) = self.plies.deepest(at, radius_um) else { return Some(at) };
            at = along(at, depth, out);
            if let Some(step) = step {
                at = along(from, step, unit(sub(at, from)));
            }
        }
        // A fiber that is half sunk lies among those of the surface.
        self.plies.deepest(at, radius_um).is_none_or(|(depth, _)| depth <= radius_um).then_some(at)
    }
}

/// Random numbers of a root.
struct Root {
    curve: usize,
    parameter: f64,
    angle: f64,
    /// Along the fiber, 1 or -1.
    way: f64,
    /// Of the angle with the surface.
    sine: f64,
    /// To which side a loop leans, 1 or -1, and its chord over its length.
    side: f64,
    chord: f64,
    /// Curvature in a frame that turns along the hair, and that turn [1/um].
    bend_per_um: [f64; 2],
    turn_per_um: f64,
}

/// A place on the surface of a ply.
struct Seat {
    point: V3,
    normal: V3,
    /// Direction of the fibers there.
    fiber: V3,
}

fn along(p: V3, by: f64, d: V3) -> V3 {
    std::array::from_fn(|k| p[k] + by * d[k])
}

fn length(v: V3) -> f64 {
    dot(v, v).sqrt()
}

/// Pieces of a hair.
fn pieces(length_um: f64, bend_per_um: f64) -> usize {
    (length_um / PIECE_UM).max(length_um * bend_per_um / PIECE_TURN).ceil().clamp(PIECES[0], PIECES[1]) as usize
}

/// Random numbers.
struct Draw(SplitMix64);

impl Draw {
    fn unit(&mut self) -> f64 {
        self.0.next_f64()
    }

    fn exponential(&mut self) -> f64 {
        -(1.0 - self.unit()).ln()
    }

    fn normal(&mut self) -> f64 {
        (2.0 * self.exponential()).sqrt() * (TAU * self.unit()).cos()
    }
}

/// Plies near a point.
struct Plies {
    lattice: Lattice,
    buckets: Buckets,
    /// Points on the axes, the ways to the next, and the radii [um].
    points: Vec<V3>,
    steps: Vec<V3>,
    radii: Vec<f64>,
    /// Height beyond which there is none [um].
    top: f64,
}

impl Plies {
    fn new(curves: &ClothCurves, lattice: &Lattice, fiber_um: f64) -> Plies {
        let (mut points, mut steps, mut radii) = (Vec::new(), Vec::new(), Vec::new());
        for curve in &curves.curves {
            let most = AXIS_STEP_UM.min(AXIS_STEP * curve.radius_um);
            let count = (curve.length_um(lattice) / most).ceil().max(4.0) as usize;
            let place = |i: usize| {
                let u = i as f64 / count as f64 * curve.control_um.len() as f64;
                curve.at(lattice, u).point_um
            };
            for i in 0..count {
                points.push(place(i));
                steps.push(sub(place(i + 1), place(i)));
                radii.push(curve.radius_um);
            }
        }
        let widest = radii.iter().copied().fold(0.0, f64::max);
        let longest = steps.iter().map(|step| length(*step)).fold(0.0, f64::max);
        let top = points.iter().map(|p| p[2].abs()).fold(0.0, f64::max) + widest + fiber_um;
        let buckets = Buckets::new(lattice, &points, widest + fiber_um + longest);
        Plies { lattice: *lattice, buckets, points, steps, radii, top }
    }

    /// By how much the middle of a fiber of this radius lies too deep in a ply, the one where it is deepest,
    /// and the direction out of it; `None` where it is clear of all.
    fn deepest(&self, p: V3, radius_um: f64) -> Option<(f64, V3)> {
        if p[2].abs() > self.top {
            return None;
        }
        let mut best: Option<(f64, V3)> = None;
        self.buckets.near(p, |i, cells| {
            let by = self.lattice.vector(cells);
            let q = self.points[i];
            let to: V3 = [p[0] - q[0] - by[0], p[1] - q[1] - by[1], p[2] - q[2]];
            let step = self.steps[i];
            let share = (dot(to, step) / dot(step, step).max(1e-300)).clamp(0.0, 1.0);
            let off = along(to, -share, step);
            let depth = self.radii[i] + radius_um - length(off);
            if depth > 1e-6 && best.is_none_or(|(most, _)| depth > most) {
                best = Some((depth, off));
            }
        });
        best.map(|(depth, off)| (depth, if length(off) > 0.0 { unit(off) } else { [0.0, 0.0, 1.0] }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plywave::spec::POLYESTER;

    const RADIUS_UM: f64 = 50.0;
    const HAIRS: Hairs = Hairs { per_mm: 5.0, length_mm: 0.4, curl_mm: 0.5, rise: 0.4, loops: 0.0 };

    /// A plain weave of single plies, in a sheared cell.
    fn plain() -> ClothCurves {
        let cell_um = [[600.0, 0.0], [0.0, 500.0]];
        let lattice = Lattice::new(cell_um).unwrap();
        let mut cloth = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
        for kind in 0..2usize {
            let (own, other) = (cell_um[1 - kind][1 - kind], cell_um[kind][kind]);
            let shift = if kind == 0 { [0, 1] } else { [1, 0] };
            for number in 0..2 {
                cloth.yarns.push(ClothYarn { kind: kind as u32, number, step: [0; 2], period: shift });
                let points: Vec<V3> = (0..32)
                    .map(|i| {
                        let t = f64::from(i) / 32.0;
                        let mut p = [0.0; 3];
                        p[1 - kind] = t * own;
                        p[kind] = (0.25 + 0.5 * f64::from(number)) * other;
                        let up = if (number == 0) == (kind == 0) { 1.0 } else { -1.0 };
                        p[2] = up * 52.0 * (TAU * (t - 0.25)).cos();
                        p
                    })
                    .collect();
                let yarn = cloth.yarns.len() as u32 - 1;
                cloth.curves.push(PlyCurve::through(yarn, RADIUS_UM, shift, &points, &lattice));
            }
        }
        cloth.check("plain").unwrap();
        cloth
    }

    fn kind(hairs: Hairs) -> HairKind {
        HairKind::new(hairs, &YarnSpec::parse(POLYESTER, "polyester.toml").unwrap())
    }

    /// All hairs of a square of cells.
    fn grown(roots: &HairRoots<'_>, cells: i32) -> Vec<(usize, [i32; 2], Hair)> {
        let all = (0..4).flat_map(|yarn| (0..cells).flat_map(move |i| (0..cells).map(move |j| (yarn, [i, j]))));
        all.flat_map(|(yarn, cell)| roots.grow(yarn, cell, 1).into_iter().map(move |hair| (yarn, cell, hair))).collect()
    }

    /// Distance of a point from the axis of a curve in any cell near it, by brute force.
    fn distance(cloth: &ClothCurves, curve: usize, p: V3) -> f64 {
        let lattice = cloth.lattice("plain").unwrap();
        let mut least = f64::MAX;
        for i in 0..800 {
            let q = cloth.curves[curve].at(&lattice, f64::from(i) / 25.0).point_um;
            let f = lattice.fractions(p[0] - q[0], p[1] - q[1]).map(|f| f.round() as i32);
            let v = lattice.vector(f);
            least = least.min(length([p[0] - q[0] - v[0], p[1] - q[1] - v[1], p[2] - q[2]]));
        }
        least
    }

    /// Number a millimeter, lengths and sides are those of the spec; roots lie on the plies.
    #[test]
    fn hairs_are_as_many_and_as_long_as_the_spec_says() {
        let cloth = plain();
        let roots = HairRoots::new(&cloth, vec![Some(kind(HAIRS)), Some(kind(HAIRS))]).unwrap();
        let cells = 30;
        let hairs = grown(&roots, cells);
        let lattice = cloth.lattice("plain").unwrap();
        let yarn_mm: f64 =
            1e-3 * f64::from(cells * cells) * cloth.curves.iter().map(|c| c.length_um(&lattice)).sum::<f64>();
        let (n, want) = (hairs.len() as f64, HAIRS.per_mm * yarn_mm);
        println!("{n} hairs on {yarn_mm:.1} mm of yarn, wanted {want:.1}");
        assert!((n - want).abs() < 5.0 * want.sqrt(), "{n} {want}");
        let mean_count = roots.mean_count(f64::from(cells * cells) * lattice.area_um2());
        assert!((mean_count - want).abs() < 1e-9 * want, "{mean_count} {want}");
        // Exponential: the share longer than x is exp(-x / mean), but for the cut at 8 means.
        let uncut: Vec<f64> = hairs.iter().filter(|(.., h)| !h.is_cut).map(|(.., h)| h.length_um()).collect();
        let cut = 1.0 - uncut.len() as f64 / n;
        println!("cut {cut:.5}, mean {:.1} um", uncut.iter().sum::<f64>() / uncut.len() as f64);
        assert!(cut < 0.002, "{cut}");
        for x in [0.1, 0.4, 0.8, 1.2, 2.0] {
            let (got, want) = (uncut.iter().filter(|l| **l > 1e3 * x).count() as f64 / n, (-x / HAIRS.length_mm).exp());
            let se = (want * (1.0 - want) / n).sqrt();
            println!("longer than {x} mm: {got:.4}, exponential {want:.4}");
            assert!((got - want).abs() < 5.0 * se + 2e-3, "{x}: {got} {want}");
        }
        let (mut up, mut off) = (0.0, 0.0f64);
        for (.., hair) in &hairs {
            off = off.max((distance(&cloth, hair.curve as usize, hair.points_um[0]) - RADIUS_UM).abs());
            up += f64::from(u8::from(hair.points_um[hair.points_um.len() - 1][2] > 0.0)) / n;
        }
        println!("tips above {up:.4}, roots off their plies {off:.4} um");
        assert!((up - 0.5).abs() < 5.0 * 0.5 / n.sqrt(), "{up}");
        assert!(off < 0.1, "{off}");
    }

    /// No hair runs through a ply, but for half of its own radius.
    #[test]
    fn hairs_stay_outside_of_plies() {
        let cloth = plain();
        let mixed = Hairs { loops: 0.3, length_mm: 1.0, ..HAIRS };
        let roots = HairRoots::new(&cloth, vec![Some(kind(mixed)), None]).unwrap();
        let hairs = grown(&roots, 6);
        let loops = hairs.iter().filter(|(.., h)| h.is_loop).count() as f64 / hairs.len() as f64;
        println!("{} hairs, {loops:.3} of them loops", hairs.len());
        assert!((loops - 0.3).abs() < 5.0 * (0.21 / hairs.len() as f64).sqrt(), "{loops}");
        let mut least = f64::MAX;
        for (yarn, _, hair) in &hairs {
            assert!(*yarn < 2, "a yarn without hairs has some");
            let ends = if hair.is_loop { hair.points_um.len() - 1 } else { hair.points_um.len() };
            for p in &hair.points_um[1..ends] {
                least = (0..4).map(|curve| distance(&cloth, curve, *p) - RADIUS_UM).fold(least, f64::min);
            }
            if hair.is_loop {
                let last = hair.points_um[hair.points_um.len() - 1];
                assert!((distance(&cloth, hair.curve as usize, last) - RADIUS_UM).abs() < 0.1);
            }
        }
        println!("nearest to a ply's surface: {least:.2} um");
        assert!(least > -0.1, "{least}");
    }

    /// The direction at the root and the curvature are those of the spec, of hairs that nothing is in the way
    /// of.
    #[test]
    fn hairs_bend_and_rise_as_the_spec_says() {
        let mut cloth = plain();
        // One straight ply.
        cloth.yarns.truncate(1);
        let lattice = cloth.lattice("plain").unwrap();
        let points: Vec<V3> = (0..8).map(|i| [150.0, 62.5 * f64::from(i), 0.0]).collect();
        cloth.curves = vec![PlyCurve::through(0, RADIUS_UM, [0, 1], &points, &lattice)];
        let stiff = Hairs { length_mm: 0.5, curl_mm: 2.0, ..HAIRS };
        let roots = HairRoots::new(&cloth, vec![Some(kind(stiff))]).unwrap();
        let hairs: Vec<Hair> = (0..2000).flat_map(|i| roots.grow(0, [0, i], 3)).collect();
        // Flat ones are pushed off the ply by their radius, short ones most.
        const LEAST: f64 = 0.3;
        let (mut rise, mut bend, mut n, mut all) = (0.0, 0.0, 0.0, 0.0);
        for hair in hairs.iter().filter(|hair| hair.length_um() > 300.0) {
            let [a, b, c] = [0, 1, 2].map(|i| hair.points_um[i]);
            let (d, e) = (unit(sub(b, a)), unit(sub(c, b)));
            let sine = dot(d, unit([a[0] - 150.0, 0.0, a[2]]));
            all += 1.0;
            if sine > LEAST {
                rise += sine;
                bend += (length(cross(d, e)) / length(sub(b, a))).powi(2);
                n += 1.0;
            }
        }
        let (share, rise, bend) = (n / all, rise / n, (n / bend).sqrt());
        println!("{n} hairs, {share:.4} of all: mean sine {rise:.4}, radius of bends {bend:.1} um");
        // P(sine < s) = s^a.
        let a = stiff.rise / (1.0 - stiff.rise);
        let want_share = 1.0 - LEAST.powf(a);
        let want = a / (a + 1.0) * (1.0 - LEAST.powf(a + 1.0)) / want_share;
        assert!((share - want_share).abs() < 5.0 * 0.5 / f64::sqrt(all), "{share} {want_share}");
        assert!((rise - want).abs() < 5.0 * 0.2 / f64::sqrt(n) + 0.005, "{rise} {want}");
        assert!((bend / (1e3 * stiff.curl_mm) - 1.0).abs() < 0.05, "{bend}");
    }

    /// The same seed gives the same hairs, another seed others; the pieces of a rectangle have all of its
    /// hairs, once.
    #[test]
    fn pieces_cover_a_rectangle_once() {
        let cloth = plain();
        let roots = HairRoots::new(&cloth, vec![Some(kind(HAIRS)), Some(kind(HAIRS))]).unwrap();
        assert_eq!(roots.grow(1, [3, -4], 7), roots.grow(1, [3, -4], 7));
        assert_ne!(roots.grow(1, [3, -4], 7), roots.grow(1, [3, -4], 8));
        let area = [[-700.0, 250.0], [3300.0, 2950.0]];
        let pieces = roots.pieces(area);
        let mut once = pieces.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), pieces.len());
        let inside = |p: &V3| (0..2).all(|k| (area[0][k]..area[1][k]).contains(&p[k]));
        let count = |pieces: &[(usize, [i32; 2])]| {
            let all = pieces.iter().flat_map(|(yarn, cell)| roots.grow(*yarn, *cell, 1));
            all.filter(|hair| inside(&hair.points_um[0])).count()
        };
        let wide = roots.pieces([[-3000.0, -2000.0], [6000.0, 6000.0]]);
        assert!(wide.len() > 2 * pieces.len());
        assert_eq!(count(&pieces), count(&wide));
    }
}
