//! The walls of hairs: round tubes along the points of a hair, closed at both ends.
//!
//! Tubes are solid and have the area of the yarn's fibers. The first point lies on the ply's surface, so that
//! a root is half sunk among the fibers there. Overlapping tubes lose no light, since a ray within a fiber
//! intersects the walls of that fiber alone.

use super::domain::Domain;
use super::options::TwinMesh;
use super::sweep::{ClothMesh, ThreadOfFiber};
use crate::cloth::Hair;
use plywave::math::vec3::{cross, dot, sub, unit};
use std::f64::consts::{PI, TAU};

type V3 = [f64; 3];

/// Vertices, normals and quads of a tube.
struct Tube {
    vertices: Vec<V3>,
    normals: Vec<V3>,
    quads: Vec<[u32; 4]>,
}

/// A tube along points. Its section is a polygon of `sides` sides with the area of the circle of `radius_um`.
fn tube(points: &[V3], radius_um: f64, sides: usize) -> Tube {
    let n = sides as f64;
    let reach = radius_um * (PI / (0.5 * n * (TAU / n).sin())).sqrt();
    let last = points.len() - 1;
    let tangent = |i: usize| -> V3 {
        let step = |i: usize| unit(sub(points[i + 1], points[i]));
        match i {
            0 => step(0),
            i if i == last => step(last - 1),
            i => unit(std::array::from_fn(|k| step(i - 1)[k] + step(i)[k])),
        }
    };
    let first = tangent(0);
    let mut side = unit(cross(if first[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] }, first));
    let mut mesh = Tube { vertices: Vec::new(), normals: Vec::new(), quads: Vec::new() };
    for (i, point) in points.iter().enumerate() {
        let t = tangent(i);
        let along = dot(side, t);
        side = unit(std::array::from_fn(|k| side[k] - along * t[k]));
        let other = cross(t, side);
        for j in 0..sides {
            let (sin, cos) = (TAU * j as f64 / n).sin_cos();
            let out: V3 = std::array::from_fn(|k| cos * side[k] + sin * other[k]);
            mesh.vertices.push(std::array::from_fn(|k| point[k] + reach * out[k]));
            mesh.normals.push(out);
        }
        if i > 0 {
            let (below, above) = ((i - 1) * sides, i * sides);
            mesh.quads.extend((0..sides).map(|j| {
                let next = (j + 1) % sides;
                [below + j, below + next, above + j, above + next].map(|v| v as u32)
            }));
        }
    }
    // Triangle fans close both ends, with flat normals and two triangles for each quad.
    for (ring, normal, is_end) in [(0, first.map(|v| -v), false), (last, tangent(last), true)] {
        let middle = mesh.vertices.len() as u32;
        mesh.vertices.push(points[ring]);
        mesh.normals.push(normal);
        for j in 0..sides {
            mesh.vertices.push(mesh.vertices[ring * sides + j]);
            mesh.normals.push(normal);
        }
        let at = |j: usize| middle + 1 + (j % sides) as u32;
        mesh.quads.extend((0..sides).step_by(2).map(|j| match is_end {
            true => [middle, at(j), at(j + 2), at(j + 1)],
            false => [middle, at(j + 2), at(j), at(j + 1)],
        }));
    }
    mesh
}

/// Adds a hair with all of its images that reach into the domain to a mesh.
pub(super) fn add_hair(mesh: &mut ClothMesh, hair: &Hair, thread: ThreadOfFiber, domain: &Domain, options: &TwinMesh) {
    if hair.points_um.len() < 2 {
        return;
    }
    let sides = (options.outline_points.max(8) as usize).next_multiple_of(2);
    let tube = tube(&hair.points_um, hair.radius_um, sides);
    let wall = 2 * mesh.fibers.len() as u32;
    mesh.fibers.push(thread);
    let bounds = |k: usize| {
        let all = tube.vertices.iter().map(|v| v[k]);
        all.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)))
    };
    let images = |k: usize| {
        let ((low, high), size) = (bounds(k), domain.size_um[k]);
        (-high / size).ceil() as i64..=((size - low) / size).floor() as i64
    };
    for a in images(0) {
        for b in images(1) {
            let by = [(a as f64 - 0.5) * domain.size_um[0], (b as f64 - 0.5) * domain.size_um[1], 0.0];
            let first = mesh.vertices.len() as u32;
            mesh.vertices
                .extend(tube.vertices.iter().map(|v| -> [f32; 3] { std::array::from_fn(|k| (v[k] + by[k]) as f32) }));
            mesh.normals.extend(tube.normals.iter().map(|n| n.map(|v| v as f32)));
            mesh.quads.extend(tube.quads.iter().map(|q| q.map(|v| first + v)));
            mesh.wall.resize(mesh.quads.len(), wall);
        }
    }
}
