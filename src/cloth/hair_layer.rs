//! Hairs of a cloth as a thin layer over each side.
//!
//! A line from direction w passes the layer with the chance `exp(-A(z) / z)`, z the cosine: A is the area
//! of the hairs that are seen from there, over that of the cloth, and counts what plies do not hide. Light
//! that hits a hair is scattered as by one fiber, mean over the directions of the hairs that are seen. Of a
//! beam from `a`, what is scattered once and leaves towards `b` on the same side is
//!
//! `f(a, b) = p(a, b) t_a / (t_a + t_b) (1 - exp(-t_a - t_b))`, t = A / z,
//!
//! which over the cosine is symmetric where A p is. Light that passes all plies meets the hairs of the
//! other side, and of that `p(a, b) t_a (exp(-t_b) - exp(-t_a)) / (t_a - t_b)` leaves after one hair. What
//! goes to the plies, or meets another hair, counts as caught (`between.rs`). The layer is even in azimuth
//! and over the cloth.

use super::between::{SIGMAS, node_of};
use crate::math::clamp_unit;
use std::f32::consts::{PI, TAU};

/// Cosines of a half of the sphere, and azimuths of the light from the viewer's to its opposite: middles of
/// even parts of 0 to 1 and 0 to pi.
pub const HAIR_COSINES: usize = 8;
/// Azimuths, as above.
pub const HAIR_AZIMUTHS: usize = 12;
/// Nodes of one kind: `[view][light, from the other side to the viewer's][azimuth]`.
pub const HAIR_NODES: usize = HAIR_COSINES * 2 * HAIR_COSINES * HAIR_AZIMUTHS;
/// Least cosine: nearer to the plane, lines hit as many hairs as there.
const MIN_COSINE: f32 = 1e-3;

/// Hairs over the face and over the back.
#[derive(Clone, Debug)]
pub struct HairLayer {
    /// `[face, back][kind][cosine]`: area of the hairs that are seen, over that of the cloth.
    pub area: [[[f32; HAIR_COSINES]; 2]; 2],
    /// `[kind][node]`, by absorption: density of the light that a hair scatters [1/sr], `HAIR_NODES` of each
    /// of two kinds.
    pub scatter: Vec<[f32; SIGMAS]>,
    /// `[kind][view][to the viewer's side, in all]`: their integrals.
    energies: Vec<[[f32; SIGMAS]; 2]>,
}

/// Part below `x` of even parts of 0 to `parts`, whose values are those of their middles, and the share of
/// the next.
#[inline]
fn part(x: f32, parts: usize) -> (usize, f32) {
    let x = (x - 0.5).max(0.0).min((parts - 1) as f32);
    let at = (x as usize).min(parts - 2);
    (at, x - at as f32)
}

impl HairLayer {
    /// Of its areas and `2 HAIR_NODES` densities.
    pub fn new(area: [[[f32; HAIR_COSINES]; 2]; 2], scatter: Vec<[f32; SIGMAS]>) -> HairLayer {
        let per_node = TAU / (HAIR_COSINES * HAIR_AZIMUTHS) as f32;
        let sum = |nodes: &[[f32; SIGMAS]]| std::array::from_fn(|k| per_node * nodes.iter().map(|p| p[k]).sum::<f32>());
        let half = HAIR_COSINES * HAIR_AZIMUTHS;
        let energies = scatter.chunks_exact(2 * half).map(|of| [sum(&of[half..]), sum(of)]).collect();
        HairLayer { area, scatter, energies }
    }

    /// By kind, hairs that a line at a cosine to the normal meets on a side, 0 for the face: mean number.
    #[inline]
    pub fn depth(&self, side: usize, cosine: f32) -> [f32; 2] {
        let z = cosine.abs().clamp(MIN_COSINE, 1.0);
        let (i, s) = part(z * HAIR_COSINES as f32, HAIR_COSINES);
        self.area[side].map(|area| (area[i] + s * (area[i + 1] - area[i])) / z)
    }

    /// The chance that light in direction `b` passes the hairs of the side that it leaves.
    #[inline]
    pub fn passes(&self, b: [f32; 3]) -> f32 {
        let [first, second] = self.depth(usize::from(b[2] < 0.0), b[2]);
        (-first - second).exp()
    }

    /// Density of the light that a hair of a kind scatters from the viewer at cosine `view` to a cosine
    /// `light`, less than 0 on the other side, at an azimuth [1/sr], by absorption.
    #[inline]
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
                    (0..SIGMAS).for_each(|k| sum[k] += share * of[k]);
                }
            }
        }
        sum
    }

    /// Largest density of clear fibers' light from a viewer at a cosine.
    pub fn most(&self, kind: usize, view: f32) -> f32 {
        let (i, _) = part(view.abs() * HAIR_COSINES as f32, HAIR_COSINES);
        let row = 2 * HAIR_COSINES * HAIR_AZIMUTHS;
        let first = kind * HAIR_NODES + i * row;
        self.scatter[first..first + 2 * row].iter().fold(0.0, |most, p| most.max(p[0]))
    }

    /// Energy that a hair of a kind scatters of light from a viewer at cosine `view`, to the viewer's side
    /// and in all, by absorption.
    fn energies(&self, kind: usize, view: f32) -> [[f32; SIGMAS]; 2] {
        let (i, s) = part(view.abs() * HAIR_COSINES as f32, HAIR_COSINES);
        let [low, high] = [i, i + 1].map(|i| &self.energies[kind * HAIR_COSINES + i]);
        std::array::from_fn(|half| std::array::from_fn(|k| low[half][k] + s * (high[half][k] - low[half][k])))
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        size_of_val(self.scatter.as_slice()) + size_of_val(self.energies.as_slice())
    }
}

/// Azimuth between two directions [rad], 0 to pi.
#[inline]
pub fn azimuth(a: [f32; 3], b: [f32; 3]) -> f32 {
    let lengths = ((a[0] * a[0] + a[1] * a[1]) * (b[0] * b[0] + b[1] * b[1])).sqrt();
    if lengths < 1e-12 {
        return 0.5 * PI;
    }
    ((a[0] * b[0] + a[1] * b[1]) / lengths).clamp(-1.0, 1.0).acos()
}

/// Of light that hits a hair at a depth of `from` and is scattered once towards a depth of `to` on the same
/// side, the share that meets no other hair, times the share of the beam that is hit.
#[inline]
pub fn once(from: f32, to: f32) -> f32 {
    let both = from + to;
    if both < 1e-6 { from } else { from / both * -(-both).exp_m1() }
}

/// As [`once`], of light that comes through the plies and leaves on the layer's other side.
#[inline]
pub fn once_through(from: f32, to: f32) -> f32 {
    let off = from - to;
    if off.abs() < 1e-3 {
        return from * (-0.5 * (from + to)).exp();
    }
    from * ((-to).exp() - (-from).exp()) / off
}

/// Hairs of one side of a cloth, for N absorptions.
#[derive(Clone, Copy, Debug)]
struct SideAt<const N: usize> {
    /// 0 for the face.
    side: usize,
    /// By kind, hairs that the beam meets.
    depth: [f32; 2],
    /// Share of the beam that comes to them.
    arrives: f32,
    /// By kind, energy that they scatter, and what of all goes to their side of the cloth.
    energy: [[f32; N]; 2],
    out: [f32; N],
    /// Chance of samples.
    chance: f32,
}

/// The hairs over a cloth, seen from a direction, for N absorptions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HairsAt<'a, const N: usize> {
    layer: &'a HairLayer,
    a: [f32; 3],
    /// By kind, node of absorption and share of the next.
    nodes: [[(usize, f32); N]; 2],
    /// Of the viewer's side and of the other.
    sides: [SideAt<N>; 2],
}

impl<'a, const N: usize> HairsAt<'a, N> {
    /// Of which a share of the beam passes all plies.
    pub(crate) fn new(layer: &'a HairLayer, a: [f32; 3], sigma_per_um: [[f32; N]; 2], passing: f32) -> Self {
        let nodes = sigma_per_um.map(|sigma| sigma.map(node_of));
        let viewer = usize::from(a[2] < 0.0);
        let energies = [0, 1].map(|kind| layer.energies(kind, a[2]));
        let sides = [(viewer, 1.0), (1 - viewer, passing)].map(|(side, arrives)| {
            let depth = layer.depth(side, a[2]);
            let all = depth[0] + depth[1];
            let hit = arrives * -(-all).exp_m1();
            let (mut energy, mut out) = ([[0.0; N]; 2], [0.0; N]);
            for kind in 0..2 {
                let share = if all > 0.0 { hit * depth[kind] / all } else { 0.0 };
                let [to_viewer, whole] = &energies[kind];
                for k in 0..N {
                    let (up, whole) = (between(to_viewer, nodes[kind][k]), between(whole, nodes[kind][k]));
                    energy[kind][k] = share * whole;
                    out[k] += share * if side == viewer { up } else { whole - up };
                }
            }
            SideAt { side, depth, arrives, energy, out, chance: 0.0 }
        });
        HairsAt { layer, a, nodes, sides }
    }

    /// `[kind][behind]`: energies that they scatter.
    pub(crate) fn energies(&self) -> [[[f32; N]; 2]; 2] {
        [0, 1].map(|kind| [0, 1].map(|behind| self.sides[behind].energy[kind]))
    }

    /// Share of what passes all plies that meets no hair behind them.
    pub(crate) fn passes_behind(&self) -> f32 {
        let [first, second] = self.sides[1].depth;
        (-first - second).exp()
    }

    /// What they send to their sides of the cloth, of the viewer's and of the other.
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

    /// Of the hairs on the side to which a direction leads, whether they are those behind.
    #[inline]
    fn behind(&self, b: [f32; 3]) -> usize {
        usize::from((b[2] < 0.0) != (self.a[2] < 0.0))
    }

    /// Adds what hairs send to their side of the cloth.
    #[inline]
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
                    f[k] += share * between(&p, self.nodes[kind][k]);
                }
            }
        }
    }

    /// Share of a ply's light in direction `b` that passes the hairs.
    #[inline]
    pub(crate) fn free(&self, b: [f32; 3]) -> f32 {
        self.layer.passes(b)
    }

    /// Density of samples [1/sr].
    pub(crate) fn pdf(&self, b: [f32; 3]) -> f32 {
        self.sides[self.behind(b)].chance / TAU
    }

    /// A direction, by a number below the chance of it.
    pub(crate) fn draw(&self, [u, v, w]: [f32; 3]) -> [f32; 3] {
        let of = &self.sides[usize::from(u >= self.sides[0].chance)];
        let z = clamp_unit(v).max(MIN_COSINE);
        let (sin, cos) = (TAU * w).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        [r * cos, r * sin, if of.side == 0 { z } else { -z }]
    }
}

/// Between nodes of absorption.
#[inline]
fn between(of: &[f32; SIGMAS], (node, share): (usize, f32)) -> f32 {
    let [low, high] = [of[node % SIGMAS], of[(node + 1) % SIGMAS]];
    low + share * (high - low)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of light that isotropic hairs scatter once in a layer, the shares that leave are those of a walk's
    /// integral over the depth.
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

    /// Between its nodes a layer has the mean of them, and energies are the integrals of densities.
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
