//! Shadows of plies on their neighbors: the probability that light which leaves a ply in a direction escapes
//! without hitting another ply.
//!
//! The probabilities are tabulated for each curve of the cell over the place along it, the offset from its
//! axis and the direction, from lines traced through the cloth (`plywave_sim`). Places with equal
//! surroundings share a table; the table of one place is described in `shadow_table.rs`.

use crate::cloth::geometry::lines::{ClothLines, LineHit};
use crate::cloth::shade::shadow_table::{ALL_FREE, SIZE, ShadowsAt, Toward, free};
use crate::math::floor_fraction;
use crate::ply::{EXIT_KINDS, ExitLine, ExitShape};

/// Distance along the curve, in ply radii, within which a hit on the ply that a line started from is ignored.
const OWN: f32 = 2.5;
/// The places of a curve in the table.
#[derive(Clone, Copy, Debug)]
struct Places {
    first: u32,
    count: u32,
    per_knot: f32,
}

/// The shadow table of a cloth.
#[derive(Clone, Debug)]
pub struct ClothShadows {
    curves: Vec<Places>,
    /// `[place]`: its table in `free`; empty if each place has its own.
    tables: Vec<u32>,
    /// `[table][row][column][LANES]`; 255 represents `MAX_SHARE`.
    free: Vec<u8>,
}

impl ClothShadows {
    /// Builds the table from the numbers of places and knots of each curve, and from the table of each place,
    /// which is empty if each place has its own. `None` if the sizes do not match.
    pub fn of(
        counts: &[u32],
        knots: impl Iterator<Item = usize>,
        tables: Vec<u32>,
        free: Vec<u8>,
    ) -> Option<ClothShadows> {
        let (mut curves, mut first) = (Vec::new(), 0u32);
        for (count, knots) in counts.iter().zip(knots) {
            curves.push(Places { first, count: *count, per_knot: *count as f32 / knots as f32 });
            first = first.checked_add(*count).filter(|_| *count > 0)?;
        }
        let (places, count) = (first as usize, free.len() / SIZE);
        let fit = if tables.is_empty() {
            count == places
        } else {
            tables.len() == places && tables.iter().all(|table| (*table as usize) < count)
        };
        (fit && free.len() == count * SIZE).then_some(ClothShadows { curves, tables, free })
    }

    /// `[place]`: number of its table; empty if each place has its own.
    pub fn tables(&self) -> &[u32] {
        &self.tables
    }

    /// Number of places of each curve.
    pub fn counts(&self) -> impl Iterator<Item = u32> {
        self.curves.iter().map(|places| places.count)
    }

    /// The table's bytes.
    pub fn free(&self) -> &[u8] {
        &self.free
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.free.len() + size_of_val(self.curves.as_slice()) + size_of_val(self.tables.as_slice())
    }
}

/// Shadows on the light of one ply at a hit.
#[derive(Clone, Copy, Debug)]
pub struct ClothShade<'a> {
    /// Whether shadows apply in the half space of incidence, and in the other.
    counts: [bool; 2],
    /// Sign of z in the half space of incidence.
    up_sign: f32,
    shadows: &'a ClothShadows,
    places: Places,
    /// Position among the places where the line is nearest to the axis, and the number of places per radius R
    /// along the curve.
    at: f32,
    per_radius: f32,
}

impl<'a> ClothShade<'a> {
    /// Prepares the shadows for a ply that a line from direction `a` hits; `counts` tells whether shadows
    /// apply in the half spaces, the one of incidence first.
    #[inline(always)]
    pub fn new(shadows: &'a ClothShadows, hit: &LineHit, a: [f32; 3], counts: [bool; 2]) -> ClothShade<'a> {
        let places = shadows.curves[hit.curve as usize];
        ClothShade {
            counts,
            up_sign: if a[2] < 0.0 { -1.0 } else { 1.0 },
            shadows,
            places,
            at: hit.parameter * places.per_knot,
            per_radius: hit.radius_um / hit.speed_um.max(1e-6) * places.per_knot,
        }
    }

    /// Tables of the two places around the hit, and the position between them.
    #[inline(always)]
    pub fn tables(&self) -> ([usize; 2], f32) {
        let (place, between) = floor_fraction(self.at);
        let table = |place: i32| {
            let place = self.places.first as usize + place.rem_euclid(self.places.count as i32) as usize;
            self.shadows.tables.get(place).map_or(place, |table| *table as usize)
        };
        ([table(place), table(place.wrapping_add(1))], between)
    }

    #[inline(always)]
    fn at(&self, s: f32) -> ShadowsAt<'a> {
        let (place, between) = floor_fraction(self.at + s * self.per_radius);
        let count = self.places.count as i32;
        let row = |place: i32| -> &'a [u8; SIZE] {
            let place = self.places.first as usize + place.rem_euclid(count) as usize;
            let at = self.shadows.tables.get(place).map_or(place, |table| *table as usize);
            self.shadows.free.get(at * SIZE..).and_then(|rows| rows.first_chunk()).unwrap_or(&[ALL_FREE; SIZE])
        };
        ShadowsAt { rows: [row(place), row(place.wrapping_add(1))], between }
    }

    /// Shares that escape in a direction of single reflection, of other light of clear fibers, and of other
    /// light of dark fibers; each leaves the ply along its line.
    #[inline(always)]
    pub fn toward(
        &self,
        toward: &Toward,
        shapes: &[ExitShape; EXIT_KINDS],
        [refl, clear, dark]: [ExitLine; EXIT_KINDS],
    ) -> [f32; EXIT_KINDS] {
        if !self.counts[usize::from(toward.b[2] * self.up_sign < 0.0)] {
            return [1.0; EXIT_KINDS];
        }
        // Single reflection and light of dark fibers leave at places close to each other and share one.
        let places = [self.at(0.5 * (refl.s + dark.s)), self.at(clear.s)];
        let exits =
            [shapes[0].at_offsets(refl.mean), shapes[1].at_offsets(clear.mean), shapes[2].at_offsets(dark.mean)];
        free(&places, toward, &exits)
    }
}

/// Whether a hit of a line is on the ply that the line started from: the same strand, close to the start.
/// `own` is the ply's curve, the cell of its image and the parameter of the start.
pub fn is_own(lines: &ClothLines, hit: &LineHit, (curve, cells, parameter): (u32, [i32; 2], f32)) -> bool {
    if hit.curve != curve {
        return false;
    }
    let turns = if hit.cells == cells {
        0
    } else {
        let by = [hit.cells[0] - cells[0], hit.cells[1] - cells[1]];
        match crate::cloth::whole_times(by, lines.shift(curve as usize)) {
            Some(turns) => turns,
            None => return false,
        }
    };
    let knots = lines.knots(curve as usize) as f32;
    (hit.parameter + turns as f32 * knots - parameter).abs() * hit.speed_um < OWN * hit.radius_um
}
