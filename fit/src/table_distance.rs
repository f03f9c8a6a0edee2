//! Distance between two tables of one yarn, or between a fitted model and a table, with noise removed; for
//! example, between the model of a yarn and the path-traced yarn.

use crate::check::check_table;
use crate::error::FitError;
use crate::fit_errors::excess2;
use crate::lobes::model::{energies, evaluate, high_lobes, locate, refl_lobes};
use crate::lobes::sphere::{Scratch, SphereGrid};
use plywave::ply::PlyData;
use plywave_tables::table::Table;
use rayon::prelude::*;

/// Distances at the common incidences and absorptions.
#[derive(Clone, Debug, PartialEq)]
pub struct TableDistance {
    /// `[M]`: incident latitudes [rad].
    pub theta_i: Vec<f64>,
    /// `[H]`: offsets [um].
    pub h_um: Vec<f64>,
    /// `[K]`: absorptions [1/um].
    pub sigma_per_um: Vec<f64>,
    /// `[M][H]`: squared relative L2 distance of f_refl, with the noise of both tables subtracted; negative
    /// if the noise is less than expected, NaN if noise hides it.
    pub refl2: Vec<f64>,
    /// `[M][H][K]`: the same for f_high.
    pub high2: Vec<f64>,
    /// `[M][H]`: energy of f_refl in the first table minus that in the second.
    pub energy_refl: Vec<f64>,
    /// `[M][H][K]`: the same for f_high.
    pub energy_high: Vec<f64>,
    /// `[M][H]`: the same for r_d.
    pub r_d: Vec<f64>,
}

/// Distance of table `a` from table `b`, relative to `b`. Both must have the same bins and some common
/// incidences and absorptions.
///
/// # Errors
/// [`FitError::Axes`] if bins differ or an axis has no common node, [`FitError::Table`].
pub fn table_distance(a: &Table, b: &Table) -> Result<TableDistance, FitError> {
    check_table(a)?;
    check_table(b)?;
    if a.grid != b.grid {
        return Err(FitError::Axes { axis: "theta_o, phi_o", model: a.grid.len(), table: b.grid.len() });
    }
    let common = |axis: &'static str, x: &[f64], y: &[f64]| -> Result<Vec<(usize, usize)>, FitError> {
        let near = |u: f64, v: f64| (u - v).abs() <= 1e-9 * (1.0 + u.abs());
        let pairs: Vec<_> =
            (0..x.len()).filter_map(|i| y.iter().position(|v| near(x[i], *v)).map(|j| (i, j))).collect();
        if pairs.is_empty() {
            return Err(FitError::Axes { axis, model: x.len(), table: y.len() });
        }
        Ok(pairs)
    };
    let theta = common("theta_i", &a.theta_i, &b.theta_i)?;
    let h = common("h_um", &a.h_um, &b.h_um)?;
    let sigma = common("sigma_per_um", &a.sigma_per_um, &b.sigma_per_um)?;
    let mut out = TableDistance {
        theta_i: theta.iter().map(|p| a.theta_i[p.0]).collect(),
        h_um: h.iter().map(|p| a.h_um[p.0]).collect(),
        sigma_per_um: sigma.iter().map(|p| a.sigma_per_um[p.0]).collect(),
        refl2: Vec::new(),
        high2: Vec::new(),
        energy_refl: Vec::new(),
        energy_high: Vec::new(),
        r_d: Vec::new(),
    };
    for &(ma, mb) in &theta {
        for &(na, nb) in &h {
            let (ia, ib) = (ma * a.h_um.len() + na, mb * b.h_um.len() + nb);
            let distance = |x: &[f32], y: &[f32], noise: [f64; 2]| -> f64 {
                let (mut apart, mut norm) = (0.0, 0.0);
                for i in 0..a.grid.theta_o {
                    let row = i * a.grid.phi_o..(i + 1) * a.grid.phi_o;
                    let (mut d, mut n) = (0.0, 0.0);
                    for (u, v) in x[row.clone()].iter().zip(&y[row]) {
                        d += f64::from(u - v).powi(2);
                        n += f64::from(*v).powi(2);
                    }
                    apart += a.grid.solid_angle(i) * d;
                    norm += a.grid.solid_angle(i) * n;
                }
                // The noise of the first table affects only the distance, not the norm.
                excess2(apart - noise[0], norm, noise[1]).unwrap_or(f64::NAN)
            };
            out.r_d.push(a.r_d[ia] - b.r_d[ib]);
            out.energy_refl.push(a.energy_refl[ia] - b.energy_refl[ib]);
            let noise = [a.noise_refl[ia], b.noise_refl[ib]];
            out.refl2.push(distance(a.refl_slice(ma, na), b.refl_slice(mb, nb), noise));
            for &(ka, kb) in &sigma {
                let (ia, ib) = (ia * a.sigma_per_um.len() + ka, ib * b.sigma_per_um.len() + kb);
                out.energy_high.push(a.energy_high[ia] - b.energy_high[ib]);
                let noise = [a.noise_high[ia], b.noise_high[ib]];
                out.high2.push(distance(a.high_slice(ma, na, ka), b.high_slice(mb, nb, kb), noise));
            }
        }
    }
    Ok(out)
}

/// Distance of a fitted model from the table `reference`, relative to the table, at the table's incidences up
/// to `theta_i` [rad] and |h| `h_um`, including those between the model's nodes, and at all of the table's
/// absorptions. Noise that the model fitted in its own table is part of the distance.
///
/// # Errors
/// [`FitError::Axes`] if no incidence remains or one lies beyond the model's nodes; [`FitError::Table`].
pub fn model_distance(model: &PlyData, reference: &Table, theta_i: f64, h_um: f64) -> Result<TableDistance, FitError> {
    check_table(reference)?;
    let within = |axis: &'static str, x: &[f64], nodes: &[f64], limit: f64| -> Result<Vec<usize>, FitError> {
        let retained: Vec<usize> = (0..x.len()).filter(|i| x[*i].abs() <= limit + 1e-9 * (1.0 + limit)).collect();
        let last = nodes.last().map_or(0.0, |n| n + 1e-9 * (1.0 + n.abs()));
        if retained.is_empty() || retained.iter().any(|i| x[*i].abs() > last) {
            return Err(FitError::Axes { axis, model: nodes.len(), table: x.len() });
        }
        Ok(retained)
    };
    let rows = within("theta_i", &reference.theta_i, &model.theta_i, theta_i)?;
    let columns = within("h_um", &reference.h_um, &model.h_um, h_um)?;
    let sphere = SphereGrid::new(reference.grid);
    let sigmas = reference.sigma_per_um.len();
    let incidences: Vec<(usize, usize)> = rows.iter().flat_map(|m| columns.iter().map(|n| (*m, *n))).collect();
    // For each incidence, f_refl and then f_high at each sigma: squared distance and difference of energy.
    let slices: Vec<Vec<(f64, f64)>> = incidences
        .par_iter()
        .map(|&(m, n)| {
            let mut scratch = Scratch::default();
            let place = locate(model, reference.theta_i[m], reference.h_um[n]);
            let node = m * reference.h_um.len() + n;
            (0..=sigmas)
                .map(|channel| {
                    let (lobes, slice, noise, energy) = match channel.checked_sub(1) {
                        None => {
                            let lobes = refl_lobes(model, place);
                            (lobes, reference.refl_slice(m, n), reference.noise_refl[node], reference.energy_refl[node])
                        }
                        Some(k) => {
                            let lobes = high_lobes(model, place, reference.sigma_per_um[k]);
                            let at = node * sigmas + k;
                            (lobes, reference.high_slice(m, n, k), reference.noise_high[at], reference.energy_high[at])
                        }
                    };
                    let slice = sphere.pad(slice, 1.0);
                    let distance2 = sphere.distance2(&evaluate(&sphere, &lobes, &mut scratch), &slice);
                    let error = excess2(distance2, sphere.inner(&slice, &slice), noise);
                    (error.unwrap_or(f64::NAN), lobes.energy - energy)
                })
                .collect()
        })
        .collect();
    let r_d = |&(m, n): &(usize, usize)| {
        let place = locate(model, reference.theta_i[m], reference.h_um[n]);
        energies(model, place).r_d - reference.r_d[m * reference.h_um.len() + n]
    };
    Ok(TableDistance {
        theta_i: rows.iter().map(|m| reference.theta_i[*m]).collect(),
        h_um: columns.iter().map(|n| reference.h_um[*n]).collect(),
        sigma_per_um: reference.sigma_per_um.clone(),
        refl2: slices.iter().map(|s| s[0].0).collect(),
        high2: slices.iter().flat_map(|s| s[1..].iter().map(|v| v.0)).collect(),
        energy_refl: slices.iter().map(|s| s[0].1).collect(),
        energy_high: slices.iter().flat_map(|s| s[1..].iter().map(|v| v.1)).collect(),
        r_d: incidences.iter().map(r_d).collect(),
    })
}
