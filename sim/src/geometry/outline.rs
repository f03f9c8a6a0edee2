//! Closed outlines of fiber cross sections: distance, area, curvature, resampling.
//!
//! A circle is stored as such; every other outline is a dense polyline whose vertices lie on the smooth
//! outline. All measures of a polyline are exact for the polyline itself, by brute force over its edges.

use nalgebra::Vector2;
use std::f64::consts::TAU;

/// A closed outline in the fiber's own frame [um].
#[derive(Clone, Debug, PartialEq)]
pub enum Outline {
    /// Circle about the origin.
    Circle {
        /// Radius [um].
        radius_um: f64,
    },
    /// Counterclockwise, closed implicitly, 192 or more points of about uniform arc length.
    Polyline(Vec<Vector2<f64>>),
}

/// A point of an outline with the outward unit normal there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlinePoint {
    /// Position in the fiber's frame [um].
    pub position_um: Vector2<f64>,
    /// Outward unit normal.
    pub normal: Vector2<f64>,
}

impl Outline {
    /// Signed distance of `p` to the outline [um], negative inside.
    pub fn signed_distance(&self, p: Vector2<f64>) -> f64 {
        match self {
            Outline::Circle { radius_um } => p.norm() - radius_um,
            Outline::Polyline(points) => {
                let mut inside = false;
                let mut min2 = f64::INFINITY;
                for (a, b) in edges(points) {
                    min2 = min2.min(segment_distance2(p, a, b));
                    inside ^= crosses_ray(p, a, b);
                }
                if inside { -min2.sqrt() } else { min2.sqrt() }
            }
        }
    }

    /// Whether `p` lies strictly within the outline.
    pub fn contains(&self, p: Vector2<f64>) -> bool {
        match self {
            Outline::Circle { radius_um } => p.norm_squared() < radius_um * radius_um,
            Outline::Polyline(points) => edges(points).fold(false, |inside, (a, b)| inside ^ crosses_ray(p, a, b)),
        }
    }

    /// Enclosed area [um^2].
    pub fn area(&self) -> f64 {
        match self {
            Outline::Circle { radius_um } => 0.5 * TAU * radius_um * radius_um,
            Outline::Polyline(points) => 0.5 * edges(points).map(|(a, b)| a.perp(&b)).sum::<f64>(),
        }
    }

    /// Length of the outline [um].
    pub fn perimeter(&self) -> f64 {
        match self {
            Outline::Circle { radius_um } => TAU * radius_um,
            Outline::Polyline(points) => edges(points).map(|(a, b)| (b - a).norm()).sum(),
        }
    }

    /// Centroid of the enclosed area [um].
    pub fn centroid(&self) -> Vector2<f64> {
        match self {
            Outline::Circle { .. } => Vector2::zeros(),
            Outline::Polyline(points) => {
                let moment: Vector2<f64> = edges(points).map(|(a, b)| (a + b) * a.perp(&b)).sum();
                moment / (6.0 * self.area())
            }
        }
    }

    /// Radius of the smallest circle about the frame's origin that contains the outline [um].
    pub fn bounding_radius(&self) -> f64 {
        match self {
            Outline::Circle { radius_um } => *radius_um,
            Outline::Polyline(points) => points.iter().map(|p| p.norm()).fold(0.0, f64::max),
        }
    }

    /// Estimated maximum absolute curvature [1/um], from the turning angle at each vertex.
    pub fn max_curvature(&self) -> f64 {
        match self {
            Outline::Circle { radius_um } => 1.0 / radius_um,
            Outline::Polyline(points) => {
                let n = points.len();
                (0..n)
                    .map(|i| {
                        let (u, v) = (points[i] - points[(i + n - 1) % n], points[(i + 1) % n] - points[i]);
                        u.perp(&v).atan2(u.dot(&v)).abs() / (0.5 * (u.norm() + v.norm()))
                    })
                    .fold(0.0, f64::max)
            }
        }
    }

    /// `n >= 3` points, uniform in arc length and counterclockwise, with outward unit normals. Points of a
    /// polyline lie on its edges, and their normals are interpolated from vertex to vertex like those of the
    /// smooth outline.
    pub fn points(&self, n: usize) -> Vec<OutlinePoint> {
        let n = n.max(3);
        match self {
            Outline::Circle { radius_um } => (0..n)
                .map(|i| {
                    let (s, c) = (TAU * i as f64 / n as f64).sin_cos();
                    OutlinePoint { position_um: Vector2::new(c, s) * *radius_um, normal: Vector2::new(c, s) }
                })
                .collect(),
            Outline::Polyline(points) => {
                let m = points.len();
                let step = self.perimeter() / n as f64;
                let vertex_normal = |i: usize| {
                    let (u, v) = (points[i] - points[(i + m - 1) % m], points[(i + 1) % m] - points[i]);
                    let t = u / u.norm() + v / v.norm();
                    Vector2::new(t.y, -t.x).normalize()
                };
                let mut out = Vec::with_capacity(n);
                let mut start = 0.0;
                for i in 0..m {
                    let (a, b) = (points[i], points[(i + 1) % m]);
                    let length = (b - a).norm();
                    while out.len() < n && out.len() as f64 * step < start + length {
                        let t = (out.len() as f64 * step - start) / length;
                        let normal = (vertex_normal(i) * (1.0 - t) + vertex_normal((i + 1) % m) * t).normalize();
                        out.push(OutlinePoint { position_um: a + (b - a) * t, normal });
                    }
                    start += length;
                }
                while out.len() < n {
                    out.push(OutlinePoint { position_um: points[0], normal: vertex_normal(0) });
                }
                out
            }
        }
    }

    /// The same outline as a polyline; a circle takes `n` points.
    pub fn polyline(&self, n: usize) -> Vec<Vector2<f64>> {
        match self {
            Outline::Circle { .. } => self.points(n).iter().map(|p| p.position_um).collect(),
            Outline::Polyline(points) => points.clone(),
        }
    }

    /// Whether no two edges of the outline touch except neighbors at their common vertex.
    pub fn is_simple(&self) -> bool {
        let Outline::Polyline(points) = self else { return true };
        let n = points.len();
        let edge = |i: usize| (points[i], points[(i + 1) % n]);
        (0..n).all(|i| {
            (i + 2..n).filter(|&j| (j + 1) % n != i).all(|j| {
                let ((a, b), (c, d)) = (edge(i), edge(j));
                !segments_cross(a, b, c, d)
            })
        })
    }
}

/// The edges of a closed polyline.
pub(crate) fn edges(points: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| (*a, *b))
}

/// Squared distance of `p` to the segment from `a` to `b`.
pub(crate) fn segment_distance2(p: Vector2<f64>, a: Vector2<f64>, b: Vector2<f64>) -> f64 {
    let (ap, ab) = (p - a, b - a);
    let t = (ap.dot(&ab) / ab.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (ap - ab * t).norm_squared()
}

/// Whether the ray from `p` along +x crosses the edge, by the half-open rule that counts a vertex once.
fn crosses_ray(p: Vector2<f64>, a: Vector2<f64>, b: Vector2<f64>) -> bool {
    (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y)
}

/// Whether two closed segments intersect.
pub(crate) fn segments_cross(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>, d: Vector2<f64>) -> bool {
    // The boxes are tested first: for collinear segments, rounding may put the ends on either side.
    let apart = |a: f64, b: f64, c: f64, d: f64| a.min(b) > c.max(d) || c.min(d) > a.max(b);
    if apart(a.x, b.x, c.x, d.x) || apart(a.y, b.y, c.y, d.y) {
        return false;
    }
    let side = |p: Vector2<f64>, q: Vector2<f64>, r: Vector2<f64>| (q - p).perp(&(r - p));
    let (s1, s2) = (side(a, b, c), side(a, b, d));
    let (s3, s4) = (side(c, d, a), side(c, d, b));
    s1 * s2 <= 0.0 && s3 * s4 <= 0.0
}

/// The edges of a closed polyline in short runs, each with a bounding circle, for fast exact distances.
pub(crate) struct Runs<'a> {
    points: &'a [Vector2<f64>],
    bounds: Vec<(Vector2<f64>, f64)>,
}

/// Edges per run.
const RUN: usize = 16;

impl<'a> Runs<'a> {
    pub(crate) fn new(points: &'a [Vector2<f64>]) -> Runs<'a> {
        let n = points.len();
        let bounds = (0..n.div_ceil(RUN)).map(|k| {
            let (first, last) = (k * RUN, (k * RUN + RUN).min(n));
            let center = points[(first + last) / 2];
            (center, (first..=last).map(|i| (points[i % n] - center).norm()).fold(0.0, f64::max))
        });
        Runs { points, bounds: bounds.collect() }
    }

    /// Exact distance of `p` to the polyline, clamped to `max`.
    pub(crate) fn distance(&self, p: Vector2<f64>, max: f64) -> f64 {
        let n = self.points.len();
        let mut min2 = max * max;
        for (k, (center, bound)) in self.bounds.iter().enumerate() {
            if ((p - center).norm() - bound).max(0.0).powi(2) <= min2 {
                for i in k * RUN..(k * RUN + RUN).min(n) {
                    min2 = min2.min(segment_distance2(p, self.points[i], self.points[(i + 1) % n]));
                }
            }
        }
        min2.sqrt()
    }
}
