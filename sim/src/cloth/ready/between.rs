//! The light between the plies of a cloth, by paths through it.

use super::cones::{Parallel, cones};
use super::follow::ClothPaths;
use super::paths::Escaped;
use super::regression::Sums;
use super::splines;
use super::{Effort, Told, parts};
use crate::error::SimError;
use plywave::cloth::making::{
    CLASSES, CLASSES_A_KIND, FEW, InterYarn, PAIRS, Poly, SIGMAS, Side, SplinesAt, TERMS, dot, few, terms,
};
use plywave::math::hash::SplitMix64;
use std::f32::consts::PI;

/// Beams from each side whose first ply is looked at: what is caught needs many terms of the direction, and
/// with a fourth of them the light that close cloths reflect depends on the seed.
const BEAMS: usize = 1 << 20;
/// Those of a draft.
const DRAFT_BEAMS: usize = 1 << 15;
/// Of so many beams two are followed until they leave the cloth.
const FOLLOWED: usize = 4;

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
    parallel: Parallel,
}

impl Found {
    fn none() -> Found {
        Found {
            caught: [0, 1].map(|_| (0..CLASSES).map(|_| splines::Sums::new()).collect()),
            leaves: [0, 1].map(|_| (0..2 * CLASSES).map(|_| Sums::new(2 * PAIRS)).collect()),
            mean: [0, 1].map(|_| Sums::new(2 * PAIRS)),
            parallel: Parallel::none(),
        }
    }

    fn new(paths: &ClothPaths<'_>, beams: usize, chunk: usize) -> Found {
        let mut found = Found::none();
        for side in 0..2 {
            let mut rng = SplitMix64(0x70_6c79 + (2 * chunk + side) as u64);
            let sign = if side == 0 { 1.0 } else { -1.0 };
            for k in chunk * (beams / CHUNKS)..(chunk + 1) * (beams / CHUNKS) {
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
                let gone = paths.path(a, at, is_followed, &mut number);
                found.parallel.look(side, &t, gone.as_ref());
                if let Some(gone) = gone {
                    found.add(side, a, &t, &gone);
                    if paths.plies.kinds == 2 {
                        found.parallel.add(side, (a, &t), paths.plies.axes(), &gone);
                    }
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
        self.parallel.join(&other.parallel);
    }
}

/// The light between the plies of a cloth.
pub(super) fn light_between(paths: &ClothPaths<'_>, effort: Effort, told: Told<'_>) -> Result<InterYarn, SimError> {
    let beams = if effort == Effort::Draft { DRAFT_BEAMS } else { BEAMS };
    let found = parts("light between plies", CHUNKS, told, |chunk| Found::new(paths, beams, chunk))?;
    let mut all = Found::none();
    found.iter().for_each(|found| all.join(found));
    let Found { caught, leaves, mean, parallel } = all;
    let cones = cones(&parallel, paths.plies.axes());
    let means = mean.map(|sums| sums.solve());
    let integrals = integrals();
    let side = |side: usize| {
        let shape = |half: usize, pair: usize| -> Poly {
            // What leaves on the other side is what comes from there.
            let from = if half == 0 { side } else { 1 - side };
            let poly = means[from][half * PAIRS + pair];
            let all = dot(&poly, &integrals);
            if all > 1e-6 {
                not_negative(poly.map(|v| v / all))
            } else {
                std::array::from_fn(|i| if i == 0 { 1.0 / PI } else { 0.0 })
            }
        };
        Side {
            caught: caught[side].iter().flat_map(|sums| splines::several(&sums.solve())).collect(),
            leaves: leaves[side].iter().flat_map(Sums::solve).collect(),
            parallel: parallel.leaves(side),
            cones: cones[side],
            shape: (0..2 * PAIRS).map(|at| shape(at / PAIRS, at % PAIRS)).collect(),
        }
    };
    Ok(InterYarn::new([side(0), side(1)]))
}

/// A polynomial of integral 1 with as much of the constant one as makes it 0 or more in every direction:
/// shading takes a negative value as 0, which would add light.
fn not_negative(poly: Poly) -> Poly {
    const ROWS: usize = 24;
    const COLUMNS: usize = 48;
    let value = |i: usize| {
        let z = (i / COLUMNS) as f32 / (ROWS - 1) as f32;
        let (sin, cos) = (2.0 * PI * (i % COLUMNS) as f32 / COLUMNS as f32).sin_cos();
        let across = (1.0 - z * z).sqrt();
        dot(&poly, &terms([across * cos, across * sin, z]))
    };
    let least = (0..ROWS * COLUMNS).map(value).fold(0.0, f32::min);
    let share = least / (least - 1.0 / PI);
    std::array::from_fn(|i| (1.0 - share) * poly[i] + if i == 0 { share / PI } else { 0.0 })
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
