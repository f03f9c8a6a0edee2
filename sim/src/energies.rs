//! Energies of one ply on grids that are finer than those of its slices. The cost per path does not depend on
//! the grids.
//!
//! Let g be the beam's profile with standard deviation s, and m(x) the probability that the line at lateral
//! position x hits a fiber. Then
//!
//! ```text
//! r_d(h) = 1 - integral of m(x) g(x - h) dx,      q_c(h) = integral of e_c(x) g(x - h) dx / integral of m(x) g(x - h) dx
//! ```
//!
//! where e_c(x) is the energy that paths at x add to channel c (f_refl, f_high at each sigma). Both follow
//! from histograms over x, which are convolved with the beam afterwards. A path or ray adds to a histogram
//! once, and bins of s/16 blur a step of m by 1e-4 at most.
//!
//! *r_d* has its own rays, which end at the first wall and cost a tenth of a path. Apart from the beam's
//! divergence, a ray depends only on the line's position and the ply's rotation: x is stratified, and the
//! rotation follows the golden ratio from ray to ray, which covers the rectangle uniformly. The standard
//! error of r_d is that of the mean over the instances. Along theta_i, r_d has a ridge where light runs
//! parallel to the fibers of the rim: at radius r they lean by k r, k = 2 pi / pitch, so the ridge lies at
//! `cot theta_i = k h`. Its width along theta_i combines that of the beam across it, `s k / (1 + k^2 R^2)`,
//! and the divergence.
//!
//! *q* is a ratio of sums over the same paths. With n paths in a bin, each with weight w in a channel, 0 <= w
//! <= 1, the variance of the numerator minus q times the denominator is
//! `sum_b g_b^2 sum (w - q)^2 <= sum_b g_b^2 ((1 - 2 q) sum w + n q^2)`, with equality if w is 0 or 1, which
//! holds at sigma = 0.

use crate::energy_grids::EnergyGrids;
use crate::incidence::Incidence;
use crate::rays::tracer::Tracer;
use crate::shard::TableSums;
use crate::target::{GOLDEN, hits, ray};
use plywave_tables::table::TableEnergies;
use rand::{Rng, RngExt};

impl EnergyGrids {
    /// Adds the rays of one instance to `sums`, at fine latitude `row` of `at`.
    pub fn trace_rays<R: Rng>(
        &self,
        at: &Incidence<'_>,
        tracer: &dyn Tracer,
        row: usize,
        rng: &mut R,
        sums: &mut TableSums,
    ) {
        let half = (f64::from(tracer.bound_radius_um()) / at.sideways_rad().cos()).min(self.bins.reach_um);
        let (mut drawn, mut hits_by_bin) = (vec![0.0f64; self.bins.count], vec![0.0f64; self.bins.count]);
        let start: f64 = rng.random();
        for i in 0..self.rays {
            let x = half * (2.0 * (i as f64 + rng.random::<f64>()) / self.rays as f64 - 1.0);
            let turn = (start + GOLDEN * i as f64).fract();
            let hit = hits(tracer, x as f32, ray(at, rng), turn as f32, rng);
            if let Some(bin) = self.bins.of(x) {
                drawn[bin] += 1.0;
                hits_by_bin[bin] += f64::from(u8::from(hit));
            }
        }
        let width = self.bins.width_um();
        for b in 0..self.bins.count {
            let (low, high) = (self.bins.center_um(b) - 0.5 * width, self.bins.center_um(b) + 0.5 * width);
            let covered = ((high.min(half) - low.max(-half)) / width).max(0.0);
            hits_by_bin[b] *= covered / drawn[b].max(1.0);
        }
        let (columns, count) = (self.miss_h_um.len(), self.bins.count);
        let squares = &mut sums.miss_squares[row * columns..(row + 1) * columns];
        for (sum, missed) in squares.iter_mut().zip(self.missed(&hits_by_bin, at.beam.sd_um())) {
            *sum += missed * missed;
        }
        sums.miss_hits[row * count..(row + 1) * count]
            .iter_mut()
            .zip(&hits_by_bin)
            .for_each(|(sum, hits)| *sum += hits);
    }

    /// Fills the rows of slice latitude `m` from its sums over `runs` runs with `instances` different
    /// instances. `sd` is the standard deviation of the beam [um].
    pub fn fill(&self, to: &mut TableEnergies, m: usize, sd: f64, sums: &TableSums, runs: f64, instances: f64) {
        let (count, columns) = (self.bins.count, self.miss_h_um.len());
        for row in 0..self.miss_rows.min(to.miss_theta_i.len() - m * self.miss_rows) {
            let a = m * self.miss_rows + row;
            let hits: Vec<f64> = sums.miss_hits[row * count..(row + 1) * count].iter().map(|v| v / runs).collect();
            to.met[a * count..(a + 1) * count].iter_mut().zip(&hits).for_each(|(to, v)| *to = (*v as f32).min(1.0));
            for (n, missed) in self.missed(&hits, sd).into_iter().enumerate() {
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

    /// Fills the shares at one node from `tally[bin][killed, refl, high..]`.
    fn fill_shares(&self, to: &mut TableEnergies, node: usize, h: f64, sd: f64, tally: &[f64], channels: usize) {
        // Number of all paths that hit a fiber: at sigma[0] = 0, f_high has no absorption.
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
