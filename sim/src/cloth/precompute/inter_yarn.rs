//! Inter-yarn scattering of a cloth, estimated by paths through it.
//!
//! Beams enter from both sides over a low-discrepancy sequence of directions and places. At the first ply of
//! each, the energy that other yarns occlude is sampled and regressed on splines of the incident direction.
//! Half of the beams are followed until they leave; the energies that leave after two or more plies are
//! regressed on polynomials of the direction, by class of the first ply and by absorption.

use super::cones::{Parallel, cones};
use super::follow::ClothPaths;
use super::lit_places::Followed;
use super::paths::Escaped;
use super::regression::RegressionSums;
use super::splines;
use super::{Effort, Progress, parts};
use crate::error::SimError;
use plywave::cloth::light::{
    CLASSES, CLASSES_A_KIND, FEW, InterYarn, LitPlaces, PAIRS, Poly, SIGMAS, Side, TERMS, dot, few, terms,
};
use plywave::cloth::shade::SplinesAt;
use plywave::math::hash::SplitMix64;
use std::f32::consts::PI;

/// Number of beams from each side whose first ply is sampled. The occluded energy needs many terms of the
/// direction: with a quarter of the beams, the light that dense cloths reflect depends on the seed.
const BEAMS: usize = 1 << 20;
/// Number of beams from each side for [`Effort::Draft`].
const DRAFT_BEAMS: usize = 1 << 15;
/// Period of the beams: two of every `FOLLOWED` are followed until they leave the cloth.
const FOLLOWED: usize = 4;

/// Bound of the energy that leaves over what the first ply has left of it. In directions that nearly all
/// light reaches through fibers, the rare path of single reflection stands for all light of dark fibers.
const MAX_PER_FIRST: f32 = 100.0;

/// Number of energies sampled at a first ply: occluded light sent up, occluded light sent down and all
/// scattered light, each by absorption.
const FIRST_VALUES: usize = 3 * SIGMAS;

/// Number of chunks of paths. Their sums are joined in order, so that the result is deterministic.
const CHUNKS: usize = 16;

/// Regression sums over paths, `[side]`.
struct Found {
    caught: [Vec<splines::SplineSums<FIRST_VALUES>>; 2],
    leaves: [Vec<RegressionSums<FEW>>; 2],
    mean: [RegressionSums<TERMS>; 2],
    parallel: Parallel,
    followed: Vec<Followed>,
}

impl Found {
    fn none() -> Found {
        Found {
            caught: [0, 1].map(|_| (0..CLASSES).map(|_| splines::SplineSums::new()).collect()),
            leaves: [0, 1].map(|_| (0..2 * CLASSES).map(|_| RegressionSums::new(2 * PAIRS)).collect()),
            mean: [0, 1].map(|_| RegressionSums::new(2 * PAIRS)),
            parallel: Parallel::none(),
            followed: Vec::new(),
        }
    }

    fn new(paths: &ClothPaths<'_>, beams: usize, chunk: usize) -> Found {
        let mut found = Found::none();
        let is_small = paths.shadows.tables().is_empty();
        for side in 0..2 {
            let mut rng = SplitMix64(0x70_6c79 + (2 * chunk + side) as u64);
            let sign = if side == 0 { 1.0 } else { -1.0 };
            for k in chunk * (beams / CHUNKS)..(chunk + 1) * (beams / CHUNKS) {
                // Low-discrepancy sequences (Roberts 2018) of direction and place. Half of the directions
                // are uniform over the hemisphere, half are cosine-weighted.
                let even = |step: f64| (0.5 + k as f64 * step).fract();
                let (u, turn) = (even(0.856_674_883_854_502_9) as f32, even(0.733_891_856_627_126_9));
                // Over a cell of many crossings the sequence of places would go with that of directions.
                let place = match is_small {
                    true => [even(0.628_706_721_042_211_5), even(0.538_597_257_223_612_7)],
                    false => [rng.next_f64(), rng.next_f64()],
                };
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
                    found.mean[side].add_sample(&t);
                }
                let path = paths.path(a, at, is_followed, &mut number);
                found.parallel.add_beam(side, &t, path.as_ref());
                if let Some(path) = path {
                    found.add(side, a, &t, &path, paths.plies.kinds == 2);
                    if is_followed {
                        found.followed.extend(Followed::new(a, &path));
                    }
                    if paths.plies.kinds == 2 {
                        found.parallel.add(side, (a, &t), paths.plies.axes(), &path);
                    }
                }
            }
        }
        found
    }

    fn add(&mut self, side: usize, a: [f32; 3], t: &Poly, path: &Escaped, has_cones: bool) {
        if path.orders == 0 {
            return;
        }
        let cause = usize::from(!path.sent_up);
        let [up, down] = path.caught;
        let mut first_values = [0.0; FIRST_VALUES];
        for (first_values, energy) in
            first_values.as_chunks_mut::<SIGMAS>().0.iter_mut().zip([up, down, path.scattered])
        {
            *first_values = energy;
        }
        self.caught[side][path.class].add(&first_values, &SplinesAt::new(a));
        if path.orders < 2 {
            return;
        }
        let few = few(t);
        let of_cause = &mut self.leaves[side][2 * path.class + cause];
        of_cause.add_sample(&few);
        let first = PAIRS * usize::from(!path.up);
        let own = path.class / CLASSES_A_KIND;
        // Cones distribute what only yarns of one kind have scattered.
        let is_about_cone = has_cones && path.kinds == 1 << own;
        for i in 0..SIGMAS {
            for j in 0..SIGMAS {
                let energy = path.weight[0][i] * path.weight[1][j];
                let pair = first + SIGMAS * i + j;
                of_cause.add(pair, (energy / path.first[[i, j][own]].max(1e-30)).min(MAX_PER_FIRST), &few);
                if !is_about_cone {
                    self.mean[side].add(pair, energy, t);
                }
            }
        }
    }

    fn join(&mut self, other: Found) {
        for side in 0..2 {
            self.caught[side].iter_mut().zip(&other.caught[side]).for_each(|(sums, other)| sums.join(other));
            self.leaves[side].iter_mut().zip(&other.leaves[side]).for_each(|(sums, other)| sums.join(other));
            self.mean[side].join(&other.mean[side]);
        }
        self.parallel.join(&other.parallel);
        self.followed.extend(other.followed);
    }
}

/// Estimates the inter-yarn scattering of a cloth, evenly over its places, and returns the paths that were
/// followed.
pub(super) fn inter_yarn(
    paths: &ClothPaths<'_>,
    effort: Effort,
    progress: Progress<'_>,
) -> Result<(InterYarn, Vec<Followed>), SimError> {
    let beams = if effort == Effort::Draft { DRAFT_BEAMS } else { BEAMS };
    let found = parts("light between plies", CHUNKS, progress, |chunk| Found::new(paths, beams, chunk))?;
    let mut all = Found::none();
    for of in found {
        all.join(of);
    }
    let Found { caught, leaves, mean, parallel, followed } = all;
    let cones = cones(&parallel, paths.plies.axes());
    let means = mean.map(|sums| sums.solve());
    let integrals = integrals();
    let side = |side: usize| {
        let shape = |half: usize, pair: usize| -> Poly {
            // By reciprocity, transmitted light has the shape of the light incident on the other side.
            let from = if half == 0 { side } else { 1 - side };
            let poly = means[from][half * PAIRS + pair];
            let all = dot(&poly, &integrals);
            if all > 1e-6 { not_negative(poly.map(|v| v / all), &EVEN) } else { EVEN }
        };
        Side {
            caught: caught[side].iter().flat_map(|sums| splines::several(&sums.solve())).collect(),
            leaves: leaves[side].iter().flat_map(RegressionSums::solve).collect(),
            parallel: parallel.leaves(side),
            cones: cones[side],
            shape: (0..2 * PAIRS).map(|at| shape(at / PAIRS, at % PAIRS)).collect(),
        }
    };
    let even = InterYarn::new([side(0), side(1)], LitPlaces::default()).along(paths.plies.runs);
    Ok((even, followed))
}

/// The constant polynomial of integral 1.
pub(super) const EVEN: Poly = {
    let mut even = [0.0; TERMS];
    even[0] = 1.0 / PI;
    even
};

/// Mixes a polynomial of integral 1 with a nonnegative `other` until it is nonnegative in every direction:
/// shading clamps negative values to 0, which would add energy.
pub(super) fn not_negative(poly: Poly, other: &Poly) -> Poly {
    const ROWS: usize = 24;
    const COLUMNS: usize = 48;
    let share = |i: usize| {
        let z = (i / COLUMNS) as f32 / (ROWS - 1) as f32;
        let (sin, cos) = (2.0 * PI * (i % COLUMNS) as f32 / COLUMNS as f32).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let t = terms([across * cos, across * sin, z]);
        let [value, other] = [&poly, other].map(|of| dot(of, &t));
        if value < 0.0 { value / (value - other.max(0.0)) } else { 0.0 }
    };
    let share = (0..ROWS * COLUMNS).map(share).fold(0.0, f32::max);
    std::array::from_fn(|i| (1.0 - share) * poly[i] + share * other[i])
}

/// Cosine-weighted integrals of the terms over the hemisphere.
pub(super) fn integrals() -> Poly {
    let mut sums = [0.0; TERMS];
    sums[0] = PI;
    sums[1] = 2.0 * PI / 3.0;
    sums[2] = 0.5 * PI;
    sums[3] = 0.4 * PI;
    sums
}
