//! Lookup of the points of a mesh by their positions on the cloth: a grid over the cloth lists the triangles
//! of each cell.

use crate::scene::Frame;
use crate::surface::mesh::Mesh;
use glam::{DVec2, Vec3};

/// Largest number of cells along a side of the grid.
const MAX_SIDE: f64 = 1024.0;

/// The triangles of a mesh in a grid over the cloth.
pub struct UvPlaces<'a> {
    mesh: &'a Mesh,
    low: DVec2,
    cell_um: DVec2,
    counts: [usize; 2],
    /// Start of each cell in `triangles`; `triangles` lists the cells' triangles in order.
    first: Vec<u32>,
    triangles: Vec<u32>,
    /// Total area of all triangles, on the cloth [um2] and in the scene [mm2].
    areas: [f64; 2],
}

impl<'a> UvPlaces<'a> {
    /// Builds the grid of a mesh.
    pub fn new(mesh: &'a Mesh) -> UvPlaces<'a> {
        let uv = |corner: u32| DVec2::from(mesh.uv_um[corner as usize].map(f64::from));
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let mut areas = [0.0; 2];
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(uv);
            (low, high) = (low.min(a).min(b).min(c), high.max(a).max(b).max(c));
            let [p, q, r] = triangle.map(|corner| mesh.positions[corner as usize].as_dvec3());
            areas[0] += 0.5 * (b - a).perp_dot(c - a).abs();
            areas[1] += 0.5 * (q - p).cross(r - p).length();
        }
        let side = (mesh.triangles.len() as f64).sqrt().ceil().clamp(1.0, MAX_SIDE);
        let cell_um = ((high - low) / side).max(DVec2::splat(1e-3));
        let counts = [side as usize; 2];
        let mut grid = UvPlaces { mesh, low, cell_um, counts, first: Vec::new(), triangles: Vec::new(), areas };
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        for (i, triangle) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(uv);
            let ([x0, y0], [x1, y1]) = (grid.cell(a.min(b).min(c)), grid.cell(a.max(b).max(c)));
            for y in y0..=y1 {
                pairs.extend((x0..=x1).map(|x| ((y * counts[0] + x) as u32, i as u32)));
            }
        }
        pairs.sort_unstable();
        grid.first = (0..=(counts[0] * counts[1]) as u32)
            .map(|cell| pairs.partition_point(|(of, _)| *of < cell) as u32)
            .collect();
        grid.triangles = pairs.into_iter().map(|(_, triangle)| triangle).collect();
        grid
    }

    fn cell(&self, at: DVec2) -> [usize; 2] {
        let f = (at - self.low) / self.cell_um;
        [0, 1].map(|k| (f[k].max(0.0) as usize).min(self.counts[k] - 1))
    }

    /// Corners with the smallest and largest coordinates of the cloth on the mesh [um].
    pub fn bounds_um(&self) -> [[f64; 2]; 2] {
        let high = self.low + self.cell_um * DVec2::new(self.counts[0] as f64, self.counts[1] as f64);
        [self.low.to_array(), high.to_array()]
    }

    /// Area of the cloth on the mesh [um2].
    pub fn cloth_um2(&self) -> f64 {
        self.areas[0]
    }

    /// Micrometers of cloth per millimeter of the scene: the root of the ratio of total areas.
    pub fn um_per_mm(&self) -> f64 {
        (self.areas[0] / self.areas[1].max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Whether triangles may overlap a rectangle of the cloth, given by its smallest and largest corner [um].
    pub fn covers(&self, [low, high]: [[f64; 2]; 2]) -> bool {
        let [all_low, all_high] = self.bounds_um();
        if (0..2).any(|k| high[k] < all_low[k] || low[k] > all_high[k]) {
            return false;
        }
        let ([x0, y0], [x1, y1]) = (self.cell(low.into()), self.cell(high.into()));
        (y0..=y1).any(|y| {
            let row = y * self.counts[0];
            self.first[row + x0] < self.first[row + x1 + 1]
        })
    }

    /// Calls `found` with each point of the mesh at this position on the cloth [um] and its axes, as in
    /// [`crate::SurfacePoint`]. A mesh with overlapping texture coordinates has several such points.
    pub fn at(&self, uv_um: [f64; 2], mut found: impl FnMut(Vec3, Frame)) {
        let at = DVec2::from(uv_um);
        let [low, high] = self.bounds_um().map(DVec2::from);
        if at.cmplt(low).any() || at.cmpgt(high).any() {
            return;
        }
        let [x, y] = self.cell(at);
        let cell = y * self.counts[0] + x;
        for i in &self.triangles[self.first[cell] as usize..self.first[cell + 1] as usize] {
            let corners = self.mesh.triangles[*i as usize].map(|c| c as usize);
            let [a, b, c] = corners.map(|c| DVec2::from(self.mesh.uv_um[c].map(f64::from)));
            let area = (b - a).perp_dot(c - a);
            let weights = [(b - at).perp_dot(c - at), (c - at).perp_dot(a - at), (a - at).perp_dot(b - at)];
            let weights = weights.map(|w| (w / area) as f32);
            if area == 0.0 || weights.iter().any(|w| *w < 0.0) {
                continue;
            }
            let [p, q, r] = corners.map(|c| self.mesh.positions[c]);
            let face = (q - p).cross(r - p).normalize_or_zero();
            let normals = corners.map(|c| self.mesh.normals[c]);
            let mean = normals[0] * weights[0] + normals[1] * weights[1] + normals[2] * weights[2];
            let normal = mean.normalize_or(if face.dot(mean) < 0.0 { -face } else { face });
            let (d, e) = ((b - a).as_vec2(), (c - a).as_vec2());
            let along = ((q - p) * e.y - (r - p) * d.y) * (area as f32).signum();
            let along = (along - normal * normal.dot(along)).normalize_or(normal.any_orthonormal_vector());
            let point = p * weights[0] + q * weights[1] + r * weights[2];
            found(point, Frame { axes: [along, normal.cross(along), normal] });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3A;

    /// Points and axes on a folded sheet equal those of the rays that hit it there.
    #[test]
    fn places_are_those_that_rays_hit() {
        let mesh = Mesh::folded(10.0);
        let places = UvPlaces::new(&mesh);
        let (scene, _) = crate::Setup::Furnace.scene(10.0, Some(mesh.clone()), None);
        let mut hits = 0;
        for i in 0..400 {
            let (x, y) = (0.019 * i as f32 - 3.9, (0.37 * i as f32) % 9.8 - 4.9);
            let Some(hit) = scene.meet(Vec3::new(x, y, 50.0), Vec3::new(0.0, 0.0, -1.0)) else { continue };
            let mut all = Vec::new();
            places.at(hit.uv_um.map(f64::from), |point, frame| all.push((point, frame)));
            assert!(!all.is_empty(), "{:?}", hit.uv_um);
            let near = |point: &Vec3| (*point - hit.position).length() < 1e-4;
            let (_, frame) = all.iter().find(|(point, _)| near(point)).expect("the point of the ray");
            let off = (0..3).map(|k| Vec3A::from(frame.axes[k] - hit.frame.axes[k]).length()).fold(0.0, f32::max);
            assert!(off < 0.02, "{off}");
            hits += 1;
        }
        assert!(hits > 300, "{hits}");
        let area = 1e4f64 * 1e4;
        assert!((places.cloth_um2() / area - 1.0).abs() < 1e-3, "{}", places.cloth_um2());
        assert!(places.covers([[10.0, 10.0], [20.0, 20.0]]) && !places.covers([[-900.0, 0.0], [-800.0, 1.0]]));
        let mut none = 0;
        places.at([-1.0, 5.0], |_, _| none += 1);
        assert_eq!(none, 0);
    }
}
