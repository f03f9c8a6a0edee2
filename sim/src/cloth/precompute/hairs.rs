//! The hairs of a cloth as a scattering layer on its face and its back: its optical depth and its phase
//! function.
//!
//! Hairs are grown on a sample of cells. Their projected area on a side of the middle plane that plies do
//! not occlude gives the optical depth by the cosine of a direction. Rays traced through single fibers give
//! the phase function by cosines of view and light, relative azimuth and absorption. `InLayer` follows paths
//! of light through the layer.

use super::paths::Escaped;
use super::{Progress, parts};
use crate::cloth::{HairKind, HairRoots};
use crate::error::SimError;
use crate::rays::path::walk;
use crate::rays::{FiberSurface, Hit, Medium, PathEnd, Surfaces, Trace};
use nalgebra::Vector3;
use plywave::cloth::geometry::ClothPlies;
use plywave::cloth::light::{
    HAIR_AZIMUTHS, HAIR_COSINES, HAIR_NODES, HAIR_TEXELS, HairField, HairLayer, SIGMA_PER_UM, SIGMAS, azimuth,
    class_of_hairs, once, once_through,
};
use plywave::cloth::{ClothCurves, Lattice, LineHits};
use plywave::math::hash::SplitMix64;
use plywave::math::vec3::{cross, dot, sub};
use plywave::spec::YarnSpec;
use plywave_textile::ClothSpec;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

/// Number of hairs that are grown to measure their occlusion by plies, and maximum number of cells.
const HAIRS: f64 = 4000.0;
const MAX_CELLS: usize = 4096;
const SEED: u64 = 0x68_6169;
/// Size of a texel of the tile of hairs over the radius of a hair, and parts of a texel along each side
/// that are drawn.
const TEXEL: f64 = 0.8;
/// Height of a hair's axis over a ply, in radii of the hair, below which it lies on it.
const LYING: f64 = 4.0;
const FINER: usize = 3;
/// Number of rays for each kind and view.
const RAYS: usize = 1 << 18;
/// Parts of the cosine and of the azimuth in each of which an outgoing direction of the first hair is
/// sampled; its occluded and scattered energies are found from them.
const FIRST_PARTS: [usize; 2] = [8, 4];
/// Maximum number of directions drawn until one is accepted.
const MAX_DRAWN: usize = 1000;

/// A piece of a hair that is visible from a direction.
struct VisiblePiece {
    /// Projected area that plies do not occlude [um2], summed over the pieces up to this one.
    sum: f64,
    /// Unit direction of the piece.
    along: [f64; 3],
    /// Unit direction to the viewer.
    w: [f64; 3],
    radius_um: f64,
    /// Whether its fiber is the second one of a blend.
    second: bool,
}

/// Computes the layer of hairs of a cloth, even over it, and the roots of its hairs; `None` if the spec has
/// no hairs.
pub(super) fn hair_layer<'a>(
    spec: &ClothSpec,
    curves: &'a ClothCurves,
    plies: &ClothPlies,
    progress: Progress<'_>,
) -> Result<Option<(HairLayer, HairRoots<'a>)>, SimError> {
    let yarns = spec.yarns();
    let mut kinds = Vec::new();
    let mut surfaces = Vec::new();
    for (kind, model) in plies.models.iter().enumerate() {
        let ply = YarnSpec::parse(&model.data().spec_text, "model (its spec)")?;
        let hairs = yarns.get(kind).or(yarns.first()).and_then(|yarn| yarn.hairs);
        kinds.push(hairs.map(|hairs| HairKind::new(hairs, &ply)));
        surfaces.push(Surfaces::of_spec(&ply));
    }
    if kinds.iter().all(Option::is_none) {
        return Ok(None);
    }
    let roots = HairRoots::new(curves, kinds)?;
    let area_um2 = plies.lattice.area_um2();
    let cells = (HAIRS / roots.mean_count(area_um2).max(1e-9)).ceil().clamp(1.0, MAX_CELLS as f64) as usize;
    let side = (cells as f64).sqrt().ceil() as usize;
    let grown = parts("hairs", side * side, progress, |cell| {
        let cell = [(cell / side) as i32, (cell % side) as i32];
        let of = |yarn: usize| (yarn, roots.grow(yarn, cell, SEED));
        (0..curves.yarns.len()).map(of).collect::<Vec<_>>()
    })?;
    let all: Vec<_> = grown.iter().flatten().flat_map(|(yarn, hairs)| hairs.iter().map(|h| (*yarn, h))).collect();
    let whole = area_um2 * (side * side) as f64;
    // Visible pieces by view, those of the face before those of the back, and by kind of yarn.
    let views = parts("hairs that are seen", 2 * HAIR_COSINES, progress, |view| {
        let mut rng = SplitMix64(SEED + view as u64);
        let z = ((view % HAIR_COSINES) as f64 + 0.5) / HAIR_COSINES as f64;
        let z = if view < HAIR_COSINES { z } else { -z };
        let mut visible: [Vec<VisiblePiece>; 2] = [Vec::new(), Vec::new()];
        let mut hits = LineHits::default();
        for (yarn, hair) in &all {
            let kind = (curves.yarns[*yarn].kind as usize).min(plies.kinds - 1);
            for ends in hair.points_um.windows(2) {
                let step = sub(ends[1], ends[0]);
                let length = dot(step, step).sqrt();
                if length < 1e-9 {
                    continue;
                }
                let along = step.map(|v| v / length);
                let (sin, cos) = (TAU * rng.next_f64()).sin_cos();
                let r = (1.0 - z * z).sqrt();
                let w = [r * cos, r * sin, z];
                let middle: [f32; 3] = std::array::from_fn(|k| (0.5 * (ends[0][k] + ends[1][k])) as f32);
                // Pieces beyond the middle plane, seen through gaps, are those of the other side.
                if middle[2] * z as f32 <= 0.0 {
                    continue;
                }
                plies.lines.hits_while(middle, w.map(|v| v as f32), &mut hits, |hit| plies.passes(hit));
                let free: f64 = hits.as_slice().iter().map(|hit| f64::from(plies.r_d(hit))).product();
                let sine = (1.0 - dot(along, w).powi(2)).max(0.0).sqrt();
                let area = 2.0 * hair.radius_um * length * sine * free;
                let sum = visible[kind].last().map_or(0.0, |piece| piece.sum) + area;
                visible[kind].push(VisiblePiece { sum, along, w, radius_um: hair.radius_um, second: hair.second });
            }
        }
        visible
    })?;
    let mut area = [[[0.0; HAIR_COSINES]; 2]; 2];
    for (view, kinds) in views.iter().enumerate() {
        for (kind, visible) in kinds.iter().enumerate() {
            let all = visible.last().map_or(0.0, |piece| piece.sum);
            area[view / HAIR_COSINES][kind][view % HAIR_COSINES] = (all / whole) as f32;
        }
    }
    let scatter = parts("light of hairs", 2 * HAIR_COSINES, progress, |at| {
        let (kind, view) = (at / HAIR_COSINES, at % HAIR_COSINES);
        let Some(surfaces) = surfaces.get(kind) else { return Vec::new() };
        scattered([&views[view][kind], &views[HAIR_COSINES + view][kind]], surfaces, SEED + at as u64)
    })?;
    let mut nodes: Vec<[f32; SIGMAS]> = scatter.concat();
    for (kind, nodes) in nodes.chunks_exact_mut(HAIR_NODES).enumerate() {
        make_symmetric(nodes, std::array::from_fn(|view| area[0][kind][view] + area[1][kind][view]));
    }
    nodes.resize(2 * HAIR_NODES, [0.0; SIGMAS]);
    Ok(Some((HairLayer::new(area, nodes), roots)))
}

/// A visible piece of a hair: where it starts, its step, its radius [um], and the share of it that plies do
/// not occlude.
type Stroke = ([f64; 3], [f64; 3], f64, f64);

/// Draws the hairs of a tile of cells that stand free, as they are seen along the normal: those over the
/// middle plane from the face, those under it from the back. A hair whose axis is within some radii of a ply
/// below it lies: its shadow is where its light is.
pub(super) fn hair_field(
    roots: &HairRoots<'_>,
    curves: &ClothCurves,
    plies: &ClothPlies,
    progress: Progress<'_>,
) -> Result<HairField, SimError> {
    // Texels along a side of the fine picture.
    const FINE: usize = HAIR_TEXELS * FINER;
    let lattice = &plies.lattice;
    let wanted_um = roots.mean_radius_um() * TEXEL * HAIR_TEXELS as f64;
    let cells = lattice.cell_um.map(|v| (wanted_um / v[0].hypot(v[1])).round().max(1.0) as u32);
    // `[cell][side]`: the strokes that stand free, and the area of all.
    let drawn = parts("hairs of a tile", (cells[0] * cells[1]) as usize, progress, |cell| {
        let cell = [cell as i32 % cells[0] as i32, cell as i32 / cells[0] as i32];
        let mut hits = LineHits::default();
        let mut sides = [(Vec::<Stroke>::new(), 0.0), (Vec::new(), 0.0)];
        for hair in (0..curves.yarns.len()).flat_map(|yarn| roots.grow(yarn, cell, SEED ^ 1)) {
            for ends in hair.points_um.windows(2) {
                let step = sub(ends[1], ends[0]);
                let middle: [f32; 3] = std::array::from_fn(|k| (ends[0][k] + 0.5 * step[k]) as f32);
                let (side, up) = if middle[2] < 0.0 { (1, -1.0) } else { (0, 1.0) };
                let (strokes, all) = &mut sides[side];
                plies.lines.hits_while(middle, [0.0, 0.0, up], &mut hits, |hit| plies.passes(hit));
                let seen: f64 = hits.as_slice().iter().map(|hit| f64::from(plies.r_d(hit))).product();
                *all += step[0].hypot(step[1]) * seen * hair.radius_um;
                plies.lines.hits(middle, [0.0, 0.0, -up], &mut hits);
                let below = hits.as_slice().first().map_or(f64::INFINITY, |hit| f64::from(hit.enter_um));
                if below >= LYING * hair.radius_um {
                    strokes.push((ends[0], step, hair.radius_um, seen));
                }
            }
        }
        sides
    })?;
    let sides = parts("strokes of hairs", 2, progress, |side| {
        let mut free = vec![1.0f32; FINE * FINE];
        let (mut heights, mut areas, mut all) = (0.0, 0.0, 0.0);
        for (strokes, of_cell) in drawn.iter().map(|sides| &sides[side]) {
            all += of_cell;
            for stroke in strokes {
                let (from, step, radius_um, seen) = stroke;
                let area = step[0].hypot(step[1]) * seen * radius_um;
                (heights, areas) = (heights + area * (from[2] + 0.5 * step[2]), areas + area);
                draw(&mut free, lattice, cells, *stroke);
            }
        }
        let covered = |at: usize| {
            let (x, y) = (at % HAIR_TEXELS * FINER, at / HAIR_TEXELS * FINER);
            let fine = (0..FINER * FINER).map(|i| free[(y + i / FINER) * FINE + x + i % FINER]);
            (15.0 * (1.0 - fine.sum::<f32>() / (FINER * FINER) as f32)).round() as u8
        };
        let half = HAIR_TEXELS * HAIR_TEXELS / 2;
        let shares: Vec<u8> = (0..half).map(|i| covered(2 * i) | covered(2 * i + 1) << 4).collect();
        let per = |sum: f64, of: f64| if of > 0.0 { (sum / of) as f32 } else { 0.0 };
        (shares, per(heights, areas), per(areas, all))
    })?;
    let [face, back] = [&sides[0], &sides[1]];
    Ok(HairField::new(lattice, cells, [face.1, back.1], [face.2, back.2], &[&face.0[..], &back.0].concat()))
}

/// Draws a stroke into the picture of a tile, which repeats.
fn draw(free: &mut [f32], lattice: &Lattice, cells: [u32; 2], (from, step, radius_um, seen): Stroke) {
    const FINE: usize = HAIR_TEXELS * FINER;
    let length = step[0].hypot(step[1]);
    if length < 1e-6 || seen < 1e-3 {
        return;
    }
    let along = [step[0] / length, step[1] / length];
    let per_cell = cells.map(|cells| FINE as f64 / f64::from(cells));
    let texel = |x: f64, y: f64| {
        let at = lattice.fractions(x, y);
        [at[0] * per_cell[0], at[1] * per_cell[1]]
    };
    let corners = [(0.0, -1.0), (0.0, 1.0), (length, -1.0), (length, 1.0)].map(|(s, t)| {
        texel(from[0] + s * along[0] - t * radius_um * along[1], from[1] + s * along[1] + t * radius_um * along[0])
    });
    let range = |k: usize| {
        let (low, high) = corners.iter().fold((f64::MAX, f64::MIN), |(a, b), c| (a.min(c[k]), b.max(c[k])));
        low.floor() as i64..=high.ceil() as i64
    };
    let [a, b] = lattice.cell_um;
    let index = |i: i64| i.rem_euclid(FINE as i64) as usize;
    for j in range(1) {
        for i in range(0) {
            let [u, v] = [(i as f64 + 0.5) / per_cell[0], (j as f64 + 0.5) / per_cell[1]];
            let p = [u * a[0] + v * b[0] - from[0], u * a[1] + v * b[1] - from[1]];
            let (s, t) = (p[0] * along[0] + p[1] * along[1], p[1] * along[0] - p[0] * along[1]);
            if (0.0..length).contains(&s) && t.abs() < radius_um {
                free[index(j) * FINE + index(i)] *= 1.0 - seen as f32;
            }
        }
    }
}

/// Makes densities times visible areas symmetric in view and light, as reciprocity demands. Noise and
/// occlusion by plies break that symmetry. The energies of clear fibers are preserved (Sinkhorn's scaling).
fn make_symmetric(nodes: &mut [[f32; SIGMAS]], area: [f32; HAIR_COSINES]) {
    const STEPS: usize = 40;
    if area.iter().any(|a| *a <= 0.0) {
        return;
    }
    let row = 2 * HAIR_COSINES * HAIR_AZIMUTHS;
    // Light at the cosine j is in row HAIR_COSINES + j on the viewer's side and in row HAIR_COSINES - 1 - j
    // on the other side.
    let at = |i: usize, half: usize, j: usize, m: usize| {
        let light = if half == 0 { HAIR_COSINES + j } else { HAIR_COSINES - 1 - j };
        i * row + light * HAIR_AZIMUTHS + m
    };
    let energies = |nodes: &[[f32; SIGMAS]]| -> [f32; HAIR_COSINES] {
        std::array::from_fn(|i| nodes[i * row..(i + 1) * row].iter().map(|p| p[0]).sum())
    };
    let before = energies(nodes);
    for i in 0..HAIR_COSINES {
        for j in 0..=i {
            for (half, m) in (0..2).flat_map(|half| (0..HAIR_AZIMUTHS).map(move |m| (half, m))) {
                for k in 0..SIGMAS {
                    let mean = 0.5 * (area[i] * nodes[at(i, half, j, m)][k] + area[j] * nodes[at(j, half, i, m)][k]);
                    nodes[at(i, half, j, m)][k] = mean / area[i];
                    nodes[at(j, half, i, m)][k] = mean / area[j];
                }
            }
        }
    }
    for _ in 0..STEPS {
        let now = energies(nodes);
        let scale: [f32; HAIR_COSINES] = std::array::from_fn(|i| (before[i] / now[i].max(1e-12)).sqrt());
        for i in 0..HAIR_COSINES {
            for (half, j) in (0..2).flat_map(|half| (0..HAIR_COSINES).map(move |j| (half, j))) {
                for m in 0..HAIR_AZIMUTHS {
                    nodes[at(i, half, j, m)].iter_mut().for_each(|p| *p *= scale[i] * scale[j]);
                }
            }
        }
    }
}

/// `[light][azimuth][sigma]`: scattered densities [1/sr] of the hairs visible from the face and from the
/// back.
fn scattered(visible: [&[VisiblePiece]; 2], surfaces: &Surfaces, seed: u64) -> Vec<[f32; SIGMAS]> {
    let mut sums = vec![[0.0f64; SIGMAS]; 2 * HAIR_COSINES * HAIR_AZIMUTHS];
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut even = SplitMix64(seed);
    let wholes = visible.map(|pieces| pieces.last().map_or(0.0, |piece| piece.sum));
    let whole = wholes[0] + wholes[1];
    let mut rays = 0;
    for _ in 0..if whole > 0.0 { RAYS } else { 0 } {
        let at = even.next_f64() * whole;
        let (of, at) = if at < wholes[0] { (visible[0], at) } else { (visible[1], at - wholes[0]) };
        let piece = &of[of.partition_point(|piece| piece.sum < at).min(of.len() - 1)];
        let h = 2.0 * even.next_f64() - 1.0;
        let Some((d, length_um)) = scatter_ray(piece, h, surfaces.of(piece.second), &mut rng) else { continue };
        rays += 1;
        let up = if piece.w[2] < 0.0 { -1.0 } else { 1.0 };
        let light = (((d[2] * up) + 1.0) * HAIR_COSINES as f64) as usize;
        let turn = azimuth(piece.w.map(|v| v as f32), d.map(|v| v as f32));
        let turn = (f64::from(turn) / PI * HAIR_AZIMUTHS as f64) as usize;
        let node = light.min(2 * HAIR_COSINES - 1) * HAIR_AZIMUTHS + turn.min(HAIR_AZIMUTHS - 1);
        for (sum, sigma) in sums[node].iter_mut().zip(SIGMA_PER_UM) {
            *sum += (-f64::from(sigma) * length_um).exp();
        }
    }
    let per = (HAIR_COSINES * HAIR_AZIMUTHS) as f64 / (TAU * f64::from(rays.max(1)));
    sums.iter().map(|sum| sum.map(|v| (v * per) as f32)).collect()
}

/// Traces a ray from the viewer that hits a piece of a hair at the offset `h` over its radius. Returns the
/// outgoing direction and the absorbing length within the fiber [um].
fn scatter_ray(piece: &VisiblePiece, h: f64, surface: &FiberSurface, rng: &mut Pcg64Mcg) -> Option<([f64; 3], f64)> {
    let z = piece.along;
    let side = cross(z, piece.w);
    let sine = dot(side, side).sqrt();
    if sine < 1e-6 {
        return None;
    }
    let y = side.map(|v| v / sine);
    let x = cross(y, z);
    let radius = piece.radius_um as f32;
    let axes = [x, y, z];
    let [wx, _, wz] = axes.map(|axis| dot(axis, piece.w));
    // The ray starts at twice the radius from the axis.
    let away = 2.0 * piece.radius_um / wx.max(1e-6);
    let pos = Vector3::new((away * wx) as f32, (h * piece.radius_um) as f32, (away * wz) as f32);
    let dir = Vector3::new(-wx as f32, 0.0, -wz as f32);
    let trace = |pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium| intersect_round(radius, pos, dir, medium);
    let (d, length_um) = match walk(trace, |_| surface, pos, dir, rng, |_, _, _| ()) {
        PathEnd::Reflected { dir, .. } => (dir, 0.0),
        PathEnd::High { dir, length_um, .. } => (dir, f64::from(length_um)),
        PathEnd::Miss | PathEnd::Killed => return None,
    };
    let d = [f64::from(d.x), f64::from(d.y), f64::from(d.z)];
    Some((std::array::from_fn(|k| axes[0][k] * d[0] + axes[1][k] * d[1] + axes[2][k] * d[2]), length_um))
}

/// Intersection of a ray with the wall of a round, solid fiber about z.
fn intersect_round(radius: f32, pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium) -> Trace {
    let a = dir.x * dir.x + dir.y * dir.y;
    let b = pos.x * dir.x + pos.y * dir.y;
    let c = pos.x * pos.x + pos.y * pos.y - radius * radius;
    let root = b * b - a * c;
    let is_inside = matches!(medium, Medium::Fiber(_));
    if a < 1e-12 {
        return if is_inside { Trace::Lost } else { Trace::Escaped };
    }
    if root <= 0.0 {
        return if is_inside { Trace::Lost } else { Trace::Escaped };
    }
    let root = root.sqrt();
    let t = if is_inside { (-b + root) / a } else { (-b - root) / a };
    if t <= 0.0 {
        return if is_inside { Trace::Lost } else { Trace::Escaped };
    }
    let at = pos + dir * t;
    let normal = Vector3::new(at.x, at.y, 0.0).normalize();
    Trace::Hit(Hit { t_um: t, normal, fiber: 0, lumen: false })
}

/// Outcome of a path through the layer of one side.
pub(super) enum Through {
    /// The path leaves the cloth.
    Out,
    /// The path continues to the plies.
    In,
    /// The path ends after its first order was sampled.
    FirstOrder,
    /// The path is dropped.
    Over,
}

/// Position of a path within a layer of hairs.
pub(super) struct InLayer<'a> {
    pub hairs: &'a HairLayer,
    /// 0 for the layer over the face, 1 for that over the back.
    pub side: usize,
    /// Share of the layer, 0 to 1, that lies outside of the position.
    pub above: f32,
}

impl InLayer<'_> {
    /// Follows a path that entered the cloth from direction `a` and now has the direction `d` through the
    /// layer, with exponential free paths in optical depth.
    pub(super) fn follow(
        mut self,
        path: &mut Escaped,
        d: &mut [f32; 3],
        (a, is_followed): ([f32; 3], bool),
        number: &mut dyn FnMut() -> f32,
    ) -> Through {
        let up = if self.side == 0 { 1.0 } else { -1.0 };
        loop {
            let is_out = d[2] * up > 0.0;
            let depth = self.hairs.depth(self.side, d[2]);
            let all = depth[0] + depth[1];
            let remaining = if is_out { self.above } else { 1.0 - self.above };
            let step = -(1.0 - number()).max(f32::MIN_POSITIVE).ln();
            if step >= all * remaining {
                return if is_out { Through::Out } else { Through::In };
            }
            self.above += if is_out { -step } else { step } / all;
            let kind = usize::from(number() * all >= depth[0]);
            if path.orders == 0 {
                self.sample_first(path, kind, is_out, a, number);
                if !is_followed {
                    path.orders = 1;
                    return Through::FirstOrder;
                }
            }
            let is_first = path.orders == 0;
            let is_behind = is_out && is_first;
            let Some(light) = self.draw(kind, *d, number) else { return Through::Over };
            let (w, p) = light;
            let share = |k: usize| (p[k] / p[0]).min(1.0);
            if is_first {
                path.sent_up = w[2] * a[2] > 0.0;
                path.first = std::array::from_fn(share);
                // All light sent to the plies counts as occluded, even if it then passes between them.
                path.orders += usize::from(path.sent_up == is_behind);
            }
            path.orders += 1;
            path.kinds = 3;
            for (k, weight) in path.weight[kind].iter_mut().enumerate() {
                *weight *= share(k);
            }
            *d = w;
            if path.is_over() {
                return Through::Over;
            }
        }
    }

    /// Samples the occluded and scattered energies of a hair of this kind that a beam from `a` hits first.
    fn sample_first(
        &self,
        path: &mut Escaped,
        kind: usize,
        is_behind: bool,
        a: [f32; 3],
        number: &mut dyn FnMut() -> f32,
    ) {
        path.class = class_of_hairs(kind, is_behind);
        let all = self.hairs.depth(self.side, a[2]).iter().sum::<f32>();
        let hit = -(-all).exp_m1();
        let [rows, columns] = FIRST_PARTS;
        let per = 4.0 * std::f32::consts::PI / (rows * columns) as f32;
        for part in 0..rows * columns {
            let [u, v] = [(part / columns, rows), (part % columns, columns)]
                .map(|(part, of)| (part as f32 + number()) / of as f32);
            let w = on_sphere(u, v);
            let p = self.scattered(kind, a, w);
            let is_up = w[2] * a[2] > 0.0;
            let [first, second] = self.hairs.depth(self.side, w[2]);
            let once = match (is_up, is_behind) {
                (true, false) => once(all, first + second),
                (false, true) => once_through(all, first + second),
                _ => 0.0,
            };
            let free = once / hit.max(1e-12);
            for k in 0..SIGMAS {
                path.scattered[k] += per * p[k];
                path.caught[usize::from(!is_up)][k] += per * p[k] * (1.0 - free);
            }
        }
    }

    /// `[sigma]`: phase function [1/sr] of light that comes from `a` and leaves in direction `w`.
    fn scattered(&self, kind: usize, a: [f32; 3], w: [f32; 3]) -> [f32; SIGMAS] {
        let light = if a[2] < 0.0 { -w[2] } else { w[2] };
        self.hairs.scattered(kind, a[2], light, azimuth(a, w))
    }

    /// Draws a direction for light with direction `d` that a hair scatters, with its density at each node of
    /// absorption [1/sr]. Clear fibers are sampled, by rejection.
    fn draw(&self, kind: usize, d: [f32; 3], number: &mut dyn FnMut() -> f32) -> Option<([f32; 3], [f32; SIGMAS])> {
        let a = d.map(|v| -v);
        let max = self.hairs.most(kind, a[2]);
        (0..MAX_DRAWN).find_map(|_| {
            let w = on_sphere(number(), number());
            let p = self.scattered(kind, a, w);
            (number() * max < p[0]).then_some((w, p))
        })
    }
}

/// A uniform direction on the sphere from two uniform numbers.
fn on_sphere(u: f32, v: f32) -> [f32; 3] {
    let z = 2.0 * u - 1.0;
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    [r * cos, r * sin, z]
}
