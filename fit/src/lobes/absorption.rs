//! Absorption as path-length spectra: `E(sigma) = sum_j P_j exp(-sigma L_j)` with P >= 0 for energies and for
//! the weight of each lobe.
//!
//! f_high is the Laplace transform in sigma of the distribution of path lengths inside the fibers. A spectrum
//! on a few path lengths shared by the model is therefore monotone in sigma and valid between and beyond the
//! simulated coefficients.

use crate::optimize::minimize::{MinimizeOptions, minimize_bounded};
use crate::optimize::nnls::nnls;
use nalgebra::{DMatrix, DVector};

/// Longest path [um] of a model, 900 m; absorption too weak to matter over that length counts as 0.
const LONGEST_UM: f64 = 9e8;
/// Number of path lengths of a model with absorption.
pub const PATHS: usize = 8;

/// Attenuation `exp(-sigma_k L_j)`, `[K][J]`.
pub(crate) fn attenuation(sigma: &[f64], path: &[f64]) -> Vec<f64> {
    sigma.iter().flat_map(|s| path.iter().map(move |l| (-s * l).exp())).collect()
}

/// The spectrum P >= 0 with sum `energy[0]` whose attenuated sums approximate `energy[k]` best, and the
/// largest error over k relative to `energy[0]`.
pub fn energy_spectrum(energy: &[f64], sigma: &[f64], path: &[f64]) -> (Vec<f64>, f64) {
    let top = energy.first().copied().unwrap_or(0.0);
    if top <= 0.0 {
        return (vec![0.0; path.len()], 0.0);
    }
    // The first row (sigma = 0) is the sum of P: a large weight fits it closely, and the scaling below makes
    // it exact.
    let t = attenuation(sigma, path);
    let weight = |k: usize| if k == 0 { 1e3 } else { 1.0 };
    let a = DMatrix::from_fn(sigma.len(), path.len(), |k, j| weight(k) * t[k * path.len() + j]);
    let b = DVector::from_fn(sigma.len(), |k, _| weight(k) * energy[k] / top);
    let x = nnls(&a, &b);
    let sum: f64 = x.iter().sum();
    if sum <= 0.0 {
        let mut p = vec![0.0; path.len()];
        p[0] = top;
        return (p, 1.0);
    }
    let p: Vec<f64> = x.iter().map(|v| v * top / sum).collect();
    let error = (0..sigma.len())
        .map(|k| {
            (t[k * path.len()..(k + 1) * path.len()].iter().zip(&p).map(|(t, p)| t * p).sum::<f64>() - energy[k]).abs()
                / top
        })
        .fold(0.0, f64::max);
    (p, error)
}

/// Largest error of energies, relative to those at sigma = 0, up to which [`PATHS`] lengths suffice.
const ENOUGH: f64 = 1e-3;
/// Larger numbers of lengths that are tried next: reflections of opaque fibers are steps of one length, which
/// eight lengths cannot resolve.
const MORE_PATHS: [usize; 2] = [12, 16];

/// Path lengths that fit `energies[node][K]` best: log-spaced, with or without a zero, with the smallest
/// maximal error over the nodes.
pub fn choose_paths(energies: &[Vec<f64>], sigma: &[f64]) -> Vec<f64> {
    let mut best = choose_among(energies, sigma, PATHS);
    for count in MORE_PATHS {
        if best.0 > ENOUGH {
            let finer = choose_among(energies, sigma, count);
            best = if finer.0 < 0.5 * best.0 { finer } else { best };
        }
    }
    best.1
}

/// The best choice of `lengths` path lengths, and its error.
fn choose_among(energies: &[Vec<f64>], sigma: &[f64], lengths: usize) -> (f64, Vec<f64>) {
    let positive: Vec<f64> = sigma.iter().copied().filter(|s| *s > 0.0).collect();
    let (Some(&min), Some(&max)) = (positive.first(), positive.last()) else { return (0.0, vec![0.0]) };
    let mut best = (f64::INFINITY, vec![0.0]);
    for zero in [true, false] {
        for low in [0.03, 0.1, 0.2, 0.4, 0.8, 1.2, 2.0] {
            for high in [0.1, 0.2, 0.4, 0.8, 1.6, 4.0] {
                let (first, last) = (low / max, (high / min).min(LONGEST_UM));
                let count = if zero { lengths - 1 } else { lengths };
                if last <= first * 1.5 {
                    continue;
                }
                let ratio = (last / first).powf(1.0 / (count - 1) as f64);
                let mut path = if zero { vec![0.0] } else { Vec::new() };
                path.extend((0..count).map(|i| first * ratio.powi(i as i32)));
                let error = energies.iter().map(|e| energy_spectrum(e, sigma, &path).1).fold(0.0, f64::max);
                if error < best.0 {
                    best = (error, path);
                }
            }
        }
    }
    best
}

/// Inner products on the sphere between a slice and its lobes: all inputs of the fit of the lobes'
/// absorption.
#[derive(Clone, Debug)]
pub(crate) struct SliceProducts {
    /// Lobe energies at this slice, `[L]`.
    pub energy: Vec<f64>,
    /// `<g_l, g_m>` of lobes of unit energy, `[L][L]`.
    pub gram: Vec<f64>,
    /// `<g_l, t_k>`, `[K][L]`.
    pub cross: Vec<f64>,
    /// `<t_k, t_k>`, `[K]`.
    pub norm2: Vec<f64>,
    /// Energy to which the evaluator scales, `[K]`.
    pub target_energy: Vec<f64>,
    /// Weight in the sum of squares, `[K]`.
    pub weight: Vec<f64>,
    /// Parameter sets of this slice and their weights.
    pub corners: Vec<(usize, f64)>,
}

/// Fits spectra `[sets][L][J]`, each with sum 1, of the energy-scaled mixtures to the slices at all sigma.
/// Every lobe starts from the spectrum `start`, `[J]`.
pub(crate) fn fit_lobe_spectra(
    slices: &[SliceProducts],
    sets: usize,
    lobes: usize,
    attenuation: &[f64],
    start: &[f64],
    iterations: usize,
) -> Vec<f64> {
    let paths = start.len();
    let sum: f64 = start.iter().sum();
    let normal: Vec<f64> = start.iter().map(|p| if sum > 0.0 { p / sum } else { 1.0 / paths as f64 }).collect();
    let n = sets * lobes * paths;
    let x0: Vec<f64> = (0..n).map(|i| normal[i % paths].max(1e-3)).collect();
    let normal = normalized(&x0[..paths]);
    let options = MinimizeOptions { iterations, tolerance: 1e-5, memory: 20 };
    let fit = minimize_bounded(&x0, &vec![0.0; n], &vec![4.0; n], options, |x, gradient| {
        spectra_cost(slices, lobes, attenuation, &normal, x, gradient)
    });
    fit.x.chunks_exact(paths).flat_map(normalized).collect()
}

/// `x` divided by its sum; equal fractions if the sum is 0.
pub(crate) fn normalized(x: &[f64]) -> Vec<f64> {
    let sum: f64 = x.iter().sum();
    if sum > 1e-9 { x.iter().map(|v| v / sum).collect() } else { vec![1.0 / x.len() as f64; x.len()] }
}

/// Strength of the pull toward the block's spectrum. It determines the spectra of lobes without energy, for
/// which there is no data, and is too weak to change others.
const PULL: f64 = 1e-5;

fn spectra_cost(
    slices: &[SliceProducts],
    lobes: usize,
    attenuation: &[f64],
    normal: &[f64],
    x: &[f64],
    gradient: &mut [f64],
) -> f64 {
    let paths = normal.len();
    let p: Vec<f64> = x.chunks_exact(paths).flat_map(normalized).collect();
    let mut by_p = vec![0.0; p.len()];
    let mut cost = 0.0;
    for (i, p) in p.iter().enumerate() {
        let d = p - normal[i % paths];
        cost += PULL * d * d;
        by_p[i] += 2.0 * PULL * d;
    }
    let mut w = vec![0.0; lobes];
    for slice in slices {
        for k in 0..slice.target_energy.len() {
            if slice.weight[k] <= 0.0 {
                continue;
            }
            let t = &attenuation[k * paths..(k + 1) * paths];
            w.fill(0.0);
            for &(set, c) in &slice.corners {
                for l in 0..lobes {
                    let p = &p[(set * lobes + l) * paths..][..paths];
                    w[l] += c * slice.energy[l] * t.iter().zip(p).map(|(t, p)| t * p).sum::<f64>();
                }
            }
            let sum: f64 = w.iter().sum();
            if sum <= 1e-14 {
                continue;
            }
            let gain = slice.target_energy[k] / sum;
            // e = gain^2 w'Gw - 2 gain w'b + |t|^2.
            let gw: Vec<f64> = (0..lobes)
                .map(|l| slice.gram[l * lobes..(l + 1) * lobes].iter().zip(&w).map(|(g, w)| g * w).sum())
                .collect();
            let b = &slice.cross[k * lobes..(k + 1) * lobes];
            let wgw: f64 = gw.iter().zip(&w).map(|(a, b)| a * b).sum();
            let wb: f64 = b.iter().zip(&w).map(|(a, b)| a * b).sum();
            cost += slice.weight[k] * (gain * gain * wgw - 2.0 * gain * wb + slice.norm2[k]);
            let by_gain = 2.0 * gain * wgw - 2.0 * wb;
            for l in 0..lobes {
                let by_w = slice.weight[k] * (2.0 * gain * (gain * gw[l] - b[l]) - by_gain * gain / sum);
                for &(set, c) in &slice.corners {
                    let at = (set * lobes + l) * paths;
                    for j in 0..paths {
                        by_p[at + j] += by_w * c * slice.energy[l] * t[j];
                    }
                }
            }
        }
    }
    chain_normalized(x, &by_p, paths, gradient);
    cost
}

/// Gradient with respect to `x` from the gradient with respect to the normalized spectra.
pub(crate) fn chain_normalized(x: &[f64], by_p: &[f64], paths: usize, gradient: &mut [f64]) {
    for ((x, g), d) in x.chunks_exact(paths).zip(gradient.chunks_exact_mut(paths)).zip(by_p.chunks_exact(paths)) {
        let sum: f64 = x.iter().sum();
        if sum > 1e-9 {
            let mean: f64 = x.iter().zip(d).map(|(x, d)| x * d).sum::<f64>() / sum;
            g.iter_mut().zip(d).for_each(|(g, d)| *g = (d - mean) / sum);
        } else {
            g.copy_from_slice(d);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMA: [f64; 6] = [0.0, 0.001, 0.003, 0.01, 0.03, 0.1];

    /// Energies of a gamma-like distribution of path lengths with mean `mean` [um].
    fn energies(mean: f64) -> Vec<f64> {
        SIGMA.iter().map(|s| 0.8 / (1.0 + s * mean / 2.0).powi(2)).collect()
    }

    #[test]
    fn energies_come_back_and_fall() {
        let nodes: Vec<Vec<f64>> = [15.0, 30.0, 60.0, 120.0].iter().map(|m| energies(*m)).collect();
        let path = choose_paths(&nodes, &SIGMA);
        assert_eq!(path.len(), PATHS);
        for e in &nodes {
            let (p, error) = energy_spectrum(e, &SIGMA, &path);
            assert!(error < 1e-3, "error {error}");
            assert!((p.iter().sum::<f64>() - e[0]).abs() < 1e-12 && p.iter().all(|v| *v >= 0.0));
            let at = |s: f64| p.iter().zip(&path).map(|(p, l)| p * (-s * l).exp()).sum::<f64>();
            assert!((0..60).all(|i| at(i as f64 * 0.01) >= at((i + 1) as f64 * 0.01)));
        }
    }

    #[test]
    fn spectra_gradient_matches_differences() {
        let path = [0.0, 10.0, 100.0];
        let t = attenuation(&SIGMA[..3], &path);
        let slice = |corners: Vec<(usize, f64)>, f: f64| SliceProducts {
            energy: vec![0.3 + f, 0.5],
            gram: vec![2.0, 0.4, 0.4, 1.0],
            cross: vec![0.8, 0.5, 0.7, 0.4, 0.5, 0.4],
            norm2: vec![0.5, 0.4, 0.3],
            target_energy: vec![0.8, 0.7, 0.5],
            weight: vec![1.0, 2.0, 3.0],
            corners,
        };
        let slices = [slice(vec![(0, 1.0)], 0.1), slice(vec![(0, 0.5), (1, 0.5)], 0.2)];
        let x: Vec<f64> = (0..12).map(|i| 0.1 + 0.07 * ((i * 5) % 7) as f64).collect();
        let normal = [0.2, 0.5, 0.3];
        let mut g = vec![0.0; 12];
        spectra_cost(&slices, 2, &t, &normal, &x, &mut g);
        for i in 0..12 {
            let cost = |d: f64| {
                let mut y = x.clone();
                y[i] += d;
                spectra_cost(&slices, 2, &t, &normal, &y, &mut [0.0; 12])
            };
            let want = (cost(1e-5) - cost(-1e-5)) / 2e-5;
            assert!((g[i] - want).abs() < 1e-7, "{i}: got {}, want {want}", g[i]);
        }
    }
}
