//! Sheets with a hem: the cloth is folded under along its four edges, and a seam holds the fold down.

use crate::surface::mesh::Mesh;
use crate::surface::net::Net;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Widths of a hem [mm].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hem {
    /// Width of the cloth that lies below.
    pub width: f32,
    /// Distance of the two layers.
    pub apart: f32,
}

/// Length of a stitch, and distance of the seam from the inner edge of the hem [mm].
const STITCH: f32 = 3.6;
const SEAM: f32 = 1.5;
/// Depth of the dents of the seam over the layers' distance, and their breadth [mm].
const DENT: f32 = 0.3;
const BREADTH: f32 = 1.1;
/// Cells of a mesh around the turn of a hem, and across the layer below.
const TURN_CELLS: usize = 6;
const UNDER_CELLS: usize = 10;

/// A net as a sheet of `size` [mm] of cloth with a hem. Points are scaled to `scale` [mm].
struct Hemmed<'a> {
    net: &'a Net,
    scale: f32,
    size: Vec2,
    hem: Hem,
}

impl Hemmed<'_> {
    /// The point of the net at a position on the cloth [mm].
    fn smooth(&self, at: Vec2) -> Vec3 {
        self.net.at(at.x / self.size.x, at.y / self.size.y) * self.scale
    }

    /// Step of finite differences [mm].
    fn step(&self) -> f32 {
        1e-3 * self.size.min_element()
    }

    fn normal(&self, at: Vec2) -> Vec3 {
        let e = self.step();
        let along = self.smooth(at + Vec2::new(e, 0.0)) - self.smooth(at - Vec2::new(e, 0.0));
        let across = self.smooth(at + Vec2::new(0.0, e)) - self.smooth(at - Vec2::new(0.0, e));
        along.cross(across).normalize_or_zero()
    }

    /// Depth of the seam's dents at a position on the cloth [mm].
    fn dent(&self, at: Vec2) -> f32 {
        let line = self.hem.width - SEAM;
        let inset = at.min(self.size - at);
        let of = |inset: f32, along: f32| {
            let off = (inset - line) / BREADTH;
            (-0.5 * off * off).exp() * (0.5 + 0.5 * (TAU * along / STITCH).cos())
        };
        // Seams end where they cross.
        let of_x = if inset.y > line { of(inset.x, at.y) } else { 0.0 };
        let of_y = if inset.x > line { of(inset.y, at.x) } else { 0.0 };
        DENT * self.hem.apart * of_x.max(of_y)
    }

    /// The upper layer.
    fn top(&self, at: Vec2) -> Vec3 {
        let is_near = at.min(self.size - at).min_element() < self.hem.width + 3.0 * BREADTH;
        let dent = if is_near { self.dent(at) } else { 0.0 };
        if dent > 1e-4 { self.smooth(at) - self.normal(at) * dent } else { self.smooth(at) }
    }

    /// A point of the hem of one side: `edge` is its position on the edge, `outward` the direction away from
    /// the cloth, and `way` the length of cloth from the edge on, around the turn [mm].
    fn under(&self, edge: Vec2, outward: Vec2, way: f32) -> Vec3 {
        let radius = 0.5 * self.hem.apart;
        if way <= 0.0 {
            return self.top(edge + outward * way);
        }
        let inset = (way - PI * radius).max(0.0);
        let at = edge - outward * inset;
        let normal = self.normal(at);
        if inset > 0.0 {
            return self.smooth(at) - normal * (self.hem.apart - self.dent(at));
        }
        let e = self.step();
        let out = self.smooth(at + outward * e) - self.smooth(at - outward * e);
        let (sin, cos) = (way / radius).sin_cos();
        self.smooth(at) + out.normalize_or_zero() * (radius * sin) - normal * (radius * (1.0 - cos))
    }
}

/// A net as a sheet of `size` [mm] of cloth with a hem and meshes of about `cell` [mm]; points of the net are
/// scaled by `scale`.
pub(crate) fn hemmed(net: &Net, scale: f32, size: Vec2, hem: Hem, cell: f32) -> Mesh {
    let sheet = Hemmed { net, scale, size, hem };
    let cells = (size / cell).ceil().max(Vec2::ONE);
    let um = |at: Vec2| (at * 1000.0).to_array();
    let place = |a: Vec2| sheet.top(a * size);
    let mut mesh = Mesh::patch([cells.x as usize, cells.y as usize], place, |a| um(a * size));
    let turn = PI * 0.5 * hem.apart;
    // Sides by the direction away from the cloth; their x axis runs such that their normal goes on.
    for outward in [Vec2::Y, Vec2::NEG_Y, Vec2::X, Vec2::NEG_X] {
        let along = Vec2::new(outward.y, -outward.x);
        let center = 0.5 * size * (Vec2::ONE + outward);
        let half = 0.5 * size.dot(along.abs());
        let of = |a: Vec2, from: f32, to: f32| {
            let way = from + a.y * (to - from);
            // Hems end on the diagonals of the corners.
            let reach = half - (way - turn).max(0.0);
            (center + along * ((2.0 * a.x - 1.0) * reach), way)
        };
        let n = (2.0 * half / cell).ceil() as usize;
        for (m, from, to) in [(TURN_CELLS, 0.0, turn), (UNDER_CELLS, turn, turn + hem.width)] {
            let place = |a: Vec2| {
                let (edge, way) = of(a, from, to);
                sheet.under(edge, outward, way)
            };
            let uv = |a: Vec2| {
                let (edge, way) = of(a, from, to);
                um(edge + outward * way)
            };
            mesh.append(Mesh::patch([n, m], place, uv));
        }
    }
    mesh
}
