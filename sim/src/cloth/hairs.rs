//! Hairs on the curves of a cloth: ends and loops of fibers that stand out of its yarns.
//!
//! Roots are a Poisson process along a yarn, with [`Hairs::per_mm`] roots per millimeter. A root lies on the
//! surface of a ply, at any angle about it where no other ply covers it. The hair leaves along the fibers
//! there, tilted outwards by the angle of [`Hairs::rise`]. Lengths are exponential, as yarn testers find
//! (Barella and Manich, "The hair-length distribution of yarns", Journal of the Textile Institute 84, 1993).
//! An end is a helix of random curvature and torsion; a loop is a cubic of the drawn length between two
//! roots. A hair that would run into a ply is pushed out to the surface and lies on it. If that fails, the
//! hair gets another root; after many failed roots it is cut.
//!
//! A hair depends on the seed, its yarn and the cell alone. Left out: hairs pass through each other, and the
//! fibers that stand out remain in their plies.

use crate::error::SimError;
use plywave::cloth::{Buckets, ClothCurves, ClothYarn, CurvePoint, Lattice, PlyCurve};
use plywave::math::hash::{GAMMA, SplitMix64, mix64};
use plywave::math::vec3::{cross, dot, sub, unit};
use plywave::spec::YarnSpec;
use plywave_textile::Hairs;
use std::f64::consts::{PI, TAU};

type V3 = [f64; 3];

/// Maximum length of a hair over the mean: the exponential distribution is truncated there, which removes 0.3
/// % of the length.
const MAX_MEANS: f64 = 8.0;
/// Minimum and maximum number of pieces of a hair, the maximum length of a piece [um] and its maximum turn
/// [rad].
const PIECES: [f64; 2] = [7.0, 63.0];
const PIECE_UM: f64 = 50.0;
const PIECE_TURN: f64 = 0.4;
/// Maximum number of roots that are tried for a hair.
const TRIES: usize = 24;
/// Maximum number of pushes of a point out of plies; a push out of one may lead into another.
const PUSHES: usize = 4;
/// Minimum sine of the rise at the roots of a loop: a flatter cubic cannot reach the drawn length.
const MIN_LOOP_RISE: f64 = 0.2;
/// Distance of the roots of a loop over its length: minimum and range. They are chosen; no source gives them.
const LOOP_CHORD: [f64; 2] = [0.2, 0.6];
/// Maximum step along the axis of a ply in the search for plies near a point [um], and over the radius.
const AXIS_STEP_UM: f64 = 25.0;
const AXIS_STEP: f64 = 0.5;

/// The hairs of a kind of yarn, with their fibers.
#[derive(Clone, Debug, PartialEq)]
pub struct HairKind {
    hairs: Hairs,
    /// Radii of round fibers with the area of the yarn's two fibers [um].
    radii_um: [f64; 2],
    /// Share of the second fiber of a blend, 0 to 1.
    second_share: f64,
    /// Twist of the fibers about the axis of their ply [rad/um].
    twist_per_um: f64,
}

impl HairKind {
    /// Hairs of a yarn whose plies have this spec.
    pub fn new(hairs: Hairs, ply: &YarnSpec) -> HairKind {
        let radius = |area: f64| (area / PI).sqrt();
        let first = ply.fiber.shape.area_um2();
        let second = ply.blend.as_ref().map_or(first, |blend| blend.fiber.shape.area_um2());
        HairKind {
            hairs,
            radii_um: [radius(first), radius(second)],
            second_share: ply.blend.as_ref().map_or(0.0, |blend| blend.share),
            twist_per_um: ply.ply.twist().rad_per_um(),
        }
    }
}

/// A hair.
#[derive(Clone, Debug, PartialEq)]
pub struct Hair {
    /// Index of the curve on which its root lies.
    pub curve: u32,
    /// Whether its fiber is of the second kind of a blend.
    pub second: bool,
    /// Radius of its fiber [um].
    pub radius_um: f64,
    /// Whether it is a loop, whose last point is a root too.
    pub is_loop: bool,
    /// Whether plies block it, so that it is shorter than its drawn length.
    pub is_cut: bool,
    /// Points, starting at the root [um].
    pub points_um: Vec<[f64; 3]>,
}

impl Hair {
    /// Total length of its pieces [um].
    pub fn length_um(&self) -> f64 {
        self.points_um.windows(2).map(|p| length(sub(p[1], p[0]))).sum()
    }
}

/// Distribution of the roots of a yarn's hairs.
struct Roots {
    /// Curves of the yarn, each with the cumulated length up to its end over that of all curves.
    curves: Vec<(usize, f64)>,
    /// Mean number of hairs per cell.
    mean: f64,
    /// `[axis][min, max]`: bounds of the curves in x and y [um].
    bounds: [[f64; 2]; 2],
}

/// Generator of the hairs of a cloth.
pub struct HairRoots<'a> {
    curves: &'a ClothCurves,
    lattice: Lattice,
    kinds: Vec<Option<HairKind>>,
    yarns: Vec<Option<Roots>>,
    plies: Plies,
}

impl<'a> HairRoots<'a> {
    /// Prepares the roots of a cloth, with the hairs of each kind of yarn.
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
                // The spline of a period also depends on points of the previous and the next one.
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
        let max_radius = kinds.iter().flatten().flat_map(|kind| kind.radii_um).fold(0.0, f64::max);
        Ok(HairRoots { curves, lattice, kinds, yarns, plies: Plies::new(curves, &lattice, max_radius) })
    }

    /// Mean number of hairs on an area of the cloth, given in um2.
    pub fn mean_count(&self, area_um2: f64) -> f64 {
        self.yarns.iter().flatten().map(|roots| roots.mean).sum::<f64>() * area_um2 / self.lattice.area_um2()
    }

    /// Smallest mean radius of the hairs of a kind of yarn [um].
    pub fn mean_radius_um(&self) -> f64 {
        let mean = |kind: &HairKind| kind.radii_um[0] + kind.second_share * (kind.radii_um[1] - kind.radii_um[0]);
        self.kinds.iter().flatten().map(mean).fold(f64::MAX, f64::min)
    }

    /// All pairs of a yarn and a cell whose hairs can have roots in a rectangle, given by its minimum and
    /// maximum corner [um]. The bounds are conservative: some of the pairs have no roots there.
    pub fn pieces(&self, [low, high]: [[f64; 2]; 2]) -> Vec<(usize, [i32; 2])> {
        let mut all = Vec::new();
        for (yarn, roots) in self.yarns.iter().enumerate() {
            let Some(Roots { bounds: [x, y], .. }) = roots else { continue };
            // Range of translations for which the yarn's bounding box overlaps the rectangle.
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

    /// Minimum and maximum corner of the plies of a yarn in a cell [um]; `None` for a yarn without hairs.
    pub fn bounds_um(&self, yarn: usize, cell: [i32; 2]) -> Option<[[f64; 2]; 2]> {
        let Roots { bounds: [x, y], .. } = self.yarns.get(yarn)?.as_ref()?;
        let v = self.lattice.vector(cell);
        Some([[x[0] + v[0], y[0] + v[1]], [x[1] + v[0], y[1] + v[1]]])
    }

    /// Generates the hairs of one period of a yarn's curves in a cell.
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
            // Each hair has its own random stream, independent of how many numbers the previous one used.
            let mut own = Draw(SplitMix64(draw.0.next_u64()));
            hairs.extend(self.hair(roots, kind, cell, &mut own));
        }
        hairs
    }

    /// Generates one hair; `None` if no root was found for it.
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
            let frame = self.frame(&root, kind, 0.0, cell);
            // Center of the fiber at its root, one fiber radius outside of the ply.
            let beside = along(frame.point, radius_um, frame.normal);
            if self.plies.deepest(beside, radius_um).is_some_and(|(depth, _)| depth > 0.5 * radius_um) {
                continue;
            }
            let (points_um, is_cut) = match is_loop {
                true => self.bow(&root, &frame, kind, cell, length_um, radius_um),
                false => self.end(&root, &frame, length_um, radius_um),
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

    /// Frame of a root on the surface of its ply, or at the distance `way_um` along the ply from it.
    fn frame(&self, root: &Root, kind: &HairKind, way_um: f64, cell: [i32; 2]) -> RootFrame {
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
        RootFrame { point: along(axis, curve.radius_um, normal), normal, fiber }
    }

    /// Points of a hair with a free end, and whether it was cut.
    fn end(&self, root: &Root, frame: &RootFrame, length_um: f64, radius_um: f64) -> (Vec<V3>, bool) {
        let cosine = root.way * (1.0 - root.sine * root.sine).max(0.0).sqrt();
        let mut way = unit(std::array::from_fn(|k| root.sine * frame.normal[k] + cosine * frame.fiber[k]));
        let mut side = unit(cross(frame.normal, frame.fiber));
        let bend = root.bend_per_um[0].hypot(root.bend_per_um[1]);
        let count = pieces(length_um, bend);
        let step = length_um / count as f64;
        let mut points = vec![frame.point];
        let mut at = frame.point;
        for _ in 0..count {
            let other = cross(way, side);
            let [a, b] = root.bend_per_um.map(|bend| bend * step);
            let aim = unit(std::array::from_fn(|k| way[k] + a * side[k] + b * other[k]));
            let Some(next) = self.free(at, along(at, step, aim), Some(step), radius_um) else {
                return (points, true);
            };
            let turned = unit(sub(next, at));
            // A hair may lie down on a ply, but it must not turn back.
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

    /// Points of a loop, and whether plies block it: the cubic of the given length between two roots, which
    /// leans to one side.
    fn bow(
        &self,
        root: &Root,
        frame: &RootFrame,
        kind: &HairKind,
        cell: [i32; 2],
        length_um: f64,
        radius_um: f64,
    ) -> (Vec<V3>, bool) {
        let far = self.frame(root, kind, root.way * root.chord * length_um, cell);
        let sine = root.sine.max(MIN_LOOP_RISE);
        let cosine = root.side * (1.0 - sine * sine).sqrt();
        let out = |frame: &RootFrame| -> V3 {
            let across = cross(frame.fiber, frame.normal);
            std::array::from_fn(|k| sine * frame.normal[k] + cosine * across[k])
        };
        let (first, last) = (out(frame), out(&far));
        let count = pieces(length_um, 0.0).max(11);
        let points = |reach: f64| -> Vec<V3> {
            let (b, c) = (along(frame.point, reach, first), along(far.point, reach, last));
            let place = |i: usize| {
                let t = i as f64 / count as f64;
                let u = 1.0 - t;
                let w = [u * u * u, 3.0 * u * u * t, 3.0 * u * t * t, t * t * t];
                std::array::from_fn(|k| w[0] * frame.point[k] + w[1] * b[k] + w[2] * c[k] + w[3] * far.point[k])
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

    /// Pushes a point out of all plies, at the distance `step` from `from` if a step is given. Returns `None`
    /// if the point remains inside a ply.
    fn free(&self, from: V3, mut at: V3, step: Option<f64>, radius_um: f64) -> Option<V3> {
        for _ in 0..PUSHES {
            let Some((depth, out)) = self.plies.deepest(at, radius_um) else { return Some(at) };
            at = along(at, depth, out);
            if let Some(step) = step {
                at = along(from, step, unit(sub(at, from)));
            }
        }
        // A fiber that is half sunk lies among those of the ply's surface, which is accepted.
        self.plies.deepest(at, radius_um).is_none_or(|(depth, _)| depth <= radius_um).then_some(at)
    }
}

/// Random parameters of a hair and its root.
struct Root {
    curve: usize,
    parameter: f64,
    angle: f64,
    /// Direction along the fiber, 1 or -1.
    way: f64,
    /// Sine of the angle with the surface.
    sine: f64,
    /// Side to which a loop leans, 1 or -1.
    side: f64,
    /// Chord of a loop over its length.
    chord: f64,
    /// Curvature in a frame that turns along the hair, and the rate of that turn [1/um].
    bend_per_um: [f64; 2],
    turn_per_um: f64,
}

/// A frame on the surface of a ply.
struct RootFrame {
    point: V3,
    normal: V3,
    /// Unit direction of the fibers there.
    fiber: V3,
}

fn along(p: V3, by: f64, d: V3) -> V3 {
    std::array::from_fn(|k| p[k] + by * d[k])
}

fn length(v: V3) -> f64 {
    dot(v, v).sqrt()
}

/// Number of pieces of a hair.
fn pieces(length_um: f64, bend_per_um: f64) -> usize {
    (length_um / PIECE_UM).max(length_um * bend_per_um / PIECE_TURN).ceil().clamp(PIECES[0], PIECES[1]) as usize
}

/// Random numbers of several distributions.
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

/// Spatial index of the plies, for their depth at a point.
struct Plies {
    lattice: Lattice,
    buckets: Buckets,
    /// Points on the axes, vectors to the next ones, and radii [um].
    points: Vec<V3>,
    steps: Vec<V3>,
    radii: Vec<f64>,
    /// Maximum |z| at which a fiber can touch a ply [um].
    top: f64,
}

impl Plies {
    fn new(curves: &ClothCurves, lattice: &Lattice, fiber_um: f64) -> Plies {
        let (mut points, mut steps, mut radii) = (Vec::new(), Vec::new(), Vec::new());
        for curve in &curves.curves {
            let max_step = AXIS_STEP_UM.min(AXIS_STEP * curve.radius_um);
            let count = (curve.length_um(lattice) / max_step).ceil().max(4.0) as usize;
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

    /// Maximum penetration of a fiber of this radius at p into a ply [um], and the unit direction out of that
    /// ply; `None` if the fiber is clear of all plies.
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
            if depth > 1e-6 && best.is_none_or(|(max, _)| depth > max) {
                best = Some((depth, off));
            }
        });
        best.map(|(depth, off)| (depth, if length(off) > 0.0 { unit(off) } else { [0.0, 0.0, 1.0] }))
    }
}

#[cfg(test)]
mod tests;
