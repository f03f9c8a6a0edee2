//! Noise of a sum of slices at different offsets.
//!
//! One path serves every offset (`sim/src/shard.rs`): its weight for h is the beam's density g(x - h) at its
//! lateral position x. Slices at neighboring offsets therefore share paths. With the probability m(x) to hit
//! a fiber, the correlation of the noise at h and h' is
//!
//! ```text
//! integral g(x - h) g(x - h') m(x) dx / sqrt(integral g(x - h)^2 m(x) dx * integral g(x - h')^2 m(x) dx)
//! ```
//!
//! Within the ply, where m is nearly constant, it is exp(-(h - h')^2 / (4 s^2)) with the standard deviation s
//! of g, which is 0.7 between adjacent nodes of usual tables. At the rim, where beams hit only the same edge,
//! it is near 1. A beam beyond the rim hits many offsets of other plies; treating its parts as independent
//! would halve their noise.

/// Minimum correlation that is not neglected.
const MIN: f64 = 1e-3;

/// `[n][k]`: correlation of the noise of the slices at `h_um[n]` and `h_um[k]`, 0 for slices that no light
/// reaches. `hit` returns the probability to hit a fiber at x.
pub(super) fn correlations(h_um: &[f64], beam_sd_um: f64, hit: impl Fn(f64) -> f64) -> Vec<f64> {
    const SDS: f64 = 5.0;
    let step = 0.125 * beam_sd_um;
    let (low, high) = h_um.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(*h), b.max(*h)));
    let count = ((high - low + 2.0 * SDS * beam_sd_um) / step) as usize;
    let lines: Vec<(f64, f64)> =
        (0..count).map(|i| low - SDS * beam_sd_um + (i as f64 + 0.5) * step).map(|x| (x, hit(x).max(0.0))).collect();
    let overlap = |a: f64, b: f64| -> f64 {
        let both = |x: f64| (-0.5 * ((x - a).powi(2) + (x - b).powi(2)) / (beam_sd_um * beam_sd_um)).exp();
        lines.iter().map(|(x, m)| m * both(*x)).sum()
    };
    let own: Vec<f64> = h_um.iter().map(|h| overlap(*h, *h)).collect();
    let pair = |n: usize, k: usize| match (own[n] * own[k]).sqrt() {
        norm if norm > 0.0 => overlap(h_um[n], h_um[k]) / norm,
        _ => 0.0,
    };
    (0..h_um.len() * h_um.len()).map(|i| pair(i / h_um.len(), i % h_um.len())).collect()
}

/// Accumulates the variance of a sum of slices, which are added in ascending order of their offsets.
#[derive(Default)]
pub(super) struct PartsNoise {
    /// Integral over the sphere of the sum's variance [1/sr].
    pub integral: f64,
    /// The last parts: offset node, and `[bin]` standard deviation times the square root of the solid angle.
    recent: Vec<(usize, Vec<f32>)>,
}

impl PartsNoise {
    /// Adds the slice at offset node `node` with the variance `scale * variance[bin]` (solid angle included)
    /// and its `correlation` with the slices of earlier nodes.
    pub fn add(&mut self, node: usize, variance: Vec<f32>, scale: f64, correlation: impl Fn(usize) -> f64) {
        self.recent.retain(|(from, _)| correlation(*from) >= MIN);
        self.integral += scale * variance.iter().map(|v| f64::from(*v)).sum::<f64>();
        let mut deviation = variance;
        deviation.iter_mut().for_each(|v| *v = (scale as f32 * *v).sqrt());
        for (from, other) in &self.recent {
            let both: f32 = deviation
                .chunks(64)
                .zip(other.chunks(64))
                .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>())
                .sum();
            self.integral += 2.0 * correlation(*from) * f64::from(both);
        }
        self.recent.push((node, deviation));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// Slices that share paths, each path weighted by the beam's density at every offset, are summed with
    /// weights. The variance of the sum over runs agrees with the prediction from the slices' variances and
    /// correlations, not with that of independent slices.
    #[test]
    fn noise_of_slices_that_share_paths() {
        let (s, step_um, nodes, bins, paths, runs) = (5.0f64, 5.83f64, 9, 24, 1500, 400);
        let weights = [3.0, 1.5, 0.9, 1.0, 0.7, 0.0, 0.0, 0.4, 0.2];
        let reach = 0.5 * step_um * (nodes - 1) as f64 + 4.0 * s;
        let h = |n: usize| step_um * (n as f64 - 0.5 * (nodes - 1) as f64);
        // Beyond the ply's edges nothing is hit, so the outermost beams share their paths.
        let hit = |x: f64| if x.abs() < 18.0 { 1.0 } else { 0.0 };
        let correlated = correlations(&(0..nodes).map(h).collect::<Vec<_>>(), s, hit);
        assert!((correlated[4 * nodes + 5] - (-0.25 * (step_um / s).powi(2)).exp()).abs() < 0.02);
        assert!(correlated[1] > 0.9 && correlated[nodes + 1] == 1.0);
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        // The density over the bins is not uniform; it is the same for every x.
        let cumulative = |b: usize| (b as f64 / bins as f64).powi(2);
        let (mut sums, mut squares) = (vec![0.0; bins], vec![0.0; bins]);
        let (mut own, mut own2) = (vec![vec![0.0; bins]; nodes], vec![vec![0.0; bins]; nodes]);
        for _ in 0..runs {
            let mut slices = vec![vec![0.0f64; bins]; nodes];
            for _ in 0..paths {
                let x = reach * (2.0 * rng.random::<f64>() - 1.0);
                let b = ((rng.random::<f64>().sqrt() * bins as f64) as usize).min(bins - 1);
                for (n, slice) in slices.iter_mut().enumerate() {
                    slice[b] += hit(x) * (-0.5 * ((x - h(n)) / s).powi(2)).exp() / paths as f64;
                }
            }
            for b in 0..bins {
                let sum: f64 = (0..nodes).map(|n| weights[n] * slices[n][b]).sum();
                sums[b] += sum;
                squares[b] += sum * sum;
                for n in 0..nodes {
                    own[n][b] += slices[n][b];
                    own2[n][b] += slices[n][b] * slices[n][b];
                }
            }
        }
        let r = f64::from(runs);
        let variance = |sum: f64, square: f64| (square - sum * sum / r) / (r - 1.0);
        let truth: f64 = (0..bins).map(|b| variance(sums[b], squares[b])).sum();
        let mut noise = PartsNoise::default();
        let mut apart = 0.0;
        for n in (0..nodes).filter(|n| weights[*n] > 0.0) {
            let total: f64 = (0..bins).map(|b| variance(own[n][b], own2[n][b])).sum::<f64>();
            // The slice's integral of variance is distributed like its density, like in the construction.
            let factor = |b: usize| (cumulative(b + 1) - cumulative(b)) * weights[n] * weights[n];
            noise.add(n, (0..bins).map(|b| factor(b) as f32).collect(), total, |from| correlated[from * nodes + n]);
            apart += total * weights[n] * weights[n];
        }
        assert!((noise.integral / truth - 1.0).abs() < 0.06, "{} of {truth}", noise.integral);
        assert!(apart < 0.6 * truth, "independent parts would have {apart} of {truth}");
    }
}
