//! Sheets as triangles with surface coordinates: flat, draped over a sphere, folded, or from a Wavefront OBJ file. Scene lengths are in millimetres,
//! surface coordinates in um of cloth.

use crate::RenderError;
use crate::room::check_room;
use glam::Vec3;
use std::collections::{HashMap, HashSet};
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

/// What was done to a mesh from a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshNotes {
    /// Millimeters of the scene to one unit of the file.
    pub mm_per_unit: f32,
    /// Faces left out because another one lies in the same place.
    pub equal_faces: usize,
    /// Faces left out because they have no area.
    pub flat_faces: usize,
}

/// Largest OBJ file that is read [bytes].
const MAX_BYTES: u64 = 1 << 30;
/// Memory to a byte of an OBJ file, at most: a corner of two characters becomes three indices, kept twice.
const MEMORY_PER_BYTE: u64 = 16;

/// Reads the lines of an OBJ file, comments left out, with one index a corner.
fn read_obj<'a>(lines: impl Iterator<Item = &'a str>) -> Result<Vec<tobj::Model>, tobj::LoadError> {
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };
    let mut text = String::new();
    for line in lines {
        text += line.split('#').next().unwrap_or("");
        text.push('\n');
    }
    let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials).map(|(models, _)| models)
}

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

    /// A square sheet that has fallen over the ball of [`Mesh::BALL`] of its width about the origin and lies with its corners on the floor at [`Mesh::FLOOR`] of it. A
    /// simulation of a second or two, the same each time.
    pub fn drape(size_mm: f32) -> Mesh {
        // The cloth's own thickness above what carries it.
        let lift = 0.004;
        let (points, side) = crate::drape::fallen(Mesh::BALL + lift, Mesh::FLOOR + lift);
        let cells = side - 1;
        // Catmull-Rom between the points.
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

    /// Radius of the ball below a drape over the sheet's width.
    pub const BALL: f32 = 0.2;
    /// Height of the floor below a drape over the sheet's width, the ball's center at 0.
    pub const FLOOR: f32 = -0.2;

    /// A square sheet with parallel folds along y.
    pub fn folded(size_mm: f32) -> Mesh {
        Mesh::grid(256, 1000.0 * size_mm, |s, t| {
            let wave = (3.0 * std::f32::consts::TAU * s + 0.7 * (4.0 * t).sin()).sin();
            Vec3::new((s - 0.5) * 0.8 * size_mm, (t - 0.5) * size_mm, 0.06 * size_mm * wave)
        })
    }

    /// Reads a Wavefront OBJ file (by `tobj`) with texture coordinates; polygons are cut into fans, normals are used where every corner has one. One unit of the
    /// texture is `cloth_um` of cloth; the mesh is scaled and moved into a box of `size_mm` about the origin. Of equal faces one is kept: two sheets in one place
    /// have no front. Faces without area are left out. Materials are not read.
    ///
    /// # Errors
    /// [`RenderError::Mesh`] with the line for what is not understood, for a face without uv, and for a file without faces; [`RenderError::Io`];
    /// [`RenderError::TooLarge`].
    pub fn obj(path: &Path, cloth_um: f32, size_mm: f32) -> Result<(Mesh, MeshNotes), RenderError> {
        let name = path.display().to_string();
        let bad = |what: String| RenderError::Mesh { file: name.clone(), line: 0, what };
        let bytes = crate::room::read_file(path, MAX_BYTES)?;
        check_room(&format!("{name}: this mesh"), MEMORY_PER_BYTE * bytes.len() as u64)?;
        let text = String::from_utf8(bytes).map_err(|_| bad("not text in UTF-8; give a Wavefront OBJ file".into()))?;
        Mesh::parse(&text, &name, cloth_um, size_mm)
    }

    fn parse(text: &str, name: &str, cloth_um: f32, size_mm: f32) -> Result<(Mesh, MeshNotes), RenderError> {
        let bad = |line: usize, what: &str| RenderError::Mesh { file: name.to_string(), line, what: what.into() };
        let models = read_obj(text.lines()).map_err(|error| {
            // The loader does not tell the line: it is the last of the shortest beginning that fails.
            let lines: Vec<&str> = text.lines().collect();
            let (mut good, mut fails) = (0, lines.len());
            while fails - good > 1 {
                let middle = (good + fails) / 2;
                match read_obj(lines[..middle].iter().copied()) {
                    Ok(_) => good = middle,
                    Err(_) => fails = middle,
                }
            }
            bad(fails, &error.to_string())
        })?;
        let mut mesh = Mesh::default();
        let mut bare = false;
        // Parts of a file are joined where position, uv and normal are the same.
        let mut known: HashMap<[u32; 8], u32> = HashMap::new();
        for part in models.iter().map(|m| &m.mesh) {
            let count = part.positions.len() / 3;
            if part.texcoords.len() != 2 * count && !part.indices.is_empty() {
                return Err(bad(0, "a face without uv; give texture coordinates (f v/vt ..)"));
            }
            let with_normals = part.normals.len() == 3 * count;
            bare |= !with_normals;
            let vertices: Vec<u32> = (0..count)
                .map(|i| {
                    let [u, v] = [part.texcoords[2 * i], part.texcoords[2 * i + 1]];
                    let position = Vec3::from_slice(&part.positions[3 * i..]);
                    let normal = if with_normals { Vec3::from_slice(&part.normals[3 * i..]) } else { Vec3::ZERO };
                    let [p, n] = [position, normal].map(|v| v.to_array().map(f32::to_bits));
                    let next = mesh.positions.len() as u32;
                    let at =
                        *known.entry([p[0], p[1], p[2], n[0], n[1], n[2], u.to_bits(), v.to_bits()]).or_insert(next);
                    if at == next {
                        mesh.positions.push(position);
                        mesh.uv_um.push([u * cloth_um, v * cloth_um]);
                        mesh.normals.push(normal.normalize_or_zero());
                    }
                    at
                })
                .collect();
            mesh.triangles.extend(part.indices.as_chunks::<3>().0.iter().map(|t| t.map(|i| vertices[i as usize])));
        }
        let finite = mesh.positions.iter().chain(&mesh.normals).all(|p| p.is_finite());
        if !finite || mesh.uv_um.iter().flatten().any(|v| !v.is_finite()) {
            return Err(bad(0, "a coordinate that is not finite"));
        }
        if mesh.triangles.is_empty() {
            return Err(bad(0, "no faces; give a Wavefront OBJ file with faces (f v/vt ..)"));
        }
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in &mesh.positions {
            (low, high) = (low.min(*p), high.max(*p));
        }
        let extent = (high - low).max_element();
        if !(extent > 0.0 && extent.is_finite()) {
            return Err(bad(0, "all faces lie in one point, or farther apart than numbers reach"));
        }
        let scale = size_mm / extent;
        let middle = 0.5 * low + 0.5 * high;
        for p in &mut mesh.positions {
            *p = (*p - middle) * scale;
        }
        let (equal_faces, flat_faces) = mesh.tidy();
        if mesh.triangles.is_empty() {
            return Err(bad(0, "no face has an area"));
        }
        if bare {
            mesh.smooth();
        }
        Ok((mesh, MeshNotes { mm_per_unit: scale, equal_faces, flat_faces }))
    }

    /// Leaves out faces that lie where another one does, whatever their uv, and faces without area; gives how many of each.
    fn tidy(&mut self) -> (usize, usize) {
        let (mut equal, mut flat) = (0, 0);
        let mut known = HashSet::new();
        let positions = &self.positions;
        self.triangles.retain(|t| {
            let corners = t.map(|i| positions[i as usize]);
            let [a, b, c] = corners;
            if (b - a).cross(c - a).length_squared() <= 0.0 {
                flat += 1;
                return false;
            }
            // Adding 0 turns -0 into 0.
            let mut key = corners.map(|p| (p + Vec3::ZERO).to_array().map(f32::to_bits));
            key.sort_unstable();
            let new = known.insert(key);
            equal += usize::from(!new);
            new
        });
        (equal, flat)
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

    const QUAD: &str = "v 0 0 0\nv 2 0 0 # a corner\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

    #[test]
    fn obj_files_are_read_and_refused() {
        let (mesh, notes) = Mesh::parse(&format!("{QUAD}f 1/1 2/2 3/3 4/-1\n"), "good", 500.0, 10.0).unwrap();
        assert_eq!((mesh.triangles.len(), mesh.positions.len()), (2, 4));
        assert_eq!(mesh.uv_um[2], [500.0, 500.0]);
        assert!((mesh.positions[1].x - 5.0).abs() < 1e-5 && (mesh.normals[0] - Vec3::Z).length() < 1e-6);
        assert_eq!(notes, MeshNotes { mm_per_unit: 5.0, equal_faces: 0, flat_faces: 0 });
        // Groups share their vertices: the normals of a fold are smooth across them.
        let fold = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\ng a\nf 1/1 2/1 3/1\ng b\nf 2/1 4/1 3/1\n";
        assert_eq!(Mesh::parse(fold, "fold", 1.0, 1.0).unwrap().0.positions.len(), 4);
        for (bad, line) in [
            ("v 0 0\n", 1),
            ("v 0 0 0\nf 1 1 1\n", 0),
            ("v 0 0 0\nvt 0 0\nf 1/1 2/1 1/1\n", 3),
            ("v 0 0 0\nvt 0 0\nf 1/1 1/1\n", 0),
            ("v 0 0 0\nv 1 x 0\nvt 0 0\n", 2),
            ("v 0 0 0\nv nan 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n", 0),
            ("v 0 0 0\nvt 0 0\nf 1/1 1/1 1/1\n", 0),
            ("", 0),
        ] {
            match Mesh::parse(bad, "bad", 1.0, 1.0) {
                Err(RenderError::Mesh { line: at, .. }) => assert_eq!(at, line, "{bad:?}"),
                other => panic!("{bad:?}: {other:?}"),
            }
        }
    }

    #[test]
    fn equal_faces_are_one_and_flat_ones_none() {
        let turned = "f 1/1 2/2 3/3 4/4\nf 3/1 4/2 1/3 2/4\nf 1/1 1/2 2/3\n";
        let (mesh, notes) = Mesh::parse(&format!("{QUAD}{turned}"), "turned", 1.0, 1.0).unwrap();
        assert_eq!((mesh.triangles.len(), notes.equal_faces, notes.flat_faces), (2, 2, 1));
    }

    /// 10 000 equal quads loaded and put into a scene within a second, 200 000 at all.
    #[test]
    fn heaps_of_equal_faces_load() {
        for (count, seconds) in [(10_000, 1.0), (200_000, 60.0)] {
            let text = QUAD.to_string() + &"f 1/1 2/2 3/3 4/4\n".repeat(count);
            let begun = std::time::Instant::now();
            let (mesh, notes) = Mesh::parse(&text, "heap", 1.0, 1.0).unwrap();
            assert_eq!((mesh.triangles.len(), notes.equal_faces), (2, 2 * count - 2));
            let scene = crate::Scene::new(mesh, Vec::new(), crate::Environment::constant(1.0));
            assert!(scene.meet(Vec3::new(0.1, 0.1, 1.0), -Vec3::Z).is_some());
            let time = begun.elapsed().as_secs_f64();
            assert!(time < seconds, "{count}: {time} s");
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
