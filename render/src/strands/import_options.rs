//! Options for reading files of strands: units, radii, basis; and the treatment of strands that are too thin.

use super::{Basis, MIN_RADIUS_MM, StrandNotes, Strands, check_points};
use crate::RenderError;

/// Largest file of strands [bytes].
pub(super) const MAX_BYTES: u64 = 1 << 32;

/// How to interpret a file of strands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandFile {
    /// Basis of the points of a `.hair` file or Mitsuba's text; pbrt's curves become splines.
    pub basis: Basis,
    /// Length of one unit of the file [mm].
    pub mm_per_unit: f32,
    /// Radius [mm] that overrides the file's radii.
    pub radius_mm: Option<f32>,
    /// Whether a spline extends from the first to the last point of each strand, as in `.hair` files.
    /// Mitsuba's splines do not.
    pub whole: bool,
}

impl StrandFile {
    pub(super) fn point(&self, [x, y, z]: [f32; 3], radius: f32) -> [f32; 4] {
        let s = self.mm_per_unit;
        [s * x, s * y, s * z, self.radius_mm.unwrap_or(s * radius)]
    }

    /// Adds a strand from the points of a file. A radius below the minimum is raised to it, since strands
    /// taper to points and some roots are thin; a strand of a single point or without width is omitted.
    /// `notes` counts both.
    pub(super) fn push(
        &self,
        strands: &mut Strands,
        points: &mut [[f32; 4]],
        notes: &mut StrandNotes,
        file: &str,
        place: &str,
    ) -> Result<(), RenderError> {
        if points.len() == 1 {
            notes.single_points += 1;
            return Ok(());
        }
        check_points(points, 0.0, file, place)?;
        let Some(min) = min_radius_mm(points.iter().map(|p| p[3].into())) else {
            notes.without_width += 1;
            return Ok(());
        };
        for p in points.iter_mut().filter(|p| f64::from(p[3]) < min) {
            p[3] = min as f32;
            notes.thin_points += 1;
        }
        if self.whole { strands.push_whole(points, file, place) } else { strands.push(points, file, place) }
    }
}

/// Minimum radius along a strand of these radii [mm]: [`MIN_RADIUS_MM`], or the 32-bit resolution of the
/// largest radius; `None` if all radii are below it.
pub(super) fn min_radius_mm(radii: impl Iterator<Item = f64>) -> Option<f64> {
    let (max, min) = (radii.fold(0.0, f64::max), f64::from(MIN_RADIUS_MM));
    (max >= min).then(|| min.max(1e-5 * max))
}

/// Refuses gzip files.
pub(super) fn refuse_packed(bytes: &[u8]) -> Result<(), String> {
    match bytes {
        [0x1f, 0x8b, ..] => Err("packed by gzip; unpack it (gunzip) and name the unpacked file".into()),
        _ => Ok(()),
    }
}
