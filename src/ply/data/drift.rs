//! Displacement along a ply: how far along the axis light of f_high leaves from where it entered.
//!
//! Fibers guide light, so that it leaves a ply further along in the direction in which it travels. The
//! displacement D runs along the axis from the point where the incident line crosses the cylinder of the
//! ply's radius R to the point where the exit line crosses it, in units of R. It is tabulated by latitude of
//! incidence and by the cosine between the outgoing direction and the axis, as an average over offsets.

use crate::Result;
use crate::io::{Check, Reader, Writer};

/// Names of the tensors in a model file.
pub(crate) const NAMES: [&str; 2] = ["drift", "drift_share"];
/// Number of equal bins of the axial cosine of the outgoing direction, -1 to 1.
pub const DRIFT_BINS: usize = 6;
/// Number of displacements by which the distribution of a bin is represented.
pub const DRIFT_QUANTILES: usize = 8;
/// Maximum displacement, in units of R.
pub const DRIFT_MAX: f64 = 200.0;

/// Bin of the cosine between an outgoing direction and the axis.
#[inline]
pub fn drift_bin(cosine: f32) -> usize {
    (((0.5 * cosine + 0.5) * DRIFT_BINS as f32) as usize).min(DRIFT_BINS - 1)
}

/// Displacements of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct ExitDrift {
    /// `[M][DRIFT_BINS][DRIFT_QUANTILES]`: D of clear fibers' light, ascending: the mean of each of as many
    /// equal parts of the light.
    pub at: Vec<f64>,
    /// `[M][DRIFT_BINS][DRIFT_QUANTILES][K]`: share of the bin's light in that part, by absorption.
    pub share: Vec<f64>,
}

/// Shape of the tensors for M latitudes and K absorptions.
pub(crate) fn shapes(m: usize, k: usize) -> ([usize; 3], [usize; 4]) {
    ([m, DRIFT_BINS, DRIFT_QUANTILES], [m, DRIFT_BINS, DRIFT_QUANTILES, k])
}

impl ExitDrift {
    /// Displacements of light that leaves where it enters.
    pub fn none(m: usize, k: usize) -> ExitDrift {
        let parts = m * DRIFT_BINS * DRIFT_QUANTILES;
        ExitDrift { at: vec![0.0; parts], share: vec![1.0 / DRIFT_QUANTILES as f64; parts * k] }
    }

    pub(crate) fn write(&self, w: &mut Writer, m: usize, k: usize) {
        let (at, share) = shapes(m, k);
        w.f32(NAMES[0], &at, self.at.iter().map(|v| *v as f32));
        w.f32(NAMES[1], &share, self.share.iter().map(|v| *v as f32));
    }

    pub(crate) fn read(r: &Reader<'_>, m: usize, k: usize) -> Result<ExitDrift> {
        let (at, share) = shapes(m, k);
        Ok(ExitDrift { at: r.f64(NAMES[0], &at)?, share: r.f64(NAMES[1], &share)? })
    }

    pub(crate) fn check(&self, c: &Check<'_>, m: usize, k: usize) -> Result<()> {
        let (at, share) = shapes(m, k);
        c.len(NAMES[0], self.at.len(), &at)?;
        c.len(NAMES[1], self.share.len(), &share)?;
        c.range(NAMES[0], &self.at, -DRIFT_MAX, DRIFT_MAX)?;
        c.range(NAMES[1], &self.share, 0.0, 1.001)
    }
}
