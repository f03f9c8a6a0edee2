//! Fits the reflection lobes of a family: the middle node as for a single model, the others from a neighbor's
//! lobes, then all nodes together, incidence by incidence.

use super::Work;
use crate::lobes::block::{Target, joint_cost};
use crate::lobes::reflection::{Nodes, fit_reflection, prior, relative};
use crate::lobes::sphere::Scratch;
use crate::optimize::minimize::{MinimizeOptions, minimize_bounded};
use plywave::ply::LobeKind;
use plywave::ply::asg::{MU_MAX, MU_MIN, PARAMS};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of rounds over the incidences of a node that starts from a neighbor's lobes.
const ROUNDS: usize = 2;

/// Fits lobes `[node][M][H][lobes][6]`, with energies as fractions that add up to 1.
pub(super) fn fit(work: &Work<'_>, done: &(dyn Fn(usize, usize) + Sync)) -> Vec<Vec<f64>> {
    let (sphere, effort, lobes) = (work.sphere, &work.options.reflection, work.options.lobes_refl);
    let first = work.all[0];
    let (m, n) = (first.theta_i.len(), first.h_um.len());
    let incidences = m * n;
    let count = work.tables.nodes.len();
    let target = |table: usize, at: usize| {
        let t = work.all[table];
        let values = t.refl_slice(at / n, at % n);
        Target::new(sphere, values, t.energy_refl[at], t.noise_refl[at], work.corners_of(table))
    };
    let alone = |table: usize, at: usize| Target { corners: vec![(0, 1.0)], ..target(table, at) };
    let total = incidences * (1 + ROUNDS) * count + incidences * effort.rounds;
    let reported = AtomicUsize::new(0);
    let report = |units: usize| done(reported.fetch_add(units, Ordering::Relaxed) + units, total);

    let mut fitted: Vec<Vec<Vec<f64>>> = vec![Vec::new(); count];
    for &(node, from) in &work.order {
        let targets: Vec<Target> = (0..incidences).map(|at| alone(node, at)).collect();
        fitted[node] = match from {
            None => {
                let all = fit_reflection(sphere, work.coarse.as_ref(), &targets, (m, n), lobes, effort, &|_| {});
                all.chunks_exact(lobes * PARAMS).map(<[f64]>::to_vec).collect()
            }
            Some(from) => {
                let mut own = fitted[from].clone();
                for _ in 0..ROUNDS {
                    round(work, (m, n), std::slice::from_mut(&mut own), &|at| vec![targets[at].clone()]);
                }
                own
            }
        };
        report(incidences * (1 + ROUNDS));
    }
    let tables = work.all.len();
    for _ in 0..effort.rounds {
        round(work, (m, n), &mut fitted, &|at| (0..tables).map(|table| target(table, at)).collect());
        report(incidences);
    }
    fitted.into_iter().map(|node| node.concat()).collect()
}

/// Refits `fitted[set][incidence]`: one color of a checkerboard of incidences after the other, with all sets
/// of an incidence together.
fn round(
    work: &Work<'_>,
    (m, n): (usize, usize),
    fitted: &mut [Vec<Vec<f64>>],
    targets: &(dyn Fn(usize) -> Vec<Target> + Sync),
) {
    let size = work.options.lobes_refl * PARAMS;
    let nodes = Nodes { m, n };
    for color in 0..2 {
        let held: Vec<Vec<Option<Vec<f64>>>> =
            fitted.iter().map(|set| set.iter().map(|p| Some(p.clone())).collect()).collect();
        let results: Vec<(usize, Vec<f64>)> = (0..m * n)
            .into_par_iter()
            .filter(|at| (at / n + at % n) % 2 == color)
            .map(|at| {
                let start: Vec<f64> = held.iter().flat_map(|set| set[at].clone().unwrap_or_default()).collect();
                let pull: Vec<f64> = held.iter().flat_map(|set| prior(nodes, at, set, size, LobeKind::Round)).collect();
                (at, fit_sets(work, &targets(at), &start, &pull))
            })
            .collect();
        for (at, params) in results {
            for (set, p) in fitted.iter_mut().zip(params.chunks_exact(size)) {
                set[at] = relative(p);
            }
        }
    }
}

/// Fits the sets of one incidence. The cost consists of the errors of its slices and the pull of each set to
/// its prior from the neighbors.
fn fit_sets(work: &Work<'_>, targets: &[Target], start: &[f64], pull: &[f64]) -> Vec<f64> {
    let (effort, lobes) = (&work.options.reflection, work.options.lobes_refl);
    let (mut lower, mut upper) = (Vec::new(), Vec::new());
    for p in start.chunks_exact(PARAMS) {
        lower.extend([-FRAC_PI_2, p[1] - PI, p[2] - PI, MU_MIN.ln(), MU_MIN.ln(), 0.0]);
        upper.extend([FRAC_PI_2, p[1] + PI, p[2] + PI, MU_MAX.ln(), MU_MAX.ln(), 1.5]);
    }
    let mut scratch = Scratch::default();
    let options = MinimizeOptions { iterations: effort.iterations, tolerance: effort.tolerance, memory: 20 };
    let size = lobes * PARAMS;
    minimize_bounded(start, &lower, &upper, options, |x, g| {
        let mut cost = joint_cost(work.sphere, targets, x, g, &mut scratch, lobes);
        for (i, ((x, p), g)) in x.iter().zip(pull).zip(g.iter_mut()).enumerate() {
            let s = effort.smoothness * if matches!(i % PARAMS, 3 | 4) { 0.25 } else { 1.0 };
            cost += s * (x - p) * (x - p);
            *g += 2.0 * s * (x - p);
        }
        // The energies of a set are fractions; their sum is free in the errors and pulled to 1 here.
        for (x, g) in x.chunks_exact(size).zip(g.chunks_exact_mut(size)) {
            let excess = x.chunks_exact(PARAMS).map(|p| p[5]).sum::<f64>() - 1.0;
            g.chunks_exact_mut(PARAMS).for_each(|g| g[5] += 0.2 * excess);
            cost += 0.1 * excess * excess;
        }
        cost
    })
    .x
}
