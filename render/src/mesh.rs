//! Sheets as triangles with surface coordinates: flat, draped over a sphere, folded, or from a Wavefront OBJ file. Scene lengths are in millimetres,
//! surface coordinates in um of cloth.

use crate::RenderError;
use glam::Vec3;
use std::path::Path;

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

/// Largest OBJ file that is read [bytes].
const MAX_BYTES: u64 = 1 << 30;

impl Mesh {
    /// A sheet of `(n + 1)^2` vertices: `place` gives the point of (s, t) in [0, 1]^2, which is `size_um` of cloth wide and high.
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

    /// A square sheet that lies on a ball of a third of its width and hangs from it in folds. Lengths along the cloth are kept on the ball and in the
    /// hanging part roughly.
    pub fn drape(size_mm: f32) -> Mesh {
        let radius = size_mm / 3.0;
        Mesh::grid(256, 1000.0 * size_mm, |s, t| {
            let (x, y) = ((s - 0.5) * size_mm, (t - 0.5) * size_mm);
            let (r, angle) = (x.hypot(y), y.atan2(x));
            // On the ball the distance from the pole is an arc; below the equator's three quarters the cloth hangs.
            let hang = radius * 1.25;
            let (out, down) = if r < hang {
                (radius * (r / radius).sin(), radius * (1.0 - (r / radius).cos()))
            } else {
                let (sin, cos) = (hang / radius).sin_cos();
                let left = r - hang;
                let (dr, dz) = (cos * 0.35, sin + (1.0 - sin) * (left / radius).min(1.0));
                (radius * sin + dr * left, radius * (1.0 - cos) + dz * left)
            };
            let grown = ((r - 0.9 * radius) / radius).max(0.0);
            let fold = 0.16 * radius * grown * grown.min(1.0) * (7.0 * angle).cos();
            let out = out + fold;
            Vec3::new(out * angle.cos(), out * angle.sin(), radius - down)
        })
    }

    /// A square sheet with parallel folds along y.
    pub fn folded(size_mm: f32) -> Mesh {
        Mesh::grid(256, 1000.0 * size_mm, |s, t| {
            let wave = (3.0 * std::f32::consts::TAU * s + 0.7 * (4.0 * t).sin()).sin();
            Vec3::new((s - 0.5) * 0.8 * size_mm, (t - 0.5) * size_mm, 0.06 * size_mm * wave)
        })
    }

    /// Reads a Wavefront OBJ file: v, vt and f with texture coordinates (polygons are cut into fans), vn where there are some. One unit of the texture is
    /// `cloth_um` of cloth; the mesh is scaled and moved into a box of `size_mm` about the origin.
    ///
    /// # Errors
    /// [`RenderError::Mesh`] with the line for what is not understood, for a face without uv, and for a file without faces.
    pub fn obj(path: &Path, cloth_um: f32, size_mm: f32) -> Result<Mesh, RenderError> {
        let name = path.display().to_string();
        let io = |source| RenderError::Io { file: name.clone(), source };
        if std::fs::metadata(path).map_err(io)?.len() > MAX_BYTES {
            return Err(RenderError::Mesh { file: name, line: 0, what: format!("larger than {MAX_BYTES} bytes") });
        }
        Mesh::parse(&std::fs::read_to_string(path).map_err(io)?, &name, cloth_um, size_mm)
    }

    fn parse(text: &str, name: &str, cloth_um: f32, size_mm: f32) -> Result<Mesh, RenderError> {
        let (mut points, mut uvs, mut normals) = (Vec::<Vec3>::new(), Vec::<[f32; 2]>::new(), Vec::<Vec3>::new());
        let mut mesh = Mesh::default();
        let mut seen = std::collections::HashMap::new();
        let mut bare = false;
        for (number, line) in text.lines().enumerate() {
            let bad = |what: String| RenderError::Mesh { file: name.to_string(), line: number + 1, what };
            let mut words = line.split('#').next().unwrap_or("").split_whitespace();
            let key = words.next().unwrap_or("");
            let numbers = |words: std::str::SplitWhitespace<'_>, least: usize| -> Result<Vec<f32>, RenderError> {
                let values: Vec<f32> = words.map_while(|w| w.parse().ok()).filter(|v: &f32| v.is_finite()).collect();
                if values.len() < least { Err(bad(format!("{key} needs {least} numbers"))) } else { Ok(values) }
            };
            match key {
                "v" => points.push(Vec3::from_slice(&numbers(words, 3)?[..3])),
                "vn" => normals.push(Vec3::from_slice(&numbers(words, 3)?[..3]).normalize_or_zero()),
                "vt" => {
                    let v = numbers(words, 2)?;
                    uvs.push([v[0] * cloth_um, v[1] * cloth_um]);
                }
                "f" => {
                    let mut corners = Vec::new();
                    for word in words {
                        let mut parts = word.split('/');
                        let mut index = |count: usize| -> Result<Option<usize>, RenderError> {
                            let Some(text) = parts.next().filter(|t| !t.is_empty()) else { return Ok(None) };
                            let i: i64 = text.parse().map_err(|_| bad(format!("{text:.20} is no index")))?;
                            // Negative ones count from the end.
                            let at = if i < 0 { count as i64 + i } else { i - 1 };
                            if at < 0 || at >= count as i64 {
                                Err(bad(format!("index {i} of {count}")))
                            } else {
                                Ok(Some(at as usize))
                            }
                        };
                        let point = index(points.len())?.ok_or_else(|| bad("a corner without a vertex".into()))?;
                        let Some(uv) = index(uvs.len())? else {
                            return Err(bad("a face without uv: give texture coordinates (f v/vt ..)".into()));
                        };
                        let normal = index(normals.len())?;
                        let next = mesh.positions.len() as u32;
                        let vertex = *seen.entry((point, uv, normal)).or_insert(next);
                        if vertex == next {
                            mesh.positions.push(points[point]);
                            mesh.uv_um.push(uvs[uv]);
                            mesh.normals.push(normal.map_or(Vec3::ZERO, |n| normals[n]));
                            bare |= normal.is_none();
                        }
                        corners.push(vertex);
                    }
                    if corners.len() < 3 {
                        return Err(bad("a face of fewer than 3 corners".into()));
                    }
                    mesh.triangles.extend((1..corners.len() - 1).map(|k| [corners[0], corners[k], corners[k + 1]]));
                }
                _ => {}
            }
        }
        if mesh.triangles.is_empty() {
            return Err(RenderError::Mesh { file: name.to_string(), line: 0, what: "no faces".into() });
        }
        if bare {
            mesh.smooth();
        }
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in &mesh.positions {
            (low, high) = (low.min(*p), high.max(*p));
        }
        let scale = size_mm / (high - low).max_element().max(1e-20);
        for p in &mut mesh.positions {
            *p = (*p - 0.5 * (low + high)) * scale;
        }
        Ok(mesh)
    }

    /// Normals from the faces around each vertex, by area.
    fn smooth(&mut self) {
        self.normals = vec![Vec3::ZERO; self.positions.len()];
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            let n = (b - a).cross(c - a);
            for i in t {
                self.normals[*i as usize] += n;
            }
        }
        for n in &mut self.normals {
            *n = n.normalize_or_zero();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn obj_files_are_read_and_refused() {
        let good = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/-1\n";
        let mesh = Mesh::parse(good, "good", 500.0, 10.0).unwrap();
        assert_eq!((mesh.triangles.len(), mesh.positions.len()), (2, 4));
        assert_eq!(mesh.uv_um[2], [500.0, 500.0]);
        assert!((mesh.positions[1].x - 5.0).abs() < 1e-5 && (mesh.normals[0] - Vec3::Z).length() < 1e-6);
        for bad in
            ["v 0 0\n", "v 0 0 0\nf 1 1 1\n", "v 0 0 0\nvt 0 0\nf 1/1 2/1 1/1\n", "v 0 0 0\nvt 0 0\nf 1/1 1/1\n", ""]
        {
            assert!(matches!(Mesh::parse(bad, "bad", 1.0, 1.0), Err(RenderError::Mesh { .. })), "{bad:?}");
        }
    }

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
