//! Fits the high-order lobes of a family, block by block.

use super::{Work, spectra};
use crate::fit::{block_products, block_targets, dark_slices};
use crate::lobes::absorption::{attenuation, fit_lobe_spectra};
use crate::lobes::block::{BlockEffort, CORNERS, Target, fit_joint};
use crate::lobes::dark::{DarkSlices, refine};
use plywave::ply::LobeKind;
use plywave::ply::asg::PARAMS;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A block of all nodes: `params[node][corner][lobe][6]`, `paths[node][corner][lobe][J]`.
pub(super) struct FamilyBlock {
    params: Vec<f64>,
    paths: Vec<f64>,
    nodes: usize,
}

impl FamilyBlock {
    pub(super) fn params_of(&self, node: usize) -> &[f64] {
        let size = self.params.len() / self.nodes;
        &self.params[node * size..(node + 1) * size]
    }

    pub(super) fn paths_of(&self, node: usize) -> &[f64] {
        let size = self.paths.len() / self.nodes;
        &self.paths[node * size..(node + 1) * size]
    }
}

/// Fits all blocks, in the order of a model's blocks.
pub(super) fn fit(work: &Work<'_>, done: &(dyn Fn(usize, usize) + Sync)) -> Vec<FamilyBlock> {
    let first = work.all[0];
    let (rows, columns) = ((first.theta_i.len() - 1) / 2, (first.h_um.len() - 1) / 2);
    let spectra: Vec<Vec<Vec<f64>>> = work.all.par_iter().map(|table| spectra(table, work.path_um)).collect();
    let count = AtomicUsize::new(0);
    (0..rows * columns)
        .into_par_iter()
        .map(|block| {
            let fitted = fit_block(work, (block / columns, block % columns), block, &spectra);
            done(count.fetch_add(1, Ordering::Relaxed) + 1, rows * columns);
            fitted
        })
        .collect()
}

fn fit_block(work: &Work<'_>, (bm, bn): (usize, usize), block: usize, spectra: &[Vec<Vec<f64>>]) -> FamilyBlock {
    let (sphere, options, coarse) = (work.sphere, work.options, work.coarse.as_ref());
    let (nodes, lobes) = (work.tables.nodes.len(), options.lobes_high);
    let size = CORNERS * lobes * PARAMS;
    let first = work.all[0];
    // Each node contributes the nine slices of its table, with the corners of that node.
    let own: Vec<Vec<Target>> =
        work.all.iter().map(|table| block_targets(sphere, table, bm, bn, LobeKind::Round)).collect();

    // First the nodes are fitted one by one, each from a neighbor.
    let follow = BlockEffort { starts: 0, moves: 0, ..options.block };
    let mut params = vec![0.0; nodes * size];
    for &(node, from) in &work.order {
        let (effort, extra) = match from {
            None => (&options.block, Vec::new()),
            Some(from) => (&follow, vec![params[from * size..(from + 1) * size].to_vec()]),
        };
        let fit = fit_joint(sphere, coarse, &own[node], CORNERS, lobes, effort, block as u64 + 1, &extra);
        params[node * size..(node + 1) * size].copy_from_slice(&fit.params);
    }
    let scale = own.iter().flatten().map(|t| t.energy).fold(0.0, f64::max);
    params.chunks_exact_mut(size).for_each(|node| common_scale(node, CORNERS as f64 * scale));

    // Then all nodes are fitted together, including the middles.
    let all: Vec<Vec<Target>> = own
        .into_iter()
        .enumerate()
        .map(|(table, targets)| {
            let nodes = work.corners_of(table);
            let placed = |target: Target| {
                let corners = |&(node, w): &(usize, f64)| {
                    target.corners.iter().map(move |&(c, wc)| (node * CORNERS + c, w * wc)).collect::<Vec<_>>()
                };
                Target { corners: nodes.iter().flat_map(corners).collect(), ..target.clone() }
            };
            targets.into_iter().map(placed).collect()
        })
        .collect();
    let sets = nodes * CORNERS;
    let flat: Vec<Target> = all.iter().flatten().cloned().collect();
    let joint = fit_joint(sphere, coarse, &flat, sets, lobes, &follow, block as u64 + 1, &[params]);
    let mut params = joint.params;

    // Last come the spectra of each node, then lobes and spectra of all nodes at every absorption.
    let attenuation = attenuation(&first.sigma_per_um, work.path_um);
    let columns = first.h_um.len();
    let j = work.path_um.len();
    let mut paths = Vec::with_capacity(sets * lobes * j);
    for node in 0..nodes {
        let products =
            block_products(sphere, work.all[node], bm, bn, &all[node], &params, lobes, work.path_um, &spectra[node]);
        let products: Vec<_> = products
            .into_iter()
            .map(|mut p| {
                p.corners.iter_mut().for_each(|c| c.0 -= node * CORNERS);
                p
            })
            .collect();
        let mean: Vec<f64> = (0..j)
            .map(|p| (0..9).map(|i| spectra[node][(2 * bm + i / 3) * columns + 2 * bn + i % 3][p]).sum())
            .collect();
        paths.extend(fit_lobe_spectra(&products, CORNERS, lobes, &attenuation, &mean, options.absorption_iterations));
    }
    if first.sigma_per_um.len() > 1 {
        let slices: Vec<DarkSlices> = all
            .iter()
            .enumerate()
            .flat_map(|(i, targets)| dark_slices(sphere, work.all[i], bm, bn, targets, work.path_um, &spectra[i]))
            .collect();
        refine(
            sphere,
            &slices,
            &mut params,
            &mut paths,
            lobes,
            &attenuation,
            options.dark_share,
            options.dark_iterations,
        );
    }
    FamilyBlock { params, paths, nodes }
}

/// Scales a node's lobe energies to the sum `to` over corners and lobes. The common factor is free in the
/// node's own fit, but would weight the node against others in interpolations.
fn common_scale(params: &mut [f64], to: f64) {
    let sum: f64 = params.chunks_exact(PARAMS).map(|p| p[5]).sum();
    if sum > 0.0 {
        params.chunks_exact_mut(PARAMS).for_each(|p| p[5] *= to / sum);
    }
}
