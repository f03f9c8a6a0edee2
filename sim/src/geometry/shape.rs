//! Fiber outlines drawn at random from the spec's shape and jitter.
//!
//! Every outline is smooth, simple, counterclockwise and centered on its centroid; vertices lie on the smooth
//! curve. Curves are parametric or, for polygons, of lines and arcs; both are sampled uniformly in arc
//! length, more densely where they bend sharply. Not modeled: variation along the fiber (the section is the
//! same at every height).

use crate::error::SimError;
use crate::geometry::fiber_section::FiberSection;
use crate::geometry::outline::{Outline, edges};
use nalgebra::{Rotation2, Vector2};
use plywave::spec::{FiberSpec, Shape};
use rand::{Rng, RngExt};
use std::f64::consts::{PI, TAU};

/// Minimum number of points of a polyline.
const MIN_POINTS: usize = 192;
/// Maximum number of points of a polyline.
const MAX_POINTS: usize = 1024;
/// Maximum turn from edge to edge [rad], subject to [`MAX_POINTS`].
const MAX_TURN: f64 = 0.2;
/// Power of the kidney's dent: its half width is about 0.4 of the half width of the fiber.
const DENT_POWER: i32 = 10;
/// Bend of the kidney's midline at its ends, per depth of the dent.
const KIDNEY_BEND: f64 = 0.5;
/// Height of the lumen relative to one of the outline's own proportions: cotton collapses when it dries.
const LUMEN_FLATNESS: f64 = 0.45;
/// Mean depth of the teeth of a serrated outline, relative to the spec's.
pub const MEAN_TOOTH: f64 = 0.7;
/// Maximum number of redraws of a random polygon until its rounding fits.
const REDRAWS: usize = 64;

/// Draws one fiber at the origin.
pub fn draw<R: Rng>(spec: &FiberSpec, rng: &mut R) -> Result<FiberSection, SimError> {
    let size = (1.0 + spec.size_jitter * normal3(rng)).max(0.2);
    let angle_rad = match spec.angle_jitter_rad {
        Some(sd) => sd * normal3(rng),
        None => rng.random_range(0.0..TAU),
    };
    let jitter = spec.shape_jitter;
    let (outer, lumen) = match &spec.shape {
        Shape::Circle { radius_um } => (Outline::Circle { radius_um: size * radius_um }, None),
        Shape::HollowCircle { radius_um, lumen, .. } => {
            let hollow = (lumen * (1.0 + jitter * normal3(rng))).clamp(0.01, 0.985);
            let circle = |radius_um| Outline::Circle { radius_um };
            (circle(size * radius_um), Some(circle(size * radius_um * hollow)))
        }
        Shape::Ellipse { a_um, b_um } => {
            let (a, b) = stretched(*a_um, *b_um, jitter, rng);
            (curve(|t| Vector2::new(a * t.cos(), b * t.sin()) * size), None)
        }
        Shape::Kidney { a_um, b_um, dent, lumen } => {
            let (a, b) = stretched(size * a_um, size * b_um, jitter, rng);
            let dent = (dent * (1.0 + jitter * normal3(rng))).clamp(0.0, 0.85);
            let hollow = (lumen * (1.0 + jitter * normal3(rng))).clamp(0.0, 0.92);
            kidney(a, b, dent, hollow)
        }
        Shape::RoundedTriangle { radius_um, rounding_um } => {
            (triangle(size * radius_um, size * rounding_um, jitter, rng)?, None)
        }
        Shape::Stone { radius_um, corners, rounding_um } => {
            (stone(size * radius_um, *corners, size * rounding_um, jitter, rng)?, None)
        }
        Shape::Trilobal { radius_um, depth } => {
            let depth = (depth * (1.0 + jitter * normal3(rng))).clamp(0.0, 0.42);
            let oval = (0.5 * jitter * normal3(rng)).clamp(-0.15, 0.15);
            let phase = rng.random_range(0.0..TAU);
            let radius = |t: f64| 1.0 + depth * (3.0 * t).cos() + oval * (2.0 * t + phase).cos();
            (curve(|t| polar(size * radius_um * radius(t), t)), None)
        }
        Shape::Serrated { radius_um, depth, teeth } => {
            (serrated(size * radius_um, *depth, f64::from(*teeth), jitter, rng), None)
        }
        Shape::Polygon { points_um, rounding_um, .. } => {
            let (x, y) = stretched(size, size, jitter, rng);
            let scaled = |x, y| points_um.iter().map(|p| Vector2::new(x * p[0], y * p[1])).collect();
            // A stretched edge may be too short for its arcs; the edges of the spec's polygon are long
            // enough.
            let outline = rounded_polygon(scaled(x, y), size * rounding_um);
            (outline.or_else(|_| rounded_polygon(scaled(size, size), size * rounding_um))?, None)
        }
    };
    let center = outer.centroid();
    Ok(FiberSection {
        center_um: Vector2::zeros(),
        angle_rad,
        outer: shifted(outer, -center),
        lumen: lumen.map(|wall| shifted(wall, -center)),
        second: false,
    })
}

/// A standard normal number within three standard deviations.
pub(crate) fn normal3<R: Rng>(rng: &mut R) -> f64 {
    loop {
        let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
        let x = radius * (TAU * rng.random::<f64>()).cos();
        if x.abs() <= 3.0 {
            return x;
        }
    }
}

/// Two lengths, one stretched and one shrunk at random by the same factor.
fn stretched<R: Rng>(a: f64, b: f64, jitter: f64, rng: &mut R) -> (f64, f64) {
    let stretch = (0.5 * jitter * normal3(rng)).exp();
    (a * stretch, b / stretch)
}

fn polar(radius: f64, t: f64) -> Vector2<f64> {
    Vector2::new(t.cos(), t.sin()) * radius
}

fn shifted(outline: Outline, by: Vector2<f64>) -> Outline {
    match outline {
        Outline::Polyline(points) => Outline::Polyline(points.iter().map(|p| p + by).collect()),
        circle => circle,
    }
}

/// Number of points for a length with this minimum radius of curvature.
fn point_count(length: f64, min_radius: f64) -> usize {
    ((length / (MAX_TURN * min_radius)).ceil() as usize).clamp(MIN_POINTS, MAX_POINTS)
}

/// Points of the closed curve `at(t)`, t in [0, 2 pi), equidistant in arc length; each lies on the curve.
pub fn curve(at: impl Fn(f64) -> Vector2<f64>) -> Outline {
    const FINE: usize = 4 * MAX_POINTS;
    let t = |i: usize| TAU * i as f64 / FINE as f64;
    let nodes: Vec<Vector2<f64>> = (0..FINE).map(|i| at(t(i))).collect();
    let mut length = vec![0.0; FINE + 1];
    for (i, (a, b)) in edges(&nodes).enumerate() {
        length[i + 1] = length[i] + (b - a).norm();
    }
    let n = point_count(length[FINE], 1.0 / Outline::Polyline(nodes).max_curvature());
    let mut i = 0;
    let points = (0..n).map(|k| {
        let s = length[FINE] * k as f64 / n as f64;
        while length[i + 1] < s {
            i += 1;
        }
        at(t(i) + (t(i + 1) - t(i)) * (s - length[i]) / (length[i + 1] - length[i]))
    });
    Outline::Polyline(points.collect())
}

fn kidney(a: f64, b: f64, dent: f64, hollow: f64) -> (Outline, Option<Outline>) {
    let bean = Kidney { a, b, dent, hollow };
    (curve(|t| bean.outer(t)), (hollow > 0.0).then(|| curve(|t| bean.lumen(t))))
}

/// A bean with a dent from above and bent ends; the lumen lies flat along its midline.
///
/// With `x = a cos t`, `s = |sin t|` and `g(s) = ((1 + s)/2)^10`, the walls stand at `b (s - dent g(s))` and
/// `b (-s - dent g(-s))` above the bent midline. As `g(s) - g(-s) <= s`, the thickness is `b (2 - dent) s` or
/// more and that of the lumen, drawn about the same midline, is less at every x: the walls never touch. Both
/// are trigonometric polynomials of degree 10.
pub struct Kidney {
    /// Half the width [um].
    pub a: f64,
    /// Half the height without the dent [um].
    pub b: f64,
    /// Depth of the dent over `b`.
    pub dent: f64,
    /// Size of the lumen over that of the outer wall; 0 for none.
    pub hollow: f64,
}

impl Kidney {
    fn dip(s: f64) -> f64 {
        (0.5 * (1.0 + s)).powi(DENT_POWER)
    }

    fn bend(&self, x: f64) -> f64 {
        KIDNEY_BEND * self.dent * self.b * x * x
    }

    /// The outer wall, t in [0, 2 pi).
    pub fn outer(&self, t: f64) -> Vector2<f64> {
        let (s, x) = t.sin_cos();
        Vector2::new(self.a * x, self.b * (s - self.dent * Self::dip(s)) + self.bend(x))
    }

    /// The wall of the lumen.
    pub fn lumen(&self, t: f64) -> Vector2<f64> {
        let height = LUMEN_FLATNESS * self.hollow * self.b * (1.0 - 0.5 * self.dent);
        let x = self.hollow * t.cos();
        let s = (1.0 - x * x).sqrt();
        let middle = -0.5 * self.b * self.dent * (Self::dip(s) + Self::dip(-s)) + self.bend(x);
        Vector2::new(self.a * x, middle + height * t.sin())
    }
}

/// A triangle of irregular corners, each rounded by an arc.
fn triangle<R: Rng>(radius: f64, rounding: f64, jitter: f64, rng: &mut R) -> Result<Outline, SimError> {
    for attempt in 0..=REDRAWS {
        let jitter = if attempt < REDRAWS { jitter } else { 0.0 };
        let corners: Vec<_> = (0..3)
            .map(|i| {
                let turn = TAU * f64::from(i) / 3.0 + jitter * normal3(rng);
                polar(radius * (1.0 + jitter * normal3(rng)), turn)
            })
            .collect();
        let area = Outline::Polyline(corners.clone()).area() / (0.75 * 3.0_f64.sqrt() * radius * radius);
        if let Some(outline) = rounded_convex(&corners, rounding).filter(|_| (0.5..1.6).contains(&area)) {
            return Ok(outline);
        }
    }
    Err(no_room(rounding))
}

/// An irregular convex polygon with rounded corners, of area pi radius^2.
fn stone<R: Rng>(radius: f64, corners: u32, rounding: f64, jitter: f64, rng: &mut R) -> Result<Outline, SimError> {
    let target = PI * radius * radius;
    for attempt in 0..=REDRAWS {
        // Corners on an ellipse are always in convex position.
        let irregular = if attempt < REDRAWS { 1.0 } else { 0.0 };
        let flat = 1.0 - irregular * (0.3 * rng.random::<f64>() + jitter * normal3(rng).abs()).min(0.7);
        let turn = Rotation2::new(rng.random_range(0.0..TAU));
        let sharp: Vec<_> = (0..corners)
            .map(|i| {
                let t = TAU * (f64::from(i) + irregular * 0.7 * (rng.random::<f64>() - 0.5)) / f64::from(corners);
                turn * Vector2::new(t.cos(), flat * t.sin())
            })
            .collect();
        let mut scale = radius;
        let mut rounded = None;
        // The rounding removes area that depends on the scale: a few steps solve for both.
        for _ in 0..12 {
            let corners: Vec<_> = sharp.iter().map(|p| p * scale).collect();
            rounded = rounded_convex(&corners, rounding);
            scale *= rounded.as_ref().map_or(1.1, |outline| (target / outline.area()).sqrt());
        }
        if let Some(outline) = rounded.filter(|outline| (outline.area() / target - 1.0).abs() < 0.01) {
            return Ok(outline);
        }
    }
    Err(no_room(rounding))
}

/// Teeth of irregular spacing and depth on a slightly irregular round.
fn serrated<R: Rng>(radius: f64, depth: f64, teeth: f64, jitter: f64, rng: &mut R) -> Outline {
    let mut wave = |amplitude: f64| (amplitude * rng.random_range(0.3..1.0), rng.random_range(0.0..TAU));
    // Warps of the teeth's phase stay below its own slope, so that no tooth runs backwards.
    let warps = [wave(0.16 * teeth), wave(0.12 * teeth), wave(0.07 * teeth)];
    let swell = [wave(0.4), wave(0.35)];
    let form = [wave(jitter), wave(0.7 * jitter)];
    let sum = |waves: &[(f64, f64)], first: f64, t: f64| -> f64 {
        waves.iter().zip(0..).map(|(&(a, phase), k)| a * ((first + f64::from(k)) * t + phase).cos()).sum()
    };
    curve(|t| {
        let tooth = (teeth * t + sum(&warps, 1.0, t)).cos();
        let deep = MEAN_TOOTH + sum(&swell, 2.0, t);
        polar(radius * (1.0 + sum(&form, 2.0, t) + depth * deep * tooth), t)
    })
}

fn no_room(rounding: f64) -> SimError {
    SimError::BadOutline {
        what: format!("corners of radius {rounding:.3} um do not fit"),
        hint: "use a smaller rounding_um".to_string(),
    }
}

/// A piece of a rounded polygon.
enum OutlinePiece {
    Line(Vector2<f64>, Vector2<f64>),
    /// Center [um], radius [um], first angle and turn [rad] (negative at reflex corners).
    Arc(Vector2<f64>, f64, f64, f64),
}

impl OutlinePiece {
    fn length(&self) -> f64 {
        match self {
            OutlinePiece::Line(a, b) => (b - a).norm(),
            OutlinePiece::Arc(_, radius, _, turn) => radius * turn.abs(),
        }
    }

    fn at(&self, fraction: f64) -> Vector2<f64> {
        match self {
            OutlinePiece::Line(a, b) => a + (b - a) * fraction,
            OutlinePiece::Arc(center, radius, start, turn) => center + polar(*radius, start + turn * fraction),
        }
    }
}

/// Points of a closed chain of pieces, equidistant in arc length; each lies on a piece.
fn sample(pieces: &[OutlinePiece], rounding: f64) -> Outline {
    let total: f64 = pieces.iter().map(OutlinePiece::length).sum();
    let n = point_count(total, rounding);
    let mut points = Vec::with_capacity(n);
    let mut start = 0.0;
    for piece in pieces {
        let length = piece.length();
        while points.len() < n && total * points.len() as f64 / (n as f64) < start + length {
            let fraction = (total * points.len() as f64 / n as f64 - start) / length;
            points.push(piece.at(fraction.max(0.0)));
        }
        start += length;
    }
    Outline::Polyline(points)
}

/// The opening of a convex counterclockwise polygon by a disc: it is shrunk by `rounding`, then grown by it.
/// Edges too short for two arcs vanish. Returns `None` if nothing remains after shrinking.
fn rounded_convex(corners: &[Vector2<f64>], rounding: f64) -> Option<Outline> {
    let mut inset = corners.to_vec();
    for (a, b) in edges(corners) {
        let along = (b - a).normalize();
        let depth = |p: Vector2<f64>| along.perp(&(p - a)) - rounding;
        let mut clipped = Vec::new();
        for (p, q) in edges(&inset) {
            let (from, to) = (depth(p), depth(q));
            if from >= 0.0 {
                clipped.push(p);
            }
            if (from < 0.0) != (to < 0.0) {
                clipped.push(p + (q - p) * (from / (from - to)));
            }
        }
        inset = clipped;
    }
    inset.dedup_by(|p, q| (*p - *q).norm() < 1e-3 * rounding);
    while inset.len() > 1 && (inset[0] - inset[inset.len() - 1]).norm() < 1e-3 * rounding {
        inset.pop();
    }
    let n = inset.len();
    if n < 3 {
        return None;
    }
    let outward = |i: usize| {
        let along = (inset[(i + 1) % n] - inset[i % n]).normalize();
        Vector2::new(along.y, -along.x)
    };
    let mut pieces = Vec::new();
    for i in 0..n {
        let (before, after) = (outward(i + n - 1), outward(i));
        let turn = before.perp(&after).atan2(before.dot(&after)).max(0.0);
        pieces.push(OutlinePiece::Arc(inset[i], rounding, before.y.atan2(before.x), turn));
        pieces.push(OutlinePiece::Line(inset[i] + after * rounding, inset[(i + 1) % n] + after * rounding));
    }
    Some(sample(&pieces, rounding))
}

/// A simple polygon with an arc at each corner, reflex ones included.
pub fn rounded_polygon(mut corners: Vec<Vector2<f64>>, rounding: f64) -> Result<Outline, SimError> {
    if Outline::Polyline(corners.clone()).area() < 0.0 {
        corners.reverse();
    }
    let n = corners.len();
    let along = |i: usize| corners[(i + 1) % n] - corners[i % n];
    let turn = |i: usize| {
        let (u, v) = (along(i + n - 1), along(i));
        u.perp(&v).atan2(u.dot(&v))
    };
    let taken = |i: usize| rounding * (0.5 * turn(i % n).abs()).tan();
    let mut pieces = Vec::new();
    for i in 0..n {
        let (before, after) = (along(i + n - 1).normalize(), along(i).normalize());
        let bend = turn(i);
        if taken(i) + taken(i + 1) > along(i).norm() * (1.0 + 1e-9) {
            return Err(no_room(rounding));
        }
        let inward = Vector2::new(-before.y, before.x) * bend.signum();
        let center = corners[i] - before * taken(i) + inward * rounding;
        pieces.push(OutlinePiece::Arc(center, rounding, (-inward.y).atan2(-inward.x), bend));
        pieces.push(OutlinePiece::Line(corners[i] + after * taken(i), corners[(i + 1) % n] - after * taken(i + 1)));
    }
    let outline = sample(&pieces, rounding);
    if outline.is_simple() && outline.area() > 0.0 {
        return Ok(outline);
    }
    Err(SimError::BadOutline {
        what: "the rounded polygon touches itself".to_string(),
        hint: "use a smaller rounding_um or a polygon without narrow necks".to_string(),
    })
}
