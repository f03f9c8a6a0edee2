//! Intersection of a ray with one segment of a strand, in 64 bits.
//!
//! A host's rays start a meter away and fibers are a micrometer thick: in 32 bits the error of the offset
//! from the center line would be 6 % of the radius. A single segment costs about the same in 64 bits as in
//! 32.
//!
//! In a frame whose z axis is the ray, the ray enters the ball of the curve at parameter s at `z(s) -
//! sqrt(Q(s))`, with `Q(s) = r(s)^2 - x(s)^2 - y(s)^2`, where Q is not negative. The tube is the union of the
//! balls, so the ray enters it at the minimum over s. On a straight piece with linear radius, Q is quadratic
//! in s and the minimum has a closed form. A spline is divided into 2^depth straight pieces between points on
//! it, independent of the ray: neighbors share their ends and the balls there close the corners, so the tube
//! has no gaps. The ray hits the band where Q is largest, if that value is not negative.

use super::StrandShape;
use glam::DVec3;

/// Largest distance between a spline and its straight pieces, relative to the radius.
pub const TOLERANCE: f64 = 0.02;
/// Largest number of halvings of a spline's segment.
pub const MAX_DEPTH: u8 = 10;

/// A frame whose z axis is a ray.
#[derive(Clone, Copy, Debug)]
pub struct RayFrame {
    pub origin: DVec3,
    /// Unit direction.
    pub w: DVec3,
    x: DVec3,
    y: DVec3,
}

impl RayFrame {
    pub fn new(origin: DVec3, w: DVec3) -> RayFrame {
        let (x, y) = w.any_orthonormal_pair();
        RayFrame { origin, w, x, y }
    }

    /// A control point in the frame: x, y, z, radius.
    #[inline(always)]
    pub fn see(&self, p: [f32; 4]) -> [f64; 4] {
        let v = DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2])) - self.origin;
        [self.x.dot(v), self.y.dot(v), self.w.dot(v), f64::from(p[3])]
    }
}

/// Coefficients of 1, u, u^2, u^3 of a segment of x, y, z, radius.
pub type Cubic = [[f64; 4]; 4];

/// Coefficients of a segment of a uniform cubic B-spline.
#[inline(always)]
pub fn cubic(p: [[f64; 4]; 4]) -> Cubic {
    let mut c = [[0.0; 4]; 4];
    for k in 0..4 {
        let [a, b, d, e] = [p[0][k], p[1][k], p[2][k], p[3][k]];
        c[0][k] = (a + 4.0 * b + d) / 6.0;
        c[1][k] = (d - a) / 2.0;
        c[2][k] = (a - 2.0 * b + d) / 2.0;
        c[3][k] = (e - a + 3.0 * (b - d)) / 6.0;
    }
    c
}

/// The curve's x, y, z, radius at the parameter u.
#[inline(always)]
pub fn point(c: &Cubic, u: f64) -> [f64; 4] {
    std::array::from_fn(|k| c[0][k] + u * (c[1][k] + u * (c[2][k] + u * c[3][k])))
}

/// The curve's derivative by u at the parameter u.
pub fn slope(c: &Cubic, u: f64) -> [f64; 4] {
    std::array::from_fn(|k| c[1][k] + u * (2.0 * c[2][k] + u * 3.0 * c[3][k]))
}

/// Entry of a ray into the hull of the balls `a` and `b`, with linear radius between them: distance along the
/// ray, and the parameter s from 0 to 1. Distances up to `after` do not count.
#[inline(always)]
pub fn tube(a: [f64; 4], b: [f64; 4], after: f64) -> Option<(f64, f64)> {
    let d: [f64; 4] = std::array::from_fn(|k| b[k] - a[k]);
    // Q(s) = qa s^2 + qb s + qc.
    let qa = d[3] * d[3] - d[0] * d[0] - d[1] * d[1];
    let qb = 2.0 * (d[3] * a[3] - d[0] * a[0] - d[1] * a[1]);
    let qc = a[3] * a[3] - a[0] * a[0] - a[1] * a[1];
    let at = |s: f64| {
        let q = qc + s * (qb + s * qa);
        (q >= 0.0).then(|| (a[2] + s * d[2] - q.sqrt(), s))
    };
    let hit = if qa < 0.0 {
        // Q is concave and the entry distance convex in s, so there is one minimum, clamped to the piece.
        let middle = -0.5 * qb / qa;
        let top = qc + 0.5 * qb * middle;
        if top < 0.0 {
            return None;
        }
        let s = middle - d[2] * (top / (qa * (qa - d[2] * d[2]))).sqrt();
        let s = s.max(0.0).min(1.0);
        // Rounding may make Q negative at the rim of Q >= 0; the fallback fails only for a piece that ends
        // before the rim.
        at(s).or_else(|| at(middle.max(0.0).min(1.0)))
    } else {
        // The ray runs along the piece more than across it: test both ends, and the part between them if
        // neither ball contains the other.
        let mut best = nearer(at(0.0), at(1.0));
        let length = qa - d[2] * d[2];
        if length < 0.0 {
            let s = if qa > 0.0 {
                let middle = -0.5 * qb / qa;
                let top = qc + 0.5 * qb * middle;
                middle + d[2] * (top / (qa * length)).max(0.0).sqrt()
            } else if qb != 0.0 {
                let root = 0.5 * qb / d[2];
                (root * root - qc) / qb
            } else {
                0.0
            };
            if s > 0.0 && s < 1.0 {
                best = nearer(best, at(s));
            }
        }
        best
    };
    hit.filter(|(z, _)| *z > after)
}

/// Intersection with the ray-facing band between `a` and `b`; arguments and result are those of [`tube`].
#[inline(always)]
pub fn band(a: [f64; 4], b: [f64; 4], after: f64) -> Option<(f64, f64)> {
    let d: [f64; 4] = std::array::from_fn(|k| b[k] - a[k]);
    let qa = d[3] * d[3] - d[0] * d[0] - d[1] * d[1];
    let qb = 2.0 * (d[3] * a[3] - d[0] * a[0] - d[1] * a[1]);
    let qc = a[3] * a[3] - a[0] * a[0] - a[1] * a[1];
    let q = |s: f64| qc + s * (qb + s * qa);
    let s = if qa < 0.0 {
        (-0.5 * qb / qa).max(0.0).min(1.0)
    } else if q(1.0) > q(0.0) {
        1.0
    } else {
        0.0
    };
    let z = a[2] + s * d[2];
    (q(s) >= 0.0 && z > after).then_some((z, s))
}

fn nearer(a: Option<(f64, f64)>, b: Option<(f64, f64)>) -> Option<(f64, f64)> {
    match (a, b) {
        (Some(p), Some(q)) => Some(if q.0 < p.0 { q } else { p }),
        (p, q) => p.or(q),
    }
}

/// Squared distance of the ray from the straight line between two points.
#[inline(always)]
fn off(a: [f64; 4], b: [f64; 4]) -> f64 {
    let d = [b[0] - a[0], b[1] - a[1]];
    let length = d[0] * d[0] + d[1] * d[1];
    let s = if length > 0.0 { (-(a[0] * d[0] + a[1] * d[1]) / length).max(0.0).min(1.0) } else { 0.0 };
    let (x, y) = (a[0] + s * d[0], a[1] + s * d[1]);
    x * x + y * y
}

/// Reach and bend of a spline's segment, independent of the ray.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Largest second derivative.
    bend: f64,
    most_radius: f64,
    /// Number of halvings after which the straight pieces are within [`TOLERANCE`].
    depth: u8,
}

impl Extent {
    /// Extent of a segment from its control points. The second derivative is linear, so it is largest at an
    /// end.
    #[inline(always)]
    pub fn from_points(p: &[[f32; 4]; 4]) -> Extent {
        let second = |k: usize| {
            let d = |c: usize| f64::from(p[k][c]) - 2.0 * f64::from(p[k + 1][c]) + f64::from(p[k + 2][c]);
            d(0) * d(0) + d(1) * d(1) + d(2) * d(2)
        };
        let bend = second(0).max(second(1)).sqrt();
        let max = p[0][3].max(p[1][3]).max(p[2][3].max(p[3][3]));
        let min = p[0][3].min(p[1][3]).min(p[2][3].min(p[3][3]));
        // A tip much thinner than the rest counts as having a hundredth of the largest radius. The error of a
        // chord over a step d is at most bend d^2 / 8.
        let fine = 8.0 * TOLERANCE * f64::from(min.max(0.01 * max));
        let (mut depth, mut pieces) = (0, 1.0);
        while bend > fine * pieces && depth < MAX_DEPTH {
            depth += 1;
            pieces *= 4.0;
        }
        Extent { bend, most_radius: max.into(), depth }
    }
}

/// First hit of a ray on a segment of a spline: its distance, beyond `after` and before `before`, and u from
/// 0 to 1.
pub fn spline(c: &Cubic, extent: Extent, shape: StrandShape, after: f64, before: f64) -> Option<(f64, f64)> {
    let step = 1.0 / f64::from(1u32 << extent.depth);
    // Each halving removes one entry and adds two, which bounds the stack.
    let mut open = [(0u32, 0u32); MAX_DEPTH as usize + 2];
    let mut count = 1;
    open[0] = (0, 1 << extent.depth);
    let (mut best, mut hit) = (before, None);
    while count > 0 {
        count -= 1;
        let (first, pieces) = open[count];
        let (from, to) = (f64::from(first) * step, f64::from(first + pieces) * step);
        let (a, b) = (point(c, from), point(c, to));
        let width = to - from;
        let reach = extent.most_radius + if pieces > 1 { 0.125 * extent.bend * width * width } else { 0.0 };
        if off(a, b) > reach * reach * (1.0 + 1e-9) || a[2].min(b[2]) - reach >= best || a[2].max(b[2]) + reach <= after
        {
            continue;
        }
        if pieces > 1 {
            let half = pieces / 2;
            open[count] = (first, half);
            open[count + 1] = (first + half, half);
            count += 2;
            continue;
        }
        let found = match shape {
            StrandShape::Tube => tube(a, b, after),
            StrandShape::Band => band(a, b, after),
        };
        if let Some((z, s)) = found
            && z < best
        {
            best = z;
            hit = Some((z, from + s * width));
        }
    }
    hit
}
