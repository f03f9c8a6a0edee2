//! Paths of light through a cloth, from ply to ply, and the light between yarns that they find.
//!
//! A ply scatters as its model says; light leaves it as the model's exits lie; a line that passes a ply's rim
//! goes on. `follow.rs` finds the plies.

use super::follow::ClothPaths;
use super::regression::Sums;
use super::splines;
use super::{Told, parts};
use crate::error::SimError;
use plywave::PlyModel;
use plywave::cloth::making::{
    CLASSES, CLASSES_A_KIND, ClothShade, FEW, InterYarn, PAIRS, Poly, SIGMA_PER_UM, SIGMAS, Side, SplinesAt, TERMS,
    Toward, dot, few, terms,
};
use plywave::math::hash::SplitMix64;
use plywave::ply::ExitsAt;
use std::f32::consts::PI;

/// Beams from each side whose first ply is looked at: what is caught needs many terms of the direction, and
/// with a fourth of them the light that close cloths reflect depends on the seed.
const BEAMS: usize = 1 << 20;
/// Of so many beams two are followed until they leave the cloth.
const FOLLOWED: usize = 4;
/// Most plies that scatter a path.
const MAX_ORDERS: usize = 64;
/// What f has over the density of its samples, at most.
const MAX_OVER: f32 = 2.0;
/// Directions of the first ply's light that are looked at.
const FIRSTS: usize = 4;
/// Steps of an even sequence of three numbers (Roberts 2018).
const EVEN: [f32; 3] = [0.819_172_5, 0.671_043_6, 0.549_700_5];
/// Most directions drawn for one that is kept.
const MAX_DRAWN: usize = 100;
/// A path of less energy is dropped.
const MIN_WEIGHT: f32 = 1e-4;

/// Light that has left the cloth.
pub(super) struct Escaped {
    /// Plies that scattered it.
    pub orders: usize,
    /// Class of the first ply; whether it sent the light up.
    pub class: usize,
    pub sent_up: bool,
    pub up: bool,
    /// Energies by node of absorption, of what the warp and what the weft leave of it.
    pub weight: [[f32; SIGMAS]; 2],
    /// What the first ply left of it.
    pub first: [f32; SIGMAS],
    /// Means over directions that the first ply may send light in: `[sent up, down]`, what other yarns catch
    /// by the table of shadows, and all that it scatters.
    pub caught: [[f32; SIGMAS]; 2],
    pub scattered: [f32; SIGMAS],
}

/// A ply that scatters a path.
pub(super) struct Scattered<'a> {
    pub model: &'a PlyModel,
    pub theta_i: f32,
    pub h_um: f32,
    pub radius_um: f32,
    pub frame: [[f32; 3]; 3],
    /// 0 for the warp or the only kind of yarn, 1 for the weft.
    pub kind: usize,
}

impl Escaped {
    /// A path that has met nothing yet.
    pub(super) fn new() -> Escaped {
        Escaped {
            orders: 0,
            class: 0,
            sent_up: false,
            up: false,
            weight: [[1.0; SIGMAS]; 2],
            first: [1.0; SIGMAS],
            caught: [[0.0; SIGMAS]; 2],
            scattered: [0.0; SIGMAS],
        }
    }

    /// Whether nothing that counts is left of it, or it has gone on for long enough.
    pub(super) fn is_over(&self) -> bool {
        let most = self.weight.iter().map(|w| w.iter().fold(0.0f32, |m, v| m.max(*v))).product::<f32>();
        self.orders >= MAX_ORDERS || most < MIN_WEIGHT
    }

    /// A ply scatters the path, which comes from direction `a`, into direction `d`. Returns the offset over R
    /// at which the new line passes the ply's axis, `-t` along `d cross z`, and how far along the axis;
    /// `None` where no direction is found. `first` is the class and the shadows of a first ply, of which the
    /// light is looked at; a path that is not followed ends there.
    pub(super) fn scatter(
        &mut self,
        scattered: &Scattered<'_>,
        first: Option<(usize, ClothShade<'_>)>,
        (a, is_followed): ([f32; 3], bool),
        d: &mut [f32; 3],
        number: &mut dyn FnMut() -> f32,
    ) -> Option<(f32, f32)> {
        let Scattered { model, theta_i, h_um, radius_um, frame, kind } = *scattered;
        // Drawn for clear fibers, the first node's: their light is then neither lost nor made, and that of
        // others is less.
        let ply = model.by_first(theta_i, h_um, SIGMA_PER_UM);
        let energy = ply.albedo()[0].max(1e-12);
        let per_mean = 1.0 / (MAX_OVER * energy);
        let looks = 1.0 / (FIRSTS as f32 * energy);
        let exits = model.exits_at(theta_i, h_um, radius_um);
        let clear_shares = SIGMA_PER_UM.map(ExitsAt::clear_share);
        let to_cloth = |w: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|i| frame[0][i] * w[0] + frame[1][i] * w[1] + frame[2][i] * w[2])
        };
        if let Some((class, shade)) = first {
            self.class = class;
            // An even sequence, turned at random; what the density lacks is made good by weights.
            let turn = [number(), number(), number()];
            for i in 0..FIRSTS {
                let u = std::array::from_fn(|n| (turn[n] + i as f32 * EVEN[n]).fract());
                let Some((w, light)) = ply.sample(u) else { continue };
                let d = to_cloth(w);
                let free = shade.toward(&Toward::new(d), exits.lines(model.exit_shapes(), w));
                let (most, per) = (light.refl[0] + light.high[0], looks / light.pdf);
                for k in 0..SIGMAS {
                    let share = clear_shares[k];
                    let all = (light.refl[k] + light.high[k]).min(most);
                    let out = light.refl[k] * free[0] + light.high[k] * (free[2] + share * (free[1] - free[2]));
                    self.scattered[k] += per * all;
                    self.caught[usize::from(d[2] * a[2] < 0.0)][k] += per * (all - out);
                }
            }
        }
        if !is_followed {
            self.orders = 1;
            return Some((0.0, 0.0));
        }
        // Directions are drawn with a density near to f, and kept by what f has over it: weights would be
        // noise.
        let (w, light) = (0..MAX_DRAWN).find_map(|_| {
            let (w, light) = ply.sample([number(), number(), number()])?;
            (number() * light.pdf <= (light.refl[0] + light.high[0]) * per_mean).then_some((w, light))
        })?;
        let (lines, [refl, high]) = (exits.lines(model.exit_shapes(), w), [light.refl[0], light.high[0]]);
        *d = to_cloth(w);
        if self.orders == 0 {
            self.sent_up = d[2] * a[2] > 0.0;
            self.first = std::array::from_fn(|k| ((light.refl[k] + light.high[k]) / (refl + high)).min(1.0));
        }
        self.orders += 1;
        let density = |kind: usize| lines[kind].density;
        if number() * (refl + high) < refl {
            return Some((density(0).draw(number()), lines[0].s));
        }
        // Drawn for clear fibers.
        let [clear, dark] = [1, 2].map(density);
        let t = clear.draw(number());
        let dark = dark.at(t) / clear.at(t);
        for (k, weight) in self.weight[kind].iter_mut().enumerate() {
            *weight *= (light.high[k] / high).min(1.0) * (clear_shares[k] + (1.0 - clear_shares[k]) * dark);
        }
        Some((t, lines[1].s))
    }
}

/// What is found of a first ply: energies caught of what it sends up and down, and all that it scatters, by
/// absorption.
const LOOKS: usize = 3 * SIGMAS;

/// Parts of the paths, whose sums are joined in order.
const CHUNKS: usize = 16;

/// Sums of paths, by side.
struct Found {
    caught: [Vec<splines::Sums<LOOKS>>; 2],
    leaves: [Vec<Sums<FEW>>; 2],
    mean: [Sums<TERMS>; 2],
}

impl Found {
    fn none() -> Found {
        Found {
            caught: [0, 1].map(|_| (0..CLASSES).map(|_| splines::Sums::new()).collect()),
            leaves: [0, 1].map(|_| (0..2 * CLASSES).map(|_| Sums::new(2 * PAIRS)).collect()),
            mean: [0, 1].map(|_| Sums::new(2 * PAIRS)),
        }
    }

    fn new(paths: &ClothPaths<'_>, chunk: usize) -> Found {
        let mut found = Found::none();
        for side in 0..2 {
            let mut rng = SplitMix64(0x70_6c79 + (2 * chunk + side) as u64);
            let sign = if side == 0 { 1.0 } else { -1.0 };
            for k in chunk * (BEAMS / CHUNKS)..(chunk + 1) * (BEAMS / CHUNKS) {
                // Even sequences (Roberts 2018) of direction and place; half of the directions even, half by
                // their cosine.
                let even = |step: f64| (0.5 + k as f64 * step).fract();
                let (u, turn) = (even(0.856_674_883_854_502_9) as f32, even(0.733_891_856_627_126_9));
                let place = [even(0.628_706_721_042_211_5), even(0.538_597_257_223_612_7)];
                let is_followed = k % FOLLOWED < 2;
                let cosine_weighted = k % 2 == 0;
                let z = if cosine_weighted { u.sqrt() } else { u }.max(2e-3);
                let (s, c) = (std::f64::consts::TAU * turn).sin_cos();
                let r = (1.0 - z * z).max(0.0).sqrt();
                let a = [r * c as f32, r * s as f32, sign * z];
                let at = paths.place(place);
                let mut number = || rng.next_f64() as f32;
                let t = terms(a);
                if is_followed {
                    found.mean[side].seen(&t);
                }
                if let Some(gone) = paths.path(a, at, is_followed, &mut number) {
                    found.add(side, a, &t, &gone);
                }
            }
        }
        found
    }

    fn add(&mut self, side: usize, a: [f32; 3], t: &Poly, gone: &Escaped) {
        if gone.orders == 0 {
            return;
        }
        let cause = usize::from(!gone.sent_up);
        let [up, down] = gone.caught;
        let mut looks = [0.0; LOOKS];
        for (looks, energy) in looks.as_chunks_mut::<SIGMAS>().0.iter_mut().zip([up, down, gone.scattered]) {
            *looks = energy;
        }
        self.caught[side][gone.class].add(&looks, &SplinesAt::new(a));
        if gone.orders < 2 {
            return;
        }
        let few = few(t);
        let of_cause = &mut self.leaves[side][2 * gone.class + cause];
        of_cause.seen(&few);
        let first = PAIRS * usize::from(!gone.up);
        let own = gone.class / CLASSES_A_KIND;
        for i in 0..SIGMAS {
            for j in 0..SIGMAS {
                let energy = gone.weight[0][i] * gone.weight[1][j];
                let pair = first + SIGMAS * i + j;
                of_cause.add(pair, energy / gone.first[[i, j][own]].max(1e-30), &few);
                self.mean[side].add(pair, energy, t);
            }
        }
    }

    fn join(&mut self, other: &Found) {
        for side in 0..2 {
            self.caught[side].iter_mut().zip(&other.caught[side]).for_each(|(sums, other)| sums.join(other));
            self.leaves[side].iter_mut().zip(&other.leaves[side]).for_each(|(sums, other)| sums.join(other));
            self.mean[side].join(&other.mean[side]);
        }
    }
}

/// The light between the plies of a cloth.
pub(super) fn light_between(paths: &ClothPaths<'_>, told: Told<'_>) -> Result<InterYarn, SimError> {
    let found = parts("light between plies", CHUNKS, told, |chunk| Found::new(paths, chunk))?;
    let mut all = Found::none();
    found.iter().for_each(|found| all.join(found));
    let Found { caught, leaves, mean } = all;
    let means = mean.map(|sums| sums.solve());
    let integrals = integrals();
    let side = |side: usize| {
        let shape = |half: usize, pair: usize| -> Poly {
            // What leaves on the other side is what comes from there.
            let from = if half == 0 { side } else { 1 - side };
            let poly = means[from][half * PAIRS + pair];
            let all = dot(&poly, &integrals);
            if all > 1e-6 {
                poly.map(|v| v / all)
            } else {
                std::array::from_fn(|i| if i == 0 { 1.0 / PI } else { 0.0 })
            }
        };
        Side {
            caught: caught[side].iter().flat_map(|sums| splines::several(&sums.solve())).collect(),
            leaves: leaves[side].iter().flat_map(Sums::solve).collect(),
            shape: (0..2 * PAIRS).map(|at| shape(at / PAIRS, at % PAIRS)).collect(),
        }
    };
    Ok(InterYarn { sides: [side(0), side(1)] })
}

/// Integrals over a half of the sphere of the terms times z.
fn integrals() -> Poly {
    let mut sums = [0.0; TERMS];
    sums[0] = PI;
    sums[1] = 2.0 * PI / 3.0;
    sums[2] = 0.5 * PI;
    sums[3] = 0.4 * PI;
    sums
}
