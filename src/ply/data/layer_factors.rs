//! The tensors of a model that describe how layers of its yarns reflect and transmit light (Yu 2025, 5.4).

use super::energies::{EnergiesAt, PlyEnergies};
use super::limits::ENERGY_TOLERANCE;
use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};

/// Names of the tensors in a model file.
pub(crate) const NAMES: [&str; 2] = ["layer_forward", "layer_diffuse"];

/// The tensors of a model that define its layers. Arrays are flat, last index fastest. On the last axis the
/// first entry is f_refl and the others are the path-length spectrum of f_high over
/// [`crate::ply::PlyData::path_um`], so a factor is valid at every absorption.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerFactors {
    /// `[2 M - 1][2 H - 1][1 + J]`, at the nodes and half-way between them: energy that exits into the half
    /// space away from the light, y < 0 in the ply frame. It is tabulated half-way too because lobes rotate
    /// and blocks change between nodes, and forward light changes with them.
    pub forward: Vec<f64>,
    /// `[2][1 + J]`: fractions of diffuse light that are reflected and transmitted, relative to the light
    /// that hits fibers.
    pub diffuse: Vec<f64>,
}

impl LayerFactors {
    /// Writes the tensors, of sizes M, H and J.
    pub(crate) fn write(&self, w: &mut Writer, (m, h, j): (usize, usize, usize)) {
        w.f64(NAMES[0], &[2 * m - 1, 2 * h - 1, 1 + j], &self.forward);
        w.f64(NAMES[1], &[2, 1 + j], &self.diffuse);
    }

    pub(crate) fn read(r: &Reader<'_>, (m, h, j): (usize, usize, usize)) -> Result<Option<LayerFactors>> {
        if !NAMES.iter().any(|name| r.has(name)) {
            return Ok(None);
        }
        Ok(Some(LayerFactors {
            forward: r.f64(NAMES[0], &[2 * m - 1, 2 * h - 1, 1 + j])?,
            diffuse: r.f64(NAMES[1], &[2, 1 + j])?,
        }))
    }

    /// Checks the factors of `j` path lengths against checked energies on the model's axes. Forward energy
    /// must not exceed scattered energy, and reflected plus transmitted diffuse light must not exceed 1.
    pub(crate) fn check(&self, c: &Check<'_>, all: &PlyEnergies, [theta_i, h_um]: [&[f64]; 2], j: usize) -> Result<()> {
        let (rows, columns) = (2 * theta_i.len() - 1, 2 * h_um.len() - 1);
        for (name, values, shape) in
            [(NAMES[0], &self.forward, &[rows, columns, 1 + j][..]), (NAMES[1], &self.diffuse, &[2, 1 + j])]
        {
            c.len(name, values.len(), shape)?;
            c.range(name, values, 0.0, 1.0 + ENERGY_TOLERANCE)?;
        }
        let energies = half_nodes(all, theta_i, h_um);
        // All paths of f_high are compared together. Lobes are scaled to their total energy, so a single path
        // may scatter more light forward than its share of the energy.
        for (i, forward) in self.forward.chunks_exact(1 + j).enumerate() {
            let energy = &energies[i];
            for (part, forward, energy) in [
                ("f_refl", forward[0], energy.refl),
                ("f_high", forward[1..].iter().sum(), energy.high.iter().sum::<f64>()),
            ] {
                if forward > energy + ENERGY_TOLERANCE {
                    let key = format!("{} of {part} at row {}, column {}", NAMES[0], i / columns, i % columns);
                    let hint = format!("what goes forward is a part of what is scattered there, {energy:.4}");
                    return Err(invalid(c.0, &key, forward, &hint));
                }
            }
        }
        let sum: f64 = self.diffuse.iter().sum();
        if sum > 1.0 + ENERGY_TOLERANCE {
            let hint = format!(
                "expected at most {}: what is sent back and passes is a part of what comes",
                1.0 + ENERGY_TOLERANCE
            );
            return Err(invalid(c.0, &format!("sum of {}", NAMES[1]), sum, &hint));
        }
        Ok(())
    }
}

/// Energies at the nodes and half-way between them, `[2 M - 1][2 H - 1]`.
pub(in crate::ply) fn half_nodes(energies: &PlyEnergies, theta_i: &[f64], h_um: &[f64]) -> Vec<EnergiesAt> {
    let (rows, columns) = (2 * theta_i.len() - 1, 2 * h_um.len() - 1);
    let half = |axis: &[f64], i: usize| 0.5 * (axis[i / 2] + axis[i.div_ceil(2)]);
    (0..rows * columns).map(|i| energies.at(half(theta_i, i / columns), half(h_um, i % columns))).collect()
}
