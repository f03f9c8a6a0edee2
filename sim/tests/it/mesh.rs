//! The sweep: every fiber one closed surface, oriented out of its material, of the right volume, along the
//! right helix.

use plywave::spec::{Handedness, Shape, YarnSpec};
use plywave_sim::{PlySection, TriMesh};
use std::collections::HashMap;

const FABRICS: [&str; 5] = ["polyester", "cotton", "silk", "wool", "viscose"];

fn fabric(name: &str) -> YarnSpec {
    let path = format!("{}/../fabrics/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    plywave_textile::load_yarn_file(path).unwrap().0
}

/// Triangles of one fiber as a mesh with the vertices of all.
fn part(mesh: &TriMesh, fiber: u32) -> TriMesh {
    let (triangles, wall) =
        mesh.triangles.iter().zip(&mesh.wall).filter(|(_, wall)| *wall / 2 == fiber).map(|(t, w)| (*t, *w)).unzip();
    TriMesh { vertices: mesh.vertices.clone(), triangles, wall }
}

/// Every directed edge once, and its reverse once.
fn assert_watertight(mesh: &TriMesh, what: &str) {
    let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
    for [a, b, c] in &mesh.triangles {
        for edge in [(*a, *b), (*b, *c), (*c, *a)] {
            assert!(edge.0 != edge.1, "{what}: a triangle without area");
            *edges.entry(edge).or_default() += 1;
        }
    }
    assert!(!edges.is_empty(), "{what}: no triangles");
    for (&(a, b), &count) in &edges {
        assert!(count == 1 && edges.get(&(b, a)) == Some(&1), "{what}: edge {a}-{b} is open or used {count} times");
    }
}

#[test]
fn fabrics_are_watertight_and_keep_their_volume() {
    for name in FABRICS {
        let ply = PlySection::generate(&fabric(name), 11).unwrap();
        let mesh = TriMesh::sweep(&ply, -30.0, 60.0, 96, 2.0);
        assert!(mesh.vertices.iter().flatten().all(|x| x.is_finite()));
        assert_eq!(mesh.triangles.len(), mesh.wall.len());
        for (i, fiber) in ply.fibers.iter().enumerate() {
            let part = part(&mesh, i as u32);
            assert_watertight(&part, &format!("{name}, fiber {i}"));
            let (got, want) = (part.volume(), fiber.material_area() * 90.0);
            assert!((got / want - 1.0).abs() < 5e-3, "{name}, fiber {i}: volume {got}, want {want}");
        }
    }
}

#[test]
fn extreme_shapes_are_watertight() {
    for shape in [
        Shape::Kidney { a_um: 8.0, b_um: 8.0, dent: 0.8, lumen: 0.9 },
        Shape::Kidney { a_um: 9.0, b_um: 2.0, dent: 0.6, lumen: 0.2 },
        Shape::Trilobal { radius_um: 8.0, depth: 0.35 },
        Shape::Serrated { radius_um: 7.0, depth: 0.12, teeth: 10 },
        Shape::Stone { radius_um: 6.0, corners: 6, rounding_um: 0.5 },
        Shape::Polygon {
            file: String::new(),
            points_um: vec![[-8.0, -8.0], [8.0, -8.0], [8.0, -5.0], [-5.0, -5.0], [-5.0, 8.0], [-8.0, 8.0]],
            rounding_um: 0.8,
        },
    ] {
        let mut spec = fabric("cotton");
        (spec.fiber.shape, spec.ply.fibers, spec.ply.radius_um) = (shape.clone(), 8, Some(80.0));
        (spec.fiber.shape_jitter, spec.ply.handedness) = (0.2, Handedness::S);
        let ply = PlySection::generate(&spec, 2).unwrap();
        for points in [64, 300] {
            let mesh = TriMesh::sweep(&ply, 0.0, 50.0, points, 5.0);
            assert_watertight(&mesh, &format!("{shape:?}"));
            let want = ply.fibers.iter().map(|f| f.material_area() * 50.0).sum::<f64>();
            let allowed = if points == 64 { 0.03 } else { 0.003 };
            assert!((mesh.volume() / want - 1.0).abs() < allowed, "{shape:?}: {} of {want}", mesh.volume());
        }
    }
}

/// Vertices of height z turned back by z times the twist lie on the outline at z = 0, for both hands.
#[test]
fn vertices_lie_on_the_helix() {
    for hand in [Handedness::Z, Handedness::S] {
        let mut spec = fabric("silk");
        spec.ply.handedness = hand;
        let ply = PlySection::generate(&spec, 4).unwrap();
        let mesh = TriMesh::sweep(&ply, 0.0, 250.0, 48, 10.0);
        let sign = if hand == Handedness::Z { 1.0 } else { -1.0 };
        let per_fiber = mesh.vertices.len() / ply.fibers.len();
        for (i, v) in mesh.vertices.iter().enumerate() {
            let [x, y, z] = v.map(f64::from);
            let back =
                nalgebra::Rotation2::new(-sign * std::f64::consts::TAU * z / 1000.0) * nalgebra::Vector2::new(x, y);
            let fiber = &ply.fibers[i / per_fiber];
            let off = fiber.outer.signed_distance(fiber.to_fiber(back)).abs();
            assert!(off < 1e-4, "vertex {i} is {off} um off its outline");
        }
    }
}

/// A step from a triangle's center along its normal leaves the material.
#[test]
fn normals_point_out_of_the_material() {
    let mut spec = fabric("cotton");
    spec.ply.fiber_pitch_um = None;
    let ply = PlySection::generate(&spec, 6).unwrap();
    let mesh = TriMesh::sweep(&ply, 0.0, 20.0, 192, 10.0);
    let mut lumen_walls = 0;
    for (triangle, &wall) in mesh.triangles.iter().zip(&mesh.wall) {
        let [a, b, c] = triangle.map(|v| nalgebra::Vector3::from(mesh.vertices[v as usize].map(f64::from)));
        let normal = (b - a).cross(&(c - a)).normalize();
        if normal.z.abs() > 0.99 {
            // Caps cover the section exactly (unit tests of `mesh.rs`); here only their side matters.
            assert_eq!(normal.z > 0.0, a.z > 10.0, "wall {wall}: a cap turned over");
            continue;
        }
        let (inner, outer) = ((a + b + c) / 3.0 - normal * 0.02, (a + b + c) / 3.0 + normal * 0.02);
        let fiber = &ply.fibers[wall as usize / 2];
        let material = |p: nalgebra::Vector3<f64>| {
            let q = fiber.to_fiber(p.xy());
            let hollow = fiber.lumen.as_ref().is_some_and(|lumen| lumen.contains(q));
            (0.0..20.0).contains(&p.z) && fiber.outer.contains(q) && !hollow
        };
        assert!(material(inner) && !material(outer), "wall {wall}: normal {normal:?}");
        lumen_walls += usize::from(wall % 2 == 1);
    }
    assert_eq!(lumen_walls, 35 * 192 * 2 * 2);
}

#[test]
fn odd_arguments_give_a_mesh_or_none() {
    let ply = PlySection::generate(&fabric("polyester"), 0).unwrap();
    assert_eq!(TriMesh::sweep(&ply, 1.0, 1.0, 32, 1.0), TriMesh::default());
    assert_eq!(TriMesh::sweep(&ply, 0.0, f64::NAN, 32, 1.0), TriMesh::default());
    for step in [0.0, f64::NAN, 1e9] {
        let mesh = TriMesh::sweep(&ply, 0.0, 10.0, 0, step);
        assert_watertight(&mesh, "one layer of eight points");
        assert_eq!(mesh.vertices.len(), 30 * 2 * 8);
    }
}

#[test]
fn obj_lists_every_vertex_and_triangle() {
    let ply = PlySection::generate(&fabric("cotton"), 0).unwrap();
    let mesh = TriMesh::sweep(&ply, 0.0, 10.0, 16, 5.0);
    let mut text = Vec::new();
    mesh.write_obj(&mut text).unwrap();
    let text = String::from_utf8(text).unwrap();
    let count = |start: &str| text.lines().filter(|line| line.starts_with(start)).count();
    assert_eq!((count("v "), count("f ")), (mesh.vertices.len(), mesh.triangles.len()));
    assert!(count("g ") >= 70 && text.lines().filter(|l| l.starts_with("f ")).all(|l| !l.contains(" 0")));
}
