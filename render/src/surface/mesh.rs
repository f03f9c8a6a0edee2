//! Sheets of triangles with surface coordinates; `sheets.rs` makes those with a hem. Scene lengths are in
//! millimeters, surface coordinates in micrometers of cloth.

use glam::{Vec2, Vec3};

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
        Mesh::patch([n, n], |a| place(a.x, a.y), |a| (a * size_um).to_array())
    }

    /// A sheet of `cells` quadrilaterals. `place` maps [0, 1]^2 and a little around it to points of the scene
    /// [mm], `uv_um` to positions on the cloth [um].
    pub(crate) fn patch(cells: [usize; 2], place: impl Fn(Vec2) -> Vec3, uv_um: impl Fn(Vec2) -> [f32; 2]) -> Mesh {
        let mut mesh = Mesh::default();
        let [n, m] = cells;
        let e = (Vec2::splat(0.4) / Vec2::new(n as f32, m as f32)).min(Vec2::splat(1e-3));
        for j in 0..=m {
            for i in 0..=n {
                let at = Vec2::new(i as f32 / n as f32, j as f32 / m as f32);
                let (x, y) = (Vec2::new(e.x, 0.0), Vec2::new(0.0, e.y));
                let along = place(at + x) - place(at - x);
                let across = place(at + y) - place(at - y);
                mesh.positions.push(place(at));
                mesh.normals.push(along.cross(across).normalize_or_zero());
                mesh.uv_um.push(uv_um(at));
            }
        }
        let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
        for j in 0..m {
            for i in 0..n {
                mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        mesh
    }

    /// Adds the triangles of another sheet.
    pub fn append(&mut self, other: Mesh) {
        let first = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.uv_um.extend(other.uv_um);
        self.triangles.extend(other.triangles.into_iter().map(|t| t.map(|k| first + k)));
    }

    /// A flat square sheet in the plane z = 0 about the origin.
    pub fn flat(size_mm: f32) -> Mesh {
        Mesh::grid(1, 1000.0 * size_mm, |s, t| Vec3::new((s - 0.5) * size_mm, (t - 0.5) * size_mm, 0.0))
    }

    /// A square sheet with parallel folds along y.
    pub fn folded(size_mm: f32) -> Mesh {
        Mesh::grid(256, 1000.0 * size_mm, |s, t| {
            let wave = (3.0 * std::f32::consts::TAU * s + 0.7 * (4.0 * t).sin()).sin();
            Vec3::new((s - 0.5) * 0.8 * size_mm, (t - 0.5) * size_mm, 0.06 * size_mm * wave)
        })
    }
}
