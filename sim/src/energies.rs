//! Energies of one ply on grids finer than those of its slices, at a cost a path that no grid adds to.
//!
//! With g the beam's profile, of standard deviation s, and m(x) the chance that the line at lateral position x hits a fiber,
//!
//! ```text
//! r_d(h) = 1 - integral of m(x) g(x - h) dx,      q_c(h) = integral of e_c(x) g(x - h) dx / integral of m(x) g(x - h) dx
//! ```
//!
//! where e_c(x) is what paths at x bring into channel c (f_refl, f_high at each sigma). So both come from histograms over x, into which a path or ray adds
//! once, convolved with the beam afterwards; bins of s/16 blur a step of m by 1e-4 at most.
//!
//! *r_d* has rays of its own that end at the first wall. They cost a tenth of a path, and all that they depend on beside the beam's divergence is the line's
//! position and the ply's turn: x is stratified and the turn follows the golden ratio from ray to ray, which covers the rectangle evenly. Its standard error is
//! that of the mean over the instances. Along theta_i it has a ridge where light runs parallel to the fibers of the rim, which lean by k r at radius r,
//! k = 2 pi / pitch: at `cot theta_i = k h`. Its width along theta_i is that of the beam across it, `s k / (1 + k^2 R^2)`, and the divergence.
//!
//! *q* is a ratio of sums over the same paths. With n paths in a bin, each with weight w in a channel, 0 <= w <= 1, the variance of the numerator less q
//! times the denominator is `sum_b g_b^2 sum (w - q)^2 <= sum_b g_b^2 ((1 - 2 q) sum w + n q^2)`, an equality where w is 0 or 1, as at sigma = 0.

use crate::incidence::Incidence;
use crate::options::SimOptions;
use crate::rays::tracer::Tracer;
use crate::shard::Sums;
use crate::target::{hits, ray};
use plywave::spec::YarnSpec;
use plywave::table::TableEnergies;
use rand::{Rng, RngExt};

/// Bins of lateral positions in a standard deviation of the beam, and the most of them.
const BINS_PER_SD: f64 = 16.0;
const MOST_BINS: f64 = 8192.0;
/// Steps of r_d, in standard deviations of the beam or of what it makes of the ridge; a spline is then good to 4e-4 of an edge's height.
const MISS_STEP_SDS: f64 = 0.4;
const RIDGE_STEP_SDS: f64 = 0.6;
/// Steps of r_d along theta_i where there is no ridge, and of the shares [rad].
const PLAIN_STEP_RAD: f64 = 0.07;
const SHARE_STEP_RAD: f64 = 0.18;
/// Step of the shares along h, in standard deviations of the beam.
const SHARE_STEP_SDS: f64 = 1.2;
/// Most nodes of an axis.
const MOST_NODES: usize = 1001;
/// Rays of a latitude of r_d over all instances, and the least of one.
const RAYS: u64 = 1 << 18;
const LEAST_RAYS: u64 = 1 << 12;

/// The grids, as refinements of those of the slices.
#[derive(Clone, Debug)]
pub(crate) struct EnergyGrids {
    /// Latitudes of r_d for each of the slices'.
    pub miss_rows: usize,
    pub miss_h_um: Vec<f64>,
    /// Latitudes of the shares for each of the slices'.
    pub share_rows: usize,
    pub share_h_um: Vec<f64>,
    pub bins: PositionBins,
    /// Rays of an instance at a latitude.
    pub rays: u64,
}

/// Equal bins of lateral positions in [-reach, reach].
#[derive(Clone, Copy, Debug)]
pub(crate) struct PositionBins {
    pub reach_um: f64,
    pub count: usize,
}

impl PositionBins {
    fn width_um(&self) -> f64 {
        2.0 * self.reach_um / self.count as f64
    }

    fn center_um(&self, bin: usize) -> f64 {
        self.width_um() * (bin as f64 + 0.5) - self.reach_um
    }

    /// The bin of a position, if it is within the reach.
    pub fn of(&self, x: f64) -> Option<usize> {
        (x.abs() < self.reach_um).then(|| (((x + self.reach_um) / self.width_um()) as usize).min(self.count - 1))
    }

    /// The beam's logarithm of density about `h` at each bin, less its greatest at a bin that counts.
    fn beam(&self, h: f64, sd: f64, counts: impl Fn(usize) -> bool) -> Vec<f64> {
        let log = |b: usize| -0.5 * ((self.center_um(b) - h) / sd).powi(2);
        let top = (0..self.count).filter(|b| counts(*b)).map(log).fold(f64::NEG_INFINITY, f64::max);
        (0..self.count).map(|b| (log(b) - top).min(0.0).exp()).collect()
    }
}

/// How many latitudes the shares have for each of the slices'.
pub(crate) fn share_rows(options: &SimOptions) -> usize {
    let theta_i = options.theta_i();
    refinement(theta_i[1] - theta_i[0], SHARE_STEP_RAD, theta_i.len())
}

/// Parts of a step that make it `wanted` or less, for an axis of `nodes`.
fn refinement(step: f64, wanted: f64, nodes: usize) -> usize {
    ((step / wanted - 1e-9).ceil().max(1.0) as usize).min(((MOST_NODES - 1) / (nodes - 1)).max(1))
}

/// An axis with each step cut into `parts`.
fn refined(axis: &[f64], parts: usize) -> Vec<f64> {
    let cells = (axis.len() - 1) * parts;
    let (first, last) = (axis[0], axis[axis.len() - 1]);
    (0..=cells).map(|i| first + (last - first) * i as f64 / cells as f64).collect()
}

impl EnergyGrids {
    pub fn new(spec: &YarnSpec, options: &SimOptions, theta_i: &[f64], h_um: &[f64]) -> EnergyGrids {
        let (sd, radius) = (spec.beam.beam().sd_um(), spec.ply_ring().radius_um);
        let reach_um = h_um[h_um.len() - 1];
        let along_h = |sds: f64| refined(h_um, refinement(h_um[1] - h_um[0], sds * sd, h_um.len()));
        let k = spec.ply.fiber_pitch_um.map_or(0.0, |pitch| std::f64::consts::TAU / pitch);
        let width = (sd * k / (1.0 + (k * radius).powi(2))).hypot(spec.beam.beam().angular_sd_rad());
        let ridge = (1.0f64).atan2(k * radius) - 3.0 * width < theta_i[theta_i.len() - 1];
        let step = if k > 0.0 && ridge { (RIDGE_STEP_SDS * width).min(PLAIN_STEP_RAD) } else { PLAIN_STEP_RAD };
        EnergyGrids {
            miss_rows: refinement(theta_i[1] - theta_i[0], step, theta_i.len()),
            miss_h_um: along_h(MISS_STEP_SDS),
            share_rows: share_rows(options),
            share_h_um: along_h(SHARE_STEP_SDS),
            bins: PositionBins {
                reach_um,
                count: (2.0 * reach_um / sd * BINS_PER_SD).ceil().clamp(64.0, MOST_BINS) as usize,
            },
            rays: (RAYS / u64::from(options.instances.max(1))).max(LEAST_RAYS),
        }
    }

    /// Fraction of the beams at `miss_h_um` that hits no fiber, of the chances `met` to hit one.
    fn missed(&self, met: &[f64], sd: f64) -> Vec<f64> {
        let density = self.bins.width_um() / (sd * std::f64::consts::TAU.sqrt());
        let of = |h: &f64| {
            let hit: f64 = (0..self.bins.count)
                .map(|b| met[b] * density * (-0.5 * ((self.bins.center_um(b) - h) / sd).powi(2)).exp())
                .sum();
            (1.0 - hit).clamp(0.0, 1.0)
        };
        self.miss_h_um.iter().map(of).collect()
    }

    /// Adds the rays of one instance at latitude `row` of the fine ones of `at` to `sums`.
    pub fn trace_rays<R: Rng>(
        &self,
        at: &Incidence<'_>,
        tracer: &dyn Tracer,
        row: usize,
        rng: &mut R,
        sums: &mut Sums,
    ) {
        let half = (f64::from(tracer.bound_radius_um()) / at.sideways_rad().cos()).min(self.bins.reach_um);
        let (mut drawn, mut met) = (vec![0.0f64; self.bins.count], vec![0.0f64; self.bins.count]);
        let start: f64 = rng.random();
        for i in 0..self.rays {
            let x = half * (2.0 * (i as f64 + rng.random::<f64>()) / self.rays as f64 - 1.0);
            let turn = (start + crate::target::GOLDEN * i as f64).fract();
            let hit = hits(tracer, x as f32, ray(at, rng), turn as f32, rng);
            if let Some(bin) = self.bins.of(x) {
                drawn[bin] += 1.0;
                met[bin] += f64::from(u8::from(hit));
            }
        }
        let width = self.bins.width_um();
        for b in 0..self.bins.count {
            let (low, high) = (self.bins.center_um(b) - 0.5 * width, self.bins.center_um(b) + 0.5 * width);
            let covered = ((high.min(half) - low.max(-half)) / width).max(0.0);
            met[b] *= covered / drawn[b].max(1.0);
        }
        let (columns, count) = (self.miss_h_um.len(), self.bins.count);
        let squares = &mut sums.miss_squares[row * columns..(row + 1) * columns];
        for (sum, missed) in squares.iter_mut().zip(self.missed(&met, at.beam.sd_um())) {
            *sum += missed * missed;
        }
        sums.miss_met[row * count..(row + 1) * count].iter_mut().zip(&met).for_each(|(sum, met)| *sum += met);
    }

    /// Energies without a number yet, of slices at these nodes.
    pub fn empty(&self, theta_i: &[f64], sigmas: usize) -> TableEnergies {
        let (miss_theta_i, share_theta_i) = (refined(theta_i, self.miss_rows), refined(theta_i, self.share_rows));
        let nodes = miss_theta_i.len() * self.miss_h_um.len();
        let shares = share_theta_i.len() * self.share_h_um.len();
        TableEnergies {
            miss: vec![0.0; nodes],
            miss_se: vec![0.0; nodes],
            met: vec![0.0; miss_theta_i.len() * self.bins.count],
            share_refl: vec![0.0; shares],
            share_high: vec![0.0; shares * sigmas],
            share_se: vec![0.0; shares * (1 + sigmas)],
            miss_theta_i,
            share_theta_i,
            miss_h_um: self.miss_h_um.clone(),
            share_h_um: self.share_h_um.clone(),
        }
    }

    /// Rows of latitude `m` of the slices from its sums over `runs` runs of instances, of which `instances` were different.
    pub fn fill(&self, to: &mut TableEnergies, m: usize, sd: f64, sums: &Sums, runs: f64, instances: f64) {
        let (count, columns) = (self.bins.count, self.miss_h_um.len());
        for row in 0..self.miss_rows.min(to.miss_theta_i.len() - m * self.miss_rows) {
            let a = m * self.miss_rows + row;
            let met: Vec<f64> = sums.miss_met[row * count..(row + 1) * count].iter().map(|v| v / runs).collect();
            to.met[a * count..(a + 1) * count].iter_mut().zip(&met).for_each(|(to, v)| *to = (*v as f32).min(1.0));
            for (n, missed) in self.missed(&met, sd).into_iter().enumerate() {
                let variance = sums.miss_squares[row * columns + n] / runs - missed * missed;
                to.miss[a * columns + n] = missed;
                to.miss_se[a * columns + n] = (variance.max(0.0) / (instances - 1.0).max(1.0)).sqrt();
            }
        }
        let channels = 2 + to.share_high.len() / to.share_refl.len();
        for row in 0..self.share_rows.min(to.share_theta_i.len() - m * self.share_rows) {
            let tally = &sums.shares[row * count * channels..(row + 1) * count * channels];
            for (n, h) in self.share_h_um.iter().enumerate() {
                let node = (m * self.share_rows + row) * self.share_h_um.len() + n;
                self.fill_shares(to, node, *h, sd, tally, channels);
            }
        }
    }

    /// The shares at one node from `tally[bin][killed, refl, high..]`.
    fn fill_shares(&self, to: &mut TableEnergies, node: usize, h: f64, sd: f64, tally: &[f64], channels: usize) {
        // All that hit a fiber: sigma[0] = 0, where f_high has lost nothing.
        let hit = |b: usize| tally[b * channels..][..3].iter().sum::<f64>();
        let beam = self.bins.beam(h, sd, |b| hit(b) > 0.0);
        let over = |of: &dyn Fn(usize) -> f64| (0..self.bins.count).map(of).sum::<f64>();
        let all = over(&|b| beam[b] * hit(b));
        if all <= 0.0 {
            return;
        }
        for c in 1..channels {
            let of = |b: usize| tally[b * channels + c];
            let q = over(&|b| beam[b] * of(b)) / all;
            let variance = over(&|b| beam[b] * beam[b] * ((1.0 - 2.0 * q) * of(b) + q * q * hit(b)).max(0.0));
            let se = variance.sqrt() / all;
            to.share_se[node * (channels - 1) + c - 1] = se;
            match c {
                1 => to.share_refl[node] = q,
                c => to.share_high[node * (channels - 2) + c - 2] = q,
            }
        }
    }
}
