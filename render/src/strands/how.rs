//! How files of strands are taken: units, radii, what points mean.

use super::{Basis, MIN_RADIUS_MM, StrandNotes, Strands, check_points};
use crate::RenderError;

/// Largest file of strands [bytes].
pub(super) const MAX_BYTES: u64 = 1 << 32;

/// How a file of strands is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandFile {
    /// What the points of a `.hair` or Mitsuba's text mean; pbrt's curves become splines.
    pub basis: Basis,
    /// A unit of the file [mm].
    pub mm_per_unit: f32,
    /// Radius [mm] in place of the file's.
    pub radius_mm: Option<f32>,
    /// Of a spline: go from the first to the last point of each strand, as `.hair` means it. Mitsuba's
    /// splines do not.
    pub whole: bool,
}

impl StrandFile {
    pub(super) fn point(&self, [x, y, z]: [f32; 3], radius: f32) -> [f32; 4] {
        let s = self.mm_per_unit;
        [s * x, s * y, s * z, self.radius_mm.unwrap_or(s * radius)]
    }

    /// Adds a strand by the points of a file. Strands end in points and are bald at some roots: a radius
    /// below the least takes the least, a strand of one point or without any width is left out, and
    /// both are counted.
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
        let Some(least) = least_radius_mm(points.iter().map(|p| p[3].into())) else {
            notes.without_width += 1;
            return Ok(());
        };
        for p in points.iter_mut().filter(|p| f64::from(p[3]) < least) {
            p[3] = least as f32;
            notes.thin_points += 1;
        }
        if self.whole { strands.push_whole(points, file, place) } else { strands.push(points, file, place) }
    }
}

/// Least radius along a strand of these radii [mm]: [`MIN_RADIUS_MM`], and what 32 bits tell apart from the
/// largest; none where all are below it.
pub(super) fn least_radius_mm(radii: impl Iterator<Item = f64>) -> Option<f64> {
    let (most, least) = (radii.fold(0.0, f64::max), f64::from(MIN_RADIUS_MM));
    (most >= least).then(|| least.max(1e-5 * most))
}

/// At most 20 characters of a word.
pub(super) fn cut(word: &str) -> String {
    if word.chars().count() <= 20 { word.to_string() } else { word.chars().take(17).chain("...".chars()).collect() }
}

/// Refuses what gzip packed.
pub(super) fn refuse_packed(bytes: &[u8]) -> Result<(), String> {
    match bytes {
        [0x1f, 0x8b, ..] => Err("packed by gzip; unpack it (gunzip) and name the unpacked file".into()),
        _ => Ok(()),
    }
}
