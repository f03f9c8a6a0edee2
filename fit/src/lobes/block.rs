//! Fits high-order lobes in blocks of nine slices (Yu 2025, Eq. 6-7): the lobes of the four corners are free
//! parameters, those of the other five slices are averages of them.
//!
//! Inside the objective, the model of a slice is scaled to the slice's energy in the same way as by the
//! evaluator, so the objective is the error of evaluated values.

use crate::lobes::cone::{self, SliceLobes, ring_lobes, rings};
use crate::lobes::init::kmeans_lobes;
use crate::lobes::sphere::{PaddedSlice, Scratch, SphereGrid};
use crate::optimize::minimize::{MinimizeOptions, minimize_bounded};
use plywave::ply::LobeKind;
use plywave::ply::asg::PARAMS;
use std::f64::consts::PI;

/// Number of corners of a block, in file order (theta_i, h): (0, 0), (0, 2), (2, 0), (2, 2).
pub const CORNERS: usize = 4;

/// Weights of the four corners at slice (a, b) of a block, a, b in 0..3 (Yu 2025, 5.2).
pub fn corner_weights(a: usize, b: usize) -> [f64; CORNERS] {
    let (s, t) = (0.5 * a as f64, 0.5 * b as f64);
    [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t]
}

/// One slice of a fit: its target, its energy, and its weight in the sum of squares.
#[derive(Clone, Debug)]
pub(crate) struct Target {
    pub slice: PaddedSlice,
    pub energy: f64,
    pub weight: f64,
    /// Weights of the free parameter sets in this slice's parameters.
    pub corners: Vec<(usize, f64)>,
    /// Kind of the lobes that are fitted.
    pub lobes: SliceLobes,
}

impl Target {
    /// A target whose `weight` gives the noise of a perfect fit equal influence: 1 / norm^2, reduced by the
    /// fraction of noise in the norm.
    pub fn new(sphere: &SphereGrid, values: &[f32], energy: f64, noise: f64, corners: Vec<(usize, f64)>) -> Self {
        let slice = sphere.pad(values, 1.0);
        let norm2 = sphere.inner(&slice, &slice);
        let signal = ((norm2 - noise) / norm2.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let weight = if norm2 > 0.0 && energy > 0.0 { signal / norm2 } else { 0.0 };
        Target { slice, energy, weight, corners, lobes: SliceLobes::Round }
    }

    /// The same target for another kind of lobes.
    pub fn with(self, lobes: SliceLobes) -> Self {
        Target { lobes, ..self }
    }

    /// The same target on a grid coarsened by two in each direction.
    pub fn coarsen(&self, fine: &SphereGrid, coarse: &SphereGrid) -> Self {
        let (f, c) = (fine.grid(), coarse.grid());
        let values = fine.unpad(&self.slice);
        let mut out = vec![0.0f32; c.len()];
        for i in 0..f.theta_o {
            let share = fine.solid_angles()[i] / coarse.solid_angles()[i / 2];
            for j in 0..f.phi_o {
                out[i / 2 * c.phi_o + j / 2] += (share * values[i * f.phi_o + j] as f64) as f32;
            }
        }
        Target { slice: coarse.pad(&out, 1.0), corners: self.corners.clone(), ..*self }
    }
}

/// The grid halved in each direction; `None` if that is impossible or useless.
pub(crate) fn coarse_grid(sphere: &SphereGrid) -> Option<SphereGrid> {
    let g = sphere.grid();
    let even = g.theta_o.is_multiple_of(2) && g.phi_o.is_multiple_of(2);
    (even && g.theta_o >= 60)
        .then(|| SphereGrid::new(plywave_tables::table::OutgoingGrid { theta_o: g.theta_o / 2, phi_o: g.phi_o / 2 }))
}

/// Sum over targets of the weighted squared distance of the energy-scaled mixture, and its gradient with
/// respect to the free parameter sets `x[set][lobe][6]`.
pub(crate) fn joint_cost(
    sphere: &SphereGrid,
    targets: &[Target],
    x: &[f64],
    gradient: &mut [f64],
    scratch: &mut Scratch,
    lobes: usize,
) -> f64 {
    let size = lobes * PARAMS;
    let (mut params, mut local) = (vec![0.0; size], vec![0.0; size]);
    gradient.fill(0.0);
    let mut cost = 0.0;
    for target in targets.iter().filter(|t| t.weight > 0.0) {
        blend(x, &target.corners, &mut params);
        let sum: f64 = params.chunks_exact(PARAMS).map(|p| p[5]).sum();
        let gain = if sum > 1e-12 { target.energy / sum } else { 0.0 };
        cost +=
            target.weight * sphere.cost_gradient_of(target.lobes, &target.slice, &params, gain, &mut local, scratch);
        if sum > 1e-12 {
            // gain = energy / sum of lobe energies, so a change of one energy changes the contributions of
            // all others.
            let mean =
                params.chunks_exact(PARAMS).zip(local.chunks_exact(PARAMS)).map(|(p, d)| p[5] * d[5]).sum::<f64>()
                    / sum;
            local.chunks_exact_mut(PARAMS).for_each(|d| d[5] -= mean);
        }
        for &(set, w) in &target.corners {
            for (g, d) in gradient[set * size..(set + 1) * size].iter_mut().zip(&local) {
                *g += target.weight * w * d;
            }
        }
    }
    if is_cone(targets) {
        for (p, g) in x.chunks_exact(PARAMS).zip(gradient.chunks_exact_mut(PARAMS)) {
            let (pull, by) = cone::pull(p);
            cost += pull;
            g[0] += by[0];
            g[2] += by[1];
        }
    }
    cost
}

fn is_cone(targets: &[Target]) -> bool {
    targets.iter().any(|t| t.lobes.family() == LobeKind::Cone)
}

/// Weighted sum of parameter sets.
pub(crate) fn blend(x: &[f64], corners: &[(usize, f64)], params: &mut [f64]) {
    let size = params.len();
    params.fill(0.0);
    for &(set, w) in corners {
        for (p, v) in params.iter_mut().zip(&x[set * size..(set + 1) * size]) {
            *p += w * v;
        }
    }
}

/// Effort of a block fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockEffort {
    /// Number of starts tried on the coarse grid.
    pub starts: usize,
    /// Number of iterations of each start.
    pub start_iterations: usize,
    /// Number of attempts to move a little used lobe of the best start to light that the mixture misses, each
    /// refitted on the coarse grid.
    pub moves: usize,
    /// Number of iterations of each such refit.
    pub move_iterations: usize,
    /// Number of iterations of the best start on the full grid.
    pub iterations: usize,
    /// Relative gain over ten iterations below which the fit stops.
    pub tolerance: f64,
}

/// A fitted block: `params[4][lobes][6]`, energies in the unit of the table, and the weighted cost.
#[derive(Clone, Debug)]
pub(crate) struct BlockFit {
    pub params: Vec<f64>,
    pub cost: f64,
    pub evaluations: usize,
}

/// Bounds of all parameters: axes within half a turn of the start, bandwidths within the lobe's range,
/// energies up to `top`.
pub(crate) fn bounds(family: LobeKind, start: &[f64], top: f64) -> (Vec<f64>, Vec<f64>) {
    let mut lower = Vec::with_capacity(start.len());
    let mut upper = Vec::with_capacity(start.len());
    for p in start.chunks_exact(PARAMS) {
        let (low, high) = cone::bounds(family, p, top);
        lower.extend(low);
        upper.extend(high);
    }
    (lower, upper)
}

/// Fits `sets` free parameter sets of `lobes` lobes to `targets`, from k-means starts on their mean and from
/// `extra` starts.
pub(crate) fn fit_joint(
    sphere: &SphereGrid,
    coarse: Option<&SphereGrid>,
    targets: &[Target],
    sets: usize,
    lobes: usize,
    effort: &BlockEffort,
    seed: u64,
    extra: &[Vec<f64>],
) -> BlockFit {
    let total: f64 = targets.iter().filter(|t| t.weight > 0.0).map(|t| t.energy).sum();
    let scale = targets.iter().map(|t| t.energy).fold(0.0, f64::max);
    let size = lobes * PARAMS;
    // Lobe energies are fitted relative to the largest slice energy, which makes all parameters of order one.
    let unit = |start: &mut [f64], by: f64| start.chunks_exact_mut(PARAMS).for_each(|p| p[5] *= by);
    let coarse_targets: Option<Vec<Target>> = coarse.map(|c| targets.iter().map(|t| t.coarsen(sphere, c)).collect());
    let (rough, rough_targets): (&SphereGrid, &[Target]) = match (coarse, &coarse_targets) {
        (Some(c), Some(t)) => (c, t),
        _ => (sphere, targets),
    };
    let mut mean = rough.pad(&vec![0.0; rough.grid().len()], 0.0);
    for target in rough_targets.iter().filter(|t| t.weight > 0.0) {
        mean.add(&target.slice, 1.0 / target.energy);
    }
    let family = targets.first().map_or(LobeKind::Round, |t| t.lobes.family());
    let mut scratch = Scratch::default();
    let mut starts: Vec<Vec<f64>> = (0..effort.starts as u64)
        .map(|s| {
            let seed = seed.wrapping_mul(1000).wrapping_add(s);
            let lobes: Vec<[f64; PARAMS]> = match family {
                LobeKind::Round => kmeans_lobes(rough, &mean, lobes, seed).into_iter().map(|l| l.to_params()).collect(),
                LobeKind::Cone => ring_lobes(&mean_rings(rough, rough_targets), lobes, row(rough), seed),
            };
            let sum: f64 = lobes.iter().map(|p| p[5]).sum::<f64>().max(f64::MIN_POSITIVE);
            (0..sets)
                .flat_map(|set| {
                    let energy = set_energy(targets, set, scale);
                    lobes.iter().flat_map(move |p| {
                        let mut p = *p;
                        p[5] *= energy / sum;
                        p
                    })
                })
                .collect()
        })
        .collect();
    for e in extra.iter().filter(|e| e.len() == sets * size) {
        let mut e = e.clone();
        unit(&mut e, 1.0 / scale.max(f64::MIN_POSITIVE));
        starts.push(e);
    }
    let mut evaluations = 0;
    if total <= 0.0 || starts.is_empty() {
        let params = starts.into_iter().next().unwrap_or_else(|| vec![0.0; sets * size]);
        return BlockFit { params, cost: 0.0, evaluations };
    }
    let mut run = |sphere: &SphereGrid, targets: &[Target], start: &[f64], iterations: usize| {
        let (lower, upper) = bounds(family, start, 4.0);
        let options = MinimizeOptions { iterations, tolerance: effort.tolerance, memory: 20 };
        let fit = minimize_bounded(start, &lower, &upper, options, |x, g| {
            joint_cost(sphere, targets, x, g, &mut scratch, lobes)
        });
        evaluations += fit.evaluations;
        fit
    };
    let mut best: Option<(f64, Vec<f64>)> = None;
    for start in &starts {
        let fit = run(rough, rough_targets, start, effort.start_iterations);
        if best.as_ref().is_none_or(|b| fit.cost < b.0) {
            best = Some((fit.cost, fit.x));
        }
    }
    let (mut cost, mut start) = best.unwrap_or_default();
    for round in 0..effort.moves {
        let moved = relocate(rough, rough_targets, &start, lobes, round);
        let fit = run(rough, rough_targets, &moved, effort.move_iterations);
        if fit.cost < cost {
            (cost, start) = (fit.cost, fit.x);
        }
    }
    let fit = run(sphere, targets, &start, effort.iterations);
    let mut params = fit.x;
    let factor = energy_factor(targets, &params, sets, lobes);
    unit(&mut params, factor);
    BlockFit { params, cost: fit.cost, evaluations }
}

/// Height of a grid row [rad].
fn row(sphere: &SphereGrid) -> f64 {
    PI / sphere.grid().theta_o as f64
}

/// Mean rings of the targets' light, each target normalized to energy 1.
fn mean_rings(sphere: &SphereGrid, targets: &[Target]) -> Vec<[f64; 3]> {
    let mut sum = vec![[0.0; 3]; sphere.grid().phi_o];
    for target in targets.iter().filter(|t| t.weight > 0.0) {
        add_rings(&mut sum, sphere, &target.slice, target.lobes, 1.0 / target.energy);
    }
    sum
}

fn add_rings(sum: &mut [[f64; 3]], sphere: &SphereGrid, slice: &PaddedSlice, lobes: SliceLobes, scale: f64) {
    let SliceLobes::Cone { theta_i } = lobes else { return };
    for (sum, ring) in sum.iter_mut().zip(rings(sphere, slice, theta_i)) {
        for (sum, v) in sum.iter_mut().zip(ring) {
            *sum += scale * v;
        }
    }
}

/// Factor that converts the free common scale of the lobe energies to the table's unit, with no lobe above 1.
fn energy_factor(targets: &[Target], x: &[f64], sets: usize, lobes: usize) -> f64 {
    let mut params = vec![0.0; lobes * PARAMS];
    let (mut want, mut have) = (0.0, 0.0);
    for target in targets.iter().filter(|t| t.weight > 0.0) {
        blend(x, &target.corners, &mut params);
        want += target.energy;
        have += params.chunks_exact(PARAMS).map(|p| p[5]).sum::<f64>();
    }
    let top = x[..sets * lobes * PARAMS].chunks_exact(PARAMS).map(|p| p[5]).fold(0.0, f64::max);
    if have > 0.0 && top > 0.0 { (want / have).min(1.0 / top) } else { 1.0 }
}

/// Number of clusters into which missing light is divided.
const MISSING: usize = 6;

/// Returns `x` with one of its least used lobes moved to light that the mixture misses. `round` selects the
/// lobe and the cluster.
fn relocate(sphere: &SphereGrid, targets: &[Target], x: &[f64], lobes: usize, round: usize) -> Vec<f64> {
    let size = lobes * PARAMS;
    let mut scratch = Scratch::default();
    let mut missing = sphere.pad(&vec![0.0; sphere.grid().len()], 0.0);
    let mut missing_rings = vec![[0.0; 3]; sphere.grid().phi_o];
    let mut params = vec![0.0; size];
    let mut used = vec![0.0; lobes];
    let mut count = 0.0;
    for target in targets.iter().filter(|t| t.weight > 0.0) {
        blend(x, &target.corners, &mut params);
        let sum: f64 = params.chunks_exact(PARAMS).map(|p| p[5]).sum();
        let model = sphere.mixture_of(target.lobes, &params, 1.0 / sum.max(1e-12), &mut scratch);
        if target.lobes == SliceLobes::Round {
            missing.add(&target.slice, 1.0 / target.energy);
            missing.add(&model, -1.0);
        } else {
            let mut own = model;
            own.scale(-1.0);
            own.add(&target.slice, 1.0 / target.energy);
            add_rings(&mut missing_rings, sphere, &own, target.lobes, 1.0);
        }
        count += 1.0;
        for (used, p) in used.iter_mut().zip(params.chunks_exact(PARAMS)) {
            // The measure of use is the squared norm of the lobe: its peak times its energy.
            *used += (p[5] / sum.max(1e-12)).powi(2) * (0.5 * (p[3] + p[4])).exp();
        }
    }
    let mut order: Vec<usize> = (0..lobes).collect();
    order.sort_by(|a, b| used[*a].total_cmp(&used[*b]).then(a.cmp(b)));
    let mut places: Vec<[f64; PARAMS]> = if is_cone(targets) {
        ring_lobes(&missing_rings, MISSING, row(sphere), round as u64)
    } else {
        kmeans_lobes(sphere, &missing, MISSING, round as u64).into_iter().map(|l| l.to_params()).collect()
    };
    let peak = |p: &[f64; PARAMS]| p[5].powi(2) * (0.5 * (p[3] + p[4])).exp();
    places.sort_by(|a, b| peak(b).total_cmp(&peak(a)));
    let victim = order[round % lobes.min(3)];
    let place = places[(round / 3) % 2];
    let mut out = x.to_vec();
    for set in out.chunks_exact_mut(size) {
        let sum: f64 = set.chunks_exact(PARAMS).map(|p| p[5]).sum();
        let mut p = place;
        p[5] = (p[5] / count).clamp(0.0, 0.3) * sum;
        set[victim * PARAMS..(victim + 1) * PARAMS].copy_from_slice(&p);
    }
    out
}

/// Starting energy of parameter set `set`: the fourth root of its own slice's energy (the corner's; else the
/// mean of all), in units of `scale`. Where the beam leaves the ply, the energies of the corners differ by a
/// factor of a thousand. With the energies themselves, the dim corner would have no effect on the slices in
/// between and hardly any gradient. At the rim blocks of polyester, measured errors are 0.45 with the first
/// power, and 0.07 with the square root and the fourth root. Only ratios between corners matter.
fn set_energy(targets: &[Target], set: usize, scale: f64) -> f64 {
    let own = targets.iter().find(|t| t.corners == [(set, 1.0)]).map(|t| t.energy);
    let energy = own.unwrap_or_else(|| targets.iter().map(|t| t.energy).sum::<f64>() / targets.len() as f64);
    (energy / scale.max(f64::MIN_POSITIVE)).clamp(1e-4, 1.0).powf(0.25)
}
