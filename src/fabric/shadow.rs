//! Shadows of yarns on their neighbors: the chance that light which leaves a ply in a direction meets no other yarn.
//!
//! It is tabulated over the place along the yarn where the light's line is nearest to the yarn's axis, its offset from the axis, and the direction, by lines followed through
//! the fabric (`flight.rs`). A draft of few crossings has rows of its own for every place; in a larger one places share
//! the rows of the pattern of the nine crossings around.

use super::flight::{YarnId, exit};
use super::{Fabric, Family};
use crate::PlyModel;
use crate::math::floor_fraction;
use crate::math::hash::SplitMix64;
use crate::math::parallel;
use std::f32::consts::TAU;

/// Places along a yarn from one crossing to the next.
const PLACES: usize = 4;
/// Rows of directions in each half of the sphere, and columns about the normal.
pub(super) const ROWS: usize = 8;
pub(super) const COLUMNS: usize = 16;
/// Offsets across a yarn.
const OFFSETS: usize = 7;
/// Numbers of a direction: the offsets, and zeros up to a word.
pub(super) const LANES: usize = 8;
/// Lines an entry.
const LINES: usize = 2;
/// Bytes of a place.
const SIZE: usize = 2 * ROWS * COLUMNS * LANES;
/// Rows that are filled together.
const ROWS_A_PART: usize = 8;
/// Most crossings of a draft whose places have rows of their own.
const MOST_CROSSINGS: usize = 512;
/// Crossings of a larger draft that are looked at for patterns.
const LOOKED_AT: usize = 1 << 18;

/// The table of a fabric.
#[derive(Clone, Debug)]
pub(super) struct Shadows {
    /// `[place][row][column][LANES]`, 0 to 255.
    pub(super) free: Vec<u8>,
    /// For patterns: of `[family][place][pattern]` the index of its row; empty where every place has its own.
    pub(super) patterns: Vec<u32>,
}

/// What a ply model says of the light that passes beside its fibers.
pub(super) trait Passing {
    /// Fraction of a beam that passes a ply.
    fn r_d(&self, family: Family, yarn: i32, theta_i: f32, h_um: f32) -> f32;
}

/// Rows of directions: z of row r + 1/2 of a half is that to this power of the row's place in the half. Shadows change most towards the plane.
fn z_of(row: f32) -> f32 {
    let t = row / ROWS as f32;
    t * t.sqrt()
}

/// Mean of z over a row: `integral ((r + u) / ROWS)^1.5 du`, u from 0 to 1.
const MEAN_Z: [f32; ROWS] = [0.017678, 0.082322, 0.175568, 0.290118, 0.422526, 0.570634, 0.732919, 0.908235];

/// Place of a z among the rows of a half, 0 to ROWS.
#[inline]
fn row_of(z: f32) -> f32 {
    (two_thirds(z) * ROWS as f32).min(ROWS as f32)
}

/// z^(2/3), z from 0 to 1, to 0.01: two steps of Newton's for the cube root of the root, from a line that is near it.
#[inline]
pub(super) fn two_thirds(z: f32) -> f32 {
    let root = z.sqrt();
    let mut c = 0.4 + 0.6 * root;
    for _ in 0..2 {
        c -= (c * c * c - root) / (3.0 * c * c);
    }
    c * c * c * c
}

impl Shadows {
    /// Of a fabric, by lines followed through it.
    pub(super) fn new(fabric: &Fabric, passing: &(impl Passing + Sync)) -> Shadows {
        let (ends, picks) = (fabric.draft.ends(), fabric.draft.picks());
        let mut shadows = Shadows { free: Vec::new(), patterns: Vec::new() };
        // Family, yarn and place of each row.
        let mut rows: Vec<(Family, i32, i32)> = Vec::new();
        if ends * picks <= MOST_CROSSINGS {
            for family in Family::EACH {
                for yarn in 0..fabric.draft.threads(family) as i32 {
                    for place in 0..(PLACES * fabric.draft.threads(family.other())) as i32 {
                        rows.push((family, yarn, place));
                    }
                }
            }
        } else {
            shadows.patterns = vec![u32::MAX; 2 * PLACES * 512];
            let step = (ends * picks).div_ceil(LOOKED_AT).max(1);
            for crossing in (0..ends * picks).step_by(step) {
                let (end, pick) = ((crossing % ends) as i32, (crossing / ends) as i32);
                for (family, yarn, along) in [(Family::Warp, end, pick), (Family::Weft, pick, end)] {
                    let pattern = pattern(fabric, family, yarn, along);
                    let first = (family as usize * PLACES) * 512 + pattern;
                    if shadows.patterns[first] == u32::MAX {
                        for place in 0..PLACES {
                            shadows.patterns[first + place * 512] = rows.len() as u32;
                            rows.push((family, yarn, along * PLACES as i32 + place as i32));
                        }
                    }
                }
            }
            // A pattern that was not looked at has the row of one that was.
            for family_place in shadows.patterns.chunks_exact_mut(512) {
                let known: Vec<usize> = (0..512).filter(|p| family_place[*p] != u32::MAX).collect();
                for p in 0..512usize {
                    if family_place[p] == u32::MAX {
                        let like = known.iter().min_by_key(|k| (*k ^ p).count_ones()).copied().unwrap_or(0);
                        family_place[p] = family_place[like];
                    }
                }
            }
        }
        let filled = parallel::map(rows.len().div_ceil(ROWS_A_PART), |part| {
            let rows = &rows[part * ROWS_A_PART..((part + 1) * ROWS_A_PART).min(rows.len())];
            let mut free = vec![0; rows.len() * SIZE];
            for (row, (family, yarn, place)) in free.chunks_exact_mut(SIZE).zip(rows) {
                fill(row, fabric, passing, YarnId { family: *family, yarn: *yarn }, *place);
            }
            free
        });
        shadows.free = filled.concat();
        shadows
    }

    pub(super) fn memory_bytes(&self) -> usize {
        self.free.len() + size_of_val(self.patterns.as_slice())
    }

    /// The shadows about a place of a yarn [um along it].
    #[inline]
    pub(super) fn at(&self, fabric: &Fabric, family: Family, yarn: i32, along_um: f32) -> ShadowsAt<'_> {
        let per_um = fabric.yarns[family.other() as usize].per_spacing * PLACES as f32;
        let (place, between) = floor_fraction(along_um * per_um);
        let row = |place: i32| -> &[u8; SIZE] {
            let at = if self.patterns.is_empty() {
                let [own, other] = [family, family.other()].map(|f| fabric.draft.threads(f));
                let first = if family == Family::Warp { 0 } else { PLACES * own * other };
                let places = PLACES * other;
                first + yarn.rem_euclid(own as i32) as usize * places + place.rem_euclid(places as i32) as usize
            } else {
                let crossing = place.div_euclid(PLACES as i32);
                let phase = place.rem_euclid(PLACES as i32) as usize;
                self.patterns[(family as usize * PLACES + phase) * 512 + pattern(fabric, family, yarn, crossing)]
                    as usize
            };
            self.free[at * SIZE..].first_chunk().unwrap_or(&[255; SIZE])
        };
        ShadowsAt { rows: [row(place), row(place.wrapping_add(1))], between }
    }
}

/// Shadows about one place.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadowsAt<'a> {
    rows: [&'a [u8; SIZE]; 2],
    between: f32,
}

impl ShadowsAt<'_> {
    /// Chances of being free in direction `b` at the offsets from the yarn's axis.
    #[inline]
    pub(super) fn free(&self, b: [f32; 3]) -> FreeAt {
        let z = b[2].abs().min(1.0);
        let r = ((row_of(z) - 0.5).max(0.0) as usize).min(ROWS - 2);
        // Towards the plane all is shadow; towards the pole the last row counts.
        let s = ((z - MEAN_Z[r]) / (MEAN_Z[r + 1] - MEAN_Z[r])).min(1.0);
        let column = (crate::math::simd::atan2::<false>(b[1], b[0]) / TAU + 1.0) * COLUMNS as f32 - 0.5;
        let (c, t) = floor_fraction(column);
        let (c0, c1) = ((c as usize) % COLUMNS, (c as usize + 1) % COLUMNS);
        let first = if b[2] < 0.0 { ROWS } else { 0 };
        let mut sum = [0.0f32; LANES];
        for (row, weight) in self.rows.iter().zip([1.0 - self.between, self.between]) {
            for (r, wr) in [(r, 1.0 - s), (r + 1, s)] {
                for (c, wc) in [(c0, 1.0 - t), (c1, t)] {
                    let at = ((first + r) * COLUMNS + c) * LANES;
                    let w = weight * wr * wc;
                    if let Some(lanes) = row[at..].first_chunk::<LANES>() {
                        for l in 0..LANES {
                            sum[l] += w * f32::from(lanes[l]);
                        }
                    }
                }
            }
        }
        FreeAt { at: std::array::from_fn(|o| (sum[o] * (1.0 / 255.0)).max(0.0)) }
    }
}

/// Chances of being free in a direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct FreeAt {
    at: [f32; OFFSETS],
}

impl FreeAt {
    /// Of light that leaves evenly within `half` of an offset from the yarn's axis, both over half of the yarn's width.
    #[inline]
    pub(super) fn within(&self, offset: f32, half: f32) -> f32 {
        const PER: f32 = 0.5 * OFFSETS as f32;
        let half = half.min(1.0);
        let center = offset.clamp(half - 1.0, 1.0 - half);
        let (low, high) = ((center - half + 1.0) * PER, (center + half + 1.0) * PER);
        let mut sum = 0.0;
        for (o, free) in self.at.iter().enumerate() {
            sum += free * (high.min(o as f32 + 1.0) - low.max(o as f32)).max(0.0);
        }
        sum / (high - low)
    }
}

/// Bits of the nine crossings around: the yarn's own and its neighbors', at this crossing and the ones beside.
fn pattern(fabric: &Fabric, family: Family, yarn: i32, crossing: i32) -> usize {
    let mut bits = 0;
    for y in -1..=1 {
        for c in -1..=1 {
            bits = 2 * bits + usize::from(fabric.is_on_top(family, yarn.wrapping_add(y), crossing.wrapping_add(c)));
        }
    }
    bits
}

/// One place: lines in every direction, from every offset.
fn fill(row: &mut [u8], fabric: &Fabric, passing: &impl Passing, id: YarnId, place: i32) {
    let spacing = fabric.yarns[id.family.other() as usize].spacing;
    let radius = fabric.yarns[id.family as usize].half_width;
    let mut rng = SplitMix64((id.yarn as u64) << 32 ^ (place as u64) << 2 ^ id.family as u64);
    let mut number = || rng.next_f64() as f32;
    for (i, entry) in row.chunks_exact_mut(LANES).enumerate() {
        let (r, c) = (i / COLUMNS, i % COLUMNS);
        let sign = if r < ROWS { 1.0 } else { -1.0 };
        for o in 0..OFFSETS {
            let mut free = 0.0;
            for k in 0..LINES {
                let spread = |u: f32| (k as f32 + u) / LINES as f32;
                let along = spacing * (place as f32 + number() - 0.5) / PLACES as f32;
                let z = sign * z_of((r % ROWS) as f32 + number());
                let (sin, cos) = (TAU * (c as f32 + spread(number())) / COLUMNS as f32).sin_cos();
                let across = (1.0 - z * z).max(0.0).sqrt();
                let b = [across * cos, across * sin, z];
                let t = ((o as f32 + number()) / OFFSETS as f32 * 2.0 - 1.0) * radius;
                let line = fabric.center_line(id.family, id.yarn, f64::from(along));
                let [center, axis] = [line.point_um, line.tangent].map(|v| v.map(|v| v as f32));
                let x =
                    [b[1] * axis[2] - b[2] * axis[1], b[2] * axis[0] - b[0] * axis[2], b[0] * axis[1] - b[1] * axis[0]];
                let scale = t / (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt().max(1e-3);
                let inner = std::array::from_fn(|i| center[i] + scale * x[i]);
                let from = exit(center, axis, radius, inner, b);
                free += free_share(fabric, passing, from, b, Some(fabric.own(id, from, b)));
            }
            let free = free / LINES as f32;
            entry[o] = (255.0 * free + 0.5) as u8;
        }
    }
}

/// Share of the light of a line that passes beside all plies.
fn free_share(
    fabric: &Fabric,
    passing: &impl Passing,
    from: [f32; 3],
    d: [f32; 3],
    skip: Option<(YarnId, f32)>,
) -> f32 {
    let mut flight = fabric.flight(from, d, skip);
    let mut free = 1.0;
    while let Some(near) = flight.next_near() {
        let hit = &near.hit;
        free *= passing.r_d(hit.family, hit.yarn, hit.theta_i, hit.h_um);
        if free < 1e-3 {
            return 0.0;
        }
    }
    free
}

/// Fraction of a beam that passes a ply of this model.
pub(super) fn r_d(model: &PlyModel, theta_i: f32, h_um: f32) -> f32 {
    use crate::ply::Lobes;
    Lobes::<1>::energies(&model.uncached(theta_i, h_um, [0.0])).r_d
}
