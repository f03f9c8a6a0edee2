//! Sheets of cloth with a hem: fallen over a ball, drawn around one, hung, folded.

use crate::surface::drape::{Fall, fallen};
use crate::surface::folds;
use crate::surface::hem::{Hem, hemmed};
use crate::surface::mesh::Mesh;
use glam::Vec2;

/// Distance of a fallen sheet from its support, relative to its width.
const LIFT: f32 = 0.004;

impl Mesh {
    /// A square sheet that has fallen over a ball about the origin, with a hem. The ball's radius is
    /// [`Mesh::BALL`] times the sheet's width, the floor's height [`Mesh::FLOOR`] times that width. The
    /// deterministic simulation takes a second or two.
    pub fn drape(size_mm: f32) -> Mesh {
        let on = Fall { ball: Mesh::BALL + LIFT, floor: Mesh::FLOOR + LIFT, turn: 0.35, pull: 0.0 };
        Mesh::fallen(&on, size_mm)
    }

    /// A square sheet that is drawn around a ball about the origin on a floor, with a hem: see
    /// [`Mesh::WRAPPED`]. The simulation takes as long as that of [`Mesh::drape`].
    pub fn wrapped(size_mm: f32) -> Mesh {
        let (ball, floor) = (Mesh::WRAPPED + LIFT, Mesh::WRAPPED_FLOOR + LIFT);
        Mesh::fallen(&Fall { ball, floor, turn: 0.6, pull: 1.2 }, size_mm)
    }

    fn fallen(on: &Fall, size_mm: f32) -> Mesh {
        let hem = Hem { width: 0.022 * size_mm, apart: 0.5 * LIFT * size_mm };
        hemmed(&fallen(on), size_mm, Vec2::splat(size_mm), hem, size_mm / 400.0)
    }

    /// A curtain in folds in the plane y = 0 about the origin, `size_mm` of cloth wide and [`Mesh::DROP`]
    /// times as long, with a hem; it hangs [`Mesh::HUNG`] times as wide.
    pub fn curtain(size_mm: f32) -> Mesh {
        let hem = Hem { width: 0.035 * size_mm, apart: 0.0012 * size_mm };
        hemmed(
            &folds::curtain(Mesh::HUNG, Mesh::DROP),
            size_mm,
            Vec2::new(1.0, Mesh::DROP) * size_mm,
            hem,
            size_mm / 700.0,
        )
    }

    /// A stack of sheets folded several times, each `size_mm` of cloth long, on the plane z = 0, with hems.
    pub fn stack(size_mm: f32) -> Mesh {
        let mut mesh = Mesh::default();
        let hem = Hem { width: 0.022 * size_mm, apart: 0.0016 * size_mm };
        for (k, net) in folds::stack().iter().enumerate() {
            let size = Vec2::new(1.0, folds::STACK_DEPTH) * size_mm;
            let mut sheet = hemmed(net, size_mm, size, hem, size_mm / 600.0);
            // Each sheet is cut from another place.
            sheet.uv_um.iter_mut().for_each(|uv| uv[0] += k as f32 * 1137.0 * size_mm);
            mesh.append(sheet);
        }
        mesh
    }

    /// Radius of the ball under a drape, relative to the sheet's width.
    pub const BALL: f32 = 0.2;
    /// Height of the floor under a drape relative to the sheet's width; the ball's center is at 0.
    pub const FLOOR: f32 = -0.27;
    /// Radius of a ball wrapped in a sheet, relative to the sheet's width.
    pub const WRAPPED: f32 = 0.23;
    /// Height of the floor under it.
    pub const WRAPPED_FLOOR: f32 = -Mesh::WRAPPED - 0.02;
    /// Width of a hung curtain and its length, relative to the width of its cloth.
    pub const HUNG: f32 = 0.5;
    /// Length of a curtain, relative to the width of its cloth.
    pub const DROP: f32 = 0.7;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheets_face_up() {
        for mesh in [Mesh::flat(10.0), Mesh::drape(10.0), Mesh::folded(10.0), Mesh::curtain(10.0), Mesh::stack(10.0)] {
            let up = mesh.triangles.iter().filter(|t| {
                let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
                let n = (b - a).cross(c - a);
                n.dot(mesh.normals[t[0] as usize]) > 0.0
            });
            assert!(up.count() * 100 >= 99 * mesh.triangles.len());
        }
    }

    /// Lengths along warp and weft over those of the cloth, of the first `triangles` triangles of a sheet:
    /// quantiles at 1 %, 50 % and 99 %.
    fn stretch(mesh: &Mesh, triangles: usize) -> [f32; 3] {
        // The first of the two triangles of a cell has an edge along u and one along v.
        let edges = mesh.triangles[..triangles].iter().step_by(2).flat_map(|t| [[t[0], t[1]], [t[1], t[2]]]);
        let mut ratios: Vec<f32> = edges
            .map(|edge| {
                let [a, b] = edge.map(|k| k as usize);
                let cloth = Vec2::from(mesh.uv_um[a]).distance(Vec2::from(mesh.uv_um[b])) / 1000.0;
                mesh.positions[a].distance(mesh.positions[b]) / cloth
            })
            .collect();
        ratios.sort_by(f32::total_cmp);
        [0.01, 0.5, 0.99].map(|q| ratios[(q * ratios.len() as f32) as usize])
    }

    /// Cloth bends much and stretches little: yarns keep their size. Simulated sheets give in most where
    /// their layers press on each other.
    #[test]
    fn sheets_do_not_stretch() {
        let of = |cells: usize, rows: usize| 2 * cells * rows;
        for (name, mesh, triangles, limit) in [
            ("drape", Mesh::drape(400.0), of(400, 400), 0.12),
            ("ball", Mesh::wrapped(250.0), of(400, 400), 0.16),
            ("curtain", Mesh::curtain(800.0), of(700, 490), 0.01),
            ("stack", Mesh::stack(500.0), of(600, 180), 0.06),
        ] {
            let [low, middle, high] = stretch(&mesh, triangles);
            assert!((middle - 1.0).abs() < 0.005, "{name}: {low} {middle} {high}");
            assert!(low > 1.0 - limit && high < 1.0 + limit, "{name}: {low} {middle} {high}, limit {limit}");
        }
    }
}
