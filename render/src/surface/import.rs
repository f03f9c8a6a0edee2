//! Imports the faces of an OBJ file as a mesh, in double precision until all vertices are scaled.
//!
//! Vertices at the same position are merged, whatever their texture coordinates, so that computed normals
//! are continuous across seams and duplicate faces are detected. Two positions are the same if they agree
//! within 2^-24 of the mesh's extent, which single precision cannot resolve. Polygons are triangulated in the
//! plane of their mean normal (Newell's method): as a fan if one covers them, by ear clipping (`earcut`) if
//! they are concave.

use crate::RenderError;
use crate::memory_limit::{check_memory, read_file};
use crate::surface::mesh::Mesh;
use crate::surface::obj::{Corner, NONE, Obj};
use crate::surface::smooth::Smooth;
use earcut::Earcut;
use earcut::utils3d::project3d_to_2d;
use glam::DVec3;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Largest OBJ file that is read [bytes].
const MAX_BYTES: u64 = 1 << 30;
/// Memory per byte of an OBJ file, at most: a corner of four characters becomes a triangle, its key, its
/// edges and its vertex.
const MEMORY_PER_BYTE: u64 = 40;
/// Number of steps over the extent of a mesh; positions within one step count as equal.
const STEPS: f64 = (1u32 << 24) as f64;
/// Minimum ratio of a mesh's extent to the spacing of double precision at its coordinates: coordinates must
/// resolve a millionth of the mesh.
const MIN_SPACINGS: f64 = (1u32 << 20) as f64;
/// Number of corners from which a fan is tried.
const FAN_STARTS: usize = 8;
/// Largest number of corners of a face that needs ear clipping.
const MAX_CORNERS: usize = 1 << 20;
/// Largest relative difference between a polygon's area and that of its triangles that counts as rounding; a
/// larger difference means that the polygon crosses itself.
const CROSSED: f64 = 1e-6;

/// Notes on the import of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeshNotes {
    /// Millimeters of the scene per unit of the file.
    pub mm_per_unit: f64,
    /// Point of the file that becomes the origin of the scene.
    pub middle: [f64; 3],
    /// Faces omitted as duplicates of others at the same positions.
    pub equal: FaceCount,
    /// Faces omitted because their area vanishes in single precision.
    pub flat: FaceCount,
    /// Self-intersecting faces, which are triangulated approximately.
    pub crossed: FaceCount,
}

/// Number of faces of some kind in a file, and the first of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaceCount {
    /// Number of faces.
    pub count: usize,
    /// Index of the first, from 1.
    pub first: usize,
    /// Line of the first, from 1.
    pub line: usize,
}

impl FaceCount {
    fn add(&mut self, face: usize, line: usize) {
        if self.count == 0 {
            (self.first, self.line) = (face, line);
        }
        self.count += 1;
    }
}

impl Mesh {
    /// Reads a Wavefront OBJ file with texture coordinates: polygons of any shape, with normals where corners
    /// have them; missing normals are computed. One unit of the texture is `cloth_um` of cloth; the mesh is
    /// scaled and moved into a box of `size_mm` about the origin. Duplicate faces are removed, since
    /// coincident sheets have no defined front. Faces without area are omitted. Names, materials and colors
    /// are ignored.
    ///
    /// # Errors
    /// [`RenderError::Mesh`] with the line number for invalid text or a face without uv; for a mesh so far
    /// from the origin that double precision does not resolve its corners; and for a file without faces.
    /// [`RenderError::Io`]; [`RenderError::TooLarge`].
    pub fn obj(path: &Path, cloth_um: f32, size_mm: f32) -> Result<(Mesh, MeshNotes), RenderError> {
        let name = path.display().to_string();
        let bytes = read_file(path, MAX_BYTES)?;
        check_memory(&format!("{name}: this mesh"), MEMORY_PER_BYTE * bytes.len() as u64)?;
        Mesh::of_obj(&Obj::read(&bytes, &name)?, &name, f64::from(cloth_um), f64::from(size_mm))
    }

    fn of_obj(obj: &Obj, name: &str, cloth_um: f64, size_mm: f64) -> Result<(Mesh, MeshNotes), RenderError> {
        let bad = |line: usize, what: &str| RenderError::Mesh { file: name.to_string(), line, what: what.into() };
        let places = Places::new(obj, name, size_mm)?;
        let mut notes = MeshNotes { mm_per_unit: places.mm_per_unit, middle: places.middle, ..MeshNotes::default() };
        let mut triangles: Vec<[Corner; 3]> = Vec::new();
        let (mut cutter, mut known, mut ring) = (Cutter::default(), HashSet::new(), Vec::new());
        for (k, (line, corners)) in obj.faces().enumerate() {
            let turned = places.ring(corners, &mut ring);
            if ring.len() > MAX_CORNERS {
                return Err(bad(line, &format!("a face of {} corners; at most {MAX_CORNERS}, cut it", ring.len())));
            }
            let crossed = cutter.cut(ring.iter().map(|i| places.at(corners[*i])));
            let (mut retained, mut there) = (false, false);
            for [i, j, k] in &cutter.triangles {
                let triangle = if turned { [i, k, j] } else { [i, j, k] }.map(|i| corners[ring[*i as usize]]);
                let [a, b, c] = triangle.map(|c| places.at(c).as_vec3());
                if (b - a).cross(c - a).length_squared() <= 0.0 {
                    continue;
                }
                let mut key = triangle.map(|c| places.of[c.position as usize]);
                key.sort_unstable();
                if known.insert(key) {
                    retained = true;
                    triangles.push(triangle);
                } else {
                    there = true;
                }
            }
            match (retained, there) {
                (true, _) if crossed => notes.crossed.add(k + 1, line),
                (true, _) => {}
                (false, true) => notes.equal.add(k + 1, line),
                (false, false) => notes.flat.add(k + 1, line),
            }
        }
        if triangles.is_empty() {
            return Err(bad(notes.flat.line, "no face has an area"));
        }
        for corner in triangles.iter().flatten() {
            if !obj.uvs[corner.uv as usize].iter().all(|x| ((x * cloth_um) as f32).is_finite()) {
                let number = corner.uv + 1;
                return Err(bad(0, &format!("texture coordinate {number} is not finite, or too large for its cloth")));
            }
        }
        let bare = triangles.iter().flatten().any(|corner| !has_normal(corner, obj));
        let smooth = bare.then(|| {
            let at: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|c| places.of[c.position as usize])).collect();
            Smooth::new(&at, &places.points)
        });
        let mut mesh = Mesh::default();
        // Vertices by position, uv and normal; the normal is one from the file, or the computed one of a
        // side.
        let mut vertices: HashMap<[u32; 4], u32> = HashMap::new();
        for (t, triangle) in triangles.iter().enumerate() {
            mesh.triangles.push(triangle.map(|corner| {
                let side = smooth.as_ref().filter(|_| !has_normal(&corner, obj)).map(|smooth| smooth.side(t));
                let normal = side.map_or([corner.normal, NONE], |side| [NONE, side]);
                let next = mesh.positions.len() as u32;
                let at = *vertices.entry([corner.position, corner.uv, normal[0], normal[1]]).or_insert(next);
                if at == next {
                    mesh.positions.push(places.at(corner).as_vec3());
                    mesh.uv_um.push(obj.uvs[corner.uv as usize].map(|x| (x * cloth_um) as f32));
                    mesh.normals.push(match (&smooth, side) {
                        (Some(smooth), Some(side)) => smooth.normal(places.of[corner.position as usize], side),
                        _ => DVec3::from(obj.normals[corner.normal as usize]).normalize().as_vec3(),
                    });
                }
                at
            }));
        }
        Ok((mesh, notes))
    }
}

/// Merged and scaled positions of a file's vertices.
struct Places {
    /// Positions [mm] relative to the middle of the mesh.
    points: Vec<DVec3>,
    /// Index of each vertex's position; [`NONE`] for a vertex that no face uses.
    of: Vec<u32>,
    /// Millimeters per unit of the file.
    mm_per_unit: f64,
    /// Middle of the mesh in the file's coordinates.
    middle: [f64; 3],
}

impl Places {
    /// Centers and scales the vertices of faces, and merges those at the same position.
    fn new(obj: &Obj, name: &str, size_mm: f64) -> Result<Places, RenderError> {
        let bad = |line: usize, what: String| RenderError::Mesh { file: name.to_string(), line, what };
        let at = |i: u32| DVec3::from(obj.positions[i as usize]);
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (line, corners) in obj.faces() {
            for corner in corners {
                if corner.uv == NONE {
                    return Err(bad(line, "a face without uv; give texture coordinates (f v/vt ..)".into()));
                }
                if !at(corner.position).is_finite() {
                    return Err(bad(line, format!("vertex {} is not finite", corner.position + 1)));
                }
                (low, high) = (low.min(at(corner.position)), high.max(at(corner.position)));
            }
        }
        if low.x > high.x {
            return Err(bad(0, "no faces; give a Wavefront OBJ file with faces (f v/vt ..)".into()));
        }
        let (extent, middle) = ((high - low).max_element(), 0.5 * low + 0.5 * high);
        let farthest = low.abs().max(high.abs()).max_element();
        let spacing = farthest.next_up() - farthest;
        if extent <= 0.0 || !extent.is_finite() {
            return Err(bad(0, "all faces lie in one point, or farther apart than numbers reach".into()));
        }
        if extent < MIN_SPACINGS * spacing {
            return Err(bad(
                0,
                format!(
                    "too far from the origin: at coordinates of {farthest:e} double precision has steps of {spacing:.1e}, and the \
                     mesh is {extent:.3} wide; subtract an offset from its vertices"
                ),
            ));
        }
        let mut places = Places {
            points: Vec::new(),
            of: vec![NONE; obj.positions.len()],
            mm_per_unit: size_mm / extent,
            middle: middle.to_array(),
        };
        let mut known: HashMap<[i32; 3], u32> = HashMap::new();
        for corner in obj.faces().flat_map(|(_, corners)| corners) {
            let slot = &mut places.of[corner.position as usize];
            if *slot == NONE {
                let p = (at(corner.position) - middle) / extent;
                let key = (p * STEPS).round().to_array().map(|x| x as i32);
                *slot = *known.entry(key).or_insert_with(|| {
                    places.points.push(p * size_mm);
                    places.points.len() as u32 - 1
                });
            }
        }
        Ok(places)
    }

    fn at(&self, corner: Corner) -> DVec3 {
        self.points[self.of[corner.position as usize] as usize]
    }

    /// Indices of the face's corners without repetitions, and whether their order is reversed. A ring of more
    /// than three corners begins at the lowest position and continues to its lower neighbor, so that
    /// duplicate faces are triangulated alike, whatever their first corner and winding.
    fn ring(&self, corners: &[Corner], ring: &mut Vec<usize>) -> bool {
        let place = |i: usize| self.of[corners[i].position as usize];
        ring.clear();
        ring.extend(0..corners.len());
        ring.dedup_by_key(|i| place(*i));
        while ring.len() > 1 && ring.last().map(|i| place(*i)) == ring.first().map(|i| place(*i)) {
            ring.pop();
        }
        if ring.len() > 3 {
            let first = (0..ring.len()).min_by_key(|k| place(ring[*k])).unwrap_or(0);
            ring.rotate_left(first);
            if place(ring[ring.len() - 1]) < place(ring[1]) {
                ring[1..].reverse();
                return true;
            }
        }
        false
    }
}

/// Whether a corner has a nonzero normal.
fn has_normal(corner: &Corner, obj: &Obj) -> bool {
    corner.normal != NONE && {
        let normal = DVec3::from(obj.normals[corner.normal as usize]);
        normal.is_finite() && normal.try_normalize().is_some()
    }
}

/// Triangulator of polygons, with its buffers.
#[derive(Default)]
struct Cutter {
    /// Triangles of the last polygon, as indices into its ring, with the winding of the face.
    triangles: Vec<[u32; 3]>,
    earcut: Earcut<f64>,
    points: Vec<[f64; 3]>,
    flat: Vec<[f64; 2]>,
    ears: Vec<u32>,
}

impl Cutter {
    /// Triangulates the polygon of a ring of positions; returns whether it crosses itself. A polygon without
    /// area may have no triangles.
    fn cut(&mut self, ring: impl ExactSizeIterator<Item = DVec3> + Clone) -> bool {
        self.triangles.clear();
        let count = ring.len();
        if count == 3 {
            self.triangles.push([0, 1, 2]);
        }
        let Some(first) = ring.clone().next().filter(|_| count > 3) else { return false };
        let size = ring.clone().map(|p| (p - first).abs().max_element()).fold(f64::MIN_POSITIVE, f64::max);
        self.points.clear();
        self.points.extend(ring.map(|p| ((p - first) / size).to_array()));
        if !project3d_to_2d(&self.points, count, &mut self.flat) {
            return false;
        }
        // Twice the area of a triangle, positive if it has the winding of the polygon.
        let area = |t: [usize; 3]| {
            let [a, b, c] = t.map(|i| self.flat[i]);
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        };
        let fan = |start: usize| (1..count - 1).map(move |k| [start, (start + k) % count, (start + k + 1) % count]);
        if let Some(start) = (0..count.min(FAN_STARTS)).find(|start| fan(*start).all(|t| area(t) > 0.0)) {
            self.triangles.extend(fan(start).map(|t| t.map(|i| i as u32)));
            return false;
        }
        self.earcut.earcut(self.flat.iter().copied(), &[], &mut self.ears);
        let (mut covered, mut whole) = (0.0, 0.0);
        for ear in self.ears.as_chunks::<3>().0 {
            let doubled = area(ear.map(|i| i as usize));
            covered += doubled.abs();
            self.triangles.push(if doubled < 0.0 { [ear[0], ear[2], ear[1]] } else { *ear });
        }
        fan(0).for_each(|t| whole += area(t));
        (covered - whole).abs() > CROSSED * whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::f64::consts::TAU;

    const QUAD: &str = "v 0 0 0\nv 2 0 0 # a corner\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

    fn read(text: &str, cloth_um: f64, size_mm: f64) -> Result<(Mesh, MeshNotes), RenderError> {
        Mesh::of_obj(&Obj::read(text.as_bytes(), "file")?, "file", cloth_um, size_mm)
    }

    fn area(mesh: &Mesh) -> f32 {
        let doubled = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            (b - a).cross(c - a).length()
        };
        0.5 * mesh.triangles.iter().map(doubled).sum::<f32>()
    }

    fn count(count: usize, first: usize, line: usize) -> FaceCount {
        FaceCount { count, first, line }
    }

    #[test]
    fn sheets_are_centered_scaled_and_joined() {
        let (mesh, notes) = read(&format!("{QUAD}f 1/1 2/2 3/3 4/-1\n"), 500.0, 10.0).unwrap();
        assert_eq!((mesh.triangles.len(), mesh.positions.len()), (2, 4));
        assert_eq!(mesh.uv_um[2], [500.0, 500.0]);
        assert!((mesh.positions[1].x - 5.0).abs() < 1e-5 && (mesh.normals[0] - Vec3::Z).length() < 1e-6);
        assert_eq!(notes, MeshNotes { mm_per_unit: 5.0, middle: notes.middle, ..MeshNotes::default() });
        // Groups share their vertices: normals are smooth across the groups of a fold.
        let fold = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\ng a\nf 1/1 2/1 3/1\ng b\nf 2/1 4/1 3/1\n";
        assert_eq!(read(fold, 1.0, 1.0).unwrap().0.positions.len(), 4);
    }

    #[test]
    fn meshes_that_cannot_be_are_refused() {
        let three = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
        for (bad, line, words) in [
            ("", 0, "no faces"),
            ("v 0 0 0\nf 1 1 1\n", 2, "without uv"),
            ("v 0 0 0\nv nan 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n", 5, "vertex 2 is not finite"),
            ("v 0 0 0\nvt 0 0\nf 1/1 1/1 1/1\n", 0, "one point"),
            ("v 0 0 0\nv 1 1 1\nv 3 3 3\nvt 0 0\n\nf 1/1 2/1 3/1\nf 2/1 1/1\n", 6, "no face has an area"),
            (&format!("{three}vt inf 0\nf 1/1 2/2 3/1\n"), 0, "texture coordinate 2"),
            // A cloth of width 0.3 at 1e11, where the spacing of double precision is 1.5e-5.
            ("v 1e11 0 0\nv 100000000000.3 0 0\nv 1e11 0.3 0\nvt 0 0\nf 1/1 2/1 3/1\n", 0, "steps of 1.5e-5"),
        ] {
            match read(bad, 1.0, 1.0) {
                Err(RenderError::Mesh { line: at, what, .. }) => {
                    assert!(at == line && what.contains(words), "{bad:?}: {at}: {what}");
                }
                other => panic!("{bad:?}: {other:?}"),
            }
        }
        // Values that no face uses are not checked.
        assert!(read(&format!("{three}v nan inf 1e300\nvt nan nan\nf 1/1 2/1 3/1\n"), 1.0, 1.0).is_ok());
    }

    #[test]
    fn equal_faces_are_one_and_flat_ones_none() {
        // The file has duplicates of a face: reversed, with another first corner, and as two triangles; then
        // a face without area and one of two corners.
        let again = "f 1/1 2/2 3/3 4/4\nf 3/1 4/2 1/3 2/4\nf 4/1 3/2 2/3 1/4\nf 2/1 3/2 4/3 1/4\nf 1/1 2/2 3/3\nf 1/1 3/2 4/3\nf 1/1 1/2 2/3\nf 1/1 2/1\n";
        let (mesh, notes) = read(&format!("{QUAD}{again}"), 1.0, 1.0).unwrap();
        assert_eq!((mesh.triangles.len(), notes.equal, notes.flat), (2, count(5, 2, 10), count(2, 7, 15)));
        assert_eq!(mesh.uv_um[0], [0.0, 0.0]);
    }

    /// 10 000 equal quads load into a scene within a second; 200 000 load as well.
    #[test]
    fn heaps_of_equal_faces_load() {
        for (count, seconds) in [(10_000, 1.0), (200_000, 60.0)] {
            let text = QUAD.to_string() + &"f 1/1 2/2 3/3 4/4\n".repeat(count);
            let begun = std::time::Instant::now();
            let (mesh, notes) = read(&text, 1.0, 1.0).unwrap();
            assert_eq!((mesh.triangles.len(), notes.equal.count), (2, count - 1));
            let scene = crate::Scene::new(mesh, Vec::new(), crate::Environment::constant(1.0));
            assert!(scene.meet(Vec3::new(0.1, 0.1, 1.0), -Vec3::Z).is_some());
            let time = begun.elapsed().as_secs_f64();
            assert!(time < seconds, "{count}: {time} s");
        }
    }

    /// Triangles of polygons of known area, from each first corner, with either winding, in tilted planes far
    /// from the origin, cover the area once and have the winding of the face.
    #[test]
    fn polygons_are_covered_whatever_their_shape() {
        let comb: Vec<[f64; 2]> = (0..40).flat_map(|k| [[f64::from(k), 1.0 + f64::from(k % 2) * 8.0]]).collect();
        let comb = [&[[0.0, 0.0]], &comb[..], &[[39.0, 0.0]]].concat();
        let comb_area = 39.0 * 5.0;
        let ring: Vec<[f64; 2]> = (0..1000).map(|k| (TAU * f64::from(k) / 1000.0).sin_cos().into()).collect();
        let star: Vec<[f64; 2]> = (0..10)
            .map(|k| <[f64; 2]>::from((TAU * f64::from(k) / 10.0).sin_cos()).map(|x| x * f64::from(1 + k % 2)))
            .collect();
        // An edge in both directions joins the hole of a frame to its outline.
        let frame = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [0.0, 4.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [3.0, 3.0],
            [3.0, 1.0],
            [1.0, 1.0],
        ];
        let polygons: [(&str, &[[f64; 2]], f64); 8] = [
            ("an L", &[[-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0]], 3.0),
            ("an arrow", &[[0.0, 0.0], [2.0, -1.0], [1.0, 0.0], [2.0, 1.0]], 1.0),
            (
                "in line",
                &[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0], [0.0, 2.0], [0.0, 1.0]],
                4.0,
            ),
            ("twice there", &[[0.0, 0.0], [0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [2.0, 2.0], [0.0, 2.0], [0.0, 0.0]], 4.0),
            ("a comb", &comb, comb_area),
            ("a circle", &ring, 500.0 * (TAU / 1000.0).sin()),
            ("a star", &star, 10.0 * (TAU / 10.0).sin()),
            ("a frame", &frame, 12.0),
        ];
        for (name, polygon, want) in polygons {
            for (start, reverse, tilt) in
                [(0, false, false), (1, true, true), (2, false, true), (3, true, false), (5, false, true)]
            {
                let mut corners = polygon.to_vec();
                corners.rotate_left(start % polygon.len());
                if reverse {
                    corners.reverse();
                }
                let mut text = String::from("vt 0 0\n");
                for [x, y] in &corners {
                    let [x, y, z] = if tilt { [0.6 * x + 4.5e6, *y - 5e5, 0.8 * x] } else { [*x, *y, 0.0] };
                    text += &format!("v {x} {y} {z}\n");
                }
                text += "f";
                (1..=corners.len()).for_each(|k| text += &format!(" {k}/1"));
                let (mesh, notes) = read(&text, 1.0, 1.0).unwrap();
                let got = f64::from(area(&mesh)) / (notes.mm_per_unit * notes.mm_per_unit);
                assert!((got / want - 1.0).abs() < 1e-4, "{name} from {start}: {got} of {want}");
                assert_eq!([notes.flat, notes.crossed, notes.equal], [FaceCount::default(); 3], "{name} from {start}");
                // Areas are signed about the face's normal, so that reversed overlaps are detected.
                let up = DVec3::new(if tilt { -0.8 } else { 0.0 }, 0.0, if tilt { 0.6 } else { 1.0 }).as_vec3();
                let signed: Vec<f32> = mesh
                    .triangles
                    .iter()
                    .map(|t| {
                        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
                        (b - a).cross(c - a).dot(up)
                    })
                    .collect();
                let turned = shoelace(&corners) < 0.0;
                assert!(
                    signed.iter().all(|s| (*s > -1e-7) != turned || s.abs() < 1e-7),
                    "{name} from {start}: {signed:?}"
                );
            }
        }
    }

    fn shoelace(ring: &[[f64; 2]]) -> f64 {
        (0..ring.len())
            .map(|k| ring[k][0] * ring[(k + 1) % ring.len()][1] - ring[k][1] * ring[(k + 1) % ring.len()][0])
            .sum()
    }

    #[test]
    fn faces_that_cross_themselves_are_told() {
        // A pentagram beside a square; a bow tie has no area about its normal.
        let mut text = String::from("vt 0 0\nv 5 0 0\nv 6 0 0\nv 6 1 0\nv 5 1 0\n");
        for k in 0..5 {
            let (y, x) = (TAU * f64::from(2 * k) / 5.0).sin_cos();
            text += &format!("v {x} {y} 0\n");
        }
        text += "f 1/1 2/1 3/1 4/1\nf 5/1 6/1 7/1 8/1 9/1\nf 1/1 3/1 2/1 4/1\n";
        let (_, notes) = read(&text, 1.0, 1.0).unwrap();
        assert_eq!((notes.crossed, notes.flat), (count(1, 2, 12), count(1, 3, 13)));
    }

    /// A survey's sheet of 3 x 3 faces, 0.3 m wide at some 4 500 km, equals the same sheet at the origin to
    /// single precision.
    #[test]
    fn places_far_from_the_origin_are_kept() {
        let sheet = |[x0, y0]: [f64; 2]| {
            let mut text = String::from("vt 0 0\n");
            for k in 0..16 {
                text += &format!("v {:.3} {:.3} 0\n", x0 + 0.1 * f64::from(k % 4), y0 + 0.1 * f64::from(k / 4));
            }
            for k in (0..12).filter(|k| k % 4 < 3) {
                text += &format!("f {}/1 {}/1 {}/1 {}/1\n", k + 1, k + 2, k + 6, k + 5);
            }
            read(&text, 1.0, 20.0).unwrap()
        };
        let (near, far) = (sheet([0.0; 2]), sheet([500_000.0, 4_500_000.0]));
        assert_eq!((far.0.triangles.len(), far.1.flat), (18, FaceCount::default()));
        assert_eq!(near.0.triangles, far.0.triangles);
        for (a, b) in near.0.positions.iter().zip(&far.0.positions) {
            assert!((*a - *b).length() < 1e-5, "{a} {b}");
        }
    }

    /// Computed normals depend on positions but not on texture coordinates or vertex indices, on a tube and
    /// at the poles of a ball.
    #[test]
    fn normals_do_not_break_at_seams() {
        let n = 16;
        for twins in [false, true] {
            let (mut text, columns) = (String::new(), if twins { n + 1 } else { n });
            for y in [-1.0, 1.0] {
                for k in 0..columns {
                    let (x, z) = (TAU * f64::from(k) / f64::from(n)).sin_cos();
                    text += &format!("v {x:.6} {y} {z:.6}\n");
                }
            }
            for v in 0..2 {
                (0..=n).for_each(|k| text += &format!("vt {} {v}\n", f64::from(k) / f64::from(n)));
            }
            for k in 0..n {
                let (a, b) = (k + 1, (k + 1) % columns + 1);
                let (c, d) = (k + 1, k + 2);
                text += &format!("f {a}/{c} {b}/{d} {}/{} {}/{}\n", b + columns, d + n + 1, a + columns, c + n + 1);
            }
            let (mesh, _) = read(&text, 1.0, 2.0).unwrap();
            assert_eq!(mesh.positions.len(), 2 * (n as usize + 1));
            for (p, normal) in mesh.positions.iter().zip(&mesh.normals) {
                let radial = Vec3::new(p.x, 0.0, p.z).normalize();
                assert!((*normal - radial).length() < 1e-5, "{p}: {normal}");
            }
        }
        // The poles of the ball have one texture coordinate per face; the normal there is the axis, elsewhere
        // the radius.
        let (n, rows) = (12, 7);
        let (mut text, mut faces) = (String::new(), String::new());
        for j in 0..=rows {
            for i in 0..=n {
                let (sin, cos) = (0.5 * TAU * f64::from(j) / f64::from(rows)).sin_cos();
                let (y, x) = (TAU * f64::from(i % n) / f64::from(n)).sin_cos();
                text += &format!("v {:.9} {:.9} {cos:.9}\nvt {i} {j}\n", sin * x, sin * y);
                if i < n && j < rows {
                    let a = j * (n + 1) + i + 1;
                    let b = a + n + 1;
                    faces += &format!("f {a}/{a} {b}/{b} {}/{} {}/{}\n", b + 1, b + 1, a + 1, a + 1);
                }
            }
        }
        let (mesh, notes) = read(&(text + &faces), 1.0, 2.0).unwrap();
        assert_eq!(notes.flat, FaceCount::default());
        for (p, normal) in mesh.positions.iter().zip(&mesh.normals) {
            let min = if p.z.abs() > 0.999 { 0.999_999 } else { 0.995 };
            assert!(normal.dot(p.normalize()) > min, "{p}: {normal}");
        }
    }

    /// Normals in the file are used; those of length 0 and missing ones are computed.
    #[test]
    fn normals_of_the_file_are_kept_where_there_are_any() {
        let text =
            format!("{QUAD}v 4 0 0\nv 4 1 0\nvn 0.6 0 0.8\nvn 0 0 0\nf 1/1/1 2/2/1 3/3/1 4/4/2\nf 2/2 5/1 6/1 3/3\n");
        let (mesh, _) = read(&text, 1.0, 1.0).unwrap();
        let retained = mesh.normals.iter().filter(|n| (**n - Vec3::new(0.6, 0.0, 0.8)).length() < 1e-6).count();
        let made = mesh.normals.iter().filter(|n| (**n - Vec3::Z).length() < 1e-6).count();
        assert_eq!((retained, made), (3, 5));
    }
}
