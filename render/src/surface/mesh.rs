//! Sheets of triangles with surface coordinates: flat, draped over a ball, folded. Scene lengths are in
//! millimeters, surface coordinates in micrometers of cloth.

use glam::Vec3;

/// A sheet.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertices [mm].
    pub positions: Vec<Vec3>,
    /// Unit normals at the vertices.
    pub normals: Vec<Vec3>,
    /// Position on the cloth at the vertices [um].
    pub uv_um: Vec<[f32; 2]>,
    /// Vertex indices, counterclockwise about the normal.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A sheet of `(n + 1)^2` vertices. `place` maps (s, t) in [0, 1]^2 to a point of the scene [mm]; the
    /// square is `size_um` of cloth wide and high.
    pub fn grid(n: usize, size_um: f32, place: impl Fn(f32, f32) -> Vec3) -> Mesh {
        let mut mesh = Mesh::default();
        let e = 1e-3;
        for j in 0..=n {
            for i in 0..=n {
                let (s, t) = (i as f32 / n as f32, j as f32 / n as f32);
                let along = place(s + e, t) - place(s - e, t);
                let across = place(s, t + e) - place(s, t - e);
                mesh.positions.push(place(s, t));
                mesh.normals.push(along.cross(across).normalize_or_zero());
                mesh.uv_um.push([s * size_um, t * size_um]);
            }
        }
        let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
        for j in 0..n {
            for i in 0..n {
                mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        mesh
    }

    /// A flat square sheet in the plane z = 0 about the origin.
    pub fn flat(size_mm: f32) -> Mesh {
        Mesh::grid(1, 1000.0 * size_mm, |s, t| Vec3::new((s - 0.5) * size_mm, (t - 0.5) * size_mm, 0.0))
    }

    /// A square sheet draped over a ball about the origin, with its corners on the floor. The ball's radius
    /// is [`Mesh::BALL`] times the sheet's width, the floor's height [`Mesh::FLOOR`] times that width. The
    /// deterministic simulation takes a second or two.
    pub fn drape(size_mm: f32) -> Mesh {
        // Distance of the cloth from its support.
        let lift = 0.004;
        let (points, side) = crate::surface::drape::fallen(Mesh::BALL + lift, Mesh::FLOOR + lift);
        let cells = side - 1;
        // Catmull-Rom interpolation between the simulated points.
        let at = |i: isize, j: isize| {
            let [i, j] = [i, j].map(|k| k.clamp(0, cells as isize) as usize);
            points[j * side + i]
        };
        let spline = |p: [Vec3; 4], u: f32| {
            let (a, b, c) =
                (p[2] - p[0], 2.0 * p[0] - 5.0 * p[1] + 4.0 * p[2] - p[3], 3.0 * (p[1] - p[2]) + p[3] - p[0]);
            p[1] + 0.5 * u * (a + u * (b + u * c))
        };
        Mesh::grid(4 * cells, 1000.0 * size_mm, |s, t| {
            let [(i, u), (j, v)] = [s, t].map(|x| {
                let x = x.clamp(0.0, 1.0) * cells as f32;
                let cell = (x as usize).min(cells - 1);
                (cell as isize, x - cell as f32)
            });
            let row = |j: isize| spline([-1, 0, 1, 2].map(|k| at(i + k, j)), u);
            spline([-1, 0, 1, 2].map(|k| row(j + k)), v) * size_mm
        })
    }

    /// Radius of the ball under a drape, relative to the sheet's width.
    pub const BALL: f32 = 0.2;
    /// Height of the floor under a drape relative to the sheet's width; the ball's center is at 0.
    pub const FLOOR: f32 = -0.2;

    /// A square sheet with parallel folds along y.
    pub fn folded(size_mm: f32) -> Mesh {
        Mesh::grid(256, 1000.0 * size_mm, |s, t| {
            let wave = (3.0 * std::f32::consts::TAU * s + 0.7 * (4.0 * t).sin()).sin();
            Vec3::new((s - 0.5) * 0.8 * size_mm, (t - 0.5) * size_mm, 0.06 * size_mm * wave)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheets_face_up() {
        for mesh in [Mesh::flat(10.0), Mesh::drape(10.0), Mesh::folded(10.0)] {
            let up = mesh.triangles.iter().filter(|t| {
                let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
                let n = (b - a).cross(c - a);
                n.dot(mesh.normals[t[0] as usize]) > 0.0
            });
            assert!(up.count() * 100 >= 99 * mesh.triangles.len());
        }
    }
}
