//! The hairs of a cloth as a layer: how many a line meets, and how one scatters.

use super::paths::Escaped;
use super::{Told, parts};
use crate::cloth::{HairKind, HairRoots};
use crate::error::SimError;
use crate::rays::path::walk;
use crate::rays::{FiberSurface, Hit, Medium, PathEnd, Surfaces, Trace};
use nalgebra::Vector3;
use plywave::cloth::making::{
    ClothPlies, HAIR_AZIMUTHS, HAIR_COSINES, HAIR_NODES, HairLayer, SIGMA_PER_UM, SIGMAS, azimuth, class_of_hairs,
    once, once_through,
};
use plywave::cloth::{ClothCurves, ClothSpec, LineHits};
use plywave::math::hash::SplitMix64;
use plywave::math::vec3::{cross, dot, sub};
use plywave::spec::YarnSpec;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

/// Hairs that are grown to see what plies hide of them, and most cells that are grown.
const HAIRS: f64 = 4000.0;
const MAX_CELLS: usize = 4096;
const SEED: u64 = 0x68_6169;
/// Rays by kind and view.
const RAYS: usize = 1 << 18;
/// Directions of a first hair's light that are looked at.
const LOOKS: usize = 4;
/// Most directions drawn for one that is kept.
const MAX_DRAWN: usize = 1000;

/// A piece of a hair that is seen from a direction.
struct Seen {
    /// Projected area that plies do not hide [um2], summed over the pieces up to it.
    sum: f64,
    along: [f64; 3],
    w: [f64; 3],
    radius_um: f64,
    second: bool,
}

/// The layer of a cloth's hairs; `None` where the spec has none.
pub(super) fn hair_layer(
    spec_text: &str,
    curves: &ClothCurves,
    plies: &ClothPlies,
    told: Told<'_>,
) -> Result<Option<HairLayer>, SimError> {
    let spec = ClothSpec::parse(spec_text, "cloth (its spec)")?;
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
    let grown = parts("hairs", side * side, told, |cell| {
        let cell = [(cell / side) as i32, (cell % side) as i32];
        let of = |yarn: usize| (yarn, roots.grow(yarn, cell, SEED));
        (0..curves.yarns.len()).map(of).collect::<Vec<_>>()
    })?;
    let all: Vec<_> = grown.iter().flatten().flat_map(|(yarn, hairs)| hairs.iter().map(|h| (*yarn, h))).collect();
    let whole = area_um2 * (side * side) as f64;
    // By view of the face and of the back, what is seen by kind.
    let views = parts("hairs that are seen", 2 * HAIR_COSINES, told, |view| {
        let mut rng = SplitMix64(SEED + view as u64);
        let z = ((view % HAIR_COSINES) as f64 + 0.5) / HAIR_COSINES as f64;
        let z = if view < HAIR_COSINES { z } else { -z };
        let mut seen: [Vec<Seen>; 2] = [Vec::new(), Vec::new()];
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
                plies.lines.hits_while(middle, w.map(|v| v as f32), &mut hits, |hit| plies.passes(hit));
                let free: f64 = hits.as_slice().iter().map(|hit| f64::from(plies.r_d(hit))).product();
                let sine = (1.0 - dot(along, w).powi(2)).max(0.0).sqrt();
                let area = 2.0 * hair.radius_um * length * sine * free;
                let sum = seen[kind].last().map_or(0.0, |seen| seen.sum) + area;
                seen[kind].push(Seen { sum, along, w, radius_um: hair.radius_um, second: hair.second });
            }
        }
        seen
    })?;
    let mut area = [[[0.0; HAIR_COSINES]; 2]; 2];
    for (view, kinds) in views.iter().enumerate() {
        for (kind, seen) in kinds.iter().enumerate() {
            let all = seen.last().map_or(0.0, |seen| seen.sum);
            area[view / HAIR_COSINES][kind][view % HAIR_COSINES] = (all / whole) as f32;
        }
    }
    let scatter = parts("light of hairs", 2 * HAIR_COSINES, told, |at| {
        let (kind, view) = (at / HAIR_COSINES, at % HAIR_COSINES);
        let Some(surfaces) = surfaces.get(kind) else { return Vec::new() };
        scattered([&views[view][kind], &views[HAIR_COSINES + view][kind]], surfaces, SEED + at as u64)
    })?;
    let mut nodes: Vec<[f32; SIGMAS]> = scatter.concat();
    for (kind, nodes) in nodes.chunks_exact_mut(HAIR_NODES).enumerate() {
        make_symmetric(nodes, std::array::from_fn(|view| area[0][kind][view] + area[1][kind][view]));
    }
    nodes.resize(2 * HAIR_NODES, [0.0; SIGMAS]);
    Ok(Some(HairLayer::new(area, nodes)))
}

/// Makes densities times the areas that are seen symmetric in view and light, which noise and what plies hide
/// make them not, and keeps the energies of clear fibers (Sinkhorn's scaling).
fn make_symmetric(nodes: &mut [[f32; SIGMAS]], area: [f32; HAIR_COSINES]) {
    const STEPS: usize = 40;
    if area.iter().any(|a| *a <= 0.0) {
        return;
    }
    let row = 2 * HAIR_COSINES * HAIR_AZIMUTHS;
    // Light to the cosine j is in part HAIR_COSINES + j on the viewer's side, in HAIR_COSINES - 1 - j on the
    // other.
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

/// Densities of the light that hairs seen from the face and from the back scatter, by
/// `[light][azimuth]`.
fn scattered(seen: [&[Seen]; 2], surfaces: &Surfaces, seed: u64) -> Vec<[f32; SIGMAS]> {
    let mut sums = vec![[0.0f64; SIGMAS]; 2 * HAIR_COSINES * HAIR_AZIMUTHS];
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut even = SplitMix64(seed);
    let wholes = seen.map(|seen| seen.last().map_or(0.0, |seen| seen.sum));
    let whole = wholes[0] + wholes[1];
    let mut rays = 0;
    for _ in 0..if whole > 0.0 { RAYS } else { 0 } {
        let at = even.next_f64() * whole;
        let (of, at) = if at < wholes[0] { (seen[0], at) } else { (seen[1], at - wholes[0]) };
        let piece = &of[of.partition_point(|piece| piece.sum < at).min(of.len() - 1)];
        let h = 2.0 * even.next_f64() - 1.0;
        let Some((d, length_um)) = by_one(piece, h, surfaces.of(piece.second), &mut rng) else { continue };
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

/// Where a ray goes that comes from the viewer to a piece of a hair at offset h over its radius, and its
/// length in the fiber as it counts for absorption [um].
fn by_one(piece: &Seen, h: f64, surface: &FiberSurface, rng: &mut Pcg64Mcg) -> Option<([f64; 3], f64)> {
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
    // From twice the radius away.
    let away = 2.0 * piece.radius_um / wx.max(1e-6);
    let pos = Vector3::new((away * wx) as f32, (h * piece.radius_um) as f32, (away * wz) as f32);
    let dir = Vector3::new(-wx as f32, 0.0, -wz as f32);
    let trace = |pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium| round(radius, pos, dir, medium);
    let (d, length_um) = match walk(trace, |_| surface, pos, dir, rng, |_, _, _| ()) {
        PathEnd::Reflected { dir, .. } => (dir, 0.0),
        PathEnd::High { dir, length_um, .. } => (dir, f64::from(length_um)),
        PathEnd::Miss | PathEnd::Killed => return None,
    };
    let d = [f64::from(d.x), f64::from(d.y), f64::from(d.z)];
    Some((std::array::from_fn(|k| axes[0][k] * d[0] + axes[1][k] * d[1] + axes[2][k] * d[2]), length_um))
}

/// The wall of a round, solid fiber about z that a ray hits.
fn round(radius: f32, pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium) -> Trace {
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

/// What becomes of light in the layer of a side.
pub(super) enum Through {
    /// It leaves the cloth, or goes on to the plies.
    Out,
    In,
    /// It was only looked at, or ends.
    Looked,
    Over,
}

/// A layer of hairs that light is in.
pub(super) struct InLayer<'a> {
    pub hairs: &'a HairLayer,
    /// 0 over the face.
    pub side: usize,
    /// Share of the layer that lies above the light.
    pub above: f32,
}

impl InLayer<'_> {
    /// Follows light in direction `d`, of a path from direction `a`, through the layer.
    pub(super) fn follow(
        mut self,
        gone: &mut Escaped,
        d: &mut [f32; 3],
        (a, is_followed): ([f32; 3], bool),
        number: &mut dyn FnMut() -> f32,
    ) -> Through {
        let up = if self.side == 0 { 1.0 } else { -1.0 };
        loop {
            let is_out = d[2] * up > 0.0;
            let depth = self.hairs.depth(self.side, d[2]);
            let all = depth[0] + depth[1];
            let left = if is_out { self.above } else { 1.0 - self.above };
            let step = -(1.0 - number()).max(f32::MIN_POSITIVE).ln();
            if step >= all * left {
                return if is_out { Through::Out } else { Through::In };
            }
            self.above += if is_out { -step } else { step } / all;
            let kind = usize::from(number() * all >= depth[0]);
            if gone.orders == 0 {
                self.look(gone, kind, is_out, a, number);
                if !is_followed {
                    gone.orders = 1;
                    return Through::Looked;
                }
            }
            let is_first = gone.orders == 0;
            let is_behind = is_out && is_first;
            let Some(light) = self.draw(kind, *d, number) else { return Through::Over };
            let (w, p) = light;
            let share = |k: usize| (p[k] / p[0]).min(1.0);
            if is_first {
                gone.sent_up = w[2] * a[2] > 0.0;
                gone.first = std::array::from_fn(share);
                // All that goes to the plies is caught, even what then passes them.
                gone.orders += usize::from(gone.sent_up == is_behind);
            }
            gone.orders += 1;
            gone.kinds = 3;
            for (k, weight) in gone.weight[kind].iter_mut().enumerate() {
                *weight *= share(k);
            }
            *d = w;
            if gone.is_over() {
                return Through::Over;
            }
        }
    }

    /// Looks at the light of a hair of a kind that a beam from `a` hits first.
    fn look(&self, gone: &mut Escaped, kind: usize, is_behind: bool, a: [f32; 3], number: &mut dyn FnMut() -> f32) {
        gone.class = class_of_hairs(kind, is_behind);
        let all = self.hairs.depth(self.side, a[2]).iter().sum::<f32>();
        let hit = -(-all).exp_m1();
        let per = 4.0 * std::f32::consts::PI / LOOKS as f32;
        for _ in 0..LOOKS {
            let w = on_sphere(number);
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
                gone.scattered[k] += per * p[k];
                gone.caught[usize::from(!is_up)][k] += per * p[k] * (1.0 - free);
            }
        }
    }

    /// Density of light that comes from `a` and goes to `w`.
    fn scattered(&self, kind: usize, a: [f32; 3], w: [f32; 3]) -> [f32; SIGMAS] {
        let light = if a[2] < 0.0 { -w[2] } else { w[2] };
        self.hairs.scattered(kind, a[2], light, azimuth(a, w))
    }

    /// A direction of the light that a hair scatters of light in direction `d`, with its density by
    /// absorption; drawn for clear fibers.
    fn draw(&self, kind: usize, d: [f32; 3], number: &mut dyn FnMut() -> f32) -> Option<([f32; 3], [f32; SIGMAS])> {
        let a = d.map(|v| -v);
        let most = self.hairs.most(kind, a[2]);
        (0..MAX_DRAWN).find_map(|_| {
            let w = on_sphere(number);
            let p = self.scattered(kind, a, w);
            (number() * most < p[0]).then_some((w, p))
        })
    }
}

/// A direction, even over the sphere.
fn on_sphere(number: &mut dyn FnMut() -> f32) -> [f32; 3] {
    let z = 2.0 * number() - 1.0;
    let (sin, cos) = (std::f32::consts::TAU * number()).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    [r * cos, r * sin, z]
}
