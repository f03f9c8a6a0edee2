//! Refines a block jointly at all absorptions, because lobes fitted at sigma = 0 alone do not describe the
//! light after absorption.
//!
//! Absorption removes long paths first, and long and short paths leave in different directions. Starting from
//! the lobes at sigma = 0 and their spectra, both are refined together on the slices of all sigma, with the
//! larger part of the weight at sigma = 0.

use crate::lobes::absorption::normalized;
use crate::lobes::block::{Target, bounds};
use crate::lobes::cone::SliceLobes;
use crate::lobes::sphere::{Scratch, SphereGrid};
use crate::optimize::minimize::{MinimizeOptions, minimize_bounded};
use plywave::ply::asg::PARAMS;

/// Slices of one incidence at all sigma, `targets[k]`; `Target::energy` is the energy to which the evaluator
/// scales.
pub(crate) struct DarkSlices {
    pub targets: Vec<Target>,
    /// Parameter sets of this incidence and their weights.
    pub corners: Vec<(usize, f64)>,
}

/// Refines `params[sets][lobes][6]` and `spectra[sets][lobes][J]` in place. `share` is the weight of a slice
/// at sigma > 0 relative to one at sigma = 0.
pub(crate) fn refine(
    sphere: &SphereGrid,
    slices: &[DarkSlices],
    params: &mut [f64],
    spectra: &mut [f64],
    lobes: usize,
    attenuation: &[f64],
    share: f64,
    iterations: usize,
) {
    let split = params.len();
    let paths = spectra.len() * PARAMS / split.max(1);
    if iterations == 0 || share <= 0.0 || split == 0 {
        return;
    }
    let scale = params.chunks_exact(PARAMS).map(|p| p[5]).fold(0.0, f64::max);
    if scale <= 0.0 {
        return;
    }
    let mut x = params.to_vec();
    x.chunks_exact_mut(PARAMS).for_each(|p| p[5] /= scale);
    let lobes_of = slices.iter().flat_map(|s| &s.targets).next().map_or(SliceLobes::Round, |t| t.lobes);
    let (mut lower, mut upper) = bounds(lobes_of.family(), &x, 1.5);
    x.extend(spectra.iter());
    lower.resize(x.len(), 0.0);
    upper.resize(x.len(), 4.0);
    let mut scratch = Scratch::default();
    let options = MinimizeOptions { iterations, tolerance: 1e-3, memory: 20 };
    let fit = minimize_bounded(&x, &lower, &upper, options, |x, gradient| {
        cost_gradient(sphere, slices, x, gradient, lobes, split, paths, attenuation, share, &mut scratch)
    });
    let top = fit.x[..split].chunks_exact(PARAMS).map(|p| p[5]).fold(1.0, f64::max);
    params.copy_from_slice(&fit.x[..split]);
    params.chunks_exact_mut(PARAMS).for_each(|p| p[5] *= scale / top);
    for (spectrum, x) in spectra.chunks_exact_mut(paths).zip(fit.x[split..].chunks_exact(paths)) {
        spectrum.copy_from_slice(&normalized(x));
    }
}

fn cost_gradient(
    sphere: &SphereGrid,
    slices: &[DarkSlices],
    x: &[f64],
    gradient: &mut [f64],
    lobes: usize,
    split: usize,
    paths: usize,
    attenuation: &[f64],
    share: f64,
    scratch: &mut Scratch,
) -> f64 {
    let size = lobes * PARAMS;
    gradient.fill(0.0);
    let p: Vec<f64> = x[split..].chunks_exact(paths).flat_map(normalized).collect();
    let mut by_p = vec![0.0; p.len()];
    let (mut blended, mut local, mut by_local) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
    let mut w = vec![0.0; lobes];
    let mut cost = 0.0;
    for slice in slices {
        crate::lobes::block::blend(x, &slice.corners, &mut blended);
        for (k, target) in slice.targets.iter().enumerate() {
            if target.weight <= 0.0 {
                continue;
            }
            let t = &attenuation[k * paths..(k + 1) * paths];
            w.fill(0.0);
            for &(set, c) in &slice.corners {
                for l in 0..lobes {
                    let p = &p[(set * lobes + l) * paths..][..paths];
                    w[l] += c * t.iter().zip(p).map(|(t, p)| t * p).sum::<f64>();
                }
            }
            local.copy_from_slice(&blended);
            local.chunks_exact_mut(PARAMS).zip(&w).for_each(|(p, w)| p[5] *= w);
            let sum: f64 = local.chunks_exact(PARAMS).map(|p| p[5]).sum();
            if sum <= 1e-14 {
                continue;
            }
            let weight = target.weight * if k == 0 { 1.0 } else { share };
            cost += weight
                * sphere.cost_gradient_of(
                    target.lobes,
                    &target.slice,
                    &local,
                    target.energy / sum,
                    &mut by_local,
                    scratch,
                );
            let mean =
                local.chunks_exact(PARAMS).zip(by_local.chunks_exact(PARAMS)).map(|(p, d)| p[5] * d[5]).sum::<f64>()
                    / sum;
            for l in 0..lobes {
                let by_energy = weight * (by_local[l * PARAMS + 5] - mean);
                for &(set, c) in &slice.corners {
                    let at = set * lobes + l;
                    for q in 0..5 {
                        gradient[at * PARAMS + q] += weight * c * by_local[l * PARAMS + q];
                    }
                    gradient[at * PARAMS + 5] += c * w[l] * by_energy;
                    for j in 0..paths {
                        by_p[at * paths + j] += c * t[j] * blended[l * PARAMS + 5] * by_energy;
                    }
                }
            }
        }
    }
    crate::lobes::absorption::chain_normalized(&x[split..], &by_p, paths, &mut gradient[split..]);
    cost
}

#[cfg(test)]
mod tests {
    use super::*;
    use plywave_tables::table::OutgoingGrid;

    #[test]
    fn gradient_matches_differences() {
        let sphere = SphereGrid::new(OutgoingGrid { theta_o: 30, phi_o: 60 });
        let mut scratch = Scratch::default();
        let lobe = |s: f64| [0.3 * s, 1.0 + s, 0.4, 1.5, 2.0 - s, 0.5 + 0.2 * s];
        let planted: Vec<f64> = [0.1, 0.8].iter().flat_map(|s| lobe(*s)).collect();
        let slice = |corners: Vec<(usize, f64)>, scratch: &mut Scratch| DarkSlices {
            targets: (0..2)
                .map(|k| {
                    let values = sphere.unpad(&sphere.mixture(&planted, 0.5 - 0.2 * k as f64, scratch));
                    Target::new(&sphere, &values, 0.6 - 0.2 * k as f64, 0.0, Vec::new())
                })
                .collect(),
            corners,
        };
        let slices = [slice(vec![(0, 1.0)], &mut scratch), slice(vec![(0, 0.5), (1, 0.5)], &mut scratch)];
        let attenuation = [1.0, 1.0, 1.0, 0.9, 0.6, 0.2];
        let mut x: Vec<f64> = [0.2, 0.9, 0.3, 1.1].iter().flat_map(|s| lobe(*s)).collect();
        let split = x.len();
        x.extend((0..12).map(|i| 0.1 + 0.05 * ((i * 5) % 7) as f64));
        let mut run = |x: &[f64], g: &mut [f64]| {
            cost_gradient(&sphere, &slices, x, g, 2, split, 3, &attenuation, 0.3, &mut scratch)
        };
        let mut gradient = vec![0.0; x.len()];
        run(&x, &mut gradient);
        let top = gradient.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        for i in 0..x.len() {
            let mut at = |d: f64| {
                let mut y = x.clone();
                y[i] += d;
                run(&y, &mut vec![0.0; x.len()])
            };
            let want = (at(1e-3) - at(-1e-3)) / 2e-3;
            assert!((gradient[i] - want).abs() < 1e-3 * top, "{i}: got {}, want {want}", gradient[i]);
        }
    }
}
