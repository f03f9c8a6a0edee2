//! The cross section of a ply instance as bodies of the wave code: the plane z = 0 of a [`PlySection`], whose
//! fibers count as parallel (Yu 2025, 4.3).
//!
//! Circles stay circles. A polyline whose vertices lie on an ellipse becomes that ellipse. Any other polyline
//! has its vertices on a smooth curve, uniformly in arc length, so that its trigonometric interpolant
//! converges as fast as the curve is smooth: it becomes a Fourier outline through the vertices, cut where the
//! rest is below [`CUT_UM`], and checked against the outline between them. The coefficients of rounded
//! polygons, whose curvature jumps, decay as 1/k^3: their joints are softened over about one spacing of the
//! vertices.

use crate::scene::scene_check::check_walls;
use crate::{Body, C64, Shape, WaveError};
use nalgebra::{Matrix4, Vector2, Vector4};
use plywave_sim::FiberSection;
use plywave_sim::Outline;
use plywave_sim::PlySection;
use std::f64::consts::TAU;

/// Maximum distance that cutting the Fourier series may move a point [um]: a four-hundredth of a wavelength,
/// and a two-hundredth of the least gap of the shipped specs.
const CUT_UM: f64 = 1e-3;
/// Maximum distance of a Fourier outline from the fiber's, between vertices too [um].
const LARGEST_DEVIATION_UM: f64 = 0.01;
/// Maximum distance of points from their conic, relative to its size.
const CONIC: f64 = 1e-10;

/// Bodies of all fibers of `section`, in their order, apart from each other. Lumens hold air.
///
/// # Errors
/// [`WaveError::Invalid`] for an outline too sharp for its vertices, [`WaveError::Overlap`] and the like for
/// walls that touch.
pub fn section_bodies(section: &PlySection, eta: f64, kappa: f64) -> Result<Vec<Body>, WaveError> {
    let bodies: Vec<Body> =
        section.fibers.iter().map(|fiber| fiber_body(fiber, eta, kappa)).collect::<Result<_, _>>()?;
    check_walls(&bodies)?;
    Ok(bodies)
}

/// The body of one fiber at its position in the section.
///
/// # Errors
/// [`WaveError::Invalid`] for an outline too sharp for its vertices.
pub fn fiber_body(fiber: &FiberSection, eta: f64, kappa: f64) -> Result<Body, WaveError> {
    let body = |wall: &Outline, eta, kappa, lumen| {
        let (shape, at) = shape_of(wall)?;
        let center = fiber.to_ply(at);
        Ok(Body { shape, center_um: [center.x, center.y], rotation_rad: fiber.angle_rad, eta, kappa, lumen })
    };
    let lumen = match &fiber.lumen {
        Some(wall) => Some(Box::new(body(wall, 1.0, 0.0, None)?)),
        None => None,
    };
    body(&fiber.outer, eta, kappa, lumen)
}

/// A wall as a shape of the wave code, and the origin of that shape in the fiber's frame.
fn shape_of(wall: &Outline) -> Result<(Shape, Vector2<f64>), WaveError> {
    match wall {
        Outline::Circle { radius_um } => Ok((Shape::Circle { radius_um: *radius_um }, Vector2::zeros())),
        Outline::Polyline(points) => match ellipse_through(points) {
            Some(ellipse) => Ok(ellipse),
            None => Ok((fourier_through(points)?, Vector2::zeros())),
        },
    }
}

/// The ellipse along the axes through all points, with its center, if there is one:
/// `A x^2 + C y^2 + D x + E y = 1`.
fn ellipse_through(points: &[Vector2<f64>]) -> Option<(Shape, Vector2<f64>)> {
    let size = points.iter().map(|p| p.norm()).fold(0.0, f64::max);
    let terms = |p: &Vector2<f64>| {
        let p = p / size;
        Vector4::new(p.x * p.x, p.y * p.y, p.x, p.y)
    };
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for p in points {
        let t = terms(p);
        normal += t * t.transpose();
        right += t;
    }
    let fit = normal.cholesky()?.solve(&right);
    if points.iter().any(|p| (terms(p).dot(&fit) - 1.0).abs() > CONIC) {
        return None;
    }
    let [a2, c2, d, e] = [fit.x, fit.y, fit.z, fit.w];
    if !(a2 > 0.0 && c2 > 0.0) {
        return None;
    }
    let level = 1.0 + d * d / (4.0 * a2) + e * e / (4.0 * c2);
    let (a_um, b_um) = (size * (level / a2).sqrt(), size * (level / c2).sqrt());
    let center = Vector2::new(-0.5 * d / a2, -0.5 * e / c2) * size;
    let shape = if (a_um - b_um).abs() <= CONIC * a_um {
        Shape::Circle { radius_um: a_um }
    } else {
        Shape::Ellipse { a_um, b_um }
    };
    Some((shape, center))
}

/// The trigonometric interpolant of equidistant points of a closed curve, truncated where its coefficients
/// are negligible.
fn fourier_through(points: &[Vector2<f64>]) -> Result<Shape, WaveError> {
    let n = points.len();
    let z: Vec<C64> = points.iter().map(|p| C64::new(p.x, p.y)).collect();
    let roots: Vec<C64> = (0..n).map(|j| C64::from_polar(1.0, TAU * j as f64 / n as f64)).collect();
    let top = (n / 2) as i32;
    let coefficient = |k: i32| {
        let step = k.rem_euclid(n as i32) as usize;
        let sum: C64 = z.iter().enumerate().map(|(j, z)| z * roots[j * step % n].conj()).sum();
        // An even number of points gives only the sum of the two highest harmonics; equal halves oscillate
        // least.
        let share = if n.is_multiple_of(2) && k.abs() == top { 0.5 } else { 1.0 };
        (k, sum * (share / n as f64))
    };
    let mut coeffs: Vec<(i32, C64)> = (-top..=top).map(coefficient).collect();
    // No point moves by more than the sum of the omitted harmonics.
    let mut moved = 0.0;
    let keep = (1..=top).rev().find(|k| {
        moved += coeffs.iter().filter(|(j, _)| j.abs() == *k).map(|(_, c)| c.norm()).sum::<f64>();
        moved > CUT_UM
    });
    coeffs.retain(|(k, _)| k.abs() <= keep.unwrap_or(1));

    let off = deviation(points, &coeffs);
    if off > LARGEST_DEVIATION_UM {
        return Err(WaveError::Invalid {
            key: "fiber.shape".into(),
            value: format!("{off:.3} um between the outline and a smooth curve through its {n} points"),
            hint: format!("round its corners more, so that this is below {LARGEST_DEVIATION_UM} um"),
        });
    }
    Ok(Shape::Fourier { coeffs })
}

/// Maximum distance, across the wall, of a Fourier outline from the curve whose points these are: at the
/// points, and halfway between them, where the curve is the cubic through the four nearest points [um].
fn deviation(points: &[Vector2<f64>], coeffs: &[(i32, C64)]) -> f64 {
    let n = points.len();
    let at = |j: usize| points[j % n];
    let curve = |t: f64| {
        let z: C64 = coeffs.iter().map(|(k, c)| c * C64::from_polar(1.0, f64::from(*k) * t)).sum();
        Vector2::new(z.re, z.im)
    };
    (0..n)
        .map(|j| {
            let step = TAU / n as f64;
            let here = (curve(step * j as f64) - at(j)).norm();
            let half = ((at(j) + at(j + 1)) * 9.0 - at(j + n - 1) - at(j + 2)) / 16.0;
            let along = (at(j + 1) - at(j)).normalize();
            let across = along.perp(&(curve(step * (j as f64 + 0.5)) - half)).abs();
            here.max(across)
        })
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    //! References: the curves of the outlines, and the outlines' own area, centroid and gaps.
    use super::*;
    use plywave::spec::YarnSpec;

    fn spec(shape: &str, jitter: f64) -> YarnSpec {
        let text = format!(
            "name = \"t\"\n[fiber]\nshape = {shape}\nsize_jitter = {jitter}\nshape_jitter = {jitter}\neta = 1.55\nalpha_fiber = 0.1\n\
             [ply]\nfibers = 5\nradius_um = 30.0\nmin_gap_um = 0.2\n"
        );
        YarnSpec::parse(&text, "t.toml").unwrap()
    }

    const SHAPES: [&str; 8] = [
        r#"{ kind = "circle", radius_um = 7.5 }"#,
        r#"{ kind = "ellipse", a_um = 9.6, b_um = 8.2 }"#,
        r#"{ kind = "kidney", a_um = 8.5, b_um = 4.5, dent = 0.35, lumen = 0.5 }"#,
        r#"{ kind = "rounded_triangle", radius_um = 8.0, rounding_um = 1.5 }"#,
        r#"{ kind = "stone", radius_um = 6.0, corners = 6, rounding_um = 0.8 }"#,
        r#"{ kind = "trilobal", radius_um = 7.0, depth = 0.25 }"#,
        r#"{ kind = "serrated", radius_um = 7.0, depth = 0.13, teeth = 8 }"#,
        r#"{ kind = "polygon", points_um = [[-6, -5], [6, -5], [6, 5], [0, 1], [-6, 5]], rounding_um = 1.0 }"#,
    ];

    /// Points of a body's wall in the scene.
    fn points(body: &Body, n: usize) -> Vec<Vector2<f64>> {
        let turn = C64::from_polar(1.0, body.rotation_rad);
        (0..n)
            .map(|j| {
                let t = TAU * j as f64 / n as f64;
                let z = match &body.shape {
                    Shape::Circle { radius_um } => C64::from_polar(*radius_um, t),
                    Shape::Ellipse { a_um, b_um } => C64::new(a_um * t.cos(), b_um * t.sin()),
                    Shape::Fourier { coeffs } => {
                        coeffs.iter().map(|(k, c)| c * C64::from_polar(1.0, f64::from(*k) * t)).sum()
                    }
                    Shape::Polygon { .. } => panic!("no polygons are made"),
                };
                let z = z * turn + C64::new(body.center_um[0], body.center_um[1]);
                Vector2::new(z.re, z.im)
            })
            .collect()
    }

    /// Every wall of every kind of fiber lies on its outline to 0.01 um, has its area to 1e-3, and keeps its
    /// distance to others.
    #[test]
    fn walls_follow_their_outlines() {
        for shape in SHAPES {
            for (seed, jitter) in [(1, 0.0), (2, 0.1)] {
                let section = PlySection::generate(&spec(shape, jitter), seed).unwrap();
                let bodies = section_bodies(&section, 1.55, 0.01).unwrap();
                assert_eq!(bodies.len(), section.fibers.len());
                for (body, fiber) in bodies.iter().zip(&section.fibers) {
                    assert_eq!((body.eta, body.kappa), (1.55, 0.01));
                    let lumen = body.lumen.as_deref();
                    assert_eq!(lumen.is_some(), fiber.lumen.is_some());
                    let walls = [(Some(body), Some(&fiber.outer)), (lumen, fiber.lumen.as_ref())];
                    for (body, wall) in walls.into_iter().filter_map(|(b, w)| Some((b?, w?))) {
                        let points: Vec<_> = points(body, 3000).into_iter().map(|p| fiber.to_fiber(p)).collect();
                        // A vertex that stands out of the chord between its neighbors by s makes the polyline
                        // that much too small.
                        let sagitta = match wall {
                            Outline::Circle { .. } => 0.0,
                            Outline::Polyline(p) => {
                                let n = p.len();
                                let chord = wall.perimeter() / n as f64;
                                chord * chord * wall.max_curvature() / 8.0
                            }
                        };
                        let far = points.iter().map(|p| wall.signed_distance(*p).abs()).fold(0.0, f64::max);
                        assert!(far < LARGEST_DEVIATION_UM + sagitta, "{shape}: {far} um off, chords {sagitta}");
                        let area = Outline::Polyline(points).area();
                        assert!((area / wall.area() - 1.0).abs() < 1e-3, "{shape}: area {area}, {}", wall.area());
                    }
                }
            }
        }
    }

    /// An ellipse comes out as drawn: a and b of the spec at no jitter, to rounding; circles too.
    #[test]
    fn closed_forms_are_kept() {
        let draw = |shape: &str| {
            let section = PlySection::generate(&spec(shape, 0.0), 3).unwrap();
            section_bodies(&section, 1.5, 0.0).unwrap()
        };
        for body in draw(SHAPES[0]) {
            assert_eq!(body.shape, Shape::Circle { radius_um: 7.5 });
        }
        for body in draw(SHAPES[1]) {
            let Shape::Ellipse { a_um, b_um } = body.shape else { panic!("{:?}", body.shape) };
            assert!((a_um - 9.6).abs() < 1e-9 && (b_um - 8.2).abs() < 1e-9, "{a_um} {b_um}");
        }
        for shape in &SHAPES[2..] {
            for body in draw(shape) {
                assert!(matches!(body.shape, Shape::Fourier { .. }), "{shape}");
            }
        }
    }

    /// The three-lobed outline is known: its interpolant lies on r(t) = R (1 + depth cos 3 t) far more
    /// closely than required.
    #[test]
    fn analytic_outlines_are_met() {
        let section = PlySection::generate(&spec(SHAPES[5], 0.0), 4).unwrap();
        for (body, fiber) in section_bodies(&section, 1.5, 0.0).unwrap().iter().zip(&section.fibers) {
            let far = points(body, 5000)
                .into_iter()
                .map(|p| {
                    let p = fiber.to_fiber(p);
                    p.norm() - 7.0 * (1.0 + 0.25 * (3.0 * p.y.atan2(p.x)).cos())
                })
                .fold(0.0, |m: f64, d| m.max(d.abs()));
            assert!(far < 2.0 * CUT_UM, "{far} um");
        }
    }

    /// Corners too sharp for the vertices are refused with a message, not smoothed silently.
    #[test]
    fn sharp_corners_are_refused() {
        let points: Vec<_> = (0..80)
            .map(|j| {
                let side = (j % 20) as f64 / 20.0 - 0.5;
                let turn = nalgebra::Rotation2::new(TAU / 4.0 * (j / 20) as f64);
                turn * Vector2::new(side * 10.0, -5.0)
            })
            .collect();
        let outer = Outline::Polyline(points);
        let fiber = FiberSection { center_um: Vector2::zeros(), angle_rad: 0.0, outer, lumen: None, second: false };
        assert!(matches!(fiber_body(&fiber, 1.5, 0.0), Err(WaveError::Invalid { .. })));
    }
}
