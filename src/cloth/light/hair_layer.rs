//! Hairs of a cloth as a thin scattering layer over each side.
//!
//! A line in direction w passes the layer with probability `exp(-A(z) / z)`, where z is the cosine to the
//! normal and A is the projected area of the visible hairs per area of the cloth, without hairs that plies
//! hide. A hair scatters as one fiber, averaged over the directions of the visible hairs. For a beam from
//! `a`, the singly scattered light that leaves towards `b` on the same side is
//!
//! `f(a, b) = p(a, b) t_a / (t_a + t_b) (1 - exp(-t_a - t_b))`, t = A / z,
//!
//! which, divided by the cosine, is symmetric where A p is. Light that passes all plies reaches the hairs
//! of the other side, and `p(a, b) t_a (exp(-t_b) - exp(-t_a)) / (t_a - t_b)` of it leaves after one hair.
//! Light that goes to the plies or hits another hair counts as intercepted and is part of inter-yarn
//! scattering (`inter_yarn.rs`). The layer is uniform in azimuth. Over the cloth its hairs are strokes
//! (`hair_field.rs`): at a point they intercept more or less than the mean, and scatter as much more or
//! less.

use crate::cloth::light::absorption::{SIGMAS, node_of};
use crate::cloth::light::hair_field::{HairField, HairsHere};
use crate::math::clamp_unit;
use std::f32::consts::{PI, TAU};

/// Number of cosines in a half of the sphere: centers of equal intervals of [0, 1].
pub const HAIR_COSINES: usize = 8;
/// Number of azimuths of the light relative to the viewer's: centers of equal intervals of [0, pi].
pub const HAIR_AZIMUTHS: usize = 12;
/// Number of nodes of one kind: `[view][light, from the other side to the viewer's][azimuth]`.
pub const HAIR_NODES: usize = HAIR_COSINES * 2 * HAIR_COSINES * HAIR_AZIMUTHS;
/// Smallest cosine; lines closer to the plane hit as many hairs as at this cosine.
const MIN_COSINE: f32 = 1e-3;
/// Share of the light that reaches a layer, below which its hairs count as even.
const MIN_ARRIVES: f32 = 1e-3;

/// Hair layers over the face and the back.
#[derive(Clone, Debug)]
pub struct HairLayer {
    /// `[face, back][kind][cosine]`: projected area of the visible hairs per area of the cloth.
    pub area: [[[f32; HAIR_COSINES]; 2]; 2],
    /// `[kind][node][absorption]`: density of the light that a hair scatters [1/sr], `HAIR_NODES` for each of
    /// two kinds.
    pub scatter: Vec<[f32; SIGMAS]>,
    /// `[kind][view][to the viewer's side, total][absorption]`: integrals of the densities.
    energies: Vec<[[f32; SIGMAS]; 2]>,
    /// Where the hairs lie; `None` if they are even over the cloth.
    pub field: Option<HairField>,
}

/// Interpolates at `x` between the centers of `parts` unit intervals: index of the center below, and weight
/// of the next.
#[inline(always)]
fn part(x: f32, parts: usize) -> (usize, f32) {
    let x = (x - 0.5).max(0.0).min((parts - 1) as f32);
    let at = (x as usize).min(parts - 2);
    (at, x - at as f32)
}

impl HairLayer {
    /// Builds even layers from their areas and `2 HAIR_NODES` densities.
    pub fn new(area: [[[f32; HAIR_COSINES]; 2]; 2], scatter: Vec<[f32; SIGMAS]>) -> HairLayer {
        let per_node = TAU / (HAIR_COSINES * HAIR_AZIMUTHS) as f32;
        let sum = |nodes: &[[f32; SIGMAS]]| std::array::from_fn(|k| per_node * nodes.iter().map(|p| p[k]).sum::<f32>());
        let half = HAIR_COSINES * HAIR_AZIMUTHS;
        let energies = scatter.chunks_exact(2 * half).map(|of| [sum(&of[half..]), sum(of)]).collect();
        HairLayer { area, scatter, energies, field: None }
    }

    /// `[kind]`: mean number of hairs that a line with this cosine to the normal hits on a side; side 0 is
    /// the face.
    #[inline(always)]
    pub fn depth(&self, side: usize, cosine: f32) -> [f32; 2] {
        let z = cosine.abs().clamp(MIN_COSINE, 1.0);
        let (i, s) = part(z * HAIR_COSINES as f32, HAIR_COSINES);
        let [first, second] = &self.area[side];
        [(first[i] + s * (first[i + 1] - first[i])) / z, (second[i] + s * (second[i + 1] - second[i])) / z]
    }

    /// Probability that light in direction `b` passes the hairs of the side on which it leaves.
    #[inline]
    pub fn passes(&self, b: [f32; 3]) -> f32 {
        1.0 - self.hits(usize::from(b[2] < 0.0), b[2])
    }

    /// Probability that a line with this cosine to the normal hits a hair of a side.
    #[inline(always)]
    fn hits(&self, side: usize, cosine: f32) -> f32 {
        let [first, second] = self.depth(side, cosine);
        -(-first - second).exp_m1()
    }

    /// Share of the light to a viewer in direction `a` that hairs of a side intercept, at a point or in the
    /// mean over the cloth.
    #[inline(always)]
    pub(crate) fn seen(&self, side: usize, a: [f32; 3], here: Option<&HairsHere<'_>>) -> f32 {
        let [first, second] = self.depth(side, a[2]);
        here.map_or(-(-first - second).exp_m1(), |here| here.seen(side, a, first + second))
    }

    /// `[absorption]`: density [1/sr] of the light that a hair of a kind scatters, for a viewer at cosine
    /// `view` and light at cosine `light` (negative on the other side) and relative `azimuth` [rad].
    #[inline(always)]
    pub fn scattered(&self, kind: usize, view: f32, light: f32, azimuth: f32) -> [f32; SIGMAS] {
        let (i, s) = part(view.abs() * HAIR_COSINES as f32, HAIR_COSINES);
        let (j, t) = part((light + 1.0) * HAIR_COSINES as f32, 2 * HAIR_COSINES);
        let (m, u) = part(azimuth * (HAIR_AZIMUTHS as f32 / PI), HAIR_AZIMUTHS);
        let first = kind * HAIR_NODES;
        let mut sum = [0.0; SIGMAS];
        for (i, s) in [(i, 1.0 - s), (i + 1, s)] {
            for (j, t) in [(j, 1.0 - t), (j + 1, t)] {
                for (m, u) in [(m, 1.0 - u), (m + 1, u)] {
                    let share = s * t * u;
                    let of = &self.scatter[first + (i * 2 * HAIR_COSINES + j) * HAIR_AZIMUTHS + m];
                    for k in 0..SIGMAS {
                        sum[k] += share * of[k];
                    }
                }
            }
        }
        sum
    }

    /// Upper bound on the density of the light of clear fibers, for a viewer at cosine `view`.
    pub fn most(&self, kind: usize, view: f32) -> f32 {
        let (i, _) = part(view.abs() * HAIR_COSINES as f32, HAIR_COSINES);
        let row = 2 * HAIR_COSINES * HAIR_AZIMUTHS;
        let first = kind * HAIR_NODES + i * row;
        self.scatter[first..first + 2 * row].iter().fold(0.0, |max, p| max.max(p[0]))
    }

    /// `[to the viewer's side, total][absorption]`: energy that a hair of a kind scatters, for a viewer at
    /// cosine `view`.
    fn energies(&self, kind: usize, view: f32) -> [[f32; SIGMAS]; 2] {
        let (i, s) = part(view.abs() * HAIR_COSINES as f32, HAIR_COSINES);
        let [low, high] = [i, i + 1].map(|i| &self.energies[kind * HAIR_COSINES + i]);
        std::array::from_fn(|half| std::array::from_fn(|k| low[half][k] + s * (high[half][k] - low[half][k])))
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        size_of_val(self.scatter.as_slice())
            + size_of_val(self.energies.as_slice())
            + self.field.as_ref().map_or(0, HairField::memory_bytes)
    }
}

/// Angle between the azimuths of two directions [rad], 0 to pi; pi / 2 if either direction is the normal.
#[inline(always)]
pub fn azimuth(a: [f32; 3], b: [f32; 3]) -> f32 {
    let lengths = ((a[0] * a[0] + a[1] * a[1]) * (b[0] * b[0] + b[1] * b[1])).sqrt();
    if lengths < 1e-12 {
        return 0.5 * PI;
    }
    ((a[0] * b[0] + a[1] * b[1]) / lengths).clamp(-1.0, 1.0).acos()
}

/// Share of the beam that hits a hair of the layer and, scattered into the outgoing line, leaves on the side
/// it came from without hitting another hair. `from` and `to` are the mean numbers of hairs along the
/// incident and the outgoing line.
#[inline]
pub fn once(from: f32, to: f32) -> f32 {
    let both = from + to;
    if both < 1e-6 { from } else { from / both * -(-both).exp_m1() }
}

/// As [`once`], for light that leaves on the opposite side of the layer.
#[inline]
pub fn once_through(from: f32, to: f32) -> f32 {
    let off = from - to;
    if off.abs() < 1e-3 {
        return from * (-0.5 * (from + to)).exp();
    }
    from * ((-to).exp() - (-from).exp()) / off
}

/// Hair layer of one side of a cloth, for N absorptions.
#[derive(Clone, Copy, Debug)]
struct SideAt<const N: usize> {
    /// Index of the side: 0 for the face, 1 for the back.
    side: usize,
    /// `[kind]`: mean number of hairs that the beam hits.
    depth: [f32; 2],
    /// Share of the beam that reaches the layer, times what hairs intercept of it here over the mean.
    arrives: f32,
    /// Share of the arriving light that hairs let pass here.
    free: f32,
    /// `[kind][absorption]`: energy that the layer scatters; and, summed over kinds, the part that leaves on
    /// the layer's side of the cloth.
    energy: [[f32; N]; 2],
    out: [f32; N],
    /// Probability of sampling the layer.
    chance: f32,
}

/// The hair layers of a cloth for one direction of the viewer and N absorptions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HairsAt<'a, const N: usize> {
    layer: &'a HairLayer,
    here: Option<HairsHere<'a>>,
    a: [f32; 3],
    /// `[kind][absorption]`: node of absorption and weight of the next.
    nodes: [[(usize, f32); N]; 2],
    /// The viewer's side and the other side.
    sides: [SideAt<N>; 2],
}

impl<'a, const N: usize> HairsAt<'a, N> {
    /// Prepares the layers for a viewer in direction `a`, at a point or in the mean over the cloth;
    /// `passing` is the share of the beam that passes all plies.
    pub(crate) fn new(
        (layer, here): (&'a HairLayer, Option<HairsHere<'a>>),
        a: [f32; 3],
        sigma_per_um: [[f32; N]; 2],
        passing: f32,
    ) -> Self {
        let nodes = sigma_per_um.map(|sigma| sigma.map(node_of));
        let viewer = usize::from(a[2] < 0.0);
        let energies = [0, 1].map(|kind| layer.energies(kind, a[2]));
        let sides = [(viewer, 1.0), (1 - viewer, passing)].map(|(side, arrives)| {
            let depth = layer.depth(side, a[2]);
            let all = depth[0] + depth[1];
            let hits = -(-all).exp_m1();
            // The other layer counts only where light arrives.
            let covered = match &here {
                Some(here) if arrives > MIN_ARRIVES => here.seen(side, a, all),
                _ => hits,
            };
            let hit = arrives * covered;
            let arrives = if hits > 0.0 { hit / hits } else { 0.0 };
            let (mut energy, mut out) = ([[0.0; N]; 2], [0.0; N]);
            for kind in 0..2 {
                let share = if all > 0.0 { hit * depth[kind] / all } else { 0.0 };
                let [to_viewer, whole] = &energies[kind];
                for k in 0..N {
                    let (up, whole) = (interpolate(to_viewer, nodes[kind][k]), interpolate(whole, nodes[kind][k]));
                    energy[kind][k] = share * whole;
                    out[k] += share * if side == viewer { up } else { whole - up };
                }
            }
            SideAt { side, depth, arrives, free: 1.0 - covered, energy, out, chance: 0.0 }
        });
        HairsAt { layer, here, a, nodes, sides }
    }

    /// `[kind][before, behind the plies][absorption]`: energies that the layers scatter.
    pub(crate) fn energies(&self) -> [[[f32; N]; 2]; 2] {
        [0, 1].map(|kind| [0, 1].map(|behind| self.sides[behind].energy[kind]))
    }

    /// Share of the light that passes all plies and then hits no hair behind them.
    pub(crate) fn passes_behind(&self) -> f32 {
        self.sides[1].free
    }

    /// `[viewer's side, other side][absorption]`: energies that leave on the layer's own side of the cloth.
    pub(crate) fn out(&self) -> [[f32; N]; 2] {
        self.sides.map(|side| side.out)
    }

    pub(crate) fn set_chances(&mut self, chances: [f32; 2]) {
        for (side, chance) in self.sides.iter_mut().zip(chances) {
            side.chance = chance;
        }
    }

    pub(crate) fn chance(&self) -> f32 {
        self.sides[0].chance + self.sides[1].chance
    }

    /// Index into `sides` of the layer on the side to which direction `b` leads.
    #[inline]
    fn behind(&self, b: [f32; 3]) -> usize {
        usize::from((b[2] < 0.0) != (self.a[2] < 0.0))
    }

    /// Adds the light that hairs scatter towards `b` on their side of the cloth.
    #[inline(always)]
    pub(crate) fn add(&self, b: [f32; 3], f: &mut [f32; N]) {
        let behind = self.behind(b);
        let of = &self.sides[behind];
        let all = of.depth[0] + of.depth[1];
        let [first, second] = self.layer.depth(of.side, b[2]);
        let once = if behind == 0 { once(all, first + second) } else { once_through(all, first + second) };
        let (light, turn) = (if behind == 0 { b[2].abs() } else { -b[2].abs() }, azimuth(self.a, b));
        for kind in 0..2 {
            if of.arrives * of.depth[kind] > 0.0 {
                let share = of.arrives * of.depth[kind] / all * once;
                let p = self.layer.scattered(kind, self.a[2], light, turn);
                for k in 0..N {
                    f[k] += share * interpolate(&p, self.nodes[kind][k]);
                }
            }
        }
    }

    /// Share of a ply's light in direction `b` that passes the hairs.
    #[inline(always)]
    pub(crate) fn free(&self, b: [f32; 3]) -> f32 {
        let side = usize::from(b[2] < 0.0);
        let [first, second] = self.layer.depth(side, b[2]);
        match &self.here {
            Some(here) => 1.0 - here.shadow(side, b, first + second),
            None => (-first - second).exp(),
        }
    }

    /// Density of [`HairsAt::draw`] times the probability of sampling the layer [1/sr].
    pub(crate) fn pdf(&self, b: [f32; 3]) -> f32 {
        self.sides[self.behind(b)].chance / TAU
    }

    /// Samples a direction uniformly over a half sphere; `u`, below [`HairsAt::chance`], selects the side.
    pub(crate) fn draw(&self, [u, v, w]: [f32; 3]) -> [f32; 3] {
        let of = &self.sides[usize::from(u >= self.sides[0].chance)];
        let z = clamp_unit(v).max(MIN_COSINE);
        let (sin, cos) = (TAU * w).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        [r * cos, r * sin, if of.side == 0 { z } else { -z }]
    }
}

/// Interpolates between nodes of absorption.
#[inline(always)]
fn interpolate(of: &[f32; SIGMAS], (node, share): (usize, f32)) -> f32 {
    let [low, high] = [of[node % SIGMAS], of[(node + 1) % SIGMAS]];
    low + share * (high - low)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed forms of light scattered once equal the integral over the depth for isotropic hairs.
    #[test]
    fn light_of_one_hair_is_the_integral_over_the_depth() {
        for (from, to) in [(0.3, 0.7), (2.0, 0.1), (0.5, 0.5004), (1e-8, 1e-8), (3.0, 40.0f32)] {
            const STEPS: usize = 20_000;
            let (mut back, mut through) = (0.0f64, 0.0f64);
            for i in 0..STEPS {
                let t = (i as f64 + 0.5) / STEPS as f64;
                let (from, to) = (f64::from(from), f64::from(to));
                back += from * (-t * (from + to)).exp() / STEPS as f64;
                through += from * (-t * from - (1.0 - t) * to).exp() / STEPS as f64;
            }
            for (found, want) in [(once(from, to), back), (once_through(from, to), through)] {
                assert!((f64::from(found) - want).abs() < 1e-3 * want + 1e-7, "{from}, {to}: {found}, {want}");
            }
        }
    }

    /// Energies are the integrals of the interpolated densities.
    #[test]
    fn energies_are_integrals() {
        let node = |i: usize| (i as f32 * 0.37).sin().abs();
        let scatter = (0..2 * HAIR_NODES).map(|i| std::array::from_fn(|k| node(i) / (1.0 + k as f32))).collect();
        let layer = HairLayer::new([[[0.2; HAIR_COSINES]; 2]; 2], scatter);
        for view in [1.0 / 16.0, 5.0 / 16.0, 15.0 / 16.0] {
            let [up, all] = layer.energies(1, view);
            let per = TAU / (HAIR_COSINES * HAIR_AZIMUTHS) as f32;
            let (mut up_sum, mut sum) = (0.0, 0.0);
            for j in 0..2 * HAIR_COSINES {
                for m in 0..HAIR_AZIMUTHS {
                    let light = (j as f32 + 0.5) / HAIR_COSINES as f32 - 1.0;
                    let azimuth = (m as f32 + 0.5) * PI / HAIR_AZIMUTHS as f32;
                    let p = per * layer.scattered(1, view, light, azimuth)[3];
                    sum += p;
                    up_sum += if light > 0.0 { p } else { 0.0 };
                }
            }
            assert!((up[3] - up_sum).abs() < 1e-4 * up_sum && (all[3] - sum).abs() < 1e-4 * sum);
        }
        assert!((layer.passes([0.0, 0.6, 0.8]) - (-0.5f32).exp()).abs() < 1e-6);
    }
}
