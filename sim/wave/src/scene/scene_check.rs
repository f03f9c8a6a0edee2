//! Checks of a scene's walls: simple, smooth, apart, lumens inside of their bodies.
//!
//! Circles are treated exactly. Other walls are sampled so densely that the chords deviate from the curve by
//! about 1e-6 of its size; two walls that are closer than these deviations count as touching. Chords are
//! grouped into runs with a bounding box each, so that a pair of walls costs little more than its nearest
//! runs.

use crate::{Body, C64, Shape, WaveError};
use nalgebra::Vector2;
use std::f64::consts::{PI, TAU};

type Point = Vector2<f64>;

/// Chords of a full turn.
const CHORDS: usize = 2048;
/// Chords per run.
const RUN: usize = 16;
/// Maximum turn between two chords [rad] that counts as smooth: a curve of radius 1/6000 of its size still
/// turns by less.
const SHARPEST: f64 = 0.5;
/// Relative accuracy of gaps between circles.
const CIRCLE_SLACK: f64 = 1e-10;

/// Refuses walls that no solver can treat.
///
/// # Errors
/// [`WaveError::SelfCrossing`], [`WaveError::Overlap`], [`WaveError::LumenOutside`], and
/// [`WaveError::Invalid`] for outlines with a cusp and polygons whose rounding does not fit.
pub fn check_walls(bodies: &[Body]) -> Result<(), WaveError> {
    let mut fibers = Vec::with_capacity(bodies.len());
    for (i, body) in bodies.iter().enumerate() {
        let mut name = format!("fiber[{i}]");
        let outer = SampledWall::new(body, &name)?;
        let mut inside_of: Option<SampledWall> = None;
        let mut at = body.lumen.as_deref();
        while let Some(lumen) = at {
            let host = name.clone();
            name.push_str(".lumen");
            let wall = SampledWall::new(lumen, &name)?;
            match inside_of.as_ref().unwrap_or(&outer).relation(&wall) {
                Relation::Holds => {}
                Relation::Touches => return Err(WaveError::Overlap { first: host, second: name }),
                Relation::Apart | Relation::IsHeld => return Err(WaveError::LumenOutside { wall: name }),
            }
            at = lumen.lumen.as_deref();
            inside_of = Some(wall);
        }
        fibers.push(outer);
    }
    for (j, b) in fibers.iter().enumerate() {
        for (i, a) in fibers[..j].iter().enumerate() {
            if a.relation(b) != Relation::Apart {
                return Err(WaveError::Overlap { first: format!("fiber[{i}]"), second: format!("fiber[{j}]") });
            }
        }
    }
    Ok(())
}

/// Relation of one closed wall to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Relation {
    /// Each is outside of the other.
    Apart,
    /// The first contains the second.
    Holds,
    /// The second contains the first.
    IsHeld,
    /// They cross or are too close to decide.
    Touches,
}

/// A box with sides along the axes.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    min: Point,
    max: Point,
}

impl Bounds {
    fn from_points(points: impl Iterator<Item = Point>) -> Bounds {
        let none = Bounds { min: Point::repeat(f64::INFINITY), max: Point::repeat(f64::NEG_INFINITY) };
        points.fold(none, |b, p| Bounds { min: b.min.inf(&p), max: b.max.sup(&p) })
    }

    /// Whether the boxes come within `reach` of each other along both axes.
    fn near(&self, other: &Bounds, reach: f64) -> bool {
        (0..2).all(|k| self.min[k] - reach <= other.max[k] && other.min[k] - reach <= self.max[k])
    }

    fn size(&self) -> f64 {
        (self.max - self.min).norm()
    }
}

/// A wall in the scene's frame.
struct SampledWall {
    curve: Curve,
    bounds: Bounds,
    /// Maximum distance of the true curve from the sampled one [um].
    slack_um: f64,
}

enum Curve {
    Circle { center: Point, radius: f64 },
    Chords { points: Vec<Point>, runs: Vec<Bounds> },
}

impl SampledWall {
    /// The wall of `body`, checked to be smooth and simple.
    fn new(body: &Body, name: &str) -> Result<SampledWall, WaveError> {
        let center = Point::from(body.center_um);
        let points = match &body.shape {
            Shape::Circle { radius_um } => {
                let r = Point::repeat(*radius_um);
                let bounds = Bounds { min: center - r, max: center + r };
                let curve = Curve::Circle { center, radius: *radius_um };
                return Ok(SampledWall { curve, bounds, slack_um: CIRCLE_SLACK * (radius_um + center.norm()) });
            }
            Shape::Ellipse { a_um, b_um } => sample(CHORDS, |t| Point::new(a_um * t.cos(), b_um * t.sin())),
            Shape::Fourier { coeffs } => {
                // A harmonic k has its features within 1/k of a turn.
                let highest = coeffs.iter().map(|(k, _)| k.unsigned_abs() as usize).max().unwrap_or(1);
                sample(CHORDS.max(32 * highest), |t| {
                    let z: C64 = coeffs.iter().map(|(k, c)| c * C64::cis(f64::from(*k) * t)).sum();
                    Point::new(z.re, z.im)
                })
            }
            Shape::Polygon { points_um, rounding_um } => round(points_um, *rounding_um, name)?,
        };
        let (sin, cos) = body.rotation_rad.sin_cos();
        let points: Vec<Point> =
            points.iter().map(|p| center + Point::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y)).collect();
        let (turn, sharpest, slack) = turns(&points);
        // Written this way, a NaN fails the check.
        let smooth = sharpest < SHARPEST && slack.is_finite();
        if !smooth {
            let key = if matches!(body.shape, Shape::Polygon { .. }) { "points_um" } else { "coeffs" };
            return Err(WaveError::Invalid {
                key: format!("{name}.{key}"),
                value: "an outline with a cusp".into(),
                hint: "give a smooth curve".into(),
            });
        }
        let n = points.len();
        let runs = (0..n.div_ceil(RUN)).map(|k| {
            let (first, last) = (k * RUN, (k * RUN + RUN).min(n));
            Bounds::from_points((first..=last).map(|i| points[i % n]))
        });
        let curve = Curve::Chords { runs: runs.collect(), points: points.clone() };
        let bounds = Bounds::from_points(points.into_iter());
        let wall = SampledWall { curve, bounds, slack_um: slack + 1e-13 * bounds.size() };
        // A simple closed curve turns by just one full turn.
        if (turn.abs() - TAU).abs() > 0.1 || wall.meets_itself() {
            return Err(WaveError::SelfCrossing { wall: name.into() });
        }
        Ok(wall)
    }

    /// Whether two chords that are not neighbors touch.
    fn meets_itself(&self) -> bool {
        let Curve::Chords { points, runs } = &self.curve else { return false };
        let n = points.len();
        let reach = 2.0 * self.slack_um;
        let meet = |i: usize, j: usize| {
            let steps = (j - i).min(n - (j - i));
            steps >= 2 && near(chord(points, i), chord(points, j), reach)
        };
        (0..runs.len()).any(|a| {
            (a..runs.len())
                .filter(|&b| runs[a].near(&runs[b], reach))
                .any(|b| run(a, n).any(|i| run(b, n).filter(|&j| j > i).any(|j| meet(i, j))))
        })
    }

    fn relation(&self, other: &SampledWall) -> Relation {
        let reach = self.slack_um + other.slack_um;
        if !self.bounds.near(&other.bounds, reach) {
            return Relation::Apart;
        }
        match (&self.curve, &other.curve) {
            (Curve::Circle { center: a, radius: ra }, Curve::Circle { center: b, radius: rb }) => {
                let d = (a - b).norm();
                if d > ra + rb + reach {
                    Relation::Apart
                } else if d + rb + reach < *ra {
                    Relation::Holds
                } else if d + ra + reach < *rb {
                    Relation::IsHeld
                } else {
                    Relation::Touches
                }
            }
            (Curve::Circle { center, radius }, Curve::Chords { points, .. }) => {
                circle_and_chords(*center, *radius, points, reach)
            }
            (Curve::Chords { points, .. }, Curve::Circle { center, radius }) => {
                match circle_and_chords(*center, *radius, points, reach) {
                    Relation::Holds => Relation::IsHeld,
                    Relation::IsHeld => Relation::Holds,
                    same => same,
                }
            }
            (Curve::Chords { points: p, runs: pr }, Curve::Chords { points: q, runs: qr }) => {
                let touch = pr.iter().enumerate().filter(|(_, a)| a.near(&other.bounds, reach)).any(|(k, a)| {
                    qr.iter().enumerate().filter(|(_, b)| a.near(b, reach)).any(|(l, _)| {
                        run(k, p.len()).any(|i| run(l, q.len()).any(|j| near(chord(p, i), chord(q, j), reach)))
                    })
                });
                if touch {
                    Relation::Touches
                } else if holds(p, q[0]) {
                    Relation::Holds
                } else if holds(q, p[0]) {
                    Relation::IsHeld
                } else {
                    Relation::Apart
                }
            }
        }
    }
}

/// Relation of a circle to a closed polyline.
fn circle_and_chords(center: Point, radius: f64, points: &[Point], reach: f64) -> Relation {
    let farthest = points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
    if farthest + reach < radius {
        return Relation::Holds;
    }
    let nearest = (0..points.len()).map(|i| distance(center, chord(points, i))).fold(f64::INFINITY, f64::min);
    if nearest <= radius + reach {
        Relation::Touches
    } else if holds(points, center) {
        Relation::IsHeld
    } else {
        Relation::Apart
    }
}

fn sample(n: usize, at: impl Fn(f64) -> Point) -> Vec<Point> {
    (0..n).map(|i| at(TAU * i as f64 / n as f64)).collect()
}

/// Chords of run `k` of a closed polyline of `n` points.
fn run(k: usize, n: usize) -> std::ops::Range<usize> {
    k * RUN..(k * RUN + RUN).min(n)
}

fn chord(points: &[Point], i: usize) -> (Point, Point) {
    (points[i], points[(i + 1) % points.len()])
}

/// Total turn, sharpest turn [rad] and largest deviation from the curve [um] of a closed polyline through a
/// curve. An arc of turn t over a chord of length c deviates by about c t / 8; twice that is used, since the
/// curvature may change from one chord to the next.
fn turns(points: &[Point]) -> (f64, f64, f64) {
    let n = points.len();
    let (mut total, mut sharpest, mut slack) = (0.0, 0.0, 0.0);
    for i in 0..n {
        let (u, v) = (points[i] - points[(i + n - 1) % n], points[(i + 1) % n] - points[i]);
        let turn = u.perp(&v).atan2(u.dot(&v));
        let turn = if u.norm().min(v.norm()) > 0.0 { turn } else { PI };
        total += turn;
        sharpest = f64::max(sharpest, turn.abs());
        slack = f64::max(slack, 0.25 * turn.abs() * u.norm().min(v.norm()));
    }
    (total, sharpest, slack)
}

/// Whether the closed polyline contains `p`, which is not on it.
fn holds(points: &[Point], p: Point) -> bool {
    let crossings = (0..points.len()).filter(|&i| {
        let (a, b) = chord(points, i);
        (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y)
    });
    crossings.count() % 2 == 1
}

fn distance(p: Point, (a, b): (Point, Point)) -> f64 {
    let (ap, ab) = (p - a, b - a);
    let along = (ap.dot(&ab) / ab.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (ap - ab * along).norm()
}

/// Whether two segments cross or come within `reach`.
fn near((a, b): (Point, Point), (c, d): (Point, Point), reach: f64) -> bool {
    let apart = |k: usize| a[k].min(b[k]) - reach > c[k].max(d[k]) || c[k].min(d[k]) - reach > a[k].max(b[k]);
    if apart(0) || apart(1) {
        return false;
    }
    let side = |p: Point, q: Point, r: Point| (q - p).perp(&(r - p));
    let cross = side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0;
    cross
        || [distance(a, (c, d)), distance(b, (c, d)), distance(c, (a, b)), distance(d, (a, b))]
            .iter()
            .any(|&x| x <= reach)
}

/// Points of the polygon with corners replaced by arcs; there are none along the edges.
fn round(points_um: &[[f64; 2]], rounding_um: f64, name: &str) -> Result<Vec<Point>, WaveError> {
    let corners: Vec<Point> = points_um.iter().map(|&p| Point::from(p)).collect();
    let n = corners.len();
    let invalid =
        |key: &str, value: String, hint: String| Err(WaveError::Invalid { key: format!("{name}.{key}"), value, hint });
    let length = |i: usize| (corners[(i + 1) % n] - corners[i]).norm();
    let perimeter: f64 = (0..n).map(length).sum();
    if let Some(i) = (0..n).find(|&i| length(i) <= 1e-9 * perimeter) {
        return invalid(
            &format!("points_um[{i}]"),
            format!("[{}, {}]", corners[i].x, corners[i].y),
            "this corner is given twice in a row; leave one out (the polygon closes by itself)".into(),
        );
    }
    // An arc of radius r that turns by t removes r tan(t/2) from both edges.
    let turn = |i: usize| {
        let (u, v) = (corners[i] - corners[(i + n - 1) % n], corners[(i + 1) % n] - corners[i]);
        u.perp(&v).atan2(u.dot(&v))
    };
    let taken = |i: usize| (0.5 * turn(i).abs()).tan();
    let max_um = (0..n).map(|i| length(i) / (taken(i) + taken((i + 1) % n))).fold(f64::INFINITY, f64::min);
    let min_um = 1e-4 * perimeter;
    if !(min_um..=max_um).contains(&rounding_um) {
        let hint = if min_um < max_um {
            format!("use from {min_um:.4} to {max_um:.4}, so that arcs are resolved and fit on the polygon's edges")
        } else {
            format!("an edge has room for {max_um:.2e} um only; leave out the shortest edges and spikes")
        };
        return invalid("rounding_um", rounding_um.to_string(), hint);
    }
    let mut points = Vec::with_capacity(n + CHORDS);
    for i in 0..n {
        let turn = turn(i);
        let along = (corners[i] - corners[(i + n - 1) % n]).normalize();
        let begin = corners[i] - along * (rounding_um * taken(i));
        // The arc's center lies on the side to which it turns.
        let center = begin + Point::new(-along.y, along.x) * (rounding_um * turn.signum());
        let steps = (turn.abs() * CHORDS as f64 / TAU).ceil().max(1.0);
        for j in 0..=steps as usize {
            let (sin, cos) = (turn * j as f64 / steps).sin_cos();
            let arm = begin - center;
            let p = center + Point::new(cos * arm.x - sin * arm.y, sin * arm.x + cos * arm.y);
            // If arcs fill an edge, one ends where the next begins; a straight corner has an arc of zero
            // length.
            if points.last().is_none_or(|q: &Point| (q - p).norm() > 1e-9 * rounding_um) {
                points.push(p);
            }
        }
    }
    if points.len() > 1 && (points[0] - points[points.len() - 1]).norm() <= 1e-9 * rounding_um {
        points.pop();
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(shape: Shape, center_um: [f64; 2]) -> Body {
        Body { shape, center_um, rotation_rad: 0.0, eta: 1.5, kappa: 0.0, lumen: None }
    }

    fn circle(radius_um: f64, center_um: [f64; 2]) -> Body {
        body(Shape::Circle { radius_um }, center_um)
    }

    fn ellipse(a_um: f64, b_um: f64, center_um: [f64; 2]) -> Body {
        body(Shape::Ellipse { a_um, b_um }, center_um)
    }

    fn fourier(coeffs: &[(i32, f64)]) -> Body {
        body(Shape::Fourier { coeffs: coeffs.iter().map(|&(k, c)| (k, C64::new(c, 0.0))).collect() }, [0.3, -0.2])
    }

    fn polygon(points_um: &[[f64; 2]], rounding_um: f64) -> Body {
        body(Shape::Polygon { points_um: points_um.to_vec(), rounding_um }, [0.0; 2])
    }

    fn overlap(bodies: &[Body]) -> bool {
        match check_walls(bodies) {
            Ok(()) => false,
            Err(WaveError::Overlap { .. }) => true,
            Err(other) => panic!("{other}"),
        }
    }

    /// Gaps are resolved to 1e-5 of the size from either side, for every pairing of exact and sampled walls.
    #[test]
    fn gaps_are_told_closely() {
        let far = |b: Body, x: f64| Body { center_um: [x, 0.0], ..b };
        let kinds = [
            circle(2.0, [0.0; 2]),
            ellipse(2.0, 1.0, [0.0; 2]),
            body(Shape::Fourier { coeffs: vec![(1, C64::new(2.0, 0.0))] }, [0.0; 2]),
            // A square that reaches 2 along x with a flat edge.
            polygon(&[[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]], 0.5),
        ];
        for a in &kinds {
            for b in &kinds {
                assert!(overlap(&[a.clone(), far(b.clone(), 4.0 - 2e-5)]), "{a:?} {b:?}");
                assert!(!overlap(&[a.clone(), far(b.clone(), 4.0 + 2e-5)]), "{a:?} {b:?}");
            }
        }
    }

    /// Circumscribed circles may overlap where the walls do not.
    #[test]
    fn crossed_ellipses_may_share_circles() {
        let upright = |x: f64| Body { rotation_rad: PI / 2.0, ..ellipse(2.0, 0.5, [x, 0.0]) };
        assert!(!overlap(&[upright(0.0), upright(1.1)]));
        assert!(overlap(&[upright(0.0), ellipse(2.0, 0.5, [1.1, 0.0])]), "one lies across the other");
    }

    /// One fiber within another is not a lumen, though the walls are far apart.
    #[test]
    fn fibers_do_not_hold_fibers() {
        for outer in [circle(5.0, [0.0; 2]), ellipse(5.0, 4.0, [0.0; 2])] {
            for inner in [circle(1.0, [1.0, 0.0]), ellipse(1.0, 0.5, [1.0, 0.0])] {
                assert!(overlap(&[outer.clone(), inner.clone()]));
                assert!(overlap(&[inner.clone(), outer.clone()]));
            }
        }
    }

    #[test]
    fn lumens_lie_inside() {
        let with = |outer: &Body, lumen: Body| Body { lumen: Some(Box::new(lumen)), ..outer.clone() };
        for outer in [circle(5.0, [7.0, 0.0]), ellipse(5.0, 4.0, [7.0, 0.0])] {
            let held = with(&circle(2.0, [8.0, 0.0]), ellipse(1.0, 0.5, [8.5, 0.0]));
            check_walls(&[with(&outer, held)]).unwrap();
            for (lumen, outside) in [
                (circle(2.0, [-1.0, 0.0]), true),
                (ellipse(2.0, 1.0, [-1.0, 0.0]), true),
                (ellipse(20.0, 18.0, [7.0, 0.0]), true),
                (ellipse(2.0, 1.0, [11.0, 0.0]), false),
                (circle(2.0, [11.0, 0.0]), false),
                (outer.clone(), false),
            ] {
                let error = check_walls(&[with(&outer, lumen)]).unwrap_err();
                let want = WaveError::LumenOutside { wall: "fiber[0].lumen".into() };
                let touch = WaveError::Overlap { first: "fiber[0]".into(), second: "fiber[0].lumen".into() };
                assert_eq!(error, if outside { want } else { touch });
            }
        }
    }

    #[test]
    fn crossing_outlines_are_refused() {
        let crossing = |b: Body| {
            assert_eq!(check_walls(&[b]), Err(WaveError::SelfCrossing { wall: "fiber[0]".into() }));
        };
        // A limacon with an inner loop; a circle run through twice; a figure of eight; a lemniscate-like
        // curve with turns that cancel.
        crossing(fourier(&[(1, 1.0), (2, 1.0)]));
        crossing(fourier(&[(2, 1.0)]));
        crossing(polygon(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]], 0.2));
        crossing(fourier(&[(1, 1.0), (-3, 0.9), (5, 0.4)]));
        // Two arms that touch from opposite sides: turns add up to one, but the walls touch.
        let comb = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [4.0, 9.0], [6.0, 4.0], [3.0, 4.0], [5.0, 9.0], [0.0, 9.0]];
        crossing(polygon(&comb, 0.1));
    }

    #[test]
    fn smooth_outlines_pass() {
        for k in [-1, 1] {
            check_walls(&[fourier(&[(k, 3.0), (4 * k, 0.3), (-2 * k, 0.5)])]).unwrap();
        }
        // A kidney, a star of 40 teeth, a polygon in both orientations with a straight corner.
        check_walls(&[fourier(&[(1, 3.0), (-1, 0.5), (2, 0.7)])]).unwrap();
        check_walls(&[fourier(&[(1, 8.0), (41, 0.05), (-39, 0.05)])]).unwrap();
        let mut points = vec![[0.0, 0.0], [4.0, 0.0], [8.0, 0.0], [8.0, 6.0], [5.0, 3.0], [0.0, 6.0]];
        check_walls(&[polygon(&points, 0.05)]).unwrap();
        points.reverse();
        check_walls(&[polygon(&points, 0.5)]).unwrap();
    }

    #[test]
    fn cusps_are_refused() {
        // A deltoid and an ellipse pressed flat.
        for coeffs in [&[(1, 2.0), (-2, 1.0)][..], &[(1, 1.0), (-1, 1.0)]] {
            let error = check_walls(&[fourier(coeffs)]).unwrap_err().to_string();
            assert!(error.contains("fiber[0].coeffs") && error.contains("cusp"), "{error}");
        }
    }

    #[test]
    fn roundings_fit_their_edges() {
        let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        // At 2 um, the arcs make a circle of it.
        check_walls(&[polygon(&square, 2.0)]).unwrap();
        check_walls(&[polygon(&square, 1.0)]).unwrap();
        for (points, rounding) in [(&square[..], 2.001), (&square, 1e-4), (&[square[0], square[1], square[0]], 0.1)] {
            let error = check_walls(&[polygon(points, rounding)]).unwrap_err().to_string();
            assert!(error.contains("fiber[0]."), "{error}");
        }
    }

    /// Many sampled walls are checked quickly: 400 side by side.
    #[test]
    fn many_fibers_are_apart() {
        let bodies: Vec<Body> =
            (0..400).map(|i| ellipse(7.5, 6.0, [f64::from(i % 20) * 15.2, f64::from(i / 20) * 12.2])).collect();
        check_walls(&bodies).unwrap();
    }
}
