//! Outlines at random seeds and strong jitter: simple, counterclockwise, centered, smooth, evenly sampled;
//! lumens strictly within.

use nalgebra::Vector2;
use plywave::spec::{Shape, YarnSpec};
use plywave_sim::{FiberSection, Outline, PlySection};

/// Every kind of polyline outline, common and extreme.
fn shapes() -> Vec<Shape> {
    let l_profile = vec![[-8.0, -8.0], [8.0, -8.0], [8.0, -2.0], [-1.0, -1.0], [-2.0, 8.0], [-8.0, 8.0]];
    let clockwise: Vec<_> = l_profile.iter().rev().copied().collect();
    let polygon = |points_um| Shape::Polygon { file: String::new(), points_um, rounding_um: 1.0 };
    vec![
        Shape::Ellipse { a_um: 10.0, b_um: 7.0 },
        Shape::Ellipse { a_um: 9.0, b_um: 1.5 },
        Shape::Kidney { a_um: 8.5, b_um: 4.5, dent: 0.35, lumen: 0.5 },
        Shape::Kidney { a_um: 8.0, b_um: 8.0, dent: 0.8, lumen: 0.9 },
        Shape::Kidney { a_um: 9.0, b_um: 1.6, dent: 0.0, lumen: 0.0 },
        Shape::RoundedTriangle { radius_um: 8.0, rounding_um: 1.5 },
        Shape::RoundedTriangle { radius_um: 8.0, rounding_um: 0.16 },
        Shape::RoundedTriangle { radius_um: 8.0, rounding_um: 3.2 },
        Shape::Stone { radius_um: 6.0, corners: 5, rounding_um: 1.0 },
        Shape::Stone { radius_um: 6.0, corners: 3, rounding_um: 2.4 },
        Shape::Stone { radius_um: 6.0, corners: 24, rounding_um: 0.12 },
        Shape::Trilobal { radius_um: 8.0, depth: 0.15 },
        Shape::Trilobal { radius_um: 8.0, depth: 0.35 },
        Shape::Serrated { radius_um: 7.0, depth: 0.13, teeth: 8 },
        Shape::Serrated { radius_um: 7.0, depth: 0.007, teeth: 40 },
        Shape::Serrated { radius_um: 7.0, depth: 0.12, teeth: 10 },
        polygon(l_profile),
        polygon(clockwise),
    ]
}

/// Fibers of a shape, far apart.
fn fibers(shape: &Shape, jitter: f64, count: u32, seed: u64) -> Vec<FiberSection> {
    let mut spec = YarnSpec::polyester().unwrap();
    spec.fiber.shape = shape.clone();
    (spec.fiber.size_jitter, spec.fiber.shape_jitter) = (jitter, jitter);
    (spec.ply.fibers, spec.ply.radius_um) = (count, Some(400.0));
    spec.check("test").unwrap();
    PlySection::generate(&spec, seed).unwrap().fibers
}

fn vertices(outline: &Outline) -> &[Vector2<f64>] {
    let Outline::Polyline(points) = outline else { panic!("a polyline") };
    points
}

#[test]
fn outlines_are_simple_smooth_and_centered() {
    for shape in shapes() {
        for fiber in fibers(&shape, 0.25, 12, 3) {
            for wall in std::iter::once(&fiber.outer).chain(&fiber.lumen) {
                let points = vertices(wall);
                assert!(points.iter().all(|p| p.x.is_finite() && p.y.is_finite()), "{shape:?}");
                assert!((192..=1024).contains(&points.len()), "{shape:?}: {} points", points.len());
                assert!(wall.area() > 0.0, "{shape:?}: clockwise");
                assert!(wall.is_simple(), "{shape:?}: crosses itself");
                let mean = wall.perimeter() / points.len() as f64;
                let edge = |i: usize| (points[(i + 1) % points.len()] - points[i]).norm();
                assert!((0..points.len()).all(|i| (0.8 * mean..1.05 * mean).contains(&edge(i))), "{shape:?}: uneven");
                // Turn from edge to edge: about 0.2 rad, or the least that 1024 points allow for the sharpest
                // shapes.
                let (turn, allowed) = (wall.max_curvature() * mean, if points.len() < 1024 { 0.25 } else { 0.75 });
                assert!(turn < allowed, "{shape:?}: turns by {turn} rad at a vertex of {}", points.len());
            }
            assert!(fiber.outer.centroid().norm() < 1e-9 * fiber.outer.bounding_radius(), "{shape:?}");
        }
    }
}

#[test]
fn lumens_keep_a_wall() {
    for (shape, jitter) in shapes().iter().flat_map(|s| [(s, 0.0), (s, 0.25)]) {
        let Shape::Kidney { lumen, .. } = shape else { continue };
        for fiber in fibers(shape, jitter, 12, 8) {
            assert_eq!(fiber.lumen.is_some(), *lumen > 0.0);
            let Some(wall) = &fiber.lumen else { continue };
            let thinnest =
                vertices(wall).iter().map(|&p| -fiber.outer.signed_distance(p)).fold(f64::INFINITY, f64::min);
            assert!(thinnest > 0.005 * fiber.outer.bounding_radius(), "{shape:?}: wall of {thinnest} um");
            assert!(vertices(&fiber.outer).iter().all(|&p| wall.signed_distance(p) > 0.0), "{shape:?}");
            assert!((fiber.material_area() - fiber.outer.area() + wall.area()).abs() < 1e-9);
        }
    }
}

/// The area in the spec's check is the mean area of drawn fibers.
#[test]
fn areas_are_those_of_the_spec() {
    for shape in shapes() {
        let drawn = fibers(&shape, 0.0, 40, 5);
        let got = drawn.iter().map(|f| f.outer.area()).sum::<f64>() / drawn.len() as f64;
        let mut spec = YarnSpec::polyester().unwrap();
        (spec.fiber.shape, spec.ply.fibers, spec.ply.radius_um) = (shape.clone(), 1, Some(100.0));
        let want = spec.packing_fraction() * std::f64::consts::PI * 1e4;
        let allowed = if matches!(shape, Shape::Polygon { .. }) { 0.02 } else { 0.01 };
        assert!((got / want - 1.0).abs() < allowed, "{shape:?}: got {got}, want {want}");
    }
}

/// Distances, areas and curvature of a polyline circle against the closed forms.
#[test]
fn measures_match_the_circle() {
    let circle = Outline::Circle { radius_um: 7.0 };
    let ring = Outline::Polyline(circle.polyline(720));
    for k in 0..40 {
        let p = Vector2::new(0.4 * f64::from(k), 1.3 - 0.1 * f64::from(k));
        let (got, want) = (ring.signed_distance(p), circle.signed_distance(p));
        assert!((got - want).abs() < 7.0 * 1e-5, "at {p:?}: got {got}, want {want}");
        assert_eq!(ring.contains(p), got < 0.0);
    }
    for (got, want) in [
        (ring.area(), circle.area()),
        (ring.perimeter(), circle.perimeter()),
        (ring.bounding_radius(), 7.0),
        (ring.max_curvature(), 1.0 / 7.0),
    ] {
        assert!((got / want - 1.0).abs() < 2e-5, "got {got}, want {want}");
    }
    for outline in [circle, ring] {
        for p in outline.points(37) {
            assert!((p.position_um.norm() - 7.0).abs() < 1e-4 && (p.normal - p.position_um / 7.0).norm() < 5e-3);
        }
    }
}

#[test]
fn a_crossed_outline_is_not_simple() {
    let bow = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]].map(|p| Vector2::new(p[0], p[1]));
    assert!(!Outline::Polyline(bow.to_vec()).is_simple());
}

/// Two fibers by hand: apart by a known gap, touching, one within the other.
#[test]
fn distances_of_fibers() {
    let square = |x: f64, half: f64| FiberSection {
        center_um: Vector2::new(x, 0.0),
        angle_rad: 0.0,
        outer: Outline::Polyline(
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|p| Vector2::from(p) * half).to_vec(),
        ),
        lumen: None,
        second: false,
    };
    let disc = FiberSection { outer: Outline::Circle { radius_um: 1.0 }, ..square(5.0, 1.0) };
    assert!((square(0.0, 1.0).min_distance(&square(5.0, 1.0)) - 3.0).abs() < 1e-12);
    assert!((square(0.0, 1.0).min_distance(&disc) - 3.0).abs() < 1e-12);
    assert!((disc.min_distance(&square(0.0, 1.0)) - 3.0).abs() < 1e-12);
    assert!(square(0.0, 1.0).min_distance(&square(1.5, 1.0)) < 0.0);
    assert!(square(0.0, 3.0).min_distance(&square(0.5, 1.0)) <= -1.5);
    assert!(square(0.5, 1.0).min_distance(&square(0.0, 3.0)) <= -1.5);
    // A cross: no vertex of either lies in the other.
    let bar = |angle_rad| FiberSection {
        angle_rad,
        outer: Outline::Polyline([[-9.0, -1.0], [9.0, -1.0], [9.0, 1.0], [-9.0, 1.0]].map(Vector2::from).to_vec()),
        ..square(0.0, 1.0)
    };
    assert!(bar(0.0).min_distance(&bar(1.5)) < 0.0);
}
