//! One shard of a simulation: paths at one incident latitude, reweighted to every beam offset and absorption.
//!
//! A path's lateral position x is drawn once, uniformly (stratified) over the width that can meet the ply. A beam centered
//! at h has the density N(x - h; w0/2) there, so the path counts for h with that density over its own: one path serves every h,
//! and with exp(-sigma L) every sigma. Light beyond the drawn width misses for certain; its share is the Gaussian's tail.

use crate::dielectric::{RoughDielectric, sin_cos_turn};
use crate::path::{PathEnd, trace_path};
use crate::tracer::Tracer;
use nalgebra::Vector3;
use plywave::{GaussianBeam, OutgoingGrid};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use std::sync::atomic::{AtomicBool, Ordering};

/// Paths between two looks at the stop flag.
const BATCH: u64 = 4096;
/// Standard deviations beyond which a beam's density counts as 0; the mass beyond is 8e-11.
const BEAM_SDS: f64 = 6.5;

/// What is the same for all shards of an incident latitude.
pub(crate) struct Incidence<'a> {
    pub theta_i: f64,
    pub h_um: &'a [f64],
    pub sigma_per_um: &'a [f64],
    pub beam: GaussianBeam,
    pub grid: OutgoingGrid,
    pub surface: RoughDielectric,
}

/// Sums over the paths of one or more shards. Densities are not yet divided by solid angle and path count.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sums {
    /// `[bin][h][1 + sigma]`: reflection-only weight, then high-order weight for each sigma.
    pub bins: Vec<f32>,
    /// `[h][1 + sigma]`: the same over all bins.
    pub energy: Vec<f64>,
    /// `[h][1 + sigma]`: sum of weight^2 / solid angle.
    pub noise: Vec<f64>,
    /// `[h]`: weight of paths that met nothing, with the beam's tail.
    pub missed: Vec<f64>,
    /// `[h]`: weight of killed paths.
    pub killed: Vec<f64>,
    /// `[h]`: sum over pairs of neighboring strata of the squared difference of their total weights.
    pub variance: Vec<f64>,
    /// Paths drawn; paths that met a fiber; their wall interactions.
    pub counts: [f64; 3],
}

impl Sums {
    pub fn zero(at: &Incidence<'_>) -> Sums {
        let (h, c) = (at.h_um.len(), 1 + at.sigma_per_um.len());
        Sums {
            bins: vec![0.0; at.grid.len() * h * c],
            energy: vec![0.0; h * c],
            noise: vec![0.0; h * c],
            missed: vec![0.0; h],
            killed: vec![0.0; h],
            variance: vec![0.0; h],
            counts: [0.0; 3],
        }
    }

    pub fn add(&mut self, other: &Sums) {
        self.bins.iter_mut().zip(&other.bins).for_each(|(a, b)| *a += b);
        for ((_, to), (_, from)) in self.doubles_mut().into_iter().zip(other.doubles()) {
            to.iter_mut().zip(from).for_each(|(a, b)| *a += b);
        }
    }

    /// The double-precision sums, by name.
    pub fn doubles(&self) -> [(&'static str, &[f64]); 6] {
        [
            ("energy", &self.energy),
            ("noise", &self.noise),
            ("missed", &self.missed),
            ("killed", &self.killed),
            ("variance", &self.variance),
            ("counts", &self.counts),
        ]
    }

    /// The same, to be written to.
    pub fn doubles_mut(&mut self) -> [(&'static str, &mut [f64]); 6] {
        [
            ("energy", &mut self.energy),
            ("noise", &mut self.noise),
            ("missed", &mut self.missed),
            ("killed", &mut self.killed),
            ("variance", &mut self.variance),
            ("counts", &mut self.counts),
        ]
    }
}

/// Half of the width over which lateral positions are drawn [um]: all rays that can meet a cylinder of radius `bound_um`,
/// their sideways tilt in the xy plane up to 5 standard deviations (at most 1 rad) included.
fn half_width(bound_um: f64, at: &Incidence<'_>) -> f64 {
    let tilt = (5.0 * at.beam.angular_sd_rad() / at.theta_i.cos().max(1e-3)).min(1.0);
    bound_um / tilt.cos()
}

/// Trace `paths` paths over one instance and add them to `sums`. None when stopped.
pub(crate) fn trace_paths<T: Tracer + ?Sized, R: Rng>(
    at: &Incidence<'_>,
    tracer: &T,
    paths: u64,
    rng: &mut R,
    sums: &mut Sums,
    stop: &AtomicBool,
    progress: &(dyn Fn(u64) + Sync),
) -> Option<()> {
    let bound = tracer.bound_radius_um();
    let half = half_width(f64::from(bound), at);
    let sd = at.beam.sd_um();
    let peak = 2.0 * half / (sd * std::f64::consts::TAU.sqrt());
    let (h_count, channels) = (at.h_um.len(), 1 + at.sigma_per_um.len());
    let (first_h, inv_dh) = (at.h_um[0], 1.0 / (at.h_um[1] - at.h_um[0]));
    let (sin_i, cos_i) = (at.theta_i as f32).sin_cos();
    // Propagation of the beam's center, and the transverse axis beside x.
    let forward = Vector3::new(0.0, -cos_i, -sin_i);
    let across = Vector3::new(0.0, -sin_i, cos_i);
    let angular_sd = at.beam.angular_sd_rad() as f32;
    let inv_solid_angle: Vec<f64> = (0..at.grid.theta_o).map(|i| 1.0 / at.grid.solid_angle(i)).collect();
    let mut weights = vec![0.0f64; h_count];
    let mut previous = vec![0.0f64; h_count];
    let mut absorbed = vec![0.0f64; channels];
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
        let tilt: [f32; 2] = [rng.sample(StandardNormal), rng.sample(StandardNormal)];
        let dir = (forward + Vector3::x() * (tilt[0] * angular_sd) + across * (tilt[1] * angular_sd)).normalize();
        // Entry into the bounding cylinder of the ray through (x, 0, z) on the beam's waist.
        let z = rng.random::<f32>() * tracer.period_um();
        let (sin, cos) = sin_cos_turn(rng.random::<f32>());
        let end = match entry(x as f32, dir, bound) {
            None => PathEnd::Miss,
            Some(s) => {
                let p = Vector3::new(x as f32 + s * dir.x, s * dir.y, z + s * dir.z);
                let turn = |v: Vector3<f32>| Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z);
                trace_path(tracer, &at.surface, turn(p), turn(dir), rng)
            }
        };
        // Weight of the path for each h that its position can serve.
        let lo = ((x - BEAM_SDS * sd - first_h) * inv_dh).ceil().max(0.0) as usize;
        let hi = (((x + BEAM_SDS * sd - first_h) * inv_dh).floor() + 1.0).clamp(0.0, h_count as f64) as usize;
        for n in lo..hi {
            let t = (x - at.h_um[n]) / sd;
            weights[n] = peak * (-0.5 * t * t).exp();
        }
        let lo = lo.min(hi);
        sums.counts[0] += 1.0;
        let mut record = |dir: Vector3<f32>, first: usize, absorbed: &[f64], interactions: u32| {
            sums.counts[1] += 1.0;
            sums.counts[2] += f64::from(interactions);
            let out = [cos * dir.x + sin * dir.y, cos * dir.y - sin * dir.x, dir.z];
            let bin = at.grid.bin(out);
            let inv = inv_solid_angle[bin / at.grid.phi_o];
            for n in lo..hi {
                let place = (bin * h_count + n) * channels + first;
                let total = n * channels + first;
                for (k, a) in absorbed.iter().enumerate() {
                    let w = weights[n] * a;
                    sums.bins[place + k] += w as f32;
                    sums.energy[total + k] += w;
                    sums.noise[total + k] += w * w * inv;
                }
            }
        };
        match end {
            PathEnd::Reflected { dir, interactions } => record(dir, 0, &[1.0], interactions),
            PathEnd::High { dir, length_um, interactions } => {
                for (a, sigma) in absorbed.iter_mut().zip(at.sigma_per_um) {
                    *a = (-sigma * f64::from(length_um)).exp();
                }
                record(dir, 1, &absorbed[..channels - 1], interactions);
            }
            PathEnd::Miss => (lo..hi).for_each(|n| sums.missed[n] += weights[n]),
            PathEnd::Killed => {
                for n in lo..hi {
                    sums.killed[n] += weights[n];
                    weights[n] = 0.0;
                }
            }
        }
        // Neighboring strata in pairs: their difference estimates the variance of the stratified total.
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
    // The tail of each beam beyond the drawn width, as a weight of the same scale.
    for (n, h) in at.h_um.iter().enumerate() {
        sums.missed[n] += paths as f64 * (upper_tail((half - h) / sd) + upper_tail((half + h) / sd));
    }
    Some(())
}

/// Distance along a ray through (x, 0) in the xy plane at which it enters the circle of radius `bound`; None when it passes by.
fn entry(x: f32, dir: Vector3<f32>, bound: f32) -> Option<f32> {
    let (a, b) = (dir.x * dir.x + dir.y * dir.y, x * dir.x);
    let disc = b * b - a * (x * x - bound * bound);
    (disc > 0.0).then(|| (-b - disc.sqrt()) / a)
}

/// Upper tail of the standard normal distribution, by Simpson's rule on the density; absolute error below 1e-9.
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
