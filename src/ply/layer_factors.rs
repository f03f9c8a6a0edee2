//! The tensors of a model that say what layers of its yarns send back and let through (Yu 2025, 5.4).

use crate::Result;
use crate::io::{Check, Reader, Writer};

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

    pub(crate) fn check(&self, c: &Check<'_>, (m, h, j): (usize, usize, usize)) -> Result<()> {
        for (name, values, shape) in
            [(NAMES[0], &self.forward, &[2 * m - 1, 2 * h - 1, 1 + j][..]), (NAMES[1], &self.diffuse, &[2, 1 + j])]
        {
            c.len(name, values.len(), shape)?;
            c.range(name, values, 0.0, 1.0 + crate::table::TOLERANCE)?;
        }
        Ok(())
    }
}
