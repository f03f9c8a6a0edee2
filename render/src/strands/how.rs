//! How files of strands are taken: units, radii, what points mean.

use super::{Basis, Strands};
use crate::RenderError;

/// How a file of strands is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandFile {
    /// What the points of a `.hair` or Mitsuba's text mean; pbrt's curves become splines.
    pub basis: Basis,
    /// A unit of the file [mm].
    pub mm_per_unit: f32,
    /// Radius [mm] in place of the file's.
    pub radius_mm: Option<f32>,
    /// Of a spline: go from the first to the last point of each strand, as `.hair` means it. Mitsuba's splines do not.
    pub whole: bool,
}

impl StrandFile {
    pub(super) fn point(&self, [x, y, z]: [f32; 3], radius: f32) -> [f32; 4] {
        let s = self.mm_per_unit;
        [s * x, s * y, s * z, self.radius_mm.unwrap_or(s * radius)]
    }

    pub(super) fn push(
        &self,
        strands: &mut Strands,
        points: &[[f32; 4]],
        file: &str,
        place: &str,
    ) -> Result<(), RenderError> {
        if self.whole { strands.push_whole(points, file, place) } else { strands.push(points, file, place) }
    }
}

/// At most 20 characters of a word.
pub(super) fn cut(word: &str) -> String {
    if word.chars().count() <= 20 { word.to_string() } else { word.chars().take(17).chain("...".chars()).collect() }
}
