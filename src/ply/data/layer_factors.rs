//! The tensors of a model for light that layers of its yarns reflect and transmit (Yu 2025, 5.4).

use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};
use crate::ply::{EnergiesAt, PlyData};
use crate::table::TOLERANCE;

/// Names of the tensors in a model file.
pub(crate) const NAMES: [&str; 2] = ["layer_forward", "layer_diffuse"];

/// The tensors of a model that define its layers. Flat arrays, last index fastest; on the last axis the first
/// entry is f_refl, the others are the path-length spectrum of f_high on [`crate::ply::PlyData::path_um`], so
/// a factor is valid at every absorption.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerFactors {
    /// `[2 M - 1][2 H - 1][1 + J]`, at the nodes and midway between them: energy that exits into the half
    /// space away from the light, y < 0 in the ply frame. Lobes turn and blocks change between nodes, and
    /// forward light with them.
    pub forward: Vec<f64>,
    /// `[2][1 + J]`: reflected and transmitted fractions of diffuse light, of the light that hits fibers.
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

    /// Checks the factors beside a model of checked sizes and energies: at most the scattered light goes
    /// forward, and at most the incident diffuse light exits.
    pub(crate) fn check(&self, c: &Check<'_>, model: &PlyData) -> Result<()> {
        let (m, h, _, j) = model.sizes();
        let (rows, columns) = (2 * m - 1, 2 * h - 1);
        for (name, values, shape) in
            [(NAMES[0], &self.forward, &[rows, columns, 1 + j][..]), (NAMES[1], &self.diffuse, &[2, 1 + j])]
        {
            c.len(name, values.len(), shape)?;
            c.range(name, values, 0.0, 1.0 + TOLERANCE)?;
        }
        let energies = half_nodes(model);
        // All paths of f_high together: lobes are scaled to the energy as a whole, so one path may send more
        // light forward than is scattered on it.
        for (i, forward) in self.forward.chunks_exact(1 + j).enumerate() {
            let energy = &energies[i];
            for (part, forward, energy) in [
                ("f_refl", forward[0], energy.refl),
                ("f_high", forward[1..].iter().sum(), energy.high.iter().sum::<f64>()),
            ] {
                if forward > energy + TOLERANCE {
                    let key = format!("{} of {part} at row {}, column {}", NAMES[0], i / columns, i % columns);
                    let hint = format!("what goes forward is a part of what is scattered there, {energy:.4}");
                    return Err(invalid(c.0, &key, forward, &hint));
                }
            }
        }
        let sum: f64 = self.diffuse.iter().sum();
        if sum > 1.0 + TOLERANCE {
            let hint =
                format!("expected at most {}: what is sent back and passes is a part of what comes", 1.0 + TOLERANCE);
            return Err(invalid(c.0, &format!("sum of {}", NAMES[1]), sum, &hint));
        }
        Ok(())
    }
}

impl PlyData {
    /// Limits forward light to scattered light, where both were interpolated separately.
    pub(in crate::ply) fn bound_layers(&mut self) {
        let Some(mut layers) = self.layers.take() else { return };
        let size = 1 + self.path_um.len();
        for (forward, energy) in layers.forward.chunks_exact_mut(size).zip(half_nodes(self)) {
            forward[0] = forward[0].min(energy.refl);
            let (sum, most) = (forward[1..].iter().sum::<f64>(), energy.high.iter().sum::<f64>());
            if sum > most {
                forward[1..].iter_mut().for_each(|f| *f *= most / sum);
            }
        }
        self.layers = Some(layers);
    }
}

/// Energies at the nodes and midway between them, `[2 M - 1][2 H - 1]`.
pub(in crate::ply) fn half_nodes(d: &PlyData) -> Vec<EnergiesAt> {
    let (rows, columns) = (2 * d.theta_i.len() - 1, 2 * d.h_um.len() - 1);
    let half = |axis: &[f64], i: usize| 0.5 * (axis[i / 2] + axis[i.div_ceil(2)]);
    (0..rows * columns).map(|i| d.energies.at(half(&d.theta_i, i / columns), half(&d.h_um, i % columns))).collect()
}
