//! Initial lobes for a slice: weighted spherical k-means, then the covariance of each cluster in the tangent
//! plane of its axis.

use crate::lobes::sphere::{PaddedSlice, SphereGrid};
use plywave::math::hash::SplitMix64;
use plywave::math::vec3::dot;
use plywave::ply::asg::{Lobe, MU_MAX, MU_MIN};

/// Returns `count` lobes whose energies add up to the slice's integral. `seed` selects the k-means++ start;
/// equal seeds give equal lobes. An empty slice gives equal broad lobes of zero energy.
pub fn kmeans_lobes(sphere: &SphereGrid, slice: &PaddedSlice, count: usize, seed: u64) -> Vec<Lobe> {
    let grid = sphere.grid();
    let values = sphere.unpad(slice);
    let mut points = Vec::with_capacity(grid.len());
    for i in 0..grid.theta_o {
        let (st, ct) = grid.theta(i).sin_cos();
        for j in 0..grid.phi_o {
            let weight = sphere.solid_angles()[i] * values[i * grid.phi_o + j].max(0.0) as f64;
            if weight > 0.0 {
                let (sp, cp) = grid.phi(j).sin_cos();
                points.push(([ct * cp, ct * sp, st], weight));
            }
        }
    }
    let total: f64 = points.iter().map(|p| p.1).sum();
    if points.is_empty() || total <= 0.0 || !total.is_finite() {
        let lobe = Lobe { theta_z: 0.0, phi_z: 0.0, phi_xy: 0.0, ln_mu1: 0.0, ln_mu2: 0.0, energy: 0.0 };
        return vec![lobe; count];
    }
    let mut stream = SplitMix64(seed);
    let mut pick = |weights: &[f64]| {
        let mut remaining = stream.next_f64() * weights.iter().sum::<f64>();
        weights.iter().position(|w| {
            remaining -= w;
            remaining < 0.0
        })
    };
    let mut centers: Vec<[f64; 3]> = Vec::with_capacity(count);
    let mut weights: Vec<f64> = points.iter().map(|p| p.1).collect();
    let mut nearest = vec![4.0f64; points.len()];
    for _ in 0..count {
        let center = points[pick(&weights).unwrap_or(points.len() - 1)].0;
        centers.push(center);
        for ((p, near), weight) in points.iter().zip(&mut nearest).zip(&mut weights) {
            *near = near.min(2.0 - 2.0 * dot(p.0, center));
            *weight = p.1 * near.max(0.0);
        }
    }
    let mut label = vec![0usize; points.len()];
    for _ in 0..30 {
        let mut sums = vec![[0.0f64; 3]; count];
        for (p, label) in points.iter().zip(&mut label) {
            let mut best = (f64::NEG_INFINITY, 0);
            for (c, center) in centers.iter().enumerate() {
                let d = dot(p.0, *center);
                if d > best.0 {
                    best = (d, c);
                }
            }
            *label = best.1;
            for k in 0..3 {
                sums[best.1][k] += p.1 * p.0[k];
            }
        }
        for (center, sum) in centers.iter_mut().zip(&sums) {
            let norm = dot(*sum, *sum).sqrt();
            if norm > 0.0 {
                *center = sum.map(|v| v / norm);
            }
        }
    }
    (0..count)
        .map(|c| cluster_lobe(centers[c], points.iter().zip(&label).filter(|(_, l)| **l == c).map(|(p, _)| *p)))
        .collect()
}

fn cluster_lobe(center: [f64; 3], points: impl Iterator<Item = ([f64; 3], f64)>) -> Lobe {
    let theta_z = center[2].clamp(-1.0, 1.0).asin();
    let phi_z = center[1].atan2(center[0]);
    let axes = Lobe { theta_z, phi_z, phi_xy: 0.0, ln_mu1: 0.0, ln_mu2: 0.0, energy: 0.0 }.frame();
    let (mut energy, mut uu, mut uw, mut ww) = (0.0, 0.0, 0.0, 0.0);
    for (p, weight) in points {
        let (u, w) = (dot(p, axes[0]), dot(p, axes[1]));
        energy += weight;
        uu += weight * u * u;
        uw += weight * u * w;
        ww += weight * w * w;
    }
    if energy <= 0.0 {
        return Lobe { theta_z, phi_z, phi_xy: 0.0, ln_mu1: 2.0, ln_mu2: 2.0, energy: 0.0 };
    }
    let (uu, uw, ww) = (uu / energy, uw / energy, ww / energy);
    let (mean, half) = (0.5 * (uu + ww), 0.5 * (uu - ww));
    let spread = half.hypot(uw);
    let phi_xy = 0.5 * uw.atan2(half);
    let ln_mu = |variance: f64| (0.5 / variance.max(1e-6)).clamp(MU_MIN, MU_MAX).ln();
    Lobe { theta_z, phi_z, phi_xy, ln_mu1: ln_mu(mean + spread), ln_mu2: ln_mu(mean - spread), energy }
}
