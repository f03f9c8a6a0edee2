//! Fits the lobes of a family of plies together (`plywave::ply::PlyFamily`).
//!
//! Separate fits of the nodes end in different minima, with lobes in another order and axes rotated by up to
//! 159 degrees; such lobes cannot be interpolated. Here
//!
//! 1. the node in the middle of the family is fitted as a separate model;
//! 2. every other node is fitted from the lobes of a fitted neighbor, with no other start and no moves. So
//!    lobe l stays lobe l, and its angles keep their turn and their swap of mu1 and mu2;
//! 3. the parameters of all nodes are refined together. Slices of tables in the middles of cells are targets
//!    too, with interpolated lobes: the cost includes the values of the family between nodes, as the cost of
//!    a model includes the five inner slices of a block (Yu 2025, 5.2).
//!
//! Step 3 is `joint_cost` and `dark::refine` with 4 N parameter sets, N nodes of four corners. No lobe is
//! sorted or brought to canonical form afterwards.

mod high;
mod reflection;

use crate::error::FitError;
use crate::exits::fit_exits;
use crate::fit::{Progress, Stage, frame_on};
use crate::fit_errors::errors;
use crate::layers::layer_factors;
use crate::lobes::absorption::choose_paths;
use crate::lobes::block::coarse_grid;
use crate::lobes::sphere::SphereGrid;
use crate::options::FitOptions;
use plywave::ply::{EdgeLobes, FamilyAxis, FamilyData, FamilyParam, PlyData, spline_coefficients};
use plywave_tables::table::Table;
use rayon::prelude::*;
use std::sync::Arc;

/// A table between the nodes, with the surrounding nodes and their weights.
pub struct FamilyMiddle {
    /// Nodes and their weights, which add up to 1.
    pub corners: Vec<(usize, f64)>,
    /// The simulated table at this position.
    pub table: Arc<Table>,
}

/// The tables of a family. All have the same grids, absorptions and seed.
pub struct FamilyTables<'a> {
    /// The spec with its ranges, in the user's text.
    pub spec_text: &'a str,
    /// The axes.
    pub axes: &'a [FamilyAxis],
    /// Tables at the nodes, the last axis fastest.
    pub nodes: &'a [Arc<Table>],
    /// Tables between the nodes; the list may be empty.
    pub middles: &'a [FamilyMiddle],
    /// Edge lobes, shared by all nodes.
    pub edge: Option<EdgeLobes>,
}

/// The order in which nodes are fitted, each with the neighbor from which it starts: first the middle node,
/// then each node after a neighbor along an axis.
fn order(axes: &[FamilyAxis]) -> Vec<(usize, Option<usize>)> {
    let sizes: Vec<usize> = axes.iter().map(|a| a.values.len()).collect();
    let index = |at: &[usize]| at.iter().zip(&sizes).fold(0, |sum, (i, n)| sum * n + i);
    let middle: Vec<usize> = sizes.iter().map(|n| n / 2).collect();
    let mut out = vec![(index(&middle), None)];
    let mut queue = std::collections::VecDeque::from([middle]);
    let mut visited = vec![false; sizes.iter().product()];
    visited[out[0].0] = true;
    while let Some(at) = queue.pop_front() {
        for axis in 0..sizes.len() {
            for up in [false, true] {
                let mut next = at.clone();
                if up && at[axis] + 1 < sizes[axis] {
                    next[axis] += 1;
                } else if !up && at[axis] > 0 {
                    next[axis] -= 1;
                } else {
                    continue;
                }
                let node = index(&next);
                if !visited[node] {
                    visited[node] = true;
                    out.push((node, Some(index(&at))));
                    queue.push_back(next);
                }
            }
        }
    }
    out
}

/// Number of absorption curves from which the common path lengths are chosen.
const CURVES: usize = 600;

/// Fits a family to its tables. The result depends on the tables and options alone, not on the number of
/// threads.
///
/// # Errors
/// Those of [`crate::fit`]; [`FitError::Axes`] for tables of different grids.
pub fn fit_family(
    tables: &FamilyTables<'_>,
    options: &FitOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<FamilyData, FitError> {
    let first = &*tables.nodes[0];
    let all: Vec<&Table> = tables.nodes.iter().chain(tables.middles.iter().map(|m| &m.table)).map(|t| &**t).collect();
    for table in &all {
        crate::check::check_table(table)?;
        for (axis, a, b) in [
            ("theta_i", &first.theta_i, &table.theta_i),
            ("h_um", &first.h_um, &table.h_um),
            ("sigma_per_um", &first.sigma_per_um, &table.sigma_per_um),
        ] {
            if a != b {
                return Err(FitError::Axes { axis, model: a.len(), table: b.len() });
            }
        }
        if table.grid != first.grid {
            return Err(FitError::Axes { axis: "theta_o and phi_o", model: first.grid.len(), table: table.grid.len() });
        }
    }
    let sigmas = first.sigma_per_um.len();
    // The common path lengths are those that fit the energies of all nodes best.
    let curves: Vec<Vec<f64>> =
        tables.nodes.iter().flat_map(|t| t.energy_high.chunks_exact(sigmas).map(<[f64]>::to_vec)).collect();
    let every = curves.len().div_ceil(CURVES).max(1);
    let path_um = choose_paths(&curves.into_iter().step_by(every).collect::<Vec<_>>(), &first.sigma_per_um);
    let mut nodes = tables
        .nodes
        .par_iter()
        .map(|table| frame_on(table, options, tables.edge.clone(), Some(&path_um)))
        .collect::<Result<Vec<PlyData>, FitError>>()?;
    share_missed(&mut nodes, tables.axes);

    let sphere = SphereGrid::new(first.grid);
    let work = Work {
        sphere: &sphere,
        coarse: coarse_grid(&sphere),
        tables,
        all: &all,
        order: order(tables.axes),
        options,
        path_um: &path_um,
    };
    let high = high::fit(&work, &|done, total| progress(Progress { stage: Stage::High, done, total }));
    let refl = reflection::fit(&work, &|done, total| progress(Progress { stage: Stage::Reflection, done, total }));
    for (i, node) in nodes.iter_mut().enumerate() {
        node.high = high.iter().flat_map(|block| block.params_of(i).iter().copied()).collect();
        node.high_path = high.iter().flat_map(|block| block.paths_of(i).iter().copied()).collect();
        node.refl = refl[i].clone();
    }
    for (node, table) in nodes.iter_mut().zip(tables.nodes) {
        let own = errors(node, table)?;
        let finite = |values: Vec<f64>| values.into_iter().map(|v| if v.is_finite() { v } else { 0.0 }).collect();
        node.error_refl = finite(own.refl);
        node.error_high = finite(own.high);
        node.exits = fit_exits(table);
        node.layers = Some(layer_factors(node));
        node.spec_text.clear();
    }
    progress(Progress { stage: Stage::Errors, done: 1, total: 1 });
    Ok(FamilyData {
        spec_text: tables.spec_text.into(),
        program_version: env!("CARGO_PKG_VERSION").to_string(),
        preset: first.preset.clone(),
        seed: first.seed,
        axes: tables.axes.to_vec(),
        nodes,
    })
}

/// Inputs shared by the fits of lobes.
struct Work<'a> {
    sphere: &'a SphereGrid,
    coarse: Option<SphereGrid>,
    tables: &'a FamilyTables<'a>,
    /// Tables of the nodes, then of the middles.
    all: &'a [&'a Table],
    order: Vec<(usize, Option<usize>)>,
    options: &'a FitOptions,
    path_um: &'a [f64],
}

impl Work<'_> {
    /// Nodes and weights of the interpolation that is compared with a table.
    fn corners_of(&self, table: usize) -> Vec<(usize, f64)> {
        let nodes = self.tables.nodes.len();
        if table < nodes { vec![(table, 1.0)] } else { self.tables.middles[table - nodes].corners.clone() }
    }
}

/// Gives all nodes the finest grid of r_d, and all nodes of equal pitch their mean r_d, because r_d does not
/// depend on the fibers' material.
fn share_missed(nodes: &mut [PlyData], axes: &[FamilyAxis]) {
    let pitches = axes.iter().find(|a| a.param == FamilyParam::FiberPitch).map_or(1, |a| a.values.len());
    let per_pitch = nodes.len() / pitches;
    let finest = |of: &dyn Fn(&PlyData) -> &Vec<f64>| {
        nodes.iter().map(of).max_by_key(|axis| axis.len()).cloned().unwrap_or_default()
    };
    let (theta_i, h_um) = (finest(&|d| &d.energies.miss_theta_i), finest(&|d| &d.energies.miss_h_um));
    for of_pitch in nodes.chunks_exact_mut(per_pitch) {
        let mut values = Vec::with_capacity(theta_i.len() * h_um.len());
        for t in &theta_i {
            for h in &h_um {
                let sum: f64 = of_pitch.iter().map(|d| d.energies.at(*t, *h).r_d).sum();
                values.push(sum / per_pitch as f64);
            }
        }
        let miss: Vec<f64> = spline_coefficients(&values, theta_i.len(), h_um.len())
            .into_iter()
            .map(|c| f64::from(c.clamp(0.0, 1.0) as f32))
            .collect();
        for node in of_pitch {
            node.energies.miss_theta_i = theta_i.clone();
            node.energies.miss_h_um = h_um.clone();
            node.energies.miss = miss.clone();
        }
    }
}

/// Spectra of the f_high energies of a table, by incidence.
fn spectra(table: &Table, path_um: &[f64]) -> Vec<Vec<f64>> {
    let of = |e: &[f64]| crate::lobes::absorption::energy_spectrum(e, &table.sigma_per_um, path_um).0;
    table.energy_high.chunks_exact(table.sigma_per_um.len()).map(of).collect()
}
