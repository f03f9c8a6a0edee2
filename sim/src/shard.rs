//! One shard of a simulation: paths at one incident latitude, reweighted to every beam offset and absorption.
//!
//! A path's lateral position x is drawn once, uniformly (stratified) over the width that can hit the ply. A
//! beam centered at h has the density N(x - h; w0/2) there, so the path's weight for h is that density over
//! its own. One path serves every h, and with exp(-sigma L) every sigma. Light beyond the drawn width misses
//! for certain; its share is the Gaussian's tail.
//!
//! For a single ply, shards also record where light leaves it and where rays hit it, for the model of a yarn
//! ([`plywave_tables::table::ExitPositions`]).

use crate::incidence::Incidence;
use crate::rays::path::PathEnd;
use crate::target::{Target, ray};
use nalgebra::Vector3;
use plywave::ply::{DRIFT_BINS, drift_bin};
use plywave_runs::{ArrayLayout, Part, Values};
use plywave_tables::table::{DISPLACEMENTS, displacement_part};
use rand::{Rng, RngExt};
use std::sync::atomic::{AtomicBool, Ordering};

/// Paths between two checks of the stop flag.
const BATCH: u64 = 4096;
/// Number of standard deviations beyond which a beam's density counts as 0; the mass beyond is 8e-11.
const BEAM_SDS: f64 = 6.5;

/// Number of azimuth bins of exit positions, 10 degrees each.
pub(crate) const EXIT_AZIMUTHS: usize = 36;
/// Number of bins of lateral positions at which light leaves.
pub(crate) const EXIT_POSITIONS: usize = 16;
/// Number of bins of lateral positions at which rays hit the ply.
pub(crate) const HIT_POSITIONS: usize = 64;

/// Sums over the paths of one or more shards. Densities are not yet divided by solid angle and path count.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TableSums {
    /// `[bin][h][1 + sigma]`: reflection-only weight, then high-order weight for each sigma.
    pub bins: Vec<f32>,
    /// `[h][1 + sigma]`: sum of `bins` over all bins.
    pub energy: Vec<f64>,
    /// `[h][1 + sigma]`: sum of weight^2 / solid angle.
    pub noise: Vec<f64>,
    /// `[h]`: weight of paths that hit nothing, with the beam's tail.
    pub missed: Vec<f64>,
    /// `[h]`: weight of killed paths.
    pub killed: Vec<f64>,
    /// `[h]`: sum over pairs of neighboring strata of the squared difference of their total weights; for
    /// yarns, sum over the shards' instances of the squared error of their total weights.
    pub variance: Vec<f64>,
    /// Paths drawn; paths that hit a fiber; their wall interactions.
    pub counts: [f64; 3],
    /// `[azimuth][position][h][1 + sigma]`: weight by exit position; empty when not recorded.
    pub exit: Vec<f64>,
    /// `[2][x]`: number of paths through a lateral position, then number of those that hit a fiber; empty
    /// when not recorded. The array `met` of a part.
    pub hits: Vec<f64>,
    /// `[bin][displacement][sigma]`: sum of the transmittance of paths of f_high, by the displacement
    /// along the axis ([`displacement_part`]); empty when not recorded.
    pub drift: Vec<f64>,
    /// `[row][bin]`: probability to hit a fiber by lateral position, at each fine latitude, summed over
    /// instances. This field and the next two are empty if energies are not tallied. The array `miss_met` of
    /// a part.
    pub miss_hits: Vec<f64>,
    /// `[row][h]`: square of the missed share, summed over instances.
    pub miss_squares: Vec<f64>,
    /// `[row][bin][2 + sigma]`: energies of paths that hit a fiber, by lateral position: killed, reflected,
    /// high-order at each sigma.
    pub shares: Vec<f64>,
}

impl TableSums {
    pub fn zero(at: &Incidence<'_>) -> TableSums {
        let (h, c) = (at.h_um.len(), 1 + at.sigma_per_um.len());
        let energies = TableSums::energies(at);
        TableSums {
            bins: vec![0.0; at.grid.len() * h * c],
            energy: vec![0.0; h * c],
            noise: vec![0.0; h * c],
            missed: vec![0.0; h],
            killed: vec![0.0; h],
            variance: vec![0.0; h],
            counts: [0.0; 3],
            exit: vec![0.0; if at.record_exits { EXIT_AZIMUTHS * EXIT_POSITIONS * h * c } else { 0 }],
            hits: vec![0.0; if at.record_exits { 2 * HIT_POSITIONS } else { 0 }],
            drift: vec![0.0; if at.record_exits { DRIFT_BINS * DISPLACEMENTS * (c - 1) } else { 0 }],
            miss_hits: vec![0.0; energies[0].iter().product()],
            miss_squares: vec![0.0; energies[1].iter().product()],
            shares: vec![0.0; energies[2].iter().product()],
        }
    }

    /// Shapes of the energies' arrays.
    fn energies(at: &Incidence<'_>) -> [[usize; 3]; 3] {
        let channels = 2 + at.sigma_per_um.len();
        at.energies.map_or([[0; 3]; 3], |e| {
            [
                [1, e.miss_rows, e.bins.count],
                [1, e.miss_rows, e.miss_h_um.len()],
                [e.share_rows, e.bins.count, channels],
            ]
        })
    }

    /// Arrays of the part that holds the sums, in the order of the fields. No value is negative, since all
    /// are sums of densities, squares, tails or counts.
    pub fn layout(at: &Incidence<'_>) -> Vec<ArrayLayout> {
        let (h, c) = (at.h_um.len(), 1 + at.sigma_per_um.len());
        let (any, energies) = ([0.0, f64::MAX], TableSums::energies(at));
        let exits = if at.record_exits { [EXIT_AZIMUTHS, EXIT_POSITIONS, h, c] } else { [0; 4] };
        let hits = if at.record_exits { [2, HIT_POSITIONS] } else { [0; 2] };
        let drift = if at.record_exits { [DRIFT_BINS, DISPLACEMENTS, c - 1] } else { [0; 3] };
        vec![
            ArrayLayout::f32("bins", &[at.grid.len(), h, c], [0.0, f64::from(f32::MAX)]),
            ArrayLayout::f64("energy", &[h, c], any),
            ArrayLayout::f64("noise", &[h, c], any),
            ArrayLayout::f64("missed", &[h], any),
            ArrayLayout::f64("killed", &[h], any),
            ArrayLayout::f64("variance", &[h], any),
            ArrayLayout::f64("counts", &[3], any),
            ArrayLayout::f64("exit", &exits, any),
            ArrayLayout::f64("met", &hits, any),
            ArrayLayout::f64("drift", &drift, any),
            ArrayLayout::f64("miss_met", &energies[0], any),
            ArrayLayout::f64("miss_squares", &energies[1], any),
            ArrayLayout::f64("shares", &energies[2], any),
        ]
    }

    /// The sums as a part.
    pub fn into_part(self) -> Part {
        let TableSums { bins, energy, noise, missed, killed, variance, counts, exit, hits, drift, .. } = self;
        let TableSums { miss_hits, miss_squares, shares, .. } = self;
        let counts = counts.to_vec();
        let doubles =
            [energy, noise, missed, killed, variance, counts, exit, hits, drift, miss_hits, miss_squares, shares];
        Part::new(std::iter::once(Values::F32(bins)).chain(doubles.into_iter().map(Values::F64)).collect())
    }

    /// The sums of a part with the arrays of [`TableSums::layout`].
    pub fn from_part(part: &Part) -> TableSums {
        let doubles = |at: usize| part.f64(at).to_vec();
        let mut counts = [0.0; 3];
        counts.iter_mut().zip(part.f64(6)).for_each(|(to, v)| *to = *v);
        TableSums {
            bins: part.f32(0).to_vec(),
            energy: doubles(1),
            noise: doubles(2),
            missed: doubles(3),
            killed: doubles(4),
            variance: doubles(5),
            counts,
            exit: doubles(7),
            hits: doubles(8),
            drift: doubles(9),
            miss_hits: doubles(10),
            miss_squares: doubles(11),
            shares: doubles(12),
        }
    }

    /// Checks that sums over `paths` paths are plausible; the error names the impossible value.
    pub fn check(&self, paths: u64) -> Result<(), String> {
        let [drawn, hits, _] = self.counts;
        if drawn != paths as f64 || hits > drawn {
            return Err(format!("{hits} of {drawn} paths met a fiber, expected {paths} paths"));
        }
        let (drawn, hits) = self.hits.split_at(self.hits.len() / 2);
        if hits.iter().zip(drawn).any(|(hits, drawn)| hits > drawn) {
            return Err("more rays met the ply than were drawn".into());
        }
        Ok(())
    }
}

/// Traces `paths` paths over one ply or yarn and adds them to `sums`. Returns `None` when stopped.
pub(crate) fn trace_paths<R: Rng>(
    at: &Incidence<'_>,
    target: &Target<'_>,
    paths: u64,
    rng: &mut R,
    sums: &mut TableSums,
    stop: &AtomicBool,
    progress: &(dyn Fn(u64) + Sync),
) -> Option<()> {
    let half = target.half_width(at, BEAM_SDS);
    let sd = at.beam.sd_um();
    let peak = 2.0 * half / (sd * std::f64::consts::TAU.sqrt());
    let (h_count, channels) = (at.h_um.len(), 1 + at.sigma_per_um.len());
    // A latitude for energies alone has no offsets.
    let (first_h, inv_dh) = if h_count > 1 { (at.h_um[0], 1.0 / (at.h_um[1] - at.h_um[0])) } else { (0.0, 1.0) };
    let inv_solid_angle: Vec<f64> = (0..at.grid.theta_o).map(|i| 1.0 / at.grid.solid_angle(i)).collect();
    let mut weights = vec![0.0f64; h_count];
    let mut previous = vec![0.0f64; h_count];
    let mut absorbed = vec![0.0f64; channels];
    let mut shares = vec![1.0f64; h_count];
    let mut reach = (0usize, 0usize);
    for i in 0..paths {
        if i % BATCH == 0 {
            if stop.load(Ordering::Relaxed) {
                return None;
            }
            progress(BATCH.min(paths - i));
        }
        let u: f64 = rng.random();
        let x = half * (2.0 * (i as f64 + u) / paths as f64 - 1.0);
        let ray_dir = ray(at, rng);
        let (end, share) = target.walk(i, x, ray_dir, at.surfaces, rng, &mut shares);
        // Weight of the path for each h that its position contributes to.
        let lo = ((x - BEAM_SDS * sd - first_h) * inv_dh).ceil().max(0.0) as usize;
        let hi = (((x + BEAM_SDS * sd - first_h) * inv_dh).floor() + 1.0).clamp(0.0, h_count as f64) as usize;
        for n in lo..hi {
            let t = (x - at.h_um[n]) / sd;
            weights[n] = peak * (-0.5 * t * t).exp();
        }
        if share {
            (lo..hi.max(lo)).for_each(|n| weights[n] *= shares[n]);
        }
        let lo = lo.min(hi);
        sums.counts[0] += 1.0;
        if at.record_exits && x.abs() < at.radius_um {
            let place = ((0.5 * x / at.radius_um + 0.5) * HIT_POSITIONS as f64) as usize;
            sums.hits[place.min(HIT_POSITIONS - 1)] += 1.0;
            if !matches!(end, PathEnd::Miss) {
                sums.hits[HIT_POSITIONS + place.min(HIT_POSITIONS - 1)] += 1.0;
            }
        }
        // The drawn width differs between instances, hence its factor.
        let tally = at.energies.and_then(|e| e.bins.of(x).map(|bin| (bin * (channels + 1), half / e.bins.reach_um)));
        let mut record = |dir: Vector3<f32>, pos: Vector3<f32>, first: usize, absorbed: &[f64], interactions: u32| {
            sums.counts[1] += 1.0;
            sums.counts[2] += f64::from(interactions);
            let bin = at.grid.bin([dir.x, dir.y, dir.z]);
            let inv = inv_solid_angle[bin / at.grid.phi_o];
            let exit = if at.record_exits { exit_place(dir, pos, at.radius_um as f32) * h_count } else { 0 };
            for n in lo..hi {
                let place = (bin * h_count + n) * channels + first;
                let total = n * channels + first;
                for (k, a) in absorbed.iter().enumerate() {
                    let w = weights[n] * a;
                    sums.bins[place + k] += w as f32;
                    sums.energy[total + k] += w;
                    sums.noise[total + k] += w * w * inv;
                    if at.record_exits {
                        sums.exit[(exit + n) * channels + first + k] += w;
                    }
                }
            }
            if let Some((place, weight)) = tally {
                for (k, a) in absorbed.iter().enumerate() {
                    sums.shares[place + 1 + first + k] += weight * a;
                }
            }
        };
        match end {
            PathEnd::Reflected { dir, pos, interactions } => record(dir, pos, 0, &[1.0], interactions),
            PathEnd::High { dir, pos, length_um, interactions } => {
                for (a, sigma) in absorbed.iter_mut().zip(at.sigma_per_um) {
                    *a = (-sigma * f64::from(length_um)).exp();
                }
                record(dir, pos, 1, &absorbed[..channels - 1], interactions);
                if at.record_exits {
                    let place = drift_place((x as f32, ray_dir), (dir, pos), at.radius_um as f32) * (channels - 1);
                    sums.drift[place..].iter_mut().zip(&absorbed[..channels - 1]).for_each(|(sum, a)| *sum += a);
                }
            }
            PathEnd::Miss => (lo..hi).for_each(|n| sums.missed[n] += weights[n]),
            PathEnd::Killed => {
                if let Some((place, weight)) = tally {
                    sums.shares[place] += weight;
                }
                for n in lo..hi {
                    sums.killed[n] += weights[n];
                    weights[n] = 0.0;
                }
            }
        }
        if matches!(target, Target::Yarn(..)) {
            (lo..hi).for_each(|n| previous[n] += weights[n]);
            continue;
        }
        // The difference of two neighboring strata estimates the variance of the stratified total.
        if i % 2 == 0 {
            previous[lo..hi].copy_from_slice(&weights[lo..hi]);
            reach = (lo, hi);
        } else {
            for n in lo.min(reach.0)..hi.max(reach.1) {
                let get = |w: &[f64], r: (usize, usize)| if n >= r.0 && n < r.1 { w[n] } else { 0.0 };
                sums.variance[n] += (get(&weights, (lo, hi)) - get(&previous, reach)).powi(2);
            }
        }
    }
    // The tail of each beam beyond the drawn width counts as missed, with a weight of the same scale.
    for (n, h) in at.h_um.iter().enumerate() {
        let tail = paths as f64 * (upper_tail((half - h) / sd) + upper_tail((half + h) / sd));
        sums.missed[n] += tail;
        if matches!(target, Target::Yarn(..)) {
            // Neighboring strata differ in psi and cannot be paired. The expected total of the shard is
            // known, so its error estimates the variance.
            sums.variance[n] += (previous[n] + tail - paths as f64).powi(2);
        }
    }
    Some(())
}

/// Exit bin `[azimuth][position]` of the line through `pos` in direction `dir`: position along (-sin phi, cos
/// phi) over [-radius, radius].
fn exit_place(dir: Vector3<f32>, pos: Vector3<f32>, radius: f32) -> usize {
    let across = dir.xy().norm().max(1e-12);
    let t = (dir.x * pos.y - dir.y * pos.x) / across;
    let turn = dir.y.atan2(dir.x) / std::f32::consts::TAU;
    let azimuth = ((turn - turn.floor()) * EXIT_AZIMUTHS as f32) as usize;
    let position = ((0.5 * t / radius + 0.5).clamp(0.0, 1.0) * EXIT_POSITIONS as f32) as usize;
    azimuth.min(EXIT_AZIMUTHS - 1) * EXIT_POSITIONS + position.min(EXIT_POSITIONS - 1)
}

/// Place `[bin][displacement]` of light that came through (x, 0, 0) in direction `ray_dir` and leaves through
/// `pos` in direction `dir`. The displacement is that between the points where the two lines cross the
/// cylinder of the ply's radius.
fn drift_place((x, ray_dir): (f32, Vector3<f32>), (dir, pos): (Vector3<f32>, Vector3<f32>), radius: f32) -> usize {
    // Distance along z from the point of a line nearest to the axis to where it crosses the cylinder.
    let half_chord = |dir: Vector3<f32>, offset: f32| {
        (radius * radius - offset * offset).max(0.0).sqrt() * dir.z / dir.xy().norm().max(1e-6)
    };
    let nearest = |dir: Vector3<f32>, pos: Vector3<f32>| {
        pos.z - pos.xy().dot(&dir.xy()) / dir.xy().norm_squared().max(1e-12) * dir.z
    };
    let offset = |dir: Vector3<f32>, pos: Vector3<f32>| dir.xy().perp(&pos.xy()) / dir.xy().norm().max(1e-6);
    let from = Vector3::new(x, 0.0, 0.0);
    let entry = nearest(ray_dir, from) - half_chord(ray_dir, offset(ray_dir, from));
    let leaves = nearest(dir, pos) + half_chord(dir, offset(dir, pos));
    drift_bin(dir.z) * DISPLACEMENTS + displacement_part(f64::from((leaves - entry) / radius))
}

/// Upper tail of the standard normal distribution, by Simpson's rule on the density; absolute error below
/// 1e-9.
fn upper_tail(t: f64) -> f64 {
    if t < 0.0 {
        return 1.0 - upper_tail(-t);
    }
    let end = t.max(7.0) + 1.0;
    let n = 800;
    let step = (end - t) / n as f64;
    let f = |k: usize| (-0.5 * (t + k as f64 * step).powi(2)).exp();
    let inner: f64 = (1..n).map(|k| f(k) * if k % 2 == 1 { 4.0 } else { 2.0 }).sum();
    (f(0) + inner + f(n)) * step / 3.0 / std::f64::consts::TAU.sqrt()
}

#[cfg(test)]
mod tests {
    use super::upper_tail;

    #[test]
    fn upper_tail_has_the_published_digits() {
        for (t, want) in [(0.0, 0.5), (1.0, 0.158_655_253_931), (3.0, 0.001_349_898_032), (-2.0, 0.977_249_868_052)] {
            assert!((upper_tail(t) - want).abs() < 1e-9, "{t}: {} against {want}", upper_tail(t));
        }
    }
}
