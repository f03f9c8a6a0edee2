//! Notes of a reader of strands: input that was omitted or changed.

use super::MIN_RADIUS_MM;
use super::words::cut;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Largest number of kinds of shapes that are counted separately.
const MAX_KINDS: usize = 16;

/// Input that a reader omitted or changed, and the included files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StrandNotes {
    /// Points whose radius was 0 or below the minimum, and was raised to it.
    pub thin_points: u64,
    /// Strands of a single point, omitted.
    pub single_points: u64,
    /// Strands whose radius is below the minimum everywhere, omitted.
    pub without_width: u64,
    /// pbrt's ribbons, read as round.
    pub ribbons: u64,
    /// pbrt's curves under a non-uniform scale, read as round with the same cross-sectional area.
    pub stretched: u64,
    /// pbrt's curves under animated transforms, read at their start.
    pub moving: u64,
    /// pbrt's shapes other than curves, which are ignored, by kind.
    pub other_shapes: BTreeMap<String, u64>,
    /// pbrt's blocks without an end.
    pub open_blocks: u64,
    /// Files that pbrt's text includes.
    pub included: BTreeSet<PathBuf>,
}

impl StrandNotes {
    pub(super) fn count_shape(&mut self, kind: &[u8]) {
        let mut kind = cut(&String::from_utf8_lossy(kind));
        if !self.other_shapes.contains_key(&kind) && self.other_shapes.len() >= MAX_KINDS {
            kind = "others".into();
        }
        *self.other_shapes.entry(kind).or_default() += 1;
    }

    /// Notes for the user, one per line.
    pub fn lines(&self) -> Vec<String> {
        let min = format!("{MIN_RADIUS_MM} mm");
        let shapes: Vec<String> = self.other_shapes.iter().map(|(kind, n)| format!("{n} {kind}")).collect();
        let others = self.other_shapes.values().sum();
        [
            (self.single_points, "strands of a single point, left out".to_string()),
            (self.without_width, format!("strands with a radius below {min} all along, left out")),
            (self.thin_points, format!("points with a radius of 0, or below {min}, which they take")),
            (self.ribbons, "ribbons, taken as round".into()),
            (
                self.stretched,
                "curves scaled differently by direction, taken as round, of the same section's area".into(),
            ),
            (self.moving, "curves that move, taken where they start".into()),
            (others, format!("shapes that are no curves, passed over ({})", shapes.join(", "))),
            (self.open_blocks, "blocks without an end, as AttributeBegin without AttributeEnd".into()),
        ]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{what}: {count}"))
        .collect()
    }
}
