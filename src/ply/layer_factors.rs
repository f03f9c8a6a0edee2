//! The tensors of a model that say what layers of its yarns send back and let through (Yu 2025, 5.4).

use super::PlyData;
use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};
use crate::table::TOLERANCE;

/// Names of the tensors in a model file.
pub(crate) const NAMES: [&str; 2] = ["layer_forward", "layer_diffuse"];

/// The tensors of a model from which its layers follow. Flat arrays, last index fastest; of the last axis the first entry is f_refl, the others are
/// the path-length spectrum of f_high on [`super::PlyData::path_um`], so that a factor holds at every absorption.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerFactors {
    /// `[2 M - 1][2 H - 1][1 + J]`, at the nodes and half way between them: energy that leaves into the half space away from the light, y < 0 in the ply frame.
    /// Lobes turn and blocks change between nodes, and what goes forward with them.
    pub forward: Vec<f64>,
    /// `[2][1 + J]`: fraction of diffuse light that is sent back and that passes, of the light that meets fibers.
    pub diffuse: Vec<f64>,
}

impl LayerFactors {
    /// Of sizes M, H and J.
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

    /// What the factors must satisfy beside a model of checked sizes and energies: no more goes forward than is scattered, no more diffuse light leaves than comes.
    pub(crate) fn check(&self, c: &Check<'_>, model: &PlyData) -> Result<()> {
        let (m, h, _, j) = model.sizes();
        let (rows, columns) = (2 * m - 1, 2 * h - 1);
        for (name, values, shape) in
            [(NAMES[0], &self.forward, &[rows, columns, 1 + j][..]), (NAMES[1], &self.diffuse, &[2, 1 + j])]
        {
            c.len(name, values.len(), shape)?;
            c.range(name, values, 0.0, 1.0 + TOLERANCE)?;
        }
        // Of f_high all paths together: lobes are scaled to the energy as a whole, so that one of its paths may take more forward than is scattered on that path.
        for (i, forward) in self.forward.chunks_exact(1 + j).enumerate() {
            let energy = |paths: std::ops::Range<usize>| {
                between(h, i / columns, i % columns, |node| paths.clone().map(|p| model.energy(node, p)).sum())
            };
            for (part, forward, energy) in
                [("f_refl", forward[0], energy(0..1)), ("f_high", forward[1..].iter().sum::<f64>(), energy(1..1 + j))]
            {
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

/// A bilinear quantity at a node or half way between nodes: the mean of the one, two or four nodes around, of `h` a row.
pub(super) fn between(h: usize, row: usize, column: usize, of: impl Fn(usize) -> f64) -> f64 {
    let (m0, m1, n0, n1) = (row / 2, row.div_ceil(2), column / 2, column.div_ceil(2));
    0.25 * (of(m0 * h + n0) + of(m0 * h + n1) + of(m1 * h + n0) + of(m1 * h + n1))
}
