//! Computes the factors of a layer of yarns (Yu 2025, 5.4) from the lobes of a fitted ply, so that they match
//! the evaluator and not the table.
//!
//! Forward is the half space y < 0 of the ply frame, phi_o in (pi, 2 pi). Diffuse light is incident with the
//! density cos(theta) cos(alpha) of its projected solid angle cos(theta) d theta d alpha about the layer's
//! normal, where alpha is its azimuth about the ply. Light scattered by an azimuth delta from its own azimuth
//! stays above the layer if |alpha + delta| < pi/2. Averaged over alpha, the probability of this is
//!
//! ```text
//! 1/2 integral from -pi/2 to pi/2 - delta of cos(alpha) d alpha = (1 + cos delta) / 2,      cos delta = sin phi_o
//! ```
//!
//! and over theta it is averaged with the weight cos^2(theta). Latitudes beyond the last node use that node's
//! fraction.

use crate::lobes::absorption::energy_spectrum;
use crate::lobes::model::{energies, evaluate, high_lobes, locate, refl_lobes};
use crate::lobes::sphere::{PaddedSlice, Scratch, SphereGrid};
use plywave::ply::{LayerFactors, PlyData};
use plywave_tables::table::OutgoingGrid;
use rayon::prelude::*;

/// Bins of the quadrature over the outgoing sphere; half and quarter turns of the azimuth fall between bins.
const GRID: OutgoingGrid = OutgoingGrid { theta_o: 90, phi_o: 180 };

/// Fractions of a slice's light that go forward, and that stay above the layer under diffuse light.
fn shares(sphere: &SphereGrid, slice: &PaddedSlice) -> (f64, f64) {
    let values = sphere.unpad(slice);
    let (mut all, mut forward, mut above) = (0.0, 0.0, 0.0);
    for (row, solid_angle) in values.chunks_exact(GRID.phi_o).zip(sphere.solid_angles()) {
        for (j, v) in row.iter().enumerate() {
            let (v, sin) = (f64::from(*v) * solid_angle, GRID.phi(j).sin());
            all += v;
            forward += if sin < 0.0 { v } else { 0.0 };
            above += 0.5 * (1.0 + sin) * v;
        }
    }
    if all > 0.0 { (forward / all, above / all) } else { (0.0, 0.0) }
}

/// Computes the layer factors of a fitted model.
pub fn layer_factors(data: &PlyData) -> LayerFactors {
    let sphere = SphereGrid::new(GRID);
    // The latitudes and offsets are the nodes and the points halfway between them.
    let (rows, columns, sigma) = (2 * data.theta_i.len() - 1, 2 * data.h_um.len() - 1, &data.sigma_per_um);
    let theta = |m: usize| data.theta_i[data.theta_i.len() - 1] * m as f64 / (rows - 1) as f64;
    let place = |node: usize| {
        let h = data.h_um[data.h_um.len() - 1] * (2.0 * (node % columns) as f64 / (columns - 1) as f64 - 1.0);
        locate(data, theta(node / columns), h)
    };
    let size = 1 + data.path_um.len();
    // For each node: forward energy of f_refl and its spectrum of f_high; the energy that stays above the
    // layer under diffuse light, and the total energy, as [1 + K].
    type Node = (Vec<f64>, Vec<f64>, Vec<f64>);
    let nodes: Vec<Node> = (0..rows * columns)
        .into_par_iter()
        .map(|node| {
            let mut scratch = Scratch::default();
            let at = place(node);
            let (mut forward, mut above, mut all) = (Vec::new(), Vec::new(), Vec::new());
            let high = sigma.iter().map(|s| high_lobes(data, at, *s));
            for lobes in std::iter::once(refl_lobes(data, at)).chain(high) {
                let (f, a) = shares(&sphere, &evaluate(&sphere, &lobes, &mut scratch));
                forward.push(f * lobes.energy);
                above.push(a * lobes.energy);
                all.push(lobes.energy);
            }
            let mut spectrum = vec![forward[0]];
            spectrum.extend(energy_spectrum(&forward[1..], sigma, &data.path_um).0);
            (spectrum, above, all)
        })
        .collect();
    // Light is uniform over h; latitudes are weighted by cos^2 with the trapezoidal rule, and the last node
    // includes the cap beyond it.
    let primitive = |theta: f64| 0.5 * theta + 0.25 * (2.0 * theta).sin();
    let edge = |m: usize| 0.5 * (theta(m - 1) + theta(m));
    let (mut above, mut all, mut hit_energy) = (vec![0.0; 1 + sigma.len()], vec![0.0; 1 + sigma.len()], 0.0);
    for m in 0..rows {
        let low = if m == 0 { 0.0 } else { edge(m) };
        let high = if m + 1 == rows { std::f64::consts::FRAC_PI_2 } else { edge(m + 1) };
        for n in 0..columns {
            let rim = if n == 0 || n + 1 == columns { 0.5 } else { 1.0 };
            let weight = rim * (primitive(high) - primitive(low));
            let node = &nodes[m * columns + n];
            above.iter_mut().zip(&node.1).for_each(|(sum, v)| *sum += weight * v);
            all.iter_mut().zip(&node.2).for_each(|(sum, v)| *sum += weight * v);
            hit_energy += weight * (1.0 - energies(data, place(m * columns + n)).r_d);
        }
    }
    let mut diffuse = Vec::with_capacity(2 * size);
    let through: Vec<f64> = all.iter().zip(&above).map(|(all, above)| all - above).collect();
    for part in [above, through] {
        diffuse.push(part[0] / hit_energy);
        let high: Vec<f64> = part[1..].iter().map(|v| v / hit_energy).collect();
        diffuse.extend(energy_spectrum(&high, sigma, &data.path_um).0);
    }
    LayerFactors { forward: nodes.into_iter().flat_map(|n| n.0).collect(), diffuse }
}
